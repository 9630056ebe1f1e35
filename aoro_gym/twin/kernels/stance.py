"""How a machine stands at rest on its ground: pose of the frames, angles and oil of the arms, bend of the tires, and what
brakes and joint hold.

The frames are rigid but for the joint, so they lie on the plane that fits the ground under the four wheels best; each arm
then swings until its wheel bears its share of the weight, or up to its end. Where that is not enough, over a pit or beside a
boulder, one wheel hangs, and the frames lie on the other three with their arms as at rest on level ground.

The wheels' contacts count, not their centres: a tire that leans by a few milliradians stands on its shoulder, centimetres
aside.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.physics.bodies import arm_tangent, hinge_rotation, hull_corner, wheel_centre
from aoro_gym.twin.physics.cylinders import cylinder_extension
from aoro_gym.twin.physics.ground import footing, ground_height, ground_level, penetration
from aoro_gym.twin.physics.tires import disc_contact
from aoro_gym.twin.records import MachineRecord

FITS = wp.constant(6)  # Newton steps of the frames' pose, then as many of frames and arms; each gains a digit or more
UP = wp.constant(wp.vec3(0.0, 0.0, 1.0))


@wp.struct
class Stance:
    """A machine at rest."""

    height: float  # [m] of the hinge's origin
    rotation: wp.quat  # front frame → world
    arm: wp.vec4  # [rad]
    bore_pressure: wp.vec4  # [Pa]
    brake: wp.vec4  # [N m] torque that holds the wheels, forward positive
    joint: float  # [N m] torque that holds the joint, left positive
    bristle_x: wp.vec4  # [m] deflection of the tires
    bristle_y: wp.vec4


@wp.func
def upright_on(normal: wp.vec3, heading: float):
    """Rotation of a frame whose z axis is ``normal``: a turn by ``heading`` [rad] on level ground, then the tilt."""
    # by half the angle between both: an arc cosine would lose small tilts in float32
    axis = wp.cross(UP, normal)
    tilt = wp.normalize(wp.quat(axis[0], axis[1], axis[2], 1.0 + normal[2]))
    return tilt * wp.quat_from_axis_angle(UP, heading)


@wp.func
def level_arms(m: MachineRecord):
    """Arm angles [rad] at rest on level ground."""
    return wp.vec4(m.rest.arm_angle_front, m.rest.arm_angle_front, m.rest.arm_angle_rear, m.rest.arm_angle_rear)


@wp.struct
class Tread:
    """How one wheel would stand at a pose of the machine."""

    place: wp.vec3  # [m] of the contact from the wheel's centre, axes of the wheel's frame
    offset: wp.vec3  # [m] of the contact from the hinge's origin, world axes
    normal: wp.vec3  # of the ground, axes of the wheel's frame
    level: float  # [-] cosine of the ground's slope
    depth: float  # [m] of the unloaded wheel under the ground, along its normal; negative above it
    rise: float  # [m/rad] of the wheel along the normal with its arm's angle


@wp.func
def half_direction(wheel: int):
    """+1 for wheels of the front half, −1 for those of the rear one."""
    return wp.where(wheel < 2, 1.0, -1.0)


@wp.func
def half_rotation(wheel: int, front: wp.mat33, rear: wp.mat33):
    """Rotation of the frame that carries the wheel."""
    if wheel < 2:
        return front
    return rear


@wp.func
def tread(m: MachineRecord, terrain: Any, ground: Any, origin: wp.vec3, rotation: wp.mat33, wheel: int, angle: float):
    """One wheel on the ground; ``rotation`` is its frame's, ``origin`` the hinge's [m]."""
    out = Tread()
    side = 1.0 - 2.0 * float(wheel & 1)
    direction = half_direction(wheel)
    pivot_x = m.frame_front.pivot_x
    if wheel >= 2:
        pivot_x = m.frame_rear.pivot_x
    centre = wheel_centre(m.corner, pivot_x, direction, side, angle)
    world = origin + rotation * centre
    # asked from where the wheel would stand, not from where this pose has it: rays find the surface below it
    stands = ground_level(terrain, ground, world[0], world[1]) + m.tire.radius
    under = footing(terrain, ground, wp.vec3(world[0], world[1], stands))
    n = wp.transpose(rotation) * under.normal
    middle = m.tire.radius * wp.sqrt(n[0] * n[0] + n[2] * n[2]) + penetration(under, world)
    touch = disc_contact(m.tire, n, middle)
    out.place = touch.place
    out.offset = rotation * (centre + touch.place)
    out.normal = n
    out.level = under.normal[2]
    out.depth = touch.depth
    out.rise = wp.dot(n, arm_tangent(direction, angle, m.corner.arm_length))
    return out


@wp.func
def first_moments(m: MachineRecord, arm: wp.vec4):
    """First moments [kg m] of front and rear half about the hinge's origin, each in its own axes."""
    front = m.frame_front.mass * wp.vec3(m.frame_front.cog_x, 0.0, m.frame_front.cog_height)
    rear = m.frame_rear.mass * wp.vec3(m.frame_rear.cog_x, 0.0, m.frame_rear.cog_height)
    rear += m.payload.mass * wp.vec3(m.payload.cog_x, 0.0, m.payload.cog_height)
    for wheel in range(4):
        side = 1.0 - 2.0 * float(wheel & 1)
        lengthwise = m.corner.rho * wp.cos(arm[wheel])
        high = m.corner.pivot_height + m.corner.rho * wp.sin(arm[wheel])
        if wheel < 2:
            front += m.corner.mass * wp.vec3(m.frame_front.pivot_x + lengthwise, side * m.corner.lateral, high)
        else:
            rear += m.corner.mass * wp.vec3(m.frame_rear.pivot_x - lengthwise, side * m.corner.lateral, high)
    return front, rear


