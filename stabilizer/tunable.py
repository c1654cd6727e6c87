"""Controllers whose gains may change between two ticks."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from schemas.settings import ControllerSettings


@runtime_checkable
class Tunable(Protocol):
    """A controller that takes new gains; one without this keeps those it has."""

    def retune(self, settings: ControllerSettings) -> None:
        """Uses these gains from the next step on.

        Args:
            settings: differ from those in use in LIVE_SETTINGS only.
        """
