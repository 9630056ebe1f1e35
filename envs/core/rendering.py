"""Pictures of a task from above, without a display, and the window that shows them."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, GRID, INK, RED, SOFT

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from aoro_gym.envs.core.task import Task

RENDER_MODES = ("rgb_array", "human")
SIZE = 720
"""Width and height of a picture [px]."""
SPAN = 6.0
"""Time [s] that the strips of traces show."""

PAPER, GROUND = "#ffffff", "#f1f3ee"
RUBBER, TREAD, STEEL, ROD = "#2c3238", "#59636c", "#5c6873", "#c3cbd2"
FRONT_PAINT, REAR_PAINT, PAINT_EDGE = "#f0b23c", "#e7a52b", "#9a6b12"

Points = NDArray[np.float64]


class Scene(Protocol):
    """Draws one sub-environment."""

    size: tuple[int, int]
    """Width and height of its pictures [px]."""

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of ``history`` (frames, channels), oldest first; rows before the start are NaN."""
        ...


class Renderer:
    """Keeps the traces of all sub-environments, draws them, and shows the first one in a window."""

    def __init__(self, task: Task, num_envs: int, machine: Machine):
        self._scene: Scene = task.scene(machine)
        self._control_step = task.control_step
        frames = round(task.render_span / task.control_step) + 1
        self._history = np.full((frames, len(task.render_channels), num_envs), np.nan, dtype=np.float32)  # a ring
        self._newest = frames - 1
        self._window: Window | None = None

    def traces(self) -> tuple[NDArray[np.float32], int]:
        """What is kept of all sub-environments, for :meth:`take_up`."""
        return self._history, self._newest

    def take_up(self, traces: tuple[NDArray[np.float32], int]) -> None:
        """Go on from the traces of another renderer."""
        self._history, self._newest = traces

    def restart(self, where: NDArray[np.intp], traces: NDArray[np.float32]) -> None:
        """Forget the sub-environments ``where``; ``traces`` (channels, N) are their first."""
        self._history[:, :, where] = np.nan
        self._history[self._newest][:, where] = traces[:, where]

    def record(self, traces: NDArray[np.float32]) -> None:
        """Append the traces (channels, N) of a control step."""
        self._newest = (self._newest + 1) % len(self._history)
        self._history[self._newest] = traces

    def frame(self, index: int) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of a sub-environment."""
        return self._scene.draw(np.roll(self._history[:, :, index], -1 - self._newest, axis=0))

    def show(self) -> None:
        """Draw the first sub-environment into the window, in real time."""
        if self._window is None:
            self._window = Window(self._control_step, self._scene.size)
        if self._window.open:
            self._window.show(self.frame(0))

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()


class Window:
    """A window of matplotlib's interactive backend. Without a display it says so once and draws nothing."""

    def __init__(self, control_step: float, size: tuple[int, int]):
        self._control_step = control_step
        self._next = 0.0
        self._image: Any = None
        self.open = False
        import matplotlib
        from matplotlib import pyplot

        self._pyplot = pyplot
        headless = sys.platform.startswith("linux") and not (
            os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        )
        if not headless:
            try:
                self._figure = pyplot.figure("aoro-gym", figsize=(size[0] / 100, size[1] / 100), dpi=100)
                self.open = matplotlib.get_backend().lower() in {name.lower() for name in _interactive_backends()}
            except ImportError:
                pass
        if not self.open:
            print(
                'aoro-gym: render_mode="human" needs a display and a windowing backend of matplotlib (pip install PyQt6); '
                'nothing is drawn. render_mode="rgb_array" needs neither.',
                file=sys.stderr,
                flush=True,
            )

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Show ``frame`` and wait for its time."""
        if not self._pyplot.fignum_exists(self._figure.number):  # closed by its user
            self.open = False
            return
        if self._image is None:
            axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set_axis_off()
            self._image = axes.imshow(frame)
            self._figure.show()
        self._image.set_data(frame)
        self._figure.canvas.draw_idle()
        self._figure.canvas.flush_events()
        now = time.perf_counter()
        self._next = max(self._next + self._control_step, now)
        time.sleep(max(self._next - now, 0.0))

    def close(self) -> None:
        """Close it."""
        if self.open:
            self._pyplot.close(self._figure)
            self.open = False


def _interactive_backends() -> Sequence[str]:
    from matplotlib.backends.registry import BackendFilter, backend_registry

    return backend_registry.list_builtin(BackendFilter.INTERACTIVE)


# ---- pictures --------------------------------------------------------------------------------------------------------


class Canvas:
    """A picture whose standing parts are drawn once: a frame draws only the artists that :meth:`moving` was told of."""

    def __init__(self, size: tuple[int, int] = (SIZE, SIZE)) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.size = size
        self.figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, facecolor=PAPER)
        self._canvas = FigureCanvasAgg(self.figure)
        self._moving: list[Artist] = []
        self._background: Any = None

    def axes(self, left: float, bottom: float, width: float, height: float) -> Axes:
        """Axes in pixels from the lower left corner."""
        across, up = self.size
        return self.figure.add_axes((left / across, bottom / up, width / across, height / up))

    def moving(self, artist: Any) -> Any:
        """Draw ``artist`` anew in every frame, after those that came before it; returns it."""
        artist.set_animated(True)
        self._moving.append(artist)
        return artist

    def forget(self) -> None:
        """Draw the standing parts anew: they have changed."""
        self._background = None

    def picture(self) -> NDArray[np.uint8]:
        """The frame as it stands, (height, width, 3)."""
        if self._background is None:
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self.figure.bbox)
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            if artist.get_visible():
                artist.draw(self._canvas.get_renderer())
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()


class MachineFromAbove:
    """The machine in the plan, forward up: frames, arms, wheels, the joint and its two cylinders."""

    def __init__(self, canvas: Canvas, axes: Axes, machine: Machine):
        from matplotlib.patches import Circle, Polygon

        frame, arm, tire = machine.frame, machine.arm, machine.tire
        linkage = machine.steering.cylinder.linkage

        def number(value: Any) -> float:
            return float(np.ravel(value)[0])

        self._parts: list[tuple[Any, Points, bool]] = []

        def part(points: ArrayLike, rear: bool, **style: Any) -> None:
            polygon = canvas.moving(Polygon(np.zeros((2, 2)), closed=True, **style))
            axes.add_patch(polygon)
            self._parts.append((polygon, np.asarray(points, dtype=np.float64), rear))

        radius, half_width = number(tire.radius), number(tire.disc_offset_outer) + 0.025
        half_track = 0.5 * number(frame.track)
        for rear, half in ((True, frame.rear), (False, frame.front)):
            sign = -1.0 if rear else 1.0
            axle, length = sign * number(half.axle_distance), number(half.hull_length)
            middle, width = number(half.cog_x), number(half.hull_width)
            for side in (1.0, -1.0):
                pivot = np.array([axle - sign * number(arm.length), side * number(arm.pivot_lateral)])
                hub = np.array([axle, side * (half_track - half_width)])
                part(_bar(pivot, hub, 0.09), rear, facecolor=STEEL, edgecolor="none")
                centre = np.array([axle, side * half_track])
                part(
                    _rounded(centre, 2.0 * radius, 2.0 * half_width, 0.12),
                    rear, facecolor=RUBBER, edgecolor="#15191c", linewidth=0.8,
                )  # fmt: skip
                slant = np.array([0.06, 0.8 * half_width])
                for offset in np.linspace(-0.75, 0.75, 6) * radius:
                    lug = centre + np.array([offset, 0.0])
                    part(_bar(lug - slant, lug + slant, 0.022), rear, facecolor=TREAD)
            inner, outer = middle - 0.5 * sign * length, middle + 0.5 * sign * length
            neck = [[0.0, 0.16], [inner, 0.38 * width], [inner, -0.38 * width], [0.0, -0.16]]
            part(neck, rear, facecolor=STEEL, edgecolor=INK, linewidth=0.8)
            part(
                _chamfered(inner, outer, width, 0.16),
                rear, facecolor=REAR_PAINT if rear else FRONT_PAINT, edgecolor=PAINT_EDGE, linewidth=1.2,
            )  # fmt: skip
            if rear:  # the engine's hood with its grille
                part(_box(middle - 0.15, 0.0, 0.66 * length, 0.64 * width), rear, facecolor="#d2921d", edgecolor="none")
                for along in np.linspace(-0.8, -0.2, 6):
                    part(_box(outer + 0.24 - 0.35 * along, 0.0, 0.035, 0.5 * width), rear, facecolor=PAINT_EDGE)
            else:  # the folded crane
                part(_bar(np.array([inner + 0.45, 0.0]), np.array([outer - 0.2, 0.22]), 0.08), rear, facecolor=STEEL)
                part(_bar(np.array([outer - 0.2, 0.22]), np.array([inner + 0.75, -0.2]), 0.055), rear, facecolor=ROD)

        radii, opening = (number(linkage.a), number(linkage.b)), number(linkage.g0)
        self._cylinders = []
        for side in (1.0, -1.0):
            rear_pin = radii[0] * np.array([-math.sin(0.5 * opening), side * math.cos(0.5 * opening)])
            front_pin = radii[1] * np.array([math.sin(0.5 * opening), side * math.cos(0.5 * opening)])
            rod = canvas.moving(Polygon(np.zeros((2, 2)), facecolor=ROD, edgecolor=INK, linewidth=0.6))
            barrel = canvas.moving(Polygon(np.zeros((2, 2)), facecolor=STEEL, edgecolor=INK, linewidth=0.8))
            axes.add_patch(rod)
            axes.add_patch(barrel)
            self._cylinders.append((rod, barrel, rear_pin, front_pin, 0.62 * number(linkage.dead_length)))
        for size, colour in ((0.17, INK), (0.09, AMBER)):
            axes.add_patch(canvas.moving(Circle((0.0, 0.0), size, facecolor=colour, edgecolor="none")))

        self.reach = number(frame.front.axle_distance) + radius
        front = frame.front
        self._outline = _chamfered(
            number(front.cog_x) - 0.5 * number(front.hull_length),
            number(front.cog_x) + 0.5 * number(front.hull_length),
            number(front.hull_width),
            0.16,
        )

    def pose(self, front_heading: float, rear_heading: float) -> None:
        """Place the parts for the headings [rad] of both frames; the hinge stays in the middle."""
        for polygon, points, rear in self._parts:
            polygon.set_xy(_screen(points, rear_heading if rear else front_heading))
        for rod, barrel, rear_pin, front_pin, length in self._cylinders:
            start, end = _turned(rear_pin, rear_heading), _turned(front_pin, front_heading)
            along = (end - start) / np.linalg.norm(end - start)
            rod.set_xy(_screen(_bar(start, end, 0.032)))
            barrel.set_xy(_screen(_bar(start, start + length * along, 0.062)))

    def front_outline(self, heading: float) -> Points:
        """Outline of the front frame at ``heading`` [rad], in the picture's coordinates (P, 2)."""
        return _screen(self._outline, heading)


