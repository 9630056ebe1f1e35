"""The hydrostatic driveline: balances of oil, symmetry, differential, gears and the pump's torque."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from aoro_gym.twin.physics.driveline import (
    Driveline,
    DrivelineControl,
    DrivelineState,
    driveline_displace,
    driveline_gas,
    driveline_step,
    motor_hose_step,
    pump_torque,
)
from aoro_gym.twin.physics.fluid import Oil, free_gas
from tests.twin.physics.elements import (
    BAR,
    LITRE_A_MINUTE,
    OIL,
    SUBSTEP,
    VOID,
    check_valve,
    compliance,
    cv,
    orifice,
    relief,
    uncrossed,
)
from tests.twin.physics.launch import ROUNDOFF, changed, columns, launch, record, rounded

WHEELS = ("fl", "fr", "rl", "rr")
HOSES = tuple(f"wheel_{wheel}" for wheel in WHEELS)
VOLUMES = ("forward", "back", *HOSES, "charge")
MOTOR = 2.812e-3 / (2 * np.pi)  # [m³/rad]
SPEED = 167.0  # [rad/s] engine

DRIVELINE = record(
    Driveline,
    main_volume=3.9e-3,
    main_compliance=3.9e-3 / 1.64e9,
    wheel_hose_volume=0.7e-3,
    wheel_hose_compliance=0.7e-3 / 1.64e9,
    pump_displacement=130e-6 / (2 * np.pi),
    pump_time_constant=0.06,
    pump_stroke_time=0.8,
    pump_leakage=6e-12,
    pump_cross_leakage=4e-12,
    pump_mechanical_efficiency=0.93,
    charge_displacement=34e-6 / (2 * np.pi),
    charge_relief_pressure=24.0 * BAR,
    charge_relief_ramp=2.0 * BAR,
    charge_relief_flow=60.0 * LITRE_A_MINUTE,
    charge_volume=0.5e-3,
    charge_compliance=0.5e-3 / 1.64e9,
    charge_cv_check=cv(100.0, 2.0),
    charge_check_crack=0.3 * BAR,
    charge_mechanical_efficiency=0.9,
    flush_shift_pressure=3.0 * BAR,
    flush_pressure=20.0 * BAR,
    flush_ramp=4.0 * BAR,
    flush_flow=15.0 * LITRE_A_MINUTE,
    relief_pressure=400.0 * BAR,
    relief_ramp=20.0 * BAR,
    relief_flow=200.0 * LITRE_A_MINUTE,
    traction_cv=cv(100.0, 5.0),
    traction_time_constant=0.1,
    motor_displacement=MOTOR,
    motor_leakage=3e-12,
    motor_mechanical_efficiency=0.92,
    motor_shift_time=0.3,
    brake_disc_torque=367.0,
    brake_parking_torque=12000.0,
    brake_presliding_stiffness=1e6,
    brake_presliding_damping=2e3,
)


@wp.kernel(enable_backward=False)
def hose_kernel(
    m: wp.array(dtype=Driveline),
    oil: wp.array(dtype=Oil),
    opening: wp.array(dtype=float),
    displacement: wp.array(dtype=float),
    rate: wp.array(dtype=float),
    main: wp.array(dtype=float),
    back: wp.array(dtype=float),
    content: wp.array(dtype=float),
    dt: wp.array(dtype=float),
    filled: wp.array(dtype=float),
    taken: wp.array(dtype=float),
    given: wp.array(dtype=float),
):
    i = wp.tid()
    gas = free_gas(oil[i], content[i])
    new, from_main, to_back = motor_hose_step(
        m[i], oil[i], gas, opening[i], displacement[i], rate[i], main[i], back[i], content[i], dt[i]
    )
    filled[i] = new
    taken[i] = from_main
    given[i] = to_back


@wp.kernel(enable_backward=False)
def run_kernel(
    m: wp.array(dtype=Driveline),
    oil: wp.array(dtype=Oil),
    control: wp.array(dtype=DrivelineControl),
    rates: wp.array(dtype=wp.vec4),
    start: wp.array(dtype=DrivelineState),
    dt: wp.array(dtype=float),
    steps: int,
    end: wp.array(dtype=DrivelineState),
):
    i = wp.tid()
    s = start[i]
    gas = driveline_gas(oil[i], s)
    for _ in range(steps):
        s = driveline_step(m[i], oil[i], gas, control[i], rates[i], s, dt[i])
    end[i] = s


@wp.kernel(enable_backward=False)
def roll_kernel(
    m: wp.array(dtype=Driveline),
    oil: wp.array(dtype=Oil),
    control: wp.array(dtype=DrivelineControl),
    angles: wp.array(dtype=wp.vec4),
    start: wp.array(dtype=DrivelineState),
    end: wp.array(dtype=DrivelineState),
):
    i = wp.tid()
    end[i] = driveline_displace(m[i], oil[i], control[i], angles[i], start[i])


@wp.kernel(enable_backward=False)
def torque_kernel(
    displacement: wp.array(dtype=float),
    drop: wp.array(dtype=float),
    efficiency: wp.array(dtype=float),
    torque: wp.array(dtype=float),
):
    i = wp.tid()
    torque[i] = pump_torque(displacement[i], drop[i], efficiency[i])


def control(swash=0.0, front=MOTOR, rear=MOTOR, traction=(1.0, 1.0, 1.0, 1.0), speed=SPEED):
    return record(
        DrivelineControl,
        swash=swash,
        displacement_front=front,
        displacement_rear=rear,
        traction=np.asarray(traction),
        engine_speed=speed,
    )


def level(pressure=24.0 * BAR, **values):
    return record(DrivelineState, **{**dict.fromkeys(VOLUMES, pressure), **values})


def circuit(m, c, rates, s):
    """All flows [m³/s] by their definition, and the net flow into the seven volumes."""
    p = SimpleNamespace(**{name: np.maximum(getattr(s, name), VOID) for name in VOLUMES})
    f = SimpleNamespace()
    f.case_f, f.case_r = m.pump_leakage * p.forward, m.pump_leakage * p.back
    f.relief_f = relief(p.forward - p.back, m.relief_pressure, m.relief_ramp, m.relief_flow)
    f.relief_r = relief(p.back - p.forward, m.relief_pressure, m.relief_ramp, m.relief_flow)
    f.charge = m.charge_displacement * c.engine_speed
    f.charge_relief = relief(p.charge, m.charge_relief_pressure, m.charge_relief_ramp, m.charge_relief_flow)
    f.check_f = check_valve(m.charge_cv_check, p.charge - p.forward, m.charge_check_crack)
    f.check_r = check_valve(m.charge_cv_check, p.charge - p.back, m.charge_check_crack)
    shift = np.clip((np.abs(p.forward - p.back) - m.flush_shift_pressure) / m.flush_shift_pressure, 0.0, 1.0)
    flushed = shift * relief(np.minimum(p.forward, p.back), m.flush_pressure, m.flush_ramp, m.flush_flow)
    f.flush_f, f.flush_r = np.where(p.forward < p.back, flushed, 0.0), np.where(p.forward < p.back, 0.0, flushed)
    for k, wheel in enumerate(WHEELS):
        displacement = c.displacement_front if k < 2 else c.displacement_rear
        hose = getattr(p, f"wheel_{wheel}")
        taken = orifice(c.traction[..., k] * m.traction_cv, p.forward - hose)
        given = displacement * rates[..., k] + m.motor_leakage * (hose - p.back)
        # there is no oil in a void: a motor passes on what its valve lets in
        given = np.where(getattr(s, f"wheel_{wheel}") < VOID, np.minimum(given, taken), given)
        given = np.where(s.back <= VOID, np.maximum(given, 0.0), given)
        setattr(f, f"taken_{wheel}", taken)
        setattr(f, f"given_{wheel}", given)
    taken = sum(getattr(f, f"taken_{wheel}") for wheel in WHEELS)
    given = sum(getattr(f, f"given_{wheel}") for wheel in WHEELS)
    forward = -f.case_f - f.relief_f + f.relief_r + f.check_f - f.flush_f - taken
    back = -f.case_r + f.relief_f - f.relief_r + f.check_r - f.flush_r + given
    # from R to F, less what leaks back inside the pump; out of a void no more than what comes in
    pump = c.swash * m.pump_displacement * c.engine_speed - m.pump_cross_leakage * (p.forward - p.back)
    pump = np.where(s.back < VOID, np.minimum(pump, np.maximum(back, 0.0)), pump)
    f.pump = np.where(s.forward < VOID, np.maximum(pump, -np.maximum(forward, 0.0)), pump)
    net = SimpleNamespace(
        forward=forward + f.pump,
        back=back - f.pump,
        charge=f.charge - f.charge_relief - f.check_f - f.check_r,
        **{f"wheel_{w}": getattr(f, f"taken_{w}") - getattr(f, f"given_{w}") for w in WHEELS},
    )
    return f, net


def compliances(m, s):
    oil = columns(OIL)

    def one(name, volume, hose):
        return compliance(oil, getattr(s, name), volume, hose)

    return SimpleNamespace(
        forward=one("forward", m.main_volume, m.main_compliance),
        back=one("back", m.main_volume, m.main_compliance),
        charge=one("charge", m.charge_volume, m.charge_compliance),
        **{name: one(name, m.wheel_hose_volume, m.wheel_hose_compliance) for name in HOSES},
    )


# ---- single steps ----


@pytest.fixture(scope="module")
def case():
    """Random parameters (±30 %), controls, wheel rates and states (voids included), and one large step of all."""
    rng = np.random.default_rng(1)
    count = 4000
    record_ = changed(
        DRIVELINE, **{n: float(DRIVELINE[n]) * rng.uniform(0.7, 1.3, count) for n in DRIVELINE.dtype.names}
    )

    def contents(high):
        return np.where(rng.random(count) < 0.1, rng.uniform(-30.0, -0.95, count), rng.uniform(0, high, count)) * BAR

    c = control(
        swash=rng.uniform(-1.0, 1.0, count),
        front=MOTOR * rng.uniform(0.5, 1.0, count),
        rear=MOTOR * rng.uniform(0.5, 1.0, count),
        traction=rng.choice([0.0, 1.0, 0.3, 0.8], (count, 4)),
        speed=rng.uniform(80.0, 200.0, count),
    )
    start = record(DrivelineState, **{name: contents(40.0 if name == "charge" else 450.0) for name in VOLUMES})
    near = rng.random(count) < 0.3  # both mains low, where checks and flushing work
    for name in VOLUMES[:6]:
        start[name] = np.where(near, start[name] / 12.0, start[name])
    rates = rounded(rng.normal(0.0, 3.0, (count, 4)))
    out = SimpleNamespace(record=record_, control=c, rates=rates, start=start, dt=2e-4)
    out.end = launch(run_kernel, record_, OIL, c, rates, start, out.dt, 1)
    out.m, out.c, out.s = columns(record_), columns(c), columns(start)
    out.flows, out.net = circuit(out.m, out.c, rates, out.s)
    out.compliance = compliances(out.m, out.s)
    out.slack = rounding(out)
    return out


def rounding(case):
    """Rounding of a net flow: every element by its own flow, opened drops by the pressures of whose difference they
    are (conductance × pressure × 2⁻²⁴), the content by half an ulp over the step."""
    m = case.m
    magnitude = sum(np.abs(x) for x in vars(case.flows).values())
    largest = 450.0 * BAR
    conductance = (m.relief_flow / m.relief_ramp + m.flush_flow / m.flush_ramp) * largest
    conductance += (m.charge_relief_flow / m.charge_relief_ramp + 2 * m.charge_cv_check / np.sqrt(BAR)) * 40.0 * BAR
    conductance += (largest / m.flush_shift_pressure) * m.flush_flow * 10.0
    return SimpleNamespace(
        **{
            name: ROUNDOFF
            * (
                16.0 * magnitude
                + 4.0 * conductance
                + 4.0
                * getattr(case.compliance, name)
                * (abs(getattr(case.s, name)) + abs(getattr(case.end, name)))
                / case.dt
            )
            for name in VOLUMES
        }
    )


def gained(case, name):
    """Oil that a volume took up [m³/s]."""
    dt = float(rounded(case.dt))
    return getattr(case.compliance, name) * (getattr(case.end, name) - getattr(case.s, name)) / dt


def test_every_volume_gains_what_flows_into_it(case):
    for name in VOLUMES:
        off = np.abs(gained(case, name) - getattr(case.net, name)) > getattr(case.slack, name)
        same = uncrossed(getattr(case.s, name), getattr(case.end, name))
        assert np.mean(same) > 0.7
        assert not np.any(off & same), name
    assert np.median(case.slack.wheel_fl) < 2e-6
    for name, flow in vars(case.flows).items():
        assert np.mean(flow != 0.0) > 0.01, f"{name} hardly occurs"


def test_loop_neither_makes_nor_loses_oil(case):
    """Σ C Δp = charge pump − leakages to the case − flushing − charge relief; motors and pump only pass oil on."""
    f = case.flows
    crossing = f.charge - f.charge_relief - f.case_f - f.case_r - f.flush_f - f.flush_r
    total = sum(gained(case, name) for name in VOLUMES)
    same = np.logical_and.reduce([uncrossed(getattr(case.s, name), getattr(case.end, name)) for name in VOLUMES])
    assert np.mean(same) > 0.2
    assert np.all((np.abs(total - crossing) <= sum(vars(case.slack).values()))[same])


def test_loop_without_pumps_and_motion_only_loses_power(case):
    """Above tank pressure: Σ p C Δp/Δt ≤ 0 with pump, charge pump and motors at rest."""
    start = changed(case.start, **{name: np.maximum(case.start[name], 0.0) for name in VOLUMES})
    c = changed(case.control, swash=0.0, engine_speed=0.0)
    s = columns(start)
    still = SimpleNamespace(m=case.m, s=s, dt=case.dt, compliance=compliances(case.m, s))
    still.end = launch(run_kernel, case.record, OIL, c, np.zeros(4), start, case.dt, 1)
    still.flows, _ = circuit(case.m, columns(c), np.zeros((4000, 4)), s)
    slack = rounding(still)
    power = sum(getattr(s, name) * gained(still, name) for name in VOLUMES)
    same = np.logical_and.reduce([uncrossed(getattr(s, name), getattr(still.end, name)) for name in VOLUMES])
    assert np.mean(same) > 0.2
    assert np.all((power <= sum(getattr(s, name) * getattr(slack, name) for name in VOLUMES))[same])
    assert np.median(power) < -1e3


def test_forward_and_back_are_mirrored(case):
    """With the wheels shut off both mains are alike: swap them and turn the swash about."""
    m = changed(case.record, motor_leakage=0.0)
    c = changed(case.control, displacement_front=0.0, displacement_rear=0.0, traction=np.zeros(4))
    ahead = launch(run_kernel, m, OIL, c, np.zeros(4), case.start, case.dt, 1)
    swapped = changed(case.start, forward=case.start["back"], back=case.start["forward"])
    astern = launch(run_kernel, m, OIL, changed(c, swash=-c["swash"]), np.zeros(4), swapped, case.dt, 1)
    for name, other in (("forward", "back"), ("back", "forward"), ("charge", "charge")):
        slack = 2 * getattr(case.slack, name) * case.dt / getattr(case.compliance, name)
        difference = np.abs(getattr(ahead, name) - getattr(astern, other))
        assert np.all(difference <= slack + 4 * ROUNDOFF * np.abs(getattr(ahead, name))), name


def test_turned_wheels_pass_their_hoses_oil_to_the_return_main(case):
    """Pump and valves shut: every hose loses D_i Δψ_i, the return main gains their sum, nothing else moves."""
    angles = rounded(np.random.default_rng(3).normal(0.0, 1e-3, (4000, 4)))
    end = launch(roll_kernel, case.record, OIL, case.control, angles, case.start)
    turned = np.stack(
        [(case.c.displacement_front if k < 2 else case.c.displacement_rear) * angles[:, k] for k in range(4)], axis=-1
    )
    gains = {**{name: -turned[:, k] for k, name in enumerate(HOSES)}, "back": turned.sum(axis=-1)}
    size = np.abs(turned).sum(axis=-1)
    for name, gain in gains.items():
        x, y, c = getattr(case.s, name), getattr(end, name), getattr(case.compliance, name)
        same = uncrossed(x, y)
        assert np.mean(same) > 0.8
        slack = 16 * ROUNDOFF * size + 2 * ROUNDOFF * c * (np.abs(x) + np.abs(y))
        assert np.all((np.abs(c * (y - x) - gain) <= slack)[same]), name
    for name in ("forward", "charge"):
        np.testing.assert_array_equal(getattr(end, name), getattr(case.s, name))


@pytest.mark.parametrize(
    ("void", "swash", "rate"),
    [("wheel_fl", 0.0, 1.0), ("back", 1.0, 0.0), ("forward", -1.0, 0.0), ("back", 0.0, -1.0)],
    ids=["motor ahead", "pump ahead", "pump astern", "motor astern"],
)
def test_nothing_is_drawn_out_of_a_void(void, swash, rate):
    """Whatever moves oil finds none in a void that nothing flows into: the void does not grow."""
    shut = level(VOID, **{void: -5.0 * BAR})
    c = control(swash=swash, traction=np.zeros(4))
    end = launch(run_kernel, changed(DRIVELINE, motor_leakage=0.0), OIL, c, np.full(4, rate), shut, SUBSTEP, 1)
    # what seeps in from the pump's case is welcome; an ulp of 5 bar is 0.03 Pa
    assert getattr(end, void) >= -5.0 * BAR - 0.1


# ---- motors ----


def test_closed_traction_valve_shuts_a_motor_off():
    filled, taken, given = launch(
        hose_kernel, changed(DRIVELINE, motor_leakage=0.0), OIL, 0.0, MOTOR, 0.0, 300 * BAR, 20 * BAR, 50 * BAR, SUBSTEP
    )
    assert taken == given == 0.0
    assert filled == 50 * BAR
    # turned from outside it pumps its own hose empty, then full
    pumped = launch(hose_kernel, DRIVELINE, OIL, 0.0, MOTOR, [1.0, -1.0], 300 * BAR, 20 * BAR, 50 * BAR, SUBSTEP)[0]
    assert pumped[0] < 50 * BAR < pumped[1]


def test_half_the_displacement_takes_the_same_oil_at_twice_the_rate():
    rate = rounded(np.linspace(-5.0, 5.0, 101))
    full = launch(hose_kernel, DRIVELINE, OIL, 1.0, MOTOR, rate, 200 * BAR, 20 * BAR, 190 * BAR, SUBSTEP)
    half = launch(hose_kernel, DRIVELINE, OIL, 1.0, MOTOR / 2, 2 * rate, 200 * BAR, 20 * BAR, 190 * BAR, SUBSTEP)
    for a, b in zip(full, half, strict=True):
        np.testing.assert_array_equal(a, b)


def test_shifting_keeps_the_power():
    """At any displacement the oil's power over the motor is shaft power D Δp ω and leakage loss c Δp²."""
    displacement = rounded(MOTOR * np.linspace(0.5, 1.0, 11))
    rate, leak = 3.0, float(columns(DRIVELINE).motor_leakage)
    hose, back = float(rounded(190 * BAR)), float(rounded(20 * BAR))
    given = launch(hose_kernel, DRIVELINE, OIL, 1.0, displacement, rate, 200 * BAR, back, hose, SUBSTEP)[2]
    drop = hose - back
    np.testing.assert_allclose(given * drop, displacement * drop * rate + leak * drop**2, rtol=8 * ROUNDOFF)


