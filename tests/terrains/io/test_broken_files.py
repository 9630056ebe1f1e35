"""Damaged files of every kind, drawn at random: one clear error or a stated repair, no crash, no hang, no silent hole.

``AORO_GYM_MUTATIONS=5000 python -m pytest tests/terrains/io/test_broken_files.py`` tries more than the few of the suite.
"""

import os
import signal
from collections import Counter
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import trimesh

from aoro_gym.terrains import Terrain, TerrainError, load

MUTATIONS = int(os.environ.get("AORO_GYM_MUTATIONS", "20"))
"""Damaged files of each kind."""
LONGEST = 60
"""Time [s] that one small file may take; a loaded computer included, a hang is longer."""


def heights() -> np.ndarray:
    x, y = np.meshgrid(np.arange(25.0), np.arange(21.0))
    return 100.0 + 0.1 * x + np.sin(0.3 * y)


def sources(folder: Path) -> dict[str, bytes]:
    """Small whole files, by suffix."""
    z = heights()
    ground = Terrain.from_heights(z, cell=1.0)
    mesh = trimesh.Trimesh(ground.vertices.copy(), ground.faces.copy(), process=False)
    for suffix in (".ply", ".obj", ".stl", ".off"):
        mesh.export(folder / f"ground{suffix}")
    x, y, height = ground.vertices.T
    trimesh.Trimesh(np.stack([x, height, -y], axis=1), ground.faces.copy(), process=False).export(folder / "ground.glb")
    mesh.export(folder / "text.ply", encoding="ascii")
    place = rasterio.Affine(1.0, 0.0, 430_000.0, 0.0, -1.0, 5_150_000.0)
    for name, more in (
        ("ground.tif", {}),
        ("packed.tif", {"compress": "deflate", "tiled": True, "blockxsize": 16, "blockysize": 16}),
    ):
        with rasterio.open(
            folder / name,
            "w",
            driver="GTiff",
            height=21,
            width=25,
            count=1,
            dtype="float32",
            crs="EPSG:32632",
            transform=place,
            nodata=-9999.0,
            **more,
        ) as file:
            file.write(z.astype("float32"), 1)
    rows = "\n".join(" ".join(f"{value:.3f}" for value in row) for row in z)
    (folder / "ground.asc").write_text(
        f"ncols 25\nnrows 21\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9999\n{rows}\n"
    )
    points = np.array(ground.vertices)
    np.savetxt(folder / "ground.xyz", points, fmt="%.3f")
    np.save(folder / "ground.npy", z)
    header = laspy.LasHeader(version="1.2", point_format=1)
    header.offsets, header.scales = np.array([430_000.0, 5_150_000.0, 0.0]), np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = (points + np.array([430_000.0, 5_150_000.0, 0.0])).T
    cloud.classification = np.full(len(points), 2, dtype=np.uint8)
    for suffix in (".las", ".laz"):
        cloud.write(str(folder / f"ground{suffix}"))
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """``content`` with bytes changed, cut out, doubled, or cut off; headers suffer most."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        if not data:
            break
        end = len(data) if rng.random() < 0.5 else min(len(data), 400)
        at = int(rng.integers(0, end))
        kind = rng.integers(0, 7)
        if kind == 0:
            data[at] = int(rng.integers(0, 256))
        elif kind == 1:
            data[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 2:
            size = int(rng.integers(1, 9))
            data[at : at + size] = rng.bytes(min(size, len(data) - at))
        elif kind == 3:
            word = rng.choice(
                [
                    b"\xff\xff\xff\x7f",
                    b"\x00\x00\xc0\x7f",
                    b"\xff\xff\xff\xff",
                    b"\x00\x00\x00\x00",
                    b" nan ",
                    b" -1 ",
                    b"1e30",
                ]
            )
            data[at : at + len(word)] = word[: len(data) - at]
        elif kind == 4:
            del data[at : at + int(rng.integers(1, 200))]
        elif kind == 5:
            data[at:at] = data[at : at + int(rng.integers(1, 200))]
        else:
            del data[max(1, int(rng.integers(0, len(data)))) :]
    return bytes(data)


def silent_holes(terrain: Terrain, report, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Places within the extent without a triangle that no hole of the report names."""
    low, high = (bound[:2] for bound in terrain.extent)
    inset = 1.01 if report.cell_m is None else 0.0  # kept triangles are measured on a grid of at most 1 m
    if np.any(high - low <= 2.0 * inset):
        return []
    points = rng.uniform(low + inset, high - inset, (30, 2))
    a, b, c = (terrain.vertices[terrain.faces[:, i], :2] for i in range(3))
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    bad = []
    for x, y in points:
        w = np.array([x, y]) - a
        with np.errstate(divide="ignore", invalid="ignore"):
            s, t = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area, (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
        covered = np.any((s >= -1e-9) & (t >= -1e-9) & (s + t <= 1.0 + 1e-9))
        if not covered and not any(h.west <= x <= h.east and h.south <= y <= h.north for h in report.holes):
            bad.append((x, y))
    return bad


class Hang(BaseException):
    """One file took longer than ``LONGEST``."""


@pytest.fixture
def watch():
    """Raises ``Hang`` in the middle of what takes too long."""

    def ring(*_):
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    yield lambda: signal.alarm(LONGEST)
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


NAMES = (
    "ground.asc",
    "ground.glb",
    "ground.las",
    "ground.laz",
    "ground.npy",
    "ground.obj",
    "ground.off",
    "ground.ply",
    "ground.stl",
    "ground.tif",
    "ground.xyz",
    "packed.tif",
    "text.ply",
)


@pytest.mark.parametrize("name", NAMES)
def test_damage_is_refused_or_repaired(tmp_path, watch, monkeypatch, name):
    # A damaged number can stretch a file over kilometres; a small limit keeps such grids small.
    monkeypatch.setattr("aoro_gym.terrains.io.frame.MOST_NODES", 50_000)
    content = sources(tmp_path)[name]
    rng = np.random.default_rng([7, *name.encode()])
    outcomes: Counter[str] = Counter()
    for index in range(MUTATIONS + 1):
        path = tmp_path / f"damaged_{name}"
        path.write_bytes(mutated(content, rng) if index else content)
        watch()
        try:
            terrain, report = load(path, cell=1.0 if name.endswith(".npy") else None)
        except TerrainError as error:
            assert index > 0, f"the whole file is refused: {error}"
            assert "\n" not in str(error)
            assert len(str(error)) < 600
            outcomes["refused"] += 1
        except OSError as error:
            raise AssertionError(f"mutation {index} of {name}: {error!r} is no TerrainError") from error
        else:
            assert np.isfinite(terrain.vertices).all()
            assert silent_holes(terrain, report, rng) == [], f"mutation {index} of {name}"
            outcomes["loaded"] += 1
    assert outcomes["loaded"] > 0
    assert outcomes["refused"] > 0 or MUTATIONS < 40
