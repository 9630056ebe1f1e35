"""Environments in worlds whose objects are solid."""

import copy
import pickle
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.agents.evaluation import inputs
from aoro_gym.agents.training.courses import held_out_courses
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.envs import Course, PathTrackingVectorEnv, TurningVectorEnv
from aoro_gym.envs.core.contacts import chassis_contact
from aoro_gym.envs.core.ray_terms import height_map, lidar
from aoro_gym.envs.core.rendering import surroundings
from aoro_gym.envs.path_tracking.config import MILD
from aoro_gym.envs.path_tracking.course_files import CourseFiles
from aoro_gym.envs.path_tracking.courses import generated_paths
from aoro_gym.execution.digest import digest
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.paths.planning import WIDTH
from aoro_gym.terrains.world.files import save_world
from aoro_gym.terrains.world.objects import Branch, Log, Tree, along, upright
from aoro_gym.terrains.world.places import HALF_LENGTH, HALF_WIDTH, ROOM, circles, open_place, stands_free
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.objects import DEEP

FIELD = Terrain.from_heights(np.zeros((61, 61)), cell=1.0, corner=(-30.0, -30.0))
STEM = 0.25
"""Diameter at breast height [m]."""
PINE = Tree((8.0, 0.0, 0.0), upright(), "pine", STEM, 16.0, 9.0, 1.5, 1)
LOG = Log((14.0, -2.0, 0.15), along((0.0, 1.0, 0.0)), "pine", 4.0, 0.15, 0.15, 0.3, 0)
TO_THE_PINE = World(FIELD, (PINE,))
STRAIGHT = Path(np.array([[-10.0, 0.0], [20.0, 0.0]]))
START = {"start": 12.0, "lateral_offset": 0.0, "heading_offset": 0.0, "joint_angle": 0.0}
"""The front axle 6 m before the pine."""
AHEAD = np.array([[0.0, 1.0]], dtype=np.float32)


def made(ground: Any = TO_THE_PINE, count: int = 1, **arguments: Any) -> PathTrackingVectorEnv:
    given = {"terrain": ground, "path": STRAIGHT, "autoreset_mode": "Disabled"} | arguments
    return PathTrackingVectorEnv(count, **given)


def driven(env: Any, steps: int = 160, seed: int = 0) -> list[Any]:
    """Results of steps straight ahead."""
    env.reset(seed=seed, options=START)
    actions = np.repeat(AHEAD, env.num_envs, axis=0)
    return [env.step(actions) for _ in range(steps)]


def logged(results: list[Any], name: str) -> np.ndarray:
    return np.array([np.asarray(infos[name]) for *_, infos in results])


def front(env: Any) -> float:
    """Place of the foremost part of the machine ahead of its hinge [m], where the stem's surface stops it."""
    return PINE.position[0] - 0.5 * float(PINE.diameter_at(1.0)) - float(env.output("position_x")[0])


@pytest.mark.parametrize("kernels", [True, False], ids=["kernels", "arrays"])
def test_a_stem_stops_the_machine(kernels):
    env, bare = made(kernels=kernels), made(FIELD, kernels=kernels)
    results, free = driven(env), driven(bare)
    touched, force = logged(results, "chassis_contact")[:, 0], logged(results, "chassis_force")[:, 0]
    assert not touched[:20].any() and touched[-20:].all()
    np.testing.assert_array_equal(touched, force > 0.0)
    assert force[-1] == pytest.approx(
        np.linalg.norm([env.output(f"object_force_{axis}_front")[0] for axis in "xyz"]), rel=0.5
    )
    # the chassis ends 2.60 m ahead of the hinge
    assert np.abs(env.output("speed")[0]) < 0.1 and 1.5 < front(env) < 2.6006 < HALF_LENGTH + ROOM
    assert front(bare) < 0.0 and "chassis_contact" not in free[-1][-1]  # on bare ground it is where the stem would be
    with pytest.raises(ValueError, match="only twins in a world with solid objects"):
        bare.output("object_force_x_front")
    # until it touches, it drives as on bare ground, to the bit
    first = int(np.argmax(touched))
    assert 20 < first < 140
    for one, other in zip(results[:first], free[:first], strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])


