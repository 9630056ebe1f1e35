"""Cases of the blind check as files, and the seal on their answers.

A folder gets ``cases/NNN`` with what a user would have: ``machine.toml``, ``logs/*.csv``, in commissioned mode
``healthy/*.csv``, each log with its manifest. What is wrong stands in a file outside of it, and beside that file, for an
oracle that knows, what the same plant does with and without the deviation on noise-free sensors. ``seal.json`` holds the
digests of them all: what was sealed can be shown later, and what was changed since is refused.
"""

from __future__ import annotations

import hashlib
import secrets
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.checks import check_choice
from aoro_gym.diagnosis.recording import SENSORS
from aoro_gym.diagnosis_benchmark.cases import Case, Family, Suite, plan
from aoro_gym.diagnosis_benchmark.plants.constants import COMMISSIONED_CELSIUS
from aoro_gym.diagnosis_benchmark.plants.runs import Recorded, Run, record
from aoro_gym.execution.files import read_json, write_json, written_whole
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance
from aoro_gym.execution.workers import Tell, spread
from aoro_gym.machine import Machine
from aoro_gym.simulation.log import NOISY, voltage_from_signal, write_log
from aoro_gym.units import BAR, RPM
from aoro_gym.version import VERSION

COLUMNS = {
    "joint_angle": ("joint_angle_rad", 1.0), "pressure_a": ("pressure_a_bar", BAR), "pressure_b": ("pressure_b_bar", BAR),
    "pump_pressure": ("pump_pressure_bar", BAR),
}  # fmt: skip
"""Column and SI value of its unit, by channel."""

BATCH = 40
"""Cases simulated together, about 1200 runs; an interruption loses one batch at most."""

SALT = 32
"""Bytes of chance among the answers, lest a digest of guessed ones be compared with theirs."""


def write_cases(
    suite: Suite,
    folder: Path,
    answers: Path,
    *,
    mode: str,
    sensors: str,
    family: Family,
    seed: int | None = None,
    batch: int = BATCH,
    workers: int = 1,
    accept_code_change: bool = False,
    progress: Callable[[str, float], Any] = lambda sentence, share: None,
) -> dict[str, Any]:
    """Draw, simulate, write and seal the cases of a suite; goes on where an interrupted call stopped.

    Args:
        suite: How many of which.
        folder: Gets ``cases/NNN`` and ``seal.json``.
        answers: File of the answers, outside of ``folder``. What oracles need stands in the folder :func:`exact_folder`.
        mode: ``day-one`` or ``commissioned``.
        sensors: ``angle`` or ``full``.
        family: ``score`` or ``development`` of :data:`aoro_gym.diagnosis_benchmark.cases.FAMILIES`.
        seed: Of all draws; by default the operating system's chance. Who gives one can know the answers, so such a suite is
            not called blind.
        batch: Cases simulated together.
        workers: Processes that share the batches; the files are the same however many.
        accept_code_change: Keep cases that other code has made, and record that in ``folder``.
        progress: Called with a sentence and the share done.

    Returns:
        The answers.

    Raises:
        ValueError: ``answers`` lies in ``folder``, or what is there belongs to another suite.
        FolderInUse: another process writes into ``folder``.
        ChangedInput, ChangedCode: see :func:`~aoro_gym.execution.provenance.check_provenance`.
        ChildProcessError: a batch failed; the others that ended are kept.
    """
    check_choice("sensors", sensors, SENSORS)
    if answers.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"answers {answers} lie within {folder}, where the diagnosis reads; keep them outside")
    asked = {
        "suite": suite.name, "mode": mode, "sensors": sensors, "family": family.name, "aoro_gym": VERSION,
    }  # fmt: skip
    with locked(folder):
        sealed, cases = _drawn(suite, folder, answers, asked, family=family, seed=seed)
        begun = (folder / "cases").exists()
        check_provenance(
            folder / PROVENANCE, asked, begun=begun, restart="a new folder", accept_code_change=accept_code_change
        )
        if (folder / "seal.json").exists():
            return open_seal(folder, answers)
        _simulate(cases, folder, answers, sensors, batch=batch, workers=workers, progress=progress)
        seal = {**asked, "cases": len(cases), "blind": sealed["blind"], "sha256": digests(folder, answers)}
        if not sealed["blind"]:
            seal["seed"] = sealed["seed"]
        write_json(folder / "seal.json", seal)
    return sealed


