"""The MuJoCo vehicle has the machine's bodies, stands as the twin stands, and drives."""

# MuJoCo takes its names from a compiled module at run time.
# pyright: reportAttributeAccessIssue=false
import mujoco
import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.benchmark.scene import CELL, SIDE, heights, starts
from aoro_gym.benchmark.vehicle import RIM_SPEED, SERVO_LAG, STEERING_RATE, controls, load, mjcf, poses
from tests.oracles.mujoco_model import MujocoMachine

FIELD = heights("raster")
LEVEL = heights("plane")

SINK = 0.004
"""[m] A wheel sinks in by r = (1 - d) a / (d k): impedance d of 0.9 and more, k = 1 / (0.95 x 0.02 s)² = 2770 1/s² (MuJoCo's
defaults), and a, what its load would do to a wheel with its motor alone: 29 kN / 340 kg at most. That makes 3.4 mm."""


def settled(model, seconds=3.0, control=None):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    if control is not None:
        data.ctrl[:] = control
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return data


def test_mass_matrix_is_the_oracles(machine):
    """Another writing of the same bodies, which the twin is held against: at rest, and with all angles moved."""
    model, oracle = load(machine, LEVEL, CELL), MujocoMachine(machine).model
    assert [model.joint(i).name for i in range(model.njnt)] == [oracle.joint(i).name for i in range(oracle.njnt)]
    rng = np.random.default_rng(0)
    rest = model.key("rest").qpos
    for qpos in (rest, rest + np.concatenate([np.zeros(7), rng.uniform(-0.4, 0.4, 9)])):
        kinetic = []
        for m in (model, oracle):
            data = mujoco.MjData(m)
            data.qpos[:] = qpos
            rates = np.random.default_rng(1).normal(size=(20, m.nv))
            mujoco.mj_forward(m, data)
            momentum = np.zeros((20, m.nv))
            for rate, row in zip(rates, momentum, strict=True):
                mujoco.mj_mulM(m, data, row, rate)
            kinetic.append(momentum)
        # nine digits in the text of the model
        np.testing.assert_allclose(kinetic[0], kinetic[1], rtol=1e-7, atol=1e-7 * np.abs(kinetic[1]).max())
    assert model.body_mass.sum() == pytest.approx(machine.mass, rel=1e-8)
    assert model.nv == 15 and model.nu == 5
    assert (model.hfield_nrow[0], model.hfield_ncol[0], model.opt.timestep) == (256, 256, 1e-3)


def test_stands_as_the_twin_stands(machine):
    model = load(machine, LEVEL, CELL)
    data = settled(model)
    rest = machine.rest
    assert abs(data.qpos[2]) < SINK
    for name, angle in (("fl", rest.arm_angle_front), ("rr", rest.arm_angle_rear)):
        assert data.joint(f"arm_{name}").qpos[0] == pytest.approx(angle, abs=SINK / machine.arm.length)
    assert np.abs(data.qvel).max() < 1e-3
    assert [contact.friction[0] for contact in data.contact] == pytest.approx(
        [machine.tire.friction_coulomb] * data.ncon
    )
    normal = [data.efc_force[4 * i : 4 * i + 4].sum() for i in range(data.ncon)]
    assert sum(normal) == pytest.approx(machine.mass * 9.81, rel=1e-3)
    twin = Twin(machine=machine)
    trace = twin.step({}, 3.0, sample_every=3.0)
    assert trace is not None
    # the twin's arms give way by the oil they seal in and leak: less than a centimetre
    assert data.qpos[2] == pytest.approx(float(trace["position_z"][-1, 0]), abs=SINK + 0.01)


def test_drives_and_steers_as_the_signals_say(machine):
    model = load(machine, LEVEL, CELL)
    ahead = settled(model, 4.0, controls(model, np.array([[0.0], [1.0]]))[0])
    # rolling on the loaded radius, which is a tenth smaller at most, and lagging by less than a servo that gives all
    assert 0.9 * (1.0 - SERVO_LAG) * RIM_SPEED < ahead.qvel[0] < RIM_SPEED
    assert abs(ahead.qpos[1]) < 0.05
    left = settled(model, 2.0, controls(model, np.array([[0.5], [1.0]]))[0])
    turned = left.joint("joint").qpos[0]
    assert 0.5 * STEERING_RATE * (1.0 - SERVO_LAG) < turned <= machine.joint.range + 0.02
    assert left.qvel[5] > 0.05  # yaws to the left


def test_ground_lies_where_the_twins_ground_lies(machine):
    model = load(machine, FIELD, CELL)
    data = mujoco.MjData(model)
    data.qpos[2] = 100.0
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, dtype=np.int32)
    for row, column in np.random.default_rng(0).integers(1, 255, (50, 2)):
        # next to the node, for a ray along an edge may slip through; the steepest ground rises 45 degrees or so
        above = np.array([column * CELL - 0.5 * SIDE + 1e-4, row * CELL - 0.5 * SIDE + 2e-4, 50.0])
        depth = mujoco.mj_ray(model, data, above, np.array([0.0, 0.0, -1.0]), None, 1, -1, hit)
        assert above[2] - depth == pytest.approx(FIELD[row, column], abs=2e-3)


def test_starts_clear_of_the_ground(machine):
    model = load(machine, FIELD, CELL)
    data = mujoco.MjData(model)
    for pose in poses(model, FIELD, CELL, *starts(30, seed=2)):
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        assert all(contact.dist > -1e-6 for contact in data.contact[: data.ncon])


def test_one_machine_only(machine):
    with pytest.raises(ValueError, match=r"the machine has 2 variants.*give variant"):
        mjcf(machine.scale({"wheel.mass": np.array([1.0, 1.1])}), LEVEL, CELL)
