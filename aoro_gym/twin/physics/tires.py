"""Tire and hull contact with the ground.

Five discs give the tire its shape; the deepest one carries one contact point with a penalty normal force and
LuGre friction. Where discs are equally deep to millimetres the point lies between them: with
δ = ε ln Σ exp(δ_i/ε) − δ_level and the mean place by the weights exp(δ_i/ε), moved along the normal to the depth δ, the
normal force derives from a potential, and a tire that leans does not chatter from disc to disc. δ_level makes δ the
middle disc's depth on level ground.
Sources: Lehto et al. (Machines 2026, 14, 128) for the disc model; Canudas de Wit et al. (IEEE TAC 40,
1995) for LuGre.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.friction import bristle_step
from aoro_gym.twin.physics.ground import Footing, ground_height, penetration

ROLLING_REGULARISATION = wp.constant(0.05)  # [rad/s] wheel rate below which rolling resistance fades
DISC_BLEND = wp.constant(0.002)  # [m] of depth by which discs differ that share the contact
HULL_REGULARISATION = wp.constant(0.05)  # [m/s] slip below which the hull's friction fades


@wp.struct
class Tire:
    """Tire parameters (machine section ``tire``)."""

    radius: float  # [m] of the middle disc, unloaded
    disc_offset_inner: float  # [m] lateral
    disc_offset_outer: float
    disc_drop_inner: float  # [m] by which the disc is smaller than the middle one
    disc_drop_outer: float
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    sigma0_longitudinal: float  # [1/m] bristle stiffness a unit of load
    sigma0_lateral: float
    sigma1_longitudinal: float  # [s/m] bristle damping
    sigma1_lateral: float
    sigma2_longitudinal: float  # [s/m] viscous
    sigma2_lateral: float
    friction_coulomb: float  # [-]
    friction_static: float  # [-]
    stribeck_velocity: float  # [m/s]
    rolling_resistance: float  # [-]
    scrub_radius: float  # [m] lever of the friction that resists swivelling
    scrub_angle: float  # [rad] twist at which the patch slides
    swivel_law: int  # by the numbers of aoro_gym.machine.laws
    bore_radius: float  # [m]
    bore_stiffness: float  # [N m/rad]
    slip_law: int
    relaxation_longitudinal: float  # [m]
    relaxation_lateral: float
    soft_ground_law: int
    bulldozing_resistance: float  # [-]


@wp.struct
class Hull:
    """Contact of the frames' corners with the ground (machine section ``hull``)."""

    stiffness: float  # [N/m] a corner
    damping: float  # [N s/m]
    friction: float  # [-]


@wp.struct
class DiscContact:
    """Where a wheel's discs meet a plane."""

    depth: float  # [m] under the plane, along its normal; negative above it
    place: wp.vec3  # [m] from the wheel's centre, frame axes


@wp.struct
class TireContact:
    """Result of one wheel's contact, in its frame's coordinates."""

    force: wp.vec3  # [N] on the wheel
    moment: wp.vec3  # [N m] on the wheel about its centre
    load: float  # [N] normal force
    forward: wp.vec3  # unit, rolling direction in the ground's plane
    lever: float  # [m] height of the wheel's centre over the contact
    damping: float  # [N s/m] of the longitudinal force
    bristle_x: float  # [m] longitudinal deflection
    bristle_y: float  # [m] lateral
    twist: float  # [rad] of the patch about the ground's normal


@wp.func
def lugre_capacity(m: Tire, speed: float, friction: float):
    """Steady friction coefficient g(v) = μ (μ_c + (μ_s − μ_c) exp(−(v/v_s)²)) at slip ``speed`` [m/s]."""
    ratio = speed / m.stribeck_velocity
    return friction * (m.friction_coulomb + (m.friction_static - m.friction_coulomb) * wp.exp(-ratio * ratio))


