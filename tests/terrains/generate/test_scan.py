"""Scans: what they leave of the ground whose truth is known, and that loading brings it back."""

import doctest
from typing import Any

import laspy
import numpy as np
import pytest
import trimesh

import aoro_gym.terrains.generate.scan as module
from aoro_gym.terrains import Terrain, load
from aoro_gym.terrains.generate.forest import PUBLISHED_SIZE, Forest, forest
from aoro_gym.terrains.generate.scan import PointClass, Scan, scan

CLEAN = {"noise": 0.0, "holes": 0.0, "low_vegetation": 0.0, "shrubs": 0.0, "low_noise": 0.0}


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.8 * np.sin(x / 6.0) + 0.5 * np.cos(y / 9.0)


@pytest.fixture(scope="module")
def terrain() -> Terrain:
    x, y = np.meshgrid(np.arange(0.0, 50.5, 0.5), np.arange(0.0, 60.5, 0.5))
    return Terrain.from_heights(waves(x, y), cell=0.5, crs="EPSG:32634", origin=(460_000.0, 7_278_000.0, 30.0))


@pytest.fixture(scope="module")
def woods() -> Forest:
    return forest(1, PUBLISHED_SIZE)


@pytest.fixture(scope="module")
def cloud(woods) -> Scan:
    return scan(woods, 5, density=15.0)


def test_clean_points_lie_on_the_ground(terrain):
    cloud = scan(terrain, 1, density=4.0, **CLEAN)
    assert len(cloud.points) == 4 * 50 * 60
    assert np.all(cloud.classes == PointClass.GROUND)
    # a triangle of 0.5 m sides leaves a wave of curvature 0.8 / 6² by at most the sagitta over its diagonal
    sagitta = (0.8 / 36 + 0.5 / 81) * 0.5**2 / 8
    np.testing.assert_allclose(cloud.points[:, 2], waves(*cloud.points.T[:2]), atol=1.01 * sagitta)
    # even over the plan: counts of 12 m x 12 m squares spread as Poisson's
    counts = np.histogram2d(*cloud.points.T[:2], bins=(4, 5), range=((0, 48), (0, 60)))[0]
    assert np.abs(counts - 4 * 144).max() < 4.5 * np.sqrt(4 * 144)


def test_noise_is_as_asked(terrain):
    cloud = scan(terrain, 1, density=4.0, **(CLEAN | {"noise": 0.05}))
    error = cloud.points[:, 2] - waves(*cloud.points.T[:2])
    # plan noise adds the slope's share: mean square slope (0.8/6)²/2 + (0.5/9)²/2
    slope = np.sqrt(((0.8 / 6) ** 2 + (0.5 / 9) ** 2) / 2)
    assert np.std(error) == pytest.approx(0.05 * np.sqrt(1 + slope**2), rel=4 / np.sqrt(2 * len(error)))


def test_holes_are_empty(cloud, woods):
    assert len(cloud.holes) == round(10.0 * 0.57 * 1.03)
    for x, y, radius in cloud.holes:
        assert np.hypot(*(cloud.points[:, :2] - [x, y]).T).min() > radius
    low, high = woods.terrain.extent
    assert np.all((cloud.holes[:, :2] > low[:2]) & (cloud.holes[:, :2] < high[:2]))


def test_vegetation_stands_above_the_ground(cloud, woods):
    nodes = woods.terrain.vertices
    step = woods.settings.cell
    columns = len(np.unique(nodes[:, 0]))
    column, row = np.rint((cloud.points[:, :2] - nodes[0, :2]) / step).astype(int).T
    inside = (row >= 0) & (column >= 0) & (column < columns) & (row * columns + column < len(nodes))
    above = cloud.points[inside, 2] - nodes[(row * columns + column)[inside], 2]
    classes = cloud.classes[inside]
    middle = {kind: float(np.median(above[classes == kind])) for kind in PointClass}
    assert middle[PointClass.LOW_NOISE] < -1.0 < middle[PointClass.GROUND]
    assert abs(middle[PointClass.GROUND]) < 0.05
    assert middle[PointClass.GROUND] + 0.03 < middle[PointClass.LOW_VEGETATION] < 0.3
    assert (
        middle[PointClass.LOW_VEGETATION]
        < middle[PointClass.MEDIUM_VEGETATION]
        < 2.5
        < middle[PointClass.HIGH_VEGETATION]
    )
    # nothing grows on asphalt
    assert woods.road is not None
    low = cloud.points[cloud.classes == PointClass.LOW_VEGETATION, :2]
    assert np.abs(woods.road.project(low)[1]).min() > woods.settings.road_width / 2


