"""Policies in files: the same actions as where they were learned, without torch and without running foreign code."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from aoro_gym.agents.evaluation.evaluate import evaluate, observing, policy_factory
from aoro_gym.agents.policies.files import SHIPPED, load_policy
from aoro_gym.agents.policies.onnx_file import write_onnx
from aoro_gym.agents.policies.policy import LearnedPolicy, Normalisation
from aoro_gym.envs import register_envs
from aoro_gym.envs.turning.environment import TurningVectorEnv

register_envs()
TURNING = "AORO/Turning-v0"
ROOT = Path(__file__).resolve().parents[3]
OBSERVED = 8
"""Numbers that the turning task observes."""


def network(seed=0, *, squashed=False, activation="tanh", actions=1, layout=None) -> LearnedPolicy:
    rng = np.random.default_rng(seed)
    sizes = [OBSERVED, 16, 12, actions]
    return LearnedPolicy(
        weights=tuple(rng.normal(0.0, 0.7, (b, a)).astype(np.float32) for a, b in pairwise(sizes)),
        biases=tuple(rng.normal(0.0, 0.3, b).astype(np.float32) for b in sizes[1:]),
        activation=activation,
        squashed=squashed,
        low=np.linspace(-1.0, -0.5, actions, dtype=np.float32),
        high=np.linspace(1.0, 0.25, actions, dtype=np.float32),
        normalisation=Normalisation(rng.normal(0.0, 1.0, OBSERVED), rng.uniform(1e-6, 2.0, OBSERVED), 1e-8, 5.0),
        environment=TURNING,
        layout=TurningVectorEnv(1).observation_layout if layout is None else layout,
        training={"command": "aoro-gym train --seed 3", "seed": 3},
    )


@pytest.fixture
def observations():
    return np.random.default_rng(5).uniform(-2.0, 2.0, (200, OBSERVED)).astype(np.float32)


def test_forward_pass_is_the_formula(observations):
    policy = network(squashed=True, actions=2)
    one = policy.normalisation
    assert one is not None
    for row, action in zip(observations, policy(observations), strict=True):
        values = [
            min(max((float(x) - m) / (v + 1e-8) ** 0.5, -5.0), 5.0)
            for x, m, v in zip(row, one.mean, one.variance, strict=True)
        ]
        for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
            values = [sum(w * x for w, x in zip(r, values, strict=True)) + b for r, b in zip(weight, bias, strict=True)]
            values = np.tanh(values) if k < 2 else values
        share = 0.5 * (np.tanh(values) + 1.0)
        # at most 16 products of numbers up to 3 in float32, in three layers
        np.testing.assert_allclose(action, policy.low + share * (policy.high - policy.low), atol=3e-5)


@pytest.mark.parametrize("squashed", [False, True])
def test_actions_stay_within_their_bounds(squashed, observations):
    policy = network(1, squashed=squashed, actions=3)
    actions = policy(100.0 * observations)
    assert actions.dtype == np.float32
    assert np.all((actions >= policy.low) & (actions <= policy.high))
    assert len(np.unique(actions[:, 0])) > 10


def test_files_give_the_same_policy_to_the_bit(tmp_path, observations):
    policy = network()
    numbers, about = policy.save(tmp_path / "made" / "mine")
    assert [numbers.name, about.name] == ["mine.safetensors", "mine.json"]
    for path in (numbers, about):
        again = load_policy(path)
        np.testing.assert_array_equal(again(observations), policy(observations))
    assert again.layout == policy.layout
    assert again.training == policy.training
    assert json.loads(about.read_text())["network"] == {
        "sizes": [8, 16, 12, 1],
        "activation": "tanh",
        "squashed": False,
    }


def test_loading_and_acting_need_no_torch(tmp_path):
    network().save(tmp_path / "mine")
    code = (
        "import sys, pathlib, numpy; from aoro_gym.agents.policies.files import load_policy;"
        f"policy = load_policy(pathlib.Path({str(tmp_path / 'mine.json')!r}));"
        "print(policy(numpy.zeros((2, 8))).shape, 'torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "(2, 1) False"


DEEP = "[" * 100_000 + "]" * 100_000
DIGITS = "9" * 400


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda about: about.update(format=4), "format is 4, but this version reads 1, 2, 3"),
        (lambda about: about["network"].update(activation="swish"), "activation is 'swish'; choose one of: tanh, relu"),
        (lambda about: about["network"].update(sizes=[8, 16, 12, 4, 1]), r"layer3\.weight is missing"),
        (lambda about: about["network"].update(sizes=[8, 16, 13, 1]), r"has the sizes|have the sizes \[8, 16, 12, 1\]"),
        (lambda about: about.pop("normalisation"), "normalisation is missing"),
        (lambda about: about.pop("network"), "network is missing"),
        (lambda about: about.update(network=[1, 2]), r"network is \[1, 2\], but must be an object"),
        (lambda about: about["network"].update(sizes="8, 1"), "sizes is '8, 1', but must be a list"),
        (lambda about: about["network"].update(sizes=[8]), r"sizes is \[8\], but must be two whole numbers or more"),
        (lambda about: about["network"].update(sizes=[8, -1]), "each above 0"),
        (lambda about: about["network"].update(sizes=[8, True]), "each above 0"),
        (lambda about: about["network"].update(sizes=[8, 10**400]), "is not the policy that"),
        (lambda about: about["network"].update(activation=["tanh"]), r"activation is \['tanh'\], but must be text"),
        (lambda about: about["network"].update(squashed="no"), "squashed is 'no', but must be true or false"),
        (lambda about: about.update(environment=None), "environment is None, but must be text"),
        (lambda about: about.update(training=[]), "training is \\[\\], but must be an object"),
        (lambda about: about.update(observation=[1]), r"observation is \[1\], but must be an object"),
        (lambda about: about["observation"].update(target=7), r"observation 'target' is 7, but must be \[first, end\]"),
        (lambda about: about["observation"].update(target=[3, 99]), r"must be \[first, end\] in \[0, 8\]"),
        (
            lambda about: about["normalisation"].update(clip=int(DIGITS)),
            "clip is 9+... .400 characters., but must be a finite",
        ),
        (
            lambda about: about["normalisation"].update(epsilon="small"),
            "epsilon is 'small', but must be a finite number",
        ),
        (lambda about: about["normalisation"].pop("clip"), "clip is None"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(spoil, message, tmp_path):
    _, about = network().save(tmp_path / "mine")
    description = json.loads(about.read_text())
    spoil(description)
    about.write_text(json.dumps(description))
    with pytest.raises(ValueError, match=message) as caught:
        load_policy(about)
    assert str(tmp_path / "mine") in str(caught.value)
    assert len(str(caught.value)) < len(str(tmp_path)) + 300


@pytest.mark.parametrize(
    "text", ["", "null", "[1, 2]", '"text"', DEEP, f'{{"format": {DIGITS * 20}}}', '{"format": NaN}', "\x00"]
)
def test_what_is_no_description_is_named(text, tmp_path):
    _, about = network().save(tmp_path / "[/x] mine$")
    about.write_text(text)
    with pytest.raises(ValueError) as caught:
        load_policy(about)
    assert str(about) in str(caught.value)
    assert len(str(caught.value)) < len(str(tmp_path)) + 300


def test_broken_numbers_are_named(tmp_path):
    numbers, about = network().save(tmp_path / "mine")
    whole = numbers.read_bytes()
    for content in (b"", b"nothing of the kind", whole[:40], whole[:-4], b"\xff" * 16, (2**60).to_bytes(8, "little")):
        numbers.write_bytes(content)
        with pytest.raises(ValueError, match=r"mine\.safetensors is no \.safetensors"):
            load_policy(numbers)
    with pytest.raises(OSError, match="another"):
        LearnedPolicy.load(tmp_path / "another.json")
    about.unlink()
    with pytest.raises(ValueError, match=r"mine\.safetensors needs mine\.json beside it"):
        load_policy(numbers)
    with pytest.raises(ValueError, match=r"layer1\.weight\[.*\] is .*, but must be finite"):
        policy = network()
        policy.weights[1][0, 0] = np.nan
        policy.__post_init__()


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("layer0.weight", None, r"layer0\.weight is missing"),
        ("layer0.weight", np.zeros((16, 8), dtype=np.int32), "type int32, but must be 2-dimensional floats"),
        ("layer0.weight", np.zeros((16, 7), dtype=np.float32), "8 numbers|7 numbers|7 are|takes 7"),
        ("layer0.bias", np.zeros((16, 1), dtype=np.float32), r"shape \(16, 1\)"),
        ("action.low", np.full(1, 2.0, dtype=np.float32), r"action\.low\[0\] is 2\.0, but must be at most .* 1\.0"),
        ("action.high", np.full(1, np.inf, dtype=np.float32), r"action\.high\[0\] is inf, but must be finite"),
        ("observation.variance", np.full(8, -1.0), r"observation\.variance\[0\] is -1, but must be at least 0"),
        ("observation.variance", np.full(9, 1.0), "takes 8 numbers, but 9 are normalised"),
    ],
)
def test_numbers_of_another_policy_are_named(name, array, message, tmp_path):
    from safetensors.numpy import load, save

    numbers, _ = network().save(tmp_path / "mine")
    arrays = {key: value for key, value in load(numbers.read_bytes()).items() if key != name}
    numbers.write_bytes(save(arrays if array is None else {**arrays, name: array}))
    with pytest.raises(ValueError, match=message) as caught:
        load_policy(numbers)
    assert str(numbers) in str(caught.value)


def test_files_of_two_policies_are_no_policy(tmp_path):
    """As a crash between the two files of one would leave them, or a copy of one of them."""
    one, other = network().save(tmp_path / "one"), network(7).save(tmp_path / "other")
    for first, second in ((one, other), (other, one)):
        first[0].with_name("mixed.safetensors").write_bytes(first[0].read_bytes())
        first[1].with_name("mixed.json").write_bytes(second[1].read_bytes())
        with pytest.raises(ValueError, match=r"mixed\.safetensors is not the policy .* its numbers are others; resume"):
            load_policy(tmp_path / "mixed.json")


def test_valid_neighbours_are_read(tmp_path, observations):
    """Numbers as JSON may write them, a policy without normalisation or known columns, and doubles."""
    from safetensors.numpy import load, save

    numbers, about = network().save(tmp_path / "mine")
    expected = load_policy(numbers)(observations)
    description = json.loads(about.read_text())
    description["normalisation"]["clip"] = 5  # a whole number, too
    description["observation"] = {}
    description["unknown"] = "is left alone"
    description["format"] = 1  # which does not say which numbers it is of
    about.write_text(json.dumps(description, indent=None))
    np.testing.assert_array_equal(load_policy(about)(observations), expected)
    wide = {name: array.astype(np.float64) for name, array in load(numbers.read_bytes()).items()}
    numbers.write_bytes(save(wide))
    np.testing.assert_array_equal(load_policy(about)(observations), expected)
    description["normalisation"] = None
    about.write_text(json.dumps(description))
    assert load_policy(about).normalisation is None


@pytest.mark.parametrize("examples", [60, pytest.param(10_000, marks=pytest.mark.slow)])
def test_mutated_policies_are_refused_clearly(examples, tmp_path):
    numbers, about = network().save(tmp_path / "mine")
    files = {numbers: numbers.read_bytes(), about: about.read_bytes()}
    rng = np.random.default_rng(examples)
    for _ in range(examples):
        file = (numbers, about)[rng.integers(2)]
        content = bytearray(files[file])
        for _ in range(rng.integers(1, 4)):
            first = int(rng.integers(len(content)))
            match rng.integers(3):
                case 0:
                    content[first] = rng.integers(256)
                case 1:
                    del content[first : first + int(rng.integers(1, 50))]
                case _:
                    content[first:first] = content[first // 2 : first // 2 + int(rng.integers(1, 50))]
            content = content or bytearray(b" ")
        file.write_bytes(bytes(content))
        try:
            load_policy(about)
        except (ValueError, OSError) as error:
            assert str(tmp_path / "mine") in str(error)
            assert len(str(error)) < len(str(tmp_path)) + 400
        file.write_bytes(files[file])


def test_pickles_need_trust(tmp_path):
    with pytest.raises(ValueError, match=r"a pickle, which runs code .* --trust-pickle"):
        load_policy(tmp_path / "model.zip")
    with pytest.raises(ValueError, match=r"is no policy; give a \.json"):
        load_policy(tmp_path / "model.pt")


def test_environment_must_observe_what_was_learned_from():
    policy = network()
    assert policy.made_for(gymnasium.make_vec(TURNING, num_envs=1)) is policy
    with pytest.raises(ValueError, match=r"observes .*pressures \(3\)"):
        policy.made_for(TurningVectorEnv(1, observe_pressures=True))
    with pytest.raises(ValueError, match="observes 11 numbers, but the policy was made for 8"):
        network(layout={}).made_for(TurningVectorEnv(1, observe_pressures=True))
    with pytest.raises(ValueError, match="takes 1 numbers, but the policy was made for 2"):
        network(actions=2).made_for(TurningVectorEnv(1))


def test_files_are_evaluated_like_controllers(tmp_path):
    network().save(tmp_path / "mine")
    file = str(tmp_path / "mine.json")
    found = evaluate(TURNING, {"mine": policy_factory(TURNING, file)}, episodes=1)
    assert np.isfinite(found.summary["mine"]["return"].mean)
    with pytest.raises(ValueError, match=r"was trained in AORO/Turning-v0, not in AORO/PathTracking-v0"):
        policy_factory("AORO/PathTracking-v0", file)


def test_a_policy_is_shown_in_a_line():
    assert (
        repr(load_policy(SHIPPED / "turning-ppo.json"))
        == "LearnedPolicy('AORO/Turning-v0', layers [8, 64, 64, 1], tanh)"
    )
    told = "LearnedPolicy('AORO/PathTracking-v1', memory 128, layers [256, 128, 128, 2], tanh)"
    assert repr(load_policy(SHIPPED / "limits-dagger.json")) == told


def test_shipped_policies_go_by_their_name(tmp_path, monkeypatch):
    from aoro_gym.agents.policies import files

    monkeypatch.setattr(files, "SHIPPED", tmp_path)
    network().save(tmp_path / "turner")
    assert list(files.shipped_policies(TURNING)) == ["turner"]
    assert files.shipped_policies("AORO/PathTracking-v0") == {}
    env = TurningVectorEnv(1)
    observations, _ = env.reset(seed=1)
    np.testing.assert_array_equal(policy_factory(TURNING, "turner")(env)(observations), network()(observations))
    with pytest.raises(ValueError, match=r"'sleeper' is no policy for AORO/Turning-v0; choose from: .*turner"):
        policy_factory(TURNING, "sleeper")


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*.json")), ids=lambda file: file.stem)
def test_every_shipped_policy_acts_in_its_environment(file):
    policy = LearnedPolicy.load(file)
    localisation = policy.training.get("localisation")
    made_with = ({} if localisation is None else {"localisation": localisation}) | observing(
        {file.stem: policy.made_for}
    )
    env = gymnasium.make_vec(policy.environment, num_envs=2, **made_with)
    observations, _ = env.reset(seed=0)
    assert env.action_space.contains(policy.made_for(env)(observations))
    assert {"command", "seed", "revision"} <= set(policy.training)


@pytest.mark.parametrize(("squashed", "activation"), [(False, "tanh"), (True, "relu")])
def test_onnx_gives_the_same_actions(squashed, activation, tmp_path, observations):
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    policy = network(squashed=squashed, activation=activation, actions=2)
    write_onnx(policy, tmp_path / "made" / "policy.onnx")
    session = runtime.InferenceSession(tmp_path / "made" / "policy.onnx", providers=["CPUExecutionProvider"])
    assert json.loads(session.get_modelmeta().custom_metadata_map["observation"])["target"] == [2, 3]
    found = session.run(["actions"], {"observations": observations})[0]
    assert np.ptp(policy(observations)) > 0.5
    np.testing.assert_allclose(found, policy(observations), atol=1e-5)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_policies_of_stable_baselines3_are_taken_over(algorithm, tmp_path, observations):
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import VecNormalize  # pyright: ignore[reportMissingImports]

    from aoro_gym.agents.policies.networks import of_stable_baselines3
    from aoro_gym.agents.training.vec_env import make_vec_env

    env = VecNormalize(make_vec_env(TURNING, 2, seed=0))
    model = getattr(sb3, algorithm)("MlpPolicy", env, seed=1, device="cpu")
    env.reset()
    for _ in range(30):
        env.step(np.random.default_rng(0).uniform(-1.0, 1.0, (2, 1)).astype(np.float32))
    wanted, _ = model.predict(env.normalize_obs(observations), deterministic=True)
    policy = of_stable_baselines3(model.policy, env, environment=TURNING)
    np.testing.assert_allclose(policy(observations), wanted, atol=1e-6)
    model.save(tmp_path / "model.zip")
    env.save(str(tmp_path / "vecnormalize.pkl"))
    np.testing.assert_array_equal(
        load_policy(tmp_path / "model.zip", trust_pickle=True)(observations), policy(observations)
    )
    with pytest.raises(ValueError, match="a network with silu cannot be taken over; use tanh or relu"):
        from torch import nn  # pyright: ignore[reportMissingImports]

        other = getattr(sb3, algorithm)("MlpPolicy", env, device="cpu", policy_kwargs={"activation_fn": nn.SiLU})
        of_stable_baselines3(other.policy)
