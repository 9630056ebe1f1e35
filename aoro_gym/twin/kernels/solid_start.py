"""Kernels for the start of twins among solid objects, and for how deep they are in them."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.kernels.solids import FRONT, Objects, near, next_object
from aoro_gym.twin.kernels.state import load_state
from aoro_gym.twin.physics.bodies import hinge_rotation, hull_corner, wheel_centre
from aoro_gym.twin.physics.solids import gap, hull_part, in_frame, wheel_part
from aoro_gym.twin.records import MachineRecord


@wp.kernel(enable_backward=False)
def clear(objects: Objects, mask: wp.array(dtype=wp.bool), numbers: wp.array(dtype=int)):
    """Twins of the ``mask`` that have touched nothing yet; where ``numbers`` is not negative, in that world."""
    t = wp.tid()
    if not mask[t]:
        return
    if numbers[t] >= 0:
        objects.worlds[t] = numbers[t]
    for row in range(objects.touches.shape[0]):
        objects.touches[row, t] = 0.0
    for row in range(objects.bristles.shape[0]):
        objects.bristles[row, t] = 0.0


@wp.kernel(enable_backward=False)
def overlaps(
    machines: wp.array(dtype=MachineRecord),
    objects: Objects,
    state: wp.array2d(dtype=float),
    # by part and twin: objects whose boxes overlap the part's, the deepest one's depth [m] and number
    candidates: wp.array2d(dtype=int),
    depths: wp.array2d(dtype=float),
    numbers: wp.array2d(dtype=int),
):
    """How deep each part of each twin (4 wheels, front and rear chassis) is in objects: 0 and number 0 where in none."""
    i, t = wp.tid()
    m = machines[t % machines.shape[0]]
    pose, velocity, change, bent, actuators, circuits, engine = load_state(state, t, 0)  # noqa: RUF059
    rotation = wp.quat_to_matrix(pose.orientation)
    rear = i == 2 or i == 3 or i == FRONT + 1
    frame = m.frame_front
    direction = float(1.0)
    if rear:
        rotation = rotation * wp.transpose(hinge_rotation(pose.joint))
        frame = m.frame_rear
        direction = float(-1.0)
    part = hull_part(hull_corner(frame, m.frame_ground_clearance, 0), hull_corner(frame, m.frame_ground_clearance, 7))
    if i < FRONT:
        side = 1.0 - 2.0 * float(i & 1)
        part = wheel_part(m.tire, wheel_centre(m.corner, frame.pivot_x, direction, side, pose.arms[i]))
    deepest = float(0.0)
    number = int(0)
    count = int(0)
    at = near(objects.grids[objects.worlds[t]], part, rotation, pose.position)
    while at.row <= at.last_row:
        at = next_object(objects.starts, objects.order, objects.boxes, at)
        if at.found < 0:
            break
        count += 1
        depth = gap(part, in_frame(objects.shapes[at.found], rotation, pose.position)).depth
        if depth > deepest:
            deepest = depth
            number = objects.numbers[at.found]
    candidates[i, t] = count
    depths[i, t] = deepest
    numbers[i, t] = number
