"""Figures of the machine files that were fitted: full turns, single figures, bounds, and theory of the same turns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.calibration.space import Space
from aoro_gym.execution.digest import Contents, digest
from aoro_gym.machine import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.validation import Validation, validate
from aoro_gym.validation.theory.sensitivities import FIGURES, LEVELS, Cases, predicted_angles
from aoro_gym.validation.turns import Turn, repeated, run_turns, stacked
from studies.identification.structures import uncertain

Progress = Callable[[str, float], Any]


@dataclass(frozen=True)
class Member:
    """A machine file that was fitted."""

    structure: str
    """Of its laws, as :mod:`studies.identification.structures` has them."""
    reference: str
    """What it was fitted to: ``mevea``, the published twin, or ``physical``, the machine."""
    folder: str = ""
    """Below the folder of the machine files."""

    def path(self, name: str) -> Path:
        """Its file."""
        return Path(str(files("aoro_gym"))) / "machines" / self.folder / f"{name}.toml"


MEMBERS: Mapping[str, Member] = {
    "aoro": Member("default", "mevea"),
    "aoro_least_squares": Member("default", "mevea"),
    "aoro_published_inputs": Member("default", "mevea"),
    "aoro_physical": Member("materials", "physical"),
    **{
        name: Member(name, "mevea", "structures")
        for name in (
            "default_materials",
            "library",
            "library_materials",
            "valve_maker",
            "valve_maker_materials",
            "vehicle",
        )
    },
}
"""The machines of the page, the default one first."""


def machines() -> dict[str, Machine]:
    """All members, by name."""
    return {name: Machine.load(member.path(name)) for name, member in MEMBERS.items()}


def digests() -> dict[str, str]:
    """Digest of each member's file."""
    return {name: digest(Contents(member.path(name)))[:16] for name, member in MEMBERS.items()}


def at_bounds(name: str, machine: Machine) -> dict[str, str]:
    """Uncertain parameters that stand on an end of their range where the data sheet does not: ``low`` or ``high`` by key."""
    space = Space(machine, uncertain(MEMBERS[name].structure, machine))
    sheet = Machine.load("aoro_datasheet")
    return dict(sorted(set(space.at_bounds(space.point())) - set(space.at_bounds(space.point(sheet)))))


def figures_of(found: Validation) -> dict[str, Any]:
    """What the page has of a validation: the twin's rows, single figures, the shape, and how much of all that is met."""
    near, away = ([one.in_bounds <= 1.0 for one in found.misses(name)] for name in ("mevea", "physical"))
    return {
        "rows": [row for row in found.rows if row["source"] == "twin"],
        "checks": found.checks,
        "shape": found.shape,
        "met": {
            "mevea": [sum(near), len(near)],
            "physical": [sum(away), len(away)],
            "shape": [found.shape_reached, len(found.shape)],
        },
        "misfit": {"filtered": found.misfit(), "unfiltered": found.misfit("twin_raw")},
        "worst": found.misses("mevea")[0].in_bounds,
        "notes": found.notes,
    }


def against_theory(family: Mapping[str, Machine], device: str = "cpu") -> dict[str, dict[str, list[float]]]:
    """Relative deviation of each member's left turns from those of the planar machine with its parameters and laws, by
    name and figure, in the order of the levels.

    Both are read alike, between samples and averaged over the phases of the logger's clock.
    """
    batch = stacked(list(family.values()))
    lanes = (("", ()),) * len(family)
    level = np.repeat(LEVELS, len(lanes))
    level_ground = Plane(slope_deg=np.zeros(len(level)), direction_deg=np.zeros(len(level)))
    turns = Cases((), repeated(batch, len(LEVELS)), level, level_ground, lanes)
    recording = run_turns(batch, [Turn("left", 100.0 * level) for level in LEVELS], device=device)
    seen = turns.figures(recording.time, recording.angle.reshape(len(recording.time), -1)).mean(axis=0)
    said = turns.figures(*predicted_angles(turns)).mean(axis=0)
    return {
        name: {
            figure: [float(f"{seen[level, at, i] / said[level, at, i] - 1.0:.4g}") for level in range(len(LEVELS))]
            for i, figure in enumerate(FIGURES)
        }
        for at, name in enumerate(family)
    }


def measured(
    device: str = "cpu", progress: Progress = lambda what, share: None
) -> tuple[dict[str, Any], list[Validation]]:
    """Figures of all members by name, and two validations to draw: the default machine's with the band of the machines of
    other laws, and that of the machine which was fitted to the real one."""
    family = machines()
    others = [machine for name, machine in family.items() if MEMBERS[name].folder]
    found, drawn = {}, []
    for at, (name, machine) in enumerate(family.items()):
        progress(f"full turns of {name}", at / len(family))
        result = validate(machine, ensemble=others if name == "aoro" else (), noise_runs=0, device=device)
        found[name] = figures_of(result) | {"at_bounds": at_bounds(name, machine)}
        if name in ("aoro", "aoro_physical"):
            drawn.append(result)
    return found, drawn
