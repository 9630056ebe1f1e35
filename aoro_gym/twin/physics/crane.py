"""Crane: four joints in a row on a moving frame, exact rigid bodies in closed form.

All is written in the axes of the frame that carries the crane, about its origin, as in
:mod:`aoro_gym.twin.physics.bodies`: a body with CoG p, inertia I and joint columns J_v = ∂ṗ/∂q̇, J_ω = ∂Ω/∂q̇ has

    v̇ = â + ω̇ × p + J_v q̈ + a₀,    Ω̇ = ω̇ + J_ω q̈ + α₀,

with a₀, α₀ what is left where ω̇, â and q̈ are zero (centripetal and Coriolis). Summed over the bodies,

    H q̈ = τ − b − U_aᵀ ω̇ − U_lᵀ â,    H = Σ m J_vᵀ J_v + J_ωᵀ I J_ω,
    U_l = Σ m J_v,    U_a = Σ p × m J_v + I J_ω,    b = Σ J_vᵀ m a₀ + J_ωᵀ (I α₀ + Ω × I Ω),

and with q̈ eliminated the frame feels an articulated inertia (Featherstone, *Rigid Body Dynamics Algorithms*, 2008, ch. 7).
Gravity is in â = v̇ − g. A force F at a place p of a log adds Jᵀ F to τ, and F and p × F to what the frame feels. Bodies:
pillar, main boom, stick, extension, and the grapple as a point at the tip, which neither swings nor turns; a log that it
holds hangs below, turns with the pillar and keeps its angle to it. Valid for rigid booms without friction. Units: m, kg, s,
rad, N.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.physics.bodies import Articulated, rigid_body

mat34: Any = wp.types.matrix(shape=(3, 4), dtype=float)
UPRIGHT = wp.constant(wp.vec3(0.0, 0.0, 1.0))


@wp.struct
class CraneRecord:
    """A crane (:class:`aoro_gym.machine.crane.Crane`)."""

    foot: wp.vec3  # [m] of the slewing axis, in the frame
    lift_offset: float  # [m]
    lift_height: float
    boom_length: float
    stick_length: float
    pillar_mass: float  # [kg]
    pillar_cog_forward: float  # [m]
    pillar_cog_height: float
    pillar_inertia_axial: float  # [kg m²]
    pillar_inertia_transverse: float
    boom_mass: float
    boom_cog_along: float
    boom_cog_over: float
    boom_inertia_axial: float
    boom_inertia_transverse: float
    stick_mass: float
    stick_cog_along: float
    stick_inertia_axial: float
    stick_inertia_transverse: float
    extension_mass: float
    extension_cog_along: float
    extension_inertia_axial: float
    extension_inertia_transverse: float
    grapple_mass: float
    held_drop: float  # [m] of a log that is held, below the tip
    held_mass: float  # [kg]; 0: none
    held_yaw: float  # [rad] of the log against the pillar
    held_inertia_axial: float  # [kg m²]
    held_inertia_transverse: float


@wp.struct
class CraneMotion:
    """Sums over the bodies of a crane."""

    carried: Articulated  # its inertia on the frame, joints locked
    h: wp.mat44  # mass matrix of the joints
    u_angular: mat34
    u_linear: mat34
    bias: wp.vec4
    tip: wp.vec3  # [m]
    tip_slopes: mat34  # its place with the joints
    tip_bias: wp.vec3  # [m/s²] its acceleration without ω̇, â and q̈
    kinetic: float  # [J] where the frame rests
    moment: wp.vec3  # [kg m] first moment of the mass about the frame's origin


@wp.struct
class Joined:
    """Where a link of the chain is, and how it moves without ω̇, â and q̈."""

    origin: wp.vec3  # [m] of its inner pin
    rate: wp.vec3  # [rad/s]
    turning: wp.vec3  # [rad/s²]
    acceleration: wp.vec3  # [m/s²] of its pin
    sliding: wp.vec3  # [m/s] of the body along it


@wp.func
def further(link: Joined, to: wp.vec3):
    """Acceleration [m/s²] of a point at ``to`` from the link's pin, for it alone."""
    return (
        link.acceleration
        + wp.cross(link.turning, to)
        + wp.cross(link.rate, wp.cross(link.rate, to))
        + 2.0 * wp.cross(link.rate, link.sliding)
    )


@wp.func
def next_link(link: Joined, to: wp.vec3, axis: wp.vec3, rate: float):
    """The link on a pin at ``to`` from this one's that turns about ``axis`` at ``rate`` [rad/s]."""
    out = Joined()
    out.origin = link.origin + to
    out.acceleration = further(link, to)
    out.turning = link.turning + wp.cross(link.rate, rate * axis)
    out.rate = link.rate + rate * axis
    return out


