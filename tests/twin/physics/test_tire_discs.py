"""A tire's discs on triangles against quadrature in float64: planes, a kerb, a trench, a ditch, and work over a kerb."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp
from scipy.optimize import brentq
from scipy.special import logsumexp

from aoro_gym.twin.physics.ground import Footing
from aoro_gym.twin.physics.tire_discs import DiscTouch, TireTouch, cut, disc_touch, tire_touch
from aoro_gym.twin.physics.tires import Tire, TireContact, tire_contact, touch_forces
from tests.twin.physics.launch import changed, columns, launch
from tests.twin.physics.test_tires import BLEND, LEVEL, LOAD, TIRE, UPRIGHT, ZERO

M = columns(TIRE)
RADII = M.radius - np.array([0.0, *[M.disc_drop_inner] * 2, *[M.disc_drop_outer] * 2])
STIFFNESS = float(M.stiffness)
NODES, SHARES = np.polynomial.legendre.leggauss(60)


@wp.kernel(enable_backward=False)
def touch_kernel(
    mesh: wp.uint64,
    m: wp.array(dtype=Tire),
    ground: wp.array(dtype=Footing),
    rotation: wp.array(dtype=wp.mat33),
    hub: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    omega: wp.array(dtype=wp.vec3),
    touch: wp.array(dtype=TireTouch),
    contact: wp.array(dtype=TireContact),
):
    i = wp.tid()
    t = tire_touch(m[i], mesh, rotation[i], hub[i])
    touch[i] = t
    if t.contact.depth > 0.0:
        contact[i] = touch_forces(
            m[i], ground[i], t.normal, t.middle, t.contact, t.steepness, velocity[i], omega[i], 0.0, 0.0, 0.0, 0.0, 1e-3
        )


@wp.kernel(enable_backward=False)
def plane_kernel(
    m: wp.array(dtype=Tire),
    ground: wp.array(dtype=Footing),
    rotation: wp.array(dtype=wp.mat33),
    hub: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    omega: wp.array(dtype=wp.vec3),
    contact: wp.array(dtype=TireContact),
):
    i = wp.tid()
    zero = wp.vec3(0.0, 0.0, 0.0)
    contact[i] = tire_contact(
        m[i], ground[i], rotation[i], hub[i], zero, velocity[i], omega[i], 0.0, 0.0, 0.0, 0.0, 1e-3
    )


@wp.kernel(enable_backward=False)
def disc_kernel(
    mesh: wp.uint64, hub: wp.array(dtype=wp.vec3), radius: wp.array(dtype=float), out: wp.array(dtype=DiscTouch)
):
    i = wp.tid()
    out[i] = disc_touch(cut(mesh, wp.identity(3, float), hub[i], radius[i]), radius[i])


def strip(points):
    """Triangles of a profile (N, 2) of x and z [m] that is the same at all y."""
    points = np.asarray(points, float)
    sides = [np.column_stack([points[:, 0], np.full(len(points), y), points[:, 1]]) for y in (-1.5, 0.07, 1.5)]
    vertices = np.concatenate(sides)
    count = len(points)
    a = np.concatenate([np.arange(count - 1) + row * count for row in (0, 1)])
    faces = np.concatenate(
        [np.stack([a, a + 1, a + 1 + count], axis=1), np.stack([a, a + 1 + count, a + count], axis=1)]
    )
    return wp.Mesh(wp.array(vertices, dtype=wp.vec3, device="cpu"), wp.array(faces.ravel(), dtype=int, device="cpu"))


KERB = [(-6.0, 0.0), (0.0, 0.0), (0.0, 0.18), (6.0, 0.18)]
TRENCH = [(-6.0, 0.0), (-0.3, 0.0), (-0.3, -0.25), (0.3, -0.25), (0.3, 0.0), (6.0, 0.0)]
DITCH = [(-6.0, 0.0), (-0.5, 0.0), (0.0, -0.4), (0.5, 0.0), (6.0, 0.0)]
LOG = [(-6.0, 0.0), (-0.1, 0.0), (-0.07, 0.07), (0.0, 0.1), (0.07, 0.07), (0.1, 0.0), (6.0, 0.0)]
PROFILES = {"kerb": KERB, "trench": TRENCH, "ditch": DITCH, "log": LOG}


class Springs:
    """Radial springs of a disc over a profile without overhangs, by quadrature over vertical strips, float64."""

    def __init__(self, points):
        self.points = np.asarray(points, float)

    def energy(self, x, z, radius):
        """E [m³] of a disc at (x, z) [m]: ∬ (R² − r²)/2R over the ground inside of it."""
        total = 0.0
        for (x_0, z_0), (x_1, z_1) in zip(self.points[:-1], self.points[1:], strict=True):
            low, high = max(x_0, x - radius), min(x_1, x + radius)
            if high <= low:
                continue
            # panels, so that kinks where the rim leaves the ground cost little
            edges = np.linspace(low, high, 9)
            half = 0.5 * np.diff(edges)[:, None]
            at = (0.5 * (edges[1:] + edges[:-1])[:, None] + half * NODES).ravel()
            rim = np.sqrt(np.maximum(radius**2 - (at - x) ** 2, 0.0))
            top = np.clip(z_0 + (z_1 - z_0) * (at - x_0) / (x_1 - x_0) - z, -rim, rim)
            column = (rim**2 * (top + rim) - (top**3 + rim**3) / 3.0) / (2.0 * radius)
            total += np.sum((half * SHARES).ravel() * column)
        return total

    def distance(self, x, z):
        """Of the nearest ground [m]."""
        start, way = self.points[:-1], np.diff(self.points, axis=0)
        from_start = np.array([x, z]) - start
        share = np.clip(np.sum(from_start * way, axis=1) / np.sum(way**2, axis=1), 0.0, 1.0)
        return np.min(np.linalg.norm(from_start - share[:, None] * way, axis=1))

    def depth(self, x, z, radius):
        """δ [m] of a plane that bends the springs as far, negative above the ground."""
        energy = self.energy(x, z, radius)
        if energy <= 0.0:
            return radius - self.distance(x, z)
        return brentq(lambda depth: plane_energy(depth, radius) - energy, 1e-9, 0.9 * radius, xtol=1e-14)

    def tire_depth(self, x, z):
        """Blended over the five discs [m]."""
        depths = [self.depth(x, z, radius) for radius in RADII[[0, 1, 3]]]
        drops = np.array([0.0, M.disc_drop_inner, M.disc_drop_outer])
        counts = np.array([1.0, 2.0, 2.0])
        return BLEND * (logsumexp(np.array(depths) / BLEND, b=counts) - logsumexp(-drops / BLEND, b=counts))

    def force(self, x, z, step=2e-5):
        """(F_x, F_z) [N]: what the energy ½ k δ² pushes with."""
        energies = [
            0.5 * STIFFNESS * self.tire_depth(x + a, z + b) ** 2
            for a, b in ((step, 0), (-step, 0), (0, step), (0, -step))
        ]
        return np.array([energies[1] - energies[0], energies[3] - energies[2]]) / (2.0 * step)


def plane_energy(depth, radius):
    """E [m³] in a plane, ∫ (R² − d²/cos² φ)²/8R dφ over half of the chord's angle, twice."""
    d = radius - depth
    chord = np.sqrt(depth * (radius + d))
    terms = radius**4 * np.arctan2(chord, d) - 2.0 * radius**2 * d * chord + d**3 * chord + d * chord**3 / 3.0
    return terms / (4.0 * radius)


