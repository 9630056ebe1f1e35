"""The pendulum arms' cylinders and valves: geometry, metering, load holding, balances of oil and power."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.arms import (
    Arm,
    ArmGeometry,
    ArmState,
    ArmValve,
    arm_displace,
    arm_fill,
    arm_flows,
    arm_gas,
    arm_geometry,
    arm_oil_torque,
    load_holding,
)
from aoro_gym.twin.physics.fluid import Oil
from tests.twin.physics.elements import (
    BAR,
    LITRE_A_MINUTE,
    OIL,
    SUBSTEP,
    VOID,
    chamber_compliance,
    closed_linkage,
    cv,
    orifice,
    pin_distance,
    relief,
    uncrossed,
)
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record, rounded

SWING = np.radians(28.0)

ARM = record(
    Arm,
    length=0.7,
    swing=SWING,
    pivot_lateral=0.6,
    stop_torsional_stiffness=1.4e7,
    stop_torsional_damping=1.4e4,
    presliding_stiffness=1e6,
    presliding_damping=2e3,
    rod_rest_pressure=5.0 * BAR,
    hose_volume=0.3e-3,
    hose_compliance=0.3e-3 / 1.2e9,
    cylinder_linkage=closed_linkage(a=0.9, b=0.5, g0=1.2, half_range=SWING),
    cylinder_bore_area=5.027e-3,
    cylinder_annulus_area=3.770e-3,
    cylinder_dead_volume=0.05e-3,
    cylinder_seal_preload=250.0,
    cylinder_seal_pressure_coefficient=1e-4,
    cylinder_seal_static_ratio=1.3,
    cylinder_seal_stribeck_velocity=0.01,
    cylinder_seal_viscous=1000.0,
    valve_cv=cv(40.0, 7.0),
    valve_pressure_drop=7.0 * BAR,
    valve_dead_band=0.1,
    valve_time_constant=0.05,
    valve_rate_limit=5.0,
    valve_holding_pressure=250.0 * BAR,
    valve_holding_ramp=20.0 * BAR,
    valve_pilot_ratio=4.0,
    valve_port_relief=350.0 * BAR,
    valve_port_ramp=20.0 * BAR,
    valve_port_flow=100.0 * LITRE_A_MINUTE,
)


@wp.kernel(enable_backward=False)
def geometry_kernel(
    m: wp.array(dtype=Arm),
    angle: wp.array(dtype=float),
    spool: wp.array(dtype=float),
    geometry: wp.array(dtype=ArmGeometry),
):
    i = wp.tid()
    geometry[i] = arm_geometry(m[i], angle[i], spool[i])


@wp.kernel(enable_backward=False)
def holding_kernel(
    m: wp.array(dtype=Arm), load: wp.array(dtype=float), pilot: wp.array(dtype=float), opening: wp.array(dtype=float)
):
    i = wp.tid()
    opening[i] = load_holding(m[i], load[i], pilot[i])


SECTION = record(
    ArmValve,
    arm_valve_law=OPTIONS["arm_valve"].index("section"),
    pressure_drop=7.0 * BAR,
    compensator_time_constant=2e-3,
    cv_compensator=cv(40.0, 3.0),
)
IDEAL = changed(SECTION, arm_valve_law=0)


@wp.kernel(enable_backward=False)
def section_kernel(
    m: wp.array(dtype=Arm),
    v: wp.array(dtype=ArmValve),
    oil: wp.array(dtype=Oil),
    spool: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    supply: wp.array(dtype=float),
    start: wp.array(dtype=ArmState),
    fills: int,
    steps: wp.array(dtype=int),
    dt: wp.array(dtype=float),
    end: wp.array(dtype=ArmState),
    drawn: wp.array(dtype=float),
):
    """Substeps at a constant supply and joint rate; ``fills``: chambers take what flows, else their pressures are held."""
    i = wp.tid()
    g = arm_geometry(m[i], 0.0, spool[i])
    s = start[i]
    gas = arm_gas(oil[i], s)
    for _ in range(steps[i]):
        flows = arm_flows(m[i], v[i], oil[i], g, rate[i], supply[i], 0.0, s, dt[i])
        if fills > 0:
            s = arm_fill(m[i], oil[i], gas, g, s, flows.bore, flows.rod, dt[i])
        s.compensator = flows.compensator
        drawn[i] = flows.drawn
    end[i] = s


@wp.kernel(enable_backward=False)
def step_kernel(
    m: wp.array(dtype=Arm),
    oil: wp.array(dtype=Oil),
    angle: wp.array(dtype=float),
    spool: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    supply: wp.array(dtype=float),
    tank: wp.array(dtype=float),
    start: wp.array(dtype=ArmState),
    dt: wp.array(dtype=float),
    steps: int,
    end: wp.array(dtype=ArmState),
    drawn: wp.array(dtype=float),
    returned: wp.array(dtype=float),
    load: wp.array(dtype=float),
):
    """A number of substeps at one angle and rate; the flows are the last substep's."""
    i = wp.tid()
    g = arm_geometry(m[i], angle[i], spool[i])
    s = start[i]
    gas = arm_gas(oil[i], s)
    for _ in range(steps):
        flows = arm_flows(m[i], ArmValve(), oil[i], g, rate[i], supply[i], tank[i], s, dt[i])
        s = arm_fill(m[i], oil[i], gas, g, s, flows.bore, flows.rod, dt[i])
        drawn[i] = flows.drawn
        returned[i] = flows.returned
        load[i] = flows.load
    end[i] = s


