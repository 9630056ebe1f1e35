"""Tire and hull contact against brute-force geometry, closed forms of LuGre friction, and signs."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from scipy.optimize import brentq
from scipy.special import logsumexp, softmax

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.friction import bristle_step
from aoro_gym.twin.physics.ground import Footing
from aoro_gym.twin.physics.tires import (
    Hull,
    Tire,
    TireContact,
    hull_contact,
    lugre_capacity,
    onto_circle,
    tire_contact,
)
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record, rounded

TIRE = record(
    Tire,
    radius=0.6,
    disc_offset_inner=0.13,
    disc_offset_outer=0.24,
    disc_drop_inner=0.003,
    disc_drop_outer=0.015,
    stiffness=450e3,
    damping=3.5e3,
    sigma0_longitudinal=16.0,
    sigma0_lateral=8.0,
    sigma1_longitudinal=1.0,
    sigma1_lateral=0.5,
    sigma2_longitudinal=0.02,
    sigma2_lateral=0.01,
    friction_coulomb=0.7,
    friction_static=0.8,
    stribeck_velocity=0.1,
    rolling_resistance=0.0125,
    scrub_radius=0.0,
    scrub_angle=0.15,
    swivel_law=0,
    bore_radius=0.13,
    bore_stiffness=15e3,
    slip_law=0,
    relaxation_longitudinal=0.3,
    relaxation_lateral=0.5,
    soft_ground_law=0,
    bulldozing_resistance=0.05,
)


def obeying(base=TIRE, **laws):
    """A tire of other laws."""
    return changed(base, **{f"{law}_law": OPTIONS[law].index(option) for law, option in laws.items()})


HULL = record(Hull, stiffness=2e6, damping=2e4, friction=0.5)
LEVEL = record(
    Footing, x=0.0, y=0.0, height=0.0, normal=[0.0, 0.0, 1.0], friction=1.0, rolling_resistance=1.0, known=1.0
)
BLEND = 0.002  # [m]
ZERO = np.zeros(3)
UPRIGHT = np.eye(3)
LOAD = 24.5e3  # [N]


@wp.kernel(enable_backward=False)
def capacity_kernel(
    m: wp.array(dtype=Tire), speed: wp.array(dtype=float), friction: wp.array(dtype=float), g: wp.array(dtype=float)
):
    i = wp.tid()
    g[i] = lugre_capacity(m[i], speed[i], friction[i])


@wp.kernel(enable_backward=False)
def bristle_kernel(
    start: wp.array(dtype=float),
    slip: wp.array(dtype=float),
    unload: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    steps: wp.array(dtype=int),
    end: wp.array(dtype=float),
):
    i = wp.tid()
    z = start[i]
    for _ in range(steps[i]):
        z = bristle_step(z, slip[i], unload[i], dt[i])
    end[i] = z


@wp.kernel(enable_backward=False)
def contact_kernel(
    m: wp.array(dtype=Tire),
    ground: wp.array(dtype=Footing),
    rotation: wp.array(dtype=wp.mat33),
    origin: wp.array(dtype=wp.vec3),
    centre: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    omega: wp.array(dtype=wp.vec3),
    spin: wp.array(dtype=float),
    bristle_x: wp.array(dtype=float),
    bristle_y: wp.array(dtype=float),
    twist: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    steps: wp.array(dtype=int),
    contact: wp.array(dtype=TireContact),
):
    """One contact, its bristles carried on for a number of steps of the same motion."""
    i = wp.tid()
    x = bristle_x[i]
    y = bristle_y[i]
    w = twist[i]
    for _ in range(steps[i]):
        c = tire_contact(
            m[i], ground[i], rotation[i], origin[i], centre[i], velocity[i], omega[i], spin[i], x, y, w, dt[i]
        )
        x = c.bristle_x
        y = c.bristle_y
        w = c.twist
        contact[i] = c


@wp.kernel(enable_backward=False)
def circle_kernel(
    force: wp.array(dtype=wp.vec2),
    stiffness: wp.array(dtype=wp.vec2),
    grip: wp.array(dtype=float),
    out: wp.array(dtype=wp.vec2),
):
    i = wp.tid()
    out[i] = onto_circle(force[i], stiffness[i], grip[i])


@wp.kernel(enable_backward=False)
def drag_kernel(
    m: wp.array(dtype=Tire),
    ground: wp.array(dtype=Footing),
    roll: wp.array(dtype=float),
    slip_x: wp.array2d(dtype=float),
    slip_y: wp.array2d(dtype=float),
    swivel: wp.array2d(dtype=float),
    dt: float,
    work: wp.array2d(dtype=float),
):
    """A wheel that rolls at a speed, locked if it is none, and is dragged and swivelled over level ground: work put in so
    far, over the load [m]."""
    i = wp.tid()
    x = float(0.0)
    y = float(0.0)
    w = float(0.0)
    total = float(0.0)
    spin = roll[i] / 0.6
    unturned = wp.mat33(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    zero = wp.vec3(0.0, 0.0, 0.0)
    for k in range(slip_x.shape[1]):
        v = wp.vec3(slip_x[i, k], slip_y[i, k], 0.0)
        hub = v + wp.vec3(roll[i], 0.0, 0.0)
        turning = wp.vec3(0.0, 0.0, swivel[i, k])
        c = tire_contact(m[i], ground[i], unturned, zero, wp.vec3(0.0, 0.0, 0.55), hub, turning, spin, x, y, w, dt)
        x = c.bristle_x
        y = c.bristle_y
        w = c.twist
        total -= (wp.dot(c.force, v) + c.moment[2] * swivel[i, k]) / c.load * dt
        work[i, k] = total


@wp.kernel(enable_backward=False)
def hull_kernel(
    m: wp.array(dtype=Hull),
    ground: wp.array(dtype=Footing),
    rotation: wp.array(dtype=wp.mat33),
    origin: wp.array(dtype=wp.vec3),
    point: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    omega: wp.array(dtype=wp.vec3),
    force: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    force[i] = hull_contact(m[i], ground[i], rotation[i], origin[i], point[i], velocity[i], omega[i])


def touch(
    tire=TIRE,
    ground=LEVEL,
    rotation=UPRIGHT,
    origin=ZERO,
    centre=(0.0, 0.0, 0.55),
    velocity=ZERO,
    omega=ZERO,
    spin=0.0,
    bristle_x=0.0,
    bristle_y=0.0,
    twist=0.0,
    dt=1e-3,
    steps=1,
):
    """A wheel that is pressed 5 cm into level ground unless told otherwise."""
    return launch(
        contact_kernel, tire, ground, rotation, origin, centre, velocity, omega, spin, bristle_x, bristle_y, twist, dt,
        steps,
    )  # fmt: skip


def turned(roll, pitch, yaw):
    """Rotation matrices R = Rz(yaw) Ry(pitch) Rx(roll), frame → world."""
    roll, pitch, yaw = np.broadcast_arrays(roll, pitch, yaw)
    zero, one = np.zeros_like(roll), np.ones_like(roll)

    def matrix(*rows):
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    c, s = np.cos, np.sin
    about_x = matrix((one, zero, zero), (zero, c(roll), -s(roll)), (zero, s(roll), c(roll)))
    about_y = matrix((c(pitch), zero, s(pitch)), (zero, one, zero), (-s(pitch), zero, c(pitch)))
    about_z = matrix((c(yaw), -s(yaw), zero), (s(yaw), c(yaw), zero), (zero, zero, one))
    return about_z @ about_y @ about_x


# ---- where the tire touches ----


def blended(tire, normal, centre):
    """Brute force: every disc as a circle of points. Depth under a plane through the origin with ``normal`` (frame
    coordinates) and lever from the centre, both blended over the discs, and the deepest disc's offset."""
    angle = np.linspace(0.0, 2 * np.pi, 20001)
    circle = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)
    inner, outer = tire.disc_offset_inner, tire.disc_offset_outer
    offsets = np.array([0.0, -inner, inner, -outer, outer])
    drops = np.array([0.0, *[tire.disc_drop_inner] * 2, *[tire.disc_drop_outer] * 2])
    levers, depths = [], []
    for offset, drop in zip(offsets, drops, strict=True):
        lever = np.array([0.0, offset, 0.0]) + (tire.radius - drop) * circle
        depth = -(centre + lever) @ normal
        k = int(np.argmax(depth))
        levers.append(lever[k])
        depths.append(depth[k])
    depths = np.array(depths)
    depth = BLEND * (logsumexp(depths / BLEND) - logsumexp(-drops / BLEND))
    share = softmax(depths / BLEND)
    return depth, share @ np.array(levers) - (depth - share @ depths) * normal, offsets[np.argmax(depths)]


