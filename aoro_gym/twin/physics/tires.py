"""Tire and hull contact with the ground.

Five discs give the tire its shape; the deepest one carries one contact point with a penalty normal force and
LuGre friction. Where discs are equally deep to millimetres the point lies between them: with
δ = ε ln Σ exp(δ_i/ε) − δ_level and the mean place by the weights exp(δ_i/ε), moved along the normal to the depth δ, the
normal force derives from a potential, and a tire that leans does not chatter from disc to disc. δ_level makes δ the
middle disc's depth on level ground.
Sources: Lehto et al. (Machines 2026, 14, 128) for the disc model; Canudas de Wit et al. (IEEE TAC 40,
1995) for LuGre; Pacejka, *Tire and Vehicle Dynamics* (3rd ed. 2012), for relaxation; Rill, *Road Vehicle Dynamics* (2012),
for bore torque; Karafiath and Nowatzki, *Soil Mechanics for Off-Road Vehicle Engineering* (1978), for soft ground.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.friction import bristle_step
from aoro_gym.twin.physics.ground import Footing, ground_height, penetration
from aoro_gym.twin.physics.laws import option

CONTACT_POINT = option("swivel", "contact_point")
FIVE_DISCS = option("swivel", "five_discs")
LUGRE = option("slip", "lugre")
BULLDOZING = option("soft_ground", "bulldozing")

ROLLING_REGULARISATION = wp.constant(0.05)  # [rad/s] wheel rate below which rolling resistance fades
DISC_BLEND = wp.constant(0.002)  # [m] of depth by which discs differ that share the contact
HULL_REGULARISATION = wp.constant(0.05)  # [m/s] slip below which the hull's friction fades
SOFT = wp.constant(
    0.05
)  # [-] rolling resistance beyond asphalt's of ground that ``bulldozing_resistance`` is given for
SOFTEST = wp.constant(0.15)  # [-] to which that holds: three times as deep, 15 cm
BULLDOZING_REGULARISATION = wp.constant(0.05)  # [m/s] lateral speed below which the push of soft ground fades
CIRCLE_STEPS = wp.constant(3)  # towards the friction circle


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


@wp.struct
class Slide:
    """How a tire's contact moves along the ground."""

    x: float  # [m/s] slip along the rolling direction
    y: float  # [m/s] across
    swivel: float  # [rad/s] about the ground's normal
    roll: float  # [m/s] at which tread passes through the contact
    load: float  # [N] normal force
    friction: float  # [-] multiplier of the ground


@wp.struct
class Friction:
    """What a tire's slip brings about."""

    bristle_x: float  # [m]
    bristle_y: float
    x: float  # [N] against the slip along the rolling direction
    y: float  # [N] across
    damping: float  # [N s/m] of ``x``


@wp.func
def lugre_capacity(m: Tire, speed: float, friction: float):
    """Steady friction coefficient g(v) = μ (μ_c + (μ_s − μ_c) exp(−(v/v_s)²)) at slip ``speed`` [m/s]."""
    ratio = speed / m.stribeck_velocity
    return friction * (m.friction_coulomb + (m.friction_static - m.friction_coulomb) * wp.exp(-ratio * ratio))


@wp.func
def lugre_slip(m: Tire, v: Slide, bristle_x: float, bristle_y: float, dt: float):
    """Law ``lugre``: F_j = F_n (σ₀ z_j + σ₁ ż_j + σ₂ v_j), ż_j = v_j − σ₀_j |v| z_j/g for both directions.

    They share one capacity, by the resultant |v|. Bristles are taken at the step's middle (mean of old and new), where the
    force acts.
    """
    out = Friction()
    speed = wp.sqrt(v.x * v.x + v.y * v.y)
    unload = speed / lugre_capacity(m, speed, v.friction)
    out.bristle_x = bristle_step(bristle_x, v.x, m.sigma0_longitudinal * unload, dt)
    out.bristle_y = bristle_step(bristle_y, v.y, m.sigma0_lateral * unload, dt)
    out.x = v.load * (
        0.5 * m.sigma0_longitudinal * (bristle_x + out.bristle_x)
        + m.sigma1_longitudinal * (out.bristle_x - bristle_x) / dt
        + m.sigma2_longitudinal * v.x
    )
    out.y = v.load * (
        0.5 * m.sigma0_lateral * (bristle_y + out.bristle_y)
        + m.sigma1_lateral * (out.bristle_y - bristle_y) / dt
        + m.sigma2_lateral * v.y
    )
    out.damping = v.load * (m.sigma1_longitudinal / (1.0 + dt * m.sigma0_longitudinal * unload) + m.sigma2_longitudinal)
    return out


