"""Clouds as text: every dialect and every usual name of a column gives the same ground; what is unclear is refused."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from aoro_gym.terrains import TerrainError, load, to_local

CORNER = np.array([500_000.0, 6_650_000.0])


def height(x, y):
    return 150.0 + 0.1 * x - 0.05 * y


def points(shift=CORNER) -> np.ndarray:
    """A plane of 21 x 21 points, one a cell, in no order that a column could be told by."""
    x, y = np.meshgrid(np.arange(21.0), np.arange(21.0))
    xyz = np.column_stack([x.ravel() + shift[0], y.ravel() + shift[1], height(x, y).ravel()])
    return xyz[np.random.default_rng(0).permutation(len(xyz))]


def rows(columns, separator=" ", decimal=".", digits=2) -> str:
    """Lines of numbers (floats with ``digits``, whole numbers and words as they are)."""

    def cell(value) -> str:
        return f"{value:.{digits}f}".replace(".", decimal) if isinstance(value, float) else str(value)

    return "".join(separator.join(cell(value) for value in row) + "\n" for row in zip(*columns, strict=True))


def xyz_rows(**options) -> str:
    return rows(points().T.tolist(), **options)


def read(path: Path, text: str | bytes, **options):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load(path, cell=1.0, ground="all", **options)


def assert_plane(terrain, shift=CORNER) -> None:
    x, y, z = (terrain.vertices + np.asarray(terrain.origin)).T
    np.testing.assert_allclose(z, height(x - shift[0], y - shift[1]), atol=1e-5)
    np.testing.assert_allclose(np.ptp([x, y], axis=1), 20.0, atol=1e-3)
    assert len(z) == 441


def changes(report) -> dict[str, int]:
    return {change.what: change.count for change in report.changes}


def texts(report) -> str:
    return "; ".join([change.text for change in report.changes] + report.warnings)


BOM = "\ufeff"
DIALECTS = {
    "blanks": xyz_rows(),
    "tabs": xyz_rows(separator="\t"),
    "commas": xyz_rows(separator=","),
    "commas and blanks": xyz_rows(separator=", "),
    "semicolons": xyz_rows(separator=";"),
    "decimal commas, blanks": xyz_rows(decimal=","),
    "decimal commas, semicolons": xyz_rows(separator=";", decimal=","),
    "decimal commas, tabs": "X\tY\tZ\n" + xyz_rows(separator="\t", decimal=","),
    "decimal commas, names": "X;Y;Z\n" + xyz_rows(separator=";", decimal=","),
    "aligned": "".join("   " + line.replace(" ", "    ") + "\n" for line in xyz_rows().splitlines()),
    "trailing separators": xyz_rows(separator=",").replace("\n", ",\n"),
    "exponents": "".join(" ".join(f"{value:.8e}" for value in row) + "\n" for row in points()),
    "lines of Windows": "x y z\n".replace("\n", "\r\n") + xyz_rows().replace("\n", "\r\n"),
    "a byte order mark": BOM + "x,y,z\n" + xyz_rows(separator=","),
    "comments": "# made here\n// and there\n" + xyz_rows().replace("\n", "\n\n", 3) + "# the end\n",
    "names in a comment": "//X Y Z\n" + xyz_rows(),
    "quotes": '"x","y","z"\n' + xyz_rows(separator=","),
    "a unit line": "x,y,z\nm,m,m\n" + xyz_rows(separator=","),
    "a count": "441\n" + xyz_rows(),
    "a count after names": "//X Y Z\n441\n" + xyz_rows(),
    "counts of two stations": "200\n" + (lines := xyz_rows().splitlines(keepends=True), "".join(lines[:200]))[1]
    + "241\n" + "".join(xyz_rows().splitlines(keepends=True)[200:]),
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".xyz", ".csv"])
@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS)
def test_every_dialect_is_the_same_ground(tmp_path, suffix, text):
    terrain, report = read(tmp_path / f"cloud{suffix}", text)
    assert_plane(terrain)
    assert report.points_read == 441
    assert report.warnings == []
    assert set(changes(report)) == {"shifted"}


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_encodings(tmp_path, encoding):
    text = "Rechtswert;Hochwert;Höhe;Straße\n" + rows([*points().T.tolist(), ["Weg"] * 441], separator=";", decimal=",")
    terrain, report = read(tmp_path / "cloud.csv", text.encode(encoding))
    assert_plane(terrain)
    assert "Straße" in texts(report)


HEADERS = [
    "x,y,z",
    "X,Y,Z",
    "X [m],Y [m],Z [m]",
    "E(m),N(m),H(m)",
    "easting,northing,elevation",
    "Easting_m,Northing_m,Height_m",
    "E,N,Alt",
    "EASTING,NORTHING,ALTITUDE",
    "Rechtswert,Hochwert,Höhe",
    "rw,hw,hoehe",
    "x_coord,y_coord,z_coord",
    "POINT_X,POINT_Y,POINT_Z",
    "utm_easting,utm_northing,orthometric_height",
    "east (m),north (m),elev (m)",
]


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
def test_columns_are_read_by_their_names(tmp_path, header, order):
    names, columns = header.split(","), points().T.tolist()
    text = ",".join(["point", *(names[i] for i in order), "code"]) + "\n"
    text += rows([range(1, 442), *(columns[i] for i in order), ["GND"] * 441], separator=",")
    terrain, report = read(tmp_path / "survey.csv", text)
    assert_plane(terrain)
    assert "columns not read: point, code" in texts(report)


def test_units_of_names_are_taken(tmp_path):
    x, y, z = points().T
    feet, survey = 0.3048, 1200.0 / 3937.0
    for header, scales, crs in (
        ("E [ft],N [ft],Z [ft]", (feet, feet, feet), None),
        ("easting (US ft),northing (US ft),elevation (US ft)", (survey, survey, survey), None),
        ("x_m,y_m,z_ft", (1.0, 1.0, feet), None),
        ("x [km],y [m],z [cm]", (1000.0, 1.0, 0.01), None),
        ("x,y,z_ft", (1.0, 1.0, feet), "EPSG:32635"),
    ):
        columns = [list(map(float, values / scale)) for values, scale in zip((x, y, z), scales, strict=True)]
        terrain, _ = read(tmp_path / "units.csv", header + "\n" + rows(columns, separator=",", digits=7), crs=crs)
        assert_plane(terrain)
    with pytest.raises(TerrainError, match="has the unit 'parsec', which is unknown"):
        read(tmp_path / "units.csv", "x [m],y [m],z [parsec]\n" + xyz_rows(separator=","))


DEGREES = ("latitude,longitude,elevation", "lat,lon,height", "Lat [deg],Lng [deg],Alt [m]", "Breite,Länge,Höhe")


@pytest.mark.parametrize("header", DEGREES)
def test_degrees_are_brought_to_metres(tmp_path, header):
    x, y, z = points().T
    change = pyproj.Transformer.from_crs("EPSG:32635", "EPSG:4326", always_xy=True)
    longitude, latitude = change.transform(x, y)
    text = header + "\n" + rows([latitude.tolist(), longitude.tolist(), z.tolist()], separator=",", digits=10)
    terrain, report = read(tmp_path / "gps.csv", text)
    assert terrain.crs == "EPSG:32635"
    x, y, z = (terrain.vertices + np.asarray(terrain.origin)).T
    np.testing.assert_allclose(z, height(x - CORNER[0], y - CORNER[1]), atol=2e-3)
    assert "taken as WGS 84 (EPSG:4326)" in texts(report)
    _, report = read(tmp_path / "gps.csv", text, crs="EPSG:4258")
    assert "crs" not in changes(report)
    with pytest.raises(TerrainError, match="latitude and longitude, but crs = 'EPSG:32635' counts in metres"):
        read(tmp_path / "gps.csv", text, crs="EPSG:32635")
    assert len(to_local(terrain, [60.0], [24.0])) == 2


def test_degrees_without_names_are_asked_about(tmp_path):
    x, y, z = points().T
    text = rows([(27.0 + (x - CORNER[0]) / 55_800.0).tolist(), (60.0 + (y - CORNER[1]) / 111_412.0).tolist(), z.tolist()],
                digits=8)  # fmt: skip
    with pytest.raises(TerrainError, match=r"as if in degrees.*crs='EPSG:4326'"):
        read(tmp_path / "gps.xyz", text)
    terrain, _ = read(tmp_path / "gps.xyz", text, crs="EPSG:4326")
    assert terrain.crs == "EPSG:32635"


def test_classes_by_name(tmp_path):
    xyz = np.concatenate([points(), points() - np.array([0.0, 0.0, 30.0])])
    columns = [*xyz.T.tolist(), [2] * 441 + [7] * 441]
    terrain, report = read(tmp_path / "cloud.csv", "x,y,z,Classification\n" + rows(columns, separator=","))
    assert_plane(terrain)
    assert changes(report)["noise_points"] == 441


def test_places_by_position(tmp_path):
    columns = points().T.tolist()
    terrain, report = read(tmp_path / "cloud.xyz", rows([*columns, [7] * 441, [0.5] * 441]))
    assert_plane(terrain)
    assert "no header: columns 1, 2, 3 are read as x, y and z" in texts(report)
    assert changes(report)["unread_columns"] == 2
    terrain, report = read(tmp_path / "cloud.xyz", rows([range(1, 442), *columns]))
    assert_plane(terrain)
    assert "column 1 counts the points" in texts(report)
    terrain, report = read(tmp_path / "cloud.xyz", rows([[f"P{i}" for i in range(441)], *columns, ["tree"] * 441]))
    assert_plane(terrain)
    assert changes(report)["unread_columns"] == 2


def test_a_profile_of_whole_metres_counts_nothing(tmp_path):
    x, y = np.meshgrid(np.arange(1.0, 31.0), np.arange(20.0))
    columns = [[int(v) for v in x.ravel()], y.ravel().tolist(), height(x, y).ravel().tolist(), [1] * 600]
    terrain, report = read(tmp_path / "grid.xyz", rows(columns))
    np.testing.assert_allclose(terrain.extent[1][:2] - terrain.extent[0][:2], [29.0, 19.0])
    assert "counts the points" not in texts(report)


@pytest.mark.parametrize("name", ["a,b,c", "id,length,width,depth", "time_s,steering_signal,angle", "x,y", "lat,z,h"])
def test_unknown_names_are_refused_with_these_names(tmp_path, name):
    columns = [points()[:, 0].tolist()] * len(name.split(","))
    with pytest.raises(TerrainError, match="its columns are named " + name.replace(",", ", ")) as caught:
        read(tmp_path / "table.csv", name + "\n" + rows(columns, separator=","))
    assert "\n" not in str(caught.value)


def test_too_few_points_are_named(tmp_path):
    lines = xyz_rows().splitlines(keepends=True)
    for text in ("441\n" + "".join(lines[:300]), "//X Y Z\n441\n" + "".join(lines[:300])):
        with pytest.raises(TerrainError, match="declares 441 points, but 300 follow; it is cut off"):
            read(tmp_path / "cut.pts", text)
    with pytest.raises(TerrainError, match="1,000,000,000,000 points, but 441 follow"):
        read(tmp_path / "cut.pts", "1000000000000\n" + xyz_rows())
    terrain, report = read(tmp_path / "more.pts", "400\n" + xyz_rows())
    assert_plane(terrain)
    assert any("declares 400 points, but 441 follow: all are read" in text for text in report.warnings)


def test_blank_and_missing_heights_are_left_out(tmp_path):
    lines = xyz_rows(separator=",").splitlines()
    lines += [f"{CORNER[0] + 3:.2f},{CORNER[1] + 4:.2f},{word}" for word in ("", "nan", "NaN", "n/a", "-")]
    terrain, report = read(tmp_path / "gaps.csv", "x,y,z\n" + "\n".join(lines) + "\n")
    assert_plane(terrain)
    assert changes(report)["broken_points"] == 5


def test_a_choice_between_columns_is_said(tmp_path):
    x, y, z = points().T.tolist()
    text = "easting,northing,ellipsoidal height,elevation\n" + rows([x, y, [0.5] * 441, z], separator=",")
    terrain, report = read(tmp_path / "two.csv", text)
    assert_plane(terrain)
    assert "z is read from column elevation, not from ellipsoidal height" in texts(report)


@pytest.mark.parametrize("at", [5, 300])
@pytest.mark.parametrize("header", ["", "x,y,z,intensity\n"])
def test_a_word_among_numbers_moves_no_column(tmp_path, at, header):
    lines = rows([*points().T.tolist(), [7] * 441], separator=",").splitlines()
    lines[at] = "500003.00,6650003.00,1.50.00,7"
    line = at + 1 + bool(header)
    with pytest.raises(TerrainError, match=rf"line {line}: '1\.50\.00' in column 3 is not a number"):
        read(tmp_path / "word.csv", header + "\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1.0 2.0", "line 301"),
        ("500010 6650010 wood", "line 301: 'wood' in column 3 is not a number"),
        ("500_010 6650010 151.0", "line 301: '500_010'"),
        ("500010 0x10 151.0", "line 301: '0x10'"),
    ],
)
def test_a_line_that_is_none_is_named(tmp_path, line, message):
    lines = xyz_rows().splitlines()
    lines[300:300] = [line]
    with pytest.raises(TerrainError, match=message) as caught:
        read(tmp_path / "line.xyz", "\n".join(lines) + "\n")
    assert str(caught.value).startswith(str(tmp_path / "line.xyz"))


@pytest.mark.parametrize(
    "content", [b"", b"\n\n", b"1 2\n3 4\n", b"x y z\n", b"\x00\x01\x02" * 50, b"words and no numbers\n" * 30, b"7\n"]
)
def test_no_cloud_is_one_clear_error(tmp_path, content):
    with pytest.raises(TerrainError) as caught:
        read(tmp_path / "none.xyz", content)
    assert "\n" not in str(caught.value)
    assert "none.xyz" in str(caught.value)


def test_names_that_are_markup_are_shown_as_they_are(tmp_path):
    with pytest.raises(TerrainError, match=r"named \[/x\], \$b, \{c\}"):
        read(tmp_path / "markup.csv", "[/x],$b,{c}\n" + xyz_rows(separator=","))


def test_chunks_do_not_matter(tmp_path, monkeypatch):
    monkeypatch.setattr("aoro_gym.terrains.io.read_text_cloud.CHUNK", 50)
    for name in ("decimal commas, names", "comments", "counts of two stations"):
        terrain, report = read(tmp_path / "cloud.xyz", DIALECTS[name])
        assert_plane(terrain)
        assert report.points_read == 441
    lines = xyz_rows().splitlines()
    lines[300] = "500010 6650010 wood"
    with pytest.raises(TerrainError, match=r"^[^:]*cloud\.xyz, line 301: 'wood' in column 3") as caught:
        read(tmp_path / "cloud.xyz", "\n".join(lines))
    assert str(caught.value).count("cloud.xyz") == 1


@pytest.mark.parametrize(
    ("separator", "thousands", "decimal"),
    [
        (";", ",", "."),
        (" ", ",", "."),
        (";", ".", ","),
        ("\t", ".", ","),
        (";", "'", "."),
        ("\t", "\u202f", ","),
        (";", "’", "."),
    ],
)
def test_separators_of_thousands_are_named(tmp_path, separator, thousands, decimal):
    def cell(value):
        return f"{value:,.2f}".replace(".", "?").replace(",", thousands).replace("?", decimal)

    text = "".join(separator.join(cell(value) for value in row) + "\n" for row in points())
    with pytest.raises(
        TerrainError, match=r"a\.xyz: its numbers have separators of thousands \(.*\); write it without them$"
    ):
        read(tmp_path / "a.xyz", text)
