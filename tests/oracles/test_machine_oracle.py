"""The continuous reference against balances and limits that need no second solver: oil, power, rest, known states."""

import numpy as np
import pytest

from tests.oracles.bodies import HALF_OF_WHEEL
from tests.oracles.hydraulics import Linkage, Oil, bristle_force, bristle_rate
from tests.oracles.machine import LAYOUT, POSE, SCALE, SLICES, VELOCITY, Command, MachineOracle, pack, unpack
from tests.oracles.tires import Plane

ATMOSPHERE = 101325.0


@pytest.fixture(scope="module")
def oracle(machine):
    return MachineOracle(machine)


@pytest.fixture(scope="module")
def turn(oracle, machine):
    """States of a full left turn at full signal into the stop, one a millisecond; the instants and the flows with them."""
    times = np.arange(0.0, 2.35, 1e-3)
    start = oracle.rest_state(-machine.joint.range)
    y = oracle.integrate(start, [(0.1, {"steering_signal": 1.0})], times, rtol=1e-5, atol=1e-5)
    _, info = oracle.evaluate(y, Command(), 1.0)
    return times, y, unpack(y), info


def scattered(oracle, count=200, seed=3):
    """Solver vectors (n, count) all over the state space: moving, in contact, every volume at its own pressure."""
    rng = np.random.default_rng(seed)
    base = pack(oracle.rest_state(0.0)) * SCALE[:, None]
    y = np.repeat(base, count, axis=1)
    spread = {
        "position": 0.02, "quaternion": 0.03, "theta": 0.5, "phi": 0.2, "velocity": 1.0, "angular_velocity": 0.4,
        "theta_rate": 0.5, "phi_rate": 0.5, "wheel_rate": 1.5, "joint_bristle": 2e-3, "arm_bristle": 1e-3,
        "wheel_bristle": 1e-3, "tire_bristle": 0.05,
    }  # fmt: skip
    for name, size in spread.items():
        shape = y[SLICES[name]].shape
        y[SLICES[name]] += size * rng.uniform(-1.0, 1.0, shape)
    for name, (_, scale) in LAYOUT.items():
        if scale == 1e6:
            y[SLICES[name]] = rng.uniform(-0.5e5, 250e5, y[SLICES[name]].shape)
    for name, low, high in (("spool", -1, 1), ("compensator", 0, 1), ("swash", 0, 1), ("arm_spool", -1, 1),
                            ("drive_swash", -1, 1), ("traction_opening", 0, 1)):  # fmt: skip
        y[SLICES[name]] = rng.uniform(low, high, y[SLICES[name]].shape)
    return y / SCALE[:, None]


# ---------------------------------------------------------------------------------------------------------------- rest
def test_rest_is_an_equilibrium_and_stays_one(oracle):
    """The rest pose comes from the project's statics: no rate survives, and a second of integration moves nothing."""
    start = oracle.rest_state(0.0)
    rate = oracle.rhs(pack(start)[:, 0], Command(), 0.0)
    assert np.abs(rate).max() < 1e-8  # of the states' scales, a second
    y = oracle.integrate(start, [], np.array([0.0, 1.0]))
    assert np.abs(y[:, 1] - y[:, 0]).max() < 1e-8


def test_rest_with_a_bent_joint_settles_without_turning(oracle, machine):
    """A bent machine leans by its lateral centre of mass, then rocks on its barely damped tires; the joint stays."""
    start = oracle.rest_state(-machine.joint.range)
    s = unpack(oracle.integrate(start, [], np.array([0.0, 1.0]), rtol=1e-5, atol=1e-5))
    assert abs(s["theta"][1] - s["theta"][0]) < np.radians(0.01)
    assert np.abs(s["velocity"][:, 1]).max() < 1e-2
    assert np.abs(s["position"][:, 1]).max() < 5e-3


