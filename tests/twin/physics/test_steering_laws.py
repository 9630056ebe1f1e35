"""The steering circuit by every option of its laws: oil, symmetry, and where its elements come to rest."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
from scipy.optimize import brentq

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.twin.physics.steering_circuit import SteeringLawState
from aoro_gym.twin.records import LAW_FIELDS
from tests.twin.physics.deviations import within
from tests.twin.physics.elements import BAR, OIL, SUBSTEP, VOID, orifice, relief, uncrossed
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record, rounded
from tests.twin.physics.steering_elements import NO_ARMS, STEERING, state
from tests.twin.physics.test_fluid import mixture_modulus
from tests.twin.physics.test_steering import (
    DT,
    STATES,
    SYMMETRIC,
    VOLUMES,
    advance,
    chambers,
    circuit,
    compliances,
    flow_tolerance,
    random_case,
    run_kernel,
    step_kernel,
)
from tests.twin.physics.test_steering_valve import balance, opening_kernel

M = columns(STEERING)
OF_CIRCUIT = [law for law, path in LAW_FIELDS.items() if path.startswith("steering.")]
CASES = [(law, option) for law in OF_CIRCUIT for option in OPTIONS[law][1:]] + [("gas", "dissolving")]
AERATED = changed(OIL, gas_fraction=0.02, gas_law=OPTIONS["gas"].index("dissolving"))


def law_case(law, option, seed, parameters=None):
    """Random circuits that obey one other law, with states that only laws have, and their oil."""
    count = 1500
    rng = np.random.default_rng(seed)
    number = OPTIONS[law].index(option)
    field = {} if law == "gas" else {LAW_FIELDS[law].removeprefix("steering."): number}
    own = record(
        SteeringLawState,
        spool_rate=rng.normal(0.0, 5.0, count),
        compensator_rate=rng.normal(0.0, 100.0, count),
        pump_valve=rng.normal(0.0, 2.0, count),
        shock_a=rng.uniform(0.0, 1e-3, count),
        shock_b=rng.uniform(0.0, 1e-3, count),
        hose_strain_a=rng.uniform(0.0, 3e-6, count),
        hose_strain_b=rng.uniform(0.0, 3e-6, count),
        hose_a=rng.uniform(-1.5, 240.0, count) * BAR,
        hose_b=rng.uniform(-1.5, 240.0, count) * BAR,
        hose_flow_a=rng.normal(0.0, 5e-4, count),
        hose_flow_b=rng.normal(0.0, 5e-4, count),
    )
    case = random_case(count, seed, parameters={**(parameters or {}), **field}, state={"law": own})
    return case, AERATED if law == "gas" else OIL


def modulus(oil, p):
    """Of oil with air that dissolves, where there is any."""
    if oil.gas_fraction == 0.0:
        return oil.bulk_modulus + oil.bulk_modulus_slope * np.maximum(p, 0.0)
    return mixture_modulus(oil, p)


def held_oil(law, option, m, oil, angle, s, end):
    """Oil [m³] that every volume of the circuit gained, and the rounding of it: by pairs of capacity and pressure."""
    walls = {"stiffening": 1.0, "viscoelastic": 1.0 - m.hose_delayed_share, "two_segments": 0.5}
    walls = m.hose_compliance * np.asarray(walls.get(option, 1.0))
    two = 0.5 * m.hose_volume if option == "two_segments" else 0.0
    nominal = m.hose_volume + 2.0 * m.cylinder_dead_volume - two
    nominal = nominal + 0.5 * (m.cylinder_bore_area + m.cylinder_annulus_area) * m.cylinder_linkage.stroke

    def port(content, volume):
        soft = (
            walls / (1.0 + np.maximum(content, 0.0) / m.hose_stiffening_pressure) if option == "stiffening" else walls
        )
        void = content < oil.void_pressure
        full = (volume - two) / modulus(oil, np.maximum(content, VOID)) + soft
        return np.where(void, nominal / oil.bulk_modulus, full)

    def rigid(content, volume, hose):
        return volume / modulus(oil, np.maximum(content, VOID)) + hose

    volume_a, volume_b = chambers(m, angle)
    pairs = [
        (rigid(s.supply, m.pump_line_volume, m.pump_line_compliance), s.supply, end.supply),
        (port(s.port_a, volume_a), s.port_a, end.port_a),
        (port(s.port_b, volume_b), s.port_b, end.port_b),
        (rigid(s.tank_line, m.tank_line_volume, m.tank_line_compliance), s.tank_line, end.tank_line),
    ]
    if option == "two_segments":
        half = 0.5 * m.hose_volume, 0.5 * m.hose_compliance
        pairs += [
            (rigid(getattr(s.law, h), *half), getattr(s.law, h), getattr(end.law, h)) for h in ("hose_a", "hose_b")
        ]
    if law == "load_sensing_line":
        liquid = oil.bulk_modulus + oil.bulk_modulus_slope * s.ls_pressure
        pairs.append((m.pump_ls_volume / liquid, s.ls_pressure, end.ls_pressure))
    gained = sum(c * (after - before) for c, before, after in pairs)
    rounding = sum(4.0 * ROUNDOFF * c * (np.abs(before) + np.abs(after)) for c, before, after in pairs)
    if option == "viscoelastic":
        gained = gained + (end.law.hose_strain_a - s.law.hose_strain_a) + (end.law.hose_strain_b - s.law.hose_strain_b)
        rounding = rounding + 8.0 * ROUNDOFF * 3e-6
    return gained, rounding


@pytest.mark.parametrize(("law", "option"), CASES)
def test_no_law_makes_or_loses_oil(law, option):
    """What all volumes gained, and what the joint swept, is what crossed the circuit's border: pump, its leak, bleed and
    relief, the filter, the suction check, the arms."""
    case, oil_record = law_case(law, option, 21)
    m, oil, s, arms = columns(case.m), columns(oil_record), columns(case.start), columns(case.arms)
    end = advance(case, oil=oil_record)
    flows, _ = circuit(m, columns(OIL), case.angle, case.speed, case.rate, arms, s)
    gained, rounding = held_oil(law, option, m, oil, case.angle, s, end)
    dt = float(rounded(DT))
    back, bleed = flows.back, flows.bleed
    if option == "orifice":
        nominal = m.tank_line_back_pressure + m.tank_line_back_pressure_ramp
        nominal = nominal + m.tank_line_throttle * m.tank_line_back_flow**2
        back = orifice(m.tank_line_back_flow / np.sqrt(nominal), np.maximum(np.maximum(s.tank_line, VOID), 0.0))
    crossing = flows.pump - flows.pump_leak - bleed - flows.relief - back + flows.tank_suction
    crossing = crossing + arms.tank_flow - arms.supply_flow
    whole = True
    if law == "load_sensing_line":  # where the arms are the load, they give what the line takes
        port = np.where(flows.opening > 0.0, np.where(s.spool > 0.0, s.port_a, s.port_b), 0.0)
        liquid = oil.bulk_modulus + oil.bulk_modulus_slope * s.ls_pressure
        taken = m.pump_ls_volume / liquid * (end.ls_pressure - s.ls_pressure) / dt + bleed
        crossing = crossing + np.where(arms.load_pressure > np.maximum(port, 0.0), taken, 0.0)
        whole = end.ls_pressure > 0.0  # no oil is drawn out of an empty line
        assert np.mean(whole) > 0.9
        assert 0.1 < np.mean(arms.load_pressure > port) < 0.9
    # conductances of reliefs and checks by pressures of 300 bar, as in :func:`flow_tolerance`; two dozen other flows of up
    # to 10 L/s, to and fro
    slack = flow_tolerance(m, flows, 0.0, 0.0, 0.0) + 48.0 * ROUNDOFF * 10e-3 + rounding / dt
    if law == "gas":  # the compliance rounds: three dozen operations and a power
        slack = slack + 64.0 * ROUNDOFF * np.abs(gained) / dt + 64.0 * ROUNDOFF * 60e-3
    for name in VOLUMES:
        whole = whole & uncrossed(getattr(s, name), getattr(end, name))
    assert np.mean(whole) > 0.4
    off, slack = np.broadcast_arrays(gained / dt + flows.swept_a + flows.swept_b - crossing, slack)
    whole = np.broadcast_to(whole, off.shape)
    within(
        off[whole],
        slack[whole],
        law="every law of the circuit",
        oracle="balance of all oil [m³/s]",
        source="rounding of flows of up to 10 L/s, of relief conductances at 300 bar, of contents over dt",
    )


MIRRORED = {
    a + "_" + b: a + "_" + c for a in ("port", "shock", "hose_strain", "hose", "hose_flow") for b, c in ("ab", "ba")
}
RISING = {  # what a state's change within a step is made of, where it is not the state itself
    **dict.fromkeys((*VOLUMES, "hose_a", "hose_b"), 1e7),
    **dict.fromkeys(("shock_a", "shock_b"), 0.05),
    **dict.fromkeys(("hose_flow_a", "hose_flow_b"), 1e-3),
    **dict.fromkeys(("hose_strain_a", "hose_strain_b"), 1e-6),
}


@pytest.mark.parametrize(("law", "option"), CASES)
def test_left_and_right_are_mirrored_by_every_law(law, option):
    case, oil = law_case(law, option, 22, parameters=SYMMETRIC)
    for name in STEERING.dtype.names:
        if "left" in name:
            case.m[name] = case.m[name.replace("left", "right")]
    end = advance(case, oil=oil)
    s = case.start
    start = changed(s, port_a=s["port_b"], port_b=s["port_a"], spool=-s["spool"])
    for name in SteeringLawState.vars:
        start["law"][name] = s["law"][MIRRORED.get(name, name)]
    start["law"]["spool_rate"] *= -1.0
    other = launch(step_kernel, case.m, oil, -case.angle, -case.demand, case.speed, -case.rate, case.arms, start, DT)
    for part, mirror, names in ((end, other, STATES), (end.law, other.law, SteeringLawState.vars)):
        for name in names:
            value = getattr(mirror, MIRRORED.get(name, name)) * (-1.0 if name in ("spool", "spool_rate") else 1.0)
            scale = np.abs(getattr(part, name)) + RISING.get(name, 0.0) + 1e-9
            # sums of the same terms in another order
            assert np.all(np.abs(getattr(part, name) - value) <= 64 * ROUNDOFF * scale), name


def test_lagged_shock_valves_are_what_leaves_the_ports():
    case, _ = law_case("shock_valve", "lag", 23)
    m, oil, s, arms = columns(case.m), columns(OIL), columns(case.start), columns(case.arms)
    end = advance(case)
    flows, net = circuit(m, oil, case.angle, case.speed, case.rate, arms, s)
    capacity = compliances(m, oil, case.angle, s)
    for side in "ab":
        name = f"port_{side}"
        before, after, c = getattr(s, name), getattr(end, name), getattr(capacity, name)
        expected = getattr(net, name) + getattr(flows, f"shock_{side}") - getattr(s.law, f"shock_{side}")
        slack = flow_tolerance(m, flows, c, before, after)
        same = uncrossed(before, after)
        assert np.all((np.abs(c * (after - before) / float(rounded(DT)) - expected) <= slack)[same])
        follow = DT / (m.valve_shock_time_constant + DT)
        lagged = getattr(s.law, f"shock_{side}")
        expected = lagged + follow * (getattr(flows, f"shock_{side}") - lagged)
        # a difference of pressures of 260 bar over the ramp
        rounding = 8 * ROUNDOFF * 300.0 * BAR * m.valve_shock_flow / m.valve_shock_ramp
        assert np.all(np.abs(getattr(end.law, f"shock_{side}") - expected) <= rounding)


def test_smooth_edges_are_what_the_circuit_meters():
    """Both smooth laws at once: flows into the loaded port and out of the other one."""
    case, _ = law_case("orifice", "smooth", 24)
    case.m["opening_law"] = OPTIONS["opening"].index("smooth")
    m, s = columns(case.m), columns(case.start)
    end = advance(case)
    left = s.spool > 0.0
    curves = [
        np.where(left, getattr(m, f"valve_{name}_left{at}"), getattr(m, f"valve_{name}_right{at}"))
        for name, at in (("dead_band", ""), ("opening", "_1V0"), ("opening", "_1V5"))
    ]
    opening = np.array(
        [
            launch(opening_kernel, np.float32(x), float(over), *(float(one) for one in curve))
            for x, over, *curve in zip(s.spool, m.valve_overlap, *curves, strict=True)
        ]
    )
    p_s, p_a, p_b, p_t = (np.maximum(getattr(s, name), VOID) for name in VOLUMES)
    load, free = np.where(left, p_a, p_b), np.where(left, p_b, p_a)
    edge_in = opening * np.where(left, m.valve_cv_in_left, m.valve_cv_in_right)
    edge_out = opening * np.where(left, m.valve_cv_out_left, m.valve_cv_out_right)
    first = s.compensator * m.valve_cv_compensator
    both = np.divide(first * edge_in, np.hypot(first, edge_in), out=np.zeros_like(first), where=edge_in > 0.0)
    for flow, coefficient, drop in (
        (end.flow_in, both, np.maximum(p_s - load, 0.0)),
        (end.flow_out, edge_out, free - p_t),
    ):
        expected = coefficient * drop / (drop**2 + BAR**2) ** 0.25
        np.testing.assert_allclose(flow, expected, rtol=48 * ROUNDOFF, atol=4 * ROUNDOFF * 10e-3)


def test_spool_and_swash_of_the_circuit_are_of_second_order():
    case, _ = law_case("spool", "second_order", 25)
    case.m["pump_law"] = OPTIONS["pump"].index("second_order")
    m, s = columns(case.m), columns(case.start)
    end = advance(case)
    omega = m.valve_spool_frequency
    rate = (s.law.spool_rate + DT * omega**2 * (case.demand - s.spool)) / (
        1.0 + 2.0 * m.valve_spool_damping * omega * DT
    )
    rate = np.clip(rate, -m.valve_spool_rate_limit, m.valve_spool_rate_limit)
    np.testing.assert_allclose(end.law.spool_rate, rate, atol=16 * ROUNDOFF * 20.0)
    np.testing.assert_allclose(end.spool, s.spool + DT * rate, atol=4 * ROUNDOFF)
    supply = np.maximum(s.supply, VOID)
    error = np.minimum(s.ls_pressure + m.pump_margin, m.pump_cutoff) - supply
    ahead = s.law.pump_valve + m.pump_valve_lead_time / m.pump_valve_time_constant * (
        error / m.pump_control_band - s.law.pump_valve
    )
    moved = np.clip(ahead, -m.pump_stroke_up_time / m.pump_stroke_down_time, 1.0)
    expected = np.clip(s.swash + DT * moved / m.pump_stroke_up_time, 0.0, 1.0)
    # errors of pressures of 300 bar over a band of 7 and more, led tenfold, in a step of 2e-3 of a stroke
    np.testing.assert_allclose(end.swash, expected, atol=(8 * 300.0 / 7.0 * 10.0 * 2e-3 + 4) * ROUNDOFF)
    follow = DT / (m.pump_valve_time_constant + DT)
    valve = s.law.pump_valve + follow * (error / m.pump_control_band - s.law.pump_valve)
    np.testing.assert_allclose(end.law.pump_valve, valve, atol=8 * 300.0 / 7.0 * ROUNDOFF)


def edge_ratio(spool):
    """Meter-in edge over open compensator in a left turn."""
    curve = [M.valve_dead_band_left, 1.0, 1.5, 2.0], [0.0, M.valve_opening_left_1V0, M.valve_opening_left_1V5, 1.0]
    return np.interp(2.0 * float(rounded(spool)), *curve) * M.valve_cv_in_left / M.valve_cv_compensator


def holding(**laws):
    return changed(STEERING, **{f"{law}_law": OPTIONS[law].index(option) for law, option in laws.items()})


@pytest.mark.parametrize("demand", [0.6, -0.8])
def test_spool_rests_where_the_flow_force_holds_it(demand):
    """x = u − share A(x) Δp/p_ref at held pressures, with the edge's drop behind an open compensator."""
    side, port = ("left", "port_a") if demand > 0.0 else ("right", "port_b")
    m = holding(flow_force="steady", compensator="static")
    start = state(**{port: 10.0 * BAR}, supply=13.0 * BAR, ls_pressure=10.0 * BAR, spool=demand)
    curve = [
        getattr(M, f"valve_{name}_{side}{volts}")
        for name, volts in (("dead_band", ""), ("opening", "_1V0"), ("opening", "_1V5"))
    ]

    def left_over(x):
        opening = np.interp(2.0 * x, [curve[0], 1.0, 1.5, 2.0], [0.0, *curve[1:], 1.0])
        ratio = opening * getattr(M, f"valve_cv_in_{side}") / M.valve_cv_compensator
        drop = 3.0 * BAR / (1.0 + ratio**2)  # 3 bar are less than the setting: it is open
        return abs(demand) - M.valve_flow_force_share * opening * drop / M.valve_compensator_pressure - x

    rest = brentq(left_over, 0.0, 1.0, xtol=1e-12)
    end = launch(run_kernel, m, OIL, demand, NO_ARMS, start, SUBSTEP, 20000, 1, 1)
    # stalled where dt/τ of what is missing is below half an ulp
    stall = 2.0 * ROUNDOFF * M.valve_spool_time_constant / SUBSTEP
    assert abs(demand) - rest > 1e-3
    within(
        np.sign(demand) * end.spool - rest,
        stall,
        law="flow_force: steady",
        oracle="rest at held pressures by Brent [-]",
        source="dt/τ of what is missing below half a last place",
    )


