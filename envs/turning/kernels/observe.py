"""What a joint's controller sees: observation terms by name, for one joint."""

import warp as wp

from aoro_gym.envs.core.kernels.joint import joint_rate
from aoro_gym.envs.core.kernels.step import OWN, StepMemory, observe_value
from aoro_gym.envs.turning import observations
from aoro_gym.envs.turning.kernels.memory import Goals, Measured

OBSERVED = (
    observations.joint_angle, observations.joint_rate, observations.target, observations.target_error,
    observations.EXACT_TERMS["joint_angle"], observations.EXACT_TERMS["error"], observations.signals,
    observations.pressures,
)  # fmt: skip
"""Functions of observation terms that :func:`observe` knows, by their kinds; those of one column first."""

JOINT_ANGLE, JOINT_RATE, TARGET, TARGET_ERROR, EXACT_ANGLE, EXACT_ERROR, SIGNALS, PRESSURES = (
    wp.constant(kind) for kind in range(len(OBSERVED))
)


@wp.func
def observed(kind: int, g: Goals, s: Measured, i: int):
    """An observation term of one column; see :mod:`aoro_gym.envs.turning.observations`."""
    if kind == JOINT_ANGLE:
        return s.joint.angles[0, i]
    if kind == JOINT_RATE:
        return joint_rate(s.joint, i)
    if kind == TARGET:
        return wp.float64(g.target[i])
    if kind == TARGET_ERROR:
        return wp.float64(g.target[i]) - s.joint.angles[0, i]
    if kind == EXACT_ANGLE:
        return wp.float64(g.target[i] - (g.target[i] - g.angle[i]))
    return wp.float64(g.target[i] - g.angle[i])


@wp.kernel(enable_backward=False, module="aoro_gym.envs.turning.kernels")
def observe(m: StepMemory, g: Goals, s: Measured):
    """Write the observation, unless it stays as it was."""
    i = wp.tid()
    if m.keeps[i]:
        return
    for term in range(m.observation_kinds.shape[0]):
        kind = m.observation_kinds[term]
        column = m.columns[term]
        if kind == SIGNALS:
            for age in range(g.signals.shape[0]):
                observe_value(m, i, column + age, wp.float64(g.signals[age, i]))
        elif kind == PRESSURES:
            for sensor in range(s.pressures.shape[1]):
                observe_value(m, i, column + sensor, wp.float64(s.pressures[i, sensor] / 1.0e7))
        elif kind != OWN:
            observe_value(m, i, column, observed(kind, g, s, i))
