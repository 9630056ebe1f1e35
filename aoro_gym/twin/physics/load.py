"""Load: a rigid pile of logs in the bunk of the rear frame, which slides lengthwise on dry friction between stops.

The pile translates along the frame's x axis and turns with the frame, so its joint is prismatic, S = (0, x̂), and is
eliminated like an arm's: U = I S, D = m (Featherstone, *Rigid Body Dynamics Algorithms*, 2008, ch. 7). With the specific
force â = (â_x, â_y, â_z) of the pile's CoG (acceleration less weight), Coulomb friction of floor and stakes holds it by

    |F| ≤ μ m (max(â_z, 0) + |â_y|),

as a Prandtl element (:mod:`aoro_gym.twin.physics.friction`) of stiffness k = μ m g/z₀ and damping 2 ζ √(k m): the way z₀
until it slides is the same for one log and for many. Valid while the logs lie in their bunk: a pile that would lift off is
held down, logs neither roll nor shift against each other, and the stakes are rigid. Symbols: units m, kg, s, N.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.bodies import eliminate, rigid_body
from aoro_gym.twin.physics.friction import dry_friction, end_stop, presliding
from aoro_gym.units import GRAVITY

STANDARD_GRAVITY = wp.constant(GRAVITY)  # [m/s²] at which the presliding distance is given
LENGTHWISE = wp.constant(wp.vec3(1.0, 0.0, 0.0))


@wp.struct
class Payload:
    """The logs in the bunk (machine section ``payload``)."""

    mass: float  # [kg]; 0: none
    cog_x: float  # [m] from the hinge, forward positive
    cog_height: float  # [m] over the design ground plane
    inertia_xx: float  # [kg m²] about the CoG
    inertia_yy: float
    inertia_zz: float
    friction: float  # [-]
    presliding_distance: float  # [m]
    presliding_damping: float  # [-] of the critical one
    slide_range: float  # [m] to either side; 0: fixed
    stop_stiffness: float  # [N/m]
    stop_damping: float  # [N s/m]


@wp.struct
class LoadState:
    """How the logs lie in their bunk."""

    slide: float  # [m] from the middle, forward positive
    rate: float  # [m/s]
    friction: float  # [m] deflection of the friction element
    acceleration: float  # [m/s²] over the last main step, along the bunk
    pressing: float  # [m/s²] specific force that presses on floor and stakes


@wp.struct
class LoadSolution:
    """An eliminated load: s̈ = (u − U_a·ω̇ − U_l·â)/D."""

    position: wp.vec3  # [m] of the CoG from the hinge's origin
    bias: wp.vec3  # [m/s²] of its acceleration
    u_angular: wp.vec3
    u_linear: wp.vec3
    u: float  # [N]


@wp.func
def pressing_force(specific: wp.vec3):
    """Force [m/s²] a unit of mass with which a load of the ``specific`` force [m/s²] presses on floor and stakes."""
    return wp.max(specific[2], 0.0) + wp.abs(specific[1])


@wp.func
def load_grip(m: Payload):
    """Stiffness [1/s²] of the friction element over its capacity: g/z₀, a unit of mass and of μ."""
    return STANDARD_GRAVITY / m.presliding_distance


@wp.func
def resting_load(m: Payload, up: wp.vec3, gravity: float):
    """A load at rest in the middle of its bunk, whose friction bears what of its weight lies along it.

    ``up`` is the upward direction in the frame's axes, ``gravity`` in m/s².
    """
    out = LoadState()
    out.pressing = gravity * pressing_force(up)
    limit = out.pressing / load_grip(m)
    if m.friction > 0.0:
        out.friction = wp.clamp(-gravity * up[0] / (m.friction * load_grip(m)), -limit, limit)
    return out


@wp.func
def load_force(m: Payload, state: LoadState, rate: float):
    """Force [N] of friction and stops on the load at ``rate`` [m/s], forward positive."""
    stiffness = m.friction * m.mass * load_grip(m)
    damping = 2.0 * m.presliding_damping * wp.sqrt(stiffness * m.mass)
    capacity = m.friction * m.mass * state.pressing
    return dry_friction(state.friction, rate, capacity, stiffness, damping) + end_stop(
        state.slide, rate, m.slide_range, m.stop_stiffness, m.stop_damping
    )


@wp.func
def drifted(m: Payload, state: LoadState, h: float):
    """``state`` a main step of ``h`` [s] later in its positions, which belong to the middle of the step (leapfrog)."""
    out = state
    out.slide += h * state.rate
    out.friction = presliding(state.friction, state.rate, h, state.pressing, load_grip(m))
    return out


@wp.func
def load_inertia(m: Payload, state: LoadState, omega: wp.vec3, h: float):
    """The load about the hinge's origin on a frame that turns at ``omega`` [rad/s]: returns (Articulated without the load's
    freedom, LoadSolution). Its rate is extrapolated to the middle of the step of ``h`` [s]."""
    rate = state.rate + 0.5 * h * state.acceleration
    out = LoadSolution()
    out.position = wp.vec3(m.cog_x + state.slide, 0.0, m.cog_height)
    out.bias = wp.cross(omega, wp.cross(omega, out.position)) + 2.0 * rate * wp.cross(omega, LENGTHWISE)
    inertia = wp.diag(wp.vec3(m.inertia_xx, m.inertia_yy, m.inertia_zz))
    body = rigid_body(m.mass, inertia, out.position)
    body.f = m.mass * out.bias
    body.n = wp.cross(omega, inertia * omega) + wp.cross(out.position, body.f)
    if m.slide_range == 0.0:
        return body, out
    out.u_linear = m.mass * LENGTHWISE
    out.u_angular = wp.cross(out.position, out.u_linear)
    out.u = load_force(m, state, rate) - body.f[0]
    return eliminate(body, out.u_angular, out.u_linear, m.mass, out.u), out


@wp.func
def moved_load(m: Payload, state: LoadState, at: LoadSolution, angular: wp.vec3, linear: wp.vec3, h: float):
    """``state`` after the kick of a step of ``h`` [s], from the frame's angular and (gravity-free) linear acceleration at
    the hinge's origin."""
    out = state
    if m.slide_range > 0.0:
        out.acceleration = (at.u - wp.dot(at.u_angular, angular) - wp.dot(at.u_linear, linear)) / m.mass
        out.rate += h * out.acceleration
    out.pressing = pressing_force(linear + wp.cross(angular, at.position) + at.bias)
    return out
