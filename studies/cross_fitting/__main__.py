"""Networks that families of plants teach beside simulated twins, each network without some of the families.

``python -m studies.cross_fitting FOLDER --start NETWORKS --device cuda:0`` simulates cases of all development plants (kept
in ``FOLDER``) and days of twins, and trains a network for each of :data:`LEFT_OUT`. What a network says of the families that
it never saw calibrates it (``studies.development``), and a diagnosis asks all networks. Plants that judge the diagnosis are
of other families still. Half of every batch are twins, half plants: a share of these mixtures of such component families as
the network may see, of the others every family as often as another.

On a GPU the plants come first: ``--plants-only`` simulates them and stops; families whose file is there are not simulated
again, so that it goes on where it was stopped. Twins and training come with the same command without it. Measured on two
H200 of one host that other trainings shared, half of the plants on each: 329 s for 12 families and 36 mixtures (20 workers),
then 130 s for 40,960 twins and 150 s of training a network.
``--only 0 2`` trains these networks alone, so that a second GPU trains the other one into the same folder.
``--cases 0.01 --machines 24 --held-out 8 --mixtures 1 --batch 16 --seconds 5 --device cpu`` tries all that out.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch

from aoro_gym.diagnosis.network.dataset import Amount, simulate
from aoro_gym.diagnosis.network.forward import Weights, networks_in
from aoro_gym.diagnosis.network.sensing import Draw
from aoro_gym.diagnosis.network.training import Batch, Course, train
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.diagnosis_benchmark import component_families
from aoro_gym.diagnosis_benchmark.component_families.parts import MIXED, mixture
from aoro_gym.diagnosis_benchmark.judge.plants import ComponentPlants, Plants
from aoro_gym.diagnosis_benchmark.judge.suite import Suite
from aoro_gym.execution.digest import Contents, digest, versions
from aoro_gym.execution.files import write_json
from studies.cross_fitting.plants import ADDED, MIXED_SUITE, SEED, SUITE, Recorded, draw_cases, load, simulated
from studies.development.cases import COMPONENT, INDEPENDENT, LAYERED, TAUGHT
from studies.development.teachers import TOLD, families_in, teachers, told_of

LEFT_OUT = (("alder", "elm", "level_0", "level_3"), ("birch", "fir", "level_1"), ("cedar", "hazel", "level_2"))
"""Families that each network never sees, nor mixtures with parts of theirs."""
HELD_OUT = 2000
"""Machines that no network sees."""


def starts_in(folder: Path) -> list[Path]:
    """Files of the networks to begin with, one for each of :data:`LEFT_OUT`.

    Raises:
        ValueError: Each of them has been taught by a family that is to be left out.
    """
    files, told = networks_in(folder), told_of(folder)
    if not told:
        return [files[number % len(files)] for number in range(len(LEFT_OUT))]
    found = []
    for left_out in LEFT_OUT:
        fit = [folder / one["file"] for one in told if not teachers(one) & set(left_out)]
        if not fit:
            raise ValueError(
                f"{folder / TOLD}: some of {', '.join(left_out)} have taught each network; name networks that left them out"
            )
        found.append(fit[0])
    return found


def file_of(number: int) -> str:
    """Name of the file of a network."""
    return f"network_{number}.safetensors"


def mixtures(left_out: Sequence[str], count: int) -> list[str]:
    """Names of ``count`` mixtures of the component families that are not ``left_out``."""
    return [mixture([one for one in component_families.FAMILIES if one not in left_out], n) for n in range(count)]


def teaching(device: str, count: int) -> list[Plants]:
    """All plants that teach: families, levels, and ``count`` mixtures for each of :data:`LEFT_OUT`."""
    only_teach = [ComponentPlants(name) for name in component_families.FAMILIES if name not in TAUGHT]
    plants: list[Plants] = [replace(one, device=device) for one in (*INDEPENDENT, *LAYERED, *COMPONENT, *only_teach)]
    names = dict.fromkeys(name for some in LEFT_OUT for name in mixtures(some, count))
    return [*plants, *(ComponentPlants(name, device) for name in names)]


def shares_of(names: Sequence[str], left_out: Sequence[str], mixed: float) -> dict[int, float]:
    """How often each of the plants that a network may see teaches it, by number: all mixtures together a share ``mixed``."""
    seen = [number for number, name in enumerate(names) if not families_in([name]) & set(left_out)]
    several = [number for number in seen if names[number].startswith(MIXED)]
    single = [number for number in seen if number not in several]
    mixed = mixed if several else 0.0
    return {one: (1.0 - mixed) / len(single) for one in single} | {one: mixed / len(several) for one in several}


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


def taught_by(recorded: Recorded, shares: Mapping[int, float], course: Course) -> Callable[[int, Draw], Batch]:
    """What draws cases of plants, by their numbers and ``shares``."""

    def beside(count: int, draw: Draw) -> Batch:
        return draw_cases(recorded, shares, count, course, draw)

    return beside


def scaled(suite: Suite, share: float) -> Suite:
    """A ``share`` of a suite's cases, one of each kind at least."""
    counts = {name: max(1, round(share * getattr(suite, name))) for name in ("healthy", "singles", "pairs", "outside")}
    return replace(suite, **counts)