@wp.func
def columns(first: wp.vec3, second: wp.vec3, third: wp.vec3, fourth: wp.vec3):
    """Matrix of four columns."""
    return mat34(
        first[0], second[0], third[0], fourth[0],
        first[1], second[1], third[1], fourth[1],
        first[2], second[2], third[2], fourth[2],
    )  # fmt: skip


@wp.func
def along_inertia(along: wp.vec3, axial: float, transverse: float):
    """Inertia [kg m²] of a body that is alike about the unit vector ``along``."""
    return transverse * wp.identity(n=3, dtype=float) + (axial - transverse) * wp.outer(along, along)


@wp.func
def with_body(
    sums: CraneMotion, link: Joined, to: wp.vec3, mass: float, inertia: wp.mat33, jv: mat34, jw: mat34, rates: wp.vec4
):
    """``sums`` with a body whose CoG is at ``to`` from its link's pin."""
    out = sums
    place = link.origin + to
    force = mass * further(link, to)
    moment = inertia * link.turning + wp.cross(link.rate, inertia * link.rate)
    body = rigid_body(mass, inertia, place)
    out.carried.a += body.a
    out.carried.b += body.b
    out.carried.c += body.c
    out.carried.f += force
    out.carried.n += moment + wp.cross(place, force)
    out.h += mass * (wp.transpose(jv) * jv) + wp.transpose(jw) * (inertia * jw)
    out.u_linear += mass * jv
    out.u_angular += mass * (wp.skew(place) * jv) + inertia * jw
    out.bias += wp.transpose(jv) * force + wp.transpose(jw) * moment
    out.moment += mass * place
    speed = jv * rates
    turn = jw * rates
    out.kinetic += 0.5 * (mass * wp.dot(speed, speed) + wp.dot(turn, inertia * turn))
    return out


@wp.func
def crane_motion(m: CraneRecord, q: wp.vec4, rates: wp.vec4, omega: wp.vec3):
    """Sums over the bodies at joints ``q`` that move at ``rates`` on a frame that turns at ``omega`` [rad/s]."""
    zero = wp.vec3()
    radial = wp.vec3(wp.cos(q[0]), wp.sin(q[0]), 0.0)
    aside = wp.vec3(-wp.sin(q[0]), wp.cos(q[0]), 0.0)
    boom = wp.cos(q[1]) * radial + wp.sin(q[1]) * UPRIGHT
    over = wp.cos(q[1]) * UPRIGHT - wp.sin(q[1]) * radial
    stick = wp.cos(q[1] + q[2]) * radial + wp.sin(q[1] + q[2]) * UPRIGHT
    raising = -aside

    ground = Joined(zero, omega, zero, zero, zero)
    pillar = next_link(ground, m.foot, UPRIGHT, rates[0])
    lift = next_link(pillar, m.lift_offset * radial + m.lift_height * UPRIGHT, raising, rates[1])
    fold = next_link(lift, m.boom_length * boom, raising, rates[2])
    out_link = fold
    out_link.sliding = rates[3] * stick

    sums = CraneMotion()
    to = m.pillar_cog_forward * radial + m.pillar_cog_height * UPRIGHT
    jv = columns(wp.cross(UPRIGHT, to), zero, zero, zero)
    jw = columns(UPRIGHT, zero, zero, zero)
    inertia = along_inertia(UPRIGHT, m.pillar_inertia_axial, m.pillar_inertia_transverse)
    sums = with_body(sums, pillar, to, m.pillar_mass, inertia, jv, jw, rates)

    to = m.boom_cog_along * boom + m.boom_cog_over * over
    jv = columns(wp.cross(UPRIGHT, lift.origin + to - m.foot), wp.cross(raising, to), zero, zero)
    jw = columns(UPRIGHT, raising, zero, zero)
    inertia = along_inertia(boom, m.boom_inertia_axial, m.boom_inertia_transverse)
    sums = with_body(sums, lift, to, m.boom_mass, inertia, jv, jw, rates)

    to = m.stick_cog_along * stick
    jw = columns(UPRIGHT, raising, raising, zero)
    inertia = along_inertia(stick, m.stick_inertia_axial, m.stick_inertia_transverse)
    jv = stick_columns(m.foot, lift.origin, fold.origin, to, raising, zero)
    sums = with_body(sums, fold, to, m.stick_mass, inertia, jv, jw, rates)

    to = (m.stick_length + q[3] + m.extension_cog_along) * stick
    inertia = along_inertia(stick, m.extension_inertia_axial, m.extension_inertia_transverse)
    jv = stick_columns(m.foot, lift.origin, fold.origin, to, raising, stick)
    sums = with_body(sums, out_link, to, m.extension_mass, inertia, jv, jw, rates)

    to = (m.stick_length + q[3]) * stick
    jv = stick_columns(m.foot, lift.origin, fold.origin, to, raising, stick)
    sums = with_body(sums, out_link, to, m.grapple_mass, wp.mat33(), jv, jw, rates)
    sums.tip = fold.origin + to
    sums.tip_slopes = jv
    sums.tip_bias = further(out_link, to)
    if m.held_mass > 0.0:  # a body that slews alone
        hangs = Joined(sums.tip, pillar.rate, pillar.turning, sums.tip_bias, zero)
        along = wp.cos(m.held_yaw) * radial + wp.sin(m.held_yaw) * aside
        inertia = along_inertia(along, m.held_inertia_axial, m.held_inertia_transverse)
        jw = columns(UPRIGHT, zero, zero, zero)
        sums = with_body(sums, hangs, -m.held_drop * UPRIGHT, m.held_mass, inertia, jv, jw, rates)
    return sums


