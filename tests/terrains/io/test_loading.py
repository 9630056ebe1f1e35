"""Every kind of source becomes the same ground, units, axes and systems are recognised, and what is broken is refused."""

import doctest
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
import rasterio
import trimesh

from aoro_gym.terrains import Terrain, TerrainError, load, to_local
from aoro_gym.terrains.io import loading
from aoro_gym.terrains.io.frame import UNITS

CELL, SIZE = 0.5, 40.0
UTM = (430_000.0, 5_150_000.0)
"""South-western corner of the georeferenced sources, in EPSG:32632."""


def height(x, y):
    """A gentle hill [m], at most 14° steep."""
    return 3.0 * np.exp(-((x - 20.0) ** 2 + (y - 18.0) ** 2) / 200.0) + 0.05 * x + 0.02 * y


STEEPEST = 3.0 * np.sqrt(1.0 / 200.0 * 2.0) * np.exp(-0.5) + np.hypot(0.05, 0.02)
"""Upper bound of the gradient of ``height``: of a Gaussian, at one standard deviation, and of its plane."""
CURVATURE = 3.0 * 2.0 / 200.0
"""Largest second derivative [1/m] of ``height``."""
BILINEAR = CURVATURE * CELL**2 / 4.0
"""Largest error [m] of two triangles a cell: h²/8 times the second derivative, along each axis."""


def nodes(cell: float = CELL):
    steps = np.arange(0.0, SIZE + 1e-9, cell)
    return np.meshgrid(steps, steps)


def grid() -> np.ndarray:
    return height(*nodes())


def surface() -> trimesh.Trimesh:
    whole = Terrain.from_heights(grid(), cell=CELL)
    return trimesh.Trimesh(whole.vertices.copy(), whole.faces.copy(), process=False)


def write_raster(
    path: Path, z=None, *, crs: str | None = "EPSG:32632", driver="GTiff", pixel=CELL, corner=UTM, **more
) -> Path:
    z = grid() if z is None else z
    top = corner[1] + pixel * (z.shape[0] - 0.5)
    place = rasterio.Affine(pixel, 0.0, corner[0] - 0.5 * pixel, 0.0, -pixel, top)
    with rasterio.open(
        path,
        "w",
        driver=driver,
        height=z.shape[0],
        width=z.shape[1],
        count=1,
        dtype="float32",
        crs=crs,
        transform=place,
        nodata=-9999.0,
        **more,
    ) as file:
        file.write(np.nan_to_num(z[::-1], nan=-9999.0).astype("float32"), 1)
    return path


def cloud(count=25_000, seed=1):
    """Points on the ground, and of trees above it: (N, 3), and their classes."""
    rng = np.random.default_rng(seed)
    plan = rng.uniform(0.0, SIZE, (count, 2))
    ground = np.column_stack([plan, height(*plan.T) + rng.normal(0.0, 0.02, count)])
    stems = rng.uniform(3.0, SIZE - 3.0, (12, 2))
    leaves = np.repeat(stems, 500, axis=0) + rng.normal(0.0, 1.0, (6000, 2))
    trees = np.column_stack([leaves, height(*leaves.T) + rng.uniform(1.5, 12.0, 6000)])
    return np.concatenate([ground, trees]), np.repeat([2, 5], [count, 6000]).astype(np.uint8)


def write_las(path: Path, points, classes=None, crs="EPSG:32632", shift=(*UTM, 300.0)) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.offsets, header.scales = np.array(shift), np.full(3, 0.001)
    if crs:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    file = laspy.LasData(header)
    file.x, file.y, file.z = (points + np.array(shift)).T
    file.classification = np.zeros(len(points), dtype=np.uint8) if classes is None else classes
    file.write(str(path))
    return path


