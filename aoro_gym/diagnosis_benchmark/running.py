"""Diagnoses of all cases of the blind check, a process each; what has ended is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from aoro_gym.checks import check_choice
from aoro_gym.diagnosis.recording import SENSORS
from aoro_gym.execution.cluster import Failed, connected, on_ray
from aoro_gym.execution.devices import several
from aoro_gym.execution.digest import Contents
from aoro_gym.execution.files import read_json, write_json, write_text
from aoro_gym.execution.locking import locked
from aoro_gym.execution.provenance import PROVENANCE, check_provenance
from aoro_gym.execution.workers import Failure, Tell, spread

RESULT, FAILED = "diagnosis.json", "error.txt"
"""Files of a case's folder: one of them once it was diagnosed."""

Diagnose = Callable[..., Any]
"""``diagnose(place, out, *, sensors, device)`` reads the case at ``place`` and writes its result into the folder ``out``,
whole or not at all: it may be killed at any time."""


def logged_sensors(folder: Path) -> str:
    """``angle`` or ``full``: what the cases in ``folder`` log; ValueError if they were not sealed."""
    sealed_cases(folder)
    return read_json(folder / "seal.json")["sensors"]


def diagnoses_folder(folder: Path, sensors: str) -> Path:
    """Where the diagnoses of the cases in ``folder`` go by default."""
    return folder / f"diagnoses-{sensors}"


def run_cases(
    folder: Path,
    out: Path,
    *,
    sensors: str,
    device: str = "cpu",
    workers: int = 1,
    ray: str | None = None,
    restart: bool = False,
    accept_code_change: bool = False,
    diagnose: Diagnose | None = None,
    progress: Callable[[str, float], Any] = lambda sentence, share: None,
) -> dict[str, str]:
    """Diagnose every case of a sealed suite that has no diagnosis by this code yet; those that failed are tried again.

    Args:
        folder: With ``cases`` and ``seal.json``.
        out: Gets ``NNN/diagnosis.json`` a case, or ``NNN/error.txt``.
        sensors: ``angle`` or ``full``: what the diagnosis may read.
        device: Where twins run; several, with commas between them, or ``"cuda:all"``, take cases in turn.
        workers: Processes at once.
        ray: Address of a Ray cluster whose nodes share ``folder`` and ``out``, to diagnose there instead; see
            :func:`aoro_gym.execution.cluster.connected`.
        restart: Diagnose all cases anew.
        accept_code_change: Keep diagnoses that other code has made, and record that in ``out``.
        diagnose: What does it, a function of a module; by default that of :mod:`aoro_gym.diagnosis.diagnose`.
        progress: Called with a sentence and the share done.

    Returns:
        Why a case failed, by name; the others have ended well.

    Raises:
        ValueError: ``folder`` holds no sealed suite with these sensors, or ``out`` diagnoses of another one.
        FolderInUse: another process writes into ``out``.
        ChangedInput, ChangedCode: see :func:`~aoro_gym.execution.provenance.check_provenance`.
    """
    cases, logged = sealed_cases(folder), logged_sensors(folder)
    check_choice("sensors", sensors, SENSORS)
    if not set(SENSORS[sensors]) <= set(SENSORS[logged]):
        raise ValueError(f"sensors {sensors!r}: the cases in {folder} log {logged!r} only")
    about = {"sensors": sensors, "cases": read_json(folder / "seal.json")["sha256"]["cases"]}
    with ExitStack() as stack:
        stack.enter_context(locked(out))
        if restart:
            _remove_diagnoses(out)
        devices = several(device)
        _check_earlier_diagnoses(folder, out, cases, about, devices, accept_code_change)
        waiting = [name for name in cases if not (out / name / RESULT).exists()]
        failures = {}
        jobs = {
            name: (diagnose or _diagnose, folder / "cases" / name, out / name, sensors, devices[k % len(devices)])
            for k, name in enumerate(waiting)
        }
        if ray is None:
            ended = spread(_run, jobs, workers=workers)
        else:
            stack.enter_context(connected(ray))
            ended = _on_cluster(jobs, devices[0])
        for done, (name, failure) in enumerate(ended, start=len(cases) - len(jobs) + 1):
            error = out / name / FAILED
            error.unlink(missing_ok=True)
            if failure is not None:
                failures[name] = failure.reason
                write_text(error, f"{failure.reason}\n{failure.trace}\n")
            progress(f"diagnosing: {done} of {len(cases)} cases", done / len(cases))
    return dict(sorted(failures.items()))


