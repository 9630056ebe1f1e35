"""What lies between the steering cylinders and the frames: free play of the pins, bending of mounts and frames.

The cylinders move the joint through a torsion spring behind a dead zone. ``deflection`` x [rad] is how far they are ahead of
the joint. Oil, dry friction and the ends of the stroke act on the cylinders, the frames' inertia on the joint: how much of
the friction is the hinge's own, no log of a tight joint tells, and with all of it here a stiff mount is the rigid joint.
Without the element (stiffness 0) cylinders and joint are one.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.steering_circuit import SteeringGeometry

MOVING_MASS = wp.constant(10.0)  # [kg] of one cylinder's piston, rod and oil that moves with them; resolved, hardly felt
LOSS_TIME = wp.constant(1.0e-3)  # [s] damping over stiffness of mounts and frames: 1 to 3 % of critical


@wp.struct
class MountState:
    deflection: float  # [rad] of the cylinders ahead of the joint
    rate: float  # [rad/s] of the cylinders, as a joint rate
    friction: float  # [rad] deflection of the joint's dry friction: seals and bearing


@wp.func
def mount_torque(stiffness: float, backlash: float, hardening: float, deflection: float, slip: float):
    """Torque [N m] of the cylinders on the frames: k (b + c ẋ) with b the part of x beyond the free play, |c ẋ| ≤ |b|.

    A spring behind a dead zone of full width ``backlash`` [rad] with Kelvin–Voigt losses (c = ``LOSS_TIME``) that never
    pulls the pins back. A spring that hardens, a = ``hardening`` > 0 [1/rad], has b (1 + a|b|/2) for b and c (1 + a|b|) for
    c: its stiffness grows in line with its bend, to 2 k at 1/a, as clearances of pins and bushings close and more of them
    bears. Valid for bends of a few 1/a.
    """
    half = 0.5 * backlash
    bent = deflection - wp.clamp(deflection, -half, half)
    if hardening > 0.0:
        spring = bent * (1.0 + 0.5 * hardening * wp.abs(bent))
        loss = LOSS_TIME * (1.0 + hardening * wp.abs(bent)) * slip
        return stiffness * (spring + wp.clamp(loss, -wp.abs(spring), wp.abs(spring)))
    return stiffness * (bent + wp.clamp(LOSS_TIME * slip, -wp.abs(bent), wp.abs(bent)))


@wp.func
def mount_bend(stiffness: float, hardening: float, torque: float):
    """Bend b [rad] beyond the free play under a constant ``torque`` [N m]: the inverse of :func:`mount_torque` at rest."""
    bent = torque / stiffness
    if hardening > 0.0:  # root of b (1 + a|b|/2) = T/k, without a difference of like numbers
        bent *= 2.0 / (1.0 + wp.sqrt(1.0 + 2.0 * hardening * wp.abs(bent)))
    return bent


@wp.func
def mount_step(
    g: SteeringGeometry,
    stiffness: float,
    backlash: float,
    hardening: float,
    torque: float,
    grip: float,
    drag: float,
    joint_rate: float,
    x: MountState,
    dt: float,
):
    """Mount after ``dt``: I ẇ = τ − T(x, ẋ), ẋ = w − θ̇, with I of both cylinders' moving mass.

    ``torque`` τ [N m] is that of oil, friction and ends of the stroke, and ``grip`` −∂τ/∂θ [N m/rad] and ``drag`` −∂τ/∂w
    [N m s/rad] are how it changes as the cylinders move. Linearly implicit in these and in the spring, so that any
    ``stiffness`` is stable and a great one gives the rigid joint; the oil's stiffness on the moving mass (below 600 Hz) is
    resolved by the substep. The friction's deflection is left as it is.
    """
    slip = x.rate - joint_rate
    held = wp.where(wp.abs(x.deflection) < 0.5 * backlash, 0.0, dt * stiffness)  # [N m s/rad]
    if hardening > 0.0:
        held *= 1.0 + hardening * (wp.abs(x.deflection) - 0.5 * backlash)
    inertia = MOVING_MASS * (g.lever_left * g.lever_left + g.lever_right * g.lever_right)
    push = torque - mount_torque(stiffness, backlash, hardening, x.deflection, slip) - held * slip - dt * grip * x.rate
    out = MountState()
    out.rate = x.rate + dt * push / (inertia + (dt + LOSS_TIME) * held + dt * (dt * grip + drag))
    out.deflection = x.deflection + dt * (out.rate - joint_rate)
    out.friction = x.friction
    return out
