"""Networks that families of plants teach beside simulated twins, each network without some of the families.

``python -m studies.cross_fitting FOLDER --start NETWORKS --device cuda:0`` simulates cases of all development plants (kept
in ``FOLDER``) and days of twins, and trains a network for each of :data:`LEFT_OUT`. What a network says of the families that
it never saw calibrates it (``studies.development``), and a diagnosis asks all networks. Plants that judge the diagnosis are
of other families still. Half of every batch are twins, half plants, every family as often as another.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from aoro_gym.diagnosis.network.dataset import Amount, simulate
from aoro_gym.diagnosis.network.forward import Weights, networks_in
from aoro_gym.diagnosis.network.sensing import Draw
from aoro_gym.diagnosis.network.training import Batch, Course, train
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.diagnosis_benchmark.judge.plants import IndependentPlants, LayeredPlants, Plants
from aoro_gym.execution.digest import Contents, digest, versions
from aoro_gym.execution.files import read_json, write_json
from studies.cross_fitting.plants import ADDED, SEED, SUITE, Recorded, draw_cases, load, simulated
from studies.development.cases import INDEPENDENT, LAYERED

LEFT_OUT = (("alder", "level_0", "level_3"), ("birch", "level_1"), ("cedar", "level_2"))
"""Families that each network never sees."""
HELD_OUT = 2000
"""Machines that no network sees."""


def starts_in(folder: Path) -> list[Path]:
    """Files of the networks to begin with, one for each of :data:`LEFT_OUT`.

    Raises:
        ValueError: families that one of them may not have seen have taught it.
    """
    files, told = networks_in(folder), folder / "training.json"
    taught = read_json(told).get("networks", []) if told.exists() else []
    if taught and [set(one["left_out"]) for one in taught] != [set(one) for one in LEFT_OUT]:
        raise ValueError(
            f"{told}: networks left out other families than {LEFT_OUT}; name networks that plants have not taught"
        )
    return [files[number % len(files)] for number in range(len(LEFT_OUT))]


def between(start: Weights, end: Weights, kept: float) -> Weights:
    """Network whose weights lie between two others', a share ``kept`` of the way from the end back to the start.

    A network that went on from another lies in the same valley of the loss, and those between them do better where neither
    has been (Wortsman et al. 2022, robust fine-tuning): what plants of a few families teach by heart is forgotten first.
    """
    arrays = {
        name: (kept * values + (1.0 - kept) * end.arrays[name]).astype(np.float32)
        for name, values in start.arrays.items()
    }
    return Weights(end.shape, arrays, kept * start.scales + (1.0 - kept) * end.scales)


def taught_by(
    recorded: Recorded, names: Sequence[str], left_out: Sequence[str], course: Course
) -> Callable[[int, Draw], Batch]:
    """What draws cases of all families but those ``left_out``."""
    families = [number for number, name in enumerate(names) if name not in left_out]

    def beside(count: int, draw: Draw) -> Batch:
        return draw_cases(recorded, families, count, course, draw)

    return beside


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--machines", type=int, default=65536, help="of twins")
    parser.add_argument("--processes", type=int, default=8, help="that draw machines")
    parser.add_argument("--seconds", type=float, default=600.0, help="of training, each network")
    parser.add_argument(
        "--kept",
        type=float,
        default=0.5,
        help="share of the weights that networks begin with in those that are written",
    )
    parser.add_argument(
        "--start",
        type=Path,
        required=True,
        help="folder of networks to begin with: no plants have taught them, or all but those that are left out",
    )
    options = parser.parse_args()
    starts = starts_in(options.start)
    options.folder.mkdir(parents=True, exist_ok=True)
    plants: list[Plants] = [IndependentPlants(one.name, options.device) for one in INDEPENDENT]
    plants += [LayeredPlants(level, options.device) for level in range(len(LAYERED))]
    names = [one.name for one in plants]
    amount = Amount(options.machines, seed=SEED, processes=options.processes)
    began = time.monotonic()

    def say(text: str) -> None:
        print(f"{time.monotonic() - began:.0f} s: {text}", flush=True)

    with ProcessPoolExecutor(len(plants), mp_context=multiprocessing.get_context("spawn")) as pool:
        paths = [pool.submit(simulated, options.folder, one, seed=SEED + number) for number, one in enumerate(plants)]
        days, scales = simulate(
            Prior(), amount, options.device, lambda done, total: say(f"machine {done} of {total} simulated")
        )
        recorded = load([path.result() for path in paths], options.device)
    say(f"{len(recorded.family)} cases of plants, {days.machines} machines")
    course = Course(steps=1_000_000, rate=5e-4)
    for number, left_out in enumerate(LEFT_OUT):
        start = Weights.load(starts[number])
        network = train(
            days, course, start=start, seconds=options.seconds, held_out=HELD_OUT,
            seed=SEED + number, beside=taught_by(recorded, names, left_out, course),
            progress=lambda step, steps, losses: say(f"step {step}: " + str({k: round(v, 3) for k, v in losses.items()})),
        )  # fmt: skip
        between(start, network.weights(scales), options.kept).save(options.folder / f"network_{number}.safetensors")
        say(f"network {number} is trained, without {', '.join(left_out)}")
    write_json(
        options.folder / "training.json",
        {
            "amount": asdict(amount), "course": asdict(course), "seconds": options.seconds, "kept": options.kept,
            "prior": asdict(Prior()),
            "sensors": asdict(SensorPrior()), "plants": {"suite": asdict(SUITE), "seed": SEED, "added": asdict(ADDED)},
            "device": torch.cuda.get_device_name() if torch.cuda.is_available() else options.device,
            "versions": versions(), "start": [digest(Contents(path)) for path in starts],
            "networks": [
                {"file": f"network_{number}.safetensors", "left_out": list(one)} for number, one in enumerate(LEFT_OUT)
            ],
        },
    )  # fmt: skip


if __name__ == "__main__":
    main()