# The brute circle misses the lowest point by up to r (1 − cos(π/20000)) = 7e-9 m in depth and r π/20000 = 9e-5 m
# sideways. Float32: heights of some 0.6 m with a dozen roundings each.
DEPTH_ERROR = 1e-8 + 16 * ROUNDOFF * 1.0
SIDE_ERROR = 1e-4


def random_poses(count, seed):
    """Wheels rolled and pitched by up to 12 degrees, any heading, on slopes of up to 15 degrees."""
    rng = np.random.default_rng(seed)
    tilt, heading = rng.uniform(0.0, np.radians(15), count), rng.uniform(0, 2 * np.pi, count)
    normal = np.stack([np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), np.cos(tilt)], axis=-1)
    ground = changed(LEVEL, normal=normal)
    rotation = rounded(
        turned(rng.uniform(-0.2, 0.2, count), rng.uniform(-0.2, 0.2, count), rng.uniform(-np.pi, np.pi, count))
    )
    centre = rounded(rng.uniform([-1.5, -1.0, -0.2], [1.5, 1.0, 0.2], (count, 3)))
    # the centre stands at 0.5 to 0.57 m over the plane: every tire touches (least radius 0.585 less camber)
    world_normal = columns(ground).normal
    height = rng.uniform(0.5, 0.57, count)
    along = rng.uniform(-3.0, 3.0, (count, 3))
    along -= np.sum(along * world_normal, axis=-1, keepdims=True) * world_normal
    wheel = along + height[:, None] * world_normal
    origin = rounded(wheel - np.einsum("nij,nj->ni", rotation, centre))
    return SimpleNamespace(ground=ground, rotation=rotation, origin=origin, centre=centre)


def in_frame(poses, i):
    """Ground normal and wheel centre (from the plane's origin) in frame coordinates, float64."""
    rotation = poses.rotation[i]
    normal = rotation.T @ columns(poses.ground).normal[i]
    return normal, rotation.T @ poses.origin[i] + poses.centre[i]


def test_cambered_wheel_rests_on_its_deepest_discs():
    count = 300
    poses = random_poses(count, 1)
    stiff = changed(TIRE, damping=0.0, rolling_resistance=0.0)
    c = touch(stiff, poses.ground, poses.rotation, poses.origin, poses.centre)
    tire = columns(TIRE)
    seen = set()
    for i in range(count):
        normal, centre = in_frame(poses, i)
        depth, lever, offset = blended(tire, normal, centre)
        seen.add(round(float(offset), 2))
        # origin and centre are several metres: their products round
        slack = DEPTH_ERROR + 16 * ROUNDOFF * 5.0
        assert c.load[i] == pytest.approx(tire.stiffness * depth, abs=tire.stiffness * slack)
        np.testing.assert_allclose(c.force[i], c.load[i] * normal, rtol=0, atol=c.load[i] * 16 * ROUNDOFF)
        moment = np.cross(lever, c.force[i])
        np.testing.assert_allclose(c.moment[i], moment, rtol=0, atol=2 * SIDE_ERROR * c.load[i])
    assert seen == {-0.24, -0.13, 0.0, 0.13, 0.24}


def test_upright_wheel_rests_on_its_middle_disc():
    c = touch()
    tire = columns(TIRE)
    assert c.load == pytest.approx(tire.stiffness * 0.05, rel=16 * ROUNDOFF * 0.6 / 0.05)
    np.testing.assert_allclose(c.force, [0.0, 0.0, c.load], atol=1e-9)
    np.testing.assert_allclose(c.moment, 0.0, atol=1e-9)


def test_equally_deep_discs_share_the_contact():
    """A tire without crown: all five discs touch at once, as deep as one does, and none takes the force aside."""
    flat = changed(TIRE, disc_drop_inner=0.0, disc_drop_outer=0.0)
    c = touch(flat)
    assert c.load == pytest.approx(columns(TIRE).stiffness * 0.05, rel=16 * ROUNDOFF * 0.6 / 0.05)
    np.testing.assert_allclose(c.moment / c.load, 0.0, atol=8 * ROUNDOFF)


def test_leaning_tire_does_no_work_against_itself():
    """The normal force derives from a potential: leaning by dφ about the wheel's centre, the energy k δ²/2 changes by
    the moment. Without the blend the moment jumps from disc to disc instead, 4 kN m at a full load.

    Central differences over 2e-3 rad: the blend turns the moment within ε/offset = 8e-3 rad, so they err by a part in
    some (2e-3/8e-3)²/6 = 1 % of the change that a disc makes, 0.13 m of lever.
    """
    tire = changed(TIRE, damping=0.0, rolling_resistance=0.0)
    roll = np.linspace(-0.2, 0.2, 401)
    lean, step = turned(roll, 0.0 * roll, 0.0 * roll), roll[1] - roll[0]
    c = touch(tire, rotation=lean, centre=np.array([0.0, 0.0, 0.0]), origin=np.array([0.0, 0.0, 0.55]))
    k = float(columns(TIRE).stiffness)
    energy = c.load**2 / (2.0 * k)
    torque = -(energy[2:] - energy[:-2]) / (2.0 * step)
    np.testing.assert_allclose(c.moment[1:-1, 0], torque, atol=0.01 * 0.13 * c.load.max())
    assert np.abs(np.diff(c.moment[:, 0] / c.load)).max() < step * 0.24**2 / BLEND


