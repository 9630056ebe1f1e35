"""Laws of yew by their closed forms: oil and bubbles, hoses, ports, tires, friction; what is shaken makes no work."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.integrate import cumulative_trapezoid, quad

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import yew
from aoro_gym.diagnosis_benchmark.component_families.laws import places
from aoro_gym.diagnosis_benchmark.component_families.laws import yew as laws
from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.advance import Inputs
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR, DEGREE, LITRE_PER_MINUTE

Yew = component.GROUP.structure("yew")
NOMINAL = component.nominal("yew")
MADE = component.GROUP.family_of("yew").derived(NOMINAL)
f64 = wp.float64


@wp.kernel(enable_backward=False, module="unique")
def evaluate(machines: wp.array(dtype=Yew), values: wp.array(dtype=f64), out: wp.array2d(dtype=f64)):
    """Laws of one variable at values of it."""
    k = wp.tid()
    m, v = machines[0], values[k]
    x = places.State()
    x[places.SIDE_A] = v
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    oil = laws.liquid(v, m)
    mixed = laws.softness(v, f64(1.0), m)
    out[k, 0] = oil[0]
    out[k, 1] = oil[1]
    out[k, 2] = mixed[0]
    out[k, 3] = mixed[1]
    out[k, 4] = laws.brush(v)
    out[k, 5] = laws.opening(v, m)
    out[k, 6] = laws.leaks(x, m, inputs)
    out[k, 7] = laws.rhombus(v)
    out[k, 8] = laws.rough(v, f64(1e12), f64(0.0), m.viscosity, m)
    x[at.ROD_RATE] = v
    x[places.SIDE_A] = f64(0.0)
    c = chambers(f64(0.0), m)
    out[k, 9] = laws.seals(x, m, c, inputs)[0]
    out[k, 10] = c[4]


@wp.kernel(enable_backward=False, module="unique")
def pressed(machines: wp.array(dtype=Yew), way: wp.array(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
    """Free share of bubbles, strain of a hose and its braid's pressure while a pressure goes its ``way`` [Pa]."""
    m = machines[0]
    free = f64(1.0)
    strain = f64(0.0)
    held = f64(0.0)
    for k in range(1, way.shape[0]):
        rate = (way[k] - way[k - 1]) / step
        stiff = laws.wall(rate, held, m)
        strain += step * rate / stiff
        held += step * rate * (f64(1.0) - m.braid_slack / stiff)
        free += step * laws.diffusion(way[k], free, m)
        out[k, 0] = free
        out[k, 1] = strain
        out[k, 2] = held


