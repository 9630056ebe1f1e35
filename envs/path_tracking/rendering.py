"""Pictures of path tracking without a display: a view from behind over the terrain, a map, and strips of traces.

The ground and the machine are flat-shaded polygons under one sun, drawn from the far to the near. Nothing but matplotlib
is needed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.envs.core.rendering import PAPER, Canvas, Traces
from aoro_gym.envs.path_tracking.courses import Course, HeightMap
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.machine import Machine
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, RED, SOFT
from aoro_gym.sensors.attitude import in_world
from aoro_gym.twin.records import WHEELS

SIZE = (1120, 630)
"""Width and height of a picture [px]; both even, for video encoders."""
VIEW = 720
"""Width of the view from behind [px]."""
PANEL, MAP_HEIGHT = SIZE[0] - VIEW, 270
"""Width of what stands beside the view, and height of the map in it [px]."""
STRIP_SPAN = 30.0
"""Time [s] that the strips show."""

BEHIND, ASIDE, ABOVE, AIM = 8.6, 4.4, 4.6, (2.0, 0.8)
"""The camera [m]: behind the hinge, right of it, above the ground there; the point that it looks at, ahead and above."""
FOCAL = 1.12
"""Of the camera, in half widths of the picture."""
FAR = 120.0
"""Distance [m] at which the haze has taken everything."""
LEVELS = ((0.25, 13.0), (0.6, 28.0), (1.5, 60.0), (4.0, FAR))
"""Cells of the ground [m], each up to a distance [m]."""
SUN = np.array([-0.45, 0.35, 0.82]) / math.sqrt(0.45**2 + 0.35**2 + 0.82**2)
"""Direction to the sun in the world."""

SKY_TOP, HAZE = np.array([0.42, 0.60, 0.78]), np.array([0.84, 0.88, 0.88])
MOSS, GRASS, SOIL = np.array([0.30, 0.38, 0.18]), np.array([0.47, 0.52, 0.26]), np.array([0.45, 0.37, 0.27])
PAINT, PAINT_DARK, IRON, CHROME = (0.95, 0.66, 0.13), (0.78, 0.50, 0.08), (0.30, 0.34, 0.38), (0.72, 0.76, 0.79)
TIRE, LUG, RIM, GLASS, WHITE = (
    (0.13, 0.14, 0.15),
    (0.21, 0.22, 0.23),
    (0.86, 0.60, 0.14),
    (0.16, 0.20, 0.24),
    (0.93, 0.94, 0.94),
)

Points = NDArray[np.float64]


# ---- solids ----------------------------------------------------------------------------------------------------------


class Solid:
    """Flat faces, counter-clockwise seen from outside, each of one colour."""

    def __init__(self) -> None:
        self._points: list[Points] = []
        self._colours: list[tuple[float, float, float]] = []
        self.hulls: list[Points] = []
        """Points of each convex piece, for its shadow."""

    def face(self, points: ArrayLike, colour: tuple[float, float, float]) -> None:
        """One face (P, 3)."""
        self._points.append(np.asarray(points, dtype=np.float64))
        self._colours.append(colour)

    def prism(self, outline: ArrayLike, depth: tuple[float, float], colour: Any, *, sides: Any = None) -> None:
        """An outline (P, 2) of x and z, counter-clockwise seen from the right (−y), drawn out from y ``depth[0]`` to the
        larger ``depth[1]``."""
        outline = np.asarray(outline, dtype=np.float64)
        right = np.stack([outline[:, 0], np.full(len(outline), depth[0]), outline[:, 1]], axis=1)
        left = right + np.array([0.0, depth[1] - depth[0], 0.0])
        self.face(right, sides or colour)
        self.face(left[::-1], sides or colour)
        for i in range(len(outline)):
            j = (i + 1) % len(outline)
            self.face([right[i], left[i], left[j], right[j]], colour)
        self.hulls.append(np.concatenate([right, left]))

    def box(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], colour: Any) -> None:
        """Between two values along each axis."""
        self.prism([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])], y, colour)

    def bar(self, start: ArrayLike, end: ArrayLike, radius: float, colour: Any, *, sides: int = 8) -> None:
        """A rod between two points.

        Args:
            start: One end (3,) [m].
            end: The other end (3,) [m].
            radius: Of the rod [m].
            colour: Of its faces.
            sides: Number of its sides.
        """
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        along = (end - start) / np.linalg.norm(end - start)
        aside = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
        aside /= np.linalg.norm(aside)
        up = np.cross(along, aside)
        turn = 2.0 * np.pi * np.arange(sides) / sides
        ring = radius * (np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * up)
        first, second = start + ring, end + ring
        self.face(first[::-1], colour)
        self.face(second, colour)
        for i in range(sides):
            j = (i + 1) % sides
            self.face([first[i], first[j], second[j], second[i]], colour)
        self.hulls.append(np.concatenate([first, second]))

    def packed(self) -> tuple[Points, NDArray[np.intp], Points]:
        """All points (V, 3), where each face begins (F + 1), and the faces' colours (F, 3)."""
        sizes = [len(points) for points in self._points]
        return np.concatenate(self._points), np.concatenate([[0], np.cumsum(sizes)]), np.array(self._colours)


