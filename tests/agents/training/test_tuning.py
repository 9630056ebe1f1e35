"""Tuning improves on a random draw, and repeats."""

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.agents.controllers.path_tracking import PurePursuit, Vehicle
from aoro_gym.agents.training import tuning
from aoro_gym.envs.path_tracking.config import FIXED
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.task import END_OF_PATH
from aoro_gym.terrains import Path, Plane

SHORT = Path(np.stack([np.arange(15.0), np.zeros(15)], axis=1))


def test_tuning_repeats_and_keeps_to_its_bounds():
    best = []
    gains = [
        tuning.tune(
            "bang-bang",
            population=5,
            generations=1,
            episodes=1,
            steps=60,
            progress=lambda generation, value: best.append(value),
        )
        for _ in range(2)
    ]
    assert gains[0] == gains[1]
    assert best[:2] == best[2:]
    assert best[1] <= best[0]
    for name, (low, high) in tuning.STUDIES["AORO/Turning-v0"].controllers["bang-bang"].bounds.items():
        assert low <= gains[0][name] <= high


def test_tuning_starts_from_what_was_found_by_hand_and_searches_logarithms():
    study = tuning.STUDIES["AORO/PathTracking-v0"]
    for name, controller in study.controllers.items():
        assert set(controller.start) == set(controller.bounds), name
        assert set(controller.logarithmic) <= set(controller.bounds)
        for gain, (low, high) in controller.bounds.items():
            assert low <= controller.start[gain] <= high, (name, gain)
            assert low > 0.0 or gain not in controller.logarithmic


def test_tuning_finds_the_least_cost_and_tries_what_was_found_by_hand(monkeypatch):
    tried = []

    def cost(env, policy, seeds, steps):
        """Least, 0, at a look-ahead of 1.3 m and a lead time of 0.2 s."""
        tried.append(policy)
        return np.log(policy.look_ahead / 1.3) ** 2 + (policy.lead_time - 0.2) ** 2

    name = "AORO/PathTracking-v0"
    env = PathTrackingVectorEnv(24, courses=[Course(Plane(), (SHORT,))], autoreset_mode="SameStep")
    study = replace(tuning.STUDIES[name], make=lambda num_envs, device: env, cost=cost)
    monkeypatch.setitem(tuning.STUDIES, name, study)
    found = tuning.tune("pure-pursuit", name, population=24, generations=40, episodes=1)
    assert found["look_ahead"] == pytest.approx(1.3, rel=0.05)
    assert found["lead_time"] == pytest.approx(0.2, abs=0.02)
    for gain, value in study.controllers["pure-pursuit"].start.items():
        assert getattr(tried[0], gain)[0] == pytest.approx(value), gain


class Straight:
    def __call__(self, observations):
        actions = np.zeros((len(observations), 2), dtype=np.float32)
        actions[:, 1] = 0.65
        return actions

    def reset(self, mask=None):
        pass


class Aside(Straight):
    def __call__(self, observations):
        actions = super().__call__(observations)
        actions[:, 0] = 1.0
        return actions


def test_drives_are_judged_by_error_travel_and_failure():
    env = PathTrackingVectorEnv(2, courses=[Course(Plane(), (SHORT,))], randomisation=FIXED, autoreset_mode="SameStep")
    lost = tuning.drive(env, Aside(), 0)
    assert lost.ending == ["lost the path"] * 2
    assert lost.failed.all() and not lost.success.any()
    assert (lost.cross_track_max > 2.9).all()  # of 3 m
    np.testing.assert_allclose(
        tuning.tracking_cost(env, Aside(), [0, 1], 400) - lost.cross_track_rms - tuning.FAILURE,
        tuning.VALVE_TRAVEL * lost.valve_travel,
    )

    begun = tuning.drive(env, Straight(), 0, 100)
    assert begun.ending == ["", ""] and not begun.failed.any()
    np.testing.assert_array_equal(begun.valve_travel, 0.0)
    np.testing.assert_allclose(tuning.tracking_cost(env, Straight(), [0, 1], 100), begun.cross_track_rms)
    assert (begun.cross_track_rms <= begun.cross_track_max).all()

    done = tuning.drive(env, PurePursuit(Vehicle.of(env)), 0)
    assert done.ending == [END_OF_PATH] * 2
    assert done.success.all() and not done.failed.any()
    assert done.speed == pytest.approx(0.75, rel=0.1)