def _drawn(
    suite: Suite, folder: Path, answers: Path, asked: Mapping[str, Any], *, family: Family, seed: int | None
) -> tuple[dict[str, Any], list[Case]]:
    """What ``answers`` hold, from an interrupted call or drawn and written now, and the cases that follow."""
    mode = asked["mode"]
    if answers.exists():
        sealed = read_json(answers)
        for name, value in {**asked, **({} if seed is None else {"seed": seed})}.items():
            if sealed.get(name) != value:
                raise ValueError(f"answers {answers} are of {name} {sealed.get(name)}, not {value}; name another file")
        cases = plan(suite, mode=mode, family=family, seed=sealed["seed"])
        if not (folder / "seal.json").exists() and sealed["cases"] != {case.name: case.answer() for case in cases}:
            raise ValueError(
                f"answers {answers} do not follow from their seed: they, or the code that draws them, were changed; begin "
                "a new folder"
            )
        return sealed, cases
    if (folder / "cases").exists():
        raise ValueError(f"{folder} holds cases, but their answers are not in {answers}; name the right file")
    drawn = secrets.randbits(128) if seed is None else seed
    cases = plan(suite, mode=mode, family=family, seed=drawn)
    about = {**asked, "blind": seed is None, "seed": drawn, "salt": secrets.token_hex(SALT)}
    sealed = {**about, "cases": {case.name: case.answer() for case in cases}}
    write_json(answers, sealed)  # before the first case, so that an interrupted suite has its seed
    return sealed, cases


def _simulate(
    cases: Sequence[Case],
    folder: Path,
    answers: Path,
    sensors: str,
    *,
    batch: int,
    workers: int,
    progress: Callable[[str, float], Any],
) -> None:
    """Simulate and write the cases that are not there yet, in batches."""
    missing = [part for part in _batches(cases, batch) if not all(_place(folder, case).exists() for case in part)]
    ticks = sum(len(run.steering) for part in missing for case in part for run in _flat(case.runs()))
    done = 0

    def tell(more: int) -> None:
        nonlocal done
        done += more
        progress("simulating plants", done / ticks)

    threads = None if workers == 1 else 1
    jobs = {
        f"cases {', '.join(case.name for case in part)}": (part, folder, answers, sensors, threads) for part in missing
    }
    for names, failure in spread(_make, jobs, workers=workers, tell=tell):
        if failure is not None:
            raise ChildProcessError(f"{names} could not be simulated: {failure.reason}")


def open_seal(folder: Path, answers: Path) -> dict[str, Any]:
    """The answers to the cases in ``folder``.

    Raises:
        ValueError: cases or answers are not those that were sealed.
    """
    seal = read_json(folder / "seal.json")
    found = digests(folder, answers)
    for what, digest in seal["sha256"].items():
        if found[what] != digest:
            raise ValueError(
                f"the {what} have the digest {found[what]}, but {digest} was sealed: they were changed since, or belong "
                "to another suite"
            )
    return read_json(answers)


def answers_file(folder: Path, answers: Path | None = None) -> Path:
    """File of the answers: ``answers``, by default beside the suite's ``folder``."""
    return folder.with_name(f"{folder.name}.answers.json") if answers is None else answers


def exact_folder(answers: Path) -> Path:
    """Folder beside ``answers`` with ``NNN.npz`` for every case that has a deviation: arrays ``LOG/CHANNEL/with`` and
    ``LOG/CHANNEL/without`` it, of two effects ``LOG/CHANNEL/without ID``, too, SI, at the log's ticks, on sensors without
    noise."""
    return answers.with_name(f"{answers.stem}.exact")