@wp.func
def scrub_step(m: Tire, twist: float, swivel: float, roll: float, depth: float, dt: float):
    """Twist [rad] of the contact patch after ``dt``: ẇ = ψ̇ − |ψ̇| w/ψ₀ − |v| w/ℓ.

    ``swivel`` ψ̇ [rad/s] about the ground's normal winds it up to ψ₀ = ``scrub_angle`` (Dahl; Sharp & Granger, *On car
    steering torques at parking speeds*), and tread that rolls in at ``roll`` v [m/s] is not twisted: it is renewed over
    the patch's length ℓ = 2 √(2 R δ), the chord at ``depth`` δ [m].
    """
    length = 2.0 * wp.sqrt(2.0 * m.radius * depth)
    return bristle_step(twist, swivel, wp.abs(swivel) / m.scrub_angle + wp.abs(roll) / length, dt)


@wp.func
def scrub_torque(m: Tire, twist: float, load: float, friction: float):
    """Torque [N m] about the ground's normal against the twist: μ F_n r w/ψ₀, r the ``scrub_radius`` (2/3 of the radius
    of a round patch of even pressure)."""
    return -friction * m.friction_coulomb * load * m.scrub_radius * twist / m.scrub_angle


@wp.func
def disc_contact(m: Tire, n: wp.vec3, middle: float):
    """Contact of the five discs with a plane of unit normal ``n`` (frame axes) that the middle disc dips into by
    ``middle`` [m]: the deepest disc's, blended with those that are nearly as deep."""
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    down = wp.vec3(-n[0] / tilt, 0.0, -n[2] / tilt)
    inner_right = middle - m.disc_drop_inner * tilt + m.disc_offset_inner * n[1]
    inner_left = middle - m.disc_drop_inner * tilt - m.disc_offset_inner * n[1]
    outer_right = middle - m.disc_drop_outer * tilt + m.disc_offset_outer * n[1]
    outer_left = middle - m.disc_drop_outer * tilt - m.disc_offset_outer * n[1]
    deepest = wp.max(middle, wp.max(wp.max(inner_right, inner_left), wp.max(outer_right, outer_left)))
    w_middle = wp.exp((middle - deepest) / DISC_BLEND)
    w_inner_right = wp.exp((inner_right - deepest) / DISC_BLEND)
    w_inner_left = wp.exp((inner_left - deepest) / DISC_BLEND)
    w_outer_right = wp.exp((outer_right - deepest) / DISC_BLEND)
    w_outer_left = wp.exp((outer_left - deepest) / DISC_BLEND)
    w_inner = w_inner_right + w_inner_left
    w_outer = w_outer_right + w_outer_left
    total = w_middle + w_inner + w_outer
    level = 1.0 + 2.0 * (wp.exp(-m.disc_drop_inner / DISC_BLEND) + wp.exp(-m.disc_drop_outer / DISC_BLEND))
    aside = m.disc_offset_inner * (w_inner_left - w_inner_right) + m.disc_offset_outer * (w_outer_left - w_outer_right)
    drop = m.disc_drop_inner * w_inner + m.disc_drop_outer * w_outer
    mean = w_middle * middle + w_inner_right * inner_right + w_inner_left * inner_left
    mean = (mean + w_outer_right * outer_right + w_outer_left * outer_left) / total
    out = DiscContact()
    out.depth = deepest + DISC_BLEND * wp.log(total / level)
    out.place = wp.vec3(0.0, aside / total, 0.0) + (m.radius - drop / total) * down - (out.depth - mean) * n
    return out


