"""Depths, normals and forces between wheels, chassis and solid objects against duality, closed forms and quadrature."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false, reportCallIssue=false
import mujoco
import numpy as np
import pytest
import warp as wp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from aoro_gym.twin.physics.solids import (
    CROWN,
    DISSIPATION,
    HULL_EDGE,
    STEM,
    STONE,
    STUMP,
    Gap,
    Part,
    Solid,
    gap,
    hull_on_solid,
    hull_part,
    tire_on_solid,
    wheel_part,
)
from aoro_gym.twin.physics.tires import HULL_REGULARISATION, Hull, Tire, TireContact
from aoro_gym.twin.records import pack
from tests.twin.physics.launch import columns, launch, record, rounded

STEP = 1e-3  # [s]
LEVEL = (0.0, 0.0, 0.0, 1.0)
AHEAD = np.array([1.0, 0.0, 0.0])


@wp.kernel(enable_backward=False)
def gap_kernel(parts: wp.array(dtype=Part), objects: wp.array(dtype=Solid), out: wp.array(dtype=Gap)):
    i = wp.tid()
    out[i] = gap(parts[i], objects[i])


@wp.kernel(enable_backward=False)
def parts_kernel(tires: wp.array(dtype=Tire), low: wp.array(dtype=wp.vec3), high: wp.array(dtype=wp.vec3),
                 wheels: wp.array(dtype=Part), hulls: wp.array(dtype=Part)):  # fmt: skip
    i = wp.tid()
    wheels[i] = wheel_part(tires[i], low[i])
    hulls[i] = hull_part(low[i], high[i])


@wp.kernel(enable_backward=False)
def tire_kernel(tires: wp.array(dtype=Tire), parts: wp.array(dtype=Part), objects: wp.array(dtype=Solid),
                velocity: wp.array(dtype=wp.vec3), spin: wp.array(dtype=float), bristle: wp.array(dtype=float),
                out: wp.array(dtype=TireContact), between: wp.array(dtype=Gap)):  # fmt: skip
    i = wp.tid()
    between[i] = gap(parts[i], objects[i])
    out[i] = tire_on_solid(tires[i], between[i], parts[i].centre, velocity[i], wp.vec3(), spin[i], objects[i].friction,
                           bristle[i], 0.0, 1.0e-3)  # fmt: skip


@wp.kernel(enable_backward=False)
def bounce_kernel(hulls: wp.array(dtype=Hull), parts: wp.array(dtype=Part), objects: wp.array(dtype=Solid),
                  mass: wp.array(dtype=float), start: wp.array(dtype=wp.vec3), steps: int,
                  end: wp.array(dtype=wp.vec3)):  # fmt: skip
    i = wp.tid()
    part = parts[i]
    v = start[i]
    for _ in range(steps):  # drift, kick, drift
        part.centre += 0.5e-3 * v
        between = gap(part, objects[i])
        if between.depth > 0.0:
            v += (1.0e-3 / mass[i]) * hull_on_solid(hulls[i], between, v, wp.vec3())
        part.centre += 0.5e-3 * v
    end[i] = v


@wp.kernel(enable_backward=False)
def roll_kernel(tires: wp.array(dtype=Tire), parts: wp.array(dtype=Part), objects: wp.array(dtype=Solid),
                mass: wp.array(dtype=float), inertia: wp.array(dtype=float), steps: int, end: wp.array(dtype=wp.vec3),
                spins: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    part = parts[i]
    v = wp.vec3()
    spin = float(0.0)
    bristle = float(0.0)
    left = float(0.0)
    for step in range(steps):
        part.centre += 0.5e-3 * v
        between = gap(part, objects[i])
        contact = tire_on_solid(tires[i], between, part.centre, v, wp.vec3(), spin, 1.0, bristle, 0.0, 1.0e-3)
        if contact.load > 0.0 and left == 0.0:
            bristle = contact.bristle_x
            v += (1.0e-3 / mass[i]) * contact.force - wp.vec3(0.0, 0.0, 9.81e-3)
            spin += 1.0e-3 / inertia[i] * contact.moment[1]
            part.centre += 0.5e-3 * v
        elif step > 100:
            left = 1.0
            v = wp.vec3()
    end[i] = part.centre
    spins[i] = spin


@wp.kernel(enable_backward=False)
def pass_kernel(tires: wp.array(dtype=Tire), parts: wp.array(dtype=Part), objects: wp.array(dtype=Solid),
                mass: wp.array(dtype=float), inertia: wp.array(dtype=float), velocity: wp.array(dtype=wp.vec3),
                spin: wp.array(dtype=float), x: wp.array2d(dtype=float), z: wp.array2d(dtype=float),
                rate: wp.array2d(dtype=float)):  # fmt: skip
    i = wp.tid()
    part = parts[i]
    v = velocity[i]
    turning = spin[i]
    bristle = float(0.0)
    for step in range(x.shape[1]):
        part.centre += 0.5e-3 * v
        between = gap(part, objects[i])
        v -= wp.vec3(0.0, 0.0, 9.81e-3)
        if between.depth > 0.0:
            contact = tire_on_solid(tires[i], between, part.centre, v, wp.vec3(), turning, 1.0, bristle, 0.0, 1.0e-3)
            bristle = contact.bristle_x
            v += (1.0e-3 / mass[i]) * contact.force
            turning += 1.0e-3 / inertia[i] * contact.moment[1]
        part.centre += 0.5e-3 * v
        x[i, step] = part.centre[0]
        z[i, step] = part.centre[2]
        rate[i, step] = turning


def disc(centre=(0.0, 0.0, 0.0), radius=0.4, margin=0.24):
    return record(Part, centre=centre, half=(radius, 0.0, radius), margin=margin, round=1)


def box(centre=(0.0, 0.0, 0.0), half=(0.8, 0.45, 0.45), margin=0.2):
    return record(Part, centre=centre, half=half, margin=margin, round=0)


def solid(kind, start, end=None, margins=(0.1, 0.1), half=(0.0, 0.0, 0.0), rotation=LEVEL, friction=1.0):
    return record(Solid, kind=kind, start=start, end=start if end is None else end, start_margin=margins[0],
                  end_margin=margins[1], half=half, rotation=rotation, friction=friction)  # fmt: skip


def pairs(kind, count, seed):
    """``count`` random parts, half of them wheels, and objects of a ``kind`` within reach of them."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-1.0, 1.0, (count, 3))
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    length = rng.uniform(0.3, 5.0, count)
    end = start + length[:, None] * direction
    margins = rng.uniform(0.05, 0.2, (2, count))
    margins[1] = np.maximum(margins[0] + rng.uniform(-0.05, 0.05, count) * length, 0.02)
    half = rng.uniform(0.05, 0.5, (count, 3))
    turned = Rotation.random(count, random_state=rng).as_quat()
    if kind == STEM:
        objects = solid(STEM, start, end, margins)
    elif kind == STUMP:
        objects = solid(STUMP, start, start + rng.uniform(0.1, 0.5, (count, 1)) * direction, (0.03, 0.03), half)
    else:
        objects = solid(STONE, start, None, margins[[0, 0]], half, turned)
    centre = rng.uniform(-1.0, 1.0, (count, 3))
    return np.where(np.arange(count) % 2, disc(centre), box(centre)), objects


