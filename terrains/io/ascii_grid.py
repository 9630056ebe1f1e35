"""ESRI ASCII grids held against what their header says, before GDAL takes a word for 0 and looks no further."""

from __future__ import annotations

import re
from pathlib import Path
from typing import BinaryIO

import numpy as np

from aoro_gym.terrains.io.check import TerrainError

HEADER = re.compile(
    rb"\s*(?P<key>ncols|nrows|xllcorner|yllcorner|xllcenter|yllcenter|cellsize|dx|dy|nodata_value|nodata)[ \t=:]+"
    rb"(?P<value>\S+)[ \t]*\r?\n",
    re.IGNORECASE,
)
NUMBER = re.compile(rb"[+-]?(\d+[.,]?\d*|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
VALUES = b"0123456789+-.,eEdD \t\r\n\f\v\x1a\x00nNaAiIfFtTyY*"
"""Bytes that a number may hold, or stand between numbers."""
CHUNK = 16_000_000
LONGEST_HEADER = 4096


def check_ascii_grid(path: Path) -> None:
    """``TerrainError`` naming line and word where the grid's text is no number, or its values are not as many as promised.

    What does not begin with the usual header is left to GDAL.
    """
    with path.open("rb") as file:
        head = file.read(LONGEST_HEADER)
        found: dict[str, bytes] = {}
        at = lines = 0
        while match := HEADER.match(head, at):
            key, value = match["key"].decode().casefold(), match["value"]
            lines += head[at : match.end()].count(b"\n")
            if not NUMBER.fullmatch(value):
                raise TerrainError(f"{path}, line {lines}: {key} is {_shown(value)}, which is no number")
            found[key] = value
            at = match.end()
        if not {"ncols", "nrows"} <= set(found):
            return
        file.seek(at)
        count = _count(path, file, lines)
    size = {key: found[key] for key in ("ncols", "nrows")}
    for key, value in size.items():
        if not re.fullmatch(rb"\+?0*[1-9]\d{0,9}(\.0*)?", value):
            raise TerrainError(
                f"{path}: {key} is {_shown(value)}, but must be a positive integer of at most ten digits"
            )
    promised = int(float(size["ncols"])) * int(float(size["nrows"]))
    if count != promised:
        why = "it is cut off; get it again" if count < promised else "it is broken"
        raise TerrainError(f"{path}: it holds {count:,} values, but its header promises {promised:,}, so {why}")


def _count(path: Path, file: BinaryIO, lines: int) -> int:
    """How many values follow; ``TerrainError`` at the first byte that no number holds."""
    count, inside = 0, False
    while chunk := file.read(CHUNK):
        strange = chunk.translate(None, VALUES)
        if strange:
            at = chunk.index(strange[:1])
            first = max(chunk.rfind(b" ", 0, at), chunk.rfind(b"\n", 0, at), chunk.rfind(b"\t", 0, at)) + 1
            word = chunk[first : first + 40].split()[0]
            line = lines + chunk[:at].count(b"\n") + 1
            raise TerrainError(f"{path}, line {line}: {_shown(word)} is no number")
        solid = np.frombuffer(chunk, dtype=np.uint8) > 32
        count += int(np.count_nonzero(solid[1:] & ~solid[:-1])) + int(solid[0] and not inside)
        inside = bool(solid[-1])
        lines += chunk.count(b"\n")
    return count


def _shown(word: bytes) -> str:
    return repr(word[:40].decode("latin-1")) + ("..." if len(word) > 40 else "")
