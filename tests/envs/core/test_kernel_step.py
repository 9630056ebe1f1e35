"""A step in kernels is the step by array operations, up to rounding, in a few launches."""

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import register_envs
from aoro_gym.envs.core.kernel_step import KernelStep
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
from aoro_gym.envs.levelling import config as levelling
from aoro_gym.envs.levelling.courses import obstacle_course
from aoro_gym.envs.levelling.driving import PathDriver
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.envs.levelling.observations import EXACT_TERMS as LEVELLING_EXACT
from aoro_gym.envs.levelling.rewards import FURTHER_REWARD_TERMS as LEVELLING_REWARDS
from aoro_gym.envs.levelling.task import Levelling
from aoro_gym.envs.path_tracking.config import MILD, PathTrackingConfig
from aoro_gym.envs.path_tracking.courses import as_courses
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.observations import EXACT_TERMS
from aoro_gym.envs.path_tracking.rewards import FURTHER_REWARD_TERMS
from aoro_gym.envs.path_tracking.task import PathTracking
from aoro_gym.envs.turning import config as turning
from aoro_gym.envs.turning.observations import EXACT_TERMS as TURNING_EXACT
from aoro_gym.envs.turning.rewards import FURTHER_REWARD_TERMS as TURNING_REWARDS
from aoro_gym.sensors import FixLoss, GpsNoise, ImuNoise, JointAngleNoise, PressureNoise, WheelSpeedNoise
from aoro_gym.twin.records import State
from tests.envs.path_tracking.paths import LEVEL

register_envs()
PATH_TRACKING, TURNING, LEVELLING = "AORO/PathTracking-v0", "AORO/Turning-v0", "AORO/Levelling-v0"

ROUNDING = 2.0**-23
"""Unit in the last place of a float32: what of a step is float64 differs by far less before it is rounded."""
TERMS = 8.0
"""Of a reward: its sum errs by as many roundings at most."""
FLOAT64 = 1e4 * 2.0**-53
"""What is logged as float64, relative to its size: some 1e4 roundings, as positions of 100 m are what errors of
millimetres are taken from."""


def stays(view):
    """A term of the user's own, of two columns."""
    return view.xp.stack([view.speed, view.tipping_margin], axis=-1)


def leans(view):
    """Likewise of the reward."""
    return view.xp.abs(view.measured_roll)


def goes(view):
    """A reward term of levelling of one's own, by all that its view calculates and path tracking's."""
    return view.arm_travel + view.lifted + view.sunk + view.tilt_rate + view.driving.measured_cross_track


def bears(view):
    """An observation term of levelling of one's own, of four columns."""
    return view.loads + view.measured_supports / 1e4


def late(view):
    """A term of turning that shows which goals its view has."""
    return view.target_age + view.target + view.error + view.overshoot


SHORT_GOALS = turning.TurningConfig(hold=(0.06, 0.12), dwell=0.04, tolerance=0.3)
"""Several targets in an episode of a few steps, some of which settle."""

TURNING_CASES: dict[str, dict[str, Any]] = {
    "turning": {"config": SHORT_GOALS},
    "turning, all that is measured": {"randomisation": turning.MILD, "observe_pressures": True},
    "turning, other terms": {
        "config": SHORT_GOALS,
        "reward_terms": {**{name: (0.5, term) for name, term in TURNING_REWARDS.items()}, "precision": None},
        "observation_terms": {**TURNING_EXACT, "joint_rate": None},
    },
    "turning, own terms": {
        "config": SHORT_GOALS,
        "reward_terms": {"late": (-1.0, late)},
        "observation_terms": {"late": ObservationTerm(late, -0.5, 0.5), "target": None},
    },
}
OBSTACLES = (obstacle_course(1, 0.8), obstacle_course(2, 0.5))

