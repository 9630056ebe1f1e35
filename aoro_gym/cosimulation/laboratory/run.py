"""One run of the parted machine beside the whole one, its driveline in another process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.checks import check_range
from aoro_gym.cosimulation.laboratory.comparison import (
    HUB_INERTIA,
    Difference,
    differences,
    drive_parted,
    drive_whole,
    parted,
)
from aoro_gym.cosimulation.laboratory.coupling import Coupling
from aoro_gym.cosimulation.laboratory.delays import DelayLine
from aoro_gym.cosimulation.laboratory.manoeuvres import MANOEUVRES
from aoro_gym.cosimulation.laboratory.process import LaboratoryLost, RemoteDriveline
from aoro_gym.cosimulation.laboratory.protection import Limits, Phase, Protection
from aoro_gym.machine.parameters import Machine

LISTENING = "driveline on "
"""What a driveline's process writes first, with its address behind it."""
MAIN_STEP = 1e-3
WHOLE = 0.1
"""Share of the time that the whole twin takes (E)."""
PATIENCE = 10.0
"""Limit of silence [s] of a driveline that this process starts: in lock-step its time stands still while no one asks."""


@dataclass(frozen=True)
class Line:
    """What happens to packets, both ways together but for ``loss``."""

    delay: float = 0.0
    """Round trip [s], a whole number of periods."""
    jitter: float = 0.0
    """[s], a whole number of periods."""
    loss: float = 0.0
    """Probability each way."""
    seed: int = 0


@dataclass(frozen=True)
class Outcome:
    """Of one run."""

    manoeuvre: str
    period_s: float
    line: Line
    hub_inertia_kg_m2: float
    phase: Phase
    reason: str
    differences: list[Difference] = field(default_factory=list)
    """To the whole twin; none where the laboratory stopped."""
    round_trip_us: dict[str, float] = field(default_factory=dict)
    """Of the sockets themselves, percentiles."""

    def as_json(self) -> str:
        """One object."""
        return json.dumps(asdict(self), indent=1) + "\n"


def lines(line: Line, period: float) -> tuple[DelayLine, DelayLine]:
    """The way to the driveline and back; of an odd number of periods the way there takes one more."""
    counts = []
    for name in ("delay", "jitter"):
        value = getattr(line, name)
        check_range(name, value, "s", ge=0.0)
        count = round(value / period)
        if abs(count * period - value) > 1e-6 * period:
            raise ValueError(
                f"{name} is {1e3 * value:g} ms, but must be a whole multiple of the period {1e3 * period:g} ms"
            )
        counts.append(count)
    delay, jitter = counts
    forth = DelayLine(delay - delay // 2, jitter - jitter // 2, line.loss, seed=2 * line.seed)
    return forth, DelayLine(delay // 2, jitter // 2, line.loss, seed=2 * line.seed + 1)


def run(
    machine: Machine,
    manoeuvre: str,
    address: tuple[str, int],
    *,
    steps: int = 1,
    line: Line | None = None,
    limits: Limits | None = None,
    token: bytes | None = None,
    hub_inertia: float = HUB_INERTIA,
    done: Callable[[str, float], None] = lambda what, share: None,
) -> Outcome:
    """Drive a manoeuvre with the driveline at ``address``, in lock-step, and compare it with the whole twin's.

    Args:
        machine: The whole machine.
        manoeuvre: One of :data:`MANOEUVRES`.
        address: Of the other process.
        steps: Main steps of 1 ms in a period.
        line: What happens to packets.
        limits: Of the laboratory; without a soft start the run is the whole twin's.
        token: Which datagrams are authenticated with.
        hub_inertia: Of a hub [kg m²], on the driveline's side.
        done: Is told what is driven and the share of all that is done.
    """
    driven, line, limits = MANOEUVRES[manoeuvre], line or Line(), limits or Limits(soft_start=0.0)
    period = steps * MAIN_STEP
    forth, back = lines(line, period)
    whole = drive_whole(machine, driven, period, lambda share: done("the whole twin", WHOLE * share))
    bodies, _ = parted(machine, driven, hub_inertia=hub_inertia)
    remote = RemoteDriveline(address, main_step=MAIN_STEP, steps=steps, token=token)
    protection = Protection(limits, bodies.hub_torques)
    try:
        coupling = Coupling(bodies, remote, steps=steps, forth=forth, back=back, protection=protection)
        outputs, _ = drive_parted(
            coupling, driven, lambda share: done("over the socket", WHOLE + (1.0 - WHOLE) * share)
        )
    except LaboratoryLost as lost:
        protection.stop(str(lost))
        outputs = np.empty((0, 0), dtype=np.float32)
    finally:
        remote.close()
    trips = np.array(remote.round_trips or [np.nan]) * 1e6
    percentiles = {f"p{percent:g}": float(np.percentile(trips, percent)) for percent in (50.0, 90.0, 99.0)}
    stopped = protection.phase is Phase.STOPPED
    found = [] if stopped else differences(whole, outputs)
    return Outcome(manoeuvre, period, line, hub_inertia, protection.phase, protection.reason, found, percentiles)


@contextmanager
def driveline_process(machine: str, hub_inertia: float = HUB_INERTIA) -> Iterator[tuple[str, int]]:
    """The address of a driveline in a process of its own, which ends with the context."""
    command = [sys.executable, "-m", "aoro_gym", "laboratory", "--driveline", "--port", "0", "--quiet"]
    command += ["--machine", machine, "--hub-inertia", str(hub_inertia), "--limit-silence", str(1e3 * PATIENCE)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            out: Any = process.stdout
            for text in out:
                if text.startswith(LISTENING):
                    host, _, port = text.removeprefix(LISTENING).strip().rpartition(":")
                    break
            else:
                raise LaboratoryLost(f"the driveline's process ended with code {process.wait()}")
            yield host, int(port)
        finally:
            process.terminate()


def write(outcome: Outcome, folder: Path) -> Path:
    """Write ``laboratory.json``."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "laboratory.json"
    path.write_text(outcome.as_json())
    return path
