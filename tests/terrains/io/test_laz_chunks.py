"""LAZ files whose chunks claim what their bytes do not hold are refused before memory is reserved for it."""

import importlib
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from aoro_gym.terrains import TerrainError, load

lazrs = importlib.import_module("lazrs")
POINT = {3: 34, 6: 30, 7: 36, 8: 38}
"""Bytes of a point, by its format (LAS 1.4)."""
SIZES = {6: 9, 7: 10, 8: 11}
"""Layers of a chunk, by its format."""


def cloud(path: Path, point_format: int = 6, extra: int = 0) -> Path:
    """A slope of 90 points in one chunk."""
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    header.scales = np.full(3, 0.001)
    for number in range(extra):
        header.add_extra_dim(laspy.ExtraBytesParams(f"extra{number}", "uint8"))
    points = laspy.LasData(header)
    x, y = np.meshgrid(np.arange(10.0), np.arange(9.0))
    points.x, points.y, points.z = x.ravel(), y.ravel(), 0.1 * x.ravel()
    points.classification = np.full(90, 2, dtype=np.uint8)
    points.write(str(path))
    return path


def start(path: Path) -> int:
    """First byte of the compressed points: of the table's position."""
    return struct.unpack_from("<I", path.read_bytes(), 96)[0]


def overwrite(path: Path, place: int, form: str, *values: int) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into(form, data, place, *values)
    path.write_bytes(data)
    return path


def record(path: Path) -> int:
    """First byte of the data of the record "laszip encoded"; its head has 54, the user id from the third on."""
    return path.read_bytes().index(b"laszip encoded") + 52


@pytest.mark.parametrize("point_format", POINT)
@pytest.mark.parametrize("extra", [0, 3])
def test_whole_files_are_read(tmp_path: Path, point_format: int, extra: int) -> None:
    _, report = load(cloud(tmp_path / "a.laz", point_format, extra))
    assert report.points_read == 90


@pytest.mark.parametrize("point_format", SIZES)
@pytest.mark.parametrize("extra", [0, 3])
def test_every_layer_lies_within_its_chunk(tmp_path: Path, point_format: int, extra: int) -> None:
    whole = cloud(tmp_path / "whole.laz", point_format, extra)
    layers = SIZES[point_format] + extra
    first = start(whole) + 8 + POINT[point_format] + extra + 4
    lengths = struct.unpack_from(f"<{layers}I", whole.read_bytes(), first)
    (table,) = struct.unpack_from("<q", whole.read_bytes(), start(whole))
    assert first + 4 * layers + sum(lengths) == table  # so these are the lengths of the layers, and all of them
    for layer in range(layers):
        for length in (lengths[layer] + 1, 2**31, 2**32 - 1):
            path = tmp_path / "a.laz"
            path.write_bytes(whole.read_bytes())
            with pytest.raises(TerrainError, match="the layers of its chunk 1 claim"):
                load(overwrite(path, first + 4 * layer, "<I", length))


@pytest.mark.parametrize("more", [1, 10_000, 2**31 - 10_000])
def test_chunks_are_no_longer_than_the_file(tmp_path: Path, more: int) -> None:
    """The table is written anew: it is compressed."""
    path = cloud(tmp_path / "a.laz")
    declared = lazrs.LazVlr(path.read_bytes()[record(path) :][:40])
    (table,) = struct.unpack_from("<q", path.read_bytes(), start(path))
    with path.open("r+b") as file:
        file.seek(start(path))
        ((points, length),) = lazrs.read_chunk_table(file, declared)
        assert length == table - start(path) - 8
        file.seek(table)
        lazrs.write_chunk_table(file, [(points, length + more)], declared)
    with pytest.raises(TerrainError, match=f"its 1 chunks claim {length + more:,} of {length:,} bytes"):
        load(path)


def test_no_more_chunks_than_bytes(tmp_path: Path) -> None:
    path = cloud(tmp_path / "a.laz")
    (table,) = struct.unpack_from("<q", path.read_bytes(), start(path))
    with pytest.raises(TerrainError, match="it claims 2,000,000,000 chunks"):
        load(overwrite(path, table + 4, "<I", 2_000_000_000))


def test_the_table_lies_in_the_file(tmp_path: Path) -> None:
    path = cloud(tmp_path / "a.laz")
    with pytest.raises(TerrainError, match="table of chunks is not in the file"):
        load(overwrite(path, start(path), "<q", 10**12))


@pytest.mark.parametrize("point_format", [3, 6])
def test_a_chunk_fits_into_memory(tmp_path: Path, point_format: int) -> None:
    path = cloud(tmp_path / "a.laz", point_format)
    with pytest.raises(TerrainError, match="it has a chunk of 4,000,000,000 points, but at most"):
        load(overwrite(path, record(path) + 12, "<I", 4_000_000_000))


def test_points_have_one_length(tmp_path: Path) -> None:
    """The record's first item, at byte 34, has a type and a size."""
    path = cloud(tmp_path / "a.laz", 6)
    with pytest.raises(TerrainError, match="its points are 30 bytes long, but 65,000 by its LASzip record"):
        load(overwrite(path, record(path) + 36, "<H", 65_000))


def test_points_say_how_they_are_compressed(tmp_path: Path) -> None:
    path = cloud(tmp_path / "a.laz")
    path.write_bytes(path.read_bytes().replace(b"laszip encoded", b"laszip_encoded"))
    with pytest.raises(TerrainError, match="no record says how"):
        load(path)
