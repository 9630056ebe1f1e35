"""Whatever bytes a machine file holds: a machine, or one line that names the file, in bounded time."""

import re
import time
from dataclasses import astuple
from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aoro_gym.machine import Machine

BUNDLED = files("aoro_gym").joinpath("machines", "aoro_datasheet.toml").read_bytes()
MASS = b'[wheel.mass]\nvalue = 220\nunit = "kg"\nrange = [170, 300]\n'
"""The table that the tests below change."""

PARTS = [
    b"nan", b"-inf", b"1e999", b"1" * 400, b"1" * 5000, b"[" * 3000, b"{a=" * 3000, b'"', b'"""', b"\n[", b"]]",
    b"\xff\xfe", b"\0", b"a." * 3000, b"= {}", b"true", b"1979-05-27", b"0x10", b"1_0", b"\n[wheel]\n", b"value = 1\n",
    b"[/x]", b"$", b"\r\n", b"\\",
    b"\nx = 1\n", b"[300, 170]", b"''", "µ".encode(), b"#" * 50_000,
]  # fmt: skip
MUTATIONS = st.lists(
    st.tuples(st.integers(0, len(BUNDLED)), st.integers(0, 40), st.sampled_from(PARTS) | st.binary(max_size=4)),
    min_size=1,
    max_size=3,
)


def mutated(mutations) -> bytes:
    content = BUNDLED
    for place, length, part in mutations:
        content = content[:place] + part + content[place + length :]
    return content


def check(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    begin = time.process_time()
    try:
        machine = Machine.load(path)
    except ValueError as error:
        message = str(error)
        assert str(path) in message
        assert "\n" not in message and len(message) < len(str(path)) + 500, message
    else:
        assert machine.num_variants == 1
    assert time.process_time() - begin < 5.0


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mutations=MUTATIONS)
def test_mutated_machine_files_are_machines_or_one_line(tmp_path: Path, mutations) -> None:
    check(tmp_path / "mutated.toml", mutated(mutations))


@pytest.mark.slow
@settings(max_examples=10_000, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mutations=MUTATIONS)
def test_many_mutated_machine_files_are_machines_or_one_line(tmp_path: Path, mutations) -> None:
    check(tmp_path / "mutated.toml", mutated(mutations))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"value = 220\n", b"value = " + b"1" * 400 + b"\n", r"wheel\.mass = an integer of 400 digits: must be a finite"),
        (b"value = 220\n", b"value = " + b"1" * 5000 + b"\n", "is not TOML: Exceeds the limit"),
        (b"value = 220\n", b"value = nan\n", r"wheel\.mass = nan: must be a finite number"),
        (b"value = 220\n", b"value = -inf\n", r"wheel\.mass = -inf: must be a finite number"),
        (b"value = 220\n", b"value = 1e999\n", r"wheel\.mass = inf: must be a finite number"),
        (b"value = 220\n", b"value = [220]\n", r"wheel\.mass = \[220\]: must be a finite number"),
        (b"value = 220\n", b"value = 1979-05-27\n", r"wheel\.mass = datetime.date"),
        (b"value = 220\n", b"value = " + b"[" * 5000 + b"]" * 5000 + b"\n", "nested too deeply"),
        (b"value = 220\n", b"value = 220\n" + b"a." * 5000 + b"a = 1\n", "nested too deeply"),
        (b"value = 220\n", b"value = 220\nvalue = 221\n", "is not TOML: Cannot overwrite"),
        (b"value = 220\n", b"value = \xff220\n", "is not TOML: byte .* is not UTF-8"),
        (b"value = 220\n", b'value = "' + b"x" * 10_000 + b'"\n', r"wheel\.mass = 'xxx.*…: must be a finite number"),
        (b"value = 220\n", b"value = -3\n", r"wheel\.mass = -3 kg: must be finite and"),
        (b"range = [170, 300]", b"range = [300, 170]", r"range = \[300, 170\]: must be \[low, high\]"),
        (b"range = [170, 300]", b"range = [170, inf]", r"range = \[170, inf\]: must be \[low, high\] with finite"),
        (b"range = [170, 300]", b"range = [170, " + b"1" * 400 + b"]", "range = .*an integer of 400 digits"),
        (b"range = [170, 300]", b"range = [" + b"1," * 9000 + b"2]", r"range = \[1, 1, …\]"),
        (b"[wheel.mass]", b"[wheel.ma\nss]", "is not TOML"),
        (b"[wheel.mass]", b"[wheel." + b"m" * 9000 + b"]", "unknown parameter 'wheel.mmm"),
        (b"[wheel.mass]", b"[" + b"a." * 20 + b"b]", "nested more than 8 deep"),
    ],
)  # fmt: skip
def test_each_fault_is_named_with_the_file(tmp_path: Path, old: bytes, new: bytes, says: str) -> None:
    content = BUNDLED.replace(MASS, MASS.replace(old, new), 1)
    assert content != BUNDLED
    path = tmp_path / "edited.toml"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=says) as caught:
        Machine.load(path)
    message = str(caught.value)
    assert re.match(rf"(machine file )?{re.escape(str(path))}", message)
    assert "\n" not in message and len(message) < len(str(path)) + 400


