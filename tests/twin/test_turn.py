"""The standing turn: substep convergence, oil accounts, mirror symmetry, the stop, and voids."""

import math
from typing import Any

import numpy as np
import pytest

from aoro_gym.sensors.chain import turn_flow
from aoro_gym.simulation.key_figures import key_figures
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.twin.rig import SteeringLedger, drive, integral, orifice, states

SIGNALS = np.array([1.0, 0.75, 0.5, -1.0, -0.75, -0.5])  # positive left
DIRECTIONS = np.sign(SIGNALS)
STEP = 0.5
"""Time [s] of the signal's step."""
DURATION = 14.0
"""Long enough [s] for the slowest turn, at half the signal to the right, and for the pressures to settle after it."""


def turn(machine, *, main_step=1e-3, substeps=30):
    """Log of the six full turns, with the machine pressing on for a while after each; one frame a main step."""
    twin = Twin(len(SIGNALS), machine=machine, main_step=main_step, substeps=substeps)
    twin.reset(joint_angle=-DIRECTIONS * machine.joint.range)
    log = drive(twin, (STEP, {}), (DURATION, {"steering_signal": SIGNALS}), sample_every=main_step)
    assert not twin.diverged
    return log


@pytest.fixture(scope="module")
def turns(machine):
    return turn(machine)


def crossing(log, angle, case):
    """Frame and fraction at which the joint of ``case`` first reaches ``angle`` [rad]."""
    ahead = DIRECTIONS[case] * (log["joint_angle"][:, case] - angle)
    after = int(np.argmax(ahead >= 0.0))
    assert after > 0, "the turn does not get there"
    return after - 1, ahead[after - 1] / (ahead[after - 1] - ahead[after])


def value_at(series, where):
    frame, fraction = where
    return series[frame] + fraction * (series[frame + 1] - series[frame])


# --------------------------------------------------------------------------------------------------------- convergence
def figures(machine, log, case):
    """The seven key figures; the first peak's time by a parabola through the samples around it, finer than a sample."""
    angle = log["joint_angle"][:, case]
    flow = turn_flow(machine.steering.cylinder, angle, log["joint_rate"][:, case], DIRECTIONS[case])
    found: dict[str, Any] = dict(key_figures(log.time, angle, machine, flow=flow))
    start = int(np.argmax(np.abs(angle - angle[0]) > math.radians(0.1)))
    peak = start + int(np.argmax(flow[start : start + 300]))
    before, top, after = flow[peak - 1 : peak + 2]
    found["first_peak_time_s"] += 1e-3 * 0.5 * (before - after) / (before - 2.0 * top + after)
    return found


def test_halving_the_substep_moves_no_key_figure_by_half_a_percent(machine, turns):
    fine = turn(machine, substeps=60)
    coarse = turn(machine, substeps=15)
    for case in range(3):
        usual, finer, coarser = (figures(machine, log, case) for log in (turns, fine, coarse))
        assert all(value is not None for value in usual.values())
        for name, value in usual.items():
            assert finer[name] == pytest.approx(value, rel=5e-3), f"{name} at {SIGNALS[case]:.0%}"
        # the oil is stepped to first order: of an error c·dt, halving 2 dt → dt removes twice what dt → dt/2 does.
        # Second-order terms shift the ratio by dt over the shortest time constant, the compensator's 1 ms: 67 µs / 1 ms
        # per factor, and the peak is read from samples: ±25 %.
        name = "first_peak_L_per_min"
        assert (coarser[name] - usual[name]) / (usual[name] - finer[name]) == pytest.approx(2.0, rel=0.25)


# ----------------------------------------------------------------------------------------------------------------- oil
def test_a_full_turn_sweeps_both_strokes(machine, turns):
    """∫ joint flow from stop to stop is the published 2.331 L, whichever way and at any signal: the twin's own channel,
    and the flow that the figures derive from the joint's motion."""
    own = integral(turns["joint_flow"], turns.time)
    for case, direction in enumerate(DIRECTIONS):
        end = crossing(turns, direction * machine.joint.range, case)
        angle, rate = turns["joint_angle"][:, case], turns["joint_rate"][:, case]
        driven = integral(turn_flow(machine.steering.cylinder, angle, rate, direction), turns.time)
        assert value_at(own[:, case], end) == pytest.approx(2.331e-3, rel=1e-3)
        assert value_at(driven, end) == pytest.approx(2.331e-3, rel=1e-3)


