"""Paths in tables: quantities by name and unit, whatever the dialect; what is not read, missing or ambiguous is said."""

import numpy as np
import pytest

from aoro_gym.terrains import load_path

X = np.arange(30.0)
Y = 0.002 * X**2


def loaded(tmp_path, text, **options):
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    return load_path(tmp_path / "a.csv", **options)


def refusal(tmp_path, text) -> str:
    with pytest.raises(ValueError) as caught:
        loaded(tmp_path, text)
    message = str(caught.value).removeprefix(str(tmp_path))
    assert message.startswith("/a.csv: ")
    assert message.count("a.csv") == 1
    assert "\n" not in message
    assert len(message) < 400
    return message


def rows(*columns, header: str, mark: str = ",") -> str:
    return header + "\n" + "".join(mark.join(f"{v}" for v in row) + "\n" for row in zip(*columns, strict=True))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed_kmh", 7.2),
        ("speed_km_per_h", 7.2),
        ("Speed (km/h)", 7.2),
        ("Speed [kph]", 7.2),
        ("v / km/h", 7.2),
        ("GPS Speed km/h", 7.2),
        ("speed_knots", 7.2 / 1.852),
        ("SOG (kn)", 7.2 / 1.852),
        ("speed_mph", 7.2 / 1.609344),
        ("ground_speed_m_per_s", 2.0),
        ("speed_mps", 2.0),
        ("speed_ms", 2.0),
        ("velocity [m/s]", 2.0),
        ("target_speed", 2.0),
        ("Speed (cm/s)", 200.0),
        ("speed_mm_per_s", 2000.0),
        ("velocity (ft/s)", 2.0 / 0.3048),
    ],
)
def test_speed_by_its_unit(tmp_path, name, value):
    path, report = loaded(tmp_path, rows(X, Y, np.full(30, value), header=f"x_m,y_m,{name}"))
    assert path.speed is not None
    np.testing.assert_allclose(path.speed, 2.0, rtol=1e-12)
    assert not report.warnings
    if name == "target_speed":
        assert "'target_speed' names no unit: taken for m/s" in str(report)


@pytest.mark.parametrize(
    ("header", "size"),
    [
        ("x,y", 1.0),
        ("X [m],Y [m]", 1.0),
        ("pos_x,pos_y", 1.0),
        ("Position X (cm),Position Y (cm)", 0.01),
        ("x_mm,y_mm", 0.001),
        ("easting_ft,northing_ft", 0.3048),
        ("East (km),North (km)", 1000.0),
        ("e,n", 1.0),
        ("local_x_m,local_y_m", 1.0),
    ],
)
def test_places_by_their_unit(tmp_path, header, size):
    path, _ = loaded(tmp_path, rows(X / size, Y / size, header=header), spacing=None)
    np.testing.assert_allclose(path.points, np.stack([X, Y], axis=1), atol=1e-9)


@pytest.mark.parametrize(
    "header", ["lat,lon", "Latitude [deg],Longitude [deg]", "gps_lat_rad,gps_lon_rad", "LatDeg,LonDeg"]
)
def test_degrees_by_their_unit(tmp_path, header):
    latitude = 60.0 + 1e-5 * X
    turn = np.pi / 180.0 if "rad" in header else 1.0
    path, report = loaded(tmp_path, rows(latitude * turn, np.full(30, 24.0 * turn), header=header))
    assert path.length == pytest.approx(29.0 * 1.11412, rel=1e-4)
    assert report.tangent_point == pytest.approx((60.0, 24.0))


@pytest.mark.parametrize(
    ("encoding", "mark", "comma"),
    [("utf-8", ";", True), ("utf-16", "\t", False), ("cp1252", ",", False), ("utf-8", "\t", True)],
)
def test_any_dialect(tmp_path, encoding, mark, comma):
    text = "# Rückegasse\n" + rows(X, Y, np.full(30, 7.2), header=f"x [m]{mark}y [m]{mark}speed [km/h]", mark=mark)
    (tmp_path / "a.csv").write_bytes((text.replace(".", ",") if comma else text).encode(encoding))
    path, _ = load_path(tmp_path / "a.csv", spacing=None)
    np.testing.assert_allclose(path.points, np.stack([X, Y], axis=1), atol=1e-9)
    np.testing.assert_allclose(path.speed_at(3.0), 2.0)


def test_a_unit_line(tmp_path):
    path, _ = loaded(tmp_path, rows(X * 100, Y * 100, np.full(30, 7.2), header="x,y,speed\ncm,cm,km/h"), spacing=None)
    np.testing.assert_allclose(path.points, np.stack([X, Y], axis=1), atol=1e-9)
    np.testing.assert_allclose(path.speed_at(3.0), 2.0)


def test_only_used_columns_must_be_numbers(tmp_path):
    when = [f"2025-05-01T10:00:{i:02d}Z" for i in range(30)]
    text = rows(when, X, Y, ["fix"] * 30, [""] * 30, header="time,x,y,quality,[/x] $a$")
    path, report = loaded(tmp_path, text)
    assert path.length == pytest.approx(29.06, abs=0.1)
    assert report.unread == "columns time, quality, [/x] $a$"
    assert "not read: columns time, quality, [/x] $a$" in str(report)


