"""ASCII grids: words are no heights, and values are as many as promised."""

import numpy as np
import pytest

from aoro_gym.terrains import TerrainError, load

N = 12
Z = 100.0 + np.add.outer(0.1 * np.arange(N), 0.2 * np.arange(N))
HEADER = {"ncols": N, "nrows": N, "xllcorner": 0, "yllcorner": 0, "cellsize": 1, "NODATA_value": -9999}


def grid(rows: str | None = None, mark: str = " ", **header) -> str:
    if rows is None:
        rows = "\n".join(" ".join(f"{value:.2f}" for value in row) for row in Z)
    return "".join(f"{key}{mark}{value}\n" for key, value in (HEADER | header).items()) + rows + "\n"


@pytest.mark.parametrize(
    "text",
    [
        grid(),
        grid(mark="\t\t").replace("\n", "\r\n"),
        grid(ncols="0012", cellsize="1.0"),
        grid().replace("ncols", "NCOLS"),
        grid().replace(".", ","),
        grid("\n".join(f"{value:.6e}" for value in Z.ravel())),
        grid(" ".join(f"{value:+.2f}" for value in Z.ravel()), NODATA_value="nan"),
        grid().replace("xllcorner 0", "xllcenter 0.5").replace("yllcorner 0", "yllcenter 0.5"),
    ],
)
def test_whole_grids(tmp_path, text):
    (tmp_path / "g.asc").write_bytes(text.encode())
    terrain, report = load(tmp_path / "g.asc")
    np.testing.assert_allclose(terrain.vertices[:, 2].reshape(N, N)[::-1], Z, atol=1e-5)
    assert report.warnings == []


def test_voids_as_nan(tmp_path):
    (tmp_path / "g.asc").write_text(grid().replace("101.30", "nan"))
    _, report = load(tmp_path / "g.asc", hole_limit=0.0)
    assert {change.what: change.count for change in report.changes}["unknown"] == int(np.isclose(Z, 101.3).sum())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (grid().replace("100.40", "abc"), "line 7: 'abc' is no number"),
        (grid().replace("100.40", "1_0"), "line 7: '1_0' is no number"),
        (grid(cellsize="1_0"), "line 5: cellsize is '1_0', which is no number"),
        (grid(ncols="9" * 400), "ncols is '9{40}'... .*positive integer"),
        (grid(ncols="-5"), "ncols is '-5'"),
        (grid(ncols=2_000_000_000, nrows=2_000_000_000), "it holds 144 values, but its header promises"),
        (grid(nrows=11), "it holds 144 values, but its header promises 132, so it is broken"),
        (grid()[:500], "so it is cut off"),
        (grid(cellsize="9" * 400), "the place or the size of its pixels"),
        (grid(xllcorner="9" * 400), "the place or the size of its pixels"),
        (grid(cellsize="0." + "0" * 399 + "1"), "the place or the size of its pixels"),
        (grid(cellsize="nan"), "the place or the size of its pixels"),
    ],
)
def test_broken_grids(tmp_path, text, message):
    (tmp_path / "[x] $g.asc").write_text(text)
    with pytest.raises(TerrainError, match=message.replace("...", r"\.\.\.,")) as caught:
        load(tmp_path / "[x] $g.asc")
    assert "[x] $g.asc" in str(caught.value)
    assert len(str(caught.value)) < 400
    assert "\n" not in str(caught.value)


def test_more_than_a_chunk(tmp_path, monkeypatch):
    monkeypatch.setattr("aoro_gym.terrains.io.ascii_grid.CHUNK", 7)
    (tmp_path / "g.asc").write_text(grid())
    assert load(tmp_path / "g.asc").terrain.vertices.shape == (N * N, 3)
    (tmp_path / "g.asc").write_text(grid().replace("100.40", "x00.40"))
    with pytest.raises(TerrainError, match="line 7: 'x"):
        load(tmp_path / "g.asc")
