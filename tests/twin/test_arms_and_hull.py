"""Pendulum arms and hull: wheel loads in static balance, arms that lift and lower, their stops and oil, and the belly."""

import numpy as np
import pytest
from scipy.special import softmax

from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.oracles.bodies import HALF_OF_WHEEL, BodyModel
from tests.oracles.hydraulics import orifice, relief_valve
from tests.oracles.tires import DISC_BLEND
from tests.twin.rig import all_wheels, drive, integral, squeezed, states

GRAVITY = 9.81


# ---------------------------------------------------------------------------------------------------------- wheel loads
def test_wheel_loads_at_rest_follow_from_the_masses(machine):
    """Level ground: axle loads from the lever rule about the wheels' contact points, written out body by body."""
    twin = Twin(1, machine=machine)
    log = drive(twin, (10.0, {}), sample_every=10.0)
    load = log.wheels("wheel_load")[-1, :, 0]
    angle = log.wheels("arm_angle")[-1, :, 0]
    assert load.sum() == pytest.approx(machine.mass * GRAVITY, rel=1e-5)
    frame, arm = machine.frame, machine.arm
    ends, moment = [], 0.0
    for half, sign, phi in ((frame.front, 1.0, angle[0]), (frame.rear, -1.0, angle[2])):
        pivot = half.axle_distance - arm.length
        wheel = pivot + arm.length * np.cos(phi)
        moment += sign * half.mass * (half.axle_distance - half.cog_offset)
        moment += sign * 2.0 * arm.mass * (pivot + arm.cog_fraction * arm.length * np.cos(phi))
        moment += sign * 2.0 * (arm.motor_mass + machine.wheel.mass) * wheel
        ends.append(sign * wheel)
    front = 0.5 * GRAVITY * (moment - machine.mass * ends[1]) / (ends[0] - ends[1])
    # the frame settles on float32 angles: a bit of 1.5e-8 rad on a lever of 1.7 m against 450 kN/m is 0.01 N
    assert load[:2] == pytest.approx(np.full(2, front), rel=1e-4)
    assert load[2:] == pytest.approx(np.full(2, 0.5 * machine.mass * GRAVITY - front), rel=1e-4)
    assert load[0] == pytest.approx(machine.rest.wheel_load_front, rel=1e-4)


def contacts(machine, kinematics, normal):
    """Contact points [m] (3, 4), depths [m] (4,) and tangents, forward and sideways, (3, 4) of the wheels on a plane."""
    tire = machine.tire
    points, depths, forward, sideways = [], [], [], []
    inner, outer = tire.disc_offset_inner, tire.disc_offset_outer
    offsets = np.array([0.0, -inner, inner, -outer, outer])
    drops = np.array([0.0, *[tire.disc_drop_inner] * 2, *[tire.disc_drop_outer] * 2])
    for wheel in range(4):
        rotation = kinematics.rotation[:, :, HALF_OF_WHEEL[wheel]]
        n = rotation.T @ normal
        tilt = np.hypot(n[0], n[2])
        down = np.array([-n[0], 0.0, -n[2]]) / tilt
        local = offsets[:, None] * np.array([0.0, 1.0, 0.0]) + (tire.radius - drops)[:, None] * down
        world = kinematics.wheel_center[:, wheel] + local @ rotation.T
        depth = -(world @ normal)
        share = softmax(depth / DISC_BLEND)
        x = np.array([n[2], 0.0, -n[0]]) / tilt
        depths.append(DISC_BLEND * (np.logaddexp.reduce(depth / DISC_BLEND) - np.logaddexp.reduce(-drops / DISC_BLEND)))
        points.append(share @ world - (depths[-1] - share @ depth) * normal)
        forward.append(rotation @ x)
        sideways.append(rotation @ np.cross(n, x))
    return np.array(points).T, np.array(depths), np.array(forward).T, np.array(sideways).T


def motion(state):
    """Pose (16,) of one twin in the reference's order."""
    names = ["X", "Y", "Z", "QW", "QX", "QY", "QZ", "JOINT"]
    names += [f"{kind}_{wheel.upper()}" for kind in ("ARM", "WHEEL") for wheel in WHEELS]
    return np.array([state[State[name]] for name in names])


