"""Specification of a machine and of a run with it, as results record them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from aoro_gym.machine.parameters import Machine
from aoro_gym.recording.cells import parse_number


@dataclass(frozen=True)
class MachineSpec:
    """A machine by its file, and changes to its parameters in the units of that file.

    Args:
        file: Bundled machine, or a machine file (.toml).
        set: ``KEY=VALUE`` texts.
        scale: ``KEY=FACTOR`` texts.
    """

    file: str
    set: tuple[str, ...] = ()
    scale: tuple[str, ...] = ()

    def load(self) -> tuple[Machine, list[str]]:
        """The machine, and a warning for every changed parameter outside its plausible range.

        Raises ValueError naming the text, key or value that is wrong; FileNotFoundError if there is no such file.
        """
        machine = Machine.load(self.file)
        values, factors = _assignments("--set", self.set), _assignments("--scale", self.scale)
        for key in values.keys() & factors.keys():
            raise ValueError(f"{key} is given to both --set and --scale; give one")
        machine = machine.set(values, check_ranges=False) if values else machine
        machine = machine.scale(factors, check_ranges=False) if factors else machine
        return machine, list(machine.outside_ranges([*values, *factors]).values())

    def to_json(self) -> dict[str, Any]:
        """Every field by name."""
        return {"file": self.file, "set": list(self.set), "scale": list(self.scale)}

    @property
    def changed(self) -> bool:
        """Whether any parameter differs from the file."""
        return bool(self.set or self.scale)

    @property
    def sentence(self) -> str:
        """The machine and its changes, for a report."""
        changes = [*self.set, *(text.replace("=", " x ", 1) for text in self.scale)]
        return f"Machine {self.file}" + (f", with {', '.join(changes)}" if changes else ", as in its file") + "."


@dataclass(frozen=True)
class RunSpec:
    """A machine, the device that its twin runs on, the seed of all that is random, and whether sensors are ideal."""

    machine: MachineSpec
    device: str = "cpu"
    seed: int = 0
    ideal: bool = False

    def to_json(self) -> dict[str, Any]:
        """Every field by name, as results record it in ``made_by``."""
        return {"machine": self.machine.to_json(), "device": self.device, "seed": self.seed, "ideal": self.ideal}


def _assignments(option: str, texts: Sequence[str]) -> dict[str, float]:
    """Numbers by key of ``KEY=NUMBER`` texts."""
    pairs: dict[str, float] = {}
    for text in texts:
        key, equals, number = (part.strip() for part in text.partition("="))
        if not (key and equals):
            raise ValueError(f"{option} {text!r} is not KEY=NUMBER, such as {option} oil.gas_fraction=0.01")
        value = parse_number(number)
        if value is None:
            raise ValueError(f"{option} {key}={number}: {number!r} is not a finite number")
        if key in pairs:
            raise ValueError(f"{option} names {key} twice; give it once")
        pairs[key] = value
    return pairs