def test_derived_parameters_agree_with_independent_ones(machine, oracle):
    """Areas, orifice constants and linkages of the machine against those that the reference finds its own way."""
    circuit, arms, valve = oracle.steering, oracle.arms, machine.steering.valve
    for cylinder, own in ((machine.steering.cylinder, circuit.cylinders), (machine.arm.cylinder, arms)):
        assert cylinder.bore_area == pytest.approx(own.bore, rel=1e-12)
        assert cylinder.annulus_area == pytest.approx(own.annulus, rel=1e-12)
        link: Linkage = own.link
        assert (cylinder.linkage.a, cylinder.linkage.b, cylinder.linkage.g0) == pytest.approx(
            (link.a, link.b, link.middle), rel=1e-9
        )
    pairs = (
        (valve.cv_in_left, circuit.cv_in["left"]),
        (valve.cv_in_right, circuit.cv_in["right"]),
        (valve.cv_out_left, circuit.cv_out["left"]),
        (valve.cv_out_right, circuit.cv_out["right"]),
        (valve.cv_compensator, circuit.cv_compensator),
        (valve.cv_anticavitation, circuit.cv_anticavitation),
        (machine.steering.pump.cv_bleed, circuit.cv_bleed),
        (machine.steering.tank_line.cv_suction, circuit.cv_suction),
        (machine.arm.valve.cv, arms.cv),
        (machine.driveline.charge.cv_check, oracle.driveline.cv_check),
        (machine.driveline.traction.cv, oracle.driveline.cv_traction),
    )
    for derived, own in pairs:
        assert derived == pytest.approx(own, rel=1e-12)


def test_linkages_span_the_strokes_with_the_slope_of_their_length(machine, oracle):
    for link, cylinder, half in (
        (oracle.steering.cylinders.link, machine.steering.cylinder, machine.joint.range),
        (oracle.arms.link, machine.arm.cylinder, machine.arm.swing),
    ):
        assert link.length(link.middle - half) == pytest.approx(cylinder.dead_length, rel=1e-12)
        assert link.length(link.middle + half) == pytest.approx(cylinder.dead_length + cylinder.stroke, rel=1e-12)
        gamma, h = link.middle + np.linspace(-half, half, 11), 1e-5
        slope = (link.length(gamma + h) - link.length(gamma - h)) / (2.0 * h)
        assert link.lever(gamma) == pytest.approx(slope, rel=1e-8)


# ----------------------------------------------------------------------------------------------------------------- oil
def test_oil_only_enters_and_leaves_at_pumps_tanks_and_cylinders(oracle):
    """Inside a circuit every flow leaves one volume and enters another: sums over the volumes keep only what is outside."""
    y = scattered(oracle)
    command = Command(arms=np.array([1.0, -0.5, 0.3, -1.0]))
    _, info = oracle.evaluate(y, command, 0.4)
    f, arms = info["steering"], info["arm_flows"]
    inside = sum(f[n] for n in ("into_a", "into_b", "into_supply", "into_return"))
    inside = inside + (arms["into_bore"] + arms["into_rod"]).sum(axis=0)
    outside = f["pump"] - f["pump_leak"] - f["bleed"] - f["supply_relief"] - f["to_tank"] + f["from_tank"]
    assert inside == pytest.approx(outside, abs=1e-12)
    assert np.abs(outside).max() > 1e-3

    d, s = info["driveline"], unpack(y)
    inside = d["into_forward"] + d["into_return"] + d["into_wheel"].sum(axis=0) + d["into_charge"]
    outside = d["charge"] - d["charge_relief"] - d["flush"] - d["case_forward"] - d["case_return"]
    assert inside == pytest.approx(outside, abs=1e-12)
    # a motor at rest passes its leakage only, a turning one its displacement a radian
    turned = scattered(oracle)
    turned[SLICES["wheel_rate"]] += 1.0 / SCALE[SLICES["wheel_rate"]][:, None]
    more = oracle.evaluate(turned, command, 0.4)[1]["driveline"]["into_return"] - d["into_return"]
    size = oracle.driveline.motor_size(s["fraction_front"], s["fraction_rear"]).sum(axis=0)
    assert more == pytest.approx(size, rel=1e-6)


