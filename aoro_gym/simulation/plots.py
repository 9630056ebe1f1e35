"""Plots of a recording: one PNG, and an interactive one for a page.

Both are drawn from the same panels, so that a quantity has one name, one unit and one colour everywhere.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from aoro_gym.execution.files import written_whole
from aoro_gym.recording.commands import JOINTS
from aoro_gym.reporting.page import Passage, block, interactive_plot, joined, tiles, write_page
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, PLOT_STYLE, RED, SHADE, SOFT
from aoro_gym.simulation.key_figures import turn_start
from aoro_gym.simulation.manoeuvres import Trajectory
from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE, RPM

CORNER_LINES = {
    "fl": ("front left", RED),
    "fr": ("front right", BLUE),
    "rl": ("rear left", AMBER),
    "rr": ("rear right", GREEN),
}
JOINT_LINES = dict(zip(JOINTS, (RED, BLUE, AMBER, GREEN), strict=True))
"""Colours of a crane's joints."""
MOST_POINTS = 4000
"""Points of a line in the HTML page; longer recordings are thinned evenly."""


@dataclass(frozen=True)
class Line:
    """One channel in a panel; ``size`` is the SI value of the panel's unit."""

    channel: str
    label: str
    colour: str
    size: float = 1.0
    dashed: bool = False
    strong: bool = False


@dataclass(frozen=True)
class Panel:
    """One plot: quantities of one unit over time."""

    title: str
    unit: str
    lines: Sequence[Line]
    from_zero: bool = False


@dataclass(frozen=True)
class Section:
    """One recording with what is said about it."""

    recording: Trajectory
    figures: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return self.recording.manoeuvre.title


def panels(recording: Trajectory) -> list[Panel]:
    """The panels worth drawing: steering, driving and arms, each where the recording uses it."""
    turn = recording.manoeuvre.turn
    drives = bool(np.any(recording["drive_signal"]))
    steers = bool(turn) or bool(np.any(recording["steering_signal"])) or not drives
    arms = [f"arm_angle_{corner}" for corner in CORNER_LINES]
    lifts = any(np.ptp(recording[name]) > 2 * DEGREE for name in arms)

    drawn: list[Panel] = []
    if steers:
        drawn += [
            Panel("Steering signal", "%, left positive", [Line("steering_signal", "signal", INK, 0.01, strong=True)]),
            Panel("Joint angle", "°, left positive", [Line("joint_angle", "angle", INK, DEGREE, strong=True)]),
            Panel(
                "Flows of the steering circuit",
                "L/min, joint positive as commanded",
                [
                    Line("pump_flow", "pump", SOFT, LITRE_PER_MINUTE),
                    Line("flow_in", "into the cylinders", RED, LITRE_PER_MINUTE),
                    Line("flow_out", "out of them", BLUE, LITRE_PER_MINUTE, dashed=True),
                    Line("joint_flow", "joint", INK, LITRE_PER_MINUTE, strong=True),
                ],
            ),
            Panel(
                "Pressures of the steering circuit",
                "bar",
                [
                    Line("pump_pressure", "pump", INK, BAR),
                    Line("ls_pressure", "load sensing", AMBER, BAR, dashed=True),
                    Line("pressure_a", "port A", RED, BAR, strong=True),
                    Line("pressure_b", "port B", BLUE, BAR, strong=True),
                    Line("return_pressure", "return line", SOFT, BAR),
                ],
                from_zero=True,
            ),
            Panel(
                "Spool, compensator and pump swash",
                "% of full stroke",
                [
                    Line("spool", "spool (left +)", RED, 0.01),
                    Line("compensator", "compensator", BLUE, 0.01),
                    Line("pump_swash", "pump swash", AMBER, 0.01),
                ],
            ),
        ]
    if drives:
        drawn += [
            Panel(
                "Drive signal and pump swash",
                "%",
                [Line("drive_signal", "signal", INK, 0.01, strong=True), Line("drive_swash", "swash", AMBER, 0.01)],
            ),
            Panel("Speed", "m/s", [Line("speed", "speed", INK, strong=True)], from_zero=True),
            Panel(
                "Pressures of the driveline",
                "bar",
                [
                    Line("drive_pressure_forward", "forward side", RED, BAR, strong=True),
                    Line("drive_pressure_return", "return side", BLUE, BAR, strong=True),
                    Line("charge_pressure", "charge", SOFT, BAR),
                ],
                from_zero=True,
            ),
            Panel("Pressure across the wheel motors", "bar", _corners("motor_pressure", BAR)),
        ]
    drawn.append(Panel("Wheel speeds", "rad/s", _corners("wheel_rate", 1.0)))
    if drives:
        drawn.append(Panel("Engine speed", "rpm", [Line("engine_speed", "engine", INK, RPM, strong=True)]))
    if lifts:
        drawn += [
            Panel("Pendulum arms", "°, wheel up positive", _corners("arm_angle", DEGREE)),
            Panel("Wheel loads", "kN", _corners("wheel_load", 1e3), from_zero=True),
        ]
    drawn += _of_crane() if "crane_tip_load" in recording else []
    return drawn + (_of_soil() if "sinkage_fl" in recording else [])