def _front(machine: Machine) -> Solid:
    """Front frame: chassis, equipment, folded crane, a mast with the two antennas."""
    out, half = Solid(), machine.frame.front
    inner, outer, width, floor, top = _hull(machine, half, 1.0)
    w = 0.5 * width
    out.prism([(0.0, floor), (inner, floor - 0.06), (inner, floor + 0.42), (0.0, floor + 0.36)], (-0.17, 0.17), IRON)
    out.prism(
        [(inner, floor), (outer - 0.25, floor), (outer, floor + 0.2), (outer, floor + 0.48), (inner, floor + 0.48)],
        (-w, w),
        PAINT,
    )
    out.box((inner + 0.12, inner + 0.95), (-w + 0.06, w - 0.06), (floor + 0.48, floor + 0.95), PAINT_DARK)
    out.box((outer - 0.1, outer + 0.02), (-w + 0.12, -w + 0.42), (floor + 0.26, floor + 0.42), WHITE)
    out.box((outer - 0.1, outer + 0.02), (w - 0.42, w - 0.12), (floor + 0.26, floor + 0.42), WHITE)
    # the crane: pillar, boom, stick and grapple
    x, base = outer - 0.55, floor + 0.48
    knee, tip = (x - 0.1, 0.0, top + 0.35), (inner + 0.25, 0.12, top + 0.1)
    out.bar((x, 0.0, base), (x, 0.0, top - 0.1), 0.16, IRON)
    out.bar((x, 0.0, top - 0.15), knee, 0.12, PAINT)
    out.bar(knee, tip, 0.1, PAINT, sides=6)
    out.bar((tip[0] + 0.15, -0.14, top + 0.02), (outer - 0.3, -0.14, top - 0.05), 0.085, PAINT_DARK, sides=6)
    # the antennas
    height, apart = 2.2, 0.6
    out.bar((1.0, -apart, height - 0.06), (1.0, apart, height - 0.06), 0.03, IRON, sides=6)
    out.bar((1.0, 0.0, floor + 0.95), (1.0, 0.0, height - 0.06), 0.035, IRON, sides=6)
    for side in (-apart, apart):
        out.bar((1.0, side, height - 0.05), (1.0, side, height + 0.03), 0.11, WHITE, sides=10)
    return out


def _rear(machine: Machine) -> Solid:
    """Rear frame: chassis, the engine's hood with its grilles, the exhaust."""
    out, half = Solid(), machine.frame.rear
    inner, outer, width, floor, top = _hull(machine, half, -1.0)
    w = 0.5 * width
    out.prism([(inner, floor - 0.06), (0.0, floor), (0.0, floor + 0.36), (inner, floor + 0.42)], (-0.17, 0.17), IRON)
    out.prism(
        [(outer + 0.15, floor), (inner, floor), (inner, floor + 0.4), (outer, floor + 0.4), (outer, floor + 0.15)],
        (-w, w),
        IRON,
    )
    out.prism(
        [
            (outer, floor + 0.4), (inner - 0.05, floor + 0.4), (inner - 0.05, top - 0.28), (inner - 0.35, top),
            (outer + 0.3, top), (outer, top - 0.25),
        ],
        (-w + 0.04, w - 0.04), PAINT,
    )  # fmt: skip
    for level in np.linspace(floor + 0.52, top - 0.42, 5):  # grilles
        out.box((outer - 0.015, outer + 0.02), (-w + 0.18, w - 0.18), (level, level + 0.07), GLASS)
    for low, high in ((-w + 0.02, -w + 0.05), (w - 0.05, w - 0.02)):
        for place in np.linspace(outer + 0.45, inner - 0.7, 4):
            out.box((place, place + 0.16), (low, high), (floor + 0.6, top - 0.4), GLASS)
    out.bar((inner - 0.55, 0.36, top - 0.02), (inner - 0.55, 0.36, top + 0.42), 0.06, IRON)
    out.bar((outer + 0.5, -0.3, top - 0.02), (outer + 0.5, -0.3, top + 0.12), 0.1, GLASS)
    return out


def _hull(machine: Machine, half: Any, sign: float) -> tuple[float, float, float, float, float]:
    """Inner and outer end, width, floor and top [m] of a frame's body."""
    middle, length = _number(half.cog_x), _number(half.hull_length)
    floor = _number(machine.frame.ground_clearance)
    inner, outer = middle - 0.5 * sign * length, middle + 0.5 * sign * length
    return inner, outer, _number(half.hull_width), floor, floor + _number(half.hull_height)


def _wheel(radius: float, width: float) -> Solid:
    """A wheel about the origin, its axle along y."""
    out, segments, half = Solid(), 24, 0.5 * width
    turn = 2.0 * np.pi * np.arange(segments) / segments

    def ring(r: float, y: float) -> Points:
        return np.stack([r * np.cos(turn), np.full(segments, y), r * np.sin(turn)], axis=1)

    inner = radius - 0.035
    rows = [ring(inner - 0.07, -half), ring(inner, -half + 0.06), ring(inner, half - 0.06), ring(inner - 0.07, half)]
    for before, after in pairwise(rows):
        for i in range(segments):
            j = (i + 1) % segments
            out.face([before[i], after[i], after[j], before[j]], TIRE)
    for side in (-1.0, 1.0):
        for r, y, colour in (
            (inner - 0.07, half, TIRE),
            (0.6 * radius, half + 0.004, RIM),
            (0.24 * radius, half + 0.03, IRON),
        ):
            disc = ring(r, side * y)
            out.face(disc if side < 0.0 else disc[::-1], colour)
    # lugs in chevrons
    for k in range(14):
        for side in (-1.0, 1.0):
            a, b = 2.0 * np.pi * (k + 0.25 * (side + 1.0)) / 14.0, 0.20
            corners = [
                (radius * math.cos(a + t), side * y, radius * math.sin(a + t))
                for t, y in ((0.0, 0.0), (b, half - 0.03), (b + 0.13, half - 0.03), (0.13, 0.0))
            ]
            out.face(corners if side < 0.0 else corners[::-1], LUG)
    out.hulls.append(np.concatenate([rows[1], rows[2]]))
    return out


