"""The crane's law against MuJoCo: on a frame that moves freely, in random states, under random torques."""

# Device code and records: their types are Warp's, not Python's. MuJoCo takes its names from a compiled module at run time.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false
import mujoco
import numpy as np
import warp as wp

from aoro_gym.machine.crane import Crane, forwarder_crane
from aoro_gym.recording.commands import JOINTS
from aoro_gym.twin.cranes import pack
from aoro_gym.twin.physics.bodies import add, rigid_body
from aoro_gym.twin.physics.crane import CraneRecord, carried_by_frame, crane_motion, joint_acceleration
from tests.oracles.mujoco_model import crane_bodies

STATES = 200
FOOT = (0.9, 0.1, 1.1)
FRAME = (4000.0, (0.3, -0.1, 0.9), (1400.0, 2200.0, 1900.0))
"""Mass [kg], CoG [m] and moments of inertia [kg m²] of the frame."""
ROUNDING = 5e-5
"""As tests/twin/physics/test_bodies.py has it, n · ε · κ = 10 · 6e-8 · 70, of the largest acceleration in its own unit."""


@wp.kernel(enable_backward=False)
def solve(
    cranes: wp.array(dtype=CraneRecord), q: wp.array(dtype=wp.vec4), rates: wp.array(dtype=wp.vec4),
    omega: wp.array(dtype=wp.vec3), torque: wp.array(dtype=wp.vec4), mass: float, cog: wp.vec3, moments: wp.vec3,
    angular: wp.array(dtype=wp.vec3), linear: wp.array(dtype=wp.vec3), joints: wp.array(dtype=wp.vec4),
    tips: wp.array(dtype=wp.vec3),
):  # fmt: skip
    t = wp.tid()
    at = crane_motion(cranes[0], q[t], rates[t], omega[t])
    inertia = wp.diag(moments)
    frame = rigid_body(mass, inertia, cog)
    frame.f = mass * wp.cross(omega[t], wp.cross(omega[t], cog))
    frame.n = wp.cross(omega[t], inertia * omega[t]) + wp.cross(cog, frame.f)
    both = add(frame, carried_by_frame(at, torque[t]))
    b_c = both.b * wp.inverse(both.c)
    turning = wp.inverse(both.a - b_c * wp.transpose(both.b)) * (b_c * both.f - both.n)
    moving = -(wp.inverse(both.c) * (both.f + wp.transpose(both.b) * turning))
    angular[t] = turning
    linear[t] = moving
    joints[t] = joint_acceleration(at, torque[t], turning, moving)
    tips[t] = at.tip


def model(crane: Crane) -> mujoco.MjModel:
    """The crane on a frame that floats."""
    moments = " ".join(map(str, FRAME[2]))
    frame = f'<inertial mass="{FRAME[0]}" pos="{" ".join(map(str, FRAME[1]))}" diaginertia="{moments}"/>'
    text = f"""
<mujoco><compiler angle="radian" autolimits="false" boundmass="0"/><option gravity="0 0 -9.81"/>
<worldbody><body name="frame"><freejoint/>{frame}{crane_bodies(crane, FOOT)}</body></worldbody></mujoco>"""
    return mujoco.MjModel.from_xml_string(text)


def test_accelerations_of_frame_and_joints_equal_mujoco():
    crane, rng = forwarder_crane(), np.random.default_rng(5)
    q = rng.uniform((-3.0, -0.5, -2.6, 0.0), (3.0, 1.4, 0.0, 1.6), (STATES, 4))
    rates, omega = rng.normal(0.0, (0.6, 0.5, 0.7, 0.5), (STATES, 4)), rng.normal(0.0, 0.5, (STATES, 3))
    torque = rng.normal(0.0, (2e4, 6e4, 3e4, 1e4), (STATES, 4))
    records = pack(crane)
    records["foot"] = FOOT
    angular, linear, tips = (wp.zeros(STATES, dtype=wp.vec3, device="cpu") for _ in range(3))
    joints = wp.zeros(STATES, dtype=wp.vec4, device="cpu")

    def on_device(values, kind):
        return wp.array(values.astype(np.float32), dtype=kind, device="cpu")

    wp.launch(
        solve, STATES,
        [
            wp.array(records, dtype=CraneRecord, device="cpu"), on_device(q, wp.vec4), on_device(rates, wp.vec4),
            on_device(omega, wp.vec3), on_device(torque, wp.vec4), FRAME[0], wp.vec3(*FRAME[1]), wp.vec3(*FRAME[2]),
            angular, linear, joints, tips,
        ],
        device="cpu",
    )  # fmt: skip
    other = model(crane)
    data, names = mujoco.MjData(other), [other.joint(name) for name in JOINTS]
    found = np.concatenate([linear.numpy(), angular.numpy(), joints.numpy()], axis=1)
    expected, places = np.empty_like(found), np.empty((STATES, 3))
    for k in range(STATES):
        data.qpos[:7], data.qvel[:3], data.qvel[3:6] = (0, 0, 0, 1, 0, 0, 0), 0.0, omega[k]
        for i, joint in enumerate(names):
            data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = q[k, i], rates[k, i]
            data.qfrc_applied[joint.dofadr[0]] = torque[k, i]
        mujoco.mj_forward(other, data)
        expected[k] = data.qacc
        places[k] = data.body("tip").xpos
    expected[:, 2] += 9.81  # without gravity, as the law has it
    size = np.abs(expected).max(axis=1, keepdims=True)
    assert np.abs(found - expected).max() <= ROUNDING * size.max()
    assert (np.abs(found - expected) / size).max() <= 10.0 * ROUNDING
    np.testing.assert_allclose(tips.numpy(), places, atol=3e-6)
    np.testing.assert_allclose(tips.numpy().T, crane.tip(q.T) + np.array(FOOT)[:, None], atol=3e-6)
