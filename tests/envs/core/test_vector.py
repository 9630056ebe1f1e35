"""Sub-environments are the single environment, to the bit; episodes end and begin as Gymnasium says."""

import warnings
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from aoro_gym.envs import register_envs
from aoro_gym.envs.core.vector import check_keywords
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.turning.config import MILD
from aoro_gym.envs.turning.environment import TurningEnv, TurningVectorEnv
from aoro_gym.machine import OutsideRangeWarning
from aoro_gym.machine.laws import Laws, family
from aoro_gym.terrains import Plane
from aoro_gym.twin.records import State

register_envs()
TURNING = "AORO/Turning-v0"


def make(num_envs=2, **arguments) -> Any:
    return TurningVectorEnv(num_envs, **arguments)


def diverge(env, index):
    """Make the state of a twin non-finite."""
    env.twin.state.numpy()[State.JOINT_RATE, index] = np.nan


@pytest.mark.parametrize("arguments", [{}, {"randomisation": MILD, "observe_pressures": True}], ids=["default", "all"])
def test_sub_environment_is_the_single_one_to_the_bit(arguments):
    count, steps = 3, 45
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, count, 1)).astype(np.float32)
    vector: Any = gymnasium.make_vec(
        TURNING, num_envs=count, max_episode_steps=20, autoreset_mode="SameStep", **arguments
    )
    log = [vector.reset(seed=7), *(vector.step(action) for action in actions)]
    for i in range(count):
        env: Any = gymnasium.make(TURNING, max_episode_steps=20, **arguments)
        observation, info = env.reset(seed=7 + i)
        np.testing.assert_array_equal(observation, log[0][0][i])
        for step, (observations, rewards, terminated, truncated, infos) in enumerate(log[1:]):
            observation, reward, end, cut, info = env.step(actions[step, i])
            assert (reward, end, cut) == (rewards[i], terminated[i], truncated[i])
            where = infos
            if cut:
                np.testing.assert_array_equal(observation, infos["final_obs"][i])
                where = infos["final_info"]
            for name, value in info.items():
                assert where[f"_{name}"][i]
                assert where[name][i] == value, name
            if cut:
                observation, info = env.reset()
            np.testing.assert_array_equal(observation, observations[i])


def test_neighbours_do_not_matter():
    one, many = make(1), make(5)
    one.reset(seed=11)
    many.reset(seed=[1, 2, 11, 3, 4])
    for signal in (0.5, 1.0, -0.7):
        action = np.full((1, 1), signal, dtype=np.float32)
        alone = one.step(action)[0]
        among = many.step(np.concatenate([-action, action, action, 0 * action, -action]))[0]
        np.testing.assert_array_equal(alone[0], among[2])


def test_same_seed_same_trajectory_and_another_seed_another():
    env = make(3)
    first, _ = env.reset(seed=5)
    after = env.step(np.ones((3, 1), dtype=np.float32))[0]
    second, _ = env.reset(seed=5)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(after, env.step(np.ones((3, 1), dtype=np.float32))[0])
    third, _ = env.reset(seed=6)
    np.testing.assert_array_equal(first[1:], third[:-1])  # seed + i
    fourth, _ = env.reset()
    assert np.any(third != fourth, axis=1).all()


def test_same_step_resets_at_once_and_keeps_the_end():
    env = make(2, max_episode_steps=4, autoreset_mode="SameStep")
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    env.reset(seed=0)
    zero = np.zeros((2, 1), dtype=np.float32)
    for _ in range(3):
        *_, truncated, infos = env.step(zero)
        assert not truncated.any()
        assert "final_obs" not in infos
    observations, _, terminated, truncated, infos = env.step(zero)
    assert truncated.all() and not terminated.any()
    assert infos["_final_obs"].all()
    assert not np.array_equal(infos["final_obs"][0], observations[0])
    assert not infos["_reward/tracking"].any()
    assert infos["final_info"]["_reward/tracking"].all()
    np.testing.assert_array_equal(env.time, 0.0)
    assert not env.step(zero)[3].any()


