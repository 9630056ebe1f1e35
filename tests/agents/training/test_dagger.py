"""Imitation of a teacher that knows the truth: it is told it, and the network comes to the middle of what it does."""

from typing import Any

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.agents.controllers.levelling import PreviewPid
from aoro_gym.agents.controllers.path_tracking import PreviewRegulator
from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.envs import Course
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Plane

pytest.importorskip("stable_baselines3")
pytest.importorskip("yaml")
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.dagger import Dagger

TURNING, TRACKING, LEVELLING = "AORO/Turning-v0", "AORO/PathTracking-v0", "AORO/Levelling-v0"
SMALL = {"n_timesteps": 400, "n_envs": 4, "n_steps": 25, "buffer_size": 400, "batch_size": 50, "net_arch": [16]}


def dagger(env: str = TURNING, device: str = "cpu", **changes) -> Dagger:
    teacher = {TURNING: "proportional-derivative", TRACKING: "preview", LEVELLING: "preview-pid"}[env]
    arguments: dict[str, Any] = {"machine": Machine.load("aoro")}
    if env != TURNING:
        line = Line(np.array([[0.0, 0.0], [30.0, 0.0]]), name="ahead")
        arguments["courses"] = [Course(Plane(), (line,), name="plane")]
    return Dagger(
        TrainingPlan(env=env, algo="dagger", device=device),
        SMALL | {"teacher": teacher, **changes},
        StepCounter(400),
        arguments,
    )


def learn(learner: Dagger, steps: int) -> None:
    learner.learn(steps, ProgressCallback(StepCounter(400), learner.episodes, lambda progress: None, every=9.0), seed=3)


@pytest.mark.slow
def test_the_network_comes_to_the_median_of_the_teacher_s_actions():
    """A teacher that acts by -2 e, of an error e ~ N(0, 1) that is measured with an error ~ N(0, 1): given the measured m,
    the median of e is m / 2, so what fits best is -m. Of 20,000 pairs its slope scatters by √(π / 2) 2 √½ / √2 / √20,000 =
    0.009, as m has the variance 2."""
    learner, rng = dagger(net_arch=[8], n_epochs=40, batch_size=500), np.random.default_rng(1)
    error = rng.standard_normal(20_000)
    seen = np.zeros((20_000, learner.envs.single_observation_space.shape[0]), dtype=np.float32)
    seen[:, 0] = error + rng.standard_normal(20_000)
    learner._observations, learner._actions = seen, -2.0 * error[:, None].astype(np.float32)
    learner._mean, learner._variance = np.zeros(seen.shape[1]), np.ones(seen.shape[1])
    learner._fit(0.01)
    shown = np.zeros((2, seen.shape[1]), dtype=np.float32)
    shown[:, 0] = -0.5, 0.5
    policy = learner.policy()
    slope = np.diff(policy(shown)[:, 0])[0]
    # 0.03: what a tanh layer and a random descent leave of a straight line
    assert slope == pytest.approx(-1.0, abs=4 * 0.009 + 0.03)
    learner.close()


def test_what_is_seldom_does_not_pull_the_signal_into_the_dead_band():
    """Of actions that are 0.2 in 70 % of cases and -0.2 in the others, the mean is 0.08; what is learned is 0.2, but for the
    steps of the last descents."""
    learner = dagger(net_arch=[8], n_epochs=40, batch_size=500)
    learner._observations = np.zeros((5000, learner.envs.single_observation_space.shape[0]), dtype=np.float32)
    learner._actions = np.where(np.arange(5000)[:, None] % 10 < 7, 0.2, -0.2).astype(np.float32)
    learner._mean, learner._variance = (np.full(learner._observations.shape[1], value) for value in (0.0, 1.0))
    learner._fit(0.01)
    assert learner.policy()(learner._observations[:1]) == pytest.approx(0.2, abs=0.01)
    learner.close()


def test_what_leads_while_the_network_learns_is_the_policy_that_is_handed_out():
    """Beyond the ranges that observations and actions are clipped to, too."""
    learner, rng = dagger(net_arch=[8]), np.random.default_rng(4)
    columns = learner.envs.single_observation_space.shape[0]
    learner._mean, learner._variance = rng.standard_normal(columns), rng.uniform(0.0, 2.0, columns)
    learner._variance[0] = 0.0  # what never varied
    seen = rng.normal(scale=30.0, size=(500, columns)).astype(np.float32)
    last: Any = learner._net[-1]
    last.weight.data.mul_(10.0)
    led = learner._led_by_network(seen)
    assert 0.1 < np.mean(np.abs(led) == 1.0) < 0.9
    np.testing.assert_allclose(led, learner.policy()(seen), rtol=0.0, atol=1e-5)  # float32, summed in another order
    learner.close()


