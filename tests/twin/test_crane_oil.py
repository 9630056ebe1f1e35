"""A crane's cylinders and valves on the twin: linkages, shut oil, flow sharing, and the steering's priority."""

# Device code and records: their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from aoro_gym import Machine, Twin
from aoro_gym.machine.vehicle_crane import VehicleCrane
from aoro_gym.recording.commands import JOINTS
from aoro_gym.twin.frame_cranes import pack_oil
from aoro_gym.twin.physics.crane_oil import CraneHydraulics, crane_chambers, priority_share
from aoro_gym.twin.records import CraneRow
from aoro_gym.twin.twin import Trace
from tests.twin.test_conservation import chamber_energy, oil_energy
from tests.twin.test_vehicle_crane import POSE, energy_and_momentum, flown, lossless

HOLD = np.array([0.3, 0.4, -1.0, 0.3])


@wp.kernel(enable_backward=False)
def at_joints(
    c: wp.array(dtype=CraneHydraulics), q: wp.array(dtype=wp.vec4), out: wp.array(dtype=wp.vec4, ndim=2),
    steering: wp.array(dtype=float), shares: wp.array(dtype=float),
):  # fmt: skip
    t = wp.tid()
    chambers = crane_chambers(c[0], q[t])
    out[0, t] = chambers.slope
    out[1, t] = chambers.volume_bore
    out[2, t] = chambers.volume_annulus
    shares[t] = priority_share(c[0], 150.0e5, steering[t])


