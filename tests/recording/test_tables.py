"""Tables of every dialect give the same numbers; a cell that is no number is named, if its column is wanted."""

import datetime
import re
import time
from decimal import Decimal

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from aoro_gym.recording.cells import parse_number
from aoro_gym.recording.dialects import Dialect, number_rows, sniff, sniff_file
from aoro_gym.recording.tables import read_table

ROWS = [(0.0, 0.0, 7.2), (0.01, -0.5, 1234.75), (0.02, 1.0, 1e-3)]


def text(separator: str, decimal: str = ".", header: str | None = "a{0}b{0}c", end: str = "\n") -> str:
    lines = [] if header is None else [header.format(separator)]
    lines += [separator.join(f"{value:g}" for value in row).replace(".", decimal) for row in ROWS]
    return "".join(line + end for line in lines)


@pytest.mark.parametrize(
    "data",
    [
        text(",").encode(),
        text(";").encode(),
        text("\t").encode(),
        text("|").encode(),
        text(" ").encode(),
        text("   ").encode(),
        text(";", ",").encode(),
        text("\t", ",").encode(),
        text(" ", ",").encode(),
        text(";", ",", end="\r\n").encode(),
        text(",", end="\r").encode(),
        text(",").encode("utf-8-sig"),
        text(",").encode("utf-16"),
        text("\t").encode("utf-16-le"),
        ("# 20 °C\n" + text(";", ",")).encode("cp1252"),
        ("# 20 °C\n\n" + text(",")).encode(),
        ("sep=;\n" + text(";", ",")).encode(),
        ("Logger 7\nStarted: yesterday\n" + text(",")).encode(),
        text(",", end=",\n").encode(),
        text(";", ",", end=";\n").encode(),
        text(", ").encode(),
        text(",", header='"a"{0}"b"{0}"c"').encode(),
        b'"a","b","c"\n"0","0","7,2"\n"0,01","-0,5","1234,75"\n"0,02","1","0,001"\n',
        ("# a,b,c\n" + text(",", header=None)).encode(),
        ("a b c\n3\n" + text(" ", header=None)).encode(),
        (text(",") + "# the end\n\n").encode(),
        (text(",") + "\x1a").encode(),
    ],
)  # fmt: skip
def test_every_dialect_gives_the_same_numbers(tmp_path, data):
    path = tmp_path / "table.csv"
    path.write_bytes(data)
    table = read_table(path)
    assert table.names == ("a", "b", "c")
    found = np.stack([table.numbers(name) for name in "abc"], axis=1)
    np.testing.assert_array_equal(found, ROWS)


@pytest.mark.parametrize("units", ["s,%,km/h", "[s],[%],[km/h]", "s,1,km/h", "s,,bogus units"])
def test_a_line_of_units_belongs_to_the_header(tmp_path, units):
    path = tmp_path / "table.csv"
    path.write_text(text(",").replace("\n", f"\n{units}\n", 1))
    table = read_table(path)
    assert table.names[0] == "a [s]"
    np.testing.assert_array_equal(table.numbers("a [s]"), [row[0] for row in ROWS])