def at_rest(mesh, x, z, tire=TIRE):
    """Contacts of upright wheels that do not move, at (x, z) [m] each."""
    hub = np.stack(np.broadcast_arrays(x, 0.0, z), axis=-1)
    return launch(touch_kernel, mesh.id, tire, LEVEL, UPRIGHT, hub, ZERO, ZERO)


GAUSS = 1e-4
"""What five points of Gauss leave of a depth of 0.11 m in one piece, whose chord is as long as 1.4 of its distance: the
integrand's d²/(d² + s²) has terms (s/d)^6 that they do not integrate. 1e-5 at 0.05 m."""


@pytest.mark.parametrize(("depth", "error"), [(0.002, 1e-5), (0.01, 1e-5), (0.05, 1e-5), (0.11, GAUSS)])
def test_equivalent_depth_of_a_plane_is_its_depth(depth, error):
    mesh = strip([(-6.0, 0.0), (0.4, 0.0), (6.0, 0.0)])
    out = launch(disc_kernel, mesh.id, [[0.0, 0.0, 0.6 - depth]], 0.6)
    assert out.depth[0] == pytest.approx(depth, rel=error, abs=1e-7)
    np.testing.assert_allclose(out.push[0], [0.0, 0.0, 1.0], atol=2.0 * error)


