"""Episodes of forest runs: metrics follow from what was driven."""

import numpy as np
import pytest

from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.metrics import named
from tests.envs.forest_run.worlds import course

ENV = "AORO/ForestRun-v0"


@pytest.fixture(scope="module")
def found():
    policies = {name: policy_factory(ENV, name) for name in ("map-planner", "straight")}
    return evaluate(ENV, policies, episodes=2, seed=4, courses=[course()])


def test_metrics_are_of_what_was_driven(found):
    planned, straight = found.runs["map-planner"], found.runs["straight"]
    np.testing.assert_array_equal(planned.course, straight.course)
    blocked = int(np.flatnonzero(planned.course[:, 1] == 0)[0])
    free = 1 - blocked
    assert planned.endings == ["goal reached"] * 2
    assert straight.endings[blocked] == "hit an object" and straight.endings[free] == "goal reached"
    assert straight.metrics["damage_kNs"][blocked] > 0.0 and straight.metrics["largest_force_kN"][blocked] > 50.0
    assert np.all(planned.metrics["damage_kNs"] == 0.0)
    assert np.isnan(straight.metrics["duration_s"][blocked]) and np.all(planned.metrics["duration_s"] > 15.0)
    shares = planned.metrics["success_by_length_share"]
    assert np.all((shares > 0.9) & (shares <= 1.0))
    assert straight.metrics["success_by_length_share"][blocked] == 0.0
    assert np.all(planned.metrics["left_m"] <= 1.5) and straight.metrics["left_m"][blocked] > 5.0
    assert found.ranking == ["map-planner", "straight"]
    # the distance to the goal falls along the way
    there = planned.errors[free][np.isfinite(planned.errors[free])]
    assert np.all(np.diff(there) < 0.01) and there[0] == pytest.approx(21.0, abs=0.3)


def test_units_are_told():
    assert named("damage_kNs") == ("damage", "kN s")
    assert named("largest_force_kN") == ("largest force", "kN")
    assert named("success_by_length_share") == ("success by length share", "%")