def write_png(path: Path, section: Section) -> None:
    """Draw the panels of one recording to ``path``."""
    import matplotlib
    from matplotlib.figure import Figure

    drawn = panels(section.recording)
    rows = (len(drawn) + 1) // 2
    with matplotlib.rc_context(PLOT_STYLE | {"font.size": 9.0}):
        figure = Figure(figsize=(11.5, 0.9 + 2.35 * rows), dpi=130, layout="constrained")
        layout: Any = figure.get_layout_engine()
        layout.set(w_pad=0.08, h_pad=0.06)
        figure.suptitle(section.title, x=0.012, ha="left", fontsize=14, fontweight="bold")
        axes = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
        for index, (axis, panel) in enumerate(zip(axes, drawn, strict=False)):
            row = drawn[index - index % 2 : index - index % 2 + 2]
            _draw(axis, panel, section, room_for_legend=any(len(other.lines) > 1 for other in row))
        for axis in axes[len(drawn) :]:
            axis.set_visible(False)
        for axis in axes[: len(drawn)][-2:]:
            axis.set_xlabel("time [s]")
            axis.tick_params(labelbottom=True)
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def write_html(
    path: Path, title: str, lead: str, sections: Sequence[Section], passages: Sequence[Passage] = ()
) -> None:
    """Write one page: ``passages`` first, then the key figures and the plots of every section.

    Args:
        path: File to write.
        title: Of the page.
        lead: Sentence below it.
        sections: Recordings with their key figures.
        passages: Blocks that come first.
    """
    bodies = [passage.section for passage in passages]
    for section in sections:
        plot = block("card", contents=[_plotly(section)])
        bodies.append((section.title, joined([tiles(section.figures), plot])))
    footer = "Plots show the simulated state. World and body frames: x forward, y left, z up. Left is positive."
    write_page(path, title, lead, bodies, footer=footer, interactive=bool(sections))


def _of_soil() -> list[Panel]:
    """The panels of soft ground."""
    return [
        Panel("Sinkage", "cm", _corners("sinkage", 0.01), from_zero=True),
        Panel("Resistance of the soil", "kN", _corners("soil_resistance", 1e3), from_zero=True),
    ]


def _of_crane() -> list[Panel]:
    """The panels of a crane."""
    turning = JOINTS[:3]
    return [
        Panel("Crane: slew, lift and fold", "°, left and up positive", _joints("crane_joint", DEGREE, turning)),
        Panel("Crane: telescope", "m", [Line("crane_joint_telescope", "out", INK, strong=True)], from_zero=True),
        Panel("Crane: rates", "°/s, left and up positive", _joints("crane_rate", DEGREE, turning)),
        Panel("Crane: oil from the pump", "L/min", _joints("crane_flow", LITRE_PER_MINUTE), from_zero=True),
        Panel("Crane: pressures of the bores", "bar", _joints("crane_pressure_bore", BAR), from_zero=True),
        Panel("Crane: pressures of the rods' sides", "bar", _joints("crane_pressure_annulus", BAR), from_zero=True),
        Panel(
            "Crane: load cell at the tip, ground under the log",
            "kN",
            [
                Line("crane_tip_load", "load cell", INK, 1e3, strong=True),
                Line("crane_ground_force", "ground", AMBER, 1e3),
            ],
        ),
        Panel("Lean", "°", [Line("roll", "roll", RED, DEGREE), Line("pitch", "pitch", BLUE, DEGREE)]),
    ]


def _joints(quantity: str, size: float, names: Iterable[str] = JOINTS) -> list[Line]:
    return [Line(f"{quantity}_{name}", name, colour, size) for name, colour in JOINT_LINES.items() if name in names]


def _corners(quantity: str, size: float) -> list[Line]:
    return [
        Line(f"{quantity}_{corner}", label, colour, size, dashed=corner.startswith("r"))
        for corner, (label, colour) in CORNER_LINES.items()
    ]


def _marks(section: Section) -> tuple[float, float] | None:
    """Start and end [s] of a full turn, where it was completed."""
    start, turn_time = turn_start(section.recording), section.figures.get("turn_time_s")
    return None if start is None or turn_time is None else (start, start + turn_time)


def _limits(panel: Panel, recording: Trajectory) -> tuple[float, float]:
    """Vertical limits with room above; at least a hundredth of the value wide, so that rounding is no drama."""
    values = [recording[line.channel] / line.size for line in panel.lines if line.channel in recording]
    low = min((float(v.min()) for v in values), default=0.0)
    high = max((float(v.max()) for v in values), default=1.0)
    if panel.from_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    least = max(0.02 * max(abs(low), abs(high)), 0.1)
    if high - low < least:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * least, middle + 0.5 * least
    return low - 0.06 * (high - low), high + 0.08 * (high - low)