def chambers(vehicle: VehicleCrane, joints: np.ndarray, steering: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Slopes, volumes of the bores and of the annuli on the device (3, 4, K), and shares of the priority valve (K,) with
    150 bar of supply, at joints (4, K)."""
    count = joints.shape[1]
    out = wp.zeros((3, count), dtype=wp.vec4, device="cpu")
    shares = wp.zeros(count, dtype=float, device="cpu")
    inputs = [
        wp.array(pack_oil(vehicle), dtype=CraneHydraulics, device="cpu"),
        wp.array(np.ascontiguousarray(joints.T, np.float32), dtype=wp.vec4, device="cpu"),
    ]
    load = wp.array(np.linspace(0.0, steering, count), dtype=float, device="cpu")
    wp.launch(at_joints, count, [*inputs, out, load, shares], device="cpu")
    return np.moveaxis(out.numpy(), -1, 1), shares.numpy()


def test_linkages_on_the_device_are_those_of_the_kinematics():
    """Slopes and volumes against :mod:`aoro_gym.machine.crane`, to float32's rounding of angles and lengths: 2e-5."""
    vehicle, rng = VehicleCrane(), np.random.default_rng(4)
    low, high = (np.array(one, dtype=float) for one in zip(*vehicle.crane.limits, strict=True))
    joints = rng.uniform(low, high, (50, 4)).T
    (slope, bore, annulus), _ = chambers(vehicle, joints)
    crane, hoses = vehicle.crane, vehicle.mount.hoses
    fixed = hoses.volume + hoses.dead_volume
    for i, (one, joint) in enumerate(((crane.lift.cylinder, crane.lift), (crane.fold.cylinder, crane.fold)), start=1):
        length, lever = one.extension(joints[i])
        shut, open_ = one.extension(joint.low)[0], one.extension(joint.high)[0]
        assert slope[i] == pytest.approx(lever, rel=2e-5)
        assert bore[i] == pytest.approx(fixed + one.bore_area * (length - shut), rel=2e-5)
        assert annulus[i] == pytest.approx(fixed + one.annulus_area * (open_ - length), rel=2e-5)
    assert slope[3] == pytest.approx(0.5) and slope[0] == pytest.approx(1.0)
    assert bore[0] + annulus[0] == pytest.approx(2.0 * (fixed + crane.slew.displacement * crane.slew.range), rel=2e-5)


def test_priority_valve_opens_over_its_ramp():
    """150 bar of supply, steering under 0 to 150 bar: whole without steering, and clip((150 − p − 10)/6) else."""
    _, shares = chambers(VehicleCrane(), np.tile(HOLD[:, None], 151), steering=150e5)
    assert shares == pytest.approx(
        np.where(np.arange(151) == 0, 1.0, np.clip((140.0 - np.arange(151)) / 6.0, 0.0, 1.0)), abs=1e-4
    )


def test_shut_oil_holds_the_crane():
    """Cylinders hold statics' pressures; once the machine has come to rest on its tires, nothing sinks by more than
    0.1 mrad or 0.1 mm in five seconds; the slew swings within its presliding way of 1 mrad."""
    twin = Twin(crane=True)
    twin.crane.place(HOLD)
    twin.step({"parking_brake": 1.0}, 12.0)
    before = twin.crane.joints
    trace = twin.step({}, 5.0, sample_every=0.02)
    moved = np.abs(twin.crane.joints - before)[:, 0]
    assert moved[1:].max() < 1e-4 and moved[0] < 5e-4
    crane = twin.crane.crane
    bores, annuli = crane.pressures(HOLD, crane.holding(HOLD))
    for i, name in enumerate(JOINTS[1:], start=1):  # frames that lean by a degree load the slew, too
        bore = trace[f"crane_pressure_bore_{name}"].mean(), bores[i]
        annulus = trace[f"crane_pressure_annulus_{name}"].mean(), annuli[i]
        found, expected = max(bore, annulus, key=lambda pair: pair[1])
        assert found == pytest.approx(expected, rel=0.1), name


def without_losses() -> VehicleCrane:
    """The crane without friction."""
    vehicle = VehicleCrane()
    none = {"slew": 0.0, "cylinders": 0.0, "slew_viscous": 0.0, "cylinder_viscous": 0.0}
    return VehicleCrane(mount=replace(vehicle.mount, friction=replace(vehicle.mount.friction, **none)))


def test_energy_is_conserved_while_the_crane_swings_on_shut_oil():
    """Two seconds of tumbling without gravity on preloaded oil: bodies and the work in all chambers, −∫p dV.

    Oscillations of ω = 60 to 300 rad/s on the oil: Störmer–Verlet's energy of them wavers by (ωh)²/8 = 1 %.
    """
    vehicle, machine = without_losses(), lossless()

    def preload(state):
        for i in range(4):
            ratio = pack_oil(vehicle)["annulus_area"][0, i] / pack_oil(vehicle)["bore_area"][0, i]
            state[int(CraneRow.ANNULUS_SLEW) + i] = 150e5
            state[int(CraneRow.BORE_SLEW) + i] = 150e5 * ratio
        state[int(CraneRow.RATE_SLEW) : int(CraneRow.RATE_SLEW) + 4] *= 0.4  # within voids and reliefs

    states = flown(vehicle, machine, 2.0, 40, preload)
    kinetic, momentum = energy_and_momentum(vehicle, machine, states)
    (_, bore, annulus), _ = chambers(vehicle, states[CraneRow.JOINT_SLEW :][:4])
    walls, modulus = vehicle.mount.hoses.volume / vehicle.mount.hoses.bulk_modulus, machine.oil.bulk_modulus
    stored = sum(
        chamber_energy(states[int(row) + i], volume[i].astype(float), walls, modulus)
        for row, volume in ((CraneRow.BORE_SLEW, bore), (CraneRow.ANNULUS_SLEW, annulus))
        for i in range(4)
    )
    swing = np.ptp(stored)
    energy = kinetic + oil_energy(machine, states) + stored
    assert swing > 50.0, "the oil should take part"
    assert np.abs(energy - energy[0]).max() < 2e-4 * kinetic[0] + 0.02 * swing
    assert np.linalg.norm(momentum - momentum[:, :1], axis=0).max() < 1e-4 * np.linalg.norm(momentum[:, 0])


def small_pump() -> Machine:
    """A pump of 56 L/min, which two sections of the crane ask too much of."""
    return Machine.load("aoro").set({"steering.pump.displacement": 35.0}, check_ranges=False)


def lost(machine: Machine, trace: Trace) -> np.ndarray:
    """Mean flow [L/min] that leaks from the pump, and that its line takes up as the pressure rises over a trace."""
    pressure, pump, oil = trace["pump_pressure"], machine.steering.pump, machine.oil
    modulus = oil.bulk_modulus + oil.bulk_modulus_slope * pressure.mean(axis=0)
    taken = pump.line_volume * (1.0 / modulus + 1.0 / pump.hose_bulk_modulus) * (pressure[-1] - pressure[0])
    return 6e4 * (pump.leakage * pressure.mean(axis=0) + taken / (trace.time[-1] - trace.time[0]))


def test_sections_share_what_a_saturated_pump_gives_in_the_ratio_of_their_openings():
    """Lift and fold at once: together the pump's flow, their ratio that of C y. The lift alone, and both of a large pump,
    get what they ask. Means of 0.3 s, in which the loads change; orifices under a common drop have the ratio at every
    instant."""
    lift, fold = np.array([1.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.55])
    results = {}
    for name, machine in (("large", Machine.load("aoro")), ("small", small_pump())):
        twin = Twin(3, machine=machine, crane=True)
        twin.crane.place(HOLD)
        twin.step({"parking_brake": 1.0}, 1.0)
        twin.step({"crane_lift": lift, "crane_fold": fold}, 0.5)
        trace = twin.step({}, 0.3, sample_every=0.01)
        flows = np.stack([trace[f"crane_flow_{joint}"].mean(axis=0) for joint in ("lift", "fold")])
        results[name] = 6e4 * flows, 6e4 * trace["pump_flow"].mean(axis=0), trace["pump_swash"].mean(axis=0)
    flows, _, swash = results["large"]
    asked = np.array([[70.0, 70.0, 70.0], [0.0, 70.0, 35.0]])
    assert flows == pytest.approx(asked, rel=0.02, abs=0.1) and swash.max() < 0.9
    flows, pump, swash = results["small"]
    assert np.all(swash > 0.999)
    assert flows[1] / flows[0] == pytest.approx([0.0, 1.0, 0.5], rel=1e-4)
    assert flows.sum(axis=0) == pytest.approx(pump - lost(machine, trace), rel=0.01)
    assert pump == pytest.approx(np.full(3, 35e-3 * 1595.0), rel=0.01)


def test_the_steering_goes_before_the_crane():
    """A turn of a pump that cannot feed both goes as far as with the crane at rest; the crane gets what is left."""
    machine = Machine.load("aoro").set({"steering.pump.displacement": 55.0}, check_ranges=False)  # 88 L/min
    twin = Twin(3, machine=machine, crane=True)
    twin.crane.place(HOLD)
    twin.step({}, 1.0)
    commands = {"steering_signal": np.array([1.0, 1.0, 0.0]), "crane_lift": np.array([0.0, 1.0, 1.0])}
    trace = twin.step(commands, 1.0, sample_every=0.01)  # short of the stop
    late = trace.time - trace.time[0] > 0.7
    turned = trace["joint_angle"][-1]
    assert turned[1] == pytest.approx(turned[0], rel=0.03) and turned[0] > 0.3 and abs(turned[2]) < 0.01
    lift = 6e4 * trace["crane_flow_lift"][late].mean(axis=0)
    leaks = machine.steering.pump.leakage * trace["pump_pressure"]
    spare = 6e4 * (trace["pump_flow"] - leaks - trace["flow_in"])[late].mean(axis=0)
    assert lift[2] == pytest.approx(70.0, rel=0.02)
    assert 5.0 < lift[1] < 40.0 and lift[1] == pytest.approx(spare[1], abs=3.0)


@pytest.mark.parametrize("joint", JOINTS)
def test_each_section_moves_its_joint_either_way_as_fast_as_its_oil_lets_it(joint):
    """q̇ = Q/(A dL/dq) by the flow that the section takes, over two swings of 1.53 s of the slew on its oil, under a steady
    signal."""
    twin = Twin(2, crane=True)
    twin.crane.place(POSE)
    twin.step({"parking_brake": 1.0}, 1.0)
    trace = twin.step({f"crane_{joint}": np.array([0.3, -0.3])}, 3.9, sample_every=0.01)
    crane, i = twin.crane.crane, JOINTS.index(joint)
    late = slice(80, 386)
    joints = np.stack([trace[f"crane_joint_{name}"][late].mean(axis=0) for name in JOINTS])
    pistons = (None, crane.lift.cylinder, crane.fold.cylinder, crane.telescope.cylinder)
    piston = pistons[i]
    areas = np.array([1.0, 1.0 if piston is None else piston.annulus_area / piston.bore_area])
    expected = np.array([1.0, -1.0]) * trace[f"crane_flow_{joint}"][late].mean(axis=0)
    expected = expected / (crane.displacements(joints)[i] * areas)
    assert trace[f"crane_rate_{joint}"][late].mean(axis=0) == pytest.approx(expected, rel=0.05)
    assert not twin.diverged