def test_wheel_forces_balance_the_weight_on_a_slope(machine):
    """15° in eight directions: normal loads and bristle forces at the contact points balance the weight, in force and in
    moment, and every load is its tire's stiffness times its depth.

    Tolerance: a float32 quaternion has 6e-8, on 2 m of frame and 450 kN/m that is 0.05 N a bit; ten bits, four wheels.
    """
    direction = np.arange(0.0, 360.0, 45.0)
    plane = Plane(slope_deg=15.0, direction_deg=direction)
    twin = Twin(len(direction), machine=machine, terrain=plane)
    log = drive(twin, (60.0, {"parking_brake": 1.0}), sample_every=1.0)
    state, body, tire = states(twin), BodyModel(machine), machine.tire
    weight = np.array([0.0, 0.0, -GRAVITY * machine.mass])
    for case, normal in enumerate(plane.normal):
        pose = motion(state[:, case])
        point, depth, forward, sideways = contacts(machine, body.kinematics(pose, np.zeros(15)), normal)
        load = log.wheels("wheel_load")[-1, :, case]
        assert load == pytest.approx(tire.stiffness * depth, abs=1.0)
        bent_x, bent_y = (
            np.array([state[State[f"BRISTLE_{axis}_{wheel.upper()}"], case] for wheel in WHEELS]) for axis in "XY"
        )
        force = load * normal[:, None]
        force -= load * (tire.sigma0_longitudinal * bent_x * forward + tire.sigma0_lateral * bent_y * sideways)
        moment = np.cross((point - body.center_of_mass(pose)[:, None]).T, force.T).sum(axis=0)
        assert force.sum(axis=1) + weight == pytest.approx(np.zeros(3), abs=2.0)
        assert moment == pytest.approx(np.zeros(3), abs=4.0)
    # the slope shifts load as the lever rule says: m g sin α h over the wheelbase or the track, h about 1 m
    load = log.wheels("wheel_load")[-1]
    shift = machine.mass * GRAVITY * np.sin(np.radians(15.0)) / (machine.frame.wheelbase, machine.frame.track)
    assert (load[2:, 0] - load[:2, 0]).sum() > 0.5 * shift[0]


# --------------------------------------------------------------------------------------------------------------- motion
def extension(machine, angle):
    """Of an arm's cylinder [m]: law of cosines; the cylinder opens as the wheel goes down."""
    linkage = machine.arm.cylinder.linkage
    gamma = linkage.g0 - angle
    squares = linkage.a**2 + linkage.b**2 - 2.0 * linkage.a * linkage.b * np.cos(gamma)
    return np.sqrt(squares) - machine.arm.cylinder.dead_length


COMMANDS = np.array([1.0, 0.5, -1.0, -0.3])


@pytest.fixture(scope="module")
def lifted(machine):
    """All arms driven for 4 s each way, from rest, one twin a command."""
    twin = Twin(len(COMMANDS), machine=machine)
    start = drive(twin, (1.0, {"parking_brake": 1.0}), sample_every=1.0)
    log = drive(twin, (4.0, all_wheels("arm", COMMANDS)), sample_every=1e-3)
    assert not twin.diverged
    return start.then(log)


def test_arm_commands_raise_and_lower_the_frame(lifted):
    """Positive lifts, negative lowers, faster with a larger command; all wheels stay down."""
    height = lifted["position_z"] - lifted["position_z"][0]
    assert np.all(np.sign(height[-1]) == np.sign(COMMANDS))
    half_second = np.abs(height[500])
    assert half_second[0] > 1.5 * half_second[1] > 0.0
    assert half_second[2] > 1.5 * half_second[3] > 0.0
    assert np.all(lifted.wheels("wheel_load")[-1] > 0.0)


def chambers(machine, log):
    """Oil taken by every bore and rod chamber since the first frame [m³], (frames, 4, twins) each."""
    arm, cylinder = machine.arm, machine.arm.cylinder
    out = extension(machine, log.wheels("arm_angle"))
    fixed = arm.hose_volume + cylinder.dead_volume
    taken = []
    for side, area, stroke in (
        ("bore", cylinder.bore_area, out),
        ("rod", cylinder.annulus_area, cylinder.stroke - out),
    ):
        volume = fixed + area * stroke
        pressure = log.wheels(f"arm_pressure_{side}")
        taken.append(volume - volume[0] + squeezed(machine, pressure, volume, arm.hose_volume, arm.hose_bulk_modulus))
    return taken


