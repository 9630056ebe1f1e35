"""Reward terms of levelling: each a function of the view that gives a number a sub-environment, with its weight."""

from __future__ import annotations

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.ruts import rut_depth
from aoro_gym.envs.core.terms import Frozen, RewardTerm
from aoro_gym.envs.levelling.view import LevellingView
from aoro_gym.execution.array_api import Array
from aoro_gym.units import DEGREE

TILT_SCALE = 2.0 * DEGREE
"""Tilt [rad] at which levelness is worth half."""
UNEVENNESS_SCALE = 0.2
"""Unevenness [-] at which evenness is worth half."""
RATE_SCALE = 10.0 * DEGREE
"""Tilt rate [rad/s] that costs 1."""
SUNK_SCALE = 0.1
"""Height [m] off the one at rest that costs 1."""
LIFTED = 0.1
"""Share [-] of its load at rest below which a wheel counts as lifted."""
TIPPING_RESERVE = 0.5
"""Tipping margin [-] below which it costs."""
FULL_POWER = 2e4
"""Hydraulic power [W] that stands for 1: about 60 L/min at 200 bar."""


def level(view: LevellingView) -> Array:
    """Path gained with level frames, 1 at the working speed and no tilt, half of that at 2° of tilt."""
    return view.pace / (1.0 + (view.tilt / TILT_SCALE) ** 2)


def even(view: LevellingView) -> Array:
    """Path gained with even loads, 1 at the working speed and loads as at rest, half of that at an unevenness of 0.2."""
    return view.pace / (1.0 + (view.unevenness / UNEVENNESS_SCALE) ** 2)


def swaying(view: LevellingView) -> Array:
    """Square of the tilt rate in units of 10°/s, at most 4."""
    return view.xp.clip((view.tilt_rate / RATE_SCALE) ** 2, None, 4.0)


def lifted(view: LevellingView) -> Array:
    """Share of the wheels that bear less than a tenth of their load at rest."""
    return view.lifted


def tipping(view: LevellingView) -> Array:
    """Square of what the tipping margin lacks to a half, 1 when two wheels lift."""
    return view.xp.clip((TIPPING_RESERVE - view.tipping_margin) / TIPPING_RESERVE, 0.0, 1.0) ** 2


def height(view: LevellingView) -> Array:
    """Square of the mean height off the one at rest in units of 0.1 m, at most 4."""
    return view.xp.clip((view.sunk / SUNK_SCALE) ** 2, None, 4.0)


def energy(view: LevellingView) -> Array:
    """Hydraulic power of pump 2 in units of 20 kW."""
    return view.hydraulic_power / FULL_POWER


def signal_change(view: LevellingView) -> Array:
    """Mean of the squared changes of the four signals."""
    change = (view.signals[:, 0] - view.signals[:, 1]) ** 2
    return 0.25 * (change[:, 0] + change[:, 1] + change[:, 2] + change[:, 3])


def failure(view: LevellingView) -> Array:
    """1 in the step in which the episode ends badly."""
    return view.failed * 1.0


def elapsed(view: LevellingView) -> Array:
    """1 in every step: what is done sooner costs less."""
    return view.xp.ones_like(view.pace)


REWARD_TERMS = Frozen(
    {
        "level": RewardTerm(0.6, level),
        "even": RewardTerm(0.4, even),
        "swaying": RewardTerm(-0.1, swaying),
        "lifted": RewardTerm(-0.5, lifted),
        "tipping": RewardTerm(-1.0, tipping),
        "height": RewardTerm(-0.05, height),
        "energy": RewardTerm(-0.1, energy),
        "signal_change": RewardTerm(-0.05, signal_change),
        "failure": RewardTerm(-50.0, failure),
    }
)
"""The reward: at most 1 a step at the working speed, for level frames and even loads."""
FURTHER_REWARD_TERMS = Frozen({"time": elapsed, "chassis_contact": chassis_contact, "rut_depth": rut_depth})
"""What it can be made of besides, by name."""
