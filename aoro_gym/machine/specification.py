"""Specification of a machine and of a run with it, as results record them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from aoro_gym.machine.laws import draws
from aoro_gym.machine.parameters import Machine
from aoro_gym.recording.cells import parse_number


@dataclass(frozen=True)
class MachineSpec:
    """A machine by its file, and changes to its parameters, in the units of that file, and to its laws.

    Args:
        file: Bundled machine, or a machine file (.toml).
        set: ``KEY=VALUE`` texts.
        scale: ``KEY=FACTOR`` texts.
        laws: Family of laws, or what laws are drawn from, see :func:`~aoro_gym.machine.laws.drawn_laws`; by default the
            file's laws.
    """

    file: str
    set: tuple[str, ...] = ()
    scale: tuple[str, ...] = ()
    laws: str | None = None

    def load(self) -> tuple[Machine, list[str]]:
        """The machine, and a warning for every changed parameter outside its plausible range; laws that are to be drawn are
        the file's yet.

        Raises ValueError naming the text, key or value that is wrong; FileNotFoundError if there is no such file.
        """
        machine = Machine.load(self.file)
        try:
            machine = machine if self.laws is None or self.draws_laws else machine.with_laws(self.laws)
        except ValueError as error:
            raise ValueError(f"--laws {self.laws}: {error}") from None
        values, factors = _assignments("--set", self.set), _assignments("--scale", self.scale)
        for key in values.keys() & factors.keys():
            raise ValueError(f"{key} is given to both --set and --scale; give one")
        machine = machine.set(values, check_ranges=False) if values else machine
        machine = machine.scale(factors, check_ranges=False) if factors else machine
        return machine, list(machine.outside_ranges([*values, *factors]).values())

    def to_json(self) -> dict[str, Any]:
        """Every field by name; laws where they are not the file's."""
        own = {} if self.laws is None else {"laws": self.laws}
        return {"file": self.file, "set": list(self.set), "scale": list(self.scale)} | own

    @property
    def draws_laws(self) -> bool:
        """Whether laws are to be drawn."""
        return draws(self.laws)

    @property
    def changed(self) -> bool:
        """Whether anything differs from the file."""
        return bool(self.set or self.scale or self.laws)

    @property
    def sentence(self) -> str:
        """The machine and its changes, for a report."""
        changes = [*self.set, *(text.replace("=", " x ", 1) for text in self.scale)]
        changes += [f"laws drawn from {self.laws}" if self.draws_laws else f"{self.laws} laws"] if self.laws else []
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
