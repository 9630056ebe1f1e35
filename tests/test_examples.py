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

    def run(name: str) -> dict[str, Any]:
        return runpy.run_path(str(EXAMPLES / name))

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
