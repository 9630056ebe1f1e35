"""Logs as calibrate and diagnose read them: columns by quantity and unit, on one grid, with one set of checks."""

import re
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from aoro_gym.calibration.logs import read_filtered_log as read_for_calibration
from aoro_gym.diagnosis.recording import read_recording as read_for_diagnosis
from aoro_gym.recording.logs import find_quantities, read_log

EPOCH = 1777881600
K = np.arange(400)


def columns() -> dict[str, np.ndarray]:
    """Four seconds at 100 Hz: rest, a left turn, rest."""
    rng = np.random.default_rng(0)
    signal = np.where((K > 50) & (K < 300), 0.6, 0.0)
    angle = 0.0018 * np.cumsum(signal) + 2e-4 * rng.standard_normal(len(K))
    pressure = 20.0 + 60.0 * (signal > 0) + 0.3 * rng.standard_normal(len(K))
    return {"time_s": K / 100, "steering_signal": signal, "joint_angle_rad": angle, "pressure_a_bar": pressure}


def cells(values) -> list[str]:
    return [value if isinstance(value, str) else f"{value:.12g}" for value in values]


def write(path: Path, table: dict, separator: str = ",", end: str = "\n", decimal: str = ".") -> Path:
    rows = zip(*(cells(values) for values in table.values()), strict=True)
    lines = [separator.join(table), *(separator.join(row).replace(".", decimal) for row in rows)]
    path.write_text("".join(line + end for line in lines), encoding="utf-8")
    return path


def renamed(**names) -> dict:
    """The log with ``old=(new, factor)`` columns."""
    table = {}
    for name, values in columns().items():
        new, factor = names.get(name, (name, 1.0))
        table[new] = factor * values
    return table


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return read_log(write(tmp_path_factory.mktemp("plain") / "log.csv", columns()))


def assert_same(found, plain, rtol=1e-9, atol=1e-10):
    assert set(found.channels) == set(plain.channels)
    np.testing.assert_array_equal(found.commands["steering_signal"], plain.commands["steering_signal"])
    for name, values in plain.channels.items():
        np.testing.assert_allclose(found.channels[name], values, rtol=rtol, atol=atol)
    assert found.rest == plain.rest


def test_a_log_in_the_projects_own_columns(plain):
    table = columns()
    np.testing.assert_allclose(plain.channels["joint_angle"], table["joint_angle_rad"], atol=1e-9)
    np.testing.assert_allclose(plain.channels["pressure_a"], 1e5 * table["pressure_a_bar"], rtol=1e-9)
    np.testing.assert_array_equal(plain.commands["steering_signal"], table["steering_signal"][:-1])
    assert (plain.rest, plain.limitations, plain.unread) == (52, (), ())
    assert plain.rate == pytest.approx(100.0)
    assert plain.duration == pytest.approx(3.99)
    assert plain.columns["pressure_a"].name == "pressure_a_bar"


@pytest.mark.parametrize(
    "names",
    [
        {"joint_angle_rad": ("joint_angle_deg", 180 / np.pi)},
        {"joint_angle_rad": ("Joint angle [°]", 180 / np.pi)},
        {"joint_angle_rad": ("jointAngleMrad", 1e3)},
        {"joint_angle_rad": ("joint_angle (gon)", 200 / np.pi)},
        {"pressure_a_bar": ("pressure_a_kPa", 100.0)},
        {"pressure_a_bar": ("Pressure A (MPa)", 0.1)},
        {"pressure_a_bar": ("pressure_a_Pa", 1e5)},
        {"pressure_a_bar": ("pressure_a [psi]", 1e5 / 6894.757293168361)},
        {"pressure_a_bar": ("pressure_a_mbar", 1000.0)},
        {"steering_signal": ("steering_signal_percent", 100.0)},
        {"steering_signal": ("Steering signal [%]", 100.0)},
        {name: (name.capitalize(), 1.0) for name in ("time_s", "steering_signal", "joint_angle_rad")},
        {"time_s": ("time", 1.0)},
        {"time_s": ("t/s", 1.0)},
        {"time_s": ("time [ms]", 1e3)},
        {"time_s": ("time_min", 1 / 60)},
    ],
    ids=str,
)  # fmt: skip
def test_whatever_unit_people_write(tmp_path, plain, names):
    assert_same(read_log(write(tmp_path / "log.csv", renamed(**names))), plain)


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("time_ns", [f"{EPOCH * 10**9 + int(k) * 10**7}" for k in K]),
        ("timestamp_us", [f"{EPOCH * 10**6 + int(k) * 10**4}" for k in K]),
        ("time_ms", [f"{EPOCH * 10**3 + int(k) * 10}" for k in K]),
        ("header.stamp", [f"{EPOCH * 10**9 + int(k) * 10**7}" for k in K]),
        ("utc", [f"2026-05-04T08:00:{k / 100:06.3f}Z" for k in K]),
        ("time", [f"2026-05-04 23:59:{56 + k / 100:06.3f}" for k in K]),
        ("time_s", [f"{EPOCH + k / 100:.2f}" for k in K]),
    ],
)
def test_clocks(tmp_path, plain, name, stamps):
    table = columns()
    del table["time_s"]
    found = read_log(write(tmp_path / "log.csv", {name: stamps, **table}))
    # a float of 1.8e9 s is good to 2e-7 s, in which the angle changes by its noise times 4e-5
    assert_same(found, plain, **({"rtol": 1e-4, "atol": 1e-7} if name == "time_s" else {}))
    assert (len(found.limitations) == 1) == (name == "header.stamp")


