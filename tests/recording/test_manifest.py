"""Manifests beside logs: each value in its type and bounds, or one line that names file, key, value and bound."""

import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aoro_gym.recording import manifest
from aoro_gym.recording.manifest import Manifest, read_manifest
from aoro_gym.terrains import plane

USUAL = b"""\
manoeuvre = "left"
duration_s = 3.4
sensors = "ideal"
filters = ["1st order, 20 Hz"]
engine_speed_rpm = 1595.0
oil_temperature_C = 35
gear = 1
payload_kg = 250.0

[ground]
slope_deg = 1.5
direction_deg = -90
friction = 0.8
rolling_resistance = 2.0
"""


def written(folder: Path, content: bytes) -> Path:
    """A log that is not there, with a manifest beside it."""
    (folder / "turn.toml").write_bytes(content)
    return folder / "turn.csv"


def test_no_manifest_says_nothing(tmp_path: Path) -> None:
    assert read_manifest(tmp_path / "turn.csv") == Manifest()


@pytest.mark.parametrize(
    "content",
    [
        USUAL, b"\xef\xbb\xbf" + USUAL, USUAL.replace(b"\n", b"\r\n"),
        b"# " + b"x" * 3000 + b"\n" + USUAL.replace(b"250.0", b"2.5e2"),
    ],
)  # fmt: skip
def test_values_are_read_as_they_stand(tmp_path: Path, content: bytes) -> None:
    found = read_manifest(written(tmp_path, content))
    assert (found.engine_speed_rpm, found.oil_temperature_C, found.gear, found.payload_kg) == (1595.0, 35.0, 1, 250.0)
    assert found.filters == ("1st order, 20 Hz",)
    assert found.tire_pressure_bar is None and found.warnings == ()
    assert found.ground == {"slope_deg": 1.5, "direction_deg": -90.0, "friction": 0.8, "rolling_resistance": 2.0}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b'gear = "first"', r"gear is 'first', but must be a number"),
        (b"gear = true", "gear is True, but must be a number"),
        (b"gear = 1.5", "gear is 1.5, but must be one of 1, 2, 3"),
        (b"gear = 4", r"gear is 4, but must be in \[1, 3\]"),
        (b"oil_temperature_C = nan", r"oil_temperature_C is nan, but must be in \[-40, 120\] °C"),
        (b"oil_temperature_C = 308.15", r"oil_temperature_C is 308.15, but must be in"),
        (b"payload_kg = -inf", r"payload_kg is -inf, but must be in \[0, 20000\] kg"),
        (b"engine_speed_rpm = " + b"9" * 400, r"engine_speed_rpm is an integer of 40\d digits, but must be in"),
        (b"engine_speed_rpm = " + b"9" * 5000, "is not TOML"),
        (b"engine_speed_rpm = [1595]", "engine_speed_rpm is a list, but must be a number"),
        (b"ground = 3", "ground is 3, but must be a table"),
        (b'ground = "' + b"x" * 5000 + b'"', "ground is 'xxx.*…, but must be a table"),
        (b"[ground]\nslope_deg = nan", r"ground.slope_deg is nan, but must be in \[-45, 45\] deg"),
        (b"[ground]\nfriction = 0", r"ground.friction is 0, but must be in"),
        (b"filters = 3", "filters is 3, but must be a list"),
        (b"filters = [3]", "filters holds 3"),
        (b"manoeuvre = 1", "manoeuvre is 1, but must be text"),
        (b"gear = 1\ngear = 2", "is not TOML: Cannot overwrite a value"),
        (b"a = " + b"[" * 5000, "nested too deeply"),
        (b"gear = \xff", "is not UTF-8"),
    ],
)
def test_each_fault_is_one_line_that_names_the_file(tmp_path: Path, content: bytes, says: str) -> None:
    with pytest.raises(ValueError, match=says) as caught:
        read_manifest(written(tmp_path, content))
    message = str(caught.value)
    assert str(tmp_path / "turn.toml") in message
    assert "\n" not in message and len(message) < len(str(tmp_path)) + 250


def test_unknown_keys_are_named_not_read(tmp_path: Path) -> None:
    content = (
        USUAL.replace(b"oil_temperature_C", b"oil_temperatur_C").replace(b"slope_deg", b"slope") + b"\n[x]\n[[y]]\n"
    )
    found = read_manifest(written(tmp_path, content))
    assert found.oil_temperature_C is None and found.ground is not None and "slope_deg" not in found.ground
    said = "\n".join(found.warnings)
    assert "unknown key 'oil_temperatur_C' was not read; did you mean 'oil_temperature_C'?" in said
    assert "unknown key 'ground.slope' was not read; did you mean 'ground.slope_deg'?" in said
    assert "'x'" in said and "'y'" in said
    many = read_manifest(written(tmp_path, b"".join(b"k%d = 1\n" % i for i in range(5000))))
    assert len(many.warnings) == 6 and "4995 more unknown keys" in many.warnings[-1]


PARTS = [
    b"nan", b"inf", b"1e999", b"1" * 400, b"1" * 5000, b"[" * 3000, b"{a=" * 2000, b'"', b"\n[", b"\xff", b"\0",
    b"a." * 2000, b"= {}", b"true", b"1979-05-27", b"[/x]", b"$", b"\r\n", b"\nx = 1\n", b"-1", b"[ground]", b"0x10",
]  # fmt: skip
MUTATIONS = st.lists(
    st.tuples(st.integers(0, len(USUAL)), st.integers(0, 20), st.sampled_from(PARTS) | st.binary(max_size=4)),
    min_size=1,
    max_size=4,
)


def check(folder: Path, mutations) -> None:
    content = USUAL
    for place, length, part in mutations:
        content = content[:place] + part + content[place + length :]
    log = written(folder, content)
    begin = time.process_time()
    try:
        found = read_manifest(log)
    except ValueError as error:
        assert str(folder) in str(error) and "\n" not in str(error) and len(str(error)) < len(str(folder)) + 400
    else:
        assert all("\n" not in warning for warning in found.warnings)
    assert time.process_time() - begin < 3.0


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mutations=MUTATIONS)
def test_mutated_manifests_are_read_or_refused_in_a_line(tmp_path: Path, mutations) -> None:
    check(tmp_path, mutations)


@pytest.mark.slow
@settings(max_examples=10_000, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mutations=MUTATIONS)
def test_many_mutated_manifests_are_read_or_refused_in_a_line(tmp_path: Path, mutations) -> None:
    check(tmp_path, mutations)


def test_a_ground_has_the_bounds_of_a_plane():
    assert manifest.GROUND == plane.BOUNDS