@pytest.mark.parametrize("law", OPTIONS["compensator"])
def test_compensator_that_feels_a_settled_line_balances_as_at_the_port(law):
    start = state(supply=40.0 * BAR, port_a=20.0 * BAR, ls_pressure=20.0 * BAR, spool=0.8, compensator=0.5)
    at_port, at_line = (
        launch(
            run_kernel,
            holding(compensator=law, compensator_sensing=where),
            OIL,
            0.8,
            NO_ARMS,
            start,
            SUBSTEP,
            20000,
            1,
            1,
        )
        for where in OPTIONS["compensator_sensing"]
    )
    s, ratio = columns(start), edge_ratio(0.8)
    rest = balance(s.supply - s.port_a, ratio)
    # the drop behind an edge of 70 L/min is turbulent, so the balance is the circuit's
    assert at_port.compensator == pytest.approx(rest, abs=(16 * 1.15 / 0.3 + 4 / 0.01) * ROUNDOFF)
    assert 0.2 < rest < 0.9
    # both stall at their balance: as in the tests of the valve
    within(
        at_line.compensator - at_port.compensator,
        (16 * 1.15 / 0.3 + 4 / 0.01) * ROUNDOFF,
        law="compensator_sensing: load_sensing_line",
        oracle="that at the port, line settled [-]",
        source="rounding over κ, and of slow steps",
    )
    behind = changed(start, ls_pressure=15.0 * BAR)
    one = [
        launch(
            run_kernel, holding(compensator=law, compensator_sensing=where), OIL, 0.8, NO_ARMS, behind, SUBSTEP, 1, 1, 1
        )
        for where in OPTIONS["compensator_sensing"]
    ]
    assert one[1].compensator < one[0].compensator  # feels less load than there is: closes