def part_support(part, n):
    """Largest n·x over each part: its core's and its margin."""
    flat = np.sqrt(n[:, 0] ** 2 + n[:, 2] ** 2) * part.half[:, 0]
    core = np.where(part.round == 1, flat, np.einsum("ni,ni->n", np.abs(n), part.half))
    return np.einsum("ni,ni->n", n, part.centre) + core + part.margin


def object_support(one, n):
    """Largest n·x over each object."""
    ends = [np.einsum("ni,ni->n", n, one.start) + one.start_margin, np.einsum("ni,ni->n", n, one.end) + one.end_margin]
    stem = np.maximum(*ends)
    axis = one.end - one.start
    lengths = np.linalg.norm(axis, axis=1)
    across = np.sqrt(np.maximum(1.0 - (np.einsum("ni,ni->n", n, axis) / np.maximum(lengths, 1e-9)) ** 2, 0.0))
    own = Rotation.from_quat(one.rotation).inv().apply(n)
    stone = np.linalg.norm(own * one.half, axis=1)
    return np.select([one.kind == STEM, one.kind == STUMP], [stem, stem + across * one.half[:, 0]], ends[0] + stone)


@pytest.mark.parametrize("kind", [STUMP, STONE])
def test_depth_is_the_least_overlap_over_all_directions(kind):
    """Duality: two convex bodies overlap along n by h_part(−n) + h_object(n), and by their depth along the best n. Points of
    both give a depth that is no larger, so the two bound the error of depth and normal together.

    Rounding of the normal, 1e-7/0.02, moves the support of a body 1 m away by 5e-6 m; alternating projections stop short
    where flat faces, or a disc and a line, are nearly parallel.
    """
    parts, objects = pairs(kind, 4000, 1 + kind)
    found, part, one = launch(gap_kernel, parts, objects), columns(parts), columns(objects)
    lacking = part_support(part, -found.normal) + object_support(one, found.normal) - found.depth
    near = (found.depth < part.margin + one.start_margin - 0.02) & (found.depth > -0.5)
    for who, ninety in ((1, 1e-5), (0, 1e-3)):
        chosen = lacking[near & (part.round == who)]
        assert len(chosen) > 800 and chosen.min() > -5e-5
        assert np.quantile(chosen, 0.9) < ninety and np.quantile(chosen, 0.98) < 0.02
    assert np.allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-5)


