"""Whole plants: order of the stepping, oscillation on shut-in oil, standstill, and level 0 against the twin."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from aoro_gym import Machine, Twin
from aoro_gym.diagnosis_benchmark import plants
from aoro_gym.diagnosis_benchmark.plants import circuits as rows
from aoro_gym.diagnosis_benchmark.plants.bodies import FRONT, REAR, mass_factor, solved
from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.effects import with_effects
from aoro_gym.diagnosis_benchmark.plants.hydraulics import SLOW_SHARE
from aoro_gym.diagnosis_benchmark.plants.linkage import displacement
from aoro_gym.diagnosis_benchmark.plants.plant import (
    FINE_SUBSTEPS,
    LEVELS,
    PLAY,
    POSITION,
    RATES,
    Plant,
    PlantRecord,
    delay,
    simulate,
)
from aoro_gym.diagnosis_benchmark.plants.records import f64, vec7
from tests.diagnosis_benchmark.plants import reference

OUTPUTS = (
    "joint_angle",
    "joint_rate",
    "pressure_a",
    "pressure_b",
    "pump_pressure",
    "pump_swash",
    "spool",
    "engine_speed",
)


OPENED = np.array([[0.5], [0.5], [60e5], [30e5], [30e5], [0.1]])
"""Spool, compensator, supply, port A, load-sensing line and swash plate of a plant in the beginning of a turn."""


def refined(constants, level, halvings, *, opened):
    """Angle, pressures, compensator and swash every 8 ms (F, 5) of the beginning of a turn, main step and circuits' step
    halved so often; with the valve ``opened`` from the start, else as a signal opens it."""
    duration, main_step = (0.048, 1e-3 / 2**halvings) if opened else (0.16, 1e-3 / 2**halvings)
    p = {**constants, "steering.valve.command_delay": np.zeros(1)} if opened else constants
    plant = Plant(p, level, joint_angle=-0.3, main_step=main_step, substeps=FINE_SUBSTEPS if opened else None)
    if opened:
        plant.state[PLAY] = 0.5
        plant.state[[rows.SPOOL, rows.COMPENSATOR, rows.SUPPLY, rows.PORT_A, rows.LS, rows.SWASH]] = OPENED
        if level == 2:
            plant.state[rows.NODES : rows.NODES + 4] = plant.state[[rows.PORT_A, rows.PORT_B, rows.PORT_A, rows.PORT_B]]
        if level == 3:
            plant.state[rows.NODES : rows.NODES + 2] = plant.state[[rows.PORT_A, rows.PORT_B]]
            wall = plant.machines["circuit"]["lines"]["hose_wall"]
            plant.state[rows.WALLS : rows.WALLS + 2] = (
                float(SLOW_SHARE) * wall * plant.state[[rows.PORT_A, rows.PORT_B]]
            )
    signal = {"steering_signal": np.full((round(duration / main_step), 1), 0.5 if opened else 0.8)}
    names = ("joint_angle", "pressure_a", "pump_pressure", "compensator", "pump_swash")
    out = simulate(plant, signal, keep_every=round(8e-3 / main_step), channels=names)
    return np.concatenate([out[name] for name in names], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_stepping_is_of_second_order(constants, level):
    """Halving all steps leaves a quarter of the error, while no valve opens or shuts."""
    first, second, third = (refined(constants, level, n, opened=True) for n in (0, 1, 2))
    coarse, fine = np.abs(first - second).max(axis=0), np.abs(second - third).max(axis=0)
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)
    assert np.all(coarse < 2e-3 * np.ptp(third, axis=0))


def test_an_opening_valve_costs_two_thousandths(constants):
    """The load-sensing line's input jumps as the valve opens, somewhere in a circuits' step of 0.25 ms: first order there,
    but small."""
    first, second = (refined(constants, 0, n, opened=False) for n in (0, 1))
    error = np.abs(first - second).max(axis=0) / np.ptp(second, axis=0)
    assert np.all(error[:3] < 2e-3)


@wp.kernel(enable_backward=False)
def pushed(machines: wp.array(dtype=PlantRecord), found: wp.array(dtype=f64)):
    """Acceleration of the joint [rad/s²] by 1 N m at the angle 0, and volume and slopes of the cylinders there."""
    m = machines[0]
    push = vec7()
    push[FRONT] = f64(1.0)
    push[REAR] = f64(-1.0)
    change = solved(mass_factor(m.bodies, vec7()), push)
    at = displacement(m.circuit.joint.cylinders, f64(0.0))
    found[0] = change[FRONT] - change[REAR]
    found[1] = at.volume_a
    found[2] = at.slope_a
    found[3] = at.slope_b


def test_the_joint_swings_on_shut_in_oil_at_its_own_frequency(constants):
    """ω² = (dT/dθ)/J: oil in both chambers and hoses is the spring, the frames on slippery ground the mass."""
    off = {
        "steering.cylinder.leakage", "steering.valve.leakage", "steering.cylinder.seal_preload", "joint.friction_torque",
        "steering.cylinder.seal_pressure_coefficient", "steering.cylinder.seal_viscous", "tire.friction_coulomb",
        "tire.friction_static", "oil.bulk_modulus_slope",
    }  # fmt: skip
    p = {key: value * (1e-9 if key in off else 1.0) for key, value in constants.items()}
    p["frame.front.cog_height"] = p["frame.rear.cog_height"] = np.array([1e-3])  # so that rolling takes no part
    plant = Plant(p, 0)
    plant.state[1:3] = 60e5  # both ports pressed: no void, and the suction valves stay shut
    # the oil is shut in at 60 bar with the joint at 1 mrad, so that it swings about there: push it instead
    plant.state[POSITION + 2 : POSITION + 4, 0] = 0.5e-3, -0.5e-3
    plant.state[RATES + 2] = 0.05
    found = wp.zeros(4, dtype=f64, device="cpu")
    wp.launch(pushed, dim=1, inputs=[wp.array(plant.machines, dtype=PlantRecord, device="cpu"), found], device="cpu")
    inverse, volume, slope_a, slope_b = found.numpy()
    lines = plant.machines["circuit"]["lines"][0]
    compliance = (lines["volume"][1] + volume) / p["oil.bulk_modulus"][0] + lines["wall"][1]
    frequency = np.sqrt((slope_a**2 + slope_b**2) / compliance * inverse)
    out = simulate(plant, {"steering_signal": np.zeros((500, 1))}, channels=("joint_rate",))
    rate = out["joint_rate"][:, 0]
    crossing = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0))
    instants = crossing + rate[crossing] / (rate[crossing] - rate[crossing + 1])
    period = 1e-3 * np.diff(instants).mean()
    # Verlet at ω h = 0.03 is short by (ω h)²/24 = 4e-5; the heights left and the amplitude make up the rest
    assert 2.0 * np.pi / period == pytest.approx(frequency, rel=5e-3)


@pytest.mark.parametrize("level", LEVELS)
def test_at_rest_nothing_moves(constants, level):
    plant = Plant(constants, level, joint_angle=0.4)
    out = simulate(
        plant, {"steering_signal": np.zeros((300, 1))}, channels=("joint_angle", "pump_pressure", "position_x")
    )
    assert np.abs(out["joint_angle"] - 0.4).max() < 1e-4  # a quarter of the angle sensor's white noise
    assert np.ptp(out["pump_pressure"]) < 0.01 * constants["steering.pump.margin"][0]
    assert np.abs(out["position_x"]).max() < 1e-4


def test_it_says_what_it_cannot_do(constants):
    with pytest.raises(ValueError, match="reaches only"):
        Plant(constants, 0, joint_angle=1.2)
    with pytest.raises(ValueError, match="choose one of"):
        Plant(constants, 4)


@pytest.mark.parametrize("level", LEVELS)
def test_every_law_does_what_its_first_writing_did(level):
    """The plants' first writing, in NumPy, stepped the same method. What differs is rounding, and that the compressibility
    follows the pressure by straight lines, to 7.5e-5 of itself at most and mostly far nearer. Two places multiply that, up
    to the method's own error of some thousandths: an emptied hose (level 2), and above level 0 pins that yield, which
    chatter where they stick, as the friction's slope of 7e5 N m s/rad on 2 kg m² is stiffer than the method bears."""
    first = np.load(Path(reference.__file__).with_suffix(".npz"))[f"level_{level}"]
    machine = Machine.load("aoro_least_squares")  # of which the first writing was
    constants = with_effects(constants_of([machine.entries] * len(reference.START)), reference.magnitudes(), level)
    plant = Plant(constants, level, joint_angle=reference.START, substeps=4)
    out = simulate(plant, reference.commands(), keep_every=reference.EVERY, channels=reference.CHANNELS)
    error = np.abs(np.stack([out[name] for name in reference.CHANNELS]) - first).max(axis=1) / np.ptp(first, axis=1)
    assert np.median(error) < 1e-6
    assert error.max() < 5e-3