def test_on_any_plane_discs_feel_what_an_averaged_plane_is():
    """Slopes up to 15 degrees at any heading, moving wheels: forces and moments of :func:`tire_contact`.

    Depths differ by GAUSS of 0.1 m at most, 10 µm, and those of two discs by half of that, which shares of discs turn into
    5/2000 of the way between them: 0.6 mm of the lever of moments, where the sides of a tire are alike.
    """
    rng = np.random.default_rng(5)
    for _ in range(12):
        slope, towards, yaw = np.radians(rng.uniform(0.0, 15.0)), rng.uniform(-np.pi, np.pi), rng.uniform(-np.pi, np.pi)
        normal = np.array([-np.sin(slope) * np.cos(towards), -np.sin(slope) * np.sin(towards), np.cos(slope)])
        x, y = np.array([-3.0, 3.1, 2.9, -3.2]), np.array([-3.1, -2.9, 3.0, 3.2])
        vertices = np.column_stack([x, y, -(normal[0] * x + normal[1] * y) / normal[2]])
        mesh = wp.Mesh(
            wp.array(vertices, dtype=wp.vec3, device="cpu"), wp.array([0, 1, 2, 0, 2, 3], dtype=int, device="cpu")
        )
        turned = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        hub = rng.uniform(-0.3, 0.3, 3)
        n = turned.T @ normal
        middle = rng.uniform(0.02, 0.11) - M.disc_offset_outer * np.abs(
            n[1]
        )  # the deepest one's less what it is deeper
        hub += (0.6 * np.hypot(n[0], n[2]) - middle - hub @ normal) * normal
        moving = rng.uniform(-0.2, 0.2, (2, 3))
        ground = changed(LEVEL, normal=normal)
        touch, found = launch(touch_kernel, mesh.id, TIRE, ground, turned, hub[None], moving[0], moving[1])
        expected = launch(plane_kernel, TIRE, ground, turned, hub[None], moving[0], moving[1])
        np.testing.assert_allclose(touch.normal[0], n, atol=2e-6)
        assert touch.steepness[0] == pytest.approx(1.0, abs=2.0 * GAUSS)
        size = float(expected.load[0])
        np.testing.assert_allclose(found.force[0], expected.force[0], atol=1.0 + 2.0 * GAUSS * size)
        np.testing.assert_allclose(found.moment[0], expected.moment[0], atol=1.0 + (2.0 * GAUSS * 0.6 + 6e-4) * size)


@pytest.mark.parametrize("name", PROFILES)
def test_force_is_that_of_the_springs_energy(name):
    """Vertical and horizontal force on kerb, trench, ditch and log at 16 places each, no moment about the axle, and as
    much on either side where the profile is.

    Of the depth GAUSS is uncertain, of the gradient as much again, and 1e-7 m by positions in float32: 3 N at most.
    """
    mesh, springs = strip(PROFILES[name]), Springs(PROFILES[name])
    rng = np.random.default_rng(2)
    x = np.concatenate([np.linspace(-0.55, 0.55, 8), rng.uniform(-0.7, 0.7, 8)])
    # as deep as 1 to 12 cm of the deepest point of any profile
    lowest = np.array([brentq(lambda z, x=x: springs.distance(x, z) - 0.6, 0.3, 1.2) for x in x])
    z = lowest - rng.uniform(0.01, 0.12, len(x))
    touch, found = at_rest(mesh, x, z)
    expected = np.array([springs.force(*place) for place in zip(x, z, strict=True)])
    depths = np.array([springs.tire_depth(*place) for place in zip(x, z, strict=True)])
    np.testing.assert_allclose(touch.contact.depth, depths, rtol=GAUSS, atol=1e-6)
    np.testing.assert_allclose(found.force[:, [0, 2]], expected, atol=3.0, rtol=2.0 * GAUSS)
    np.testing.assert_allclose(found.force[:, 1], 0.0, atol=1.0)
    np.testing.assert_allclose(found.moment[:, 1], 0.0, atol=1.0)


