"""Rigid bodies: the 15-degree-of-freedom tree in minimal coordinates.

Two half-vehicles (frame, two pendulum arms, two wheels) share the hinge axis. Every half is written about the hinge
origin in its own frame, so front and rear go through the same code. All inner joints but the hinge turn about the
frame's y axis, hence the wheels' absolute spins Ω decouple (J_s Ω̇ = torque about the axle) and the arms are eliminated
in closed form, then the hinge; one 6 × 6 system is left. This is the articulated-body algorithm (Featherstone, *Rigid
Body Dynamics Algorithms*, 2008, ch. 7) with the wheels as gyrostats.

Units: m, kg, s, rad. ``direction`` is +1 for the front half (arms lead) and −1 for the rear one (arms trail).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp


@wp.struct
class FrameBody:
    """One frame without arms and wheels (machine section ``frame.front`` or ``frame.rear``)."""

    mass: float  # [kg]
    cog_x: float  # [m] from the hinge, forward positive
    cog_height: float  # [m] over the design ground plane
    inertia_xx: float  # [kg m²] about the CoG
    inertia_yy: float
    inertia_zz: float
    pivot_x: float  # [m] arm pivots, forward positive
    hull_length: float  # [m]
    hull_width: float
    hull_height: float


@wp.struct
class Corner:
    """Arm, motor and wheel as one rigid body without the wheel's spin inertia; axes: along the arm, lateral, normal."""

    mass: float  # [kg]
    rho: float  # [m] CoG from the pivot, along the arm
    lateral: float  # [m] |y| of the CoG
    inertia_ee: float  # [kg m²] about the CoG
    inertia_yy: float
    inertia_nn: float
    inertia_ey: float  # tensor element, y outward
    wheel_lateral: float  # [m] |y| of the wheel centre
    arm_length: float  # [m]
    pivot_height: float  # [m] over the design ground plane
    spin_inertia: float  # [kg m²] of the wheel


@wp.struct
class CornerLoad:
    """What acts on one corner."""

    angle: float  # [rad] arm
    rate: float  # [rad/s] arm
    spin: float  # [rad/s] wheel, absolute about y
    arm_torque: float  # [N m] raises the arm
    wheel_torque: float  # [N m] from the arm on the wheel
    force: wp.vec3  # [N] on the wheel at its centre, frame coordinates
    moment: wp.vec3  # [N m] on the wheel


@wp.struct
class CornerSolution:
    """An eliminated arm: φ̈ = (u − U_a·ω̇ − U_l·â)/D."""

    u_angular: wp.vec3
    u_linear: wp.vec3
    d: float
    u: float


@wp.struct
class Articulated:
    """Articulated inertia about the hinge origin: moment = A ω̇ + B â + n, force = Bᵀ ω̇ + C â + f."""

    a: wp.mat33
    b: wp.mat33
    c: wp.mat33
    n: wp.vec3
    f: wp.vec3


@wp.func
def wheel_centre(corner: Corner, pivot_x: float, direction: float, side: float, angle: float):
    """Wheel centre [m] in frame coordinates; ``side`` is +1 left, −1 right."""
    return wp.vec3(
        pivot_x + direction * corner.arm_length * wp.cos(angle),
        side * corner.wheel_lateral,
        corner.pivot_height + corner.arm_length * wp.sin(angle),
    )


@wp.func
def hull_corner(frame: FrameBody, clearance: float, i: int):
    """Corner ``i`` (0 … 7) [m] of a frame's hull, whose belly is ``clearance`` over the design ground plane."""
    return wp.vec3(
        frame.cog_x + frame.hull_length * (float(i & 1) - 0.5),
        frame.hull_width * (float((i >> 1) & 1) - 0.5),
        clearance + frame.hull_height * float(i >> 2),
    )


