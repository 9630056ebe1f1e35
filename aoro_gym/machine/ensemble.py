"""Ensembles: several machines that fit the same measurements."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from aoro_gym.machine.parameters import Machine


def bundled_ensemble() -> list[Machine]:
    """Machines that fit the published figures as well as the bundled one."""
    return read_ensemble(Path(str(files("aoro_gym") / "machines" / "ensemble")))


def bundled_structures() -> list[Machine]:
    """Machines of other laws, each fitted to the published twin's left turns, in the order of their files' names."""
    return read_ensemble(Path(str(files("aoro_gym") / "machines" / "structures")))


def read_ensemble(path: Path) -> list[Machine]:
    """The machine of a file, or those of all machine files (.toml) in a folder, by name; raises as ``Machine.load``."""
    return [Machine.load(file) for file in (sorted(path.glob("*.toml")) if path.is_dir() else [path])]