def test_same_seed_same_scan(woods, cloud):
    np.testing.assert_array_equal(scan(woods, 5, density=15.0).points, cloud.points)
    assert not np.array_equal(scan(woods, 6, density=15.0).holes, cloud.holes)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_in_world_coordinates(tmp_path, terrain, suffix):
    cloud = scan(terrain, 3, density=5.0)
    cloud.save(tmp_path / f"scan{suffix}")
    written: Any = laspy.read(tmp_path / f"scan{suffix}")
    np.testing.assert_array_equal(written.classification, cloud.classes)
    np.testing.assert_allclose(written.xyz - terrain.origin, cloud.points, atol=0.5001e-3)  # counts millimetres
    assert written.header.parse_crs().to_authority() == ("EPSG", "32634")


def test_mesh_is_loaded_as_the_ground(tmp_path, terrain):
    cloud = scan(terrain, 3, density=20.0, noise=0.02, holes=0.0)
    cloud.save_mesh(tmp_path / "scan.ply", cell=0.5)
    again, report = load(tmp_path / "scan.ply")
    assert report.kind == "mesh"
    # the lowest of a cell's about 14 ground points of noise 0.02 m lies 1.7 deviations low, and 0.25 m downhill at most
    error = again.vertices[:, 2] + again.origin[2] - waves(*(again.vertices[:, :2] + again.origin[:2]).T)
    assert -0.1 < np.median(error) < 0.0
    assert np.std(error) < 0.05


def test_mesh_leaves_the_holes_open(tmp_path, terrain):
    cloud = scan(terrain, 3, density=20.0, noise=0.02, holes=10.0)
    vertices, faces = cloud.mesh(0.5)
    middles = vertices[faces].mean(axis=1)
    for x, y, radius in cloud.holes[cloud.holes[:, 2] > 1.5]:
        assert np.hypot(middles[:, 0] - x, middles[:, 1] - y).min() > 0.5 * radius
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0.0)  # seen from above, counter-clockwise
    # the lowest of about five noisy points of a cell
    error = vertices[:, 2] - waves(*vertices.T[:2])
    assert -4.5 * 0.02 < np.median(error) < 0.0
    cloud.save_mesh(tmp_path / "scan.ply", cell=0.5)
    read: Any = trimesh.load_mesh(tmp_path / "scan.ply", process=False)
    assert len(read.faces) == len(faces)
    top = cloud.mesh(0.5, surface="top")[0]
    assert top[:, 2].max() > vertices[:, 2].max() + 0.3  # shrubs


def test_coloured_points(tmp_path, cloud):
    cloud.save(tmp_path / "scan.ply")
    read = trimesh.load(tmp_path / "scan.ply")
    assert isinstance(read, trimesh.PointCloud)
    np.testing.assert_allclose(read.vertices, cloud.points, atol=1e-5)
    assert len(np.unique(np.asarray(read.colors), axis=0)) == len(np.unique(cloud.classes))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"density": 0.0}, r"density is 0, but must be in \[0.1, 1000\]"),
        ({"noise": np.nan}, "noise is nan"),
        ({"low_vegetation": 2.0}, "low_vegetation is 2"),
    ],
)
def test_refuses(terrain, wrong, message):
    with pytest.raises(ValueError, match=message):
        scan(terrain, 0, **wrong)


def test_refuses_other_files(tmp_path, cloud):
    with pytest.raises(ValueError, match=r"scans are written as .las, .laz or .ply"):
        cloud.save(tmp_path / "scan.xyz")
    with pytest.raises(ValueError, match=r"meshes are written as .ply"):
        cloud.save_mesh(tmp_path / "scan.dwg")
    with pytest.raises(ValueError, match="mesh cell is 0 m"):
        cloud.mesh(0.0)


def test_example():
    tried = doctest.testmod(module)
    assert tried.attempted > 0
    assert tried.failed == 0
