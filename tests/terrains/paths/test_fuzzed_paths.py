"""Damaged files of paths: whatever happens to their bytes, they are read or refused in one line, without delay."""

import time
from pathlib import Path as File

import numpy as np
import pytest

from aoro_gym.terrains import Terrain, load_path
from tests.damage import assert_refusal, fuzz
from tests.terrains.lines import (
    collection,
    degrees,
    feature,
    gpx,
    gx_track,
    kml,
    kmz,
    line_string,
    placemark,
    positions,
    rte,
    straight,
    table,
    trk,
    wpt,
)

CORPUS = File(__file__).parents[1] / "corpus" / "paths"
"""Files that were once answered otherwise."""
LONGEST_S = 5.0
"""Time that an answer may take; whole files take 10 ms."""
LINE = straight(12.0, 0.5)
FAR = np.concatenate([LINE, straight(5.0, 0.5, start=(40.0, 0.0))])


SEEDS: dict[str, list[bytes]] = {
    "gpx": [
        gpx(trk(LINE, inside="<speed>1.5</speed>", name="a"), wpt(LINE[:2])).encode(),
        gpx(trk(LINE[:9], FAR[9:]), rte(LINE)).encode(),
    ],
    "kml": [
        kml(placemark(line_string(FAR), "a")).encode(),
        kml(placemark(gx_track(LINE)), placemark("<Polygon/>")).encode("utf-16"),
    ],
    "kmz": [kmz(kml(placemark(line_string(LINE), "a")))],
    "geojson": [
        collection(feature("LineString", positions(LINE), name="a")).encode(),
        collection(
            feature("MultiLineString", [positions(LINE), positions(FAR)]),
            crs={"type": "name", "properties": {"name": "EPSG:4326"}},
        ).encode(),
    ],
    "csv": [
        table(FAR, "x_m,y_m").encode(),
        ("lat;lon;speed (km/h)\n" + "".join(f"{a};{b};7,2\n".replace(".", ",") for a, b in degrees(LINE))).encode(),
        "".join(f"{x} {y}\n" for x, y in LINE).encode(),
    ],
}
TOKENS = (
    b"", b"\0", b"\n", b",", b";", b'"', b"<", b">", b"&", b"]", b"{", b"-", b"nan", b"inf", b"1e308", b"-1e308", b"1e12",
    b"9" * 400, b"0", b"1_0", b"180", b"-91", b"null", b"true", b"[", b"<trkseg>", b"</trkseg>", b"\xff\xfe",
    b"\xef\xbb\xbf", b"<!ENTITY a 'b'>", b" ", b"\t", b"#", b"PK\x03\x04", b"e", b"\xc3", b"10", b"x_km", b"lon",
)  # fmt: skip


GROUND = Terrain.from_heights(
    np.zeros((41, 41)), cell=2.0, corner=(-40.0, -40.0), crs="EPSG:32635", origin=(332_700.0, 6_655_200.0, 0.0)
)


def answer(file: File, terrain: Terrain | None) -> None:
    """Read the file, or be refused as everybody is to be refused."""
    began = time.perf_counter()
    try:
        path, report = load_path(file, terrain)
        assert np.isfinite(path.points).all()
        assert len(str(report)) < 4000
    except ValueError as error:
        assert_refusal(error, file)
    assert time.perf_counter() - began < LONGEST_S


def damage(kind: str, file: File, examples: int) -> None:
    def answered(data: bytes) -> None:
        file.write_bytes(data)
        for terrain in (GROUND, None):
            answer(file, terrain)

    fuzz(answered, SEEDS[kind], TOKENS, examples)


@pytest.mark.parametrize("kind", SEEDS)
def test_damaged_files(tmp_path, kind):
    damage(kind, tmp_path / f"a.{kind}", 60)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SEEDS)
def test_many_damaged_files(tmp_path, kind):
    damage(kind, tmp_path / f"a.{kind}", 10_000)


@pytest.mark.parametrize("kind", SEEDS)
def test_the_seeds_are_whole(tmp_path, kind):
    for seed in SEEDS[kind]:
        (tmp_path / f"a.{kind}").write_bytes(seed)
        path, _ = load_path(tmp_path / f"a.{kind}", track=1)
        assert path.length == pytest.approx(12.0, abs=0.1)


@pytest.mark.parametrize("file", sorted(CORPUS.glob("*")), ids=lambda file: file.name)
def test_files_that_were_answered_otherwise(tmp_path, file):
    copy = tmp_path / f"a{file.suffix}"
    copy.write_bytes(file.read_bytes())
    for terrain in (None, GROUND):
        answer(copy, terrain)