def test_next_step_resets_one_step_later():
    env = make(2, max_episode_steps=3)
    assert env.metadata["autoreset_mode"] is env.autoreset_mode is AutoresetMode.NEXT_STEP  # as Gymnasium's default
    env.reset(seed=0)
    zero = np.zeros((2, 1), dtype=np.float32)
    for _ in range(2):
        env.step(zero)
    last, _, _, truncated, _ = env.step(zero)
    assert truncated.all()
    begun, rewards, terminated, truncated, infos = env.step(np.ones((2, 1), dtype=np.float32))
    np.testing.assert_array_equal(rewards, 0.0)
    assert not (terminated | truncated).any()
    assert not infos["_reward/tracking"].any()
    assert infos["_target"].all()
    assert not np.array_equal(last, begun)
    np.testing.assert_array_equal(env.time, 0.0)
    np.testing.assert_array_equal(begun[:, env.observation_layout["signals"]], 0.0)


def test_disabled_leaves_resetting_to_the_user():
    env = make(2, max_episode_steps=2, autoreset_mode="Disabled")
    zero = np.zeros((2, 1), dtype=np.float32)
    with pytest.raises(gymnasium.error.ResetNeeded, match="sub-environment 0 has no running episode"):
        env.step(zero)
    env.reset(seed=0)
    env.step(zero)
    observations, _, _, truncated, _ = env.step(zero)
    assert truncated.all()
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
        env.step(zero)
    mask = np.array([False, True])
    options = {"reset_mask": mask}
    begun, infos = env.reset(options=options)
    assert options["reset_mask"] is mask
    np.testing.assert_array_equal(begun[0], observations[0])
    assert not np.array_equal(begun[1], observations[1])
    np.testing.assert_array_equal(infos["_target"], mask)
    with pytest.raises(gymnasium.error.ResetNeeded, match="sub-environment 0"):
        env.step(zero)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_a_lost_twin_ends_its_episode_with_the_reason_and_recovers(mode):
    env = make(3, autoreset_mode=mode)
    before, _ = env.reset(seed=0)
    zero = np.zeros((3, 1), dtype=np.float32)
    diverge(env, 1)
    observations, rewards, terminated, truncated, infos = env.step(zero)
    np.testing.assert_array_equal(terminated, [False, True, False])
    assert not truncated.any()
    end = infos["final_info"] if mode is AutoresetMode.SAME_STEP else infos
    assert end["termination"][1] == "simulation diverged: non-finite state"
    np.testing.assert_array_equal(end["_termination"], [False, True, False])
    assert not end["is_success"][1]
    assert rewards[1] == 0.0
    final = infos["final_obs"][1] if mode is AutoresetMode.SAME_STEP else observations[1]
    np.testing.assert_array_equal(final, before[1])  # the last that was known
    assert np.isfinite(observations).all()
    if mode is AutoresetMode.DISABLED:
        env.reset(options={"reset_mask": terminated})
    for _ in range(2):
        observations, rewards, terminated, _, _ = env.step(zero)
        assert not terminated.any()
        assert np.isfinite(observations).all()
        assert env.twin.diverged == []


def test_a_lost_single_twin_ends_its_episode_and_recovers():
    env: Any = gymnasium.make(TURNING)
    env.reset(seed=0)
    diverge(env.unwrapped.vector, 0)
    _, reward, terminated, truncated, info = env.step(np.zeros(1, dtype=np.float32))
    assert terminated and not truncated
    assert reward == 0.0
    assert info["termination"] == "simulation diverged: non-finite state"
    assert info["is_success"] is False
    env.reset()
    *_, terminated, _, info = env.step(np.zeros(1, dtype=np.float32))
    assert not terminated
    assert "termination" not in info


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_gymnasiums_statistics_count_the_reward_terms(mode):
    env: Any = RecordEpisodeStatistics(make(2, max_episode_steps=4, autoreset_mode=mode))
    env.reset(seed=1)
    total = np.zeros(2)
    for _ in range(4):
        _, rewards, _, _, infos = env.step(np.ones((2, 1), dtype=np.float32))
        total += rewards
    np.testing.assert_array_equal(infos["episode"]["l"], 4)
    np.testing.assert_allclose(infos["episode"]["r"], total)


