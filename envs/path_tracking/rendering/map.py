"""The map: hillshade with contours, the path, the trace and the machine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aoro_gym.envs.core.rendering import PAPER, Canvas
from aoro_gym.envs.path_tracking.rendering.ground import ground_colour
from aoro_gym.envs.path_tracking.rendering.history import History, Tracked
from aoro_gym.machine.solid import Points
from aoro_gym.reporting.style import AMBER, BLUE, INK

COLUMNS = 400
"""Of the hillshade's picture."""
FRAMES = np.array([[0.15, 1.2], [2.4, 1.2], [2.4, -1.2], [0.15, -1.2]])
"""Outline of the front frame from the hinge, forward and left [m]; the rear one's is its mirror image."""


class Map:
    """Part of the picture.

    Args:
        canvas: Where it stands.
        place: Left, bottom, width and height in it [px].
        task: Where the machine drives.
    """

    def __init__(self, canvas: Canvas, place: tuple[int, int, int, int], task: Tracked):
        from matplotlib.patches import Polygon

        self._task, self._canvas = task, canvas
        self._axes = axes = canvas.axes(*place)
        axes.set_axis_off()
        self._shape = place[2] / place[3]
        self._image: Any = None
        self._shown: tuple[int, int] | None = None
        self._trees = axes.scatter([], [], s=9.0, color="#2f4a2c", linewidths=0.0, alpha=0.75)
        (self._path,) = axes.plot([], [], color=BLUE, linewidth=2.2, solid_capstyle="round")
        (self._trace,) = axes.plot([], [], color=AMBER, linewidth=1.8, solid_capstyle="round")
        canvas.moving(self._trace)
        (self._ends,) = axes.plot([], [], "o", color=PAPER, markersize=5, markeredgecolor=INK, markeredgewidth=1.2)
        (self._scale,) = axes.plot([], [], color=INK, linewidth=2.0, solid_capstyle="butt")
        self._label = axes.text(0.0, 0.0, "10 m", fontsize=8, color=INK, ha="center", va="bottom")
        self._frames = []
        for colour in ("#e7a52b", "#f0b23c"):
            patch = Polygon(np.zeros((4, 2)), closed=True, facecolor=colour, edgecolor=INK, linewidth=0.7)
            axes.add_patch(patch)
            self._frames.append(canvas.moving(patch))

    def draw(self, history: History) -> None:
        """Move what moves to where it is now; draw another path's map where it is another one."""
        if self._shown != (history.course, history.path):
            self._shown = (history.course, history.path)
            self._show(*self._shown)
        self._trace.set_data(history["reference_x"], history["reference_y"])
        now = history.now
        at = np.array([now["x"], now["y"]])
        for patch, sign, heading in zip(
            self._frames, (-1.0, 1.0), (now["yaw"] - now["joint_angle"], now["yaw"]), strict=True
        ):
            s, c = math.sin(heading), math.cos(heading)
            patch.set_xy(at + FRAMES * [sign, 1.0] @ np.array([[c, s], [-s, c]]))

    def _show(self, course: int, path: int) -> None:
        """The standing parts."""
        self._trees.set_offsets(self._task.courses[course].trees[:, :2])
        points = self._task.table.paths[path].points
        low, high = points.min(axis=0) - 5.0, points.max(axis=0) + 5.0
        size = np.maximum(high - low, 24.0)
        size = np.array([max(size[0], size[1] * self._shape), max(size[1], size[0] / self._shape)])
        low, high = 0.5 * (low + high) - 0.5 * size, 0.5 * (low + high) + 0.5 * size
        if self._image is not None:
            self._image.remove()
        self._image = self._axes.imshow(
            self._hillshade(course, low, size),
            extent=(low[0], high[0], low[1], high[1]), origin="lower", aspect="auto", zorder=0,
        )  # fmt: skip
        self._axes.set_xlim(low[0], high[0])
        self._axes.set_ylim(low[1], high[1])
        line = points if not self._task.table.paths[path].closed else np.concatenate([points, points[:1]])
        self._path.set_data(*line.T)
        self._ends.set_data(*line[[0, -1]].T)
        corner = low + 0.06 * size[1]
        self._scale.set_data([corner[0], corner[0] + 10.0], [corner[1], corner[1]])
        self._label.set_position((corner[0] + 5.0, corner[1] + 0.012 * size[1]))
        self._canvas.forget()

    def _hillshade(self, course: int, low: Points, size: Points) -> Points:
        """Colours (rows, columns, 3) of the ground within ``size`` [m] from the lower left corner, with contours."""
        rows = int(COLUMNS / self._shape)
        x = low[0] + size[0] * (np.arange(COLUMNS) + 0.5) / COLUMNS
        y = low[1] + size[1] * (np.arange(rows) + 0.5) / rows
        grid = np.stack(np.meshgrid(x, y), axis=-1)
        number = np.full(grid.shape[:2], course)
        z = self._task.height_map.height(number, grid)
        slope_y, slope_x = np.gradient(z, y, x)
        image = ground_colour(grid[..., 0], grid[..., 1], slope_x, slope_y)
        image = 0.35 + 0.65 * image  # paper shines through
        steep = np.maximum(np.hypot(slope_x, slope_y), 1e-6)
        for interval, strength in ((0.5, 0.10), (2.0, 0.16)):
            line = np.abs((z / interval + 0.5) % 1.0 - 0.5) * interval / steep / (size[0] / COLUMNS)
            image = image * (1.0 - strength * np.clip(1.4 - line, 0.0, 1.0) * (steep > 0.01))[..., None]
        return np.where(self._task.height_map.known(number, grid)[..., None], image, 0.96)