@wp.func
def onto_circle(force: wp.vec2, stiffness: wp.vec2, grip: float):
    """Elastic ``force`` of bristles of ``stiffness`` that yield along it until it is at most ``grip`` (all a unit of load).

    f_j (1 + γ k_j) = f_j⁰ with the least γ ≥ 0 that brings |f| to the grip (closest-point return, Simo and Hughes,
    *Computational Inelasticity*, 1998): what slides does so along the force, and takes work. Newton's method on 1/|f|,
    exact in a step where both stiffnesses are alike; what little it lacks is scaled.
    """
    out = force
    give = float(0.0)
    for _ in range(CIRCLE_STEPS):
        size = wp.length(out)
        if size > grip:
            yielding_x = stiffness[0] / (1.0 + give * stiffness[0])
            yielding_y = stiffness[1] / (1.0 + give * stiffness[1])
            slope = yielding_x * out[0] * out[0] + yielding_y * out[1] * out[1]
            give += (size / grip - 1.0) * size * size / slope
            out = wp.vec2(force[0] / (1.0 + give * stiffness[0]), force[1] / (1.0 + give * stiffness[1]))
    return out * wp.min(1.0, grip / wp.max(wp.length(out), grip))


@wp.func
def relaxed_slip(m: Tire, v: Slide, bristle_x: float, bristle_y: float, dt: float):
    """Law ``relaxation``: ż_j = v_j − |v_r| z_j/ℓ_j, F_j = F_n (σ₀_j z_j + σ₁_j ż_j), on or within the circle |F| = F_n g.

    The carcass bends by z until tread that rolls in at v_r = Ω r meets no more slip: a first-order lag over the way ℓ =
    ``relaxation_…`` (Pacejka 2012, section 7.2, single contact point). A steady small slip has the stiffness
    F_n σ₀ ℓ; a wheel that stands winds up as a spring until it slides (parking). σ₁ is the carcass's damping, and vanishes
    at steady slip or slide. Linearly implicit: stable at any speed. Valid for forces linear in slip up to the circle,
    without a tire's gradual onset of sliding, and for wave lengths of some patches' length.
    """
    out = Friction()
    stiffness = wp.vec2(m.sigma0_longitudinal, m.sigma0_lateral)
    renewed = dt * wp.abs(v.roll) / m.relaxation_longitudinal
    trial_x = m.sigma0_longitudinal * (bristle_x + dt * v.x) / (1.0 + renewed)
    trial_y = m.sigma0_lateral * bristle_step(bristle_y, v.y, wp.abs(v.roll) / m.relaxation_lateral, dt)
    grip = lugre_capacity(m, wp.sqrt(v.x * v.x + v.y * v.y), v.friction)
    elastic = onto_circle(wp.vec2(trial_x, trial_y), stiffness, grip)
    out.bristle_x = elastic[0] / m.sigma0_longitudinal
    out.bristle_y = elastic[1] / m.sigma0_lateral
    force = wp.vec2(
        0.5 * (m.sigma0_longitudinal * bristle_x + elastic[0])
        + m.sigma1_longitudinal * (out.bristle_x - bristle_x) / dt,
        0.5 * (m.sigma0_lateral * bristle_y + elastic[1]) + m.sigma1_lateral * (out.bristle_y - bristle_y) / dt,
    )
    size = wp.length(force)
    if size > grip:
        force *= grip / size
    elif trial_x * trial_x + trial_y * trial_y < grip * grip:
        out.damping = v.load * m.sigma1_longitudinal / (1.0 + renewed)
    out.x = v.load * force[0]
    out.y = v.load * force[1]
    return out


@wp.func
def patch_length(m: Tire, depth: float):
    """Length ℓ = 2 √(2 R δ) [m] of the contact patch: the chord at ``depth`` δ [m]."""
    return 2.0 * wp.sqrt(2.0 * m.radius * depth)


