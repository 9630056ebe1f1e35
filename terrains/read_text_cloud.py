"""Point clouds as text: XYZ, CSV, PTS."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aoro_gym.terrains.check import Report, TerrainError
from aoro_gym.terrains.cloud_survey import Chunk, Cloud
from aoro_gym.terrains.frame import Request
from aoro_gym.terrains.ground import Ground
from aoro_gym.terrains.read_cloud import CHUNK, broken, read_cloud


def read_text(path: Path, request: Request, report: Report) -> Ground:
    """A cloud of lines ``x y z``, separated by spaces, tabs, commas or semicolons; the first lines may be names."""
    skip, separator, columns = _layout(path)

    def chunks() -> Iterator[Chunk]:
        with broken(path, "lines of x, y, z"), path.open(encoding="utf-8", errors="replace") as file:
            for _ in range(skip):
                next(file)
            while lines := list(itertools.islice(file, CHUNK)):
                lines = [line for line in lines if line.strip() and not line.lstrip().startswith(("#", "//"))]
                if lines:
                    values = np.loadtxt(lines, delimiter=separator, usecols=columns, ndmin=2, comments=None)
                    classes = values[:, 3].astype(np.uint8) if values.shape[1] > 3 else None
                    yield Chunk(values[:, :3], classes)

    return read_cloud(Cloud(0, chunks), request, report)


def _layout(path: Path) -> tuple[int, str | None, tuple[int, ...]]:
    """Lines to skip, separator, and columns of x, y, z and, if named, the class."""
    names: list[str] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for skip, line in enumerate(itertools.islice(file, 50)):
            text = line.strip()
            separator = next((mark for mark in (";", ",", "\t") if mark in text), None)
            parts = [part.strip().strip('"') for part in (text.split(separator) if separator else text.split())]
            if not text or text.startswith(("//", "#")) or not all(_is_number(part) for part in parts):
                names = [part.lower() for part in parts] or names
                continue
            if len(parts) < 3:
                raise TerrainError(f"{path}, line {skip + 1}: {len(parts)} numbers; a point has x, y and z")
            if len(names) != len(parts) or not {"x", "y", "z"} <= set(names):
                return skip, separator, (0, 1, 2)
            classes = next((names.index(name) for name in ("classification", "class") if name in names), None)
            plan = tuple(names.index(name) for name in ("x", "y", "z"))
            return skip, separator, plan if classes is None else (*plan, classes)
    raise TerrainError(f"{path}: no line of numbers x, y, z among the first 50")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
