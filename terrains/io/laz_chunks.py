"""Chunks of a LAZ file, held against its bytes: lazrs would reserve what they claim, and abort the process.

Layout: LASzip 3.4. The compressed points begin with the position of the table of chunks (int64), or -1 if that stands in
the file's last eight bytes. The table begins with a version and the number of chunks (uint32 each); the length of every
chunk follows, compressed. A chunk begins with its first point as it is. Of the formats 6 to 10 then follow the number of
its points and the length of each of its layers (uint32 each), and the layers.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.io.check import Report, TerrainError

LAYERED = 3
"""Compressor that parts a chunk into layers."""
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
"""Layers of an item, by its type: point, RGB, RGB with near infrared, wave packet."""
EXTRA_BYTES = 14
"""Type of the item that has a layer a byte."""
LARGEST_CHUNK = 2**30
"""Bytes that a chunk may take in memory (E): LASzip writes 50,000 points into one, a few megabytes."""


@dataclass(frozen=True)
class Points:
    """Where the compressed points of a file lie, and what its header says of them."""

    path: Path
    start: int
    """First byte of the points."""
    count: int
    length: int
    """Of a point that is not compressed [bytes]."""


def check_chunks(points: Points, record: bytes, report: Report) -> None:
    """``TerrainError`` where the table of chunks, or the layers of one, cannot be true.

    Args:
        points: The compressed points.
        record: Data of the record "laszip encoded".
        report: Takes a warning if there are more chunks than the header's points fill.
    """
    lazrs = import_extra("lazrs", f"the point cloud {points.path.name}")
    declared = lazrs.LazVlr(record)
    claimed = declared.item_size()
    if claimed != points.length:
        raise _broken(points, f"its points are {points.length} bytes long, but {claimed:,} by its LASzip record")
    with points.path.open("rb") as file:
        table = _table(points, file)
        _check_count(points, file, table)
        file.seek(points.start)
        chunks = lazrs.read_chunk_table(file, declared)
        _check_lengths(points, chunks, table)
        _note_more(points, chunks, report)
        (compressor,) = struct.unpack_from("<H", record)
        if compressor == LAYERED:
            _check_layers(points, file, chunks, _layers(record))


def _broken(points: Points, what: str) -> TerrainError:
    return TerrainError(f"{points.path}: {what}, so it is cut off or broken; get it again")


def _table(points: Points, file: BinaryIO) -> int:
    """Position of the table of chunks."""
    size = points.path.stat().st_size
    file.seek(points.start)
    (table,) = struct.unpack("<q", file.read(8))
    if table == -1:
        file.seek(size - 8)
        (table,) = struct.unpack("<q", file.read(8))
    if not points.start + 8 <= table <= size - 8:
        raise _broken(points, "its table of chunks is not in the file")
    return table


def _check_count(points: Points, file: BinaryIO, table: int) -> None:
    """No chunk is shorter than a byte."""
    file.seek(table)
    _, count = struct.unpack("<II", file.read(8))
    room = table - points.start - 8
    if count > room:
        raise _broken(points, f"it claims {count:,} chunks in {room:,} bytes")


def _check_lengths(points: Points, chunks: Sequence[tuple[int, int]], table: int) -> None:
    """``chunks`` gives points and bytes of each; those of the last may be fewer."""
    room = table - points.start - 8
    lengths = sum(length for _, length in chunks)
    if lengths > room:
        raise _broken(points, f"its {len(chunks):,} chunks claim {lengths:,} of {room:,} bytes")
    largest, most = max((count for count, _ in chunks), default=0), LARGEST_CHUNK // points.length
    if largest > most:
        raise TerrainError(
            f"{points.path}: it has a chunk of {largest:,} points, but at most {most:,} are read; if it is not broken, write"
            " it anew in smaller chunks"
        )
    held = sum(count for count, _ in chunks)
    if points.count > held:
        raise _broken(
            points,
            f"its header declares {points.count:,} points, but its {len(chunks):,} chunks hold {held:,} at most",
        )


def _note_more(points: Points, chunks: Sequence[tuple[int, int]], report: Report) -> None:
    """Warn of chunks after the header's points."""
    before = sum(count for count, _ in chunks[:-1])
    if chunks and points.count <= before:
        report.warnings.append(
            f"the header declares {points.count:,} points, but there are {len(chunks):,} chunks, which hold more than"
            f" {before:,}: what comes after the declared ones is not read; write the file anew to have it"
        )


def _layers(record: bytes) -> int:
    """Layers of a chunk, of the items that the record names: type, size and version (uint16 each)."""
    (count,) = struct.unpack_from("<H", record, 32)
    items: Any = struct.iter_unpack("<HHH", record[34 : 34 + 6 * count])
    return sum(size if kind == EXTRA_BYTES else LAYERS.get(kind, 0) for kind, size, _ in items)


def _check_layers(points: Points, file: BinaryIO, chunks: Sequence[tuple[int, int]], layers: int) -> None:
    start = points.start + 8
    for number, (_, length) in enumerate(chunks, 1):
        file.seek(start + points.length + 4)
        claimed = sum(struct.unpack(f"<{layers}I", file.read(4 * layers)))
        room = length - points.length - 4 - 4 * layers
        if claimed > room:
            raise _broken(points, f"the layers of its chunk {number:,} claim {claimed:,} of {room:,} bytes")
        start += length
