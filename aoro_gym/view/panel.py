"""The panel beside the scene: time, driving, gauges and a chart."""

from __future__ import annotations

import html
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from aoro_gym.recording.commands import JOINTS, WHEELS
from aoro_gym.units import BAR, DEGREE, RPM

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
"""Simulated seconds a second to choose from."""
GEARS = ("1", "2", "3")
NOTCH = 0.1
"""Change of a signal by a key."""
SPAN, CHART_POINTS = 20.0, 200
"""Simulated time [s] of the chart, and its points."""
GAUGES: tuple[tuple[str, str, float, str, float, float], ...] = (
    # label, channel, SI value of the unit, unit, lowest and highest
    ("port A", "pressure_a", BAR, "bar", 0.0, 250.0),
    ("port B", "pressure_b", BAR, "bar", 0.0, 250.0),
    ("pump 2", "pump_pressure", BAR, "bar", 0.0, 250.0),
    ("drive forward", "drive_pressure_forward", BAR, "bar", 0.0, 450.0),
    ("drive return", "drive_pressure_return", BAR, "bar", 0.0, 450.0),
    ("joint angle", "joint_angle", DEGREE, "°", -40.0, 40.0),
    *((f"arm {wheel}", f"arm_angle_{wheel}", DEGREE, "°", -30.0, 30.0) for wheel in WHEELS),
    *((f"load {wheel}", f"wheel_load_{wheel}", 1e3, "kN", 0.0, 60.0) for wheel in WHEELS),
    ("engine", "engine_speed", RPM, "rpm", 0.0, 2500.0),
    ("speed", "speed", 1.0, "m/s", -3.0, 3.0),
    ("left of path", "cross_track", 0.01, "cm", -50.0, 50.0),
    ("roll", "roll", DEGREE, "°", -30.0, 30.0),
    ("pitch", "pitch", DEGREE, "°", -30.0, 30.0),
    ("slew", "crane_joint_slew", DEGREE, "°", -200.0, 200.0),
    ("lift", "crane_joint_lift", DEGREE, "°", -30.0, 80.0),
    ("fold", "crane_joint_fold", DEGREE, "°", -150.0, 0.0),
    ("telescope", "crane_joint_telescope", 1.0, "m", 0.0, 1.7),
    ("load cell", "crane_tip_load", 1e3, "kN", 0.0, 40.0),
)
CHART = (
    ("port A", "pressure_a", "#c8423b"), ("port B", "pressure_b", "#1f77b4"), ("pump 2", "pump_pressure", "#2a9d6f"),
    ("drive forward", "drive_pressure_forward", "#e0962b"),
)  # fmt: skip
"""Pressures over time: label, channel, colour."""


class TimeControls:
    """Pause, single step, speed and restart.

    Args:
        gui: Of a server of viser.
        restart: Called to begin again.
    """

    def __init__(self, gui: Any, restart: Callable[[], None]):
        self.steps = 0
        """Single steps that were asked for and not yet done."""
        with gui.add_folder("Time"):
            self._pause = gui.add_checkbox("pause", False, hint="space")
            self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1", hint="simulated seconds a second")
            step, again = gui.add_button("step 0.03 s", hint="N"), gui.add_button("restart", hint="Backspace")
            self._shown = gui.add_markdown("")
        step.on_click(lambda _: self.step())
        again.on_click(lambda _: restart())
        gui.add_command("Pause or go on", hotkey="space").on_trigger(lambda _: self.toggle())
        gui.add_command("Single step", hotkey="N").on_trigger(lambda _: self.step())
        gui.add_command("Restart", hotkey="backspace").on_trigger(lambda _: restart())

    def toggle(self) -> None:
        """Pause, or go on."""
        self._pause.value = not self._pause.value

    def step(self) -> None:
        """Pause and ask for one step."""
        self._pause.value = True
        self.steps += 1

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        return bool(self._pause.value)

    @property
    def speed(self) -> float:
        """Simulated seconds a second that are asked for."""
        return float(self._speed.value)

    def show(self, time: float, reached: float, note: str = "") -> None:
        """Tell the simulated ``time`` [s] and the speed that is ``reached``."""
        self._shown.content = f"t = **{time:.2f} s**, {reached:.2f} × real time{note}"


class Timeline:
    """Slider of a replay's time.

    Args:
        gui: Of a server of viser.
        duration: [s]
        seek: Called with the time [s] that a person moves it to.
    """

    def __init__(self, gui: Any, duration: float, seek: Callable[[float], None]):
        self._slider = gui.add_slider("time [s]", min=0.0, max=max(duration, 0.01), step=0.01, initial_value=0.0)
        # what the program sets comes without a client
        self._slider.on_update(lambda event: seek(float(self._slider.value)) if event.client is not None else None)

    def show(self, time: float) -> None:
        """Move the slider to ``time`` [s]."""
        self._slider.value = round(time, 2)