@wp.func
def tire_contact(
    # parameters
    m: Tire,
    ground: Footing,
    # pose of the half: rotation frame → world, hinge origin in the world, wheel centre in the frame
    rotation: wp.mat33,
    origin: wp.vec3,
    centre: wp.vec3,
    # motion in the frame: wheel centre, frame's angular velocity, absolute spin
    velocity: wp.vec3,
    omega: wp.vec3,
    spin: float,
    # bristles
    bristle_x: float,
    bristle_y: float,
    twist: float,
    dt: float,
):
    """Contact of one wheel: F_n = max(0, k δ + c δ̇), F_j = F_n (σ₀ z_j + σ₁ ż_j + σ₂ v_j) for both directions.

    The slip of both directions shares one capacity (σ₀_j |v| z_j/g with the resultant |v|). Bristles are taken at the
    step's middle (mean of old and new), where the force acts. ``ground`` is the footing under the wheel's centre, a plane
    for all five discs. Valid for wheels whose discs meet it from above.
    """
    out = TireContact()
    n = wp.transpose(rotation) * ground.normal
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    down = wp.vec3(-n[0] / tilt, 0.0, -n[2] / tilt)

    touch = disc_contact(m, n, penetration(ground, origin + rotation * (centre + m.radius * down)))

    if touch.depth > 0.0:
        arm = touch.place
        slip = velocity + wp.cross(wp.vec3(omega[0], spin, omega[2]), arm)
        load = wp.max(m.stiffness * touch.depth - m.damping * wp.dot(n, slip), 0.0)
        forward = wp.vec3(n[2] / tilt, 0.0, -n[0] / tilt)
        sideways = wp.cross(n, forward)
        slip_x = wp.dot(forward, slip)
        slip_y = wp.dot(sideways, slip)
        speed = wp.sqrt(slip_x * slip_x + slip_y * slip_y)
        unload = speed / lugre_capacity(m, speed, ground.friction)
        out.bristle_x = bristle_step(bristle_x, slip_x, m.sigma0_longitudinal * unload, dt)
        out.bristle_y = bristle_step(bristle_y, slip_y, m.sigma0_lateral * unload, dt)
        force_x = load * (
            0.5 * m.sigma0_longitudinal * (bristle_x + out.bristle_x)
            + m.sigma1_longitudinal * (out.bristle_x - bristle_x) / dt
            + m.sigma2_longitudinal * slip_x
        )
        force_y = load * (
            0.5 * m.sigma0_lateral * (bristle_y + out.bristle_y)
            + m.sigma1_lateral * (out.bristle_y - bristle_y) / dt
            + m.sigma2_lateral * slip_y
        )
        out.force = load * n - force_x * forward - force_y * sideways
        out.forward = forward
        out.lever = wp.dot(arm, down)
        out.damping = load * (
            m.sigma1_longitudinal / (1.0 + dt * m.sigma0_longitudinal * unload) + m.sigma2_longitudinal
        )
        rolling = (
            m.rolling_resistance * ground.rolling_resistance * load * out.lever
            * wp.tanh(spin / ROLLING_REGULARISATION)
        )
        out.moment = wp.cross(arm, out.force) - wp.vec3(0.0, rolling, 0.0)
        if m.scrub_radius > 0.0:
            roll = wp.dot(forward, velocity)
            out.twist = scrub_step(m, twist, wp.dot(n, omega), roll, touch.depth, dt)
            out.moment += scrub_torque(m, 0.5 * (twist + out.twist), load, ground.friction) * n
        out.load = load
    return out


@wp.func
def hull_contact(
    m: Hull, ground: Footing, rotation: wp.mat33, origin: wp.vec3, point: wp.vec3, velocity: wp.vec3, omega: wp.vec3
):
    """Force [N], frame coordinates, on one corner of a hull: penalty spring and damper that never pulls, with Coulomb
    friction regularised below 5 cm/s."""
    force = wp.vec3(0.0, 0.0, 0.0)
    world = origin + rotation * point
    depth = ground_height(ground, world[0], world[1]) - world[2]
    if depth > 0.0:
        n = wp.transpose(rotation) * ground.normal
        v = velocity + wp.cross(omega, point)
        v_n = wp.dot(n, v)
        load = wp.max(m.stiffness * depth * (rotation * n)[2] - m.damping * v_n, 0.0)
        slip = v - v_n * n
        speed = wp.sqrt(wp.dot(slip, slip) + HULL_REGULARISATION * HULL_REGULARISATION)
        force = load * n - (m.friction * load / speed) * slip
    return force