@wp.struct
class Support:
    """What the wheels bear at a pose of the machine, and how far they are from rest."""

    load: wp.vec4  # [N] vertical
    east: wp.vec4  # [m] of the contacts from the hinge's origin
    north: wp.vec4
    level: wp.vec4  # [-] cosines of the ground's slope
    rise: wp.vec4  # [m/rad] of the wheels along the normal with the arms' angles
    surplus: wp.vec4  # [m] by which each wheel is too deep
    plane: wp.vec3  # height [m] and slopes that fit the surplus best, over the wheels that stand


@wp.func
def support(
    m: MachineRecord,
    terrain: Any,
    ground: Any,
    origin: wp.vec3,
    front: wp.mat33,
    rear: wp.mat33,
    arm: wp.vec4,
    hanging: int,
    cog: wp.vec3,
    weight: float,
):
    """What the wheels bear but for the ``hanging`` one (−1: none).

    Every wheel bears a vertical force V at its contact, normal force and friction together, so that the moments of all are
    those of the ``weight`` W [N] at the CoG (``cog`` [m], front axes). V = α + β x + γ y over the plan is the solution of
    least squares: ΣV = W, and the forces' centre lies under the CoG. On three wheels it is the only one.
    """
    out = Support()
    # sums of 1, x, y and their products, over the contacts of the wheels that stand
    spread = wp.mat33()
    for wheel in range(4):
        foot = tread(m, terrain, ground, origin, half_rotation(wheel, front, rear), wheel, arm[wheel])
        out.east[wheel] = foot.offset[0]
        out.north[wheel] = foot.offset[1]
        out.level[wheel] = foot.level
        out.rise[wheel] = foot.rise
        out.surplus[wheel] = foot.depth
        if wheel != hanging:
            one = wp.vec3(1.0, foot.offset[0], foot.offset[1])
            spread += wp.outer(one, one)
    spread = wp.inverse(spread)
    centre = front * cog
    share = spread * (weight * wp.vec3(1.0, centre[0], centre[1]))
    # by how much each wheel is too deep; as heights, and the plane through them
    sums = wp.vec3()
    for wheel in range(4):
        one = wp.vec3(1.0, out.east[wheel], out.north[wheel])
        load = wp.where(wheel == hanging, 0.0, wp.max(wp.dot(share, one), 0.0))
        surplus = out.surplus[wheel] - load * out.level[wheel] / m.tire.stiffness
        if wheel != hanging:
            sums += (surplus / out.level[wheel]) * one
        out.load[wheel] = load
        out.surplus[wheel] = surplus
    out.plane = spread * sums
    return out


@wp.func
def swing(m: MachineRecord, at: Support, arm: wp.vec4):
    """Arm angles [rad] that take what the plane leaves, and the wheel that hangs then (−1: none)."""
    out = arm
    hanging = int(-1)
    lacking = float(0.0)
    for wheel in range(4):
        left = at.surplus[wheel] - at.level[wheel] * wp.dot(at.plane, wp.vec3(1.0, at.east[wheel], at.north[wheel]))
        if arm[wheel] <= -m.arm.swing and left < lacking:
            lacking = left
            hanging = wheel
        out[wheel] = wp.clamp(
            arm[wheel] + left / wp.max(at.rise[wheel], 0.1 * m.corner.arm_length), -m.arm.swing, m.arm.swing
        )
    if hanging >= 0:
        out = level_arms(m)
        out[hanging] = -m.arm.swing
    return out, hanging


