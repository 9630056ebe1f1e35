"""The ground under the machine: the one seam between the vehicle and any terrain.

Every contact asks :func:`footing`, which gives the ground under one point as a plane, its **effective road plane**:

- height: the mean of the ground's heights 20 cm (``PATCH``) east, west, north and south of the point;
- normal: by the two chords between those four points;
- friction and rolling resistance: interpolated between nodes of the terrain's raster, times the twin's own multipliers.

A tire bears on a patch, not on a point: at its load it is about half a metre long and as wide as the tire. Following the
ends of a chord of 0.8 times that length is the tandem follower of Schmeitz, *A Semi-Empirical Three-Dimensional Model of
the Pneumatic Tyre Rolling over Arbitrarily Uneven Road Surfaces* (Delft 2004). A plane is reproduced exactly, however it
is triangulated, and where the ground kinks by Δs the slope changes gradually over the chord, by Δs a 2 ``PATCH`` of way: a
wheel does not chatter on edges. On ground of curvature κ the mean lies κ PATCH²/2 off the point itself (4 mm at 5 m).

The type of ``terrain`` chooses the implementation when the kernel is built, so that none pays for another:

- :class:`Planes`: one inclined plane a twin;
- :class:`Meshes`: the four heights by rays down through the triangles, exact, below overhangs;
- :class:`Discs`: the same footing for hulls, while tires ask the triangles disc by disc
  (:mod:`aoro_gym.twin.physics.tire_discs`);
- :class:`Rasters`: the same height and slopes, computed once at the nodes of a grid, interpolated bilinearly.

Beyond the edges, and over holes, the ground goes on at the height of the nearest known ground, and ``Footing.known``
says so.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.terrains.survey import PATCH, REACH

DOWN = wp.constant(wp.vec3(0.0, 0.0, -1.0))
DEEP = wp.constant(1.0e4)  # [m] that a ray goes down: more than any terrain's relief


@wp.struct
class Ground:
    """What one twin stands on: a plane through the world's origin."""

    normal: wp.vec3  # unit, upward, world frame
    friction: float  # [-] multiplier of the tire's friction (1 = dry asphalt)
    rolling_resistance: float  # [-] multiplier of the tire's rolling resistance
    gravity: float  # [m/s²]


@wp.struct
class Site:
    """What one twin stands on: a terrain of many."""

    x: float  # [m] of the raster's first node, its south-western one
    y: float
    inverse_cell: float  # [1/m]
    columns: int  # nodes from west to east
    rows: int  # nodes from south to north
    first: int  # index of the first node
    mesh: wp.uint64
    friction: float  # [-] the twin's multipliers, on top of the terrain's
    rolling_resistance: float
    gravity: float  # [m/s²]


@wp.struct
class Planes:
    """An inclined plane a twin."""

    twins: wp.array(dtype=Ground)


@wp.struct
class Rasters:
    """Many terrains, their rasters one after the other, rows from south to north."""

    twins: wp.array(dtype=Site)  # where each twin stands
    terrains: wp.array(dtype=Site)
    nodes: wp.array(dtype=wp.vec4)  # height [m], slopes along x and y [-], share known [-] of the effective road plane
    cover: wp.array(dtype=wp.vec2)  # multipliers of friction and rolling resistance [-]
    ceilings: wp.array(dtype=float)  # [m] over the whole cell north-east of the node: no ground is higher


@wp.struct
class Meshes:
    """Many terrains as triangles; their rasters give the multipliers, and the heights where there is no triangle."""

    twins: wp.array(dtype=Site)
    terrains: wp.array(dtype=Site)
    nodes: wp.array(dtype=wp.vec4)
    cover: wp.array(dtype=wp.vec2)
    ceilings: wp.array(dtype=float)


@wp.struct
class Discs:
    """Many terrains as triangles, which every disc of a tire asks by itself."""

    twins: wp.array(dtype=Site)
    terrains: wp.array(dtype=Site)
    nodes: wp.array(dtype=wp.vec4)
    cover: wp.array(dtype=wp.vec2)
    ceilings: wp.array(dtype=float)


@wp.struct
class Footing:
    """The ground under one contact: a plane through (x, y, height)."""

    x: float  # [m]
    y: float
    height: float  # [m]
    normal: wp.vec3  # unit, upward, world frame
    friction: float  # [-] multiplier of the tire's friction
    rolling_resistance: float  # [-] multiplier of the tire's rolling resistance
    known: float  # [-] share of the patch that lies on the map


@wp.func
def ground_height(ground: Footing, x: float, y: float):
    """Height [m] of the footing's plane at the plan position (x, y) [m]."""
    return ground.height - (ground.normal[0] * (x - ground.x) + ground.normal[1] * (y - ground.y)) / ground.normal[2]


@wp.func
def penetration(ground: Footing, point: wp.vec3):
    """Depth [m] of a world point under the footing's plane, along its normal; negative above it."""
    return (ground_height(ground, point[0], point[1]) - point[2]) * ground.normal[2]


@wp.struct
class Cell:
    """A place on a raster."""

    node: int  # index of the cell's south-western node
    east: float  # [-] way across the cell
    north: float
    inside_x: bool  # not clamped to the edge
    inside_y: bool


