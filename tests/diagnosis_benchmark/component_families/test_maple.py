"""Laws of maple by their closed forms; what sticks or is pressed makes no work; its relief as measured."""

import math

import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import maple
from aoro_gym.diagnosis_benchmark.component_families.laws import maple as laws
from aoro_gym.diagnosis_benchmark.component_families.laws import places
from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.advance import Inputs
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR, DEGREE

Maple = component.GROUP.structure("maple")
MADE = component.GROUP.family_of("maple").derived(component.nominal("maple"))
f64 = wp.float64


@wp.kernel(enable_backward=False, module="unique")
def evaluate(machines: wp.array(dtype=Maple), at_: wp.array(dtype=f64), out: wp.array2d(dtype=f64)):
    """Laws of one variable at values of it."""
    k = wp.tid()
    m, v = machines[0], at_[k]
    x = places.State()
    x[places.SIDE_A] = v
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    out[k, 0] = laws.liquid(v, m)
    out[k, 1] = laws.wall(v, m)
    out[k, 2] = laws.leaks(x, m, inputs)
    out[k, 3] = laws.opening(v, m)
    out[k, 4] = laws.sprung(v, m)
    out[k, 5] = laws.bore(v)
    out[k, 6] = laws.patch_slip(v)
    out[k, 7] = laws.torsion(v)
    out[k, 8] = laws.friction_factor(v, f64(2e-3))
    out[k, 9] = laws.bristle(f64(1.0), v)
    out[k, 10] = laws.piped(v, f64(1e11), m.line_resistance * m.viscosity * f64(0.3), m.viscosity * f64(0.3), m)
    out[k, 11] = laws.turbulence(v, m.viscosity * f64(0.3), m)