@pytest.mark.parametrize(
    "dialect",
    [{"separator": ";", "decimal": ","}, {"separator": "\t"}, {"separator": " "}, {"end": ",\n"}, {"end": "\r\n"}],
    ids=str,
)
def test_dialects(tmp_path, plain, dialect):
    assert_same(read_log(write(tmp_path / "log.csv", columns(), **dialect)), plain)


def test_parquet_with_timestamps(tmp_path, plain):
    table = columns()
    moments = pyarrow.array([EPOCH * 10**6 + int(k) * 10**4 for k in K]).cast(pyarrow.timestamp("us", "UTC"))
    arrays = {"timestamp": moments, **{name: values for name, values in table.items() if name != "time_s"}}
    arrays |= {"state": ["idle"] * len(K), "ok": [True] * len(K)}
    pyarrow.parquet.write_table(pyarrow.table(arrays), tmp_path / "log.parquet")
    found = read_log(tmp_path / "log.parquet")
    assert_same(found, plain, rtol=1e-7)
    assert found.unread == ("state", "ok")
    assert found.limitations == ("log.parquet: unknown columns were not read: state, ok",)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("state", ["idle"] * 400),
        ("oil_temperature_degC", ["41.5" if k % 100 == 0 else "" for k in K]),
        ("gps_speed_m_per_s", ["nan"] * 400),
        ("[/x]", ["1_0"] * 400),
        ("$note", ["9" * 400] * 400),
    ],
)
def test_what_nobody_reads_need_be_no_number_and_is_named(tmp_path, plain, name, values):
    found = read_log(write(tmp_path / "log.csv", {**columns(), name: values}))
    assert_same(found, plain)
    assert found.unread == (name,)
    assert len(found.limitations) == 1 and name in found.limitations[0]


def test_a_wanted_column_with_blanks_says_how_many(tmp_path):
    table = columns()
    pressure = ["" if k % 4 else "20.5" for k in K]
    path = write(tmp_path / "log.csv", {**table, "pressure_a_bar": pressure})
    with pytest.raises(ValueError, match=r"line 3: pressure_a_bar = '' .* blank in 300 of 400 rows"):
        read_log(path)


def shuffled(rows: list) -> dict:
    """The log with its rows in another order, or repeated."""
    return {name: np.asarray(values)[rows] for name, values in columns().items()}


