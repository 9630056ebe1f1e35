"""The bound of the hydraulic step: the twin is steady below it and rings not far above it, whatever machine it is."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from aoro_gym.agents.evaluation.perturbations import PERTURBATIONS
from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.twin.hydraulic_step import (
    FineStepWarning,
    _fastest,
    _hose_frequency,
    _largest_step_of_mass,
    _port,
    _steering,
    check_hydraulic_step,
    largest_hydraulic_step,
)

Phases = Sequence[tuple[Mapping[str, float], float]]
MAIN = 1e-3
PRESSURES = (
    "pressure_a", "pressure_b", "pump_pressure", "return_pressure", "drive_pressure_forward", "drive_pressure_return",
    "charge_pressure", "ls_pressure", "motor_pressure_fl", "arm_pressure_bore_fl", "arm_pressure_rod_fl",
)  # fmt: skip
RINGING = 0.3e5
"""Pressure [Pa] that alternates from sample to sample, as a sensor's noise does."""
MACHINES = {
    "as it is": {},
    "small charge line": {"driveline.charge.volume": 0.3},
    "large charge line": {"driveline.charge.volume": 3.0},
    "small return line": {"steering.tank_line.volume": 0.2},
    "short wheel hoses": {"driveline.wheel_hose_volume": 0.2},
    "stiff oil": {"oil.bulk_modulus": 2.0},
    "wide traction valves": {"driveline.traction.nominal_flow": 4.0},
}
LAWS = {
    "small load-sensing line": ({"load_sensing_line": "volume"}, {"steering.pump.ls_volume": 0.03}),
    "short return line behind an orifice": ({"return_line": "orifice"}, {"steering.tank_line.volume": 0.1}),
    "short hoses of two segments": ({"hose": "two_segments"}, {"steering.hose_volume": 0.4}),
    "short hoses that creep": ({"hose": "viscoelastic"}, {"steering.hose_volume": 0.1}),
    "short hoses that stiffen": ({"hose": "stiffening"}, {"steering.hose_volume": 0.1}),
}
"""Laws, and what makes the circuit that they change so quick that no other one decides at 2.5 times its bound."""


MOTION = (
    ({"drive_signal": 0.5}, 1.0),
    ({"steering_signal": 0.6}, 0.5),
    ({"drive_signal": 0.0, "steering_signal": -1.0}, 0.8),
    ({"steering_signal": 0.0, "arm_fl": 0.5}, 0.3),
)
"""Driving, turning and lifting."""
PRESSING = (({"steering_signal": 1.0}, 1.5),)
"""On a stop: the other port is smallest, and what leaks leaves its edge laminar."""


def ringing(machine: Machine, substeps: int, phases: Phases = MOTION, joint: float = 0.0) -> float:
    """Largest alternation [Pa] of any pressure in ``phases`` of commands from a ``joint`` angle [rad], each at its end."""
    twin = Twin(machine=machine, main_step=MAIN, substeps=substeps, check_step=False)
    twin.reset(joint_angle=joint)
    worst = 0.0
    for commands, duration in phases:
        trace = twin.step(commands, duration, sample_every=MAIN)
        assert trace is not None
        late = np.stack([trace[name][-200:, 0] for name in PRESSURES]).astype(float)
        worst = max(worst, float(np.median(np.abs(np.diff(late, 3, axis=1)), axis=1).max()) / 8.0)
    return worst


def odd(count: float) -> int:
    """Of an even number of substeps each sample would meet the same side of what alternates."""
    return int(count) | 1


@pytest.mark.parametrize("name", MACHINES)
def test_the_largest_stable_step_is_one_to_two_and_a_half_bounds(name):
    rings_beyond_its_bound(Machine.load("aoro").scale(MACHINES[name], check_ranges=False))


@pytest.mark.parametrize("name", LAWS)
def test_the_bound_follows_the_laws(name):
    laws, scales = LAWS[name]
    machine = Machine.load("aoro")
    changed = machine.scale(scales, check_ranges=False).with_laws(**laws)
    assert largest_hydraulic_step(changed)[0] < largest_hydraulic_step(machine)[0] / 2.5
    rings_beyond_its_bound(changed, PRESSING, 0.95 * float(changed.joint.range))


def rings_beyond_its_bound(changed: Machine, phases: Phases = MOTION, joint: float = 0.0) -> None:
    bound = float(largest_hydraulic_step(changed)[0])
    below = odd(np.ceil(MAIN / bound) + 1)
    assert MAIN / below < bound
    assert ringing(changed, below, phases, joint) < RINGING
    above = odd(MAIN / (2.5 * bound)) - 2 * (odd(MAIN / (2.5 * bound)) > MAIN / (2.5 * bound))
    assert ringing(changed, max(above, 1), phases, joint) > RINGING


def test_a_mass_is_stable_up_to_its_bound():
    """ẋ⁺ = (ẋ − dt ω² x)/(1 + 2 ζ ω dt), x⁺ = x + dt ẋ⁺: spectral radius 1."""
    for frequency in (50.0, 1e4):
        for damping in (0.0, 0.3, 3.0):
            bound = float(_largest_step_of_mass(frequency, damping))
            for share, stable in ((0.999, True), (1.001, False)):
                dt = share * bound
                held = 1.0 / (1.0 + 2.0 * damping * frequency * dt)
                rate = np.array([-dt * frequency**2 * held, held])
                radius = np.max(np.abs(np.linalg.eigvals(np.array([np.array([1.0, 0.0]) + dt * rate, rate]))))
                assert (radius <= 1.0 + 1e-12) == stable


