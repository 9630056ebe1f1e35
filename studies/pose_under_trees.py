"""Why ``AORO/PathTracking-v1`` is lost, and what of the pose could be known: ``python -m studies.pose_under_trees`` (two
minutes on two cores).

Policies drive the paths that trainings are evaluated on; told is in which reception they fail, and how far the estimated
cross-track error then is off. Then, from what the machine measured under the expert, poses are reckoned on for some seconds:

- as the environment does: straight on by wheel speeds and yaw rate, as if the ground were level and nothing slipped;
- with the attitude: the heading changes by (ω_y sin φ + ω_z cos φ) / cos θ, the plan is driven at v cos θ;
- with slip, too: of the speed along and across, each linear in :func:`regressors`, found on half of the sub-environments and
  judged on the others;
- with the true heading in the last: what is left then is slip, the rest the gyroscope's.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.envs import register_envs
from aoro_gym.envs.limit_tracking.courses import validation_courses
from aoro_gym.sensors.attitude import wrapped

ENV, COUNT, STEPS, SEED = "AORO/PathTracking-v1", 80, 1000, 7000
STEP = 0.05
"""[s] of control."""
SECONDS = (3.0, 6.0, 10.0)
"""For which poses are reckoned on."""
POLICIES = ("expert", "preview-speed", "limits-dagger")
RECEPTIONS = ("no satellites", "float", "fixed")
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """T control steps of N sub-environments, one after the other episode."""

    pose: Floats
    """True x, y [m] and heading [rad] of the reference point (T, N, 3)."""
    seen: dict[str, Floats]
    """Observation terms of one column (T, N)."""
    rates: Floats
    """Measured angular velocity in the front frame's axes [rad/s] (T, N, 3)."""
    off: Floats
    """Estimated less true cross-track error [m] (T, N)."""
    quality: NDArray[np.int64]
    """Of the solutions (T, N)."""
    ended: NDArray[np.bool_]
    """Whether an episode ended with the step (T, N)."""
    reached: NDArray[np.bool_]
    """Whether it ended well (T, N)."""


def driven(name: str) -> Drive:
    """What a policy does and measures."""
    register_envs()
    made: Any = gymnasium.make_vec(
        ENV, num_envs=COUNT, device="cpu:simd", courses=validation_courses(), autoreset_mode="SameStep"
    )
    env: Any = made.unwrapped
    policy, task = policy_factory(ENV, name)(env), env.task
    one_column = {term: span.start for term, span in env.observation_layout.items() if span.stop == span.start + 1}
    observations, _ = env.reset(seed=SEED)
    rows: list[tuple[Any, ...]] = []
    for _ in range(STEPS):
        view, heading = task.view(), env.output("yaw")
        pose = np.column_stack([task._reference, heading])
        now = (pose, observations[:, list(one_column.values())].astype(float), view.measured_rates.copy(),
               view.measured_cross_track - view.cross_track, task._sensors.gps.quality.copy())  # fmt: skip
        observations, _, terminated, truncated, infos = env.step(policy(observations))
        ended = terminated | truncated
        policy.reset(ended)
        reached = ended & infos["final_info"]["is_success"] if "final_info" in infos else np.zeros_like(ended)
        rows.append((*now, ended, reached))
    pose, seen, rates, off, quality, ended, reached = (np.array(column) for column in zip(*rows, strict=True))
    terms = {term: seen[:, :, k] for k, term in enumerate(one_column)}
    return Drive(pose, terms, rates, off, quality, ended, reached)


def failures(drive: Drive) -> str:
    """In which reception episodes failed, and how far the estimate was off."""
    failed, count = drive.ended & ~drive.reached, int(drive.ended.sum())
    lately = [drive.quality[max(t - 100, 0) : t + 1, k].min() < 2 for t, k in zip(*np.nonzero(failed), strict=True)]
    by = ", ".join(f"{int((drive.quality[failed] == k).sum())} {word}" for k, word in enumerate(RECEPTIONS))
    return (
        f"{int(failed.sum())} of {count} fail: {by}; {sum(lately)} within 5 s of a lost fix; the estimate is off by "
        f"{np.median(np.abs(drive.off[failed])):.2f} m then (median), by "
        f"{np.sqrt(np.mean(drive.off[drive.quality == 2] ** 2)):.3f} m rms while fixed"
    )


