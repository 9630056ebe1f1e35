"""Kinematics: how velocities move the pose, and how fast the wheels turn on their arms."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.kernels.state import Pose, Velocity
from aoro_gym.twin.physics.bodies import Accelerations


@wp.func
def turn(q: wp.quat, omega: wp.vec3, dt: float):
    """Quaternion after turning at body rate ``omega`` for ``dt`` (second order)."""
    half = 0.5 * dt
    return wp.normalize(q * wp.quat(half * omega[0], half * omega[1], half * omega[2], 1.0))


@wp.func
def drift(pose: Pose, velocity: Velocity, rotation: wp.mat33, dt: float):
    """Pose after moving for ``dt`` [s], but for orientation and wheels. What float32 rounds off the position is kept for
    the next time (compensated summation)."""
    shift = rotation * (dt * velocity.linear) + pose.remainder
    position = pose.position + shift
    remainder = shift - (position - pose.position)
    joint = pose.joint + dt * velocity.joint
    arms = pose.arms + dt * velocity.arms
    return Pose(position, remainder, pose.orientation, joint, arms, pose.wheels)


@wp.func
def kick(velocity: Velocity, change: Accelerations, dt: float):
    """Velocity after ``dt`` [s]."""
    out = Velocity()
    out.linear = velocity.linear + dt * change.linear
    out.angular = velocity.angular + dt * change.angular
    out.joint = velocity.joint + dt * change.joint
    out.arms = velocity.arms + dt * change.arms
    out.spins = velocity.spins + dt * change.spins
    return out


@wp.func
def rear_rate(to_rear: wp.mat33, velocity: Velocity):
    """Angular velocity [rad/s] of the rear frame, in its own axes."""
    return to_rear * velocity.angular - velocity.joint * wp.vec3(0.0, 0.0, 1.0)


@wp.func
def rear_rate_change(to_rear: wp.mat33, velocity: Velocity, change: Accelerations):
    """How ``to_rear`` ω changes [rad/s²] as the front frame and the joint turn.

    Without the joint's acceleration, which no wheel feels: it turns the frames about z.
    """
    z_axis = wp.vec3(0.0, 0.0, 1.0)
    return to_rear * change.angular + velocity.joint * wp.cross(z_axis, to_rear * velocity.angular)


@wp.func
def wheel_rates(omega: wp.vec3, omega_rear: wp.vec3, arm_rate: wp.vec4, spin: wp.vec4):
    """Wheel rates [rad/s] relative to the arms, from the absolute spins: ω_w = Ω − ω_y ± φ̇."""
    return wp.vec4(
        spin[0] - omega[1] + arm_rate[0],
        spin[1] - omega[1] + arm_rate[1],
        spin[2] - omega_rear[1] - arm_rate[2],
        spin[3] - omega_rear[1] - arm_rate[3],
    )