@wp.func
def arm_tangent(direction: float, angle: float, radius: float):
    """Derivative [m/rad] of a point at ``radius`` on the arm with respect to the arm angle."""
    return wp.vec3(-direction * radius * wp.sin(angle), 0.0, radius * wp.cos(angle))


@wp.func
def rigid_body(mass: float, inertia: wp.mat33, position: wp.vec3):
    """Spatial inertia of a rigid body about the origin; ``inertia`` about its CoG at ``position``."""
    s = wp.skew(position)
    out = Articulated()
    out.a = inertia - mass * (s * s)
    out.b = mass * s
    out.c = wp.mat33(mass, 0.0, 0.0, 0.0, mass, 0.0, 0.0, 0.0, mass)
    return out


@wp.func
def add(x: Articulated, y: Articulated):
    """Sum of two articulated inertias about the same origin in the same axes."""
    out = Articulated()
    out.a = x.a + y.a
    out.b = x.b + y.b
    out.c = x.c + y.c
    out.n = x.n + y.n
    out.f = x.f + y.f
    return out


@wp.func
def eliminate(x: Articulated, u_angular: wp.vec3, u_linear: wp.vec3, d: float, u: float):
    """Articulated inertia seen through a joint with U = (u_angular, u_linear), D = ``d`` and net torque ``u``."""
    out = Articulated()
    out.a = x.a - wp.outer(u_angular, u_angular) / d
    out.b = x.b - wp.outer(u_angular, u_linear) / d
    out.c = x.c - wp.outer(u_linear, u_linear) / d
    out.n = x.n + u_angular * (u / d)
    out.f = x.f + u_linear * (u / d)
    return out


@wp.func
def frame_inertia(frame: FrameBody, omega: wp.vec3, force: wp.vec3, moment: wp.vec3):
    """A frame about the hinge origin under an external ``force`` and ``moment`` (about the origin), turning at
    ``omega``."""
    position = wp.vec3(frame.cog_x, 0.0, frame.cog_height)
    inertia = wp.diag(wp.vec3(frame.inertia_xx, frame.inertia_yy, frame.inertia_zz))
    out = rigid_body(frame.mass, inertia, position)
    centripetal = frame.mass * wp.cross(omega, wp.cross(omega, position))
    out.n = wp.cross(omega, inertia * omega) + wp.cross(position, centripetal) - moment
    out.f = centripetal - force
    return out


@wp.func
def corner_inertia(
    corner: Corner, pivot_x: float, direction: float, side: float, omega: wp.vec3, load: CornerLoad
):
    """One corner about the hinge origin, and its eliminated arm: returns (Articulated without the arm's freedom,
    CornerSolution)."""
    sine = wp.sin(load.angle)
    cosine = wp.cos(load.angle)
    y = wp.vec3(0.0, 1.0, 0.0)
    position = wp.vec3(
        pivot_x + direction * corner.rho * cosine, side * corner.lateral, corner.pivot_height + corner.rho * sine
    )
    tangent = arm_tangent(direction, load.angle, corner.rho)

    # inertia from arm axes (e, y, n) to the frame: e = (d cos φ, 0, sin φ), n = (−d sin φ, 0, cos φ)
    i_ey = side * corner.inertia_ey
    i_xx = corner.inertia_ee * cosine * cosine + corner.inertia_nn * sine * sine
    i_zz = corner.inertia_ee * sine * sine + corner.inertia_nn * cosine * cosine
    i_xz = direction * (corner.inertia_ee - corner.inertia_nn) * sine * cosine
    i_xy = direction * i_ey * cosine
    i_yz = i_ey * sine
    inertia = wp.mat33(i_xx, i_xy, i_xz, i_xy, corner.inertia_yy, i_yz, i_xz, i_yz, i_zz)

    body = rigid_body(corner.mass, inertia, position)
    relative = -direction * load.rate  # arm against frame, about y
    omega_arm = omega + relative * y
    acceleration = (
        wp.cross(omega, wp.cross(omega, position))
        + 2.0 * load.rate * wp.cross(omega, tangent)
        - (load.rate * load.rate) * (position - wp.vec3(pivot_x, side * corner.lateral, corner.pivot_height))
    )
    inertial_force = corner.mass * acceleration
    inertial_moment = (
        inertia * (relative * wp.cross(omega, y))
        + wp.cross(omega_arm, inertia * omega_arm)
        + (corner.spin_inertia * load.spin) * wp.cross(omega, y)
    )

    # external: contact at the wheel (its y moment drives the spin, not the arm), reaction of the wheel torque
    wheel = wheel_centre(corner, pivot_x, direction, side, load.angle)
    external_moment = wp.cross(wheel, load.force) + wp.vec3(load.moment[0], -load.wheel_torque, load.moment[2])
    body.n = inertial_moment + wp.cross(position, inertial_force) - external_moment
    body.f = inertial_force - load.force

    solution = CornerSolution()
    solution.u_linear = corner.mass * tangent
    solution.u_angular = wp.cross(position, solution.u_linear) - direction * (inertia * y)
    solution.d = corner.inertia_yy + corner.mass * corner.rho * corner.rho
    solution.u = (
        load.arm_torque
        + direction * load.wheel_torque
        + wp.dot(arm_tangent(direction, load.angle, corner.arm_length), load.force)
        - (wp.dot(tangent, inertial_force) - direction * inertial_moment[1])
    )
    return eliminate(body, solution.u_angular, solution.u_linear, solution.d, solution.u), solution