def _number(value: Any) -> float:
    return float(np.ravel(value)[0])


class SolidMachine:
    """The machine as solids, posed by its outputs."""

    def __init__(self, machine: Machine):
        frame, arm, tire = machine.frame, machine.arm, machine.tire
        self._bodies = {False: _front(machine), True: _rear(machine)}
        self._half_width = _number(tire.disc_offset_outer) + 0.025
        self._wheel = _wheel(_number(tire.radius), 2.0 * self._half_width)
        self._arm_length, self._pivot_height = _number(arm.length), _number(arm.pivot_height)
        self._pivot_lateral, self._half_track = _number(arm.pivot_lateral), 0.5 * _number(frame.track)
        self._axles = (_number(frame.front.axle_distance), -_number(frame.rear.axle_distance))
        self._packed = {key: solid.packed() for key, solid in (*self._bodies.items(), ("wheel", self._wheel))}
        linkage = machine.steering.cylinder.linkage
        self._pins = (_number(linkage.a), _number(linkage.b), 0.5 * _number(linkage.g0))

    def posed(
        self,
        origin: Points,
        roll: float,
        pitch: float,
        yaw: float,
        joint: float,
        arms: Sequence[float],
        wheels: Sequence[float],
    ) -> tuple[Points, NDArray[np.intp], Points, list[Points]]:
        """Points (V, 3), beginnings of the faces (F + 1), their colours (F, 3), and the convex pieces, in the world.

        Args:
            origin: Hinge (3,) [m] in the world.
            roll: Of the front frame [rad].
            pitch: Of the front frame [rad].
            yaw: Its heading [rad].
            joint: Joint angle [rad].
            arms: Arm angles (4,) [rad].
            wheels: Wheel angles (4,) [rad].
        """
        points, starts, colours, hulls, total = [], [np.array([0])], [], [], 0

        def place(local: Points, rear: bool) -> Points:
            if rear:
                s, c = math.sin(-joint), math.cos(-joint)
                local = np.stack(
                    [c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1], local[:, 2]], axis=1
                )
            return origin + in_world(roll, pitch, yaw, local)

        def add(packed: tuple[Points, NDArray[np.intp], Points], solid: Solid, local: Any, rear: bool) -> None:
            nonlocal total
            points.append(place(local(packed[0]), rear))
            starts.append(packed[1][1:] + total)
            colours.append(packed[2])
            hulls.extend(place(local(hull), rear) for hull in solid.hulls)
            total += len(packed[0])

        for rear in (False, True):
            add(self._packed[rear], self._bodies[rear], lambda p: p, rear)
        for i, (angle, turned) in enumerate(zip(arms, wheels, strict=True)):
            rear, side = i >= 2, 1.0 if i % 2 == 0 else -1.0
            direction = -1.0 if rear else 1.0
            pivot_x = self._axles[int(rear)] - direction * self._arm_length
            x = pivot_x + direction * self._arm_length * math.cos(angle)
            z = self._pivot_height + self._arm_length * math.sin(angle)
            bars = Solid()
            hub = (x, side * (self._half_track - self._half_width), z)
            bars.bar((pivot_x, side * self._pivot_lateral, self._pivot_height), hub, 0.13, IRON)
            bars.bar(
                (pivot_x, side * (self._pivot_lateral - 0.05), self._pivot_height + 0.42),
                np.array([pivot_x + 0.55 * (x - pivot_x), 0.9 * hub[1], 0.45 * self._pivot_height + 0.55 * z]),
                0.06, CHROME, sides=6,
            )  # fmt: skip
            add(bars.packed(), bars, lambda p: p, rear)
            s, c = math.sin(turned), math.cos(turned)

            def rolled(p: Points, x: float = x, side: float = side, z: float = z, s: float = s, c: float = c) -> Points:
                # positive rotation about y brings the top forward
                return np.stack(
                    [x + c * p[:, 0] + s * p[:, 2], side * self._half_track + p[:, 1], z + c * p[:, 2] - s * p[:, 0]],
                    axis=1,
                )

            add(self._packed["wheel"], self._wheel, rolled, rear)
        steering = Solid()
        a, b, half = self._pins
        for side in (1.0, -1.0):
            back = np.array([-a * math.sin(half), side * a * math.cos(half)])
            s, c = math.sin(-joint), math.cos(-joint)
            back = np.array([c * back[0] - s * back[1], s * back[0] + c * back[1]])
            front = np.array([b * math.sin(half), side * b * math.cos(half)])
            steering.bar((*back, 0.78), (*front, 0.78), 0.045, CHROME, sides=6)
        add(steering.packed(), steering, lambda p: p, False)
        return np.concatenate(points), np.concatenate(starts), np.concatenate(colours), hulls


# ---- ground and camera -----------------------------------------------------------------------------------------------


