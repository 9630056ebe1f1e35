"""Pictures of ``architecture.md``. ``python docs/diagrams.py`` draws them into ``docs/pictures``.

They are SVG files of boxes on a grid and arrows between them, so that they show on the built pages and on GitHub alike,
without a network. The floors of the packages come from ``pyproject.toml``.
"""

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path

HERE = Path(__file__).resolve().parent
WIDTH, HEIGHT = 160, 54
"""Size of a box [px]; one may be wider by a factor."""
ACROSS, DOWN = 210, 92
"""Distance [px] of the grid's columns and rows."""
COLOURS = {"control": "#e8edf3", "oil": "#fbe9d7", "body": "#dff0e3", "data": "#e3ecfa", "plain": "#f4f4f2"}


@dataclass(frozen=True)
class Box:
    """A box at ``column`` and ``row`` of the grid, ``wide`` times as wide as others."""

    column: float
    row: float
    title: str
    note: str = ""
    colour: str = "plain"
    wide: float = 1.0

    @property
    def centre(self) -> tuple[float, float]:
        return self.column * ACROSS + 12 + 0.5 * WIDTH, self.row * DOWN + 14 + 0.5 * HEIGHT

    def svg(self) -> Iterator[str]:
        x, y = self.centre
        width = WIDTH * self.wide
        yield (
            f'<rect x="{x - width / 2:g}" y="{y - HEIGHT / 2:g}" width="{width:g}" height="{HEIGHT}" rx="6" '
            f'fill="{COLOURS[self.colour]}" stroke="#5b6672"/>'
        )
        yield f'<text x="{x:g}" y="{y + (-3 if self.note else 5):g}" font-weight="600">{escape(self.title)}</text>'
        if self.note:
            yield f'<text x="{x:g}" y="{y + 15:g}" font-size="11" fill="#4a545e">{escape(self.note)}</text>'

    def border(self, other: "Box") -> tuple[float, float]:
        """Point of the border on the way to the middle of ``other``."""
        (x, y), (to_x, to_y) = self.centre, other.centre
        dx, dy = to_x - x, to_y - y
        share = min(WIDTH * self.wide / 2 / abs(dx) if dx else 1.0, HEIGHT / 2 / abs(dy) if dy else 1.0)
        return x + share * dx, y + share * dy


@dataclass(frozen=True)
class Arrow:
    """An arrow from one box to another with what goes along it; ``signal`` draws it dashed, ``both`` with two heads."""

    start: Box
    end: Box
    label: str = ""
    signal: bool = False
    both: bool = False

    def svg(self) -> Iterator[str]:
        (x1, y1), (x2, y2) = self.start.border(self.end), self.end.border(self.start)
        style = ' stroke-dasharray="5 4"' if self.signal else ""
        style += ' marker-start="url(#head)"' if self.both else ""
        yield f'<path d="M{x1:.1f} {y1:.1f} L{x2:.1f} {y2:.1f}" stroke="#333d47"{style} marker-end="url(#head)"/>'
        if self.label:
            level = abs(y2 - y1) < 1.0
            place = f'x="{(x1 + x2) / 2 + (0 if level else 8):.1f}" y="{(y1 + y2) / 2 + (-6 if level else 4):.1f}"'
            anchor = "" if level else ' text-anchor="start"'
            yield f'<text {place} font-size="11"{anchor} class="label">{escape(self.label)}</text>'


def drawn(title: str, boxes: Sequence[Box], arrows: Sequence[Arrow] = ()) -> str:
    """An SVG file of boxes and arrows."""
    width = max(box.centre[0] + WIDTH * box.wide / 2 for box in boxes) + 14
    height = max(box.centre[1] for box in boxes) + HEIGHT / 2 + 14
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        'font-family="system-ui, sans-serif" font-size="13" text-anchor="middle" role="img">',
        f"<title>{escape(title)}</title>",
        "<style>.label { paint-order: stroke; stroke: #fff; stroke-width: 4px; fill: #333d47 }</style>",
        '<marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" '
        'orient="auto-start-reverse"><path d="M0 0 L8 4 L0 8 z" fill="#333d47"/></marker>',
        '<rect width="100%" height="100%" fill="#fff"/>',
    ]
    for part in (*arrows, *boxes):
        lines += part.svg()
    return "\n".join([*lines, "</svg>"]) + "\n"


