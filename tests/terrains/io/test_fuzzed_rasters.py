"""Damaged rasters and arrays: whatever happens to their bytes, they are read or refused in one line, without delay."""

import tempfile
import time
import warnings
from pathlib import Path as File

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp

from aoro_gym.terrains import load
from tests.damage import assert_refusal, fuzz

CORPUS = File(__file__).parents[1] / "corpus" / "rasters"
"""Files that were once answered otherwise."""
LONGEST_S = 10.0
"""Processor time that an answer may take; whole files take 10 ms."""
Z = 100.0 + np.add.outer(0.1 * np.arange(12), 0.2 * np.sin(np.arange(15)))


def _raster(suffix: str, driver: str, bands, dtype: str, crs: str, place, **more) -> bytes:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = File(folder) / f"g.{suffix}"
        with rasterio.open(
            path,
            "w",
            driver=driver,
            height=12,
            width=15,
            count=len(bands),
            dtype=dtype,
            crs=crs,
            transform=place,
            **more,
        ) as data:
            for number, band in enumerate(bands, 1):
                data.write(band.astype(dtype), number)
            if len(bands) > 1:
                data.colorinterp = [ColorInterp.gray, ColorInterp.alpha]
                data.scales, data.units = (0.01, 1.0), ("ftUS", "")
        return path.read_bytes()


def _array(z: np.ndarray) -> bytes:
    with tempfile.TemporaryFile() as file:
        np.save(file, z)
        file.seek(0)
        return file.read()


METRES = rasterio.Affine(1.0, 0.0, 430_000.0, 0.0, -1.0, 5_150_000.0)
TURNED = rasterio.Affine(0.9, 0.3, 2_671_667.0, 0.3, -0.9, 8_399_737.0)
DEGREES = rasterio.Affine(1e-5, 0.0, 24.0, 0.0, -1e-5, 60.0)
GRID = b"ncols 15\nnrows 12\nxllcorner 430000\nyllcorner 5150000\ncellsize 1.0\nNODATA_value -9999\n"
SEEDS: dict[str, list[bytes]] = {
    "tif": [
        _raster("tif", "GTiff", [Z], "float32", "EPSG:32632", METRES, nodata=-9999.0),
        _raster("tif", "GTiff", [Z * 100.0, np.full(Z.shape, 255)], "int16", "EPSG:3857", TURNED, compress="deflate"),
        _raster("tif", "GTiff", [Z], "float64", "EPSG:4326", DEGREES, tiled=True, blockxsize=16, blockysize=16),
    ],
    "img": [_raster("img", "HFA", [Z], "float32", "EPSG:32632", METRES)],
    "asc": [
        GRID + "\n".join(" ".join(f"{value:.2f}" for value in row) for row in Z).encode() + b"\n",
        GRID.replace(b"\n", b"\r\n") + " ".join(f"{value:.0f}" for value in Z.ravel()).encode(),
    ],
    "npy": [_array(Z), _array(np.rint(Z).astype(np.int16).T)],
}
TOKENS = (
    b"", b"\0", b"\n", b" ", b",", b"-", b"nan", b"inf", b"1e308", b"-1e308", b"9" * 400, b"0", b"1_0", b"-1", b"1e-400",
    b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f", b"\xff\xff\xff\xff", b"\x00\x00\x80\x7f", b"\x00\x00\x00\x00", b"ncols",
    b"\x00\x00\x00\x80", b"\x01\x00", b"\xff\xff", b"\x80", b"\x00\x00\x00\x00\x00\x00\xf0\x7f", b"II*\x00", b"MM\x00*",
    b"8388608", b"(9999999, 9999999)", b"|O", b"<c16", b"nodata_value", b"e", b"\x1a",
)  # fmt: skip


def answer(file: File) -> None:
    """Read the file, or be refused as everybody is to be refused."""
    began = time.process_time()
    try:
        terrain, report = load(file, cell=1.0 if file.suffix == ".npy" else None)
        assert np.isfinite(terrain.vertices).all()
        assert all("\n" not in text and len(text) < 700 for text in report.warnings)
        report.to_json()
    except ValueError as error:
        assert_refusal(error, file)
    assert time.process_time() - began < LONGEST_S


def damage(kind: str, file: File, examples: int) -> None:
    def answered(data: bytes) -> None:
        file.write_bytes(data)
        answer(file)

    fuzz(answered, SEEDS[kind], TOKENS, examples)


@pytest.fixture(autouse=True)
def _small_grids(monkeypatch):
    """A damaged number can stretch a file over kilometres; a small limit keeps such grids small."""
    monkeypatch.setattr("aoro_gym.terrains.io.frame.MOST_NODES", 50_000)


@pytest.mark.parametrize("kind", SEEDS)
def test_whole_files(tmp_path, kind):
    for data in SEEDS[kind]:
        file = tmp_path / f"a.{kind}"
        file.write_bytes(data)
        assert len(load(file, cell=1.0 if kind == "npy" else None).terrain.vertices) >= 100


@pytest.mark.parametrize("kind", SEEDS)
def test_damaged_files(tmp_path, kind):
    damage(kind, tmp_path / f"a.{kind}", 60)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SEEDS)
def test_many_damaged_files(tmp_path, kind):
    damage(kind, tmp_path / f"a.{kind}", 10_000)


@pytest.mark.parametrize("name", sorted(path.name for path in CORPUS.glob("*")))
def test_corpus(tmp_path, capfd, name):
    file = tmp_path / name
    file.write_bytes((CORPUS / name).read_bytes())
    answer(file)
    assert capfd.readouterr() == ("", "")
