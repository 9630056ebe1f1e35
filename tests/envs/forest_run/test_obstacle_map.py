"""The map of past sweeps: beside an independent one in NumPy, and what episodes and copies do to it."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from aoro_gym.agents.evaluation.evaluate import observing
from aoro_gym.agents.policies.files import load_policy, shipped_policies
from aoro_gym.envs.forest_run.environment import ForestRunVectorEnv
from aoro_gym.envs.forest_run.obstacle_map import ObstacleMap, obstacle_map
from tests.envs.forest_run.worlds import course

N = 4


def make(output="numpy", **arguments) -> Any:
    env = ForestRunVectorEnv(
        N, courses=[course()], observation_terms={"obstacle_map": True}, output=output, autoreset_mode="Disabled",
        **arguments,
    )  # fmt: skip
    env.reset(seed=0, options={"path": [0, 0, 1, 1]})
    return env


def shown(env, observation) -> Any:
    return np.asarray(observation)[:, env.observation_layout["obstacle_map"]]


def driven(env, steps):
    """Observations of so many steps, each machine with its own steering."""
    actions = np.stack([np.linspace(-0.3, 0.3, N), np.full(N, 0.66)], axis=1).astype(np.float32)
    return [env.step(actions)[0] for _ in range(steps)]


class Reference:
    """Places that stood, as a set of cells of a machine, and what they leave, by looking at every one."""

    def __init__(self, term: ObstacleMap):
        self.term, self.cells = term, set()

    def add(self, pose, obstacles) -> None:
        x, y, heading = pose
        for away, azimuth in zip(obstacles, self.term.seen.azimuths, strict=True):
            if away < self.term.mapped:
                ahead = self.term.seen.lidar.mounting.position[0] - 1.7 + away * np.cos(azimuth)
                place = np.array([x, y]) + turned(heading) @ [ahead, away * np.sin(azimuth)]
                self.cells.add(tuple(np.floor(place / self.term.cell + 0.5).astype(int)))

    def distances(self, pose) -> Any:
        term = self.term
        out = np.full(term.directions, term.reach)
        middles = np.pi - (np.arange(term.directions) + 0.5) * 2 * np.pi / term.directions
        for place in self.places(pose):
            away = np.hypot(*place)
            half = np.arcsin(0.5 * term.cell / max(away, term.cell))
            apart = (middles - np.arctan2(*place[::-1]) + np.pi) % (2 * np.pi) - np.pi
            out[np.abs(apart) <= half + np.pi / term.directions] = np.minimum(
                out[np.abs(apart) <= half + np.pi / term.directions], away
            )
        return out

    def ways(self, pose, step=0.002) -> Any:
        """By trying ways in small steps along each arc."""
        term, ways = self.term, np.arange(0.0, self.term.reach, step)
        out = np.full((len(term.half_widths), term.arcs), term.reach)
        for a, curvature in enumerate(term.curvatures):
            turn = curvature * ways
            along = ways * np.sinc(turn / (2 * np.pi))
            points = np.stack([along * np.cos(turn / 2), along * np.sin(turn / 2)], axis=1)
            for place in self.places(pose):
                away = np.hypot(*(points - place).T)
                for b, width in enumerate(term.half_widths):
                    inside = away < width
                    met = not inside[0] and inside.any()
                    first = ways[np.argmax(inside)] if met or (inside[0] and place[0] > 0) else term.reach
                    out[b, a] = min(out[b, a], first)
        return out

    def places(self, pose):
        x, y, heading = pose
        found = [turned(heading).T @ (np.array(cell) * self.term.cell - (x, y)) for cell in sorted(self.cells)]
        return [place for place in found if np.hypot(*place) < self.term.reach]


def turned(angle) -> Any:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def poses(env) -> Any:
    view = env.task.view()
    heading, goal = np.asarray(view.measured_heading), np.asarray(view.measured_goal)
    return [(*(-turned(angle) @ away), angle) for angle, away in zip(heading, goal, strict=True)]


def test_it_shows_what_stood_in_any_sweep():
    env = make()
    term = env.task.observation_terms["obstacle_map"].function
    known = [Reference(term) for _ in range(N)]
    observation = env.reset(seed=0, options={"path": [0, 0, 1, 1]})[0]
    for number in range(60):
        for machine, pose, sectors in zip(known, poses(env), term.seen(env.task.view()), strict=True):
            machine.add(pose, sectors)
        if number % 20 == 19:
            for machine, pose, row in zip(known, poses(env), shown(env, observation), strict=True):
                distances, ways = row[: term.directions], row[term.directions :].reshape(len(term.half_widths), -1)
                # float32 of coordinates of some 30 m, and the step of the ways that are tried
                np.testing.assert_allclose(distances, machine.distances(pose), atol=1e-4)
                np.testing.assert_allclose(ways, machine.ways(pose), atol=0.003)
        observation = driven(env, 1)[0]
    assert all(machine.cells for machine in known[:2])
    # what one sweep shows no longer is still known
    now = np.asarray(term.seen(env.task.view()))
    assert (shown(env, observation)[:, : term.directions] < term.reach).sum() > (now < term.mapped).sum()


def test_an_episode_begins_with_an_empty_map():
    env, new = make(), make()
    driven(env, 60)
    first = shown(new, new.reset(seed=5, options={"path": [0, 0, 1, 1]})[0])
    again = shown(env, env.reset(seed=5, options={"path": [0, 0, 1, 1]})[0])
    np.testing.assert_array_equal(again, first)
    view, term = env.task.view(), env.task.observation_terms["obstacle_map"].function
    np.testing.assert_array_equal(term(view), term(view))  # asked twice, it shows the same


def test_a_copy_goes_on_with_the_map():
    env = make()
    driven(env, 40)
    copy = pickle.loads(pickle.dumps(env))
    for one, other in zip(driven(env, 3), driven(copy, 3), strict=True):
        np.testing.assert_array_equal(one, other)


def test_tensors_show_the_same():
    pytest.importorskip("torch")
    env, tensors = make(), make("torch")
    one, other = driven(env, 40)[-1], driven(tensors, 40)[-1]
    # the same kernels on float32 of the same sensors, whose sums torch adds in another order
    np.testing.assert_allclose(shown(tensors, other.numpy()), shown(env, one), atol=1e-3)


def test_a_policy_leaves_out_what_it_has_not_learned_from():
    env, plain = make(), ForestRunVectorEnv(N, courses=[course()])
    policy: Any = load_policy(shipped_policies("AORO/ForestRun-v0")["forest-dagger"])
    observation = driven(env, 1)[0]
    expected = policy.made_for(plain)(observation[:, : policy.observed])
    np.testing.assert_array_equal(policy.made_for(env)(observation), expected)


def test_an_evaluation_asks_for_what_a_policy_has_learned_from():
    env = make()
    policy: Any = load_policy(shipped_policies("AORO/ForestRun-v0")["forest-dagger"])
    assert observing({"forest-dagger": policy.made_for}) == {}
    wide = replace(
        policy,
        memory=None,
        normalisation=None,
        layout=env.observation_layout,
        weights=(np.zeros((2, 207)),),
        biases=(np.zeros(2),),
    )
    asked = observing({"forest-dagger": policy.made_for, "wide": wide.made_for})
    assert asked == {"observation_terms": {"obstacle_map": True}}
    assert wide.made_for(env) is wide
    wanted = r"but the environment observes .*; make it with observation_terms=\{'obstacle_map': True\}"
    with pytest.raises(ValueError, match=wanted):
        wide.made_for(ForestRunVectorEnv(N, courses=[course()]))


def test_what_is_not_mapped_at_first_is_normalised_by_its_reach():
    pytest.importorskip("torch")
    from aoro_gym.agents.training.dagger import least_deviations

    env = make()
    least, columns = least_deviations(env), env.observation_layout["obstacle_map"]
    assert np.all(least[columns] == 3.0) and np.count_nonzero(least) == columns.stop - columns.start


def test_a_wrong_setting_is_named():
    with pytest.raises(ValueError, match=r"half_widths\[1\] is 7 m"):
        obstacle_map(half_widths=(1.0, 7.0))