def machine() -> str:
    """The machine's block diagram, as the kernel computes it."""
    commands = Box(0, 0, "Commands", "to valves and pump 1", "control")
    engine = Box(1.5, 0, "Diesel engine", "speed governor", "body")
    load_sensing = Box(0.5, 1, "Pump 2", "load sensing", "oil")
    drive_pump = Box(2, 1, "Pump 1", "closed loop", "oil")
    steering_valve = Box(0, 2, "Steering valve", "with compensator", "oil")
    arm_valves = Box(1, 2, "4 arm valves", "with load holding", "oil")
    traction = Box(2, 2, "4 traction valves", "", "oil")
    steering = Box(0, 3, "2 steering cylinders", "ports A and B", "oil")
    lifting = Box(1, 3, "4 arm cylinders", "", "oil")
    motors = Box(2, 3, "4 wheel motors", "", "oil")
    joint = Box(0, 4, "Articulated joint", "friction, stops, play", "body")
    arms = Box(1, 4, "4 pendulum arms", "", "body")
    wheels = Box(2, 4, "4 wheels", "with brakes", "body")
    frames = Box(0.5, 5, "2 frames", "15 degrees of freedom", "body")
    tires = Box(2, 5, "Tires and hulls", "contact", "body")
    sensors = Box(0, 6, "Sensors", "angle, pressures, GPS, …", "control")
    ground = Box(2, 6, "Ground", "plane, raster, triangles", "data")
    arrows = [
        Arrow(engine, load_sensing, both=True),
        Arrow(engine, drive_pump, both=True),
        Arrow(load_sensing, steering_valve),
        Arrow(load_sensing, arm_valves),
        Arrow(drive_pump, traction, "oil"),
        Arrow(steering_valve, steering, "oil", both=True),
        Arrow(arm_valves, lifting, "oil", both=True),
        Arrow(traction, motors, "oil", both=True),
        Arrow(steering, joint, "torque", both=True),
        Arrow(lifting, arms, "torque", both=True),
        Arrow(motors, wheels, "torque", both=True),
        Arrow(joint, frames, both=True),
        Arrow(arms, frames, both=True),
        Arrow(arms, wheels, both=True),
        Arrow(wheels, tires, "force", both=True),
        Arrow(ground, tires, "height, grip", signal=True),
        Arrow(commands, steering_valve, signal=True),
        Arrow(joint, sensors, signal=True),
    ]
    boxes = dict.fromkeys(box for arrow in arrows for box in (arrow.start, arrow.end))
    return drawn("Block diagram of the machine", list(boxes), arrows)


def packages() -> str:
    """The packages on their floors: each sees only what stands on lower floors."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    floors = next(one["layers"] for one in project["tool"]["importlinter"]["contracts"] if one["type"] == "layers")
    rows = [floor.split(" | ") for floor in floors if floor != "__main__"]
    boxes = [
        Box(0.7 + column - 0.5 * (len(row) - 1), 0.7 * floor, name, colour="data", wide=2.45 if len(row) == 1 else 1.14)
        for floor, row in enumerate(rows)
        for column, name in enumerate(row)
    ]
    return drawn("Packages, each above all that it imports", boxes)


def chain(title: str, *steps: tuple[str, str, str]) -> str:
    """Boxes one under the other: title, where it happens, and what it hands on."""
    boxes = [Box(0.7, row, name, where, "data", 2.45) for row, (name, where, _) in enumerate(steps)]
    handed = [result for _, _, result in steps]
    return drawn(title, boxes, [Arrow(*pair, label) for pair, label in zip(pairwise(boxes), handed, strict=False)])


PICTURES = {
    "machine.svg": machine(),
    "packages.svg": packages(),
    "flow_of_a_parameter.svg": chain(
        "A parameter on its way into the kernel",
        ("Machine file: an overlay and its base", "aoro_gym/machines/*.toml", "tables"),
        ("Read and checked; units to SI", "aoro_gym/machine/machine_file.py", "parameters by dotted key"),
        ("Sections with bounds; does the machine close?", "aoro_gym/machine/parameters.py", "Machine"),
        ("--set, --scale, effects: one value, or one a twin", "aoro_gym/effects/catalogue.py", "Machine"),
        ("Packed by name, with what follows from it", "aoro_gym/twin/records.py", "records, float32"),
        ("Read by the law that it belongs to", "aoro_gym/twin/physics", ""),
    ),
    "flow_of_a_step.svg": chain(
        "A batch of actions on its way through a step",
        ("Actions checked, clipped", "envs/core/vector.py", "(N, A)"),
        ("Actions become commands of the machine", "envs/turning, envs/path_tracking", "rows of commands"),
        ("All twins advance in one launch", "aoro_gym/twin/twin.py", "outputs, status"),
        ("Sensors measure; the pose is estimated", "aoro_gym/sensors", "measurements"),
        ("Terms of reward; who has ended, and why", "envs/core/terms.py", "rewards, ends"),
        ("New goals; ended episodes are drawn and reset", "envs/core/randomisation.py", "new episodes"),
        ("Terms of observation", "envs/core/terms.py", ""),
    ),
    "flow_of_a_log.svg": chain(
        "A log on its way through a diagnosis",
        ("Columns found by quantity and unit; 100 Hz, SI", "aoro_gym/recording/logs.py", "recordings"),
        ("Checked beside the twin: what no machine shows", "aoro_gym/diagnosis/credible.py", "credible ones"),
        ("Healthy and later logs paired by command", "aoro_gym/diagnosis/network/cases.py", "a case"),
        ("Networks weigh every hypothesis", "aoro_gym/diagnosis/network/forward.py", "probabilities"),
        ("Verdict and declared set", "aoro_gym/diagnosis/network/decision.py", "causes that may be"),
        ("Twins fit their sizes, by families of laws", "aoro_gym/diagnosis/fits.py", "sizes, closure"),
        ("What to record next", "aoro_gym/diagnosis/next_experiments.py", "Diagnosis"),
        ("diagnosis.json, report.html, machine files", "aoro_gym/diagnosis/report.py", ""),
    ),
}
"""Text of every picture, by its file's name."""

if __name__ == "__main__":
    for name, text in PICTURES.items():
        (HERE / "pictures" / name).write_text(text, encoding="utf-8")
