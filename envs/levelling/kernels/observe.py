"""What those who level see: observation terms by name, for one vehicle."""

import warp as wp

from aoro_gym.envs.core.kernels.step import OWN, StepMemory, observe_value
from aoro_gym.envs.levelling import observations
from aoro_gym.envs.levelling.kernels.memory import Arms, Frames, Ground
from aoro_gym.envs.path_tracking.kernels.memory import Sensing, Vehicle
from aoro_gym.envs.path_tracking.kernels.sense import last
from aoro_gym.twin.records import Output
from aoro_gym.units import GRAVITY

WEIGHT = wp.constant(wp.float64(GRAVITY))
SUPPORT_UNIT = wp.constant(wp.float64(observations.SUPPORT_UNIT))

OBSERVED = (
    observations.roll, observations.pitch, observations.supply, observations.joint_angle, observations.speed,
    observations.EXACT_TERMS["roll"], observations.EXACT_TERMS["pitch"], observations.tilt_rates, observations.force,
    observations.arm_angles, observations.arm_rates, observations.supports, observations.ground, observations.signals,
)  # fmt: skip
"""Functions of observation terms that :func:`observe` knows, by their kinds; those of one column first."""

(
    ROLL, PITCH, SUPPLY, JOINT_ANGLE, SPEED, EXACT_ROLL, EXACT_PITCH, TILT_RATES, FORCE, ARM_ANGLES, ARM_RATES, SUPPORTS,
    GROUND, SIGNALS,
) = (wp.constant(kind) for kind in range(len(OBSERVED)))  # fmt: skip


@wp.func
def observed(kind: int, m: StepMemory, s: Sensing, a: Arms, i: int):
    """An observation term of one column; see :mod:`aoro_gym.envs.levelling.observations`."""
    if kind == ROLL:
        return s.roll[i]
    if kind == PITCH:
        return s.pitch[i]
    if kind == SUPPLY:
        return a.pressures[8, i] / SUPPORT_UNIT
    if kind == JOINT_ANGLE:
        return s.joint.angles[0, i]
    if kind == SPEED:
        return s.speed[i]
    if kind == EXACT_ROLL:
        return last(m, Output.ROLL, i)
    return last(m, Output.PITCH, i)


@wp.func
def observed_of_arm(kind: int, v: Vehicle, a: Arms, f: Frames, wheel: int, i: int):
    """What is seen of one arm."""
    if kind == ARM_ANGLES:
        return a.angles[wheel, i] - f.rest_angles[wheel, i]
    if kind == ARM_RATES:
        return a.rates[wheel, i]
    return (a.pressures[wheel, i] - v.rod_share[i] * a.pressures[4 + wheel, i]) / SUPPORT_UNIT


@wp.func
def observe_many(kind: int, m: StepMemory, v: Vehicle, s: Sensing, a: Arms, g: Ground, f: Frames, i: int, column: int):
    """An observation term of several columns, from ``column`` on."""
    if kind == TILT_RATES:
        for axis in range(2):
            observe_value(m, i, column + axis, s.rates[i, axis])
    elif kind == FORCE:
        for axis in range(3):
            observe_value(m, i, column + axis, s.force[i, axis] / WEIGHT)
    elif kind == GROUND:
        for place in range(g.places.shape[0]):
            observe_value(m, i, column + place, g.heights[i, place])
    elif kind == SIGNALS:
        for age in range(f.signals.shape[0]):
            for wheel in range(4):
                observe_value(m, i, column + 4 * age + wheel, wp.float64(f.signals[age, i, wheel]))
    else:
        for wheel in range(4):
            observe_value(m, i, column + wheel, observed_of_arm(kind, v, a, f, wheel, i))


@wp.kernel(enable_backward=False, module="aoro_gym.envs.levelling.kernels")
def observe(m: StepMemory, v: Vehicle, s: Sensing, a: Arms, g: Ground, f: Frames):
    """Write the observation, unless it stays as it was."""
    i = wp.tid()
    if m.keeps[i]:
        return
    for term in range(m.observation_kinds.shape[0]):
        kind = m.observation_kinds[term]
        if kind != OWN:
            if kind < TILT_RATES:
                observe_value(m, i, m.columns[term], observed(kind, m, s, a, i))
            else:
                observe_many(kind, m, v, s, a, g, f, i, m.columns[term])