@wp.kernel(enable_backward=False)
def lift_kernel(
    m: wp.array(dtype=Arm),
    oil: wp.array(dtype=Oil),
    angle: wp.array(dtype=float),
    risen: wp.array(dtype=float),
    start: wp.array(dtype=ArmState),
    end: wp.array(dtype=ArmState),
    torque_before: wp.array(dtype=float),
    torque_after: wp.array(dtype=float),
):
    """The arm raised by a small angle with its valve shut, and the oil's torque before and after."""
    i = wp.tid()
    g = arm_geometry(m[i], angle[i], 0.0)
    s = arm_displace(m[i], oil[i], g, risen[i], start[i])
    torque_before[i] = arm_oil_torque(oil[i], g, start[i])
    torque_after[i] = arm_oil_torque(oil[i], g, s)
    end[i] = s


# ---- geometry ----


def chambers(m, angle):
    """Volumes of bore and rod side from the pins' distance: the cylinder extends as the wheel goes down."""
    extension = pin_distance(m.cylinder_linkage, -angle) - m.cylinder_linkage.dead_length
    fixed = m.hose_volume + m.cylinder_dead_volume
    return (
        fixed + m.cylinder_bore_area * extension,
        fixed + m.cylinder_annulus_area * (m.cylinder_linkage.stroke - extension),
    )


ANGLES = rounded(np.linspace(-SWING, SWING, 301))
# lengths of 0.6 to 1 m, their squares of up to 2 m² (a² + b² + 2ab) with four roundings, over twice the length
LENGTH_ERROR = 4.0 * ROUNDOFF * 2.0 / 1.2 + 4.0 * ROUNDOFF


def test_chambers_follow_the_pins():
    m = columns(ARM)
    g = launch(geometry_kernel, ARM, ANGLES, 0.0)
    bore, rod = chambers(m, ANGLES)
    # the volumes of up to 2.5 L round as well
    np.testing.assert_allclose(g.volume_bore, bore, atol=m.cylinder_bore_area * LENGTH_ERROR + 4 * ROUNDOFF * 2.5e-3)
    np.testing.assert_allclose(g.volume_rod, rod, atol=m.cylinder_annulus_area * LENGTH_ERROR + 4 * ROUNDOFF * 2.5e-3)


def test_displacements_and_lever_are_derivatives():
    m, step = columns(ARM), 1e-5
    g = launch(geometry_kernel, ARM, ANGLES, 0.0)
    after, before = chambers(m, ANGLES + step), chambers(m, ANGLES - step)
    for value, up, down in ((g.displacement_bore, after[0], before[0]), (g.displacement_rod, after[1], before[1])):
        # a dozen roundings; float64 difference quotient of 1e-3 m³: 1e-19/1e-5
        np.testing.assert_allclose(value, (up - down) / (2 * step), rtol=16 * ROUNDOFF, atol=1e-11)
    assert np.all(g.displacement_bore < 0.0)  # raising the wheel presses oil out of the bore
    assert np.all(g.displacement_rod > 0.0)
    link = m.cylinder_linkage
    slope = (pin_distance(link, -ANGLES + step) - pin_distance(link, -ANGLES - step)) / (2 * step)
    np.testing.assert_allclose(g.lever, slope, rtol=16 * ROUNDOFF)