LEVELLING_CASES: dict[str, dict[str, Any]] = {
    "levelling": {},
    "levelling, other frames and memories": {
        "randomisation": levelling.MILD,
        "config": levelling.LevellingConfig(
            sample_step=0.025,
            signal_memory=3,
            ground_ahead=(-1.0, 0.5, 2.0),
            arm_angle_noise=JointAngleNoise.published(),
            driver=PathDriver(drive_signal=0.9, look_ahead=3.0, rest_error=0.0),
        ),
    },
    "levelling, exact sensors over a plane": {
        "courses": (LEVEL,),
        "config": levelling.LevellingConfig(
            control_step=0.04,
            ground_noise=0.0,
            ground_offset=0.0,
            arm_angle_noise=JointAngleNoise(),
            pressure_noise=PressureNoise(),
            imu_noise=ImuNoise(),
            joint_angle_noise=JointAngleNoise(),
            wheel_speed_noise=WheelSpeedNoise(),
            gps_noise=GpsNoise(),
            driver=PathDriver(gain=0.0),
            tilt_limit=1e-3,
        ),
    },
    "levelling, other terms": {
        "reward_terms": {**{name: (0.5, term) for name, term in LEVELLING_REWARDS.items()}, "even": None},
        "observation_terms": {**LEVELLING_EXACT, "ground": None},
    },
    "levelling, own terms": {
        "reward_terms": {"leans": (-1.0, leans), "way": (-1.0, goes)},
        "observation_terms": {"loads": ObservationTerm(bears, -5e4, 5e4), "supply": None},
    },
}
"""Of which only the last needs a view."""
CASES: dict[str, dict[str, Any]] = {
    "default": {},
    "all that is measured": {
        "randomisation": MILD,
        "gear": "automatic",
        "arms": "level",
        "observe_inertial": True,
        "scan_x": (2.0, 4.0),
        "config": PathTrackingConfig(gps_noise=GpsNoise.typical(FixLoss(0.1, 0.5, 0.2))),
    },
    "filtered pose": {
        "randomisation": MILD,
        "localisation": "filter",
        "config": PathTrackingConfig(gps_latency=0.2, gps_noise=GpsNoise.typical(FixLoss(0.1, 0.5, 0.2))),
    },
    "all that acts": {"act_arms": True, "act_traction": True, "act_gear": True},
    "exact sensors over a plane": {
        "courses": (LEVEL,),
        "arms": "hold",
        "config": PathTrackingConfig(
            traction=None,
            sample_step=0.05,
            gps_noise=GpsNoise(),
            imu_noise=ImuNoise(),
            joint_angle_noise=JointAngleNoise(),
            pressure_noise=PressureNoise(),
            wheel_speed_noise=WheelSpeedNoise(),
        ),
    },
    "other terms": {
        "reward_terms": {**{name: (0.5, term) for name, term in FURTHER_REWARD_TERMS.items()}, "time": None},
        "observation_terms": {**EXACT_TERMS, "preview": None},
    },
    "own terms": {
        "reward_terms": {"leans": (-1.0, leans), "time": -0.2},
        "observation_terms": {"stays": ObservationTerm(stays, -0.5, 0.5), "roll": None},
    },
}


def pair(count: int = 3, name: str = PATH_TRACKING, **arguments: Any) -> tuple[Any, Any]:
    """The same environment by array operations, and in kernels."""
    if name == LEVELLING:
        arguments = {"courses": OBSTACLES, **arguments}
    plain, kernels = (
        gymnasium.make_vec(name, num_envs=count, kernels=each, **arguments).unwrapped for each in (False, True)
    )
    return plain, kernels


def agree(name: str, plain: Any, kernels: Any) -> None:
    plain, kernels = np.asarray(plain), np.asarray(kernels)
    assert plain.dtype == kernels.dtype and plain.shape == kernels.shape, name
    if plain.dtype.kind == "f":
        relative = TERMS * ROUNDING if plain.dtype == np.float32 else FLOAT64
        scale = max(1.0, float(np.abs(plain).max(initial=0.0)))
        np.testing.assert_allclose(kernels, plain, rtol=0.0, atol=relative * scale, err_msg=name)
    elif plain.dtype == object:
        for one, other in zip(plain, kernels, strict=True):
            if one is None or isinstance(one, str):
                assert one == other, name
            else:
                agree(name, one, other)
    else:
        np.testing.assert_array_equal(kernels, plain, err_msg=name)


def infos_agree(plain: dict[str, Any], kernels: dict[str, Any]) -> None:
    assert list(plain) == list(kernels)
    for name, value in plain.items():
        infos_agree(value, kernels[name]) if name == "final_info" else agree(name, value, kernels[name])


