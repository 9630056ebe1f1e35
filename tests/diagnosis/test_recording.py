"""Logs as a diagnosis reads them: good ones on an even grid, bad ones refused or limited, each with its reason."""

from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis.recording import REST, TICK, read_recording
from aoro_gym.simulation.log import write_log


def columns(duration: float = 3.0, rate: float = 100.0, rest: float = 0.5, level: float = 0.8) -> dict:
    """A left turn: the angle follows the integral of the signal."""
    time = np.arange(round(duration * rate) + 1) / rate
    signal = np.where((time >= rest) & (time < duration - 0.5), level, 0.0)
    angle = -0.6 + 0.5 * np.cumsum(np.r_[0.0, signal[:-1]]) / rate
    rng = np.random.default_rng(0)
    return {
        "time_s": time,
        "steering_signal": signal,
        "joint_angle_rad": angle + 1e-4 * rng.standard_normal(len(time)),
        "pressure_a_bar": 20.0 + 60.0 * signal + 0.1 * rng.standard_normal(len(time)),
    }


def written(folder: Path, table: dict, manifest: dict | None = None) -> Path:
    path = folder / "log.csv"
    write_log(path, table, manifest)
    return path


def test_good_log_lies_on_an_even_grid(tmp_path):
    table = columns()
    recording = read_recording(written(tmp_path, table, {"oil_temperature_C": 35.0}))
    assert recording.ticks == len(table["time_s"]) - 1
    np.testing.assert_allclose(recording.commands[:, 0], table["steering_signal"][:-1])
    np.testing.assert_allclose(recording.channels["joint_angle"], table["joint_angle_rad"], atol=1e-8)
    np.testing.assert_allclose(recording.channels["pressure_a"], 1e5 * table["pressure_a_bar"], rtol=1e-8)
    assert recording.rest == round(0.5 / TICK) + 1
    assert recording.start_angle == pytest.approx(-0.6, abs=1e-4)
    assert recording.manifest == {"oil_temperature_C": 35.0}
    assert recording.limitations == ()


@pytest.mark.parametrize("rate", [25.0, 50.0, 250.0, 1000.0])
def test_any_rate_gives_the_same_motion(tmp_path, rate):
    """A sample of the grid lies within one interval of the log's own: it is off by no more than the way in that time."""
    even = read_recording(written(tmp_path, columns()))
    other = read_recording(written(tmp_path, columns(rate=rate)))
    way = 0.5 * 0.8 * max(1.0 / rate, TICK)
    difference = np.abs(even.channels["joint_angle"] - other.channels["joint_angle"])
    assert np.max(difference) <= way + 1e-3  # and the noise of both


def test_degrees_and_volts_are_read_as_such(tmp_path):
    table = columns()
    even = read_recording(written(tmp_path, table))
    table["joint_angle_deg"] = np.degrees(table.pop("joint_angle_rad"))
    table["steering_signal_V"] = 2.5 - 2.0 * table.pop("steering_signal")
    other = read_recording(written(tmp_path, table))
    np.testing.assert_allclose(even.channels["joint_angle"], other.channels["joint_angle"], atol=1e-8)
    np.testing.assert_allclose(even.commands, other.commands, atol=1e-8)


def test_exact_state_is_never_read(tmp_path):
    table = columns()
    table["true_joint_angle_deg"] = np.degrees(table["joint_angle_rad"]) + 5.0
    recording = read_recording(written(tmp_path, table))
    assert set(recording.channels) == {"joint_angle", "pressure_a"}
    del table["joint_angle_rad"]
    with pytest.raises(ValueError, match="joint_angle_rad"):
        read_recording(written(tmp_path, table))