def test_depth_in_a_stem_is_the_least_along_its_axis():
    """Against 4001 points of the axis in float64, the crown with it. Samples of 5 m lie 1.3 mm apart, so they miss at most
    (0.6 mm)²/(2 · 0.02 m) = 1e-5 m; twelve steps to the root leave 0.2 mm of depth in one case of a thousand, where the
    derivative jumps."""
    parts, objects = pairs(STEM, 2000, 1)
    found, part, one = launch(gap_kernel, parts, objects), columns(parts), columns(objects)
    axis = one.end - one.start
    length = np.linalg.norm(axis, axis=1)
    middle = np.clip(np.einsum("ni,ni->n", part.centre - one.start, axis) / length, 0.0, length)
    depth = np.full(len(length), -np.inf)
    for share in np.linspace(0.0, 1.0, 4001):
        d = one.start + share * axis - part.centre
        inward = np.minimum(part.half[:, 0] / np.maximum(np.hypot(d[:, 0], d[:, 2]), 1e-9), 1.0)
        flat = np.stack([inward * d[:, 0], np.zeros(len(d)), inward * d[:, 2]], axis=1)
        core = np.where((part.round == 1)[:, None], flat, np.clip(d, -part.half, part.half))
        margin = part.margin + one.start_margin + share * (one.end_margin - one.start_margin)
        crown = 0.5 * CROWN * (share * length - middle) ** 2
        depth = np.maximum(depth, margin - crown - np.linalg.norm(d - core, axis=1))
    near = depth < part.margin + np.minimum(one.start_margin, one.end_margin) - 0.02
    assert near.sum() > 1000
    error = found.depth[near] - depth[near]
    assert -5e-4 < error.min() and np.quantile(error, 0.002) > -1e-5 and error.max() < 3e-5


@pytest.fixture(scope="module")
def bundled(machine):
    return pack(machine)