def _draw(axis: Any, panel: Panel, section: Section, *, room_for_legend: bool) -> None:
    recording = section.recording
    span = _marks(section)
    if span is not None:
        axis.axvspan(*span, color=SHADE, lw=0)
        if panel.lines[0].channel == "joint_angle":
            middle = (sum(span) / 2, 0.07)
            text = f"turn time {span[1] - span[0]:.3f} s"
            axis.annotate(text, middle, xycoords=("data", "axes fraction"), ha="center", fontsize=9)
    for line in panel.lines:
        if line.channel in recording:
            axis.plot(
                recording.time,
                recording[line.channel] / line.size,
                color=line.colour,
                lw=1.7 if line.strong else 1.1,
                ls=(0, (5, 2)) if line.dashed else "-",
                label=line.label,
            )
    axis.set_title(
        f"{panel.title} [{panel.unit}]", loc="left", fontsize=10, fontweight="bold", pad=19 if room_for_legend else 6
    )
    axis.grid(True)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_xlim(0.0, float(recording.time[-1]))
    axis.set_ylim(*_limits(panel, recording))
    if len(panel.lines) > 1:
        axis.legend(
            frameon=False,
            fontsize=8.5,
            ncols=len(panel.lines),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderpad=0.0,
            borderaxespad=0.3,
            handlelength=1.6,
            handletextpad=0.5,
            columnspacing=1.4,
        )


def _plotly(section: Section) -> Markup:
    """The panels of a section as one linked plot."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    recording = section.recording
    drawn = panels(recording)
    rows = (len(drawn) + 1) // 2
    together: Any = "all"  # typed as a bool in plotly
    figure: Any = make_subplots(
        rows=rows,
        cols=2,
        shared_xaxes=together,
        subplot_titles=[f"<b>{panel.title}</b> [{panel.unit}]" for panel in drawn],
        horizontal_spacing=0.07,
        vertical_spacing=0.26 / rows,
    )
    stride = -(-len(recording.time) // MOST_POINTS)
    time = _instants(recording.time, stride)
    for index, panel in enumerate(drawn):
        row, column = index // 2 + 1, index % 2 + 1
        legend = "legend" if index == 0 else f"legend{index + 1}"
        axis = "" if index == 0 else str(index + 1)
        for line in panel.lines:
            if line.channel in recording:
                figure.add_trace(
                    go.Scatter(
                        **time,
                        y=_thin(recording[line.channel] / line.size, stride),
                        name=line.label,
                        mode="lines",
                        legend=legend,
                        showlegend=len(panel.lines) > 1,
                        line={
                            "color": line.colour,
                            "width": 2.2 if line.strong else 1.4,
                            "dash": "dash" if line.dashed else "solid",
                        },
                        hovertemplate=f"%{{y:.4g}} {html.escape(panel.unit.split(',')[0])}",
                    ),
                    row=row,
                    col=column,
                )
        domain_x = figure.layout[f"xaxis{axis}"].domain
        domain_y = figure.layout[f"yaxis{axis}"].domain
        figure.update_layout(
            {
                legend: {
                    "x": domain_x[0],
                    "y": domain_y[1],
                    "yanchor": "bottom",
                    "xanchor": "left",
                    "orientation": "h",
                    "font": {"size": 11},
                    "bgcolor": "rgba(0,0,0,0)",
                }
            }
        )
        figure.update_yaxes(range=_limits(panel, recording), row=row, col=column)
        if index >= len(drawn) - 2:
            figure.update_xaxes(title_text="time [s]", showticklabels=True, row=row, col=column)
        span = _marks(section)
        if span is not None:
            figure.add_vrect(x0=span[0], x1=span[1], fillcolor=SHADE, line_width=0, layer="below", row=row, col=column)
    figure.update_annotations(yshift=20)
    figure.update_xaxes(range=[0.0, float(recording.time[-1])])
    return interactive_plot(figure, height=70 + 285 * rows, margin={"l": 50, "r": 15, "t": 60, "b": 45})


def _instants(time: NDArray[np.float64], stride: int) -> dict[str, Any]:
    """Every ``stride``-th instant as plotly takes it: its first and the step where steps are even, which takes no bytes."""
    every = time[::stride]
    step = (every[-1] - every[0]) / max(len(every) - 1, 1)
    is_even = bool(np.allclose(every, every[0] + step * np.arange(len(every)), rtol=0.0, atol=1e-6))
    # rounded as it is written beside the cursor
    return (
        {"x0": round(float(every[0]), 6), "dx": round(float(step), 9)} if is_even else {"x": every.astype(np.float32)}
    )


def _thin(values: NDArray[np.float64], stride: int) -> NDArray[np.float32]:
    return values[::stride].astype(np.float32)
