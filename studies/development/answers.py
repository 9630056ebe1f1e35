"""What networks say of the development cases, kept beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aoro_gym.diagnosis.network.cases import case_of, posteriors, tokens_of
from aoro_gym.diagnosis.network.decision import SENSOR_SETS
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis_benchmark.judge.plants import Plants
from aoro_gym.diagnosis_benchmark.judge.suite import Plan
from aoro_gym.execution.digest import Contents, digest
from aoro_gym.execution.files import written_whole
from studies.development.cases import kept

BATCH = 16
"""Cases that networks are asked about together."""


def said(
    folder: Path, files: Sequence[Path], made: Plan, plants: Plants, sensors: str
) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities of the hypotheses (N, hypotheses) and quantiles of sizes [SI] (N, effects, quantiles) for a family's
    cases, in the plan's order; where the folder has none, cases are simulated and the networks asked.

    Args:
        folder: Keeps cases and answers.
        files: Of the networks, whose mean is said.
        made: The plan.
        plants: The family.
        sensors: Name of the set of channels that networks are shown.
    """
    networks, weights = digest(*map(Contents, files)), [Weights.load(file) for file in files]
    path = folder / f"said_{made.digest[:8]}_{networks[:8]}_{plants.name}_{sensors}.npz"
    if not path.exists():
        shown = [one.with_channels(SENSOR_SETS[sensors]) for one in kept(folder, made, plants)]
        found: tuple[list[np.ndarray], list[np.ndarray]] = [], []
        for first in range(0, len(shown), BATCH):
            part = [case_of(one.later, one.healthy) for one in shown[first : first + BATCH]]
            tokens = tokens_of(weights, np.concatenate([one.rows for one in part]))
            ends = np.cumsum([len(one.rows) for one in part]).tolist()
            for end, one in zip(ends, part, strict=True):
                own = [kept_tokens[None, end - len(one.rows) : end] for kept_tokens in tokens]
                for kept_answers, answer in zip(found, posteriors(weights, own), strict=True):
                    kept_answers.append(answer[0])
            print(f"{path.stem}: {min(first + BATCH, len(shown))} of {len(shown)} cases", flush=True)
        with written_whole(path) as temporary:
            probabilities, quantiles = (np.array(one, dtype=np.float32) for one in found)
            np.savez(temporary, allow_pickle=False, probabilities=probabilities, quantiles=quantiles)
    with np.load(path) as answers:
        return answers["probabilities"].astype(np.float64), answers["quantiles"].astype(np.float64)
