"""Networks of tables from nothing: simulate turns, train on them, calibrate and try them on machines that they never saw."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from aoro_gym.diagnosis.network.decision import as_dict, calibrated
from aoro_gym.diagnosis.network.evaluation import BATCH, Answers, answered, rates
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.program import Program, Progress, as_told, finished
from aoro_gym.diagnosis.network.sensing import Draw
from aoro_gym.diagnosis.network.tables_dataset import TablePrior, Tables, draw_batch, simulate
from aoro_gym.diagnosis.network.tables_forward import CALIBRATION, DAY_ONE, NETWORKS, PAIRED, TRAINING, file_name
from aoro_gym.diagnosis.network.tables_model import TablesNetwork
from aoro_gym.diagnosis.network.training import Batch, Course, optimise
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.execution.files import with_nulls, write_json

HELD_OUT = 0.1
"""Share of the machines that networks are calibrated with, and tried on: one half each."""
FEWEST = 8
"""Machines of either half, if there are as many as four times that: on one of them nothing should be wrong on some day."""
ROUNDS = 8
"""Days of each of them."""
SETS = {PAIRED: False, DAY_ONE: True}
"""Sets of tables, and whether these have no healthy day."""


def course(steps: int, batch: int) -> Course:
    """How a network of tables is trained."""
    return Course(steps=steps, batch=batch, rate=1.5e-3, logs=6, day_one=0.35, unpaired=0.06)


def run(program: Program, device: str, out: Path, progress: Progress = lambda sentence, share: None) -> dict[str, Any]:
    """Train networks of tables; each is written to ``out`` once it is trained, then their calibration and how well they do.
    Networks that an earlier run of the same program finished there are kept.

    Args:
        program: What is trained; its manoeuvres are full turns.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        out: Folder for :data:`~aoro_gym.diagnosis.network.tables_forward.NETWORKS` and what belongs to them, made where
            there is none.
        progress: Told what is done.

    Returns:
        What the file of :data:`~aoro_gym.diagnosis.network.tables_forward.TRAINING` holds.
    """
    began = time.monotonic()
    out.mkdir(parents=True, exist_ok=True)
    told = as_told(program, device) | {"tables": asdict(TablePrior())}
    before = finished(out / TRAINING, told)
    kept = before["networks"][: program.networks]
    if len(kept) == program.networks and (out / CALIBRATION).exists():
        progress("all networks are trained already", 1.0)
        return before
    progress("drawing machines", 0.0)
    data, scales = simulate(
        Prior(), program.amount, device, threads=program.amount.processes,
        progress=lambda done, total: progress(f"turn {done} of {total} simulated", 0.5 * done / total),
    )  # fmt: skip
    result: dict[str, Any] = told | {
        "machines": data.machines,
        "simulated_s": time.monotonic() - began,
        "networks": kept,
    }
    trained = [TablesNetwork.of(Weights.load(out / one["file"])).to(device) for one in kept]
    for number in range(len(kept), program.networks):
        first, part = 0.5 + 0.5 * number / program.networks, 0.5 / program.networks

        def tell(step: int, steps: int, losses: dict[str, float], first: float = first, part: float = part) -> None:
            progress(f"step {step} of {steps}, cross-entropy {losses['cause']:.2f}", first + part * step / steps)

        start = time.monotonic()
        trained.append(train(data, program, seed=program.amount.seed + number, progress=tell))
        trained[-1].weights(scales).save(out / file_name(number))
        result["networks"].append({"file": file_name(number), "trained_s": time.monotonic() - start})
        write_json(out / TRAINING, with_nulls(result))
    calibrating, trying = _halves(data)
    sets = {name: _calibrated(trained, data, calibrating, day_one) for name, day_one in SETS.items()}
    write_json(out / CALIBRATION, {"source": "simulated machines that were held out", "sets": as_dict(sets)})
    result["rates"] = {
        name: rates(_answers(trained, data, trying, day_one, seed=2)).as_dict() for name, day_one in SETS.items()
    }
    result["whole_s"] = time.monotonic() - began
    write_json(out / TRAINING, with_nulls(result))
    for stale in set(out.glob(NETWORKS)) - {out / one["file"] for one in result["networks"]}:
        stale.unlink()
    return with_nulls(result)


def train(
    data: Tables, program: Program, *, seed: int, progress: Any = lambda step, steps, losses: None
) -> TablesNetwork:
    """A trained network; the last :data:`HELD_OUT` of the machines it never sees. ``progress`` as in
    :func:`aoro_gym.diagnosis.network.training.train`."""
    torch.manual_seed(seed)
    device = data.figures.device
    draw = Draw(torch.Generator(device=device).manual_seed(seed))
    network = TablesNetwork(program.shape).to(device)
    seen = data.machines - sum(len(one) for one in _halves(data))

    def make() -> Batch:
        machines = draw.one_of(seen, program.course.batch)
        return draw_batch(data, machines, program.course, draw, prior=TablePrior(), sensors=SensorPrior())

    optimise(network, make, program.course, device, seconds=program.seconds, progress=progress)
    return network


def _halves(data: Tables) -> tuple[torch.Tensor, torch.Tensor]:
    """Numbers of machines that networks are calibrated with, and tried on; of few machines a quarter each."""
    half = max(int(0.5 * HELD_OUT * data.machines), min(FEWEST, data.machines // 4), 1)
    held_out = torch.arange(data.machines - 2 * half, data.machines, device=data.figures.device)
    return held_out[:half], held_out[half:]


def _calibrated(networks: list[TablesNetwork], data: Tables, machines: torch.Tensor, day_one: bool) -> Any:
    said = _answers(networks, data, machines, day_one, seed=1)
    return calibrated(said.probabilities.astype("float64"), said.truth, statistics={"nothing": 1.0}, offset=False)


def _answers(
    networks: list[TablesNetwork], data: Tables, machines: torch.Tensor, day_one: bool, *, seed: int
) -> Answers:
    """What the mean of ``networks`` says of tables of ``machines``, with or without healthy days."""
    draw = Draw(torch.Generator(device=data.figures.device).manual_seed(seed))

    def batches() -> Iterator[Batch]:
        for part in machines.repeat(ROUNDS).split(BATCH):
            yield draw_batch(
                data, part, replace(course(1, 1), day_one=0.0), draw, prior=TablePrior(), sensors=SensorPrior(),
                day_one=day_one,
            )  # fmt: skip

    return answered(networks, batches())
