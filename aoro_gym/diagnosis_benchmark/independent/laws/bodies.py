"""Two frames in the plane, hinged: masses, yaw, the rods between them, and slope.

Axes of the rear frame: x forward, y left. With G the common centre of mass, d_r and d_f the distances of the frames'
centres from the hinge and μ = m_r m_f/(m_r + m_f):
  (I_r + μ d_r²) ω̇_r + μ d_r d_f (cos θ ω̇_f − sin θ ω_f²) = Q_r,
  (I_f + μ d_f²) ω̇_f + μ d_r d_f (cos θ ω̇_r + sin θ ω_r²) = Q_f.
By Lagrange; Wittenburg: Dynamics of Multibody Systems, 2008.
"""

from typing import Any

import warp as wp

from .geometry import vec2d, vec4d
from .layout import ANGLE, RATE_FRONT, RATE_REAR, ROD, ROD_RATE, VX, VY, WHEEL, YAW
from .numbers import HALF, ONE, ZERO, f64, play, unit


@wp.func
def rod_torque(x: Any, m: Any):
    """Torque [N m] that rods and brackets pass on to the joint: a spring and a damper with free play between."""
    stretch = x[ROD] - x[ANGLE]
    touching = unit(ONE + (wp.abs(stretch) - m.joint_play) / f64(2e-5))
    twist_rate = x[ROD_RATE] - (x[RATE_FRONT] - x[RATE_REAR])
    return m.joint_stiffness * play(stretch, m.joint_play) + m.joint_damping * twist_rate * touching


@wp.func
def stop_torque(x: Any, m: Any):
    """Torque [N m] of the cylinders' end stops: K d + C min(d/d₀, 1) ḋ, only pressing; d₀ = 0.5 mrad."""
    depth = wp.abs(x[ROD]) - m.stop_angle
    torque = ZERO
    if depth > ZERO:
        side = wp.sign(x[ROD])
        damping = m.stop_damping * unit(depth / f64(5e-4))
        torque = -side * wp.max(ZERO, m.stop_stiffness * depth + damping * side * x[ROD_RATE])
    return torque


@wp.func
def relative_velocity(x: Any, m: Any):
    """Velocity of the front frame's centre of mass against the rear one's, in the rear frame [m/s]."""
    s = wp.sin(x[ANGLE])
    c = wp.cos(x[ANGLE])
    front = m.centre_front * x[RATE_FRONT]
    return vec2d(-front * s, m.centre_rear * x[RATE_REAR] + front * c)


@wp.func
def wheel_motion(x: Any, m: Any, wheel: int):
    """Of a wheel: slip forwards R Ω − v_x, ground speed sideways and along, yaw rate; in axes of its frame."""
    relative = relative_velocity(x, m)
    side = HALF * m.track
    if wheel == 1 or wheel == 3:
        side = -side
    share = m.mass_front / (m.mass_front + m.mass_rear)
    vx = x[VX] - share * relative[0]
    vy = x[VY] - share * relative[1]
    yaw = x[RATE_REAR]
    arm = m.centre_rear - m.axle_rear
    if wheel < 2:
        s = wp.sin(x[ANGLE])
        c = wp.cos(x[ANGLE])
        wx = x[VX] + (ONE - share) * relative[0]
        wy = x[VY] + (ONE - share) * relative[1]
        vx = c * wx + s * wy
        vy = c * wy - s * wx
        yaw = x[RATE_FRONT]
        arm = m.axle_front - m.centre_front
    along = vx - yaw * side
    return vec4d(m.tire_radius * x[WHEEL + wheel] - along, vy + yaw * arm, along, yaw)


@wp.func
def kinetic_energy(x: Any, m: Any):
    """Kinetic energy [J] of frames and wheels."""
    mass = m.mass_front + m.mass_rear
    relative = relative_velocity(x, m)
    energy = mass * (x[VX] * x[VX] + x[VY] * x[VY]) + m.mass_front * m.mass_rear / mass * wp.dot(relative, relative)
    energy += m.yaw_inertia_rear * x[RATE_REAR] * x[RATE_REAR] + m.yaw_inertia_front * x[RATE_FRONT] * x[RATE_FRONT]
    for wheel in range(4):
        energy += m.wheel_inertia * x[WHEEL + wheel] * x[WHEEL + wheel]
    return HALF * energy


@wp.func
def frames(d: Any, x: Any, m: Any, rear: vec4d, front: vec4d, torque: wp.float64, cylinders: wp.float64):
    """Derivatives of the frames and the rods.

    ``rear`` and ``front``: an axle's force along and across, its moment about the axle's centre (all tires' pairs
    in it), and an outer moment. ``torque``: on the joint, of the rods less the bearing. ``cylinders``: of pressure
    and friction, on the rods.
    """
    s = wp.sin(x[ANGLE])
    c = wp.cos(x[ANGLE])
    mass = m.mass_front + m.mass_rear
    share = m.mass_front / mass
    reduced = share * m.mass_rear
    fx = c * front[0] - s * front[1]
    fy = s * front[0] + c * front[1]
    slope_x = wp.cos(x[YAW]) * m.slope_along + wp.sin(x[YAW]) * m.slope_across
    slope_y = wp.cos(x[YAW]) * m.slope_across - wp.sin(x[YAW]) * m.slope_along
    d[VX] = (rear[0] + fx) / mass + slope_x + x[RATE_REAR] * x[VY]
    d[VY] = (rear[1] + fy) / mass + slope_y - x[RATE_REAR] * x[VX]
    arm_rear = m.centre_rear - m.axle_rear
    arm_front = m.axle_front - m.centre_front
    q_rear = arm_rear * rear[1] + rear[2] + rear[3] - torque
    q_rear += m.centre_rear * ((ONE - share) * fy - share * rear[1])
    q_front = arm_front * front[1] + front[2] + front[3] + torque
    q_front += m.centre_front * ((ONE - share) * front[1] - share * (c * rear[1] - s * rear[0]))
    coupling = reduced * m.centre_rear * m.centre_front
    q_rear += coupling * s * x[RATE_FRONT] * x[RATE_FRONT]
    q_front -= coupling * s * x[RATE_REAR] * x[RATE_REAR]
    a = m.yaw_inertia_rear + reduced * m.centre_rear * m.centre_rear
    b = coupling * c
    e = m.yaw_inertia_front + reduced * m.centre_front * m.centre_front
    determinant = a * e - b * b
    d[RATE_REAR] = (e * q_rear - b * q_front) / determinant
    d[RATE_FRONT] = (a * q_front - b * q_rear) / determinant
    d[YAW] = x[RATE_REAR]
    d[ANGLE] = x[RATE_FRONT] - x[RATE_REAR]
    d[ROD] = x[ROD_RATE]
    d[ROD_RATE] = (cylinders - rod_torque(x, m) + stop_torque(x, m)) / m.rod_inertia
    return d
