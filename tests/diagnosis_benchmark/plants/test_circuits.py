"""The plants' hydraulic circuits and their integration against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.circuits import (
    PORT_A,
    RETURN,
    SLOW_SHARE,
    SUPPLY,
    VALVES,
    WALLS,
    Chebyshev,
    Circuits,
)
from aoro_gym.diagnosis_benchmark.plants.plant import STAGES


@pytest.mark.parametrize("stages", [2, 4, 5])
def test_chebyshev_is_of_second_order_and_stable_to_its_bound(stages):
    first, rest, _ = Chebyshev(stages).steps()

    def amplification(z):
        older, newer = np.ones_like(z), 1.0 + first * z
        for constant, mu, nu, slope, back in rest:
            older, newer = newer, constant + mu * newer + nu * older + slope * z * newer + back * z
        return newer

    z = -np.logspace(-3, -2, 5)
    error = np.abs(amplification(z) - np.exp(z))
    order = np.diff(np.log(error)) / np.diff(np.log(-z))
    assert order == pytest.approx(3.0, abs=0.02)  # of a step's error: one more than of the method
    bound = 0.65 * (stages**2 - 1.0)
    assert np.abs(amplification(-np.linspace(0.0, bound, 400))).max() <= 1.0 + 1e-12


def still(circuits, y, duration, steps, angle=0.0):
    """State after ``duration`` [s] with frames, wheels and commands at rest."""
    zero = np.zeros(circuits.runs)
    wheels = np.zeros((4, circuits.runs))
    return circuits.advance(y, zero, zero + angle, zero, wheels, zero, zero, duration, steps)[0]


def test_a_volume_discharges_through_an_orifice_as_its_closed_form(constants):
    """Turbulent: √Δp falls as a straight line, d√Δp/dt = −C/(2 C_h)."""
    p = {**constants, "oil.bulk_modulus_slope": np.zeros(1), "steering.cylinder.leakage": np.zeros(1)}
    p = {**p, "steering.valve.leakage": np.zeros(1), "steering.valve.cross_orifice": np.array([1e-8])}
    circuits = Circuits(p, 0, STAGES)
    y = circuits.at_rest(np.zeros(1))
    y[PORT_A] = 150e5
    y[[PORT_A + 1, RETURN]] = 50e5  # so that no suction valve opens
    circuits.volume[PORT_A + 1] = 1.0  # a large vessel: its pressure stays
    after = still(circuits, y.copy(), 2e-3, 40)
    at = circuits.cylinders.at(np.zeros(1))
    capacity = (circuits.volume[PORT_A] + at.volume_a) / p["oil.bulk_modulus"] + circuits.wall[PORT_A]
    root = np.sqrt(100e5) - 1e-8 / (2.0 * capacity) * 2e-3
    assert np.sqrt(after[PORT_A] - 50e5) == pytest.approx(root, rel=1e-5)


def test_turning_against_shut_ports_compresses_their_oil(constants):
    p = {**constants, "oil.bulk_modulus_slope": np.zeros(1), "steering.cylinder.leakage": np.zeros(1)}
    p = {**p, "steering.valve.leakage": np.zeros(1)}
    circuits, rate, duration = Circuits(p, 0, STAGES), -0.05, 0.02
    y = circuits.at_rest(np.zeros(1))
    y[PORT_A] = y[PORT_A + 1] = 100e5
    zero = np.zeros(1)
    after, _ = circuits.advance(y, zero, zero, zero + rate, np.zeros((4, 1)), zero, zero, duration, 40)
    # V(1/β) dp = −dV, walls yield by C_w dp: ∫ dp = −ΔV/(V̄/β + C_w); second order in ΔV/V, here 0.3 %
    start, end = circuits.cylinders.at(zero), circuits.cylinders.at(zero + rate * duration)
    middle = circuits.volume[PORT_A] + 0.5 * (start.volume_a + end.volume_a)
    rise = (start.volume_a - end.volume_a) / (middle / p["oil.bulk_modulus"] + circuits.wall[PORT_A])
    assert after[PORT_A] - 100e5 == pytest.approx(rise, rel=1e-4)


def test_idle_circuits_stay_at_rest(constants):
    """No pressure moves by more than leaks of a tenth of a second can explain."""
    circuits = Circuits(constants, 0, STAGES)
    y = circuits.at_rest(np.zeros(1))
    after = still(circuits, y.copy(), 0.05, 400)
    assert after[SUPPLY] == pytest.approx(y[SUPPLY], rel=1e-3)
    assert after[4:11] == pytest.approx(y[4:11], rel=1e-3)


def test_a_hose_in_halves_gives_way_at_once_and_late(constants):
    """Pressed by a flow into its valve's end, cylinders and valve shut, it takes in what oil and all of the wall do once the
    wall has settled."""
    circuits = Circuits(constants, 3, STAGES)
    start = circuits.at_rest(np.zeros(1))
    state, stretch, zero = start.copy(), np.zeros(1), np.zeros(1)
    state[VALVES] += 1e3  # a charge into both ends, small as the modulus of oil with air rises with pressure
    for _ in range(300):
        state, stretch = circuits.advance(state, stretch, zero, zero, np.zeros((4, 1)), zero, zero, 1e-3, 4)
    fast = circuits.hose_volume * circuits.oil.compressibility(start[VALVES]) + 0.6 * circuits.hose_wall
    middle = circuits.cylinders.at(zero)
    chambers = np.stack([middle.volume_a, middle.volume_b]) + circuits.volume[PORT_A:RETURN]
    end = chambers * circuits.oil.compressibility(start[PORT_A:RETURN]) + circuits.wall[PORT_A:RETURN]
    rise = fast * 1e3 / (fast + 0.4 * circuits.hose_wall + end)
    # leaks of cylinders and valve take a little in 0.3 s
    assert state[PORT_A:RETURN] - start[PORT_A:RETURN] == pytest.approx(rise, rel=0.05)
    assert state[VALVES] == pytest.approx(state[PORT_A:RETURN], rel=1e-3)
    assert state[WALLS] == pytest.approx(SLOW_SHARE * circuits.hose_wall * state[VALVES], rel=1e-3)
