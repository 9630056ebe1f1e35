"""The joint as a controller knows it: :mod:`aoro_gym.envs.core.joint` for one sub-environment."""

import warp as wp

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.envs.core.kernels.step import StepMemory
from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.joint_angle import JointAngleMemory, joint_angle_memory, joint_angle_shown
from aoro_gym.sensors.kernels.noise import constants
from aoro_gym.twin.records import Output

ZERO = wp.constant(wp.float64(0.0))


@wp.struct
class JointMemory:
    """Sensors of N sub-environments, with their last samples."""

    sensor: JointAngleMemory
    scale: wp.array(dtype=wp.float64)  # (N,) of the noise
    ages: wp.array(dtype=wp.float64)  # (F,) [s] of a step's samples
    slope: wp.array(dtype=wp.float64)  # (kept,) [1/s]
    angles: wp.array2d(dtype=wp.float64)  # (kept, N) [rad] newest first


def joint_memory(joint: MeasuredJoint, arrays: Arrays) -> JointMemory:
    """The memory of ``joint``, shared."""
    out = JointMemory()
    out.sensor = joint_angle_memory(joint._sensor, arrays)
    out.scale, out.angles = arrays.shared(joint.scale), arrays.shared(joint._angles)
    out.ages, out.slope = constants(arrays, arrays.host(joint._ages)), constants(arrays, joint._weights)
    return out


@wp.func
def shown_joint(j: JointMemory, i: int, true: wp.float64, time: wp.float64):
    """What is measured of the angle ``true`` [rad] at ``time`` [s]."""
    return true + j.scale[i] * (joint_angle_shown(j.sensor, i, true, time) - true)


@wp.func
def sense_joint(m: StepMemory, j: JointMemory, i: int, time: wp.float64):
    """Samples over a step that ended at ``time`` [s]."""
    kept = j.angles.shape[0]
    frames = m.outputs.shape[0]
    for k in range(kept):
        row = kept - 1 - k
        if row >= frames:
            j.angles[row, i] = j.angles[row - frames, i]
    for row in range(wp.min(frames, kept)):
        frame = frames - 1 - row
        true = wp.float64(m.outputs[frame, Output.JOINT_ANGLE, i])
        j.angles[row, i] = shown_joint(j, i, true, time - j.ages[frame])


@wp.func
def rest_joint(j: JointMemory, i: int, angle: wp.float64):
    """The joint rests at ``angle`` [rad]."""
    shown = shown_joint(j, i, angle, ZERO)
    for k in range(j.angles.shape[0]):
        j.angles[k, i] = shown


@wp.func
def joint_rate(j: JointMemory, i: int):
    """Slope of the line through the last measured angles [rad/s]."""
    rate = wp.float64(0.0)
    for k in range(j.slope.shape[0]):
        rate += j.slope[k] * j.angles[k, i]
    return rate