@wp.func
def mean_disc_offset(m: Tire):
    """Mean lateral distance [m] of the five discs from the wheel's middle, the lever of their friction against a swivel."""
    return 0.4 * (m.disc_offset_inner + m.disc_offset_outer)


@wp.func
def scrub_step(m: Tire, twist: float, swivel: float, roll: float, depth: float, dt: float):
    """Twist [rad] of the contact patch after ``dt``: ẇ = ψ̇ − |ψ̇| w/ψ₀ − |v| w/ℓ.

    ``swivel`` ψ̇ [rad/s] about the ground's normal winds it up to ψ₀ = ``scrub_angle`` (Dahl; Sharp & Granger, *On car
    steering torques at parking speeds*), and tread that rolls in at ``roll`` v [m/s] is not twisted: it is renewed over
    the patch's length ℓ = 2 √(2 R δ), the chord at ``depth`` δ [m].
    """
    return bristle_step(twist, swivel, wp.abs(swivel) / m.scrub_angle + wp.abs(roll) / patch_length(m, depth), dt)


@wp.func
def scrub_torque(m: Tire, twist: float, load: float, friction: float):
    """Torque [N m] about the ground's normal against the twist: μ F_n r w/ψ₀, r the ``scrub_radius`` (2/3 of the radius
    of a round patch of even pressure)."""
    return -friction * m.friction_coulomb * load * m.scrub_radius * twist / m.scrub_angle


@wp.func
def discs_step(m: Tire, v: Slide, twist: float, depth: float, dt: float):
    """Twist [rad] of the patch after ``dt`` by the law ``five_discs``: ẇ = ψ̇ − σ₀ u w/g(u) − |v_r| w/ℓ, what LuGre's
    bristles of the inner discs at ±y differ by, over 2y.

    u² = |v|² + (ψ̇ y)² of their slip. A wheel that only swivels twists up to g/(σ₀ y), at which all discs slide but the
    middle one; one that slides along does not twist.
    """
    rim = v.swivel * m.disc_offset_inner
    speed = wp.sqrt(v.x * v.x + v.y * v.y + rim * rim)
    unload = m.sigma0_longitudinal * speed / lugre_capacity(m, speed, v.friction)
    return bristle_step(twist, v.swivel, unload + wp.abs(v.roll) / patch_length(m, depth), dt)


@wp.func
def disc_torque(m: Tire, v: Slide, bristle: wp.vec2, twist: float, share: float, lever: float):
    """Torque [N m] about the ground's normal of the disc that bears ``share`` of the load, ``lever`` y [m] left of its
    middle.

    It slips by v_x − ψ̇ y, so its bristle is bent by z_x − w y (``twist`` w [rad]); it slides at what the lateral force
    leaves of the capacity g.
    """
    slip = v.x - v.swivel * lever
    grip = lugre_capacity(m, wp.sqrt(slip * slip + v.y * v.y), v.friction)
    lateral = m.sigma0_lateral * bristle[1]
    left = wp.sqrt(wp.max(grip * grip - lateral * lateral, 0.0))
    pull = wp.clamp(m.sigma0_longitudinal * (bristle[0] - lever * twist), -left, left)
    return v.load * share * lever * pull


@wp.func
def five_discs_torque(m: Tire, n: wp.vec3, middle: float, v: Slide, bristle: wp.vec2, twist: float):
    """Law ``five_discs``: torque [N m] about the ground's normal of longitudinal forces at all discs,
    T = F_n Σ w_i y_i clip(σ₀ (z_x − w y_i), ±g).

    Each disc is a spring of its own under a fifth of the tire's stiffness, so its share w_i of the load is that of its
    depth, as the ground sees it along the normal ``n`` with the middle one at ``middle`` [m]; levers y_i count from the
    loads' mean, where the resultant force acts. A little twist is held by F_n σ₀ Σ w_i y_i² [N m/rad]; with all discs
    sliding T = μ F_n Σ w_i |y_i|. The twist is that of :func:`discs_step`. Valid for a patch that is short against its
    width: lateral forces before and behind the middle are left out.
    """
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    inner = m.disc_offset_inner
    outer = m.disc_offset_outer
    inner_depth = middle - m.disc_drop_inner * tilt
    outer_depth = middle - m.disc_drop_outer * tilt
    centre = wp.max(middle, 0.0)
    inner_left = wp.max(inner_depth - inner * n[1], 0.0)
    inner_right = wp.max(inner_depth + inner * n[1], 0.0)
    outer_left = wp.max(outer_depth - outer * n[1], 0.0)
    outer_right = wp.max(outer_depth + outer * n[1], 0.0)
    total = wp.max(centre + inner_left + inner_right + outer_left + outer_right, 1.0e-9)
    mean = (inner * (inner_left - inner_right) + outer * (outer_left - outer_right)) / total
    return (
        disc_torque(m, v, bristle, twist, centre / total, -mean)
        + disc_torque(m, v, bristle, twist, inner_left / total, inner - mean)
        + disc_torque(m, v, bristle, twist, inner_right / total, -inner - mean)
        + disc_torque(m, v, bristle, twist, outer_left / total, outer - mean)
        + disc_torque(m, v, bristle, twist, outer_right / total, -outer - mean)
    )


