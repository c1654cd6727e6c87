"""Motions of the ground, as a scenario file writes them.

Angles are written in degrees and turned into radians here, at the border.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from surefoot.schemas.robot_file import NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct

Axis = Literal["x", "y", "z", "roll", "pitch", "yaw"]
ROTATIONS = ("roll", "pitch", "yaw")
BLEND_S = 0.020
"""Ramps, drops and ternary sequences change their velocity over this time [s]."""
PRTS_STATE_S = 0.25
"""How long a state of the ternary sequence lasts at its own speed [s]."""
PRTS_SPAN_STATES = 9
"""Span of the integrated sequence, in units of one state's way."""
Quantity = Literal["position", "velocity", "acceleration"]
_Lengths = Literal["m", "cm", "mm", "m/s", "cm/s", "mm/s", "m/s2", "cm/s2", "mm/s2"]
_Angles = Literal["deg", "rad", "deg/s", "rad/s", "deg/s2", "rad/s2"]
Units = _Lengths | Literal["gal", "g"] | _Angles
STANDARD_GRAVITY = 9.80665
_DEG = math.pi / 180.0
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_ANGLES = {"deg": _DEG, "rad": 1.0}
_PER: dict[Quantity, str] = {"position": "", "velocity": "/s", "acceleration": "/s2"}
_GRAVITIES = {"gal": 1e-2, "g": STANDARD_GRAVITY}


class _Motion(FileStruct, frozen=True, kw_only=True):
    """Fields of all motions: an axis of the platform's top centre and a start."""

    axis: Axis
    """Axis along or about which the platform's top centre moves."""
    start_s: NonNegative = 0.0
    """Time at which the motion begins."""
    blend_s: Positive | None = None
    """Time in which velocity builds up; each kind says what holds when it is absent."""

    @property
    def is_rotation(self) -> bool:
        """Whether the axis is a rotation."""
        return self.axis in ROTATIONS

    def _si(self, stem: str, per: str = "") -> float:
        if self.is_rotation:
            value = getattr(self, f"{stem}_deg{per}")
            return math.radians(value) if value is not None else 0.0
        value = getattr(self, f"{stem}_m{per}")
        return float(value) if value is not None else 0.0

    def _only_unit(self, stem: str, *, per: str = "", required: bool) -> None:
        right, wrong = f"{stem}_m{per}", f"{stem}_deg{per}"
        if self.is_rotation:
            right, wrong = wrong, right
        if getattr(self, wrong) is not None:
            raise ValueError(f"axis {self.axis!r} takes `{right}`, got `{wrong}`")
        if required and getattr(self, right) is None:
            raise ValueError(f"axis {self.axis!r} needs `{right}`")


class _SizedMotion(_Motion, frozen=True, kw_only=True):
    """A motion with an amplitude."""

    amplitude_m: Annotated[float, msgspec.Meta(ge=-20.0, le=20.0)] | None = None
    """Amplitude along x, y or z; signed for ramps and drops."""
    amplitude_deg: float | None = None
    """Amplitude about roll, pitch or yaw; signed for ramps and drops."""

    def __post_init__(self) -> None:
        """Check that the size has the unit of the axis."""
        self._only_unit("amplitude", required=True)

    @property
    def amplitude(self) -> float:
        """Size in SI [m or rad]."""
        return self._si("amplitude")


class SineMotion(_SizedMotion, frozen=True, kw_only=True, tag="sine", tag_field="kind"):
    """Sine that fades in over ``blend_s``, or over its first period."""

    frequency_hz: Positive
    """Frequency of the sine."""
    phase_deg: float = 0.0
    """Phase of the sine at its start."""


class RampMotion(_SizedMotion, frozen=True, kw_only=True, tag="ramp", tag_field="kind"):
    """Constant rate to the amplitude, blended over 20 ms (``blend_s``) at both ends."""

    rate_m_s: Positive | None = None
    """Magnitude of the rate along x, y or z."""
    rate_deg_s: Positive | None = None
    """Magnitude of the rate about roll, pitch or yaw."""

    def __post_init__(self) -> None:
        """Check units of amplitude and rate."""
        super().__post_init__()
        self._only_unit("rate", per="_s", required=True)

    @property
    def rate(self) -> float:
        """Magnitude of the rate in SI [m/s or rad/s]."""
        return self._si("rate", "_s")


class DropMotion(_SizedMotion, frozen=True, kw_only=True, tag="drop", tag_field="kind"):
    """Drop to the amplitude: in free fall, or at a given rate.

    It brakes over 20 ms (``blend_s``). At a given rate it also speeds up over that.
    """

    rate_m_s: Positive | None = None
    """Magnitude of the rate along x, y or z; z falls freely without one."""
    rate_deg_s: Positive | None = None
    """Magnitude of the rate about roll, pitch or yaw."""

    def __post_init__(self) -> None:
        """Check units; only z can fall freely."""
        super().__post_init__()
        self._only_unit("rate", per="_s", required=self.axis != "z")

    @property
    def rate(self) -> float | None:
        """Magnitude of the rate in SI, or None for a free fall."""
        return self._si("rate", "_s") or None


