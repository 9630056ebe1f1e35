"""The crane's parameters, and its kinematics against rotation matrices."""

import re

import numpy as np
import pytest

from aoro_gym.machine.crane import Crane, crane_parameters, forwarder_crane
from aoro_gym.twin.cranes import Cranes

JOINTS = np.array([[0.4, 0.3, -0.7, 0.5], [-2.0, 1.2, -2.2, 0.0], [0.0, -0.3, -0.1, 1.6]]).T


@pytest.fixture(scope="module")
def crane() -> Crane:
    return forwarder_crane()


def test_every_parameter_lies_in_its_range_and_says_where_it_comes_from():
    for entry in crane_parameters().values():
        assert re.match(r"(R|E)\b", entry.source), entry.key
        assert entry.range[0] <= entry.value <= entry.range[1], entry.key


def test_its_masses_and_its_reach_are_those_of_the_budget(crane):
    """1,750 kg of crane, rotator and grapple in the budget of the front frame; reach of its class, 7.2 m."""
    assert crane.mass == pytest.approx(1750.0)
    assert crane.reach == pytest.approx(7.2)


def test_the_tip_is_where_rotations_put_it(crane):
    """Frame by frame: about z, then twice about −y, each followed by a way in the turned axes."""

    def about(axis, angle):
        cross = np.cross(np.eye(3), axis)
        return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross

    for slew, lift, fold, out in JOINTS.T:
        turned = about([0.0, 0.0, 1.0], slew)
        place = turned @ [crane.lift.offset, 0.0, crane.lift.height]
        turned = turned @ about([0.0, -1.0, 0.0], lift)
        place += turned @ [crane.boom.length, 0.0, 0.0]
        turned = turned @ about([0.0, -1.0, 0.0], fold)
        place += turned @ [crane.stick.length + out, 0.0, 0.0]
        assert crane.tip([slew, lift, fold, out]) == pytest.approx(place, abs=1e-12)
    assert crane.tip(JOINTS).shape == (3, 3)


def test_joints_bring_the_tip_back(crane):
    np.testing.assert_allclose(crane.joints_at(crane.tip(JOINTS), JOINTS[3]), JOINTS, atol=1e-9)


@pytest.mark.parametrize(
    ("place", "out", "words"),
    [
        ((9.0, 0.0, 1.0), 0.5, r"cannot be 8\.86 m from the lift's pin with the telescope 0\.50 m out: .* 0\.50 to 5\.90 m"),
        ((1.2, 0.0, 1.5), 0.0, r"fold is -173.1 deg, but must be in \[-150, 0\] deg"),
        ((7.5, 0.0, 1.5), 3.0, r"telescope is 3 m, but must be in \[0, 1\.65\] m"),
    ],
)  # fmt: skip
def test_what_it_cannot_reach_is_told(crane, place, out, words):
    with pytest.raises(ValueError, match=words):
        crane.joints_at(place, out)


def test_what_it_holds_is_a_mass(crane):
    assert crane.with_grapple(800.0).mass == pytest.approx(crane.mass + 500.0)
    with pytest.raises(ValueError, match=r"mass is -1 kg, but must be at least 0"):
        crane.with_grapple(np.array([300.0, -1.0]))


# cylinders


@pytest.mark.parametrize("name", ["lift", "fold"])
def test_a_cylinder_s_lever_is_the_slope_of_its_length(crane, name):
    """Virtual work, F dL = τ dq: slopes of the mechanism against central differences, which round lengths of a metre by
    1e-16 and err by 1e-10; it lengthens over the whole range, and closed it is longer than its stroke."""
    joint = getattr(crane, name)
    angles, step = np.linspace(joint.low, joint.high, 101), 1e-6
    length, lever = joint.cylinder.extension(angles)
    ahead, behind = (joint.cylinder.extension(angles + d)[0] for d in (step, -step))
    np.testing.assert_allclose(lever, (ahead - behind) / (2.0 * step), atol=1e-8)
    assert lever.min() > 0.1
    assert np.ptp(length) < length.min() - 0.2  # piston, glands and pins


def test_the_bars_of_the_fold_keep_their_lengths(crane):
    cylinder = crane.fold.cylinder
    lug, shared = cylinder.pins(np.linspace(crane.fold.low, crane.fold.high, 51))
    np.testing.assert_allclose(np.abs(lug), cylinder.lug, atol=1e-12)
    np.testing.assert_allclose(np.abs(shared - lug), cylinder.coupler, atol=1e-12)
    pivot = -cylinder.pivot_back + 1j * cylinder.pivot_over
    np.testing.assert_allclose(np.abs(shared - pivot), cylinder.lever, atol=1e-12)


def test_what_holds_it_in_closed_form_is_what_its_dynamics_say(crane):
    """First moments about the pins, in float64, against the kernel's U_lᵀ g in float32: 1e-5 of the largest torque."""
    rng = np.random.default_rng(4)
    joints = rng.uniform((-3.0, -0.5, -2.6, 0.0), (3.0, 1.39, 0.0, 1.65), (50, 4)).T
    cranes = Cranes(50, crane=crane)
    cranes.place(joints)
    held = crane.holding(joints)
    assert np.abs(cranes.state().holding - held).max() < 1e-5 * np.abs(held).max()


