"""A twin whose wheels are turned from outside, with the driveline that turns them, is the whole twin."""

import pickle
from collections.abc import Callable

import numpy as np
import pytest

from aoro_gym import Machine, Plane, Twin
from aoro_gym.twin.driveline import COMMANDS, Driveline
from aoro_gym.twin.hub_driven import HubDrivenTwin
from aoro_gym.twin.kernels.advance import advance
from aoro_gym.twin.kernels.build import with_others
from aoro_gym.twin.records import CHANNELS

STEP = 1e-3


def run_whole(commands: Callable[[float], dict[str, float]], duration: float) -> np.ndarray:
    """Outputs (main steps, channels) of the whole twin."""
    twin, rows = Twin(), []
    for step in range(round(duration / STEP)):
        twin.set_commands(commands(step * STEP))
        twin.advance(STEP)
        rows.append(twin.outputs.numpy()[-1, :, 0].copy())
    return np.array(rows)


def run_parted(
    commands: Callable[[float], dict[str, float]], duration: float, hub_inertia: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """The same of twin and driveline that exchange at every main step, and the torques (main steps, 4) between them."""
    machine = Machine.load("aoro")
    bodies = machine.set({"wheel.inertia_spin": float(machine.wheel.inertia_spin) - hub_inertia})
    twin, driveline = HubDrivenTwin(machine=bodies), Driveline(machine=machine, hub_inertia=hub_inertia)
    driveline.reset(twin.hub_torques)
    rows, torques = [], []
    for step in range(round(duration / STEP)):
        asked = commands(step * STEP)
        driveline.set_commands({name: asked[name] for name in asked if name in COMMANDS})
        twin.set_commands({name: asked[name] for name in asked if name not in COMMANDS})
        torque, speed = driveline.step(twin.wheel_rates, twin.pump_torque)
        twin.set_hubs(torque, speed)
        twin.advance(STEP)
        rows.append(twin.outputs.numpy()[-1, :, 0].copy())
        torques.append(torque[:, 0])
    return np.array(rows), np.array(torques)


def driving_and_turning(time: float) -> dict[str, float]:
    return {
        "drive_signal": 0.6,
        "steering_signal": 0.5 if time > 0.8 else 0.0,
        "gear": 2.0 if time > 0.6 else 1.0,
        "parking_brake": 1.0 if time > 1.4 else 0.0,
    }


@pytest.fixture(scope="module")
def whole() -> np.ndarray:
    return run_whole(driving_and_turning, 1.6)


@pytest.mark.parametrize(("hub_inertia", "tolerance"), [(0.0, 1e-4), (4.0, 1e-2)])
def test_parted_at_the_hubs_is_the_whole(whole: np.ndarray, hub_inertia: float, tolerance: float) -> None:
    # no hub inertia: all that differs is that the brake's damping is explicit, c h/(2 J) = 2 % of what is damped within
    # 0.3 mrad before it slides; 4 of 45 kg m² behind the cut: its torque comes a main step late
    parted, _ = run_parted(driving_and_turning, 1.6, hub_inertia)
    for channel in (
        "speed",
        "yaw_rate",
        "joint_angle",
        "wheel_rate_fl",
        "wheel_rate_rr",
        "wheel_load_rl",
        "pressure_a",
    ):
        column = CHANNELS.index(channel)
        error = parted[:, column] - whole[:, column]
        assert np.sqrt(np.mean(error**2)) <= tolerance * np.ptp(whole[:, column]), channel


def test_no_brake_is_left_in_the_bodies() -> None:
    # a parking brake on this side of the cut would stop 12 kN m of torque; here the command means nothing
    twin = HubDrivenTwin()
    twin.set_hubs([1000.0] * 4, 167.0)
    twin.step({"parking_brake": 1.0, "gear": 3.0, "drive_signal": -1.0}, 1.0)
    other = HubDrivenTwin()
    other.set_hubs([1000.0] * 4, 167.0)
    other.step({}, 1.0)
    assert twin.output("speed")[0] == other.output("speed")[0]
    assert twin.output("speed")[0] > 0.2


def test_torques_accelerate_mass_and_wheels() -> None:
    """(m + 4 J/r²) a = 4 T/r − c m g on the level, with r between the rolling and the unloaded radius."""
    machine = Machine.load("aoro")
    twin, torque = HubDrivenTwin(machine=machine), 2000.0
    twin.set_hubs([torque] * 4, 167.0)
    twin.step({}, 7.0)  # until the frames hardly swing any more
    before = twin.output("speed")[0]
    twin.step({}, 1.0)
    acceleration = float(twin.output("speed")[0] - before)
    mass, radius = float(machine.mass), float(machine.tire.radius)
    weights = 9.81 * mass
    bounds = [
        (4.0 * torque / r - float(machine.tire.rolling_resistance) * weights)
        / (mass + 4.0 * float(machine.wheel.inertia_spin) / r**2)
        for r in (radius, 0.9 * radius)
    ]
    assert (1.0 - 2e-4) * bounds[0] <= acceleration <= bounds[1]


def test_reset_holds_the_machine_on_a_slope() -> None:
    twin = HubDrivenTwin(2, terrain=Plane(slope_deg=np.array([0.0, 8.0])))
    assert np.all(np.abs(twin.hub_torques[:, 0]) < 50.0)
    assert np.all(np.abs(twin.hub_torques[:, 1]) > 500.0)
    twin.step({}, 1.0)
    assert np.all(np.abs(twin.output("position_x")) < 0.02)


def test_copy_goes_on_to_the_bit() -> None:
    twin = HubDrivenTwin()
    twin.set_hubs([700.0, 800.0, 900.0, 1000.0], 160.0)
    twin.step({"steering_signal": 0.3}, 0.1)
    copy = pickle.loads(pickle.dumps(twin))
    for one in (twin, copy):
        one.step({}, 0.1)
    assert np.array_equal(twin.state.numpy(), copy.state.numpy())
    assert np.array_equal(twin.wheel_rates, copy.wheel_rates)
    assert copy.engine_speed[0] == np.float32(160.0)


def test_mean_torque_over_several_steps() -> None:
    # the same rates over four main steps, at once and one by one
    once, single = Driveline(), Driveline()
    for driveline in (once, single):
        driveline.set_commands({"drive_signal": 0.5})
    torque, _ = once.step([0.0] * 4, 0.0, 4)
    parts = [single.step([0.0] * 4, 0.0)[0] for _ in range(4)]
    assert np.allclose(torque, np.mean(parts, axis=0), rtol=1e-5, atol=1e-3)
    assert once.output("drive_pressure_forward") == single.output("drive_pressure_forward")


def test_refusals() -> None:
    twin, driveline = HubDrivenTwin(), Driveline()
    with pytest.raises(ValueError, match=r"torque has shape \(3,\)"):
        twin.set_hubs([0.0] * 3, 100.0)
    with pytest.raises(ValueError, match="torque"):
        twin.set_hubs([np.nan] * 4, 100.0)
    with pytest.raises(ValueError, match="engine_speed"):
        twin.set_hubs([0.0] * 4, -1.0)
    with pytest.raises(ValueError, match="no command 'steering_signal' of a driveline"):
        driveline.set_commands({"steering_signal": 0.0})
    with pytest.raises(ValueError, match="rates"):
        driveline.step([np.inf] * 4, 0.0)
    with pytest.raises(ValueError, match="hub_inertia"):
        Driveline(hub_inertia=-1.0)


def test_names_that_stand_for_others_must_be_there() -> None:
    with pytest.raises(NameError, match="advance knows nothing by the name of no_such_law"):
        with_others(advance, {"no_such_law": None})