class Driving:
    """Sliders and keys of the commands.

    Args:
        gui: Of a server of viser.
        driver: What a controller in the place of the person is called; None: there is none.
        crane: Whether there is a crane to move.
    """

    def __init__(self, gui: Any, driver: str | None = None, *, crane: bool = False):
        signal = {"min": -1.0, "max": 1.0, "step": 0.01, "initial_value": 0.0}
        with gui.add_folder("Drive"):
            self.driver = None if driver is None else gui.add_checkbox(f"driven by {driver}", True)
            self._sliders = {
                "drive_signal": gui.add_slider("drive", **signal, hint="W and S, X: stop"),
                "steering_signal": gui.add_slider("steer (right -, left +)", **signal, hint="A and D, C: middle"),
            }
            self._gear = gui.add_dropdown("gear", GEARS, initial_value=GEARS[0])
            self._brake = gui.add_checkbox("parking brake", False)
        with gui.add_folder("Arms and traction", expand_by_default=False):
            for wheel in WHEELS:
                self._sliders[f"arm_{wheel}"] = gui.add_slider(f"arm {wheel}", **signal)
            for wheel in WHEELS:
                share = {"min": 0.0, "max": 1.0, "step": 0.01, "initial_value": 1.0}
                self._sliders[f"traction_{wheel}"] = gui.add_slider(f"traction {wheel}", **share)
        if crane:
            with gui.add_folder("Crane"):
                for joint, way in zip(JOINTS, ("left +", "up +", "out +", "out +"), strict=True):
                    self._sliders[f"crane_{joint}"] = gui.add_slider(f"{joint} ({way})", **signal)
        for label, key, name, change in (
            ("Faster forward", "W", "drive_signal", NOTCH), ("Slower, backward", "S", "drive_signal", -NOTCH),
            ("Stop", "X", "drive_signal", None), ("Steer left", "A", "steering_signal", NOTCH),
            ("Steer right", "D", "steering_signal", -NOTCH), ("Steer straight", "C", "steering_signal", None),
        ):  # fmt: skip
            gui.add_command(label, hotkey=key).on_trigger(lambda _, n=name, c=change: self.nudge(n, c))

    def nudge(self, name: str, change: float | None) -> None:
        """Move a signal by ``change``, or to the middle."""
        slider = self._sliders[name]
        slider.value = 0.0 if change is None else round(min(max(slider.value + change, -1.0), 1.0), 2)

    def put(self, name: str, value: float) -> None:
        """Move a signal to ``value``."""
        self._sliders[name].value = value

    def shift(self, gears: int) -> None:
        """So many gears up, or down."""
        number = GEARS.index(self._gear.value) + gears
        self._gear.value = GEARS[min(max(number, 0), len(GEARS) - 1)]

    def toggle_brake(self) -> None:
        """Parking brake on, or off."""
        self._brake.value = not self._brake.value

    @property
    def commands(self) -> dict[str, float]:
        """All commands by name."""
        signals = {name: float(slider.value) for name, slider in self._sliders.items()}
        return {**signals, "gear": float(self._gear.value), "parking_brake": float(self._brake.value)}

    def rest(self) -> None:
        """Sliders to where the machine stands still."""
        for name, slider in self._sliders.items():
            slider.value = 1.0 if name.startswith("traction") else 0.0


def gauges(readings: Mapping[str, float], title: str = "") -> str:
    """HTML of bars for the channels that there are, SI."""
    rows = []
    for label, channel, size, unit, low, high in GAUGES:
        value = readings.get(channel, math.nan) / size
        if not math.isfinite(value):
            continue
        zero = (max(low, 0.0) - low) / (high - low)
        share = min(max((value - low) / (high - low), 0.0), 1.0)
        left, width = 100.0 * min(zero, share), 100.0 * abs(share - zero)
        rows.append(
            f'<tr><td style="white-space:nowrap">{label}</td><td style="width:50%;background:#e3e8ec">'
            f'<div style="margin-left:{left:.1f}%;width:{width:.1f}%;height:9px;background:#1f77b4"></div></td>'
            f'<td style="text-align:right;white-space:nowrap">{value:.{0 if high >= 100.0 else 1}f} {unit}</td></tr>'
        )
    head = f"<b>{html.escape(title)}</b>" if title else ""
    return f'{head}<table style="width:94%;margin:0 3%;font-size:11px;border-spacing:4px 1px">{"".join(rows)}</table>'


class Gauges:
    """Bars of each machine's readings, and a chart of the first one's pressures."""

    def __init__(self, gui: Any, names: Sequence[str]):
        from viser import uplot

        self._names = names if len(names) > 1 else [""]
        self._rows: deque[list[float]] = deque(maxlen=CHART_POINTS)
        with gui.add_folder("Gauges"):
            self._bars = [gui.add_html("") for _ in self._names]
        with gui.add_folder("Pressures [bar]"):
            empty = np.zeros(1)
            self._chart = gui.add_uplot(
                (empty, *(empty for _ in CHART)),
                (uplot.Series(label="t"), *(uplot.Series(label=n, stroke=c, width=2) for n, _, c in CHART)),
                scales={"x": uplot.Scale(time=False), "y": uplot.Scale(auto=True)},
                height=170,
            )

    def show(self, time: float, readings: Sequence[Mapping[str, float]]) -> None:
        """Draw the readings of all machines at ``time`` [s]."""
        for bar, name, one in zip(self._bars, self._names, readings, strict=True):
            bar.content = gauges(one, name)
        if self._rows and not self._rows[-1][0] <= time <= self._rows[-1][0] + SPAN:
            self._rows.clear()
        if not self._rows or time - self._rows[-1][0] >= 0.9 * SPAN / CHART_POINTS:
            self._rows.append([time, *(readings[0].get(channel, math.nan) / BAR for _, channel, _ in CHART)])
            if len(self._rows) > 1:
                self._chart.data = tuple(np.array(self._rows).T.copy())