@pytest.mark.parametrize("level", LEVELS)
def test_threads_and_holding_change_nothing(constants, level):
    signal = np.repeat([[0.0], [0.8], [-0.4]], 2, axis=1) * [1.0, -1.0]
    three = {key: np.repeat(value, 2) for key, value in constants.items()}
    by_step, by_tick = (
        simulate(Plant(three, level), {"steering_signal": s}, hold=hold, threads=threads)
        for s, hold, threads in ((np.repeat(signal, 10, axis=0), 1, 1), (signal, 10, 2))
    )
    for name, values in by_step.items():
        assert by_tick[name] == pytest.approx(values, rel=1e-9, abs=1e-12), name


# ------------------------------------------------------------------------------------------------- level 0 and the twin
SIGNALS = np.array([1.0, 0.75, 0.5, -1.0, -0.75, -0.5])
REST, DURATION = 0.1, 1.3


@pytest.fixture(scope="module")
def both(machine):
    """Twin and plant of six turns, every millisecond; at half the signal the first third of a turn."""
    start = -np.sign(SIGNALS) * float(machine.joint.range)
    twin = Twin(len(SIGNALS), machine=machine)
    twin.reset(joint_angle=start)
    traces = [
        twin.step({}, duration=REST, sample_every=1e-3),
        twin.step({"steering_signal": SIGNALS}, duration=DURATION - REST, sample_every=1e-3),
    ]
    of_twin = {name: np.concatenate([t[name] for t in traces if t]).astype(float) for name in OUTPUTS}
    plant = Plant(constants_of([machine.entries] * len(SIGNALS)), 0, joint_angle=start)
    signal = np.zeros((round(DURATION / 1e-3), len(SIGNALS)))
    signal[round(REST / 1e-3) :] = SIGNALS
    of_plant = simulate(plant, {"steering_signal": signal}, channels=OUTPUTS)
    return of_twin, {name: values[1:] for name, values in of_plant.items()}, start


