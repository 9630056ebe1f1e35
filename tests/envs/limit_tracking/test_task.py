"""Path tracking at the limits: courses by difficulty, the task of path tracking else, and policies that are told more."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from aoro_gym.agents.controllers.exact import EXACT, Informed
from aoro_gym.agents.controllers.path_tracking import PreviewDriver, Vehicle
from aoro_gym.agents.controllers.reference import reference_policy
from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.agents.policies.files import shipped_policies
from aoro_gym.envs import LimitTrackingVectorEnv, limit_config
from aoro_gym.envs.limit_tracking.config import FIXED
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.sensors import GpsNoise, Localisation, PoseFilter, PoseFilterSettings
from aoro_gym.sensors.gps import FIXED as FIXED_SOLUTION
from aoro_gym.sensors.gps import FLOAT, NONE, FixLoss
from aoro_gym.terrains import Path, Plane
from tests.envs.path_tracking.paths import LEVEL

ENV = "AORO/PathTracking-v1"


def made(**arguments: Any) -> Any:
    return LimitTrackingVectorEnv(2, autoreset_mode="Disabled", **{"courses": [LEVEL], **arguments})


@pytest.fixture(scope="module")
def slopes() -> tuple[Course, ...]:
    """Easy courses, the easiest first."""
    from aoro_gym.envs.limit_tracking.courses import hilly_course

    return tuple(hilly_course(seed, 0.1 * seed) for seed in range(3))


def test_courses_are_drawn_by_difficulty(slopes):
    env = made(courses=slopes, randomisation=replace(FIXED, difficulty=(0.7, 1.0)))
    assert np.all(env.reset(seed=1)[1]["terrain"] == 2)
    env = made(courses=slopes, randomisation=replace(FIXED, difficulty=(0.0, 0.3)))
    assert np.all(env.reset(seed=1)[1]["terrain"] == 0)
    assert np.all(env.reset(seed=1, options={"terrain": 1})[1]["terrain"] == 1)


def test_a_step_in_kernels_is_that_of_array_operations(slopes):
    """Up to rounding, as in path tracking: the same kernels with another configuration."""
    both = [made(courses=slopes, kernels=kernels) for kernels in (True, False)]
    assert both[0]._in_kernels() is not None and both[1]._in_kernels() is None
    seen = [env.reset(seed=5)[0] for env in both]
    np.testing.assert_allclose(*seen, atol=1e-6)
    for _ in range(20):
        steps = [env.step(np.full((2, 2), 0.6, dtype=np.float32)) for env in both]
    np.testing.assert_allclose(steps[0][0], steps[1][0], atol=2e-4)
    np.testing.assert_allclose(steps[0][1], steps[1][1], atol=2e-4)


def test_the_pose_is_estimated_as_asked():
    assert isinstance(made().task._sensors.localisation, Localisation)
    assert isinstance(made(localisation="filter").task._sensors.localisation, PoseFilter)
    settings = PoseFilterSettings(friction=0.3)
    assert made(localisation=settings).task._sensors.localisation.settings is settings
    with pytest.raises(ValueError, match="localisation is 'kalman'; choose one of: gains, filter"):
        made(localisation="kalman")
    with pytest.raises(ValueError, match="localisation is None, but must be LocalisationGains or PoseFilterSettings"):
        limit_config(localisation=None)


@pytest.mark.parametrize("kernels", [True, False])
def test_the_receiver_says_how_good_its_solutions_are(kernels):
    """With losses of 0.5 s every 0.5 s all three qualities come up within 5 s of two vehicles, but with a chance of 1e-3."""
    loss = FixLoss(interval=0.5, float_duration=0.5, none_duration=0.5, none_share=0.5)
    env = made(config=limit_config(gps_noise=GpsNoise.typical(loss)), kernels=kernels)
    column = env.observation_layout["gps_quality"]
    observations, infos = env.reset(seed=1)
    assert np.all(observations[:, column] == 2.0)
    seen = set()
    for _ in range(100):
        observations, _, terminated, _, infos = env.step(np.zeros((2, 2), dtype=np.float32))
        assert not terminated.any()
        np.testing.assert_array_equal(observations[:, column][:, 0], infos["gps_quality"])
        seen |= set(infos["gps_quality"].tolist())
    assert seen == {NONE, FLOAT, FIXED_SOLUTION}


def test_room_and_time_are_tight():
    env = made()
    env.reset(seed=1, options={"path": 0, "lateral_offset": 0.3})
    _, _, terminated, _, infos = env.step(np.zeros((2, 2), dtype=np.float32))
    assert terminated.all() and set(infos["termination"]) == {"lost the path"}
    line = LEVEL.paths[0].length - 4.0
    assert env.task._steps_allowed[0] == np.ceil(line / 1.5 * 1.05 / 0.05)


def test_third_gear_is_twice_as_fast_as_the_first():
    fast, slow = made(), made(config=limit_config(gear=1))
    assert Vehicle.of(fast).top_speed == pytest.approx(2.0 * Vehicle.of(slow).top_speed)
    for env in (fast, slow):
        env.reset(seed=1, options={"path": 0})
        for _ in range(60):
            env.step(np.tile(np.array([0.0, 0.6], dtype=np.float32), (2, 1)))
        # the loop leaks a little
        assert env.output("speed")[0] == pytest.approx(0.6 * Vehicle.of(env).top_speed, rel=0.05)


def test_speed_is_what_joint_brakes_and_power_allow():
    layout = {
        "cross_track": slice(0, 1),
        "heading_error": slice(1, 2),
        "preview": slice(2, 6),
        "curvature": slice(6, 9),
    }
    names = ("speed", "joint_angle", "joint_rate", "pitch")
    layout |= {name: slice(9 + k, 10 + k) for k, name in enumerate(names)}
    vehicle = Vehicle(layout, preview=(1.0, 2.0), top_speed=2.0)
    driver = PreviewDriver(vehicle, largest_rate=0.5, braking=1.0, climbing=0.3, speeding=0.5, fastest=1.8)
    rows = np.zeros((5, 13), dtype=np.float32)
    rows[:, 9] = 3.0  # fast
    rows[1, 7:9] = 0.2  # a bend begins at once: (f + r) κ′ = 0.68 rad/m
    rows[2, 8] = 0.2  # a bend begins 1 m ahead, 0.3 m of which are lost
    rows[3, 12] = np.arcsin(0.25)  # nose down
    rows[4, 9] = 0.2  # from rest
    wanted = [1.8, 0.5 / 0.68, np.sqrt((0.5 / 0.68) ** 2 + 2.0 * 0.7), 1.2, 0.7]
    np.testing.assert_allclose(driver.speed(vehicle.see(rows)), wanted, rtol=1e-6)
    np.testing.assert_allclose(driver(rows)[:, 1], np.array(wanted) / 2.0, rtol=1e-6)
    with pytest.raises(ValueError, match="'pitch'"):
        PreviewDriver(Vehicle({name: columns for name, columns in layout.items() if name != "pitch"}))


def test_who_is_told_the_truth_sees_it():
    env = made()
    observations, _ = env.reset(seed=2)
    told = []

    class Listens:
        def __call__(self, observations):
            told.append(observations)
            return np.zeros((2, 2), dtype=np.float32)

        def reset(self, mask=None):
            told.append(mask)

    informed = Informed(Listens(), made(), EXACT[ENV]).watching(env)
    informed(observations)
    view, layout = env.task.view(), env.observation_layout
    np.testing.assert_array_equal(told[0][:, layout["cross_track"]][:, 0], view.cross_track.astype(np.float32))
    assert np.all(told[0][:, layout["cross_track"]] != observations[:, layout["cross_track"]])
    rest = np.ones(observations.shape[1], dtype=bool)
    for name in EXACT[ENV]:
        rest[layout[name]] = False
    np.testing.assert_array_equal(told[0][:, rest], observations[:, rest])
    informed.reset(np.array([True, False]))
    assert told[1].tolist() == [True, False]


def test_a_controller_needs_what_it_was_made_for():
    flat = Course(Plane(), (Path(np.array([[0.0, 0.0], [30.0, 0.0]])),))
    with pytest.raises(ValueError, match="acts on steering_signal, drive_signal, arms"):
        reference_policy(ENV, "preview-speed", made(courses=[flat], act_arms=True))


@pytest.mark.parametrize(("name", "localisation"), [("limits-dagger", "gains"), ("limits-filter-dagger", "filter")])
def test_policies_of_the_package_drive(name, localisation):
    env = made(localisation=localisation)
    policy = policy_factory(ENV, name)(env)
    observations, _ = env.reset(seed=3, options={"path": 0})
    for _ in range(80):
        observations, _, terminated, _, _ = env.step(policy(observations))
        assert not terminated.any()
    assert np.all(env.output("speed") > 1.5)


def test_a_policy_that_learned_with_a_filter_needs_one():
    assert list(shipped_policies(ENV, "gains")) == ["limits-dagger"]
    assert list(shipped_policies(ENV, "filter")) == ["limits-filter-dagger"]
    policy = policy_factory(ENV, "limits-filter-dagger")
    with pytest.raises(ValueError, match=r"localisation 'filter', .*'gains'.* or give --localisation filter"):
        policy(made())
    policy(made(localisation="filter"))