class Camera:
    """A pinhole that looks from a point at another."""

    def __init__(self, eye: Points, target: Points):
        self.eye = eye
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(right, forward), forward])
        self.heading = math.atan2(forward[1], forward[0])

    def seen(self, points: Points) -> tuple[Points, Points]:
        """Places in the picture (..., 2), right and up in half widths, and depths [m] (...)."""
        local = (points - self.eye) @ self._axes.T
        depth = local[..., 2]
        return FOCAL * local[..., :2] / np.maximum(depth, 0.3)[..., None], depth


def _area(ring: Points) -> float:
    """Of a polygon (P, 2), positive counter-clockwise."""
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _noise(x: Points, y: Points, cell: float) -> Points:
    """Smooth random numbers in [0, 1] over the plan, the same at the same place."""
    u, v = np.asarray(x) / cell, np.asarray(y) / cell
    i, j = np.floor(u), np.floor(v)
    fu, fv = u - i, v - j
    fu, fv = fu * fu * (3.0 - 2.0 * fu), fv * fv * (3.0 - 2.0 * fv)

    def corner(di: float, dj: float) -> Points:
        value = np.sin((i + di) * 12.9898 + (j + dj) * 78.233) * 43758.5453
        return value - np.floor(value)

    low = corner(0, 0) * (1 - fu) + corner(1, 0) * fu
    high = corner(0, 1) * (1 - fu) + corner(1, 1) * fu
    return low * (1 - fv) + high * fv


def ground_colour(x: Points, y: Points, slope_x: Any, slope_y: Any) -> Points:
    """Colours (..., 3) of the ground at a place with its slopes [-], in the sun: moss, grass, and soil where it is steep."""
    patches = 0.6 * _noise(x, y, 4.0) + 0.4 * _noise(x + 31.0, y, 1.1)
    colour = MOSS + (GRASS - MOSS) * np.clip(1.6 * patches - 0.3, 0.0, 1.0)[..., None]
    steep = np.hypot(slope_x, slope_y)
    bare = np.clip((steep - 0.18) / 0.3 + 0.25 * (_noise(x, y + 57.0, 2.3) - 0.5), 0.0, 1.0)
    colour = colour + (SOIL - colour) * bare[..., None]
    length = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    light = (SUN[2] - SUN[0] * slope_x - SUN[1] * slope_y) / length
    # steeper relief than true: gentle slopes should be seen
    exaggerated = (SUN[2] - 2.0 * (SUN[0] * slope_x + SUN[1] * slope_y)) / np.sqrt(1.0 + 4.0 * steep**2)
    grain = 0.94 + 0.12 * _noise(x, y, 0.37)
    return np.clip(colour * ((0.45 + 0.5 * light + 0.4 * (exaggerated - SUN[2])) * grain)[..., None] * 1.25, 0.0, 1.0)


class Tracked(Protocol):
    """What the pictures need of the task."""

    render_channels: ClassVar[tuple[str, ...]]
    """Names of the columns of a history."""

    @property
    def courses(self) -> tuple[Course, ...]:
        """By the channel ``course``."""
        ...

    table: PathTable
    """Paths by the channel ``path``."""
    height_map: HeightMap
    """Grounds by the channel ``course``."""


# ---- the scene -------------------------------------------------------------------------------------------------------


