"""Whole plants: order of the stepping, oscillation on shut-in oil, standstill, and level 0 against the twin."""

from pathlib import Path

import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.diagnosis_benchmark import plants
from aoro_gym.diagnosis_benchmark.plants.circuits import (
    COMPENSATOR,
    LS,
    NODES,
    PORT_A,
    PORT_B,
    SLOW_SHARE,
    SPOOL,
    SUPPLY,
    SWASH,
    VALVES,
    WALLS,
)  # fmt: skip
from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.plant import LEVELS, Plant, delay, simulate

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


def refined(constants, level, halvings, *, opened):
    """Angle, pressures, compensator and swash every 8 ms (F, 5) of the beginning of a turn, main step and circuits' step
    halved so often; with the valve ``opened`` from the start, else as a signal opens it."""
    duration, main_step = (0.048, 1e-3 / 2**halvings) if opened else (0.16, 1e-3 / 2**halvings)
    p = {**constants, "steering.valve.command_delay": np.zeros(1)} if opened else constants
    plant = Plant(p, level, joint_angle=-0.3, main_step=main_step)
    if opened:
        plant._play[:] = 0.5
        for row, value in ((SPOOL, 0.5), (COMPENSATOR, 0.5), (SUPPLY, 60e5), (PORT_A, 30e5), (LS, 30e5), (SWASH, 0.1)):
            plant.state[row] = value
        if level == 2:
            plant.state[NODES] = plant.state[[PORT_A, PORT_B, PORT_A, PORT_B]]
        if level == 3:
            plant.state[VALVES] = plant.state[[PORT_A, PORT_B]]
            plant.state[WALLS] = SLOW_SHARE * plant.circuits.hose_wall * plant.state[[PORT_A, PORT_B]]
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


def test_an_opening_valve_costs_a_thousandth(constants):
    """The load-sensing line's input jumps as the valve opens: first order there, but small."""
    first, second = (refined(constants, 0, n, opened=False) for n in (0, 1))
    error = np.abs(first - second).max(axis=0) / np.ptp(second, axis=0)
    assert np.all(error[:3] < 1e-3)


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
    bodies = plant.bodies
    angle = 1e-3
    bodies.position[2], bodies.position[3] = 0.5 * angle, -0.5 * angle
    at = plant.circuits.cylinders.at(np.zeros(1))
    # the oil is shut in at 60 bar with the joint at 1 mrad, so that it swings about there: push it instead
    plant.u[2], plant.u[3] = 0.05, 0.0
    compliance = (plant.circuits.volume[1] + at.volume_a) / p["oil.bulk_modulus"] + plant.circuits.wall[1]
    spring = at.slope_a**2 / compliance + at.slope_b**2 / compliance
    mass = bodies.mass_factor()[..., 0]
    matrix = mass @ mass.T
    push = np.zeros(7)
    push[2], push[3] = 1.0, -1.0
    inverse = push @ np.linalg.solve(matrix, push)
    frequency = np.sqrt(spring[0] * inverse)
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
    plant.bodies.position[4:] = 0.0
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
