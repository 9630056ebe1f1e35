"""Laws of oak by their closed forms: oil, hoses, edges, tires, friction; what is shaken makes no work."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import expm
from scipy.special import betainc

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import oak
from aoro_gym.diagnosis_benchmark.component_families.laws import oak as laws
from aoro_gym.diagnosis_benchmark.component_families.laws import places
from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.advance import Inputs
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE

Oak = component.GROUP.structure("oak")
NOMINAL = component.nominal("oak")
MADE = component.GROUP.family_of("oak").derived(NOMINAL)
f64 = wp.float64


@wp.kernel(enable_backward=False, module="unique")
def evaluate(machines: wp.array(dtype=Oak), values: wp.array(dtype=f64), out: wp.array2d(dtype=f64)):
    """Laws of one variable at values of it."""
    k = wp.tid()
    m, v = machines[0], values[k]
    x = places.State()
    x[places.SIDE_A] = v
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    oil = laws.liquid(v, m)
    free = laws.undissolved(v, m)
    past = laws.beyond(v, m.joint_play)
    line = laws.curved(v, f64(1e12), f64(1e8), f64(0.0), m, m.viscosity)
    out[k, 0] = oil[0]
    out[k, 1] = oil[1]
    out[k, 2] = free[0]
    out[k, 3] = free[1]
    out[k, 4] = past[0]
    out[k, 5] = past[1]
    out[k, 6] = line[0]
    out[k, 7] = line[1]
    out[k, 8] = laws.characteristic(v, f64(1.0))
    out[k, 9] = laws.opening(v, m)
    out[k, 10] = laws.leaks(x, m, inputs)
    out[k, 11] = laws.return_flow(v, m, m.viscosity)


@wp.kernel(enable_backward=False, module="unique")
def shaken(machines: wp.array(dtype=Oak), way: wp.array2d(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
    """Work [J] of a given motion on tire along, across and in twist, hinge, seals, rods; moment, strains of a hose."""
    m = machines[0]
    x = places.State()
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    work = wp.vector(length=6, dtype=f64)
    for k in range(way.shape[0]):
        t = laws.tire(x, m, 0, places.vec4d(way[k, 0], way[k, 1], way[k, 2], way[k, 3]), m.load_mean)
        x[at.RATE_FRONT] = way[k, 4]
        x[at.ROD_RATE] = way[k, 5]
        bearing = laws.hinge(x, m)
        seal = laws.seals(x, m, chambers(x[at.ROD], m), inputs)
        rod = laws.rods(x, m)
        creep = laws.wall(f64(100.0) * places.BAR, x[places.LINE], x[places.LINE + 1], m)
        power = wp.vector(
            t[3] * way[k, 0], -t[4] * way[k, 1], -t[5] * way[k, 3], bearing[0] * way[k, 4], seal[0] * way[k, 5],
            rod[0] * (way[k, 5] - way[k, 4]),
        )  # fmt: skip
        work += step * power
        for i in range(3):
            x[places.TIRE + i] += step * t[i]
        for i in range(2):
            x[places.SEAL + i] += step * seal[1 + i]
            x[places.LINE + i] += step * creep[i]
        x[places.HINGE] += step * bearing[1]
        x[at.ROD] += step * way[k, 5]
        x[at.ANGLE] += step * way[k, 4]
        for i in range(6):
            out[k, i] = work[i]
        out[k, 6] = -t[5]
        out[k, 7] = x[places.LINE]
        out[k, 8] = x[places.LINE + 1]
        out[k, 9] = bearing[0]


def packed() -> wp.array:
    """The nominal machine as kernels take it."""
    return wp.array(component.GROUP.pack("oak", [NOMINAL]), dtype=Oak, device="cpu")


def evaluated(values: np.ndarray) -> np.ndarray:
    """Laws (K, 12) of the nominal machine at ``values`` (K,)."""
    out = wp.zeros((len(values), 12), dtype=f64, device="cpu")
    wp.launch(evaluate, len(values), [packed(), wp.array(values, dtype=f64, device="cpu")], [out], device="cpu")
    return out.numpy()


def moved(way: np.ndarray, step: float) -> np.ndarray:
    """What :func:`shaken` finds (K, 10) of a motion (K, 6)."""
    out = wp.zeros((len(way), 10), dtype=f64, device="cpu")
    wp.launch(shaken, 1, [packed(), wp.array(way, dtype=f64, device="cpu"), step], [out], device="cpu")
    return out.numpy()


def test_density_and_modulus_of_the_oil_belong_together() -> None:
    pressures = np.linspace(0.0, 300 * BAR, 2001)
    found = evaluated(pressures)
    assert found[:, 1] == pytest.approx([oak.bulk_modulus(MADE, p) for p in pressures], rel=1e-12)
    grown = cumulative_trapezoid(1 / found[:, 1], pressures, initial=0.0)
    assert np.log(found[:, 0]) == pytest.approx(grown, abs=1e-9)  # trapezoids: p h² (1/K)''/12 < 1e-10


def test_air_dissolves_by_a_beta_distribution() -> None:
    share = np.linspace(0.0, 1.2, 25)
    found = evaluated(share * MADE["saturation_pressure"])
    assert found[:, 2] == pytest.approx(betainc(5, 5, 1 - np.minimum(share, 1.0)), abs=1e-12)
    fine = np.linspace(0.0, MADE["saturation_pressure"], 4001)
    assert np.trapezoid(evaluated(fine)[:, 3], fine) == pytest.approx(1.0, abs=1e-9)


def test_a_hose_that_holds_its_pressure_creeps_by_its_branches() -> None:
    step, count = 1e-4, 20_000
    found = moved(np.zeros((count, 6)), step)[:, 7:9]
    fast, slow, relaxed = (MADE[name] for name in ("wall_fast", "wall_slow", "hose_relaxed"))
    share, times = np.array([fast, slow]) / (fast + slow + relaxed), np.array([0.02, 0.25])
    rates = (np.outer(np.ones(2), share) - np.eye(2)) / times[:, None]
    final = 100 * BAR / relaxed
    for k in (100, 1000, count - 1):
        exact = final * (np.ones(2) - expm(rates * step * (k + 1)) @ np.ones(2))
        assert found[k] == pytest.approx(exact, abs=final * step / 0.02)  # Euler's steps of 1/200 of the fast branch
    assert MADE["hose_volume"] * final == pytest.approx(100 * BAR * oak.hose(MADE, 100 * BAR))


def test_a_tires_force_rises_to_its_peak_and_falls_to_sliding() -> None:
    asked = np.array([1e-6, 1.0, 2.999, 3.0, 3.001, 5.0, 7.0, 50.0])
    force = evaluated(asked)[:, 8] * asked
    assert force[0] / asked[0] == pytest.approx(1.0, abs=1e-6)
    assert force[2:5] == pytest.approx(1.0, abs=1e-6)
    assert force[5] == pytest.approx(0.96) and force[6:] == pytest.approx(0.92)


def test_a_swivelled_wheel_needs_the_moment_that_effects_measure() -> None:
    step, rate = 1e-4, 0.35
    way = np.zeros((round(20 * DEGREE / rate / step), 6))
    way[:, 3] = rate
    moment = moved(way, step)[-1, 6]
    assert moment == pytest.approx(oak.scrub(MADE, 20 * DEGREE), rel=0.03)  # its damping: 2 % of the stiffness


def test_free_play_ends_smoothly() -> None:
    play = MADE["joint_play"]
    stretch = np.linspace(-4 * play, 4 * play, 8001)
    found = evaluated(stretch)
    assert np.gradient(found[:, 4], stretch) == pytest.approx(found[:, 5], abs=2e-3)  # a kink of 4/3 a play over a step
    assert found[-1, 4] == pytest.approx(3 * play) and found[0, 4] == pytest.approx(-3 * play)


def test_lands_open_as_measured_and_ever_wider() -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found = evaluated(sign * np.array([0.0, MADE[f"band_{side}"], 0.5, 0.75, 1.0]))[:, 9]
        assert found == pytest.approx([0.0, 0.0, MADE[f"half_{side}"], MADE[f"most_{side}"], 1.0], abs=1e-12)
        assert np.all(np.diff(evaluated(sign * np.linspace(0.0, 1.05, 400))[:, 9]) >= 0.0)


def test_leakage_is_what_effects_measure() -> None:
    drops = np.array([5.0, 40.0, 100.0]) * BAR
    asked = [oak.piston_leakage(MADE, d) + oak.port_leakage(MADE, d) for d in drops]
    assert evaluated(drops)[:, 10] == pytest.approx(asked, rel=1e-9)


def test_the_return_hose_holds_back_what_effects_measure() -> None:
    flow = np.array([20.0, 70.0, 100.0]) * LITRE_PER_MINUTE
    drop = np.array([oak.back_pressure(MADE, q) - MADE["tank_pressure"] for q in flow])
    laminar = (1 + (0.1 * BAR / drop) ** 2) ** (-3 / 14)
    assert evaluated(drop)[:, 11] == pytest.approx(flow * laminar, rel=1e-9)
    assert laminar[1] > 0.999


def test_a_curved_hose_loses_more_by_its_dean_number() -> None:
    drops = np.array([0.1, 2.0, 20.0, 100.0]) * BAR
    found = evaluated(drops)
    flow, line = found[:, 6], found[:, 7]
    assert line * flow + 1e12 * flow**2 == pytest.approx(drops, rel=1e-5)
    plain = (-1e8 + np.sqrt(1e16 + 4e12 * drops)) / 2e12
    reynolds = 4 * oak.OIL_DENSITY * 0.5 * plain / (math.pi * oak.BORE * MADE["viscosity"])
    dean = np.maximum(reynolds * np.sqrt(0.5 * oak.BORE / MADE["coil_radius"]), 1.0)
    assert line == pytest.approx(1e8 * (1 + 0.033 * np.log10(dean) ** 4), rel=1e-5)


def test_the_loop_of_the_hysteresis_is_as_wide_as_measured() -> None:
    """Commands 0.4 from below and from above, reached by ramps, held: all plays have turned round."""
    times = np.arange(120) * 0.01
    steering = np.interp(times, [0.0, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2], [0.0, 0.4, 0.4, 0.4, 0.6, 0.4, 0.4])
    (log,) = component.trace([component.Run("oak", NOMINAL, steering, joint_angle=-0.6)], period=0.01)
    below, above = log["spool"][58], log["spool"][118]
    over = 2 * 0.0044 * 0.4 / 30  # plays keep what the driver's filter overshoots of a ramp's last steps, at both ends
    assert above - below == pytest.approx(oak.hysteresis(NOMINAL), abs=over)


def test_what_is_shaken_makes_no_work_and_the_bearing_holds_its_torque() -> None:
    rng, step = np.random.default_rng(2), 1e-5
    times = np.arange(100_000) * step
    waves = [(2 * np.pi * rng.uniform(0.5, 12.0, 6), rng.uniform(0.0, 2 * np.pi, 6)) for _ in range(6)]
    sizes = np.array([0.15, 0.15, 0.3, 0.6, 0.35, 0.3])
    way = np.stack([s * np.sin(np.outer(times, w) + p).sum(axis=1) for s, (w, p) in zip(sizes, waves, strict=True)], 1)
    found = moved(way, step)
    work, rate = found[:, :6], way[:, 4]
    assert np.all(np.isfinite(work)) and np.all(work[-1] > 0.0)
    assert np.all(work.min(axis=0) > -2e-3 * work.max(axis=0))  # Euler's steps: half a step's change of force
    dry = found[:, 9] - 120.0 * rate
    assert np.abs(dry).max() <= MADE["hinge_torque"] + 250.0 * np.abs(rate).max()


def test_oil_is_as_thick_as_its_grade() -> None:
    """46 mm²/s at 40 °C and 12 at 75 °C, of a density that falls by 6.5e-4 a kelvin from 880 kg/m³ at 15 °C."""
    for celsius, kinematic in ((40.0, 46.0), (75.0, 12.0)):
        made = component.GROUP.family_of("oak").derived(NOMINAL | {"temperature": celsius})
        density = 880.0 * (1 - 6.5e-4 * (celsius - 15.0))
        assert made["viscosity"] == pytest.approx(kinematic * 1e-6 * density, rel=0.01)


def test_the_relief_holds_the_supply_at_the_stop() -> None:
    command = np.full(120, 1.0)
    (log,) = component.trace([component.Run("oak", NOMINAL, command, joint_angle=NOMINAL["stop_angle"] - 1e-3)])
    assert NOMINAL["relief_pressure"] < log["exact_pump"][-1] < oak.pump_limit(NOMINAL)
    shaft = log["exact_pump"][-1] * NOMINAL["pump_displacement"]  # of a full stroke; the regulator takes less
    assert shaft > NOMINAL["torque_limit"] and log["engine_speed"][-1] > 0.94 * NOMINAL["engine_speed"]
