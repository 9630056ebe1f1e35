"""Episodes of levelling: each seed has its lane, metrics follow from what was driven."""

import numpy as np
import pytest

from aoro_gym.agents.controllers.reference import reference_policy
from aoro_gym.agents.evaluation.drives import every_path
from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.levelling import level_lanes, make_levelling
from aoro_gym.agents.evaluation.logs import write_episode
from aoro_gym.agents.evaluation.metrics import named
from aoro_gym.envs.levelling.courses import held_out_courses
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.recording.tables import read_table
from aoro_gym.terrains import Path, Plane

ENV = "AORO/Levelling-v0"
LINES = tuple(Path(np.array([[0.0, 0.0], [length, 0.0]]), name=f"{length} m") for length in (8.0, 10.0))
SLOPE = Course(Plane(slope_deg=4.0, direction_deg=90.0), LINES, name="side slope")


class Still:
    """Moves no arm."""

    def __init__(self, env):
        self.forgotten = []

    def __call__(self, observations):
        return np.zeros((len(observations), 4), dtype=np.float32)

    def reset(self, mask=None):
        self.forgotten.append(mask)


@pytest.fixture(scope="module")
def found():
    policies = {"assistance": lambda env: reference_policy(ENV, "assistance", env), "still": Still}
    return evaluate(ENV, policies, episodes=2, seed=4, courses=[SLOPE])


def test_two_hundred_seeds_in_a_row_drive_every_held_out_lane_once():
    courses = held_out_courses()
    for first in (0, 60_000):
        chosen = every_path(courses, range(first, first + 200))
        assert len(set(zip(chosen["terrain"].tolist(), chosen["path"].tolist(), strict=True))) == 200
    few = every_path(courses, range(16))["terrain"]  # of 40 grounds from easy to difficult
    assert few.min() < 8 and few.max() > 32


def test_a_seed_drives_the_same_lane_whoever_drives(found):
    runs = list(found.runs.values())
    np.testing.assert_array_equal(runs[0].course, runs[1].course)
    assert {tuple(row) for row in runs[0].course} == {(0, 0), (0, 1)}


def test_metrics_are_of_what_was_driven(found):
    still, levelled = found.runs["still"], found.runs["assistance"]
    # the frames lie as the slope does but for the tires: the lower ones are pressed in more
    assert np.all(np.abs(still.metrics["tilt_rms_deg"] - 4.0) < 0.8)
    assert np.all(levelled.metrics["tilt_rms_deg"] < 0.6 * still.metrics["tilt_rms_deg"])
    for run in (still, levelled):
        metrics = run.metrics
        assert np.all(metrics["tilt_rms_deg"] <= metrics["largest_tilt_deg"] + 1e-6)
        assert np.all(metrics["tilt_p95_deg"] <= metrics["largest_tilt_deg"])
        lengths = np.array([LINES[path].length for path in run.course[:, 1]])
        # from 4 m to 0.25 m before the end; a step is 4 cm
        np.testing.assert_allclose(metrics["driven_m"], lengths - 4.25, atol=0.06)
        assert run.endings == ["end of path reached"] * 2
        known = np.isfinite(run.errors)
        assert np.all(run.errors[known] <= np.repeat(metrics["largest_tilt_deg"], known.sum(axis=1)) + 1e-6)
    assert np.all(levelled.metrics["pump_kJ_per_m"] > still.metrics["pump_kJ_per_m"])
    assert np.all(levelled.metrics["arm_way_m_per_m"] > still.metrics["arm_way_m_per_m"])
    assert found.ranking[0] == "assistance"


def test_units_of_metrics_are_told():
    assert named("pump_kJ_per_m") == ("pump", "kJ/m")
    assert named("arm_way_m_per_m") == ("arm way", "m/m")
    assert named("tilt_rms_deg") == ("tilt rms", "°")


def test_the_first_episode_is_logged(found, tmp_path):
    write_episode(found, "assistance", tmp_path / "episode.csv")
    table = read_table(tmp_path / "episode.csv")
    run = found.runs["assistance"]
    assert len(table["time_s"]) == len(run.film)
    assert np.abs(table["true_roll_deg"]).max() == pytest.approx(4.0, abs=0.8)


def test_environments_that_reset_themselves_are_refused():
    env = make_levelling(1, [SLOPE])
    with pytest.raises(ValueError, match="autoreset_mode is 'NextStep', but an evaluation needs 'Disabled'"):
        level_lanes(env, Still(env), [0])


def test_the_shipped_policies_level():
    policies = {name: policy_factory(ENV, name) for name in ("levelling-dagger", "levelling-ppo")}
    for run in evaluate(ENV, policies, episodes=2, seed=4, courses=[SLOPE]).runs.values():
        assert run.endings == ["end of path reached"] * 2
        assert np.all(run.metrics["tilt_rms_deg"] < 0.6 * 4.0)
