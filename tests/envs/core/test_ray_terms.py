"""Terms that cast rays: closed forms on planes, their age, errors and noise, and the same by every way to make a step."""

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest

from aoro_gym import Plane
from aoro_gym.envs.core.ray_scenes import FARTHEST, scene_of
from aoro_gym.envs.core.ray_terms import HEIGHT_BOUND, HeightView, LidarView, height_map, lidar
from aoro_gym.envs.core.terms import ObservationTerm
from aoro_gym.envs.levelling.environment import LevellingVectorEnv
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingEnv, PathTrackingVectorEnv
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.sensors.lidar import Lidar, Motion
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.generate.world import world
from aoro_gym.twin.records import State
from tests.envs.path_tracking.paths import LEVEL

FLOAT = 2.0**-23
X = np.linspace(-15.0, 25.0, 81)
POSE = ("position_x", "position_y", "position_z", "roll", "pitch", "yaw")
TREES = np.array([[0.0, 4.0, 0.2, 10.0], [6.0, -4.0, 0.15, 8.0]])
COURSES = [
    Course(
        Terrain.from_heights(0.2 * np.sin(0.3 * X[:, None] + phase) * np.cos(0.2 * X), cell=0.5, corner=(-15.0, -15.0)),
        (Path(np.array([[-8.0, 0.0], [20.0, 3.0]])),),
        trees=TREES,
    )
    for phase in (0.0, 1.0)
]
DRIVE = np.array([0.4, 0.8], dtype=np.float32)
EXACT = {"position_error": 0.0, "angle_error_deg": 0.0, "latency": 0.0}


def made(count: int = 3, terms: Any = None, **settings: Any) -> Any:
    given: dict[str, Any] = {"courses": COURSES, **settings}
    terms = {"lidar": lidar(columns=12), "height_map": height_map(cell=2.0)} if terms is None else terms
    return PathTrackingVectorEnv(count, observation_terms=terms, **given)


def shown(env: Any, name: str, observation: Any) -> Any:
    return np.asarray(observation)[:, env.observation_layout[name]]


def driven(env: Any, steps: int, *, seed: int | None = 5) -> list[Any]:
    """What the terms that cast rays, which come last, show from step to step."""
    out = [env.reset(seed=seed)[0]] if seed is not None else []
    actions = np.tile(DRIVE, (env.num_envs, 1))
    out += [env.step(actions)[0] for _ in range(steps)]
    return [np.array(each)[:, env.observation_layout["actions"].stop :] for each in out]


def poses(env: Any) -> np.ndarray:
    state = env.twin.state.numpy()
    rows = [State.X, State.Y, State.Z, State.QX, State.QY, State.QZ, State.QW]
    return state[[int(row) for row in rows]].T.astype(float)


def test_heights_of_a_slope_are_its():
    """The plane rises by tan 6° towards y; the machine stands with any heading."""
    env = made(4, {"height_map": height_map(cell=1.0, **EXACT)}, courses=[Course(Plane(6.0, 90.0), LEVEL.paths)])
    observation, _ = env.reset(seed=1)
    rise = math.tan(math.radians(6.0))
    points = env.task.observation_terms["height_map"].function.points
    for pose, heights in zip(poses(env), shown(env, "height_map", observation), strict=True):
        x, y, z, w = pose[3:]
        ahead = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        expected = rise * (pose[1] + points @ [np.sin(ahead), np.cos(ahead)]) - pose[2]
        np.testing.assert_allclose(heights, expected, atol=100 * FLOAT * FARTHEST * rise)


@pytest.mark.parametrize("latency", [0.0, 0.04])
def test_ranges_are_those_of_a_lidar_that_drives_there(latency):
    """Ground and trees; the sensor's own sweep over the recorded poses is the oracle, motion distortion included."""
    env = made(2, {"lidar": lidar("os1-64", columns=24, noise=False, latency=latency)})
    env.reset(seed=3)
    recorded = []
    for _ in range(20):
        observation, *_ = env.step(np.tile(DRIVE, (2, 1)))
        recorded.append([[env.output(name)[i] for name in POSE] for i in range(2)])
    view: LidarView = env.task.observation_terms["lidar"].function
    track = np.array(recorded[-4:])  # (4, twins, 6)
    assert np.linalg.norm(track[-1, :, :2] - track[-3, :, :2], axis=-1).min() > 0.05
    start = -latency - float(view.model.firings().time[-1])
    for i, ground in enumerate(env.task._course):
        motion = Motion(np.array([-0.15, -0.1, -0.05, 0.0]), track[:, i, :3], *track[:, i, 3:].T)
        scene = scene_of(COURSES[ground].surroundings, "cpu")
        [points] = Lidar(scene, view.model, subrays=1, ideal=True).sweep(motion, start=start)
        assert len(points) > 300 and (points.instance > 0).any()
        azimuth = np.arctan2(points.points[:, 1], points.points[:, 0])
        elevation = np.arcsin(points.points[:, 2] / np.linalg.norm(points.points, axis=1))
        apart = np.linalg.norm(view.directions[:, None] - np.column_stack([azimuth, elevation]), axis=-1)
        place = np.argmin(apart, axis=0)
        assert apart.min(axis=0).max() < 1e-5
        ranges = shown(env, "lidar", observation)[i]
        # the pose's angles are rounded to float32, which grazing incidence magnifies
        np.testing.assert_allclose(ranges[place], points.range, rtol=2e-4)
        assert (np.delete(ranges, place) == view.model.max_range).all()