# ---- at rest and under way ----


def test_idle_loop_rests_on_charge_pressure():
    """F and R alike; each check passes what leaks to the case, laminar: Δp = crack + c p/C · √1 bar."""
    m = columns(DRIVELINE)
    end = launch(run_kernel, DRIVELINE, OIL, control(), np.zeros(4), level(), SUBSTEP, 150_000)
    leak = m.pump_leakage * end.forward
    over = end.charge - end.forward - m.charge_check_crack
    # a main rests once dt Q/C is less than half its ulp
    stall = 2 * ROUNDOFF * compliances(m, end).forward * end.forward / SUBSTEP
    assert over == pytest.approx(leak / m.charge_cv_check * np.sqrt(BAR), rel=stall / leak)
    assert end.back == pytest.approx(end.forward, abs=2 * stall / m.charge_cv_check * np.sqrt(BAR))
    surplus = m.charge_displacement * SPEED - 2 * leak
    setting = m.charge_relief_pressure + m.charge_relief_ramp * surplus / m.charge_relief_flow
    # either check may pass a main's stall more or less
    slack = 4 * stall * m.charge_relief_ramp / m.charge_relief_flow
    assert end.charge == pytest.approx(setting, abs=slack)
    # hoses level out over the open valve and their motors: an ulp or two
    for name in HOSES:
        assert getattr(end, name) == pytest.approx(end.forward, abs=4 * ROUNDOFF * end.forward)