@pytest.mark.slow
def test_a_turn_accounts_for_its_oil(turn, oracle, machine):
    """Net inflow = swept volume + compression, on both sides, at every instant of the whole turn into the stop."""
    times, _, s, info = turn
    cylinders, steering, oil = oracle.steering.cylinders, machine.steering, Oil(machine.oil)
    _, _, volume_a, volume_b, _, _ = cylinders.geometry(s["theta"])
    stroke = (cylinders.bore + cylinders.annulus) * cylinders.stroke
    for side, volume in (("a", volume_a), ("b", volume_b)):
        net = info["steering"][f"into_{side}"]
        entered = np.append(0.0, np.cumsum(0.5 * np.diff(times) * (net[1:] + net[:-1])))
        x = s[side]
        p = oil.pressure(x)
        # ∫ C dp with C = V/(β + slope p) + V_h/β_h; a void is what the state lacks below its pressure
        compliance = (
            volume / (machine.oil.bulk_modulus + machine.oil.bulk_modulus_slope * np.maximum(p, 0.0))
            + steering.hose_volume / steering.hose_bulk_modulus
        )
        squeezed = np.append(0.0, np.cumsum(0.5 * (compliance[1:] + compliance[:-1]) * np.diff(p)))
        void = np.maximum(machine.oil.void_pressure - x, 0.0) * oracle.steering.mid_volume / machine.oil.bulk_modulus
        missing = entered - (volume - volume[0] + squeezed - void)
        # trapezoids of 1 ms on flows that swing by 2e-3 m³/s within 10 ms err by h²/12 f'' t: some 1e-7 m³
        assert np.abs(missing).max() < 1e-6
    assert np.ptp(volume_a) > stroke  # and a little more, as the stop gives way
    end, begin = cylinders.geometry(machine.joint.range), cylinders.geometry(-machine.joint.range)
    assert end[2] - begin[2] == pytest.approx(stroke, rel=1e-12)


def test_a_void_takes_back_what_it_gave(oracle, machine):
    """Oil drawn from a volume below its void pressure and given back restores the pressure."""
    oil, volume = oracle.oil, 1e-3
    x, dt, flow = 2e5, 1e-7, 1e-3
    for sign in (-1.0, 1.0):
        for _ in range(20000):
            x += dt * float(oil.rate(x, sign * flow, volume, volume, 1.2e9, volume))
        if sign < 0.0:
            assert x < machine.oil.void_pressure
    assert x == pytest.approx(2e5, abs=2.0 * dt * flow / volume * 1.4e9)  # one step


@pytest.mark.parametrize("gas", [0.0, 0.01])
def test_compressibility_is_that_of_a_mixture(machine, gas):
    """1/β against -d ln V/dp of liquid and polytropic gas at one pressure; the law leaves out the liquid's own 1 %."""
    oil = Oil(machine.oil)
    oil.gas = gas
    p = np.array([1e5, 1e6, 1e7])

    def volume(p):
        liquid = (1.0 + oil.slope * p / oil.bulk_modulus) ** (-1.0 / oil.slope)
        return (1.0 - gas) * liquid + gas * (ATMOSPHERE / (p + ATMOSPHERE)) ** (1.0 / oil.exponent)

    h = 1e-4 * p
    exact = -(np.log(volume(p + h)) - np.log(volume(p - h))) / (2.0 * h)
    assert oil.compressibility(p) == pytest.approx(exact, rel=0.01)


# --------------------------------------------------------------------------------------------------------------- power
def test_energy_of_the_bodies_changes_by_the_power_put_in(oracle):
    """d(kinetic + potential)/dt along the motion = power of joint, arms, wheels and tires, in any state."""
    y = scattered(oracle, count=40)
    rate, info = oracle.evaluate(y, Command(), 0.0)
    x, dx = y * SCALE[:, None], rate * SCALE[:, None]

    def energy(step):
        z = x + step * dx
        return oracle.bodies.energy(z[POSE], z[VELOCITY])

    h = 1e-6
    change = (energy(h) - energy(-h)) / (2.0 * h)
    s, kin, contact = unpack(y), info["kinematics"], info["contact"]
    joint = sum(info["joint"].values()) * s["theta_rate"]
    arms = (sum(info["arms"].values()) * s["phi_rate"]).sum(axis=0)
    wheels = ((info["motor"] + info["brake"]) * s["wheel_rate"]).sum(axis=0)
    force = kin.to_half(info["tire_force"], HALF_OF_WHEEL)
    tires = ((force * contact["velocity"]).sum(axis=0) + contact["rolling_power"]).sum(axis=0)
    assert (contact["load"] > 0.0).mean() > 0.2
    assert change == pytest.approx(joint + arms + wheels + tires, rel=1e-6, abs=1e-4 * np.abs(change).max())