def with_events() -> dict:
    """Each step of the command twice at one instant, first with the old signal, as FMU tools write events."""
    table = columns()
    steps = np.flatnonzero(np.diff(table["steering_signal"])) + 1
    rows = np.sort(np.concatenate([K, steps]))
    out = {name: values[rows] for name, values in table.items()}
    first = np.flatnonzero(np.diff(out["time_s"]) == 0.0)
    out["steering_signal"][first] = table["steering_signal"][steps - 1]
    return out


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (with_events(), "repeats or runs backwards; 2 rows left out"),
        (
            shuffled([*range(200), 201, 200, *range(202, 400)]),
            "line 203: time_s repeats or runs backwards; 1 rows left out",
        ),
        (shuffled([*range(200), *range(206, 400)]), "a gap of 0.070 s, bridged"),
        (shuffled([k for k in range(400) for _ in range(2)]), "400 rows repeat another one in time and value"),
        (shuffled([*range(100), *range(50, 400)]), "50 rows repeat another one in time and value"),
        ({**columns(), "time_s": np.r_[K[:200], K[:200]] / 100}, "sort them"),
    ],
    ids=["events", "out of order", "gap", "all twice", "a stretch again", "a clock that restarts"],
)
def test_calibrate_and_diagnose_leave_out_the_same_rows(tmp_path, plain, table, says):
    path = write(tmp_path / "log.csv", table)
    said = []
    for read in (read_for_calibration, read_for_diagnosis, read_log):
        try:
            read(path)
        except ValueError as error:
            said.append(re.sub(r"a (calibration|diagnosis|recording)", "it", str(error)))
    assert len(set(said)) <= 1 and len(said) in (0, 3)
    if says.endswith("sort them"):
        assert "sort them" in said[0]
        return
    found = read_log(path)
    assert any(re.search(says, sentence) for sentence in found.limitations)
    np.testing.assert_array_equal(found.commands["steering_signal"], plain.commands["steering_signal"])
    np.testing.assert_allclose(found.channels["joint_angle"], plain.channels["joint_angle"], atol=2e-3)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (renamed(pressure_a_bar=("pressure_a_bar", 100.0)), r"reaches 8\.\d+e\+03 bar, but hoses burst at 600 bar"),
        (renamed(pressure_a_bar=("pressure_a_MPa", 1.0)), "hoses burst at 600 bar"),
        (renamed(joint_angle_rad=("joint_angle_rad", 57.3)), "that is degrees: name it joint_angle_deg"),
        (renamed(joint_angle_rad=("joint_angle_deg", 600.0)), "was it logged in another unit"),
        (renamed(joint_angle_rad=("joint_angle [furlong]", 1.0)), "'furlong', which is no unit"),
        (renamed(joint_angle_rad=("joint_angle [bar]", 1.0)), "'bar', which is no unit"),
        (renamed(joint_angle_rad=("joint_angle", 57.3)), "names no unit .* name it joint_angle_deg or joint_angle_gon"),
        (
            renamed(joint_angle_rad=("joint_angle", 3.5)),
            "name it joint_angle_rad or joint_angle_deg or joint_angle_gon",
        ),
        (renamed(time_s=("time [fortnight]", 1.0)), "'fortnight', which is no unit"),
        (renamed(time_s=("time_ns", 1.0)), r"covers 0\.00 s .* \(time_ns was read in ns\)"),
        (renamed(time_s=("time", 1e3)), r"has 0\.1 samples a second; .* \(time was read in s, as no unit is named\)"),
        (renamed(steering_signal=("steering_signal", 100.0)), "is it percent"),
        (renamed(steering_signal=("steering_signal_V", 9.0)), "must be in"),
        ({**columns(), "time_s": [f"{EPOCH * 10**9 + int(k) * 10**7}" for k in K]}, "these are nanoseconds since 1970"),
        ({**columns(), "time_s": np.repeat(columns()["time_s"][::4], 4)}, "repeats, with other values, .* more digits"),
        ({**columns(), "engine_speed_rpm": 9e3 + K}, "no engine of this kind turns faster"),
        ({**columns(), "gear": np.where(K > 99, 1.5, 1.0)}, "gear is 1.5, but must be one of 1, 2, 3"),
    ],
)
def test_what_cannot_be_is_refused_by_name(tmp_path, table, says):
    with pytest.raises(ValueError, match=says) as caught:
        read_log(write(tmp_path / "log.csv", table))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "says", "without"),
    [
        (renamed(pressure_a_bar=("pressure_a_Pa", 1.0)), "pressure_a_Pa reaches 0.00.* was not used", "pressure_a"),
        (renamed(joint_angle_rad=("joint_angle_deg", 0.01)), "its angle has another unit", None),
    ],
)
def test_what_is_too_little_to_be_of_its_unit_is_said(tmp_path, table, says, without):
    found = read_log(write(tmp_path / "log.csv", table))
    assert any(re.search(says, sentence) for sentence in found.limitations)
    assert without not in found.channels


def test_an_angle_without_a_unit_is_radians_if_degrees_were_no_motion(tmp_path, plain):
    table = columns()
    table["joint_angle"] = table.pop("joint_angle_rad")
    found = read_log(write(tmp_path / "log.csv", {**table, "joint_angle": table["joint_angle"]}))
    assert_same(found, plain)
    assert "joint_angle names no unit and was read in rad" in found.limitations[0]


