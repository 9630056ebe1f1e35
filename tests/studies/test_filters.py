"""Filters of the joint's flow: against SciPy, and what the study says of them."""

from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from aoro_gym import Machine
from aoro_gym.execution.files import read_json
from aoro_gym.sensors.chain import CUTOFF, SAMPLE_RATE
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.turns import Turn, run_turns
from studies.filters import FILTERS, LEVELS, figures_by_filter, in_bounds, markdown

ROOT = Path(__file__).parents[2]


def scipys(name: str, values: np.ndarray) -> np.ndarray:
    """The same filter by its transfer function."""
    if name == "7-point mean":
        return np.asarray(signal.savgol_filter(values, 7, 0, mode="nearest"))  # a polynomial of degree 0
    low, up = np.array(signal.butter(2 if name.startswith("second") else 4, CUTOFF, fs=SAMPLE_RATE))
    filtered = signal.lfilter(low, up, values) if name == "one pass" else signal.filtfilt(low, up, values, padlen=200)
    return np.asarray(filtered)


@pytest.mark.parametrize("name", FILTERS)
def test_filters_are_those_of_scipy(name):
    """Noise between two seconds of rest, which is longer than the filters remember."""
    rng = np.random.default_rng(0)
    values = np.concatenate([np.zeros(200), rng.standard_normal(300), np.zeros(200)])
    # polynomials of the eighth degree beside sections of the second: 1e-16 by the conditioning of the former, 1e6
    np.testing.assert_allclose(FILTERS[name].filtered(values), scipys(name, values), atol=1e-9)
    others = [other for other in FILTERS if other != name]
    assert all(np.abs(FILTERS[other].filtered(values) - scipys(name, values)).max() > 0.05 for other in others)


def test_bounds_are_those_of_the_published_rows():
    rows = {r["signal_percent"]: r for r in published_rows() if (r["source"], r["direction"]) == ("mevea", "left")}
    figures = np.array([[rows[level][name] for name in FIGURES] for level in LEVELS], dtype=np.float64)
    assert np.all(in_bounds(figures, "mevea"))
    # by hand: its first peak at 50 % is 45 % above the machine's, its time at 100 % the machine's own
    assert in_bounds(figures, "physical")[0, 0] and not in_bounds(figures, "physical")[2, 3]
    figures[1, 4] += 0.0201
    assert np.argwhere(~in_bounds(figures, "mevea")).tolist() == [[1, 4]]


def test_the_stored_figures_are_those_of_the_machine():
    stored = read_json(ROOT / "studies/filters_results/figures.json")["filters"]
    found = figures_by_filter(run_turns(Machine.load("aoro"), [Turn("left", level) for level in LEVELS]))
    for name, figures in found.items():
        # 5e-3 is what devices may differ by; times are read from samples
        np.testing.assert_allclose(figures[:, 1:4], np.array(stored[name]["aoro"])[:, 1:4], rtol=5e-3)
        np.testing.assert_allclose(figures[:, [0, 4]], np.array(stored[name]["aoro"])[:, [0, 4]], atol=0.0101)


def test_the_page_has_the_table():
    page = (ROOT / "docs/evidence/filters.md").read_text(encoding="utf-8")
    assert markdown(read_json(ROOT / "studies/filters_results/figures.json")).strip() in page