def test_every_passive_part_dissipates(oracle):
    y = scattered(oracle, count=400)
    command = Command(arms=np.array([1.0, -0.5, 0.3, -1.0]))
    _, info = oracle.evaluate(y, command, 0.4)
    s, f = unpack(y), info["steering"]
    p = {name: oracle.oil.pressure(s[name]) for name in ("supply", "a", "b", "return_line")}
    load, back = np.where(s["spool"] > 0, p["a"], p["b"]), np.where(s["spool"] > 0, p["b"], p["a"])
    for power in (
        f["valve_in"] * (p["supply"] - load),
        f["valve_out"] * (back - p["return_line"]),
        f["shock_a"] * (p["a"] - p["return_line"]),
        f["shock_b"] * (p["b"] - p["return_line"]),
        f["suction_a"] * (p["return_line"] - p["a"]),
        f["suction_b"] * (p["return_line"] - p["b"]),
        f["leak_a"] * (p["a"] - p["return_line"]),
        f["cylinder_leak"] * (p["a"] - p["b"]),
        f["pump_leak"] * p["supply"],
        f["bleed"] * s["load_sensing"],
        f["supply_relief"] * p["supply"],
        f["to_tank"] * p["return_line"],
        -f["from_tank"] * p["return_line"],
        -info["joint"]["viscous"] * s["theta_rate"],
        -info["arms"]["viscous"] * s["phi_rate"],
        -info["contact"]["rolling_power"],
    ):
        assert power.min() >= 0.0
        assert power.shape[-1] == y.shape[1]
    assert (f["edge_drop"] >= 0.0).all() and (f["valve_in"] >= 0.0).all()


def test_friction_elements_lose_energy_over_any_cycle():
    """Prandtl element driven round a Lissajous figure of amplitudes: work in, spring energy returned, never more out."""
    k, c, capacity = 7e5, 5e3, 400.0
    t, dt = np.linspace(0.0, 4.0 * np.pi, 100001, retstep=True)
    speeds = np.outer(np.cos(t) + 0.5 * np.cos(2.0 * t), (2e-4, 5e-3, 0.1))
    z, work = np.zeros(3), np.zeros(3)
    for v in speeds:
        work -= bristle_force(z, v, k, c, capacity) * v * dt
        z = z + dt * bristle_rate(z, v, capacity / k)
    assert np.all(work > 0.0)
    assert np.all(np.abs(z) <= capacity / k * 1.01)
    # wide cycles slide nearly all the way: the work is capacity times path
    assert work[2] == pytest.approx(capacity * np.abs(speeds[:, 2]).sum() * dt, rel=0.05)


def test_tire_brakes_steady_sliding_with_coulomb_friction(oracle, machine):
    """A locked wheel dragged at constant speed feels μ(v) F_n against its motion, along and across."""
    tire, p = oracle.tire, machine.tire
    n = np.array([0.0, 0.0, 1.0]).reshape(3, 1)
    for direction in (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])):
        speed, z = 0.7, np.zeros((2, 1))
        velocity = (speed * direction).reshape(3, 1)
        for _ in range(1000):
            force, _, z_rate, info = tire.contact(
                np.array([-0.55]), n, 1.0, z, velocity, np.zeros((3, 1)), np.zeros(1), 1.0, 0.0
            )
            z = z + 2e-3 * z_rate
        g = p.friction_coulomb + (p.friction_static - p.friction_coulomb) * np.exp(
            -((speed / p.stribeck_velocity) ** 2)
        )
        viscous = np.array([p.sigma2_longitudinal, p.sigma2_lateral]) @ np.abs(direction[:2]) * speed
        expected = -(g + viscous) * info["load"] * direction[:2]
        assert info["load"] == pytest.approx(p.stiffness * 0.05, rel=1e-9)
        assert force[:2, 0] == pytest.approx(expected, rel=1e-6, abs=1e-6 * info["load"][0])