@wp.kernel(enable_backward=False, module="unique")
def shaken(machines: wp.array(dtype=Yew), way: wp.array2d(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
    """Work [J] of a given motion on tire, hinge, seals and rods; tire's forces along and across, moment, hinge's torque."""
    m = machines[0]
    x = places.State()
    x[places.HINGE] = f64(1.0)
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
        x[places.HINGE] += step * bearing[1]
        x[at.ROD] += step * way[k, 5]
        x[at.ANGLE] += step * way[k, 4]
        for i in range(4):
            out[k, i] = work[i]
        out[k, 7] = bearing[0]


def packed() -> wp.array:
    """The nominal machine as kernels take it."""
    return wp.array(component.GROUP.pack("yew", [NOMINAL]), dtype=Yew, device="cpu")


def evaluated(values: np.ndarray) -> np.ndarray:
    """Laws (K, 11) of the nominal machine at ``values`` (K,)."""
    out = wp.zeros((len(values), 11), dtype=f64, device="cpu")
    wp.launch(evaluate, len(values), [packed(), wp.array(values, dtype=f64, device="cpu")], [out], device="cpu")
    return out.numpy()


def compressed(way: np.ndarray, step: float) -> np.ndarray:
    """What :func:`pressed` finds (K, 3) of a pressure (K,)."""
    out = wp.zeros((len(way), 3), dtype=f64, device="cpu")
    wp.launch(pressed, 1, [packed(), wp.array(way, dtype=f64, device="cpu"), step], [out], device="cpu")
    return out.numpy()


def moved(way: np.ndarray, step: float) -> np.ndarray:
    """What :func:`shaken` finds (K, 8) of a motion (K, 6)."""
    out = wp.zeros((len(way), 8), dtype=f64, device="cpu")
    wp.launch(shaken, 1, [packed(), wp.array(way, dtype=f64, device="cpu"), step], [out], device="cpu")
    return out.numpy()


def steady(seconds: float, step: float, **speeds: float) -> np.ndarray:
    """A motion (K, 6) at constant speeds of the tire: slip along, across, rolling, and in twist; of the hinge."""
    way = np.zeros((round(seconds / step), 6))
    for place, name in enumerate(("along", "across", "rolling", "twist", "hinge")):
        way[:, place] = speeds.get(name, 0.0)
    return way


def test_volume_and_modulus_of_the_oil_belong_together() -> None:
    pressures = np.linspace(0.0, 300 * BAR, 2001)
    found = evaluated(pressures)
    assert found[:, 1] == pytest.approx([yew.bulk_modulus(MADE, p) for p in pressures], rel=1e-12)
    shrunk = cumulative_trapezoid(1 / found[:, 1], pressures, initial=0.0)
    assert -np.log(found[:, 0]) == pytest.approx(shrunk, abs=1e-9)  # trapezoids: p h² (1/K)''/12 < 1e-10


def test_oil_with_free_bubbles_shrinks_as_both_do() -> None:
    absolute = np.geomspace(1.0, 200.0, 20001) * ATMOSPHERIC_PRESSURE
    found = evaluated(absolute - ATMOSPHERIC_PRESSURE)
    mixed = (1 - MADE["foam_share"]) * found[:, 0] + found[:, 3]  # of what was a unit of volume
    shrunk = cumulative_trapezoid(found[:, 2], absolute, initial=0.0)
    assert shrunk == pytest.approx(mixed[0] - mixed, abs=1e-7)  # trapezoids: (ln p)² of a step /12 of 1.4 %
    assert found[:, 3] == pytest.approx(MADE["foam_share"] * ATMOSPHERIC_PRESSURE / absolute)


def test_bubbles_dissolve_as_their_radius_squared() -> None:
    step, pressure = 1e-3, 40 * BAR
    free = np.maximum(compressed(np.full(3000, pressure), step)[1:, 0], 0.0)  # a step may end below nought
    times = np.arange(1, 3000) * step
    exact = np.maximum(1 - 2 / 3 * times * pressure / (30 * BAR * MADE["foam_time"]), 0.0)
    assert free ** (2 / 3) == pytest.approx(exact, abs=0.01)  # nuclei of 1e-4: a thousandth of the rate at 4 % free
    assert np.all(compressed(np.full(100, -0.5 * BAR), step)[1:, 0] == 1.0)  # no more comes out than there is


def test_a_hose_rubs_as_its_pressure_swings() -> None:
    times = np.arange(400_001) * 1e-5
    way = 60 * BAR - 60 * BAR * np.cos(2 * np.pi * times)
    found = compressed(way, 1e-5)
    strain, held = found[1:, 1], found[1:, 2]
    limit, stiff = MADE["braid_friction"], MADE["braid_modulus"]
    assert np.abs(held).max() <= limit * 1.0001
    assert way[1:] - held == pytest.approx(MADE["braid_slack"] * strain, abs=1e-6 * way.max())
    last = slice(300_000, 400_000)  # a whole swing
    lost = np.sum(way[1:][last] * np.gradient(strain)[last])
    wide = np.ptp(strain[last])
    reached = math.tanh(0.5 * stiff * wide / limit)  # of Dahl's curve on steady swings
    assert lost == pytest.approx(2 * limit * (wide - 2 * reached * limit / stiff), rel=0.01)
    assert yew.hose(MADE, 100 * BAR) == pytest.approx(MADE["hose_volume"] / MADE["braid_slack"])


def test_a_standing_brush_is_the_sum_of_its_bristles() -> None:
    demand = np.array([0.01, 0.3, 0.7, 0.99, 1.0, 5.0])
    exact = [
        1.5 * quad(lambda u, q=q: min(q, 1 - u * u), 0.0, 1.0, points=[math.sqrt(max(1 - q, 0.0))])[0] for q in demand
    ]
    assert evaluated(demand)[:, 4] == pytest.approx(exact, rel=1e-9)


def test_a_standing_tire_that_is_pushed_holds_back_as_a_brush() -> None:
    step, speed = 1e-4, 0.2
    most = MADE["grip"] * MADE["load_mean"]
    force = -moved(steady(1.2, step, across=speed), step)[:, 5] - MADE["tire_damping"] * speed
    demand = MADE["stiffness_across"] * np.arange(len(force)) * step * speed / (1.5 * most)
    early = demand < 0.6
    exact = evaluated(demand[early])[:, 4]
    assert force[early] == pytest.approx(most * exact, rel=0.01, abs=0.002 * most)  # q⁷/7/3.8 yields
    assert most - MADE["tire_damping"] * speed < force[-1] < most * 1.0001


def test_a_rolling_tire_builds_its_force_over_the_relaxation_length() -> None:
    step, rolling = 1e-4, 2.0
    force = -moved(steady(1.2, step, across=0.01, rolling=rolling), step)[:, 5]
    rolled = np.arange(len(force)) * step * rolling
    stretched = 0.01 / rolling * MADE["relaxation_length"] * -np.expm1(-rolled / MADE["relaxation_length"])
    damped = MADE["tire_damping"] * 0.01 * np.exp(-rolled / MADE["relaxation_length"])
    most = MADE["grip"] * MADE["load_mean"]
    exact = most * evaluated(MADE["stiffness_across"] * stretched / (1.5 * most))[:, 4] + damped
    assert force == pytest.approx(exact, rel=1e-3)  # Euler's steps of 1/1900 of the relaxation


def test_a_swivelled_wheel_needs_the_moment_that_effects_measure() -> None:
    step, rate = 1e-4, 0.35
    for angle in (4 * DEGREE, 20 * DEGREE):
        moment = -moved(steady(angle / rate, step, twist=rate), step)[-1, 6]
        damped = 0.02 * MADE["twist_stiffness"] * rate
        assert yew.scrub(MADE, angle) * 0.995 < moment < yew.scrub(MADE, angle) + damped


def test_rhombi_open_as_measured_and_ever_wider() -> None:
    width = np.minimum(np.linspace(0.0, 1.0, 100_001), np.linspace(1.0, 0.0, 100_001)) * 4
    area = cumulative_trapezoid(width, dx=1e-5, initial=0.0)
    edges = np.array([0.1, 0.4, 0.5, 0.8, 1.0])
    assert evaluated(edges)[:, 7] == pytest.approx(np.interp(edges, np.linspace(0.0, 1.0, 100_001), area), abs=1e-9)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found = evaluated(sign * np.array([0.0, MADE[f"band_{side}"], 0.5, 0.75, 1.0]))[:, 5]
        assert found == pytest.approx([0.0, 0.0, MADE[f"half_{side}"], MADE[f"most_{side}"], 1.0], abs=1e-12)
        assert np.all(np.diff(evaluated(sign * np.linspace(0.0, 1.05, 400))[:, 5]) >= 0.0)


def test_leakage_is_what_effects_measure_either_way() -> None:
    drops = np.array([5.0, 40.0, 100.0]) * BAR
    asked = [yew.piston_leakage(MADE, d) + yew.port_leakage(MADE, d) for d in drops]
    assert evaluated(drops)[:, 6] == pytest.approx(asked, rel=1e-9)
    assert evaluated(-drops)[:, 6] == pytest.approx(-np.array(asked), rel=1e-9)


def test_a_rough_hose_is_laminar_first_and_loses_by_the_square_then() -> None:
    drops = np.array([0.05, 0.5, 30.0, 100.0]) * BAR
    flow = evaluated(drops)[:, 8]
    area = 2 * math.pi / 4 * yew.BORE**2
    reynolds = yew.OIL_DENSITY * flow / area * yew.BORE / MADE["viscosity"]
    laminar = 64 / reynolds
    rough = (2 * math.log10(3.7 / yew.ROUGHNESS)) ** -2
    length = MADE["line_resistance"] * 2 * math.pi * yew.BORE**4 / 128
    darcy = (drops - 1e12 * flow**2) / (length / yew.BORE * 0.5 * yew.OIL_DENSITY * (flow / area) ** 2)
    assert darcy == pytest.approx(np.maximum(laminar, rough), rel=1e-4)
    assert laminar[0] > rough > laminar[-1]


def test_seals_break_away_at_what_effects_measure() -> None:
    rates = np.array([0.012, 0.05, 0.4])
    found = evaluated(rates)
    lever = found[0, 10]
    speeds = rates * lever
    slid = yew.breakaway(MADE) / MADE["seal_ratio"]
    level = slid + (MADE["seal_force"] - slid) * np.exp(-np.sqrt(speeds / MADE["stribeck_speed"]))
    dry = level * np.tanh(speeds / 0.004)
    viscous = MADE["seal_viscosity"] * MADE["viscosity"] * speeds
    assert found[:, 9] == pytest.approx(2 * lever * (dry + viscous), rel=1e-9)


def test_a_bearing_that_has_rested_breaks_away_and_weakens_as_it_slips() -> None:
    step = 1e-4
    found = moved(steady(3.0, step, hinge=0.01), step)[:, 7] - 140.0 * 0.01
    assert found[0] == pytest.approx(
        NOMINAL["hinge_torque"], rel=1e-3
    )  # a asinh(½ e^(1.3/a))/1.3 is 1 within e^(−2.6/a)
    assert np.all(np.diff(found) < 0.0)
    age = -math.log(1 + math.exp(-1))  # where it neither heals nor weakens
    steady_torque = 0.25 / 1.3 * math.asinh(0.5 * math.exp((1 + 0.3 * age) / 0.25))
    assert found[-1] == pytest.approx(steady_torque * NOMINAL["hinge_torque"], rel=1e-3)


def test_the_loop_of_the_hysteresis_is_as_wide_as_measured() -> None:
    """Commands 0.5 from below and from above, reached by ramps, held."""
    times = np.arange(140) * 0.01
    steering = np.interp(times, [0.0, 0.3, 0.4, 0.7, 0.9, 1.1, 1.4], [0.0, 0.5, 0.5, 0.5, 0.7, 0.5, 0.5])
    (log,) = component.trace([component.Run("yew", NOMINAL, steering, joint_angle=-0.6)], period=0.01)
    assert log["spool"][138] - log["spool"][68] == pytest.approx(yew.hysteresis(NOMINAL), rel=0.05)


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
        made = component.GROUP.family_of("yew").derived(NOMINAL | {"temperature": celsius})
        density = 880.0 * (1 - 6.5e-4 * (celsius - 15.0))
        assert made["viscosity"] == pytest.approx(kinematic * 1e-6 * density, rel=0.01)


def test_the_gallery_holds_back_what_effects_measure() -> None:
    flow = 70 * LITRE_PER_MINUTE
    changed = component.apply("back_pressure", "yew", NOMINAL, 8 * BAR)
    made = component.GROUP.family_of("yew").derived(changed)
    assert yew.back_pressure(made, flow) - yew.back_pressure(MADE, flow) == pytest.approx(8 * BAR, rel=1e-6)
    runs = [component.Run("yew", one, np.full(160, 1.0), joint_angle=-0.6) for one in (NOMINAL, changed)]
    new, held = (log["exact_b"][800:1400].mean() for log in component.trace(runs))
    assert held - new == pytest.approx(8 * BAR, rel=0.05)  # whatever flows


def test_the_relief_ends_the_supply_at_the_stop() -> None:
    command = np.full(160, 1.0)
    (log,) = component.trace([component.Run("yew", NOMINAL, command, joint_angle=NOMINAL["stop_angle"] - 1e-3)])
    assert NOMINAL["lift_pressure"] < log["exact_pump"][-1] < yew.pump_limit(NOMINAL)
