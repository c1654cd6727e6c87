"""Settings of walking, of all controllers that walk."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from surefoot.schemas.robot_file import Fraction, NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct

Share = Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]


class WalkSettings(FileStruct, frozen=True, kw_only=True):
    """How the steps of a plan are taken."""

    shift_s: Positive = 0.8
    """First shift of the weight onto one foot, from standing."""
    settle_s: Positive = 0.6
    """Last shift of the weight, back between the feet."""
    preview_steps: Annotated[int, msgspec.Meta(ge=1, le=10)] = 3
    """Steps ahead that the reference of the DCM looks [1]."""
    horizontal_part: Share = 0.85
    """Part of single support in which the swing foot travels [1]."""
    apex_part: Share = 0.45
    """Part of single support after which it is highest [1]."""
    touchdown_m_s: Positive = 0.05
    """Speed towards the expected ground at the planned touchdown."""
    late_m_s: Positive = 0.3
    """Speed down where the ground was expected and is not."""
    late_depth_m: Positive = 0.12
    """Farthest that a foot goes down below the expected ground [m]."""
    unloaded_share: Fraction = 0.13
    """A foot may leave the ground when it carries less of the weight [1]."""
    unload_wait_s: NonNegative = 0.1
    """It leaves without having unloaded after so long."""
    touchdown_n: Positive = 40.0
    """Normal force at which a foot in the air has touched down [N]."""
    caught_share: Positive = 0.1
    """A foot in the air that meets more than this part of the weight on its way, and
    less from below, is caught at an edge [1]."""
    step_over_m: NonNegative = 0.03
    """So much higher than planned it then goes on; 0 has it push on [m]."""
    landing_s: Positive = 0.12
    """After touchdown a foot is landing for so long."""
    landing_force_n: Positive = 250.0
    """Largest normal force error that a landing foot yields to [N]."""
    bounce_n: NonNegative = 15.0
    """A landing foot that feels less has bounced [N]."""
    bounce_s: NonNegative = 0.012
    """And for so long."""
    anchor_s: NonNegative = 0.05
    """The odometry follows a foot until so long after its touchdown."""
    early_share: Fraction = 0.08
    """Part of the weight asked of a foot that touched down early [1]."""
    leaving_margin: Fraction = 0.15
    """How much more than its planned part of the weight a leaving foot may be asked
    to carry [1]."""
    lead_s: NonNegative = 0.005
    """Lead of the swing foot's velocity, beside the servos' own lag [s]."""
    swing_gain: Positive = 12.0
    """Second QP: position and orientation gain of the swing foot [1/s]."""
    swing_kp: Positive = 100.0
    """First QP: position gain of the swing foot [1/s^2]."""
    swing_kd: Positive = 20.0
    """First QP: velocity gain of the swing foot [1/s]."""
    swing_weight: Positive = 0.3
    """First QP: weight of the swing foot, where the centre of mass has 1 [1]."""
    height_s: Positive = 1.5
    """Time constant with which the height reference follows the feet [s]."""
    climb_s: Positive = 0.15
    """The same to heights of the plan: of each of three low-passes [s]."""
    normal_filter_s: Positive = 0.03
    """Low-pass of the expected ground's normal [s]."""
    normal_agreement: Positive = 0.06
    """Soles whose normals, or the line between them, disagree by more than this show
    no common ground [rad]."""
    adjust: Literal["off", "place", "both"] = "both"
    """Whether a step changes its place, or place and time, when the DCM leaves its
    reference."""
    adjust_dead_m: tuple[NonNegative, NonNegative] = (0.02, 0.015)
    """Error of the DCM, ahead and sideways, that changes no step [m]."""
    adjust_filter_s: Positive = 0.03
    """Low-pass of that error: impacts shake it [s]."""
    adjust_growth_m: Positive = 0.13
    """A step that lasts so long that the DCM gets twice as far counts as much as one
    that is shifted by this [m]."""
    adjust_offset_weight: Positive = 5.0
    """How much a DCM off its place at the end of the step counts more than a step off
    its own [1]."""
    adjust_zmp_share: Fraction = 0.5
    """Part of the sole in which the ZMP is taken to answer an error of the DCM; over
    the outer edge of the standing foot all of it [1]."""
    adjust_wait_s: NonNegative = 0.3
    """Longest that single support is made longer."""
    adjust_pause_m: Positive = 0.05
    """No foot leaves the ground while the DCM is farther off its reference [m]."""
    adjust_pause_s: NonNegative = 0.8
    """But each is kept no longer than this."""
    adjust_rate_m_s: Positive = 2.0
    """Fastest shift of a step."""
    adjust_limit_m: tuple[Positive, Positive] = (0.25, 0.20)
    """Largest shift of a step, ahead and sideways [m]."""
    adjust_until_s: NonNegative = 0.15
    """No shift any more so long before the planned touchdown."""
    between_soles_m: NonNegative = 0.015
    """Least gap between the soles, sideways [m]."""
    farthest_m: Positive = 0.45
    """Largest sideways distance of the middles of the feet [m]."""
    longest_m: Positive = 0.5
    """Farthest that a foot may be set ahead of, or behind, the other [m]."""
    turn_limit_rad: Positive = 0.6
    """Largest turn of a foot against the other [rad]."""
    rise_limit_m: Positive = 0.2
    """Largest difference of height between two footholds [m]."""
