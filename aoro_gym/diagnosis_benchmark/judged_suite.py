"""The judged suite as files, handed out twice: with the stock machine file, and with one calibrated to each machine.

``FOLDER/stock`` and ``FOLDER/calibrated`` are suites like any other: ``cases/NNNN/{machine.toml,logs,healthy}`` and
``seal.json``. They differ in ``machine.toml`` alone. What is wrong, the judge's verdicts and the seed stand in one file of
answers outside of both, whose digest both seals hold.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.calibration.logs import calibrate_logs
from aoro_gym.calibration.output import calibrate_to
from aoro_gym.diagnosis.recording import SENSORS
from aoro_gym.diagnosis_benchmark.cases import MACHINES, Excitation
from aoro_gym.diagnosis_benchmark.judge.features import PERIOD
from aoro_gym.diagnosis_benchmark.judge.library import Library
from aoro_gym.diagnosis_benchmark.judge.observed import Observed, judge_cases
from aoro_gym.diagnosis_benchmark.judge.plants import Log, PlantRun, Plants
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase, Plan, Suite, plan
from aoro_gym.diagnosis_benchmark.plants.constants import COMMISSIONED_CELSIUS
from aoro_gym.diagnosis_benchmark.sealing import COLUMNS, SALT, digests
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.execution.locking import locked
from aoro_gym.machine import Machine
from aoro_gym.simulation.log import NOISY, voltage_from_signal, write_log
from aoro_gym.units import RPM
from aoro_gym.version import VERSION

VARIANTS = ("stock", "calibrated")
STOCK = MACHINES / "aoro.toml"
SENSED = "full"
"""What all cases log; a method that may read less is told so when it runs."""

Calibrate = Callable[[Sequence[Path], Path], Any]
"""``calibrate(logs, out)`` writes the machine file ``out`` from a machine's healthy logs, or keeps what is there."""


def draw(suite: Suite, families: Sequence[Plants], answers: Path) -> Plan:
    """The plan whose seed ``answers`` hold; where there are none, by the operating system's chance, kept there."""
    if not answers.exists():
        write_json(answers, {"suite": suite.name, "seed": secrets.randbits(128), "salt": secrets.token_hex(SALT)})
    held = read_json(answers)
    if held["suite"] != suite.name:
        raise ValueError(f"answers {answers} are of suite {held['suite']}, not {suite.name}; name another file")
    return plan(suite, families, held["seed"])


def calibrate_on(device: str) -> Calibrate:
    """Calibration of the stock machine on a device, as ``aoro-gym calibrate --logs`` does it; written whatever its verdict
    says, as a user would use it."""

    def calibrate(logs: Sequence[Path], out: Path) -> None:
        calibrate_to(
            out, lambda folder: calibrate_logs(Machine.load(STOCK), logs, device=device, folder=folder), force=True
        )

    return calibrate


def write_machines(folder: Path, made: Plan, families: Sequence[Plants], calibrate: Calibrate) -> None:
    """Log the full turns of each machine's healthy day to ``FOLDER/machines/FAMILY_N/healthy`` and calibrate to them.

    Args:
        folder: Of the suite.
        made: The plan.
        families: Of its plants.
        calibrate: Makes ``FOLDER/machines/FAMILY_N/machine.toml``; a machine that has one is left.
    """
    turns = [one for name, one in made.excitations.items() if name.startswith(("left", "right"))]
    for plants in families:
        for number in range(made.suite.machines):
            place = folder / "machines" / f"{plants.name}_{number}"
            if (place / "machine.toml").exists():
                continue
            machine = made.machine(plants, number)
            rng = np.random.default_rng([made.seed, number, *f"{plants.name} healthy".encode()])
            runs = [PlantRun(machine, turn, seed=int(rng.integers(2**62))) for turn in turns]
            logs = dict(zip([turn.name for turn in turns], plants.record(runs, exact=False), strict=True))
            paths = [_write_log(place / "healthy", made.excitations[name], log) for name, log in logs.items()]
            calibrate(paths, place / "machine.toml")


