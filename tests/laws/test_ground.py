"""The plane: heights, normals and depths against analytic geometry."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import warp as wp

from aoro_gym.twin.laws.ground import Ground, ground_height, ground_normal, penetration
from tests.laws.launch import ROUNDOFF, columns, launch, record, rounded


@wp.kernel(enable_backward=False)
def ground_kernel(
    ground: wp.array(dtype=Ground),
    point: wp.array(dtype=wp.vec3),
    height: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
    depth: wp.array(dtype=float),
):
    i = wp.tid()
    p = point[i]
    height[i] = ground_height(ground[i], p[0], p[1])
    normal[i] = ground_normal(ground[i], p[0], p[1])
    depth[i] = penetration(ground[i], p, ground_normal(ground[i], p[0], p[1]))


def slopes(count=1000):
    """Planes of up to 45 degrees and points within 100 m of the origin."""
    rng = np.random.default_rng(1)
    tilt, heading = rng.uniform(0.0, np.pi / 4, count), rng.uniform(0.0, 2 * np.pi, count)
    normal = np.stack([np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), np.cos(tilt)], axis=-1)
    ground = record(Ground, normal=normal, friction=1.0, rolling_resistance=1.0, gravity=9.81)
    point = rounded(rng.uniform(-100.0, 100.0, (count, 3)))
    return ground, point


# n·p of three terms of up to 100 m: six roundings of a term, and a division by n_z ≥ 0.7
TOLERANCE = 8.0 * ROUNDOFF * 100.0 * np.sqrt(3.0) / 0.7


def test_height_lies_on_the_plane_through_the_origin():
    ground, point = slopes()
    height, _, _ = launch(ground_kernel, ground, point)
    n = columns(ground).normal
    on_plane = np.column_stack([point[:, :2], height])
    assert np.all(np.abs(np.sum(n * on_plane, axis=-1)) <= TOLERANCE)


def test_height_rises_against_the_normals_lean():
    """A plane whose normal leans back climbs forwards."""
    climb = np.radians(10.0)
    ground = record(
        Ground, normal=[-np.sin(climb), 0.0, np.cos(climb)], friction=1.0, rolling_resistance=1.0, gravity=9.81
    )
    height, _, _ = launch(ground_kernel, ground, [[5.0, 3.0, 0.0]])
    np.testing.assert_allclose(height, 5.0 * np.tan(climb), rtol=8 * ROUNDOFF)


def test_normal_is_the_planes_and_perpendicular_to_its_heights():
    ground, point = slopes()
    _, normal, _ = launch(ground_kernel, ground, point)
    np.testing.assert_array_equal(normal, columns(ground).normal)
    other = rounded(point + np.array([1.0, 2.0, 0.0]))
    here, there = (launch(ground_kernel, ground, p)[0] for p in (point, other))
    along = np.column_stack([other[:, :2] - point[:, :2], there - here])
    assert np.all(np.abs(np.sum(normal * along, axis=-1)) <= 2 * TOLERANCE)


def test_depth_is_the_distance_from_the_plane():
    ground, point = slopes()
    _, _, depth = launch(ground_kernel, ground, point)
    n = columns(ground).normal
    distance = np.sum(n * point, axis=-1) / np.linalg.norm(n, axis=-1)
    assert np.all(np.abs(depth + distance) <= TOLERANCE)
    assert np.any(depth > 0.0)
    assert np.any(depth < 0.0)
