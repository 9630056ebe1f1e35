"""Undergrowth against the law of Beer and Lambert: how many rays get through, and where the others end."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from aoro_gym.sensors.lidar import Lidar, LidarModel, Motion, Mounting
from aoro_gym.sensors.lidar.device import UNDERGROWTH
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.world import Undergrowth

COUNT = 20_000
LEAVES = (0.5, 0.3)
"""Reflectance of class 1."""


def grown(corner: tuple[float, float], nodes: int, height: float = 1.0, density: float = 1.0) -> Undergrowth:
    """The same everywhere on a square of nodes 1 m apart."""
    even = np.ones((nodes, nodes), dtype=np.float32)
    return Undergrowth(corner, 1.0, height * even, density * even)


def scene(height: float, density: float, *, slope: float = 0.0, size: float = 60.0) -> Scene:
    """A plane that rises by ``slope`` along x, with undergrowth everywhere up to ``size`` [m] from the origin."""
    xy = 80.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    leaves = grown((-size, -size), round(2.0 * size) + 1, height, density)
    return Scene(
        np.column_stack([xy, slope * xy[:, 0]]), [[0, 1, 2], [0, 2, 3]], reflectance=[(0.3, 0.3), LEAVES],
        undergrowth=leaves, undergrowth_class=1,
    )  # fmt: skip


def down(elevation_deg: float, **changes) -> LidarModel:
    """A lidar that looks ahead and down, many times."""
    given = {
        "name": "down", "elevation_deg": (elevation_deg,) * COUNT, "columns": 1, "rate": 10.0, "range_10": 4000.0,
        "max_range": 200.0, "min_range": 0.1, "noise": ((0.0, 0.02),), "divergence_deg": (0.1, 0.1),
        "wavelength_nm": 905.0, "azimuth_offset_deg": (180.0,),
    }  # fmt: skip
    return LidarModel(**{**given, **changes})


def seen(ground: Scene, model: LidarModel, *, z: float = 3.0, **settings):
    mounting = Mounting(position=(0.0, 0.0, 0.0))
    given = {"subrays": 1, "ideal": True, "mounting": mounting, **settings}
    [points] = Lidar(ground, model, **given).sweep(Motion.still([0.0, 0.0, z]))
    return points


@pytest.mark.parametrize(
    ("height", "density", "elevation"), [(1.0, 0.8, -30.0), (0.3, 4.0, -15.0), (0.15, 8.0, -80.0), (2.5, 0.4, -60.0)]
)
def test_as_many_get_through_as_the_law_says(height, density, elevation):
    points = seen(scene(height, density), down(elevation))
    assert len(points) == COUNT
    length = height / math.sin(math.radians(-elevation))
    through = math.exp(-0.5 * density * length)
    ground = points.instance == 0
    # the number of strides varies by at most one, with a variance of at most 1/4, whose mean exp(-depth) is greater
    convexity = through * 0.5 * 0.25 * (0.5 * density * 0.05) ** 2
    assert ground.mean() == pytest.approx(through, abs=4.0 * math.sqrt(through * (1.0 - through) / COUNT) + convexity)
    assert (points.instance[~ground] == UNDERGROWTH).all() and (points.class_id[~ground] == 1).all()
    entered = (3.0 - height) / math.sin(math.radians(-elevation))
    depth = points.range[~ground] - entered
    assert depth.min() > -1e-3 and depth.max() < length + 1e-3
    law = stats.truncexpon(b=0.5 * density * length, scale=2.0 / density)
    assert depth.mean() == pytest.approx(law.mean(), abs=4.0 * law.std() / math.sqrt(len(depth)) + 0.01)
    assert depth.std() == pytest.approx(law.std(), rel=0.05, abs=0.01)  # strides of 0.05 m


def test_leaves_send_back_what_leaves_that_point_anywhere_do():
    points = seen(scene(2.0, 3.0), down(-45.0))
    leaves = points.instance == UNDERGROWTH
    np.testing.assert_allclose(points.reflectance[leaves], LEAVES[0] * 2.0 / 3.0, rtol=1e-5)
    np.testing.assert_allclose(points.reflectance[~leaves], 0.3 * math.sin(math.radians(45.0)), rtol=1e-5)


def test_a_beam_is_dimmed_by_the_sub_rays_that_it_loses():
    """Tall thin undergrowth: the mean power from the ground is the law's share of what bare ground sends."""
    model = down(-90.0 + 1e-3, pulse=1e-12)  # so short that ground and leaves are apart
    bare, grown = (seen(scene(h, 0.5), model, subrays=16, z=5.0, returns=["last"]) for h in (0.0, 2.0))
    power = np.where(grown.instance == 0, grown.intensity, 0.0) / bare.intensity.mean()
    assert power.mean() == pytest.approx(math.exp(-0.5), abs=4.0 * float(power.std()) / math.sqrt(COUNT))
    assert 0.05 < power.std() < 0.3


def test_on_a_slope_it_is_as_tall_as_it_stands():
    points = seen(scene(0.6, 2.0, slope=0.4), down(-90.0 + 1e-3))
    through = math.exp(-0.6)
    assert (points.instance == 0).mean() == pytest.approx(through, abs=4.0 * math.sqrt(0.25 / COUNT))


def test_beyond_its_grid_none_grows():
    points = seen(scene(0.5, 5.0, size=5.0), down(-15.0))  # the ground is met 11.2 m away
    assert (points.instance == 0).all()


def test_a_worlds_undergrowth_is_seen():
    made = world(1, size=(40.0, 40.0))
    lidar = {name: Lidar(Scene.of_world(each), "vlp-16", subrays=4) for name, each in
             (("grown", made), ("bare", replace(made, undergrowth=None)))}  # fmt: skip
    pose = Motion.still([0.0, 0.0, float(np.median(made.terrain.vertices[:, 2])) + 1.0])
    [grown], [bare] = (lidar[name].sweep(pose) for name in ("grown", "bare"))
    leaves = grown.instance == UNDERGROWTH
    assert 0.02 < leaves.mean() < 0.5 and (grown.class_id[leaves] == Surface.DWARF_SHRUBS).all()
    assert (bare.instance != UNDERGROWTH).all()
    assert (grown.instance == 0).sum() < (bare.instance == 0).sum()


def test_what_cannot_be_is_said():
    with pytest.raises(ValueError, match="undergrowth has 1 x 1 nodes, but must have at least 2 x 2"):
        Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], undergrowth=grown((0.0, 0.0), 1))
    with pytest.raises(ValueError, match="no node of the undergrowth lies over the scene's ground"):
        far = grown((90.0, 90.0), 2)
        Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], undergrowth=far)
    with pytest.raises(ValueError, match="class 3 has no reflectance"):
        Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], undergrowth_class=3)