def test_depth_is_measured_along_the_slopes_normal():
    """A wheel that stands upright on a slope of 20 degrees, heading up it."""
    climb = np.radians(20.0)
    normal = np.array([-np.sin(climb), 0.0, np.cos(climb)])
    ground = changed(LEVEL, normal=normal)
    c = touch(
        ground=ground, rotation=turned(0.0, -climb, 0.0), origin=2.0 * np.array([np.cos(climb), 0, np.sin(climb)])
    )
    # the frame is parallel to the slope and the wheel's centre 0.55 m off it
    assert c.load == pytest.approx(450e3 * 0.05, rel=32 * ROUNDOFF * 2.0 / 0.05)
    np.testing.assert_allclose(c.force / c.load, [0.0, 0.0, 1.0], atol=8 * ROUNDOFF)
    # with the frame level in the world, the force leans back and the contact lies in front of the centre
    level = touch(ground=ground, centre=(0.0, 0.0, 0.55 / np.cos(climb)))
    assert level.load == pytest.approx(450e3 * 0.05, rel=32 * ROUNDOFF * 0.6 / 0.05)
    np.testing.assert_allclose(level.force / level.load, normal, atol=8 * ROUNDOFF)
    np.testing.assert_allclose(level.moment / level.load, 0.0, atol=8 * ROUNDOFF)


def test_no_contact_no_force_and_bristles_at_rest():
    c = touch(centre=(0.0, 0.0, 0.601), velocity=(3.0, 1.0, -2.0), spin=5.0, bristle_x=0.02, bristle_y=-0.02)
    for value in (c.force, c.moment, c.load, c.bristle_x, c.bristle_y):
        np.testing.assert_array_equal(value, 0.0)


# ---- normal force ----


def test_load_is_spring_and_damper_and_never_pulls():
    rng = np.random.default_rng(2)
    depth, sink = rng.uniform(0.001, 0.1, 1000), rounded(rng.normal(0.0, 3.0, 1000))
    height = rounded(0.6 - depth)
    position = np.stack([0 * height, 0 * height, height], axis=-1)
    c = touch(centre=position, velocity=np.stack([0 * sink, 0 * sink, -sink], axis=-1))
    tire = columns(TIRE)
    expected = np.maximum(tire.stiffness * (tire.radius - height) + tire.damping * sink, 0.0)
    # the depth is a difference of 0.6 m
    slack = tire.stiffness * 4 * ROUNDOFF * 0.6 + 8 * ROUNDOFF * (expected + tire.damping * np.abs(sink))
    assert np.all(np.abs(c.load - expected) <= slack)
    assert np.any(expected == 0.0)
    lifted = c.load == 0.0
    np.testing.assert_array_equal(c.force[lifted], 0.0)
    np.testing.assert_array_equal(c.moment[lifted], 0.0)
    np.testing.assert_allclose(c.force[:, 2], c.load, rtol=4 * ROUNDOFF)


def test_spin_and_yaw_do_not_load_the_damper():
    """The contact's normal speed is the centre's: turning about the axle or the vertical adds none."""
    resting = touch()
    for motion in ({"spin": 30.0}, {"omega": (0.0, 0.0, 2.0)}, {"omega": (0.0, 5.0, 0.0)}):
        assert touch(**motion).load == resting.load


# ---- swivelling ----

SCRUB = changed(TIRE, scrub_radius=0.12)


def test_slow_swivel_twists_the_patch_up_to_its_angle():
    """A wheel that stands and is swivelled to ψ: w = ψ₀ (1 − exp(−ψ/ψ₀)), M = −μ_c F_n r w/ψ₀ about the normal."""
    psi, steps = np.array([0.02, 0.1, 0.349, 1.0]), 2000
    for sense in (1.0, -1.0):
        omega = np.stack([0.0 * psi, 0.0 * psi, rounded(sense * psi)], axis=-1)  # one second
        moved = touch(tire=SCRUB, omega=omega, dt=1.0 / steps, steps=steps)
        expected = sense * 0.15 * (1.0 - np.exp(-psi / 0.15))
        # implicit Euler: half a step's share of the angle, λ dt/2 with λ = ψ̇/ψ₀ ≤ 6.7, at most 1/e of the goal
        np.testing.assert_allclose(moved.twist, expected, atol=0.15 * psi.max() / 0.15 / steps / 2 / np.e + 1e-6)
        held = touch(tire=SCRUB, twist=moved.twist)
        torque = -0.7 * held.load * 0.12 * moved.twist / 0.15
        np.testing.assert_allclose(held.moment[:, 2], torque, rtol=16 * ROUNDOFF, atol=1e-3)
    assert np.all(touch(omega=(0.0, 0.0, 1.0), steps=100).moment[..., 2] == 0.0)


def test_grip_of_the_ground_scales_the_torque_of_swivelling():
    full, wet = (
        touch(tire=SCRUB, ground=changed(LEVEL, friction=grip), twist=0.1).moment[..., 2] for grip in (1.0, 0.3)
    )
    assert wet == pytest.approx(0.3 * full, rel=8 * ROUNDOFF)


def test_rolling_renews_the_patch():
    """On a circle of curvature κ: w = κ/(κ/ψ₀ + 1/ℓ), ℓ the chord of the pressed-in disc; straight on it dies out."""
    speed, steps = 0.75, 8000
    chord = 2.0 * np.sqrt(0.6**2 - (0.6 - 0.05) ** 2)
    for curvature in (0.1, 1.0):
        rolling = {"velocity": (speed, 0.0, 0.0), "spin": speed / 0.55}
        circle = touch(tire=SCRUB, omega=(0.0, 0.0, speed * curvature), dt=1e-3, steps=steps, **rolling)
        # ℓ = 2 √(2Rδ) is the chord to first order in δ/R: 2 √(2Rδ − δ²) is shorter by δ/4R = 2 %, and counts in part
        assert circle.twist == pytest.approx(curvature / (curvature / 0.15 + 1.0 / chord), rel=0.03)
        straight = touch(tire=SCRUB, twist=circle.twist, dt=1e-3, steps=steps, **rolling)
        assert abs(straight.twist) < 1e-4 * circle.twist


def shares(middle=0.05):
    """Depths of the five discs of an upright wheel over their sum, and the discs' offsets."""
    depth = middle - np.array([0.015, 0.003, 0.0, 0.003, 0.015])
    return depth / depth.sum(), np.array([-0.24, -0.13, 0.0, 0.13, 0.24])


def grip_at(speed):
    """Steady friction coefficient g(v) on asphalt."""
    return 0.7 + 0.1 * np.exp(-((speed / 0.1) ** 2))