@wp.func
def stick_columns(foot: wp.vec3, lift: wp.vec3, fold: wp.vec3, to: wp.vec3, raising: wp.vec3, slide: wp.vec3):
    """Columns J_v of a body at ``to`` from the fold's pin; ``slide``: direction in which the telescope moves it."""
    return columns(
        wp.cross(UPRIGHT, fold + to - foot), wp.cross(raising, fold + to - lift), wp.cross(raising, to), slide
    )


@wp.func
def place_of_tip(m: CraneRecord, q: wp.vec4):
    """The tip [m] at joints ``q``, and its slopes with them."""
    radial = wp.vec3(wp.cos(q[0]), wp.sin(q[0]), 0.0)
    raising = wp.vec3(wp.sin(q[0]), -wp.cos(q[0]), 0.0)
    boom = wp.cos(q[1]) * radial + wp.sin(q[1]) * UPRIGHT
    stick = wp.cos(q[1] + q[2]) * radial + wp.sin(q[1] + q[2]) * UPRIGHT
    lift = m.foot + m.lift_offset * radial + m.lift_height * UPRIGHT
    fold = lift + m.boom_length * boom
    to = (m.stick_length + q[3]) * stick
    return fold + to, stick_columns(m.foot, lift, fold, to, raising, stick)


@wp.func
def held_log(m: CraneRecord, slew: float):
    """Half of the log that is held along its axis [m], a cylinder by its moments of inertia (l²/12 = (I_t − I_a/2)/m, r² = 2
    I_a/m), and the middle of its lower side from the tip."""
    mass = wp.max(m.held_mass, 1.0e-6)
    half = wp.sqrt(3.0 * wp.max(m.held_inertia_transverse - 0.5 * m.held_inertia_axial, 0.0) / mass)
    radius = wp.sqrt(2.0 * m.held_inertia_axial / mass)
    angle = slew + m.held_yaw
    return half * wp.vec3(wp.cos(angle), wp.sin(angle), 0.0), -(m.held_drop + radius) * UPRIGHT


@wp.func
def slewed(rate: float, to: wp.vec3):
    """Velocity [m/s] of a place of the log at ``to`` from the tip, beyond the tip's: the log slews at ``rate`` [rad/s]."""
    return wp.cross(rate * UPRIGHT, to)


@wp.func
def pushed(at: CraneMotion, foot: wp.vec3, force: wp.vec3, moment: wp.vec3):
    """Torques [N m] (N) on the joints of a ``force`` [N] on the log with a ``moment`` [N m] about the frame's origin, by
    their power: the log slews, and goes with the tip otherwise."""
    out = wp.transpose(at.tip_slopes) * force
    out[0] = (moment - wp.cross(foot, force))[2]
    return out


@wp.func
def carried_by_frame(at: CraneMotion, torque: wp.vec4):
    """The crane as its frame feels it, its joints under the ``torque`` (the last a force): moment = A ω̇ + B â + n,
    force = Bᵀ ω̇ + C â + f."""
    inverse = wp.inverse(at.h)
    u = torque - at.bias
    out = Articulated()
    out.a = at.carried.a - at.u_angular * (inverse * wp.transpose(at.u_angular))
    out.b = at.carried.b - at.u_angular * (inverse * wp.transpose(at.u_linear))
    out.c = at.carried.c - at.u_linear * (inverse * wp.transpose(at.u_linear))
    out.n = at.carried.n + at.u_angular * (inverse * u)
    out.f = at.carried.f + at.u_linear * (inverse * u)
    return out


@wp.func
def joint_acceleration(at: CraneMotion, torque: wp.vec4, angular: wp.vec3, linear: wp.vec3):
    """q̈ from the frame's angular and (gravity-free) linear acceleration at its origin."""
    u = torque - at.bias - wp.transpose(at.u_angular) * angular - wp.transpose(at.u_linear) * linear
    return wp.inverse(at.h) * u


@wp.func
def tip_specific_force(at: CraneMotion, joints: wp.vec4, angular: wp.vec3, linear: wp.vec3):
    """Specific force [m/s²] of what hangs at the tip, from the accelerations of joints and frame."""
    return linear + wp.cross(angular, at.tip) + at.tip_slopes * joints + at.tip_bias
