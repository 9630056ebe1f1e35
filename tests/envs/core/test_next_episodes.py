"""Episodes that are drawn ahead are those that would be drawn when they begin."""

import copy
import pickle
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import warp as wp

from aoro_gym.envs import register_envs
from aoro_gym.envs.core import drawing, next_episodes, vector
from aoro_gym.envs.core.drawing import OneByOne, Together
from aoro_gym.envs.core.kernels.step import BEGUN, WRONG_OBSERVATION
from aoro_gym.envs.core.next_episodes import NextEpisodes
from aoro_gym.envs.levelling import config as levelling
from aoro_gym.envs.levelling.courses import obstacle_course
from aoro_gym.envs.path_tracking.config import MILD, PathTrackingConfig
from aoro_gym.envs.turning import config as turning
from aoro_gym.sensors import GpsNoise

pytest.importorskip("torch")
pytest.importorskip("array_api_compat")
register_envs()
PATH_TRACKING, TURNING, LEVELLING = "AORO/PathTracking-v0", "AORO/Turning-v0", "AORO/Levelling-v0"
LIMIT_TRACKING = "AORO/PathTracking-v1"
NUMBER = 10


WAYS = {"together": 1, "one by one": NUMBER + 1}
"""How generators draw, and the least number of sub-environments that draw together then."""


@pytest.fixture(autouse=True)
def way(request, monkeypatch) -> str:
    """Together, as many would, unless a test asks for both."""
    monkeypatch.setattr(drawing, "TOGETHER_FROM", WAYS[getattr(request, "param", "together")])
    return getattr(request, "param", "together")


both_ways = pytest.mark.parametrize("way", WAYS, indirect=True)


def made(name: str = TURNING, *, output: str = "torch", **options: Any) -> Any:
    """On the host nothing is drawn ahead."""
    options = {"num_envs": NUMBER, "max_episode_steps": 4, "autoreset_mode": "SameStep", **options}
    if name == LEVELLING:
        options["courses"] = [obstacle_course(1, 0.8), obstacle_course(2, 0.5)]
    return gymnasium.make_vec(name, output=output, **options).unwrapped


def pair(name: str = TURNING, **options: Any) -> tuple[Any, Any]:
    ahead, plain = made(name, **options), made(name, output="numpy", **options)
    for env in (ahead, plain):
        env.reset(seed=5)
    return ahead, plain


