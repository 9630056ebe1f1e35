"""What solid objects do to the machine: which are near, and their forces on its wheels and its chassis.

:data:`OBJECT_GROUNDS` stand for grounds with objects on them in ``advance``, whose functions of the corners, the hulls and
the outputs are exchanged for those below (:mod:`aoro_gym.twin.kernels.build`); kernels without objects know nothing of all
this.

Broad phase: a uniform grid over each world in plan has the objects of each cell, built once on the host. A part asks the
cells that its axis-aligned box meets. An object that lies in several of them is told in the first one that both share, so
once, and only if their boxes overlap.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.corners import Half, corner_contact, hull_loads
from aoro_gym.twin.kernels.hydraulics import Signals
from aoro_gym.twin.kernels.outputs import GroundContact, record_outputs
from aoro_gym.twin.kernels.state import Actuators, Circuits, Deflections, OilLoads, Pose, Velocity
from aoro_gym.twin.physics.arms import ArmGeometry, ArmState
from aoro_gym.twin.physics.bodies import Accelerations, CornerLoad, FrameBody, hull_corner, wheel_centre
from aoro_gym.twin.physics.engine import EngineState
from aoro_gym.twin.physics.ground import Meshes, Rasters
from aoro_gym.twin.physics.solids import Part, Solid, gap, hull_on_solid, hull_part, in_frame, tire_on_solid, wheel_part
from aoro_gym.twin.physics.tires import Hull, Tire
from aoro_gym.twin.records import FIRST_OBJECT_OUTPUT, OBJECT_PARTS, MachineRecord

FRONT = wp.constant(4)  # number of the front chassis among the parts, after the wheels
TOUCH_ROWS = wp.constant(4)  # of a part in ``Objects.touches``: force x, y, z in the world [N], number of an object
BRISTLE_ROWS = wp.constant(6)  # of a wheel in ``Objects.bristles``: twice number of an object, deflections x, y [m]
ALL_TOUCH_ROWS = wp.constant(4 * len(OBJECT_PARTS))
FIRST_ROW = wp.constant(FIRST_OBJECT_OUTPUT)


@wp.struct
class Box:
    """Axis-aligned box of an object."""

    low: wp.vec3  # [m]
    high: wp.vec3
    column: int  # of the grid, of its western edge
    row: int  # of its southern edge


@wp.struct
class Grid:
    """Grid over the objects of one world."""

    x: float  # [m] western edge
    y: float  # southern edge
    inverse_cell: float  # [1/m]
    columns: int
    rows: int
    first: int  # its first cell among those of all worlds


@wp.struct
class Objects:
    """The objects of all worlds, and what each twin has to do with them."""

    grids: wp.array(dtype=Grid)  # one a world
    starts: wp.array(dtype=int)  # of each cell's objects in ``order``, and the end of the last one's
    order: wp.array(dtype=int)
    boxes: wp.array(dtype=Box)  # one an object
    shapes: wp.array(dtype=Solid)
    numbers: wp.array(dtype=int)  # in its world, from 1
    worlds: wp.array(dtype=int)  # one a twin
    touches: wp.array2d(dtype=float)  # rows of parts × twins: what touched last
    bristles: wp.array2d(dtype=float)  # rows of wheels × twins: friction with the two objects of the largest load


@wp.struct
class ObjectSite:
    """A twin on a ground with objects, as ``advance`` knows it."""

    gravity: float  # [m/s²]
    twin: int


@wp.struct
class ObjectRasters:
    """Rasters with objects on them."""

    twins: wp.array(dtype=ObjectSite)
    ground: Rasters
    objects: Objects


@wp.struct
class ObjectMeshes:
    """Triangles with objects on them."""

    twins: wp.array(dtype=ObjectSite)
    ground: Meshes
    objects: Objects


OBJECT_GROUNDS = {Rasters: ObjectRasters, Meshes: ObjectMeshes}
"""By the kind of ground below them."""


@wp.struct
class Search:
    """A way through the objects near a box."""

    low: wp.vec3  # [m]
    high: wp.vec3
    grid: Grid
    first_column: int
    last_column: int
    first_row: int
    last_row: int
    column: int  # where it is
    row: int
    at: int  # the next of the cell's objects
    end: int
    found: int  # index of an object; -1: there is none more


@wp.func
def search(grid: Grid, low: wp.vec3, high: wp.vec3):
    """Search of the objects whose boxes overlap that from ``low`` to ``high`` [m], before the first."""
    out = Search()
    out.low = low
    out.high = high
    out.grid = grid
    # clamped as floats: what is far away, or not finite, fits no whole number
    columns = float(grid.columns)
    rows = float(grid.rows)
    out.first_column = int(wp.clamp(wp.floor((low[0] - grid.x) * grid.inverse_cell), 0.0, columns))
    out.last_column = int(wp.clamp(wp.floor((high[0] - grid.x) * grid.inverse_cell), -1.0, columns - 1.0))
    out.first_row = int(wp.clamp(wp.floor((low[1] - grid.y) * grid.inverse_cell), 0.0, rows))
    out.last_row = int(wp.clamp(wp.floor((high[1] - grid.y) * grid.inverse_cell), -1.0, rows - 1.0))
    out.column = out.first_column - 1
    out.row = out.first_row
    if out.last_column < out.first_column:
        out.row = out.last_row + 1
    out.found = -1
    return out


@wp.func
def overlap(box: Box, low: wp.vec3, high: wp.vec3):
    """Whether two boxes meet."""
    return (
        box.low[0] <= high[0]
        and low[0] <= box.high[0]
        and box.low[1] <= high[1]
        and low[1] <= box.high[1]
        and box.low[2] <= high[2]
        and low[2] <= box.high[2]
    )


@wp.func
def next_object(starts: wp.array(dtype=int), order: wp.array(dtype=int), boxes: wp.array(dtype=Box), now: Search):
    """``now`` at the next object, or at none: then it is past the last row."""
    out = now
    out.found = -1
    while out.found < 0 and out.row <= out.last_row:
        if out.at < out.end:
            index = order[out.at]
            out.at += 1
            box = boxes[index]
            told_here = (
                wp.max(box.column, out.first_column) == out.column and wp.max(box.row, out.first_row) == out.row
            )
            if told_here and overlap(box, out.low, out.high):
                out.found = index
        else:
            out.column += 1
            if out.column > out.last_column:
                out.column = out.first_column
                out.row += 1
            if out.row <= out.last_row:
                cell = out.grid.first + out.row * out.grid.columns + out.column
                out.at = starts[cell]
                out.end = starts[cell + 1]
    return out


@wp.func
def near(grid: Grid, part: Part, rotation: wp.mat33, origin: wp.vec3):
    """Search of the objects near a part of a frame at ``origin`` [m] of a ``rotation``."""
    middle = origin + rotation * part.centre
    reach = wp.vec3()
    for i in range(3):
        reach[i] = (
            wp.abs(rotation[i, 0]) * part.half[0]
            + wp.abs(rotation[i, 1]) * part.half[1]
            + wp.abs(rotation[i, 2]) * part.half[2]
            + part.margin
        )
    return search(grid, middle - reach, middle + reach)


@wp.struct
class Touched:
    """What objects do to one part, in its frame's axes."""

    force: wp.vec3  # [N]
    moment: wp.vec3  # [N m] about a wheel's centre, or the hinge's origin
    number: int  # of the object of the largest load, in its world; 0: none
    spin_damping: float  # [N m s/rad] that the tire's friction gives the wheel's spin
    damping_force: wp.vec3  # [N s/rad] that a rate of the spin brings with it