@wp.func
def raster_cell(site: Site, x: float, y: float):
    """Cell at the plan position (x, y) [m], clamped to the raster's edges; NaN goes to the first one."""
    out = Cell()
    u = (x - site.x) * site.inverse_cell
    v = (y - site.y) * site.inverse_cell
    last_u = float(site.columns - 1)
    last_v = float(site.rows - 1)
    out.inside_x = u >= 0.0 and u <= last_u
    out.inside_y = v >= 0.0 and v <= last_v
    u = wp.where(u > 0.0, wp.min(u, last_u), 0.0)
    v = wp.where(v > 0.0, wp.min(v, last_v), 0.0)
    column = wp.min(int(u), site.columns - 2)
    row = wp.min(int(v), site.rows - 2)
    out.node = site.first + row * site.columns + column
    out.east = u - float(column)
    out.north = v - float(row)
    return out


@wp.func
def interpolate(cell: Cell, columns: int, values: wp.array(dtype=Any)):
    """Bilinear interpolation of ``values`` at the nodes."""
    south = (1.0 - cell.east) * values[cell.node] + cell.east * values[cell.node + 1]
    north = (1.0 - cell.east) * values[cell.node + columns] + cell.east * values[cell.node + columns + 1]
    return (1.0 - cell.north) * south + cell.north * north


@wp.func
def ground_level(terrain: Planes, ground: Ground, x: float, y: float):
    """Height [m] of the plane at the plan position (x, y) [m]."""
    return -(ground.normal[0] * x + ground.normal[1] * y) / ground.normal[2]


@wp.func
def ground_level(terrain: Any, ground: Site, x: float, y: float):
    """Height [m] of the terrain's raster at the plan position (x, y) [m]."""
    return interpolate(raster_cell(ground, x, y), ground.columns, terrain.nodes)[0]


@wp.func
def road_plane(site: Site, x: float, y: float, plane: wp.vec4, cover: wp.vec2):
    """Footing of the effective road plane (height, two slopes, share known)."""
    out = Footing()
    out.x = x
    out.y = y
    out.height = plane[0]
    out.normal = wp.normalize(wp.vec3(-plane[1], -plane[2], 1.0))
    out.friction = site.friction * cover[0]
    out.rolling_resistance = site.rolling_resistance * cover[1]
    out.known = plane[3]
    return out


@wp.func
def footing(terrain: Planes, ground: Ground, point: wp.vec3):
    """The ground under a world ``point`` [m]."""
    out = Footing()
    out.normal = ground.normal
    out.friction = ground.friction
    out.rolling_resistance = ground.rolling_resistance
    out.known = 1.0
    return out


@wp.func
def footing(terrain: Rasters, ground: Site, point: wp.vec3):
    """The ground under a world ``point`` [m]."""
    cell = raster_cell(ground, point[0], point[1])
    plane = interpolate(cell, ground.columns, terrain.nodes)
    # level across the edge, where the height stays
    plane[1] = wp.where(cell.inside_x, plane[1], 0.0)
    plane[2] = wp.where(cell.inside_y, plane[2], 0.0)
    plane[3] = wp.where(cell.inside_x and cell.inside_y, plane[3], 0.0)
    return road_plane(ground, point[0], point[1], plane, interpolate(cell, ground.columns, terrain.cover))


@wp.func
def mesh_footing(nodes: wp.array(dtype=wp.vec4), covers: wp.array(dtype=wp.vec2), ground: Site, point: wp.vec3):
    """The effective road plane of triangles under a world ``point`` [m]: of the highest surfaces less than ``REACH`` above
    it."""
    cell = raster_cell(ground, point[0], point[1])
    substitute = interpolate(cell, ground.columns, nodes)[0]  # where there is no triangle
    heights = wp.vec4()
    known = float(0.0)
    for i in range(4):
        reach = wp.where(i & 1, -PATCH, PATCH)
        start = point + wp.vec3(wp.where(i < 2, reach, 0.0), wp.where(i < 2, 0.0, reach), REACH)
        hit = wp.mesh_query_ray(ground.mesh, start, DOWN, DEEP)
        heights[i] = wp.where(hit.result, start[2] - hit.t, substitute)
        known += wp.where(hit.result, 0.25, 0.0)
    plane = wp.vec4(
        0.25 * (heights[0] + heights[1] + heights[2] + heights[3]),
        (heights[0] - heights[1]) / (2.0 * PATCH),
        (heights[2] - heights[3]) / (2.0 * PATCH),
        known,
    )
    return road_plane(ground, point[0], point[1], plane, interpolate(cell, ground.columns, covers))


@wp.func
def footing(terrain: Meshes, ground: Site, point: wp.vec3):
    """The ground under a world ``point`` [m]."""
    return mesh_footing(terrain.nodes, terrain.cover, ground, point)


@wp.func
def footing(terrain: Discs, ground: Site, point: wp.vec3):
    """The ground under a world ``point`` [m]."""
    return mesh_footing(terrain.nodes, terrain.cover, ground, point)


@wp.func
def ceiling(terrain: Planes, ground: Ground, x: float, y: float):
    """A height [m] that the ground at the plan position (x, y) [m] does not exceed: spares contacts above it a query."""
    return -(ground.normal[0] * x + ground.normal[1] * y) / ground.normal[2]


@wp.func
def ceiling(terrain: Any, ground: Site, x: float, y: float):
    """A height [m] that the ground at the plan position (x, y) [m] does not exceed: spares contacts above it a query."""
    return terrain.ceilings[raster_cell(ground, x, y).node]


@wp.func
def place(terrain: Planes, t: int, number: int):
    """A twin on a plane stays on it."""


@wp.func
def place(terrain: Any, t: int, number: int):
    """Put twin ``t`` on terrain ``number``; its multipliers and its gravity stay."""
    here = terrain.twins[t]
    there = terrain.terrains[number]
    there.friction = here.friction
    there.rolling_resistance = here.rolling_resistance
    there.gravity = here.gravity
    terrain.twins[t] = there
