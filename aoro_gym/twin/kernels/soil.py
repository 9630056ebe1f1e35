"""What soft ground does to the machine: ruts that each twin remembers, and the forces of the soil on its wheels.

:data:`SOIL_GROUNDS` stand for grounds of soil in ``advance``, whose functions of the corners, the hulls and the outputs are
exchanged for those below (:mod:`aoro_gym.twin.kernels.build`); kernels without soil know nothing of all this.

A twin's ruts are a raster of the deepest sinkage that each place has borne, in tiles of 8 × 8 nodes that are made where a
wheel first comes and found by a hash table of the twin's own (open addressing, linear probing). Memory is bounded by the
track that is driven, not by the area. Where the table is three quarters full, the next tile makes the twin's state
non-finite, which freezes it; :func:`lost_on_soil` tells this from a state that diverged.

Ruts of soil with passes (:class:`PassRuts`) count, too, the wheels that have gone over each node, in kernels of their own. A
wheel's way is counted in legs: one ends where the wheel is its diameter away from where it began. A node notes the wheel and
the leg that bore on it last. Another wheel, or the same one two legs later or more, is a new pass: it has been away by its
diameter at least. One that stands, shakes, rocks by less than that, or is lifted and set down in its place, is one pass.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportRedeclaration=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.corners import Half, corner_contact, hull_loads
from aoro_gym.twin.kernels.hydraulics import Signals
from aoro_gym.twin.kernels.outputs import GroundContact, record_outputs
from aoro_gym.twin.kernels.state import Actuators, Circuits, Deflections, OilLoads, Pose, Velocity
from aoro_gym.twin.physics.arms import ArmGeometry, ArmState
from aoro_gym.twin.physics.bodies import Accelerations, FrameBody, wheel_centre
from aoro_gym.twin.physics.engine import EngineState
from aoro_gym.twin.physics.ground import Footing, Meshes, Planes, Rasters, footing, penetration
from aoro_gym.twin.physics.soil import (
    Patch,
    Soil,
    contact_width,
    flank_force,
    half_chord,
    pass_sinkage_factor,
    recall,
    remembered,
    rut_depth,
    shear_step,
    sinkage_step,
    slip_sinkage_factor,
    soil_friction,
    wheel_reaction,
)
from aoro_gym.twin.physics.tires import LUGRE, Hull, Tire, disc_contact, lugre_capacity
from aoro_gym.twin.records import FIRST_SOIL_OUTPUT, NON_FINITE, RUTS_FULL, MachineRecord

TILE = wp.constant(8)  # nodes along an edge of a tile
TILE_BITS = wp.constant(3)
FARTHEST = wp.constant(16383)  # tiles from the origin
PRESSED_EVERY = wp.constant(
    8.0
)  # main steps between two times that a wheel leaves its trace: 3 cm at the highest speed
SINKAGE = wp.constant(0)  # rows of a wheel in ``Ruts.wheels``: sinkage [m],
SHEAR = wp.constant(1)  # shear displacement [m],
RUT = wp.constant(2)  # depth of the rut that stays [m],
RESISTANCE = wp.constant(3)  # resistance of the soil [N],
AGE = wp.constant(4)  # main steps since it left its trace
WHEEL_ROWS = wp.constant(5)
LEG_X = wp.constant(0)  # rows of a wheel in ``PassRuts.legs``: where its leg began [m],
LEG_Y = wp.constant(1)
LEG = wp.constant(2)  # number of its leg
LEG_ROWS = wp.constant(3)
PASS_BITS = wp.constant(12)  # of a node's passes in its number, those of the wheel above them, those of the leg above all
MOST_PASSES = wp.constant(4095)
WHEEL_BITS = wp.constant(2)
LEG_MASK = wp.constant(131071)  # 17 bits: legs are counted from 0 again after more than 100 km
FIRST_ROW = wp.constant(FIRST_SOIL_OUTPUT)


@wp.struct
class Ruts:
    """What each twin remembers of its ruts."""

    keys: wp.array2d(dtype=int)  # (twins, slots): which tile stands in a slot; 0: none
    depths: wp.array2d(dtype=float)  # (twins, slots × 64) [m]: deepest sinkage
    count: wp.array(dtype=int)  # tiles that a twin has
    full: wp.array(dtype=int)  # whether a twin lacked one
    wheels: wp.array2d(dtype=float)  # rows of wheels × twins
    inverse_cell: float  # [1/m]


@wp.struct
class PassRuts:
    """As :class:`Ruts`, of soil with passes."""

    keys: wp.array2d(dtype=int)
    depths: wp.array2d(dtype=float)
    count: wp.array(dtype=int)
    full: wp.array(dtype=int)
    wheels: wp.array2d(dtype=float)
    inverse_cell: float
    passes: wp.array2d(dtype=int)  # (twins, slots × 64): wheels over a node, and which on which leg was the last
    legs: wp.array2d(dtype=float)  # rows of wheels × twins


@wp.struct
class SoilSite:
    """A twin on soil, as ``advance`` knows it."""

    gravity: float  # [m/s²]
    twin: int


@wp.struct
class SoilPlanes:
    """Planes of soil."""

    twins: wp.array(dtype=SoilSite)
    ground: Planes
    soils: wp.array(dtype=Soil)  # one for all, or one a twin
    ruts: Ruts


@wp.struct
class SoilRasters:
    """Rasters of soil."""

    twins: wp.array(dtype=SoilSite)
    ground: Rasters
    soils: wp.array(dtype=Soil)
    ruts: Ruts


@wp.struct
class SoilMeshes:
    """Triangles of soil."""

    twins: wp.array(dtype=SoilSite)
    ground: Meshes
    soils: wp.array(dtype=Soil)
    ruts: Ruts


@wp.struct
class PassPlanes:
    """Planes of soil with passes."""

    twins: wp.array(dtype=SoilSite)
    ground: Planes
    soils: wp.array(dtype=Soil)
    ruts: PassRuts


@wp.struct
class PassRasters:
    """Rasters of soil with passes."""

    twins: wp.array(dtype=SoilSite)
    ground: Rasters
    soils: wp.array(dtype=Soil)
    ruts: PassRuts


@wp.struct
class PassMeshes:
    """Triangles of soil with passes."""

    twins: wp.array(dtype=SoilSite)
    ground: Meshes
    soils: wp.array(dtype=Soil)
    ruts: PassRuts


SOIL_GROUNDS = {Planes: SoilPlanes, Rasters: SoilRasters, Meshes: SoilMeshes}
"""By the kind of ground that is soft."""
PASS_GROUNDS = {Planes: PassPlanes, Rasters: PassRasters, Meshes: PassMeshes}
"""Likewise, of soil with passes."""


@wp.struct
class Sunk:
    """Says to a contact that its ground is known: the base of the tire in the soil."""

    unused: int


@wp.func
def footing(terrain: Sunk, ground: Footing, point: wp.vec3):  # noqa: F811 (an overload)
    """The ground itself."""
    return ground


@wp.func
def clear_node(ruts: Ruts, twin: int, node: int):
    """Make a node virgin."""
    ruts.depths[twin, node] = 0.0


@wp.func
def clear_node(ruts: PassRuts, twin: int, node: int):  # noqa: F811 (an overload)
    """Make a node virgin."""
    ruts.depths[twin, node] = 0.0
    ruts.passes[twin, node] = 0


@wp.func
def wheel_on_leg(ruts: Ruts, twin: int, first: int, w: Patch):
    """Nothing is noted of the wheel whose rows begin at ``first``."""
    return 0


@wp.func
def wheel_on_leg(ruts: PassRuts, twin: int, first: int, w: Patch):  # noqa: F811 (an overload)
    """Number of a wheel and the leg of its way that it is on; a leg begins where the wheel is its diameter away from where
    the last did."""
    wheel = first / WHEEL_ROWS
    row = LEG_ROWS * wheel
    leg = int(ruts.legs[row + LEG, twin])
    east = w.x - ruts.legs[row + LEG_X, twin]
    north = w.y - ruts.legs[row + LEG_Y, twin]
    if east * east + north * north > 4.0 * w.radius * w.radius:
        leg = (leg + 1) & LEG_MASK
        ruts.legs[row + LEG_X, twin] = w.x
        ruts.legs[row + LEG_Y, twin] = w.y
        ruts.legs[row + LEG, twin] = float(leg)
    return (leg << WHEEL_BITS) | wheel


@wp.func
def count_pass(ruts: Ruts, twin: int, node: int, bearing: int):
    """Passes are not counted."""
    return


@wp.func
def count_pass(ruts: PassRuts, twin: int, node: int, bearing: int):  # noqa: F811 (an overload)
    """Count a wheel that is new to a node; ``bearing`` on it: which wheel, and on which leg (:func:`wheel_on_leg`)."""
    kept = ruts.passes[twin, node]
    passes = kept & MOST_PASSES
    last = kept >> PASS_BITS
    other = ((bearing ^ last) & ((1 << WHEEL_BITS) - 1)) != 0
    legs = ((bearing >> WHEEL_BITS) - (last >> WHEEL_BITS)) & LEG_MASK
    if passes == 0 or other or legs > 1:
        passes = wp.min(passes + 1, MOST_PASSES)
    ruts.passes[twin, node] = (bearing << PASS_BITS) | passes


@wp.func
def find_tile(ruts: Any, twin: int, column: int, row: int):
    """Slot of a tile, and whether it is there; where it is not, the slot that it would take, or −1 if it is too far away."""
    slots = ruts.keys.shape[1]
    slot = int(-1)
    found = bool(False)
    if wp.abs(column) <= FARTHEST and wp.abs(row) <= FARTHEST:
        key = (column + FARTHEST) * (2 * FARTHEST + 1) + row + FARTHEST + 1
        mixed = wp.uint32(key) * wp.uint32(1540483477)
        slot = int(mixed >> wp.uint32(8)) & (slots - 1)
        kept = ruts.keys[twin, slot]
        while kept != key and kept != 0:
            slot = (slot + 1) & (slots - 1)
            kept = ruts.keys[twin, slot]
        found = kept == key
    return slot, found


@wp.func
def make_tile(ruts: Any, twin: int, column: int, row: int):
    """Slot of a tile, which is made where it is not there; −1 if there is no room."""
    slot, found = find_tile(ruts, twin, column, row)
    if not found:
        if slot < 0 or 4 * ruts.count[twin] >= 3 * ruts.keys.shape[1]:
            ruts.full[twin] = 1
            slot = int(-1)
        else:
            ruts.keys[twin, slot] = (column + FARTHEST) * (2 * FARTHEST + 1) + row + FARTHEST + 1
            ruts.count[twin] = ruts.count[twin] + 1
            first = slot * TILE * TILE
            nodes = int(TILE * TILE)
            for i in range(nodes):
                clear_node(ruts, twin, first + i)
    return slot


@wp.func
def node_depth(ruts: Any, twin: int, column: int, row: int):
    """Deepest sinkage [m] of a node."""
    slot, found = find_tile(ruts, twin, column >> TILE_BITS, row >> TILE_BITS)
    depth = float(0.0)
    if found:
        depth = ruts.depths[twin, (slot * TILE + (row & (TILE - 1))) * TILE + (column & (TILE - 1))]
    return depth


@wp.func
def remembered(memory: Ruts, twin: int, x: float, y: float):  # noqa: F811 (an overload)
    """Deepest sinkage [m] at the plan position (x, y) [m]: the least of the four nodes around it.

    The arc of a tire that comes to virgin soil is as short as a cell. What lies between a node in the rut and one ahead of
    it counts as virgin; interpolated, it would be half pressed before the tire has paid for it.
    """
    column = int(wp.floor(x * memory.inverse_cell))
    row = int(wp.floor(y * memory.inverse_cell))
    c = column & (TILE - 1)
    r = row & (TILE - 1)
    if c < TILE - 1 and r < TILE - 1:  # all four in one tile
        slot, found = find_tile(memory, twin, column >> TILE_BITS, row >> TILE_BITS)
        least = float(0.0)
        if found:
            node = (slot * TILE + r) * TILE + c
            south = wp.min(memory.depths[twin, node], memory.depths[twin, node + 1])
            north = wp.min(memory.depths[twin, node + TILE], memory.depths[twin, node + TILE + 1])
            least = wp.min(south, north)
        return least
    south = wp.min(node_depth(memory, twin, column, row), node_depth(memory, twin, column + 1, row))
    north = wp.min(node_depth(memory, twin, column, row + 1), node_depth(memory, twin, column + 1, row + 1))
    return wp.min(south, north)


@wp.func
def recall(memory: PassRuts, s: Soil, twin: int, x: float, y: float):  # noqa: F811 (an overload)
    """Deepest sinkage [m] at the plan position (x, y) [m], as of :class:`Ruts` that of the shallowest of four nodes, and by
    its passes how many times as deep wheels sink there as in virgin soil [-]."""
    column = int(wp.floor(x * memory.inverse_cell))
    row = int(wp.floor(y * memory.inverse_cell))
    inside = (column & (TILE - 1)) < TILE - 1 and (row & (TILE - 1)) < TILE - 1  # all four in one tile
    slot, found = find_tile(memory, twin, column >> TILE_BITS, row >> TILE_BITS)
    least = float(1.0e6)
    shallowest = int(-1)
    nodes = int(4)
    for i in range(nodes):
        c = column + (i & 1)
        r = row + (i >> 1)
        if not inside and i > 0:
            slot, found = find_tile(memory, twin, c >> TILE_BITS, r >> TILE_BITS)
        depth = float(0.0)
        node = int(-1)
        if found:
            node = (slot * TILE + (r & (TILE - 1))) * TILE + (c & (TILE - 1))
            depth = memory.depths[twin, node]
        if depth < least:
            least = depth
            shallowest = node
    passes = int(0)
    if shallowest >= 0:
        passes = memory.passes[twin, shallowest] & MOST_PASSES
    return least, pass_sinkage_factor(s, passes)


@wp.func
def press(ruts: Any, twin: int, first: int, w: Patch):
    """Leave the trace of a tire, whose rows begin at ``first``: every node below it remembers its depth, if it was less
    deep."""
    bearing = wheel_on_leg(ruts, twin, first, w)
    end = half_chord(w.radius, w.depth)
    half = 0.5 * w.width
    reach = wp.sqrt(end * end + half * half)
    cell = 1.0 / ruts.inverse_cell
    first_row = int(wp.ceil((w.y - reach) * ruts.inverse_cell))
    last_row = int(wp.floor((w.y + reach) * ruts.inverse_cell))
    first_column = int(wp.ceil((w.x - reach) * ruts.inverse_cell))
    last_column = int(wp.floor((w.x + reach) * ruts.inverse_cell))
    tile_column = int(0)
    tile_row = int(0)
    slot = int(-1)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            east = float(column) * cell - w.x
            north = float(row) * cell - w.y
            along = east * w.east + north * w.north
            across = north * w.east - east * w.north
            if wp.abs(along) < end and wp.abs(across) <= half:
                depth = w.depth - w.radius + wp.sqrt(w.radius * w.radius - along * along)
                depth = wp.min(depth, w.sinkage)
                if slot < 0 or column >> TILE_BITS != tile_column or row >> TILE_BITS != tile_row:
                    tile_column = column >> TILE_BITS
                    tile_row = row >> TILE_BITS
                    slot = make_tile(ruts, twin, tile_column, tile_row)
                if slot >= 0:
                    node = (slot * TILE + (row & (TILE - 1))) * TILE + (column & (TILE - 1))
                    count_pass(ruts, twin, node, bearing)
                    if depth > ruts.depths[twin, node]:
                        ruts.depths[twin, node] = depth


@wp.func
def leave_trace(ruts: Any, soil: Soil, twin: int, first: int, w: Patch, length: float):
    """:func:`press` a tire, whose rows begin at ``first``, into the ground every few steps, and measure its rut."""
    age = ruts.wheels[first + AGE, twin] + 1.0
    if age >= PRESSED_EVERY:
        age = float(0.0)
        press(ruts, twin, first, w)
        deepest, before = recall(ruts, soil, twin, w.x, w.y)
        dug = slip_sinkage_factor(soil, w.shear / length) * before
        ruts.wheels[first + RUT, twin] = rut_depth(soil, w.width, length, dug, wp.max(deepest, w.sinkage))
    ruts.wheels[first + AGE, twin] = age


@wp.struct
class Standing:
    """A wheel over the undisturbed ground."""

    under: Footing
    normal: wp.vec3  # of the ground, frame axes
    forward: wp.vec3  # unit, rolling direction in the ground's plane, frame axes
    place: wp.vec3  # [m] of the contact from the wheel's centre, frame axes
    patch: Patch


@wp.func
def standing(m: Tire, terrain: Any, ground: Any, rotation: wp.mat33, origin: wp.vec3, centre: wp.vec3):
    """A wheel of a half at ``centre`` [m] over the undisturbed ground."""
    out = Standing()
    world = origin + rotation * centre
    out.under = footing(terrain, ground, world)
    n = wp.transpose(rotation) * out.under.normal
    tilt = wp.sqrt(n[0] * n[0] + n[2] * n[2])
    down = wp.vec3(-n[0] / tilt, 0.0, -n[2] / tilt)
    touch = disc_contact(m, n, penetration(out.under, origin + rotation * (centre + m.radius * down)))
    out.normal = n
    out.place = touch.place
    out.forward = wp.vec3(n[2] / tilt, 0.0, -n[0] / tilt)
    ahead = rotation * out.forward
    level = wp.max(wp.sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1]), 1.0e-6)
    out.patch.radius = m.radius
    out.patch.width = contact_width(m)
    out.patch.depth = touch.depth
    out.patch.x = world[0]
    out.patch.y = world[1]
    out.patch.east = ahead[0] / level
    out.patch.north = ahead[1] / level
    return out


@wp.func
def soil_step(
    m: Tire, soil: Soil, ruts: Any, twin: int, first: int, at: Standing, velocity: wp.vec3, omega: wp.vec3, spin: float,
    h: float,
):  # fmt: skip
    """The tire's base in the soil after ``h`` [s] as the ground of its contact, the soil's forces [N] that this contact does
    not know, against rolling and against the flank, and the friction coefficient that the soil bears."""
    w = at.patch
    under = at.under
    forces = wp.vec3(0.0, 0.0, 0.0)
    if w.depth > 0.0:
        sideways = wp.cross(at.normal, at.forward)
        slip = velocity + wp.cross(wp.vec3(omega[0], spin, omega[2]), at.place)
        slip_x = wp.dot(at.forward, slip)
        slip_y = wp.dot(sideways, slip)
        way = wp.dot(at.forward, velocity)
        w.roll = way - slip_x
        w.sinkage = wp.min(ruts.wheels[first + SINKAGE, twin], w.depth)
        w.shear = ruts.wheels[first + SHEAR, twin]
        r = wheel_reaction(soil, ruts, twin, w)
        w.sinkage = sinkage_step(m.stiffness, w, r)
        load = m.stiffness * (w.depth - w.sinkage)
        under.height -= w.sinkage / under.normal[2]
        under.rolling_resistance = wp.min(under.rolling_resistance, 1.0)
        speed = wp.sqrt(slip_x * slip_x + slip_y * slip_y)
        under.friction = soil_friction(m, r.grip, load, speed, under.friction)
        forces = wp.vec3(r.resistance, flank_force(r, slip_y), lugre_capacity(m, speed, under.friction))
        leave_trace(ruts, soil, twin, first, w, r.length)
        ruts.wheels[first + SINKAGE, twin] = w.sinkage
        ruts.wheels[first + SHEAR, twin] = shear_step(w.shear, slip_x, slip_y, w.roll, way, r.length, w.width, h)
        ruts.wheels[first + RESISTANCE, twin] = r.resistance
    else:
        for row in range(4):
            ruts.wheels[first + row, twin] = 0.0
    return under, forces


@wp.func
def soil_corner_contact(
    m: MachineRecord, terrain: Any, ground: SoilSite, half: Half, i: int, g: ArmGeometry, cylinder: ArmState,
    arm_angles: wp.vec4, start: Velocity, middle: Velocity, start_wheel_rates: wp.vec4, wheel_rates: wp.vec4,
    change: Accelerations, oil: OilLoads, bent: Deflections, parking_brake: float, h: float,
):  # fmt: skip
    """As :func:`aoro_gym.twin.kernels.corners.corner_contact`, on soil: the tire stands on what the soil bears, with the
    friction that it bears; the resistance acts through the wheel's centre, as pressure on an arc does."""
    t = ground.twin
    angle = arm_angles[i]
    centre = wheel_centre(m.corner, half.pivot_x, half.direction, 1.0 - 2.0 * float(i & 1), angle)
    at = standing(m.tire, terrain.ground, terrain.ground.twins[t], half.rotation, half.origin, centre)
    # the arm's tangent, without its sine and cosine once more
    tangent = half.direction * wp.vec3(m.corner.pivot_height - centre[2], 0.0, centre[0] - half.pivot_x)
    velocity = half.velocity + wp.cross(half.omega, centre) + middle.arms[i] * tangent
    soil = terrain.soils[t % terrain.soils.shape[0]]
    under, forces = soil_step(
        m.tire, soil, terrain.ruts, t, WHEEL_ROWS * i, at, velocity, half.omega, middle.spins[i], h
    )
    held = bent
    if m.tire.slip_law == LUGRE:
        # bristles that stick let nothing go, but the soil below a rolling wheel is renewed and bears less: LuGre's law alone
        # would hold what it bore before, then slip, and so on several times a second
        coefficient = wp.vec2(
            m.tire.sigma0_longitudinal * bent.bristle_x[i], m.tire.sigma0_lateral * bent.bristle_y[i]
        )
        share = wp.min(forces[2] / wp.max(wp.length(coefficient), 1.0e-6), 1.0)
        bristle_x = bent.bristle_x
        bristle_y = bent.bristle_y
        bristle_x[i] = share * bristle_x[i]
        bristle_y[i] = share * bristle_y[i]
        held.bristle_x = bristle_x
        held.bristle_y = bristle_y
    out = corner_contact(
        m, Sunk(), under, half, i, g, cylinder, arm_angles, start, middle, start_wheel_rates, wheel_rates, change, oil,
        held, parking_brake, h,
    )  # fmt: skip
    flank = -forces[1] * wp.cross(at.normal, at.forward)
    load = out.load
    load.force += flank - forces[0] * at.forward
    load.moment += wp.cross(at.place, flank)
    if terrain.ruts.full[t] > 0:
        load.force = load.force * wp.inf  # no room for the rut: the twin freezes
    out.load = load
    return out