def test_parts_are_as_large_as_the_machine(bundled):
    tire = bundled["tire"]
    low, high = (-0.5, -0.65, 0.6), (1.5, 0.65, 1.9)
    wheel, hull = launch(parts_kernel, tire, low, high)
    assert wheel.half[0, 0] + wheel.margin[0] == pytest.approx(tire["radius"][0])
    assert wheel.margin[0] == tire["disc_offset_outer"][0] and wheel.half[0, 1] == 0.0
    np.testing.assert_allclose(hull.centre + hull.half + hull.margin[0], [high], rtol=1e-6)
    np.testing.assert_allclose(hull.centre - hull.half - hull.margin[0], [low], rtol=1e-6)
    assert hull.margin[0] == pytest.approx(HULL_EDGE)


def on_log(tire, radius, angle, depth):
    """A wheel pressed by ``depth`` into a log across its way, whose axis lies in the origin, at ``angle`` from its top."""
    away = float(tire["radius"][0]) + radius - depth
    margin = float(tire["disc_offset_outer"][0])
    centre = away * np.array([-np.sin(angle), 0.0, np.cos(angle)])
    part = disc(centre, float(tire["radius"][0]) - margin, margin)
    return part, solid(STEM, (0.0, -2.0, 0.0), (0.0, 2.0, 0.0), (radius, radius))


@pytest.mark.parametrize("radius", [0.05, 0.15, 0.4])
@pytest.mark.parametrize("angle", [0.0, 0.6, -1.2])
def test_a_wheel_at_rest_on_a_log_presses_as_its_spring(bundled, radius, angle):
    """F = k (R + r − |c|) along the line from the log's axis to the wheel's centre; at rest nothing else."""
    tire, depth = bundled["tire"], 0.04
    part, log = on_log(tire, radius, angle, depth)
    contact, between = launch(tire_kernel, tire, part, log, (0.0, 0.0, 0.0), 0.0, 0.0)
    normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    assert between.depth == pytest.approx(depth, abs=3e-7)
    np.testing.assert_allclose(between.normal[0], normal, atol=3e-6)
    load = float(tire["stiffness"][0]) * depth
    np.testing.assert_allclose(contact.force[0], load * normal, atol=1e-4 * load)
    assert np.abs(contact.moment).max() < 1e-4 * load
    assert contact.lever == pytest.approx(float(tire["radius"][0]), rel=1e-5)


def test_a_wheel_that_leaves_fast_is_not_pulled(bundled):
    tire = bundled["tire"]
    part, log = on_log(tire, 0.15, 0.3, 0.02)
    k, c = (float(tire[name][0]) for name in ("stiffness", "damping"))
    rates = np.linspace(-1.0, 6.0, 15)  # along the normal, away
    away = np.outer(rates, [-np.sin(0.3), 0.0, np.cos(0.3)])
    contact, _ = launch(tire_kernel, tire, part, log, away, 0.0, 0.0)
    np.testing.assert_allclose(contact.load, np.maximum(k * 0.02 - c * rates, 0.0), rtol=1e-4, atol=1.0)
    assert (contact.load == 0.0).any() and (contact.load > 0.0).any()


@pytest.mark.parametrize("friction", [0.4, 0.7, 1.0])
def test_a_wheel_that_spins_on_a_log_slides_at_its_capacity(bundled, friction):
    """Steady LuGre: F = N (g(v) + σ₂ v) up the log's flank, and its moment is F R."""
    tire, angle = bundled["tire"], 0.5
    part, log = on_log(tire, 0.2, angle, 0.05)
    log["friction"] = friction
    t = columns(tire)
    spin = 8.0
    slip = spin * t.radius
    grip = friction * (
        t.friction_coulomb + (t.friction_static - t.friction_coulomb) * np.exp(-((slip / t.stribeck_velocity) ** 2))
    )
    contact, _ = launch(tire_kernel, tire, part, log, (0.0, 0.0, 0.0), spin, rounded(-grip / t.sigma0_longitudinal))
    force = contact.load * (grip + t.sigma2_longitudinal * slip)
    np.testing.assert_allclose(contact.force @ np.array([np.cos(angle), 0.0, np.sin(angle)]), force, rtol=1e-4)
    np.testing.assert_allclose(contact.moment[:, 1], -force * t.radius, rtol=1e-4)