def test_metered_oil_is_swept_leaked_or_squeezed(machine):
    """Oil through either metering edge against the chambers' growth, leaks and compression, at every moment.

    The log holds each main step's last flow, which differs from the step's mean by O(h²): at 1 ms that costs 2 of the
    2.3 mL that 0.1 % of a full turn allows, at half the step a quarter. A void's volume does not show in a pressure:
    moments with a void are left to the test on voids.
    """
    log = turn(machine, main_step=5e-4, substeps=15)
    ledger = SteeringLedger(machine, log)
    volume_a, volume_b = ledger.chambers()
    for case, direction in enumerate(DIRECTIONS):
        for side, metered in (("in", log["flow_in"]), ("out", -log["flow_out"])):
            loaded = (direction > 0) == (side == "in")
            port, volume, out = (ledger.a, volume_a, ledger.from_a) if loaded else (ledger.b, volume_b, ledger.from_b)
            entered = integral((metered - out)[:, case], log.time)
            taken = (volume - volume[0])[:, case] + ledger.squeezed(port, volume)[:, case]
            full = port[:, case] > machine.oil.void_pressure
            error = np.abs(entered - taken)[full].max()
            assert error < 1e-3 * 2.331e-3, f"{side}, signal {SIGNALS[case]}"
            assert np.ptp(volume[:, case]) > 2.33e-3  # there was a whole stroke to account for


# ------------------------------------------------------------------------------------------------------------ symmetry
def test_left_and_right_mirror_each_other(machine):
    """With the right section's parameters set to the left ones, a right turn is a left turn seen in a mirror."""
    names = ("nominal_flow", "nominal_drop_in", "nominal_drop_out", "dead_band")
    pairs = {f"steering.valve.{n}_right": f"steering.valve.{n}_left" for n in names}
    pairs |= {f"steering.valve.opening_right_{v}": f"steering.valve.opening_left_{v}" for v in ("1V0", "1V5")}
    even = machine.set({right: machine.value(left) for right, left in pairs.items()}, si=True)
    twin = Twin(2, machine=even)
    side = np.array([1.0, -1.0])
    twin.reset(joint_angle=-side * even.joint.range)
    log = drive(twin, (0.2, {}), (3.0, {"steering_signal": side}), (0.5, {"steering_signal": 0.0}), sample_every=5e-3)

    swapped = {"pressure_a": "pressure_b", "pressure_b": "pressure_a"}
    mirrored = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
    odd = {"steering_signal", "joint_angle", "joint_rate", "spool", "position_y", "roll", "yaw", "yaw_rate"}
    # Left and right are summed in another order. A float32 has 6e-8; over 2000 steps as a random walk that is 3e-6 of a
    # channel's largest value. The stiffest reading is an arm's pressure: 1.6 kPa per µrad where oil holds the arm
    # against its tire, and 2000 roundings of an angle of 0.17 rad walk 0.3 µrad: 0.5 kPa of the rod side's 2 MPa.
    # Bouncing off the stop stretches all of it: a check valve that opens one substep earlier moves the return line by
    # Q Δt/C = 1.7e-3 m³/s · 33 µs / 1.5e-12 m³/Pa = 36 kPa, 4 % of its peak. A quarter of that is allowed.
    free, commanded = log.time < 2.0, log["steering_signal"][:, 0] != 0.0
    for channel in log.rows:
        stem, _, wheel = channel.rpartition("_")
        other = f"{stem}_{mirrored[wheel]}" if wheel in WHEELS else swapped.get(channel, channel)
        left, right = log[channel][:, 0], (-1.0 if channel in odd else 1.0) * log[other][:, 1]
        if channel == "joint_flow":  # into the port that the command pressurises
            left, right = left * commanded, right * commanded
        error = np.abs(left - right) / max(np.abs(left).max(), 1e-30)
        assert error[free].max() <= 3e-4, channel
        assert error.max() <= 1e-2, channel
    assert np.ptp(log["joint_angle"][:, 0]) > 1.99 * even.joint.range


# ------------------------------------------------------------------------------------------------------------ the stop
def test_pressures_rise_to_the_cut_off_at_the_stop(machine, turns):
    """Pressing against the stop, the pump holds its cut-off and only leakage flows, through both metering edges."""
    steering, laminar = machine.steering, machine.oil.laminar_pressure
    valve, left = steering.valve, DIRECTIONS > 0
    loaded = np.where(left, turns["pressure_a"], turns["pressure_b"])
    idle = np.where(left, turns["pressure_b"], turns["pressure_a"])[-1]
    assert np.all(loaded[round(STEP / 1e-3)] < 0.05 * steering.pump.cutoff)  # it was not there before
    loaded = loaded[-1]
    pump, tank, compensator, flow = (
        turns[name][-1] for name in ("pump_pressure", "return_pressure", "compensator", "flow_in")
    )

    # the swash integrates the error to the cut-off away, down to what 14 s leave of it
    assert pump == pytest.approx(steering.pump.cutoff, rel=1e-4)
    piston = 2.0 * steering.cylinder.leakage * (loaded - idle)
    spool = valve.leakage * (loaded - tank), valve.leakage * (idle - tank)
    # steady: the pressures still move by less than a bar a second, worth 2 % of the leakage in 1.6 L of oil
    assert flow == pytest.approx(piston + spool[0], rel=0.02)
    # edges are laminar below 1 bar: compensator and edge in series, then the meter-out edge
    opening = np.array(
        [1.0, valve.opening_left_1V5, valve.opening_left_1V0, 1.0, valve.opening_right_1V5, valve.opening_right_1V0]
    )
    edge = opening * np.where(left, valve.cv_in_left, valve.cv_in_right)
    series = 1.0 / np.hypot(1.0 / edge, 1.0 / (compensator * valve.cv_compensator))
    assert orifice(series, pump - loaded, laminar) == pytest.approx(flow, rel=0.02)
    out = opening * np.where(left, valve.cv_out_left, valve.cv_out_right)
    assert orifice(out, idle - tank, laminar) == pytest.approx(piston - spool[1], rel=0.02)
    # the return line: its back pressure, and what the leakage adds on the valve's ramp
    line = steering.tank_line
    ramp = line.back_pressure_ramp * (piston + spool[0]) / line.back_flow
    assert tank == pytest.approx(line.back_pressure + ramp, rel=1e-3)