def write_suite(
    folder: Path,
    answers: Path,
    made: Plan,
    families: Sequence[Plants],
    seen: Mapping[str, Observed],
    libraries: Sequence[Library],
    variants: Sequence[str] = VARIANTS,
) -> dict[str, Any]:
    """Judge, write and seal all cases of a plan.

    Args:
        folder: Gets a suite by variant.
        answers: File that :func:`draw` has begun, outside of ``folder``.
        made: The plan.
        families: Of its plants.
        seen: What the plants of all cases do.
        libraries: Of these and more families, by which the judge judges.
        variants: Machine files that are handed out; ``calibrated`` ones need :func:`write_machines` first.

    Returns:
        The answers.

    Raises:
        ValueError: ``answers`` lie in ``folder``, or it is sealed.
    """
    if answers.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"answers {answers} lie within {folder}, where the diagnosis reads; keep them outside")
    with locked(folder):
        if any((folder / variant / "seal.json").exists() for variant in variants):
            raise ValueError(f"{folder} is sealed already; name a new folder")
        verdicts = judge_cases(made, seen, libraries)
        of_family = {plants.name: plants for plants in families}
        told = {
            case.name: _answer(case, made, of_family[case.family])
            | {"verdicts": {name: each[case.name].as_dict() for name, each in verdicts.items()}}
            for case in made.cases
        }
        sealed = read_json(answers) | {"plan": made.digest, "aoro_gym": VERSION, "cases": told}
        write_json(answers, sealed)
        for variant in variants:
            for case in made.cases:
                _write_case(folder, variant, case, seen[case.name], made.excitations)
            about = {"suite": made.suite.name, "mode": "commissioned", "sensors": SENSED, "variant": variant}
            sha256 = digests(folder / variant, answers)
            write_json(folder / variant / "seal.json", {**about, "cases": len(told), "blind": True, "sha256": sha256})
    return sealed


def _answer(case: JudgedCase, made: Plan, plants: Plants) -> dict[str, Any]:
    """What is withheld of a case: its magnitudes are those of its later day."""
    (run, *_) = made.runs(case, plants, made.machine(plants, case.machine))["logs"]
    return {
        "kind": case.kind, "family": case.family, "machine": case.machine, "protocol": case.protocol,
        "effects": {name: plants.magnitude(name, run.machine, size) for name, size in run.effects.items()},
        "outside": case.outside, "novel": case.novel, "logs": list(made.protocols[case.protocol]),
    }  # fmt: skip


def _write_case(
    folder: Path, variant: str, case: JudgedCase, seen: Observed, excitations: Mapping[str, Excitation]
) -> None:
    """Write a case's folder, whole or not at all."""
    place = folder / variant / "cases" / case.name
    partial = place.with_name(f".{case.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    file = STOCK if variant == "stock" else folder / "machines" / f"{case.family}_{case.machine}" / "machine.toml"
    Machine.load(file).save(partial / "machine.toml")
    for purpose, logs in (("healthy", seen.healthy), ("logs", seen.logs)):
        for name, log in logs.items():
            _write_log(partial / purpose, excitations[name], log)
    partial.rename(place)


def _write_log(folder: Path, excitation: Excitation, log: Log) -> Path:
    """Write a log and its manifest: conditions as the crew believes them to be, the same whatever is wrong."""
    count = len(excitation.steering)
    columns = {
        "time_s": PERIOD * np.arange(count),
        "steering_signal": excitation.steering,
        "steering_signal_V": voltage_from_signal(excitation.steering),
    }
    if excitation.drive is not None:
        columns["drive_signal"] = excitation.drive
    for channel in SENSORS[SENSED]:
        column, unit = COLUMNS[channel]
        columns[column] = log[channel][:count] / unit
    manifest = {
        "manoeuvre": excitation.name,
        "duration_s": round(PERIOD * (count - 1), 9),
        "sensors": NOISY,
        "filters": [],
        "engine_speed_rpm": round(float(Machine.load(STOCK).engine.set_speed) / RPM, 9),
        "oil_temperature_C": COMMISSIONED_CELSIUS,
        "gear": 1,
        "payload_kg": 0.0,
        "ground": {"slope_deg": 0.0, "direction_deg": 0.0, "friction": 1.0, "rolling_resistance": 1.0},
    }
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{excitation.name}.csv"
    write_log(path, columns, manifest)
    return path
