"""The ground under a contact: planes against geometry, triangles against their closed form, rasters against triangles."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.raster import CELL
from aoro_gym.terrains.survey import HEADROOM, PATCH, REACH
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.grounds import KINDS, Grounds
from aoro_gym.twin.physics.ground import Footing, Planes, ceiling, footing, ground_height, penetration
from tests.twin.landscapes import AVERAGED
from tests.twin.physics.launch import ROUNDOFF, columns, launch, record, rounded

HUB = 0.6
"""Height [m] over the ground that the triangles are asked from."""


# ------------------------------------------------------------------------------------------------------------ one footing
@wp.kernel(enable_backward=False)
def plane_kernel(
    ground: wp.array(dtype=Footing),
    point: wp.array(dtype=wp.vec3),
    height: wp.array(dtype=float),
    depth: wp.array(dtype=float),
):
    i = wp.tid()
    p = point[i]
    height[i] = ground_height(ground[i], p[0], p[1])
    depth[i] = penetration(ground[i], p)


def slopes(count=1000):
    """Footings of up to 45 degrees anywhere within 100 m of the origin, and points within 100 m of it."""
    rng = np.random.default_rng(1)
    tilt, heading = rng.uniform(0.0, np.pi / 4, count), rng.uniform(0.0, 2 * np.pi, count)
    normal = np.stack([np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), np.cos(tilt)], axis=-1)
    x, y, height = rng.uniform(-100.0, 100.0, (3, count))
    ground = record(Footing, x=x, y=y, height=height, normal=normal, friction=1.0, rolling_resistance=1.0, known=1.0)
    return ground, rounded(rng.uniform(-100.0, 100.0, (count, 3)))


# n·p of three terms of up to 200 m: eight roundings of a term, and a division by n_z ≥ 0.7
TOLERANCE = 10.0 * ROUNDOFF * 200.0 * np.sqrt(3.0) / 0.7


def test_height_lies_on_the_footings_plane():
    ground, point = slopes()
    height, _ = launch(plane_kernel, ground, point)
    g = columns(ground)
    way = np.column_stack([point[:, 0] - g.x, point[:, 1] - g.y, height - g.height])
    assert np.all(np.abs(np.sum(g.normal * way, axis=-1)) <= TOLERANCE)


def test_height_rises_against_the_normals_lean():
    """A plane whose normal leans back climbs forwards."""
    climb = np.radians(10.0)
    normal = [-np.sin(climb), 0.0, np.cos(climb)]
    rest = {"x": 1.0, "y": 7.0, "height": 2.0, "friction": 1.0, "rolling_resistance": 1.0, "known": 1.0}
    height, _ = launch(plane_kernel, record(Footing, normal=normal, **rest), [[5.0, 3.0, 0.0]])
    np.testing.assert_allclose(height, 2.0 + 4.0 * np.tan(climb), rtol=8 * ROUNDOFF)


def test_depth_is_the_distance_from_the_plane():
    ground, point = slopes()
    _, depth = launch(plane_kernel, ground, point)
    g = columns(ground)
    way = point - np.column_stack([g.x, g.y, g.height])
    distance = np.sum(g.normal * way, axis=-1) / np.linalg.norm(g.normal, axis=-1)
    assert np.all(np.abs(depth + distance) <= TOLERANCE)
    assert np.any(depth > 0.0)
    assert np.any(depth < 0.0)


# --------------------------------------------------------------------------------------------------------------- queries
def footing_kernel(
    terrain: Any, point: wp.array(dtype=wp.vec3), out: wp.array(dtype=Footing), top: wp.array(dtype=float)
):
    i = wp.tid()
    ground = terrain.twins[0]
    out[i] = footing(terrain, ground, point[i])
    top[i] = ceiling(terrain, ground, point[i][0], point[i][1])


KERNELS = {
    kind: wp.overload(
        wp.kernel(footing_kernel, enable_backward=False, module=f"tests.footing.{kind.key}"), {"terrain": kind}
    )
    for kind in (Planes, *(KINDS[name] for name in AVERAGED))
}


def ask(grounds: Grounds, points: Any) -> tuple[SimpleNamespace, np.ndarray]:
    """Footings (fields of shape (N,) and (N, 3)) and ceilings under ``points`` (N, 3)."""
    point = wp.array(np.asarray(points, np.float32), dtype=wp.vec3, device="cpu")
    out = wp.zeros(len(point), dtype=Footing, device="cpu")
    top = wp.zeros(len(point), dtype=float, device="cpu")
    struct = grounds.device_struct
    wp.launch(KERNELS[type(struct)._cls], dim=len(point), inputs=[struct, point], outputs=[out, top], device="cpu")
    return columns(out.numpy()), top.numpy().astype(float)


def on(terrain: Any, kind: str = "raster", **options: Any) -> Grounds:
    return Grounds(terrain, num_twins=1, kind=kind, **options)


def grid(height: Any, *, cell: float = 0.1, size: float = 12.0, **options: Any) -> Terrain:
    """Terrain of ``height(x, y)`` over [0, size]²."""
    x = cell * np.arange(round(size / cell) + 1)
    return Terrain.from_heights(np.broadcast_to(height(x[None, :], x[:, None]), (len(x), len(x))), cell=cell, **options)


def places(count: int, size: float = 12.0, margin: float = PATCH, seed: int = 0) -> np.ndarray:
    """Plan positions (N, 2), float32, at least ``margin`` inside."""
    return rounded(np.random.default_rng(seed).uniform(margin, size - margin, (count, 2)))


def above(plan: np.ndarray, height: Any) -> np.ndarray:
    """Points (N, 3) as high as a hub above ``height(x, y)``."""
    return np.column_stack([plan, height(*plan.T) + HUB])


def slope_of(answer: SimpleNamespace) -> np.ndarray:
    return -answer.normal[:, :2] / answer.normal[:, 2:]


# -------------------------------------------------------------------------------------------------------------- planes
def test_a_plane_goes_through_the_origin_everywhere():
    plane = Plane(slope_deg=17.0, direction_deg=40.0, friction=0.7, rolling_resistance=3.0)
    points = np.column_stack([places(100) - 6.0, np.zeros(100)])
    answer, top = ask(Grounds(plane, num_twins=1), points)
    np.testing.assert_allclose(answer.normal, np.tile(plane.normal, (100, 1)), atol=ROUNDOFF)
    along = np.sum(
        answer.normal * np.column_stack([points[:, 0] - answer.x, points[:, 1] - answer.y, 0.0 * points[:, 2]]), 1
    )
    expected = plane.height(*points[:, :2].T)
    np.testing.assert_allclose(answer.height - along / answer.normal[:, 2], expected, atol=TOLERANCE)
    np.testing.assert_allclose(top, expected, atol=TOLERANCE)
    assert np.all(answer.known == 1.0)
    np.testing.assert_allclose(answer.friction, 0.7, rtol=ROUNDOFF)
    np.testing.assert_allclose(answer.rolling_resistance, 3.0, rtol=ROUNDOFF)


@pytest.mark.parametrize("kind", AVERAGED)
def test_a_triangulated_plane_is_a_plane(kind):
    """However it is cut into triangles: corners at random. Heights come from rays of float32 among coordinates of 12 m
    and heights of 5 m: sixteen roundings of that; slopes from two of them over the chord."""

    def plane(x, y):
        return 0.31 * x - 0.17 * y + 1.0

    rng = np.random.default_rng(3)
    base = grid(lambda x, y: 0.0 * x + 0.0 * y, cell=0.5)
    vertices = np.array(base.vertices)
    inner = np.all((vertices[:, :2] > 0.1) & (vertices[:, :2] < 11.9), axis=1)
    vertices[inner, :2] += rng.uniform(-0.2, 0.2, (inner.sum(), 2))
    vertices[:, 2] = plane(*vertices[:, :2].T)
    terrain = Terrain(vertices=vertices, faces=base.faces)
    points = above(places(2000, margin=PATCH + CELL), plane)
    answer, _ = ask(on(terrain, kind), points)
    tolerance = 16.0 * 2.0 * ROUNDOFF * 12.0
    np.testing.assert_allclose(answer.height, plane(*points[:, :2].T), atol=tolerance)
    np.testing.assert_allclose(
        slope_of(answer), np.tile([0.31, -0.17], (2000, 1)), atol=2.0 * tolerance / (2.0 * PATCH)
    )
    assert np.all(answer.known == 1.0)


# --------------------------------------------------------------------------------------------------------- definition
def rough(cell: float, size: float = 12.0, seed: int = 5) -> tuple[Terrain, Any]:
    """Heights at random, ± 0.2 m, and the closed form of their triangles."""
    count = round(size / cell) + 1
    z = rounded(np.random.default_rng(seed).uniform(-0.2, 0.2, (count, count)))

    def surface(x, y):
        u, v = np.clip(x / cell, 0, count - 1.001), np.clip(y / cell, 0, count - 1.001)
        i, j = u.astype(int), v.astype(int)
        a, b, c, d = z[j, i], z[j, i + 1], z[j + 1, i + 1], z[j + 1, i]
        u, v = u - i, v - j
        return np.where(u > v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))

    return Terrain.from_heights(z, cell=cell), surface


def effective(surface: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Height and slopes by the definition."""
    east, west = surface(x + PATCH, y), surface(x - PATCH, y)
    north, south = surface(x, y + PATCH), surface(x, y - PATCH)
    return 0.25 * (east + west + north + south), np.stack([east - west, north - south], axis=-1) / (2.0 * PATCH)