@pytest.mark.parametrize(
    ("name", "says"),
    [("pressure_a", "no unit is named; name it pressure_a_bar"), ("pressure_a [slug]", "the unit 'slug' is unknown")],
)
def test_a_sensor_whose_unit_is_unknown_is_not_used_and_named(tmp_path, name, says):
    found = read_log(write(tmp_path / "log.csv", renamed(pressure_a_bar=(name, 1.0))))
    assert set(found.channels) == {"joint_angle"}
    assert says in found.limitations[0]


def test_every_command_of_a_log_is_held_from_its_row_on(tmp_path):
    table = columns() | {
        "drive_signal": np.where(K > 150, 0.25, 0.0),
        "arm_fl [%]": np.where(K > 200, -50.0, 0.0),
        "traction_rr": np.where(K > 250, 0.5, 1.0),
        "gear": np.where(K > 120, 2.0, 1.0),
        "parking_brake": np.where(K > 20, 0.0, 1.0),
    }
    found = read_log(write(tmp_path / "log.csv", table))
    for name, values in table.items():
        key = name.removesuffix(" [%]")
        if key in found.commands:
            np.testing.assert_allclose(found.commands[key], values[:-1] / (100.0 if "%" in name else 1.0))
    assert set(found.commands) == {"steering_signal", "drive_signal", "arm_fl", "traction_rr", "gear", "parking_brake"}
    few = read_log(tmp_path / "log.csv", purpose="a diagnosis", commands=("steering_signal",))
    assert set(few.commands) == {"steering_signal"}
    for name in ("drive_signal", "arm_fl", "traction_rr", "gear", "parking_brake"):
        assert any(f"{name}" in said and "a diagnosis does not replay it" in said for said in few.limitations)


def test_two_columns_of_one_quantity_are_not_chosen_from_in_silence(tmp_path):
    table = columns()
    path = write(tmp_path / "log.csv", {**table, "joint_angle_deg": np.degrees(table["joint_angle_rad"])})
    found = read_log(path)
    assert found.columns["joint_angle"].name == "joint_angle_rad"
    assert found.limitations == ("log.csv: joint_angle_deg not read, as joint_angle_rad is the same quantity",)


def test_the_simulators_own_state_is_never_looked_at():
    found = find_quantities(["True_pressure_a_bar", "true_joint_angle_deg", "pressure_a_bar"])
    assert {key: [name for name, _ in columns] for key, columns in found.items()} == {"pressure_a": ["pressure_a_bar"]}


def test_a_cut_row_need_not_be_whole(tmp_path, plain):
    path = write(tmp_path / "log.csv", columns())
    path.write_text(path.read_text() + "4.00,0,0.27,-")
    found = read_log(path)
    assert_same(found, plain)
    assert "line 402: the file ends within a line" in found.limitations[0]


def test_twenty_thousand_columns(tmp_path):
    """Every name is looked at once."""
    table = columns()
    wide = [f"channel_{i}_bar" for i in range(20_000)]
    lines = [",".join([*table, *wide])]
    tail = ",0" * len(wide)
    lines += [",".join(row) + tail for row in zip(*(cells(values) for values in table.values()), strict=True)][::2]
    path = tmp_path / "wide.csv"
    path.write_text("\n".join(lines) + "\n")
    found = read_log(path)
    assert len(found.unread) == 20_000
    assert max(map(len, found.limitations)) < 300


def test_a_log_that_stands_twice_in_its_file_is_read_once(tmp_path, plain):
    found = read_log(write(tmp_path / "log.csv", shuffled([*range(400), *range(400)])))
    assert_same(found, plain)
    assert found.limitations == ("log.csv: 400 rows repeat another one in time and value, and were left out",)


def test_lines_before_the_header_are_passed_over_and_counted(tmp_path, plain):
    path = write(tmp_path / "log.csv", columns(), separator=";", decimal=",")
    path.write_text("Logger AX-7\nMachine;no. 3\n\n" + path.read_text(), encoding="utf-8")
    found = read_log(path)
    assert_same(found, plain)
    assert found.limitations == ("log.csv: 2 lines before the header were passed over",)


def test_a_line_of_units_under_the_header(tmp_path, plain):
    table = {
        "Time": 1e3 * K / 100,
        "Steering signal": 100 * columns()["steering_signal"],
        "Joint angle": np.degrees(columns()["joint_angle_rad"]),
        "Pressure A": 100 * columns()["pressure_a_bar"],
    }
    path = write(tmp_path / "log.csv", table, separator=";", decimal=",")
    path.write_text(path.read_text().replace("\n", "\nms;%;°;kPa\n", 1), encoding="cp1252")
    found = read_log(path)
    assert_same(found, plain)
    assert found.limitations == ()