def _make(tell: Tell, part: Sequence[Case], folder: Path, answers: Path, sensors: str, threads: int | None) -> None:
    """Simulate cases together, and write them."""
    runs = [case.runs() for case in part]
    logs = iter(record([run for each in runs for run in _flat(each)], threads=threads, progress=tell))
    for case, each in zip(part, runs, strict=True):
        found = {purpose: [next(logs) for _ in group] for purpose, group in each.items()}
        if not _place(folder, case).exists():
            _write_exact(exact_folder(answers) / f"{case.name}.npz", case, found, sensors)
            _write_case(_place(folder, case), case, found, sensors)


def _batches(cases: Sequence[Case], size: int) -> list[Sequence[Case]]:
    """Cases that are simulated together, the same whatever is done already."""
    return [cases[first : first + size] for first in range(0, len(cases), size)]


def _flat(runs: Mapping[str, Sequence[Run]]) -> list[Run]:
    return [run for group in runs.values() for run in group]


def _place(folder: Path, case: Case) -> Path:
    return folder / "cases" / case.name


def _write_case(place: Path, case: Case, found: Mapping[str, Sequence[Recorded]], sensors: str) -> None:
    """Write a case's folder, whole or not at all."""
    partial = place.with_name(f".{place.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    Machine.load(case.twin).save(partial / "machine.toml")  # whole, whatever it is an overlay of
    for purpose in ("healthy", "logs"):
        for excitation, log in zip(case.excitations, found.get(purpose, ()), strict=False):
            columns = {
                "time_s": log.time, "steering_signal": log.steering, "steering_signal_V": voltage_from_signal(log.steering)
            }  # fmt: skip
            if excitation.drive is not None:
                columns["drive_signal"] = log.drive
            for channel in SENSORS[sensors]:
                column, unit = COLUMNS[channel]
                columns[column] = log.channels[channel] / unit
            write_log(partial / purpose / f"{excitation.name}.csv", columns, _manifest(case, excitation.name, log))
    partial.rename(place)


def _manifest(case: Case, excitation: str, log: Recorded) -> dict[str, Any]:
    """What the crew would note: the conditions as they believe them to be, the same whatever is wrong."""
    return {
        "manoeuvre": excitation,
        "duration_s": round(float(log.time[-1]), 9),
        "sensors": NOISY,
        "filters": [],
        "engine_speed_rpm": round(float(case.later.engine.set_speed) / RPM, 9),
        "oil_temperature_C": COMMISSIONED_CELSIUS,
        "gear": 1,
        "payload_kg": 0.0,
        "ground": {"slope_deg": 0.0, "direction_deg": 0.0, "friction": 1.0, "rolling_resistance": 1.0},
    }


def _write_exact(path: Path, case: Case, found: Mapping[str, Sequence[Recorded]], sensors: str) -> None:
    if not case.hidden:
        return
    arrays = {
        f"{excitation.name}/{channel}/{purpose}": log.channels[channel].astype(np.float32)
        for purpose, logs in found.items()
        if purpose not in ("healthy", "logs")
        for excitation, log in zip(case.excitations, logs, strict=True)
        for channel in SENSORS[sensors]
    }
    with written_whole(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # pyright: ignore[reportArgumentType]  keys are names of arrays


def digests(folder: Path, answers: Path) -> dict[str, str]:
    """SHA-256 of the answers' file, which holds the salt, and of all names and contents of the exact logs and the cases."""
    return {
        "answers": hashlib.sha256(answers.read_bytes()).hexdigest(),
        "exact logs": _digest(exact_folder(answers)),
        "cases": _digest(folder / "cases"),
    }


def _digest(folder: Path) -> str:
    total = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        for part in (path.relative_to(folder).as_posix().encode(), path.read_bytes()):
            total.update(len(part).to_bytes(8, "big") + part)
    return total.hexdigest()