def steps_agree(ahead, plain, count=14):
    """To the bit: the same kernels compute both."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        actions = rng.uniform(-1.0, 1.0, plain.action_space.shape).astype(np.float32)
        one, other = ahead.step(actions), plain.step(actions)
        for left, right in zip(one[:4], other[:4], strict=True):
            np.testing.assert_array_equal(np.asarray(left), right)


@pytest.fixture
def begun(monkeypatch):
    """Numbers of sub-environments whose episodes began from what was drawn ahead."""
    rows: list[int] = []
    begin, began = NextEpisodes._begin, NextEpisodes.began

    def in_step(self, env, done):
        rows.extend(np.flatnonzero(done & self._ready_then))
        began(self, env, done)

    monkeypatch.setattr(
        NextEpisodes, "_begin", lambda self, env, which: (rows.extend(which), begin(self, env, which))[1]
    )
    monkeypatch.setattr(NextEpisodes, "began", in_step)
    return rows


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (TURNING, {}),
        (TURNING, {"autoreset_mode": "NextStep", "randomisation": turning.MILD}),
        (PATH_TRACKING, {"randomisation": MILD, "gear": "automatic"}),
        (PATH_TRACKING, {"autoreset_mode": "NextStep"}),
        (LEVELLING, {"randomisation": levelling.MILD}),
    ],
)
@both_ways
def test_drawn_ahead_is_drawn_then(name, options, begun):
    """Machines that vary, too; most episodes begin so."""
    ahead, plain = pair(name, **options)
    steps_agree(ahead, plain)
    assert len(begun) >= NUMBER


def on_host(value: Any) -> np.ndarray:
    return np.asarray(value.cpu() if hasattr(value, "cpu") else value)


def same(one: Any, other: Any, name: str = "") -> None:
    """To the bit, of what is nested, too."""
    if isinstance(one, dict):
        assert list(one) == list(other), name
        for key, value in one.items():
            same(value, other[key], key)
        return
    one, other = on_host(one), on_host(other)
    assert one.dtype == other.dtype and one.shape == other.shape, name
    if one.dtype == object:
        assert [each is None for each in one] == [each is None for each in other], name
        for left, right in zip(one, other, strict=True):
            same(left, right, name) if isinstance(left, np.ndarray) else None
            assert isinstance(left, np.ndarray) or left == right, name
    else:
        np.testing.assert_array_equal(one, other, err_msg=name)


def two_ways(name: str = TURNING, **options: Any) -> tuple[Any, Any]:
    """The same environment, whose episodes begin in the launches of a step, and by the host after them."""
    in_step, by_host = made(name, **options), made(name, **options)
    for env in (in_step, by_host):
        env.reset(seed=3)
    by_host._next._in_step = False
    return in_step, by_host


def all_agree(in_step: Any, by_host: Any, count: int, seed: int = 1) -> int:
    """How many episodes ended, of steps that hand out the same."""
    rng, ended = np.random.default_rng(seed), 0
    for _ in range(count):
        actions = rng.uniform(-1.0, 1.0, by_host.action_space.shape).astype(np.float32)
        one, other = in_step.step(actions), by_host.step(actions)
        for left, right in zip(one, other, strict=True):
            same(left, right)
        ended += int(on_host(other[2] | other[3]).sum())
    assert in_step._kernel_step.begins and not by_host._kernel_step.begins
    states = ([generator.bit_generator.state for generator in env.generators] for env in (in_step, by_host))
    for env in (in_step, by_host):
        env._forget_next()  # what is drawn and was not needed
    one, other = states
    assert one == other
    return ended


ENDINGS: dict[str, tuple[str, dict[str, Any]]] = {
    "paths are lost": (PATH_TRACKING, {"config": PathTrackingConfig(path_limit=0.35, randomisation=MILD)}),
    "paths of any difficulty": (LIMIT_TRACKING, {"max_episode_steps": 5}),
    "joints turn": (TURNING, {"max_episode_steps": 3, "randomisation": turning.MILD}),
    "machines vary, and carry sensors": (
        PATH_TRACKING,
        {
            "config": PathTrackingConfig(randomisation=MILD, gps_latency=0.2, gps_noise=GpsNoise.typical()),
            "gear": "automatic",
            "max_episode_steps": 6,
        },
    ),
    "frames are levelled": (LEVELLING, {"randomisation": levelling.MILD}),
}


@pytest.mark.parametrize("case", ENDINGS)
@pytest.mark.parametrize("brought", [False, True])
@pytest.mark.parametrize("count", [16, pytest.param(150, marks=pytest.mark.slow)])
def test_launches_begin_what_the_host_would(case, brought, count, monkeypatch):
    """Observations, rewards, ends, infos, final ones and generators; of tensors, and of NumPy's arrays that are brought."""
    name, options = ENDINGS[case]
    if brought:
        monkeypatch.setattr(vector, "calculates_there", lambda task, twin: True)
        options = {**options, "output": "numpy"}
    in_step, by_host = two_ways(name, **options)
    assert all_agree(in_step, by_host, count) >= 2 * NUMBER


@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("case", ENDINGS)
@pytest.mark.parametrize("number", [NUMBER, 600])
@both_ways
def test_launches_of_a_gpu_begin_what_the_host_would(case, number):
    name, options = ENDINGS[case]
    assert all_agree(*two_ways(name, **options, num_envs=number, device="cuda:0"), 16) >= 2 * NUMBER


def test_what_is_handed_out_lasts():
    """While later steps hand out others, in which episodes end and begin, too."""
    env, _ = two_ways(PATH_TRACKING)
    steps = []
    for _ in range(9):
        out = env.step(np.full(env.action_space.shape, 0.3, np.float32))
        steps.append((out, copy.deepcopy(out)))
    assert env._kernel_step.begins and sum("final_info" in out[4] for out, _ in steps) == 2
    for out, then in steps:
        for one, other in zip(out, then, strict=True):
            same(one, other)


