"""Deviations outside of the catalogue of effects, by neutral names, so that nobody trains on a name.

Each takes a size from 0 (weak) to 1 (strong) and a random generator for when and where it happens.
"""

from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from aoro_gym.diagnosis_benchmark.independent.outside import Columns, Outside, Rng, between
from aoro_gym.units import BAR, LITRE_PER_MINUTE

from .measuring import GRID


def _frozen(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    made = command.copy()
    edges = np.flatnonzero(np.diff(command))
    for edge in edges:
        made[edge + 1 : edge + 1 + int(between(25, 250, size) * rng.uniform(0.6, 1.4))] = made[edge]
    return made


def _ringing(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    w, damping = 2 * np.pi * rng.uniform(4.0, 9.0), between(0.6, 0.06, size)
    pole = np.exp((-damping + 1j * np.sqrt(1 - damping**2)) * w * GRID)
    below = np.real(np.poly([pole, np.conj(pole)]))
    return np.clip(lfilter([below.sum()], below, command), -1.0, 1.0)


def _fading(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    pole = np.exp(-GRID / (between(8.0, 0.9, size) * rng.uniform(0.9, 1.1)))
    return np.clip(lfilter([1.0, -1.0], [1.0, -pole], command), -1.0, 1.0)


def _trembling(command: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    times = np.arange(len(command)) * GRID
    wave = np.sin(2 * np.pi * rng.uniform(2.5, 7.0) * times + rng.uniform(0.0, 2 * np.pi))
    return np.clip(command + between(0.02, 0.2, size) * wave * (command != 0.0), -1.0, 1.0)


def _repeated(columns: Columns, size: float, rng: Rng) -> Columns:
    every = round(between(4.0, 16.0, size))
    place = np.arange(len(columns["joint_angle"])) // every * every
    return {name: one[place] for name, one in columns.items()}


def _exchanged(columns: Columns, size: float, rng: Rng) -> Columns:
    share = between(0.15, 1.0, size)
    start = int(rng.uniform(0.1, 0.4) * len(columns["joint_angle"]))
    made = {name: one.copy() for name, one in columns.items()}
    for one, other in (("pressure_a", "pressure_b"), ("pressure_b", "pressure_a")):
        made[one][start:] += share * (columns[other][start:] - columns[one][start:])
    return made


def _loose(columns: Columns, size: float, rng: Rng) -> Columns:
    width = between(0.004, 0.06, size)
    angle = columns["joint_angle"]
    made, place = np.empty_like(angle), angle[0]
    for k, value in enumerate(angle):
        place = min(max(place, value - width), value + width)
        made[k] = place
    return columns | {"joint_angle": made}


def _clogged(columns: Columns, size: float, rng: Rng) -> Columns:
    name = str(rng.choice(["pressure_a", "pressure_b"]))
    rate = between(2.2e5, 7e3, size)
    values = columns[name]
    made, place = np.empty_like(values), values[0]
    for k, value in enumerate(values):
        drop = value - place
        place += np.sign(drop) * min(abs(drop), rate * 0.01 * np.sqrt(abs(drop)))
        made[k] = place
    return columns | {name: made}


def _stumbling(times: np.ndarray, size: float, rng: Rng) -> np.ndarray:
    late = np.maximum(rng.standard_normal(len(times)), 0.0) * between(0.004, 0.05, size)
    return np.maximum(times - late, 0.0)


def _saturated(columns: Columns, size: float, rng: Rng) -> Columns:
    top = between(0.66, 0.2, size)
    return columns | {"joint_angle": top * np.tanh(columns["joint_angle"] / top)}


def _coupled(columns: Columns, size: float, rng: Rng) -> Columns:
    speed = columns["engine_speed"] - columns["engine_speed"][0]
    pump = columns["pump_pressure"] - columns["pump_pressure"][0]
    slope = rng.choice((-1, 1)) * between(2e-5, 4e-4, size)
    share = between(0.02, 0.3, size)
    return columns | {
        "joint_angle": columns["joint_angle"] + slope * pump / BAR + 1e-3 * speed,
        "pressure_a": columns["pressure_a"] + share * pump,
    }


def _window(rng: Rng, length: float, name: str, least: float, most: float) -> dict[str, float]:
    last = 0.3 + 0.3 * min(length, 4.0)
    return {f"{name}_start": rng.uniform(0.3, last), f"{name}_length": rng.uniform(least, most)}


COMMANDS = {
    "kind_01": Outside("the command stands still for a while after every change", familiar=True, command=_frozen),
    "kind_02": Outside("the driver of the valve rings", familiar=True, command=_ringing),
    "kind_03": Outside("a capacitor lies in the command's line: the command fades", command=_fading),
    "kind_04": Outside("a tremor of a few hertz on the command while it acts", familiar=True, command=_trembling),
}
LOGGERS = {
    "kind_05": Outside("the logger repeats its samples: it is slower than it says", familiar=True, columns=_repeated),
    "kind_06": Outside("the channels of both ports mix from a moment on", columns=_exchanged),
    "kind_07": Outside("the joint sensor's coupling has play", familiar=True, columns=_loose),
    "kind_08": Outside("the bore to a pressure sensor is clogged", familiar=True, columns=_clogged),
    "kind_09": Outside("samples are older than their times by random spans", familiar=True, clock=_stumbling),
    "kind_10": Outside("the joint sensor's amplifier saturates softly", columns=_saturated),
    "kind_11": Outside("a ground loop: the pump's load shifts angle and a pressure", columns=_coupled),
}
MACHINES = {
    "kind_12": Outside(
        "a bundle of hoses bends round the joint like a spring",
        machine=lambda size, rng, length: {
            "bent_stiffness": between(1.5e3, 2e4, size), "bent_angle": rng.uniform(-0.6, 0.6),
        },
    ),
    "kind_13": Outside(
        "a log is jammed between the frames near one end",
        machine=lambda size, rng, length: {
            "jam_side": float(rng.choice((-1, 1))), "jam_angle": rng.uniform(-0.1, 0.35),
            "jam_stiffness": between(1e4, 2e5, size),
        },
    ),
    "kind_14": Outside(
        "something pushes the frames from aside for a moment", familiar=True,
        machine=lambda size, rng, length: {
            "push_torque": float(rng.choice((-1, 1))) * between(2e3, 2e4, size),
            **_window(rng, length, "push", 0.1, 0.5),
        },
    ),
    "kind_15": Outside(
        "the boom slews during the log",
        machine=lambda size, rng, length: {
            "slew_torque": float(rng.choice((-1, 1))) * between(2e3, 2e4, size),
            **_window(rng, length, "slew", 0.2, 0.6),
        },
    ),
    "kind_16": Outside(
        "another consumer draws on the pump for a while", familiar=True,
        machine=lambda size, rng, length: {
            "other_conductance": between(60, 300, size) * LITRE_PER_MINUTE / np.sqrt(80 * BAR),
            **_window(rng, length, "other", 0.3, 1.2),
        },
    ),
    "kind_17": Outside(
        "somebody has left an accumulator on the line to port A",
        machine=lambda size, rng, length: {
            "accumulator_volume": between(3e-5, 8e-4, size), "accumulator_precharge": rng.uniform(5, 30) * BAR,
        },
    ),
    "kind_18": Outside(
        "the joint pinches the hose to port A where it passes an angle",
        machine=lambda size, rng, length: {
            "pinch_resistance": between(1.5e9, 3e10, size), "pinch_angle": rng.uniform(-0.4, 0.4),
        },
    ),
    "kind_19": Outside(
        "a piston of the pump is dead: one dent a revolution", familiar=True,
        machine=lambda size, rng, length: {"dead_piston": between(0.25, 1.0, size)},
    ),
    "kind_20": Outside(
        "a rag hangs in the return passage of one spool side",
        machine=lambda size, rng, length: {"half_block": 1.0 - between(0.6, 0.12, size)},
    ),
}  # fmt: skip
GROUNDS = {
    "kind_21": Outside(
        "the machine stands on three legs: a diagonal carries it",
        machine=lambda size, rng, length: {"load_skew": float(rng.choice((-1, 1))) * between(0.25, 0.93, size)},
    ),
    "kind_22": Outside(
        "an axle's motors are cut off and free-wheel",
        machine=lambda size, rng, length: {"free_axle": between(0.3, 1.0, size)},
    ),
    "kind_23": Outside(
        "a crust under the wheels breaks during the turn",
        machine=lambda size, rng, length: {
            "crust_loss": between(0.2, 0.9, size), "crust_start": rng.uniform(0.4, 0.3 + 0.3 * min(length, 4.0)),
        },
    ),
}  # fmt: skip
OUTSIDE: Mapping[str, Outside] = {**COMMANDS, **LOGGERS, **MACHINES, **GROUNDS}
"""All deviations outside of the catalogue by name."""
FAMILIAR = frozenset(name for name, one in OUTSIDE.items() if one.familiar)
"""Those whose like anybody may train on."""
