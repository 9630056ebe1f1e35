"""How a step went: reward terms by name, goals, and what is logged, for one joint."""

import warp as wp

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.kernels.step import OWN, StepMemory, chassis_force, counts, end_step
from aoro_gym.envs.turning import rewards
from aoro_gym.envs.turning.kernels.memory import Goals, Rules, Told

FULL_FLOW = wp.constant(rewards.FULL_FLOW)
TRACKING_SCALE = wp.constant(rewards.TRACKING_SCALE)

REWARDED = (
    rewards.tracking, rewards.precision, rewards.overshoot, rewards.flow_oscillation, rewards.flow_excess,
    chassis_contact, rewards.signal_change,
)  # fmt: skip
"""Functions of reward terms that :func:`reward_of` knows, by their kinds."""

TRACKING, PRECISION, OVERSHOOT, FLOW_OSCILLATION, FLOW_EXCESS, CHASSIS_CONTACT, SIGNAL_CHANGE = (
    wp.constant(kind) for kind in range(len(REWARDED))
)


@wp.func
def reward_of(kind: int, m: StepMemory, g: Goals, tolerance: float, error: float, overshoot: float, i: int):
    """A reward term before its weight; see :mod:`aoro_gym.envs.turning.rewards`."""
    if kind == TRACKING:
        return wp.exp(-wp.abs(error) / TRACKING_SCALE)
    if kind == PRECISION:
        share = error / tolerance
        return wp.exp(-(share * share))
    if kind == OVERSHOOT:
        return overshoot
    if kind == FLOW_OSCILLATION:
        return wp.abs(g.flows[0, i] - 2.0 * g.flows[1, i] + g.flows[2, i]) / FULL_FLOW
    if kind == FLOW_EXCESS:
        return wp.max(wp.abs(g.flows[0, i]) / FULL_FLOW - 1.0, 0.0)
    if kind == CHASSIS_CONTACT:
        return wp.where(chassis_force(m, i) > 0.0, 1.0, 0.0)
    change = g.signals[0, i] - g.signals[1, i]
    return change * change


@wp.func
def update_goals(g: Goals, r: Rules, i: int):
    """Set the next target where the time of the last one is up."""
    cursor = int(g.cursor[i])
    if g.step[i] >= g.until[i, cursor]:
        if g.inside[i] >= r.dwell:
            g.settled[i] = g.settled[i] + wp.int64(1)
        else:
            g.missed[i] = g.missed[i] + wp.int64(1)
        g.cursor[i] = wp.int64(cursor + 1)
        g.target[i] = g.table[i, cursor + 1]
        way = g.target[i] - g.angle[i]
        approach = float(0.0)
        if way > 0.0:
            approach = 1.0
        if way < 0.0:
            approach = -1.0
        g.approach[i] = approach
        g.set_at[i] = g.step[i]
        g.inside[i] = wp.int64(0)


@wp.func
def age_of(m: StepMemory, g: Goals, i: int):
    """Time since the target was set [s]."""
    return wp.float64(g.step[i] - g.set_at[i]) * m.control_step


@wp.func
def tell(m: StepMemory, g: Goals, r: Rules, t: Told, i: int):
    """What is logged; see ``Turning.info``."""
    settled = g.inside[i] >= r.dwell
    done = g.settled[i]
    missed = g.missed[i]
    if settled:
        done += wp.int64(1)
    elif age_of(m, g, i) >= r.hold:
        missed += wp.int64(1)
    t.floats[0, i] = g.target[i]
    t.floats[1, i] = g.angle[i]
    t.floats[2, i] = g.largest_overshoot[i]
    t.integers[0, i] = done
    t.integers[1, i] = missed
    t.success[i] = done > wp.int64(0) and missed == wp.int64(0) and m.status[i] == 0


@wp.kernel(enable_backward=False, module="aoro_gym.envs.turning.kernels")
def judge(m: StepMemory, g: Goals, r: Rules, t: Told):
    """Reward the step, end it, set the next goal, and tell of it."""
    i = wp.tid()
    error = g.target[i] - g.angle[i]
    overshoot = wp.max(g.approach[i] * (g.angle[i] - g.target[i]), 0.0)
    if wp.abs(error) <= r.tolerance:
        g.inside[i] = g.inside[i] + wp.int64(1)
    else:
        g.inside[i] = wp.int64(0)
    g.largest_overshoot[i] = wp.max(g.largest_overshoot[i], overshoot)
    g.pursued[0, i] = g.target[i]
    g.pursued[1, i] = error
    g.pursued[2, i] = overshoot
    g.pursued_age[i] = age_of(m, g, i)
    count = counts(m, i)
    total = float(0.0)
    for term in range(m.weights.shape[0]):
        kind = m.reward_kinds[term]
        if kind != OWN:
            value = float(0.0)
            if count:
                value = float(m.weights[term] * wp.float64(reward_of(kind, m, g, r.tolerance, error, overshoot, i)))
            m.values[term, i] = value
            total += value
    end_step(m, i, total, wp.int64(0), False)
    update_goals(g, r, i)
    tell(m, g, r, t, i)
