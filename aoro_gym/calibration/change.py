"""What a change of parameters does to full turns and to a straight drive, with the turn time restored if asked for.

The publication argues so: a parameter is changed, the pressure drop of the valve's edges is found anew until a full turn at
full signal takes the time that it took, and what differs then is what the parameter does beside the time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.procedure import SIDES, motor_pressure, solve, turn_time
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import measured_flow, sample
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch, turn_span
from aoro_gym.units import LITRE_PER_MINUTE
from aoro_gym.validation.published import published
from aoro_gym.validation.turns import TURNS, Turn, run_turns, stacked

BEFORE, AFTER = 0.3, 0.15
"""Time [s] of a curve before the turn begins and after the slower machine has ended it."""


@dataclass(frozen=True, eq=False)
class ChangedTurn:
    """One turn of the machine as it was and of the changed one."""

    turn: Turn
    figures: tuple[dict[str, float | None], dict[str, float | None]]
    """Key figures of both through the published measuring chain; None where there is none."""
    time: NDArray[np.float64]
    """Time [s] since the joint has moved (F,), 100 samples a second."""
    flow: NDArray[np.float64]
    """Joint flow of both [L/min] (2, F)."""

    def percent(self, name: str) -> float | None:
        """Change of a figure [%]."""
        before, after = (figures[name] for figures in self.figures)
        return None if before is None or after is None else 100.0 * (after / before - 1.0)


@dataclass(frozen=True, eq=False)
class Change:
    """What :func:`study_change` found."""

    machines: tuple[Machine, Machine]
    """As it was, and changed."""
    changed: dict[str, tuple[float, float]]
    """Values of all parameters that differ, in the units of the machine file."""
    recalibrated: tuple[str, ...]
    """Those of them that were found anew so that the turn time stays."""
    turns: tuple[ChangedTurn, ...]
    """Of :data:`~aoro_gym.validation.turns.TURNS`."""
    motor_pressure: tuple[float, float]
    """Pressure difference [bar] over the wheel motors at the published speed on level ground."""

    def to_json(self) -> dict[str, Any]:
        """Everything but the curves."""
        turns = [
            {"direction": one.turn.direction, "signal_percent": one.turn.signal_percent}
            | {"before": one.figures[0], "after": one.figures[1]}
            | {"percent": {name: one.percent(name) for name in FIGURES}}
            for one in self.turns
        ]
        before, after = self.motor_pressure
        return {
            "machine": self.machines[0].name,
            "changed": {key: {"before": a, "after": b} for key, (a, b) in self.changed.items()},
            "recalibrated": list(self.recalibrated),
            "turns": turns,
            "drive_speed_m_per_s": published("drive_speed"),
            "motor_pressure_bar": {"before": before, "after": after, "percent": 100.0 * (after / before - 1.0)},
        }


def study_change(
    machine: Machine,
    changed: Machine,
    *,
    recalibrate: bool = False,
    device: str = "cpu",
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> Change:
    """Full turns to both sides at 100, 75 and 50 % signal and a straight drive, before and after a change.

    Args:
        machine: The machine as it was.
        changed: The same with other parameters.
        recalibrate: Find the pressure drop of the changed machine's supply edges anew, each side's within its range, so that
            full turns at full signal take the time that they took.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        progress: Called with what is being done and the share that is.

    Raises:
        ValueError: no pressure drop within its range restores the time.
    """
    restored = {side: f"steering.valve.nominal_drop_in_{side}" for side in (SIDES if recalibrate else ())}
    for number, (side, key) in enumerate(restored.items()):
        progress(f"turn time to the {side}", 0.3 * number)
        measure = turn_time(side, device)
        changed = solve(changed, key, float(measure(machine)[0]), measure)
    progress("full turns", 0.6)
    turns = _turns(machine, changed, device)
    progress("straight drives", 0.8)
    pressures = [float(motor_pressure(one, device)[0]) for one in (machine, changed)]
    values = {
        key: (float(machine.entries[key].value), float(entry.value))
        for key, entry in changed.entries.items()
        if entry.value != machine.entries[key].value
    }
    return Change((machine, changed), values, tuple(restored.values()), turns, (pressures[0], pressures[1]))


def _turns(machine: Machine, changed: Machine, device: str) -> tuple[ChangedTurn, ...]:
    """Both machines' turns; each curve counts from where its own turn begins."""
    recording = run_turns(stacked([machine, changed]), TURNS, device=device)
    ticks, angle = sample(recording.time, recording.angle.reshape(len(recording.time), -1))
    figures = key_figures_batch(ticks, angle, recording.machine)
    cylinder = recording.machine.steering.cylinder
    sign = np.repeat([turn.sign for turn in TURNS], 2)
    flow = measured_flow(cylinder, angle, sign) / LITRE_PER_MINUTE
    began = turn_span(ticks, angle, cylinder.half_range).began
    out = []
    for number, turn in enumerate(TURNS):
        pair = (2 * number, 2 * number + 1)
        slowest = np.nanmax(np.nan_to_num(figures["turn_time_s"][list(pair)]))
        time = np.arange(-BEFORE, (slowest or ticks[-1]) + AFTER, ticks[1] - ticks[0])
        out.append(ChangedTurn(
            turn,
            ({name: _number(figures[name][pair[0]]) for name in FIGURES},
             {name: _number(figures[name][pair[1]]) for name in FIGURES}),
            time,
            np.array([np.interp(time, ticks - began[one], flow[:, one]) for one in pair]),
        ))  # fmt: skip
    return tuple(out)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
