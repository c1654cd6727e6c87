"""What each kind of fault does to one message."""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from random import Random
from typing import NamedTuple

import msgspec

from surefoot.schemas.codec import decode_map
from surefoot.schemas.errors import MessageError
from surefoot.schemas.relay_plan import (
    MS_PER_S,
    ClockJumpFault,
    CorruptFault,
    CutFault,
    DelayFault,
    DropFault,
    DuplicateFault,
    JitterFault,
    RelayFault,
    ReorderFault,
)

NS_PER_S = 1_000_000_000


class Parcel(NamedTuple):
    """Bytes and when they go on.

    Attributes:
        at_s: when, on the clock they arrived by [s].
        data: the message, encoded.
        in_order: whether it waits for those before it; False for one that was kept
            back while others overtook it.
    """

    at_s: float
    data: bytes
    in_order: bool = True


Parcels = tuple[Parcel, ...]
Act = Callable[[Parcel], Parcels]
"""Turns a message into those that go on instead. The same one says that nothing was
done to it."""


@singledispatch
def act_of(fault: RelayFault, chance: Random) -> Act:
    """Return what a fault does to a message that meets it.

    Args:
        fault: of the plan.
        chance: decides for this fault and channel alone.
    """
    raise TypeError(f"no fault: {fault!r}")


@act_of.register
def _drop(fault: DropFault, chance: Random) -> Act:
    return lambda parcel: () if chance.random() < fault.probability else (parcel,)


@act_of.register
def _cut(fault: CutFault, chance: Random) -> Act:
    del fault, chance
    return lambda parcel: ()


@act_of.register
def _delay(fault: DelayFault, chance: Random) -> Act:
    del chance
    later_s = fault.ms / MS_PER_S
    return lambda parcel: (parcel._replace(at_s=parcel.at_s + later_s),)


@act_of.register
def _jitter(fault: JitterFault, chance: Random) -> Act:
    most_s = fault.ms / MS_PER_S
    return lambda parcel: (
        parcel._replace(at_s=parcel.at_s + chance.uniform(0.0, most_s)),
    )


@act_of.register
def _duplicate(fault: DuplicateFault, chance: Random) -> Act:
    later_s = fault.ms / MS_PER_S

    def act(parcel: Parcel) -> Parcels:
        if chance.random() >= fault.probability:
            return (parcel,)
        stays = parcel.in_order and later_s == 0.0
        return parcel, parcel._replace(at_s=parcel.at_s + later_s, in_order=stays)

    return act


@act_of.register
def _reorder(fault: ReorderFault, chance: Random) -> Act:
    later_s = fault.ms / MS_PER_S

    def act(parcel: Parcel) -> Parcels:
        if chance.random() >= fault.probability:
            return (parcel,)
        return (parcel._replace(at_s=parcel.at_s + later_s, in_order=False),)

    return act


@act_of.register
def _corrupt(fault: CorruptFault, chance: Random) -> Act:
    def act(parcel: Parcel) -> Parcels:
        if not parcel.data or chance.random() >= fault.probability:
            return (parcel,)
        data = bytearray(parcel.data)
        size = 8 * len(data)
        for bit in chance.sample(range(size), min(fault.bits, size)):
            data[bit // 8] ^= 1 << bit % 8
        return (parcel._replace(data=bytes(data)),)

    return act


@act_of.register
def _clock_jump(fault: ClockJumpFault, chance: Random) -> Act:
    del chance
    shift_ns = round(fault.seconds * NS_PER_S)

    def act(parcel: Parcel) -> Parcels:
        try:
            message = decode_map(parcel.data)
            message["stamp_ns"] = max(0, message["stamp_ns"] + shift_ns)
            data = msgspec.msgpack.encode(message)
        except (MessageError, KeyError, TypeError, ValueError, OverflowError):
            return (parcel,)  # whoever gets it will say what is wrong with it
        return (parcel._replace(data=data),)

    return act