def steps_agree(plain: Any, kernels: Any, count: int, seed: int = 3, reasons: set[Any] | None = None) -> int:
    """Number of episodes that end; why they terminate goes into ``reasons``."""
    rng, ended = np.random.default_rng(seed), 0
    for _ in range(count):
        actions = rng.uniform(-1.1, 1.1, plain.action_space.shape).astype(np.float32)
        one, other = plain.step(actions), kernels.step(actions)
        for name, array, told in zip(("observations", "rewards", "terminated", "truncated"), one, other, strict=False):
            agree(name, array, told)
        infos_agree(one[4], other[4])
        ended += int((one[2] | one[3]).sum())
        if reasons is not None:
            reasons.update(other[4].get("final_info", other[4]).get("termination", ()))
    assert isinstance(kernels._kernel_step, KernelStep) and plain._kernel_step is None
    return ended


@pytest.mark.parametrize(
    ("case", "output"),
    [
        *((case, "numpy") for case in (*CASES, *TURNING_CASES, *LEVELLING_CASES)),
        ("default", "torch"),
        ("filtered pose", "torch"),
        ("own terms", "torch"),
        ("turning, own terms", "torch"),
        ("levelling", "torch"),
        ("levelling, own terms", "torch"),
    ],
)
def test_kernels_do_what_array_operations_do(case, output):
    """Over three episodes each, with their resets."""
    if output == "torch":
        pytest.importorskip("array_api_compat")
    name = TURNING if case in TURNING_CASES else LEVELLING if case in LEVELLING_CASES else PATH_TRACKING
    options = (CASES | TURNING_CASES | LEVELLING_CASES)[case]
    plain, kernels = pair(name=name, max_episode_steps=16, output=output, **options)
    one, other = plain.reset(seed=7), kernels.reset(seed=7)
    agree("observations", one[0], other[0])
    infos_agree(one[1], other[1])
    assert steps_agree(plain, kernels, 40) == 6
    if "config" in TURNING_CASES.get(case, {}):  # goals were reached, and missed
        told = plain.task.info()
        assert plain.task._cursor.min() > 0 and told["targets_settled"].any() and told["targets_missed"].any()


@pytest.mark.parametrize("name", [PATH_TRACKING, TURNING, LEVELLING])
def test_same_step_autoreset_agrees(name):
    plain, kernels = pair(name=name, max_episode_steps=5, autoreset_mode="SameStep")
    for env in (plain, kernels):
        env.reset(seed=1)
    assert steps_agree(plain, kernels, 12) == 6


@pytest.mark.parametrize("name", [PATH_TRACKING, LEVELLING])
def test_a_part_that_is_reset_leaves_the_others(name):
    plain, kernels = pair(name=name, autoreset_mode="Disabled")
    for env in (plain, kernels):
        env.reset(seed=1)
    steps_agree(plain, kernels, 3)
    before = kernels._observation.copy()
    mask = np.array([False, True, False])
    one, other = (env.reset(options={"reset_mask": mask}) for env in (plain, kernels))
    agree("observations", one[0], other[0])
    np.testing.assert_array_equal(other[0][~mask], before[~mask])
    assert (other[0][mask] != before[mask]).any()
    steps_agree(plain, kernels, 3)


def test_a_path_that_is_brought_along_is_followed():
    """The table of paths is replaced, and with it what the kernels share."""
    plain, kernels = pair(courses=(LEVEL,), autoreset_mode="Disabled")
    for env in (plain, kernels):
        env.reset(seed=1)
    steps_agree(plain, kernels, 2)
    path = as_courses((LEVEL,), None, None)[0].paths[0]
    other = type(path)(path.points[::-1].copy(), path.closed)
    for env in (plain, kernels):
        env.reset(options={"path": other})
    steps_agree(plain, kernels, 5)


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        ({"stuck_time": 0.2, "stuck_distance": 3.0}, "stuck"),
        ({"path_limit": 0.1}, "lost the path"),
        ({"rollover": 0.001}, "rolled over"),
    ],
)
def test_episodes_end_for_the_same_reason(limits, reason):
    """Over two episodes each, that start elsewhere."""
    config = PathTrackingConfig(randomisation=MILD, **limits)
    plain, kernels = pair(config=config, autoreset_mode="SameStep")
    for env in (plain, kernels):
        env.reset(seed=4)
    reasons: set[Any] = set()
    assert steps_agree(plain, kernels, 9, reasons=reasons) > 3
    assert reasons - {None} == {reason}


