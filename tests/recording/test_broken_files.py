"""Damaged tables, logs and command files, drawn at random: a result, or one clear sentence, and soon.

The slow ones try 10,000 of each; what once failed is kept in ``corpus``.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aoro_gym.diagnosis.recording import Recording, read_recording
from aoro_gym.recording.cells import parse_number
from aoro_gym.recording.dialects import SAMPLE, Dialect, number_rows, sniff
from aoro_gym.recording.tables import read_table
from aoro_gym.recording.units import DIMENSIONS, canonical, find_unit, parse_name, splits
from aoro_gym.simulation.manoeuvres import from_file
from tests.damage import fuzz

CORPUS = Path(__file__).parent / "corpus"
QUICK, THOROUGH = 60, 10_000
LONGEST = 20.0
"""Time [s] that one small file may take on a loaded computer."""

K = np.arange(160)
SIGNAL = np.where((K > 50) & (K < 120), 0.6, 0.0)
ANGLE = 0.004 * np.cumsum(SIGNAL) + 2e-4 * np.random.default_rng(0).standard_normal(len(K))


def text_log(separator: str = ",", decimal: str = ".", clock: str = "time_s") -> bytes:
    ticks = {"time_s": K / 100, "time_ms": K * 10, "stamp": 1777881600 * 10**9 + K * 10**7}[clock]
    rows = [separator.join([clock, "steering_signal [%]", "joint_angle_deg", "pressure_a_kPa", "state"])]
    for tick, u, a in zip(ticks, SIGNAL, ANGLE, strict=True):
        row = separator.join([f"{tick}", f"{100 * u:g}", f"{np.degrees(a):.5f}", f"{2000 + a:.4f}", "idle"])
        rows.append(row.replace(".", decimal))
    return ("\n".join(rows) + "\n").encode()


def parquet_log() -> bytes:
    sink = pyarrow.BufferOutputStream()
    stamps = pyarrow.array(1777881600 * 10**6 + K * 10**4).cast(pyarrow.timestamp("us"))
    table = {"timestamp": stamps, "steering_signal": SIGNAL, "joint_angle_rad": ANGLE, "state": ["idle"] * len(K)}
    pyarrow.parquet.write_table(pyarrow.table(table), sink)
    return sink.getvalue().to_pybytes()


COMMANDS = b"time_s,steering_signal,gear\n0.1,0,1\n0.2,-0.5,1\n0.5,0.25,2\n"
WHOLE = {
    ".csv": [
        text_log(), text_log(";", ",", "time_ms"), text_log("\t", clock="stamp"), text_log().decode().encode("utf-16"),
        COMMANDS,
    ],
    ".parquet": [parquet_log()],
}  # fmt: skip
TOKENS = [b"", b"nan", b"1_0", b"-1e999", b'"', b",", b";", b"\t", b"\n", b"\r", b"\x00", b"\xff", b"[/x]", b"$", b"9" * 400,
          b"time_s", b"2026-05-04T08:00:00Z", b"\xef\xbb\xbf", b"#", b"1,5", b"(((((", b"\xe2\x88\x92"]  # fmt: skip


def judge(data: bytes, suffix: str) -> None:
    """Every reader gives finite numbers, or one line that names the file and does not repeat it, in time."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{suffix}"
        path.write_bytes(data)
        for read in (_all_numbers, read_recording, from_file):
            try:
                found = read(path)
            except (ValueError, OSError) as error:
                said = str(error)
                assert "log" in said and "\n" not in said
                assert len(said.replace(folder, "")) < 400, said
                continue
            if isinstance(found, Recording):
                assert all(np.isfinite(values).all() for values in found.channels.values())
                assert np.abs(found.commands).max() <= 1.0
        if suffix == ".csv":
            _as_a_cloud(data)
    assert time.process_time() - began < LONGEST


def _all_numbers(path: Path) -> None:
    table = read_table(path)
    faults = []
    for name in set(table.names):
        try:
            assert np.isfinite(table.numbers(name)).all()
        except ValueError as error:
            faults.append(error)
    if faults:
        raise faults[0]


def _as_a_cloud(data: bytes) -> None:
    try:
        dialect = sniff(data[:SAMPLE])
        lines = data.decode(dialect.encoding, errors="replace").splitlines()[dialect.skip :]
        number_rows(lines, dialect, range(min(3, max(dialect.columns, 1))))
    except ValueError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("suffix", WHOLE)
def test_whole_files_are_read(tmp_path, suffix):
    for data in WHOLE[suffix][:1]:
        path = tmp_path / f"log{suffix}"
        path.write_bytes(data)
        recording = read_recording(path)
        np.testing.assert_allclose(recording.channels["joint_angle"], ANGLE, atol=1e-6)
        np.testing.assert_allclose(recording.commands[:, 0], SIGNAL[:-1])


@pytest.mark.parametrize("suffix", WHOLE)
def test_damaged_files(suffix):
    fuzz(lambda data: judge(data, suffix), WHOLE[suffix], TOKENS, QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", WHOLE)
def test_very_many_damaged_files(suffix):
    fuzz(lambda data: judge(data, suffix), WHOLE[suffix], TOKENS, THOROUGH)


@pytest.mark.parametrize(
    ("names", "gain", "message"),
    [
        (("time_s", "\nteering_signal", "joint_angle_rad"), 1.0, "neither a column steering_signal"),
        (("time_s", "steering\nsignal", "joint_angle_rad"), 3.0, "must be in"),
        (("time\n_s", "steering_signal", "joint_angle_rad"), -1.0, "repeats or runs backwards"),
    ],
    ids=["unknown", "known, its values out of range", "time that runs backwards"],
)
@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_damaged_column_name_leaves_a_message_on_one_line(tmp_path, names, gain, message, suffix):
    time_s = K / 100 if gain > 0.0 else K[::-1] / 100
    values = pyarrow.table(dict(zip(names, (time_s, abs(gain) * SIGNAL, ANGLE), strict=True)))
    path = tmp_path / f"log{suffix}"
    write = pyarrow.parquet.write_table if suffix == ".parquet" else pyarrow.csv.write_csv
    write(values, path)
    with pytest.raises(ValueError, match=message) as caught:
        read_recording(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*")), ids=lambda path: path.name)
def test_what_once_failed(path):
    judge(path.read_bytes(), path.suffix)


WORDS = st.sampled_from(["time", "pressure", "a", "s", "m", "per", "km", "h", "^-1", "²", "(", ")", "[", "]", "/", "_", " ",
                         "°", "C", "kPa", "m/s", "·", "⁻¹", "-", ".", "in", "%", "\n", "9" * 50, "ÿ"])  # fmt: skip
NAMES = st.one_of(st.text(max_size=60), st.lists(WORDS, max_size=12).map("".join))


@settings(max_examples=QUICK, deadline=None, derandomize=True, database=None)
@given(NAMES)
def test_any_name_is_taken_apart(name):
    for base, unit, _ in splits(name):
        assert base == base.lower()
        for dimension in DIMENSIONS:
            found = find_unit(unit, dimension)
            assert found is None or (np.isfinite(found.factor) and found.factor > 0.0)
    found = parse_name(name, {canonical(name)}, "pressure")
    assert found is None or found.base == canonical(name)


@settings(max_examples=200, deadline=None, derandomize=True, database=None)
@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([".", ","]))
def test_every_float_is_read_back(value, mark):
    assert parse_number(repr(value).replace(".", mark), mark) == value
    text = f"{value!r};1".replace(".", mark)
    np.testing.assert_array_equal(number_rows([text], Dialect(separator=";", decimal=mark), (0, 1)), [[value, 1.0]])
