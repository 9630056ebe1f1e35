"""How soon any policy could settle a turn: ``python -m studies.turning_bound`` (a minute on one core).

Nothing turns the joint faster than the full signal, so nobody is within the tolerance of a target before the full signal
brings it there. Beside it, on the same targets, the tuned proportional-derivative controller with exact sensors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aoro_gym import Machine, Twin
from aoro_gym.agents.controllers.turning import ProportionalDerivative
from aoro_gym.envs.turning.config import TurningConfig
from aoro_gym.execution.array_api import Array

COUNT, SEED = 1000, 5
LAYOUT = {"error": slice(0, 1), "joint_rate": slice(1, 2)}
LONGEST = 3.2
"""Time [s] in which every target is reached."""


def turned(start: Array, signal: Callable[[Array, Array], Array], step: float) -> Array:
    """Joint angles [rad] (K + 1, N) at the control steps from ``start`` (N,) on, under ``signal(angle, rate)``."""
    twin = Twin(num_twins=len(start), machine=Machine.load("aoro"))
    twin.reset(joint_angle=start)
    angles, rate = [start], np.zeros(len(start))
    for _ in range(round(LONGEST / step)):
        shown = twin.step(
            {"steering_signal": signal(angles[-1], rate).astype(np.float32)}, duration=step, sample_every=step / 2
        )
        assert shown is not None
        before, now = np.asarray(shown["joint_angle"], dtype=np.float64)
        angles.append(now)
        rate = (now - before) / (step / 2)
    return np.array(angles)


def main() -> None:
    config, rng = TurningConfig(), np.random.default_rng(SEED)
    reach = float(Machine.load("aoro").joint.range) - config.target_clearance
    pairs = rng.uniform(-reach, reach, (4 * COUNT, 2))
    start, target = pairs[np.abs(pairs[:, 1] - pairs[:, 0]) > config.target_change][:COUNT].T
    side = np.sign(target - start)
    controller = ProportionalDerivative(LAYOUT)

    full = turned(start, lambda angle, rate: side, config.control_step)
    tuned = turned(
        start, lambda angle, rate: controller(np.stack([target - angle, rate], axis=1))[:, 0], config.control_step
    )
    outside = [np.abs(angles - target) > config.tolerance for angles in (full, tuned)]
    soonest = np.argmin(outside[0], axis=0) * config.control_step
    settled = (len(tuned) - np.argmax(outside[1][::-1], axis=0)) * config.control_step
    for name, times in (
        ("full signal, first within the tolerance", soonest),
        ("proportional-derivative, settled", settled),
        ("episode by episode", settled - soonest),
    ):
        half = 1.96 * times.std(ddof=1) / np.sqrt(COUNT)
        print(f"{name}: {times.mean():.3f} s ± {half:.3f} s (95 % of the mean of {COUNT} targets)")


if __name__ == "__main__":
    main()