def test_shock_valve_opens_and_shuts_with_its_lag():
    """q = q∞ (1 − e^(−t/τ)) at held pressures; the steps leave dt t/(2 τ²) of what is on its way."""
    m = holding(shock_valve="lag")
    start = state(port_a=220.0 * BAR, tank_line=0.0, supply=20.0 * BAR)
    through = relief(220.0 * BAR, M.valve_shock_pressure, M.valve_shock_ramp, M.valve_shock_flow)
    tau, steps = M.valve_shock_time_constant, 240
    t = steps * SUBSTEP
    end = launch(run_kernel, m, OIL, 0.0, NO_ARMS, start, SUBSTEP, steps, 1, 1)
    left = np.exp(-t / tau) * through
    error = SUBSTEP * t / (2.0 * tau**2) * left
    # the pressure beyond the setting of 210 bar rounds; and every step
    rounding = (4 * 22.0 + 2 * steps) * ROUNDOFF * through
    within(
        end.law.shock_a - (through - left - error),
        0.05 * error + rounding,
        law="shock_valve: lag",
        oracle="exponential [m³/s]",
        source="the next order of the step; rounding of 220 bar beside the setting",
    )
    assert end.law.shock_b == 0.0
    start["port_a"] = 100.0 * BAR
    start["law"]["shock_a"] = through
    shut = launch(run_kernel, m, OIL, 0.0, NO_ARMS, start, SUBSTEP, steps, 1, 1)
    assert shut.law.shock_a == pytest.approx(left + error, abs=0.05 * error + rounding)