def test_triangles_give_the_effective_road_plane():
    """Slopes of up to 0.8 between the vertices carry a rounding of 12 m into the heights."""
    terrain, surface = rough(0.5)
    points = above(places(3000), surface)
    answer, _ = ask(on(terrain, "mesh"), points)
    height, slope = effective(surface, *points[:, :2].T)
    tolerance = 16.0 * ROUNDOFF * 12.0
    np.testing.assert_allclose(answer.height, height, atol=tolerance)
    np.testing.assert_allclose(slope_of(answer), slope, atol=2.0 * tolerance / (2.0 * PATCH))


def test_nodes_of_the_raster_are_the_triangles():
    terrain, surface = rough(0.5)
    x, y = np.meshgrid(CELL * np.arange(1, 47), CELL * np.arange(1, 47))
    points = above(np.column_stack([x.ravel(), y.ravel()]), surface)
    exact, _ = ask(on(terrain, "mesh"), points)
    answer, _ = ask(on(terrain, "raster"), points)
    tolerance = 16.0 * ROUNDOFF * 12.0
    np.testing.assert_allclose(answer.height, exact.height, atol=tolerance)
    np.testing.assert_allclose(answer.normal, exact.normal, atol=2.0 * tolerance / (2.0 * PATCH))


def test_raster_and_triangles_agree_on_smooth_ground():
    """z = A sin kx cos ky: linear interpolation errs by h² k² A/8 along each axis, in the heights; in the slopes, whose
    own curvature is k³ A, by h² k³ A/8. The triangles' facets of 0.1 m, which both see, err by their own h² k² A/8."""
    a, k, facet = 0.5, 0.8, 0.1

    def waves(x, y):
        return a * np.sin(k * x) * np.cos(k * y)

    points = above(places(5000, margin=PATCH + CELL), waves)
    terrain = grid(waves, cell=facet)
    exact, _ = ask(on(terrain, "mesh"), points)
    answer, _ = ask(on(terrain, "raster"), points)
    bound = 2.0 * (CELL**2 + facet**2) * k**2 * a / 8.0
    assert bound < 6e-3
    gap = np.abs(answer.height - exact.height)
    assert 0.3 * bound < gap.max() < min(bound, 5e-3)
    # facets change the slope by k² A h in steps, which the chord averages over four of them
    assert np.abs(slope_of(answer) - slope_of(exact)).max() < 2.0 * CELL**2 * k**3 * a / 8.0 + k**2 * a * facet
    # against the formula: the chord's mean lies κ PATCH²/4 off an axis, its slope PATCH²/6 k³ A
    height, slope = effective(waves, *points[:, :2].T)
    assert np.abs(exact.height - height).max() < 2.0 * facet**2 * k**2 * a / 8.0
    assert np.abs(slope_of(exact) - slope).max() < 4.0 * facet**2 * k**2 * a / 8.0 / PATCH