class Traces:
    """A strip of lines over the last seconds, the present at its right end.

    Args:
        canvas: Where it stands.
        axes: Its own.
        title: Over it.
        limit: Largest value, or lowest and largest.
        ticks: On the vertical axis.
        span: How far back it reaches [s].
        every: Distance of the ticks of time [s].
        gap: Distance of the lines' names, as a share of the width.
    """

    def __init__(
        self,
        canvas: Canvas,
        axes: Axes,
        title: str,
        limit: float | tuple[float, float],
        ticks: Sequence[float],
        *,
        span: float = SPAN,
        every: float = 1.0,
        gap: float = 0.09,
    ):
        self._canvas, self._axes, self._gap = canvas, axes, gap
        low, high = limit if isinstance(limit, tuple) else (-limit, limit)
        axes.set_xlim(-span, 0.0)
        axes.set_ylim(low, high)
        times = np.arange(-span, 0.5 * every, every)
        axes.set_xticks(times, labels=[f"{t:.0f} s" if t else "now" for t in times])
        axes.set_yticks(list(ticks))
        axes.tick_params(length=0, labelsize=8, labelcolor=SOFT)
        axes.grid(color=GRID, linewidth=0.8)
        axes.axhline(0.0, color=SOFT, linewidth=0.8)
        for spine in axes.spines.values():
            spine.set_visible(False)
        axes.set_title(title, loc="left", fontsize=9, color=INK, pad=4)
        self._labels = 0

    def line(self, label: str, colour: str, **style: Any) -> Any:
        """A line, named in the legend."""
        (line,) = self._axes.plot([], [], color=colour, **{"linewidth": 1.8, "solid_joinstyle": "round", **style})
        self._axes.text(
            1.0 - self._gap * self._labels, 1.03, label, color=colour, fontsize=9, ha="right", va="bottom",
            transform=self._axes.transAxes,
        )  # fmt: skip
        self._labels += 1
        return self._canvas.moving(line)