# -------------------------------------------------------------------------------------------------------- limit states
def test_compensator_in_balance_meters_the_nominal_flow(oracle, machine):
    """At mid stroke the compensator keeps its reference over the edge: U Q_nom whatever supply and load are."""
    valve, circuit = machine.steering.valve, oracle.steering
    for spool, nominal in ((0.75, valve.nominal_flow_left), (-0.75, valve.nominal_flow_right)):
        opening, left = circuit.opening(np.array([spool]))
        expected = valve.opening_left_1V5 if spool > 0 else valve.opening_right_1V5
        assert opening[0] == pytest.approx(expected)
        c1, cv = 0.5 * circuit.cv_compensator, circuit.cv_in["left" if spool > 0 else "right"]
        drop = valve.compensator_pressure * (1.0 + (opening[0] * cv / c1) ** 2)
        load = np.array([50e5])
        p_a, p_b = (load, np.zeros(1)) if spool > 0 else (np.zeros(1), load)
        _, _, _, q_in, _, edge = circuit.valve_flows(np.array([spool]), np.array([0.5]), load + drop, p_a, p_b, 0.0)
        assert edge[0] == pytest.approx(valve.compensator_pressure, rel=1e-12)
        in_drop = valve.nominal_drop_in_left if spool > 0 else valve.nominal_drop_in_right
        assert q_in[0] == pytest.approx(opening[0] * nominal * np.sqrt(valve.compensator_pressure / in_drop), rel=1e-12)
        assert bool(left[0]) == (spool > 0)


def test_dead_band_closes_both_edges(oracle):
    spool = np.array([0.0, 0.134, -0.174])
    none = np.zeros(3)
    _, _, _, q_in, q_out, edge = oracle.steering.valve_flows(spool, none + 1.0, none + 1e7, none, none + 5e6, none)
    assert np.all(q_in == 0.0) and np.all(q_out == 0.0) and np.all(edge == 0.0)


@pytest.mark.slow
def test_turn_is_that_of_the_machine(turn, oracle, machine):
    """Stop to stop in about two seconds with the published shape: first peak near 0.1 s, then the metered flow."""
    times, y, s, info = turn
    out = oracle.outputs(times, y)
    flow = out["joint_flow"] * 6e4
    moved = times[np.argmax(s["theta"] > -machine.joint.range + np.radians(0.1))]
    stopped = times[np.argmax(s["theta"] > machine.joint.range - np.radians(0.1))]
    duration = stopped - moved
    since = times - moved
    assert duration == pytest.approx(1.98, rel=0.15)
    first = since < 0.3
    assert 0.05 < since[first][flow[first].argmax()] < 0.2
    assert 85.0 < flow[first].max() < 110.0
    steady = (since > 0.48 * duration) & (since < 0.92 * duration)
    assert flow[steady].mean() == pytest.approx(info["steering"]["valve_in"][steady].mean() * 6e4, rel=0.02)
    assert flow[steady].mean() == pytest.approx(69.0, rel=0.15)
    assert (out["pressure_a"] > out["pressure_b"]).mean() > 0.8


@pytest.mark.slow
def test_driving_takes_the_pressure_that_brakes_and_tires_add_up_to(oracle, machine):
    """Straight on at constant speed: η Δp D = disc torque + rolling resistance, summed over the wheels."""
    d = machine.driveline
    times = np.array([0.0, 9.0])  # by then the engine's governor has settled, too
    s = unpack(oracle.integrate(oracle.rest_state(0.0), [(0.0, {"drive_signal": 0.65})], times, rtol=1e-5, atol=1e-5))
    drop = (s["wheel_line"] - s["drive_return"]).mean(axis=0)[-1]
    weight = 9.81 * machine.mass
    rolling = machine.tire.rolling_resistance * weight / 4.0 * machine.tire.radius
    expected = (d.brake.disc_torque + rolling) / (d.motor.mechanical_efficiency * d.motor.displacement)
    assert drop == pytest.approx(expected, rel=2e-3)
    # the pump's flow less two kinds of leakage turns the wheels, and they roll at the tire's radius
    w, omega = s["wheel_rate"][:, -1], s["engine_speed"][-1]
    leak = d.pump.cross_leakage * drop + d.motor.leakage * 4.0 * drop + d.pump.leakage * s["drive_forward"][-1]
    supplied = 0.65 * d.pump.displacement * omega - leak
    assert 4.0 * d.motor.displacement * w.mean() == pytest.approx(supplied, rel=2e-3)
    assert s["velocity"][0, -1] == pytest.approx(w.mean() * machine.tire.radius, rel=5e-3)
    assert omega == pytest.approx(machine.engine.set_speed, rel=2e-3)