def test_blank_and_wrong_speeds(tmp_path):
    speed = [f"{1 + 0.1 * i:.1f}" for i in range(30)]
    speed[3], speed[29], speed[10] = "", "nan", "n/a"
    path, report = loaded(tmp_path, rows(X, Y, speed, header="x,y,speed_mps"), spacing=None)
    assert path.speed is not None
    np.testing.assert_allclose(path.speed, np.minimum(1.0 + 0.1 * np.arange(30), 3.8))
    assert "3 of 30 points have no speed: interpolated" in str(report)
    some = ["1.0" if i < 10 else "" for i in range(30)]
    path, report = loaded(tmp_path, rows(X, Y, some, header="x,y,speed_mps"))
    assert path.speed is None
    assert report.warnings == ["no speed is read: 20 of 30 points have none"]
    none = loaded(tmp_path, rows(X, Y, [""] * 30, header="x,y,speed_mps"))
    assert none.path.speed is None
    assert "30 of 30" in none.report.warnings[0]
    said = refusal(tmp_path, rows(X, Y, -X, header="x,y,speed_mps"))
    assert "its speed at point 2 (line 3) is -1 m/s, but must be finite and at least 0" in said
    assert "line 2: speed_mps = 'fast' is not a" in refusal(tmp_path, rows(X, Y, ["fast"] * 30, header="x,y,speed_mps"))


def test_two_columns_for_one_quantity_are_named(tmp_path):
    text = rows(X, Y, np.full(30, 1.0), np.full(30, 7.2), header="x,y,gps_speed_mps,target_speed_kmh")
    path, report = loaded(tmp_path, text)
    np.testing.assert_allclose(path.speed_at(1.0), 2.0)
    assert report.warnings == ["'target_speed_kmh' is taken for the speed to drive, not gps_speed_mps"]
    assert "gps_speed_mps" in report.unread
    text = rows(X + 9, Y, X, Y, header="true_x_m,true_y_m,x_m,y_m")
    path, report = loaded(tmp_path, text, spacing=None)
    np.testing.assert_allclose(path.points[:, 0], X)
    assert report.warnings == ["x_m, y_m are taken for its places, not true_x_m, true_y_m"]
    text = rows(X, X + 3e5, Y, Y + 6e6, header="x,easting,y,northing")
    path, report = loaded(tmp_path, text, spacing=None)
    np.testing.assert_allclose(path.points, np.stack([X, Y], axis=1))
    assert "not easting, northing" in report.warnings[0]


def test_units_that_nobody_knows(tmp_path):
    report = loaded(tmp_path, rows(X, Y, X, header="x,y,speed [furlong/h]")).report
    assert report.warnings == ["'speed [furlong/h]' is not read: its unit 'furlong/h' is no known speed"]
    said = refusal(tmp_path, rows(X, Y, header="x [parsec],y [parsec]"))
    assert "the unit of 'x [parsec]' is not known; convert it, and name the column x_m" in said


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,1\n2,z\n3,1\n", "line 3: y = 'z' is not a"),
        ("x,y\n1,1\n1_0,2\n", "line 3: x = '1_0' is not a"),
        (f"x,y\n1,1\n{'9' * 400},2\n", "line 3: x = '999"),
        ("x,x,y\n1,1,2\n2,2,3\n", "the header names the column 'x' twice"),
        ("h" * 5000 + ",b\n1,2\n", "but must name latitude and longitude [deg], or x and y [m]"),
        ("1\n2\n3\n", "it has one column"),
        ("\n\n", "it has no lines"),
        ("x,y\n", "rows"),
        ("x,y\n1,2,3\n1,2\n", "line"),
    ],
)
def test_broken_tables_are_refused_in_a_line(tmp_path, text, message):
    assert message in refusal(tmp_path, text)


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("Rechtswert [m];Hochwert [m];Geschwindigkeit [km/h]", (1.0, 1.0, 3.6)),
        ("Ostwert;Nordwert;Vitesse (m/s)", (1.0, 1.0, 1.0)),
        ("Länge [°];Breite [°];Fahrgeschwindigkeit [m/s]", (1e-5, 1e-5, 1.0)),
    ],
)
def test_headers_in_german(tmp_path, header, factors):
    columns = [factor * values for factor, values in zip(factors, (X, Y, np.full(30, 2.0)), strict=True)]
    text = rows(*columns, header=header, mark=";").replace(".", ",")
    path, report = loaded(tmp_path, text, spacing=None)
    scale = 1.0 if factors[0] == 1.0 else 1e-5 * 111319.49
    np.testing.assert_allclose(path.points[:, 0], scale * X, atol=1e-4)
    np.testing.assert_allclose(path.points[:, 1], scale * Y, rtol=0.01, atol=1e-4)
    assert path.speed is not None
    np.testing.assert_allclose(path.speed, 2.0, rtol=1e-12)
    assert not report.unread


def test_a_point_far_off_is_left_out_with_a_word(tmp_path):
    columns = np.r_[0.0, X + 400.0], np.r_[0.0, Y + 400.0]
    path, report = loaded(tmp_path, rows(*columns, header="x_m,y_m"), spacing=None)
    np.testing.assert_allclose(path.points[:, :2], np.stack([X + 400.0, Y + 400.0], axis=1), atol=1e-6)
    assert "not bridged; only points 2 to 31, 29.1 m are taken, join_gaps=True" in " ".join(report.warnings)