@wp.func
def tell(touches: wp.array2d(dtype=float), twin: int, part: int, touched: Touched, rotation: wp.mat33):
    """Keep what touched a ``part``; nothing is written while nothing does."""
    row = TOUCH_ROWS * part
    if touched.number > 0 or touches[row + 3, twin] > 0.0:
        force = rotation * touched.force
        for i in range(3):
            touches[row + i, twin] = force[i]
        touches[row + 3, twin] = float(touched.number)


@wp.func
def kept_bristle(objects: Objects, row: int, twin: int):
    """Number of an object and the bristles of a wheel's friction with it."""
    return wp.vec3(objects.bristles[row, twin], objects.bristles[row + 1, twin], objects.bristles[row + 2, twin])


@wp.func
def keep_bristle(objects: Objects, row: int, twin: int, value: wp.vec3):
    """Inverse of :func:`kept_bristle`."""
    for i in range(3):
        objects.bristles[row + i, twin] = value[i]


@wp.func
def wheel_touched(
    tire: Tire, objects: Objects, twin: int, friction: float, half: Half, i: int, centre: wp.vec3,
    velocity: wp.vec3, spin: float, found: Search, before: bool, h: float,
):  # fmt: skip
    """What the objects from that which is ``found`` on do to wheel ``i`` at ``centre`` [m] that moves at ``velocity`` [m/s],
    both of the frame; ``before``: whether any touched it in the step before.

    Every object presses; friction remembers its bristles with the two of the largest load, any other starts anew in each
    step, so that it only damps.
    """
    out = Touched()
    part = wheel_part(tire, centre)
    row = BRISTLE_ROWS * i
    old_first = wp.vec3()
    old_second = wp.vec3()
    if before:
        old_first = kept_bristle(objects, row, twin)
        old_second = kept_bristle(objects, row + 3, twin)
    first = wp.vec3()
    second = wp.vec3()
    first_load = float(-1.0)
    second_load = float(-1.0)
    at = found
    while at.found >= 0:
        one = in_frame(objects.shapes[at.found], half.rotation, half.origin)
        between = gap(part, one)
        if between.depth > 0.0:
            number = float(objects.numbers[at.found])
            bristle = wp.vec3(number, 0.0, 0.0)
            if old_first[0] == number:
                bristle = old_first
            elif old_second[0] == number:
                bristle = old_second
            contact = tire_on_solid(
                tire, between, centre, velocity, half.omega, spin, friction * one.friction, bristle[1], bristle[2], h
            )
            out.force += contact.force
            out.moment += contact.moment
            out.spin_damping += contact.damping * contact.lever * contact.lever
            out.damping_force += (contact.damping * contact.lever) * contact.forward
            bristle = wp.vec3(number, contact.bristle_x, contact.bristle_y)
            if contact.load > first_load:
                second = first
                second_load = first_load
                first = bristle
                first_load = contact.load
            elif contact.load > second_load:
                second = bristle
                second_load = contact.load
        at = next_object(objects.starts, objects.order, objects.boxes, at)
    out.number = int(first[0])
    if before or out.number > 0:
        keep_bristle(objects, row, twin, first)
        keep_bristle(objects, row + 3, twin, second)
    return out


