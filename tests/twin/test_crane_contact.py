"""A log in a crane's grapple on the ground: what it does to joints and frame by its power, and statics."""

# Device code and records: their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false, reportGeneralTypeIssues=false
import numpy as np
import pytest
import warp as wp

from aoro_gym import Twin
from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP, VehicleCrane, moments_of_log
from aoro_gym.twin.frame_cranes import pack_on_frame
from aoro_gym.twin.kernels.crane_on_frame import FrameCrane
from aoro_gym.twin.physics.crane import crane_motion, held_log, place_of_tip, pushed, slewed
from aoro_gym.twin.records import WHEELS
from aoro_gym.units import GRAVITY

STATES = 200
MASS, LENGTH, DIAMETER = 180.0, 4.0, 0.26
VEHICLE = VehicleCrane()


@wp.kernel(enable_backward=False)
def powers(
    cranes: wp.array(dtype=FrameCrane), joints: wp.array(dtype=wp.vec4), rates: wp.array(dtype=wp.vec4),
    linear: wp.array(dtype=wp.vec3), angular: wp.array(dtype=wp.vec3), forces: wp.array(dtype=wp.vec3),
    out: wp.array2d(dtype=float),
):  # fmt: skip
    t = wp.tid()
    chain = cranes[0].chain
    chain.held_mass = 180.0
    chain.held_yaw = 0.4
    chain.held_inertia_axial = cranes[0].folded_mass
    chain.held_inertia_transverse = cranes[0].folded_moment[0]
    at = crane_motion(chain, joints[t], rates[t], angular[t])
    tip, slopes = place_of_tip(chain, joints[t])
    along, below = held_log(chain, joints[t][0])
    point = tip + below + along
    velocity = (
        linear[t] + wp.cross(angular[t], point) + slopes * rates[t] + slewed(rates[t][0], point - tip)
    )  # fmt: skip
    moment = wp.cross(point, forces[t])
    torque = pushed(at, chain.foot, forces[t], moment)
    out[0, t] = wp.dot(forces[t], velocity)
    out[1, t] = wp.dot(forces[t], linear[t]) + wp.dot(moment, angular[t]) + wp.dot(torque, rates[t])
    out[2, t] = wp.length(tip - at.tip)
    out[3, t] = wp.length(along)
    out[4, t] = -below[2]


def test_a_force_on_the_log_does_the_same_power_on_its_place_as_on_frame_and_joints():
    """In random poses and motions; and the log's ends and lower side are those of its moments of inertia. Rounding of
    float32: 1e-5 of the sum of the parts' magnitudes, some 1e5 W."""
    rng = np.random.default_rng(4)
    records = pack_on_frame(VEHICLE)
    axial, across = moments_of_log(MASS, LENGTH, DIAMETER)
    records["folded_mass"], records["folded_moment"][:, 0] = axial, across
    joints = rng.uniform((-3.0, -0.4, -2.4, 0.0), (3.0, 1.3, -0.1, 1.6), (STATES, 4))

    def on_device(values, kind):
        return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=kind, device="cpu")

    out = wp.zeros((5, STATES), dtype=float, device="cpu")
    wp.launch(
        powers, STATES,
        [
            wp.array(records, dtype=FrameCrane, device="cpu"), on_device(joints, wp.vec4),
            on_device(rng.normal(size=(STATES, 4)), wp.vec4), on_device(rng.normal(size=(STATES, 3)), wp.vec3),
            on_device(rng.normal(size=(STATES, 3)), wp.vec3), on_device(1e4 * rng.normal(size=(STATES, 3)), wp.vec3), out,
        ],
        device="cpu",
    )  # fmt: skip
    direct, parts, off, half, below = out.numpy().astype(float)
    assert np.abs(direct - parts).max() < 1.0
    assert np.abs(direct).max() > 1e4
    assert off.max() < 1e-5
    np.testing.assert_allclose(half, 0.5 * LENGTH, rtol=1e-5)
    np.testing.assert_allclose(below, GRAPPLE_DROP + 0.5 * DIAMETER, rtol=1e-5)


def lowered(**arguments) -> Twin:
    """A twin whose boom has pressed a log on the ground, ahead and to the left, and rests."""
    twin = Twin(crane=VehicleCrane(**arguments))
    twin.crane.grasp(MASS, LENGTH, DIAMETER, yaw=0.4)
    place = VEHICLE.at_foot([4.0, 1.0, GRAPPLE_DROP + 0.5 * DIAMETER + 0.1])
    twin.crane.place(VEHICLE.crane.joints_at(place, 0.3))
    twin.step({"parking_brake": 1.0}, 1.0)
    twin.step({"crane_lift": -0.3}, 1.5)
    twin.step({"crane_lift": 0.0}, 2.0)
    return twin


def lower_side(twin: Twin) -> float:
    """Height [m] of the log's lower side over the level ground, of a machine that hardly leans."""
    x, y, z = twin.crane.tip[:, 0]
    pitch, roll = float(twin.output("pitch")[0]), float(twin.output("roll")[0])
    return float(twin.output("position_z")[0] + z - x * pitch + y * roll - GRAPPLE_DROP - 0.5 * DIAMETER)


def test_the_ground_bears_a_log_and_what_the_crane_presses():
    """Loads of the wheels and of the log are the weight of all; the load cell feels what the ground bears beyond log and
    grapple; the log sinks by force over stiffness. Means over a second in which the machine hardly rocks.

    Without contact the log goes through the ground.
    """
    twin = lowered()
    trace = twin.step({}, 1.0, sample_every=0.01)
    wheels = sum(float(trace[f"wheel_load_{wheel}"].mean()) for wheel in WHEELS)
    ground, tip = float(trace["crane_ground_force"].mean()), float(trace["crane_tip_load"].mean())
    assert ground > 2000.0
    assert wheels + ground == pytest.approx(GRAVITY * (float(twin.machine.mass) + MASS), rel=1e-3)
    hanging = GRAVITY * (300.0 + MASS)
    # the log's friction on the ground is not along the weight: 5 % of it
    assert tip == pytest.approx(abs(ground - hanging), abs=0.05 * ground)
    depth = ground / (3.0 * float(VEHICLE.mount.contact.stiffness))
    assert lower_side(twin) == pytest.approx(-depth, abs=0.01)
    through = lowered(log_contact=False)
    assert through.output("crane_ground_force")[0] == 0.0
    assert lower_side(through) < lower_side(twin) - 0.05


def test_a_log_in_the_air_moves_as_without_contact():
    """To the bit; and a crane without a log feels no ground."""
    twins = [Twin(crane=VehicleCrane(start=(0.0, 0.61, -1.2, 0.0), log_contact=contact)) for contact in (True, False)]
    for twin in twins:
        twin.crane.grasp(MASS, LENGTH, DIAMETER)
        twin.step({"crane_lift": 0.5, "crane_slew": 0.3}, 0.5)
        assert twin.output("crane_ground_force")[0] == 0.0
    assert twins[0].state.numpy().tobytes() == twins[1].state.numpy().tobytes()