def test_words_under_a_header_are_no_units(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("time,state\n2026-05-04T08:00:00Z,idle\n2026-05-04T08:00:01Z,m\n")
    table = read_table(path)
    assert table.names == ("time", "state")
    np.testing.assert_array_equal(table.elapsed("time", None)[0], [0.0, 1.0])


def test_unread_columns_need_no_numbers_and_are_named(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,state,b,,a2\n0,idle,,x,nan\n1,turning,3,,inf\n")
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("a"), [0.0, 1.0])
    assert table.unread == ("state", "b", "column 4", "a2")
    with pytest.raises(ValueError, match=r"line 2: b = '' is not a finite number: it is blank in 1 of 2 rows"):
        table.numbers("b")
    with pytest.raises(ValueError, match=r"line 2: state = 'idle' is not a finite number"):
        table.numbers("state")
    with pytest.raises(ValueError, match=r"line 3: a2 = 'inf'|line 2: a2 = 'nan'"):
        table.numbers("a2")


@pytest.mark.parametrize(
    ("cell", "value"),
    [("1e3", 1000.0), (".5", 0.5), ("5.", 5.0), ("+1", 1.0), ("−1.5", -1.5), (" 2 ", 2.0), ("0." + "1" * 400, 1 / 9),
     ("1_0", None), ("0x10", None), ("1,5", None), ("1.2.3", None), ("1e", None), ("nan", None), ("inf", None),
     ("1" * 400, None), ("1e999", None), ("١", None), ("", None), ("true", None), ("1" * 5000, None)],
)  # fmt: skip
def test_numbers_are_strict(tmp_path, cell, value):
    assert parse_number(cell) == value
    path = tmp_path / "table.csv"
    path.write_text(f'a,b\n0.5,1\n1.5,"{cell}"\n', encoding="utf-8")
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("a"), [0.5, 1.5])
    if value is None:
        with pytest.raises(ValueError, match="line 3: b = ") as caught:
            table.numbers("b")
        assert len(str(caught.value).removeprefix(str(path))) < 200
    else:
        assert table.numbers("b")[1] == value


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "holds no rows"),
        (b"\n\n# nothing\n", "holds no rows"),
        (b"a,b\n", "holds no rows"),
        (b"1,2\n3,4\n", "holds no rows under a header"),
        (b"a,b\n0,1\n1\n", "line 3: 1 values where the header names 2 columns"),
        (b"a,b\n0,1\n1,2,3\n", "line 3: 3 values where the header names 2 columns"),
        (b"a,b\n1\n0,1\n0,1\n", "1 rows are declared, but 2 follow"),
        (b"a,b\nx\n0,1\n0,1\n", "line 2: 1 values where the header names 2 columns"),
        (b'a,b\n0,1\n1,"2\n3,4\n', "line 3: a quotation mark is not closed"),
        (b"a,b\n0,1\n1,\x002\n", "is not a CSV text file: byte 11 is zero"),
        (b"a,b\n0,1\n1,\x012\n", "is not a CSV text file: line 3 holds the control character"),
        (b"\x89PNG\x81\x8d", "is not a CSV text file"),
        (b"a,b\n0," + b"9" * 200000 + b"\n", "field larger than field limit"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused_with_its_line(tmp_path, data, message):
    path = tmp_path / "broken.csv"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        read_table(path)
    said = str(caught.value)
    assert said.startswith(str(path)) and "\n" not in said and len(said.removeprefix(str(path))) < 200


def test_a_name_that_stands_twice_is_refused_only_if_it_is_wanted(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b,b\n0,1,2\n1,2,3\n")
    table = read_table(path)
    assert len(table.numbers("a")) == 2
    with pytest.raises(ValueError, match="names the column 'b' twice"):
        table.numbers("b")
    with pytest.raises(ValueError, match=r"no column '\[/x\]', only a, b, b"):
        table.numbers("[/x]")


def test_mixed_decimal_marks_are_named(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a;b\n0,5;1,5\n1,5;2.5\n")
    with pytest.raises(ValueError, match=r"line 3: b = '2\.5' .* decimal comma"):
        read_table(path).numbers("b")


def test_wide_tables_take_time_in_proportion(tmp_path):
    """20,000 columns: no work that grows with their square."""
    path = tmp_path / "wide.csv"
    names = [f"c{i}" for i in range(20_000)]
    path.write_text(",".join(names) + "\n" + "\n".join(",".join(["0.5"] * 20_000) for _ in range(3)) + "\n")
    start = time.process_time()
    table = read_table(path)
    table.load("c0", "c19999")
    assert time.process_time() - start < 5.0
    assert len(table.unread) == 19_998


def test_more_columns_than_the_limit_are_refused_with_it(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"c{i}" for i in range(100_001)) + "\n" + ",".join(["0"] * 100_001) + "\n")
    with pytest.raises(ValueError, match="100,001 columns, more than 100,000"):
        read_table(path)


def test_clocks(tmp_path):
    """Ten milliseconds in every dress are ten milliseconds."""
    from aoro_gym.recording.units import parse_name

    zero = 1777881600
    clocks = {
        "time_ns": [f"{zero * 10**9 + k * 10**7}" for k in range(3)],
        "time_us": [f"{zero * 10**6 + k * 10**4}" for k in range(3)],
        "time_ms": [f"{zero * 10**3 + k * 10}" for k in range(3)],
        "time_s": ["5", "5.01", "5.02"],
        "time": [f"{zero * 10**9 + k * 10**7}" for k in range(3)],
        "time_h": [f"{k / 360000:.17g}" for k in range(3)],
        "time_utc": [f"2026-05-04T08:00:00.{k:02d}Z" for k in range(3)],
        "time_local": ["2026-12-31 23:59:59.5", "2026-12-31T22:59:59,51-0100", "2027-01-01 01:59:59.520 +02:00"],
        "time_day": [f"08:00:00,{k:02d}" for k in range(3)],
        "time_german": [f"4.5.2026 08:00:00.{k:02d}" for k in range(3)],
    }  # fmt: skip
    path = tmp_path / "clocks.csv"
    rows = zip(*clocks.values(), strict=True)
    path.write_text(";".join(clocks) + "\n" + "".join(";".join(row) + "\n" for row in rows))
    table = read_table(path)
    for name in clocks:
        found = parse_name(name, {"time", "time_utc", "time_local", "time_day", "time_german"}, "time")
        assert found is not None
        seconds, _ = table.elapsed(name, found.unit)
        np.testing.assert_allclose(seconds, [0.0, 0.01, 0.02], rtol=0, atol=1e-12)


def test_a_clock_beyond_its_unit_is_named(tmp_path):
    from aoro_gym.recording.units import find_unit

    path = tmp_path / "clock.csv"
    for power, words in ((9, "nanoseconds since 1970"), (6, "microseconds since 1970"), (3, "milliseconds since 1970")):
        path.write_text("time_s,a\n" + "".join(f"{(1777881600 + k) * 10**power},0\n" for k in range(3)))
        with pytest.raises(ValueError, match=f"no time in s; these are {words}"):
            read_table(path).elapsed("time_s", find_unit("s", "time"))
    path.write_text("time_s,a\n" + "".join(f"{10**30 + k},0\n" for k in range(3)))
    with pytest.raises(ValueError, match="is no time in s; name its unit"):
        read_table(path).elapsed("time_s", find_unit("s", "time"))


def test_dates_with_slashes_serve_within_a_day(tmp_path):
    path = tmp_path / "clock.csv"
    path.write_text("clock,a\n" + "".join(f"05/04/2026 08:00:{k}.5,0\n" for k in (10, 11, 12)))
    np.testing.assert_array_equal(read_table(path).elapsed("clock", None)[0], [0.0, 1.0, 2.0])
    path.write_text("clock,a\n05/04/2026 23:59:59,0\n06/04/2026 00:00:00,0\n")
    with pytest.raises(ValueError, match="day and month of clock cannot be told apart"):
        read_table(path).elapsed("clock", None)


def parquet(path, **columns):
    pyarrow.parquet.write_table(pyarrow.table(columns), path)
    return read_table(path)


def test_parquet_types(tmp_path):
    moments = [datetime.datetime(2026, 5, 4, 8, 0, 0, 10_000 * k) for k in range(3)]
    table = parquet(
        tmp_path / "typed.parquet",
        whole=[1, 2, 3],
        real=pyarrow.array([0.5, 1.5, 2.5], pyarrow.float32()),
        exact=[Decimal("1.25"), Decimal("2.50"), Decimal("-3.75")],
        coded=pyarrow.array([4.0, 4.0, 5.0]).dictionary_encode(),
        flag=[True, False, True],
        words=["a", "b", "c"],
        gaps=[1.0, None, 3.0],
        moment=pyarrow.array(moments, pyarrow.timestamp("us", "UTC")),
        since=pyarrow.array([0, 10_000_000, 20_000_000], pyarrow.duration("ns")),
        day=pyarrow.array([datetime.time(8, 0, 0, 10_000 * k) for k in range(3)], pyarrow.time32("ms")),
        stamp=pyarrow.array([1777881600 * 10**9 + 10**7 * k for k in range(3)]),
    )
    np.testing.assert_array_equal(table.numbers("whole"), [1, 2, 3])
    np.testing.assert_array_equal(table.numbers("real"), [0.5, 1.5, 2.5])
    np.testing.assert_array_equal(table.numbers("exact"), [1.25, 2.5, -3.75])
    np.testing.assert_array_equal(table.numbers("coded"), [4, 4, 5])
    for name in ("moment", "since", "day", "stamp"):
        np.testing.assert_allclose(table.elapsed(name, None)[0], [0.0, 0.01, 0.02], rtol=0, atol=1e-12)
    for name, what in (("flag", "true and false"), ("words", "text"), ("moment", "timestamps"), ("since", "durations")):
        with pytest.raises(ValueError, match=f"column '{name}' does not hold numbers, but {what}"):
            table.numbers(name)
    with pytest.raises(ValueError, match=r"line 2: gaps = '' .* blank in 1 of 3 rows"):
        table.numbers("gaps")


def test_dotted_and_nested_names_of_parquet(tmp_path):
    table = parquet(tmp_path / "dots.parquet", **{"header.stamp": [1.0, 2.0], "pose": [{"x": 1.0}, {"x": 2.0}]})
    np.testing.assert_array_equal(table.numbers("header.stamp"), [1.0, 2.0])
    with pytest.raises(ValueError, match="'pose' does not hold numbers, but values of type struct"):
        table.numbers("pose")


def test_dialects_of_point_clouds(tmp_path):
    """What the reader of clouds needs of a file of which it has seen the begin only."""
    counted = sniff(b"//X Y Z Intensity\n3\n15.9 23.5 149.2 5\n6.7 13.7 150.3 5\n1.0 2.0 3.0 5\n")
    assert counted.names == ("X", "Y", "Z", "Intensity") and counted.is_header_comment
    assert (counted.separator, counted.count, counted.skip) == (None, 3, 2)
    leica = sniff(b"2\n15.924 23.524 149.245 -312 120 118 99\n6.745 13.765 150.314 -312 120 118 99\n")
    assert (leica.names, leica.count, leica.skip, leica.columns) == ((), 2, 1, 7)
    comma = sniff(b"500015,92 6650023,52 149,41\n500006,74 6650013,77 149,86\n500001,02 66500", is_whole=False)
    assert (comma.separator, comma.decimal, comma.columns) == (None, ",", 3)
    path = tmp_path / "cloud.csv"
    path.write_text("X;Y;Z\n500015,92;6650023,52;149,41\n500006,74;6650013,77;149,86\n")
    dialect = sniff_file(path)
    assert (dialect.separator, dialect.decimal, dialect.skip) == (";", ",", 1)
    lines = path.read_text().splitlines()[dialect.skip :]
    expected = [[500015.92, 149.41], [500006.74, 149.86]]
    np.testing.assert_array_equal(number_rows(lines, dialect, (0, 2)), expected)
    np.testing.assert_array_equal(
        number_rows(["1 2", "# no", "", "nan 4", "5 -"], Dialect(separator=None), (0, 1)),
        [[1, 2], [np.nan, 4], [5, np.nan]],
    )
    with pytest.raises(ValueError, match=r"cloud\.csv, line 12: '1_0' in column 1 is not a number"):
        number_rows(["1;2", "1_0;3"], Dialect(separator=";"), (0, 1), where="cloud.csv", first_line=11)
    with pytest.raises(ValueError, match=r"line 12: 1 values where a row has 2"):
        number_rows(["1;2", "3"], Dialect(separator=";"), (0, 1), where="cloud.csv", first_line=11)


def test_comments_blank_lines_and_byte_order_marks_are_passed_over(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("\ufeff# made by hand\n\ntime_s, spool\n0, 1\n\n# more\n1, 2\n", encoding="utf-8")
    table = read_table(path)
    np.testing.assert_array_equal(table["spool"], [1.0, 2.0])
    assert table.where(1) == f"{path}, line 7"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no rows"),
        ("time_s,a\n", "holds no rows"),
        ("time_s,a\n0,1\n1\n", "line 3: 1 values where the header names 2 columns"),
        ("time_s,a\n0,1\n1,x\n", "line 3: a = 'x' is not a finite number"),
        ("time_s,a\n0,nan\n", "line 2: a = 'nan' is not a finite number"),
        ("time_s,a\n0,inf\n", "line 2: a = 'inf' is not a finite number"),
        ("time_s,a\n0,\n", "line 2: a = '' is not a finite number"),
    ],
)
def test_a_broken_file_is_named_with_its_line(tmp_path, text, message):
    path = tmp_path / "broken.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        read_table(path).numbers("a")
    assert "broken.csv" in str(caught.value)


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(ValueError, match="does not exist"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(ValueError, match="is not a file"):
        read_table(tmp_path)
    for name, what in (("image.csv", "CSV text"), ("image.parquet", "Parquet")):
        (tmp_path / name).write_bytes(b"\x89PNG\xff\xfe\x00")
        with pytest.raises(ValueError, match=f"is not a {what} file"):
            read_table(tmp_path / name)


def test_a_decimal_comma_that_comes_late(tmp_path):
    """A machine at rest writes whole numbers for long."""
    path = tmp_path / "table.csv"
    path.write_text("a;b\n" + "0;0\n" * 500 + "1,5;-0,25\n")
    table = read_table(path)
    assert (table["a"][-1], table["b"][-1]) == (1.5, -0.25)


def test_blank_cells_where_they_may_be(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b\n1,2\n,3\nn/a,4\n5,x\n")
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers_or_blank("a"), [1.0, np.nan, np.nan, 5.0])
    with pytest.raises(ValueError, match="line 5: b = 'x' is not a"):
        table.numbers_or_blank("b")