WRAPPERS = [
    ("NormalizeObservation", {}),
    ("NormalizeReward", {}),
    ("FlattenObservation", {}),
    ("TransformObservation", {"func": lambda observations: observations}),
    ("TransformAction", {"func": lambda actions: actions}),
    ("TransformReward", {"func": lambda rewards: 2.0 * rewards}),
    ("ClipAction", {}),
    ("ClipReward", {"max_reward": 1.0}),
    ("RescaleAction", {"min_action": -2.0, "max_action": 2.0}),
    ("RescaleObservation", {"min_obs": 0.0, "max_obs": 1.0}),
    ("DtypeObservation", {"dtype": np.float64}),
    ("RecordEpisodeStatistics", {}),
    ("DictInfoToList", {}),
    ("VectorizeTransformObservation", {"wrapper": gymnasium.wrappers.TransformObservation, "func": lambda x: x}),
]


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::RuntimeWarning")  # Gymnasium's, of float64 bounds
@pytest.mark.parametrize(("name", "arguments"), WRAPPERS, ids=[name for name, _ in WRAPPERS])
def test_gymnasiums_vector_wrappers_work_as_it_is_made(name, arguments):
    inner: Any = gymnasium.make_vec(TURNING, num_envs=2, max_episode_steps=3)
    if name in ("TransformObservation", "VectorizeTransformObservation"):
        space = inner.single_observation_space
        arguments = {**arguments, "observation_space" if name[0] == "V" else "single_observation_space": space}
    env = getattr(gymnasium.wrappers.vector, name)(inner, **arguments)
    observations, _ = env.reset(seed=0)
    ended = 0
    for _ in range(9):
        assert observations.shape == env.observation_space.shape
        assert np.isfinite(observations).all()
        observations, rewards, terminated, truncated, _ = env.step(env.action_space.sample())
        assert np.isfinite(rewards).all()
        ended += int(np.sum(terminated | truncated))
    assert ended == 4  # 3 steps and the one that resets, twice


def test_same_step_is_refused_by_those_wrappers_and_by_name():
    env: Any = gymnasium.make_vec(TURNING, num_envs=2, autoreset_mode="SameStep")
    with pytest.raises(ValueError, match="NEXT_STEP or DISABLED, got"):
        gymnasium.wrappers.vector.NormalizeObservation(env)


@pytest.mark.parametrize("env_id", [TURNING, "AORO/PathTracking-v0"])
@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        (
            {"zebra": 1},
            "has no argument 'zebra'; it takes .*randomisation, .*machine, .*max_episode_steps, render_mode",
        ),
        (
            {"terain": 1, "own_machines": True},
            "has no argument 'terain': did you mean 'terrain'\\? It takes .*ground, soil, device",
        ),
        ({"reward_term": {}}, "did you mean 'reward_terms'"),
        ({"Device": "cpu"}, "did you mean 'device'"),
    ],
)
def test_unknown_keywords_are_answered_with_the_known_ones(env_id, keywords, message):
    for make_one, own in (
        (gymnasium.make, ()),
        (partial(gymnasium.make_vec, num_envs=2), ("num_envs", "autoreset_mode")),
    ):
        for error in (TypeError, ValueError):
            with pytest.raises(error, match=message) as caught:
                make_one(env_id, **keywords)
        told = str(caught.value)  # pyright: ignore[reportPossiblyUnboundVariable]
        assert all((name in told) == bool(own) for name in ("num_envs", "autoreset_mode"))
        assert "self" not in told and "task" not in told and "arguments" not in told