def regressors(drive: Drive) -> Floats:
    """What slip is taken to be linear in (T, N, 8): 1, sin φ, sin θ, v ω_z, ω_z / v, sin of the joint angle, joint rate / v,
    sin φ cos θ |sin φ|."""
    seen, turning = drive.seen, drive.rates[..., 2]
    speed, roll, pitch = np.maximum(seen["speed"], 0.3), seen["roll"], seen["pitch"]
    return np.stack(
        [
            np.ones_like(roll), np.sin(roll), np.sin(pitch), speed * turning, turning / speed, np.sin(seen["joint_angle"]),
            seen["joint_rate"] / speed, np.sin(roll) * np.cos(pitch) * np.abs(np.sin(roll)),
        ],
        axis=-1,
    )  # fmt: skip


def moves(drive: Drive) -> dict[str, Floats]:
    """Moves along and across [m] and turns [rad] (T - 1, N, 3) from step to step, by who reckons, the true ones first."""
    speed, roll, pitch = (drive.seen[name][1:] for name in ("speed", "roll", "pitch"))
    turn = wrapped(np.diff(drive.pose[..., 2], axis=0))
    heading = drive.pose[:-1, :, 2] + 0.5 * turn
    x, y = np.moveaxis(np.diff(drive.pose[..., :2], axis=0), -1, 0)
    along, across = x * np.cos(heading) + y * np.sin(heading), y * np.cos(heading) - x * np.sin(heading)
    nothing = np.zeros_like(along)
    tilted = STEP * (drive.rates[1:, :, 1] * np.sin(roll) + drive.rates[1:, :, 2] * np.cos(roll)) / np.cos(pitch)
    level = STEP * speed * np.cos(pitch)
    known, learned = regressors(drive)[1:], np.zeros(along.shape, dtype=bool)
    learned[5:, : COUNT // 2] = True
    learned &= ~drive.ended[:-1] & (speed > 0.5)
    way = STEP * np.maximum(speed, 0.3)
    slip = [
        way * (known @ np.linalg.lstsq(known[learned], (value / way)[learned], rcond=None)[0])
        for value in (along - level, across)
    ]
    return {
        "true": np.stack([along, across, turn], axis=-1),
        "as the environment does": np.stack([STEP * speed, nothing, STEP * drive.rates[1:, :, 2]], axis=-1),
        "with the attitude": np.stack([level, nothing, tilted], axis=-1),
        "with slip, too": np.stack([level + slip[0], slip[1], tilted], axis=-1),
        "and the true heading": np.stack([level + slip[0], slip[1], turn], axis=-1),
    }


def reckoned(drive: Drive, moved: Floats, seconds: float) -> tuple[float, float]:
    """Root mean square and median of the error across [m] after so long, over the sub-environments that were not learned
    from."""
    length, found = round(seconds / STEP), []
    for first in range(40, STEPS - length - 1, 37):
        whole = ~drive.ended[first : first + length].any(axis=0) & (np.arange(COUNT) >= COUNT // 2)
        along, across, turn = np.moveaxis(moved[first : first + length], -1, 0)
        heading = drive.pose[first, :, 2] + np.cumsum(turn, axis=0) - 0.5 * turn
        x = drive.pose[first, :, 0] + (along * np.cos(heading) - across * np.sin(heading)).sum(axis=0)
        y = drive.pose[first, :, 1] + (along * np.sin(heading) + across * np.cos(heading)).sum(axis=0)
        end = drive.pose[first + length]
        error = (y - end[:, 1]) * np.cos(end[:, 2]) - (x - end[:, 0]) * np.sin(end[:, 2])
        found.append(error[whole])
    errors = np.concatenate(found)
    return float(np.sqrt(np.mean(errors**2))), float(np.median(np.abs(errors)))


def main() -> None:
    drives = {name: driven(name) for name in sys.argv[1:] or POLICIES}
    for name, drive in drives.items():
        print(f"{name}: {failures(drive)}", flush=True)
    drive = drives.get("expert") or driven("expert")
    for name, moved in moves(drive).items():
        errors = (reckoned(drive, moved, seconds) for seconds in SECONDS)
        told = "; ".join(
            f"{s:g} s: {rms:.3f} m rms, median {half:.3f} m" for s, (rms, half) in zip(SECONDS, errors, strict=True)
        )
        print(f"{name}: {told}", flush=True)


if __name__ == "__main__":
    main()