@pytest.mark.parametrize("swash", [0.5, -0.5])
@pytest.mark.parametrize("front", [1.0, 0.5])
def test_loop_under_way_settles_where_all_flows_balance(swash, front):
    """Wheels held to rates that take a tenth less than the pump gives: leakage takes the rest."""
    m = columns(DRIVELINE)
    c = control(swash=swash, front=MOTOR * front)
    pumped = swash * m.pump_displacement * SPEED
    share = np.array([0.3, 0.2, 0.35, 0.15])
    displacement = MOTOR * np.array([front, front, 1.0, 1.0])
    rates = rounded(0.9 * pumped * share / displacement)
    end = launch(run_kernel, DRIVELINE, OIL, c, rates, level(), SUBSTEP, 300_000)
    flows, net = circuit(m, columns(c), rates, end)
    # an integrated content rests once dt Q/C is less than half its ulp; single flows round to 2⁻²⁴ of 1 L/s
    capacity = compliances(m, end)
    for name in VOLUMES:
        slack = 4 * ROUNDOFF * (getattr(capacity, name) * getattr(end, name) / SUBSTEP + 3 * abs(pumped))
        assert abs(getattr(net, name)) <= slack, name
    high, low = (end.forward, end.back) if swash > 0 else (end.back, end.forward)
    # the surplus of a tenth leaks from the high side: to the case, across the pump, and through the motors, whose drop
    # is smaller by that of their valves
    conductance = m.pump_leakage + m.pump_cross_leakage + 4 * m.motor_leakage
    expected = (0.1 * abs(pumped) - m.pump_leakage * low) / conductance
    valves = (0.35 * pumped / m.traction_cv) ** 2
    assert 20 * BAR < expected < 100 * BAR
    assert abs(high - low - expected) <= 4 * m.motor_leakage / conductance * valves
    # the low side is fed and flushed
    assert m.flush_pressure < low < end.charge - m.charge_check_crack
    assert (flows.flush_r if swash > 0 else flows.flush_f) > 0.0
    # an open differential: whatever their rates, the motors bear the main's pressure less their valve's drop
    for k, name in enumerate(HOSES):
        through = getattr(flows, f"given_{WHEELS[k]}")
        drop = float(end.forward - getattr(end, name))
        assert orifice(m.traction_cv, drop) == pytest.approx(through, rel=1e-3)
        assert np.sign(drop) == np.sign(swash)