@pytest.mark.parametrize(("radius", "start"), [(0.4, 0.2), (0.8, 0.3)])
def test_a_wheel_rolls_off_a_log_where_it_must_leave_it(bundled, radius, start):
    """A free wheel that starts at rest, the angle ``start`` from a log's top, and does not slip: energy gives v² (1 + κ)/2 =
    g (R + r) (cos θ₀ − cos θ), κ = J/(m R²), and it leaves where v² = g (R + r) cos θ: at cos θ = 2 cos θ₀/(3 + κ). Its
    spin is less than v/R then: it slips over the last of the load.

    On a tire of a hundredfold stiffness and damping (0.7 mm of deflection); the last hundredth of the load, 7 µm, goes over
    the last 0.01 rad.
    """
    tire = bundled["tire"].copy()
    for name in ("stiffness", "damping"):
        tire[name] *= 100.0
    mass, inertia = 2500.0, 40.0
    size = float(tire["radius"][0])
    part, log = on_log(tire, radius, -start, 0.0007)
    end, spin = launch(roll_kernel, tire, part, log, mass, inertia, 3000)
    ratio = inertia / (mass * size**2)
    angle = np.arctan2(end[0, 0], end[0, 2])
    leaves = np.arccos(2.0 * np.cos(start) / (3.0 + ratio))
    assert angle == pytest.approx(leaves, abs=0.005)
    rolling = np.sqrt(9.81 * (size + radius) * np.cos(leaves)) / size
    assert 0.9 * rolling < spin[0] < rolling


WHEEL_OVER_LOG = """
<mujoco>
  <option timestep="0.0005" gravity="0 0 -9.81" cone="elliptic" integrator="implicitfast"/>
  <default><geom friction="1 0 0" condim="3" solref="0.004 1" solimp="0.99 0.999 0.0001"/></default>
  <worldbody>
    <geom type="cylinder" size="{radius} 2" zaxis="0 1 0"/>
    <body pos="{x} 0 {z}">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="spin" type="hinge" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom type="sphere" size="{size}"/>
    </body>
  </worldbody>
</mujoco>
"""
"""A wheel in its plane over a fixed log: a sphere, which there is a disc."""


