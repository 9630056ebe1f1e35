"""Copies and pickles of environments, twins and grounds go on as the original does, to the bit, and apart from it."""

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym import Machine, Plane, Twin
from aoro_gym.envs.core.terms import RewardTerm
from aoro_gym.envs.path_tracking.config import MILD as MILD_PATHS
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.turning.config import MILD
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.terrains import Path, Terrain

X = np.linspace(-15.0, 25.0, 81)
HILLS = [
    Terrain.from_heights(0.2 * np.sin(0.3 * X[:, None] + phase) * np.cos(0.2 * X), cell=0.5, corner=(-15.0, -15.0))
    for phase in (0.0, 1.0)
]
COURSES = [Course(hill, (Path(np.array([[-10.0, 0.0], [20.0, 3.0]])),)) for hill in HILLS]
WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda thing: pickle.loads(pickle.dumps(thing))}
pytestmark = pytest.mark.parametrize("way", WAYS)


def effort(view: Any) -> Any:
    return view.output("pump_pressure") / 1e7


def turning() -> Any:
    return TurningVectorEnv(
        3,
        randomisation=MILD,
        observe_pressures=True,
        max_episode_steps=8,
        reward_terms={"effort": RewardTerm(-0.1, effort)},
    )


def tracking() -> Any:
    return PathTrackingVectorEnv(
        3,
        courses=COURSES,
        randomisation=MILD_PATHS,
        gear="automatic",
        scan_x=(1.0,),
        observe_inertial=True,
        autoreset_mode="SameStep",
        max_episode_steps=8,
    )


def steps(env: Any, count: int, seed: int = 0) -> list[Any]:
    """Observations, rewards, ends and infos of random actions."""
    rng = np.random.default_rng(seed)
    seen = []
    for _ in range(count):
        actions = rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(actions)
        seen += [
            observation,
            reward,
            terminated,
            truncated,
            *(info[name] for name in sorted(info) if name[:5] != "final"),
        ]
        if env.render_mode is not None:
            seen.append(np.asarray(env.render()))
        if terminated is True or truncated is True:
            seen.append(env.reset()[0])
    return [np.array(values) for values in seen]


def agree(one: list[Any], other: list[Any]) -> None:
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("make", [turning, tracking])
def test_a_copy_of_a_vector_environment_goes_on_to_the_bit(make, way):
    """In the middle of episodes that end soon: resets draw the same machines, courses and noise, too."""
    env = make()
    env.reset(seed=5)
    steps(env, 5)
    other = WAYS[way](env)
    third = WAYS[way](env)
    expected = steps(env, 20, seed=1)
    agree(steps(other, 20, seed=1), expected)  # the original has gone on: they share nothing
    np.testing.assert_array_equal(other.twin.state.numpy(), env.twin.state.numpy())
    agree(steps(WAYS[way](third), 20, seed=1), expected)  # a copy of a copy
    again, first = other.reset(seed=7)[0], env.reset(seed=7)[0]
    np.testing.assert_array_equal(again, first)


@pytest.mark.parametrize("name", ["AORO/Turning-v0", "AORO/PathTracking-v0"])
def test_a_copy_of_a_single_environment_goes_on_to_the_bit(name, way):
    arguments: Any = {"courses": COURSES} if "Path" in name else {"max_episode_steps": 12}
    env: Any = gymnasium.make(name, **arguments)
    env.reset(seed=3)
    steps(env, 4)
    other = WAYS[way](env)
    agree(steps(other, 16, seed=1), steps(env, 16, seed=1))
    assert other.spec.id == env.spec.id and other.spec.kwargs.keys() == env.spec.kwargs.keys()
    np.testing.assert_array_equal(other.reset()[0], env.reset()[0])
    np.testing.assert_array_equal(steps(other, 3)[-1], steps(env, 3)[-1])


