"""Laws of larch by their closed forms: oil, hoses, bores, tires, friction; what is shaken makes no work."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.integrate import cumulative_trapezoid, quad

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import larch
from aoro_gym.diagnosis_benchmark.component_families.laws import larch as laws
from aoro_gym.diagnosis_benchmark.component_families.laws import places
from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.advance import Inputs
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR, DEGREE, GRAVITY, LITRE_PER_MINUTE

Larch = component.GROUP.structure("larch")
NOMINAL = component.nominal("larch")
MADE = component.GROUP.family_of("larch").derived(NOMINAL)
f64 = wp.float64


@wp.kernel(enable_backward=False, module="unique")
def evaluate(machines: wp.array(dtype=Larch), values: wp.array(dtype=f64), out: wp.array2d(dtype=f64)):
    """Laws of one variable at values of it."""
    k = wp.tid()
    m, v = machines[0], values[k]
    x = places.State()
    x[places.SIDE_A] = v
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    oil = laws.liquid(v, m)
    gas = laws.free_gas(v, m)
    out[k, 0] = oil[0]
    out[k, 1] = oil[1]
    out[k, 2] = gas[0]
    out[k, 3] = gas[1]
    out[k, 4] = laws.disc(v)
    out[k, 5] = laws.opening(v, m)
    out[k, 6] = laws.leaks(x, m, inputs)
    out[k, 7] = laws.hose_loss(v, m.viscosity, m)
    out[k, 8] = laws.through(v, f64(1e12), f64(0.0), m.viscosity, m)


@wp.kernel(enable_backward=False, module="unique")
def shaken(machines: wp.array(dtype=Larch), way: wp.array2d(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
    """Work [J] of a given motion on tire, hinge, seals and rods; tire's forces along and across, moment, seals' torque."""
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
        for i in range(2):
            x[places.SEAL + i] += step * seal[1 + i]
        x[at.ROD] += step * way[k, 5]
        x[at.ANGLE] += step * way[k, 4]
        for i in range(4):
            out[k, i] = work[i]
        out[k, 7] = seal[0]


def packed() -> wp.array:
    """The nominal machine as kernels take it."""
    return wp.array(component.GROUP.pack("larch", [NOMINAL]), dtype=Larch, device="cpu")


def evaluated(values: np.ndarray) -> np.ndarray:
    """Laws (K, 9) of the nominal machine at ``values`` (K,)."""
    out = wp.zeros((len(values), 9), dtype=f64, device="cpu")
    wp.launch(evaluate, len(values), [packed(), wp.array(values, dtype=f64, device="cpu")], [out], device="cpu")
    return out.numpy()


def moved(way: np.ndarray, step: float) -> np.ndarray:
    """What :func:`shaken` finds (K, 8) of a motion (K, 6)."""
    out = wp.zeros((len(way), 8), dtype=f64, device="cpu")
    wp.launch(shaken, 1, [packed(), wp.array(way, dtype=f64, device="cpu"), step], [out], device="cpu")
    return out.numpy()


def steady(seconds: float, step: float, **speeds: float) -> np.ndarray:
    """A motion (K, 6) at constant speeds of the tire: slip along, across, rolling, and in twist."""
    way = np.zeros((round(seconds / step), 6))
    for place, name in enumerate(("along", "across", "rolling", "twist")):
        way[:, place] = speeds.get(name, 0.0)
    return way


def test_volume_and_modulus_of_the_oil_belong_together() -> None:
    pressures = np.linspace(0.0, 300 * BAR, 2001)
    found = evaluated(pressures)
    assert found[:, 1] == pytest.approx([larch.bulk_modulus(MADE, p) for p in pressures], rel=1e-12)
    shrunk = cumulative_trapezoid(1 / found[:, 1], pressures, initial=0.0)
    assert -np.log(found[:, 0]) == pytest.approx(shrunk, abs=1e-9)  # trapezoids: p h² (1/K)''/12 < 1e-10


def test_air_is_free_at_the_atmosphere_and_gone_at_the_critical_pressure() -> None:
    critical = MADE["critical_pressure"]
    absolute = np.geomspace(ATMOSPHERIC_PRESSURE * 1.0001, critical * 0.9999, 4001)
    found = evaluated(absolute)
    falls = cumulative_trapezoid(found[:, 3], absolute, initial=0.0)
    assert found[0, 2] - found[:, 2] == pytest.approx(falls, abs=1e-5)  # trapezoids: (ln p)² of a step /12
    ends = evaluated(np.array([0.5 * ATMOSPHERIC_PRESSURE, ATMOSPHERIC_PRESSURE, critical, 2 * critical]))[:, 2]
    assert ends == pytest.approx([2 ** (1 / 1.35), 1.0, 0.0, 0.0], abs=1e-12)


def test_a_disc_of_bristles_turns_as_the_sum_of_them() -> None:
    twists = np.array([0.01, 0.3, 1.0, 3.0, 8.0])
    exact = [
        quad(lambda u, q=q: min(q * u, 1 - u * u) * u * u, 0.0, 1.0, points=[(math.sqrt(q * q + 4) - q) / 2])[0]
        for q in twists
    ]
    found = evaluated(twists)[:, 4]
    assert found == pytest.approx(np.array(exact) * 7.5, rel=1e-9)
    assert evaluated(np.array([1e-6]))[0, 4] == pytest.approx(1.875e-6, rel=1e-5)


def test_a_standing_tire_that_is_pushed_holds_back_exponentially() -> None:
    step, speed = 1e-4, 0.2
    most = MADE["grip"] * MADE["load_mean"]
    force = -moved(steady(1.2, step, across=speed), step)[:, 5] - MADE["tire_damping"] * speed
    path = np.arange(len(force)) * step * speed
    demand = MADE["stiffness_across"] * path / most
    early = demand < 1.0
    assert force[early] == pytest.approx(most * -np.expm1(-demand[early]), rel=0.02, abs=0.003 * most)  # r⁴/81 yields
    assert force.max() < most and force[-1] > 0.9 * most


def test_a_rolling_tire_builds_its_force_over_the_relaxation_length() -> None:
    step, rolling = 1e-4, 2.0
    force = -moved(steady(1.2, step, across=0.01, rolling=rolling), step)[:, 5]
    rolled = np.arange(len(force)) * step * rolling
    stretched = 0.01 / rolling * MADE["relaxation_length"] * -np.expm1(-rolled / MADE["relaxation_length"])
    damped = MADE["tire_damping"] * 0.01 * np.exp(-rolled / MADE["relaxation_length"])
    most = MADE["grip"] * MADE["load_mean"]
    exact = most * -np.expm1(-MADE["stiffness_across"] * stretched / most) + damped
    assert force == pytest.approx(exact, rel=1e-3)  # Euler's steps of 1/1200 of the relaxation


def test_a_swivelled_wheel_needs_the_moment_that_effects_measure() -> None:
    step, rate = 1e-4, 0.35
    moment = -moved(steady(20 * DEGREE / rate, step, twist=rate), step)[-1, 6]
    assert moment == pytest.approx(larch.scrub(MADE, 20 * DEGREE), rel=0.04)  # its damping: 1 % of the stiffness


def test_bores_open_as_measured_and_ever_wider() -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found = evaluated(sign * np.array([0.0, MADE[f"band_{side}"], 0.5, 0.75, 1.0]))[:, 5]
        assert found == pytest.approx([0.0, 0.0, MADE[f"half_{side}"], MADE[f"most_{side}"], 1.0], abs=1e-12)
        assert np.all(np.diff(evaluated(sign * np.linspace(0.0, 1.05, 400))[:, 5]) >= 0.0)


def test_leakage_is_what_effects_measure_either_way() -> None:
    drops = np.array([5.0, 40.0, 100.0]) * BAR
    asked = [larch.piston_leakage(MADE, d) + larch.port_leakage(MADE, d) for d in drops]
    assert evaluated(drops)[:, 6] == pytest.approx(asked, rel=1e-9)
    assert evaluated(-drops)[:, 6] == pytest.approx(-np.array(asked), rel=1e-9)


def test_a_hose_is_laminar_first_and_obeys_blasius_then() -> None:
    area = math.pi / 4 * larch.BORE**2
    reynolds = np.array([50.0, 400.0, 4000.0, 2e4])
    flow = 2 * area * MADE["viscosity"] * reynolds / (larch.OIL_DENSITY * larch.BORE)
    factor = evaluated(flow)[:, 7]
    assert factor[:2] == pytest.approx(1.0, abs=1e-3)
    assert factor[2:] == pytest.approx(0.316 * reynolds[2:] ** 0.75 / 64, rel=2e-3)
    drops = np.array([0.5, 5.0, 30.0]) * BAR
    found = evaluated(drops)[:, 8]
    line = MADE["line_resistance"] * MADE["viscosity"] * evaluated(found)[:, 7]
    assert line * found + 1e12 * found**2 == pytest.approx(drops, rel=0.02)  # three rounds of the factor


def test_the_loop_of_the_hysteresis_is_as_wide_as_measured() -> None:
    """Commands 0.4 from below and from above, reached by ramps, held."""
    times = np.arange(120) * 0.01
    steering = np.interp(times, [0.0, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2], [0.0, 0.4, 0.4, 0.4, 0.6, 0.4, 0.4])
    (log,) = component.trace([component.Run("larch", NOMINAL, steering, joint_angle=-0.6)], period=0.01)
    assert log["spool"][118] - log["spool"][58] == pytest.approx(larch.hysteresis(NOMINAL), rel=0.02)


def test_what_is_shaken_makes_no_work() -> None:
    rng, step = np.random.default_rng(2), 1e-5
    times = np.arange(100_000) * step
    waves = [(2 * np.pi * rng.uniform(0.5, 12.0, 6), rng.uniform(0.0, 2 * np.pi, 6)) for _ in range(6)]
    sizes = np.array([0.15, 0.15, 0.3, 0.6, 0.35, 0.3])
    way = np.stack([s * np.sin(np.outer(times, w) + p).sum(axis=1) for s, (w, p) in zip(sizes, waves, strict=True)], 1)
    work = moved(way, step)[:, :4]
    assert np.all(np.isfinite(work)) and np.all(work[-1] > 0.0)
    assert np.all(work.min(axis=0) > -2e-3 * work.max(axis=0))  # Euler's steps: half a step's change of force


def test_seals_break_away_at_what_effects_measure() -> None:
    step = 1e-4
    way = np.zeros((120_000, 6))
    way[:, 5] = 3e-3  # slower than 5 % of the Stribeck speed, 70 presliding lengths far
    found = moved(way, step)[-1, 7]
    levers = cylinder_levers()
    speeds = 3e-3 * np.abs(levers)
    slid = larch.breakaway(MADE) / MADE["seal_ratio"]
    limit = slid * (1 + (MADE["seal_ratio"] - 1) * np.exp(-speeds / MADE["stribeck_speed"]))
    viscous = MADE["seal_viscosity"] * MADE["viscosity"] * speeds
    assert found == pytest.approx(float(np.abs(levers) @ (limit + viscous)), rel=0.02)  # 1 − s = 1/(1 + travel σ/F)


def cylinder_levers() -> np.ndarray:
    """Rates of both cylinders' lengths over the joint's angle [m/rad] with the joint straight."""
    length = math.sqrt(MADE["mount_squares"] - 2 * MADE["mount_across"])
    return np.array([MADE["mount_along"], -MADE["mount_along"]]) / length


def test_oil_is_as_thick_as_its_grade() -> None:
    """46 mm²/s at 40 °C and 12 at 75 °C, of a density that falls by 6.5e-4 a kelvin from 880 kg/m³ at 15 °C."""
    for celsius, kinematic in ((40.0, 46.0), (75.0, 12.0)):
        made = component.GROUP.family_of("larch").derived(NOMINAL | {"temperature": celsius})
        density = 880.0 * (1 - 6.5e-4 * (celsius - 15.0))
        assert made["viscosity"] == pytest.approx(kinematic * 1e-6 * density, rel=0.01)


def test_the_cooler_holds_back_what_effects_measure() -> None:
    flow = 70 * LITRE_PER_MINUTE
    changed = component.apply("back_pressure", "larch", NOMINAL, 8 * BAR)
    made = component.GROUP.family_of("larch").derived(changed)
    assert larch.back_pressure(made, flow) - larch.back_pressure(MADE, flow) == pytest.approx(8 * BAR, rel=1e-6)


def test_a_payload_lies_half_on_either_frame() -> None:
    made = component.GROUP.family_of("larch").derived(NOMINAL | {"payload": 2000.0})
    for frame in ("front", "rear"):
        assert made[f"mass_{frame}"] == NOMINAL[f"mass_{frame}_empty"] + 1000.0
    loads = 2 * (made["load_front"] + made["load_rear"])
    assert loads == pytest.approx(GRAVITY * made["mass_total"]) and made["mass_total"] == pytest.approx(12e3)


def test_the_power_line_ends_the_supply_at_the_stop() -> None:
    command = np.full(160, 1.0)
    (log,) = component.trace([component.Run("larch", NOMINAL, command, joint_angle=NOMINAL["stop_angle"] - 1e-3)])
    assert 0.9 * larch.pump_limit(NOMINAL) < log["exact_pump"][-1] < larch.pump_limit(NOMINAL)