def test_the_stop_carries_the_oil_s_torque(machine):
    """On ice and without friction in the joint, the stop's spring alone balances the oil."""
    free = machine.set(
        {
            "tire.friction_coulomb": 0.008,
            "tire.friction_static": 0.008,
            "joint.friction_torque": 0.0,
            "steering.cylinder.seal_preload": 0.0,
            "steering.cylinder.seal_pressure_coefficient": 0.0,
        }
    )
    side = np.array([1.0, -1.0])
    twin = Twin(2, machine=free, terrain=Plane(friction=0.01))
    twin.reset(joint_angle=side * 0.9 * machine.joint.range)
    log = drive(twin, (6.0, {"steering_signal": side}), sample_every=0.5)
    angle, a, b = log["joint_angle"][-1], log["pressure_a"][-1], log["pressure_b"][-1]
    cylinder, joint = free.steering.cylinder, free.joint
    right, left = cylinder.linkage.lever(angle), cylinder.linkage.lever(-angle)
    torque = side * (cylinder.bore_area * (a * right - b * left) + cylinder.annulus_area * (a * left - b * right))
    stiffness = 2.0 * joint.stop_stiffness * (cylinder.stroke / (2.0 * joint.range)) ** 2
    # What is left: the tires' grip, on half the track at most, and the weight of a half on its leaning hinge.
    half = 9.81 * 0.5 * machine.mass
    tires = 0.01 * free.tire.friction_static * 2.0 * half * 0.5 * machine.frame.track
    lean = half * machine.frame.front.axle_distance * np.hypot(log["roll"][-1], log["pitch"][-1]).max()
    assert np.all(torque > 100.0 * (tires + lean))
    assert stiffness * (side * angle - joint.range) == pytest.approx(torque, abs=tires + lean)


# --------------------------------------------------------------------------------------------------------------- voids
def test_a_void_forms_and_is_refilled_before_the_pressure_rises(machine):
    """Without anti-cavitation, a valve shut in the middle of a turn pulls the driving side empty.

    The void keeps account: its volume, from the state, is what the oil balance says is missing, and steering on fills
    it first.
    """
    starved = machine.set({"steering.valve.anticavitation_flow": 1e-12}, si=True)
    twin = Twin(1, machine=starved)
    twin.reset(joint_angle=-machine.joint.range)
    drive(twin, (1.6, {"steering_signal": 1.0}), sample_every=1e-3)
    before = states(twin)[State.PORT_A, 0]
    stop = drive(twin, (0.4, {"steering_signal": 0.0}), sample_every=1e-3)
    during = states(twin)[State.PORT_A, 0]
    again = drive(twin, (1.0, {"steering_signal": 1.0}), sample_every=1e-3)
    after = states(twin)[State.PORT_A, 0]

    cylinder, steering = machine.steering.cylinder, machine.steering
    nominal = (
        steering.hose_volume
        + 2.0 * cylinder.dead_volume
        + 0.5 * (cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke
    )
    void = machine.oil.void_pressure

    def void_volume(content):
        return np.maximum(void - content, 0.0) * nominal / machine.oil.bulk_modulus

    assert stop["pressure_a"].min() == pytest.approx(void, rel=1e-6)
    assert void_volume(during) > 5e-6  # mL that the pressure does not show
    assert stop["pressure_a"][-1, 0] == pytest.approx(void, rel=1e-6)
    assert after > 1e6

    for log, first, last in ((stop, before, during), (again, during, after)):
        ledger = SteeringLedger(starved, log)
        volume, _ = ledger.chambers()
        entered = integral(log["flow_in"] * (log["spool"] > 0.0) - ledger.from_a, log.time)
        grown = (volume - volume[0]) + ledger.squeezed(ledger.a, volume)
        missing = grown - entered
        # the log begins one sample after the state was taken: 1 ms at the turn's 70 L/min is 1.2 mL
        assert missing[-1, 0] == pytest.approx(void_volume(last) - void_volume(first), abs=2.331e-6)