def test_two_segments_are_stable_up_to_their_bound():
    """So little inertance that their swing decides together with the edge: the matrix of one step, flow first, of a port
    that loses what the fastest mode does has spectral radius 1 between the bound and a tenth more, as the other end yields.
    """
    machine = (
        Machine.load("aoro").with_laws(hose="two_segments").scale({"steering.hose_inertance": 1e-4}, check_ranges=False)
    )
    bound = float(largest_hydraulic_step(machine)[0])
    first, second = (float(one) for one in _port(machine))
    inertance = float(machine.steering.hose_inertance)
    decay = max(float(_fastest(1, *_steering(machine, side))[0]) for side in ("left", "right"))
    assert bound < 0.9 * min(2.0 / decay, 2.0 / float(_hose_frequency(machine)))
    for share, stable in ((0.999, True), (1.1, False)):
        dt = share * bound
        flow = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [dt / inertance, -dt / inertance, 1.0]])
        fill = np.array([[1.0, 0.0, -dt * first], [0.0, 1.0, dt * second], [0.0, 0.0, 1.0]])
        lost = np.diag([-dt * decay, 0.0, 0.0])
        assert (np.max(np.abs(np.linalg.eigvals(fill @ flow + lost))) <= 1.0 + 1e-9) == stable


def test_the_bound_of_one_volume_is_in_closed_form():
    """A charge line so small that it decides alone: 2 / (K (C/√p_lam + Q/ramp)), K = β / (V + C_walls β)."""
    machine = Machine.load("aoro").set({"driveline.charge.volume": 0.001}, check_ranges=False)
    line, oil = machine.driveline, machine.oil
    modulus = oil.bulk_modulus + oil.bulk_modulus_slope * line.charge.relief_pressure
    stiffness = modulus / (line.charge.volume + line.charge_compliance * modulus)
    slope = line.charge.cv_check / np.sqrt(oil.laminar_pressure) + line.charge.relief_flow / line.charge.relief_ramp
    # the mains beside it, a thousand times larger, add a little
    assert largest_hydraulic_step(machine)[0] == pytest.approx(2.0 / (stiffness * slope), rel=2e-2)


def test_bounds_are_those_of_each_variant():
    factors = np.array([0.2, 1.0, 3.0])
    many = largest_hydraulic_step(Machine.load("aoro").scale({"driveline.charge.volume": factors}, check_ranges=False))
    for factor, bound in zip(factors, many, strict=True):
        one = Machine.load("aoro").scale({"driveline.charge.volume": factor}, check_ranges=False)
        assert largest_hydraulic_step(one)[0] == pytest.approx(bound, rel=1e-12)
    assert many[0] < many[1] < many[2]


def test_a_slow_lag_bounds_the_step_too():
    quick = Machine.load("aoro").set({"steering.valve.spool_time_constant": 1e-5}, check_ranges=False)
    assert largest_hydraulic_step(quick)[0] == pytest.approx(2e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"substeps": 1}, r"^substeps is 1, a hydraulic step of 1e\+03 µs, but the circuits of machine 'aoro' are stable "
         r"only up to 83\.5 µs: take substeps of at least 12, or a shorter main_step$"),
        ({"substeps": 11}, "take substeps of at least 12"),
        ({"main_step": 2e-3, "substeps": 20}, "a hydraulic step of 100 µs.* take substeps of at least 24"),
    ],
)  # fmt: skip
def test_an_unstable_step_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Twin(**arguments)


def test_a_machine_that_is_too_stiff_for_the_step_is_refused_by_the_twins_number():
    machine = Machine.load("aoro")
    stiff = machine.scale({"driveline.charge.volume": 0.2}, check_ranges=False)
    with pytest.raises(ValueError, match=r"substeps is 30, .* only up to 17\.7 µs: take substeps of at least 57"):
        Twin(machine=stiff)
    both = machine.scale({"driveline.charge.volume": np.array([1.0, 0.05])}, check_ranges=False)
    with pytest.raises(ValueError, match="of twin 1 are stable only up to"):
        Twin(2, machine=both)
    twin = Twin(5, own_machines=True)
    with pytest.raises(ValueError, match="of twin 4 are stable only up to"):
        twin.set_machines([2, 4], both)
    twin.set_machines([2], machine)


def test_of_many_machines_a_stiff_one_may_ring_a_little():
    """Machines that are drawn within their ranges are driven as they are: one of thirty is stiffer than the step bears."""
    drawn = PERTURBATIONS["perturbed"](Machine.load("aoro"), range(40_000, 40_030))
    bounds = largest_hydraulic_step(drawn)
    assert np.sum(bounds < 1e-3 / 30) == 1
    twin = Twin(30, machine=drawn)
    twin.set_machines([0], drawn.variant(int(np.argmin(bounds))))
    with pytest.raises(ValueError, match="are stable only up to"):
        Twin(machine=drawn.variant(int(np.argmin(bounds))))


def test_steps_that_are_used_pass_in_silence_and_finer_ones_are_named():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for main_step, substeps in (
            (1e-3, 15),
            (1e-3, 20),
            (1e-3, 30),
            (1e-3, 120),
            (2e-3, 30),
            (2e-3, 500),
            (5e-4, 15),
        ):
            Twin(main_step=main_step, substeps=substeps)
        Twin(substeps=480, check_step=False)
    for main_step, substeps, most in ((1e-3, 251, 250), (1e-3, 480, 250), (5e-4, 150, 125)):
        with pytest.warns(FineStepWarning, match=f"finer than 4 µs, .* take substeps of at most {most}$"):
            Twin(main_step=main_step, substeps=substeps)


def test_bundled_machines_are_stable_at_the_default_step():
    from aoro_gym.machine.machine_file import bundled_machines

    for name in bundled_machines():
        check_hydraulic_step(Machine.load(name), 1e-3, 30)
        assert largest_hydraulic_step(Machine.load(name))[0] > 1.8 * 1e-3 / 30