@pytest.mark.parametrize("kind", AVERAGED)
def test_slope_changes_gradually_over_an_edge(kind):
    """A ridge of ± 0.3: over d of way the slope changes by no more than d/(2 PATCH) times the kink, plus roundings; the
    raster, which interpolates between nodes of that same function, no faster."""

    def ridge(x, y):
        return -0.3 * np.abs(x - 6.0) + 0.0 * y

    x = np.arange(5.0, 7.0, 0.01)
    points = above(np.column_stack([x, np.full_like(x, 6.1)]), ridge)
    answer, _ = ask(on(grid(ridge), kind), points)
    slope = slope_of(answer)[:, 0]
    assert slope[0] == pytest.approx(0.3, abs=1e-4)
    assert slope[-1] == pytest.approx(-0.3, abs=1e-4)
    assert np.abs(np.diff(slope)).max() <= 0.6 * 0.01 / (2.0 * PATCH) + 1e-4
    assert np.all(np.diff(slope) <= 1e-4)


# -------------------------------------------------------------------------------------------------------------- multipliers
@pytest.mark.parametrize("kind", AVERAGED)
def test_multipliers_blend_between_zones(kind):
    """Ice west of x = 6 m, mud east of it: constant inside, and in between linear over the triangles' cell, the patch and
    the raster's cell; the twin's own multipliers come on top."""
    x = 0.5 * np.arange(25)
    ice = np.broadcast_to(np.where(x < 5.9, 0.1, 0.6), (25, 25))
    mud = np.broadcast_to(np.where(x < 5.9, 1.0, 8.0), (25, 25))
    terrain = Terrain.from_heights(np.zeros((25, 25)), cell=0.5, friction=ice, rolling_resistance=mud)
    grounds = on(terrain, kind)
    along = np.linspace(0.5, 11.5, 221)
    points = np.column_stack([along, np.full_like(along, 3.3), np.full_like(along, HUB)])
    answer, _ = ask(grounds, points)
    reach = 0.5 + PATCH + CELL
    west, east = along < 6.0 - reach, along > 6.0 + PATCH + CELL
    np.testing.assert_allclose(answer.friction[west], 0.1, rtol=1e-5)
    np.testing.assert_allclose(answer.friction[east], 0.6, rtol=1e-5)
    np.testing.assert_allclose(answer.rolling_resistance[west], 1.0, rtol=1e-5)
    np.testing.assert_allclose(answer.rolling_resistance[east], 8.0, rtol=1e-5)
    assert np.all(np.diff(answer.friction) > -1e-6)
    assert np.abs(np.diff(answer.friction)).max() <= 0.5 * 0.05 / 0.5 + 1e-5  # no steeper than between the vertices
    grounds.set_multipliers(np.array([0], np.int32), 0.5, None)
    again, _ = ask(grounds, points)
    np.testing.assert_allclose(again.friction, 0.5 * answer.friction, rtol=1e-6)
    np.testing.assert_array_equal(again.rolling_resistance, answer.rolling_resistance)


