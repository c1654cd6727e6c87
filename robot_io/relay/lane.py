"""Applies a relay's faults, one after the other, to the messages of one channel."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from functools import singledispatch
from random import Random
from typing import NamedTuple

import msgspec

from surefoot.schemas.arrays import MS_PER_S
from surefoot.schemas.codec import decode_map
from surefoot.schemas.errors import MessageError
from surefoot.schemas.relay_plan import (
    ClockJumpFault,
    CorruptFault,
    CutFault,
    DelayFault,
    DropFault,
    DuplicateFault,
    JitterFault,
    RelayFault,
    RelayPlan,
    ReorderFault,
)

NS_PER_S = 1_000_000_000


class Parcel(NamedTuple):
    """A message and its time of departure.

    Attributes:
        at_s: departure, on the clock of the arrivals [s].
        data: the message, encoded.
        in_order: whether it waits for those before it; False for one that was held
            back while others overtook it.
    """

    at_s: float
    data: bytes
    in_order: bool = True


Parcels = tuple[Parcel, ...]
Act = Callable[[Parcel], Parcels]
"""Turns a message into the messages that go on instead. The unchanged message means
that the fault did nothing."""


@singledispatch
def act_of(fault: RelayFault, chance: Random) -> Act:
    """Return the effect of a fault on a message."""
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
            return (parcel,)  # the receiver will report what is wrong with it
        return (parcel._replace(data=data),)

    return act


class Lane:
    """One channel through the relay.

    It keeps the order of its messages, as a link does; only a fault that holds messages
    back lets others overtake them. The same plan, seed and arrivals give the same
    departures.

    Attributes:
        counts: ``arrived``, ``left``, and for each kind of fault the number of messages
            that it changed.
    """

    def __init__(self, plan: RelayPlan, channel: str, *, seed: int) -> None:
        """Take a channel's faults from the plan.

        Args:
            plan: plan of the relay.
            channel: name of the channel.
            seed: seed of all random numbers. Each fault and channel has its own
                sequence, so one more fault in the plan does not change the others.
        """
        self.counts: Counter[str] = Counter()
        self._faults = [
            (fault, str(fault.__struct_config__.tag), act_of(fault, chance))
            for index, fault in plan.faults_of(channel)
            for chance in [Random(f"{seed} {channel} {index}")]
        ]
        self._newest_s = -math.inf

    def pass_on(
        self, data: bytes, *, now_s: float, elapsed_s: float | None
    ) -> list[Parcel]:
        """Return the messages that go on for one that came, with their departures.

        Args:
            data: the message as it came.
            now_s: its arrival; never goes back [s].
            elapsed_s: time since the first command, when the plan begins [s]; None
                before it, when messages pass unchanged.

        Returns:
            The messages that go on instead; none when it is lost.
        """
        self.counts["arrived"] += 1
        parcels = [Parcel(now_s, data)]
        if elapsed_s is not None:
            for fault, kind, act in self._faults:
                if not fault.is_on(elapsed_s):
                    continue
                before, parcels = parcels, [o for p in parcels for o in act(p)]
                self.counts[kind] += parcels != before
        self.counts["left"] += len(parcels)
        return [self._in_order(parcel) for parcel in parcels]

    def _in_order(self, parcel: Parcel) -> Parcel:
        if not parcel.in_order:
            return parcel
        self._newest_s = max(self._newest_s, parcel.at_s)
        return parcel._replace(at_s=self._newest_s)


class PlanClock:
    """Time since the first joint command; before it the plan is not in force."""

    def __init__(self) -> None:
        """Start without a beginning."""
        self._began_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Begin; later calls change nothing."""
        if self._began_s is None:
            self._began_s = now_s

    def elapsed_s(self, now_s: float) -> float | None:
        """Return the time since the beginning [s]; None before it."""
        return None if self._began_s is None else now_s - self._began_s
