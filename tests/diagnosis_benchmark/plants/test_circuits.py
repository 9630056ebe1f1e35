"""The plants' hydraulic circuits and their integration against closed forms."""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.circuits import (
    NODES,
    PORT_A,
    PORT_B,
    RETURN,
    SUPPLY,
    WALLS,
    Circuit,
    circuit_of,
)
from aoro_gym.diagnosis_benchmark.plants.fluid import compressibility_of, oil_of
from aoro_gym.diagnosis_benchmark.plants.hydraulics import (
    SLOW_SHARE,
    advance_circuit,
    chebyshev,
    held_of,
    unknown_softness,
)
from aoro_gym.diagnosis_benchmark.plants.linkage import Displacement, displacement
from aoro_gym.diagnosis_benchmark.plants.plant import STAGES, Plant
from aoro_gym.diagnosis_benchmark.plants.records import f64, packed, vec4, vec29


@wp.kernel(enable_backward=False)
def advanced(
    circuits: wp.array(dtype=Circuit), rule: wp.array2d(dtype=f64), y: wp.array(dtype=vec29), angle: f64, rate: f64,
    duration: f64, calls: int, steps: int, at: wp.array(dtype=Displacement),
):  # fmt: skip
    state = vec29(y[0])
    stretch = f64(0.0)
    soft = unknown_softness()
    for _ in range(calls):
        held = held_of(circuits[0], state, angle, rate, vec4(), f64(0.0), f64(0.0))
        state, stretch, soft = advance_circuit(circuits[0], rule, state, stretch, soft, held, angle, duration, steps)
    y[0] = state
    at[0] = displacement(circuits[0].joint.cylinders, angle)
    at[1] = displacement(circuits[0].joint.cylinders, angle + rate * duration)


def moved(circuit, y, duration, steps, *, rate=0.0, calls=1):
    """State (29,) after ``calls`` of ``duration`` [s], wheels and commands at rest, the joint turning from 0 at ``rate``
    [rad/s]; and the cylinders' displacement before and after one call."""
    state, at = wp.array(y[None], dtype=vec29, device="cpu"), wp.zeros(2, dtype=Displacement, device="cpu")
    inputs = [
        wp.array(circuit, dtype=Circuit, device="cpu"), wp.array(chebyshev(STAGES), dtype=f64, device="cpu"), state, 0.0,
        rate, duration, calls, steps, at,
    ]  # fmt: skip
    wp.launch(advanced, dim=1, inputs=inputs, device="cpu")
    return state.numpy()[0], at.numpy()


def idle(constants, level):
    """Record (1,) of the circuits and their state (29,) at rest."""
    return packed(Circuit, circuit_of(constants, level), 1), Plant(constants, level).state[:29, 0].copy()


@pytest.mark.parametrize("stages", [2, 4, 5])
def test_chebyshev_is_of_second_order_and_stable_to_its_bound(stages):
    first, *rest = chebyshev(stages)

    def amplification(z):
        older, newer = np.ones_like(z), 1.0 + first[4] * z
        for _, constant, mu, nu, slope, back in rest:
            older, newer = newer, constant + mu * newer + nu * older + slope * z * newer + back * z
        return newer

    z = -np.logspace(-3, -2, 5)
    error = np.abs(amplification(z) - np.exp(z))
    order = np.diff(np.log(error)) / np.diff(np.log(-z))
    assert order == pytest.approx(3.0, abs=0.02)  # of a step's error: one more than of the method
    bound = 0.65 * (stages**2 - 1.0)
    assert np.abs(amplification(-np.linspace(0.0, bound, 400))).max() <= 1.0 + 1e-12


def test_a_volume_discharges_through_an_orifice_as_its_closed_form(constants):
    """Turbulent: √Δp falls as a straight line, d√Δp/dt = −C/(2 C_h)."""
    p = {**constants, "oil.bulk_modulus_slope": np.zeros(1), "steering.cylinder.leakage": np.zeros(1)}
    p = {**p, "steering.valve.leakage": np.zeros(1), "steering.valve.cross_orifice": np.array([1e-8])}
    circuit, y = idle(p, 0)
    y[PORT_A] = 150e5
    y[[PORT_B, RETURN]] = 50e5  # so that no suction valve opens
    lines = circuit["lines"][0]
    lines["volume"][PORT_B] = 1.0  # a large vessel: its pressure stays
    after, at = moved(circuit, y, 2e-3, 40)
    capacity = (lines["volume"][PORT_A] + at["volume_a"][0]) / p["oil.bulk_modulus"] + lines["wall"][PORT_A]
    root = np.sqrt(100e5) - 1e-8 / (2.0 * capacity) * 2e-3
    assert np.sqrt(after[PORT_A] - 50e5) == pytest.approx(root[0], rel=1e-5)


def test_turning_against_shut_ports_compresses_their_oil(constants):
    p = {**constants, "oil.bulk_modulus_slope": np.zeros(1), "steering.cylinder.leakage": np.zeros(1)}
    p = {**p, "steering.valve.leakage": np.zeros(1)}
    circuit, y = idle(p, 0)
    y[[PORT_A, PORT_B]] = 100e5
    after, at = moved(circuit, y, 0.02, 40, rate=-0.05)
    # V(1/β) dp = −dV, walls yield by C_w dp: ∫ dp = −ΔV/(V̄/β + C_w); second order in ΔV/V, here 0.3 %
    start, end = at["volume_a"]
    lines = circuit["lines"][0]
    middle = lines["volume"][PORT_A] + 0.5 * (start + end)
    rise = (start - end) / (middle / p["oil.bulk_modulus"] + lines["wall"][PORT_A])
    assert after[PORT_A] - 100e5 == pytest.approx(rise[0], rel=1e-4)


def test_idle_circuits_stay_at_rest(constants):
    """No pressure moves by more than leaks of a tenth of a second can explain."""
    circuit, y = idle(constants, 0)
    after, _ = moved(circuit, y, 0.05, 400)
    assert after[SUPPLY] == pytest.approx(y[SUPPLY], rel=1e-3)
    assert after[4:11] == pytest.approx(y[4:11], rel=1e-3)


def test_a_hose_in_halves_gives_way_at_once_and_late(constants):
    """Pressed by a flow into its valve's end, cylinders and valve shut, it takes in what oil and all of the wall do once the
    wall has settled."""
    circuit, y = idle(constants, 3)
    valves, ports = slice(NODES, NODES + 2), slice(PORT_A, RETURN)
    pressed = y.copy()
    pressed[valves] += 1e3  # a charge into both ends, small as the modulus of oil with air rises with pressure
    after, at = moved(circuit, pressed, 1e-3, 4, calls=300)
    lines, oil = circuit["lines"][0], oil_of(constants, 3)
    fast = lines["hose_volume"] * compressibility_of(oil, y[NODES]) + (1.0 - float(SLOW_SHARE)) * lines["hose_wall"]
    chambers = np.array([at["volume_a"][0], at["volume_b"][0]]) + lines["volume"][ports]
    end = chambers * compressibility_of(oil, y[PORT_A]) + lines["wall"][ports]
    rise = fast * 1e3 / (fast + float(SLOW_SHARE) * lines["hose_wall"] + end)
    # leaks of cylinders and valve take a little in 0.3 s
    assert after[ports] - y[ports] == pytest.approx(rise, rel=0.05)
    assert after[valves] == pytest.approx(after[ports], rel=1e-3)
    slow = float(SLOW_SHARE) * lines["hose_wall"] * after[valves]
    assert after[WALLS : WALLS + 2] == pytest.approx(slow, rel=1e-3)
