"""Paths against closed forms: straight line, circle, clothoid; projection against every point of the path."""

import re

import numpy as np
import pytest
from scipy.special import fresnel

from aoro_gym.terrains.paths.path import MOST_POINTS, Path

RADIUS = 6.0


def at(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, dtype=float)


def circle(count: int, radius: float = RADIUS, turn: float = 1.0) -> Path:
    """A closed circle from (0, 0), heading along x; to the left for ``turn`` = 1, to the right for -1."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return Path(radius * np.stack([np.sin(angle), turn * (1.0 - np.cos(angle))], axis=1), closed=True)


def clothoid(sharpness: float, length: float, spacing: float) -> tuple[Path, np.ndarray]:
    """A path whose curvature is ``sharpness`` [1/m²] times its arc length, and the arc length at its points."""
    s = np.linspace(0.0, length, round(length / spacing) + 1)
    scale = np.sqrt(np.pi / sharpness)
    sine, cosine = fresnel(s / scale)
    return Path(scale * np.stack([cosine, sine], axis=1)), s


def test_straight_line():
    path = Path(at((1.0, 2.0), (4.0, 6.0), (7.0, 10.0)))
    assert path.length == pytest.approx(10.0)
    np.testing.assert_allclose(path.stations, [0.0, 5.0, 10.0])
    s = np.array([[0.0, 2.5], [10.0, 7.0]])
    np.testing.assert_allclose(path.position(s), np.array([1.0, 2.0]) + s[..., None] * [0.6, 0.8])
    np.testing.assert_allclose(path.heading(s), np.arctan2(4.0, 3.0))
    np.testing.assert_allclose(path.curvature(s), 0.0, atol=1e-12)
    np.testing.assert_allclose(path.position([-3.0, 99.0]), path.points[[0, -1]])


@pytest.mark.parametrize("turn", [1.0, -1.0])
@pytest.mark.parametrize("count", [8, 100])
def test_circle(count, turn):
    path = circle(count, turn=turn)
    # the perimeter of the inscribed polygon
    assert path.length == pytest.approx(2.0 * count * RADIUS * np.sin(np.pi / count))
    s = path.length * np.linspace(-0.7, 2.3, 301)
    np.testing.assert_allclose(path.curvature(s), turn / RADIUS)
    around = 2.0 * np.pi * s / path.length * turn
    np.testing.assert_allclose(np.angle(np.exp(1j * (path.heading(s) - around))), 0.0, atol=1e-12)
    assert np.all(np.abs(path.heading(s)) <= np.pi)
    # between its points a polygon lies inside by at most the sagitta
    offset = RADIUS - np.hypot(*(path.position(s) - [0.0, turn * RADIUS]).T)
    assert offset.min() > -1e-9
    assert offset.max() <= RADIUS * (1.0 - np.cos(np.pi / count)) + 1e-9


def test_open_arc_keeps_heading_and_curvature_to_its_ends():
    angle = np.linspace(0.0, 1.0, 11)
    path = Path(RADIUS * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1))
    np.testing.assert_allclose(path.headings, angle, atol=1e-12)
    np.testing.assert_allclose(path.curvatures, 1.0 / RADIUS)


def test_clothoid():
    sharpness, spacing = 0.01, 0.25
    path, s = clothoid(sharpness, 20.0, spacing)
    # at a point, the circle through three points h apart errs by the derivatives of curvature: κ κ'... h²; κ'' = 0
    # here leaves κ (κ² + ...) h² / 24 < 0.2³ × 0.25² / 24 and the chords' shortness of κ² h² / 24 of s
    chord = s[-1] * 0.2**2 * spacing**2 / 24
    np.testing.assert_allclose(path.stations, s, atol=chord)
    tolerance = sharpness * chord + 0.2**3 * spacing**2 / 24 + sharpness**2 * spacing**2
    np.testing.assert_allclose(path.curvatures[1:-1], sharpness * s[1:-1], atol=tolerance)
    np.testing.assert_allclose(path.headings[1:-1], (sharpness * s**2 / 2)[1:-1], atol=sharpness * spacing**2)


def test_heading_is_continuous_through_half_a_turn():
    path = circle(40)
    assert np.abs(np.diff(path.headings)).max() == pytest.approx(2.0 * np.pi / 40)
    assert path.headings[-1] == pytest.approx(2.0 * np.pi * 39 / 40)


def test_cross_track_is_positive_to_the_left():
    path = Path(at((0.0, 0.0), (10.0, 0.0)))
    s, cross_track = path.project([[2.0, 3.0], [4.0, -1.0], [5.0, 0.0]])
    np.testing.assert_allclose(s, [2.0, 4.0, 5.0])
    np.testing.assert_allclose(cross_track, [3.0, -1.0, 0.0])


def test_cross_track_of_a_circle():
    path = circle(720)
    rng = np.random.default_rng(3)
    angle, radius = rng.uniform(0, 2 * np.pi, 200), rng.uniform(0.5, 2.0, 200) * RADIUS
    xy = np.stack([radius * np.sin(angle), RADIUS - radius * np.cos(angle)], axis=1)
    s, cross_track = path.project(xy)
    sagitta = RADIUS * (1.0 - np.cos(np.pi / 720))
    np.testing.assert_allclose(cross_track, RADIUS - radius, atol=sagitta)  # inside is left
    # a foot slides along its segment by at most half of it
    apart = np.angle(np.exp(1j * (s / RADIUS - angle)))
    np.testing.assert_allclose(apart, 0.0, atol=1.1 * np.pi / 720)


@pytest.mark.parametrize("closed", [False, True])
def test_projection_is_the_nearest_point(closed):
    rng = np.random.default_rng(7)
    path = Path.spline(rng.uniform(-20, 20, (7, 2)), spacing=0.6, closed=closed)
    xy = rng.uniform(-25, 25, (50, 2))
    s, cross_track = path.project(xy)
    every = path.position(np.linspace(0.0, path.length, 20_001))
    apart = np.linalg.norm(xy[:, None] - every, axis=2).min(axis=1)
    inside = (s > 0.0) & (s < path.length)
    # the sampled points lie at most half a step from the foot, at right angles to it
    np.testing.assert_allclose(np.abs(cross_track[inside]), apart[inside], atol=path.length / 20_000)
    np.testing.assert_allclose(np.linalg.norm(path.position(s) - xy, axis=1), apart, atol=path.length / 20_000)
    ahead = path.position(s + 1e-4) - path.position(s - 1e-4)
    side = ahead[:, 0] * (xy - path.position(s))[:, 1] - ahead[:, 1] * (xy - path.position(s))[:, 0]
    assert np.array_equal(side[inside] > 0, cross_track[inside] > 0)


def test_beyond_the_ends_the_end_is_prolonged():
    path = Path(at((0.0, 0.0), (4.0, 0.0), (4.0, 4.0)))
    s, cross_track = path.project([[-3.0, 1.0], [3.5, 7.0]])
    np.testing.assert_allclose(s, [0.0, path.length])
    np.testing.assert_allclose(cross_track, [1.0, 0.5])


def test_outside_a_corner_the_distance_counts():
    s, cross_track = Path(at((0.0, 0.0), (4.0, 0.0), (4.0, 4.0))).project([7.0, -4.0])
    assert (float(s), float(cross_track)) == pytest.approx((4.0, -5.0))


@pytest.mark.parametrize("closed", [False, True])
def test_near_keeps_to_its_branch(closed):
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    eight = np.stack([12.0 * np.sin(angle), 6.0 * np.sin(2.0 * angle)], axis=1)  # crosses itself at (0, 0)
    path = Path(np.roll(eight, 30, axis=0), closed=closed)
    first, second = path.stations[30], path.stations[230]
    near = np.array([first - 2.0, second + 2.0])
    s, cross_track = path.project(np.zeros((2, 2)) + 0.01, near)
    np.testing.assert_allclose(s, [first, second], atol=0.1)
    assert np.all(np.abs(cross_track) < 0.02)
    # a branch out of reach is not found even where it is the nearest
    s, _ = path.project([0.0, 0.0], first + 8.0, reach=3.0)
    assert abs(float(s) - (first + 5.0)) < path.length / 400


def test_near_goes_on_over_the_laps_seam():
    path = circle(200)
    for near in (0.2, path.length - 0.2, -0.2, path.length + 0.2):
        for wanted in (0.5, path.length - 0.5):
            s, cross_track = path.project(path.position(wanted), near, reach=1.0)
            assert float(s) == pytest.approx(wanted)
            assert abs(float(cross_track)) < 1e-9
    s, _ = path.project(path.position(3.0), 0.0, reach=1e6)
    assert float(s) == pytest.approx(3.0)


def test_uneven_points_are_reached():
    path = Path(at((0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (9.0, 0.0), (9.1, 0.0), (30.0, 0.0)))
    near = np.array([0.0, 8.5, 29.0])
    s, _ = path.project(np.stack([near + 1.5, np.ones(3)], axis=1), near, reach=2.0)
    np.testing.assert_allclose(s, [1.5, 10.0, 30.0])


def test_projection_keeps_shapes():
    path = circle(50)
    assert all(part.shape == (2, 3) for part in path.project(np.ones((2, 3, 2)), np.zeros(3)))
    assert all(part.shape == () for part in path.project([1.0, 1.0]))
    assert all(part.shape == (0,) for part in path.project(np.zeros((0, 2)), np.zeros(0)))


@pytest.mark.parametrize("closed", [False, True])
def test_resample(closed):
    path = Path(at((0.0, 0.0), (10.0, 0.0), (10.0, 5.0)), closed=closed, speed=np.array([0.0, 2.0, 1.0]))
    even = path.resample(0.5)
    gap = np.linalg.norm(np.diff(even.points, axis=0), axis=1)
    count = round(path.length / 0.5)
    assert even.num_segments == count
    # a corner is cut by at most the difference of two sides and a diagonal
    assert gap.max() <= path.length / count + 1e-9
    np.testing.assert_allclose(np.abs(path.project(even.points)[1]), 0.0, atol=1e-9)
    assert even.speed_at(0.0) == pytest.approx(0.0)
    assert even.speed_at(5.0) == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("closed", [False, True])
def test_spline_meets_its_waypoints_with_continuous_curvature(closed):
    waypoints = np.array([[0.0, 0.0], [10.0, 2.0], [18.0, 10.0], [8.0, 16.0], [-4.0, 9.0]])
    path = Path.spline(waypoints, spacing=0.05, closed=closed)
    _, cross_track = path.project(waypoints)
    assert np.abs(cross_track).max() < 0.05**2  # sagitta of the points' spacing at these radii
    gap = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
    assert np.ptp(gap) < 0.01 * gap.mean()
    # C2: curvature has no jumps, only the slope of its slowest change between waypoints about 10 m apart
    jump = np.abs(np.diff(path.curvatures[1:-1])).max()
    assert jump < 5.0 * np.ptp(path.curvatures) * 0.05 / 5.0


def test_spline_of_a_circle_is_that_circle():
    angle = np.arange(12) * np.pi / 6
    path = Path.spline(RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1), closed=True)
    # a cubic spline's error is at most 5/384 h⁴ |f''''| [Hall and Meyer 1976], here h = π/6 of angle, |f''''| = RADIUS
    bound = 5 / 384 * (np.pi / 6) ** 4 * RADIUS * np.sqrt(2.0)
    np.testing.assert_allclose(np.hypot(*path.points.T), RADIUS, atol=bound)
    np.testing.assert_allclose(path.curvatures, 1.0 / RADIUS, rtol=0.05)


def test_two_waypoints_make_a_line():
    path = Path.spline([[0.0, 0.0], [0.0, 10.0]], spacing=1.0, speed=[0.0, 1.0])
    np.testing.assert_allclose(path.points, np.stack([np.zeros(11), np.arange(11)], axis=1), atol=1e-12)
    np.testing.assert_allclose(path.speed_at([0.0, 5.0]), [0.0, 0.5])


def test_smooth_takes_noise_out_and_leaves_the_curve():
    rng = np.random.default_rng(5)
    exact = circle(250, radius=8.0)
    noisy = Path(exact.points + rng.normal(0.0, 0.03, exact.points.shape), closed=True)
    path = noisy.smooth(5.0)
    # noise of a white spectrum through 1 / (1 + (ω/ωc)⁴): its variance falls to (3 √2 / 8) ωc step / 2
    cut = 2.0 * np.pi / 5.0
    left = 0.03 * np.sqrt(3.0 * np.sqrt(2.0) / 8.0 * cut * 0.2 / 2.0)
    shrunk = 8.0 * (5.0 / (2.0 * np.pi * 8.0)) ** 4
    radius = np.hypot(path.points[:, 0], path.points[:, 1] - 8.0)
    assert np.sqrt(np.mean((radius - 8.0) ** 2)) < 2.0 * left + shrunk
    assert np.abs(noisy.curvatures - 1 / 8.0).max() > 0.3  # what the twin would have to follow
    assert np.abs(path.curvatures - 1 / 8.0).max() < 0.05


def test_smooth_halves_a_wave_of_the_wavelength():
    s = np.linspace(0.0, 60.0, 1201)
    wave = np.stack([s, 0.05 * np.sin(2.0 * np.pi * s / 6.0)], axis=1)
    left = Path(wave).smooth(6.0)
    inside = (left.points[:, 0] > 15.0) & (left.points[:, 0] < 45.0)
    # the wave's own length is (π A / λ)² longer than its chord: under 0.1 %
    assert np.abs(left.points[inside, 1]).max() == pytest.approx(0.025, rel=0.02)
    kept = Path(wave).smooth(3.0)
    inside = (kept.points[:, 0] > 15.0) & (kept.points[:, 0] < 45.0)
    assert np.abs(kept.points[inside, 1]).max() == pytest.approx(0.05 * 16 / 17, rel=0.02)


def test_is_frozen():
    given = np.array([[0.0, 0.0], [1.0, 0.0]])
    path = Path(given)
    given[0] = 9.0
    assert path.points[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        path.points[0] = 1.0


SQUARE = at((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Path(at((0.0, 0.0))), r"the shape \(1, 2\); give a path \(P, 2\) with at least 2 points"),
        (lambda: Path(SQUARE[:2], closed=True), r"a closed path \(P, 2\) with at least 3"),
        (lambda: Path(np.zeros((4, 3))), r"the shape \(4, 3\)"),
        (lambda: Path(at((0.0, 0.0), (1.0, np.nan), (2.0, 0.0))), "path point 1 is .* must be finite; leave it out"),
        (lambda: Path(at((0.0, 0.0), (1.0, 0.0), (1.0, 0.0))), "path point 2 repeats point 1: they are 0 m apart"),
        (lambda: Path(np.vstack([SQUARE, SQUARE[:1]]), closed=True), "path point 0 repeats point 4.*leave it out"),
        (lambda: Path(at((0.0, 0.0), (1.0, 0.0), (0.0, 0.0))), "path point 2 turns straight back to point 0"),
        (lambda: Path(SQUARE, speed=np.ones(3)), r"path speed has the shape \(3,\); give \(4,\)"),
        (lambda: Path(SQUARE, speed=np.array([1, 1, -1, 1])), "path speed at point 2 is -1 m/s"),
        (lambda: Path(SQUARE).speed_at(0.0), "path 'path' says no speed"),
        (lambda: Path(SQUARE).resample(0.0), "spacing is 0 m, but must be at least 0.001 m"),
        (lambda: Path.spline(SQUARE, spacing=np.nan), "spacing is nan m"),
        (lambda: Path(SQUARE).smooth(0.4), "wavelength is 0.4 m, but must be above 0.5 m, two spacings"),
        (lambda: Path(SQUARE).project([1.0, 2.0, 3.0]), r"xy has the shape \(3,\)"),
        (lambda: Path(SQUARE).project([1.0, 2.0], reach=0.0), "reach is 0 m, but must be above 0"),
    ],
)
def test_refuses(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("length", [1100.0, 1240.0, 1249.0, 99_500.0, 123_456.0])
def test_the_spacing_that_a_refusal_names_is_enough(length):
    path = Path(at((0.0, 0.0), (length, 0.0)))
    with pytest.raises(ValueError, match="or give a spacing of at least") as caught:
        path.resample(0.001)
    spacing = float(re.findall(r"at least ([\d.]+) m", str(caught.value))[0])
    # as little as two digits can say, and their margin
    assert length / MOST_POINTS <= spacing <= 1.11 * length / MOST_POINTS