def test_kernels_and_tensors_tell_the_same_contacts():
    torch = pytest.importorskip("torch")
    arguments: dict[str, Any] = {"reward_terms": {"chassis_contact": -5.0}, "count": 2}
    arrays, kernels = (driven(made(kernels=each, **arguments)) for each in (False, True))
    env = made(output="torch", **arguments)
    env.reset(seed=0, options=START)
    tensors = [env.step(torch.tensor(np.repeat(AHEAD, 2, axis=0))) for _ in range(160)]
    for name in ("chassis_contact", "reward/chassis_contact"):
        np.testing.assert_array_equal(logged(kernels, name), logged(arrays, name))
        np.testing.assert_array_equal(logged(kernels, name), logged(tensors, name))
    # three products, two sums and a root, rounded
    rounding = 4 * float(np.finfo(np.float32).eps)
    np.testing.assert_allclose(logged(kernels, "chassis_force"), logged(tensors, "chassis_force"), rtol=rounding)
    touched = logged(kernels, "chassis_contact")
    np.testing.assert_array_equal(logged(kernels, "reward/chassis_contact"), -5.0 * touched)
    with_term, without = logged(kernels, "reward/chassis_contact"), driven(made(count=2))
    rewards = np.array([result[1] for result in kernels]) - np.array([result[1] for result in without])
    # a float32 sum of nine terms, the largest of them 5
    np.testing.assert_allclose(rewards, with_term, rtol=0.0, atol=9 * 5.0 * float(np.finfo(np.float32).eps))


def test_the_reward_term_is_asked_for_by_its_weight_and_costs_nothing_on_bare_ground():
    for env in (
        made(FIELD, reward_terms={"chassis_contact": -5.0}),
        TurningVectorEnv(1, reward_terms={"chassis_contact": -5.0}),
    ):
        env.reset(seed=0)
        assert env.task.reward_terms["chassis_contact"].function is chassis_contact
        assert not env._in_kernels().own_rewards  # pyright: ignore[reportOptionalMemberAccess]
        assert env.step(np.zeros_like(env.action_space.sample()))[-1]["reward/chassis_contact"][0] == 0.0
    with pytest.raises(ValueError, match=r"no 'chasis_contact' to weigh.*chassis_contact"):
        made(reward_terms={"chasis_contact": -5.0})


@pytest.mark.parametrize("kernels", [True, False], ids=["kernels", "arrays"])
def test_a_force_on_the_chassis_ends_the_episode(kernels):
    env = made(kernels=kernels, chassis_force_limit=2e4)
    results = driven(env, 60)
    while not (results[-1][2] | results[-1][3]).any():
        results.append(env.step(AHEAD))
    force = logged(results, "chassis_force")[:, 0]
    assert force[-1] > 2e4 >= force[:-1].max()
    assert results[-1][-1]["termination"][0] == "hit an object"
    assert results[-1][-1]["reward/failure"][0] == -50.0 and not results[-1][-1]["is_success"][0]
    with pytest.raises(ValueError, match="chassis_force_limit is -1 N, but must be at least 0 N"):
        made(chassis_force_limit=-1.0)


@pytest.mark.parametrize("autoreset", ["NextStep", "SameStep"])
def test_a_new_episode_has_no_contact(autoreset):
    env = made(chassis_force_limit=0.0, autoreset_mode=autoreset)
    results = driven(env, 60)
    while not (results[-1][2]).any():
        results.append(env.step(AHEAD))
    infos = results[-1][-1]
    if autoreset == "SameStep":
        assert infos["final_info"]["chassis_force"][0] > 0.0
    else:
        assert infos["chassis_force"][0] > 0.0
        infos = env.step(AHEAD)[-1]
    assert infos["chassis_force"][0] == 0.0 and not infos["chassis_contact"][0] and infos["_chassis_contact"][0]


def test_rays_meet_what_stops_the_machine():
    terms = {
        "lidar": lidar(columns=360, noise=False, latency=0.0),
        "height_map": height_map(cell=0.25, forward=(0.0, 20.0), left=(-1.0, 1.0), latency=0.0, ground_only=False),
    }
    env = made(World(FIELD, (PINE, LOG)), observation_terms=terms)
    observation, _ = env.reset(seed=0, options=START)
    state = env.twin.state.numpy()[:3, 0]

    def shown(name: str) -> np.ndarray:
        return observation[0, env.observation_layout[name]]

    view = env.task.observation_terms["lidar"].function
    level = np.abs(view.directions[:, 1]) < np.radians(1.5)
    ahead = level & (np.abs(view.directions[:, 0]) < np.radians(1.0))
    axis_x = PINE.position[0] - state[0] - view.mounting.position[0]
    height = view.mounting.position[2] + state[2]
    # from the axis by the stem's radius at the beam's height; a beam 1 degree off the axis is farther by less than 1 cm
    nearest = axis_x - 0.5 * float(PINE.diameter_at(height))
    assert shown("lidar")[ahead].min() == pytest.approx(nearest, abs=0.05)
    points = env.task.observation_terms["height_map"].function.points
    off = points[:, 0] + state[0] - LOG.position[0]
    on_log = np.abs(off) < LOG.radius
    assert on_log.any()
    # over the map's origin, which is the hinge; the mesh of a log is flatter than it
    top = LOG.position[2] + np.sqrt(LOG.radius**2 - off[on_log] ** 2)
    np.testing.assert_allclose(shown("height_map")[on_log] + state[2], top, atol=0.03)