def _check_earlier_diagnoses(
    folder: Path, out: Path, cases: list[str], about: dict[str, Any], devices: Sequence[str], accept_code_change: bool
) -> None:
    """Record what the diagnoses in ``out`` follow from; refuse those of other cases, sensors, devices or code."""
    kept = out / "run.json"
    if kept.exists() and read_json(kept) != about:
        raise ValueError(f"{out} holds diagnoses of other cases, or with other sensors; name another folder")
    inputs = {
        "sensors": about["sensors"],
        # twins on another card of its kind are the same
        "device": ",".join(dict.fromkeys(device.partition(":")[0] for device in devices)),
        "case": {name: Contents(folder / "cases" / name) for name in cases},
    }
    begun = any((out / name / RESULT).exists() for name in cases)
    check_provenance(out / PROVENANCE, inputs, begun=begun, accept_code_change=accept_code_change)
    write_json(kept, about)


def _remove_diagnoses(out: Path) -> None:
    """Remove all diagnoses in ``out``, and what they follow from."""
    for result in [*out.glob(f"*/{RESULT}"), *out.glob(f"*/{FAILED}")]:
        result.unlink()
    for name in ("run.json", PROVENANCE):
        (out / name).unlink(missing_ok=True)


def sealed_cases(folder: Path) -> list[str]:
    """Names of the cases in ``folder``.

    Raises:
        ValueError: their suite was not sealed.
    """
    if not (folder / "seal.json").is_file():
        raise ValueError(
            f"{folder} holds no seal.json: let 'aoro-gym blind seal {folder}' make cases there, to its end"
        )
    return sorted(path.name for path in (folder / "cases").iterdir() if not path.name.startswith("."))


def read_diagnoses(folder: Path, out: Path) -> tuple[str, dict[str, dict[str, Any] | str]]:
    """The sensors that the diagnoses in ``out`` of the cases in ``folder`` were given, and by case what ``diagnosis.json``
    holds, or why there is none.

    Raises:
        ValueError: a case was not diagnosed yet, or ``out`` holds diagnoses of other cases.
    """
    cases = sealed_cases(folder)
    again = f"let 'aoro-gym blind run {folder}' end first"
    if not (out / "run.json").is_file():
        raise ValueError(f"{out} holds no diagnoses; {again}, or name their folder with --diagnoses")
    about = read_json(out / "run.json")
    if about["cases"] != read_json(folder / "seal.json")["sha256"]["cases"]:
        raise ValueError(f"{out} holds diagnoses of other cases than {folder}; name the right folder")
    found: dict[str, dict[str, Any] | str] = {}
    for name in cases:
        if (out / name / RESULT).is_file():
            found[name] = read_json(out / name / RESULT)
        elif (out / name / FAILED).is_file():
            found[name] = (out / name / FAILED).read_text(encoding="utf-8").splitlines()[0]
    missing = [name for name in cases if name not in found]
    if missing:
        raise ValueError(f"{len(missing)} of {len(cases)} cases have no diagnosis, {missing[0]} among them; {again}")
    return about["sensors"], found


def _on_cluster(jobs: Mapping[str, tuple[Any, ...]], device: str) -> Iterator[tuple[str, Failure | None]]:
    """As :func:`~aoro_gym.execution.workers.spread`, on the cluster that is connected."""
    jobs = {
        name: (diagnose, place.absolute(), out.absolute(), *rest)
        for name, (diagnose, place, out, *rest) in jobs.items()
    }
    for name, result in on_ray(partial(_run, _silent), jobs, device=device):
        yield name, Failure(result.reason, result.trace) if isinstance(result, Failed) else None


def _silent(amount: int) -> None:
    """Nobody hears what a job on another node tells."""


def _run(tell: Tell, diagnose: Diagnose, place: Path, out: Path, sensors: str, device: str) -> None:
    out.mkdir(parents=True, exist_ok=True)
    diagnose(place, out, sensors=sensors, device=device)
    if not (out / RESULT).is_file():
        raise FileNotFoundError(f"the diagnosis ended without {out / RESULT}")


def _diagnose(place: Path, out: Path, *, sensors: str, device: str) -> None:
    import warp

    from aoro_gym.diagnosis.diagnose import diagnose_case  # twins are for the processes that use them

    warp.config.log_level = warp.LOG_ERROR  # no banner of every process
    diagnose_case(place, out, sensors=sensors, device=device)