def parsed() -> argparse.Namespace:
    """What the command says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--machines", type=int, default=65536, help="of twins")
    parser.add_argument("--held-out", type=int, default=HELD_OUT, help="of these, machines that no network sees")
    parser.add_argument("--mixtures", type=int, default=12, help="of the component families that each network may see")
    parser.add_argument("--mixed", type=float, default=0.4, help="share of the cases of plants that are of mixtures")
    parser.add_argument("--processes", type=int, default=8, help="that draw machines")
    parser.add_argument("--workers", type=int, default=8, help="that simulate a family of plants each")
    parser.add_argument("--cases", type=float, default=1.0, help="share of the plants' cases, to try the study out")
    parser.add_argument(
        "--only", type=int, nargs="+", choices=range(len(LEFT_OUT)), default=range(len(LEFT_OUT)),
        help="numbers of the networks to train here, as when every GPU trains others into the same folder; all by default",
    )  # fmt: skip
    parser.add_argument("--plants-only", action="store_true", help="simulate plants, and train nothing")
    parser.add_argument("--batch", type=int, default=Course.batch, help="cases in a batch")
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
        help="folder of networks to begin with, which none of what they are to leave out has taught",
    )
    return parser.parse_args()


def main() -> None:
    options = parsed()
    starts = starts_in(options.start)
    options.folder.mkdir(parents=True, exist_ok=True)
    plants = teaching(options.device, options.mixtures)
    names = [one.name for one in plants]
    suites = [scaled(MIXED_SUITE if name.startswith(MIXED) else SUITE, options.cases) for name in names]
    amount = Amount(options.machines, seed=SEED, processes=options.processes)
    began = time.monotonic()

    def say(text: str) -> None:
        print(f"{time.monotonic() - began:.0f} s: {text}", flush=True)

    with ProcessPoolExecutor(options.workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        paths = [
            pool.submit(simulated, options.folder, one, suite, SEED + number)
            for number, (one, suite) in enumerate(zip(plants, suites, strict=True))
        ]
        if options.plants_only:
            for number, path in enumerate(paths):
                say(f"{path.result().name}: {number + 1} of {len(paths)}")
            return
        days, scales = simulate(
            Prior(), amount, options.device, lambda done, total: say(f"machine {done} of {total} simulated")
        )
        recorded = load([path.result() for path in paths], options.device)
    say(f"{len(recorded.family)} cases of {len(plants)} families and mixtures, {days.machines} machines")
    course = Course(steps=1_000_000, batch=options.batch, rate=5e-4)
    taught = [shares_of(names, left_out, options.mixed) for left_out in LEFT_OUT]
    for number in options.only:
        start = Weights.load(starts[number])
        network = train(
            days, course, start=start, seconds=options.seconds, held_out=options.held_out,
            seed=SEED + number, beside=taught_by(recorded, taught[number], course),
            progress=lambda step, steps, losses: say(f"step {step}: " + str({k: round(v, 3) for k, v in losses.items()})),
        )  # fmt: skip
        between(start, network.weights(scales), options.kept).save(options.folder / file_of(number))
        say(f"network {number} is trained, without {', '.join(LEFT_OUT[number])}")
    write_json(
        options.folder / TOLD,
        {
            "amount": asdict(amount), "course": asdict(course), "seconds": options.seconds, "kept": options.kept,
            "prior": asdict(Prior()), "sensors": asdict(SensorPrior()),
            "plants": {
                "suite": asdict(scaled(SUITE, options.cases)), "mixtures": asdict(scaled(MIXED_SUITE, options.cases)),
                "mixed": options.mixed, "seed": SEED, "added": asdict(ADDED),
            },
            "device": torch.cuda.get_device_name() if torch.cuda.is_available() else options.device,
            "versions": versions(), "start": [digest(Contents(path)) for path in starts],
            "networks": [
                {
                    "file": file_of(number), "left_out": list(LEFT_OUT[number]),
                    "taught": [names[one] for one in shares],
                }
                for number, shares in enumerate(taught)
            ],
        },
    )  # fmt: skip


if __name__ == "__main__":
    main()