def test_rings_come_from_the_top_and_from_the_left():
    directions = LidarView().directions.reshape(16, -1, 2)
    assert (np.diff(directions[:, :, 1], axis=0) < 0).all() and (np.ptp(directions[:, :, 1], axis=1) == 0).all()
    assert (np.diff(directions[:, :, 0], axis=1) < 0).all()


@pytest.mark.parametrize("name", ["lidar", "height_map"])
def test_latency_shows_what_was(name):
    """Two steps late is what was shown two steps before; half a step lies between poses."""
    instant = {"columns": 12, "noise": False, "model": "mid-360"} if name == "lidar" else {"cell": 1.0}
    make = {"lidar": lidar, "height_map": height_map}[name]
    now, late, half = (driven(made(2, {name: make(**instant, latency=age)}), 8) for age in (0.0, 0.1, 0.025))
    for step in range(9):
        # the pulses' ages are rounded
        np.testing.assert_allclose(late[step], now[max(step - 2, 0)], atol=1e-5)
    if name == "height_map":  # of level ranges, smooth in the pose
        between = 0.5 * (now[8] + now[7])
        assert np.abs(half[8] - between).max() < 0.2 * np.abs(now[8] - now[7]).max()


def test_errors_of_the_mounting_last_an_episode_and_scatter_as_asked():
    """On level ground heights are less the machine's: what position errors add is their z, what angles add is linear."""
    count = 400
    terms = {
        "height_map": height_map(cell=4.0, forward=(0.0, 4.0), left=(0.0, 0.0), latency=0.0, position_error=0.05),
        "tilted": ObservationTerm(
            HeightView(cell=4.0, forward=(0.0, 4.0), left=(0.0, 0.0), angle_error_deg=1.0, seed=1)
        ),
    }
    env = made(count, terms, courses=[LEVEL])
    first, second = (each[:, :2] for each in driven(env, 1))
    rest = first.mean()
    assert np.std(first[:, 0]) == pytest.approx(0.05, rel=4.0 / math.sqrt(2 * count))
    np.testing.assert_allclose(first[:, 0], first[:, 1], atol=1e-6)
    np.testing.assert_allclose(second - first, (second - first).mean(), atol=5e-3)  # the machines settle alike
    assert abs(rest) < 0.05
    again = shown(env, "height_map", env.reset()[0])
    assert np.abs(again - first).max() > 0.05
    tilted = shown(env, "tilted", env.reset(seed=9)[0])
    slope = (tilted[:, 1] - tilted[:, 0]) / 4.0
    assert np.std(slope) == pytest.approx(math.radians(1.0), rel=4.0 / math.sqrt(2 * count))


def test_noise_is_new_each_step_and_as_strong_as_asked():
    env = made(2, {"height_map": height_map(cell=0.25, noise=0.03, latency=0.0)}, courses=[LEVEL])
    first, second = driven(env, 1)
    for heights in (first, second):
        assert np.std(heights, axis=1) == pytest.approx(0.03, rel=4.0 / math.sqrt(2 * heights.shape[1]))
    together = np.corrcoef(np.concatenate([first, second]))
    assert np.abs(together - np.eye(4)).max() < 4.5 / math.sqrt(first.shape[1])


