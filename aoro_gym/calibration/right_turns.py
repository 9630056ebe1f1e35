"""The right side of the valve: of right turns the publication has the time at full signal and two mean flows.

Left turns do not feel these parameters, and right turns say nothing of the others that left turns do not say better. So the
right side is set once all else is: its most probable values with which the right turns are met.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.fit import Residuals
from aoro_gym.calibration.probable import most_probable_fit
from aoro_gym.calibration.procedure import published_turn_time, solve, turn_time
from aoro_gym.calibration.space import Space
from aoro_gym.calibration.turns import population_figures
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.study import RIGHT_FLOW_TARGET, TURN_TIME_TARGET
from aoro_gym.validation.turns import Turn

TURNS = tuple(Turn("right", percent) for percent in (100.0, 75.0, 50.0))
"""Right turns that something is published of."""

DROP = "steering.valve.nominal_drop_in_right"
"""Pressure drop by which the procedure sets the time of a full turn."""

KEYS = (
    "steering.valve.nominal_flow_right",
    DROP,
    "steering.valve.opening_right_1V5",
    "steering.valve.opening_right_1V0",
)
"""Parameters that right turns set."""

EDGE = "steering.valve.nominal_drop_out_right"
"""Return edge of the right port, which no published figure feels; it is taken to be made like the left one's."""

RIGHT_FIGURES = ("right_turn_time", "right_mean_flow_at_75_percent", "right_mean_flow_at_50_percent")
"""What is published of them, by name in a report."""

SOURCE = "C: most probable with the published right turns"
"""Of what right turns set, in a machine file."""

MOST_STEPS = 8
"""Jacobians of the search: four parameters, and figures that are nearly linear in them."""


def right_residuals(space: Space, device: str = "cpu") -> Residuals:
    """Misses (3, N) of points, in half tolerances: the time at full signal, mean flows at 75 and 50 %."""
    flows = {row["signal_percent"]: row["mean_flow_L_per_min"] for row in published_rows() if _is_right(row)}

    def residuals(points: NDArray[np.float64]) -> NDArray[np.float64]:
        found = population_figures(space.population(points), TURNS, device=device)
        time = (found[0, FIGURES.index("turn_time_s")] - published_turn_time("right")) / TURN_TIME_TARGET
        mean = found[1:, FIGURES.index("mean_flow_L_per_min")]
        known = np.array([flows[turn.signal_percent] for turn in TURNS[1:]], dtype=np.float64)
        return 2.0 * np.vstack([time, (mean / known[:, None] - 1.0) / RIGHT_FLOW_TARGET])

    return residuals


def with_right_turns(
    machine: Machine, prior: Machine, held: set[str], device: str = "cpu"
) -> tuple[Machine, dict[str, float]]:
    """``machine`` with its right side set, and how far it misses each of :data:`RIGHT_FIGURES`, in tolerances.

    Args:
        machine: All else is set.
        prior: Machine whose right side is the most probable one before any turn.
        held: Keys that stay as they are.
        device: Where the twins run.

    Raises:
        ValueError: no pressure drop of the right edge within its range gives the published time.
    """
    out = float(machine.entries["steering.valve.nominal_drop_out_left"].value)
    machine = machine.set({EDGE: out}, source="C: taken to be made like the left edge", check_ranges=False)
    # residuals are cut where a time is missed by 0.1 s, and have no slope there: so the time is met first
    machine = solve(machine, DROP, published_turn_time("right"), turn_time("right", device))
    space = Space(machine, [key for key in KEYS if key not in held])
    fit = most_probable_fit(
        right_residuals(space, device), space.point(prior), space.point(), max_iterations=MOST_STEPS
    )
    misses = {name: 0.5 * miss for name, miss in zip(RIGHT_FIGURES, fit.residuals, strict=True)}
    return machine.set(space.rounded(fit.point), source=SOURCE), misses


def _is_right(row: dict) -> bool:
    return (row["direction"], row["source"]) == ("right", "physical")