def test_level_0_turns_as_the_twin(both, machine):
    """Two writings of the same laws, from the same rest. The twin's own step leaves 0.2 % of the flow's peak, the plant's
    0.1 %; that its bodies leave out the arms' motion and have tilts to second order adds as much in a turn's first
    instants."""
    twin, plant, start = both
    for case, signal in enumerate(SIGNALS):
        ahead = np.sign(signal) * twin["joint_angle"][:, case]
        free = np.flatnonzero(ahead > machine.joint.range - 2e-3)
        until = (int(free[0]) if free.size else len(ahead)) - 10  # the bounces off the stop amplify what differs
        rate, exact = plant["joint_rate"][:until, case], twin["joint_rate"][:until, case]
        peak = np.abs(exact).max()
        error = rate - exact
        assert np.sqrt(np.mean(error**2)) < 0.001 * peak, signal
        assert np.abs(error).max() < 0.006 * peak, signal
        turned, expected = (values["joint_angle"][until - 1, case] - start[case] for values in (plant, twin))
        assert turned == pytest.approx(expected, rel=5e-4), signal
        assert np.abs(rate).max() == pytest.approx(peak, rel=0.01), signal


def test_level_0_has_the_twin_s_circuit(both):
    """Spool to the twin's float32; pump and engine as near as the load that they see."""
    twin, plant, _ = both
    assert np.abs(twin["spool"] - plant["spool"])[:1500].max() < 1e-3
    for name, bound in (("pump_pressure", 0.02), ("pump_swash", 0.03), ("engine_speed", 0.002)):
        error = np.abs(twin[name] - plant[name])[:1500]
        assert np.sqrt(np.mean(error**2)) < bound * np.abs(twin[name]).max(), name


def test_level_0_drives_as_the_twin(machine):
    """Pulling away with the joint turning: the loop of oil, motors, brakes and tires, within a percent of their peaks."""
    names = (
        "wheel_rate_fl",
        "wheel_rate_rr",
        "drive_pressure_forward",
        "drive_pressure_return",
        "position_x",
        "joint_angle",
    )
    count, signal, drive = 600, 0.6, 0.4
    twin = Twin(1, machine=machine)
    twin.reset()
    trace = twin.step({"steering_signal": signal, "drive_signal": drive}, duration=1e-3 * count, sample_every=1e-3)
    assert trace is not None
    plant = Plant(constants_of([machine.entries]), 0)
    plant.state[POSITION + 4 : POSITION + 7] = 0.0
    commands = {"steering_signal": np.full((count, 1), signal), "drive_signal": np.full((count, 1), drive)}
    out = simulate(plant, commands, channels=names)
    for name in names:
        exact = trace[name][:, 0].astype(float)
        error = out[name][1:, 0] - exact
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.abs(exact).max(), name


def test_a_dead_time_shifts_the_signal_and_nothing_else():
    signal = np.zeros((50, 3))
    signal[10:] = 1.0
    late = delay(signal, np.array([0.0, 0.0075, 0.02]), 1e-3)
    arrival = 0.5e-3 * np.argmax(late > 1e-9, axis=0)
    assert arrival == pytest.approx([0.010, 0.0175, 0.030])
    assert late[:, 0] == pytest.approx(np.repeat(signal[:, 0], 2))
    between = delay(signal, np.array([0.00725] * 3), 1e-3)  # within a half step its mean passes
    assert between[34] == pytest.approx(0.5)


def test_plants_share_no_law_with_the_twin():
    """Of the package they see the format of the machine file, and nothing that steps."""
    folder = Path(plants.__file__).parent
    seen = {
        line.split()[1]
        for file in folder.glob("*.py")
        for line in file.read_text(encoding="utf-8").splitlines()
        if line.startswith(("from aoro_gym", "import aoro_gym"))
    }
    outside = {name for name in seen if not name.startswith("aoro_gym.diagnosis_benchmark.plants")}
    assert outside == {"aoro_gym.machine.machine_file"}