@pytest.mark.parametrize("radius", [0.15, 0.4])
def test_a_wheel_rolls_over_a_log_as_in_mujoco(bundled, radius):
    """Up one side, over the top and down the other: place and spin at every 0.1 s of the 0.5 s before it leaves the log.

    Both contacts are nearly rigid, a millimetre deep at most; what is at the top a millimetre aside is some more of them
    below.
    """
    tire = bundled["tire"].copy()
    for name in ("stiffness", "damping"):
        tire[name] *= 100.0
    mass, inertia, size, angle, speed = 2500.0, 40.0, float(tire["radius"][0]), 0.35, 1.5
    part, log = on_log(tire, radius, angle, 0.0007)
    ahead = speed * np.array([np.cos(angle), 0.0, np.sin(angle)])
    ours = launch(pass_kernel, tire, part, log, mass, inertia, ahead, speed / size, length=500)
    text = WHEEL_OVER_LOG.format(
        radius=radius, x=part["centre"][0], z=part["centre"][2], mass=mass, inertia=inertia, size=size
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = ahead[0], ahead[2], speed / size
    theirs = []
    for _ in range(500):
        mujoco.mj_step(model, data, 2)
        theirs.append((part["centre"][0] + data.qpos[0], part["centre"][2] + data.qpos[1], data.qvel[2]))
    place = np.stack(ours, axis=-1)[0]
    assert place[0, 0] < -0.2 and place[-1, 0] > 0.1  # over the top, and still on it
    assert np.hypot(place[-1, 0], place[-1, 1]) < size + radius
    np.testing.assert_allclose(place[99::100, :2], np.array(theirs)[99::100, :2], atol=3e-3)
    np.testing.assert_allclose(place[99::100, 2], np.array(theirs)[99::100, 2], rtol=5e-3)


def restitution(speed):
    """Speed [m/s] after a collision by F = K δ (1 + a δ̇): from ∫ v dv/(1 + a v) = −K/m ∫ δ dδ = 0 over the whole contact,
    a v − ln(1 + a v) is the same at its begin and its end, whatever K and m."""

    def left(v):
        return DISSIPATION * v - np.log1p(DISSIPATION * v)

    return brentq(lambda out: left(-out) - left(speed), 0.0, min(speed, (1.0 - 1e-12) / DISSIPATION))


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("kind", [STEM, STONE])
def test_a_chassis_rebounds_as_hunt_and_crossley_say(bundled, speed, kind):
    """A mass of 4 t that runs straight into a stem, or a stone, in steps of 1 ms: ω h = 0.022, so that a symplectic step
    errs by (ω h)² = 5e-4 of the speed, and by as much again for the step in which contact begins."""
    assert restitution(0.01) / 0.01 == pytest.approx(1.0 - 2.0 / 3.0 * DISSIPATION * 0.01, abs=1e-4)
    ends = ((1.5, 0.0, -1.0), (1.5, 0.0, 3.0)) if kind == STEM else ((1.5, 0.0, 0.1), None)
    one = solid(kind, *ends, margins=(0.2, 0.2), half=(0.1, 0.1, 0.1))
    end = launch(bounce_kernel, bundled["hull"], box(), one, 4000.0, speed * AHEAD, int(2000 / min(speed, 1.0)))
    assert end[0, 0] == pytest.approx(-restitution(speed), abs=2e-3 * speed)
    assert np.abs(end[0, 1:]).max() < 1e-3 * speed
    assert restitution(speed) < speed


def test_a_chassis_that_grazes_a_stem_is_braked_by_coulomb(bundled):
    """The first step: the tangential force is μ F v/√(v² + v₀²)."""
    hull = columns(bundled["hull"])
    speed, h = 2.0, 1e-3
    part = box(centre=(-1.05, 0.0, 0.0))  # its front 5 cm in the stem
    one = solid(STEM, (0.1, 0.0, -1.0), (0.1, 0.0, 1.0), margins=(0.2, 0.2))
    end = launch(bounce_kernel, bundled["hull"], part, one, 4000.0, (0.0, speed, 0.0), 1)
    load = hull.stiffness * 0.05
    np.testing.assert_allclose(end[0, 0], -load * h / 4000.0, rtol=1e-3)
    braked = hull.friction * load * h / 4000.0 * speed / np.hypot(speed, HULL_REGULARISATION)
    np.testing.assert_allclose(speed - end[0, 1], braked, rtol=1e-2)


def test_cores_that_meet_are_pushed_apart(bundled):
    """Beyond the depth that is exact, the force is finite and points to the part's middle."""
    parts = np.concatenate([np.atleast_1d(box()), np.atleast_1d(disc())])
    through = solid(STEM, (0.2, 0.0, -3.0), (0.2, 0.0, 3.0))
    stump = solid(STUMP, (0.2, 0.0, -0.1), (0.2, 0.0, 0.1), half=(0.1, 0.0, 0.0))
    for one in (through, stump, solid(STONE, (0.2, 0.0, 0.0), half=(0.1,) * 3)):
        found = launch(gap_kernel, parts, one)
        assert np.isfinite(found.normal).all() and np.allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-5)
        assert (found.depth > 0.3 * columns(parts).margin).all()