def settle(mesh, x, load, tire=TIRE):
    """Heights [m] of wheels at ``x`` that bear a vertical ``load`` [N], and their contacts: bisection, all at once."""
    low, high = np.full(len(x), 0.15), np.full(len(x), 0.9)
    for _ in range(40):
        middle = 0.5 * (low + high)
        found = at_rest(mesh, x, middle, tire)[1]
        heavy = found.force[:, 2] > load
        low, high = np.where(heavy, middle, low), np.where(heavy, high, middle)
    return 0.5 * (low + high), at_rest(mesh, x, 0.5 * (low + high), tire)[1]


def test_climbing_a_kerb_takes_the_work_that_lifts_the_load():
    """Drawn over the kerb at its axle under a constant load, slowly: the way back and the way up, ∫F_x dx = −W h, as the
    springs are as bent before as after. 0.3 %: the trapezoidal rule over 500 places."""
    mesh = strip(KERB)
    x = np.linspace(-1.2, 1.2, 500)
    height, found = settle(mesh, x, LOAD)
    assert height[-1] - height[0] == pytest.approx(0.18, abs=1e-5)
    assert np.trapezoid(found.force[:, 0], x) == pytest.approx(-LOAD * 0.18, rel=3e-3)
    assert np.all(np.abs(np.diff(found.force[:, 0])) < 0.05 * LOAD)  # nothing jumps


def test_a_hard_tire_climbs_as_a_rigid_wheel():
    """Of a wheel that does not yield, the force on the edge goes through the axle: it takes F_x = W √(2Rh − h²)/(R − h) to
    lift it off (R of the deepest disc). A tire 500 times as stiff yields 3 mm on the edge, which is 3 % of the lever."""
    hard = changed(TIRE, stiffness=500.0 * STIFFNESS)
    reach = np.sqrt(2.0 * 0.6 * 0.18 - 0.18**2)
    x = np.linspace(-reach, -0.5 * reach, 200)
    _, found = settle(strip(KERB), x, LOAD, hard)
    expected = LOAD * reach / (0.6 - 0.18)
    assert -found.force[:, 0].min() == pytest.approx(expected, rel=0.03)


def test_a_hard_tire_hangs_on_both_edges_of_a_trench():
    """As deep as its sagitta, R − √(R² − b²/4), of a trench of the width b; the tire yields by 1 mm to either edge."""
    hard = changed(TIRE, stiffness=2000.0 * STIFFNESS)
    height, found = settle(strip(TRENCH), np.array([0.0]), LOAD, hard)
    assert height[0] == pytest.approx(np.sqrt(0.6**2 - 0.3**2), abs=3e-3)
    assert found.force[0, 0] == pytest.approx(0.0, abs=1e-3 * LOAD)


def test_damping_takes_work_on_an_edge():
    """F = g (k δ − c g n·v): the damper adds c g² v against a motion along the ground's normal, here into a kerb's edge."""
    mesh = strip(KERB)
    hub = [[-0.35, 0.0, 0.6]]
    touch, still = launch(touch_kernel, mesh.id, TIRE, LEVEL, UPRIGHT, hub, ZERO, ZERO)
    n, g = touch.normal[0], float(touch.steepness[0])
    assert 0.1 < g < 0.9
    assert n[0] < -0.2
    way = changed(TIRE, friction_coulomb=1e-9, friction_static=1e-9, sigma1_longitudinal=0.0, sigma2_longitudinal=0.0)
    _, moving = launch(touch_kernel, mesh.id, way, LEVEL, UPRIGHT, hub, -0.1 * n, ZERO)
    assert moving.load[0] - still.load[0] == pytest.approx(float(M.damping) * g * g * 0.1, rel=1e-3)


def test_far_from_the_ground_there_is_no_contact():
    touch, found = at_rest(strip(KERB), np.array([-2.0, 0.0]), np.array([0.75, 3.0]))
    assert np.all(touch.contact.depth < 0.0)
    assert np.all(found.load == 0.0)