@pytest.mark.slow
def test_parking_brake_holds_on_a_slope(machine):
    """Standing across and along an 8° slope with the parking brake: bristles carry the weight, nothing creeps."""
    slope = np.tan(np.radians(8.0))
    for ground in (Plane(slope_x=slope), Plane(slope_y=slope)):
        oracle = MachineOracle(machine, ground=ground)
        start = oracle.rest_state(0.0)
        axis = np.cross([0.0, 0.0, 1.0], ground.normal)
        angle = np.radians(8.0)
        start["quaternion"][:] = [np.cos(0.5 * angle), *(np.sin(0.5 * angle) * axis / np.linalg.norm(axis))]
        y = oracle.integrate(start, [(0.0, {"parking_brake": 1.0})], np.array([0.0, 3.0, 3.5]), rtol=1e-5, atol=1e-5)
        s = unpack(y)
        # after 3 s its rocking on the tires, about 1 Hz with 5 % of damping, is down to a few mm
        assert np.abs(s["position"][:, 2] - s["position"][:, 1]).max() < 2e-2
        assert np.linalg.norm(s["position"][:, 2]) < 0.15
        _, info = oracle.evaluate(y[:, -1], Command(parking_brake=1.0), 0.0)
        weight = 9.81 * machine.mass
        assert info["contact"]["load"].sum() == pytest.approx(weight * np.cos(angle), rel=0.1)
        along = np.hypot(*info["contact"]["push"].sum(axis=1)).item()
        assert along == pytest.approx(weight * np.sin(angle), rel=0.3)


def test_engine_governor_returns_to_the_set_speed(oracle, machine):
    """A constant load ends at the set speed with torque = load + friction, one beyond the torque curve stalls it."""
    engine, h = oracle.engine, 1e-3
    for load, holds in ((300.0, True), (900.0, False)):
        s = {"engine_speed": machine.engine.set_speed, "governor": 80.0, "engine_torque": 80.0}
        for _ in range(20000):
            rate = engine.rates(s, load)
            s = {name: float(s[name] + h * np.clip(rate[name], -1e5, 1e5)) for name in s}
            s["governor"] = max(s["governor"], 0.0)
        if holds:
            assert s["engine_speed"] == pytest.approx(machine.engine.set_speed, rel=1e-3)
            assert s["engine_torque"] == pytest.approx(load + engine.friction(s["engine_speed"]), rel=1e-3)
        else:
            assert s["engine_speed"] < 0.1 * machine.engine.set_speed


@pytest.mark.slow
def test_solver_tolerance_is_converged(oracle, machine):
    """Start and first peak, with all switching of valve and compensator: ten times tighter moves the flow by < 0.1 %."""
    times = np.arange(0.0, 0.4, 1e-3)
    start, steps = oracle.rest_state(-machine.joint.range), [(0.1, {"steering_signal": 1.0})]
    flows = []
    for tolerance in (1e-5, 1e-6):
        y = oracle.integrate(start, steps, times, rtol=tolerance, atol=tolerance)
        flows.append(oracle.outputs(times, y)["joint_flow"])
    assert np.abs(flows[1] - flows[0]).max() < 1e-3 * np.abs(flows[1]).max()


def test_states_round_trip(oracle):
    y = scattered(oracle, count=3)
    assert pack(unpack(y)) == pytest.approx(y, rel=1e-15)
    assert y[POSE].shape[0] == 16
