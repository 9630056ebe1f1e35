"""What an exported twin takes and gives: commands in, outputs out, parameters before it is placed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import DECLARATIONS, Machine
from aoro_gym.machine.quantities import UNITS, Declaration, with_unit
from aoro_gym.recording.commands import COMMAND_BOUNDS
from aoro_gym.terrains.plane import BOUNDS as PLANE_BOUNDS
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import OUTPUT_UNITS

INPUT, OUTPUT, PARAMETER = "input", "output", "parameter"

_COMMANDS = {
    "steering_signal": "share of the full steering signal, positive to the left; the valve gets 2.5 V - 2 V times it",
    "drive_signal": "share of the full drive signal, positive ahead",
    "gear": "1, 2 or 3",
    "parking_brake": "1 holds the wheels, 0 lets them go",
}
_GROUND = {
    "slope_deg": ("ground.slope", "deg", "inclination of the plane, rising towards ground.direction"),
    "direction_deg": ("ground.direction", "deg", "direction of ascent, counter-clockwise from world x, from above"),
    "friction": ("ground.friction", "1", "multiplier of the tires' friction; 1 is dry asphalt"),
    "rolling_resistance": ("ground.rolling_resistance", "1", "multiplier of the tires' rolling resistance"),
}
_INITIAL = {
    "x": ("m", "world position of the hinge at the start"),
    "y": ("m", "world position of the hinge at the start"),
    "heading": ("rad", "heading of the front frame at the start"),
    "joint_angle": ("rad", "joint angle at the start, positive to the left, within joint.range"),
}

_ANY = Declaration("1")


@dataclass(frozen=True)
class Variable:
    """A variable of the exported twin; its number in the list is its value reference."""

    name: str
    kind: str
    unit: str
    description: str
    start: float = 0.0
    """Value in ``unit`` at which it begins; outputs begin where the machine stands."""
    suggested: tuple[float, float] | None = None
    """Plausible range in ``unit``, for people."""
    bounds: Declaration = _ANY
    """What it must be within [SI]."""

    @property
    def factor(self) -> float:
        """Size of ``unit`` in SI."""
        return UNITS[self.unit][1] if self.unit in UNITS else 1.0

    @property
    def identifier(self) -> str:
        """Constant of C that numbers it."""
        return "AORO_" + self.name.replace(".", "_").upper()

    @property
    def whole(self) -> bool:
        """Whether it is an integer."""
        return self.name == "gear"


def variables(machine: Machine, plane: Plane | None) -> list[Variable]:
    """All variables in the order of their numbers, time first.

    Args:
        machine: Gives parameters their start, unit and range.
        plane: The ground with its parameters; None on a terrain.

    Raises ValueError if two names would be one in C.
    """
    out = [Variable("time", OUTPUT, "s", "time"), *_commands(), *_outputs(), *_parameters(machine, plane)]
    names = [one.identifier for one in out]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"variables {', '.join(sorted(twice))} share a name; rename one of each")
    return out


def of_kind(listed: list[Variable], kind: str) -> list[Variable]:
    """The variables of a kind, without time."""
    return [one for one in listed[1:] if one.kind == kind]


def _commands() -> Iterator[Variable]:
    for name, (low, high, start) in COMMAND_BOUNDS.items():
        share = "share of the full signal of this arm's valve" if name.startswith("arm") else "opening of this valve"
        text = _COMMANDS.get(name, share)
        yield Variable(name, INPUT, "1", text, start, (low, high), Declaration("1", low, high))


def _outputs() -> Iterator[Variable]:
    for name, unit in OUTPUT_UNITS.items():
        if name not in COMMAND_BOUNDS:  # the host knows what it commands
            yield Variable(name, OUTPUT, unit.replace(" ", "*"), name.replace("_", " "))


def _parameters(machine: Machine, plane: Plane | None) -> Iterator[Variable]:
    for name, (unit, text) in _INITIAL.items():
        yield Variable(f"initial.{name}", PARAMETER, unit, text, 0.0, None, Declaration(unit))
    for field, (name, unit, text) in _GROUND.items():
        if plane is None and unit == "deg":
            continue
        low, high, _ = PLANE_BOUNDS[field]
        start = 1.0 if plane is None else float(getattr(plane, field))  # pyright: ignore[reportArgumentType]
        factor = UNITS[unit][1]
        bounds = Declaration(UNITS[unit][0], low * factor, high * factor)
        yield Variable(name, PARAMETER, unit, text, start, (low, high), bounds)
    for key, declaration in DECLARATIONS.items():
        if key.startswith(PAYLOAD):  # an exported twin carries none
            continue
        entry = machine.entries[key]
        value = float(entry.value)
        low, high = (float(limit) for limit in entry.range)
        suggested = (min(low, value), max(high, value))
        yield Variable(key, PARAMETER, entry.unit, entry.source, value, suggested, declaration)


def bounds_text(one: Variable) -> str:
    """What a variable must be, in words: ``above 0 s and at most 0.1 s``."""
    if one.whole:
        low, high = (with_unit(limit, one.unit) for limit in (one.bounds.low, one.bounds.high))
        return f"a whole number from {low} to {high}"
    text = one.bounds.bounds(one.unit)
    return text if math.isfinite(one.bounds.low + one.bounds.high) or text == "finite" else f"finite and {text}"
