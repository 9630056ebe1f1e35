"""Laws of aspen by their closed forms: oil, air, hoses, notches, tires, friction; what is shaken makes no work."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.integrate import cumulative_trapezoid, quad
from scipy.optimize import brentq

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import aspen
from aoro_gym.diagnosis_benchmark.component_families.laws import aspen as laws
from aoro_gym.diagnosis_benchmark.component_families.laws import places
from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.advance import Inputs
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR, DEGREE, LITRE_PER_MINUTE

Aspen = component.GROUP.structure("aspen")
NOMINAL = component.nominal("aspen")
MADE = component.GROUP.family_of("aspen").derived(NOMINAL)
f64 = wp.float64


@wp.kernel(enable_backward=False, module="unique")
def evaluate(machines: wp.array(dtype=Aspen), values: wp.array(dtype=f64), out: wp.array2d(dtype=f64)):
    """Laws of one variable at values of it."""
    k = wp.tid()
    m, v = machines[0], values[k]
    x = places.State()
    x[places.SIDE_A] = v
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    c = chambers(f64(0.0), m)
    out[k, 0] = laws.liquid(v, m)
    out[k, 1] = laws.swelling(v, m)
    out[k, 2] = laws.pocket(v, m)
    out[k, 3] = laws.dugoff(v)
    out[k, 4] = laws.notch(v)
    out[k, 5] = laws.opening(v, m)
    out[k, 6] = laws.leaks(x, m, inputs, c)
    out[k, 7] = laws.hose_factor(v, m.viscosity, m)
    out[k, 8] = laws.through(v, f64(1e12), f64(0.0), m.viscosity, m)
    x[at.ROD_RATE] = v
    out[k, 9] = laws.seals(x, m, c, inputs)[0]
    out[k, 10] = c[4]


@wp.kernel(enable_backward=False, module="unique")
def shaken(machines: wp.array(dtype=Aspen), way: wp.array2d(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
    """Work [J] of a given motion on tire, hinge, seals and rods; tire's forces along and across, and moment."""
    m = machines[0]
    x = places.State()
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    work = wp.vector(length=4, dtype=f64)
    for k in range(way.shape[0]):
        t = laws.tire(x, m, 0, places.vec4d(way[k, 0], way[k, 1], way[k, 2], way[k, 3]), m.load_mean)
        x[at.RATE_FRONT] = way[k, 4]
        x[at.ROD_RATE] = way[k, 5]
        bearing = laws.hinge(x, m)
        seal = laws.seals(x, m, chambers(x[at.ROD], m), inputs)
        rod = laws.rods(x, m)
        turning = t[3] * way[k, 0] - t[4] * way[k, 1] - t[5] * way[k, 3]
        work += step * wp.vector(turning, bearing[0] * way[k, 4], seal[0] * way[k, 5], rod[0] * (way[k, 5] - way[k, 4]))
        for i in range(3):
            x[places.TIRE + i] += step * t[i]
            out[k, 4 + i] = t[3 + i]
        x[at.ROD] += step * way[k, 5]
        x[at.ANGLE] += step * way[k, 4]
        for i in range(4):
            out[k, i] = work[i]


def packed() -> wp.array:
    """The nominal machine as kernels take it."""
    return wp.array(component.GROUP.pack("aspen", [NOMINAL]), dtype=Aspen, device="cpu")


def evaluated(values: np.ndarray) -> np.ndarray:
    """Laws (K, 11) of the nominal machine at ``values`` (K,)."""
    out = wp.zeros((len(values), 11), dtype=f64, device="cpu")
    wp.launch(evaluate, len(values), [packed(), wp.array(values, dtype=f64, device="cpu")], [out], device="cpu")
    return out.numpy()