def test_every_keyword_that_is_listed_is_taken():
    """The list is that of the signatures: each name reaches its own check, not that of unknown ones."""
    for kind in (TurningVectorEnv, PathTrackingVectorEnv):
        with pytest.raises(ValueError, match="it takes") as caught:
            kind(2, nothing_like_it=1)
        names = str(caught.value).partition("it takes ")[2].split(", ")
        assert {"config", "machine", "terrain", "ground", "device", "output", "render_mode"} < set(names)
        check_keywords(kind, dict.fromkeys(names))


def test_reward_is_the_sum_of_its_logged_terms():
    env = make(2)
    env.reset(seed=0)
    _, rewards, _, _, infos = env.step(np.array([[1.0], [-0.4]], dtype=np.float32))
    terms = [value for name, value in infos.items() if name.startswith("reward/")]
    assert len(terms) == len(env.task.reward_terms)
    np.testing.assert_allclose(rewards, np.sum(terms, axis=0), rtol=1e-6)


def test_what_is_returned_is_not_touched_later():
    env = make(2)
    kept, first = env.reset(seed=0)
    copies = kept.copy(), {name: value.copy() for name, value in first.items()}
    for _ in range(3):
        env.step(np.ones((2, 1), dtype=np.float32))
    env.reset()
    np.testing.assert_array_equal(kept, copies[0])
    for name, value in first.items():
        np.testing.assert_array_equal(value, copies[1][name])


def test_machines_may_differ_between_sub_environments(machine):
    flows = np.array([35.0, 70.0])
    env = make(2, machine=machine.set({"steering.valve.nominal_flow_left": flows}))
    env.reset(options={"joint_angle": 0.0})
    for _ in range(40):
        env.step(np.ones((2, 1), dtype=np.float32))
    slow, fast = env.output("joint_angle")
    assert fast > 1.4 * slow > 0.0


def test_every_sub_environment_keeps_its_laws_in_all_episodes(machine):
    """Those of the kernel that chooses, whatever the first one's are, and after a reset that changes a parameter, too."""
    names = ["default", "vehicle", "materials"]
    machines = machine.with_laws(**Laws.stacked([family(name) for name in names], [1, 1, 1]).names)
    together = make(3, machine=machines, randomisation=MILD)
    alone = [make(1, machine=machine.with_laws(name), randomisation=MILD) for name in names]
    action = np.ones((3, 1), dtype=np.float32)
    found = []
    for seed in (4, 14):
        together.reset(seed=seed, options={"joint_angle": -0.5})
        for index, env in enumerate(alone):
            env.reset(seed=seed + index, options={"joint_angle": -0.5})
        for _ in range(25):
            together.step(action)
            for env in alone:
                env.step(action[:1])
        # the default kernel leaves out branches, and its compiler may round other sums
        found.append(together.output("joint_angle").copy())
        np.testing.assert_allclose(found[-1], [env.output("joint_angle")[0] for env in alone], atol=1e-5)
    assert np.abs(np.diff(found, axis=1)).min() > 1e-4


def test_machine_option_holds_for_one_episode():
    env = make(2, max_episode_steps=40, autoreset_mode="SameStep")
    full = np.ones((2, 1), dtype=np.float32)

    def turn():
        for _ in range(39):
            env.step(full)
        angles = env.output("joint_angle")
        env.step(full)
        return angles

    env.reset(
        seed=0, options={"joint_angle": 0.0, "machine": {"steering.valve.nominal_flow_left": np.array([35.0, 70.0])}}
    )
    slow, fast = turn()
    env.reset(options={"joint_angle": 0.0})
    np.testing.assert_allclose(turn(), [env_angle := turn_of_default(), env_angle], rtol=1e-6)
    assert fast > 1.4 * slow