@pytest.mark.parametrize("rate", [0.05, 0.5, 5.0])
def test_five_discs_hold_a_swivelled_wheel_up_to_their_sliding_torque(rate):
    """A wheel that stands is swivelled by ψ: w = ψ₀ (1 − exp(−ψ/ψ₀)), ψ₀ = g/(σ₀ y) of the inner discs; each disc pulls by
    σ₀ y w up to g of its own speed, on a lever y, and all slide at F_n Σ w_i |y_i| g."""
    tire, (share, lever) = obeying(swivel="five_discs"), shares()
    angle = grip_at(rate * 0.13) / (16.0 * 0.13)
    psi, steps = np.array([0.02, 0.1, 0.3, 1.0, 5.0]), 4000
    for sense in (1.0, -1.0):
        c = touch(tire, omega=(0.0, 0.0, sense * rate), dt=psi / rate / steps, steps=steps)
        twist = angle * (1.0 - np.exp(-psi / angle))
        pull = np.minimum(16.0 * np.abs(lever) * twist[:, None], grip_at(rate * np.abs(lever)))
        expected = -sense * c.load * (share * np.abs(lever) * pull).sum(axis=-1)
        # implicit Euler and the middle of the last step: ψ/steps of the winding, at most psi/ψ₀/4000 = 4e-3
        np.testing.assert_allclose(c.moment[:, 2], expected, rtol=4e-3)
        np.testing.assert_array_equal(c.force[:, :2], 0.0)
    sliding = c.load[-1] * (share * np.abs(lever) * grip_at(rate * np.abs(lever))).sum()
    assert abs(c.moment[-1, 2]) == pytest.approx(sliding, rel=1e-3)


def test_five_discs_turn_freely_while_they_slide_along():
    """A locked wheel that slides ahead fast: all discs pull by g, whose levers balance."""
    speed, rate = 3.0, 0.1
    c = touch(obeying(swivel="five_discs"), velocity=(speed, 0.0, 0.0), omega=(0.0, 0.0, rate), steps=2000)
    # bristles at ±y differ by the bend over which they slide, ψ̇ y/v of g/σ₀
    assert c.twist == pytest.approx(0.7 / 16.0 * rate / speed, rel=1e-3)
    assert abs(c.moment[2]) < 0.7 * c.load * 0.24 * rate * 0.24 / speed
    assert abs(touch(obeying(swivel="five_discs"), omega=(0.0, 0.0, rate), steps=2000).moment[2]) > 0.05 * c.load


def test_a_leaning_tires_discs_count_from_their_loads_mean():
    """A longitudinal bristle alone pulls at the contact: the discs add no torque, however uneven their loads."""
    pose = {"rotation": turned(0.08, 0.0, 0.0), "centre": (0.0, 0.0, 0.55), "bristle_x": 0.01}
    plain, discs = touch(TIRE, **pose), touch(obeying(swivel="five_discs"), **pose)
    np.testing.assert_allclose(discs.moment, plain.moment, atol=8 * ROUNDOFF * 0.3 * 0.16 * plain.load)
    np.testing.assert_array_equal(discs.force, plain.force)


def test_bore_torque_is_a_spring_that_slides_and_unloads_at_once():
    """Wound up by ψ and back: k ψ up to μ F_n R_B, and from there by k a radian back."""
    tire, rate, steps = obeying(swivel="bore_torque"), 0.2, 1000
    psi = np.array([0.01, 0.05, 0.1, 0.3, 1.0])
    wound = touch(tire, omega=(0.0, 0.0, rate), dt=psi / rate / steps, steps=steps)
    limit = 0.7 * wound.load * 0.13
    held = touch(tire, twist=wound.twist)
    np.testing.assert_allclose(held.moment[:, 2], -np.minimum(15e3 * psi, limit), rtol=steps * ROUNDOFF)
    back = touch(tire, omega=(0.0, 0.0, -rate), twist=wound.twist, dt=0.05 / rate / steps, steps=steps)
    released = touch(tire, twist=back.twist)
    expected = -np.maximum(np.minimum(15e3 * psi, limit) - 15e3 * 0.05, -limit)
    np.testing.assert_allclose(released.moment[:, 2], expected, atol=float(limit.max()) * steps * ROUNDOFF)


@pytest.mark.parametrize("swivel", ["five_discs", "bore_torque"])
def test_rolling_renews_the_patch_by_any_law_of_swivelling(swivel):
    """On a circle of curvature κ: w = κ/(κ/ψ₀ + 1/ℓ), or κ ℓ of a spring; straight on it dies out."""
    tire, speed, curvature, steps = obeying(swivel=swivel), 0.75, 0.1, 8000
    chord = 2.0 * np.sqrt(2.0 * 0.6 * 0.05)
    rolling = {"velocity": (speed, 0.0, 0.0), "spin": speed / 0.6}
    circle = touch(tire, omega=(0.0, 0.0, speed * curvature), dt=1e-3, steps=steps, **rolling)
    wound = curvature * 16.0 * 0.13 / grip_at(speed * curvature * 0.13) if swivel == "five_discs" else 0.0
    assert circle.twist == pytest.approx(curvature / (wound + 1.0 / chord), rel=1e-4)
    straight = touch(tire, twist=circle.twist, dt=1e-3, steps=steps, **rolling)
    assert abs(straight.twist) < 1e-4 * circle.twist


def test_a_bore_torque_replaces_the_scrub_and_discs_are_lengthened_by_it():
    """M ∝ mean offset + scrub radius of five discs, whose own is 0.4 (0.13 + 0.24) m; the bore torque has a radius of its
    own."""
    factors = {"bore_torque": 1.0, "five_discs": 1.0 + SCRUB["scrub_radius"] / 0.148}
    for swivel, factor in factors.items():
        plain, scrub = (
            touch(obeying(tire, swivel=swivel), omega=(0.0, 0.0, 0.5), steps=300).moment for tire in (TIRE, SCRUB)
        )
        np.testing.assert_allclose(scrub[2], factor * plain[2], rtol=4 * ROUNDOFF)


# ---- soft ground ----


def test_soft_ground_resists_moving_sideways_by_its_softness():
    """F_n c b v/√(v² + v₀²) across alone, b the rolling resistance beyond asphalt's over 0.05, at most 3."""
    multiplier = rounded(np.array([0.0, 1.0, 2.0, 5.0, 20.0, 50.0]))[:, None]
    slip = rounded(np.array([-2.0, -0.05, 0.0, 0.02, 0.5]))
    velocity = np.stack([0.3 + 0.0 * slip, slip, 0.0 * slip], axis=-1)
    ground = changed(LEVEL, rolling_resistance=multiplier)
    pushed, plain = (touch(tire, ground, velocity=velocity) for tire in (obeying(soft_ground="bulldozing"), TIRE))
    softness = np.clip(0.0125 * (multiplier - 1.0), 0.0, 0.15) / 0.05
    expected = -0.05 * softness * slip / np.sqrt(slip**2 + 0.05**2)
    difference = (pushed.force - plain.force) / plain.load[..., None]
    # of a difference of forces of up to (σ₁ + σ₂) v = 1
    np.testing.assert_allclose(difference[..., 1], expected, atol=16 * ROUNDOFF)
    np.testing.assert_array_equal(difference[..., [0, 2]], 0.0)
    np.testing.assert_array_equal(difference[:2], 0.0)


