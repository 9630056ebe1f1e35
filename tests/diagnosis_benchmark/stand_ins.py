"""Diagnoses of a moment, for the processes that cases are diagnosed in: these import this module and little else."""

import time

from aoro_gym.diagnosis_benchmark.running import run_cases
from aoro_gym.execution.files import write_json, write_text


def stand_in(place, out, *, sensors, device):
    """A diagnosis that fails on the third case and forgets its result of the fourth, until told otherwise."""
    assert (place / "machine.toml").is_file() and list((place / "logs").glob("*.csv"))
    mended = (place.parents[1] / "mended").exists()
    if place.name == "003" and not mended:
        raise ValueError("the log is too short")
    if place.name == "004" and not mended:
        return
    write_json(out / "diagnosis.json", {"verdict": "no_gap", "sensors": sensors, "device": device})


def slow_stand_in(place, out, *, sensors, device):
    """A diagnosis that writes now and then while it works."""
    for part in range(20):
        write_text(out / f"part{part}.txt", "x" * 10_000)
        time.sleep(0.005)
    write_json(out / "diagnosis.json", {"case": place.name, "sensors": sensors})


def run_slowly(suite, out):
    run_cases(suite, out, sensors="angle", workers=2, diagnose=slow_stand_in)