def ramp(side: float = 1.0, noise: float = 0.1) -> dict:
    """A signal that grows over 3 s; below 0.4 of it the joint stands still, with ``noise`` [deg] as published."""
    table = columns(duration=5.0)
    time = table["time_s"]
    table["steering_signal"] = np.where(time < 4.5, np.clip((time - 0.5) / 3.0, 0.0, 1.0), 0.0)
    rate = 0.5 * np.maximum(table["steering_signal"] - 0.4, 0.0)
    rng = np.random.default_rng(1)
    table["joint_angle_rad"] = side * np.cumsum(rate) / 100.0 + np.radians(noise) * rng.standard_normal(len(time))
    return table


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_side_of_a_slow_start_is_judged_by_the_motion(tmp_path, mirrored):
    """Long before a joint leaves its dead band there is nothing but noise; what it does then tells the sign."""
    path = written(tmp_path, ramp(-1.0 if mirrored else 1.0))
    if mirrored:
        with pytest.raises(ValueError, match="turns against its command"):
            read_recording(path)
    else:
        assert read_recording(path).limitations == ()


@pytest.mark.parametrize("recoil", [0.9, 1.1])
def test_a_recoil_is_no_wrong_sign_until_it_is_a_degree(tmp_path, recoil):
    """While it should still stand in its dead band, the joint goes right by ``recoil`` degrees; later it turns left."""
    table = ramp(noise=0.0)
    table["joint_angle_rad"] -= np.radians(recoil) * np.exp(-(((table["time_s"] - 0.9) / 0.1) ** 2))
    path = written(tmp_path, table)
    if recoil < 1.0:
        read_recording(path)
    else:
        with pytest.raises(ValueError, match="turns against its command"):
            read_recording(path)


def test_a_joint_that_coasts_into_the_next_command_is_not_judged_by_that(tmp_path):
    """A left pulse within the joint's delay, then a right one: the joint still turns left, rightly so."""
    table = columns()
    time = table["time_s"]
    table["steering_signal"] = np.where(
        (time >= 0.5) & (time < 0.6), 1.0, np.where((time >= 0.6) & (time < 1.0), -1.0, 0.0)
    )
    table["joint_angle_rad"] = 1e-4 * np.sin(40.0 * time) + np.radians(5.0) * np.clip((time - 0.65) / 0.2, 0.0, 1.0)
    assert read_recording(written(tmp_path, table)).limitations == ()


def test_a_sensor_without_noise_is_not_saturated(tmp_path):
    """Ideal sensors repeat values at a stop as they do at rest."""
    table = columns()
    table["joint_angle_rad"] = -0.6 + 0.5 * np.clip(table["time_s"] - 0.5, 0.0, 1.5)
    table["pressure_a_bar"] = 20.0 + 60.0 * table["steering_signal"]
    assert read_recording(written(tmp_path, table)).limitations == ()


def test_a_file_that_is_cut_is_used_up_to_its_last_whole_row(tmp_path):
    path = written(tmp_path, columns())
    text = path.read_text()
    rows = text.splitlines(keepends=True)
    path.write_text("".join(rows[:220]) + rows[220].rstrip()[:-4])  # in the middle of its last number
    recording = read_recording(path)
    assert recording.ticks == 218  # a header and 219 samples
    assert any("line 221: the file ends within a line" in sentence for sentence in recording.limitations)
    assert any("ends under a command" in sentence for sentence in recording.limitations)
    path.write_text("".join(rows[:220]) + rows[220].split(",")[0])
    with pytest.raises(ValueError, match="line 221: 1 values where the header names 4 columns"):
        read_recording(path)
    path.write_text("".join(rows[:2]).rstrip())
    with pytest.raises(ValueError, match=r"covers 0\.00 s with 1 samples"):
        read_recording(path)


def changed(**replacements) -> dict:
    table = columns()
    for name, change in replacements.items():
        table[name] = change(table[name])
    return table


def held(values: np.ndarray, begin: int, end: int) -> np.ndarray:
    """Samples that repeat one of them."""
    return np.r_[values[:begin], np.full(end - begin, values[begin]), values[end:]]


