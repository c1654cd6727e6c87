from __future__ import annotations

import math
from typing import Any

import msgpack
import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.schemas import messages
from surefoot.schemas.codec import MAX_MESSAGE_BYTES, decode, encode
from surefoot.schemas.errors import MessageError, SchemaVersionError
from surefoot.schemas.messages import SCHEMA_VERSION
from tests.schemas.messages_strategy import JOINT_COUNT, KINDS, messages_of
from tests.schemas.simplest_message import simplest_message

every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
any_kind = st.sampled_from(KINDS)
command = messages.JointCommand(
    schema=SCHEMA_VERSION,
    tick=7,
    stamp_ns=123,
    q=[0.1, -0.2, 0.3, 0.0, 1.5],
    commander="stabilizer",
    sequence=8,
)


def packed(**changes: Any) -> bytes:
    """Return a valid command with some fields replaced, packed without our codec."""
    return msgpack.packb({**msgspec.to_builtins(command), **changes})


def refusal(data: bytes, kind: type[msgspec.Struct] = messages.JointCommand) -> str:
    """Return the field in a refusal, whose text must begin with kind and field."""
    with pytest.raises(MessageError) as caught:
        decode(data, kind, joint_count=JOINT_COUNT)
    field = caught.value.field
    assert str(caught.value).startswith(
        f"{kind.__name__}.{field}: " if field else f"{kind.__name__}: "
    )
    return field


@every_kind
@settings(max_examples=30)
@given(data=st.data())
def test_messages_survive_the_wire(
    kind: type[msgspec.Struct], data: st.DataObject
) -> None:
    message = data.draw(messages_of(kind))
    assert decode(encode(message), kind, joint_count=JOINT_COUNT) == message


@every_kind
@settings(max_examples=10)
@given(data=st.data())
def test_other_messagepack_libraries_speak_the_same(
    kind: type[msgspec.Struct], data: st.DataObject
) -> None:
    message = data.draw(messages_of(kind))
    plain = msgspec.to_builtins(message)
    assert msgpack.unpackb(encode(message)) == plain
    assert decode(msgpack.packb(plain), kind, joint_count=JOINT_COUNT) == message


@settings(max_examples=300)
@given(kind=any_kind, data=st.binary(max_size=200))
def test_arbitrary_bytes_raise_message_errors_only(
    kind: type[msgspec.Struct], data: bytes
) -> None:
    with pytest.raises(MessageError):
        decode(data, kind, joint_count=JOINT_COUNT)


@settings(max_examples=200)
@given(kind=any_kind, data=st.data())
def test_damaged_messages_decode_or_raise_message_errors(
    kind: type[msgspec.Struct], data: st.DataObject
) -> None:
    good = encode(data.draw(messages_of(kind)))
    place = data.draw(st.integers(0, len(good) - 1))
    bad = good[:place] + data.draw(st.binary(max_size=3)) + good[place + 1 :]
    try:
        message = decode(bad, kind, joint_count=JOINT_COUNT)
    except MessageError:
        return
    assert decode(encode(message), kind, joint_count=JOINT_COUNT) == message


_PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats()
    | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)  # fmt: skip


@settings(max_examples=300)
@given(kind=any_kind, data=st.data())
def test_any_value_in_any_field_is_taken_or_named(
    kind: type[msgspec.Struct], data: st.DataObject
) -> None:
    plain = _example(kind)
    name = data.draw(st.sampled_from(sorted(plain)))
    plain[name] = data.draw(_PLAIN)
    named = name
    try:
        decode(msgpack.packb(plain), kind, joint_count=JOINT_COUNT)
    except MessageError as error:
        named = error.field
    # The rule on both feet or none is the message's, not a single field's.
    assert named.startswith(name) or (named == "" and name == "feet")


@settings(max_examples=300)
@given(kind=any_kind, data=st.data())
def test_the_quick_way_takes_nothing_that_two_steps_refuse(
    kind: type[msgspec.Struct], data: st.DataObject
) -> None:
    plain = _example(kind)
    plain[data.draw(st.sampled_from(sorted(plain)))] = data.draw(_PLAIN)
    packed_bytes = msgpack.packb(plain)
    try:
        message = decode(packed_bytes, kind, joint_count=JOINT_COUNT)
    except MessageError:
        return
    assert message == msgspec.convert(msgpack.unpackb(packed_bytes), kind)


@every_kind
def test_each_missing_field_is_named(kind: type[msgspec.Struct]) -> None:
    example = _example(kind)
    for name in kind.__struct_fields__:
        if name == "schema":
            continue
        raw = {"schema": SCHEMA_VERSION}
        before = kind.__struct_fields__[: kind.__struct_fields__.index(name)]
        raw |= {key: example[key] for key in before}
        assert refusal(msgpack.packb(raw), kind) == name


