"""Reward terms of a forest run: each a function of the view that gives a number a sub-environment, with its weight."""

from __future__ import annotations

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.terms import Frozen, RewardTerm
from aoro_gym.envs.forest_run.view import ForestRunView
from aoro_gym.envs.path_tracking import rewards as path_tracking
from aoro_gym.envs.path_tracking.rewards import energy, failure, tipping
from aoro_gym.execution.array_api import Array

DAMAGE_SCALE = 1e4
"""Force [N] on a chassis that costs 1 a step: a tenth of the machine's weight."""


def progress(view: ForestRunView) -> Array:
    """Distance by which the goal came nearer, 1 at the working speed straight to it."""
    return view.nearer / (view.control_step * view.working_speed)


def damage(view: ForestRunView) -> Array:
    """Force of objects on a chassis in units of 10 kN: its sum is their impulse."""
    return view.chassis_force / DAMAGE_SCALE


def signal_change(view: ForestRunView) -> Array:
    """Sum of the squared changes of both signals."""
    return path_tracking.signal_change(view.driving)


def elapsed(view: ForestRunView) -> Array:
    """1 in every step: what is done sooner costs less."""
    return view.xp.ones_like(view.nearer)


def finish(view: ForestRunView) -> Array:
    """1 in the step that reaches the goal."""
    return view.finished * 1.0


REWARD_TERMS = Frozen(
    {
        "progress": RewardTerm(1.0, progress),
        "damage": RewardTerm(-1.0, damage),
        "tipping": RewardTerm(-1.0, tipping),
        "energy": RewardTerm(-0.1, energy),
        "signal_change": RewardTerm(-0.05, signal_change),
        "time": RewardTerm(-0.2, elapsed),
        "finish": RewardTerm(100.0, finish),
        "failure": RewardTerm(-200.0, failure),
    }
)
"""The reward: about 0.7 a step on the straight way to the goal, and much for how it ends."""
FURTHER_REWARD_TERMS = Frozen({"chassis_contact": chassis_contact})
"""What it can be made of besides, by name."""
