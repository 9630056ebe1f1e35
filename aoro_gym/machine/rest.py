"""Bodies and pose that follow from the machine's parameters: the composite corner, and the static rest pose.

Frame coordinates: x forward, y left, z up, origin on the hinge axis in the design ground plane, ``arm.pivot_height`` below
the pivots. The machine stands with level frames and straight joint, front arms at ``arm.rest_angle``; how high, its load
and its tires decide, and the frames' own geometry does not change with them.
"""

from dataclasses import dataclass

import numpy as np

from aoro_gym.machine.quantities import Quantity, as_quantity
from aoro_gym.machine.sections import Arm, Frame, Payload, Tire, Wheel
from aoro_gym.units import GRAVITY

_CONVERGED = 1e-14  # [rad] change of the rear arm angle in one iteration
_MAX_ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class Corner:
    """Arm, motor and wheel as one rigid body, without the wheel's inertia about its axle.

    Axes: e along the arm from pivot to wheel, y lateral, positive outward, n normal to both. Attributes are floats or
    arrays of shape (N,).
    """

    mass: Quantity  # [kg]
    rho: Quantity  # [m] CoG from the pivot along the arm
    lateral: Quantity  # [m] |y| of the CoG
    inertia_ee: Quantity  # [kg m²] about the CoG
    inertia_yy: Quantity
    inertia_nn: Quantity
    inertia_ey: Quantity  # tensor element −Σ m e y


@dataclass(frozen=True, eq=False)
class RestPose:
    """Static equilibrium on level ground with level frames and straight joint; floats or arrays of shape (N,)."""

    height: Quantity  # [m] of the design ground plane over the ground
    arm_angle_front: Quantity  # [rad] elevation of the wheel over the pivot
    arm_angle_rear: Quantity
    wheel_load_front: Quantity  # [N] on one wheel
    wheel_load_rear: Quantity
    deflection_front: Quantity  # [m] of one tire
    deflection_rear: Quantity
    bore_pressure_front: Quantity  # [Pa] in an arm cylinder, with arm.rod_rest_pressure on its rod side
    bore_pressure_rear: Quantity


def composite_corner(arm: Arm, wheel: Wheel, track: Quantity) -> Corner:
    """One corner: arm, motor (a point at the wheel centre) and wheel, at half the ``track`` [m]."""
    outside = 0.5 * track
    at_wheel = arm.motor_mass + wheel.mass
    mass = arm.mass + at_wheel
    arm_e, arm_y = arm.cog_fraction * arm.length, 0.5 * (arm.pivot_lateral + outside)
    rho = (arm.mass * arm_e + at_wheel * arm.length) / mass
    lateral = (arm.mass * arm_y + at_wheel * outside) / mass
    # two points on a line: Σ m (r − r̄)(r − r̄)ᵀ = reduced mass × distance × distanceᵀ
    reduced = arm.mass * at_wheel / mass
    de, dy = arm.length - arm_e, outside - arm_y
    return Corner(
        mass=mass,
        rho=rho,
        lateral=lateral,
        inertia_ee=arm.inertia_axial + wheel.inertia_transverse + reduced * dy**2,
        inertia_yy=arm.inertia_transverse + reduced * de**2,
        inertia_nn=arm.inertia_transverse + wheel.inertia_transverse + reduced * (de**2 + dy**2),
        inertia_ey=-reduced * de * dy,
    )


def rest_pose(frame: Frame, arm: Arm, tire: Tire, corner: Corner, payload: Payload) -> RestPose:
    """Rest pose of a machine of two frames and four corners with a load on the rear frame.

    The front arms' angle is given and sets the frames' height; the rear arms' angle follows from it and from the
    difference of tire deflections. Loads depend on that angle through the wheels' position, weakly (below 0.01 rad per
    rad), so iterating converges in a few rounds.

    Where the rear wheels cannot reach the ground, or the iteration finds no pose, the rear arms' angle is NaN.

    Args:
        frame: Both frames.
        arm: Each of the four.
        tire: Likewise.
        corner: Likewise.
        payload: In the middle of its bunk.
    """
    front, rear = arm.rest_angle, arm.rest_angle
    pivot_front = frame.front.axle_distance - arm.length
    pivot_rear = frame.rear.axle_distance - arm.length
    weight = GRAVITY * (frame.front.mass + frame.rear.mass + 4.0 * corner.mass + payload.mass)
    for _ in range(_MAX_ITERATIONS):
        wheel_front = pivot_front + arm.length * np.cos(front)
        wheel_rear = pivot_rear + arm.length * np.cos(rear)
        moment = GRAVITY * (
            frame.front.mass * frame.front.cog_x
            + frame.rear.mass * frame.rear.cog_x
            + payload.mass * payload.cog_x
            + 2.0 * corner.mass * (pivot_front + corner.rho * np.cos(front) - pivot_rear - corner.rho * np.cos(rear))
        )
        load_front = 0.5 * (moment + weight * wheel_rear) / (wheel_front + wheel_rear)
        load_rear = 0.5 * weight - load_front
        deflection_front = load_front / tire.stiffness
        deflection_rear = load_rear / tire.stiffness
        pivots = tire.radius - deflection_front - arm.length * np.sin(front)
        reach = (tire.radius - deflection_rear - pivots) / arm.length
        previous, rear = rear, np.arcsin(np.clip(reach, -1.0, 1.0))
        if np.all(np.abs(rear - previous) < _CONVERGED):
            break
    found = (np.abs(reach) < 1.0) & (np.abs(rear - previous) < _CONVERGED)
    rear = as_quantity(np.where(found, rear, np.nan))

    rod = arm.rod_rest_pressure

    def bore_pressure(angle: Quantity, load: Quantity) -> Quantity:
        """Bore pressure that carries the frame: p_b A_b = torque / lever + p_r A_r."""
        torque = (load * arm.length - GRAVITY * corner.mass * corner.rho) * np.cos(angle)
        force = torque / arm.cylinder.linkage.lever(-angle)
        return (force + rod * arm.cylinder.annulus_area) / arm.cylinder.bore_area

    return RestPose(
        height=pivots - arm.pivot_height,
        arm_angle_front=front,
        arm_angle_rear=rear,
        wheel_load_front=load_front,
        wheel_load_rear=load_rear,
        deflection_front=deflection_front,
        deflection_rear=deflection_rear,
        bore_pressure_front=bore_pressure(front, load_front),
        bore_pressure_rear=bore_pressure(rear, load_rear),
    )