def without(name: str) -> dict:
    table = columns()
    del table[name]
    return table


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (columns(duration=1.0), r"covers 1\.00 s .* needs 1\.5 s"),
        (columns(duration=30.0, rate=1.0, rest=5.0), r"has 1 samples a second; a diagnosis needs 20"),
        (columns(duration=4.0, rate=1.0, rest=1.0), r"has 1 samples a second"),
        (columns(rest=0.1), f"needs {REST} s of standstill"),
        (columns(level=0.0), "commands no motion|standstill|stands still"),
        (without("steering_signal"), "neither a column steering_signal nor steering_signal_V"),
        (changed(joint_angle_rad=np.degrees), "joint_angle_rad reaches .*degrees"),
        (changed(joint_angle_rad=lambda x: 0.0 * x + 0.1), "joint_angle_rad is 0.1 throughout"),
        (changed(joint_angle_rad=lambda x: -x), "turns against its command"),
        (changed(steering_signal=lambda x: 100.0 * x), r"steering_signal is 80 in row .* must be in \[-1, 1\]"),
        (changed(pressure_a_bar=lambda x: 1e5 * x), "logged in Pa"),
        (changed(pressure_a_bar=lambda x: 14.5 * x), "kPa or psi"),
        (changed(joint_angle_rad=lambda x: np.minimum(x, -0.3)), r"joint_angle_rad stays at exactly -0\.3 for 1\.\d+ s"),
        (changed(joint_angle_rad=lambda x: held(x, 120, 140)), r"line 142: the joint angle jumps by \d\.\d+° in 0\.01 s"),
        (changed(joint_angle_rad=lambda x: np.where(np.arange(len(x)) == 120, 0.0, x)), "line 122: .* leave such rows out"),
        (changed(joint_angle_rad=lambda x: np.r_[x[40:], x[:40] - x[0] + x[-1]]), "turns by .* before the first command"),
        (changed(pressure_a_bar=lambda x: np.where(np.arange(len(x)) > 99, np.nan, x)), "line 102: pressure_a_bar = 'nan'"),
        (changed(joint_angle_rad=lambda x: np.where(np.arange(len(x)) == 7, np.inf, x)), "line 9: joint_angle_rad = 'inf'"),
        (changed(steering_signal=lambda x: 0.0 * x + 0.8), "begins with 0.01 s of zero commands"),
        (without("time_s"), "no column time_s, only steering_signal"),
        (without("joint_angle_rad"), "no column joint_angle_rad or joint_angle_deg"),
        (changed(time_s=lambda t: t + np.where(t > 1.0, 0.4, 0.0)), "a gap of 0.41 s"),
        (changed(time_s=lambda t: np.where(np.arange(len(t)) % 10 == 5, t - 0.02, t)), "repeats or runs backwards"),
        ({**columns(), "steering_signal_V": 2.5 + 2.0 * columns()["steering_signal"]}, "positive is left"),
    ],
    ids=[
        "short", "coarse", "short and coarse", "no rest", "no command", "no signal", "degrees", "constant", "mirrored",
        "percent", "pascal", "psi", "saturated angle", "dropout", "glitch", "late clock",
        "stretch of nan", "infinite", "constant command", "no time", "no angle", "gap", "unsorted", "contradicting",
    ],
)  # fmt: skip
def test_bad_log_is_refused_with_its_reason(tmp_path, table, says):
    with pytest.raises(ValueError, match=says):
        read_recording(written(tmp_path, table))


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (changed(time_s=lambda t: np.where(np.arange(len(t)) == 150, t - 0.02, t)), "1 rows left out"),
        (changed(time_s=lambda t: t + np.where(t > 1.0, 0.05, 0.0)), "a gap of 0.060 s, bridged"),
        (changed(pressure_a_bar=lambda p: 0.0 * p + 3.0), "pressure_a_bar is 3 throughout and was not used"),
        (
            changed(pressure_a_bar=lambda p: np.minimum(p, 50.0)),
            "pressure_a_bar stays at exactly 50 for 1.99 s: its sensor is saturated, or hangs; it was not used",
        ),
        (changed(pressure_a_bar=lambda p: held(p, 120, 140)), "line 122: pressure_a_bar stays at exactly"),
        ({**columns(), "oil_level_mm": columns()["pressure_a_bar"]}, "unknown columns were not read: oil_level_mm"),
        ({**columns(), "pressure_a_psi": columns()["pressure_a_bar"]}, "pressure_a_psi not read, as pressure_a_bar is"),
        (changed(steering_signal=lambda x: np.where(np.arange(len(x)) > 100, 0.8, x)), "ends under a command"),
        (changed(joint_angle_rad=lambda x: -0.6 + 0.01 * (x + 0.6)), "hardly moves"),
    ],
    ids=[
        "one stamp",
        "small gap",
        "dead sensor",
        "saturated",
        "hangs",
        "unknown column",
        "two of a kind",
        "cut",
        "stuck",
    ],
)
def test_poor_log_is_used_with_its_limitation_named(tmp_path, table, says):
    recording = read_recording(written(tmp_path, table))
    assert any(says in sentence for sentence in recording.limitations), recording.limitations


