"""The laws of joint, mount, tires and ground in the whole twin: what each changes of a turn, drives, rest, and stability."""

from __future__ import annotations

import numpy as np
import pytest

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import State
from aoro_gym.twin.twin import Twin
from tests.twin.rig import drive, states

LAWS = ("friction", "mount", "swivel", "slip", "soft_ground")
CHOSEN = [(law, option) for law in LAWS for option in OPTIONS[law][1:]]
"""What twins 1 … 8 obey; twin 0 has the default laws."""
NAMES = [f"{law}: {option}" for law, option in CHOSEN]


@pytest.fixture(scope="module")
def batch(machine: Machine) -> Machine:
    """A machine whose mount gives way, by every option of the laws."""
    options = {law: [OPTIONS[law][0]] + [o if law == own else OPTIONS[law][0] for own, o in CHOSEN] for law in LAWS}
    return machine.set({"joint.compliance": 1.5e-7}).with_laws(**options)


@pytest.fixture(scope="module")
def turns(batch: Machine):
    """Full turns to the left on soft ground: a frame a centisecond."""
    twin = Twin(batch.num_variants, machine=batch, terrain=Plane(rolling_resistance=5.0))
    twin.reset(joint_angle=-batch.joint.range)
    log = drive(twin, (0.2, {}), (2.3, {"steering_signal": 1.0}), sample_every=0.01)
    assert not twin.diverged
    return log


@pytest.mark.parametrize("number", range(1, len(CHOSEN) + 1), ids=NAMES)
def test_every_law_shows_in_a_turn_that_the_valve_still_paces(turns, number: int) -> None:
    """The valve meters the flow, so a turn takes as long whatever resists it, but for what oil and mount give way: at
    50 bar 0.3 % of the chambers' 5 L, and 1.5e-7 rad/(N m) · 8 kN m of 1.4 rad."""
    angle = turns["joint_angle"]
    across = [np.interp(0.5, angle[:, twin], turns.time) - 0.2 for twin in (0, number)]
    assert across[1] == pytest.approx(across[0], rel=0.02)
    rate = turns["joint_rate"]
    assert np.abs(rate[:, number] - rate[:, 0]).max() > 1e-4 * np.ptp(rate[:, 0])


@pytest.mark.parametrize("option", OPTIONS["swivel"][1:])
def test_a_turn_has_to_slide_the_tires_that_swivel(machine: Machine, turns, option: str) -> None:
    """Four wheels swivel at half the joint's rate, so the joint bears twice one wheel's torque M. They slide by no more than
    M = μ F_n r, less what rolling on their arcs renews: between 0.4 and 1 of it."""
    number = 1 + CHOSEN.index(("swivel", option))
    tire, friction = machine.tire, machine.tire.friction_static
    depth = 24.5e3 / tire.stiffness - np.array([0.0, tire.disc_drop_inner, tire.disc_drop_outer])
    shares = np.array([1.0, 2.0, 2.0]) * depth / (depth * [1.0, 2.0, 2.0]).sum()
    discs = float(shares[1] * tire.disc_offset_inner + shares[2] * tire.disc_offset_outer)
    lever = discs if option == "five_discs" else tire.bore_radius
    bore, annulus = machine.steering.cylinder.bore_area, machine.steering.cylinder.annulus_area
    middle = (turns.time > 0.8) & (turns.time < 1.6)
    linkage = machine.steering.cylinder.linkage
    torque = (turns["pressure_a"] - turns["pressure_b"])[middle] * (bore + annulus) * linkage.mean_lever
    added = (torque[:, number] - torque[:, 0]).mean()
    sliding = 2.0 * friction * 24.5e3 * lever
    assert 0.4 * sliding < added < sliding


def test_every_law_drives_up_a_slope(batch: Machine) -> None:
    """Across and up, turning meanwhile: as fast as by the default laws."""
    twin = Twin(batch.num_variants, machine=batch, terrain=Plane(slope_deg=10.0, rolling_resistance=3.0))
    log = drive(twin, (2.5, {"drive_signal": 0.7}), (1.0, {"steering_signal": 0.6}), sample_every=0.05)
    assert not twin.diverged
    end = log.wheels("wheel_rate")[-5:].mean(axis=(0, 1))
    assert end[0] > 1.0
    np.testing.assert_allclose(end, end[0], rtol=0.05)