class PrtsMotion(_Motion, frozen=True, kw_only=True, tag="prts", tag_field="kind"):
    """Pseudo-random ternary sequence, the stimulus of human balance studies.

    Velocity is positive, zero or negative for 0.25 s at a time, 80 times a cycle, as
    given by a shift register; changes take 20 ms, or ``blend_s``. A cycle of 20 s ends
    where it began. Only the odd harmonics of the cycle have power.
    """

    peak_to_peak_m: Positive | None = None
    """Distance from the lowest to the highest place along x, y or z."""
    peak_to_peak_deg: Positive | None = None
    """Range from the lowest to the highest angle about roll, pitch or yaw."""
    speed: Positive = 1.0
    """Factor on the speed: 10.0 plays the sequence ten times as fast [1]."""
    cycles: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 3
    """Number of cycles; analyses leave out the first."""

    def __post_init__(self) -> None:
        """Check units, and that the velocity reaches its value within a state."""
        self._only_unit("peak_to_peak", required=True)
        if self.blend > self.state_s:
            raise ValueError(
                f"`blend_s` is {self.blend:g} s and a state lasts {self.state_s:g} s "
                f"at speed {self.speed:g}, expected at most as long a blend; lower one"
            )

    @property
    def state_s(self) -> float:
        """How long a state lasts [s]."""
        return PRTS_STATE_S / self.speed

    @property
    def blend(self) -> float:
        """How long a change of the velocity takes [s]."""
        return BLEND_S if self.blend_s is None else self.blend_s

    @property
    def rate(self) -> float:
        """Magnitude of the velocity [m/s or rad/s]."""
        return self._si("peak_to_peak") / (PRTS_SPAN_STATES * self.state_s)


class SpectrumMotion(
    _Motion, frozen=True, kw_only=True, tag="spectrum", tag_field="kind"
):
    """Irregular waves of a sea state, times a gain.

    The JONSWAP spectrum of the given height and period, from half to four times the
    peak frequency, as a sum of sines with random phases. Motions with the same ``seed``
    follow the same waves. They fade in over ``blend_s``, or over one peak period.
    """

    height_m: Positive
    """Significant height of the waves: four standard deviations."""
    period_s: Positive
    """Period at the peak of the spectrum."""
    gamma: Annotated[float, msgspec.Meta(ge=1.0, le=10.0)] = 3.3
    """Peak factor of the spectrum; 1.0 is a fully developed sea [1]."""
    gain: float = 1.0
    """Metres, or degrees for tilts, of the platform per metre of wave."""
    phase_deg: float = 0.0
    """Phase by which this axis is ahead of the waves."""
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    """Seed of the random phases."""

    @property
    def gain_si(self) -> float:
        """Gain in SI [m/m or rad/m]."""
        return math.radians(self.gain) if self.is_rotation else self.gain


class RecordedMotion(
    _Motion, frozen=True, kw_only=True, tag="recorded", tag_field="kind"
):
    """A motion somebody measured, read from a file.

    Text with a time and a value in each line (.csv), strong-motion records of PEER
    (.AT2, .VT2, .DT2) and of K-NET and KiK-net, or a channel of an MCAP file.
    Velocities and accelerations are integrated, with drift removed. The platform stays
    where the record ends. Velocity fades in and out over 20 ms, or over ``blend_s``.
    """

    file: Annotated[str, msgspec.Meta(min_length=1)]
    """Path of the record, relative to the scenario file; from Python, to the working
    directory."""
    quantity: Quantity | None = None
    """Measured quantity; not needed if the file states it (PEER, K-NET)."""
    units: Units | None = None
    """Units of the file's values; absent: those that the file states, else m or deg,
    per s or s2."""
    scale: float = 1.0
    """Factor on the motion [1]."""
    drift_hz: NonNegative | None = None
    """Cutoff below which motion is removed as drift, from 0.001 to less than half the
    record's rate. Absent: 0.1 for accelerations and velocities; 0.0 (nothing is
    removed) for positions."""
    from_s: NonNegative = 0.0
    """Time at which to begin, counted from the record's first sample."""
    to_s: Positive | None = None
    """Time at which to end, counted likewise; absent: at the record's end."""
    column: str = ""
    """Text files with a heading: name of the column, with or without its unit in
    brackets; absent: the second column."""
    channel: str = ""
    """MCAP: topic of the channel, with or without its leading slash."""
    field: str = ""
    """MCAP: number within a message, such as ``linear_acceleration.0``."""

    def __post_init__(self) -> None:
        """Check that units fit the axis and the quantity."""
        if self.scale == 0.0:
            raise ValueError("`scale` is 0, expected a factor other than 0")
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(
                f"`to_s` is {self.to_s:g}, expected more than `from_s`, {self.from_s:g}"
            )
        if self.units is not None and self.quantity is not None:
            self.si_factor(self.units, self.quantity)

    @property
    def blend(self) -> float:
        """How long velocity fades in and out [s]."""
        return BLEND_S if self.blend_s is None else self.blend_s

    def drift_of(self, quantity: Quantity) -> float:
        """Frequency below which motion is removed as drift [Hz]."""
        if self.drift_hz is not None:
            return self.drift_hz
        return 0.0 if quantity == "position" else 0.1

    def units_for(self, quantity: Quantity) -> dict[str, float]:
        """Return the units of a quantity along the axis in SI, the default first."""
        known = _ANGLES if self.is_rotation else _LENGTHS
        valid = {f"{name}{_PER[quantity]}": size for name, size in known.items()}
        if quantity == "acceleration" and not self.is_rotation:
            valid |= _GRAVITIES
        return valid

    def si_factor(self, units: str | None, quantity: Quantity) -> float:
        """Return the factor that turns a value of the file into SI.

        Args:
            units: units of the value; None for the default of axis and quantity.
            quantity: kind of the value.

        Raises:
            ValueError: the units do not fit this quantity along this axis.
        """
        valid = self.units_for(quantity)
        factor = valid.get(next(iter(valid)) if units is None else units)
        if factor is None:
            raise ValueError(
                f"`units` are {units!r}, expected one of {', '.join(map(repr, valid))} "
                f"for the {quantity} of axis {self.axis!r}"
            )
        return factor


Motion = (
    SineMotion | RampMotion | DropMotion | PrtsMotion | SpectrumMotion | RecordedMotion
)