# -------------------------------------------------------------------------------------------------- edges, holes, overhangs
@pytest.mark.parametrize("kind", AVERAGED)
def test_beyond_the_edge_the_ground_goes_on_level(kind):
    def slope(x, y):
        return 0.1 * x + 0.2 * y

    grounds = on(grid(slope, cell=0.5), kind)
    outside = np.array(
        [[-3.0, 5.0], [30.0, 5.0], [5.0, -1.0], [5.0, 99.0], [-1e6, 1e6], [np.inf, 5.0], [np.nan, np.nan]]
    )
    answer, top = ask(grounds, np.column_stack([outside, np.full(len(outside), 1.0)]))
    clamped = np.clip(np.nan_to_num(outside, nan=0.0, posinf=12.0), 0.0, 12.0)
    # the outermost nodes know ground on three or two of their four sides only
    np.testing.assert_allclose(answer.height, slope(*clamped.T), atol=0.3 * PATCH)
    assert np.all(answer.known == 0.0)
    assert np.all(np.isfinite(answer.normal))
    assert np.all(slope_of(answer)[:2, 0] == 0.0)  # no slope across the edge, along which the height stays
    assert np.all(slope_of(answer)[2:4, 1] == 0.0)
    assert np.all(top >= answer.height)
    inside, _ = ask(grounds, [[6.0, 6.0, slope(6.0, 6.0) + HUB]])
    assert inside.known[0] == 1.0


@pytest.mark.parametrize("kind", AVERAGED)
def test_a_hole_is_bridged_and_named(kind):
    """A lake that the scan left out: level with its shore, and not known."""
    x = 0.5 * np.arange(25)
    z = np.full((25, 25), 2.0)
    z[np.hypot(x[None, :] - 6.0, x[:, None] - 6.0) < 2.0] = np.nan
    answer, _ = ask(on(Terrain.from_heights(z, cell=0.5), kind), [[6.0, 6.0, 2.0 + HUB], [1.0, 1.0, 2.0 + HUB]])
    np.testing.assert_allclose(answer.height, 2.0, atol=1e-6)
    np.testing.assert_allclose(answer.normal[:, 2], 1.0, atol=1e-6)
    assert answer.known.tolist() == [0.0, 1.0]