class PathTrackingScene:
    """View from behind, map, readings and two strips."""

    size = SIZE

    def __init__(self, machine: Machine, task: Tracked):
        self._task = task
        self._solid = SolidMachine(machine)
        self._columns = {name: i for i, name in enumerate(task.render_channels)}
        self._canvas = Canvas(SIZE)
        self._make_view()
        self._make_map()
        self._make_readings()
        self._make_strips()

    def _make_view(self) -> None:
        from matplotlib.collections import PolyCollection
        from matplotlib.patches import PathPatch, Rectangle
        from matplotlib.path import Path as Outline
        from matplotlib.patheffects import withStroke

        canvas, height = self._canvas, SIZE[1]
        view = canvas.axes(0, 0, VIEW, height)
        view.set_axis_off()
        self._aspect = height / VIEW
        view.set_xlim(-1.0, 1.0)
        view.set_ylim(-self._aspect, self._aspect)
        share = np.linspace(0.0, 1.0, 64)[:, None, None]
        sky = HAZE + (SKY_TOP - HAZE) * share**0.8
        self._sky = canvas.moving(
            view.imshow(np.broadcast_to(sky, (64, 2, 3)), extent=(-1.0, 1.0, 0.0, 1.0), aspect="auto", origin="lower")
        )
        view.set_xlim(-1.0, 1.0)
        view.set_ylim(-self._aspect, self._aspect)
        self._haze = canvas.moving(Rectangle((-1.0, -1.0), 2.0, 1.0, facecolor=HAZE))
        view.add_patch(self._haze)

        def polygons(**style: Any) -> Any:
            collection = PolyCollection([], **style)
            view.add_collection(collection, autolim=False)
            return canvas.moving(collection)

        self._ground = polygons(linewidths=0.6)
        self._trees_behind = polygons(edgecolors="none")
        self._ruts = polygons(facecolors=(0.20, 0.16, 0.11, 0.45), edgecolors="none")
        self._ribbon = polygons(facecolors=BLUE, edgecolors="none", alpha=0.9)
        self._driven = polygons(facecolors=AMBER, edgecolors="none", alpha=0.9)
        self._shadow = canvas.moving(
            PathPatch(Outline(np.zeros((1, 2))), facecolor=(0.03, 0.05, 0.03, 0.45), edgecolor="none")
        )
        view.add_patch(self._shadow)
        self._faces = polygons(linewidths=0.4)
        self._trees_before = polygons(edgecolors="none")
        self._flags = polygons(facecolors=RED, edgecolors="none")
        top = self._aspect - 0.062
        style: dict[str, Any] = {
            "color": INK,
            "va": "center",
            "path_effects": [withStroke(linewidth=3, foreground="#ffffffb0")],
        }
        canvas.moving(view.text(-0.965, top, "AORO", fontsize=15, fontweight="bold", **style))
        canvas.moving(view.text(-0.765, top, "Path tracking", fontsize=15, **style))
        self._clock = canvas.moving(view.text(0.965, top, "", fontsize=13, ha="right", **style))

    def _make_map(self) -> None:
        from matplotlib.patches import Polygon

        canvas = self._canvas
        self._map = canvas.axes(VIEW, SIZE[1] - MAP_HEIGHT, PANEL, MAP_HEIGHT)
        self._map.set_axis_off()
        self._map_shape = PANEL / MAP_HEIGHT
        self._map_image: Any = None
        self._map_key: tuple[int, int] | None = None
        self._map_trees = self._map.scatter([], [], s=9.0, color="#2f4a2c", linewidths=0.0, alpha=0.75)
        (self._map_path,) = self._map.plot([], [], color=BLUE, linewidth=2.2, solid_capstyle="round")
        (self._map_trace,) = self._map.plot([], [], color=AMBER, linewidth=1.8, solid_capstyle="round")
        canvas.moving(self._map_trace)
        (self._map_ends,) = self._map.plot(
            [], [], "o", color=PAPER, markersize=5, markeredgecolor=INK, markeredgewidth=1.2
        )
        (self._map_scale,) = self._map.plot([], [], color=INK, linewidth=2.0, solid_capstyle="butt")
        self._map_label = self._map.text(0.0, 0.0, "10 m", fontsize=8, color=INK, ha="center", va="bottom")
        self._map_machine = []
        for colour in ("#e7a52b", "#f0b23c"):
            patch = Polygon(np.zeros((4, 2)), closed=True, facecolor=colour, edgecolor=INK, linewidth=0.7)
            self._map.add_patch(patch)
            self._map_machine.append(canvas.moving(patch))

    def _make_readings(self) -> None:
        from matplotlib.patches import Rectangle

        canvas, height = self._canvas, SIZE[1] - MAP_HEIGHT - 210
        board = canvas.axes(VIEW, 210, PANEL, height)
        board.set_xlim(0.0, PANEL)
        board.set_ylim(0.0, height)
        board.set_axis_off()

        def reading(x: float, label: str, size: float, colour: str) -> Any:
            board.text(x, 112.0, label, fontsize=9, color=SOFT)
            return canvas.moving(board.text(x, 78.0, "", fontsize=size, color=colour, va="baseline"))

        self._error = reading(24.0, "cross-track", 18, INK)
        self._pace = reading(150.0, "speed", 18, GREEN)
        self._left = reading(286.0, "to go", 18, BLUE)
        self._bars = []
        for y, name in ((38.0, "steer"), (14.0, "drive")):
            board.text(24.0, y + 5.0, name, fontsize=9, color=SOFT, va="center")
            board.add_patch(Rectangle((70.0, y), 200.0, 10.0, facecolor="#e3e8ec"))
            bar = canvas.moving(Rectangle((170.0, y), 0.0, 10.0, facecolor=AMBER))
            board.add_patch(bar)
            board.plot([170.0, 170.0], [y - 3.0, y + 13.0], color=INK, linewidth=1.1)
            self._bars.append(bar)
        self._gear = canvas.moving(board.text(286.0, 43.0, "", fontsize=10, color=INK, va="center"))
        self._tilt = canvas.moving(board.text(286.0, 19.0, "", fontsize=10, color=INK, va="center"))

    def _make_strips(self) -> None:
        canvas = self._canvas
        strip = Traces(
            canvas, canvas.axes(VIEW + 46, 122, PANEL - 66, 64), "cross-track [m], + left", 0.6, (-0.5, 0, 0.5),
            span=STRIP_SPAN, every=10.0, gap=0.2,
        )  # fmt: skip
        self._true_line = strip.line("true", INK)
        self._seen_line = strip.line("measured", BLUE, linewidth=1.0)
        strip = Traces(
            canvas,
            canvas.axes(VIEW + 46, 26, PANEL - 66, 64),
            "speed [m/s]",
            (-0.3, 2.6),
            (0, 1, 2),
            span=STRIP_SPAN,
            every=10.0,
        )
        self._speed_line = strip.line("", GREEN)

    # ---- one frame

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture of the channels of ``PathTracking.render_channels``, (frames, channels)."""
        there = history[~np.isnan(history[:, 0])].astype(np.float64)
        now = dict(zip(self._columns, there[-1], strict=True))
        course, path = int(now["course"]), int(now["path"])
        self._chart(course, path, there, now)

        origin = np.array([now["x"], now["y"], now["z"]])
        recent = there[-30:, self._columns["yaw"]] - 0.5 * there[-30:, self._columns["joint_angle"]]
        heading = math.atan2(np.sin(recent).mean(), np.cos(recent).mean())
        ahead = np.array([math.cos(heading), math.sin(heading)])
        eye_xy = origin[:2] - BEHIND * ahead + ASIDE * np.array([ahead[1], -ahead[0]])
        floor = float(self._height(course, eye_xy[None])[0])
        eye = np.array([*eye_xy, max(floor, origin[2] - 0.8) + ABOVE])
        target = np.array([*(origin[:2] + AIM[0] * ahead), origin[2] + AIM[1]])
        camera = Camera(eye, target)

        self._draw_ground(camera, course)
        horizon, _ = camera.seen(camera.eye + 1e4 * np.array([math.cos(camera.heading), math.sin(camera.heading), 0.0]))
        self._sky.set_extent((-1.0, 1.0, horizon[1] - 0.01, horizon[1] + 0.75))
        self._haze.set_height(1.0 + horizon[1])
        s = now["s"]
        length = self._task.table.lengths[path]
        closed = self._task.table.paths[path].closed
        stations = np.arange(max(s - 12.0, 0.0), s + 45.0 if closed else min(s + 45.0, length) + 0.01, 0.4)
        self._lay(self._ribbon, camera, course, self._on_path(path, stations), 0.11, 0.04)
        reference = there[-500::4][:, [self._columns["reference_x"], self._columns["reference_y"]]]
        self._lay(self._driven, camera, course, reference, 0.06, 0.06)
        self._lay_ruts(camera, course, there)

        arms = [now[f"arm_{wheel}"] for wheel in WHEELS]
        wheels = [now[f"wheel_{wheel}"] for wheel in WHEELS]
        self._draw_machine(
            camera, course, origin, (now["roll"], now["pitch"], now["yaw"], now["joint_angle"], arms, wheels)
        )
        self._draw_flag(camera, course, path)
        self._draw_trees(camera, course, float(np.hypot(*(origin[:2] - eye[:2]))))
        self._read(now, there, length)
        return self._canvas.picture()

    def _height(self, course: int, xy: Points) -> Points:
        return self._task.height_map.height(np.full(len(xy), course), xy)

    def _on_path(self, path: int, s: Points) -> Points:
        return self._task.table.at(np.full(len(s), path), s)[0]

    def _draw_ground(self, camera: Camera, course: int) -> None:
        task, eye = self._task, camera.eye
        squares, colours, depths = [], [], []
        for level, (cell, reach) in enumerate(LEVELS):
            least = LEVELS[level - 1][1] - 1.5 * cell if level else 0.0
            number = np.arange(-math.ceil(reach / cell), math.ceil(reach / cell) + 1)
            x = (np.floor(eye[0] / cell) + number) * cell
            y = (np.floor(eye[1] / cell) + number) * cell
            middle = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2) + 0.5 * cell
            apart = middle - eye[:2]
            distance = np.hypot(apart[:, 0], apart[:, 1])
            off = np.abs((np.arctan2(apart[:, 1], apart[:, 0]) - camera.heading + np.pi) % (2.0 * np.pi) - np.pi)
            wide = math.atan(1.0 / FOCAL) + np.minimum(1.5 * cell / np.maximum(distance, 0.1), 1.0) + 0.1
            middle = middle[(distance >= least) & (distance < reach) & ((off < wide) | (distance < 8.0))]
            if not len(middle):
                continue
            number = np.full(len(middle), course)
            middle = middle[task.height_map.known(number, middle)]
            corners = middle[:, None] + 0.5 * cell * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            z = self._height(course, corners.reshape(-1, 2)).reshape(-1, 4)
            slope_x = (z[:, 1] + z[:, 2] - z[:, 0] - z[:, 3]) / (2.0 * cell)
            slope_y = (z[:, 2] + z[:, 3] - z[:, 0] - z[:, 1]) / (2.0 * cell)
            seen, depth = camera.seen(np.concatenate([corners, z[..., None]], axis=-1))
            kept = (
                (depth.min(axis=1) > 0.4)
                & (np.abs(seen[..., 0]).min(axis=1) < 1.05)
                & (seen[..., 1].max(axis=1) > -1.0)
            )
            colour = ground_colour(middle[:, 0], middle[:, 1], slope_x, slope_y)
            haze = np.clip(depth.mean(axis=1) / FAR, 0.0, 1.0)[:, None] ** 0.8
            squares.append(seen[kept])
            colours.append((colour + (HAZE - colour) * haze)[kept])
            depths.append(depth.mean(axis=1)[kept])
        order = np.argsort(-np.concatenate(depths), kind="stable")
        self._ground.set_verts(np.concatenate(squares)[order])
        painted = np.concatenate(colours)[order]
        self._ground.set_facecolors(painted)
        self._ground.set_edgecolors(painted)

    def _lay(self, collection: Any, camera: Camera, course: int, line: Points, half: float, lift: float) -> None:
        """A ribbon along a line (P, 2) on the ground."""
        if len(line) < 2:
            collection.set_verts([])
            return
        along = np.gradient(line, axis=0)
        length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
        aside = half * np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
        edges = []
        for edge in (line + aside, line - aside):
            edges.append(np.column_stack([edge, self._height(course, edge) + lift]))
        quads = np.stack([edges[0][:-1], edges[0][1:], edges[1][1:], edges[1][:-1]], axis=1)
        seen, depth = camera.seen(quads)
        moved = np.hypot(*(line[1:] - line[:-1]).T) > 1e-4
        collection.set_verts(seen[(depth.min(axis=1) > 0.4) & moved])

    def _lay_ruts(self, camera: Camera, course: int, there: Points) -> None:
        """Tracks of the rear wheels."""
        rows = there[-400::6]
        column = self._columns
        rear = rows[:, column["yaw"]] - rows[:, column["joint_angle"]]
        axle = self._solid._axles[1]
        middle = rows[:, [column["x"], column["y"]]] + axle * np.stack([np.cos(rear), np.sin(rear)], axis=1)
        quads = []
        for side in (1.0, -1.0):
            line = middle + side * self._solid._half_track * np.stack([-np.sin(rear), np.cos(rear)], axis=1)
            self._lay(self._ruts, camera, course, line, self._solid._half_width, 0.02)
            quads += [p.vertices[:4] for p in self._ruts.get_paths()]
        self._ruts.set_verts(quads)

    def _draw_machine(self, camera: Camera, course: int, origin: Points, pose: tuple[Any, ...]) -> None:
        from matplotlib.path import Path as Outline
        from scipy.spatial import ConvexHull

        points, starts, colours, hulls = self._solid.posed(origin, *pose)
        seen, depth = camera.seen(points)
        faces, kept = [], []
        for f in range(len(colours)):
            span = slice(starts[f], starts[f + 1])
            a, b, c = points[starts[f] : starts[f] + 3]
            normal = np.cross(b - a, c - a)
            if normal @ (camera.eye - a) <= 0.0:
                continue
            light = 0.52 + 0.55 * max(float(normal @ SUN) / max(float(np.linalg.norm(normal)), 1e-12), 0.0)
            faces.append(seen[span])
            kept.append((-depth[span].mean(), np.clip(colours[f] * light, 0.0, 1.0)))
        order = sorted(range(len(kept)), key=lambda i: kept[i][0])
        self._faces.set_verts([faces[i] for i in order])
        painted = [kept[i][1] for i in order]
        self._faces.set_facecolors(painted)
        self._faces.set_edgecolors([0.8 * colour for colour in painted])

        shadows = []
        for hull in hulls:
            base = self._height(course, hull[:, :2])
            cast = hull[:, :2] - SUN[:2] / SUN[2] * np.maximum(hull[:, 2] - base, 0.0)[:, None]
            ring = cast[ConvexHull(cast).vertices]
            flat, far = camera.seen(np.column_stack([ring, self._height(course, ring) + 0.03]))
            if far.min() > 0.4:
                shadows.append(flat)
        # one outline of all rings, each counter-clockwise: overlaps are filled once
        self._shadow.set_visible(bool(shadows))
        if shadows:
            rings = [ring if _area(ring) > 0.0 else ring[::-1] for ring in shadows]
            self._shadow.set_path(
                Outline.make_compound_path(*(Outline(r[[*range(len(r)), 0]], closed=True) for r in rings))
            )

    def _draw_trees(self, camera: Camera, course: int, apart: float) -> None:
        """Spruces as flat shapes that face the camera: a trunk and three tiers, lit from the sun's side."""
        trees = self._task.courses[course].trees
        gone = np.hypot(*(trees[:, :2] - camera.eye[:2]).T)
        trees, gone = trees[gone > 6.0], gone[gone > 6.0]
        aside = np.array([math.sin(camera.heading), -math.cos(camera.heading)])
        order = np.argsort(-gone)
        shapes: dict[bool, tuple[list[Points], list[Points]]] = {True: ([], []), False: ([], [])}
        base = self._height(course, trees[:, :2])
        lit = 1.0 if SUN[:2] @ aside > 0.0 else -1.0
        for i in order:
            x, y, radius, height = trees[i]
            spread = 0.17 * height
            tiers: list[Any] = [((-radius, 0.0), (radius, 0.0), (radius, 0.25 * height), (-radius, 0.25 * height))]
            paints = [np.array([0.27, 0.20, 0.15])]
            for low, high, wide in ((0.12, 0.56, 1.0), (0.36, 0.78, 0.74), (0.58, 1.0, 0.48)):
                tiers.append(((-wide * spread, low * height), (wide * spread, low * height), (0.0, high * height)))
                tiers.append(((0.0, low * height), (lit * wide * spread, low * height), (0.0, high * height)))
                shade = 0.85 + 0.25 * _noise(x, y, 0.7)
                paints += [np.array([0.11, 0.21, 0.12]) * shade, np.array([0.17, 0.30, 0.15]) * shade]
            haze = min(gone[i] / FAR, 1.0) ** 0.8
            squares, colours = shapes[bool(gone[i] > apart)]
            for tier, paint in zip(tiers, paints, strict=True):
                flat = np.array(tier)
                points = np.column_stack([np.array([x, y]) + flat[:, :1] * aside, base[i] + flat[:, 1]])
                seen, depth = camera.seen(points)
                if depth.min() < 1.0 or np.abs(seen[:, 0]).min() > 1.1:
                    break
                squares.append(seen)
                near = 0.2 if gone[i] < apart else 1.0  # see the machine through what stands before it
                colours.append(np.append(paint + (HAZE - paint) * haze, near))
        for collection, key in ((self._trees_behind, True), (self._trees_before, False)):
            collection.set_verts(shapes[key][0])
            collection.set_facecolors(shapes[key][1])

    def _draw_flag(self, camera: Camera, course: int, path: int) -> None:
        """A pole with a flag at the path's end."""
        end = self._on_path(path, np.array([self._task.table.lengths[path]]))[0]
        z = float(self._height(course, end[None])[0])
        aside = np.array([-math.sin(camera.heading), math.cos(camera.heading)]) * -1.0

        def at(across: float, up: float) -> Points:
            return np.array([*(end + across * aside), z + up])

        shapes = [
            np.array([at(-0.03, 0.0), at(0.03, 0.0), at(0.03, 2.4), at(-0.03, 2.4)]),
            np.array([at(0.03, 2.4), at(0.9, 2.12), at(0.03, 1.84)]),
        ]
        seen = [camera.seen(shape) for shape in shapes]
        self._flags.set_verts([flat for flat, depth in seen if 1.0 < depth.min() < 0.6 * FAR])

    def _chart(self, course: int, path: int, there: Points, now: dict[str, float]) -> None:
        """The map: hillshade with contours, path, trace and the machine."""
        column = self._columns
        if self._map_key != (course, path):
            self._map_key = (course, path)
            trees = self._task.courses[course].trees
            self._map_trees.set_offsets(trees[:, :2])
            points = self._task.table.paths[path].points
            low, high = points.min(axis=0) - 5.0, points.max(axis=0) + 5.0
            size = np.maximum(high - low, 24.0)
            size = np.array([max(size[0], size[1] * self._map_shape), max(size[1], size[0] / self._map_shape)])
            low, high = 0.5 * (low + high) - 0.5 * size, 0.5 * (low + high) + 0.5 * size
            columns = 400
            x = low[0] + size[0] * (np.arange(columns) + 0.5) / columns
            y = low[1] + size[1] * (np.arange(int(columns / self._map_shape)) + 0.5) / int(columns / self._map_shape)
            grid = np.stack(np.meshgrid(x, y), axis=-1)
            number = np.full(grid.shape[:2], course)
            z = self._task.height_map.height(number, grid)
            slope_y, slope_x = np.gradient(z, y, x)
            image = ground_colour(grid[..., 0], grid[..., 1], slope_x, slope_y)
            image = 0.35 + 0.65 * image  # paper shines through
            steep = np.maximum(np.hypot(slope_x, slope_y), 1e-6)
            for interval, strength in ((0.5, 0.10), (2.0, 0.16)):
                line = np.abs((z / interval + 0.5) % 1.0 - 0.5) * interval / steep / (size[0] / columns)
                image = image * (1.0 - strength * np.clip(1.4 - line, 0.0, 1.0) * (steep > 0.01))[..., None]
            image = np.where(self._task.height_map.known(number, grid)[..., None], image, 0.96)
            if self._map_image is not None:
                self._map_image.remove()
            self._map_image = self._map.imshow(
                image, extent=(low[0], high[0], low[1], high[1]), origin="lower", aspect="auto", zorder=0
            )
            self._map.set_xlim(low[0], high[0])
            self._map.set_ylim(low[1], high[1])
            line = points if not self._task.table.paths[path].closed else np.concatenate([points, points[:1]])
            self._map_path.set_data(*line.T)
            self._map_ends.set_data(*line[[0, -1]].T)
            corner = low + 0.06 * size[1]
            self._map_scale.set_data([corner[0], corner[0] + 10.0], [corner[1], corner[1]])
            self._map_label.set_position((corner[0] + 5.0, corner[1] + 0.012 * size[1]))
            self._canvas.forget()
        self._map_trace.set_data(there[:, column["reference_x"]], there[:, column["reference_y"]])
        at = np.array([now["x"], now["y"]])
        for patch, sign, heading in zip(
            self._map_machine, (-1.0, 1.0), (now["yaw"] - now["joint_angle"], now["yaw"]), strict=True
        ):
            s, c = math.sin(heading), math.cos(heading)
            outline = np.array([[0.15, 1.2], [2.4, 1.2], [2.4, -1.2], [0.15, -1.2]]) * [sign, 1.0]
            patch.set_xy(at + outline @ np.array([[c, s], [-s, c]]))

    def _read(self, now: dict[str, float], there: Points, length: float) -> None:
        column = self._columns
        error = now["cross_track"]
        self._clock.set_text(f"{now['time']:.1f} s")
        self._error.set_text(f"{100.0 * error:+.0f} cm".replace("-", "−"))
        self._error.set_color(RED if abs(error) > 0.5 else INK)
        self._pace.set_text(f"{now['speed']:.2f} m/s".replace("-", "−"))
        self._left.set_text(f"{max(length - now['s'], 0.0):.1f} m")
        for bar, value in zip(self._bars, (-now["steering_signal"], now["drive_signal"]), strict=True):
            bar.set_width(100.0 * value)  # left is left
        tilt = math.degrees(math.acos(min(math.cos(now["roll"]) * math.cos(now["pitch"]), 1.0)))
        self._gear.set_text(f"gear {now['gear']:.0f}")
        self._tilt.set_text(f"tilt {tilt:.0f}°")
        since = there[:, column["time"]] - now["time"]
        self._true_line.set_data(since, np.clip(there[:, column["cross_track"]], -0.62, 0.62))
        self._seen_line.set_data(since, np.clip(there[:, column["measured_cross_track"]], -0.62, 0.62))
        self._speed_line.set_data(since, there[:, column["speed"]])