def test_metering_sets_the_arms_speed(machine, lifted):
    """Extending, a bore takes what its edge meters: nominal flow times opening, less where the supply falls short.

    Between 0.3 and 1.0 s, with the spool at its command and the arms clear of their stops. 0.5 %: at frames of 1 ms
    each end of the span is known to a thousandth of it, and pressures ripple by a few bar in between.
    """
    valve = machine.arm.valve
    within = slice(300, 1000)
    bore, _ = chambers(machine, lifted)
    for case in range(2):
        cv = valve.cv * (COMMANDS[case] - valve.dead_band) / (1.0 - valve.dead_band)
        drop = lifted["pump_pressure"][:, None] - lifted.wheels("arm_pressure_bore")
        flow = orifice(cv, np.clip(drop[..., case], 0.0, valve.pressure_drop), machine.oil.laminar_pressure)
        metered = integral(flow[within], lifted.time[within])[-1]
        assert bore[within][-1, :, case] - bore[within][0, :, case] == pytest.approx(metered, rel=5e-3)


def test_the_arms_oil_comes_from_the_pump_and_goes_to_the_tank(machine, lifted):
    """All along: the pump's oil, less its leaks, is in the driven chambers; what leaves the others is in the tank.

    1 mL of up to 10 L in and out, and a jump of 160 L/min between two frames of 1 ms hides 1.3 mL.
    """
    pump, line, laminar = machine.steering.pump, machine.steering.tank_line, machine.oil.laminar_pressure
    supply, tank = lifted["pump_pressure"], lifted["return_pressure"]
    drawn = (
        lifted["pump_flow"]
        - pump.leakage * supply
        - orifice(pump.cv_bleed, lifted["ls_pressure"], laminar)
        - relief_valve(supply, pump.relief_pressure, pump.relief_ramp, pump.relief_flow)
    )
    still = np.ones_like(supply)
    in_line = squeezed(machine, supply, pump.line_volume * still, pump.line_volume, pump.hose_bulk_modulus)
    in_return = squeezed(machine, tank, line.volume * still, line.volume, line.hose_bulk_modulus)
    home = relief_valve(tank, line.back_pressure, line.back_pressure_ramp, line.back_flow)
    bore, rod = (oil.sum(axis=1) for oil in chambers(machine, lifted))
    driven, driving = np.where(COMMANDS > 0.0, bore, rod), np.where(COMMANDS > 0.0, rod, bore)
    entered = integral(drawn, lifted.time) - in_line
    left = integral(home, lifted.time) + in_return
    assert np.all(driven.max(axis=0) > 1.4e-3)  # litres
    assert entered == pytest.approx(driven, abs=2.3e-6)
    assert left == pytest.approx(-driving, abs=2.3e-6)


def test_stops_hold_the_arms(machine):
    """Driven against either end, an arm rests on its stop: the stop's spring takes what oil and wheel leave over.

    Frames at two thirds of their mass, so that the cut-off pressure is enough to reach the upper end of the lift.
    """
    light = machine.scale({"frame.front.mass": 2.0 / 3.0, "frame.rear.mass": 2.0 / 3.0})
    side = np.array([1.0, -1.0])
    twin = Twin(2, machine=light)
    log = drive(twin, (30.0, all_wheels("arm", side)), sample_every=1.0)
    arm, cylinder = light.arm, light.arm.cylinder
    angle, load, bore, rod = (
        log.wheels(name)[-1] for name in ("arm_angle", "wheel_load", "arm_pressure_bore", "arm_pressure_rod")
    )
    lever = cylinder.linkage.lever(-angle)
    oil = lever * (rod * cylinder.annulus_area - bore * cylinder.bore_area)  # raises the wheel, as all torques here
    hanging = GRAVITY * (arm.mass * arm.cog_fraction + arm.motor_mass + light.wheel.mass)
    outside = (load - hanging) * arm.length * np.cos(angle)
    pressures = np.maximum(bore, 0.0) + np.maximum(rod, 0.0)
    seals = cylinder.seal_preload + cylinder.seal_pressure_coefficient * pressures
    seals = lever * cylinder.seal_static_ratio * seals
    stiffness = arm.stop_stiffness * (cylinder.stroke / (2.0 * arm.swing)) ** 2
    beyond = np.abs(angle) - arm.swing
    assert np.all(np.sign(angle) == -side)
    assert np.all(beyond > 0.0)
    # the dry seals may hold part of it, and so may the wheel: by its disc brake, and by the rim's pull that this allows
    wheel = light.driveline.brake.disc_torque * (1.0 + arm.length * np.abs(np.sin(angle)) / light.tire.radius)
    pushed = stiffness * beyond * np.sign(angle)
    assert np.all(np.abs(pushed - oil - outside) < seals + wheel)
    assert np.all(np.abs(oil) > 10.0 * (seals + wheel))


