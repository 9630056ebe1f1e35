"""Courses are the same from the disk as made afresh, and nothing of them outlives their terrain."""

import gc
import re
import subprocess
import sys
import weakref
from pathlib import Path as Folder
from typing import Any

import numpy as np
import pytest

from aoro_gym.envs.path_tracking.courses import HeightMap, forest_course, generated_paths
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.raster import surface

SMALL: Any = {"size": (40.0, 40.0), "count": 2, "length": 12.0}


@pytest.fixture
def folder(tmp_path: Folder, monkeypatch) -> Folder:
    monkeypatch.setenv("AORO_GYM_CACHE", str(tmp_path))
    return tmp_path


def hills(seed: int = 0) -> Terrain:
    rng = np.random.default_rng(seed)
    x = np.linspace(-20.0, 20.0, 41)
    heights = 0.5 * np.sin(0.1 * x[:, None] + rng.uniform(0.0, 6.0)) + 0.3 * np.cos(0.2 * x)
    return Terrain.from_heights(
        heights, cell=1.0, corner=(-20.0, -20.0), friction=0.7, crs="EPSG:32635", origin=(1, 2, 3)
    )


def test_a_course_from_the_disk_is_the_one_made_afresh(folder):
    fresh = forest_course(5, **SMALL)
    (kept,) = (folder / "courses").iterdir()
    again = forest_course(5, **SMALL)
    assert again is not fresh
    assert (again.name, again.terrain.name, again.terrain.crs) == (fresh.name, fresh.terrain.name, fresh.terrain.crs)  # type: ignore[union-attr]
    for name in ("vertices", "faces", "friction", "rolling_resistance", "origin"):
        one, other = (getattr(course.terrain, name) for course in (fresh, again))
        assert np.asarray(one).dtype == np.asarray(other).dtype
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(again.trees, fresh.trees)
    assert len(again.paths) == len(fresh.paths) == 2
    for one, other in zip(fresh.paths, again.paths, strict=True):
        assert (one.name, one.closed, one.speed, one.length) == (other.name, other.closed, other.speed, other.length)
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.curvatures, other.curvatures)
    kept.write_bytes(kept.read_bytes()[:1000])
    np.testing.assert_array_equal(forest_course(5, **SMALL).terrain.vertices, fresh.terrain.vertices)  # type: ignore[union-attr]
    forest_course(6, **SMALL)
    forest_course(5, **{**SMALL, "count": 1})
    assert len(list((folder / "courses").iterdir())) == 3


def test_episodes_on_a_kept_course_are_those_on_a_fresh_one(folder):
    def drive() -> list[np.ndarray]:
        env = PathTrackingVectorEnv(2, courses=[forest_course(5, **SMALL)])
        seen = [env.reset(seed=3)[0]]
        seen += [env.step(np.full((2, 2), 0.4, dtype=np.float32))[0] for _ in range(20)]
        env.close()
        return seen

    np.testing.assert_array_equal(drive(), drive())


def test_generated_paths_are_kept_by_what_the_terrain_is(folder, monkeypatch):
    first = generated_paths(hills(), 2, 12.0)
    ground = hills()
    assert generated_paths(ground, 2, 12.0) is not first
    assert generated_paths(ground, 2, 12.0) is generated_paths(ground, 2, 12.0)
    assert len(list((folder / "paths").iterdir())) == 1
    monkeypatch.setenv("AORO_GYM_CACHE", "off")
    for one, other in zip(generated_paths(hills(), 2, 12.0), generated_paths(ground, 2, 12.0), strict=True):
        np.testing.assert_array_equal(one.points, other.points)
    monkeypatch.setenv("AORO_GYM_CACHE", str(folder))
    assert len(generated_paths(Plane(), 3, 12.0, 7)) == 3
    generated_paths(hills(1), 2, 12.0)
    generated_paths(ground, 2, 12.0, 1)
    assert len(list((folder / "paths").iterdir())) == 4
    with pytest.raises(ValueError, match="no drivable path of 12 m"):
        generated_paths(Plane(slope_deg=30.0), 1, 12.0)


