"""Terms are changed by name; what is wrong with one is said with its name."""

import copy
import pickle
from dataclasses import FrozenInstanceError
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import ObservationTerm, RewardTerm, TurningConfig, register_envs
from aoro_gym.envs.core.terms import Frozen, changed_observations, changed_rewards
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.envs.turning.observations import OBSERVATION_TERMS
from aoro_gym.envs.turning.rewards import REWARD_TERMS

register_envs()


def pump_effort(view):
    return view.xp.abs(view.output("pump_pressure")) / 1e7


def shake(view):
    return view.samples("joint_rate").std(axis=0)


def test_own_terms_come_in_by_name():
    env: Any = gymnasium.make(
        "AORO/Turning-v0",
        reward_terms={"pump_effort": (-0.5, pump_effort), "flow_oscillation": None, "overshoot": -1.0, "shake": shake},
        observation_terms={
            "engine": ObservationTerm(lambda view: view.output("engine_speed"), 0.0, 300.0),
            "both": lambda view: view.xp.stack([view.error, view.target_age], -1),
            "joint_rate": None,
        },
    )
    layout = env.unwrapped.observation_layout
    assert list(layout) == ["joint_angle", "target", "error", "signals", "engine", "both"]
    assert layout["both"] == slice(8, 10)
    assert env.observation_space.shape == (10,)
    assert env.observation_space.high[layout["engine"]] == 300.0
    observation, _ = env.reset(seed=0)
    assert 100.0 < observation[layout["engine"]] < 300.0  # idling, before the first step
    observation, reward, _, _, info = env.step(np.array([0.3], dtype=np.float32))
    assert 100.0 < observation[layout["engine"]] < 300.0
    assert observation[layout["both"]][1] == np.float32(0.02)
    names = {name.removeprefix("reward/") for name in info if name.startswith("reward/")}
    assert names == {"tracking", "precision", "overshoot", "signal_change", "pump_effort", "shake"}
    pump = env.unwrapped.vector.output("pump_pressure")[0]
    assert info["reward/pump_effort"] == pytest.approx(-0.5 * pump / 1e7, rel=1e-6)
    assert reward == pytest.approx(sum(info[f"reward/{name}"] for name in names), rel=1e-5)


def test_observations_stay_within_their_bounds():
    env = TurningVectorEnv(
        1, observation_terms={"large": ObservationTerm(lambda view: 0 * view.error + 9.0, -2.0, 2.0)}
    )
    observations, _ = env.reset(seed=0)
    assert observations[0, env.observation_layout["large"]] == 2.0
    assert observations[0] in env.single_observation_space


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": None}, "reward_terms has no 'speed' to leave out; choose one of: tracking, precision"),
        ({"speed": 2.0}, "reward_terms has no 'speed' to weigh"),
        ({"mine": (1.0, 2.0)}, "reward_terms\\['mine'\\]: a reward term's function is 2.0, but must be callable"),
        (
            {"mine": (np.nan, abs)},
            "reward_terms\\['mine'\\]: a reward term's weight is nan, but must be a finite number",
        ),
        ({"mine": "tracking"}, "reward_terms\\['mine'\\] is 'tracking'; give \\(weight, function\\)"),
        ({"": abs}, "names must be non-empty strings"),
        ([("mine", abs)], "reward_terms is .* but must be a mapping"),
        (dict.fromkeys(REWARD_TERMS), "leaves no term"),
    ],
)
def test_wrong_reward_terms_are_named(changes, message):
    with pytest.raises(ValueError, match=message):
        changed_rewards(REWARD_TERMS, changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": None}, "observation_terms has no 'speed' to leave out; choose one of: joint_angle"),
        ({"mine": 3.0}, "observation_terms\\['mine'\\] is 3.0; give an ObservationTerm"),
        (dict.fromkeys(OBSERVATION_TERMS), "leaves no term"),
    ],
)
def test_wrong_observation_terms_are_named(changes, message):
    with pytest.raises(ValueError, match=message):
        changed_observations(OBSERVATION_TERMS, changes)


def test_wrong_bounds_are_named():
    with pytest.raises(ValueError, match=r"bounds are \[1.0, 0.0\], but must be finite with low < high"):
        ObservationTerm(abs, 1.0, 0.0)
    with pytest.raises(ValueError, match="must be finite"):
        ObservationTerm(abs, 0.0, np.inf)


def test_results_of_the_wrong_shape_are_named():
    env = TurningVectorEnv(3, reward_terms={"mine": (1.0, lambda view: view.error[:2])})
    env.reset()
    with pytest.raises(ValueError, match=r"reward_terms\['mine'\] returned \(2,\), but must return .* \(3,\)"):
        env.step(np.zeros((3, 1), dtype=np.float32))
    with pytest.raises(ValueError, match=r"observation_terms\['mine'\] returned 1.0"):
        TurningVectorEnv(3, observation_terms={"mine": lambda view: 1.0})


def test_results_that_are_not_finite_are_named():
    env = TurningVectorEnv(2, reward_terms={"mine": (1.0, lambda view: view.error * np.nan)})
    env.reset()
    with pytest.raises(ValueError, match=r"reward_terms\['mine'\] is nan in sub-environment 0; return finite numbers"):
        env.step(np.zeros((2, 1), dtype=np.float32))
    env = TurningVectorEnv(2, observation_terms={"mine": lambda view: view.error * np.nan})
    with pytest.raises(ValueError, match=r"observation_terms\['mine'\] is nan in sub-environment 0"):
        env.reset()


def test_unknown_channels_are_named():
    env = TurningVectorEnv(1, reward_terms={"mine": (1.0, lambda view: view.output("oil_level"))})
    env.reset()
    with pytest.raises(ValueError, match="there is no output 'oil_level'; choose one of: steering_signal"):
        env.step(np.zeros((1, 1), dtype=np.float32))


def test_mappings_of_terms_are_immutable_and_travel():
    with pytest.raises(TypeError):
        REWARD_TERMS["tracking"] = RewardTerm(1.0, abs)  # type: ignore[index]
    config = TurningConfig()
    for twin in (copy.deepcopy(config), pickle.loads(pickle.dumps(config))):
        assert twin.reward_terms == REWARD_TERMS
    assert hash(Frozen({"a": 1})) == hash(Frozen({"a": 1}))
    assert repr(Frozen({"a": 1})) == "Frozen({'a': 1})"


def test_terms_do_not_change():
    with pytest.raises(FrozenInstanceError):
        RewardTerm(1.0, abs).weight = 2.0  # type: ignore[misc]
