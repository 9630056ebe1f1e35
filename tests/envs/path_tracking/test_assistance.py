"""Gear, traction and arms: the rules of each, and that machines on twisted ground come through."""

import math

import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.envs.path_tracking.assistance import (
    TWIST,
    ArmControl,
    ArmController,
    AutomaticGear,
    GearShift,
    MachineDimensions,
    TractionControl,
)
from aoro_gym.terrains import Plane

STEP = 0.05


def shifted(gear, *, steps=40, signal=1.0, speed=0.0, pressure=50e5):
    one = np.ones(1)
    for _ in range(steps):
        gear.update(signal * one, speed * one, pressure * one, one, STEP)
    return gear.gear[0]


def test_gears_go_up_when_fast_and_light_and_down_when_slow_or_heavy():
    gear = AutomaticGear(1)  # first gear drives 1 m/s, the others 4/3 and 2
    assert shifted(gear, speed=0.8) == 1
    assert shifted(gear, speed=0.9, signal=0.5) == 1
    assert shifted(gear, speed=0.9, pressure=150e5) == 1  # 200 bar in second
    assert shifted(gear, speed=0.9) == 2
    assert shifted(gear, speed=0.7) == 2  # hysteresis
    assert shifted(gear, speed=1.2) == 3
    assert shifted(gear, speed=1.9, steps=200) == 3
    assert shifted(gear, speed=1.9, pressure=270e5, steps=10) == 2
    assert shifted(gear, speed=0.5) == 1
    gear.gear[:] = 3.0
    gear.reset(np.array([0]))
    assert gear.gear[0] == 1


def test_a_gear_is_held_for_its_time():
    gear, one = AutomaticGear(1), np.ones(1)
    changes = []
    for step in range(200):
        before = gear.gear[0]
        speed = 3.0 if step % 2 else 0.0  # as nervous as can be
        gear.update(one, speed * one, 0.0 * one, one, STEP)
        if gear.gear[0] != before:
            changes.append(step)
    assert len(changes) > 3
    assert min(np.diff(changes)) * STEP >= GearShift().hold - 1e-9


def test_spinning_wheels_are_throttled_and_freed_again():
    control, openings = TractionControl(), np.ones((2, 4))
    rates = np.array([[6.0, 0.0, 0.1, 0.0], [1.3, 1.7, 1.3, 1.7]])  # one spins; a bend of 7 m
    for _ in range(20):
        openings = control.openings(openings, rates, STEP)
    np.testing.assert_allclose(openings, [[control.least, 1.0, 1.0, 1.0], [1.0] * 4])
    for _ in range(60):
        openings = control.openings(openings, rates[1:].repeat(2, 0), STEP)
    np.testing.assert_allclose(openings, 1.0)


def stance(machine, count=1):
    one = np.ones(count)
    rest = [machine.rest.arm_angle_front] * 2 + [machine.rest.arm_angle_rear] * 2
    return MachineDimensions(
        front=machine.frame.front.axle_distance * one,
        rear=machine.frame.rear.axle_distance * one,
        half_track=0.5 * machine.frame.track * one,
        arm_length=machine.arm.length * one,
        rest=np.outer(rest, one),
        dead_band=machine.arm.valve.dead_band * one,
    )


def signals(machine, control, *, pressures=(0.0,) * 4, roll=0.0, pitch=0.0, joint=0.0):
    m = stance(machine)
    arms = ArmController(1, control)
    for _ in range(100):
        out = arms.update(
            np.array(pressures)[:, None], m.rest, np.array([roll]), np.array([pitch]), np.array([joint]), m, STEP
        )
    return out[:, 0]


def test_arms_yield_on_the_heavy_diagonal_and_nowhere_else(machine):
    heavy = signals(machine, ArmControl.sharing(), pressures=100e5 + 50e5 * TWIST[:, 0])
    np.testing.assert_array_equal(np.sign(heavy), -TWIST[:, 0])
    np.testing.assert_array_equal(signals(machine, ArmControl.sharing(), pressures=[150e5, 150e5, 50e5, 50e5]), 0.0)
    np.testing.assert_array_equal(signals(machine, ArmControl.sharing(), roll=0.1, pitch=0.1), 0.0)


