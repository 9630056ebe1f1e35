"""Deviations that the catalogue lacks, of many kinds, so that a diagnosis learns what "none of these" looks like.

Three places: the machine's parameters (:data:`MACHINE`, :data:`DRAWN`), what its valve really gets of the command
(:data:`COMMAND`), and the sampled signals (:data:`SIGNAL`, applied where noise is drawn, by number). Sizes are estimates:
from what could just be seen to what nobody would miss. Kinds that somebody thought of are few beside those that machines
have, so some are broad (:data:`BROAD`): any parameters, another machine, any mix of the signals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.simulation.manoeuvres import REST, TICK

Floats = NDArray[np.float64]

MACHINE: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "weak_shock_valves": {"steering.valve.shock_pressure": (0.25, 0.7)},
    "one_sided_left_flow": {"steering.valve.nominal_flow_left": (0.6, 0.9)},
    "one_sided_right_flow": {"steering.valve.nominal_flow_right": (0.6, 0.9)},
    "narrow_return_edge_left": {"steering.valve.nominal_drop_out_left": (3.0, 30.0)},
    "narrow_return_edge_right": {"steering.valve.nominal_drop_out_right": (3.0, 30.0)},
    "stiff_suction_valves": {"steering.valve.anticavitation_flow": (0.02, 0.3)},
    "low_margin": {"steering.pump.margin": (0.3, 0.65)},
    "high_margin": {"steering.pump.margin": (1.4, 2.5)},
    "leaking_load_sensing_line": {"steering.pump.bleed_flow": (4.0, 20.0)},
    "accumulator_in_pump_line": {"steering.pump.line_volume": (3.0, 12.0)},
    "low_relief": {"steering.pump.relief_pressure": (0.25, 0.6)},
    "turned_front": {"frame.front.inertia_zz": (1.4, 3.0)},
    "slippery_ground": {"tire.friction_coulomb": (0.15, 0.5), "tire.friction_static": (0.15, 0.5)},
    "small_wheels": {"tire.radius": (0.93, 0.98)},
    "early_stop": {"joint.range": (0.85, 0.97)},
    "weak_engine": {
        f"engine.torque.rpm_{speed}": (0.1, 0.5) for speed in (900, 1200, 1400, 1600, 1800, 2000, 2200, 2400)
    },
}  # fmt: skip
"""Factors on parameters by kind, one draw for all keys of a kind; none does what a form of an effect does."""
DRAWN = ("any_parameters", "another_machine")
"""Kinds whose parameters are drawn: a few of :data:`FREE` ones far from where they were, or all of another machine."""
FREE = ("steering.", "joint.", "tire.", "frame.", "oil.")
"""Beginnings of the parameters of ``any_parameters`` that no effect of the catalogue moves."""
MOST_FREE = 3
"""Of them that move at once."""
FREE_FACTOR = (1.4, 6.0)
"""By which each is more, or less (E)."""


def _held(command: Floats, rng: np.random.Generator) -> Floats:
    """A bus that passes on every k-th value only."""
    every = int(rng.integers(8, 26))
    return command[(np.arange(len(command)) // every) * every]


def _dropped(command: Floats, rng: np.random.Generator) -> Floats:
    """A loose contact: the command is zero now and then."""
    out = command.copy()
    for begin in rng.integers(round(REST / TICK), len(command), size=int(rng.integers(3, 9))):
        out[begin : begin + int(rng.integers(4, 16))] = 0.0
    return out


def _sagging(command: Floats, rng: np.random.Generator) -> Floats:
    """A supply that gives way while the valve is driven."""
    load = np.cumsum(np.abs(command)) * TICK
    return command * np.exp(-load / rng.uniform(0.8, 5.0) * rng.uniform(0.3, 1.0))


def _biased(command: Floats, rng: np.random.Generator) -> Floats:
    """A joystick off its centre."""
    return np.clip(command + rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.3), -1.0, 1.0)


def _one_sided(command: Floats, rng: np.random.Generator) -> Floats:
    """One coil weaker than the other."""
    side = rng.choice([-1.0, 1.0])
    return np.where(command * side > 0.0, command * rng.uniform(0.6, 0.9), command)


def _dithered(command: Floats, rng: np.random.Generator) -> Floats:
    """An oscillation of the valve's current while it is driven."""
    time = TICK * np.arange(len(command))
    wave = rng.uniform(0.08, 0.3) * np.sin(2.0 * np.pi * rng.uniform(2.0, 9.0) * time + rng.uniform(0.0, 6.3))
    return np.clip(command * (1.0 + wave), -1.0, 1.0)