class TurningScene:
    """The turning task: the machine with its target, readings beside it, and two strips of traces below."""

    def __init__(self, machine: Machine, *, tolerance: float):
        self._canvas = Canvas()
        self.size = self._canvas.size
        self._tolerance = tolerance
        self._limit = float(np.max(machine.joint.range))
        self._make_plan(machine)
        self._make_readings(machine)
        self._make_strips()

    def _make_plan(self, machine: Machine) -> None:
        from matplotlib.patches import Polygon, Wedge

        canvas = self._canvas
        view = canvas.axes(0, 250, 450, 470)
        view.set_facecolor(GROUND)
        scale = 70.0  # px/m
        view.set_xlim(-225 / scale, 225 / scale)
        view.set_ylim(-235 / scale, 235 / scale)
        view.set_xticks([])
        view.set_yticks([])
        for spine in view.spines.values():
            spine.set_visible(False)
        (self._ground,) = view.plot([], [], "+", color="#cfd6c9", markersize=7, markeredgewidth=1.0)
        canvas.moving(self._ground)
        self._reach = canvas.moving(Wedge((0.0, 0.0), 3.0, 0.0, 1.0, width=0.06, facecolor="#d9dee2", edgecolor="none"))
        view.add_patch(self._reach)
        self._swept = canvas.moving(Wedge((0.0, 0.0), 3.0, 0.0, 1.0, width=0.06, facecolor=BLUE, alpha=0.45))
        view.add_patch(self._swept)
        self._ghost = canvas.moving(
            Polygon(np.zeros((2, 2)), facecolor="#1f77b41c", edgecolor=BLUE, linewidth=1.4, linestyle=(0, (4, 3)))
        )
        self._machine = MachineFromAbove(canvas, view, machine)
        view.add_patch(self._ghost)
        (self._aim,) = view.plot([], [], color=BLUE, linewidth=1.6, linestyle=(0, (4, 3)))
        (self._axis,) = view.plot([], [], color=INK, linewidth=1.6)
        self._flag = canvas.moving(Polygon(np.zeros((3, 2)), facecolor=BLUE, edgecolor="none"))
        self._needle = canvas.moving(Polygon(np.zeros((3, 2)), facecolor=INK, edgecolor="none"))
        canvas.moving(self._aim)
        canvas.moving(self._axis)
        view.add_patch(self._flag)
        view.add_patch(self._needle)
        view.text(
            -3.1, -3.25, f"from above; crosses 1 m apart; joint stops at ±{math.degrees(self._limit):.0f}°",
            fontsize=7.5, color=SOFT,
        )  # fmt: skip

    def _make_readings(self, machine: Machine) -> None:
        from matplotlib.patches import Rectangle

        canvas, valve = self._canvas, machine.steering.valve
        panel = canvas.axes(450, 250, 270, 470)
        panel.set_xlim(0.0, 270.0)
        panel.set_ylim(0.0, 470.0)
        panel.set_axis_off()

        def label(y: float, text: str) -> None:
            panel.text(24.0, y, text, fontsize=9, color=SOFT)

        def value(y: float, size: float, colour: str, x: float = 24.0, **style: Any) -> Any:
            return canvas.moving(panel.text(x, y, "", fontsize=size, color=colour, va="baseline", **style))

        panel.text(24.0, 434.0, "AORO", fontsize=15, color=INK, fontweight="bold")
        panel.text(95.0, 434.0, "Turning", fontsize=15, color=SOFT)
        self._clock = value(434.0, 13, INK, 250.0, ha="right")
        label(384.0, "joint angle")
        self._angle = value(346.0, 27, INK)
        label(304.0, "target")
        self._target = value(272.0, 21, BLUE)
        self._state = value(272.0, 11, GREEN, 250.0, ha="right")
        label(230.0, "valve signal")
        self._signal = value(230.0, 9.5, INK, 250.0, ha="right", fontweight="bold")
        self._middle, self._half, bar = 137.0, 113.0, 194.0
        panel.add_patch(Rectangle((self._middle - self._half, bar), 2 * self._half, 22.0, facecolor=GRID))
        for side, dead_band in ((-1.0, valve.dead_band_left), (1.0, valve.dead_band_right)):
            width = side * self._half * float(np.ravel(dead_band)[0]) / 2.0
            panel.add_patch(Rectangle((self._middle, bar), width, 22.0, facecolor="#cbd3da"))
        self._bar = canvas.moving(Rectangle((self._middle, bar), 0.0, 22.0, facecolor=AMBER))
        panel.add_patch(self._bar)
        panel.plot([self._middle] * 2, [bar - 4.0, bar + 26.0], color=INK, linewidth=1.2)
        for x, text, side in ((24.0, "left", "left"), (self._middle, "dead band", "center"), (250.0, "right", "right")):
            panel.text(x, bar - 17.0, text, fontsize=8, color=SOFT, ha=side)
        label(134.0, "joint flow")
        self._flow = value(102.0, 21, GREEN)
        self._peak = value(102.0, 9, SOFT, 250.0, ha="right")
        label(58.0, "targets")
        self._judged = value(30.0, 12.5, INK)

    def _make_strips(self) -> None:
        canvas, degrees = self._canvas, math.degrees(self._limit)
        strip = Traces(canvas, canvas.axes(46, 142, 650, 78), "joint angle [deg]", 1.1 * degrees, (-30, 0, 30))
        self._target_line = strip.line("target", BLUE, linestyle=(0, (4, 2)), linewidth=1.4)
        self._angle_line = strip.line("angle", INK)
        strip = Traces(canvas, canvas.axes(46, 26, 650, 78), "flow [L/min], signal [%]", 115.0, (-100, 0, 100))
        self._signal_line = strip.line("signal", AMBER, linewidth=1.4, drawstyle="steps-pre")
        self._flow_line = strip.line("flow", GREEN)

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture of the channels of ``Turning.render_channels``, (frames, channels)."""
        clock, x, y, yaw, angle, target, signal, flow, settled, missed = (float(v) for v in history[-1])
        rear = yaw - angle
        aim = rear + target
        on_target = abs(target - angle) <= self._tolerance
        colour = GREEN if on_target else BLUE

        self._machine.pose(yaw, rear)
        side = np.arange(-4.0, 5.0)
        crosses = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2) - np.array([x % 1.0, y % 1.0])
        self._ground.set_data(*_screen(crosses).T)
        # angles in the picture: the heading, counter-clockwise from the right
        self._reach.set_theta1(90.0 + math.degrees(rear - self._limit))
        self._reach.set_theta2(90.0 + math.degrees(rear + self._limit))
        self._swept.set_theta1(90.0 + math.degrees(min(yaw, aim)))
        self._swept.set_theta2(90.0 + math.degrees(max(yaw, aim)))
        self._ghost.set_xy(self._machine.front_outline(aim))
        for line, heading in ((self._aim, aim), (self._axis, yaw)):
            line.set_data(*_screen(np.array([[2.3, 0.0], [2.94, 0.0]]), heading).T)
        self._flag.set_xy(_screen(np.array([[3.02, 0.0], [3.24, 0.1], [3.24, -0.1]]), aim))
        self._needle.set_xy(_screen(np.array([[2.94, 0.0], [2.74, 0.09], [2.74, -0.09]]), yaw))
        for artist in (self._flag, self._swept):
            artist.set_facecolor(colour)
        self._ghost.set_edgecolor(colour)
        self._aim.set_color(colour)

        self._clock.set_text(f"{clock:.2f} s")
        self._angle.set_text(_signed(math.degrees(angle), "°", 1))
        self._target.set_text(_signed(math.degrees(target), "°", 1))
        self._target.set_color(colour)
        self._state.set_text("on target" if on_target else _sided(math.degrees(target - angle), "°", 1))
        self._state.set_color(colour)
        self._signal.set_text(_sided(100.0 * signal, " %"))
        self._bar.set_width(-self._half * signal)  # left is left
        self._flow.set_text(f"{abs(6e4 * flow):.0f} L/min")
        since = (history[:, 0] - clock).astype(np.float64)
        self._peak.set_text(f"{SPAN:.0f} s peak {6e4 * np.nanmax(np.abs(history[:, 7])):.0f}")
        self._judged.set_text(f"{settled:.0f} settled" + (f", {missed:.0f} missed" if missed else ""))
        self._judged.set_color(RED if missed else INK)

        for line, values in (
            (self._target_line, np.degrees(history[:, 5])),
            (self._angle_line, np.degrees(history[:, 4])),
            (self._signal_line, 100.0 * history[:, 6]),
            (self._flow_line, 6e4 * history[:, 7]),
        ):
            line.set_data(since, values)
        return self._canvas.picture()


def _signed(value: float, unit: str, digits: int) -> str:
    return f"{value:+.{digits}f}{unit}".replace("-", "−")


def _sided(value: float, unit: str, digits: int = 0) -> str:
    text = f"{abs(value):.{digits}f}"
    side = "" if float(text) == 0.0 else " left" if value > 0.0 else " right"
    return f"{text}{unit}{side}"


# ---- shapes in a frame's axes: forward, left -------------------------------------------------------------------------


def _turned(points: Points, heading: float) -> Points:
    c, s = math.cos(heading), math.sin(heading)
    return points @ np.array([[c, s], [-s, c]])


def _screen(points: Points, heading: float = 0.0) -> Points:
    """Points (P, 2) forward, left of a frame at ``heading`` [rad] → right, up in the picture."""
    turned = _turned(points, heading) if heading else points
    return np.stack([-turned[:, 1], turned[:, 0]], axis=1)


def _bar(start: Points, end: Points, half_width: float) -> Points:
    along = np.asarray(end, dtype=np.float64) - start
    across = half_width * np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return np.array([start + across, end + across, end - across, start - across])


def _box(x: float, y: float, length: float, width: float) -> Points:
    return np.array([x, y]) + 0.5 * np.array([[length, width], [length, -width], [-length, -width], [-length, width]])


def _rounded(centre: Points, length: float, width: float, radius: float) -> Points:
    corner = np.linspace(0.0, 0.5 * math.pi, 5)
    points = []
    for quarter, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        middle = np.array([sx * (0.5 * length - radius), sy * (0.5 * width - radius)])
        angle = corner + 0.5 * math.pi * quarter
        points.append(middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return centre + np.concatenate(points)


def _chamfered(inner: float, outer: float, width: float, cut: float) -> Points:
    step = math.copysign(cut, outer - inner)
    half = 0.5 * width
    return np.array(
        [
            [inner, half - cut], [inner + step, half], [outer - step, half], [outer, half - cut],
            [outer, cut - half], [outer - step, -half], [inner + step, -half], [inner, cut - half],
        ]
    )  # fmt: skip