@pytest.mark.parametrize("env", [TURNING, TRACKING])
def test_the_teacher_is_told_the_truth_and_drives_first(env, monkeypatch):
    learner, told, drawn = dagger(env), [], []
    teacher, step = learner._teacher, learner._env.step_async

    def followed(observations):
        view = learner.envs.task.view()
        told.append((observations.copy(), {name: np.array(exact(view)) for name, exact in learner._exact.items()}))
        return teacher(observations)

    def stepped(actions):
        drawn.append(np.array(actions))
        step(actions)

    monkeypatch.setattr(learner, "_teacher", followed)
    monkeypatch.setattr(learner._env, "step_async", stepped)
    learn(learner, 200)
    layout = learner.envs.observation_layout
    seen = np.split(learner._observations, 50)
    for (known, exact), measured, wanted in zip(told, seen, np.split(learner._actions, 50), strict=True):
        for name, values in exact.items():
            np.testing.assert_array_equal(known[:, layout[name]][:, 0], values.astype(np.float32))
            known[:, layout[name]] = measured[:, layout[name]]
        np.testing.assert_array_equal(known, measured)  # the rest is as measured
        assert np.all(np.abs(wanted) <= 1.0)
    steering, noisy = learner._actions[:, 0], teacher(learner._observations)[:, 0]
    partial = (np.abs(steering) > 0.0) & (np.abs(steering) < 1.0)
    assert np.count_nonzero(partial) > 20
    assert np.mean(noisy[partial] != steering[partial]) > 0.9  # it was not as measured
    for k in range(25):
        np.testing.assert_array_equal(drawn[k], learner._actions[4 * k : 4 * k + 4])
    assert all(np.any(drawn[k] != learner._actions[4 * k : 4 * k + 4]) for k in range(25, 50))
    learner.close()


def test_the_newest_pairs_are_kept_and_the_first_ones_normalise():
    learner = dagger(buffer_size=150)
    learn(learner, 100)
    first = learner._observations
    kept = learner.policy().normalisation
    assert kept is not None
    np.testing.assert_allclose(kept.mean, first.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(kept.variance, first.var(axis=0), rtol=1e-4, atol=1e-9)
    learn(learner, 100)
    assert len(learner._observations) == len(learner._actions) == 150
    np.testing.assert_array_equal(learner._observations[:50], first[50:])
    assert learner.policy().normalisation == kept
    learner.close()


@pytest.mark.slow
def test_it_learns_what_the_teacher_does():
    """Of the variance of the teacher's signal, less than a fifth is left after four rollouts."""
    learner = dagger(n_envs=16, n_steps=100, buffer_size=6400, batch_size=100, n_epochs=20, net_arch=[32, 32])
    learn(learner, 6400)
    left = np.mean((learner.policy()(learner._observations) - learner._actions) ** 2)
    assert left < 0.2 * np.var(learner._actions)
    learner.close()


def test_it_goes_on_from_a_policy(tmp_path):
    learner = dagger()
    learn(learner, 100)
    learner.policy(environment=TURNING).save(tmp_path / "first")
    other = dagger()
    policy = LearnedPolicy.load(tmp_path / "first.json")
    other.start_from(policy)
    observations = learner._observations[:9]
    np.testing.assert_array_equal(other.policy()(observations), policy(observations))
    with pytest.raises(ValueError, match="layers"):
        dagger(net_arch=[8]).start_from(policy)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"teacher": "stanley"}, "'stanley' is no reference controller of AORO/Turning-v0"),
        ({"teacher_kwargs": {"gian": 1.0}}, "teacher_kwargs {'gian': 1.0} of proportional-derivative: .*gian"),
        ({"buffer_size": 99}, "buffer_size is 99, but must hold a rollout, n_envs \\* n_steps = 100"),
        ({"n_epochs": 0}, "n_epochs is 0, but must be a positive integer"),
        ({"action_noise": -0.1}, "action_noise is -0.1, but must be finite and at least 0"),
        ({"learning_rate": "fast_1"}, "learning_rate is 'fast_1', but must be a number, or lin_NUMBER"),
        ({"gamma": 0.9}, "that dagger does not take: .*gamma"),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        dagger(**changes)


def test_gains_of_the_teacher_are_those_asked_for():
    learner = dagger(TRACKING, teacher_kwargs={"rate_weight": 0.004})
    assert isinstance(learner._teacher, PreviewRegulator)
    assert learner._teacher.rate_weight == 0.004
    learner.close()
    learner = dagger(LEVELLING, teacher_kwargs={"share_integral": 0.0})
    assert isinstance(learner._teacher, PreviewPid)
    assert learner._teacher.gains["share_integral"] == 0.0
    assert learner._teacher.gains["level_gain"] == PreviewPid.GAINS["level_gain"]
    learner.close()
    with pytest.raises(ValueError, match="PreviewPid has no gain 'gian'"):
        dagger(LEVELLING, teacher_kwargs={"gian": 1.0})


def test_networks_learn_on_the_cpu_whose_lanes_the_twins_run_on():
    learner = dagger(LEVELLING, device="cpu:simd")
    learn(learner, 200)
    assert learner._device.type == "cpu" and learner.steps == 200
    learner.close()


def test_a_teacher_forgets_where_an_episode_has_ended():
    learner, told = dagger(), []

    class Teacher:
        def __call__(self, observations):
            return np.zeros((len(observations), 1), dtype=np.float32)

        def reset(self, mask=None):
            told.append(np.array(mask))

    learner._teacher = Teacher()
    learner.envs.max_episode_steps = 20
    learn(learner, 4 * 25)
    np.testing.assert_array_equal(told, [np.ones(4, dtype=bool)])
