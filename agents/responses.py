"""Episodes of the turning task, and how the joint responds to each of its targets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aoro_gym.agents.controllers import Policy
from aoro_gym.envs.turning import TurningVectorEnv
from aoro_gym.manoeuvres import TwinLost

EPISODE_STEPS = 500
"""Control steps of an episode of ``AORO/Turning-v0``."""


@dataclass(frozen=True)
class Rollout:
    """One episode of each of N sub-environments; arrays of shape (T, N), row 0 after the first step, SI."""

    control_step: float
    joint_angle: NDArray[np.float32]
    """True [rad]."""
    target: NDArray[np.float32]
    """That the step pursued [rad]."""
    start_angle: NDArray[np.float32]
    """[rad], shape (N,)."""
    steering_signal: NDArray[np.float32]
    reward: NDArray[np.float32]
    success: NDArray[np.bool_]
    """Shape (N,)."""

    @property
    def returns(self) -> NDArray[np.float64]:
        """Sum of rewards, shape (N,)."""
        return self.reward.sum(axis=0, dtype=np.float64)


def rollout(
    env: TurningVectorEnv,
    policy: Policy,
    *,
    seed: int | list[int],
    steps: int = EPISODE_STEPS,
    options: Mapping[str, Any] | None = None,
    watch: Callable[[], Any] | None = None,
) -> Rollout:
    """Drive every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
        seed: Of sub-environment 0, or one each.
        steps: Control steps.
        options: Of the reset.
        watch: Called after the reset and after every step.

    Raises:
        ValueError: the environment resets by itself.
        TwinLost: a twin was lost.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but a rollout needs 'Disabled'")
    rows: dict[str, list[NDArray[Any]]] = {name: [] for name in ("angle", "target", "signal", "reward")}
    policy.reset()
    observations, infos = env.reset(seed=seed, options=options)
    start = infos["joint_angle"]
    if watch is not None:
        watch()
    for _ in range(steps):
        actions = policy(observations)
        rows["target"].append(infos["target"])
        observations, rewards, terminated, _, infos = env.step(actions)
        if terminated.any():
            index = int(np.argmax(terminated))
            raise TwinLost(f"sub-environment {index} ended early: {infos['termination'][index]}")
        rows["angle"].append(infos["joint_angle"])
        rows["signal"].append(actions[:, 0])
        rows["reward"].append(rewards)
        if watch is not None:
            watch()
    return Rollout(
        control_step=env.task.control_step,
        joint_angle=np.array(rows["angle"]),
        target=np.array(rows["target"]),
        start_angle=start,
        steering_signal=np.array(rows["signal"]),
        reward=np.array(rows["reward"]),
        success=infos["is_success"],
    )


def responses(run: Rollout, *, tolerance: float, shortest: float = 2.0) -> dict[str, NDArray[np.float64]]:
    """How the joint responded to every target held for at least ``shortest`` [s]; arrays of shape (targets,).

    - ``step``: change that the target asked for [rad], positive left;
    - ``rise_time``: until the joint has made 90 % of it [s]; NaN if never;
    - ``overshoot``: largest excursion beyond the target [rad];
    - ``settling_time``: until the joint stays within ``tolerance`` [rad] of the target [s]; NaN if it does not;
    - ``final_error``: mean distance from the target over the last 0.5 s [rad].
    """
    found: dict[str, list[float]] = {
        name: [] for name in ("step", "rise_time", "overshoot", "settling_time", "final_error")
    }
    for i in range(run.target.shape[1]):
        angle, target = run.joint_angle[:, i].astype(np.float64), run.target[:, i].astype(np.float64)
        starts = np.flatnonzero(np.diff(target, prepend=np.nan) != 0.0)
        for first, end in zip(starts, [*starts[1:], len(target)], strict=True):
            if (end - first) * run.control_step < shortest:
                continue
            before = angle[first - 1] if first else float(run.start_angle[i])
            step = target[first] - before
            made = (angle[first:end] - before) / step
            away = np.abs(angle[first:end] - target[first])
            late = np.flatnonzero(away > tolerance)
            settled = 0 if not late.size else late[-1] + 1
            found["step"].append(step)
            found["rise_time"].append(
                (np.argmax(made >= 0.9) + 1) * run.control_step if (made >= 0.9).any() else np.nan
            )
            found["overshoot"].append(max(float((made.max() - 1.0) * abs(step)), 0.0))
            found["settling_time"].append((settled + 1) * run.control_step if settled < end - first else np.nan)
            found["final_error"].append(float(away[-round(0.5 / run.control_step) :].mean()))
    return {name: np.array(values) for name, values in found.items()}