@wp.func
def loaded(load: CornerLoad, touched: Touched, last: float, inertia: float, h: float):
    """``load`` with that of objects, implicit in the wheel's spin as in
    :func:`aoro_gym.twin.kernels.corners.implicitly_damped`; and the force [N] of the objects with that."""
    out = load
    out.moment += touched.moment
    lacking = last - (out.wheel_torque + out.moment[1]) / inertia
    share = 0.5 * h * lacking * inertia / (inertia + 0.5 * h * touched.spin_damping)
    force = touched.force - share * touched.damping_force
    out.moment += wp.vec3(0.0, share * touched.spin_damping, 0.0)
    out.force += force
    return out, force


@wp.func
def object_corner_contact(
    m: MachineRecord, terrain: Any, ground: ObjectSite, half: Half, i: int, g: ArmGeometry, cylinder: ArmState,
    arm_angles: wp.vec4, start: Velocity, middle: Velocity, start_wheel_rates: wp.vec4, wheel_rates: wp.vec4,
    change: Accelerations, oil: OilLoads, bent: Deflections, parking_brake: float, h: float,
):  # fmt: skip
    """As :func:`aoro_gym.twin.kernels.corners.corner_contact`, on a ground with objects."""
    site = terrain.ground.twins[ground.twin]
    out = corner_contact(
        m, terrain.ground, site, half, i, g, cylinder, arm_angles, start, middle, start_wheel_rates, wheel_rates, change,
        oil, bent, parking_brake, h,
    )  # fmt: skip
    angle = arm_angles[i]
    centre = wheel_centre(m.corner, half.pivot_x, half.direction, 1.0 - 2.0 * float(i & 1), angle)
    objects = terrain.objects
    at = near(objects.grids[objects.worlds[ground.twin]], wheel_part(m.tire, centre), half.rotation, half.origin)
    at = next_object(objects.starts, objects.order, objects.boxes, at)
    before = objects.touches[TOUCH_ROWS * i + 3, ground.twin] > 0.0
    if at.found >= 0 or before:
        # the arm's tangent, without its sine and cosine once more
        tangent = half.direction * wp.vec3(m.corner.pivot_height - centre[2], 0.0, centre[0] - half.pivot_x)
        velocity = half.velocity + wp.cross(half.omega, centre) + middle.arms[i] * tangent
        touched = wheel_touched(
            m.tire, objects, ground.twin, site.friction, half, i, centre, velocity, middle.spins[i], at, before, h
        )
        if touched.number > 0:
            load, force = loaded(out.load, touched, change.spins[i], m.corner.spin_inertia, h)
            out.load = load
            touched.force = force
        tell(objects.touches, ground.twin, i, touched, half.rotation)
    return out


