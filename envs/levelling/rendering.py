"""Pictures of levelling: the view from behind and the map of path tracking, tilt, loads and the signals of the arms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.rendering import Canvas, Traces
from aoro_gym.envs.levelling.config import ARM_SIGNALS
from aoro_gym.envs.path_tracking.rendering.chase_view import ChaseView
from aoro_gym.envs.path_tracking.rendering.history import History, Tracked
from aoro_gym.envs.path_tracking.rendering.map import Map
from aoro_gym.envs.path_tracking.rendering.scene import MAP_HEIGHT, PANEL, SIZE, STRIP_SPAN, VIEW
from aoro_gym.machine import Machine
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, RED, SOFT

WORST_TILT, WORST_UNEVENNESS = 6.0, 0.6
"""Ends of the strips [°], [-]."""


class LevellingScene:
    """View from behind, map, readings and two strips.

    Args:
        machine: That is drawn.
        driving: The task of its path.
        channels: Names of what is drawn, those of ``Levelling.render_channels``.
    """

    size = SIZE

    def __init__(self, machine: Machine, driving: Tracked, channels: Sequence[str]):
        self._canvas, self._channels = Canvas(SIZE), channels
        self._parts = (
            ChaseView(self._canvas, (VIEW, SIZE[1]), machine, driving, title="Levelling"),
            Map(self._canvas, (VIEW, SIZE[1] - MAP_HEIGHT, PANEL, MAP_HEIGHT), driving),
            Readings(self._canvas),
            Strips(self._canvas),
        )

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of the channels (frames, channels)."""
        so_far = History(self._channels, history)
        for part in self._parts:
            part.draw(so_far)
        return self._canvas.picture()


class Readings:
    """Tilt, unevenness of the wheels' loads, speed and the signals of the four arms, of now."""

    def __init__(self, canvas: Canvas):
        from matplotlib.patches import Rectangle

        height = SIZE[1] - MAP_HEIGHT - 210
        board = canvas.axes(VIEW, 210, PANEL, height)
        board.set_xlim(0.0, PANEL)
        board.set_ylim(0.0, height)
        board.set_axis_off()

        def reading(x: float, label: str, colour: str) -> Any:
            board.text(x, 112.0, label, fontsize=9, color=SOFT)
            return canvas.moving(board.text(x, 78.0, "", fontsize=18, color=colour, va="baseline"))

        self._tilt = reading(24.0, "tilt", INK)
        self._unevenness = reading(136.0, "unevenness of loads", AMBER)
        self._pace = reading(286.0, "speed", GREEN)
        self._bars = {}
        for index, name in enumerate(ARM_SIGNALS):
            x, y = 24.0 + 186.0 * (index % 2), 38.0 - 24.0 * (index // 2)  # as the wheels stand, the front on top
            board.text(x, y + 5.0, name.removeprefix("arm_"), fontsize=9, color=SOFT, va="center")
            board.add_patch(Rectangle((x + 30.0, y), 120.0, 10.0, facecolor="#e3e8ec"))
            bar = canvas.moving(Rectangle((x + 90.0, y), 0.0, 10.0, facecolor=BLUE))
            board.add_patch(bar)
            board.plot([x + 90.0, x + 90.0], [y - 3.0, y + 13.0], color=INK, linewidth=1.1)
            self._bars[name] = bar

    def draw(self, history: History) -> None:
        """Write what is read now; a bar to the right lifts the frame."""
        now = history.now
        tilt = math.degrees(math.acos(min(math.cos(now["roll"]) * math.cos(now["pitch"]), 1.0)))
        self._tilt.set_text(f"{tilt:.1f}°")
        self._tilt.set_color(RED if tilt > 2.0 else INK)
        self._unevenness.set_text(f"{now['unevenness']:.2f}")
        self._pace.set_text(f"{now['speed']:.2f} m/s".replace("-", "−"))
        for name, bar in self._bars.items():
            bar.set_width(60.0 * now[f"signal_{name}"])


class Strips:
    """Traces of roll, pitch and unevenness over the last seconds."""

    def __init__(self, canvas: Canvas):
        strip = Traces(
            canvas, canvas.axes(VIEW + 46, 122, PANEL - 66, 64), "tilt [°]", WORST_TILT, (-5, 0, 5),
            span=STRIP_SPAN, every=10.0, gap=0.12,
        )  # fmt: skip
        self._roll_line = strip.line("roll", INK)
        self._pitch_line = strip.line("pitch", BLUE)
        strip = Traces(
            canvas, canvas.axes(VIEW + 46, 26, PANEL - 66, 64), "unevenness of loads [-]", (0.0, WORST_UNEVENNESS),
            (0, 0.2, 0.4), span=STRIP_SPAN, every=10.0,
        )  # fmt: skip
        self._unevenness_line = strip.line("", AMBER)

    def draw(self, history: History) -> None:
        """Draw the lines up to now."""
        since = history["time"] - history.now["time"]
        self._roll_line.set_data(since, np.clip(np.degrees(history["roll"]), -WORST_TILT, WORST_TILT))
        self._pitch_line.set_data(since, np.clip(np.degrees(history["pitch"]), -WORST_TILT, WORST_TILT))
        self._unevenness_line.set_data(since, np.clip(history["unevenness"], 0.0, WORST_UNEVENNESS))
