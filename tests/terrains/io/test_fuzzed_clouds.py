"""Damaged clouds and meshes: whatever happens to their bytes, they are read or refused in one line, without delay."""

import signal
import tempfile
import time
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import trimesh
from laspy.vlrs.known import WktCoordinateSystemVlr

from aoro_gym.terrains import Terrain, load
from tests.damage import assert_refusal, fuzz

CORPUS = Path(__file__).parents[1] / "corpus" / "clouds"
"""Files that were once answered otherwise."""
LONGEST_S = 10.0
"""Processor time that an answer may take; whole files take 50 ms."""
HANG_S = 120
"""Time after which an answer is given up, on a loaded computer included."""

GROUND = Terrain.from_heights(100.0 + np.add.outer(0.1 * np.arange(9), 0.3 * np.sin(np.arange(10))), cell=1.0)
POINTS = np.asarray(GROUND.vertices, dtype=np.float64)
FAR = POINTS + np.array([430_000.0, 5_150_000.0, 0.0])


def _las(suffix: str, version: str, point_format: int, *records) -> bytes:
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.offsets, header.scales = np.array([430_000.0, 5_150_000.0, 0.0]), np.full(3, 0.001)
    for record in records:
        header.vlrs.append(record)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = FAR.T
    cloud.classification = np.full(len(FAR), 2, dtype=np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        cloud.write(str(Path(folder) / f"g.{suffix}"))
        return (Path(folder) / f"g.{suffix}").read_bytes()


def _mesh(kind: str, **options) -> bytes:
    data = trimesh.Trimesh(POINTS.copy(), GROUND.faces.copy(), process=False).export(file_type=kind, **options)
    return data.encode() if isinstance(data, str) else bytes(data)


def _points() -> bytes:
    data: Any = trimesh.PointCloud(POINTS).export(file_type="ply")
    return bytes(data)


def _text(before: str, separator: str, decimal: str, after: str = "") -> bytes:
    lines = (separator.join(f"{value:.3f}".replace(".", decimal) for value in point) + after for point in FAR)
    return (before + "\n".join(lines) + "\n").encode()


WKT = WktCoordinateSystemVlr('LOCAL_CS["site",UNIT["metre",1]]')
SEEDS: dict[str, list[bytes]] = {
    "las": [_las("las", "1.2", 1), _las("las", "1.4", 6, WKT)],
    "laz": [_las("laz", "1.2", 3), _las("laz", "1.4", 6)],
    "xyz": [_text("", " ", "."), _text("", "\t", ",", "\t7"), _text("// X Y Z\n90\n", " ", ".")],
    "csv": [_text("x [m],y [m],z [m]\n", ",", "."), _text("Rechtswert;Hochwert;Höhe;Code\n", ";", ",", ";Weg")],
    "pts": [_text("90\n", " ", ".", " -312 120 118 99")],
    "ply": [
        _mesh("ply"),
        _mesh("ply", encoding="ascii"),
        _points(),
    ],
    "obj": [_mesh("obj"), _mesh("obj").replace(b"f 1 2", b"f -90 -89")],
    "stl": [_mesh("stl"), _mesh("stl_ascii")],
    "off": [_mesh("off")],
    "glb": [_mesh("glb")],
    "gltf": [b'{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "children": [1]}, {}],'
             b'"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [{"bufferView": 0, "count": 4,'
             b'"componentType": 5126, "type": "VEC3"}], "bufferViews": [{"buffer": 0, "byteLength": 48}], "buffers":'
             b'[{"byteLength": 48, "uri": "data:application/octet-stream;base64,' + b"A" * 64 + b'"}]}'],
}  # fmt: skip
TOKENS = (
    b"", b"\0", b"\n", b" ", b",", b";", b".", b"-", b"nan", b"inf", b"1e308", b"-1e308", b"9" * 400, b"0", b"1_0", b"-1",
    b"1e12", b"1e-400", b"4", b"3", b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f", b"\xff\xff\xff\xff", b"\x00\x00\x80\x7f",
    b"\x00\x00\x00\x00", b"\x00\x00\x00\x80", b"\x01\x00", b"\xff\xff", b"\x80", b"\x00\x00\x00\x00\x00\x00\xf0\x7f",
    b"1000000000000", b"[" * 3000, b"{", b"\"", b"x", b"z", b"lat", b"double", b"list", b"#", b"\\\n", b"\r",
    b"\xef\xbb\xbf", b"endfacet", b"element", b"f 1 2 3\n", b"v 1 2\n", b"-9999", b"EPSG", b"\x1a", b"[/x]", b"$",
)  # fmt: skip


class Hang(BaseException):
    """An answer took longer than ``HANG_S``."""


def _ring(*_) -> None:
    raise Hang


def answer(file: Path, **wishes) -> bool:
    """Read the file, or be refused as everybody is to be refused; whether it was read."""
    began = time.process_time()
    signal.alarm(HANG_S)
    try:
        terrain, report = load(file, **wishes)
    except ValueError as error:
        assert_refusal(error, file)
        return False
    finally:
        signal.alarm(0)
        assert time.process_time() - began < LONGEST_S
    assert np.isfinite(terrain.vertices).all()
    assert all("\n" not in text and len(text) < 700 for text in report.warnings)
    report.to_json()
    return True


def damage(kind: str, file: Path, examples: int, **wishes) -> None:
    def answered(data: bytes) -> None:
        file.write_bytes(data)
        answer(file, **wishes)

    fuzz(answered, SEEDS[kind], TOKENS, examples)


@pytest.fixture(autouse=True)
def _bounded(monkeypatch):
    """A damaged number can stretch a file over kilometres; a small limit keeps such grids small. What hangs is given up."""
    monkeypatch.setattr("aoro_gym.terrains.io.frame.MOST_NODES", 20_000)
    before = signal.signal(signal.SIGALRM, _ring)
    yield
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("kind", SEEDS)
def test_whole_files_are_read(tmp_path, kind):
    for number, data in enumerate(SEEDS[kind]):
        file = tmp_path / f"whole{number}.{kind}"
        file.write_bytes(data)
        assert answer(file, ground="all", units="m") or kind == "gltf"


@pytest.mark.parametrize("kind", SEEDS)
def test_damaged_files_are_read_or_refused(tmp_path, kind):
    damage(kind, tmp_path / f"damaged.{kind}", 30, ground="all")


@pytest.mark.slow
@pytest.mark.parametrize("kind", SEEDS)
def test_many_damaged_files_are_read_or_refused(tmp_path, kind):
    damage(kind, tmp_path / f"damaged.{kind}", 10_000)


@pytest.mark.parametrize("file", sorted(CORPUS.glob("*")), ids=lambda file: file.name)
def test_what_was_once_answered_otherwise(tmp_path, capfd, file):
    copy = tmp_path / file.name
    copy.write_bytes(file.read_bytes())
    answer(copy)
    assert capfd.readouterr() == ("", "")