def test_both_ways_to_make_a_step_show_the_same():
    in_kernels, by_arrays = (
        driven(made(3, kernels=kernels, autoreset_mode="SameStep", max_episode_steps=5), 12)
        for kernels in (True, False)
    )
    for a, b in zip(in_kernels, by_arrays, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_an_episode_begins_without_the_last_ones_past(mode):
    """What the first observation of a second episode shows is what one shows that begins with the same seed."""
    terms = {"height_map": height_map(cell=1.0, latency=0.2), "lidar": lidar(columns=6, latency=0.1)}
    env = made(1, terms, autoreset_mode=mode, max_episode_steps=6)
    seen = driven(env, 6 + (mode == "NextStep"))[-1]
    fresh = made(1, terms, max_episode_steps=6)
    fresh.reset(seed=5)
    np.testing.assert_array_equal(fresh.reset()[0][:, env.observation_layout["height_map"].start :], seen)


def test_one_environment_shows_what_it_shows_among_others():
    several = driven(made(3), 4)
    one = PathTrackingEnv(
        courses=COURSES, observation_terms={"lidar": lidar(columns=12), "height_map": height_map(cell=2.0)}
    )
    alone = [one.reset(seed=7)[0], *(one.step(DRIVE)[0] for _ in range(4))]
    for a, b in zip(alone, several, strict=True):
        np.testing.assert_array_equal(a[one.observation_layout["lidar"].start :], b[2])


def test_a_ground_is_seen_once_a_machine_stands_on_it():
    """A scene is made where a machine first stands: what is seen there does not depend on where it stood before."""
    second, both = made(1), made(1)
    expected = second.reset(seed=5, options={"terrain": 1})[0]
    both.reset(seed=4, options={"terrain": 0})
    assert both.task._rays._met == {0}
    np.testing.assert_array_equal(both.reset(seed=5, options={"terrain": 1})[0], expected)
    assert not np.array_equal(both.reset(seed=5, options={"terrain": 0})[0], expected)


@pytest.mark.parametrize("way", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_go_on_alike(way):
    env = made(2)
    driven(env, 4)
    other = way(env)
    for a, b in zip(driven(env, 4, seed=None), driven(other, 4, seed=None), strict=True):
        np.testing.assert_array_equal(a, b)


def test_tensors_show_the_same():
    torch = pytest.importorskip("torch")
    here = driven(made(2), 3)
    env = made(2, output="torch")
    there = [env.reset(seed=5)[0], *(env.step(torch.tensor(np.tile(DRIVE, (2, 1))))[0] for _ in range(3))]
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a, b.numpy()[:, env.observation_layout["lidar"].start :])


def test_turning_knows_them_too():
    env = TurningVectorEnv(2, observation_terms={"height_map": True}, terrain=[course.terrain for course in COURSES])
    observation, _ = env.reset(seed=0)
    heights = shown(env, "height_map", observation)
    assert np.isfinite(heights).all() and np.ptp(heights) > 0.1
    env.step(np.zeros((2, 1), dtype=np.float32))


def test_levelling_knows_them_too():
    """With what is late, by either way to make a step."""
    terms = {"height_map": height_map(cell=1.0, latency=0.04), "lidar": True}
    envs = [LevellingVectorEnv(2, courses=COURSES, observation_terms=terms, kernels=way) for way in (True, False)]
    for env in envs:
        env.reset(seed=0)
    actions = np.full((2, 4), 0.5, dtype=np.float32)
    for _ in range(3):
        one, other = (env.step(actions)[0] for env in envs)
        assert np.isfinite(one).all() and np.ptp(shown(envs[0], "height_map", one)) > 0.1
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-6 * np.abs(other).max())  # roundings of float32


def test_the_objects_of_a_world_are_seen():
    made_world = world(2, size=(40.0, 40.0))
    course = Course(made_world.terrain, (Path(np.array([[-8.0, 0.0], [8.0, 0.0]])),), world=made_world)
    bare = Course(made_world.terrain, course.paths)
    env, other = (made(1, {"lidar": lidar(columns=30, noise=False)}, courses=[each]) for each in (course, bare))
    observation, infos = env.reset(seed=0)
    with_objects = shown(env, "lidar", observation)
    start = 0.5 * np.round(2.0 * (16.0 - infos["remaining"]))  # in the world it starts where it stands free
    without = shown(other, "lidar", other.reset(seed=0, options={"start": start})[0])
    nearer = with_objects < without - 0.1
    darker = with_objects == 30.0  # the world's ground reflects less in places
    assert nearer.mean() > 0.1 and (darker | (with_objects <= without + 1e-4)).all()
    with pytest.raises(ValueError, match="its world stands on another terrain"):
        Course(COURSES[0].terrain, course.paths, world=made_world)


def test_no_ground_is_a_hole_and_no_echo_the_greatest_range():
    env = made(1, {"height_map": height_map(cell=2.0, forward=(-40.0, 40.0)), "lidar": lidar(columns=12)})
    observation, _ = env.reset(seed=0)
    assert shown(env, "height_map", observation).min() == -HEIGHT_BOUND
    assert shown(env, "lidar", observation).max() == 30.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: lidar(latency=-0.1), "latency is -0.1 s, but must be finite and at least 0 s"),
        (lambda: lidar("os2"), "lidar model is 'os2'"),
        (lambda: lidar(max_range=500.0), "max_range is 500 m, but must be .*100"),
        (lambda: lidar(columns=0), "columns is 0, but must be"),
        (lambda: lidar(columns=100_000), "number of the lidar's pulses is .*take fewer columns"),
        (lambda: lidar(subrays=0), "subrays is 0"),
        (lambda: height_map(cell=0.0), "cell is 0 m, but must be finite and above 0 m"),
        (lambda: height_map(cell=0.001), "number of points of the height map is .*take larger cells"),
        (lambda: height_map(noise=-1.0), "noise is -1 m"),
        (
            lambda: made(1, {"lidar": lidar(latency=30.0)}),
            "control steps that a term looks back is .*shorten its latency",
        ),
        (lambda: made(1, {"sonar": True}), "observation_terms has no 'sonar' to ask for by True; choose one of: lidar"),
        (lambda: made(1, {"late": lambda view: HeightView(latency=0.0)(view)}), "keeps no poses"),
    ],
)
def test_what_cannot_be_is_said(make, message):
    with pytest.raises(ValueError, match=message):
        make()