# ---- where episodes start --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def forest() -> World:
    return world(1, size=(60.0, 60.0))


def test_generated_paths_keep_clear_of_what_is_solid(forest):
    def apart(paths: Any) -> float:
        """Least distance [m] of a path's points from what is solid."""
        solid = circles(forest)
        return min(
            float((np.linalg.norm(path.points[:, None] - solid[:, :2], axis=2) - solid[:, 2]).min()) for path in paths
        )

    paths = generated_paths(forest, 2, 40.0)
    assert apart(paths) > 0.5 * WIDTH > apart(generated_paths(forest.terrain, 2, 40.0))


def test_drawn_starts_are_free(forest):
    env = made(forest, 32, path=None, randomisation=MILD)
    solid = circles(forest)
    for seed in range(8):
        env.reset(seed=100 * seed)
        hinge = env.twin.state.numpy()[:2].T.astype(np.float64)
        assert stands_free(solid, hinge, env.output("yaw"), env.output("joint_angle")).all()
        _, depths, _ = env.twin._grounds.objects.overlaps(env.twin.machines, env.twin.state)  # pyright: ignore
        assert depths.max() <= DEEP
        assert not env.reset(seed=100 * seed)[1]["chassis_contact"].any()


def test_a_start_in_an_object_is_moved_along_the_path():
    beside = replace(PINE, position=(-2.0, 0.5, 0.0))
    solid = circles(World(FIELD, (beside,)))
    env, bare = (
        made(ground, randomisation=replace(MILD, start=(0.2, 0.2))) for ground in (World(FIELD, (beside,)), FIELD)
    )
    for seed in range(5):
        (_, infos), (_, free) = env.reset(seed=seed), bare.reset(seed=seed)
        moved = (free["remaining"] - infos["remaining"])[0]
        assert abs(moved) > 1.0 and 2.0 * moved == pytest.approx(round(2.0 * moved), abs=1e-3)
        for name in ("cross_track", "heading_error"):
            np.testing.assert_allclose(infos[name], free[name], atol=1e-5)
        # nowhere nearer does it stand free
        drawn, apart = STRAIGHT.length - free["remaining"][0], round(2.0 * abs(moved))
        for step in (*range(-apart + 1, apart), round(2.0 * moved)):
            bare.reset(seed=seed, options={"start": drawn + 0.5 * step})
            yaw, joint = (np.array([float(bare.output(name)[0])]) for name in ("yaw", "joint_angle"))
            stands = stands_free(solid, bare.twin.state.numpy()[:2].T.astype(float), yaw, joint)[0]
            assert stands == (step == round(2.0 * moved))
    with pytest.raises(ValueError, match="would stand in an object"):
        env.reset(seed=0, options={"start": 8.0})
    env.reset(seed=0)
    env.step(AHEAD)


def test_a_machine_stands_free_where_no_circle_is_within_reach():
    rng = np.random.default_rng(0)
    hinge, heading, angle = rng.uniform(-3, 3, (400, 2)), rng.uniform(-3, 3, 400), rng.uniform(-0.7, 0.7, 400)
    solid = np.array([[0.0, 0.0, 0.3]])
    # by points of both frames' outlines, 5 cm apart
    x, y = np.meshgrid(np.linspace(0.0, HALF_LENGTH, 51), np.linspace(-HALF_WIDTH, HALF_WIDTH, 53))
    nearest = np.full(400, np.inf)
    for turned in (heading, heading - angle + np.pi):
        c, s = np.cos(turned)[:, None], np.sin(turned)[:, None]
        points = hinge[:, None] + np.stack([c * x.ravel() - s * y.ravel(), s * x.ravel() + c * y.ravel()], axis=-1)
        nearest = np.minimum(nearest, np.linalg.norm(points, axis=-1).min(axis=1))
    clear = nearest - 0.3 - ROOM
    free = stands_free(solid, hinge, heading, angle)
    known = np.abs(clear) > 0.05  # what the points' distance leaves open
    np.testing.assert_array_equal(free[known], clear[known] > 0.0)
    assert free.any() and not free.all()