def test_pressures_give_the_torques_and_neither_side_falls_below_the_return_line(crane):
    rng = np.random.default_rng(9)
    joints = rng.uniform((-3.0, -0.5, -2.6, 0.0), (3.0, 1.39, 0.0, 1.65), (50, 4)).T
    torques = rng.normal(0.0, 1.0, (4, 50)) * np.array([2e4, 6e4, 3e4, 1e4])[:, None]
    bore, annulus = crane.pressures(joints, torques, back=4e5)
    assert min(bore.min(), annulus.min()) == pytest.approx(4e5)
    assert np.all(np.isclose(bore, 4e5) | np.isclose(annulus, 4e5))
    forces = [
        bore[i] * one.bore_area - annulus[i] * one.annulus_area
        for i, one in ((1, crane.lift.cylinder), (2, crane.fold.cylinder), (3, crane.telescope.cylinder))
    ]
    levers = [crane.lift.cylinder.extension(joints[1])[1], crane.fold.cylinder.extension(joints[2])[1], 0.5]
    for force, lever, torque in zip(forces, levers, torques[1:], strict=True):
        np.testing.assert_allclose(force * lever, torque, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose((bore[0] - annulus[0]) * crane.slew.displacement, torques[0], rtol=1e-9, atol=1e-6)


def test_a_full_load_asks_for_the_whole_pressure(crane):
    """With the greatest mass in the grapple one of lift and fold is at the limit, the other below it."""
    joints = np.stack(
        [crane.joints_at([reach, 0.0, 0.5], out) for reach, out in ((4.0, 0.0), (5.5, 0.6), (7.0, 1.65))], axis=1
    )
    most = crane.capacity(joints, 250e5)
    assert np.all(np.diff(most) < 0.0) and 500.0 < most[2] < 1500.0  # the class lifts about a tonne at full reach (R)
    full = crane.with_grapple(crane.grapple.mass + most)
    bore, _ = full.pressures(joints, full.holding(joints), back=0.0)
    assert np.max(bore[1:3], axis=0) == pytest.approx(250e5, rel=1e-9)


# tip control


def test_the_jacobian_is_the_slope_of_the_tip(crane):
    step = 1e-6
    found = crane.jacobian(JOINTS)
    for i in range(4):
        way = np.zeros((4, 1))
        way[i] = step
        slope = (crane.tip(JOINTS + way) - crane.tip(JOINTS - way)) / (2.0 * step)
        np.testing.assert_allclose(found[:, i], slope, atol=1e-8)
    np.testing.assert_array_equal(found[..., 1], crane.jacobian(JOINTS[:, 1]))


def test_flows_are_what_the_cylinders_take_up(crane):
    """Change of length times the area of the side that the oil goes into, over a step short enough to be linear in."""
    step, rates = 1e-6, np.array([0.3, -0.4, 0.5, -0.2])
    for joints in JOINTS.T:
        for way in (rates, -rates):
            before, after = joints, joints + step * way
            grown = [
                (one.extension(after[i])[0] - one.extension(before[i])[0]) / step
                for i, one in ((1, crane.lift.cylinder), (2, crane.fold.cylinder))
            ]
            grown.append(way[3] / crane.telescope.cylinder.ratio)
            pistons = crane.lift.cylinder, crane.fold.cylinder, crane.telescope.cylinder
            expected = [abs(way[0]) * crane.slew.displacement]
            expected += [
                rate * one.bore_area if rate > 0.0 else -rate * one.annulus_area
                for rate, one in zip(grown, pistons, strict=True)
            ]
            np.testing.assert_allclose(crane.flows(joints, way), expected, rtol=1e-4)


def test_the_tip_goes_straight_and_slows_down_where_flow_is_short(crane):
    """From log to bunk in straight lines at 1 m/s, by Heun's method of 10 ms, which bends a line of 3 m by less than 0.1 mm;
    with two thirds of the flow it takes longer and goes the same way, with equal volumes."""
    start, end = np.array([5.0, -2.0, 0.2]), np.array([3.0, 1.0, 1.5])
    way = end - start
    length = np.linalg.norm(way)
    most = 0.0
    for available in (np.inf, 1e-3):
        joints, travelled = crane.joints_at(start, 0.6), 0.0
        while travelled < length - 0.02:
            velocity = way / length
            first = crane.tip_rates(joints, velocity, available)
            second = crane.tip_rates(joints + 0.01 * first, velocity, available)
            joints = joints + 0.005 * (first + second)
            most = max(most, crane.flows(joints, first).sum()) if np.isinf(available) else most
            assert available > 1.0 or crane.flows(joints, first).sum() < 1.02 * available
            tip = crane.tip(joints) - start
            travelled = tip @ velocity
            assert np.linalg.norm(tip - travelled * velocity) < 1e-4
        assert np.all(
            [low - 0.02 < joint < high + 0.02 for joint, (low, high) in zip(joints, crane.limits, strict=True)]
        )
    assert most > 1.5e-3, "the short flow is short"


def test_no_other_joint_rates_take_less_volume_squared(crane):
    joints, velocity = JOINTS[:, 0], np.array([0.4, -0.3, 0.5])
    rates = crane.tip_rates(joints, velocity)
    np.testing.assert_allclose(crane.jacobian(joints) @ rates, velocity, atol=1e-6)
    null = np.linalg.svd(crane.jacobian(joints))[2][-1]
    volumes = [np.sum((crane.displacements(joints) * (rates + a * null)) ** 2) for a in (-1e-3, 0.0, 1e-3)]
    assert volumes[1] < min(volumes[0], volumes[2])