# ---- relaxation ----

RELAXED = changed(TIRE, slip_law=OPTIONS["slip"].index("relaxation"))


@pytest.mark.parametrize("speed", [0.1, 3.0, 30.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_force_follows_a_step_in_slip_over_the_relaxation_length(axis, speed):
    """F = F_n σ₀ ℓ s (1 − exp(−x/ℓ)) after a way x at slip s: 63 % after ℓ, then F_n σ₀ ℓ, at any speed."""
    length, sigma0, slip = ((0.3, 16.0), (0.5, 8.0))[axis] + (0.01,)
    way, steps = length * np.array([0.1, 1.0, 3.0, 15.0]), 3000
    velocity = np.array([speed, 0.0, 0.0])
    velocity[axis] += slip * speed
    c = touch(RELAXED, velocity=velocity, spin=speed / 0.6, dt=way / speed / steps, steps=steps)
    expected = -slip * sigma0 * length * (1.0 - np.exp(-way / length))
    # implicit Euler, and force in the middle of the last step: a step's share of the way each, 15/3000/2, of the end;
    # damping σ₁ ż adds σ₁ v/ℓ of it while it builds up, so bristles count; slip is a difference of speeds of float32
    slack = slip * sigma0 * length * (15.0 / steps + 4 * ROUNDOFF / slip)
    bristle = (c.bristle_x, c.bristle_y)[axis]
    np.testing.assert_allclose(-sigma0 * bristle, expected, atol=slack)
    assert c.force[-1, axis] / c.load[-1] == pytest.approx(-slip * sigma0 * length, abs=slack)


@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi / 2, 2.4, -1.0])
def test_a_locked_relaxing_tire_slides_along_its_force(heading):
    """F = F_n g(v) against the slip, whatever the bristles' stiffnesses; before, a spring F_n σ₀ x."""
    direction = np.array([np.cos(heading), np.sin(heading), 0.0])
    speed = rounded(SLIDES)
    c = touch(RELAXED, velocity=speed[:, None] * direction, dt=1.5 / 3000 / speed, steps=3000)
    expected = -grip_at(speed)[:, None] * direction[:2]
    # the last steps' yielding by a step's bend, k v dt = 16 · 5e-4 m of g
    np.testing.assert_allclose(c.force[:, :2] / c.load[:, None], expected, atol=16.0 * 1.5 / 3000 / 0.7 * 0.1)
    moved = touch(RELAXED, velocity=1e-3 * direction, dt=1e-3, steps=1000)
    still = touch(RELAXED, bristle_x=moved.bristle_x, bristle_y=moved.bristle_y)
    spring = -1e-3 * np.array([16.0, 8.0]) * direction[:2]
    np.testing.assert_allclose(still.force[:2] / still.load, spring, atol=1000 * ROUNDOFF * 0.016)


def test_return_to_the_friction_circle_is_the_closest_point():
    """f (1 + γ k) = f⁰ with |f| = g, the root γ found in float64; inside it nothing changes."""
    rng = np.random.default_rng(11)
    count = 500
    stiffness = rounded(10.0 ** rng.uniform(0.7, 2.3, (count, 2)))
    grip, angle = rounded(rng.uniform(0.01, 1.5, count)), rng.uniform(0.0, 2.0 * np.pi, count)
    # a step of 2 ms at 5 m/s of the stiffest bristle, 2, beyond the least grip or within it
    size = grip * rng.uniform(0.1, 2.0, count)
    force = rounded(np.stack([size * np.cos(angle), size * np.sin(angle)], axis=-1))
    out = launch(circle_kernel, force, stiffness, grip)
    for f, k, g, found in zip(force, stiffness, grip, out, strict=True):
        expected = f
        if np.hypot(*f) > g:
            give = brentq(lambda x, f=f, k=k, g=g: np.hypot(*(f / (1.0 + x * k))) - g, 0.0, 1e3, xtol=1e-15)
            expected = f / (1.0 + give * k)
        np.testing.assert_allclose(found, expected, atol=2e-3 * g)
        assert np.hypot(*found) <= g * (1.0 + 4 * ROUNDOFF) or np.array_equal(found, f)


def test_a_relaxing_tire_stays_in_its_friction_circle_at_any_speed():
    """Random slips, spins and steps from random bristles: |F| ≤ F_n μ g(v), bristles within it; and it settles, at 2 ms."""
    rng = np.random.default_rng(12)
    count = 3000
    velocity = np.concatenate([rng.normal(0.0, 10.0, (count, 2)), np.zeros((count, 1))], axis=-1)
    spin, dt = rng.normal(0.0, 20.0, count), 10.0 ** rng.uniform(-4.0, -2.7, count)
    bristle = rng.normal(0.0, 0.2, (2, count))
    once = touch(RELAXED, velocity=velocity, spin=spin, bristle_x=bristle[0], bristle_y=bristle[1], dt=dt)
    speed = np.hypot(velocity[:, 0] - 0.6 * spin, velocity[:, 1])
    limit = once.load * (0.7 + 0.1 * np.exp(-((speed / 0.1) ** 2)))
    assert np.all(np.hypot(once.force[:, 0], once.force[:, 1]) <= limit * (1.0 + 1e-4))
    assert np.all(np.hypot(16.0 * once.bristle_x, 8.0 * once.bristle_y) <= limit / once.load * (1.0 + 1e-4))
    some = {"velocity": velocity[:200], "spin": spin[:200], "dt": 2e-3}
    late, later = (touch(RELAXED, **some, steps=steps) for steps in (3000, 3001))
    np.testing.assert_allclose(later.force, late.force, atol=1e-3 * float(late.load.max()))


# ---- friction ----


def test_capacity_falls_from_static_to_coulomb_friction():
    speed = rounded(np.array([0.0, 0.05, 0.1, 0.3, 5.0, -0.1]))
    expected = 0.5 * (0.7 + 0.1 * np.exp(-((speed / 0.1) ** 2)))
    np.testing.assert_allclose(launch(capacity_kernel, TIRE, speed, 0.5), expected, rtol=16 * ROUNDOFF)


def test_bristle_follows_its_differential_equation():
    """ż = v − λ z: z = v/λ + (z₀ − v/λ) exp(−λt), first order in the step."""
    z0, slip, unload, span = 0.01, -0.3, 6.0, 0.2
    exact = slip / unload + (z0 - slip / unload) * np.exp(-unload * span)
    errors = [launch(bristle_kernel, z0, slip, unload, span / n, n) - exact for n in (100, 200)]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.02)
    # the global error of implicit Euler: λ dt/2 · λt e^(−λt) of the size v/λ − z₀, at most 1/e of it
    assert abs(errors[1]) <= unload * span / 200 / 2 / np.e * abs(z0 - slip / unload)


