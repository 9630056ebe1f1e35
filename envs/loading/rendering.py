"""Pictures of loading: the machine from above, the crane in the plane of its booms, readings and two strips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.rendering import Canvas, Traces
from aoro_gym.envs.loading.config import SIGNALS
from aoro_gym.machine import Machine
from aoro_gym.machine.vehicle_crane import VehicleCrane
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, RED, SOFT
from aoro_gym.twin.frame_cranes import GRAPPLE_DROP

SIZE = (960, 600)
"""[px]"""
PLAN, SIDE = (-5.2, 5.2, -6.2, 6.2), (-0.6, 8.2, -0.4, 5.6)
"""What the views show [m]: x and y about the hinge; distance from the slewing axis, and height."""
SPAN = 20.0
"""Of the strips [s]."""
WOOD = "#8a5a2b"
STEEL = "#d9dee2"


class LoadingScene:
    """View from above, view of the booms' plane, readings and strips.

    Args:
        machine: That is drawn.
        vehicle: Its crane.
        channels: Names of what is drawn, those of ``Loading.render_channels``.
    """

    size = SIZE

    def __init__(self, machine: Machine, vehicle: VehicleCrane, channels: Sequence[str]):
        canvas = self._canvas = Canvas(SIZE)
        self._channels = channels
        self._parts = (Plan(canvas, machine, vehicle), Booms(canvas, vehicle), Readings(canvas), Strips(canvas))

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of the channels (frames, channels)."""
        values = dict(zip(self._channels, history.T.astype(float), strict=True))
        for part in self._parts:
            part.draw(values)
        return self._canvas.picture()


def _now(values: Mapping[str, NDArray[np.float64]], name: str) -> float:
    return float(values[name][-1])