def test_full_swing_takes_the_whole_stroke():
    m = columns(ARM)
    g = launch(geometry_kernel, ARM, np.array([-SWING, SWING]), 0.0)
    stroke = m.cylinder_linkage.stroke
    assert g.volume_bore[0] - g.volume_bore[1] == pytest.approx(m.cylinder_bore_area * stroke, rel=32 * ROUNDOFF)
    assert g.volume_rod[1] - g.volume_rod[0] == pytest.approx(m.cylinder_annulus_area * stroke, rel=32 * ROUNDOFF)


def test_opening_starts_beyond_the_dead_band_on_either_side():
    spool = rounded(np.array([-1.0, -0.55, -0.1, -0.05, 0.0, 0.05, 0.1, 0.55, 1.0]))
    expected = [-1.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0]
    opening = launch(geometry_kernel, ARM, 0.0, spool).opening
    np.testing.assert_allclose(opening, expected, atol=4 * ROUNDOFF)
    np.testing.assert_array_equal(opening[2:7], 0.0)


# ---- load holding ----


def test_load_holding_opens_by_pilot_or_overload():
    load = np.array([0.0, 100.0, 100.0, 100.0, 100.0, 250.0, 260.0, 270.0, 400.0, -0.9]) * BAR
    pilot = np.array([0.0, 0.0, 37.5, 40.0, 42.5, 0.0, 0.0, 0.0, 0.0, 62.9]) * BAR
    expected = [0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.5, 1.0, 1.0, 0.035]
    # sums of 250 bar over a ramp of 20
    np.testing.assert_allclose(launch(holding_kernel, ARM, load, pilot), expected, atol=4 * ROUNDOFF * 270 / 20)


@pytest.mark.parametrize("spool", [-1.0, 1.0])
def test_load_is_held_until_the_pump_pushes(spool):
    """A loaded arm with the valve opened against its load: not a drop leaves while the pilot line is at rest."""
    held = {"bore": 100.0 * BAR, "rod": 0.0} if spool < 0 else {"bore": 0.0, "rod": 100.0 * BAR}
    start = record(ArmState, **held, compensator=0.0)
    end, drawn, returned, _ = launch(step_kernel, ARM, OIL, 0.0, spool, 0.0, 0.0, 0.0, start, SUBSTEP, 1000)
    assert drawn == returned == 0.0
    assert end.bore == rounded(held["bore"])
    assert end.rod == rounded(held["rod"])
    # with supply, the pilot rises and the load sinks
    end, drawn, returned, _ = launch(step_kernel, ARM, OIL, 0.0, spool, 0.0, 100.0 * BAR, 0.0, start, SUBSTEP, 1000)
    assert min(drawn, returned) >= 0.0
    assert (end.bore if spool < 0 else end.rod) < 100.0 * BAR


# ---- the circuit of one arm ----


def circuit(m, g, rate, supply, tank, s):
    """Flows [m³/s] by their definition, and the net flow into both chambers."""
    p_b, p_r = np.maximum(s.bore, VOID), np.maximum(s.rod, VOID)
    extend = g.opening > 0.0
    coefficient = np.abs(g.opening) * m.valve_cv
    p_in, p_out = np.where(extend, p_b, p_r), np.where(extend, p_r, p_b)
    f = SimpleNamespace()
    f.into = orifice(coefficient, np.clip(supply - p_in, 0.0, m.valve_pressure_drop))
    hold = np.clip((p_out + m.valve_pilot_ratio * p_in - m.valve_holding_pressure) / m.valve_holding_ramp, 0.0, 1.0)
    f.out = hold * orifice(coefficient, np.maximum(p_out - tank, 0.0))
    f.relief_b = relief(p_b - tank, m.valve_port_relief, m.valve_port_ramp, m.valve_port_flow)
    f.relief_r = relief(p_r - tank, m.valve_port_relief, m.valve_port_ramp, m.valve_port_flow)
    f.swept_b, f.swept_r = g.displacement_bore * rate, g.displacement_rod * rate
    net = SimpleNamespace(
        bore=np.where(extend, f.into, -f.out) - f.relief_b - f.swept_b,
        rod=np.where(extend, -f.out, f.into) - f.relief_r - f.swept_r,
    )
    return f, net, p_in, p_out


