"""Machines of the independent plants: healthy figures, effects of the size that is asked for, logs that are finite."""

import math
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.independent import (
    EFFECTS,
    FAMILIES,
    OUTSIDE,
    Run,
    another_day,
    apply,
    figures,
    machine,
    magnitudes,
    measure,
    nominal,
    record,
    trace,
)
from aoro_gym.diagnosis_benchmark.independent.families import GROUP
from aoro_gym.diagnosis_benchmark.independent.turns import PUBLISHED, PUBLISHED_RIGHT, key_figures
from tests.diagnosis_benchmark.independent.plants import back_and_forth, turn
from tests.effects.test_catalogue import IDS


def test_every_effect_is_there():
    assert sorted(EFFECTS) == sorted(IDS)
    assert len(OUTSIDE) >= 14


@pytest.mark.parametrize("family", FAMILIES)
def test_healthy_turns_are_those_of_the_published_vehicle(family):
    duration = {100: 2.9, 75: 3.5, 50: 9.2}
    logs = trace([turn(family, share / 100, seconds) for share, seconds in duration.items()], period=0.01)
    for (share, published), log in zip(PUBLISHED.items(), logs, strict=True):
        got = key_figures(log["angle"], nominal(family))
        for name, value in published.items():
            assert got[name] == pytest.approx(value, rel=0.25), (share, name)


