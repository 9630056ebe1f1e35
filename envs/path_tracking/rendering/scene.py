"""The picture as a whole: the view from behind, and beside it the map, the readings and two strips."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.rendering import Canvas, Traces
from aoro_gym.envs.path_tracking.rendering.chase_view import ChaseView
from aoro_gym.envs.path_tracking.rendering.history import History, Tracked
from aoro_gym.envs.path_tracking.rendering.map import Map
from aoro_gym.machine import Machine
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, RED, SOFT

SIZE = (1120, 630)
"""Width and height of a picture [px]; both even, for video encoders."""
VIEW = 720
"""Width of the view from behind [px]."""
PANEL, MAP_HEIGHT = SIZE[0] - VIEW, 270
"""Width of what stands beside the view, and height of the map in it [px]."""
STRIP_SPAN = 30.0
"""Time [s] that the strips show."""


class PathTrackingScene:
    """View from behind, map, readings and two strips.

    Args:
        machine: That is drawn.
        task: Where it drives.
        title: What it does there.
    """

    size = SIZE

    def __init__(self, machine: Machine, task: Tracked, title: str = "Path tracking"):
        self._task = task
        self._canvas = Canvas(SIZE)
        self._parts = (
            ChaseView(self._canvas, (VIEW, SIZE[1]), machine, task, title),
            Map(self._canvas, (VIEW, SIZE[1] - MAP_HEIGHT, PANEL, MAP_HEIGHT), task),
            Readings(self._canvas, task),
            Strips(self._canvas),
        )

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture of the channels of ``PathTracking.render_channels``, (frames, channels)."""
        so_far = History(self._task.render_channels, history)
        for part in self._parts:
            part.draw(so_far)
        return self._canvas.picture()


class Readings:
    """Error, speed, what is left of the path, both signals, gear and tilt, of now."""

    def __init__(self, canvas: Canvas, task: Tracked):
        from matplotlib.patches import Rectangle

        self._task = task
        height = SIZE[1] - MAP_HEIGHT - 210
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

    def draw(self, history: History) -> None:
        """Write what is read now."""
        now = history.now
        error = now["cross_track"]
        self._error.set_text(f"{100.0 * error:+.0f} cm".replace("-", "−"))
        self._error.set_color(RED if abs(error) > 0.5 else INK)
        self._pace.set_text(f"{now['speed']:.2f} m/s".replace("-", "−"))
        self._left.set_text(f"{max(self._task.table.lengths[history.path] - now['s'], 0.0):.1f} m")
        for bar, value in zip(self._bars, (-now["steering_signal"], now["drive_signal"]), strict=True):
            bar.set_width(100.0 * value)  # left is left
        tilt = math.degrees(math.acos(min(math.cos(now["roll"]) * math.cos(now["pitch"]), 1.0)))
        self._gear.set_text(f"gear {now['gear']:.0f}")
        self._tilt.set_text(f"tilt {tilt:.0f}°")


class Strips:
    """Traces of the cross-track error and the speed over the last seconds."""

    def __init__(self, canvas: Canvas):
        strip = Traces(
            canvas, canvas.axes(VIEW + 46, 122, PANEL - 66, 64), "cross-track [m], + left", 0.6, (-0.5, 0, 0.5),
            span=STRIP_SPAN, every=10.0, gap=0.2,
        )  # fmt: skip
        self._true_line = strip.line("true", INK)
        self._seen_line = strip.line("measured", BLUE, linewidth=1.0)
        strip = Traces(
            canvas, canvas.axes(VIEW + 46, 26, PANEL - 66, 64), "speed [m/s]", (-0.3, 2.6), (0, 1, 2),
            span=STRIP_SPAN, every=10.0,
        )  # fmt: skip
        self._speed_line = strip.line("", GREEN)

    def draw(self, history: History) -> None:
        """Draw the lines up to now."""
        since = history["time"] - history.now["time"]
        self._true_line.set_data(since, np.clip(history["cross_track"], -0.62, 0.62))
        self._seen_line.set_data(since, np.clip(history["measured_cross_track"], -0.62, 0.62))
        self._speed_line.set_data(since, history["speed"])