@wp.func
def arm_acceleration(s: CornerSolution, angular: wp.vec3, linear: wp.vec3):
    """φ̈ [rad/s²] from the frame's angular and (gravity-free) linear acceleration at the hinge origin."""
    return (s.u - wp.dot(s.u_angular, angular) - wp.dot(s.u_linear, linear)) / s.d


@wp.func
def hinge_rotation(joint_angle: float):
    """Rotation that takes front-frame components to rear-frame components: R_z(θ)."""
    c = wp.cos(joint_angle)
    s = wp.sin(joint_angle)
    return wp.mat33(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@wp.func
def join(front: Articulated, rear: Articulated, to_rear: wp.mat33, omega: wp.vec3, joint_rate: float, torque: float):
    """Accelerations of the whole tree: returns (ω̇ front, â front, θ̈, ω̇ rear, â rear), all in their own frames.

    â = v̇ + ω×v − g is the hinge origin's acceleration without gravity. ``torque`` [N m] drives θ up (front to the left).
    """
    z = wp.vec3(0.0, 0.0, 1.0)
    to_front = wp.transpose(to_rear)
    # ω̇_rear = Q ω̇_front + θ̇ z × Q ω_front − θ̈ z
    turning = joint_rate * wp.cross(z, to_rear * omega)
    u_angular = -(rear.a * z)
    u_linear = -(wp.transpose(rear.b) * z)
    d = rear.a[2, 2]
    bias = Articulated()
    bias.a = rear.a
    bias.b = rear.b
    bias.c = rear.c
    bias.n = rear.n + rear.a * turning
    bias.f = rear.f + wp.transpose(rear.b) * turning
    u = torque + bias.n[2]
    carried = eliminate(bias, u_angular, u_linear, d, u)

    a = front.a + to_front * carried.a * to_rear
    b = front.b + to_front * carried.b * to_rear
    c = front.c + to_front * carried.c * to_rear
    n = front.n + to_front * carried.n
    f = front.f + to_front * carried.f

    # [A B; Bᵀ C][ω̇; â] = −[n; f], by the Schur complement of C
    c_inverse = wp.inverse(c)
    b_c = b * c_inverse
    angular = wp.inverse(a - b_c * wp.transpose(b)) * (b_c * f - n)
    linear = -(c_inverse * (f + wp.transpose(b) * angular))

    angular_rear = to_rear * angular
    linear_rear = to_rear * linear
    joint = (u - wp.dot(u_angular, angular_rear) - wp.dot(u_linear, linear_rear)) / d
    return angular, linear, joint, angular_rear + turning - joint * z, linear_rear


@wp.struct
class Accelerations:
    """Time derivatives of the tree's velocities."""

    linear: wp.vec3  # [m/s²] of the hinge origin's velocity components, front frame
    angular: wp.vec3  # [rad/s²] front frame
    joint: float  # [rad/s²]
    arms: wp.vec4  # [rad/s²]
    spins: wp.vec4  # [rad/s²] absolute wheel spins


@wp.struct
class Halves:
    """Both halves about the hinge's origin, each in its own axes, with their arms eliminated."""

    front: Articulated
    rear: Articulated
    fl: CornerSolution
    fr: CornerSolution
    rl: CornerSolution
    rr: CornerSolution


@wp.func
def halves(
    # parameters
    frame_front: FrameBody,
    frame_rear: FrameBody,
    corner: Corner,
    # motion
    omega: wp.vec3,
    omega_rear: wp.vec3,
    # loads
    fl: CornerLoad,
    fr: CornerLoad,
    rl: CornerLoad,
    rr: CornerLoad,
    front_force: wp.vec3,
    front_moment: wp.vec3,
    rear_force: wp.vec3,
    rear_moment: wp.vec3,
):
    """The halves under torques, contact forces at the wheels, and wrenches on the frames (about the hinge origin, in the
    axes of each frame)."""
    half_fl, arm_fl = corner_inertia(corner, frame_front.pivot_x, 1.0, 1.0, omega, fl)
    half_fr, arm_fr = corner_inertia(corner, frame_front.pivot_x, 1.0, -1.0, omega, fr)
    half_rl, arm_rl = corner_inertia(corner, frame_rear.pivot_x, -1.0, 1.0, omega_rear, rl)
    half_rr, arm_rr = corner_inertia(corner, frame_rear.pivot_x, -1.0, -1.0, omega_rear, rr)
    front = add(frame_inertia(frame_front, omega, front_force, front_moment), add(half_fl, half_fr))
    rear = add(frame_inertia(frame_rear, omega_rear, rear_force, rear_moment), add(half_rl, half_rr))
    return Halves(front, rear, arm_fl, arm_fr, arm_rl, arm_rr)


@wp.func
def accelerate(
    # parameters
    corner: Corner,
    both: Halves,
    # pose and motion: weight of a unit mass in front axes, hinge rotation, hinge origin's velocity, angular velocity
    weight: wp.vec3,
    to_rear: wp.mat33,
    velocity: wp.vec3,
    omega: wp.vec3,
    joint_rate: float,
    # loads
    joint_torque: float,
    fl: CornerLoad,
    fr: CornerLoad,
    rl: CornerLoad,
    rr: CornerLoad,
):
    """Forward dynamics of the tree: returns (Accelerations, ω̇ rear, â rear), the last two in the rear frame's axes."""
    angular, linear, joint, angular_rear, linear_rear = join(
        both.front, both.rear, to_rear, omega, joint_rate, joint_torque
    )
    out = Accelerations()
    out.linear = linear - wp.cross(omega, velocity) + weight
    out.angular = angular
    out.joint = joint
    out.arms = wp.vec4(
        arm_acceleration(both.fl, angular, linear),
        arm_acceleration(both.fr, angular, linear),
        arm_acceleration(both.rl, angular_rear, linear_rear),
        arm_acceleration(both.rr, angular_rear, linear_rear),
    )
    out.spins = (
        wp.vec4(
            fl.wheel_torque + fl.moment[1],
            fr.wheel_torque + fr.moment[1],
            rl.wheel_torque + rl.moment[1],
            rr.wheel_torque + rr.moment[1],
        )
        / corner.spin_inertia
    )
    return out, angular_rear, linear_rear