def test_wheels_share_the_pumps_oil_by_what_they_roll():
    """Two splits of the same sum of rates end in the same mains: an open differential neither drives nor brakes one."""
    m = columns(DRIVELINE)
    total = 0.98 * 0.3 * m.pump_displacement * SPEED / MOTOR
    straight, turning = np.array([0.25, 0.25, 0.25, 0.25]), np.array([0.35, 0.15, 0.3, 0.2])
    ends = [
        launch(run_kernel, DRIVELINE, OIL, control(swash=0.3), rounded(total * share), level(), SUBSTEP, 300_000)
        for share in (straight, turning)
    ]
    # only the valves' drops differ, and with them the motors' leakage: at most 5 bar · (0.35² / ...) of some 100 bar
    drops = [(0.3 * m.pump_displacement * SPEED * share.max() / m.traction_cv) ** 2 for share in (straight, turning)]
    for name in ("forward", "back"):
        assert getattr(ends[0], name) == pytest.approx(getattr(ends[1], name), abs=max(drops))
    for name in HOSES[1:]:
        assert getattr(ends[0], name) == pytest.approx(ends[0].wheel_fl, rel=4 * ROUNDOFF)


def test_relief_bounds_the_pressure_of_blocked_wheels():
    m = columns(DRIVELINE)
    for swash in (1.0, -1.0):
        end = launch(run_kernel, DRIVELINE, OIL, control(swash=swash), np.zeros(4), level(), SUBSTEP, 150_000)
        drop = abs(end.forward - end.back)
        pumped = m.pump_displacement * SPEED
        leak = (m.pump_cross_leakage + 4 * m.motor_leakage) * drop
        expected = m.relief_pressure + m.relief_ramp * (pumped - leak - m.pump_leakage * drop) / m.relief_flow
        # the case leakage of the high side is that of its full pressure: 24 bar more than the drop, of a ramp of 20 bar
        slack = m.relief_ramp * m.pump_leakage * 30 * BAR / m.relief_flow
        assert drop == pytest.approx(expected, abs=slack)
        assert np.sign(end.forward - end.back) == swash


