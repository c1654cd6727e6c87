"""Overrides scenario values by path, such as ``platform.0.motion.1.rate_deg_s``.

Beside the file's own keys there are derived ones, for quantities that are not one
number of the file: the direction of a push at constant impulse, the peak rate of a
sine, the rate of a tilt about a diagonal, the pace of everything that moves.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
from msgspec.structs import fields

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.motions import ROTATIONS
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.schemas.scenario_robot import SensorDelays

Table = dict[str, Any]
_PACE, _TILT_RATE = "pace", "tilt_rate_deg_s"
_NOT_SWEPT = ("name", "description")
_PACED = ("frequency_hz", "rate_m_s", "rate_deg_s", "speed")
"""Keys of motions that are multiplied by the pace."""
_TABLES = ("sensors", "delay", "model_error", "start")
_OPEN: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(
        (
            f"sensors.{stem}"
            for stem in (
                *("gyro_noise_rad_s", "accel_noise_m_s2", "gyro_bias_rad_s"),
                *("accel_bias_m_s2", "gyro_scale", "accel_scale"),
                *("gyro_drift_rad_s_min", "accel_drift_m_s2_min"),
            )
        ),
        (),
    ),
    "delay.sensor_ms": tuple(field.name for field in fields(SensorDelays)),
    "sensors.encoder_offset_rad": (),
    "model_error.backlash_rad": (),
    "model_error.joint_friction_nm": (),
    "start.posture": (),
    **{
        f"sensors.{stem}": ("left", "right")
        for stem in (
            *("force_noise_n", "moment_noise_nm", "force_bias_n", "moment_bias_nm"),
            *("force_scale", "moment_scale", "force_drift_n_min"),
            "moment_drift_nm_min",
        )
    },
}
"""Values that may be one number or a table, with the keys the number stands for."""
_TILTING = ("sine", "ramp", "drop")


def override_scenario(scenario: Scenario, values: dict[str, Any]) -> Scenario:
    """Return a scenario with some of its values changed, in the order given.

    Args:
        scenario: scenario to start from; it is not changed.
        values: path to new value; see :func:`scenario_paths` for the paths.

    Raises:
        FileFormatError: no such path in this scenario (with the nearest valid one),
            or a value of the wrong type or out of range.
    """
    if not values:
        return scenario
    known = scenario_paths(scenario)
    table: Table = msgspec.to_builtins(scenario)
    for path, value in values.items():
        if (
            path not in known
            and not any(path.startswith(f"{whole}.") for whole in _OPEN)
            and not _is_absent(table, path)
        ):
            raise FileFormatError(_unknown(path, scenario, known), field=path)
        _set(table, path, value)
    words = ", ".join(f"{path}={value}" for path, value in values.items())
    return scenario_from_table(table, source=f"{scenario.name} with {words}")


def scenario_paths(scenario: Scenario) -> list[str]:
    """Return every path of a scenario that can be overridden, derived ones included."""
    table: Table = msgspec.to_builtins(scenario)
    paths = [path for path in _leaves(table) if path not in _NOT_SWEPT]
    for index, push in enumerate(scenario.push):
        if push.force_n is None:
            paths += [f"push.{index}.direction_deg"]
            continue
        paths += [f"push.{index}.direction_deg", f"push.{index}.impulse_n_s"]
    moving = False
    for at, platform in enumerate(table["platform"]):
        for index, motion in enumerate(platform["motion"]):
            moving = moving or any(motion.get(key) is not None for key in _PACED)
            if motion["kind"] == "sine":
                rate = "peak_rate_deg_s" if _turns(motion) else "peak_rate_m_s"
                paths.append(f"platform.{at}.motion.{index}.{rate}")
    if moving:
        paths.append(_PACE)
    motions = (m for each in table["platform"] for m in _horizontal(each))
    if any(motion["kind"] in _TILTING for motion in motions):
        paths.append(_TILT_RATE)
    return list(dict.fromkeys(paths))


def _unknown(path: str, scenario: Scenario, known: list[str]) -> str:
    near = difflib.get_close_matches(path, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"valid are {', '.join(known)}"
    return f"{path}: no such value in scenario {scenario.name!r}; {hint}"


def _is_absent(table: Table, path: str) -> bool:
    """Whether a path leads to a key of the scenario without a value."""
    *parents, name = path.split(".")
    place: Any = table
    for parent in parents:
        if isinstance(place, list) and parent.isdigit() and int(parent) < len(place):
            place = place[int(parent)]
        elif isinstance(place, dict) and parent in place:
            place = place[parent]
        else:
            return False
    return isinstance(place, dict) and name in place and place[name] is None


def _leaves(value: Any, path: str = "") -> Iterable[str]:
    """Yield the paths of all values: lists of numbers, and each number in them.

    Includes values that are absent from the tables every scenario has.
    """
    if isinstance(value, dict):
        if not value:
            yield path
        for key, inner in value.items():
            is_told = inner is not None or path in _TABLES
            if is_told and key not in ("kind", "axis", "foot"):
                yield from _leaves(inner, f"{path}.{key}" if path else key)
        return
    if isinstance(value, list):
        if value and not isinstance(value[0], dict):
            yield path
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{path}.{index}")
        return
    yield path


def _set(table: Table, path: str, value: Any) -> None:
    """Set one known path in a table of :func:`msgspec.to_builtins`."""
    if path in (_PACE, _TILT_RATE):
        (_set_pace if path == _PACE else _set_tilt_rate)(table, _positive(path, value))
        return
    *parents, name = path.split(".")
    place: Any = table
    for depth, parent in enumerate(parents):
        inner = place[int(parent)] if isinstance(place, list) else place[parent]
        if not isinstance(inner, (dict, list)):
            following = [*parents, name][depth + 1]
            if following.isdigit():  # one number for all axes becomes one for each
                inner = place[parent] = [inner] * 3
            else:
                parts = _OPEN.get(".".join(parents[: depth + 1]), ())
                inner = place[parent] = dict.fromkeys(parts, inner)
        place = inner
    derived = _DERIVED.get(name)
    if derived is not None:
        derived(place, _number(path, value))
    elif isinstance(place, list):
        place[int(name)] = value
    else:
        place[name] = value


def _set_direction(push: Table, direction_deg: float) -> None:
    """Turn a push about the vertical; 0 is forwards, 90 to the left."""
    if push["force_n"] is None:
        push["direction_deg"] = direction_deg
        return
    x, y, z = push["force_n"]
    size, angle = math.hypot(x, y), math.radians(direction_deg)
    push["force_n"] = [size * math.cos(angle), size * math.sin(angle), z]


def _set_impulse(push: Table, impulse_n_s: float) -> None:
    """Scale the force; the push keeps its direction and its duration."""
    size = math.hypot(*push["force_n"])
    if size == 0.0:
        raise FileFormatError(
            "impulse_n_s: the push has no force and so no direction; set force_n",
            field="impulse_n_s",
        )
    scale = impulse_n_s / (size * push["duration_s"])
    push["force_n"] = [scale * part for part in push["force_n"]]


def _set_peak_rate(motion: Table, rate: float) -> None:
    """Set a sine's frequency for this greatest rate."""
    amplitude = motion["amplitude_deg" if _turns(motion) else "amplitude_m"]
    if amplitude == 0.0:
        raise FileFormatError(
            "peak_rate: a sine without amplitude has no rate; set its amplitude",
            field="peak_rate",
        )
    motion["frequency_hz"] = rate / (math.tau * abs(amplitude))