def test_a_pressure_that_hangs_is_not_among_the_channels(tmp_path):
    recording = read_recording(written(tmp_path, changed(pressure_a_bar=lambda p: held(p, 120, 140))))
    assert set(recording.channels) == {"joint_angle"}


@pytest.mark.parametrize("step", [0.5, 2.0])
def test_a_quantiser_does_not_hang(tmp_path, step):
    """Steps of half and of twice the noise: at a standstill values repeat for long."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        table = columns(duration=8.0, level=0.2)
        noisy = table["joint_angle_rad"] + 1e-3 * rng.standard_normal(len(table["time_s"]))
        table["joint_angle_rad"] = 1e-3 * step * np.round(noisy / (1e-3 * step))
        assert read_recording(written(tmp_path, table)).limitations == ()


@pytest.mark.parametrize("noise", [0.1, 0.2, 0.3])
def test_a_coarse_angle_may_stand_still_for_any_time(tmp_path, noise):
    """A 12-bit angle whose noise is a share of its step: it flickers near an edge, and stands in the middle."""
    step = 2.0 * np.pi / 4096
    rng = np.random.default_rng(3)
    for start in np.linspace(-0.6, -0.6 + step, 7):
        table = columns(duration=6.0, level=0.5)
        angle = table["joint_angle_rad"] - table["joint_angle_rad"][0] + start
        table["joint_angle_rad"] = step * np.round(angle / step + noise * rng.standard_normal(len(angle)))
        assert read_recording(written(tmp_path, table)).limitations == ()


@pytest.mark.parametrize("period", [3, 5, 8])
@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_an_angle_that_a_slow_bus_holds_moves_in_steps(tmp_path, period, noise):
    """Held for 30 to 80 ms while the joint turns at 0.7 rad/s: steps of up to 3.2°, at 5.6 rad/s by the sample."""
    table = columns(duration=2.5)
    table["steering_signal"] = np.where(table["time_s"] < 2.0, np.sign(table["steering_signal"]), 0.0)
    angle = -0.6 + 0.7 * np.cumsum(np.r_[0.0, table["steering_signal"][:-1]]) / 100.0
    angle = np.clip(angle, None, 0.5)[(np.arange(len(angle)) // period) * period]
    table["joint_angle_rad"] = angle + noise * np.random.default_rng(4).standard_normal(len(angle))
    assert read_recording(written(tmp_path, table)).limitations == ()
    table["joint_angle_rad"][100] += np.radians(3.0)  # a spike among the steps
    with pytest.raises(ValueError, match="jumps by"):
        read_recording(written(tmp_path, table))


def test_a_log_of_a_drive_does_not_say_that_the_joint_stands(tmp_path):
    table = columns()
    table["drive_signal"] = table.pop("steering_signal")
    table["steering_signal"] = 0.0 * table["time_s"]
    table["joint_angle_rad"] = 1e-4 * np.random.default_rng(0).standard_normal(len(table["time_s"]))
    assert read_recording(written(tmp_path, table)).limitations == ()


def test_manifest_that_is_no_toml_is_named(tmp_path):
    path = written(tmp_path, columns())
    path.with_suffix(".toml").write_text("a = = 1")
    with pytest.raises(ValueError, match="not TOML"):
        read_recording(path)
