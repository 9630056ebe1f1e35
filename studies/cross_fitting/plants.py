"""Recordings of plants of all families as batches that a network learns from, on the device."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.cases import aligned, paired
from aoro_gym.diagnosis.network.features import features
from aoro_gym.diagnosis.network.sensing import Draw, with_law_error
from aoro_gym.diagnosis.network.training import Batch, Course, what_there_may_be
from aoro_gym.diagnosis.simulation.logs import UNITS
from aoro_gym.diagnosis.simulation.manoeuvres import CHANNELS, SAMPLES
from aoro_gym.diagnosis.simulation.prior import SensorPrior
from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.plants import Plants
from aoro_gym.diagnosis_benchmark.judge.suite import Suite, plan
from aoro_gym.effects.catalogue import IDS
from aoro_gym.execution.files import written_whole
from studies.development.cases import DEVICE_TOGETHER, cases_of

SUITE = Suite("teaching", 800, 1320, 1200, 900, machines=200, protocols=60, logs=4, draws=8)
"""Cases of one family: healthy, single, pair, outside; half of the last, of kinds that nothing may learn from, are left."""
MIXED_SUITE = replace(SUITE, name="teaching mixtures", healthy=200, singles=330, pairs=300, outside=225, machines=60)
"""Cases of one mixture: there are many, and each has few laws that are its own alone."""
SEED = 9100
"""Of the teaching cases of the first family, one more of the next; those that are scored are drawn with other seeds."""
ADDED = SensorPrior(
    angle_zero=3e-4, pressure_zero=2e4, law_error=(0.001, 0.01), change_error=(0.005, 0.1), law_error_time=0.1
)
"""What is added to recordings each time that they are shown, as plants are fewer than twins (E)."""


@dataclass(frozen=True)
class Recorded:
    """N cases of J pairs of logs.

    Attributes:
        samples: int16 (N, J, 2, channels, SAMPLES), in :data:`UNITS`: of the healthy and of the later day.
        commands: (N, J, 2, SAMPLES).
        hypothesis: Number of what is wrong (N,).
        effects: Numbers of the effects (N, 2), −1 for none.
        family: Number of the plants' family (N,).
    """

    samples: Tensor
    commands: Tensor
    hypothesis: Tensor
    effects: Tensor
    family: Tensor


def cut(told: Excitation) -> Excitation:
    """A manoeuvre as far as a network is shown it: a launch takes as long as its longest log."""
    moves = np.abs(told.steering) > 1e-3
    if told.drive is not None:
        moves = moves | (np.abs(told.drive) > 1e-3)
    shown = int(np.flatnonzero(moves)[0]) + SAMPLES
    return replace(told, steering=told.steering[:shown], drive=None if told.drive is None else told.drive[:shown])


def simulated(folder: Path, plants: Plants, suite: Suite, seed: int) -> Path:
    """File of a family's cases in ``folder``, simulated where there is none."""
    began = time.monotonic()
    made = plan(suite, [plants], seed)
    cases = tuple(case for case in made.cases if not case.novel)
    made = replace(made, cases=cases, excitations={name: cut(one) for name, one in made.excitations.items()})
    path = folder / f"teaching_{made.digest[:8]}_{plants.name}.npz"
    if path.exists():
        return path
    samples, commands, effects, outside = [], [], [], []
    for one in cases_of(made, plants, together=DEVICE_TOGETHER):
        pairs = [
            (aligned(pair.healthy), aligned(pair.later))
            for pair in paired(one.later, one.healthy)
            if pair.healthy is not None and pair.later is not None
        ]
        signals = np.array([[day.signals for day in both] for both in pairs]) / np.array(UNITS)[:, None]
        if len(pairs) < suite.logs or not np.all(np.isfinite(signals)):
            continue
        samples.append(np.clip(np.round(signals), -32767, 32767).astype(np.int16))
        commands.append(np.array([later.commands for _, later in pairs], dtype=np.float32))
        numbers = [IDS.index(name) for name in one.case.effects]
        effects.append([*numbers, -1, -1][:2])
        outside.append(one.case.kind == "outside")
    with written_whole(path) as temporary:
        np.savez(
            temporary, allow_pickle=False, samples=np.array(samples), commands=np.array(commands),
            effects=np.array(effects), outside=np.array(outside),
        )  # fmt: skip
    print(f"{len(samples)} cases of {plants.name} in {time.monotonic() - began:.0f} s", flush=True)
    return path


def load(paths: Sequence[Path], device: str) -> Recorded:
    """Cases of several families, numbered as their ``paths``, on a device."""
    parts = [dict(np.load(path)) for path in paths]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    family = np.concatenate([np.full(len(part["effects"]), number) for number, part in enumerate(parts)])
    hypothesis = hypotheses.number_of(joined["effects"], joined["outside"])
    arrays = joined["samples"], joined["commands"], hypothesis, joined["effects"], family
    return Recorded(*(torch.as_tensor(array, device=device) for array in arrays))


def draw_cases(recorded: Recorded, shares: Mapping[int, float], count: int, course: Course, draw: Draw) -> Batch:
    """``count`` cases as a user may have them, of families as often as their ``shares`` of all are."""
    rows = [torch.nonzero(recorded.family == family)[:, 0] for family in shares]
    table = torch.nn.utils.rnn.pad_sequence(rows, batch_first=True)
    sizes = torch.tensor([len(one) for one in rows], device=table.device)
    ends = torch.cumsum(torch.tensor(list(shares.values()), device=table.device), dim=0)
    which = torch.searchsorted(ends, draw.even(0.0, float(ends[-1]), count), right=True).clamp(max=len(rows) - 1)
    cases = table[which, (draw.even(0.0, 1.0, count) * sizes[which]).long()]
    unit = torch.tensor(UNITS, device=table.device)[:, None]
    signals = recorded.samples[cases].float() * unit  # (B, J, 2, channels, T)
    signals = with_law_error(signals.transpose(1, 2), ADDED, draw)
    angle_zero = ADDED.angle_zero * draw.normal(count, 2, 1, 1, 1)
    zeros = torch.cat([angle_zero, ADDED.pressure_zero * draw.normal(count, 2, 1, len(CHANNELS) - 1, 1)], dim=3)
    before, after = (signals + zeros).unbind(dim=1)
    logs = before.shape[1]
    has = what_there_may_be((count, logs, len(CHANNELS)), replace(course, repeated=0.0), draw)
    shown = features(torch, recorded.commands[cases], before, after, has.channels, has.days, has.repeats.float())
    lacking = course.logs - logs
    return Batch(
        torch.nn.functional.pad(shown, (0, 0, 0, 0, 0, lacking)),
        torch.nn.functional.pad(has.logs, (0, lacking)),
        recorded.hypothesis[cases],
        recorded.effects[cases],
        torch.full((count, 2), float("nan"), device=shown.device),
    )