def _set_tilt_rate(table: Table, rate: float) -> None:
    """Set the tilt rate about horizontal axes: of all ramps together, of each sine.

    A ramp about a diagonal consists of one about roll and one about pitch. Each gets
    its share, so that both end together and the rates add up, as vectors, to ``rate``.
    """
    for platform in table["platform"]:
        ramps = [m for m in _horizontal(platform) if m["kind"] in ("ramp", "drop")]
        size = math.hypot(*(m["amplitude_deg"] for m in ramps))
        for motion in ramps:
            if size > 0.0 and motion["amplitude_deg"]:
                motion["rate_deg_s"] = rate * abs(motion["amplitude_deg"]) / size
        for motion in _horizontal(platform):
            if motion["kind"] == "sine":
                _set_peak_rate(motion, rate)


def _set_pace(table: Table, factor: float) -> None:
    """Scale the speed of motions, but not of free falls, seas and records."""
    for platform in table["platform"]:
        for motion in platform["motion"]:
            for key in _PACED:
                if motion.get(key) is not None:
                    motion[key] *= factor


def _horizontal(platform: Table) -> list[Table]:
    return [m for m in platform["motion"] if m["axis"] in ("roll", "pitch")]


def _turns(motion: Table) -> bool:
    return motion["axis"] in ROTATIONS


def _number(path: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise FileFormatError(f"{path}: got {value!r}, expected a number", field=path)
    if not math.isfinite(value):
        raise FileFormatError(
            f"{path}: got {value}, expected a finite number", field=path
        )
    return float(value)


def _positive(path: str, value: Any) -> float:
    number = _number(path, value)
    if number <= 0.0:
        raise FileFormatError(
            f"{path}: got {number:g}, expected more than 0", field=path
        )
    return number


_DERIVED: dict[str, Callable[[Table, float], None]] = {
    "direction_deg": _set_direction,
    "impulse_n_s": _set_impulse,
    "peak_rate_deg_s": _set_peak_rate,
    "peak_rate_m_s": _set_peak_rate,
}