def test_coasting_vehicle_drives_the_pump():
    """Wheels that roll faster than the pump lets them: the return side bears the pressure."""
    end = launch(run_kernel, DRIVELINE, OIL, control(swash=0.2), np.full(4, 0.6), level(), SUBSTEP, 300_000)
    assert end.back > end.forward + 10 * BAR


# ---- the pump's shaft ----


def test_pump_takes_more_than_it_gives_in_every_quadrant():
    rng = np.random.default_rng(2)
    displacement = rounded(rng.uniform(-1.0, 1.0, 1000) * 2.07e-5)
    drop, eta = rounded(rng.uniform(-400.0, 400.0, 1000) * BAR), float(rounded(0.93))
    torque = launch(torque_kernel, displacement, drop, eta)
    ideal = displacement * drop
    np.testing.assert_allclose(torque, ideal + (1 - eta) * np.abs(ideal), rtol=4 * ROUNDOFF, atol=1e-9)
    loss = torque - ideal
    assert np.all(loss >= -4 * ROUNDOFF * np.abs(ideal))
    np.testing.assert_allclose(loss, (1 - eta) * np.abs(ideal), rtol=16 * ROUNDOFF / (1 - eta))
    # driven: it still gives something back
    assert np.all(torque[ideal < 0] < 0)
    assert launch(torque_kernel, 2.07e-5, 200 * BAR, 1.0) == pytest.approx(2.07e-5 * 200 * BAR, rel=4 * ROUNDOFF)
