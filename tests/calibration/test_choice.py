"""Logs choose the family of laws: by what it predicts of logs that were left out."""

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.calibration.choice import BLOCK, families_of, folds_of, is_apart, phases, ratio_interval, searchable
from aoro_gym.calibration.logs import calibrate_logs, times_one_family
from aoro_gym.calibration.recordings import EVERY, read_filtered_log
from aoro_gym.calibration.report import tables
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, LAWS
from tests.calibration.turn_logs import write_log

KEYS = ("steering.valve.nominal_drop_in_left", "steering.valve.spool_time_constant", "oil.bulk_modulus")
HIDDEN = {"steering.valve.nominal_drop_in_left": 8.0, "oil.bulk_modulus": 1.3e9}
TURNS = ((1.0, 1.6), (-1.0, 1.2), (0.6, 1.2))
"""Signal, and how long it holds [s]."""


@pytest.fixture
def start():
    return Machine.load("aoro_datasheet")


def logs_of(folder, machine):
    return [write_log(folder / f"turn{i}.csv", machine, *turn, seed=i) for i, turn in enumerate(TURNS)]


@pytest.mark.parametrize("plant", [pytest.param("default", marks=pytest.mark.slow), "materials"])
def test_a_look_finds_the_laws_of_the_machine_that_wrote_the_logs(start, tmp_path, plant):
    """Compensators of the two feel the load elsewhere: ports differ by tens of bar in the turn's first half second."""
    logs = logs_of(tmp_path, start.with_laws(plant).set(HIDDEN))
    families = ("default", "materials")
    found = calibrate_logs(start, logs, keys=KEYS, families=families, quick=True, starts=1, population=2)
    laws = found.report["laws"]
    assert laws["chosen"] == plant and laws["told_apart"], laws["sentence"]
    assert found.machine.laws.names == start.with_laws(plant).laws.names
    best, other = laws["families"]
    assert best["screening"] < 0.5 * other["screening"] and other["ratio_to_the_best_95"][0] > 1.0
    assert found.report["verdict"]["fits"]
    assert f"laws: {plant}, of 2 families" in "".join(map(str, tables(found.report)))


def test_a_family_cannot_be_told_apart_from_itself(start, tmp_path):
    """Laws of their own, but those of a family: the same to the bit, and said so."""
    logs = logs_of(tmp_path, start.set(HIDDEN))
    laws = calibrate_logs(
        start, logs, keys=KEYS[:1], families=("file", "default"), quick=True, starts=1, population=2
    ).report["laws"]
    assert not laws["told_apart"] and laws["alike"] == [name for name in ("file", "default") if name != laws["chosen"]]
    assert laws["families"][1]["ratio_to_the_best_95"] == [1.0, 1.0]
    assert "cannot be told apart from" in laws["sentence"]


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["default", "library", "materials"])
def test_full_fits_choose_among_all_families(start, tmp_path, plant):
    """What is chosen is the plant's family, or it is said that the two cannot be told apart."""
    logs = logs_of(tmp_path, start.with_laws(plant).set(HIDDEN))
    told, kept = [], tmp_path / "kept"
    options = {"keys": KEYS, "families": families_of(start), "starts": 1, "population": 8, "folder": kept}
    found = calibrate_logs(start, logs, progress=lambda sentence, share: told.append((sentence, share)), **options)
    laws = found.report["laws"]
    assert plant in (laws["chosen"], *laws["alike"]), laws["sentence"]
    assert all(one["ratio_to_the_best_95"] for one in laws["families"] if one["family"] != laws["chosen"])
    assert {one["family"] for one in laws["families"]} == set(FAMILIES)
    assert [one["predicted"] is not None for one in laws["families"]] == [True, True, False, False, False]
    shares = [share for _, share in told]
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert any("screening laws" in sentence for sentence, _ in told)

    told.clear()
    again = calibrate_logs(start, logs, progress=lambda sentence, share: told.append((sentence, share)), **options)
    assert again.report == found.report and not any("screening laws" in sentence for sentence, _ in told)


def test_logs_are_dealt_and_each_sample_of_movement_is_predicted_once(start, tmp_path):
    one = read_filtered_log(logs_of(tmp_path, start)[0])
    for count in (2, 3, 5):
        folds = folds_of([replace(one) for _ in range(count)])
        assert len(folds) == min(count, 3)
        for number in range(count):
            moving = np.arange(0, one.count, EVERY) >= one.rest
            np.testing.assert_array_equal(np.sum([fold.left_out[number] for fold in folds], axis=0), moving)
            assert not any(np.any(fold.left_out[number] & fold.fitted[number]) for fold in folds)
    first, second = folds_of([one])
    assert np.any(first.left_out[0]) and np.any(second.left_out[0])
    assert not np.any(first.left_out[0] & second.left_out[0])
    assert np.flatnonzero(first.left_out[0])[-1] < np.flatnonzero(second.left_out[0])[0], "halves, one after the other"


def test_the_interval_of_a_ratio():
    """Independent blocks of chi-squared mean squares: the logarithm of the ratio of two roots has the variance
    (2 / (BLOCK B)) / 2, that of each mean square's logarithm being 2 / (BLOCK B)."""
    rng, count = np.random.default_rng(0), 400
    one, two = (rng.chisquare(BLOCK, count) / BLOCK for _ in range(2))
    low, high = ratio_interval(one, 4.0 * two)
    std = np.sqrt(0.25 * 2.0 * 2.0 / (BLOCK * count))
    assert low < 2.0 < high
    assert np.log(high / low) == pytest.approx(2.0 * 1.96 * std, rel=0.15)  # 400 blocks know their variance to 7 %
    assert ratio_interval(one, one) == (1.0, 1.0)


def test_what_is_told_apart():
    assert is_apart((1.1, 2.0), 3.0, 4.0) and is_apart((0.5, 0.9), 4.0, 3.0)
    assert not is_apart((0.9, 2.0), 3.0, 4.0), "the interval holds 1"
    assert not is_apart((1.5, 2.0), 0.4, 0.7), "both are within the noise"
    assert is_apart((1.5, 3.0), 0.7, 1.4)


def test_parameters_of_the_laws_are_searched(start):
    own = set(searchable(start.with_laws("materials"))) - set(searchable(start))
    assert own == {key for law, option in FAMILIES["materials"].items() for key in LAWS[law].parameters.get(option, ())}
    assert families_of(start) == list(FAMILIES)
    assert families_of(start.with_laws("default", gas="dissolving")) == [*FAMILIES, "file"]


def test_a_look_costs_a_fraction():
    """Of the work that is told beforehand."""
    whole, look = (sum(phases(75, 5, 3, quick=quick).values()) for quick in (False, True))
    assert look < 0.15 * whole


def test_what_a_choice_costs_beside_one_family(start, tmp_path):
    """Three logs: 5 screenings of 2 Jacobians a fold, the first one shared, so 4 of them, and 6 full fits of 8 Jacobians of
    two thirds of the logs, beside 2 searches of 8 Jacobians, one that says what the logs feel, and one of the intervals."""
    one = read_filtered_log(logs_of(tmp_path, start)[0])
    jacobians = (5 * 4 + 6 * 8 * 2 / 3) / (2 * 8 + 1 + 1)
    assert times_one_family(start, [one] * 3, 5) == pytest.approx(1.0 + jacobians, rel=0.05)
    assert times_one_family(start, [one] * 3, 2) < times_one_family(start, [one] * 3, 5)
