from __future__ import annotations

import math

import msgspec
import pytest

from surefoot.schemas.motions import RampMotion, SineMotion
from surefoot.sim_robot.catalogue import list_scenarios, load_scenario

NOISY = load_scenario("moving-platform-slow").sensors
IMPULSE_N_S = 20.0
TOLERANCE = 1e-3


@pytest.mark.parametrize("name", list_scenarios())
def test_all_scenarios_have_the_same_noisy_sensors(name: str) -> None:
    assert load_scenario(name).sensors == NOISY


@pytest.mark.parametrize("name", ["moving-platform", "two-platforms"])
def test_the_fast_one_is_the_slow_one_four_times_as_fast(name: str) -> None:
    slow, fast = (load_scenario(f"{name}-{pace}") for pace in ("slow", "fast"))
    for one, other in zip(slow.platform, fast.platform, strict=True):
        assert one.foot == other.foot
        for calm, quick in zip(one.motion, other.motion, strict=True):
            same = msgspec.structs.replace(calm, frequency_hz=quick.frequency_hz)
            assert quick == same
            assert quick.frequency_hz == pytest.approx(4.0 * calm.frequency_hz)


def test_pair_moves_out_of_step() -> None:
    left, right = load_scenario("two-platforms-slow").platform
    for one, other in zip(left.motion, right.motion, strict=True):
        assert isinstance(one, SineMotion)
        assert isinstance(other, SineMotion)
        assert one.phase_deg != other.phase_deg


@pytest.mark.parametrize("fall_mm", [50, 80])
def test_left_platform_falls_freely_and_tilts_by_ten_degrees(fall_mm: int) -> None:
    left, right = load_scenario(f"falling-platform-{fall_mm}").platform
    drop, *tilts = left.motion
    assert (left.foot, drop.axis) == ("left", "z")
    assert drop.amplitude == pytest.approx(-1e-3 * fall_mm)
    assert all(motion.start_s == 3.5 for motion in left.motion)
    tilt = math.hypot(*(motion.amplitude for motion in tilts))
    assert math.degrees(tilt) == pytest.approx(10.0)
    assert not right.motion


@pytest.mark.parametrize("axis", ["roll", "pitch", "diagonal"])
def test_ramps_reach_fifteen_degrees_at_sixty_a_second(axis: str) -> None:
    (platform,) = load_scenario(f"tilt-ramp-{axis}").platform
    ramps = [motion for motion in platform.motion if isinstance(motion, RampMotion)]
    assert len(ramps) == (2 if axis == "diagonal" else 1)
    angle = math.degrees(math.hypot(*(motion.amplitude for motion in ramps)))
    rate = math.degrees(math.hypot(*(motion.rate for motion in ramps)))
    assert angle == pytest.approx(15.0, rel=TOLERANCE)
    assert rate == pytest.approx(60.0, rel=TOLERANCE)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_sines_peak_at_120_degrees_a_second(axis: str) -> None:
    ((motion,),) = (p.motion for p in load_scenario(f"tilt-sine-{axis}").platform)
    assert isinstance(motion, SineMotion)
    peak = math.degrees(math.tau * motion.frequency_hz * motion.amplitude)
    assert peak == pytest.approx(120.0, rel=TOLERANCE)


@pytest.mark.parametrize("name", ["push-standing", "push-slow-platform"])
def test_pushes_have_twenty_newton_seconds(name: str) -> None:
    (push,) = load_scenario(name).push
    assert math.hypot(*push.force_n) * push.duration_s == pytest.approx(IMPULSE_N_S)


def test_push_on_the_slow_platform_has_that_platform() -> None:
    slow, pushed = (
        load_scenario(n) for n in ("moving-platform-slow", "push-slow-platform")
    )
    assert pushed.platform == slow.platform