def _example(kind: type[msgspec.Struct]) -> dict[str, Any]:
    return simplest_message(kind, joint_count=JOINT_COUNT)


@pytest.mark.parametrize("size", [0, JOINT_COUNT - 1, JOINT_COUNT + 1])
def test_wrong_joint_count_is_named(size: int) -> None:
    assert refusal(packed(q=[0.0] * size)) == "q"


def test_joint_count_is_free_when_not_given() -> None:
    assert decode(packed(q=[1.0]), messages.JointCommand).q == [1.0]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_non_finite_numbers_are_named_with_their_index(value: float) -> None:
    assert refusal(packed(q=[0.0, 0.0, value, 0.0, 0.0])) == "q[2]"


def test_large_finite_numbers_are_accepted() -> None:
    q = [1.7e308] * JOINT_COUNT
    assert decode(packed(q=q), messages.JointCommand, joint_count=JOINT_COUNT).q == q


def test_non_finite_numbers_in_nested_structs_are_named() -> None:
    foot = {"position": [0.0, math.nan, 0.0], "quat_xyzw": [0.0, 0.0, 0.0, 1.0]}
    raw = {**_example(messages.Reference), "feet": [foot, foot]}
    data = msgpack.packb(raw)
    assert refusal(data, messages.Reference) == "feet[0].position[1]"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"tick": True}, "tick"),
        ({"tick": 1.0}, "tick"),
        ({"tick": "1"}, "tick"),
        ({"tick": -1}, "tick"),
        ({"tick": 2**63}, "tick"),
        ({"tick": None}, "tick"),
        ({"schema": True}, "schema"),
        ({"q": 1.0}, "q"),
        ({"q": b"\x00" * 8}, "q"),
        ({"q": [True] * 5}, "q[0]"),
        ({"q": [0.0, "0", 0.0, 0.0, 0.0]}, "q[1]"),
        ({"q": [0.0, None, 0.0, 0.0, 0.0]}, "q[1]"),
        ({"commander": 5}, "commander"),
        ({"surprise": 1}, "surprise"),
    ],
)
def test_wrong_types_and_unknown_fields_are_named(
    changes: dict[str, Any], field: str
) -> None:
    assert refusal(packed(**changes)) == field


def test_whole_numbers_are_numbers() -> None:
    message = decode(packed(q=[1, 2, 3, 4, 5]), messages.JointCommand)
    assert message.q == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert all(type(value) is float for value in message.q)


@pytest.mark.parametrize("version", [0, SCHEMA_VERSION + 1, 2**64 - 1])
def test_another_schema_version_is_told_apart(version: int) -> None:
    with pytest.raises(SchemaVersionError, match=f"version {version}") as caught:
        decode(packed(schema=version), messages.JointCommand)
    assert caught.value.field == "schema"


def test_another_schema_version_wins_over_its_other_fields() -> None:
    data = msgpack.packb({"schema": SCHEMA_VERSION + 1, "joints": {"left_knee": 0.7}})
    with pytest.raises(SchemaVersionError):
        decode(data, messages.JointCommand)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"hello",
        encode(command) + b"\x00",
        encode(command)[:-1],
        b"\x91" * 50_000,
        b"\xdd\xff\xff\xff\xff",
        b"\x81\xa1q\xdd\xff\xff\xff\xff",
        b"\x81\xa9commander\xa2\xff\xfe",
        msgpack.packb([1, 2, 3]),
        msgpack.packb({1: 2}),
    ],
)
def test_what_is_no_message_is_refused_as_a_whole(data: bytes) -> None:
    assert refusal(data) == ""


def test_huge_messages_are_refused_unread() -> None:
    with pytest.raises(MessageError, match=str(MAX_MESSAGE_BYTES)):
        decode(packed(commander="x" * MAX_MESSAGE_BYTES), messages.JointCommand)


def test_one_foot_alone_is_no_reference() -> None:
    foot = {"position": [0.0] * 3, "quat_xyzw": [0.0, 0.0, 0.0, 1.0]}
    raw = {**_example(messages.Reference), "feet": [foot]}
    with pytest.raises(MessageError, match="feet"):
        decode(msgpack.packb(raw), messages.Reference)


def test_service_replies_are_checked_for_joints_too() -> None:
    raw = {**_example(messages.ServiceReply), "q_command": [0.0]}
    assert refusal(msgpack.packb(raw), messages.ServiceReply) == "q_command"


def test_bytes_that_msgpack_refuses_without_a_word_are_named_too() -> None:
    with pytest.raises(MessageError, match=r"ImuState: not MessagePack: \w"):
        decode(b"\xc1rubbish", messages.ImuState)