def _joints(values: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.array([_now(values, name) for name in ("slew", "lift", "fold", "telescope")])


def chain(vehicle: VehicleCrane, joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pins of the crane (4, 2): foot, lift, fold and tip, as distance from the slewing axis and height over the foot [m]."""
    crane = vehicle.crane
    _, lift, fold, out = joints
    pins = [(0.0, 0.0), (float(crane.lift.offset), float(crane.lift.height))]
    for length, angle in ((crane.boom.length, lift), (crane.stick.length + out, lift + fold)):
        x, z = pins[-1]
        pins.append((x + float(length) * math.cos(angle), z + float(length) * math.sin(angle)))
    return np.array(pins)


class Plan:
    """The machine from above, its nose to the right."""

    def __init__(self, canvas: Canvas, machine: Machine, vehicle: VehicleCrane):
        from matplotlib.patches import Polygon, Rectangle

        self._vehicle = vehicle
        axes = self._axes = canvas.axes(0, 0, 500, SIZE[1])
        axes.set_xlim(PLAN[0], PLAN[1])
        axes.set_ylim(PLAN[2], PLAN[3])
        axes.set_axis_off()
        axes.set_facecolor("#f4f1ea")
        axes.add_patch(Rectangle((PLAN[0], PLAN[2]), 10.4, 12.4, facecolor="#eef1ea", zorder=0))
        frame, load = machine.frame, machine.payload
        for half in (frame.front, frame.rear):
            x, length, width = (float(np.mean(one)) for one in (half.cog_x, half.hull_length, half.hull_width))
            axes.add_patch(Rectangle((x - 0.5 * length, -0.5 * width), length, width, facecolor=STEEL, edgecolor=SOFT))
        track = float(np.mean(frame.track))
        for x in (float(np.mean(frame.front.axle_distance)), -float(np.mean(frame.rear.axle_distance))):
            for y in (0.5 * track, -0.5 * track):
                axes.add_patch(Rectangle((x - 0.6, y - 0.26), 1.2, 0.52, facecolor="#5b636a"))
        wide, far = float(np.mean(load.bunk_width)), float(np.mean(load.distance))
        axes.add_patch(Rectangle((-far - 1.4, -0.5 * wide), 2.8, wide, fill=False, edgecolor=AMBER, linewidth=2.0))
        axes.text(-far, 0.5 * track + 0.35, "bunk", ha="center", fontsize=9, color=AMBER)
        axes.text(PLAN[0] + 0.3, PLAN[3] - 0.5, "Loading", fontsize=15, color=INK)
        self._log = canvas.moving(Polygon(np.zeros((4, 2)), closed=True, facecolor=WOOD, edgecolor=INK, linewidth=0.6))
        axes.add_patch(self._log)
        self._crane = canvas.moving(axes.plot([], [], color=BLUE, linewidth=5, solid_capstyle="round")[0])
        self._stick = canvas.moving(axes.plot([], [], color=GREEN, linewidth=4, solid_capstyle="round")[0])
        self._grapple = canvas.moving(axes.plot([], [], color=RED, linewidth=3)[0])

    def draw(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Log and crane as they are now."""
        joints = _joints(values)
        pins, foot = chain(self._vehicle, joints), float(np.asarray(self._vehicle.mount.foot.distance))
        way = np.array([math.cos(joints[0]), math.sin(joints[0])])
        places = np.array([foot, 0.0]) + pins[:, :1] * way
        self._crane.set_data(*places[:3].T)
        self._stick.set_data(*places[2:].T)
        yaw = joints[0] + _now(values, "rotator")
        wide = 0.35 if _now(values, "closed") else 0.6
        across = np.array([-math.sin(yaw), math.cos(yaw)]) * wide
        self._grapple.set_data(*np.stack([places[3] - across, places[3] + across]).T)
        middle = np.array([_now(values, "log_x"), _now(values, "log_y")])
        yaw, length, diameter = (_now(values, f"log_{name}") for name in ("yaw", "length", "diameter"))
        along, side = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
        half = 0.5 * length * along, 0.5 * diameter * side
        self._log.set_xy(
            np.array([middle + a * half[0] + b * half[1] for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
        )


class Booms:
    """The plane of the booms, from the side."""

    def __init__(self, canvas: Canvas, vehicle: VehicleCrane):
        from matplotlib.patches import Circle

        self._vehicle = vehicle
        axes = canvas.axes(510, 322, 430, 262)
        axes.set_xlim(SIDE[0], SIDE[1])
        axes.set_ylim(SIDE[2], SIDE[3])
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.plot(SIDE[:2], (0.0, 0.0), color=SOFT, linewidth=1.0)
        axes.text(SIDE[1], 0.08, "plane of the booms", ha="right", fontsize=9, color=SOFT)
        self._boom = canvas.moving(axes.plot([], [], color=BLUE, linewidth=5, solid_capstyle="round")[0])
        self._stick = canvas.moving(axes.plot([], [], color=GREEN, linewidth=4, solid_capstyle="round")[0])
        self._grapple = canvas.moving(axes.plot([], [], color=RED, linewidth=2)[0])
        self._log = canvas.moving(axes.add_patch(Circle((0.0, 0.0), 0.15, facecolor=WOOD, edgecolor=INK)))

    def draw(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Booms, grapple as it would swing, and the log."""
        joints = _joints(values)
        pins = chain(self._vehicle, joints) + np.array([0.0, float(np.asarray(self._vehicle.mount.foot.height))])
        self._boom.set_data(*pins[:3].T)
        self._stick.set_data(*pins[2:].T)
        hangs = pins[3] - [0.0, GRAPPLE_DROP]
        self._grapple.set_data(*np.stack([pins[3], hangs]).T)
        foot = float(np.asarray(self._vehicle.mount.foot.distance))
        way = _now(values, "log_x") - foot, _now(values, "log_y")
        along = way[0] * math.cos(joints[0]) + way[1] * math.sin(joints[0])
        aside = way[1] * math.cos(joints[0]) - way[0] * math.sin(joints[0])
        self._log.set_center((along, _now(values, "log_z")))
        self._log.set_radius(0.5 * max(_now(values, "log_diameter"), 0.05))
        self._log.set_visible(abs(aside) < 1.5)


class Readings:
    """Power, load, swing and the signals, of now."""

    def __init__(self, canvas: Canvas):
        from matplotlib.patches import Rectangle

        board = canvas.axes(520, 196, 420, 122)
        board.set_xlim(0.0, 420.0)
        board.set_ylim(0.0, 122.0)
        board.set_axis_off()

        def reading(x: float, label: str, colour: str) -> Any:
            board.text(x, 106.0, label, fontsize=9, color=SOFT)
            return canvas.moving(board.text(x, 78.0, "", fontsize=16, color=colour, va="baseline"))

        self._load = reading(6.0, "load at the tip", INK)
        self._power = reading(120.0, "pump", AMBER)
        self._swing = reading(220.0, "swing", BLUE)
        self._left = reading(320.0, "way left", GREEN)
        self._bars = {}
        for index, name in enumerate(SIGNALS):
            x, y = 6.0 + 208.0 * (index % 2), 50.0 - 20.0 * (index // 2)
            board.text(x, y + 5.0, name.removeprefix("crane_"), fontsize=9, color=SOFT, va="center")
            board.add_patch(Rectangle((x + 74.0, y), 120.0, 10.0, facecolor="#e3e8ec"))
            bar = canvas.moving(Rectangle((x + 134.0, y), 0.0, 10.0, facecolor=BLUE))
            board.add_patch(bar)
            self._bars[name] = bar

    def draw(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Write what is read now."""
        self._load.set_text(f"{_now(values, 'load') / 1e3:.1f} kN")
        self._power.set_text(f"{_now(values, 'power') / 1e3:.0f} kW")
        swing = math.degrees(_now(values, "sway"))
        self._swing.set_text(f"{swing:.0f}°")
        self._swing.set_color(RED if swing > 20.0 else BLUE)
        self._left.set_text(f"{_now(values, 'remaining'):.1f} m")
        for name, bar in self._bars.items():
            bar.set_width(60.0 * _now(values, f"signal_{name}"))


class Strips:
    """Swing and power over the last seconds."""

    def __init__(self, canvas: Canvas):
        strip = Traces(
            canvas, canvas.axes(560, 116, 380, 52), "swing [°]", (0.0, 40.0), (0, 20, 40), span=SPAN, every=5.0
        )
        self._swing = strip.line("", BLUE)
        strip = Traces(
            canvas,
            canvas.axes(560, 26, 380, 52),
            "power of the pump [kW]",
            (0.0, 60.0),
            (0, 30, 60),
            span=SPAN,
            every=5.0,
        )
        self._power = strip.line("", AMBER)

    def draw(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Draw the lines up to now."""
        since = values["time"] - values["time"][-1]
        self._swing.set_data(since, np.clip(np.degrees(values["sway"]), 0.0, 40.0))
        self._power.set_data(since, np.clip(values["power"] / 1e3, 0.0, 60.0))