def moved(way: np.ndarray, step: float) -> np.ndarray:
    """What :func:`shaken` finds (K, 7) of a motion (K, 6)."""
    out = wp.zeros((len(way), 7), dtype=f64, device="cpu")
    wp.launch(shaken, 1, [packed(), wp.array(way, dtype=f64, device="cpu"), step], [out], device="cpu")
    return out.numpy()


def steady(seconds: float, step: float, **speeds: float) -> np.ndarray:
    """A motion (K, 6) at constant speeds of the tire: slip along, across, rolling, and in twist."""
    way = np.zeros((round(seconds / step), 6))
    for place, name in enumerate(("along", "across", "rolling", "twist")):
        way[:, place] = speeds.get(name, 0.0)
    return way


def test_oil_and_hoses_are_as_stiff_as_effects_measure() -> None:
    pressures = np.linspace(0.0, 300 * BAR, 3001)
    found = evaluated(pressures)
    assert found[:, 0] == pytest.approx([aspen.bulk_modulus(MADE, p) for p in pressures], rel=1e-12)
    assert MADE["hose_volume"] * found[:, 1] == pytest.approx([aspen.hose(MADE, p) for p in pressures], rel=1e-12)
    grown = cumulative_trapezoid(found[:, 1], pressures, initial=0.0)
    curve = MADE["hose_expansion"] * ((pressures + 4 * BAR) / (100 * BAR)) ** 0.7
    assert grown == pytest.approx(curve - curve[0], abs=1e-7)  # trapezoids of 0.1 bar: p h² e‴/12 < 1e-8


def test_a_pocket_of_air_is_polytropic() -> None:
    absolute = np.geomspace(0.5, 300.0, 20001) * ATMOSPHERIC_PRESSURE
    shrunk = cumulative_trapezoid(evaluated(absolute - ATMOSPHERIC_PRESSURE)[:, 2], absolute, initial=0.0)
    volume = MADE["pocket_at_rest"] * (ATMOSPHERIC_PRESSURE / absolute) ** (1 / 1.2)
    assert shrunk == pytest.approx(volume[0] - volume, abs=1e-7 * volume[0])  # trapezoids: (ln p)² of a step /12
    assert aspen.gas(MADE, 1.0) == pytest.approx(np.interp(ATMOSPHERIC_PRESSURE, absolute, volume), rel=1e-6)


def test_a_tires_force_leaves_the_straight_line_at_half_its_limit() -> None:
    demand = np.array([0.01, 0.499, 0.501, 1.0, 2.0, 100.0])
    force = evaluated(demand)[:, 3] * demand
    assert force[:2] == pytest.approx(demand[:2])
    assert force[2:] == pytest.approx(1 - 1 / (4 * demand[2:]), rel=1e-9)


def test_a_standing_tire_that_is_pushed_holds_back_by_dugoff() -> None:
    step, speed = 1e-4, 0.2
    most = MADE["grip"] * MADE["load_mean"]
    force = -moved(steady(1.2, step, across=speed), step)[:, 5] - MADE["tire_damping"] * speed
    demand = MADE["stiffness_across"] * np.arange(len(force)) * step * speed / most
    early = demand < 0.5
    assert force[early] == pytest.approx(most * demand[early], rel=0.01, abs=0.002 * most)  # r³/81 yields
    assert 0.88 * most < force[-1] < most


def test_a_rolling_tire_builds_its_force_over_the_relaxation_length() -> None:
    step, rolling = 1e-4, 2.0
    force = -moved(steady(1.2, step, across=0.01, rolling=rolling), step)[:, 5]
    rolled = np.arange(len(force)) * step * rolling
    stretched = 0.01 / rolling * MADE["relaxation_length"] * -np.expm1(-rolled / MADE["relaxation_length"])
    damped = MADE["tire_damping"] * 0.01 * np.exp(-rolled / MADE["relaxation_length"])
    assert force == pytest.approx(MADE["stiffness_across"] * stretched + damped, rel=1e-3)  # Euler's steps of 1/1400