def test_arms_level_by_raising_what_is_low(machine):
    control = ArmControl.levelling()
    np.testing.assert_array_equal(np.sign(signals(machine, control, roll=0.1)), [-1, 1, -1, 1])  # left is up
    np.testing.assert_array_equal(np.sign(signals(machine, control, pitch=0.1)), [1, 1, -1, -1])  # nose is down
    # with the joint bent the rear corners stand elsewhere: the rear frame points to the right of the front one's tail
    bent = signals(machine, control, roll=0.05, joint=math.radians(40))
    straight = signals(machine, control, roll=0.05)
    assert np.abs(bent[2:] - straight[2:]).min() > 0.1


def test_signs_of_the_arms_are_the_machines(machine):
    """On level ground a raised left side comes from the signals that are said to raise it."""
    twin = Twin(machine=machine)
    twin.reset()
    twin.step({"arm_fl": 0.5, "arm_rl": 0.5, "arm_fr": 0.0, "arm_rr": 0.0}, duration=1.0)
    assert twin.output("roll")[0] > math.radians(1.0)
    twin.reset()
    twin.step({"arm_fl": 0.5, "arm_fr": 0.5}, duration=1.0)
    assert twin.output("pitch")[0] < -math.radians(1.0)


def controlled(machine, control, terrain, *, steps=60, twist=0.0):
    """A twin whose front left arm was first driven out for ``twist`` seconds, and its wheel loads [N] after the steps."""
    twin = Twin(machine=machine, terrain=terrain)
    twin.reset()
    if twist:
        twin.step({"arm_fl": 0.6}, duration=twist)
    arms, m = ArmController(1, control), stance(machine)
    share = machine.arm.cylinder.annulus_area / machine.arm.cylinder.bore_area
    wheels = ("fl", "fr", "rl", "rr")
    commands = {"arm_fl": 0.0}
    for _ in range(steps):
        twin.step(commands, duration=STEP)
        pressures = np.stack(
            [twin.output(f"arm_pressure_bore_{w}") - share * twin.output(f"arm_pressure_rod_{w}") for w in wheels]
        )
        angles = np.stack([twin.output(f"arm_angle_{w}") for w in wheels])
        roll, pitch, joint = (twin.output(name).astype(np.float64) for name in ("roll", "pitch", "joint_angle"))
        out = arms.update(pressures, angles.astype(np.float64), roll, pitch, joint, m, STEP)
        commands = {f"arm_{w}": row for w, row in zip(wheels, out, strict=True)}
    loads = np.array([twin.output(f"wheel_load_{w}")[0] for w in wheels])
    return twin, loads


def test_sharing_evens_the_diagonals(machine):
    _, held = controlled(machine, ArmControl(share_gain=0.0, height_gain=0.0), Plane(), twist=0.6)
    _, shared = controlled(machine, ArmControl.sharing(), Plane(), twist=0.6)
    before, after = (abs(TWIST[:, 0] @ loads) for loads in (held, shared))
    # the band of pressure that is left, by cylinder and lever at the wheel, on four of them; half as much for friction
    cylinder = machine.arm.cylinder
    band = ArmControl.sharing().share_band * cylinder.bore_area * cylinder.linkage.mean_lever / machine.arm.length
    assert after < 4 * 1.5 * band < before


def test_levelling_brings_the_frame_upright_on_a_slope(machine):
    slope = Plane(slope_deg=6.0, direction_deg=90.0)  # the left side is up
    held, _ = controlled(machine, None, slope, steps=1)
    level, _ = controlled(machine, ArmControl.levelling(), slope, steps=120)
    assert held.output("roll")[0] > math.radians(5.0)
    # the band of height, seen over the half track
    assert abs(level.output("roll")[0]) < 1.5 * ArmControl.levelling().level_band / (0.5 * machine.frame.track)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: GearShift(down_speed=0.9), "down_speed is 0.9, but must be in"),
        (lambda: GearShift(up_pressure=1e9), "up_pressure is 1000000000 Pa"),
        (lambda: TractionControl(excess=1.0), "excess is 1, but must be above 1"),
        (lambda: TractionControl(least=2.0), "least is 2,"),
        (lambda: ArmControl(share_gain=-1.0), "share_gain is -1,"),
        (lambda: ArmControl(largest=0.0), "largest is 0,"),
    ],
)
def test_wrong_values_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