@pytest.fixture(scope="module")
def case():
    """Random parameters (±30 %), states (voids included), spools and motion, and one large step of all."""
    rng = np.random.default_rng(1)
    count = 4000
    names = [n for n in ARM.dtype.names if n not in ("cylinder_linkage", "valve_dead_band")]
    m = changed(ARM, **{n: float(ARM[n]) * rng.uniform(0.7, 1.3, count) for n in names})

    def contents():
        return np.where(rng.random(count) < 0.1, rng.uniform(-30.0, -0.95, count), rng.uniform(0, 420, count)) * BAR

    out = SimpleNamespace(
        record=m,
        m=columns(m),
        angle=rounded(rng.uniform(-SWING, SWING, count)),
        spool=rounded(np.where(rng.random(count) < 0.2, 0.0, rng.uniform(-1.0, 1.0, count))),
        rate=rounded(rng.normal(0.0, 0.3, count)),
        supply=rounded(rng.uniform(-0.5, 300.0, count) * BAR),
        tank=rounded(rng.uniform(-0.5, 8.0, count) * BAR),
        start=record(ArmState, bore=contents(), rod=contents(), compensator=0.0),
        dt=2e-4,
    )
    out.s = columns(out.start)
    out.geometry = launch(geometry_kernel, m, out.angle, out.spool)
    out.end, out.drawn, out.returned, out.load = launch(
        step_kernel, m, OIL, out.angle, out.spool, out.rate, out.supply, out.tank, out.start, out.dt, 1
    )
    out.flows, out.net, out.p_in, out.p_out = circuit(out.m, out.geometry, out.rate, out.supply, out.tank, out.s)
    m, g, oil = out.m, out.geometry, columns(OIL)
    fixed = m.hose_volume + m.cylinder_dead_volume
    stroke = m.cylinder_linkage.stroke
    nominal = fixed + 0.5 * m.cylinder_bore_area * stroke, fixed + 0.5 * m.cylinder_annulus_area * stroke
    out.compliance = SimpleNamespace(
        bore=chamber_compliance(oil, out.s.bore, g.volume_bore, m.hose_compliance, nominal[0]),
        rod=chamber_compliance(oil, out.s.rod, g.volume_rod, m.hose_compliance, nominal[1]),
    )
    # Rounding of a net flow: every element by its own flow; load holding by (1 + R) p over its ramp, reliefs by p over
    # theirs, of the flow that they pass fully open; the content by half an ulp, over the step.
    magnitude = sum(np.abs(x) for x in vars(out.flows).values())
    largest = 450.0 * BAR
    steep = (1 + m.valve_pilot_ratio) / m.valve_holding_ramp * m.valve_cv * np.sqrt(largest)
    steep += m.valve_port_flow / m.valve_port_ramp
    contents = {n: np.abs(getattr(out.s, n)) + np.abs(getattr(out.end, n)) for n in ("bore", "rod")}
    out.slack = SimpleNamespace(
        **{
            n: ROUNDOFF * (16 * magnitude + 4 * steep * largest + 4 * getattr(out.compliance, n) * contents[n] / out.dt)
            for n in contents
        }
    )
    return out


def test_chambers_gain_what_flows_into_them(case):
    for name in ("bore", "rod"):
        before, after = getattr(case.s, name), getattr(case.end, name)
        gained = getattr(case.compliance, name) * (after - before) / case.dt
        same = uncrossed(before, after)
        assert np.mean(same) > 0.8
        assert np.all((np.abs(gained - getattr(case.net, name)) <= getattr(case.slack, name))[same]), name
    assert np.median(case.slack.bore) < 1e-6
    assert np.mean(case.flows.out > 0.0) > 0.1


def test_arm_neither_makes_nor_loses_oil(case):
    gained = case.flows.swept_b + case.flows.swept_r
    for name in ("bore", "rod"):
        gained = gained + getattr(case.compliance, name) * (getattr(case.end, name) - getattr(case.s, name)) / case.dt
    same = uncrossed(case.s.bore, case.end.bore) & uncrossed(case.s.rod, case.end.rod)
    off = np.abs(gained - (case.drawn - case.returned)) > 2 * (case.slack.bore + case.slack.rod)
    assert np.mean(same) > 0.7
    assert not np.any(off & same)