@both_ways
def test_what_is_not_drawn_in_time_begins_after_the_launches(begun, monkeypatch):
    """Of all that end in a step, those that are drawn begin in it, the others by the host."""
    in_step, by_host = two_ways()
    for env in (in_step, by_host):
        env.step(np.zeros(env.action_space.shape, np.float32))
    in_step._next.forget(in_step)
    monkeypatch.setattr(in_step._next, "_batch", 3)
    monkeypatch.setattr(in_step._next, "draw_during", lambda env, step: env._next.draw(env))
    assert all_agree(in_step, by_host, 12) == 3 * NUMBER
    assert begun


@both_ways
@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_others_are_drawn_with_those_that_wait(way, mode, begun, monkeypatch):
    """Where they are drawn together: it takes no longer. They begin as if they had been drawn before."""
    ahead, plain = pair(autoreset_mode=mode)
    steps_agree(ahead, plain, 3)
    assert ahead._next.ready.any() and not begun
    ahead._next.forget(ahead)
    monkeypatch.setattr(ahead._next, "_batch", NUMBER + 1)  # so many are never missing
    steps_agree(ahead, plain, 3)
    assert sorted(begun) == list(range(NUMBER)) and not ahead._next.ready.any()
    monkeypatch.setattr(ahead._next, "_most", NUMBER)
    ahead._next.begin(ahead, np.arange(2))
    assert ahead._next.ready.tolist() == [False] * 2 + [way == "together"] * (NUMBER - 2)


def test_a_wrong_term_is_named_before_anything_begins():
    env = made(max_episode_steps=9)
    env.reset(seed=3)
    for _ in range(8):
        env.step(np.zeros(env.action_space.shape, np.float32))
    ready = env._next.ready.copy()
    assert env._kernel_step.begins and ready.any()
    wrong = env.arrays.zeros(env.action_space.shape, env.arrays.xp.float32)
    wrong[2] = np.nan
    with pytest.raises(ValueError, match="sub-environment 2 is not finite"):
        env.step(wrong)
    assert (env._next.ready >= ready).all() and np.asarray(env._next._on_device["ready"]).sum() == env._next.ready.sum()


def test_a_wrong_first_observation_is_told_with_the_next_step_and_once():
    """The host has read the flags of the step in which the episode began before that observes."""
    env = made(max_episode_steps=3)
    env.reset(seed=3)
    nothing = np.zeros(env.action_space.shape, np.float32)
    begun = []
    for _ in range(12):
        env.step(nothing)
        begun.append(int(env._kernel_step._flags[int(BEGUN)]))
        if begun[-1]:
            break
    assert begun[-1] > 0 and not any(begun[:-1])
    env._kernel_step._flags[int(WRONG_OBSERVATION)] = 1
    with pytest.raises(ValueError, match="not finite where an episode began in the last step"):
        env.step(nothing)
    env.step(nothing)


def test_arrays_that_are_replaced_are_drawn_for_anew():
    in_step, by_host = two_ways()
    all_agree(in_step, by_host, 6)
    for env in (in_step, by_host):
        env._next._writes.places[0, 0] += 1  # as if they lay elsewhere before ...
        env._next._writes._tensors = ()  # ... and were others
    all_agree(in_step, by_host, 12)


@both_ways
@pytest.mark.parametrize("name", [TURNING, LEVELLING])
def test_a_reset_begins_what_would_have_begun_without(name, begun):
    """All of it is given back: with a mask, with options, with seeds; generators that were spawned, too."""
    ahead, plain = pair(name)
    masks = {"reset_mask": np.arange(NUMBER) % 3 == 0}
    options = masks, {"joint_angle": 0.1}, {"machine": {"oil.gas_fraction": 0.005}}
    for each in ({"seed": 9}, *({"options": one} for one in options)):
        steps_agree(ahead, plain, 6)
        assert ahead._next.ready.any()
        one, other = (env.reset(**each) for env in (ahead, plain))
        np.testing.assert_array_equal(np.asarray(one[0]), other[0])
    steps_agree(ahead, plain, 6)
    assert begun


def test_what_is_set_later_counts_for_episodes_that_were_drawn(begun):
    ahead, plain = pair()
    for env in (ahead, plain):
        steps = env.step(np.zeros(env.action_space.shape, np.float32))
        assert len(steps) == 5
        env.task.randomisation = replace(turning.MILD, joint_angle=(0.5, 0.6))
    assert ahead._next.ready.any()
    steps_agree(ahead, plain)
    assert begun


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_begins_the_same_episodes(copied):
    ahead, plain = pair()
    steps_agree(ahead, plain, 2)
    assert ahead._next.ready.any()
    steps_agree(copied(ahead), copied(plain))
    steps_agree(ahead, plain)