@pytest.mark.parametrize(
    ("change", "mass"),
    [
        (lambda content: b"\xef\xbb\xbf" + content, 220.0),  # a byte order mark
        (lambda content: content.replace(b"\n", b"\r\n"), 220.0),  # Windows
        (lambda content: content.replace(MASS, MASS.replace(b"220", b"2.2e2")), 220.0),
        (lambda content: content.replace(MASS, MASS.replace(b"220", b"310")), 310.0),  # outside of its plausible range
        (lambda content: b"# note: " + b"." * 5000 + b"\n" + content, 220.0),
    ],
)
def test_valid_neighbours_are_read_value_for_value(tmp_path: Path, change, mass) -> None:
    path = tmp_path / "neighbour.toml"
    path.write_bytes(change(BUNDLED))
    machine, bundled = Machine.load(path), Machine.load("aoro_datasheet")
    assert machine.wheel.mass == mass
    assert {k: e.si for k, e in machine.entries.items() if k != "wheel.mass"} == {
        k: e.si for k, e in bundled.entries.items() if k != "wheel.mass"
    }


def test_a_file_of_many_megabytes_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    path.write_bytes(b"#" * (1 << 21))
    with pytest.raises(ValueError, match=r"large\.toml has 2,097,152 bytes, but a TOML file at most 1,048,576"):
        Machine.load(path)


def test_an_overlay_is_its_base_with_what_differs(tmp_path: Path) -> None:
    base = Machine.load("aoro")
    heavier = base.set({"frame.front.mass": 4000.0}, source="E: weighed")
    heavier.save(tmp_path / "heavier.toml", base="aoro")
    text = (tmp_path / "heavier.toml").read_text()
    assert text.endswith('base = "aoro"\n\n[frame.front.mass]\nvalue = 4000\nsource = "E: weighed"\n')
    again = heavier.set({"frame.rear.mass": 3900.0})
    again.save(tmp_path / "again.toml", base="heavier.toml")  # the file beside it
    loaded = Machine.load(tmp_path / "again.toml")
    assert {key: astuple(entry) for key, entry in loaded.entries.items()} == {
        key: astuple(entry) for key, entry in again.entries.items()
    }
    assert again.identity != base.identity == Machine.load("aoro").identity


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("base = 3\n", "base = 3: must be the name of a machine"),
        ('base = "aoros"\n', "no bundled machine 'aoros'"),
        ('base = "absent.toml"\n', r"no machine file .*absent\.toml"),
        ('base = "odd.toml"\n', "more than 8 files stand on each other, or in a circle"),
        ('base = "aoro"\n[frame.weight]\nvalue = 1\n', "frame.weight: lacks unit, range, source, role"),
        (
            'base = "aoro"\n[wheel.mass]\npublished = 0\n',
            r"wheel\.mass: published = 0: must be a finite number other than 0",
        ),
        ('base = "aoro"\n[wheel.mass]\nvalue = -1\n', r"wheel\.mass = -1 kg: must be finite and"),
    ],
)
def test_each_fault_of_an_overlay_is_named(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "odd.toml").write_text(text)
    with pytest.raises(ValueError, match=says) as caught:
        Machine.load(tmp_path / "odd.toml")
    assert str(tmp_path / "odd.toml") in str(caught.value)


def test_what_is_published_goes_through_overlays_changes_and_saving(tmp_path: Path) -> None:
    key = "steering.valve.nominal_flow_left"
    machine = Machine.load("aoro")
    assert machine.entries[key].published == 70.6 != machine.entries[key].value
    changed = machine.set({key: 70.0}, source="a test")
    assert changed.entries[key].deviation == pytest.approx(70.0 / 70.6 - 1.0)
    for base in (None, "aoro"):
        changed.save(tmp_path / "copy.toml", base)
        entry = Machine.load(tmp_path / "copy.toml").entries[key]
        assert (entry.value, entry.published) == (70.0, 70.6)
    assert machine.entries["wheel.mass"].published is machine.entries["wheel.mass"].deviation is None