@pytest.mark.parametrize("name", [PATH_TRACKING, TURNING, LEVELLING])
def test_a_lost_twin_is_told_alike(name):
    arguments: dict[str, Any] = {"courses": (LEVEL,)} if name == PATH_TRACKING else {}
    plain, kernels = pair(name=name, **arguments)
    for env in (plain, kernels):
        env.reset(seed=0)
    steps_agree(plain, kernels, 2)
    before = kernels._observation.copy()
    for env in (plain, kernels):
        env.twin.state.numpy()[State.JOINT_RATE, 1] = np.nan
    assert steps_agree(plain, kernels, 1) == 1
    np.testing.assert_array_equal(kernels._observation[1], before[1])
    steps_agree(plain, kernels, 3)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_a_copy_goes_on_by_itself(copied):
    _, env = pair(2)
    env.reset(seed=0)
    actions = np.full((2, 2), 0.5, dtype=np.float32)
    env.step(actions)
    other = copied(env)
    first = [env.step(actions)[0] for _ in range(3)]
    second = [other.step(actions)[0] for _ in range(3)]
    np.testing.assert_array_equal(first, second)


class Derived(PathTracking):
    """A task that does something else."""


class DerivedLevelling(Levelling):
    """Likewise."""


class DerivedDriver(PathDriver):
    """A law of one's own."""

    def signals(self, view, first, front, rear, limit):
        return 0.0 * super().signals(view, first, front, rear, limit)


def test_a_derived_task_is_asked_itself():
    env = PathTrackingVectorEnv(1, courses=(LEVEL,))
    env.task = Derived((LEVEL,), env.task.config)
    env._allocate()
    env.reset(seed=0)
    env.step(np.zeros((1, 2), dtype=np.float32))
    assert env._kernel_step is None


@pytest.mark.parametrize(
    ("task", "driver"), [(DerivedLevelling, PathDriver()), (Levelling, DerivedDriver())], ids=["task", "driver"]
)
def test_a_derived_task_of_levelling_and_a_derived_driver_are_asked_themselves(task, driver):
    env = LevellingVectorEnv(1, courses=(LEVEL,))
    env.task = task((LEVEL,), levelling.LevellingConfig(driver=driver))
    env._allocate()
    env.reset(seed=0)
    env.step(np.zeros((1, 4), dtype=np.float32))
    assert env._kernel_step is None


def test_what_is_handed_out_stays():
    """The kernels write in place."""
    _, env = pair(2)
    first, _ = env.reset(seed=0)
    parts = [first, *env.step(np.ones((2, 2), dtype=np.float32))[:4]]
    infos = env.step(np.ones((2, 2), dtype=np.float32))[4]
    kept, told = copy.deepcopy(parts), copy.deepcopy(infos)
    for _ in range(2):
        env.step(-np.ones((2, 2), dtype=np.float32))
    for now, then in zip(parts, kept, strict=True):
        np.testing.assert_array_equal(now, then)
    infos_agree(told, infos)


def test_what_is_set_later_counts():
    plain, kernels = pair(2)
    for env in (plain, kernels):
        env.reset(seed=0)
    steps_agree(plain, kernels, 1)
    for env in (plain, kernels):
        env.max_episode_steps = 3
        env.task.reward_terms = {
            **env.task.reward_terms,
            "time": RewardTerm(-5.0, env.task.reward_terms["time"].function),
        }
    assert steps_agree(plain, kernels, 2) == 2
    assert kernels.step(np.zeros((2, 2), dtype=np.float32))[4]["reward/time"].tolist() == [0.0, 0.0]  # they reset
    assert kernels.step(np.zeros((2, 2), dtype=np.float32))[4]["reward/time"].tolist() == [-5.0, -5.0]


def test_wrong_terms_are_named():
    for kind in ("reward_terms", "observation_terms"):
        arguments: dict[str, Any] = {kind: {"mine": lambda view: view.cross_track * np.nan}}
        _, env = pair(2, **arguments)
        with pytest.raises(ValueError, match=rf"{kind}\['mine'\] is nan in sub-environment 0"):
            env.reset(seed=0)
            env.step(np.zeros((2, 2), dtype=np.float32))