def errors(terrain: Terrain, corner=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Heights of the vertices against the true ones at their places."""
    x, y, z = (terrain.vertices + np.asarray(terrain.origin) - corner).T
    return z - height(x, y)


def uncovered(terrain: Terrain, points: np.ndarray) -> np.ndarray:
    """(N,) whether no triangle lies under each plan position; by brute force."""
    a, b, c = (terrain.vertices[terrain.faces[:, i], :2] for i in range(3))
    area = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2]
    found = []
    for p in points:
        v = ((p[0] - a[:, 0]) * (c - a)[:, 1] - (p[1] - a[:, 1]) * (c - a)[:, 0]) / area
        w = ((b - a)[:, 0] * (p[1] - a[:, 1]) - (b - a)[:, 1] * (p[0] - a[:, 0])) / area
        found.append(not np.any((v >= -1e-9) & (w >= -1e-9) & (v + w <= 1.0 + 1e-9)))
    return np.array(found)


def assert_no_silent_hole(terrain: Terrain, report, count=200, seed=3) -> None:
    """Every place within the extent has ground, or the report names the hole around it."""
    low, high = (bound[:2] for bound in terrain.extent)
    edge = 1.01 if report.cell_m is None else 0.0  # kept triangles are measured on a grid of at most 1 m
    points = np.random.default_rng(seed).uniform(low + edge, high - edge, (count, 2))
    for x, y in points[uncovered(terrain, points)]:
        assert any(h.west <= x <= h.east and h.south <= y <= h.north for h in report.holes), f"silent hole at {x}, {y}"


def changes(report) -> dict[str, int]:
    return {change.what: change.count for change in report.changes}


def test_example():
    tried = doctest.testmod(loading)
    assert tried.attempted > 0
    assert tried.failed == 0


# --- every kind of source ---


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off", ".glb"])
def test_mesh_keeps_its_triangles(tmp_path, suffix):
    mesh = surface()
    if suffix == ".glb":  # y up, by its specification
        mesh.vertices = np.stack([mesh.vertices[:, 0], mesh.vertices[:, 2], -mesh.vertices[:, 1]], axis=1)
    mesh.export(tmp_path / f"ground{suffix}")
    terrain, report = load(tmp_path / f"ground{suffix}")
    assert report.cell_m is None
    assert report.holes == []
    assert len(terrain.faces) == len(mesh.faces)
    assert np.abs(errors(terrain)).max() < 1e-4  # single precision, and eight digits of text
    assert report.slope_max_deg <= np.degrees(np.arctan(STEEPEST)) + 0.1
    assert_no_silent_hole(terrain, report)


@pytest.mark.parametrize(("suffix", "driver"), [(".tif", "GTiff"), (".asc", "AAIGrid")])
def test_raster(tmp_path, suffix, driver):
    path = tmp_path / f"ground{suffix}"
    if driver == "GTiff":
        write_raster(path)
    else:
        rows = "\n".join(" ".join(f"{v:.5f}" for v in row) for row in grid()[::-1])
        corner = f"xllcorner {UTM[0] - 0.25}\nyllcorner {UTM[1] - 0.25}\n"
        path.write_text(f"ncols 81\nnrows 81\n{corner}cellsize 0.5\nNODATA_value -9999\n{rows}\n")
    terrain, report = load(path, crs="EPSG:32632")
    assert terrain.crs == report.crs == "EPSG:32632"
    assert np.abs(terrain.vertices).max() < SIZE
    assert np.abs(errors(terrain, (*UTM, 0.0))).max() < 1e-4
    assert report.cell_m == pytest.approx(CELL)
    assert_no_silent_hole(terrain, report)


def test_array_and_npy(tmp_path):
    np.save(tmp_path / "ground.npy", grid())
    for source in (grid(), tmp_path / "ground.npy", grid().tolist()):
        terrain, report = load(source, cell=CELL)
        assert np.abs(errors(terrain)).max() == 0.0
        assert report.ground_m2 == pytest.approx(SIZE**2)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_cloud_by_class(tmp_path, suffix):
    told = []
    path = write_las(tmp_path / f"forest{suffix}", *cloud())
    terrain, report = load(path, progress=told.append)
    assert report.crs == "EPSG:32632"
    assert changes(report)["ground_by_class"] == 25_000
    assert told == sorted(told)
    assert told[-1] == 1.0
    inside = np.abs(terrain.vertices[:, :2] + terrain.origin[:2] - UTM - SIZE / 2).max(axis=1) < SIZE / 2 - 1.0
    # means of about four points of 2 cm noise, and a cell's curvature; five standard deviations
    assert report.cell_m is not None
    bound = 5.0 * 0.02 + CURVATURE * report.cell_m**2
    assert np.abs(errors(terrain, (*UTM, 300.0))[inside]).max() < bound
    assert_no_silent_hole(terrain, report)


@pytest.mark.parametrize("suffix", [".laz", ".xyz", ".csv", ".ply"])
def test_trees_are_told_from_ground(tmp_path, suffix):
    points, _ = cloud()
    path = tmp_path / f"forest{suffix}"
    if suffix == ".laz":
        write_las(path, points, shift=(*UTM, 0.0))
    elif suffix == ".ply":
        trimesh.PointCloud(points).export(path)
    else:
        comma = suffix == ".csv"
        np.savetxt(
            path, points, fmt="%.3f", delimiter="," if comma else " ", header="x,y,z" if comma else "", comments=""
        )
    terrain, report = load(path)
    assert "ground_by_filter" in changes(report)
    wrong = errors(terrain, (*UTM, 0.0) if suffix == ".laz" else (0.0, 0.0, 0.0))
    # The lowest of several points of 2 cm noise lies below the ground; a tree's lowest leaf 1.5 m above.
    assert np.percentile(np.abs(wrong), 95) < 0.15
    assert wrong.max() < 1.0
    assert_no_silent_hole(terrain, report)


def test_chunks_do_not_matter(tmp_path, monkeypatch):
    path = write_las(tmp_path / "forest.laz", *cloud())
    whole = load(path).terrain
    monkeypatch.setattr("aoro_gym.terrains.io.read_las.CHUNK", 7_001)
    parts = load(path).terrain
    np.testing.assert_allclose(parts.vertices, whole.vertices, atol=1e-9)  # order of summation


# --- units, axes, systems ---


@pytest.mark.parametrize("unit", ["mm", "ft", "us-ft", "in", "cm"])
def test_units_as_asked(tmp_path, unit):
    mesh = surface()
    mesh.vertices /= UNITS[unit]
    mesh.export(tmp_path / "ground.ply")
    terrain, report = load(tmp_path / "ground.ply", units=unit)
    assert np.abs(errors(terrain)).max() < 1e-4
    assert report.units == f"{unit} (as asked)"


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("km", 1e-3)])
def test_a_thousand_is_recognised(tmp_path, unit, factor):
    mesh = surface()
    mesh.vertices *= factor
    mesh.export(tmp_path / "ground.ply")
    terrain, report = load(tmp_path / "ground.ply")
    assert np.abs(errors(terrain)).max() < 1e-4
    assert report.units.startswith(unit)
    assert "units" in changes(report)


def test_a_thousand_in_height_is_recognised(tmp_path):
    terrain, report = load(write_raster(tmp_path / "ground.tif", grid() * 1e3))
    assert np.abs(errors(terrain, (*UTM, 0.0))).max() < 1e-4
    assert "z_units" in changes(report)


def test_feet_of_the_coordinate_system(tmp_path):
    foot = UNITS["us-ft"]
    path = write_raster(
        tmp_path / "ground.tif", grid() / foot, crs="EPSG:2227", pixel=CELL / foot, corner=(6.5e6, 2.0e6)
    )
    terrain, report = load(path)
    assert np.abs(errors(terrain, (6.5e6 * foot, 2.0e6 * foot, 0.0))).max() < 1e-3
    assert report.extent_m[0] == pytest.approx(SIZE)
    assert any("nothing is said of the unit of heights" in text for text in report.warnings)
    metres, _ = load(
        write_raster(tmp_path / "m.tif", crs="EPSG:2227", pixel=CELL / foot, corner=(6.5e6, 2e6)), z_units="m"
    )
    assert np.abs(errors(metres, (6.5e6 * foot, 2.0e6 * foot, 0.0))).max() < 1e-3


def test_y_up_is_recognised(tmp_path):
    mesh = surface()
    mesh.vertices = np.stack([mesh.vertices[:, 0], mesh.vertices[:, 2], -mesh.vertices[:, 1]], axis=1)
    mesh.export(tmp_path / "ground.obj")
    terrain, report = load(tmp_path / "ground.obj")
    assert np.abs(errors(terrain)).max() < 1e-4
    assert report.up.startswith("y")
    assert "up" in changes(report)


def test_degrees_become_utm(tmp_path):
    # 20 m of prairie at 1 m in degrees: a degree of latitude is 111 km
    z = np.add.outer(np.arange(60) * 0.1, np.zeros(60))
    path = write_raster(tmp_path / "g.tif", z, crs="EPSG:4326", pixel=1e-5, corner=(9.0, 45.0))
    terrain, report = load(path)
    assert terrain.crs == "EPSG:32632"
    assert "projected" in changes(report)
    x, y = to_local(terrain, 45.0003, 9.0003)
    low, high = terrain.extent
    assert low[0] < x < high[0]
    assert low[1] < y < high[1]
    with pytest.raises(TerrainError, match="as if in degrees"):
        load(write_raster(tmp_path / "unknown.tif", z, crs=None, pixel=1e-5, corner=(9.0, 45.0)))


def test_path_in_degrees_meets_terrain_in_utm(tmp_path):
    terrain, _ = load(write_raster(tmp_path / "ground.tif"))
    back = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    longitude, latitude = back.transform(UTM[0] + 20.0, UTM[1] + 18.0)
    x, y = to_local(terrain, latitude, longitude)
    nearest = terrain.vertices[np.argmin(np.hypot(terrain.vertices[:, 0] - x, terrain.vertices[:, 1] - y))]
    assert nearest[2] + terrain.origin[2] == pytest.approx(height(20.0, 18.0), abs=1e-4)


def test_window_and_cell(tmp_path):
    path = write_raster(tmp_path / "ground.tif")
    terrain, report = load(path, window=(UTM[0] + 10.0, UTM[1] + 5.0, UTM[0] + 30.0, UTM[1] + 35.0))
    assert report.extent_m[:2] == pytest.approx((20.0, 30.0))
    assert np.abs(errors(terrain, (*UTM, 0.0))).max() < 1e-4
    coarse, report = load(path, cell=2.0)
    assert report.cell_m == 2.0
    assert np.abs(errors(coarse, (*UTM, 0.0))).max() < CURVATURE * 2.0**2 / 4.0  # a mean over the cell
    with pytest.raises(TerrainError, match="lies outside of its extent"):
        load(path, window=(0.0, 0.0, 1.0, 1.0))


def test_larger_than_single_precision_is_cropped(tmp_path):
    z = np.add.outer(np.zeros(1300), 0.01 * np.arange(1300.0))
    terrain, report = load(write_raster(tmp_path / "g.tif", z, pixel=10.0))
    assert "cropped" in changes(report)
    assert np.abs(terrain.vertices).max() <= 5000.0
    assert report.extent_m[0] == pytest.approx(10_000.0, abs=20.0)


def test_saved_terrain_keeps_its_place_on_earth(tmp_path):
    loaded = load(write_raster(tmp_path / "ground.tif"))
    loading.save(loaded, tmp_path / "again.ply")
    again, report = load(tmp_path / "again.ply")
    assert (again.crs, again.origin) == (loaded.terrain.crs, loaded.terrain.origin)
    assert "georeferenced" in changes(report)
    assert np.abs(errors(again, (*UTM, 0.0))).max() < 1e-4
    (tmp_path / "again.json").write_text("[]")
    assert load(tmp_path / "again.ply").terrain.crs is None


# --- repair ---


def without(z, rows, columns):
    z = z.copy()
    z[rows, columns] = np.nan
    return z


def test_small_holes_are_filled_large_ones_named():
    z = without(without(grid(), slice(10, 16), slice(10, 16)), slice(40, 70), slice(40, 70))
    terrain, report = load(z, cell=CELL, hole_limit=5.0)
    assert len(report.holes) == 1
    hole = report.holes[0]
    # of 30 open heights a side, so 31 open cells
    assert (hole.west, hole.east) == (39 * CELL, 70 * CELL)
    assert not hole.at_edge
    assert hole.area_m2 == pytest.approx((31 * CELL) ** 2, rel=0.1)  # the disc rounds its corners
    assert changes(report)["holes_filled"] >= 36
    bridged = np.abs(errors(terrain)).max()
    assert 0.0 < bridged < CURVATURE * 3.5**2 / 4.0
    assert_no_silent_hole(terrain, report)


def test_bays_of_the_edge_are_filled_but_ground_is_not_continued():
    z = without(grid(), slice(0, 20), slice(30, 34))
    wide = np.pad(z, 10, constant_values=np.nan)
    terrain, report = load(wide, cell=CELL)
    low, high = terrain.extent
    np.testing.assert_allclose(low[:2], 5.0)
    np.testing.assert_allclose(high[:2], 5.0 + SIZE)
    # only the mouth of the bay, where the disc leaves it, may stay open
    assert sum(hole.area_m2 for hole in report.holes) < 2.5 * 2.5 + 4 * (2 * SIZE + 10.0) * 5.0
    assert changes(report)["holes_filled"] > 0.8 * 80


def test_spikes_go_and_steps_stay():
    z = grid()
    z[20, 30], z[50, 51:53], z[60, 10] = 40.0, -20.0, 6.0
    z[:, 60:] += 1.0  # a ledge
    terrain, report = load(z, cell=CELL)
    assert changes(report)["spikes_removed"] == 4
    x, y, height_ = terrain.vertices.T
    assert np.abs(height_ - height(x, y) - (x >= 60 * CELL)).max() < CURVATURE * 4 * CELL**2


def test_flipped_double_and_floating_triangles(tmp_path):
    mesh = surface()
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    faces = np.concatenate([faces, faces[:50], [[0, 0, 1]]])
    bird = len(mesh.vertices) + np.arange(3)
    vertices = np.concatenate([mesh.vertices, [[5.0, 5.0, 9.0], [6.0, 5.0, 9.0], [5.0, 6.0, 9.0]]])
    trimesh.Trimesh(vertices, np.concatenate([faces, [bird]]), process=False).export(tmp_path / "ground.ply")
    terrain, report = load(tmp_path / "ground.ply")
    found = changes(report)
    assert found["duplicate_triangles"] == 50
    assert found["degenerate_triangles"] == 1
    assert found["pieces_removed"] == 1
    assert found["flipped_triangles"] == pytest.approx(len(mesh.faces) / 3, abs=51)
    assert len(terrain.faces) == len(mesh.faces)
    a, b, c = (terrain.vertices[terrain.faces[:, i]] for i in range(3))
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0.0)
    assert np.abs(errors(terrain)).max() < 1e-4


def test_a_roof_over_the_ground_is_an_overhang(tmp_path):
    roof = trimesh.creation.box([8.0, 8.0, 0.4], trimesh.transformations.translation_matrix([20.0, 20.0, 9.0]))
    trimesh.util.concatenate([surface(), roof]).export(tmp_path / "ground.ply")
    terrain, report = load(tmp_path / "ground.ply")
    assert changes(report)["overhangs_removed"] == pytest.approx(8.0**2 / 0.25**2, rel=0.1)
    assert np.abs(errors(terrain)).max() < BILINEAR + 1e-4
    assert_no_silent_hole(terrain, report)


def test_missing_triangles_are_noticed(tmp_path):
    mesh = surface()
    gone = np.ones(len(mesh.faces), dtype=bool)
    gone[3000] = False
    trimesh.Trimesh(mesh.vertices, mesh.faces[gone], process=False).export(tmp_path / "ground.ply")
    terrain, report = load(tmp_path / "ground.ply")
    assert any("it has holes" in change.text for change in report.changes)
    assert not uncovered(terrain, mesh.triangles_center[~gone][:, :2]).any()
    assert np.abs(errors(terrain)).max() < BILINEAR + 1e-4


def test_a_solid_becomes_its_upper_side(tmp_path):
    trimesh.creation.box([30.0, 20.0, 2.0]).export(tmp_path / "box.stl")
    terrain, report = load(tmp_path / "box.stl")
    assert changes(report)["undersides_removed"] == 2
    np.testing.assert_allclose(terrain.vertices[:, 2].max(), 1.0, atol=1e-6)
    assert report.slope_median_deg == 0.0
    assert any("level" in text for text in report.warnings)


def test_buildings_are_taken_off_a_surface_model(tmp_path):
    z = grid()
    z[30:46, 30:46] += 5.0  # 8 m wide
    _, kept = load(write_raster(tmp_path / "ground.tif", z))
    terrain, report = load(tmp_path / "ground.tif", ground="filter", hole_limit=12.0)
    assert changes(report)["obstacles_removed"] >= 16 * 16
    assert kept.slope_max_deg > 70.0
    assert report.slope_max_deg < 20.0
    assert np.abs(errors(terrain, (*UTM, 0.0))).max() < CURVATURE * 9.0**2 / 4.0


def test_a_height_normalised_cloud_is_said(tmp_path):
    points, classes = cloud()
    points[:, 2] = np.where(classes == 2, 0.0, points[:, 2])
    _, report = load(write_las(tmp_path / "flat.laz", points, classes, shift=(*UTM, 0.0)))
    assert any(text.startswith("height-normalised cloud") for text in report.warnings)
    _, hilly = load(write_las(tmp_path / "hilly.laz", *cloud()))
    assert not any("normalised" in text for text in hilly.warnings)


# --- refusals ---


def broken_files(folder: Path) -> dict[str, tuple[Path, str]]:
    """Name to a file and what its error says."""
    rng = np.random.default_rng(5)
    files: dict[str, tuple[Path, str]] = {}

    def put(name: str, content: bytes | None, message: str) -> Path:
        path = folder / name
        if content is not None:
            path.write_bytes(content)
        files[name] = (path, message)
        return path

    surface().export(folder / "whole.ply")
    whole = (folder / "whole.ply").read_bytes()
    put("empty.ply", b"", "the file is empty")
    put("cut.ply", whole[: len(whole) // 2], "declares 6,561 vertices and 12,800 faces")
    put("noise.laz", rng.bytes(5000), "does not begin as a point cloud")
    las = write_las(folder / "whole.laz", *cloud()).read_bytes()
    put("cut.laz", las[: len(las) // 2], "cut off|cannot be read as a point cloud")
    write_raster(put("voids.tif", None, "there is no ground in it"), np.full((20, 20), np.nan))
    put("words.csv", b"tree,height\noak,12\n", "no line of numbers x, y, z|columns are named tree, height")
    put("nothing.xyz", b"1 2 3\n", "1 points are no ground")
    put("what.docx", b"x", "terrains end in one of")
    np.save(put("cube.npy", None, "have the shape"), np.zeros((3, 3, 3)))
    mesh = surface()
    mesh.vertices[:] = np.nan
    mesh.export(put("nan.ply", None, "finite corners"))
    trimesh.creation.box([0.2, 0.1, 0.1]).export(put("toy.stl", None, "needs at least 25 m²"))
    wall = trimesh.Trimesh([[0, 0, 0], [50, 0, 0], [50, 0, 50], [0, 0, 50]], [[0, 1, 2], [0, 2, 3]], process=False)
    wall.export(put("wall.ply", None, "stand upright|no ground"))
    with rasterio.open(
        put("photo.tif", None, "it is a picture"),
        "w",
        driver="GTiff",
        height=9,
        width=9,
        count=3,
        dtype="uint8",
        crs="EPSG:32632",
        transform=rasterio.Affine(1.0, 0.0, 0.0, 0.0, -1.0, 9.0),
    ) as file:
        file.write(np.zeros((3, 9, 9), dtype="uint8"))
    steep = np.add.outer(np.zeros(40), 5.0 * np.arange(40.0))
    write_raster(put("cliff.tif", None, "nothing can drive on it"), steep)
    return files


def test_broken_files_are_refused_in_one_sentence(tmp_path):
    wishes = {
        "cliff.tif": {"z_units": "m"},
        "wall.ply": {"up": "z"},
        "cube.npy": {"cell": CELL},
        "toy.stl": {"units": "m"},
    }
    for name, (path, message) in broken_files(tmp_path).items():
        with pytest.raises(TerrainError, match=message) as caught:
            load(path, **wishes.get(name, {}))
        assert "\n" not in str(caught.value), name
        assert str(path) in str(caught.value) or path.name in str(caught.value), name


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"units": "yards"}, "units is 'yards'; choose one of:"),
        ({"z_units": "yards"}, "z_units is 'yards'; choose one of:"),
        ({"up": "w"}, "up is 'w'; choose one of:"),
        ({"ground": "grass"}, "ground is 'grass'; choose one of:"),
        ({"cell": 0.0}, r"cell is 0 m, but must be in \[0.01, 100\] m"),
        ({"cell": np.nan}, "cell is nan m, but"),
        ({"hole_limit": -1.0}, "hole_limit is -1 m, but"),
        ({"window": (0.0, 0.0, 0.0, 1.0)}, "west < east"),
        ({}, "give cell="),
        ({"cell": 0.5, "friction": 3.0}, "friction is 3"),
    ],
)
def test_wrong_wishes_are_refused(options, message):
    with pytest.raises(TerrainError, match=message):
        load(grid(), **options)


def test_missing_file():
    with pytest.raises(FileNotFoundError):
        load("none.ply")


def test_missing_library_is_named(tmp_path, monkeypatch):
    path = write_raster(tmp_path / "ground.tif")
    monkeypatch.setitem(__import__("sys").modules, "rasterio", None)
    with pytest.raises(ValueError, match=r"needs rasterio: pip install 'aoro-gym\[terrain\]'"):
        load(path)


def _tilted_cloud(path, rise):
    """A strip of 50 m x 10 m of points, whose southern half climbs by ``rise`` [m/m], and z of a plane in the north."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(0.0, 10.1, 0.5), np.arange(0.0, 50.1, 0.5)))
    z = 150.0 + 0.02 * x + rise * np.maximum(y - 25.0, 0.0)
    path.write_text("".join(f"{a:.2f} {b:.2f} {c:.3f}\n" for a, b, c in zip(x, y, z, strict=True)))
    return path


def test_ground_that_a_filter_loses_is_named(tmp_path):
    report = load(_tilted_cloud(tmp_path / "steep.xyz", 3.0), ground="filter", cell=0.5).report
    assert any("m of the 10 m x 50 m that the points cover" in warning for warning in report.warnings)
    for rise in (0.0, 0.2):
        terrain, report = load(_tilted_cloud(tmp_path / "mild.xyz", rise), ground="filter", cell=0.5)
        np.testing.assert_allclose(np.ptp(terrain.vertices, axis=0), (10.0, 50.0, 0.2 + 25.0 * rise), atol=0.6)
        assert not any("that the points cover" in warning for warning in report.warnings)


def test_options_that_a_format_has_no_place_for(tmp_path):
    cloud = _tilted_cloud(tmp_path / "a.xyz", 0.0)
    with pytest.raises(TerrainError, match=r"a\.xyz: only a raster has bands; drop band=\.\.\. \(--band\)"):
        load(cloud, band=1)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 20 0 0\nv 20 20 1\nv 0 20 1\nf 1 2 3\nf 1 3 4\n")
    assert any("nodata is passed over" in warning for warning in load(tmp_path / "a.obj", nodata=0).report.warnings)
    assert not load(tmp_path / "a.obj", nodata=()).report.warnings


def test_a_spike_is_named_by_the_height_that_counts_on_its_cells(tmp_path):
    for cell, limit in ((0.1, "0.5"), (2.0, "3.5")):
        heights = np.add.outer(np.arange(60.0), np.zeros(60)) * 0.01 * cell
        heights[30, 30] += 20.0
        report = load(heights, cell=cell).report
        assert [c.text for c in report.changes if c.what == "spikes_removed"] == [
            f"1 heights that stuck out by more than {limit} m removed"
        ]