@wp.func
def belly_depth(m: MachineRecord, terrain: Any, ground: Any, origin: wp.vec3, front: wp.mat33, rear: wp.mat33):
    """Depth [m] of the deepest corner of both hulls under the ground, 0 above it."""
    depth = float(0.0)
    for i in range(16):
        frame = m.frame_front
        turned = front
        if i >= 8:
            frame = m.frame_rear
            turned = rear
        world = origin + turned * hull_corner(frame, m.frame_ground_clearance, i & 7)
        under = footing(terrain, ground, world)
        depth = wp.max(depth, ground_height(under, world[0], world[1]) - world[2])
    return depth


@wp.func
def reaction(
    m: MachineRecord, gravity: float, rotation: wp.mat33, foot: Tread, direction: float, angle: float, load: float
):
    """What holds a wheel under the vertical ``load`` [N] and its arm: torque of the brake [N m], bore pressure [Pa], and
    the tire's deflections [m]."""
    up = wp.transpose(rotation) * UP
    # the brake holds the wheel against its contact; the cylinder, the arm against contact, brake and its own weight
    brake = -load * wp.cross(foot.place, up)[1]
    lever_up = wp.dot(arm_tangent(direction, angle, 1.0), up)
    torque = direction * brake + lever_up * (load * m.corner.arm_length - gravity * m.corner.mass * m.corner.rho)
    _, lever = cylinder_extension(m.arm.cylinder_linkage, -angle)
    annulus = m.arm.rod_rest_pressure * m.arm.cylinder_annulus_area
    bore_pressure = wp.max((torque / lever + annulus) / m.arm.cylinder_bore_area, 0.0)
    # the tire's friction, σ₀ z a normal force of one, is what the vertical force has along the ground
    n = foot.normal
    forward = wp.normalize(wp.vec3(n[2], 0.0, -n[0]))
    bristle_x = -wp.dot(forward, up) / (foot.level * m.tire.sigma0_longitudinal)
    bristle_y = -wp.dot(wp.cross(n, forward), up) / (foot.level * m.tire.sigma0_lateral)
    return brake, bore_pressure, wp.vec2(bristle_x, bristle_y)


@wp.func
def stance(m: MachineRecord, terrain: Any, ground: Any, x: float, y: float, heading: float, joint: float):
    """Rest on the ground around the hinge's plan position (x, y)."""
    out = Stance()
    to_rear = hinge_rotation(joint)
    to_front = wp.transpose(to_rear)
    arm = level_arms(m)
    mass = m.frame_front.mass + m.frame_rear.mass + 4.0 * m.corner.mass + m.payload.mass
    front_moment, rear_moment = first_moments(m, arm)
    cog = (front_moment + to_front * rear_moment) / mass

    # the frames follow the plane, the arms what is left
    height = ground_level(terrain, ground, x, y) + m.rest.height
    slope_x = float(0.0)
    slope_y = float(0.0)
    load = wp.vec4()
    hanging = int(-1)
    for step in range(2 * FITS):
        rotation = wp.quat_to_matrix(upright_on(wp.normalize(wp.vec3(-slope_x, -slope_y, 1.0)), heading))
        at = support(
            m, terrain, ground, wp.vec3(x, y, height), rotation, rotation * to_front, arm, hanging, cog,
            ground.gravity * mass,
        )
        load = at.load
        if step >= FITS and hanging < 0:
            arm, hanging = swing(m, at, arm)
        height += at.plane[0]
        slope_x += at.plane[1]
        slope_y += at.plane[2]

    q = upright_on(wp.normalize(wp.vec3(-slope_x, -slope_y, 1.0)), heading)
    rotation = wp.quat_to_matrix(q)
    rear_rotation = rotation * to_front
    origin = wp.vec3(x, y, height)
    # a mound between the wheels: up until nothing is pressed in deeper than at rest
    lift = belly_depth(m, terrain, ground, origin, rotation, rear_rotation)
    turning = -ground.gravity * rear_moment  # first moment of the vertical forces on the rear half
    for wheel in range(4):
        turned = half_rotation(wheel, rotation, rear_rotation)
        foot = tread(m, terrain, ground, origin, turned, wheel, arm[wheel])
        lift = wp.max(lift, foot.depth / foot.level - load[wheel] / m.tire.stiffness)

        brake, bore, bristle = reaction(m, ground.gravity, turned, foot, half_direction(wheel), arm[wheel], load[wheel])
        out.brake[wheel] = brake
        out.bore_pressure[wheel] = bore
        out.bristle_x[wheel] = bristle[0]
        out.bristle_y[wheel] = bristle[1]
        if wheel >= 2:
            turning += load[wheel] * (wp.transpose(turned) * foot.offset)

    # the joint bears what turns the rear half about the hinge
    out.joint = wp.cross(turning, wp.transpose(rear_rotation) * UP)[2]

    out.height = height + lift
    out.rotation = q
    out.arm = arm
    return out
