"""Courses to learn on, and others to evaluate on."""

import numpy as np
import pytest

from aoro_gym.agents.training import courses as training
from aoro_gym.agents.training.courses import made_courses, meet_worlds
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.cli.courses import training_courses
from aoro_gym.envs import Course
from aoro_gym.envs.core import ray_scenes
from aoro_gym.envs.forest_run import courses as forest_run
from aoro_gym.envs.forest_run.environment import ForestRunVectorEnv
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.paths.planning import NoDrivablePath
from aoro_gym.terrains.world.world import World

TRACKING = "AORO/PathTracking-v0"


def test_evaluation_is_on_ground_that_was_held_out(tmp_path, monkeypatch):
    monkeypatch.setattr("aoro_gym.agents.training.courses.HELD_OUT_FORESTS", (101,))
    assert training_courses(TrainingPlan()) == (None, None)
    learned, held_out = training_courses(TrainingPlan(env=TRACKING, forests=1))
    assert learned is not None and held_out is not None
    assert [course.name for course in learned] == ["forest 1"]
    assert [course.name for course in held_out] == ["forest 101"]

    def grown(seed: int) -> Course:
        if seed in (1, 3):
            raise NoDrivablePath("too dense")
        return Course(Plane(), (Line(np.array([[0.0, 0.0], [9.0, 0.0]]), name="ahead"),), name=f"forest {seed}")

    monkeypatch.setattr("aoro_gym.agents.training.courses.forest_course", grown)
    learned, _ = training_courses(TrainingPlan(env=TRACKING, forests=3))
    assert learned is not None
    assert [course.name for course in learned] == ["forest 2", "forest 4", "forest 5"]
    with pytest.raises(ValueError, match="forests is 99, but there are 98 to learn on; ask for fewer"):
        training_courses(TrainingPlan(env=TRACKING, forests=99))
    monkeypatch.undo()

    x = np.arange(0.0, 40.0, 1.0)
    rows = [(a, b, 0.02 * a) for b in x for a in x]
    np.savetxt(tmp_path / "slope.csv", rows, delimiter=",", header="x,y,z", comments="")
    own = TrainingPlan(env=TRACKING, terrain=str(tmp_path / "slope.csv"), path_length=15.0)
    learned, held_out = training_courses(own)
    assert learned is not None and held_out is not None
    assert learned[0].terrain is held_out[0].terrain
    places = [{path.points.tobytes() for path in courses[0].paths} for courses in (learned, held_out)]
    assert [len(each) for each in places] == [4, 4]
    assert not places[0] & places[1]

    (tmp_path / "lane.csv").write_text("x,y\n5,10\n8,10\n11,10\n14,10\n")
    learned, held_out = training_courses(TrainingPlan(env=TRACKING, path=str(tmp_path / "lane.csv")))
    assert learned is held_out  # there is no other


def test_worlds_that_the_disk_lacks_are_grown_first(monkeypatch, tmp_path):
    """Those to evaluate on, too; many by other processes, and none that is there already."""
    monkeypatch.setenv("AORO_GYM_CACHE", str(tmp_path))
    lacking = {2, 3, 5_001}
    grown, shares, spread = [], [], []
    monkeypatch.setattr(forest_run, "is_kept", lambda seed, difficulty: seed not in lacking)
    monkeypatch.setattr(forest_run, "forest_run_course", lambda *one: grown.append(one))
    monkeypatch.setattr(forest_run, "learned_courses", lambda count: ("learned",) * count)
    monkeypatch.setattr(forest_run, "validation_courses", lambda: ("held out",))
    monkeypatch.setattr(training, "spread", lambda work, jobs, workers: spread.append(jobs) or iter(jobs))
    assert made_courses(training.FOREST_RUN, 4, shares.append) == (("learned",) * 4, ("held out",))
    assert grown == [(2, 0.7), (3, 1.0), (5_001, 0.229)]  # difficulties of 4 and of 8 from 0.1 to 1
    assert shares == [1 / 3, 2 / 3, 1.0]
    assert not spread
    monkeypatch.setattr(training, "GROWN_HERE", 2)
    made_courses(training.FOREST_RUN, 4)
    assert spread == [{"2": (2, 0.7), "3": (3, 1.0), "5001": (5_001, 0.229)}]
    assert len(grown) == 3


def test_worlds_are_met_before_the_first_episode(monkeypatch):
    """No scene is made twice: episodes find all of them. Planes, and environments without rays, have none to be made."""
    ground = Terrain.from_heights(np.zeros((31, 31)), cell=1.0, corner=(-15.0, -15.0))
    ahead = Line(np.array([[-5.0, 0.0], [10.0, 0.0]]), name="ahead")
    courses = [Course.over(World(ground, ()), [ahead]) for _ in range(3)]
    made, shares, of = [], [], Scene.of_world
    monkeypatch.setattr(ray_scenes.Scene, "of_world", lambda world, **how: made.append(world) or of(world, **how))
    env = ForestRunVectorEnv(3, courses=courses)
    meet_worlds(courses, env, shares.append)
    assert shares == [0.0, 1 / 3, 2 / 3]
    assert len(made) == 3
    env.reset(seed=1, options={"terrain": np.arange(3)})
    assert len(made) == 3
    env.close()
    blind = ForestRunVectorEnv(1, courses=courses, observation_terms={"obstacles": None})
    meet_worlds([Course.over(World(ground, ()), [ahead])], blind)
    meet_worlds(None, env)
    meet_worlds([Course(Plane(), (ahead,))], env)
    assert len(made) == 3
    blind.close()