@wp.kernel(enable_backward=False, module="unique")
def shaken(machines: wp.array(dtype=Maple), way: wp.array2d(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
    """Work [J] that a given motion has done on tire along, across and in twist, on hinge, seals and rods, over time."""
    m = machines[0]
    x = places.State()
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    x[places.SIDE_B] = f64(20.0) * places.BAR
    work = wp.vector(length=6, dtype=f64)
    for k in range(way.shape[0]):
        v = places.vec4d(way[k, 0], way[k, 1], way[k, 2], way[k, 3])
        x[places.SIDE_A] = (f64(1.0) + way[k, 4]) * f64(60.0) * places.BAR
        x[at.RATE_FRONT] = way[k, 5]
        x[at.ROD_RATE] = way[k, 6]
        c = chambers(x[at.ROD], m)
        t = laws.tire(x, m, 0, v, m.load_mean * (f64(1.0) + f64(0.3) * way[k, 4]))
        bearing = laws.hinge(x, m)
        seal = laws.seals(x, m, c, inputs)
        rod = laws.rods(x, m)
        power = wp.vector(
            t[3] * v[0], -t[4] * v[1], -t[5] * v[3], bearing[0] * way[k, 5], seal[0] * way[k, 6],
            rod[0] * (way[k, 6] - way[k, 5]),
        )  # fmt: skip
        work += step * power
        for i in range(3):
            x[places.TIRE + i] += step * t[i]
        x[places.HINGE] += step * bearing[1]
        x[places.SEAL] += step * seal[1]
        x[places.SEAL + 1] += step * seal[2]
        x[at.ROD] += step * way[k, 6]
        x[at.ANGLE] += step * way[k, 5]
        for i in range(6):
            out[k, i] = work[i]


def machines(made: dict[str, float] | None = None) -> wp.array:
    """One machine as kernels take it."""
    return wp.array(component.GROUP.pack("maple", [made or component.nominal("maple")]), dtype=Maple, device="cpu")


def evaluated(values: np.ndarray) -> np.ndarray:
    """Laws (K, 12) of the nominal machine at ``values`` (K,)."""
    out = wp.zeros((len(values), 12), dtype=f64, device="cpu")
    wp.launch(evaluate, len(values), [machines(), wp.array(values, dtype=f64, device="cpu")], [out], device="cpu")
    return out.numpy()


def test_oil_and_walls_have_the_moduli_that_effects_measure() -> None:
    pressures = np.array([0.0, 10.0, 100.0, 250.0]) * BAR
    found = evaluated(pressures)
    assert found[:, 0] == pytest.approx([maple.bulk_modulus(MADE, p) for p in pressures], rel=1e-12)
    assert found[:, 1] == pytest.approx([maple.hose(MADE, p) for p in pressures], rel=1e-12)
    fine = np.linspace(0.0, 300 * BAR, 2001)
    strain = np.trapezoid(1 / evaluated(fine)[:, 0], fine)
    left = 1 - fine[-1] / (MADE["bulk_modulus"] + 5.0 * fine[-1])
    assert strain == pytest.approx(-math.log(left), rel=1e-6)  # trapezoids: (Δp/K)²/12 and less


def test_leakage_is_what_effects_measure() -> None:
    drops = np.array([-100.0, 5.0, 40.0, 100.0]) * BAR
    asked = [math.copysign(maple.piston_leakage(MADE, abs(d)) + maple.port_leakage(MADE, abs(d)), d) for d in drops]
    assert evaluated(drops)[:, 2] == pytest.approx(asked, rel=1e-9)


def test_notches_open_with_the_square_and_end_in_a_slot() -> None:
    spool = np.array([0.1, 0.3, 0.5, 0.75, 1.0, 1.2, -0.2, -0.5, -0.75, -1.0])
    found = evaluated(spool)[:, 3]
    assert found[0] == found[6] == 0.0
    assert found[2] / found[1] == pytest.approx(((0.5 - 0.145) / (0.3 - 0.145)) ** 2)
    assert maple.regulated_flow(MADE) == pytest.approx(found[3] * MADE["edge_left"] * math.sqrt(MADE["edge_drop"]))
    assert found[4] == found[5] == found[9] == 1.0
    steps = np.abs(np.diff(evaluated(np.linspace(-1.0, 1.0, 4001))[:, 3]))
    assert steps.max() < 2.6 * 5e-4  # steepest: 2 √(notch · most) = 2.59


def test_a_port_is_a_segment_of_a_circle() -> None:
    places_ = np.array([0.05, 0.3, 0.62, 1.0])
    edges = np.linspace(0.0, 1.0, 200001)
    chord = 2 * np.sqrt(edges * (1 - edges))
    area = np.r_[0.0, np.cumsum(0.5 * (chord[1:] + chord[:-1]) * np.diff(edges))] / (np.pi / 4)
    assert evaluated(places_)[:, 5] == pytest.approx(np.interp(places_, edges, area), abs=1e-6)
    assert maple.open_passage(MADE) == pytest.approx(
        MADE["compensator_passage"] * np.interp(MADE["compensator_spring"], edges, area), rel=1e-6
    )


def test_a_patch_slips_by_fiala() -> None:
    slip = np.linspace(-3.0, 3.0, 61)
    force = slip - slip * np.abs(slip) / 3 + slip**3 / 27
    assert evaluated(force)[:, 6] == pytest.approx(slip, abs=1e-4)  # the cube root of a rounding at full slip: 1e-5


def test_a_disc_that_is_twisted_yields_from_its_rim() -> None:
    angles = np.linspace(1e-3, 20 * DEGREE, 4000)
    most = MADE["scrub_adhesion"] + MADE["scrub_arm"] * MADE["grip_sliding"] * MADE["load_mean"]
    moment = np.array([maple.scrub(MADE, one) for one in angles])
    slope = np.gradient(moment, angles) / MADE["twist_stiffness"]
    assert evaluated(moment / most)[:, 7] == pytest.approx(slope, abs=2e-3)  # a kink of curvature 12 over a step
    assert maple.scrub(MADE, 0.75 * most / MADE["twist_stiffness"]) == pytest.approx(0.75 * most)


def test_turbulent_pipes_lose_what_colebrook_says() -> None:
    """Haaland (1983) gives his law within 2 % of Colebrook's."""
    reynolds = np.geomspace(4e3, 1e7, 15)
    found = evaluated(reynolds)[:, 8]
    inverse = 1 / np.sqrt(found)
    for _ in range(60):
        inverse = -2 * np.log10(2e-3 / 3.7 + 2.51 * inverse / reynolds)
    assert found == pytest.approx(inverse**-2, rel=0.02)


def test_flow_through_a_line_balances_its_losses() -> None:
    drops = np.array([1.0, 10.0, 40.0, 100.0]) * BAR
    flow = evaluated(drops)[:, 10]
    linear = 0.3 * MADE["line_resistance"] * MADE["viscosity"]
    loss = linear * flow + (1e11 + evaluated(flow)[:, 11]) * flow**2
    assert np.any(evaluated(flow)[:, 11] > 1e10)  # turbulent with warm oil
    assert loss == pytest.approx(drops, rel=0.02)  # at worst a round leaves 0.37 of the error before, of 40 %


def test_friction_slides_at_its_limit_and_is_elastic_below() -> None:
    shares = np.array([-0.9, 0.0, 0.5, 0.69, 0.85, 1.0])
    assert evaluated(shares)[:, 9] == pytest.approx([1.0, 1.0, 1.0, 1.0, 1.0 - 0.5 * 0.85, 0.0])


def test_what_is_shaken_makes_no_work() -> None:
    rng, step = np.random.default_rng(2), 1e-5
    times = np.arange(100_000) * step
    waves = [(2 * np.pi * rng.uniform(0.5, 12.0, 6), rng.uniform(0.0, 2 * np.pi, 6)) for _ in range(7)]
    sizes = np.array([0.15, 0.15, 0.3, 0.6, 0.9 / 6, 0.35, 0.3])
    way = np.stack([s * np.sin(np.outer(times, w) + p).sum(axis=1) for s, (w, p) in zip(sizes, waves, strict=True)], 1)
    out = wp.zeros((len(times), 6), dtype=f64, device="cpu")
    asked = [machines(), wp.array(way, dtype=f64, device="cpu"), step]
    wp.launch(shaken, 1, asked, [out], device="cpu")
    work = out.numpy()
    assert np.all(np.isfinite(work)) and np.all(work[-1] > 0.0)
    assert np.all(work.min(axis=0) > -2e-3 * work.max(axis=0))  # Euler's steps: half a step's change of force


def test_oil_is_as_thick_as_its_grade() -> None:
    """46 mm²/s at 40 °C and 12 at 75 °C, of a density that falls by 6.5e-4 a kelvin from 880 kg/m³ at 15 °C."""
    for celsius, kinematic in ((40.0, 46.0), (75.0, 12.0)):
        made = component.GROUP.family_of("maple").derived(component.nominal("maple") | {"temperature": celsius})
        density = 880.0 * (1 - 6.5e-4 * (celsius - 15.0))
        assert made["viscosity"] == pytest.approx(kinematic * 1e-6 * density, rel=0.01)


def test_the_relief_lets_go_of_the_pumps_flow_at_the_limit() -> None:
    machine = component.nominal("maple")
    command = np.full(120, 1.0)
    (log,) = component.trace([component.Run("maple", machine, command, joint_angle=machine["stop_angle"] - 1e-3)])
    rest = maple.pump_limit(machine) - log["exact_pump"][-1]
    lost = machine["pump_leakage"] * log["exact_pump"][-1] / (machine["pump_displacement"] * machine["engine_speed"])
    slowed = 1 - log["engine_speed"][-1] / machine["engine_speed"]
    assert rest == pytest.approx(machine["override"] * (lost + slowed), abs=0.1 * machine["override"])  # leaks of ports


def test_gas_is_adiabatic_at_once_and_isothermal_at_length() -> None:
    """ln p rises steadily at a rate a: T → 1/(1 − κ a τ), κ = 2/7, with a time constant of τ/(1 − κ a τ)."""
    for rise, tau in ((40.0, 1.0), (0.5, 0.05)):
        warmth, pressure, step = 0.0, 4 * BAR, 1e-5
        for _ in range(2000):
            absolute = pressure + ATMOSPHERIC_PRESSURE
            change = float(laws.warming.func(f64(warmth), f64(pressure), f64(rise * absolute), f64(tau)))
            warmth, pressure = warmth + step * change, pressure + step * rise * absolute
        heat = 1 - 2 / 7 * rise * tau
        assert 1 + warmth == pytest.approx(1 / heat + (1 - 1 / heat) * math.exp(-heat * 0.02 / tau), rel=2e-3)