def test_oil_carries_the_arm_by_the_volumes_that_it_gains(case):
    """Virtual work: τ dφ = p_b dV_b + p_r dV_r. Bore pressure pushes the wheel down."""
    m, step = case.m, 1e-6
    torque = launch(lift_kernel, case.record, OIL, case.angle, 0.0, case.start)[1]
    gains = [
        (up - down) / (2 * step)
        for up, down in zip(chambers(m, case.angle + step), chambers(m, case.angle - step), strict=True)
    ]
    work = [np.maximum(getattr(case.s, n), VOID) * gain for n, gain in zip(("bore", "rod"), gains, strict=True)]
    # levers with a dozen roundings, difference quotients of 2 L good to 2e-3 · 1e-16 / 1e-6, times 420 bar
    slack = 16 * ROUNDOFF * (np.abs(work[0]) + np.abs(work[1])) + 4e-13 * 420 * BAR
    assert np.all(np.abs(torque - work[0] - work[1]) <= slack)
    loaded = record(ArmState, bore=80.0 * BAR, rod=0.0, compensator=0.0)
    assert launch(lift_kernel, ARM, OIL, 0.0, 0.0, loaded)[1] < 0.0


def test_raised_arm_squeezes_its_chambers(case):
    """Shut: C Δp = −dV/dφ Δφ in either chamber; the torque falls by Σ (dV/dφ)²/C Δφ, a spring."""
    risen = rounded(np.random.default_rng(2).normal(0.0, 1e-3, case.angle.size))
    end, before, after = launch(lift_kernel, case.record, OIL, case.angle, risen, case.start)
    whole = uncrossed(case.s.bore, end.bore) & uncrossed(case.s.rod, end.rod)
    assert np.mean(whole) > 0.7
    spring = 0.0
    for name in ("bore", "rod"):
        x, y, c = getattr(case.s, name), getattr(end, name), getattr(case.compliance, name)
        gain = getattr(case.geometry, f"displacement_{name}")
        slack = 16 * ROUNDOFF * np.abs(gain * risen / c) + 2 * ROUNDOFF * (np.abs(x) + np.abs(y))
        assert np.all((np.abs(y - x + gain * risen / c) <= slack)[whole]), name
        spring = spring + np.where(x > VOID, gain**2 / c, 0.0)
    slack = 64 * ROUNDOFF * (spring * np.abs(risen) + 420 * BAR * 5e-3)
    assert np.all((np.abs(after - before + spring * risen) <= slack)[whole])


def test_valve_draws_and_returns_by_its_edges(case):
    open_ = case.geometry.opening != 0.0
    np.testing.assert_allclose(case.drawn, case.flows.into, rtol=32 * ROUNDOFF, atol=1e-12)
    expected = case.flows.out + case.flows.relief_b + case.flows.relief_r
    assert np.all(np.abs(case.returned - expected) <= case.slack.bore + case.slack.rod)
    np.testing.assert_array_equal(case.load, np.where(open_, case.p_in, 0.0))
    # the compensator: full opening never draws more than its share of the nominal flow
    nominal = case.m.valve_cv * np.sqrt(case.m.valve_pressure_drop)
    assert np.all(case.drawn <= np.abs(case.geometry.opening) * nominal * (1 + 16 * ROUNDOFF))


def test_valve_only_loses_power(case):
    assert np.all(case.drawn >= 0.0)
    assert np.all(case.returned >= 0.0)
    assert np.all(case.drawn * (case.supply - case.p_in) >= 0.0)
    assert np.all(case.returned * (np.maximum(case.s.bore, case.s.rod) - case.tank) >= 0.0)
    # chambers at rest, no oil from the pump: their power is never positive above the tank's pressure
    start = changed(case.start, bore=np.maximum(case.s.bore, 8 * BAR), rod=np.maximum(case.s.rod, 8 * BAR))
    end, drawn, _, _ = launch(step_kernel, case.record, OIL, case.angle, case.spool, 0.0, 0.0, 0.0, start, case.dt, 1)
    np.testing.assert_array_equal(drawn, 0.0)
    assert np.all(end.bore <= columns(start).bore)
    assert np.all(end.rod <= columns(start).rod)
    assert np.any(end.bore < columns(start).bore)


