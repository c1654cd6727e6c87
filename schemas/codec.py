"""MessagePack codec with typed validation: bytes on the bus to messages and back.

The wire holds maps with string keys, numbers, strings, and arrays of them. A
message that does not fit is refused with an error that names the field.
"""

from __future__ import annotations

import math
import re
from typing import Any, TypeVar

import msgpack
import msgspec

from schemas.errors import MessageError, SchemaVersionError
from schemas.messages import SCHEMA_VERSION, Message

MAX_MESSAGE_BYTES = 65536
_T = TypeVar("_T", bound=msgspec.Struct)
_FIELD_IN_ERROR = re.compile(r"at `\$\.?([^`]*)`")
_NAME_IN_ERROR = re.compile(r"field `([^`]+)`")


def encode(message: msgspec.Struct) -> bytes:
    """Packs a message.

    Args:
        message: any struct of :mod:`schemas.messages`.

    Returns:
        MessagePack bytes.
    """
    packed: bytes = msgpack.packb(msgspec.to_builtins(message))
    return packed


def decode(data: bytes, kind: type[_T], *, joint_count: int | None = None) -> _T:
    """Unpacks and checks a message.

    Args:
        data: bytes from the bus.
        kind: the struct that the topic carries.
        joint_count: n_a of the robot; when given, every per-joint field must have
            exactly so many numbers.

    Returns:
        The message; every number in it is finite.

    Raises:
        SchemaVersionError: written for another schema version.
        MessageError: anything else that is wrong; ``field`` names the place.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError(
            f"{kind.__name__}: {len(data)} bytes, at most {MAX_MESSAGE_BYTES} allowed"
        )
    try:
        raw = msgpack.unpackb(data)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise MessageError(
            f"{kind.__name__}: not MessagePack ({type(error).__name__}: {error})"
        ) from error
    if not isinstance(raw, dict):
        raise MessageError(f"{kind.__name__}: got {type(raw).__name__}, expected a map")
    _check_version(raw, kind)
    try:
        message = msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise _message_error(kind, error) from error
    _check_finite(raw, kind)
    if joint_count is not None and isinstance(message, Message):
        for name in message.PER_JOINT:
            size = len(raw[name])
            if size != joint_count:
                raise MessageError(
                    f"{kind.__name__}.{name}: got {size} numbers, expected "
                    f"{joint_count}, one per joint of the robot file",
                    field=name,
                )
    return message


def _check_version(raw: dict[str, Any], kind: type[msgspec.Struct]) -> None:
    version = raw.get("schema", SCHEMA_VERSION)
    if isinstance(version, int) and version != SCHEMA_VERSION:
        raise SchemaVersionError(
            f"{kind.__name__}.schema: got version {version}, this side speaks "
            f"{SCHEMA_VERSION}; install the same release on both sides",
            field="schema",
        )


def _check_finite(value: Any, kind: type[msgspec.Struct], path: str = "") -> None:
    """Refuses NaN and infinities anywhere; a sum is finite only if all terms are."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise MessageError(
                f"{kind.__name__}.{path}: got {value}, expected a finite number",
                field=path,
            )
    elif isinstance(value, list):
        if value and isinstance(value[0], (int, float)):
            if math.isfinite(sum(value)):
                return
            for index, item in enumerate(value):
                _check_finite(item, kind, f"{path}[{index}]")
            raise MessageError(
                f"{kind.__name__}.{path}: numbers too large to add up", field=path
            )
        for index, item in enumerate(value):
            _check_finite(item, kind, f"{path}[{index}]")
    elif isinstance(value, dict):
        for name, item in value.items():
            _check_finite(item, kind, f"{path}.{name}" if path else name)


def _message_error(
    kind: type[msgspec.Struct], error: msgspec.ValidationError
) -> MessageError:
    return MessageError(f"{kind.__name__}: {error}", field=field_of(error))


def field_of(error: msgspec.ValidationError) -> str:
    """Path of the field a validation error speaks of, without the leading ``$``."""
    text = str(error)
    place = _FIELD_IN_ERROR.search(text)
    path = place.group(1) if place else ""
    name = _NAME_IN_ERROR.search(text)
    if name is None:
        return path
    return f"{path}.{name.group(1)}" if path else name.group(1)
