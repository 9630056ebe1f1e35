"""The examples run and show what they say."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture
def example(monkeypatch, tmp_path):
    """Runs an example in an empty folder; returns its variables."""
    monkeypatch.chdir(tmp_path)

    def run(name: str, run_name: str = "example") -> dict[str, Any]:
        return runpy.run_path(str(EXAMPLES / name), run_name=run_name)

    return run


def test_a_turn_takes_as_long_as_published(example, tmp_path):
    found = example("01_turn.py")
    # the bound that a validation sets on the time, 2 %
    assert found["figures"]["turn_time_s"] == pytest.approx(found["published"]["mevea"]["turn_time_s"], rel=0.02)
    assert (tmp_path / "turn.png").stat().st_size > 0


def test_every_vehicle_of_an_environment_ends_with_a_return(example):
    found = example("02_environment.py")
    assert not found["running"].any()
    assert np.isfinite(found["returns"]).all() and (found["returns"] != 0.0).all()


def test_the_hidden_fault_shows_and_nothing_but_noise_is_left_of_the_gap(example):
    least = example("03_diagnose_a_log.py")["least"]
    assert min(least, key=least.__getitem__) == "spool_lag"
    # the noise is known from 60 samples, to 9 % (standard deviation)
    assert least["spool_lag"] < 1.3 < least["nothing"]


def test_steeper_and_slower_gears_take_more_pressure(example):
    found = example("04_drive.py")
    speed, pressure = (found[name].reshape(3, 3) for name in ("speed", "pressure"))  # slopes by gears
    assert (np.diff(speed, axis=1) > 0.0).all() and (np.diff(pressure, axis=0) > 0.0).all()


def test_a_machine_of_ones_own_is_written_and_turns(example, tmp_path):
    found = example("05_own_machine.py")
    assert (tmp_path / "mine.toml").stat().st_size > 0
    # the same oil at a flow in proportion to the valve's; the start takes less than in proportion
    assert found["times"][0] / found["times"][-1] == pytest.approx(1.0 / 0.7, rel=0.05)


def test_ground_of_ones_own_is_driven_over(example):
    found = example("06_own_terrain.py")
    assert found["arrived"] and found["rms"] < 0.1


def test_a_reward_of_ones_own_is_logged(example):
    found = example("07_custom_reward.py")
    assert found["sums"]["reward/haste"] < 0.0


def test_stable_baselines_learns(example, tmp_path):
    pytest.importorskip("stable_baselines3", reason="[agents] is not installed")
    found = example("08_train_stable_baselines3.py")
    assert np.isfinite(found["rewards"]).all()
    assert (tmp_path / "turning.zip").stat().st_size > 0


def test_a_controller_of_ones_own_follows_the_path(example, monkeypatch):
    """At least as a person would: within a machine's width, and to the end."""
    monkeypatch.setattr("sys.argv", ["09_controller.py"])
    found = example("09_controller.py", run_name="__main__")["found"].summary
    assert found["mine"]["success_rate"].mean == 1.0
    assert found["mine"]["cross_track_rms_m"].mean < 0.5


def test_skrl_learns_on_tensors(example, tmp_path):
    pytest.importorskip("skrl", reason="[resident] is not installed")
    found = example("10_train_skrl.py")
    assert all(bool(one.isfinite().all()) for one in found["rewards"])
    # every rollout is learned from in four passes over four batches
    steps = {int(state["step"]) for state in found["agent"].optimizer.state.values()}
    assert steps == {found["STEPS"] // found["ROLLOUT"] * 4 * 4}
    assert (tmp_path / "turning.pt").stat().st_size > 0


@pytest.mark.slow
def test_what_was_hidden_is_calibrated(example, tmp_path):
    found = example("11_calibrate_from_logs.py")
    for key, hidden in found["HIDDEN"].items():
        row = found["parameters"][key]
        # half an interval more on either side: four standard deviations
        slack = 0.5 * (row["high95"] - row["low95"])
        assert row["identified"] and row["low95"] - slack <= hidden <= row["high95"] + slack
    assert (tmp_path / "calibrated.toml").stat().st_size > 0


@pytest.mark.slow
def test_a_lidars_odometry_tracks_the_true_path_within_a_hundredth(example, tmp_path):
    found = example("12_lidar_odometry.py")
    assert found["driven"][-1] == pytest.approx(100.0, abs=3.0)
    assert found["error"].max() < 0.01 * found["driven"][-1]
    assert (tmp_path / "odometry.png").stat().st_size > 0