def stacked(*levels: float) -> Terrain:
    """Level ground at zero, with a plate of 4 m x 4 m at each of ``levels`` over its middle."""
    base = grid(lambda x, y: 0.0 * x + 0.0 * y, cell=1.0)
    vertices, faces = [base.vertices], [base.faces]
    for level in levels:
        faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + sum(len(v) for v in vertices))
        vertices.append(np.array([[4.0, 4.0, level], [8.0, 4.0, level], [8.0, 8.0, level], [4.0, 8.0, level]]))
    return Terrain(vertices=np.concatenate(vertices), faces=np.concatenate(faces))


@pytest.mark.parametrize("kind", AVERAGED)
def test_wheels_drive_below_overhangs_and_over_obstacles(kind):
    """A roof, and a roof over a plinth, are not the ground; a plinth is. From a hub, what is within reach counts."""
    low = 0.9 * (HUB + REACH)
    for levels, expected in (
        ((HEADROOM + 0.1,), 0.0),
        ((low,), low),
        ((low, low + HEADROOM + 0.1), low),
        ((0.3, 0.6), 0.6),
    ):
        answer, top = ask(on(stacked(*levels), kind), [[6.0, 6.0, HUB], [2.0, 2.0, HUB]])
        np.testing.assert_allclose(answer.height, [expected, 0.0], atol=1e-5)
        assert top[0] >= answer.height[0]


@pytest.mark.parametrize("kind", AVERAGED)
def test_no_ground_is_above_its_ceiling(kind):
    """Over rough triangles larger and smaller than the raster's cells; and the ceiling is of use: it follows the ground."""
    for cell in (0.1, 0.7, 3.0):
        terrain, surface = rough(cell, size=12.6 if cell == 0.7 else 12.0)
        points = above(places(3000, margin=0.0), surface)
        answer, top = ask(on(terrain, kind), points)
        assert np.all(top >= answer.height - 1e-6)
    assert np.mean(top - answer.height) < 0.15


def test_terrains_stand_side_by_side():
    """Every twin is on its own of several terrains of different size, and keeps its multipliers when it moves."""
    terrains = [grid(lambda x, y, h=h: h + 0.0 * x + 0.0 * y, cell=0.5, size=4.0 + h) for h in (1.0, 2.0, 3.0)]
    for kind in AVERAGED:
        grounds = Grounds(terrains, num_twins=2, kind=kind)
        assert grounds.count == 3
        sites = grounds.device_struct.terrains.numpy()
        twins = grounds.device_struct.twins.numpy()
        for number in range(3):
            for name in ("x", "y", "inverse_cell", "columns", "rows", "first", "mesh"):
                twins[name][0] = sites[name][number]
            grounds.device_struct.twins.assign(twins)
            answer, _ = ask(grounds, [[2.0, 2.0, number + 1.0 + HUB]])
            np.testing.assert_allclose(answer.height, number + 1.0, atol=1e-6)


# --------------------------------------------------------------------------------------------------------------- errors
@pytest.mark.parametrize(
    ("terrain", "options", "message"),
    [
        (Plane(), {"kind": "voxels"}, "ground is 'voxels'; choose one of: raster, mesh"),
        ([], {}, "terrain is empty; give a Plane, a Terrain or World, or a sequence of them"),
        ([Plane()], {}, "terrain holds a Plane; give a Plane, a Terrain or World, or a sequence of them"),
        (Plane(friction=np.ones(3)), {}, "the terrain has 3 variants, but must have 1 or num_twins = 1"),
    ],
)
def test_errors_name_the_fix(terrain, options, message):
    with pytest.raises(ValueError, match=message):
        Grounds(terrain, num_twins=1, **options)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("friction", 3.0, r"friction is 3, but must be in \[0.01, 2\]"),
        ("friction", np.nan, r"friction is nan, but must be in \[0.01, 2\]"),
        ("rolling_resistance", -1.0, r"rolling_resistance is -1, but must be in \[0, 50\]"),
        ("rolling_resistance", np.ones(2), r"rolling_resistance has shape \(2,\), but must be a scalar or \(1,\)"),
    ],
)
def test_multipliers_are_checked(name, value, message):
    given = {"friction": None, "rolling_resistance": None, name: value}
    with pytest.raises(ValueError, match=message):
        on(Plane()).set_multipliers(np.array([0], np.int32), **given)