@wp.func
def bore_limit(m: Tire, load: float, friction: float):
    """Torque [N m] at which a patch slides about the ground's normal: μ F_n R_B."""
    return friction * m.friction_coulomb * load * m.bore_radius


@wp.func
def bore_step(m: Tire, v: Slide, twist: float, depth: float, dt: float):
    """Twist [rad] of the patch after ``dt`` by the law ``bore_torque``: ẇ = ψ̇ − |v_r| w/ℓ, held within ±μ F_n R_B/k."""
    limit = bore_limit(m, v.load, v.friction) / m.bore_stiffness
    return wp.clamp(bristle_step(twist, v.swivel, wp.abs(v.roll) / patch_length(m, depth), dt), -limit, limit)


@wp.func
def bore_torque(m: Tire, v: Slide, twist: float):
    """Law ``bore_torque``: −k w [N m], no more than μ F_n R_B, of a spring k = ``bore_stiffness`` on the bore radius R_B.

    Rill (2012), section 3.7: a patch that is bored into the ground sticks as a spring and slides at once as a whole. Valid
    for a patch whose longitudinal and lateral forces leave it most of its grip.
    """
    limit = bore_limit(m, v.load, v.friction)
    return -wp.clamp(m.bore_stiffness * twist, -limit, limit)


