"""Damaged files of paths: whatever happens to their bytes, they are read or refused in one line, without delay."""

import io
import time
import zipfile
from pathlib import Path as File

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aoro_gym.terrains import Terrain, load_path
from tests.terrains.lines import (
    collection,
    degrees,
    feature,
    gpx,
    gx_track,
    kml,
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


def _kmz() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("doc.kml", kml(placemark(line_string(LINE), "a")))
    return packed.getvalue()


SEEDS: dict[str, list[bytes]] = {
    "gpx": [
        gpx(trk(LINE, inside="<speed>1.5</speed>", name="a"), wpt(LINE[:2])).encode(),
        gpx(trk(LINE[:9], FAR[9:]), rte(LINE)).encode(),
    ],
    "kml": [
        kml(placemark(line_string(FAR), "a")).encode(),
        kml(placemark(gx_track(LINE)), placemark("<Polygon/>")).encode("utf-16"),
    ],
    "kmz": [_kmz()],
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


@st.composite
def damaged(draw: st.DrawFn, kind: str) -> bytes:
    """A seed with up to six places cut, copied, overwritten or filled in."""
    data = bytearray(draw(st.sampled_from(SEEDS[kind])))
    for _ in range(draw(st.integers(1, 6))):
        start = draw(st.integers(0, len(data)))
        size = draw(st.sampled_from((0, 0, 1, 2, 8, 60, 400)))
        how = draw(st.sampled_from(("token", "token", "byte", "cut", "copy")))
        if how == "token":
            data[start : start + size] = draw(st.sampled_from(TOKENS))
        elif how == "byte":
            data[start : start + 1] = draw(st.binary(min_size=1, max_size=2))
        elif how == "cut":
            del data[start : start + size]
        else:
            data[start:start] = data[start : start + size] * 3
    return bytes(data)


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
        message = str(error)
        assert message.startswith(str(file))
        assert "\n" not in message
        assert len(message) < len(str(file)) + 700
    assert time.perf_counter() - began < LONGEST_S


def fuzz(kind: str, file: File, examples: int) -> None:
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(damaged(kind), st.booleans())
    def run(data: bytes, on_ground: bool) -> None:
        file.write_bytes(data)
        answer(file, GROUND if on_ground else None)

    run()


@pytest.mark.parametrize("kind", SEEDS)
def test_damaged_files(tmp_path, kind):
    fuzz(kind, tmp_path / f"a.{kind}", 60)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SEEDS)
def test_many_damaged_files(tmp_path, kind):
    fuzz(kind, tmp_path / f"a.{kind}", 10_000)


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