def test_a_fresh_environment_is_copied_before_its_first_reset(way):
    env = turning()
    other = WAYS[way](env)
    np.testing.assert_array_equal(other.reset(seed=1)[0], env.reset(seed=1)[0])
    agree(steps(other, 12), steps(env, 12))


def test_pictures_of_a_copy_are_those_of_the_original(way):
    env: Any = gymnasium.make("AORO/Turning-v0", render_mode="rgb_array")
    env.reset(seed=0)
    steps(env, 3)
    other = WAYS[way](env)
    agree(steps(other, 3, seed=1), steps(env, 3, seed=1))


def test_tensors_of_a_copy_are_its_own(way):
    torch = pytest.importorskip("torch")
    env = PathTrackingVectorEnv(2, courses=COURSES, output="torch", max_episode_steps=6)
    env.reset(seed=0)
    for _ in range(3):
        env.step(torch.full((2, 2), 0.5))
    other = WAYS[way](env)
    for _ in range(8):
        one, two = (each.step(torch.full((2, 2), -0.4)) for each in (env, other))
        for a, b in zip(one[:4], two[:4], strict=True):
            assert torch.equal(a, b) and a.data_ptr() != b.data_ptr()
    assert other.output("speed").data_ptr() != env.output("speed").data_ptr()


def test_terms_that_cannot_be_pickled_are_named(way):
    env: Any = gymnasium.make("AORO/Turning-v0", reward_terms={"mine": (1.0, lambda view: 0.0 * view.error)})
    env.reset(seed=0)
    if way == "deepcopy":
        agree(steps(copy.deepcopy(env), 4), steps(env, 4))
    else:
        with pytest.raises(TypeError, match=r"lambda.*define their functions in a module, or make another.*same seed"):
            pickle.dumps(env)


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"terrain": Plane(slope_deg=[1.0, 4.0, -3.0], friction=0.8), "gravity": 9.0, "main_step": 5e-4, "substeps": 15},
        {"terrain": HILLS},
        {"terrain": HILLS, "ground": "mesh", "cell": 0.5},
    ],
    ids=["level", "planes", "rasters", "meshes"],
)
def test_a_copy_of_a_twin_goes_on_to_the_bit(arguments, way):
    twin = Twin(3, own_machines=True, **arguments)
    twin.set_machines([1], Machine.load("aoro").scale({"tire.stiffness": 0.9}))
    twin.reset(position=[[0.0, 0.0], [2.0, 1.0], [5.0, 2.0]], terrain=[0, 1, 1] if twin._grounds.count else None)
    twin.set_ground([2], friction=0.5)
    twin.step({"drive_signal": 0.4, "steering_signal": [0.3, -0.5, 1.0]}, 0.3, sample_every=0.1)
    other = WAYS[way](twin)
    np.testing.assert_array_equal(other.outputs.numpy(), twin.outputs.numpy())
    np.testing.assert_array_equal(other.time, twin.time)
    one, two = (each.step({}, 0.3, sample_every=0.01) for each in (twin, other))
    assert one is not None and two is not None
    np.testing.assert_array_equal(one.samples, two.samples)
    other.step({"steering_signal": 1.0}, 0.1)
    np.testing.assert_array_equal(twin.commands.numpy()[0], np.array([0.3, -0.5, 1.0], dtype=np.float32))
    for each in (twin, other):
        each.reset()
    np.testing.assert_array_equal(twin.state.numpy(), other.state.numpy())


def test_grounds_and_paths_stay_read_only(way):
    for thing in (
        HILLS[0],
        COURSES[0].paths[0],
        Path(np.eye(2), speed=np.ones(2), name="föhre"),
        Plane(slope_deg=[1, 2]),
    ):
        other = WAYS[way](thing)
        assert type(other) is type(thing)
        for name, value in vars(thing).items():
            np.testing.assert_array_equal(getattr(other, name), value)
            if isinstance(value, np.ndarray) and name in type(thing).__dataclass_fields__:
                assert not getattr(other, name).flags.writeable