# ----------------------------------------------------------------------------------------------------------------- belly
def test_the_belly_carries_what_the_wheels_do_not(machine):
    """Frames lowered onto the ground by retracting the arms: hull and wheels carry the weight together.

    The design's 0.6 m of clearance is more than the arms can lower, so the hulls are taken deeper: by 3 cm too little
    for the wheels to come off the ground, and far enough that they do.
    """
    arm, tire = machine.arm, machine.tire
    lowest = arm.pivot_height + arm.length * np.sin(arm.swing) - tire.radius  # free wheels' lowest points
    clearance = np.array([lowest + 0.03, lowest - 0.10, 0.6])
    twin = Twin(3, machine=machine.set({"frame.ground_clearance": clearance}, si=True))
    drive(twin, (1.0, {"parking_brake": 1.0}), (20.0, all_wheels("arm", -1.0)), sample_every=1.0)
    log = drive(twin, (1.0, all_wheels("arm", 0.0)), (10.0, {}), sample_every=1.0)
    load, hull, state = log.wheels("wheel_load")[-1], log["hull_force"][-1], states(twin)
    weight = machine.mass * GRAVITY
    assert load.sum(axis=0) + hull == pytest.approx(np.full(3, weight), rel=1e-4)
    assert 0.1 * weight < hull[0] < 0.9 * weight
    assert np.all(load[:, 0] > 0.0)
    assert np.all(load[:, 1] == 0.0)
    assert hull[2] == 0.0
    # the force is the corners' depth times their stiffness
    for case in range(2):
        kinematics = BodyModel(machine).kinematics(motion(state[:, case]), np.zeros(15))
        deep = 0.0
        for half, part in enumerate((machine.frame.front, machine.frame.rear)):
            for x in (-0.5, 0.5):
                for y in (-0.5, 0.5):
                    corner = [part.cog_x + x * part.hull_length, y * part.hull_width, clearance[case]]
                    height = kinematics.hinge[2] + (kinematics.rotation[:, :, half] @ corner)[2]
                    deep += max(-height, 0.0)
        assert machine.hull.stiffness * deep == pytest.approx(hull[case], rel=1e-3)


def test_dynamic_sections_lift_as_far_as_ideal_ones(machine):
    """Arms at 60 % of their signal by either law of ``arm_valve``: from 0.3 s on they swing as fast, within the 1 % that a
    supply which still rings by a quarter of its margin leaves of the mean; the compensators throttle, and the margin stands.
    """
    twin = Twin(2, machine=machine.with_laws(arm_valve=["ideal", "section"]))
    log = drive(twin, (0.5, {}), (0.3, all_wheels("arm", 0.6)), (0.9, {}), sample_every=1e-3)
    swung = log.wheels("arm_angle")[-1] - log.wheels("arm_angle")[-900]
    assert np.all(swung < -0.15)
    np.testing.assert_allclose(swung[:, 1], swung[:, 0], rtol=0.01)
    over = (log["pump_pressure"] - log["ls_pressure"])[-900:].mean(axis=0)
    np.testing.assert_allclose(over, machine.steering.pump.margin, rtol=0.03)
    opened = states(twin)[[State[f"ARM_COMPENSATOR_{wheel.upper()}"] for wheel in WHEELS]]
    assert np.all((opened[:, 1] > 0.1) & (opened[:, 1] < 0.9))
    resting = drive(twin, (3.0, all_wheels("arm", 0.0)), sample_every=0.1)
    assert np.ptp(resting.wheels("arm_angle")[-10:], axis=0).max() < 1e-3