def test_at_rest_on_a_slope_nothing_gathers_speed(batch: Machine) -> None:
    """Parked across a slope with a bent joint: reset leaves it at rest by every law, and what moves dies out.

    The joint goes on with the oil that leaks from its loaded port, ever slower.
    """
    twin = Twin(batch.num_variants, machine=batch, terrain=Plane(slope_deg=12.0))
    twin.reset(joint_angle=0.3, heading=0.8)
    start, speeds = states(twin), []
    moving = [*range(State.VX, State.VZ + 1), State.JOINT_RATE]
    for _ in range(40):
        twin.step({"parking_brake": 1.0}, 0.1)
        speeds.append(np.abs(states(twin)[moving]).max(axis=0))
    early, late = np.max(speeds[:10], axis=0), np.max(speeds[-10:], axis=0)
    assert np.all(early < 1e-3)
    assert np.all(late < 0.75 * early)
    moved = np.abs(states(twin) - start)
    assert np.all(moved[State.JOINT] < 2e-3)
    assert np.all(moved[State.X : State.Z + 1] < 0.02)


def test_reset_bears_the_joint_by_each_law(machine: Machine) -> None:
    """Across a slope the cylinders bear what they bear by the default laws, T = k b of the linear mount: a hardening one
    bends by the root of k b (1 + b/2b₀) = T, and where friction does not stick, oil holds T = p_A dV_A/dθ + p_B dV_B/dθ.
    """
    angle = 0.3
    soft = machine.set({"joint.compliance": 5e-7, "joint.hardening_angle": 0.001})
    several = soft.with_laws(
        friction=["presliding", "lugre", "stribeck_tanh", "coulomb_viscous", "presliding"],
        mount=[*["linear"] * 4, "hardening"],
    )
    twin = Twin(5, machine=several, terrain=Plane(slope_deg=20.0))
    twin.reset(joint_angle=angle, heading=0.8)
    state = states(twin)
    bend, torque = state[State.MOUNT], state[State.MOUNT, 0] / 5e-7
    assert abs(torque) > 500.0
    np.testing.assert_array_equal(bend[:4], bend[0])
    assert abs(bend[4]) == pytest.approx(0.001 * (np.sqrt(1.0 + 2.0 * abs(bend[0]) / 0.001) - 1.0), rel=1e-6)
    cylinder, step = machine.steering.cylinder, 1e-5
    lever_right, lever_left = (
        (cylinder.linkage.extension(at + step) - cylinder.linkage.extension(at - step)) / (2.0 * step)
        for at in (angle, -angle)
    )
    swept_a = cylinder.bore_area * lever_right + cylinder.annulus_area * lever_left
    swept_b = -cylinder.bore_area * lever_left - cylinder.annulus_area * lever_right
    oil = state[State.PORT_A] * swept_a + state[State.PORT_B] * swept_b
    np.testing.assert_allclose(oil[2:4], torque, rtol=1e-4)
    assert np.all(np.abs(oil[[0, 1, 4]]) < 0.9 * abs(torque))
    held = -machine.joint.presliding_stiffness * state[State.JOINT_FRICTION]
    np.testing.assert_allclose(oil + held, torque, rtol=1e-4)
    np.testing.assert_array_equal(held[2:4], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("main_step", [1e-3, 2e-3])
@pytest.mark.parametrize("substeps", [15, 30])
def test_no_machine_of_any_laws_diverges(machine: Machine, substeps: int, main_step: float) -> None:
    """200 machines within half their ranges, half of them on mounts: turns, drives and stops on slopes of soft ground."""
    rng = np.random.default_rng(3)
    drawn = machine.sample(200, laws="any", parameters=0.5, seed=46)
    drawn = drawn.set({"joint.compliance": np.where(rng.random(200) < 0.5, 0.0, rng.uniform(0.0, 5e-7, 200))})
    ground = Plane(slope_deg=6.0, rolling_resistance=rng.uniform(1.0, 10.0, 200), friction=rng.uniform(0.3, 1.0, 200))
    twin = Twin(200, machine=drawn, terrain=ground, main_step=main_step, substeps=substeps, check_step=False)
    twin.reset(joint_angle=-drawn.joint.range)
    phases = (
        (1.5, {"steering_signal": 1.0}),
        (1.5, {"steering_signal": -1.0, "drive_signal": 1.0}),
        (0.5, {"drive_signal": 0.0, "steering_signal": 0.0}),
        (0.5, {"parking_brake": 1.0}),
    )
    log = drive(twin, *phases, sample_every=0.02)
    assert not twin.diverged
    assert np.abs(log["joint_rate"]).max() < 5.0
    assert np.abs(log.wheels("wheel_rate")).max() < 30.0
