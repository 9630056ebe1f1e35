"""Policies that remember: the recursion by hand and by torch, what is forgotten and when, files, ONNX."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from aoro_gym.agents.evaluation.inputs import policy_content
from aoro_gym.agents.policies.memory import GatedMemory
from aoro_gym.agents.policies.onnx_file import write_onnx
from aoro_gym.agents.policies.policy import LearnedPolicy, Normalisation
from aoro_gym.execution.digest import digest

OBSERVED, ENCODED, UNITS = 5, 4, 3


def remembering(seed: int = 0) -> LearnedPolicy:
    rng = np.random.default_rng(seed)

    def drawn(*shape: int) -> np.ndarray:
        return rng.normal(0.0, 0.7, shape).astype(np.float32)

    memory = GatedMemory(
        drawn(ENCODED, OBSERVED), drawn(ENCODED), drawn(3 * UNITS, ENCODED), drawn(3 * UNITS, UNITS), drawn(3 * UNITS),
        drawn(3 * UNITS),
    )  # fmt: skip
    return LearnedPolicy(
        weights=(drawn(6, ENCODED + UNITS), drawn(2, 6)),
        biases=(drawn(6), drawn(2)),
        activation="tanh",
        squashed=False,
        low=np.full(2, -5.0, dtype=np.float32),
        high=np.full(2, 5.0, dtype=np.float32),
        normalisation=Normalisation(np.zeros(OBSERVED), np.ones(OBSERVED), 1e-8, 10.0),
        memory=memory,
    )


@pytest.fixture
def seen() -> np.ndarray:
    """(T, N, O)"""
    return np.random.default_rng(5).uniform(-2.0, 2.0, (20, 3, OBSERVED)).astype(np.float32)


def by_hand(policy: LearnedPolicy, seen: np.ndarray) -> list[list[float]]:
    """Actions along the observations (T, O) of one sub-environment, number by number."""
    memory, state, found = policy.memory, [0.0] * UNITS, []
    assert memory is not None

    def layer(weight, bias, values):
        return [
            sum(float(w) * v for w, v in zip(row, values, strict=True)) + float(b)
            for row, b in zip(weight, bias, strict=True)
        ]

    for row in seen.astype(float):
        encoded = [math.tanh(v) for v in layer(memory.encoder_weight, memory.encoder_bias, row)]
        taken = layer(memory.input_weight, memory.input_bias, encoded)
        kept = layer(memory.state_weight, memory.state_bias, state)
        r, z = ([1.0 / (1.0 + math.exp(-taken[k] - kept[k])) for k in range(a, a + UNITS)] for a in (0, UNITS))
        n = [math.tanh(taken[2 * UNITS + k] + r[k] * kept[2 * UNITS + k]) for k in range(UNITS)]
        state = [(1.0 - z[k]) * n[k] + z[k] * state[k] for k in range(UNITS)]
        hidden = [math.tanh(v) for v in layer(policy.weights[0], policy.biases[0], encoded + state)]
        found.append(layer(policy.weights[1], policy.biases[1], hidden))
    return found


def test_the_recursion_is_the_formula(seen):
    policy = remembering()
    acted = np.array([policy(row) for row in seen])
    for k in range(seen.shape[1]):
        # sums of at most 7 products up to 3 in float32, whose errors a gate halves from step to step
        np.testing.assert_allclose(acted[:, k], by_hand(policy, seen[:, k]), atol=2e-5)


def test_torch_s_network_acts_as_its_policy_and_along_sequences(seen):
    torch = pytest.importorskip("torch")
    from gymnasium.spaces import Box

    from aoro_gym.agents.training.memory_network import MemoryNetwork

    torch.manual_seed(1)
    network = MemoryNetwork(OBSERVED, UNITS, [6], 2, 1)
    policy = network.policy(Box(-5.0, 5.0, (2,), np.float32), normalisation=remembering().normalisation)
    begins = np.zeros(seen.shape[:2], dtype=bool)
    begins[0], begins[7, 1], begins[12, 2] = True, True, True
    acted = []
    for row, begun in zip(seen, begins, strict=True):
        policy.reset(begun)
        acted.append(policy(row))
    with torch.no_grad():
        along, told = network(torch.from_numpy(seen), network.beginning(3), torch.from_numpy(begins))
    assert told.shape == (*seen.shape[:2], 1)
    np.testing.assert_allclose(acted, along.numpy(), atol=2e-6)
    other = MemoryNetwork(OBSERVED, UNITS, [6], 2, 0)
    other.take(policy)
    np.testing.assert_array_equal(other.cell.weight_hh.detach(), network.cell.weight_hh.detach())
    with pytest.raises(ValueError, match=r"has a memory of \(5, 3, 3\), but the network to train one of \(5, 4, 4\)"):
        MemoryNetwork(OBSERVED, 4, [6], 2, 0).take(policy)


def test_who_begins_anew_forgets_and_the_others_do_not(seen):
    policy, fresh = remembering(), remembering()
    for row in seen[:9]:
        policy(row)
    policy.reset(np.array([False, True, False]))
    acted, begun = policy(seen[9]), fresh(seen[9])
    np.testing.assert_array_equal(acted[1], begun[1])
    assert np.abs(acted[[0, 2]] - begun[[0, 2]]).min() > 1e-4
    policy.reset()
    np.testing.assert_array_equal(policy(seen[9]), begun)
    np.testing.assert_array_equal(policy(seen[10, :2]), remembering()(seen[10, :2]))  # others


def test_each_environment_has_its_own(seen):
    space, acts = SimpleNamespace(shape=(OBSERVED,)), SimpleNamespace(shape=(2,))
    env = SimpleNamespace(observation_layout={}, single_observation_space=space, single_action_space=acts)
    env.unwrapped = env
    policy = remembering()
    policy(seen[0])
    np.testing.assert_array_equal(policy.made_for(env)(seen[1]), remembering()(seen[1]))


def test_files_hold_it_and_say_so(tmp_path, seen):
    policy = remembering()
    _, about = policy.save(tmp_path / "mine")
    again = LearnedPolicy.load(about)
    for row in seen:
        np.testing.assert_array_equal(again(row), policy(row))
    content = json.loads(about.read_text())
    assert content["format"] == 3
    assert content["network"]["memory"] == [OBSERVED, ENCODED, UNITS]
    assert digest(policy_content(again.made_for)) == digest(policy_content(policy.made_for))
    assert digest(policy_content(again.made_for)) != digest(policy_content(remembering(1).made_for))
    content["network"]["memory"] = [OBSERVED, ENCODED]
    about.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"memory is \[5, 4\], but must be three whole numbers, each above 0"):
        LearnedPolicy.load(about)


def test_parts_that_do_not_fit_are_named():
    policy = remembering()
    assert policy.memory is not None
    with pytest.raises(ValueError, match=r"memory.state_bias has the shape \(8,\), but must have \(9,\)"):
        replace(policy.memory, state_bias=np.zeros(8, dtype=np.float32))
    with pytest.raises(ValueError, match=r"the memory gives 7 numbers, but layer 0 takes 6"):
        replace(policy, weights=(np.zeros((6, 6), np.float32), policy.weights[1]))
    with pytest.raises(ValueError, match=r"the network takes 5 numbers, but 7 are normalised"):
        replace(policy, normalisation=Normalisation(np.zeros(7), np.ones(7), 1e-8, 10.0))


def test_onnx_gives_the_same_actions_and_states(tmp_path, seen):
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    policy, state = remembering(), np.zeros((3, UNITS), dtype=np.float32)
    write_onnx(policy, tmp_path / "policy.onnx")
    session = runtime.InferenceSession(tmp_path / "policy.onnx", providers=["CPUExecutionProvider"])
    for row in seen:
        actions, state = session.run(["actions", "next_state"], {"observations": row, "state": state})
        np.testing.assert_allclose(actions, policy(row), atol=5e-6)
