"""The library: the same whatever is simulated in one go, and after it was written and read."""

from pathlib import Path

import numpy as np

from aoro_gym.diagnosis_benchmark.judge.library import Extent, Library, build
from aoro_gym.diagnosis_benchmark.judge.suite import Suite, plan
from tests.diagnosis_benchmark.judge.families import Made

SUITE = Suite("by hand", 3, 3, 0, 0, 2, 1, 2, 1, ("left_50", "right_75", "steps_1"))
FAMILY = Made("law_0.05", 0.05)


def test_it_does_not_depend_on_how_many_manoeuvres_are_simulated_together(tmp_path: Path) -> None:
    excitations = list(plan(SUITE, [FAMILY], 3).excitations.values())
    told: list[str] = []
    one = build(FAMILY, excitations, Extent(3, 2, 2, (0.5, 1.0)), 1, told.append)
    build(FAMILY, excitations, Extent(3, 2, 2, (0.5, 1.0)), 1, together=2).save(tmp_path / "library.npz")
    other = Library.load(tmp_path / "library.npz")
    assert told == [f"{FAMILY.name}: {name}" for name in SUITE.only or ()]
    assert one.paths == other.paths
    for name in SUITE.only or ():
        np.testing.assert_array_equal(one.days[name].values, other.days[name].values)
        np.testing.assert_array_equal(one.exact[name].values, other.exact[name].values)
        np.testing.assert_array_equal(one.effects[name], other.effects[name])
        assert np.ptp(one.days[name].values[:, :, 0]) > 0.0  # machines and days differ
