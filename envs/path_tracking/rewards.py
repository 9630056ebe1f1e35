"""Reward terms of path tracking: each a function of the view that gives a number a sub-environment, with its weight."""

from __future__ import annotations

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.ruts import rut_depth
from aoro_gym.envs.core.terms import Frozen, RewardTerm
from aoro_gym.envs.path_tracking.view import PathTrackingView
from aoro_gym.execution.array_api import Array

CROSS_TRACK_SCALE = 0.5
"""Cross-track error [m] that costs 1."""
EXACT_SCALE = 0.03
"""Cross-track error [m] at which exact progress is worth half: what the reference controllers come to."""
BRISK = 1.1
"""Pace, as a share [-] of the working speed, at which exact progress is worth most."""
TIPPING_RESERVE = 0.5
"""Tipping margin [-] below which it costs."""
FULL_POWER = 1e5
"""Engine power [W] that stands for 1: about what the engine gives at its governed speed."""


def progress(view: PathTrackingView) -> Array:
    """Path gained, 1 at the working speed: what all of it is worth does not depend on the speed."""
    return view.progress / (view.control_step * view.working_speed)


def cross_track_cost(view: PathTrackingView) -> Array:
    """Square of the cross-track error in units of 0.5 m, at most 4."""
    return view.xp.clip((view.cross_track / CROSS_TRACK_SCALE) ** 2, None, 4.0)


def exact_progress(view: PathTrackingView) -> Array:
    """Path gained, worth half at 0.03 m off the path, and the less the more it is driven faster than a little over the
    working speed: what is left to gain is to be nearer to the path. Nobody saves anything by standing still, as where
    errors cost more than progress brings."""
    pace = progress(view)
    worth = pace - 2.0 * view.xp.clip(pace - BRISK, 0.0, None)
    return worth / (1.0 + (view.cross_track / EXACT_SCALE) ** 2)


def signal_change(view: PathTrackingView) -> Array:
    """Sum of the squared changes of all signals."""
    change = (view.actions[:, 0] - view.actions[:, 1]) ** 2
    total = change[:, 0]
    for column in range(1, change.shape[1]):
        total = total + change[:, column]
    return total


def tipping(view: PathTrackingView) -> Array:
    """Square of what the tipping margin lacks to a half, 1 when two wheels lift."""
    return view.xp.clip((TIPPING_RESERVE - view.tipping_margin) / TIPPING_RESERVE, 0.0, 1.0) ** 2


def energy(view: PathTrackingView) -> Array:
    """Mean engine power in units of 100 kW: its sum is the engine's work."""
    return view.engine_power / FULL_POWER


def elapsed(view: PathTrackingView) -> Array:
    """1 in every step: what is done sooner costs less."""
    return view.xp.ones_like(view.progress)


def finish(view: PathTrackingView) -> Array:
    """1 in the step that reaches the path's end."""
    return view.finished * 1.0


def failure(view: PathTrackingView) -> Array:
    """1 in the step in which the episode ends badly."""
    return view.failed * 1.0


REWARD_TERMS = Frozen(
    {
        "progress": RewardTerm(1.0, progress),
        "cross_track": RewardTerm(-0.5, cross_track_cost),
        "signal_change": RewardTerm(-0.2, signal_change),
        "tipping": RewardTerm(-1.0, tipping),
        "energy": RewardTerm(-0.1, energy),
        "time": RewardTerm(-0.1, elapsed),
        "finish": RewardTerm(20.0, finish),
        "failure": RewardTerm(-50.0, failure),
    }
)
"""The reward: about 1 a step for following the path's middle at the working speed."""
FURTHER_REWARD_TERMS = Frozen(
    {"exact_progress": exact_progress, "chassis_contact": chassis_contact, "rut_depth": rut_depth}
)
"""What it can be made of besides, by name."""