@wp.func
def object_hull_loads(m: Hull, frame: FrameBody, clearance: float, terrain: Any, ground: ObjectSite, half: Half):
    """As :func:`aoro_gym.twin.kernels.corners.hull_loads`, on a ground with objects; ``touch`` is the ground's alone."""
    site = terrain.ground.twins[ground.twin]
    out = hull_loads(m, frame, clearance, terrain.ground, site, half)
    objects = terrain.objects
    part = hull_part(hull_corner(frame, clearance, 0), hull_corner(frame, clearance, 7))
    touched = Touched()
    largest = float(-1.0)
    at = near(objects.grids[objects.worlds[ground.twin]], part, half.rotation, half.origin)
    while at.row <= at.last_row:
        at = next_object(objects.starts, objects.order, objects.boxes, at)
        if at.found < 0:
            break
        between = gap(part, in_frame(objects.shapes[at.found], half.rotation, half.origin))
        if between.depth > 0.0:
            force = hull_on_solid(m, between, half.velocity, half.omega)
            touched.force += force
            touched.moment += wp.cross(between.place, force)
            if wp.length(force) > largest:
                largest = wp.length(force)
                touched.number = objects.numbers[at.found]
    if touched.number > 0:
        out.force += touched.force
        out.moment += touched.moment
    tell(objects.touches, ground.twin, wp.where(half.direction > 0.0, FRONT, FRONT + 1), touched, half.rotation)
    return out


@wp.func
def record_object_outputs(
    outputs: wp.array3d(dtype=float), frame: int, t: int, m: MachineRecord, signals: Signals, pose: Pose,
    velocity: Velocity, actuators: Actuators, circuits: Circuits, engine: EngineState, contact: GroundContact,
    terrain: Any,
):  # fmt: skip
    """All rows of :class:`~aoro_gym.twin.records.Output`, then those of
    :data:`~aoro_gym.twin.records.OBJECT_OUTPUT_UNITS`."""
    record_outputs(outputs, frame, t, m, signals, pose, velocity, actuators, circuits, engine, contact, terrain)
    rows = int(ALL_TOUCH_ROWS)
    for row in range(rows):
        outputs[frame, FIRST_ROW + row, t] = terrain.objects.touches[row, t]
