"""The pseudo-random ternary sequence that tilts the ground in human balance studies.

Implements the stimulus of Peterka (2002, J. Neurophysiol. 88) as the COMTEST protocol
of EUROBENCH uses it (Lippi et al., arXiv 2104.11935).
"""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.motions import PrtsMotion
from surefoot.sim_robot.motion_law import MotionLaw, check_frequency

STATES = 80
"""In a cycle: 3 ** 4 - 1."""


def prts_states() -> list[int]:
    """Return the states of a cycle: 80 of -1, 0 and 1.

    A shift register of four ternary stages, at first 0 0 0 1, gives out its last stage;
    what enters is the last stage less the third, modulo 3. State 2 stands for -1.
    """
    register, states = [0, 0, 0, 1], []
    for _ in range(STATES):
        states.append((0, 1, -1)[register[3]])
        register = [(register[3] - register[2]) % 3, *register[:3]]
    return states


def prts_law(motion: PrtsMotion) -> MotionLaw:
    """Make the integral of the states, its velocity blended where the state changes.

    A change begins with its state and takes a blend, as a smooth step: the position is
    that of the abrupt sequence, averaged over the blend before, so it ends where it
    began.

    Raises:
        ScenarioError: faster than half the simulation's rate.
    """
    state_s, blend, rate, start_s = (
        *(motion.state_s, motion.blend, motion.rate, motion.start_s),
    )
    check_frequency(0.5 / state_s, "speed", what=f"states of {1e3 * state_s:g} ms, so")
    states: Array = np.array(prts_states() * motion.cycles, dtype=np.float64)
    velocity = (rate * np.append(states, 0.0)).tolist()
    before = [0.0, *velocity[:-1]]
    # Over a state: its own velocity, less what the blend lacks of it.
    lacks = 0.5 * blend * np.diff(rate * states, prepend=0.0)
    travelled = np.cumsum(rate * states * state_s - lacks)
    position = [0.0, *travelled.tolist()]
    last = len(velocity) - 1

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        index = min(int(since / state_s), last)
        since -= index * state_s
        begin, change = before[index], velocity[index] - before[index]
        if since >= blend:
            moved = begin * since + change * (since - 0.5 * blend)
            return position[index] + moved, velocity[index]
        u = since / blend
        moved = begin * since + change * blend * u * u * u * (1.0 - 0.5 * u)
        return position[index] + moved, begin + change * u * u * (3.0 - 2.0 * u)

    return law
