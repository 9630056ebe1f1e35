"""What a vehicle measures, and where it is on its path, where a Kalman filter estimates its pose.

It takes so many registers that without it a GPU senses many more vehicles at once; so its kernels are apart.
"""

import warp as wp

from aoro_gym.envs.core.kernels.step import StepMemory, begin_step, beginning
from aoro_gym.envs.path_tracking.kernels.judge import tell
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing, Told, Vehicle
from aoro_gym.envs.path_tracking.kernels.sense import (
    begin_to_follow,
    follow,
    front_axle,
    read_at_rest,
    read_sensors,
)
from aoro_gym.sensors.kernels.pose_filter import begin_filter, filter_pose


@wp.func
def measured_rates(s: Sensing, i: int):
    """Measured angular velocity [rad/s]."""
    return wp.vec3d(s.rates[i, 0], s.rates[i, 1], s.rates[i, 2])


@wp.kernel(enable_backward=False, module="aoro_gym.envs.path_tracking.kernels.filtered")
def sense_filtered(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules):
    """Read all sensors at the end of the step, and find the vehicles on their paths."""
    i = wp.tid()
    fix = read_sensors(m, v, s, d, i, begin_step(m, i))
    filter_pose(s.filter, i, fix, s.roll[i], s.pitch[i], measured_rates(s, i), front_axle(v, i), s.speed[i])
    follow(m, c, v, s, d, r, i)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.path_tracking.kernels.filtered")
def rest_filtered(m: StepMemory, c: Courses, k: Control, v: Vehicle, s: Sensing, d: Driving, r: Rules, t: Told):
    """First measurements of the vehicles whose episodes begin, at rest, and what is told of them."""
    i = beginning(m, wp.tid())
    if i >= 0:
        fix = read_at_rest(m, v, s, i)
        begin_filter(s.filter, i, fix, s.roll[i], s.pitch[i], measured_rates(s, i), front_axle(v, i))
        begin_to_follow(m, c, v, s, d, r, i)
        tell(m, k, s, d, t, i)