def test_bristle_is_stable_at_any_step():
    """Never beyond the larger of start and v/λ, on the way from one to the other."""
    rng = np.random.default_rng(3)
    count = 2000
    start, slip = rounded(rng.normal(0.0, 0.05, count)), rounded(rng.normal(0.0, 10.0, count))
    unload, dt = rounded(10.0 ** rng.uniform(-1, 4, count)), rounded(10.0 ** rng.uniform(-4, 1, count))
    end = launch(bristle_kernel, start, slip, unload, dt, 1)
    goal = slip / unload
    slack = 8 * ROUNDOFF * (np.abs(start) + np.abs(goal))
    assert np.all((end - start) * np.sign(goal - start) >= -slack)
    assert np.all((goal - end) * np.sign(goal - start) >= -slack)


SLIDES = np.array([0.02, 0.1, 0.5, 3.0])


@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi / 2, 2.4, np.pi, -1.0])
@pytest.mark.parametrize("ground_friction", [1.0, 0.3])
def test_steady_slide_meets_capacity_and_viscous_part(heading, ground_friction):
    """F = F_n (g(v) + σ₂ v) against the slip; both directions share one capacity."""
    tire = columns(TIRE)
    direction = np.array([np.cos(heading), np.sin(heading), 0.0])
    speed = rounded(SLIDES)
    ground = changed(LEVEL, friction=ground_friction)
    velocity = speed[:, None] * direction
    # 1.5 m of slide are 8·1.5/0.8 > 15 relaxation lengths g/σ₀ of the softer direction, in steps of 1/200 of one
    steps = 3000
    c = touch(ground=ground, velocity=velocity, dt=1.5 / steps / speed, steps=steps)
    g = rounded(ground_friction) * (0.7 + 0.1 * np.exp(-((speed / 0.1) ** 2)))
    viscous = np.array([tire.sigma2_longitudinal, tire.sigma2_lateral])
    expected = -(g[:, None] + viscous * speed[:, None]) * direction[:2]
    # e⁻¹⁵ of the capacity is left of the transient; steady float32: λ dt = 0.01, so a rounding of z counts hundredfold
    slack = g * (np.exp(-15.0) + 200 * 4 * ROUNDOFF)
    np.testing.assert_allclose(c.force[:, :2] / c.load[:, None], expected, atol=float(np.max(slack)))
    along = np.linalg.norm(c.force[:, :2] / c.load[:, None] + viscous * velocity[:, :2], axis=-1)
    assert np.all(along <= g * (1 + 1e-4))


def test_small_deflection_is_elastic():
    """Pushed by a tenth of a millimetre: F = −F_n σ₀ x, in either direction."""
    tire = columns(TIRE)
    for axis, sigma0 in ((0, tire.sigma0_longitudinal), (1, tire.sigma0_lateral)):
        for sign in (1.0, -1.0):
            velocity = np.zeros(3)
            velocity[axis] = sign * 1e-4
            moved = touch(velocity=velocity, dt=1e-3, steps=1000)
            bristle = (moved.bristle_x, moved.bristle_y)[axis]
            # it yields by σ₀ x/g: 16 · 1e-4/0.8 = 2e-3 at the end, half of it on the way; viscous terms σ₁ v / σ₀ x = 6e-2
            assert bristle == pytest.approx(sign * 1e-4, rel=2e-3)
            still = touch(
                velocity=ZERO,
                bristle_x=moved.bristle_x,
                bristle_y=moved.bristle_y,
            )
            assert still.force[axis] == pytest.approx(-sign * still.load * sigma0 * 1e-4, rel=2e-3)
            assert still.force[1 - axis] == pytest.approx(0.0, abs=1e-6)


def test_bristle_damping_and_viscous_part_act_at_once():
    """First instant of a slip from rest: F = −F_n (σ₁ + σ₂) v."""
    tire = columns(TIRE)
    dt = 1e-6
    for axis, name in ((0, "longitudinal"), (1, "lateral")):
        velocity = np.zeros(3)
        velocity[axis] = 0.01
        c = touch(velocity=velocity, dt=dt)
        expected = -(getattr(tire, f"sigma1_{name}") + getattr(tire, f"sigma2_{name}")) * float(rounded(0.01))
        # the spring's part: σ₀ v dt/2, five orders below
        assert c.force[axis] / c.load == pytest.approx(expected, rel=1e-4)


def test_friction_lies_in_the_grounds_plane_on_any_slope():
    """First instant of a slide of a tilted wheel on a slope: F_t = −F_n σ₁ v_t for a tire alike in both directions, and
    along the wheel's plane alone if it resists there only."""
    count = 300
    poses = random_poses(count, 7)
    rng = np.random.default_rng(7)
    bare = changed(TIRE, damping=0.0, sigma2_longitudinal=0.0, sigma2_lateral=0.0, rolling_resistance=0.0)
    alike = changed(bare, sigma0_lateral=16.0, sigma1_lateral=1.0)
    along = changed(bare, sigma0_lateral=0.0, sigma1_lateral=0.0)
    velocity = rounded(rng.normal(0.0, 1.0, (count, 3)))
    normal = np.einsum("nji,nj->ni", poses.rotation, columns(poses.ground).normal)
    in_plane = velocity - np.sum(normal * velocity, axis=-1, keepdims=True) * normal
    # across the wheel's axle and in the ground's plane
    ahead = np.cross(np.array([0.0, 1.0, 0.0]), normal)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    dt = 1e-6
    for tire, slip in ((alike, in_plane), (along, np.sum(ahead * velocity, axis=-1, keepdims=True) * ahead)):
        c = touch(tire, poses.ground, poses.rotation, poses.origin, poses.centre, velocity=velocity, dt=dt)
        friction = c.force / c.load[:, None] - normal
        # over dt the spring adds σ₀ v dt/2 and the bristle gives way by σ₀ |v| dt/g: 1e-5 and 2e-5 |v| of σ₁ v
        speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
        assert np.all(np.abs(friction + slip) <= 4e-5 * (speed + speed**2) + 32 * ROUNDOFF)


def test_reversal_unloads_before_it_pulls_the_other_way():
    """From a full slide back by s: z = (g/σ₀)(2 exp(−σ₀ s/g) − 1), zero after s = ln 2 · g/σ₀."""
    smooth = changed(TIRE, sigma1_longitudinal=0.0, sigma2_longitudinal=0.0, friction_static=0.7)
    reach = 0.7 / 16.0
    speed, steps = 0.2, 4000
    ahead = touch(smooth, velocity=(speed, 0.0, 0.0), dt=20 * reach / speed / steps, steps=steps)
    assert ahead.force[0] == pytest.approx(-0.7 * ahead.load, rel=1e-3)
    back = np.array([0.01, 0.3, np.log(2.0), 1.0, 3.0])
    c = touch(
        smooth, velocity=(-speed, 0.0, 0.0), bristle_x=ahead.bristle_x, dt=back * reach / speed / steps, steps=steps
    )
    expected = -0.7 * (2.0 * np.exp(-back) - 1.0)
    # first order: λ dt/2 ≤ 3/4000/2 of the size 1.4; the force lies in the middle of the last step: the same again;
    # float32: √steps roundings
    np.testing.assert_allclose(c.force[:, 0] / c.load, expected, atol=1.4 * 3 / steps + np.sqrt(steps) * ROUNDOFF)
    assert np.all(c.force[:2, 0] < 0.0)
    assert np.all(c.force[3:, 0] > 0.0)