def test_a_command_in_a_unit_of_something_else_is_not_passed_over(tmp_path):
    path = write(tmp_path / "log.csv", {**columns(), "drive_signal_V": 2.5 + 0.0 * K})
    with pytest.raises(ValueError, match="'drive_signal_V' is in 'V', which is no unit of this quantity"):
        read_log(path)


def test_time_with_its_zone_in_brackets(tmp_path, plain):
    table = columns()
    del table["time_s"]
    stamps = [f"2026-05-04T08:00:{k / 100:06.3f}" for k in K]
    assert_same(read_log(write(tmp_path / "log.csv", {"Time (UTC)": stamps, **table})), plain)


@pytest.mark.parametrize("clock", ["time_s", "time", "t [s]"])
def test_a_temperature_is_no_clock(tmp_path, plain, clock):
    table = {"T [°C]": np.full(len(K), 41.0), **renamed(time_s=(clock, 1.0))}
    found = read_log(write(tmp_path / "log.csv", table))
    assert_same(found, plain)
    assert found.columns["time"].name == clock
    assert found.limitations == ("log.csv: unknown columns were not read: T [°C]",)


@pytest.mark.parametrize(
    ("heads", "factors", "said"),
    [
        (("Zeit [s]", "Lenksignal [%]", "Knickwinkel (°)", "Druck A [bar]"), (1, 100, 180 / np.pi, 1), ""),
        (("Zeit(ms)", "Lenkbefehl [‰]", "Knickwinkel [Grad]", "Druck A [MPa]"), (1e3, 1e3, 180 / np.pi, 0.1), ""),
        (("Temps (s)", "Commande de direction (%)", "Angle d'articulation (mrad)", "Pression A (kPa)"),
         (1, 100, 1e3, 100), ""),
        (("t[s]", "steering [%]", "Angle (°)", "pressure_a_bar"), (1, 100, 180 / np.pi, 1), "Angle (°) was taken for"),
        (("epoch_s", "steering_percent", "Winkel [gon]", "pressure_a_bar"), (1, 100, 200 / np.pi, 1), "Winkel [gon] was"),
    ],
)  # fmt: skip
def test_headers_in_german_french_and_short(tmp_path, plain, heads, factors, said):
    table = dict(zip(heads, (f * v for f, v in zip(factors, columns().values(), strict=True)), strict=True))
    found = read_log(write(tmp_path / "log.csv", table, ";", decimal=","))
    for name, values in plain.channels.items():
        np.testing.assert_allclose(found.channels[name], values, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.commands["steering_signal"], plain.commands["steering_signal"], atol=1e-12)
    assert found.unread == ()
    assert said in " ".join(found.limitations)
    assert bool(said) == bool(found.limitations)


def test_a_short_name_needs_a_fitting_unit_and_gives_way_to_a_plain_one(tmp_path, plain):
    table = {**columns(), "Angle (°)": K * 1.0, "steering [deg]": K * 2.0}
    found = read_log(write(tmp_path / "log.csv", table))
    np.testing.assert_array_equal(found.channels["joint_angle"], plain.channels["joint_angle"])
    assert set(found.unread) == {"Angle (°)", "steering [deg]"}
    with pytest.raises(ValueError, match="neither a column steering_signal"):
        read_log(write(tmp_path / "log.csv", renamed(steering_signal=("steering", 1.0))))


def test_grad_is_asked_for_where_it_may_be_degrees_or_gon(tmp_path):
    table = renamed(joint_angle_rad=("joint_angle [Grad]", 180 / np.pi))
    with pytest.raises(ValueError, match=r"'Grad', which is no unit of this quantity \(degrees or gon\?\)"):
        read_log(write(tmp_path / "log.csv", table))


@pytest.mark.parametrize("cell", ["4.000.000,5", "4'000'000,5", "4\u202f000\u202f000,5"])
def test_separators_of_thousands_are_named(tmp_path, cell):
    file = write(tmp_path / "log.csv", renamed(pressure_a_bar=("pressure_a [Pa]", 1e5)), ";", decimal=",")
    lines = file.read_text(encoding="utf-8").splitlines()
    lines[9] = f"{lines[9].rpartition(';')[0]};{cell}"
    file.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ValueError, match=r"line 10: .* it has separators of thousands; write the column without them"):
        read_log(file)