@wp.func
def lost_on_soil(terrain: Any, t: int):
    """Status of a twin whose state is not finite: whether it lacked room for its ruts."""
    return wp.where(terrain.ruts.full[t] > 0, RUTS_FULL, NON_FINITE)


@wp.func
def soil_hull_loads(m: Hull, frame: FrameBody, clearance: float, terrain: Any, ground: SoilSite, half: Half):
    """As :func:`aoro_gym.twin.kernels.corners.hull_loads`, on the undisturbed ground, which is hard for a hull."""
    return hull_loads(m, frame, clearance, terrain.ground, terrain.ground.twins[ground.twin], half)


@wp.func
def record_soil_outputs(
    outputs: wp.array3d(dtype=float), frame: int, t: int, m: MachineRecord, signals: Signals, pose: Pose,
    velocity: Velocity, actuators: Actuators, circuits: Circuits, engine: EngineState, contact: GroundContact,
    terrain: Any,
):  # fmt: skip
    """All rows of :class:`~aoro_gym.twin.records.Output`, then those of
    :data:`~aoro_gym.twin.records.SOIL_OUTPUT_UNITS`."""
    record_outputs(outputs, frame, t, m, signals, pose, velocity, actuators, circuits, engine, contact, terrain)
    for i in range(4):
        first = WHEEL_ROWS * i
        outputs[frame, FIRST_ROW + i, t] = terrain.ruts.wheels[first + SINKAGE, t]
        outputs[frame, FIRST_ROW + 4 + i, t] = terrain.ruts.wheels[first + RUT, t]
        outputs[frame, FIRST_ROW + 8 + i, t] = terrain.ruts.wheels[first + RESISTANCE, t]
