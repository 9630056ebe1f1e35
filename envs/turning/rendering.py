"""Pictures of turning from above, without a display."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.envs.core.rendering import Canvas, Traces
from aoro_gym.machine import Machine
from aoro_gym.machine.solids import first_value
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, GRID, INK, RED, SOFT
from aoro_gym.units import LITRE_PER_MINUTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE = 720
"""Width and height of a picture [px]."""
SPAN = 6.0
"""Time [s] that the strips of traces show."""

GROUND = "#f1f3ee"
RUBBER, TREAD, STEEL, ROD = "#2c3238", "#59636c", "#5c6873", "#c3cbd2"
FRONT_PAINT, REAR_PAINT, PAINT_EDGE = "#f0b23c", "#e7a52b", "#9a6b12"

Points = NDArray[np.float64]


class MachineFromAbove:
    """The machine in the plan, forward up: frames, arms, wheels, the joint and its two cylinders."""

    def __init__(self, canvas: Canvas, axes: Axes, machine: Machine):
        from matplotlib.patches import Circle, Polygon

        frame, arm, tire = machine.frame, machine.arm, machine.tire
        linkage = machine.steering.cylinder.linkage

        self._parts: list[tuple[Any, Points, bool]] = []

        def part(points: ArrayLike, rear: bool, **style: Any) -> None:
            polygon = canvas.moving(Polygon(np.zeros((2, 2)), closed=True, **style))
            axes.add_patch(polygon)
            self._parts.append((polygon, np.asarray(points, dtype=np.float64), rear))

        radius, half_width = first_value(tire.radius), first_value(tire.disc_offset_outer) + 0.025
        half_track = 0.5 * first_value(frame.track)
        for rear, half in ((True, frame.rear), (False, frame.front)):
            sign = -1.0 if rear else 1.0
            axle, length = sign * first_value(half.axle_distance), first_value(half.hull_length)
            middle, width = first_value(half.cog_x), first_value(half.hull_width)
            for side in (1.0, -1.0):
                pivot = np.array([axle - sign * first_value(arm.length), side * first_value(arm.pivot_lateral)])
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

        radii, opening = (first_value(linkage.a), first_value(linkage.b)), first_value(linkage.g0)
        self._cylinders = []
        for side in (1.0, -1.0):
            rear_pin = radii[0] * np.array([-math.sin(0.5 * opening), side * math.cos(0.5 * opening)])
            front_pin = radii[1] * np.array([math.sin(0.5 * opening), side * math.cos(0.5 * opening)])
            rod = canvas.moving(Polygon(np.zeros((2, 2)), facecolor=ROD, edgecolor=INK, linewidth=0.6))
            barrel = canvas.moving(Polygon(np.zeros((2, 2)), facecolor=STEEL, edgecolor=INK, linewidth=0.8))
            axes.add_patch(rod)
            axes.add_patch(barrel)
            self._cylinders.append((rod, barrel, rear_pin, front_pin, 0.62 * first_value(linkage.dead_length)))
        for size, colour in ((0.17, INK), (0.09, AMBER)):
            axes.add_patch(canvas.moving(Circle((0.0, 0.0), size, facecolor=colour, edgecolor="none")))

        self.reach = first_value(frame.front.axle_distance) + radius
        front = frame.front
        self._outline = _chamfered(
            first_value(front.cog_x) - 0.5 * first_value(front.hull_length),
            first_value(front.cog_x) + 0.5 * first_value(front.hull_length),
            first_value(front.hull_width),
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


class TurningScene:
    """The turning task: the machine with its target, readings beside it, and two strips of traces below."""

    def __init__(self, machine: Machine, *, tolerance: float):
        self._canvas = Canvas((SIZE, SIZE))
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
            width = side * self._half * first_value(dead_band) / 2.0
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
        strip = Traces(
            canvas, canvas.axes(46, 142, 650, 78), "joint angle [deg]", 1.1 * degrees, (-30, 0, 30), span=SPAN
        )
        self._target_line = strip.line("target", BLUE, linestyle=(0, (4, 2)), linewidth=1.4)
        self._angle_line = strip.line("angle", INK)
        strip = Traces(
            canvas, canvas.axes(46, 26, 650, 78), "flow [L/min], signal [%]", 115.0, (-100, 0, 100), span=SPAN
        )
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
        self._flow.set_text(f"{abs(flow) / LITRE_PER_MINUTE:.0f} L/min")
        since = (history[:, 0] - clock).astype(np.float64)
        self._peak.set_text(f"{SPAN:.0f} s peak {np.nanmax(np.abs(history[:, 7])) / LITRE_PER_MINUTE:.0f}")
        self._judged.set_text(f"{settled:.0f} settled" + (f", {missed:.0f} missed" if missed else ""))
        self._judged.set_color(RED if missed else INK)

        for line, values in (
            (self._target_line, np.degrees(history[:, 5])),
            (self._angle_line, np.degrees(history[:, 4])),
            (self._signal_line, 100.0 * history[:, 6]),
            (self._flow_line, history[:, 7] / LITRE_PER_MINUTE),
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