@wp.func
def bulldozing(m: Tire, ground: Footing, load: float, slip: float):
    """Law ``bulldozing``: force [N] of soft ground against a lateral ``slip`` v [m/s], F_n c b v/√(v² + v₀²).

    b = ρ/0.05 says how soft the ground is by its rolling resistance beyond asphalt's, ρ = c_rr (multiplier − 1), and c is
    the ``bulldozing_resistance`` at b = 1. In proportion, as a tire of contact length ℓ sinks into ground of pressure k zⁿ
    (Bekker) by z = (n + 1) ℓ ρ, the work of pressing its rut being that of rolling, and its sunk flank pushes off ground of
    cohesion c_s with 2 c_s √K_p ℓ z (passive earth pressure; Karafiath and Nowatzki 1978, ch. 2): 5 cm and 0.05 F_n at
    ρ = 0.05 with ℓ = 0.5 m, n = 1, c_s = 15 kPa, K_p = 3. Saarilahti (*Soil Interaction Model*, ECOWOOD 2002) has forest
    soils at ρ up to some 0.15, the largest that counts. Valid for ruts less deep than that and cohesive ground; on asphalt
    and harder it is nothing.
    """
    softness = wp.clamp(m.rolling_resistance * (ground.rolling_resistance - 1.0), 0.0, SOFTEST) / SOFT
    size = wp.sqrt(slip * slip + BULLDOZING_REGULARISATION * BULLDOZING_REGULARISATION)
    return load * m.bulldozing_resistance * softness * slip / size


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
def touch_forces(
    # parameters
    m: Tire,
    ground: Footing,
    # the contact: ground's unit normal in frame axes, depth of the middle disc, depth and place of the contact, and by how
    # much the depth grows with the way against the normal
    n: wp.vec3,
    middle: float,
    touch: DiscContact,
    steepness: float,
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
    """What a wheel whose discs dip into the ground feels: F_n = g max(0, k δ + c δ̇), δ̇ = −g n·v with g the ``steepness``,
    which is 1 on a plane; friction by the law of slip, torque by that of swivelling."""
    out = TireContact()
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    down = wp.vec3(-n[0] / tilt, 0.0, -n[2] / tilt)
    arm = touch.place
    slip = velocity + wp.cross(wp.vec3(omega[0], spin, omega[2]), arm)
    load = wp.max(steepness * (m.stiffness * touch.depth - m.damping * steepness * wp.dot(n, slip)), 0.0)
    forward = wp.vec3(n[2] / tilt, 0.0, -n[0] / tilt)
    sideways = wp.cross(n, forward)
    out.lever = wp.dot(arm, down)
    v = Slide(wp.dot(forward, slip), wp.dot(sideways, slip), 0.0, 0.0, load, ground.friction)
    grip = Friction()
    if m.slip_law == LUGRE:
        grip = lugre_slip(m, v, bristle_x, bristle_y, dt)
    else:
        v.roll = spin * out.lever
        grip = relaxed_slip(m, v, bristle_x, bristle_y, dt)
    if m.soft_ground_law == BULLDOZING:
        grip.y += bulldozing(m, ground, load, v.y)
    out.bristle_x = grip.bristle_x
    out.bristle_y = grip.bristle_y
    out.force = load * n - grip.x * forward - grip.y * sideways
    out.forward = forward
    out.damping = grip.damping
    rolling = (
        m.rolling_resistance * ground.rolling_resistance * load * out.lever * wp.tanh(spin / ROLLING_REGULARISATION)
    )
    out.moment = wp.cross(arm, out.force) - wp.vec3(0.0, rolling, 0.0)
    if m.swivel_law == CONTACT_POINT:
        if m.scrub_radius > 0.0:
            roll = wp.dot(forward, velocity)
            out.twist = scrub_step(m, twist, wp.dot(n, omega), roll, touch.depth, dt)
            out.moment += scrub_torque(m, 0.5 * (twist + out.twist), load, ground.friction) * n
    else:
        v.swivel = wp.dot(n, omega)
        v.roll = spin * out.lever
        if m.swivel_law == FIVE_DISCS:
            out.twist = discs_step(m, v, twist, touch.depth, dt)
            bristle = 0.5 * wp.vec2(bristle_x + out.bristle_x, bristle_y + out.bristle_y)
            torque = five_discs_torque(m, n, middle, v, bristle, 0.5 * (twist + out.twist))
            out.moment += torque * (1.0 + m.scrub_radius / mean_disc_offset(m)) * n
        else:
            out.twist = bore_step(m, v, twist, touch.depth, dt)
            out.moment += bore_torque(m, v, 0.5 * (twist + out.twist)) * n
    out.load = load
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
    """Contact of one wheel: F_n = max(0, k δ + c δ̇), friction by the law of slip, torque by that of swivelling.

    ``ground`` is the footing under the wheel's centre, a plane for all five discs. Valid for wheels whose discs meet it from
    above.
    """
    out = TireContact()
    n = wp.transpose(rotation) * ground.normal
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    down = wp.vec3(-n[0] / tilt, 0.0, -n[2] / tilt)

    middle = penetration(ground, origin + rotation * (centre + m.radius * down))
    touch = disc_contact(m, n, middle)

    if touch.depth > 0.0:
        out = touch_forces(
            m, ground, n, middle, touch, 1.0, velocity, omega, spin, bristle_x, bristle_y, twist, dt
        )
    return out


@wp.func
def hull_contact(
    m: Hull, ground: Footing, rotation: wp.mat33, origin: wp.vec3, point: wp.vec3, velocity: wp.vec3, omega: wp.vec3
):
    """Force [N], frame coordinates, on one corner of a hull: penalty spring and damper that never pulls, with Coulomb
    friction regularised below 5 cm/s."""
    world = origin + rotation * point
    depth = ground_height(ground, world[0], world[1]) - world[2]
    if depth <= 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    n = wp.transpose(rotation) * ground.normal
    v = velocity + wp.cross(omega, point)
    v_n = wp.dot(n, v)
    load = wp.max(m.stiffness * depth * (rotation * n)[2] - m.damping * v_n, 0.0)
    slip = v - v_n * n
    speed = wp.sqrt(wp.dot(slip, slip) + HULL_REGULARISATION * HULL_REGULARISATION)
    return load * n - (m.friction * load / speed) * slip
