"""Rods that push, pull or strike a link, as a scenario file writes them."""

from __future__ import annotations

from surefoot.schemas.robot_file import NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct


class _Rod(FileStruct, frozen=True, kw_only=True):
    """What all rods share: they touch a link at its centre of mass."""

    body: str
    """Link of the URDF."""
    direction_deg: float = 0.0
    """In the ground's plane, the world's axes: 0 along x, 90 along y."""
    start_s: NonNegative = 0.0
    """When it begins."""


class _DrivenRod(_Rod, frozen=True, kw_only=True):
    """A rod that follows a course."""

    frequency_hz: Positive | None = None
    """Of a sine that fades in over its first period."""
    rise_s: Positive | None = None
    """Instead of a sine: how long it takes to go there, once, and stay."""

    def __post_init__(self) -> None:
        """Check that there is one course."""
        if (self.frequency_hz is None) == (self.rise_s is None):
            raise ValueError("needs either `frequency_hz` or `rise_s`, not both")


class ForceRod(_DrivenRod, frozen=True, kw_only=True, tag="force", tag_field="kind"):
    """Pushes and pulls with a given force, wherever the link goes."""

    amplitude_n: Positive
    """Of the force."""


class DisplacementRod(
    _DrivenRod, frozen=True, kw_only=True, tag="displacement", tag_field="kind"
):
    """Leads the link along a given way, by a stiff spring and a damper."""

    amplitude_m: Positive
    """From where the link was when it began."""
    stiffness_n_m: Positive = 1e5
    """Between rod and link."""
    damping_n_s_m: NonNegative = 1.5e3
    """Between rod and link."""


class StrikeRod(_Rod, frozen=True, kw_only=True, tag="strike", tag_field="kind"):
    """A free mass that meets the link once, with a pad between, as a pendulum does."""

    mass_kg: Positive
    """Of the striker."""
    speed_m_s: Positive
    """With which it arrives."""
    stiffness_n_m: Positive = 2e4
    """Of the pad."""


Rod = ForceRod | DisplacementRod | StrikeRod