def _limited(command: Floats, rng: np.random.Generator) -> Floats:
    """A stop that keeps the spool from opening wholly."""
    return np.clip(command, -1.0, 1.0) * np.minimum(1.0, rng.uniform(0.55, 0.85) / np.maximum(np.abs(command), 1e-6))


def _sticking(command: Floats, rng: np.random.Generator) -> Floats:
    """A spool that sticks for a time each time its command changes much, then jumps."""
    out, last = command.copy(), command[0]
    wait = int(rng.integers(6, 20))
    for begin in np.flatnonzero(np.abs(np.diff(command)) > 0.1) + 1:
        out[begin : begin + wait] = last
        last = command[min(begin + wait, len(command) - 1)]
    return out


def _closing_late(command: Floats, rng: np.random.Generator) -> Floats:
    """A valve that opens at once and closes slowly."""
    out, rate = command.copy(), TICK / rng.uniform(0.08, 0.5)
    for i in range(1, len(out)):
        if abs(out[i]) < abs(out[i - 1]):
            out[i] = np.sign(out[i - 1]) * max(abs(out[i - 1]) - rate, abs(command[i]))
    return out


def _bent(command: Floats, rng: np.random.Generator) -> Floats:
    """A joystick or an amplifier of another curve."""
    power = np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(np.log(1.2), np.log(2.5)))
    return np.sign(command) * np.abs(command) ** power


def _coarse(command: Floats, rng: np.random.Generator) -> Floats:
    """An amplifier with a few steps."""
    step = rng.uniform(0.12, 0.4)
    return np.clip(np.round(command / step) * step, -1.0, 1.0)


def _ringing(command: Floats, rng: np.random.Generator) -> Floats:
    """A current controller that overshoots: of second order, hardly damped."""
    natural, damping = 2.0 * np.pi * rng.uniform(0.8, 5.0), rng.uniform(0.05, 0.5)
    out, value, rate = np.empty_like(command), command[0], 0.0
    for i, wanted in enumerate(command):
        for _ in range(RINGING_STEPS):
            rate += TICK / RINGING_STEPS * natural * (natural * (wanted - value) - 2.0 * damping * rate)
            value += TICK / RINGING_STEPS * rate
        out[i] = value
    return np.clip(out, -1.0, 1.0)


RINGING_STEPS = 4
"""Integration steps a tick."""

COMMAND: Mapping[str, Callable[[Floats, np.random.Generator], Floats]] = {
    "held_command": _held, "dropped_command": _dropped, "sagging_supply": _sagging, "biased_command": _biased,
    "weak_coil": _one_sided, "dithered_valve": _dithered, "limited_spool": _limited, "sticking_spool": _sticking,
    "closing_late": _closing_late, "bent_command": _bent, "coarse_command": _coarse, "ringing_command": _ringing,
}  # fmt: skip
"""What the valve gets of a command (K,) that was logged, by kind."""

SIGNAL: tuple[str, ...] = (
    "drifting_angle", "spiking_angle", "wobbling_angle", "dropped_samples", "stretched_clock", "coarse_angle",
    "pressure_gain", "drifting_pressure", "slow_pressure", "cross_talk", "resonant_pressure", "clipped_pressure",
    "kinked_angle", "humming_pressure", "mixed_signals", "bent_signal", "filtered_signal", "wandering_signal",
    "warped_time", "late_pressure", "swapped_ports",
)  # fmt: skip
"""Deviations of sampled signals; :mod:`aoro_gym.diagnosis.network.sensing` has their equations."""

ALL: tuple[str, ...] = (*MACHINE, *DRAWN, *COMMAND, *SIGNAL)
"""Every kind, in the order of their numbers."""
BROAD: Mapping[str, float] = {
    "any_parameters": 10.0, "another_machine": 3.0, "bent_command": 2.0, "ringing_command": 2.0, "mixed_signals": 8.0,
    "bent_signal": 3.0, "filtered_signal": 3.0, "wandering_signal": 3.0,
}  # fmt: skip
"""How often broad kinds are drawn beside the others, which weigh 1."""
SHARES: Floats = np.array([BROAD.get(name, 1.0) for name in ALL]) / sum(BROAD.get(name, 1.0) for name in ALL)
"""Probabilities of all kinds."""