@pytest.mark.parametrize("family", FAMILIES)
def test_right_turn_is_slower(family):
    left, right = trace([turn(family, 1.0, 3.2), turn(family, -1.0, 3.2)], period=0.01)
    times = [key_figures(log["angle"], nominal(family))["turn_time"] for log in (left, right)]
    assert 1.02 < times[1] / times[0] < 1.2
    assert times[1] == pytest.approx(PUBLISHED_RIGHT[100]["turn_time"], rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_drawn_machines_make_plausible_turns(family):
    rng = np.random.default_rng(5)
    machines = [machine(family, rng) for _ in range(24)]
    logs = trace([turn(family, 1.0, 3.2, machine=one) for one in machines], period=0.01)
    turns = [key_figures(log["angle"], one) for log, one in zip(logs, machines, strict=True)]
    for name, value in PUBLISHED[100].items():
        values = np.array([one[name] for one in turns])
        assert np.median(values) == pytest.approx(value, rel=0.25)
        assert np.all(np.abs(values / value - 1.0) < 0.4)


@pytest.mark.parametrize("family", FAMILIES)
def test_joint_stays_between_its_stops(family):
    (log,) = trace([turn(family, 1.0, 3.2)], period=0.01)
    stop = nominal(family)["stop_angle"]
    assert math.degrees(stop) - 0.2 < math.degrees(log["angle"][-1]) < math.degrees(stop) + 0.6
    assert np.max(np.abs(log["angle"])) < stop + math.radians(1.5)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_effect_moves_its_magnitude_by_its_size(family):
    healthy = machine(family, np.random.default_rng(3))
    before = magnitudes(family, healthy)
    for effect, one in EFFECTS.items():
        for size in (sign * some for sign in one.signs for some in (one.weak, one.strong)):
            got = measure(effect, family, apply(effect, family, healthy, size)) - before[effect]
            wanted = size * before[effect] if one.relative else size
            assert got == pytest.approx(wanted, rel=1e-6), (effect, size)
        assert apply(effect, family, healthy, 0.0) == healthy


@pytest.mark.parametrize("family", FAMILIES)
def test_an_effect_leaves_the_other_effects_magnitudes_alone(family):
    healthy = nominal(family)
    before = magnitudes(family, healthy)
    shared = {
        "oil_temperature",
        "soft_ground",
        "payload",
        "entrained_air",
        "oil_bulk_modulus",
    }  # physics ties them to others
    for effect, one in EFFECTS.items():
        after = magnitudes(family, apply(effect, family, healthy, one.signs[0] * one.strong))
        moved = {name for name in EFFECTS if abs(after[name] - before[name]) > 1e-3 * abs(before[name]) + 1e-9}
        assert effect in moved
        if effect not in shared:
            assert moved - {effect} <= GROUP.family_of(family).TIED.get(effect, set()), effect


def strong_runs(family, ends):
    runs = []
    for effect, one in EFFECTS.items():
        for sign in one.signs:
            runs += [back_and_forth(family, effects={effect: sign * getattr(one, end)}) for end in ends]
    return runs


@pytest.mark.parametrize("family", FAMILIES)
def test_logs_are_finite_and_effects_show(family):
    healthy, *logs = record([back_and_forth(family), *strong_runs(family, ["strong"])], noise=False)
    silent = set()
    names = [effect for effect, one in EFFECTS.items() for _ in one.signs]
    for effect, log in zip(names, logs, strict=True):
        assert all(np.all(np.isfinite(column)) for column in log.values()), effect
        scales = (("joint_angle", 1e-3), ("pressure_a", 1e5))
        if max(np.ptp(log[name] - healthy[name]) / scale for name, scale in scales) < 1.0:
            silent.add(effect)
    assert silent <= {"engine_droop", "pump_limit", "tire_relaxation"}
    assert all(EFFECTS[effect].note for effect in silent)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_logs_are_finite_at_both_ends_of_drawn_machines(family):
    rng = np.random.default_rng(9)
    runs = [
        Run(family, machine(family, rng), run.steering, run.effects, joint_angle=rng.uniform(-0.6, 0.6))
        for run in strong_runs(family, ["weak", "strong"])
    ]
    assert all(np.all(np.isfinite(column)) for log in record(runs) for column in log.values())


def mixed_run(family, rng, seed):
    """A drawn machine with some effects of any size, perhaps a deviation and driving, commands at random."""
    effects = {}
    for name in rng.choice(list(EFFECTS), rng.integers(1, 5), replace=False):
        one = EFFECTS[name]
        effects[str(name)] = float(rng.choice(one.signs) * one.weak * (one.strong / one.weak) ** rng.random())
    command = np.repeat(rng.uniform(-1.0, 1.0, 8) * (rng.random(8) < 0.8), 30)
    drive = np.repeat(rng.uniform(-0.5, 0.5, 3), 80) if rng.random() < 0.3 else None
    outside = str(rng.choice(list(OUTSIDE))) if rng.random() < 0.4 else None
    more = {"joint_angle": rng.uniform(-0.65, 0.65), "seed": seed, "outside": outside, "outside_size": rng.random()}
    return Run(family, machine(family, rng), command, effects, drive, **more)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_effects_together_stay_finite_and_accurate(family):
    rng = np.random.default_rng(77)
    runs = [mixed_run(family, rng, seed) for seed in range(60)]
    whole, half = trace(runs, period=0.01), trace(runs, period=0.01, step=5e-5)
    pairs = list(zip(whole, half, strict=True))
    errors = [[np.sqrt(np.mean((a[side] - b[side]) ** 2)) for a, b in pairs] for side in ("exact_a", "exact_b")]
    assert np.quantile(np.max(errors, axis=0), 0.95) < 0.05e5
    assert all(np.all(np.isfinite(log["angle"])) and log["exact_pump"].max() < 400e5 for log in whole)
    assert all(np.max(np.abs(log["angle"])) < 0.75 for log in whole)


@pytest.mark.parametrize("family", FAMILIES)
def test_deviations_outside_of_the_catalogue_show(family):
    runs = [back_and_forth(family, outside=name, outside_size=1.0, seed=4) for name in OUTSIDE]
    healthy, *logs = record([back_and_forth(family, seed=4), *runs], noise=False)
    for name, log in zip(OUTSIDE, logs, strict=True):
        assert all(np.all(np.isfinite(column)) for column in log.values()), name
        scales = (("joint_angle", 1e-3), ("pressure_a", 1e5), ("pressure_b", 1e5), ("engine_speed", 1.0))
        assert max(np.ptp(log[column] - healthy[column]) / scale for column, scale in scales) > 1.0, name


def test_page_has_the_tables_of_effects_and_deviations():
    page = (Path(__file__).parents[3] / "docs/evidence/independent_plants.md").read_text(encoding="utf-8")
    for row in (*figures.effects(), *figures.deviations()):
        assert row in page


def test_noise_is_seeded_and_of_its_size():
    family = FAMILIES[0]
    runs = [Run(family, nominal(family), np.zeros(100), seed=seed) for seed in (1, 1, 2)]
    one, again, other = record(runs)
    (quiet,) = record(runs[:1], noise=False)
    assert np.array_equal(one["joint_angle"], again["joint_angle"])
    assert not np.array_equal(one["joint_angle"], other["joint_angle"])
    assert 1e-4 < np.std(one["joint_angle"] - quiet["joint_angle"]) < 2e-3
    assert 0.1e5 < np.std(one["pressure_a"] - quiet["pressure_a"]) < 0.5e5
    steps = one["joint_angle"] / nominal(family)["angle_step"]
    assert np.allclose(steps, np.round(steps), atol=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_another_day_is_nearly_the_same_machine(family):
    rng = np.random.default_rng(8)
    healthy = machine(family, rng)
    other = another_day(family, healthy, rng)
    changed = {name for name in healthy if other[name] != healthy[name]}
    assert {"oil_temperature", "seal_friction", "air", "ground_friction", "angle_offset"} <= changed
    assert len(changed) < 0.5 * len(healthy)
    assert abs(other["oil_temperature"] - healthy["oil_temperature"]) < 5.0


def test_wrong_input_is_refused():
    family = FAMILIES[0]
    good = nominal(family)
    for run, message in (
        (Run("elm", good, np.zeros(5)), "family must be one of"),
        (Run(family, good, np.full(5, 1.2)), "steering"),
        (Run(family, good, np.zeros(5), drive=np.zeros(4)), "drive"),
        (Run(family, good, np.zeros(5), {"rust": 1.0}), "no effect 'rust'"),
        (Run(family, good, np.zeros(5), outside="rust"), "no deviation 'rust'"),
    ):
        with pytest.raises(ValueError, match=message):
            record([run])
    with pytest.raises(ValueError, match="out of what family"):
        apply("oil_bulk_modulus", family, good, -1.5)