def test_a_swivelled_wheel_needs_the_moment_that_effects_measure() -> None:
    step, rate = 1e-4, 0.35
    moment = -moved(steady(20 * DEGREE / rate, step, twist=rate), step)[-1, 6]
    damped = 0.015 * MADE["twist_stiffness"] * rate
    assert aspen.scrub(MADE, 20 * DEGREE) < moment < aspen.scrub(MADE, 20 * DEGREE) + damped


def test_a_notch_is_a_half_disc_and_then_as_wide_as_it() -> None:
    def width(y: float) -> float:
        return 2 * math.sqrt(0.09 - (0.3 - min(y, 0.3)) ** 2)

    whole = quad(width, 0.0, 1.0, points=[0.3])[0]
    edges = np.array([0.05, 0.2, 0.3, 0.6, 1.0])
    exact = [quad(width, 0.0, y, points=[min(y, 0.3)])[0] / whole for y in edges]
    assert evaluated(edges)[:, 4] == pytest.approx(exact, rel=1e-6)
    assert [aspen.notch(y) for y in edges] == pytest.approx(exact, rel=1e-6)


def test_notches_open_as_measured_and_ever_wider() -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found = evaluated(sign * np.array([0.0, MADE[f"band_{side}"], 0.5, 0.75, 1.0]))[:, 5]
        assert found == pytest.approx([0.0, 0.0, MADE[f"half_{side}"], MADE[f"most_{side}"], 1.0], abs=1e-12)
        assert np.all(np.diff(evaluated(sign * np.linspace(0.0, 1.05, 400))[:, 5]) >= 0.0)


def test_leakage_is_what_effects_measure_either_way() -> None:
    drops = np.array([5.0, 40.0, 100.0]) * BAR
    asked = [aspen.piston_leakage(MADE, d) + aspen.port_leakage(MADE, d) for d in drops]
    assert evaluated(drops)[:, 6] == pytest.approx(asked, rel=1e-9)
    assert evaluated(-drops)[:, 6] == pytest.approx(-np.array(asked), rel=1e-9)


def test_a_hose_is_laminar_first_and_obeys_colebrook_then() -> None:
    area = math.pi / 4 * aspen.BORE**2
    reynolds = np.array([5.0, 800.0, 1e4, 1e5])
    factor = evaluated(2 * area * MADE["viscosity"] * reynolds / (aspen.OIL_DENSITY * aspen.BORE))[:, 7]
    assert factor[:2] == pytest.approx(1.0, abs=2e-3)

    def colebrook(re: float) -> float:
        return brentq(lambda f: f**-0.5 + 2 * math.log10(1e-3 / 3.7 + 2.51 / (re * math.sqrt(f))), 1e-3, 0.2)  # type: ignore[return-value]

    exact = [colebrook(re) * re / 64 for re in reynolds[2:]]
    assert factor[2:] == pytest.approx(exact, rel=0.03)  # Churchill's fit of Colebrook's curve
    drops = np.array([0.5, 5.0, 30.0]) * BAR
    found = evaluated(drops)[:, 8]
    line = MADE["line_resistance"] * MADE["viscosity"] * evaluated(found)[:, 7]
    assert line * found + 1e12 * found**2 == pytest.approx(drops, rel=0.04)  # two rounds of the factor


def test_seals_break_away_at_what_effects_measure() -> None:
    rates = np.linspace(1e-4, 0.8, 16001)
    found = evaluated(rates)
    lever = found[0, 10]
    dry = found[:, 9] - 2 * lever**2 * rates * MADE["seal_viscosity"] * MADE["viscosity"]
    assert dry.max() == pytest.approx(2 * lever * aspen.breakaway(MADE), rel=1e-4)
    assert dry[-1] == pytest.approx(2 * lever * MADE["seal_force"] / MADE["seal_ratio"], rel=0.02)  # slides


