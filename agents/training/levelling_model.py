"""The twin linearised for the regulator of ``AORO/Levelling-v0``: ``python -m aoro_gym.agents.training.levelling_model``.

Machines drive straight over level ground by their path controller while small random demands, held for 0.1 to 0.4 s, move
the modes of their arms; least squares give x⁺ = A x + B u of each block
(:data:`aoro_gym.agents.controllers.levelling.MODEL`). Sensors are without errors; every demand is lifted over the dead band,
as the controllers do.
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.controllers.levelling import BLOCKS, MODES, Stance, twist_of
from aoro_gym.envs.levelling.config import LevellingRandomisation
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.terrains import Path, Plane

Floats = NDArray[np.float64]
Model = dict[str, tuple[Floats, Floats]]

AMPLITUDE = 0.25
"""Largest demand of each mode [-]: all four together just open a valve fully."""
SETTLING = 40
"""Control steps before anything counts: the machine comes to speed."""


def linearised(machines: int = 32, steps: int = 300, seed: int = 0) -> tuple[Model, dict[str, Floats]]:
    """A and B by block, and what share [-] of the variance of each of its three motions' changes over a step they explain.

    Args:
        machines: That drive side by side.
        steps: Control steps of each.
        seed: Of the demands.
    """
    quiet = LevellingRandomisation(sensor_noise=(0.0, 0.0), lateral_offset=(0.0, 0.0), heading_offset=(0.0, 0.0))
    line = Path(np.array([[0.0, 0.0], [60.0, 0.0]]))
    env = LevellingVectorEnv(machines, terrain=Plane(), path=line, randomisation=quiet, autoreset_mode="Disabled")
    stance, rng = Stance.of(env), np.random.default_rng(seed)
    observations, _ = env.reset(seed=seed)
    demands, left = np.zeros((machines, 4)), np.zeros(machines, dtype=int)
    states, inputs = [], []
    for step in range(steps):
        seen = stance.see(observations)
        twist, sunk = twist_of(seen["supports"]), stance.arm_length * seen["arm_angles"].mean(axis=1)
        states.append(
            np.column_stack(
                [seen["roll"], seen["tilt_rates"][:, 0], twist, seen["pitch"], seen["tilt_rates"][:, 1], sunk]
            )
        )
        over = left <= 0
        # back to the middle in the mean, so that all stays small
        pull = np.column_stack([4.0 * seen["roll"], 4.0 * seen["pitch"], twist, 2.0 * sunk])
        fresh = np.clip(rng.uniform(-AMPLITUDE, AMPLITUDE, demands.shape) + 0.5 * pull, -AMPLITUDE, AMPLITUDE)
        demands = np.where(over[:, None], fresh, demands) * (step >= SETTLING // 2)
        left = np.where(over, rng.integers(2, 9, machines), left) - 1
        inputs.append(demands.copy())
        observations, *_ = env.step(stance.signals(stance.spread(demands, seen["joint_angle"][:, 0]), 0.0))
    return _fitted(np.array(states)[SETTLING:], np.array(inputs)[SETTLING - 1 :])


def _fitted(states: Floats, inputs: Floats) -> tuple[Model, dict[str, Floats]]:
    """Least squares over states (T, N, 6) and the demands before and at each of them (T + 1, N, 4)."""
    model, explained = {}, {}
    for number, (block, modes) in enumerate(BLOCKS.items()):
        columns = [MODES.index(mode) for mode in modes]
        motion = states[..., 3 * number : 3 * number + 3]
        now, then = motion[:-1].reshape(-1, 3), motion[1:].reshape(-1, 3)
        last, asked = (part[..., columns].reshape(-1, 2) for part in (inputs[:-2], inputs[1:-1]))
        known = np.column_stack([now, last, asked, np.ones(len(now))])  # the last one: where it rests
        found, *_ = np.linalg.lstsq(known, then, rcond=None)
        a, b = np.zeros((5, 5)), np.zeros((5, 2))
        a[:3], b[:3], b[3:] = found[:5].T, found[5:7].T, np.eye(2)
        model[block] = (a, b)
        explained[block] = 1.0 - (then - known @ found).var(axis=0) / (then - now).var(axis=0)
    return model, explained


def main() -> None:
    """Print the model and what it explains as JSON."""
    model, explained = linearised()
    for block, (a, b) in model.items():
        rows = np.column_stack([a[:3], b[:3]])
        told = {name: np.vectorize(lambda v: float(f"{v:.4g}"))(part).tolist() for name, part in (
            ("rows of (A, B)", rows), ("explained", explained[block]),
        )}  # fmt: skip
        print(json.dumps({block: told}))


if __name__ == "__main__":
    main()
