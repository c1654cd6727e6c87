"""Applies faults to the messages of one channel; pure: no clock and no bus."""

from __future__ import annotations

import math
from collections import Counter
from random import Random

from surefoot.robot_io.relay.faults import Parcel, act_of
from surefoot.schemas.relay_plan import RelayPlan


class Lane:
    """One channel through the relay.

    It keeps the order of its messages, as a link does; only a fault that keeps
    messages back lets others overtake them. The same plan, seed and arrivals give the
    same departures.

    Attributes:
        counts: ``arrived``, ``left``, and for each kind of fault the messages it did
            something to.
    """

    def __init__(self, plan: RelayPlan, channel: str, *, seed: int) -> None:
        """Take a channel's faults from the plan.

        Args:
            plan: of the relay.
            channel: name of the channel.
            seed: of all chance. Each fault and channel has its own sequence, so that
                one more fault in the plan changes nothing about the others.
        """
        self.counts: Counter[str] = Counter()
        self._faults = [
            (fault, str(fault.__struct_config__.tag), act_of(fault, chance))
            for index, fault in plan.faults_of(channel)
            for chance in [Random(f"{seed} {channel} {index}")]
        ]
        self._newest_s = -math.inf

    @property
    def is_clear(self) -> bool:
        """Whether no fault of the plan acts on this channel."""
        return not self._faults

    def pass_on(
        self, data: bytes, *, now_s: float, elapsed_s: float | None
    ) -> list[Parcel]:
        """Say when a message goes on, and as what.

        Args:
            data: the message as it came.
            now_s: when it came, never going back [s].
            elapsed_s: since the first command, when the plan's time begins [s]; None
                before it, when nothing is touched.

        Returns:
            What goes on instead: nothing when it is lost.
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
    """Counts from the first joint command; before it the plan is not in force."""

    def __init__(self) -> None:
        """Start without a time."""
        self._began_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Begin; later calls change nothing."""
        if self._began_s is None:
            self._began_s = now_s

    def elapsed_s(self, now_s: float) -> float | None:
        """Return the time since it began [s]; None before."""
        return None if self._began_s is None else now_s - self._began_s