@pytest.mark.parametrize("env_id", [TURNING, "AORO/PathTracking-v0"])
def test_implausible_machines_are_named_once_by_key_and_sub_environment(env_id):
    arguments: Any = {} if env_id == TURNING else {"terrain": Plane()}
    env: Any = gymnasium.make_vec(env_id, num_envs=3, **arguments)
    lag = "steering.valve.spool_time_constant"
    with pytest.warns(OutsideRangeWarning) as caught:
        env.reset(seed=0, options={"machine": {lag: [0.01, 0.01, 0.9], "wheel.mass": 215.0}})
        env.reset(options={"machine": {lag: [0.8, 0.01, 0.9]}})  # once a key
        env.reset(options={"machine": {"frame.front.mass": 9000.0}})
    assert [str(warning.message).partition(";")[0] for warning in caught] == [
        f"options['machine']: {lag} of sub-environment 2 = 0.9 s: outside of its plausible range 0.008 to 0.06 s",
        "options['machine']: frame.front.mass = 9000 kg: outside of its plausible range 3200 to 4500 kg",
    ]
    with pytest.warns(OutsideRangeWarning, match=f"of sub-environment 1: {lag} = 0.7 s"):
        other: Any = make(3)
        mask = np.array([False, True, False])
        other.reset(options={"machine": {lag: [0.01, 0.7, 0.01]}, "reset_mask": mask})


def test_randomised_machines_pass_in_silence():
    env = make(8, randomisation=MILD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(20):
            env.reset(seed=seed)


def turn_of_default():
    env = make(1)
    env.reset(options={"joint_angle": 0.0})
    for _ in range(39):
        env.step(np.ones((1, 1), dtype=np.float32))
    return env.output("joint_angle")[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0, but must be a positive integer"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0, but must be a positive integer, or None"),
        ({"render_mode": "ascii"}, "render_mode is 'ascii'; choose None, 'rgb_array' or 'human'"),
        ({"autoreset_mode": "never"}, "autoreset_mode is 'never'; choose one of: 'NextStep', 'SameStep', 'Disabled'"),
        (
            {"randomisation": MILD, "own_machines": False},
            "own_machines is False, but the randomisation varies machines",
        ),
        ({"device": "cuda:99"}, "device 'cuda:99' is not available here"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"target": 0.1},
            "unknown key 'target'; choose from: reset_mask, machine, terrain, sensor_seed, joint_angle, targets, hold, "
            "position, heading",
        ),
        ({"reset_mask": np.array([1, 0])}, "must be \\(2,\\) of bool"),
        ({"reset_mask": np.zeros(2, dtype=bool)}, "selects no sub-environment"),
        ({"joint_angle": 2.0}, r"'joint_angle'\] is 2 rad, but must be in \[-0\.\d+, 0\.\d+\] rad"),
        ({"joint_angle": [0.0, np.nan]}, "'joint_angle'\\] is nan rad"),
        ({"joint_angle": [0.0, 0.1, 0.2]}, "shape \\(3,\\), but must be a number or \\(2,\\)"),
        ({"targets": [0.1, 3.0]}, "'targets'\\] has 3 rad, but the joint reaches only"),
        ({"targets": np.zeros((3, 2))}, "shape \\(3, 2\\), but must be \\(T,\\) or \\(2, T\\)"),
        ({"sensor_seed": [1]}, "'sensor_seed'\\] is \\[1\\], but must be \\(2,\\) whole numbers of at least 0"),
        ({"sensor_seed": [0, -1]}, "'sensor_seed'\\] is \\[0, -1\\]"),
        ({"hold": 0.0}, "'hold'\\] is 0.0 s, but must be one number, at least 0.02"),
        ({"machine": 3}, "must map dotted keys to values"),
        ({"machine": {"steering.valve.colour": 1.0}}, "unknown parameter 'steering.valve.colour'"),
        ({"machine": {"joint.range": [38.0, 39.0, 40.0]}}, "shape \\(3,\\), but must be a number or \\(2,\\)"),
        (
            {"machine": {"joint.range": [[38.0], [39.0, 40.0]]}},
            r"'joint.range'\] is \[\[38.*, but must be a number or \(2,\)",
        ),
        ({"machine": {"joint.range": "wide"}}, r"'joint.range'\] is 'wide', but must be a number or \(2,\) numbers"),
        (
            {"machine": {"joint.range": [True, False]}},
            r"'joint.range'\] is \[True, False\], but must be a number or \(2,\)",
        ),
        (
            {"machine": {"joint.rnge": 38.0}},
            r"^options\['machine'\]: unknown parameter 'joint.rnge': did you mean 'joint.range'",
        ),
        ({"machine": {5: 38.0}}, r"^options\['machine'\]: unknown parameter 5: keys are dotted names"),
        (
            {"machine": {"wheel.mass": [220.0, -1.0]}},
            r"^options\['machine'\]: wheel.mass of sub-environment 1 = -1 kg: must be finite and above 0 kg",
        ),
        (
            {"machine": {"tire.stiffness": [400.0, 1.0]}, "reset_mask": np.array([False, True])},
            r"^options\['machine'\] of sub-environment 1: .*tire.stiffness = 1 kN/m: the rear wheels cannot reach",
        ),
    ],
)
def test_wrong_options_are_named(options, message):
    env = make(2)
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)


