"""Reward terms of turning: each a function of the view that gives a number a sub-environment, with its weight."""

from __future__ import annotations

from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.ruts import rut_depth
from aoro_gym.envs.core.terms import Frozen, RewardTerm
from aoro_gym.envs.turning.view import TurningView
from aoro_gym.execution.array_api import Array

FULL_FLOW = 1.2e-3
"""Joint flow [m³/s] that stands for 1: about that of a turn at full signal."""
TRACKING_SCALE = 0.2
"""Error [rad] at which the tracking term has fallen to 1/e."""


def tracking(view: TurningView) -> Array:
    """1 on target, falling exponentially with the error: every moment away from the target costs."""
    return view.xp.exp(-view.xp.abs(view.error) / TRACKING_SCALE)


def precision(view: TurningView) -> Array:
    """1 on target, 1/e at the tolerance, nothing beyond: worth the last degree."""
    return view.xp.exp(-((view.error / view.tolerance) ** 2))


def overshoot(view: TurningView) -> Array:
    """How far the joint is beyond its target [rad]."""
    return view.overshoot


def flow_oscillation(view: TurningView) -> Array:
    """Second difference of the joint flow over three steps, in units of the full flow: a steady ramp is free."""
    newest, middle, oldest = view.flows
    return view.xp.abs(newest - 2.0 * middle + oldest) / FULL_FLOW


def flow_excess(view: TurningView) -> Array:
    """How far the joint flow is above the full one, in units of it: the first peak of a turn, above what it settles at."""
    return view.xp.clip(view.xp.abs(view.flows[0]) / FULL_FLOW - 1.0, 0.0, None)


def signal_change(view: TurningView) -> Array:
    """Square of the steering signal's change."""
    return (view.signals[:, 0] - view.signals[:, 1]) ** 2


REWARD_TERMS = Frozen(
    {
        "tracking": RewardTerm(0.6, tracking),
        "precision": RewardTerm(0.4, precision),
        "overshoot": RewardTerm(-10.0, overshoot),
        "flow_oscillation": RewardTerm(-0.2, flow_oscillation),
        "signal_change": RewardTerm(-0.1, signal_change),
    }
)
"""The reward: at most 1 a step, so 500 an episode."""
FURTHER_REWARD_TERMS = Frozen({"flow_excess": flow_excess, "chassis_contact": chassis_contact, "rut_depth": rut_depth})
"""What it can be made of besides, by name."""