def test_flow_does_not_depend_on_load_or_supply():
    """Ideal compensator: U Q_nom as long as the supply exceeds the load by the nominal drop."""
    load = np.array([0.0, 50.0, 150.0, 193.0, 200.0]) * BAR
    start = record(ArmState, bore=load, rod=0.0, compensator=0.0)
    _, drawn, _, signal = launch(step_kernel, ARM, OIL, 0.0, 0.55, 0.0, 200.0 * BAR, 0.0, start, SUBSTEP, 1)
    np.testing.assert_allclose(drawn[:4], 0.5 * 40.0 * LITRE_A_MINUTE, rtol=32 * ROUNDOFF)
    assert drawn[4] == 0.0
    np.testing.assert_array_equal(signal, rounded(load))


def test_supply_below_the_load_neither_lifts_nor_drops_it():
    start = record(ArmState, bore=100.0 * BAR, rod=5.0 * BAR, compensator=0.0)
    _, drawn, _, _ = launch(step_kernel, ARM, OIL, 0.0, 1.0, 0.0, 50.0 * BAR, 0.0, start, SUBSTEP, 1)
    assert drawn == 0.0


def test_closed_valve_passes_nothing_in_a_hundred_thousand_substeps():
    bore = np.array([0.1, 5.0, 80.0, 200.0, 340.0]) * BAR
    start = record(ArmState, bore=bore, rod=5.0 * BAR, compensator=0.0)
    spool = np.array([0.0, 0.05, -0.05, 0.099, -0.099])
    end, drawn, returned, load = launch(
        step_kernel, ARM, OIL, -0.1, spool, 0.0, 210.0 * BAR, 3.0 * BAR, start, SUBSTEP, 100_000
    )
    np.testing.assert_array_equal(end.bore, rounded(bore))
    np.testing.assert_array_equal(end.rod, rounded(5.0 * BAR))
    for flow in (drawn, returned, load):
        np.testing.assert_array_equal(flow, 0.0)


def test_closed_cylinder_springs_back():
    """Wheel pushed up against a closed valve: bore pressure rises by β ΔV/V, rod pressure falls."""
    g = launch(geometry_kernel, ARM, 0.0, 0.0)
    start = record(ArmState, bore=80.0 * BAR, rod=40.0 * BAR, compensator=0.0)
    steps, rate = 100, 0.001 / (100 * SUBSTEP)  # 1 mrad
    end, *_ = launch(step_kernel, ARM, OIL, 0.0, 0.0, rate, 0.0, 0.0, start, SUBSTEP, steps)
    # β grows by 10 Δp/β: over the rise of 14 bar less than 1 %
    for name, swept, volume, p in (
        ("bore", g.displacement_bore, g.volume_bore, 80.0),
        ("rod", g.displacement_rod, g.volume_rod, 40.0),
    ):
        c = volume / (1.4e9 + 10.0 * p * BAR) + 0.3e-3 / 1.2e9
        assert getattr(end, name) - p * BAR == pytest.approx(-swept * 1e-3 / c, rel=0.01)
    assert end.bore > 85.0 * BAR
    assert end.rod < 35.0 * BAR


def test_port_reliefs_bound_a_blow():
    """A wheel that is driven up fast: the bore's relief passes what is swept."""
    m = columns(ARM)
    g = launch(geometry_kernel, ARM, 0.0, 0.0)
    start = record(ArmState, bore=80.0 * BAR, rod=5.0 * BAR, compensator=0.0)
    end, _, returned, _ = launch(step_kernel, ARM, OIL, 0.0, 0.0, 1.0, 0.0, 0.0, start, SUBSTEP, 3000)
    swept = -g.displacement_bore * 1.0
    settled = m.valve_port_relief + m.valve_port_ramp * swept / m.valve_port_flow
    # settled within C/(flow/ramp), milliseconds, to where dt Q/C is less than half an ulp
    capacity = g.volume_bore / (1.4e9 + 10.0 * settled) + m.hose_compliance
    stall = 2 * ROUNDOFF * settled * capacity / SUBSTEP
    assert end.bore == pytest.approx(settled, abs=stall * m.valve_port_ramp / m.valve_port_flow)
    assert returned == pytest.approx(swept, abs=stall)


# ---- dynamic sections ----

SUPPLIES = rounded(np.array([20.0, 40.0, 80.0, 160.0, 210.0]) * BAR)
PRESSURES = rounded(np.array([[5.0], [35.0], [75.0], [120.0]]) * BAR)
LOADS = record(ArmState, bore=PRESSURES, rod=PRESSURES, compensator=1.0)