@pytest.mark.parametrize("env_id", [TURNING, "AORO/PathTracking-v0"])
def test_an_episode_is_repeated_with_other_errors_of_its_sensors(env_id):
    env: Any = gymnasium.make_vec(env_id, num_envs=3)

    def rested(**options):
        """Observations after some steps at rest, in which errors that are rounded off show, and the true angle or error."""
        env.reset(seed=[4, 4, 4], options=options)
        for _ in range(9):
            seen, *_, infos = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        return seen, infos["joint_angle" if env_id == TURNING else "cross_track"]

    plain, truth = rested()
    seen, repeated = rested(sensor_seed=[1, 2, 1])
    np.testing.assert_array_equal(seen[0], seen[2])
    assert np.any(seen[0] != seen[1])
    assert np.any(seen[0] != plain[0])
    np.testing.assert_array_equal(repeated, truth)
    np.testing.assert_array_equal(rested()[0], plain)


def test_wrong_actions_are_named():
    env = make(2)
    env.reset()
    with pytest.raises(ValueError, match="actions have shape \\(2,\\), but must have \\(2, 1\\)"):
        env.step(np.zeros(2, dtype=np.float32))
    with pytest.raises(ValueError, match="action of sub-environment 1 is not finite"):
        env.step(np.array([[0.0], [np.nan]], dtype=np.float32))
    with pytest.raises(ValueError, match="seed has 1 entries, but must have num_envs = 2"):
        env.reset(seed=[1])


def test_actions_beyond_the_space_saturate():
    env = make(2)
    env.reset(seed=0)
    observations, *_ = env.step(np.array([[5.0], [-5.0]], dtype=np.float32))
    np.testing.assert_array_equal(observations[:, env.observation_layout["signals"]][:, 0], [1.0, -1.0])


def test_a_shared_machine_cannot_be_changed():
    env = make(2, own_machines=False)
    with pytest.raises(ValueError, match="own_machines is False; drop one of the two"):
        env.reset(options={"machine": {"joint.friction_torque": 100.0}})


@pytest.mark.parametrize("name", ["num_envs", "autoreset_mode"])
def test_a_single_environment_has_no_batch(name):
    with pytest.raises(ValueError, match=f"{name} belongs to gymnasium.make_vec"):
        TurningEnv(None, **{name: 2})
    with pytest.raises(ValueError, match="'reset_mask'\\] belongs to vector environments"):
        gymnasium.make(TURNING).reset(options={"reset_mask": np.array([True])})
