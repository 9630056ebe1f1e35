"""Episodes of the turning task, and how the joint responds to each of its targets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.machine.sections import SteeringCylinder
from aoro_gym.sensors.chain import STANDSTILL, measured_flow
from aoro_gym.simulation.key_figures import STEADY, TOLERANCE
from aoro_gym.simulation.manoeuvres import SimulationDiverged

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
    sampled_angle: NDArray[np.float32]
    """True [rad] (F, N), as often as the sensor samples it: F / T rows a control step, the last one of each as in
    ``joint_angle``."""
    cylinder: SteeringCylinder
    """One of the steering cylinders, with one variant or N: makes oil of angles."""

    @property
    def sample_step(self) -> float:
        """Between the rows of ``sampled_angle`` [s]."""
        return self.control_step * len(self.joint_angle) / len(self.sampled_angle)

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
    callback: Callable[[], Any] | None = None,
) -> Rollout:
    """Drive every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
        seed: Of sub-environment 0, or one each.
        steps: Control steps.
        options: Of the reset.
        callback: Called after the reset and after every step.

    Raises:
        ValueError: the environment resets by itself.
        SimulationDiverged: a twin's state is no longer finite.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but a rollout needs 'Disabled'")
    rows: dict[str, list[NDArray[Any]]] = {name: [] for name in ("angle", "target", "signal", "reward", "sampled")}
    policy.reset()
    observations, infos = env.reset(seed=seed, options=options)
    start = infos["joint_angle"]
    if callback is not None:
        callback()
    for _ in range(steps):
        actions = policy(observations)
        rows["target"].append(infos["target"])
        observations, rewards, terminated, _, infos = env.step(actions)
        if terminated.any():
            index = int(np.argmax(terminated))
            raise SimulationDiverged(f"sub-environment {index} ended early: {infos['termination'][index]}")
        rows["angle"].append(infos["joint_angle"])
        rows["sampled"].append(np.array(env.arrays.host(env.task.view().samples("joint_angle")), dtype=np.float32))
        rows["signal"].append(actions[:, 0])
        rows["reward"].append(rewards)
        if callback is not None:
            callback()
    return Rollout(
        control_step=env.task.control_step,
        joint_angle=np.array(rows["angle"]),
        target=np.array(rows["target"]),
        start_angle=start,
        steering_signal=np.array(rows["signal"]),
        reward=np.array(rows["reward"]),
        success=infos["is_success"],
        sampled_angle=np.concatenate(rows["sampled"]),
        cylinder=env.twin.machine.steering.cylinder,
    )


def responses(run: Rollout, *, tolerance: float, shortest: float = 2.0) -> dict[str, NDArray[np.float64]]:
    """How the joint responded to every target held for at least ``shortest`` [s]; arrays of shape (targets,). A target that
    is set within ``tolerance`` of where the joint is asks for no response: a joint that stands still would settle at once.

    - ``episode``: which of the rollout's it was;
    - ``held``: how long the target stood [s];
    - ``step``: change that the target asked for [rad], positive left;
    - ``rise_time``: until the joint has made 90 % of it [s]; NaN if never;
    - ``overshoot``: largest excursion beyond the target [rad]; NaN if the joint did not come within ``tolerance`` of it;
    - ``settling_time``: until the joint stays within ``tolerance`` [rad] of the target [s]; NaN if it does not;
    - ``final_error``: mean distance from the target over the last 0.5 s [rad];
    - ``flow_overshoot``: see :func:`flow_overshoot`.
    """
    found: dict[str, list[float]] = {
        name: []
        for name in (
            "episode", "held", "step", "rise_time", "overshoot", "settling_time", "final_error", "flow_overshoot",
        )
    }  # fmt: skip
    flows = flow_curves(run)
    ratio = len(run.sampled_angle) // len(run.joint_angle)
    for i in range(run.target.shape[1]):
        angle, target = run.joint_angle[:, i].astype(np.float64), run.target[:, i].astype(np.float64)
        starts = np.flatnonzero(np.diff(target, prepend=np.nan) != 0.0)
        for first, end in zip(starts, [*starts[1:], len(target)], strict=True):
            if (end - first) * run.control_step < shortest:
                continue
            before = angle[first - 1] if first else float(run.start_angle[i])
            step = target[first] - before
            if abs(step) <= tolerance:
                continue
            made = (angle[first:end] - before) / step
            away = np.abs(angle[first:end] - target[first])
            late = np.flatnonzero(away > tolerance)
            settled = 0 if not late.size else late[-1] + 1
            fine = slice(ratio * first, ratio * end)
            direction = np.sign(step)
            found["episode"].append(i)
            found["held"].append((end - first) * run.control_step)
            found["step"].append(step)
            found["rise_time"].append(
                (np.argmax(made >= 0.9) + 1) * run.control_step if (made >= 0.9).any() else np.nan
            )
            beyond = float((made.max() - 1.0) * abs(step))
            found["overshoot"].append(max(beyond, 0.0) if beyond >= -tolerance else np.nan)
            found["settling_time"].append((settled + 1) * run.control_step if settled < end - first else np.nan)
            found["final_error"].append(float(away[-round(0.5 / run.control_step) :].mean()))
            found["flow_overshoot"].append(
                flow_overshoot(
                    flows[direction][fine, i],
                    direction * (run.sampled_angle[fine, i].astype(np.float64) - before),
                    abs(step),
                    tolerance,
                )
            )
    return {name: np.array(values) for name, values in found.items()}


def flow_curves(run: Rollout) -> dict[float, NDArray[np.float64]]:
    """Joint flow [m³/s] (F, N) by direction, +1 left and -1 right, positive in it: true angles through the measuring chain.

    Before its first target a joint has rested: that half second, which the chain's filter needs, is put before the samples.
    """
    rest = round(STANDSTILL / run.sample_step)
    angle = np.concatenate([np.broadcast_to(run.start_angle, (rest, len(run.start_angle))), run.sampled_angle])
    return {
        direction: measured_flow(run.cylinder, angle, direction, rate=1.0 / run.sample_step)[rest:]
        for direction in (1.0, -1.0)
    }


def flow_overshoot(flow: NDArray[np.float64], turned: NDArray[np.float64], step: float, tolerance: float) -> float:
    """Peak of a turn's flow curve above its steady value, as a share [-] of the latter.

    As of the full turns in :mod:`aoro_gym.simulation.key_figures`: t = 0 where the joint has left its start by 0.1°, the
    steady flow is the mean over [0.48 T, 0.92 T]. Two things differ, for a target is no stop: T is when the joint comes
    within ``tolerance`` of it, as it may come to rest there; and the peak is the largest flow up to T, as a short turn is
    over before 0.3 s.

    Args:
        flow: Of the turn, positive in its direction (F,).
        turned: Angle from the start [rad], likewise.
        step: Angle of the whole turn [rad].
        tolerance: [rad]

    Returns NaN if the joint does not come there, or in fewer samples than tell a steady flow.
    """
    left, there = turned > TOLERANCE, turned >= step - tolerance
    if not there.any():
        return np.nan
    began, arrived = int(np.argmax(left)), int(np.argmax(there))
    low, high = (began + share * (arrived - began) for share in STEADY)
    steady = flow[int(np.ceil(low)) : int(high) + 1]
    if not steady.size or steady.mean() <= 0.0:
        return np.nan
    return float(flow[began : arrived + 1].max() / steady.mean() - 1.0)
