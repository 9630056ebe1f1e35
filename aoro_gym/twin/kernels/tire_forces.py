"""Forces of the ground on the tires, for pictures: what the next main step begins with, evaluated from the state alone."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from functools import cache
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.laws import ChosenLaws, with_laws
from aoro_gym.twin.kernels.motion import rear_rate
from aoro_gym.twin.kernels.state import load_state
from aoro_gym.twin.physics.bodies import arm_tangent, hinge_rotation, wheel_centre
from aoro_gym.twin.physics.ground import footing, penetration
from aoro_gym.twin.physics.tire_discs import wheel_contact
from aoro_gym.twin.records import MachineRecord


def tire_forces(
    machines: wp.array(dtype=MachineRecord),
    laws: Any,
    terrain: Any,
    state: wp.array2d(dtype=float),
    # by twin and wheel: force [N] on the tire, contact point [m], both in the world
    forces: wp.array2d(dtype=wp.vec3),
    feet: wp.array2d(dtype=wp.vec3),
    h: float,
):
    """Forces on all wheels of each twin, as ``advance`` computes them in a main step of ``h`` [s]; it extrapolates
    the motion to the middle of the step, which is left out here."""
    t, i = wp.tid()
    m = with_laws(laws, machines[t % machines.shape[0]])
    ground = terrain.twins[t]
    pose, velocity, change, bent, actuators, circuits, engine = load_state(state, t, m.varies_laws)  # noqa: RUF059
    to_rear = hinge_rotation(pose.joint)
    rotation = wp.quat_to_matrix(pose.orientation)
    linear = velocity.linear
    omega = velocity.angular
    direction = float(1.0)
    pivot_x = m.frame_front.pivot_x
    if i >= 2:
        rotation = rotation * wp.transpose(to_rear)
        linear = to_rear * linear
        omega = rear_rate(to_rear, velocity)
        direction = float(-1.0)
        pivot_x = m.frame_rear.pivot_x
    angle = pose.arms[i]
    centre = wheel_centre(m.corner, pivot_x, direction, 1.0 - 2.0 * float(i & 1), angle)
    tangent = arm_tangent(direction, angle, m.corner.arm_length)
    hub = linear + wp.cross(omega, centre) + velocity.arms[i] * tangent
    middle = pose.position + rotation * centre
    under = footing(terrain, ground, middle)
    contact = wheel_contact(
        terrain, ground, m.tire, under, rotation, pose.position, centre, hub, omega, velocity.spins[i], bent.bristle_x[i],
        bent.bristle_y[i], bent.twist[i], h,
    )
    forces[t, i] = rotation * contact.force
    foot = middle - contact.lever * under.normal
    feet[t, i] = foot + penetration(under, foot) * under.normal


@cache
def build(kind: Any, laws: Any) -> Any:
    """The kernel for one kind of ground and of laws, see :func:`aoro_gym.twin.kernels.build.build`."""
    module = f"{__name__}.{kind.key.lower()}" + ("_laws" if laws is ChosenLaws else "")
    wp.set_module_options({"default_grid_stride": False}, module=module)
    return wp.overload(wp.kernel(tire_forces, enable_backward=False, module=module), {"laws": laws, "terrain": kind})