@pytest.mark.parametrize(
    "laws",
    [{}, {"slip": "relaxation"}, {"swivel": "five_discs"}, {"swivel": "bore_torque"}, {"soft_ground": "bulldozing"}],
    ids=lambda laws: "".join(laws.values()) or "default",
)
def test_dragging_a_tire_never_yields_work(laws):
    """Whatever the path from rest, slow or fast, along, across or both, locked or rolling, and turning where it resists
    that: the tire never gives back more than it took.
    """
    rng = np.random.default_rng(6)
    count, steps, dt = 1000, 4000, 1e-3
    t = dt * np.arange(steps)
    slip = np.zeros((3, count, steps))
    for _ in range(3):
        size, frequency = 10.0 ** rng.uniform(-3.0, 0.0, (3, count, 1)), rng.uniform(0.05, 5.0, (3, count, 1))
        slip += size * np.sin(2 * np.pi * frequency * t + rng.uniform(0.0, 6.3, (3, count, 1)))
    slip[:, : count // 4] *= np.array([1.0, 0.0, 0.0])[:, None, None]
    slip[:, count // 4 : count // 2] *= np.array([0.0, 1.0, 0.0])[:, None, None]
    if "swivel" not in laws:
        slip[2] = 0.0
    roll = np.where(np.arange(count) % 2, 10.0 ** rng.uniform(-2.0, 1.0, count), 0.0)
    roll *= bool(laws)  # LuGre's bristles do not roll out of the contact
    ground = changed(LEVEL, rolling_resistance=5.0)
    work = launch(drag_kernel, obeying(**laws), ground, roll, *slip, dt, length=steps)
    path = np.cumsum(np.hypot(slip[0], slip[1]) + 0.24 * np.abs(slip[2]), axis=-1) * dt
    # a few roundings of μ |v| dt a step, and of the rolling speed that the slip is a difference from
    assert np.all(work >= -16 * ROUNDOFF * 0.8 * path - 16 * ROUNDOFF * (roll[:, None] + 0.1) * (t + dt))
    assert np.all(work[:, -1] > 0.0)


def test_friction_does_not_depend_on_the_step():
    """Half the step, nearly the same force: first order."""
    velocity = (0.05, 0.03, 0.0)
    forces = [touch(velocity=velocity, dt=0.5 / n, steps=n).force for n in (250, 500, 1000)]
    np.testing.assert_allclose((forces[0] - forces[1])[:2] / (forces[1] - forces[2])[:2], 2.0, rtol=0.1)


def test_rolling_wheel_has_no_slip():
    """v = Ω r: neither bristle bends; at a slip of 1 % they do."""
    spin = 3.0
    c = touch(velocity=(0.6 * spin, 0.0, 0.0), spin=spin, steps=100)
    # 0.6 · 3 m/s rounds to an ulp, over 0.1 s
    assert abs(c.bristle_x) <= 0.1 * 4 * ROUNDOFF * 1.8
    assert c.force[0] == pytest.approx(0.0, abs=c.load * 20 * 4 * ROUNDOFF * 1.8)
    assert touch(velocity=(0.6 * spin * 1.01, 0.0, 0.0), spin=spin, steps=100).force[0] < -100.0


def test_locked_wheel_is_braked_and_spun_up():
    c = touch(velocity=(2.0, 0.0, 0.0), steps=200)
    assert c.force[0] < -0.5 * c.load
    assert c.moment[1] == pytest.approx(-0.6 * c.force[0], rel=8 * ROUNDOFF)
    assert c.moment[1] > 0.0


def test_spinning_wheel_drives_and_is_slowed():
    c = touch(spin=5.0, steps=200)
    assert c.force[0] > 0.5 * c.load
    assert c.moment[1] < -0.5 * 0.6 * c.load
    reverse = touch(spin=-5.0, steps=200)
    assert reverse.force[0] == pytest.approx(-c.force[0], rel=16 * ROUNDOFF)
    assert reverse.moment[1] == pytest.approx(-c.moment[1], rel=16 * ROUNDOFF)


def test_side_slip_is_opposed_and_tips_the_wheel():
    c = touch(velocity=(0.0, 1.0, 0.0), steps=2000)
    assert c.force[1] < -0.5 * c.load
    # lever (0, 0, −r) × (0, F, 0) = (r F, 0, 0)
    assert c.moment[0] == pytest.approx(0.6 * c.force[1], rel=8 * ROUNDOFF)


def test_slip_counts_the_frames_turning_at_the_contact():
    """Roll rate moves the contact sideways by ω_x r; the pitch rate is not counted (the spin is absolute)."""
    rolling = touch(omega=(1.0, 0.0, 0.0), dt=1e-6)
    sliding = touch(velocity=(0.0, 0.6, 0.0), dt=1e-6)
    np.testing.assert_allclose(rolling.force, sliding.force, rtol=1e-5)
    np.testing.assert_array_equal(touch(omega=(0.0, 1.0, 0.0), steps=10).force, touch(steps=10).force)
    # on the right discs of a cambered wheel a yaw rate moves the contact forwards: ω_z × (0, −y, 0) = (ω y, 0, 0)
    pose = {"rotation": turned(0.15, 0.0, 0.0), "centre": (0.0, 0.0, 0.52)}
    upward = turned(0.15, 0.0, 0.0).T @ [0.0, 0.0, 1.0]
    lever = blended(columns(TIRE), upward, np.array([0.0, 0.0, 0.52]))[1]
    assert lever[1] < -columns(TIRE).disc_offset_inner
    yawing = touch(**pose, omega=(0.0, 0.0, 1.0), dt=1e-6)
    moving = touch(**pose, velocity=(-lever[1], 0.0, 0.0), dt=1e-6)
    assert moving.moment[0] != 0.0
    np.testing.assert_allclose(yawing.force, moving.force, rtol=1e-5, atol=1e-2)


def test_contact_turns_with_the_world():
    """Objectivity: pose, ground and nothing else turned about the vertical and tilted leave the frame's view alone."""
    rng = np.random.default_rng(4)
    count = 200
    poses = random_poses(count, 5)
    motion = {
        "velocity": rng.normal(0.0, 1.0, (count, 3)),
        "omega": rng.normal(0.0, 0.5, (count, 3)),
        "spin": rng.normal(0.0, 3.0, count),
        "bristle_x": rng.normal(0.0, 0.02, count),
        "bristle_y": rng.normal(0.0, 0.02, count),
    }
    first = touch(TIRE, poses.ground, poses.rotation, poses.origin, poses.centre, **motion)
    turn = turned(rng.uniform(-0.2, 0.2, count), rng.uniform(-0.2, 0.2, count), rng.uniform(-3, 3, count))
    ground = changed(poses.ground, normal=np.einsum("nij,nj->ni", turn, columns(poses.ground).normal))
    origin = np.einsum("nij,nj->ni", turn, poses.origin)
    second = touch(TIRE, ground, turn @ poses.rotation, origin, poses.centre, **motion)
    # depths differ by the roundings of metres (stiffness · 64 · 2⁻²⁴ · 5 m = 9 N); on a tie of two discs the force may
    # jump over: the poses' closest pair is far apart
    np.testing.assert_allclose(second.load, first.load, atol=450e3 * 64 * ROUNDOFF * 5.0)
    np.testing.assert_allclose(second.force, first.force, atol=450e3 * 128 * ROUNDOFF * 5.0)
    np.testing.assert_allclose(second.moment, first.moment, atol=450e3 * 128 * ROUNDOFF * 5.0)


# ---- rolling resistance ----


def rolling_torque(factor=1.0, **motion):
    """Torque [N m] that rolling resistance adds about the axle, and the load [N]."""
    ground = changed(LEVEL, rolling_resistance=factor)
    rolling = touch(ground=ground, **motion)
    free = touch(changed(TIRE, rolling_resistance=0.0), ground=ground, **motion)
    np.testing.assert_array_equal(rolling.force, free.force)
    np.testing.assert_array_equal(rolling.moment[..., [0, 2]], free.moment[..., [0, 2]])
    return rolling.moment[..., 1] - free.moment[..., 1], rolling.load


# a difference of moments about the axle of up to 1 · F_n · 0.6 m, of a few roundings each
MOMENT_ERROR = 8 * ROUNDOFF * 0.6


def test_rolling_resistance_brakes_the_wheel():
    """−c_rr F_n r tanh(Ω/0.05 rad/s) about the axle, and no force."""
    spin = rounded(np.array([-4.0, -0.05, 0.0, 0.02, 0.05, 4.0]))
    for factor in (1.0, 3.0):
        # rolling without slip, so that friction's own moment is small
        velocity = np.stack([0.6 * spin, 0 * spin, 0 * spin], axis=-1)
        torque, load = rolling_torque(factor, spin=spin, velocity=velocity)
        expected = -0.0125 * factor * load * 0.6 * np.tanh(spin / 0.05)
        np.testing.assert_allclose(torque, expected, rtol=32 * ROUNDOFF, atol=MOMENT_ERROR * float(load.max()))
        assert np.all(torque * spin <= 0.0)
        assert torque[2] == 0.0


@pytest.mark.parametrize("roll", [0.0, 0.05, -0.05, -0.15, 0.15])
def test_rolling_resistance_levers_the_contacts_radius(roll):
    """On a cambered wheel the torque about the axle is c_rr F_n r with the contact's distance from the axle."""
    lean = turned(roll, 0.0, 0.0)
    torque, load = rolling_torque(rotation=lean, centre=(0.0, 0.0, 0.52), spin=5.0)
    lever = blended(columns(TIRE), lean.T @ [0.0, 0.0, 1.0], lean.T @ [0.0, 0.0, 0.0] + [0.0, 0.0, 0.52])[1]
    expected = columns(TIRE).rolling_resistance * load * lever[2]
    assert torque == pytest.approx(expected, abs=MOMENT_ERROR * float(load))


# ---- hull ----


def test_hull_corner_is_free_above_the_ground():
    np.testing.assert_array_equal(
        launch(hull_kernel, HULL, LEVEL, UPRIGHT, ZERO, (1.0, 0.5, 0.01), (1.0, 1.0, -5.0), ZERO), 0.0
    )


def test_hull_corner_is_pushed_out_by_spring_and_damper():
    rng = np.random.default_rng(5)
    sink = rounded(rng.normal(0.0, 5.0, 500))
    depth = rounded(rng.uniform(0.001, 0.05, 500))
    point = np.stack([np.full(500, 1.0), np.full(500, 0.5), -depth], axis=-1)
    force = launch(hull_kernel, HULL, LEVEL, UPRIGHT, ZERO, point, np.stack([0 * sink, 0 * sink, -sink], -1), ZERO)
    expected = np.maximum(2e6 * depth + 2e4 * sink, 0.0)
    np.testing.assert_allclose(force[:, 2], expected, atol=8 * ROUNDOFF * 2e5)
    np.testing.assert_array_equal(force[:, :2], 0.0)
    assert np.any(expected == 0.0)


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5, -2.0])
def test_hull_friction_opposes_the_slide(heading):
    """μ F_n v/√(v² + (5 cm/s)²) against the slide."""
    speed = rounded(np.array([0.0, 0.01, 0.05, 1.0, 10.0]))
    direction = np.array([np.cos(heading), np.sin(heading), 0.0])
    force = launch(hull_kernel, HULL, LEVEL, UPRIGHT, ZERO, (1.0, 0.5, -0.01), speed[:, None] * direction, ZERO)
    size = 0.5 * 2e4 * speed / np.sqrt(speed**2 + 0.05**2)
    np.testing.assert_allclose(force[:, :2], -size[:, None] * direction[:2], rtol=16 * ROUNDOFF, atol=1e-3)
    np.testing.assert_allclose(force[:, 2], 2e4, rtol=16 * ROUNDOFF)