def test_array_operations_go_on_from_the_same_draws():
    ahead, plain = pair()
    steps_agree(ahead, plain, 2)
    states = [generator.bit_generator.state for generator in plain.generators]
    ahead._kernels = False
    ahead._in_kernels()
    assert [generator.bit_generator.state for generator in ahead.generators] == states


@both_ways
@pytest.mark.parametrize("name", [TURNING, PATH_TRACKING])
def test_who_draws_between_steps_draws_what_comes_next(name, way, begun):
    """By the first sub-environment's generator, and by another kind of generator in the place of one."""
    ahead, plain = pair(name)
    steps_agree(ahead, plain, 2)
    assert ahead._next.ready.any() and isinstance(ahead._next._drawing, Together) == (way == "together")
    assert ahead.np_random.random() == plain.np_random.random()
    steps_agree(ahead, plain, 4)
    for env in (ahead, plain):
        env.generators[3] = np.random.Generator(np.random.MT19937(5))
    steps_agree(ahead, plain, 8)
    assert isinstance(ahead._next._drawing, OneByOne)
    assert ahead.generators[3].random() == plain.generators[3].random()
    assert begun


def test_an_error_is_raised_where_the_episode_begins(monkeypatch):
    """Not while others go on; then with nothing lost."""
    ahead, plain = pair()
    real = type(ahead.task).start

    def start(self, where, *given):
        raise ValueError("no start") if self is ahead.task else real(self, where, *given)

    with monkeypatch.context() as patch:
        patch.setattr(type(ahead.task), "start", start)
        steps_agree(ahead, plain, 3)
        assert isinstance(ahead._next.failed, ValueError) and not ahead._next.ready.any()
        with pytest.raises(ValueError, match="no start"):
            ahead.step(np.zeros(ahead.action_space.shape, np.float32))


def test_nothing_is_drawn_ahead_without_a_device():
    """There the host has no time to spare; and with resets by hand none is known to come."""
    cases: tuple[dict[str, Any], ...] = ({"output": "numpy"}, {"autoreset_mode": "Disabled"}, {"kernels": False})
    for options in cases:
        env = made(**options)
        env.reset(seed=1)
        env.step(np.zeros(env.action_space.shape, np.float32))
        assert env._next is None


@pytest.mark.parametrize(("seconds", "computing", "batches"), [(0.0, True, 1), (1e9, False, 1), (1e9, True, NUMBER)])
def test_batches_are_drawn_while_they_fit_into_the_step(seconds, computing, batches):
    """One at least; each is one episode of ten."""
    env = made()
    env.reset(seed=5)
    env.step(env.arrays.zeros(env.action_space.shape, env.arrays.xp.float32))
    env._next.forget(env)
    env._next.draw_during(env, SimpleNamespace(computing=computing, seconds=seconds))
    assert env._next.ready.sum() == batches


@pytest.mark.parametrize(("took", "computing", "sizes"), [
    (1.0, True, [256, 512, 1024, 2048, 2048]),
    (3.0, True, [256, 512]),
    (1.0, False, [256]),
    (8.0, True, [256]),
])  # fmt: skip
def test_batches_grow_while_two_fit_into_a_step(took, computing, sizes, monkeypatch):
    """Of an unlimited number of episodes, in a step of eight seconds; every batch takes ``took``, whatever its size."""
    following, clock = NextEpisodes(4096, in_step=True), [0.0]
    drawn: list[int] = []

    def draw(env: Any) -> int:
        clock[0] += took
        drawn.append(following._most)
        return following._most

    monkeypatch.setattr(following, "_draw", draw)
    monkeypatch.setattr(next_episodes, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    following.draw_during(None, SimpleNamespace(computing=computing, seconds=8.0))
    assert drawn[: len(sizes)] == sizes and clock[0] <= max(8.0, took)
    took *= 9.0
    following.draw_during(None, SimpleNamespace(computing=computing, seconds=8.0))
    assert following._most == max(drawn[-1] // 2, next_episodes.MOST)
