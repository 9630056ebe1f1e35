"""A cloud is what its points say: marks of "unknown" are left out and counted, strays too, and the up axis is told."""

import numpy as np
import pytest

from aoro_gym.terrains import TerrainError, load
from aoro_gym.terrains.io.check import Report
from aoro_gym.terrains.io.cloud_survey import Chunk, Cloud, survey
from aoro_gym.terrains.io.frame import LoadOptions


def height(x, y):
    return 0.1 * x - 0.05 * y


def points(shift=(0.0, 0.0, 0.0), side=20.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0.0, side + 1e-9), np.arange(0.0, side + 1e-9))
    return np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()]) + shift


def surveyed(xyz, count=None, **wishes):
    """The survey of points in chunks of 100, and what its report says."""
    report = Report(source="cloud")
    cloud = Cloud(
        len(xyz) if count is None else count, lambda: (Chunk(xyz[i : i + 100]) for i in range(0, len(xyz), 100))
    )
    return survey(cloud, LoadOptions(**wishes), report), report


def changes(report) -> dict[str, int]:
    return {change.what: change.count for change in report.changes}


UTM = (500_000.0, 6_650_000.0, 150.0)


def with_rows(xyz, row, number) -> np.ndarray:
    rows = np.tile(np.asarray(row, dtype=np.float64), (number, 1))
    return np.concatenate([xyz[:50], rows, xyz[50:]])


MARKED = {
    "-9999": (UTM, (500_003.0, 6_650_003.0, -9999.0), 7, "unknown_heights"),
    "-32768": (UTM, (500_003.0, 6_650_003.0, -32768.0), 300, "unknown_heights"),
    "no height": (UTM, (500_003.0, 6_650_003.0, 0.0), 12, "unknown_heights"),
    "-999": (UTM, (500_003.0, 6_650_003.0, -999.0), 3, "unknown_heights"),
    "origin": (UTM, (0.0, 0.0, 0.0), 1, "zero_points"),
    "missed echoes": ((-10.0, -10.0, -1.0), (0.0, 0.0, 0.0), 200, "zero_points"),
    "not a number": (UTM, (500_003.0, np.nan, 150.0), 4, "broken_points"),
    "infinite": (UTM, (np.inf, 6_650_003.0, 150.0), 4, "broken_points"),
    "no float at all": (UTM, (500_003.0, 6_650_003.0, -3.4e38), 4, "broken_points"),
    "a stray": (UTM, (900_000.0, 6_650_003.0, 150.0), 1, "stray_points"),
    "strays": (UTM, (500_003.0, -6_650_003.0, 150.0), 3, "stray_points"),
}


@pytest.mark.parametrize("name", MARKED)
def test_marks_of_unknown_are_left_out_and_counted(name):
    shift, row, number, what = MARKED[name]
    whole = points(shift)
    if name == "missed echoes":
        whole = whole[~np.all(np.abs(whole) < 1e-9, axis=1)]
    found, report = surveyed(with_rows(whole, row, number))
    assert changes(report) == {what: number}
    assert found.count == len(whole)
    np.testing.assert_array_equal([found.low, found.high], [whole.min(axis=0), whole.max(axis=0)])
    assert report.points_read == len(whole) + number
    assert int(found.usable(Chunk(with_rows(whole, row, number))).sum()) == len(whole)


VALID = {
    "a corner at zero": points(),
    "through zero": points((-10.0, -10.0, 0.0)),
    "a deep sea": points((0.0, 0.0, -9999.0)),
    "sea level": np.where(points()[:, 2:] < 0.5, points() * [1.0, 1.0, 0.0], points()),
    "millimetres": points((-9.0, -9.0, -1.0)) * 1000.0,
    "minus one": points((0.0, 0.0, -1.0)),
    "a long road": np.concatenate([points(), points((0.0, 60.0, 0.0)), points((0.0, 120.0, 3.0))]),
}


@pytest.mark.parametrize("name", VALID)
def test_whole_clouds_stay_whole(name):
    xyz = VALID[name]
    found, report = surveyed(xyz)
    assert changes(report) == {}
    assert found.count == len(xyz)
    np.testing.assert_array_equal([found.low, found.high], [xyz.min(axis=0), xyz.max(axis=0)])


def test_the_users_marks_win():
    whole = points(UTM)
    marked = with_rows(with_rows(whole, (500_003.0, 6_650_003.0, 151.5), 5), (500_003.0, 6_650_003.0, -9999.0), 5)
    same = int((whole[:, 2] == 151.5).sum())
    found, report = surveyed(marked, nodata=(151.5, -9999.0))
    assert changes(report) == {"unknown_heights": 10 + same}
    found, report = surveyed(with_rows(whole, (500_003.0, 6_650_003.0, -9999.0), 5), nodata=())
    assert changes(report) == {}
    assert found.low[2] == -9999.0


def test_a_cloud_of_marks_is_refused():
    with pytest.raises(TerrainError, match="none of its 40 points is usable"):
        surveyed(np.full((40, 3), np.nan))


@pytest.mark.parametrize("suffix", [".xyz", ".ply"])
def test_marks_do_not_reach_the_ground(tmp_path, suffix):
    xyz = with_rows(points((0.0, 0.0, 150.0)), (3.0, 3.0, -9999.0), 6)
    path = tmp_path / f"cloud{suffix}"
    if suffix == ".ply":
        import trimesh

        trimesh.PointCloud(xyz).export(path)
    else:
        np.savetxt(path, xyz, fmt="%.3f")
    terrain, report = load(path, cell=1.0, ground="all")
    x, y, z = (terrain.vertices + np.asarray(terrain.origin)).T
    np.testing.assert_allclose(z, 150.0 + height(x, y), atol=1e-4)
    assert changes(report)["unknown_heights"] == 6


# --- the up axis of a cloud ---


def y_up(xyz) -> np.ndarray:
    return np.column_stack([xyz[:, 0], xyz[:, 2], -xyz[:, 1]])


def corridor(seed=0) -> np.ndarray:
    """A scan of a road of 60 m x 10 m that rises by 36 m, with trees."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.0, 60.0, 1500), rng.uniform(0.0, 10.0, 1500)
    tree = np.where(rng.random(1500) < 0.15, rng.uniform(1.0, 12.0, 1500), 0.0)
    return np.column_stack([x, y, 0.6 * x + 0.2 * np.sin(y) + tree])


@pytest.mark.parametrize("make", [corridor, points, lambda: points(side=60.0) * [1.0, 0.2, 5.0]])
def test_z_up_stays(make):
    xyz = make()
    found, report = surveyed(xyz)
    assert (found.up, changes(report)) == ("z", {})


@pytest.mark.parametrize("make", [points, lambda: points(side=60.0), lambda: corridor() * [1.0, 6.0, 0.3]])
def test_y_up_is_told_and_said(make):
    found, report = surveyed(y_up(make()))
    assert found.up == "y"
    (change,) = report.changes
    assert change.what == "up"
    assert "up='z'" in change.text


def test_an_error_after_a_guess_names_it(tmp_path):
    np.savetxt(tmp_path / "toy.xyz", y_up(points(side=60.0)) * 0.05, fmt="%.4f")
    with pytest.raises(TerrainError, match=r"before that: y taken as up: .* up='z' keeps z"):
        load(tmp_path / "toy.xyz", units="m")


def test_survey_needs_no_declared_count():
    found, _ = surveyed(points(UTM), count=0)
    assert found.count == 441