def test_a_raster_from_the_disk_is_the_one_made_afresh(folder, monkeypatch):
    fresh = surface(hills(), "cpu")
    again = surface(ground := hills(), "cpu")
    assert again is surface(ground, "cpu") and again is not fresh
    assert (again.corner, again.cell) == (fresh.corner, fresh.cell)
    for name in ("nodes", "cover", "ceilings"):
        one, other = getattr(fresh, name), getattr(again, name)
        assert one.dtype == other.dtype == np.float32 and not one.flags.writeable and not other.flags.writeable
        np.testing.assert_array_equal(one, other)
    surface(ground, "cpu", cell=0.5)
    assert len(list((folder / "rasters").iterdir())) == 2
    with pytest.raises(ValueError, match="cell is -1 m"):
        surface(ground, "cpu", cell=-1)


def test_nothing_of_a_terrain_outlives_it(folder):
    ground = hills()
    map_ = HeightMap([ground])
    paths = generated_paths(ground, 1, 12.0)
    env = PathTrackingVectorEnv(1, terrain=ground, path=paths[0])
    env.reset(seed=0)
    gone = weakref.ref(ground), weakref.ref(surface(ground, "cpu")), weakref.ref(env.twin)
    env.close()
    del ground, map_, env
    gc.collect()
    assert [one() for one in gone] == [None, None, None]
    assert isinstance(paths[0], Path)


@pytest.mark.slow
def test_the_default_course_costs_little_the_second_time():
    """Make and reset in a process of its own: less than its imports, whatever the speed of the machine."""
    code = (
        "import importlib, resource\n"
        "spent = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_utime\n"
        "import gymnasium, aoro_gym\n"
        "importlib.import_module('aoro_gym.envs.path_tracking.environment')\n"
        "imported = spent()\n"
        "gymnasium.make('AORO/PathTracking-v0').reset(seed=0)\n"
        "print((spent() - imported) / imported)"
    )
    ratios = []
    for _ in range(3):  # the first may compile and generate
        out = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
        ratios.append(float(re.findall(r"^[\d.]+$", out, re.MULTILINE)[-1]))
        if ratios[-1] < 1.0:
            return
    pytest.fail(f"CPU time of make and reset over that of the imports: {ratios}")


def rss() -> int:
    """Resident memory of this process [bytes]."""
    pages = int(Folder("/proc/self/statm").read_text().split()[1])
    return pages * 4096


@pytest.mark.slow
def test_memory_does_not_grow_with_own_terrains(monkeypatch):
    monkeypatch.setenv("AORO_GYM_CACHE", "off")

    def use(seed: int) -> None:
        env = PathTrackingVectorEnv(1, terrain=hills(seed), path=Path(np.array([[-15.0, 0.0], [15.0, 0.0]])))
        env.reset(seed=0)
        env.close()

    for seed in range(5):
        use(seed)
    gc.collect()
    before = rss()
    for seed in range(5, 25):
        use(seed)
    gc.collect()
    assert rss() - before < 20 * 2**20  # each raster alone has 0.7 MB, each environment several


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["turning", "own terrains"])
def test_memory_is_flat(kind, monkeypatch):
    """Two thousand environments, made and closed; or forty on large terrains of one's own."""
    import gymnasium

    monkeypatch.setenv("AORO_GYM_CACHE", "off")

    def turning(_: int) -> None:
        env: Any = gymnasium.make("AORO/Turning-v0")
        env.reset(seed=0)
        env.step(env.action_space.sample())
        env.close()

    def own(seed: int) -> None:
        x = np.linspace(-50.0, 50.0, 401)
        ground = Terrain.from_heights(
            0.3 * np.sin(0.1 * x[:, None] + seed) * np.cos(0.1 * x), cell=0.25, corner=(-50.0, -50.0)
        )
        env = PathTrackingVectorEnv(1, terrain=ground)
        env.reset(seed=0)
        env.close()
        del env
        gc.collect()  # tests look for garbage seldom, and what comes back late leaves holes in the memory

    use, warm, count, bound = (turning, 200, 1800, 20e6) if kind == "turning" else (own, 5, 35, 40e6)
    for number in range(warm):
        use(number)
    gc.collect()
    before = rss()
    for number in range(warm, warm + count):
        use(number)
    gc.collect()
    assert rss() - before < bound


def test_ground_is_known_up_to_each_edge():
    ground = Terrain.from_heights(np.zeros((11, 31)), cell=1.0, corner=(-5.0, 20.0))
    edges = np.array([[-5.0, 25.0], [25.0, 25.0], [10.0, 20.0], [10.0, 30.0]])
    inwards = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    known = HeightMap([ground]).known
    assert known(np.zeros(4, dtype=int), edges + 0.01 * inwards).all()
    assert not known(np.zeros(4, dtype=int), edges - 0.01 * inwards).any()
