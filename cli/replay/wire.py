"""Messages of a record as they were on the bus."""

from __future__ import annotations

import math
from typing import Any

import msgspec

_NULL = b"null"


def to_wire(data: bytes, *, is_raw: bool) -> bytes:
    """The MessagePack bytes of a message.

    JSON knows no NaN and no infinity: a reading that was either is null in the record
    and NaN again afterwards. All other numbers come back bit for bit.

    Args:
        data: as recorded.
        is_raw: whether these are the bytes of the bus already.

    Raises:
        DecodeError: the record holds no JSON there (msgspec).
    """
    if is_raw:
        return data
    message: dict[str, Any] = msgspec.json.decode(data)
    if _NULL in data:
        message = {name: _restored(value) for name, value in message.items()}
    return msgspec.msgpack.encode(message)


def _restored(value: Any) -> Any:
    if value is None:
        return math.nan
    if isinstance(value, list):
        return [_restored(item) for item in value]
    return value
