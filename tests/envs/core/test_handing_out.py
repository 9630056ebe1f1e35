"""NumPy's arrays are the same whether they were calculated on the host, or on the device and brought there."""

import copy
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import warp as wp

pytest.importorskip("array_api_compat")

from aoro_gym.agents.controllers.mppi import Mppi, PathIntegral
from aoro_gym.envs.core import handing_out, vector
from aoro_gym.envs.core.terms import RewardTerm
from aoro_gym.execution.array_api import Arrays
from tests.envs.core.test_kernel_step import (
    LEVELLING,
    OBSTACLES,
    PATH_TRACKING,
    SHORT_GOALS,
    TURNING,
    infos_agree,
)

ARGUMENTS: dict[str, dict[str, Any]] = {
    PATH_TRACKING: {},
    TURNING: {"config": SHORT_GOALS},
    LEVELLING: {"courses": OBSTACLES},
}
ON_GPU = SimpleNamespace(device=SimpleNamespace(is_cuda=True))
CUDA = pytest.param("cuda:0", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device"))


def pair(monkeypatch: pytest.MonkeyPatch, name: str, device: str = "cpu", **arguments: Any) -> tuple[Any, Any]:
    """The same environment with its arrays on the host, and with tensors that are brought there."""
    envs = []
    for there in (False, True):
        monkeypatch.setattr(vector, "calculates_there", lambda task, twin, there=there: there)
        of = {"num_envs": 3, "device": device, **ARGUMENTS[name], **arguments}
        envs.append(gymnasium.make_vec(name, **of).unwrapped)
    host, there = envs
    assert host.arrays.on_host and not there.arrays.on_host and there.handed_out.on_host
    return host, there


def same(host: tuple[Any, ...], there: tuple[Any, ...]) -> None:
    for one, other in zip(host[:-1], there[:-1], strict=True):
        assert isinstance(other, np.ndarray) and other.dtype == one.dtype
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-5)
    infos_agree(host[-1], there[-1])


@pytest.mark.parametrize(("name", "mode"), [*((name, "SameStep") for name in ARGUMENTS), (TURNING, "NextStep")])
def test_arrays_are_those_of_the_host(monkeypatch, name, mode):
    """Over resets and three ends of episodes, infos and what is in them included."""
    host, there = pair(monkeypatch, name, autoreset_mode=mode, max_episode_steps=4)
    same(host.reset(seed=1), there.reset(seed=1))
    rng = np.random.default_rng(2)
    for _ in range(13):
        actions = rng.uniform(-1.0, 1.0, host.action_space.shape).astype(np.float32)
        same(host.step(actions), there.step(actions))
        np.testing.assert_array_equal(there.output("joint_angle"), host.output("joint_angle"))
        np.testing.assert_array_equal(there.time, host.time)
        np.testing.assert_allclose(there.traces(), host.traces(), atol=1e-5)


@pytest.mark.parametrize("device", [CUDA])
def test_on_a_gpu_they_are_those_of_array_operations(monkeypatch, device):
    host, there = pair(monkeypatch, PATH_TRACKING, device, autoreset_mode="SameStep", max_episode_steps=4)
    same(host.reset(seed=1), there.reset(seed=1))
    for step in range(9):
        actions = np.full(host.action_space.shape, 0.1 * step, dtype=np.float32)
        same(host.step(actions), there.step(actions))


def test_why_an_episode_terminates_is_said_in_words(monkeypatch):
    host, there = pair(monkeypatch, PATH_TRACKING, autoreset_mode="SameStep")
    for env in (host, there):
        env.reset(seed=1)
        env.task.config = copy.copy(env.task.config)
        object.__setattr__(env.task.config, "path_limit", 0.0)
        env._kernel_step = None
    actions = np.zeros(host.action_space.shape, dtype=np.float32)
    one, other = host.step(actions), there.step(actions)
    same(one, other)
    assert other[4]["final_info"]["termination"].tolist() == ["lost the path"] * 3


def test_what_was_handed_out_stays(monkeypatch):
    _, there = pair(monkeypatch, TURNING)
    observations, _ = there.reset(seed=1)
    kept = observations.copy()
    there.step(np.ones(there.action_space.shape, dtype=np.float32))
    np.testing.assert_array_equal(observations, kept)


def test_a_copy_goes_on_alike(monkeypatch):
    _, there = pair(monkeypatch, TURNING)
    there.reset(seed=1)
    other = copy.deepcopy(there)
    actions = np.full(there.action_space.shape, 0.4, dtype=np.float32)
    same(there.step(actions), other.step(actions))


def test_planners_see_the_same_future(monkeypatch):
    plans = []
    for env in pair(monkeypatch, TURNING):
        monkeypatch.setattr(vector, "calculates_there", lambda task, twin: False)
        env.reset(seed=1)
        planner = Mppi(env, PathIntegral(noise=(0.5,), horizon=4, samples=4))
        plans.append(planner(np.zeros(0, dtype=np.float32)))
    np.testing.assert_allclose(plans[0], plans[1], atol=1e-5)


def test_terms_of_ones_own_keep_arrays_on_the_host(monkeypatch):
    monkeypatch.setattr(handing_out, "calculates_on_gpus", lambda: True)
    env: Any = gymnasium.make_vec(TURNING, num_envs=1).unwrapped
    task = env.task
    assert handing_out.calculates_there(task, ON_GPU)
    assert not handing_out.calculates_there(task, SimpleNamespace(device=SimpleNamespace(is_cuda=False)))
    task.reward_terms = {**task.reward_terms, "own": RewardTerm(1.0, lambda view: np.abs(view.error))}
    assert not handing_out.calculates_there(task, ON_GPU)


def test_a_torch_that_knows_no_gpu_calculates_on_none(monkeypatch):
    env: Any = gymnasium.make_vec(TURNING, num_envs=1).unwrapped
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert not handing_out.calculates_there(env.task, ON_GPU)
    with pytest.raises(
        ValueError, match="knows no GPU, and the device is cuda:0: install a torch that is built for CUDA"
    ):
        Arrays.torch("cuda:0")
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    assert handing_out.calculates_there(env.task, ON_GPU)
