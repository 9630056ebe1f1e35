"""The view from behind: ground, path, tracks, the machine with its shadow, trees and the flag at the path's end."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aoro_gym.envs.core.rendering import Canvas
from aoro_gym.envs.path_tracking.rendering.camera import FAR, HAZE, SUN, Camera
from aoro_gym.envs.path_tracking.rendering.ground import ground_cells
from aoro_gym.envs.path_tracking.rendering.history import History, Tracked
from aoro_gym.envs.path_tracking.rendering.machine import SolidMachine
from aoro_gym.envs.path_tracking.rendering.trees import tree_shapes
from aoro_gym.machine import Machine
from aoro_gym.machine.solid import Points
from aoro_gym.reporting.style import AMBER, BLUE, INK, RED
from aoro_gym.twin.records import WHEELS

SKY_TOP = np.array([0.42, 0.60, 0.78])


class ChaseView:
    """The left part of the picture.

    Args:
        canvas: Where it stands.
        size: Width and height [px].
        machine: What is drawn.
        task: Where it drives.
        title: What it does there.
    """

    def __init__(self, canvas: Canvas, size: tuple[int, int], machine: Machine, task: Tracked, title: str):
        self._task = task
        self._solid = SolidMachine(machine)
        view = canvas.axes(0, 0, *size)
        view.set_axis_off()
        self._aspect = size[1] / size[0]
        self._make_shapes(canvas, view)
        self._make_title(canvas, view, title)

    def _make_shapes(self, canvas: Canvas, view: Any) -> None:
        from matplotlib.collections import PolyCollection
        from matplotlib.patches import PathPatch, Rectangle
        from matplotlib.path import Path as Outline

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

    def _make_title(self, canvas: Canvas, view: Any, title: str) -> None:
        from matplotlib.patheffects import withStroke

        top = self._aspect - 0.062
        style: dict[str, Any] = {
            "color": INK,
            "va": "center",
            "path_effects": [withStroke(linewidth=3, foreground="#ffffffb0")],
        }
        canvas.moving(view.text(-0.965, top, "AORO", fontsize=15, fontweight="bold", **style))
        canvas.moving(view.text(-0.765, top, title, fontsize=15, **style))
        self._clock = canvas.moving(view.text(0.965, top, "", fontsize=13, ha="right", **style))

    def draw(self, history: History) -> None:
        """Move what moves to where it is now."""
        now, course, path = history.now, history.course, history.path
        origin = np.array([now["x"], now["y"], now["z"]])
        recent = history["yaw"][-30:] - 0.5 * history["joint_angle"][-30:]
        heading = math.atan2(np.sin(recent).mean(), np.cos(recent).mean())
        camera = Camera.following(origin, heading, lambda places: self._height(course, places))
        self._clock.set_text(f"{now['time']:.1f} s")
        horizon = camera.horizon()
        self._sky.set_extent((-1.0, 1.0, horizon - 0.01, horizon + 0.75))
        self._haze.set_height(1.0 + horizon)
        squares, colours = ground_cells(camera, self._task.height_map, course)
        self._ground.set_verts(squares)
        self._ground.set_facecolors(colours)
        self._ground.set_edgecolors(colours)
        self._ribbon.set_verts(self._band(camera, course, self._path_near(path, now["s"]), 0.11, 0.04))
        driven = history.places("reference_x", "reference_y")[-500::4]
        self._driven.set_verts(self._band(camera, course, driven, 0.06, 0.06))
        self._ruts.set_verts(self._tracks(camera, history))
        self._draw_machine(camera, origin, history)
        self._draw_flag(camera, course, path)
        trees, apart = self._task.courses[course].trees, float(np.hypot(*(origin[:2] - camera.eye[:2])))
        shapes = tree_shapes(camera, trees, self._height(course, trees[:, :2]), apart)
        for collection, (outlines, colours) in zip((self._trees_behind, self._trees_before), shapes, strict=True):
            collection.set_verts(outlines)
            collection.set_facecolors(colours)

    def _height(self, course: int, xy: Points) -> Points:
        return self._task.height_map.height(np.full(len(xy), course), xy)

    def _path_near(self, path: int, s: float) -> Points:
        """Points (P, 2) of a path from a little behind a distance along it [m] to ahead."""
        length = self._task.table.lengths[path]
        end = s + 45.0 if self._task.table.paths[path].closed else min(s + 45.0, length) + 0.01
        return self._on_path(path, np.arange(max(s - 12.0, 0.0), end, 0.4))

    def _on_path(self, path: int, s: Points) -> Points:
        return self._task.table.at(np.full(len(s), path), s)[0]

    def _band(self, camera: Camera, course: int, line: Points, half: float, lift: float) -> Points:
        """Quads (Q, 4, 2) along a line on the ground.

        Args:
            camera: What sees it.
            course: Whose ground.
            line: Points (P, 2) [m].
            half: Of the width [m].
            lift: Height over the ground [m].
        """
        if len(line) < 2:
            return np.empty((0, 4, 2))
        along = np.gradient(line, axis=0)
        length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
        aside = half * np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
        left, right = (
            np.column_stack([edge, self._height(course, edge) + lift]) for edge in (line + aside, line - aside)
        )
        seen, depth = camera.seen(np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1))
        moved = np.hypot(*(line[1:] - line[:-1]).T) > 1e-4
        return seen[(depth.min(axis=1) > 0.4) & moved]

    def _tracks(self, camera: Camera, history: History) -> Points:
        """Quads of the tracks of the rear wheels."""
        recent = slice(-400, None, 6)
        rear = history["yaw"][recent] - history["joint_angle"][recent]
        forward, left = (
            np.stack(axis, axis=1) for axis in ((np.cos(rear), np.sin(rear)), (-np.sin(rear), np.cos(rear)))
        )
        middle = history.places("x", "y")[recent] + self._solid.axles[1] * forward
        return np.concatenate(
            [
                self._band(camera, history.course, middle + side * left, self._solid.half_width, 0.02)
                for side in (self._solid.half_track, -self._solid.half_track)
            ]
        )

    def _draw_machine(self, camera: Camera, origin: Points, history: History) -> None:
        now = history.now
        arms, wheels = ([now[f"{part}_{wheel}"] for wheel in WHEELS] for part in ("arm", "wheel"))
        points, starts, colours, hulls = self._solid.posed(
            origin, now["roll"], now["pitch"], now["yaw"], now["joint_angle"], arms, wheels
        )
        seen, depth = camera.seen(points)
        faces = []  # depth, outline and colour
        for f in range(len(colours)):
            span = slice(starts[f], starts[f + 1])
            a, b, c = points[starts[f] : starts[f] + 3]
            normal = np.cross(b - a, c - a)
            if normal @ (camera.eye - a) <= 0.0:
                continue
            light = 0.52 + 0.55 * max(float(normal @ SUN) / max(float(np.linalg.norm(normal)), 1e-12), 0.0)
            faces.append((depth[span].mean(), seen[span], np.clip(colours[f] * light, 0.0, 1.0)))
        faces.sort(key=lambda face: -face[0])
        self._faces.set_verts([outline for _, outline, _ in faces])
        self._faces.set_facecolors([colour for _, _, colour in faces])
        self._faces.set_edgecolors([0.8 * colour for _, _, colour in faces])
        self._draw_shadow(camera, history.course, hulls)

    def _draw_shadow(self, camera: Camera, course: int, hulls: list[Points]) -> None:
        from matplotlib.path import Path as Outline
        from scipy.spatial import ConvexHull

        rings = []
        for hull in hulls:
            base = self._height(course, hull[:, :2])
            cast = hull[:, :2] - SUN[:2] / SUN[2] * np.maximum(hull[:, 2] - base, 0.0)[:, None]
            ring = cast[ConvexHull(cast).vertices]
            flat, far = camera.seen(np.column_stack([ring, self._height(course, ring) + 0.03]))
            if far.min() > 0.4:
                rings.append(flat if _area(flat) > 0.0 else flat[::-1])
        # one outline of all rings, each counter-clockwise: overlaps are filled once
        self._shadow.set_visible(bool(rings))
        if rings:
            outlines = (Outline(ring[[*range(len(ring)), 0]], closed=True) for ring in rings)
            self._shadow.set_path(Outline.make_compound_path(*outlines))

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


def _area(ring: Points) -> float:
    """Of a polygon (P, 2), positive counter-clockwise."""
    x, y = ring.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
