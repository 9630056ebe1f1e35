"""A sealed suite of four cases by hand: logs of a few seconds, a deviation that is known, a healthy day."""

from pathlib import Path

import numpy as np

from aoro_gym.diagnosis_benchmark.cases import MACHINES
from aoro_gym.diagnosis_benchmark.sealing import digests, exact_folder
from aoro_gym.execution.files import write_json
from aoro_gym.simulation.log import write_log

NOISE = 1e-3
"""Standard deviation [rad] of the angle's noise, white."""
SAMPLES, RESTING = 301, 70
MANOEUVRES = ("left_100", "steps")


def turn(sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Signal and angle [rad] of a turn, each (SAMPLES,)."""
    signal = np.zeros(SAMPLES)
    signal[RESTING:200] = 0.8 * sign
    return signal, 5e-3 * np.cumsum(np.r_[0.0, signal[:-1]])


def deviation(size: float) -> np.ndarray:
    """A bump [rad] of this height (SAMPLES,), after the rest."""
    bump = np.zeros(SAMPLES)
    bump[100:200] = size * np.sin(np.linspace(0.0, np.pi, 100))
    return bump


def write_case(place: Path, exact: Path, size: float, *, day: float = 0.0, healthy: bool = True, seed: int = 0) -> None:
    """A case whose deviation has the height ``size``, on a day that adds a bump of the height ``day``."""
    rng = np.random.default_rng(seed)
    arrays = {}
    place.mkdir(parents=True)
    (place / "machine.toml").write_bytes((MACHINES / "aoro.toml").read_bytes())
    for name, sign in zip(MANOEUVRES, (1.0, -1.0), strict=True):
        signal, angle = turn(sign)
        time = 0.01 * np.arange(SAMPLES)
        without, with_ = angle + deviation(day), angle + deviation(day) + deviation(size)
        arrays |= {f"{name}/joint_angle/with": with_, f"{name}/joint_angle/without": without}
        for purpose, shown in (("logs", with_), ("healthy", angle)):
            if purpose == "logs" or healthy:
                noisy = shown + NOISE * rng.standard_normal(SAMPLES)
                table = {"time_s": time, "steering_signal": signal, "joint_angle_rad": noisy}
                write_log(place / purpose / f"{name}.csv", table)
    if size:
        exact.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(exact, **arrays)


def effect(component: str = "valve", unit: str = "s", magnitude: tuple[float, ...] = (0.02,)) -> dict:
    """An effect as it stands in the answers."""
    return {
        "component": component, "quantity": "q", "unit": unit, "magnitude": list(magnitude),
        "without": [0.0] * len(magnitude), "severity": 0.5,
    }  # fmt: skip


ABOUT = {"suite": "quick", "mode": "commissioned", "sensors": "angle", "family": "score", "blind": True}


def write_suite(folder: Path) -> Path:
    """Null, a strong spool lag, a spool lag that cannot be seen, and one outside the catalogue; returns the answers."""
    answers = folder / "check.answers.json"
    truths = [("null", {}, 0.0), ("single", {"spool_lag": effect()}, 0.1), ("single", {"spool_lag": effect()}, 1e-5)]
    truths.append(("outside", {"x_air_pocket": effect("oil_and_hoses", "m^3", (1e-4,))}, 0.1))
    cases = {}
    for number, (kind, effects, size) in enumerate(truths, start=1):
        name = f"{number:03d}"
        write_case(folder / "check" / "cases" / name, exact_folder(answers) / f"{name}.npz", size, seed=number)
        cases[name] = {"kind": kind, "level": number % 2, "effects": effects, "logs": list(MANOEUVRES)}
    write_json(answers, {**ABOUT, "cases": cases})
    write_json(folder / "check" / "seal.json", {**ABOUT, "sha256": digests(folder / "check", answers)})
    return answers