def test_hull_corner_moves_with_its_frame():
    """ω × r of the corner counts: a roll rate drives the right corner down, a yaw rate moves it forwards."""
    point = (1.0, -0.5, -0.01)
    down = launch(hull_kernel, HULL, LEVEL, UPRIGHT, ZERO, point, ZERO, (0.4, 0.0, 0.0))
    np.testing.assert_allclose(down[2], 2e4 + 2e4 * 0.2, rtol=16 * ROUNDOFF)
    yaw = launch(hull_kernel, HULL, LEVEL, UPRIGHT, ZERO, point, ZERO, (0.0, 0.0, 20.0))
    # velocity (10, 20, 0): Coulomb against it
    np.testing.assert_allclose(yaw[:2], -0.5 * 2e4 * np.array([10.0, 20.0]) / np.hypot(10.0, 20.0), rtol=1e-5)


def test_hull_force_stands_on_the_slope():
    climb = np.radians(25.0)
    normal = np.array([-np.sin(climb), 0.0, np.cos(climb)])
    ground = changed(LEVEL, normal=normal)
    rotation = turned(0.1, -0.3, 0.8)
    depth = 0.02
    point = rotation.T @ (-depth * normal + 1.5 * np.array([np.cos(climb), 0.0, np.sin(climb)]))
    force = launch(hull_kernel, HULL, ground, rotation, ZERO, point, ZERO, ZERO)
    # the depth is a difference of coordinates of 1.5 m
    np.testing.assert_allclose(rotation @ force, 2e6 * depth * normal, atol=2e6 * 32 * ROUNDOFF * 1.5)