@pytest.mark.parametrize("throttle", [0.0, 5.0])
def test_return_orifice_drops_as_much_as_the_check_at_its_nominal_flow_and_nothing_at_rest(throttle):
    flow = M.tank_line_back_flow
    arms = changed(NO_ARMS, tank_flow=flow)
    rest = {}
    for option in OPTIONS["return_line"]:
        m = changed(holding(return_line=option), tank_line_throttle=throttle * BAR / flow**2, valve_leakage=0.0)
        through = launch(run_kernel, m, OIL, 0.0, arms, state(), SUBSTEP, 30000, 1, 0)
        # stalled where a step's flow is below half an ulp of the line's content: G/C of 500 /s, 2 % of it a step
        nominal = (4.4 + throttle) * BAR
        within(
            through.tank_line - nominal,
            8 * ROUNDOFF / 0.01 * nominal,
            law=f"return_line: {option}",
            oracle="drop at nominal flow [Pa]",
            source="a step's flow below half a last place of the content",
        )
        rest[option] = launch(
            run_kernel, m, OIL, 0.0, NO_ARMS, state(tank_line=4.0 * BAR), SUBSTEP, 60000, 1, 0
        ).tank_line
    assert rest["check"] == pytest.approx(3.4 * BAR, abs=0.05 * BAR)
    assert abs(rest["orifice"]) < 0.001 * BAR