@pytest.mark.parametrize("spool", [-1.0, -0.4, 0.4, 1.0])
def test_a_section_comes_to_rest_at_what_an_ideal_compensator_passes(spool):
    """Any supply and load, after 0.2 s: the flow of the ideal one where the compensator is not fully open, and where it is,
    that of edge and open compensator in series, never more than the ideal one's. 1e-5: a hundred time constants of 2 ms
    leave less; what is left is rounding of an opening that balances 7 bar out of 200."""
    args = (OIL, spool, 0.0, SUPPLIES, LOADS, 0, 6000, SUBSTEP)
    end, drawn = launch(section_kernel, ARM, SECTION, *args)
    ideal = launch(section_kernel, ARM, IDEAL, *args)[1]
    regulates = end.compensator < 1.0
    assert np.mean(regulates) > 0.5
    assert np.any(~regulates)
    np.testing.assert_allclose(drawn[regulates], ideal[regulates], rtol=1e-5)
    opening = (abs(spool) - 0.1) / 0.9
    edge, both = opening * float(ARM["valve_cv"]), float(SECTION["cv_compensator"])
    series = orifice(1.0 / np.sqrt(edge**-2 + both**-2), np.maximum(SUPPLIES - PRESSURES, 0.0))
    np.testing.assert_allclose(drawn[~regulates], series[~regulates], rtol=1e-5)
    assert np.all(drawn <= ideal * (1.0 + 1e-5))


def surge(supply, rate, seconds):
    """Contents of both chambers [Pa] and compensator of an opened arm after ``seconds``, as an ODE in float64: it extends at
    ``rate`` [rad/s] from 60 bar with its compensator fully open."""
    m, v, oil = columns(ARM), columns(SECTION), columns(OIL)
    g = launch(geometry_kernel, ARM, 0.0, 1.0)
    edge, open_cv = float(m.valve_cv), float(v.cv_compensator)
    fixed, stroke = m.hose_volume + m.cylinder_dead_volume, m.cylinder_linkage.stroke
    middles = (0.5 * m.cylinder_bore_area * stroke, 0.5 * m.cylinder_annulus_area * stroke)
    volumes = (g.volume_bore, g.volume_rod)

    def rates(_, x):
        bore, rod, y = x
        available = max(supply - bore, 0.0)
        share = y / np.sqrt(y**2 + (edge / open_cv) ** 2)
        hold = np.clip((rod + m.valve_pilot_ratio * bore - m.valve_holding_pressure) / m.valve_holding_ramp, 0.0, 1.0)
        flows = (
            orifice(edge * share, available) - g.displacement_bore * rate,
            -hold * orifice(edge, max(rod, 0.0)) - g.displacement_rod * rate,
        )
        stiff = [
            flow / chamber_compliance(oil, content, volume, m.hose_compliance, fixed + middle)
            for flow, content, volume, middle in zip(flows, (bore, rod), volumes, middles, strict=True)
        ]
        metered = available * share**2
        opens = (v.pressure_drop - metered) / (v.pressure_drop * v.compensator_time_constant)
        return [*stiff, min(opens, 0.0) if y >= 1.0 else opens]

    found = solve_ivp(
        rates, (0.0, seconds), [60.0 * BAR, 5.0 * BAR, 1.0], rtol=1e-8, atol=[1.0, 1.0, 1e-9], method="Radau"
    )
    return found.y[:, -1]


@pytest.mark.parametrize("supply", [90.0 * BAR, 180.0 * BAR])
def test_a_section_surges_as_its_ode_does(supply):
    """The supply is there at once: the open compensator passes too much until it has closed, 2 to 20 ms. Substeps are of
    first order, so a fourth of the step leaves a fourth of the error; at the twin's own it is below 1 % of the supply."""
    rate = -0.12  # [rad/s] extends
    start = record(ArmState, bore=60.0 * BAR, rod=5.0 * BAR, compensator=1.0)
    for seconds in (2e-3, 5e-3, 2e-2):
        expected = surge(supply, rate, seconds)
        errors = []
        for parts in (1, 4):
            steps = round(seconds / SUBSTEP) * parts
            end, _ = launch(section_kernel, ARM, SECTION, OIL, 1.0, rate, supply, start, 1, steps, seconds / steps)
            found = np.array([float(end.bore), float(end.rod), float(end.compensator)])
            errors.append(np.abs(found - expected) / np.array([supply, supply, 1.0]))
        assert np.all(errors[0] < 0.01), seconds
        assert np.all(errors[1] < 0.35 * errors[0] + 2e-5), seconds
