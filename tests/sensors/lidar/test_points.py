"""Points in files are those of the sweep."""

import laspy
import numpy as np
import pytest

from aoro_gym.sensors.lidar import Lidar, Motion, Points
from aoro_gym.sensors.raytrace import Scene


@pytest.fixture(scope="module")
def points() -> Points:
    scene = Scene([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], [[0, 1, 2], [0, 2, 3]])
    return Lidar(scene, "vlp-16", subrays=2, returns=["first", "last"]).sweep(Motion.still([1.0, 2.0, 0.0]))[0]


def test_npz(points, tmp_path):
    points.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        assert set(file) == set(Points.__dataclass_fields__)
        for name in file:
            np.testing.assert_array_equal(file[name], getattr(points, name))


def test_pcd(points, tmp_path):
    points.save(tmp_path / "a.pcd")
    head, _, body = (tmp_path / "a.pcd").read_bytes().partition(b"DATA binary\n")
    words = {line.split()[0]: line.split()[1:] for line in head.decode().splitlines()}
    kinds = [f"<{letter.lower()}{size}" for letter, size in zip(words["TYPE"], words["SIZE"], strict=True)]
    record = np.frombuffer(body, dtype=list(zip(words["FIELDS"], kinds, strict=True)))
    assert int(words["POINTS"][0]) == len(points) == len(record)
    np.testing.assert_array_equal(np.column_stack([record[axis] for axis in "xyz"]), points.points)
    for name in ("intensity", "time", "ring", "instance", "class_id", "echo"):
        np.testing.assert_array_equal(record[name], getattr(points, name))


@pytest.mark.parametrize("suffix", [".laz", ".las"])
def test_las(points, tmp_path, suffix):
    points.save(tmp_path / f"a{suffix}")
    cloud = laspy.read(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(cloud.xyz, points.world, atol=0.5e-3 + 1e-6)
    np.testing.assert_array_equal(cloud.gps_time, points.time)
    np.testing.assert_array_equal(cloud.ring, points.ring)
    np.testing.assert_array_equal(cloud["class_id"], points.class_id)
    np.testing.assert_array_equal(cloud.power, points.intensity)
    assert (np.asarray(cloud.return_number) <= np.asarray(cloud.number_of_returns)).all()


def test_no_points_are_a_file_too(points, tmp_path):
    none = points.chosen(np.zeros(len(points), dtype=bool))
    for suffix in (".npz", ".pcd", ".laz"):
        none.save(tmp_path / f"a{suffix}")
    assert len(laspy.read(tmp_path / "a.laz").x) == 0
    with pytest.raises(ValueError, match=r"suffix of a.xyz is '.xyz'; choose one of: .npz"):
        none.save(tmp_path / "a.xyz")