def test_the_loop_of_the_hysteresis_is_as_wide_as_measured() -> None:
    """Commands 0.4 from below and from above, reached by ramps, held."""
    times = np.arange(140) * 0.01
    steering = np.interp(times, [0.0, 0.3, 0.4, 0.7, 0.9, 1.1, 1.4], [0.0, 0.4, 0.4, 0.4, 0.6, 0.4, 0.4])
    (log,) = component.trace([component.Run("aspen", NOMINAL, steering, joint_angle=-0.6)], period=0.01)
    assert log["spool"][138] - log["spool"][68] == pytest.approx(aspen.hysteresis(NOMINAL), rel=0.05)


def test_what_is_shaken_makes_no_work() -> None:
    rng, step = np.random.default_rng(2), 1e-5
    times = np.arange(100_000) * step
    waves = [(2 * np.pi * rng.uniform(0.5, 12.0, 6), rng.uniform(0.0, 2 * np.pi, 6)) for _ in range(6)]
    sizes = np.array([0.15, 0.15, 0.3, 0.6, 0.35, 0.3])
    way = np.stack([s * np.sin(np.outer(times, w) + p).sum(axis=1) for s, (w, p) in zip(sizes, waves, strict=True)], 1)
    work = moved(way, step)[:, :4]
    assert np.all(np.isfinite(work)) and np.all(work[-1] > 0.0)
    assert np.all(work.min(axis=0) > -2e-3 * work.max(axis=0))  # Euler's steps: half a step's change of force


def test_oil_is_as_thick_as_its_grade() -> None:
    """46 mm²/s at 40 °C and 12 at 75 °C, of a density that falls by 6.5e-4 a kelvin from 880 kg/m³ at 15 °C."""
    for celsius, kinematic in ((40.0, 46.0), (75.0, 12.0)):
        made = component.GROUP.family_of("aspen").derived(NOMINAL | {"temperature": celsius})
        density = 880.0 * (1 - 6.5e-4 * (celsius - 15.0))
        assert made["viscosity"] == pytest.approx(kinematic * 1e-6 * density, rel=0.01)


def test_the_filter_holds_back_what_effects_measure() -> None:
    flow = 70 * LITRE_PER_MINUTE
    changed = component.apply("back_pressure", "aspen", NOMINAL, 8 * BAR)
    made = component.GROUP.family_of("aspen").derived(changed)
    assert aspen.back_pressure(made, flow) - aspen.back_pressure(MADE, flow) == pytest.approx(8 * BAR, rel=1e-6)
    runs = [component.Run("aspen", one, np.full(160, 1.0), joint_angle=-0.6) for one in (NOMINAL, changed)]
    new, held = (log["exact_b"][800:1400].mean() for log in component.trace(runs))
    assert held - new == pytest.approx(8 * BAR, rel=0.1)  # at the 66 to 72 L/min of the turn


def test_the_relief_ends_the_supply_at_the_stop() -> None:
    command = np.full(160, 1.0)
    (log,) = component.trace([component.Run("aspen", NOMINAL, command, joint_angle=NOMINAL["stop_angle"] - 1e-3)])
    assert NOMINAL["poppet_pressure"] < log["exact_pump"][-1] < aspen.pump_limit(NOMINAL)


def test_another_consumer_does_not_take_the_flow_of_the_steering() -> None:
    """The priority valve: what is drawn off comes out of the surplus."""
    conductance = 20 * LITRE_PER_MINUTE / math.sqrt(80 * BAR)
    other = {"other_conductance": conductance, "other_start": 0.0, "other_length": 9.0}
    command = np.full(160, 0.6)
    run = component.Run("aspen", NOMINAL | other, command, joint_angle=-0.5)
    alone = component.Run("aspen", NOMINAL, command, joint_angle=-0.5)
    drawn, whole = component.trace([run, alone])
    middle = slice(900, 1500)
    assert drawn["volume_rate_a"][middle].mean() == pytest.approx(whole["volume_rate_a"][middle].mean(), rel=0.01)
