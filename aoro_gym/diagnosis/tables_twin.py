"""Key figures that twins have in the turns of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aoro_gym.calibration.turns import PATIENCE, longest
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import USUAL, Replay, Simulator, Variants
from aoro_gym.diagnosis.tables import Row
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import STANDSTILL
from aoro_gym.simulation.key_figures import key_figures_batch
from aoro_gym.units import LITRE_PER_MINUTE
from aoro_gym.validation.turns import REST_AFTER, REST_BEFORE

SAME_OIL = 0.1
"""Share by which turn time times mean flow may miss the oil of a full turn, until units must be wrong."""
FULL = 0.9
"""Share of the way from stop to stop that a turn must make to have figures."""


def oil_of_turn(machine: Machine) -> float:
    """Oil [m³] of a full turn."""
    cylinder = machine.steering.cylinder
    return float(np.asarray((cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke))


def turn_time(row: Row, machine: Machine) -> float | None:
    """Time [s] of a row's turn, from its mean flow where that is all that is known; None where neither is.

    Raises:
        ValueError: the two contradict each other.
    """
    lasts, flow = row.figures.get("turn_time_s"), row.figures.get("mean_flow_L_per_min")
    if flow is None:
        return lasts
    oil = oil_of_turn(machine)
    by_flow = oil / (flow * LITRE_PER_MINUTE)
    if lasts is not None and abs(lasts / by_flow - 1.0) > SAME_OIL:
        raise ValueError(
            f"{row.title}: {flow:g} L/min for {lasts:g} s are {1e3 * oil * lasts / by_flow:.3g} L, but a full turn "
            f"takes {1e3 * oil:.3g} L; check the units of turn_time_s and mean_flow_L_per_min"
        )
    return lasts or by_flow


class TwinTurns:
    """Twins that make the turns of ``rows``, and their figures.

    Args:
        rows: Whose turns they are.
        machine: The twin, whose geometry turns angles into flows.
        simulator: Runs the twins.
    """

    def __init__(self, rows: Sequence[Row], machine: Machine, simulator: Simulator):
        self.rows = tuple(rows)
        self.machine = machine
        self.simulator = simulator
        self._turns = [_turn(row, machine) for row in rows]
        reach = float(np.asarray(machine.joint.range))
        angles = self._angles([[Variants(machine)]] * len(self.rows))
        rest = [_rests(angle)[0] for angle in angles]
        self._give = [row.turn.sign * angle - reach for row, angle in zip(rows, rest, strict=True)]
        """Angle [rad] by which every turn comes to rest beyond its stop, which gives."""
        self.given = [self._figures(k, angle) for k, angle in enumerate(angles)]
        """Figures (1,) of each row by the given twin; see :meth:`figures`."""

    def figures(self, variants: Sequence[Sequence[Variants]]) -> list[Mapping[str, Floats]]:
        """Figures (N,) of each row's own ``variants``, together N, by name; NaN where there is none. No turn is told by its
        stop: it ends where the angle comes to rest, less what the given twin's stop gives."""
        return [self._figures(k, angle) for k, angle in enumerate(self._angles(variants))]

    def _angles(self, variants: Sequence[Sequence[Variants]]) -> list[Floats]:
        """Joint angles (F, N) [rad] by row, as the measuring chain shows them."""
        tasks = [Replay(one, turn, USUAL) for turn, own in zip(self._turns, variants, strict=True) for one in own]
        found = iter(self.simulator.run(tasks))
        return [
            np.concatenate([next(found)["joint_angle"] for _ in own], axis=1).astype(np.float64) for own in variants
        ]

    def _figures(self, row: int, angle: Floats) -> Mapping[str, Floats]:
        sign = self.rows[row].turn.sign
        with np.errstate(invalid="ignore"):
            complete = sign * (angle[-1] - angle[0]) > 2.0 * FULL * float(np.asarray(self.machine.joint.range))
        stop = _rests(angle) - sign * self._give[row]
        shown = key_figures_batch(TICK * np.arange(len(angle)), angle, self.machine, stop=stop, interpolate=True)
        return {name: np.where(complete, values, np.nan) for name, values in shown.items()}


def _turn(row: Row, machine: Machine) -> Recording:
    """The turn's commands, from beyond the stop, so that every machine starts at its own; its angle is not known."""
    driven = max(longest(row.turn), PATIENCE * (turn_time(row, machine) or 0.0))
    commands = np.zeros((round((REST_BEFORE + driven + REST_AFTER) / TICK), 2))
    rest = round(REST_BEFORE / TICK)
    commands[rest:, 0] = row.turn.sign * row.turn.signal_percent / 100.0
    beyond_the_stop = -2.0 * row.turn.sign * float(np.asarray(machine.joint.range))
    return Recording(row.title, commands, {"joint_angle": np.zeros(len(commands) + 1)}, rest, beyond_the_stop)


def _rests(angle: Floats) -> Floats:
    """Angle (N,) [rad] at which turns (F, N) come to rest."""
    return np.mean(angle[-round(STANDSTILL / TICK) :], axis=0)
