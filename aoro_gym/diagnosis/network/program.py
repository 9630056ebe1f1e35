"""Networks of a diagnosis from nothing: simulate days, train on them, try them on machines that they never saw."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from aoro_gym.diagnosis.network.dataset import Amount, simulate
from aoro_gym.diagnosis.network.evaluation import answers, rates
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.model import Network
from aoro_gym.diagnosis.network.shape import Shape
from aoro_gym.diagnosis.network.training import SENSORS, Course, train
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.execution.digest import Contents, digest, versions
from aoro_gym.execution.files import read_json, with_nulls, write_json

HELD_OUT = 0.05
"""Share of the machines that networks are tried on."""
ROUNDS = 2
"""Days of each of them, drawn anew for every set of sensors."""

Progress = Callable[[str, float], Any]
"""Takes a sentence and the share done."""


@dataclass(frozen=True)
class Program:
    """What is trained.

    Attributes:
        amount: Of simulated machines and days.
        networks: Trained one after the other on the same days, each from weights and draws of its own.
        course: Of each.
        seconds: Most time for each [s].
        shape: Sizes of each.
        start: Weights that training begins with, one after the other and again; random ones by default.
    """

    amount: Amount
    networks: int = 3
    course: Course = field(default_factory=Course)
    seconds: float = float("inf")
    shape: Shape = field(default_factory=Shape)
    start: tuple[Path, ...] = ()


def run(program: Program, device: str, out: Path, progress: Progress = lambda sentence, share: None) -> dict[str, Any]:
    """Train networks; each is written to ``out`` once it is trained, and ``training.json`` with how well it does. Networks
    that an earlier run of the same program finished there are kept; what it left besides is removed in the end.

    Args:
        program: What is trained.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        out: Folder for ``network_N.safetensors``, made where there is none.
        progress: Told what is done.

    Returns:
        What ``training.json`` holds.
    """
    began = time.monotonic()
    starts = [Weights.load(path) for path in program.start] or [None]
    if starts[0] is not None:
        program = replace(program, shape=starts[0].shape)
    out.mkdir(parents=True, exist_ok=True)
    told = as_told(program, device)
    before = finished(out / "training.json", told)
    kept = before["networks"][: program.networks]
    if len(kept) == program.networks:
        progress("all networks are trained already", 1.0)
        return before
    share = 0.3
    progress("drawing machines", 0.0)
    data, scales = simulate(
        Prior(), program.amount, device,
        lambda done, total: progress(f"machine {done} of {total} simulated", share * done / total),
    )  # fmt: skip
    result = told | {"machines": data.machines, "simulated_s": time.monotonic() - began, "networks": kept}
    held_out = max(int(HELD_OUT * data.machines), 1)
    machines = torch.arange(data.machines - held_out, data.machines, device=data.samples.device)
    trained = [Network.of(Weights.load(out / one["file"])).to(machines.device) for one in kept]
    for number in range(len(kept), program.networks):
        first = share + (1.0 - share) * number / program.networks
        part = (1.0 - share) / program.networks

        def tell(step: int, steps: int, losses: dict[str, float], first: float = first, part: float = part) -> None:
            progress(f"step {step} of {steps}, cross-entropy {losses['cause']:.2f}", first + part * step / steps)

        start = time.monotonic()
        network = train(
            data, program.course, shape=program.shape, start=starts[number % len(starts)], held_out=held_out,
            seed=program.amount.seed + number, seconds=program.seconds, progress=tell,
        )  # fmt: skip
        name = f"network_{number}.safetensors"
        network.weights(scales).save(out / name)
        trained.append(network)
        result["networks"].append(
            {"file": name, "trained_s": time.monotonic() - start, "rates": _rates([network], data, machines)}
        )
        if number:
            result["together"] = _rates(trained, data, machines)
        write_json(out / "training.json", with_nulls(result))
    for stale in set(out.glob("network_*.safetensors")) - {out / one["file"] for one in result["networks"]}:
        stale.unlink()
    return with_nulls(result)


def as_told(program: Program, device: str) -> dict[str, Any]:
    """All that networks depend on, but for how many there are and how many processes draw machines."""
    told = {
        "amount": asdict(program.amount), "course": asdict(program.course), "shape": program.shape.as_dict(),
        "seconds": program.seconds, "prior": asdict(Prior()), "sensors": asdict(SensorPrior()), "versions": versions(),
        "device": device, "start": [digest(Contents(path)) for path in program.start],
    }  # fmt: skip
    del told["amount"]["processes"]
    return told


def finished(path: Path, told: dict[str, Any]) -> dict[str, Any]:
    """What an earlier run of the same program wrote to ``path``; no networks where there was none, or one is gone."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        found = read_json(path)
        same = json.loads(json.dumps(with_nulls(told)))
        if {key: found[key] for key in same} == same and all(
            (path.parent / one["file"]).exists() for one in found["networks"]
        ):
            return found
    return {"networks": []}


def _rates(networks: list[Any], data: Any, machines: torch.Tensor) -> dict[str, dict[str, float]]:
    return {sensors: rates(answers(networks, data, machines, sensors, rounds=ROUNDS)).as_dict() for sensors in SENSORS}
