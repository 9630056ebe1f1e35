"""Deviations that are in no catalogue of effects: of the supply, the command, the machine, the ground and the logger.

Each takes a size from 0 (weak) to 1 (strong) and a random generator for when and where it happens.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from aoro_gym.units import BAR, LITRE_PER_MINUTE

Columns = dict[str, np.ndarray]
Rng = np.random.Generator
MILLI = 1e-3


@dataclass(frozen=True)
class Outside:
    """A deviation outside of the catalogue: which of a run's parts it changes.

    Args:
        what: One line.
        machine: Constants by size, generator, and length of the log [s].
        command: Command on a grid of 1 ms, as it leaves the controller.
        clock: Sampling times.
        columns: Logged columns.
        familiar: Whether its like is what anybody may think of, and train on.
    """

    what: str
    machine: Callable[[float, Rng, float], Mapping[str, float]] | None = None
    command: Callable[[np.ndarray, float, Rng], np.ndarray] | None = None
    clock: Callable[[np.ndarray, float, Rng], np.ndarray] | None = None
    columns: Callable[[Columns, float, Rng], Columns] | None = None
    familiar: bool = False


def between(low: float, high: float, size: float) -> float:
    """Geometric way from ``low`` (size 0) to ``high`` (size 1)."""
    return low * (high / low) ** size


def _moment(count: int, rng: Rng) -> int:
    """Sample in the middle half of a log."""
    return int(count * rng.uniform(0.25, 0.7))


def _sag(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    sagged = command.copy()
    start = _moment(len(command), rng)
    sagged[start : start + int(rng.uniform(300, 900))] *= 1.0 - between(0.06, 0.5, size)
    return sagged


def _coarse(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    step = between(0.045, 0.27, size) * rng.uniform(0.95, 1.05)
    return np.trunc(command / step) * step


def _jitter(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    late = np.zeros(len(command), int)
    for frame in range(0, len(command), 10):
        late[frame : frame + 10] = int(rng.exponential(between(4.0, 60.0, size)))
    return command[np.maximum(np.arange(len(command)) - late, 0)]


def _contact(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    broken = command.copy()
    for _ in range(2 + int(6 * size)):
        start = int(rng.uniform(0.15, 0.9) * len(command))
        broken[start : start + int(rng.uniform(0.5, 1.5) * between(12.0, 80.0, size))] = 0.0
    return broken


def _drift(times: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    return times * (1.0 + rng.choice((-1, 1)) * between(0.004, 0.04, size))


def _dropout(columns: Columns, size: float, rng: Rng) -> Columns:
    angle = columns["joint_angle"].copy()
    for _ in range(2 + int(5 * size)):
        start = int(rng.uniform(0.1, 0.9) * len(angle))
        angle[start : start + 2 + int(rng.uniform(0.5, 1.5) * between(2.0, 25.0, size))] = angle[start]
    return columns | {"joint_angle": angle}


def _spikes(columns: Columns, size: float, rng: Rng) -> Columns:
    made = dict(columns)
    for name, scale in (("joint_angle", 0.02), ("pressure_a", 10 * BAR), ("pressure_b", 10 * BAR)):
        hit = rng.random(len(made[name])) < between(0.004, 0.04, size)
        made[name] = made[name] + hit * rng.standard_normal(len(hit)) * scale * between(0.5, 4.0, size)
    return made


def _pressure_drift(columns: Columns, size: float, rng: Rng) -> Columns:
    name = rng.choice(["pressure_a", "pressure_b"])
    ramp = np.linspace(0.0, 1.0, len(columns[name])) * rng.choice((-1, 1)) * between(1.5, 20.0, size) * BAR
    return columns | {str(name): columns[name] + ramp}


def _cross_talk(columns: Columns, size: float, rng: Rng) -> Columns:
    angle = columns["joint_angle"] + between(2e-4, 5e-3, size) * (
        columns["pump_pressure"] - columns["pump_pressure"][0]
    ) / (10 * BAR)
    b = columns["pressure_b"] + between(0.02, 0.25, size) * columns["pressure_a"]
    return columns | {"joint_angle": angle, "pressure_b": b}


def _slip(columns: Columns, size: float, rng: Rng) -> Columns:
    angle = columns["joint_angle"].copy()
    angle[_moment(len(angle), rng) :] += rng.choice((-1, 1)) * between(0.005, 0.08, size)
    return columns | {"joint_angle": angle}


def _stuck_bit(columns: Columns, size: float, rng: Rng) -> Columns:
    step = between(0.004, 0.05, size)
    return columns | {"joint_angle": columns["joint_angle"] - step * (np.floor(columns["joint_angle"] / step) % 2)}


COMMAND = {
    "supply_sag": Outside("the valve's supply voltage sags for a part of the log", command=_sag, familiar=True),
    "coarse_command": Outside("the command is quantised coarsely on its way", command=_coarse, familiar=True),
    "bus_jitter": Outside("frames of the command's bus come late by random times", command=_jitter, familiar=True),
    "broken_contact": Outside("a contact of the solenoid opens for moments", command=_contact, familiar=True),
}

LOGGER = {
    "clock_drift": Outside("the logger's clock runs fast or slow", clock=_drift, familiar=True),
    "dropouts": Outside("the joint angle freezes for moments", columns=_dropout, familiar=True),
    "spikes": Outside("spikes on joint angle and pressures", columns=_spikes, familiar=True),
    "pressure_drift": Outside("a pressure sensor drifts during the log", columns=_pressure_drift, familiar=True),
    "cross_talk": Outside("pressures leak into the joint angle's and each other's channels", columns=_cross_talk),
    "angle_slip": Outside("the joint sensor slips on its shaft once", columns=_slip),
    "stuck_bit": Outside("a bit of the joint angle's converter is stuck at nought", columns=_stuck_bit),
}

MACHINE = {
    "pump_resonance": Outside(
        "the pump on its soft mount resonates: its flow swings",
        lambda size, rng, length: {"ripple": between(0.08, 0.6, size), "ripple_frequency": rng.uniform(14.0, 28.0)},
    ),
    "stuck_shock_valve": Outside(
        "the shock valve of port A stays open from a moment on",
        lambda size, rng, length: {
            "shock_leak": between(3.0, 40.0, size) * LITRE_PER_MINUTE / (50 * BAR) ** 0.5,
            "shock_start": rng.uniform(0.2, 0.9),
        },
        familiar=True,
    ),
    "detached_cylinder": Outside(
        "a pin has fallen out: one cylinder stands still (no sizes)",
        lambda size, rng, length: {str(rng.choice(["attached_left", "attached_right"])): 0.0},
    ),
    "wandering_air": Outside(
        "a pocket of air wanders from one side to the other during the turn",
        lambda size, rng, length: {
            "pocket_volume": between(10.0, 400.0, size) * MILLI * MILLI,
            "pocket_angle": rng.uniform(-0.25, 0.25),
        },
    ),
    "aeration_burst": Outside(
        "foam from the tank passes for half a second",
        lambda size, rng, length: {
            "burst_air": between(0.02, 0.25, size),
            "burst_start": rng.uniform(0.2, 0.9),
            "burst_duration": 0.5,
        },
    ),
    "bent_rod": Outside(
        "a bent rod rubs where it passes the gland",
        lambda size, rng, length: {"bend_force": between(3e3, 4e4, size), "bend_angle": rng.uniform(-0.3, 0.3)},
    ),
    "sticking_sense_check": Outside(
        "the load-sensing line's check valve sticks: its pressure falls slowly",
        lambda size, rng, length: {"sense_fall": between(8.0, 150.0, size)},
        familiar=True,
    ),
    "heating": Outside(
        "hot oil arrives: viscosity falls during the log",
        lambda size, rng, length: {"heating": between(0.1, 0.8, size)},
    ),
    "hunting_governor": Outside(
        "the engine's governor hunts",
        lambda size, rng, length: {"hunting": between(0.03, 0.2, size), "hunting_frequency": rng.uniform(0.7, 1.6)},
    ),
}

GROUND = {
    "blocked_wheel": Outside(
        "a stone blocks a front wheel", lambda size, rng, length: {"stone_torque": between(3e3, 1.5e4, size)}
    ),
    "ice": Outside(
        "one front wheel stands on ice", lambda size, rng, length: {"grip": between(0.6, 0.04, size)}, familiar=True
    ),
    "swinging_load": Outside(
        "a load swings under the crane",
        lambda size, rng, length: {
            "swing_torque": between(600.0, 8e3, size),
            "swing_frequency": rng.uniform(0.4, 1.1),
            "swing_phase": rng.uniform(0.0, 6.28),
        },
    ),
}

OUTSIDE: Mapping[str, Outside] = {**COMMAND, **LOGGER, **MACHINE, **GROUND}
"""All deviations outside of the catalogue by name."""
FAMILIAR = frozenset(name for name, one in OUTSIDE.items() if one.familiar)
"""Those whose like anybody may train on."""
