"""The whole calibration against published figures, on turns in closed form."""

from typing import Any

import numpy as np
import pytest

from aoro_gym.calibration import procedure, published, right_turns
from aoro_gym.calibration.procedure import measured_curve, rolling_pressure
from aoro_gym.calibration.published import SINGLE_FIGURES, calibrate_published
from aoro_gym.calibration.right_turns import RIGHT_FIGURES
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.units import BAR
from aoro_gym.validation.published import published as value_of
from aoro_gym.validation.published import published_rows, valve_flow

VALVE = "steering.valve"
SIZES: dict[str, Any] = {"starts": 1, "population": 4}


def rows(direction, source):
    return {
        row["signal_percent"]: row
        for row in published_rows()
        if (row["direction"], row["source"]) == (direction, source)
    }


def turns_in_closed_form(machine, turns, *, peak=1.05, wave=0.0, swing=False, progress=lambda machines: None, **_):
    """A mean flow by the valve's curve and its edge's drop, a time by the mean flow; of the left the published twin's
    figures, but first peaks are ``peak`` times as high and fall with the tenth root of the spool's time constant. The steady
    flow swings by ``wave``, and less with the same root."""
    out = np.full((len(turns), len(FIGURES) + 2 * swing, machine.num_variants), np.nan)
    table = valve_flow()
    for i, turn in enumerate(turns):
        side, entries = turn.direction, machine.entries
        volts, name = {100.0: (2.0, ""), 75.0: (1.5, "1V5"), 50.0: (1.0, "1V0")}[turn.signal_percent]
        curve = dict(zip(table["signal_V"], table[f"{side}_L_per_min"], strict=True))
        share = entries[f"{VALVE}.nominal_flow_{side}"].value / curve[volts]
        share = share * np.sqrt(7.0 / entries[f"{VALVE}.nominal_drop_in_{side}"].value)
        if name:
            share = share * entries[f"{VALVE}.opening_{side}_{name}"].value
        known = rows(turn.direction, "mevea" if turn.direction == "left" else "physical")[turn.signal_percent]
        for at, name in enumerate(FIGURES):
            wanted: Any = np.nan if known[name] is None else known[name]
            out[i, at] = wanted / share if name == "turn_time_s" else wanted * (1.0 if name.endswith("_s") else share)
            if name == "first_peak_L_per_min":
                out[i, at] = wanted * peak * (0.02 / entries[f"{VALVE}.spool_time_constant"].value) ** 0.1
        out[i, len(FIGURES) :] = wave * (0.02 / entries[f"{VALVE}.spool_time_constant"].value) ** 0.1
    progress(float(machine.num_variants))
    return out


@pytest.fixture
def quick(monkeypatch):
    """Sets how high peaks are, and makes all else quick."""

    def turn_by(**options):
        for module in (procedure, published, right_turns):
            monkeypatch.setattr(
                module,
                "population_figures",
                lambda machine, turns, **given: turns_in_closed_form(machine, turns, **given, **options),
            )

    pressure = lambda speed, machine, **_: rolling_pressure(machine) * BAR  # noqa: E731
    monkeypatch.setattr(procedure, "motor_pressure_at", pressure)
    _, bound = SINGLE_FIGURES["rim_speed"]
    rim = lambda machine, device, substeps: np.atleast_1d(value_of("rim_speed"))  # noqa: E731
    monkeypatch.setattr(published, "SINGLE_FIGURES", {**SINGLE_FIGURES, "rim_speed": (rim, bound)})
    turn_by()
    return turn_by


def test_the_most_probable_machine_gives_way_no_farther_than_figures_ask(quick):
    """Peaks 8 % too high, of which 4.7 % are allowed, ask for a slower spool: by a factor (1.08/1.047)¹⁰."""
    quick(peak=1.08)
    shares = []
    found = calibrate_published(Machine.load("aoro_datasheet"), **SIZES, progress=lambda _, share: shares.append(share))
    assert found.fits and found.report["largest_miss_tolerances"] == pytest.approx(0.94, abs=1e-3)
    assert found.report["leaning_on_a_bound"] == []
    constant = found.machine.entries[f"{VALVE}.spool_time_constant"]
    assert constant.value == pytest.approx(0.02 * (1.08 / 1.047) ** 10, rel=1e-2)
    assert shares == sorted(shares) and shares[-1] == 1.0
    right = [found.report["single_misses_tolerances"][name] for name in RIGHT_FIGURES]
    assert max(map(abs, right)) <= 0.95


def test_a_flow_that_swings_asks_for_damping_as_a_figure_does(quick):
    """A wave of 2.0 %, of which 1.88 % are allowed, asks for a slower spool: by a factor (2.0/1.88)¹⁰."""
    quick(peak=1.03, wave=0.02)
    found = calibrate_published(Machine.load("aoro_datasheet"), **SIZES)
    assert found.fits and found.report["largest_miss_tolerances"] == pytest.approx(0.94, abs=1e-3)
    constant = found.machine.entries[f"{VALVE}.spool_time_constant"]
    assert constant.value == pytest.approx(0.02 * (2.0 / 1.88) ** 10, rel=1e-2)
    for row in found.report["swings_tolerances"].values():
        assert list(row.values()) == pytest.approx([0.94, 0.94], abs=1e-3)


def test_where_no_machine_has_the_figures_the_verdict_says_so(quick):
    quick(peak=1.45)
    found = calibrate_published(Machine.load("aoro_datasheet"), **SIZES)
    assert not found.fits and "no machine within these ranges" in found.report["verdict"]["sentence"]
    assert {"key": f"{VALVE}.spool_time_constant", "end": "high"} in found.report["leaning_on_a_bound"]


def test_published_values_are_held_and_an_ensemble_is_drawn(quick):
    sheet = Machine.load("aoro_datasheet")
    found = calibrate_published(sheet, **SIZES, hold_published=True, ensemble=2)
    held = measured_curve(sheet).entries
    for key in found.report["held"]:
        assert found.machine.entries[key].value == pytest.approx(held[key].published, rel=5e-7), key
    assert not set(found.report["held"]) & set(found.report["searched"])
    assert len(found.ensemble) == 2 and found.report["ensemble_dropped"] == []
    assert max(abs(miss) for row in found.report["misses_tolerances"].values() for miss in row.values()) <= 0.95


def test_an_interrupted_calibration_ends_as_an_uninterrupted_one(quick, tmp_path):
    def until(share):
        def progress(_, done):
            if done >= share:
                raise KeyboardInterrupt

        return progress

    sheet = Machine.load("aoro_datasheet")
    whole = calibrate_published(sheet, **SIZES)
    for share in (0.5, 0.8, 0.95):
        with pytest.raises(KeyboardInterrupt):
            calibrate_published(sheet, **SIZES, folder=tmp_path, progress=until(share))
    assert (tmp_path / "search-probable.json").exists()
    assert calibrate_published(sheet, **SIZES, folder=tmp_path).report == whole.report
