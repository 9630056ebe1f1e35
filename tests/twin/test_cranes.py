"""Cranes on their feet: energy in free swing, rest, and statics."""

import numpy as np
import pytest

from aoro_gym.machine.crane import forwarder_crane
from aoro_gym.twin.cranes import Cranes

POSE = np.array([0.3, 0.4, -0.8, 0.5])
RATES = np.array([0.5, 0.3, -0.4, 0.2])


def swung(step: float, duration: float = 0.6) -> np.ndarray:
    """Joints after a free swing."""
    cranes = Cranes(step=step)
    cranes.place(POSE, 4.0 * RATES)
    cranes.advance(np.zeros(4), duration)
    return cranes.joints[:, 0].astype(float)


def test_energy_is_conserved_in_free_swing():
    """64 cranes thrown into the air without gravity, and one that falls, for two seconds of 1 ms.

    Expected: a scheme of second order at rates up to 3 rad/s errs by (ωh)² = 1e-5 of the energy that goes to and fro, and
    float32 rounds 2,000 steps by 6e-8 each, 3e-6 in a random walk; 1e-4 is above both.
    """
    rng = np.random.default_rng(8)
    cranes = Cranes(64, gravity=np.zeros(3))
    cranes.place(np.tile(POSE[:, None], 64), rng.normal(size=(4, 64)) * RATES[:, None])
    before = cranes.state().kinetic
    cranes.advance(np.zeros(4), 2.0)
    assert cranes.state().kinetic == pytest.approx(before, rel=1e-4)
    falling = Cranes()
    falling.place(POSE, RATES)
    first, kinetic = falling.state(), 0.0
    for _ in range(10):
        falling.advance(np.zeros(4), 0.05)
        now = falling.state()
        kinetic = max(kinetic, float(now.kinetic[0]))
        assert now.kinetic + now.potential == pytest.approx(first.kinetic + first.potential, abs=1e-4 * kinetic + 0.02)
    assert kinetic > 1e4


def test_halved_steps_quarter_the_error():
    fine = swung(1e-4)
    errors = [np.linalg.norm(swung(step) - fine) for step in (5e-3, 2.5e-3)]
    assert 1.7 < np.log2(errors[0] / errors[1]) < 2.6, errors


def test_what_holds_it_is_the_slope_of_its_potential_energy():
    """τ = ∂V/∂q: torques that hold, against differences of the energy over ±1 cm or ±0.01 rad; on a slope the slew, too."""
    down = 9.81 * np.array([np.sin(0.2), np.sin(0.1), -np.sqrt(1.0 - np.sin(0.2) ** 2 - np.sin(0.1) ** 2)])
    cranes = Cranes(9, gravity=down)
    steps = np.concatenate([np.zeros((4, 1)), 0.01 * np.eye(4), -0.01 * np.eye(4)], axis=1)
    cranes.place(POSE[:, None] + steps)
    now = cranes.state()
    slope = (now.potential[1:5].astype(float) - now.potential[5:9]) / 0.02
    # central differences of sines err by 0.01²/6 = 2e-5, differences of 3e4 J in float32 by 2e-3 J/0.02 = 0.1
    assert now.holding[:, 0] == pytest.approx(slope, rel=1e-4, abs=1.0)
    assert abs(now.holding[0, 0]) > 1000.0


def test_a_held_crane_stays_and_its_foot_bears_its_weight():
    crane = forwarder_crane().with_grapple(np.array([300.0, 1100.0]))
    cranes = Cranes(2, crane=crane)
    cranes.place(POSE)
    held = cranes.state().holding
    cranes.advance(held, 1.0)
    # a torque that is rounded by 6e-8 of 8e4 N m moves 1e4 kg m² by 3e-7 rad in a second
    assert np.abs(cranes.joints - POSE[:, None]).max() < 1e-5
    now = cranes.state()
    assert now.force[2] == pytest.approx(-9.81 * crane.mass, rel=1e-5)
    assert np.abs(now.force[:2]).max() < 1.0
    # the tip's share of the moment about the foot: 800 kg more at the same place
    tip = crane.tip(POSE)
    more = 9.81 * 800.0 * np.array([-tip[1], tip[0]])
    assert now.moment[:2, 1] - now.moment[:2, 0] == pytest.approx(more, rel=1e-4)
    assert held[1, 1] - held[1, 0] == pytest.approx(9.81 * 800.0 * (np.hypot(*tip[:2]) - crane.lift.offset), rel=1e-4)


def test_a_tip_is_brought_to_a_place_by_torques():
    """Inverse kinematics with PD and what holds: within 1 cm after eight seconds, as 16 cranes do at once."""
    cranes, goal = Cranes(16), np.array([4.5, -2.0, 0.5])
    cranes.place(POSE)
    target = cranes.crane.joints_at(goal, 0.4)[:, None]
    stiff, damped = np.array([[4e4], [1.5e5], [4e4], [2e4]]), np.array([[4e4], [8e4], [2e4], [8e3]])
    for _ in range(800):
        hold = cranes.state().holding
        cranes.advance(hold + stiff * (target - cranes.joints) - damped * cranes.rates, 0.01)
    assert np.linalg.norm(cranes.state().tip - goal[:, None], axis=0).max() < 0.01


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Cranes(0), "num_cranes"),
        (lambda: Cranes(2, gravity=np.zeros((3, 3))), "gravity has 3 variants, but must have 1 or num_cranes = 2"),
        (lambda: Cranes(step=0.1), "step is 0.1 s"),
        (lambda: Cranes().place([0.0, 2.0, 0.0, 0.0]), r"lift is 114.6 deg, but must be in \[-30, 80\] deg"),
        (lambda: Cranes(2).place(np.zeros((4, 3))), r"joints have shape \(4, 3\), but must be \(4,\) or \(4, 2\)"),
        (lambda: Cranes().advance(np.zeros(4), 0.0005), "duration is 0.0005 s, but must be a positive whole multiple"),
    ],
)
def test_what_is_wrong_is_told(call, words):
    with pytest.raises(ValueError, match=words):
        call()
