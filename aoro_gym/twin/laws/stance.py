"""How a machine stands at rest on its ground: pose of the frames, angles and oil of the arms, bend of the tires.

The frames are rigid but for the joint, so they lie on the plane that fits the ground under the four wheels best; each arm
then swings until its wheel bears its share of the weight, or up to its end. Where that is not enough, over a pit or beside a
boulder, one wheel hangs, and the frames lie on the other three with their arms as at rest on level ground.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.laws.bodies import Corner, FrameBody, arm_tangent, hinge_rotation, hull_corner, wheel_centre
from aoro_gym.twin.laws.cylinders import cylinder_extension
from aoro_gym.twin.laws.ground import Footing, Ground, Planes, Site, footing, raster_height
from aoro_gym.twin.laws.tires import Tire, disc_contact
from aoro_gym.twin.records import MachineRecord

FITS = wp.constant(6)  # Newton steps of the frames' pose, then as many of frames and arms; each gains two digits or more
UP = wp.constant(wp.vec3(0.0, 0.0, 1.0))


@wp.struct
class Stance:
    """A machine at rest."""

    height: float  # [m] of the hinge's origin
    rotation: wp.quat  # front frame → world
    arm: wp.vec4  # [rad]
    bore_pressure: wp.vec4  # [Pa]
    bristle_x: wp.vec4  # [m] deflection of the tires
    bristle_y: wp.vec4


@wp.func
def upright_on(normal: wp.vec3, heading: float):
    """Rotation of a frame whose z axis is ``normal``: a turn by ``heading`` [rad] on level ground, then the tilt."""
    axis = wp.cross(UP, normal)
    tilt = wp.quat_identity()
    if wp.length(axis) > 1.0e-6:
        tilt = wp.quat_from_axis_angle(wp.normalize(axis), wp.acos(wp.clamp(normal[2], -1.0, 1.0)))
    return tilt * wp.quat_from_axis_angle(UP, heading)


@wp.func
def level_arms(m: MachineRecord):
    """Arm angles [rad] at rest on level ground."""
    return wp.vec4(m.rest.arm_angle_front, m.rest.arm_angle_front, m.rest.arm_angle_rear, m.rest.arm_angle_rear)


@wp.func
def stance(m: MachineRecord, terrain: Planes, ground: Ground, x: float, y: float, heading: float, joint: float):
    """The rest pose on level ground, laid on the plane; hinge at (x, y)."""
    out = Stance()
    under = footing(terrain, ground, wp.vec3(x, y, 0.0))
    out.height = (m.rest.height - under.normal[0] * x - under.normal[1] * y) / under.normal[2]
    out.rotation = upright_on(under.normal, heading)
    out.arm = level_arms(m)
    front = m.rest.bore_pressure_front
    rear = m.rest.bore_pressure_rear
    out.bore_pressure = wp.vec4(front, front, rear, rear)
    return out


@wp.func
def wheel_place(corner: Corner, front: FrameBody, rear: FrameBody, to_front: wp.mat33, wheel: int, angle: float):
    """Wheel centre [m], and its derivative [m/rad] with respect to the arm's angle, both in the front frame's axes."""
    side = 1.0 - 2.0 * float(wheel & 1)
    if wheel < 2:
        return wheel_centre(corner, front.pivot_x, 1.0, side, angle), arm_tangent(1.0, angle, corner.arm_length)
    centre = to_front * wheel_centre(corner, rear.pivot_x, -1.0, side, angle)
    return centre, to_front * arm_tangent(-1.0, angle, corner.arm_length)


@wp.func
def overlap(tire: Tire, under: Footing, centre: wp.vec3, axle: wp.vec3):
    """Depth [m] of an unloaded wheel under its footing; negative above it."""
    across = wp.dot(under.normal, axle)
    tilt = wp.sqrt(wp.max(1.0 - across * across, 0.0))
    distance = (centre[2] - under.height) * under.normal[2]
    return disc_contact(tire, wp.vec3(0.0, across, tilt), tire.radius * tilt - distance).depth


@wp.func
def stance(m: MachineRecord, terrain: Any, ground: Site, x: float, y: float, heading: float, joint: float):
    """Rest on the terrain around the hinge's plan position (x, y).

    Wheel loads N = α + β x + γ y are the ones of least squares that carry the weight: ΣN = W, and their centre is where
    the weight's line of action from the CoG meets the ground. On three wheels that is the only solution.
    """
    out = Stance()
    to_rear = hinge_rotation(joint)
    to_front = wp.transpose(to_rear)
    arm = level_arms(m)

    # mass and first moments at the rest pose, front axes; the ground lies rest.height below z = 0
    mass = m.frame_front.mass + m.frame_rear.mass + 4.0 * m.corner.mass
    moment = m.frame_front.mass * wp.vec3(m.frame_front.cog_x, 0.0, m.frame_front.cog_height)
    moment += to_front * (m.frame_rear.mass * wp.vec3(m.frame_rear.cog_x, 0.0, m.frame_rear.cog_height))
    for wheel in range(4):
        side = 1.0 - 2.0 * float(wheel & 1)
        lengthwise = m.corner.rho * wp.cos(arm[wheel])
        high = m.corner.pivot_height + m.corner.rho * wp.sin(arm[wheel])
        if wheel < 2:
            moment += m.corner.mass * wp.vec3(m.frame_front.pivot_x + lengthwise, side * m.corner.lateral, high)
        else:
            moment += to_front * (
                m.corner.mass * wp.vec3(m.frame_rear.pivot_x - lengthwise, side * m.corner.lateral, high)
            )
    cog = moment / mass + m.rest.height * UP

    height = raster_height(terrain, ground, x, y) + m.rest.height
    slope_x = float(0.0)
    slope_y = float(0.0)
    q = wp.quat_identity()
    load = wp.vec4()
    bent = wp.vec3()
    weight = wp.vec3()
    hanging = int(-1)
    for step in range(2 * FITS):
        q = upright_on(wp.normalize(wp.vec3(-slope_x, -slope_y, 1.0)), heading)
        rotation = wp.quat_to_matrix(q)
        weight = wp.transpose(rotation) * wp.vec3(0.0, 0.0, -ground.gravity * mass)
        bent = -weight / weight[2]
        # sums of 1, x, y and their products, over the wheels that stand
        spread = wp.mat33()
        for wheel in range(4):
            if wheel != hanging:
                centre, tangent = wheel_place(m.corner, m.frame_front, m.frame_rear, to_front, wheel, arm[wheel])
                one = wp.vec3(1.0, centre[0], centre[1])
                spread += wp.outer(one, one)
        share = wp.inverse(spread) * (
            -weight[2] * wp.vec3(1.0, cog[0] + bent[0] * cog[2], cog[1] + bent[1] * cog[2])
        )
        # by how much each wheel is too deep; as heights, and the plane through them in the world
        sums = wp.vec3()
        around = wp.mat33()
        lacking = float(0.0)
        lowest = int(-1)
        for wheel in range(4):
            centre, tangent = wheel_place(m.corner, m.frame_front, m.frame_rear, to_front, wheel, arm[wheel])
            load[wheel] = wp.where(
                wheel == hanging, 0.0, wp.max(share[0] + share[1] * centre[0] + share[2] * centre[1], 0.0)
            )
            offset = rotation * centre
            world = wp.vec3(x, y, height) + offset
            stands = raster_height(terrain, ground, world[0], world[1]) + m.tire.radius
            under = footing(terrain, ground, wp.vec3(world[0], world[1], stands))
            axle = wp.vec3(0.0, 1.0, 0.0)
            if wheel >= 2:
                axle = to_front * axle
            surplus = overlap(m.tire, under, world, rotation * axle) - load[wheel] / m.tire.stiffness
            if wheel != hanging:
                one = wp.vec3(1.0, offset[0], offset[1])
                around += wp.outer(one, one)
                sums += (surplus / under.normal[2]) * one
            if step >= FITS and hanging < 0:
                if arm[wheel] <= -m.arm.swing and surplus < lacking:
                    lacking = surplus
                    lowest = wheel
                arm[wheel] = wp.clamp(
                    arm[wheel] + surplus / wp.max(wp.dot(under.normal, rotation * tangent), 0.1 * m.corner.arm_length),
                    -m.arm.swing,
                    m.arm.swing,
                )
        plane = wp.inverse(around) * sums
        height += plane[0]
        slope_x += plane[1]
        slope_y += plane[2]
        if hanging < 0 and lowest >= 0:
            hanging = lowest
            arm = level_arms(m)
            arm[hanging] = -m.arm.swing

    # a mound between the wheels: up until nothing is pressed in deeper than at rest
    q = upright_on(wp.normalize(wp.vec3(-slope_x, -slope_y, 1.0)), heading)
    rotation = wp.quat_to_matrix(q)
    rear_rotation = rotation * to_front
    lift = float(0.0)
    for wheel in range(4):
        centre, tangent = wheel_place(m.corner, m.frame_front, m.frame_rear, to_front, wheel, arm[wheel])
        world = wp.vec3(x, y, height) + rotation * centre
        stands = raster_height(terrain, ground, world[0], world[1]) + m.tire.radius
        under = footing(terrain, ground, wp.vec3(world[0], world[1], stands))
        axle = rotation * wp.vec3(0.0, 1.0, 0.0)
        if wheel >= 2:
            axle = rear_rotation * wp.vec3(0.0, 1.0, 0.0)
        surplus = overlap(m.tire, under, world, axle) - load[wheel] / m.tire.stiffness
        lift = wp.max(lift, surplus / under.normal[2])
    for i in range(16):
        frame = m.frame_front
        turned = rotation
        if i >= 8:
            frame = m.frame_rear
            turned = rear_rotation
        world = wp.vec3(x, y, height) + turned * hull_corner(frame, m.frame_ground_clearance, i & 7)
        under = footing(terrain, ground, world)
        lift = wp.max(lift, under.height - world[2])

    out.height = height + lift
    out.rotation = q
    out.arm = arm
    for wheel in range(4):
        # the cylinder holds what the wheel's load and the corner's weight leave
        _, lever = cylinder_extension(m.arm.cylinder_linkage, -arm[wheel])
        torque = (load[wheel] * m.corner.arm_length + m.corner.mass * m.corner.rho * weight[2] / mass) * wp.cos(arm[wheel])
        out.bore_pressure[wheel] = wp.max(
            (torque / lever + m.arm.rod_rest_pressure * m.arm.cylinder_annulus_area) / m.arm.cylinder_bore_area, 0.0
        )
        # every tire holds its share of the slope
        local = bent
        if wheel >= 2:
            local = to_rear * bent
        out.bristle_x[wheel] = local[0] / m.tire.sigma0_longitudinal
        out.bristle_y[wheel] = local[1] / m.tire.sigma0_lateral
    return out
