"""Reward terms of loading: each a function of the view that gives a number a sub-environment, with its weight."""

from __future__ import annotations

from aoro_gym.envs.core.terms import Frozen, RewardTerm
from aoro_gym.envs.loading.view import LoadingView
from aoro_gym.execution.array_api import Array, floats
from aoro_gym.units import DEGREE

FULL_POWER = 2e4
"""Hydraulic power [W] that stands for 1: about 60 L/min at 200 bar."""
SWAY_SCALE = 10.0 * DEGREE
"""Swing [rad] that costs 1."""
TILT_SCALE = 5.0 * DEGREE
"""Tilt [rad] of the machine that costs 1."""


def nearer(view: LoadingView) -> Array:
    """Way gained towards the log and, with it, towards the bunk [m]."""
    return view.nearer


def turned(view: LoadingView) -> Array:
    """Angle gained of the grapple towards the log's, and, with it, towards the bunk's [rad]."""
    return view.turned


def grasped(view: LoadingView) -> Array:
    """1 in the step in which the log is grasped."""
    return floats(view.grasped)


def placed(view: LoadingView) -> Array:
    """1 in the step in which the log is put on the bunk."""
    return floats(view.placed)


def failure(view: LoadingView) -> Array:
    """1 in the step in which the episode ends badly."""
    return floats(view.failed)


def time(view: LoadingView) -> Array:
    """1 in every step: what is done sooner costs less."""
    return view.xp.ones_like(view.power)


def energy(view: LoadingView) -> Array:
    """Hydraulic power of the pump in units of 20 kW."""
    return view.power / FULL_POWER


def sway(view: LoadingView) -> Array:
    """Square of the grapple's swing in units of 10°, at most 4."""
    return view.xp.clip((view.sway / SWAY_SCALE) ** 2, None, 4.0)


def tilt(view: LoadingView) -> Array:
    """Square of the machine's tilt in units of 5°, at most 4."""
    return view.xp.clip((view.tilt / TILT_SCALE) ** 2, None, 4.0)


def signal_change(view: LoadingView) -> Array:
    """Mean of the squared changes of the signals of the four joints."""
    change = view.signals[:, 0, :4] - view.signals[:, 1, :4]
    return view.xp.mean(change**2, axis=1)


REWARD_TERMS = Frozen(
    {
        "nearer": RewardTerm(1.0, nearer),
        "turned": RewardTerm(0.5, turned),
        "grasped": RewardTerm(10.0, grasped),
        "placed": RewardTerm(30.0, placed),
        "failure": RewardTerm(-20.0, failure),
        "time": RewardTerm(-0.02, time),
        "energy": RewardTerm(-0.02, energy),
        "sway": RewardTerm(-0.02, sway),
        "signal_change": RewardTerm(-0.02, signal_change),
    }
)
"""The reward: a good loading is worth about 50."""
FURTHER_REWARD_TERMS = Frozen({"tilt": tilt})
"""What it can be made of besides, by name."""