def test_turning_starts_in_the_open(forest):
    env = TurningVectorEnv(8, terrain=forest)
    for seed in range(4):
        env.reset(seed=seed, options={"heading": np.linspace(0.0, 6.0, 8)})
        env.step(np.ones((8, 1), dtype=np.float32))
    at = np.array(open_place(forest))
    np.testing.assert_allclose(env.twin.state.numpy()[:2, 0], at, atol=0.1)
    crowd = tuple(
        replace(PINE, position=(float(x), float(y), 0.0)) for x in range(-30, 31, 3) for y in range(-30, 31, 3)
    )
    dense = TurningVectorEnv(1, terrain=World(FIELD, crowd))
    with pytest.raises(ValueError, match=r"no place with 3\.0 m to the next solid object"):
        dense.reset(seed=0)
    with pytest.raises(ValueError, match="would stand in an object"):
        dense.reset(seed=0, options={"position": (1.5, 0.0)})


def test_a_world_is_a_course_in_a_folder(tmp_path, forest):
    save_world(forest, tmp_path / "forest")
    files = CourseFiles("AORO/PathTracking-v0", terrain=tmp_path / "forest", path_length=20.0)
    ground, warnings = files.load_terrain(lambda share: None)
    course, _, _ = files.course(ground)
    assert course.world is not None and course.world.objects == forest.objects and not warnings
    assert course.ground is course.world and len(course.trees) == sum(
        isinstance(one, Tree) and not one.drivable() for one in forest.objects
    )
    plan = TrainingPlan(env="AORO/PathTracking-v0", terrain=str(tmp_path / "forest"), path_length=20.0)
    held_out = held_out_courses(plan, [course])
    assert held_out[0].ground is course.ground and held_out[0].paths != course.paths
    with pytest.raises(OSError, match=r"world\.json"):
        CourseFiles("AORO/PathTracking-v0", terrain=tmp_path).load_terrain(lambda share: None)


def test_the_page_shows_the_objects(forest):
    env, turning = made(forest, path=None), TurningVectorEnv(1, terrain=forest)
    env.reset(seed=0)
    assert surroundings(env.task, env.twin)[0] is forest
    assert surroundings(turning.task, turning.twin)[0] is forest


# ---- what is kept ----------------------------------------------------------------------------------------------------


def test_paths_and_results_are_kept_by_the_objects_too(tmp_path, monkeypatch):
    monkeypatch.setenv("AORO_GYM_CACHE", str(tmp_path))
    moved = replace(PINE, position=(8.0, 3.0, 0.0))
    one, same, other = World(FIELD, (PINE,)), World(FIELD, (PINE,)), World(FIELD, (moved,))
    first = generated_paths(one, 1, 12.0)
    assert len(list(tmp_path.rglob("*.npz"))) == 1
    np.testing.assert_array_equal(generated_paths(same, 1, 12.0)[0].points, first[0].points)
    assert len(list(tmp_path.rglob("*.npz"))) == 1
    generated_paths(other, 1, 12.0)
    assert len(list(tmp_path.rglob("*.npz"))) == 2
    kept = [digest(inputs.grounds([Course.over(ground, (STRAIGHT,))])) for ground in (one, same, other, FIELD)]
    assert kept[0] == kept[1] and len(set(kept)) == 3


def test_a_world_without_solid_objects_is_bare_ground_to_the_bit():
    branch = Branch((0.0, 0.0, 0.02), along((1.0, 0.0, 0.0)), "pine", 1.0, 0.02)
    env, bare = made(World(FIELD, (branch,))), made(FIELD)
    for one, other in zip(driven(env, 20), driven(bare, 20), strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        assert one[-1].keys() == other[-1].keys()


def test_copies_go_on_to_the_bit():
    env = made()
    driven(env, 100)
    copies = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    for _ in range(40):
        expected = env.step(AHEAD)
        for each in copies:
            found = each.step(AHEAD)
            np.testing.assert_array_equal(found[0], expected[0])
            np.testing.assert_array_equal(found[-1]["chassis_force"], expected[-1]["chassis_force"])
    assert expected[-1]["chassis_force"][0] > 0.0


@pytest.mark.parametrize("name", ["AORO/PathTracking-v0", "AORO/Turning-v0"])
def test_gymnasium_makes_one_and_many(name, forest):
    env = gymnasium.make(name, terrain=forest)
    one, info = env.reset(seed=3)
    many = gymnasium.make_vec(name, num_envs=2, terrain=[forest] if "Turning" in name else forest)
    np.testing.assert_array_equal(many.reset(seed=3)[0][0], one)
    assert info["chassis_contact"] is False and info["chassis_force"] == 0.0
    with pytest.raises(ValueError, match=r"make it by Course.over\(world, paths\)"):
        Course(forest, (STRAIGHT,))  # pyright: ignore[reportArgumentType]
