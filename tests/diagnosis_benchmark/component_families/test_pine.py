"""Laws of pine by their closed forms: oil, pipes and their waves, splines, tires, friction; what is shaken makes no work."""

import math

import numpy as np
import pytest
import warp as wp
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import pine
from aoro_gym.diagnosis_benchmark.component_families.laws import pine as laws
from aoro_gym.diagnosis_benchmark.component_families.laws import places
from aoro_gym.diagnosis_benchmark.independent.laws import layout as at
from aoro_gym.diagnosis_benchmark.independent.laws.advance import Inputs
from aoro_gym.diagnosis_benchmark.independent.laws.geometry import chambers
from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR, DEGREE, LITRE_PER_MINUTE

Pine = component.GROUP.structure("pine")
NOMINAL = component.nominal("pine")
MADE = component.GROUP.family_of("pine").derived(NOMINAL)
CLOSED = NOMINAL | {"bubble_share": 1e-15, "ring_gap": 1e-9, "crack_width": 1e-9}
"""A machine without bubbles and leakage."""
f64 = wp.float64


@wp.kernel(enable_backward=False, module="unique")
def evaluate(machines: wp.array(dtype=Pine), values: wp.array(dtype=f64), out: wp.array2d(dtype=f64)):
    """Laws of one variable at values of it."""
    k = wp.tid()
    m, v = machines[0], values[k]
    x = places.State()
    x[places.SIDE_A] = v
    x[laws.NEAR] = v
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    oil = laws.liquid(v, m)
    out[k, 0] = oil[0]
    out[k, 1] = oil[1]
    out[k, 2] = laws.softness(v, m)
    out[k, 3] = laws.unitire(v)
    out[k, 4] = laws.opening(v, m)
    out[k, 5] = laws.ring_leak(x, m, inputs)
    out[k, 6] = laws.crack_leak(x, m, inputs)
    out[k, 7] = laws.pipe_loss(v, m.viscosity, m)


@wp.kernel(enable_backward=False, module="unique")
def rung(machines: wp.array(dtype=Pine), given: places.State, step: f64, out: wp.array2d(dtype=f64)):
    """Pressures near, halfway and in the chamber, and both flows, of pipe A between a shut valve and a still piston."""
    m = machines[0]
    x = given
    inputs = Inputs()
    inputs[at.VISCOSITY] = m.viscosity
    c = chambers(f64(0.0), m)
    none = places.vec4d()
    for k in range(out.shape[0]):
        out[k, 0] = x[laws.NEAR]
        out[k, 1] = x[laws.MIDDLE]
        out[k, 2] = x[places.SIDE_A]
        out[k, 3] = x[laws.FIRST]
        out[k, 4] = x[laws.SECOND]
        half = x + f64(0.5) * step * laws.line_rates(places.State(), x, m, inputs, none, c)
        x += step * laws.line_rates(places.State(), half, m, inputs, none, c)


@wp.kernel(enable_backward=False, module="unique")
def shaken(machines: wp.array(dtype=Pine), way: wp.array2d(dtype=f64), step: f64, out: wp.array2d(dtype=f64)):
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
        x[places.CREEP] += step * rod[1]
        x[at.ROD] += step * way[k, 5]
        x[at.ANGLE] += step * way[k, 4]
        for i in range(4):
            out[k, i] = work[i]
        out[k, 7] = seal[0]


def packed(machine: dict[str, float] = NOMINAL) -> wp.array:
    """A machine as kernels take it."""
    return wp.array(component.GROUP.pack("pine", [machine]), dtype=Pine, device="cpu")


def evaluated(values: np.ndarray) -> np.ndarray:
    """Laws (K, 8) of the nominal machine at ``values`` (K,)."""
    out = wp.zeros((len(values), 8), dtype=f64, device="cpu")
    wp.launch(evaluate, len(values), [packed(), wp.array(values, dtype=f64, device="cpu")], [out], device="cpu")
    return out.numpy()


def ringing(near: float, count: int, step: float = 1e-5) -> np.ndarray:
    """What :func:`rung` finds (K, 5) of a pipe at 50 bar but for the pressure at its valve."""
    state = places.State()
    for place in (laws.NEAR, laws.MIDDLE, places.SIDE_A):
        state[place], state[place + 1] = 50 * BAR, 50 * BAR
    state[laws.NEAR] = near
    out = wp.zeros((count, 5), dtype=f64, device="cpu")
    wp.launch(rung, 1, [packed(CLOSED), state, step], [out], device="cpu")
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
    assert found[:, 1] == pytest.approx([pine.bulk_modulus(MADE, p) for p in pressures], rel=1e-12)
    shrunk = cumulative_trapezoid(1 / found[:, 1], pressures, initial=0.0)
    assert -np.log(found[:, 0]) == pytest.approx(shrunk, abs=1e-9)  # trapezoids: p h² (1/K)''/12 < 1e-10


def test_oil_with_bubbles_shrinks_as_both_do() -> None:
    absolute = np.geomspace(1.0, 200.0, 20001) * ATMOSPHERIC_PRESSURE
    found = evaluated(absolute - ATMOSPHERIC_PRESSURE)
    share = MADE["bubble_share"]
    mixed = (1 - share) * found[:, 0] + share * ATMOSPHERIC_PRESSURE / absolute
    shrunk = cumulative_trapezoid(found[:, 2], absolute, initial=0.0)
    assert shrunk == pytest.approx(np.log(mixed[0] / mixed), abs=1e-8)  # trapezoids: (ln p)² of a step /12 of 1 %


def test_a_pipes_waves_keep_its_oil_and_lose_energy() -> None:
    found = ringing(60 * BAR, 60_000)
    made = component.GROUP.family_of("pine").derived(CLOSED)
    side = 0.5 * (component_volume() + made["dead_volume"])
    quarter = 0.25 * made["hose_volume"]
    modulus = pine.bulk_modulus(made, 55 * BAR)
    soft = np.array([quarter, 2 * quarter, quarter]) * (1 / modulus + made["wall_softness"])
    soft[2] += side / modulus
    stored = found[:, :3] @ soft
    # over 10 bar the modulus changes by 0.7 %: that much of the oil that moved
    assert stored == pytest.approx(stored[0], abs=0.007 * np.ptp(found[:, 0]) * soft[0])
    half = 0.5 * made["pipe_inertance"] * 1.0345
    rest = found[:, :3] - stored[0] / soft.sum()
    energy = 0.5 * rest**2 @ soft + 0.5 * half * (found[:, 3:] ** 2).sum(axis=1)
    assert np.all(np.diff(energy[::2000]) < 1e-3 * energy[0]) and energy[-1] < 0.02 * energy[0]
    # Frequencies by the matrix of two halves between three nodes
    flow = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]) / half
    node = np.array([[-1.0, 0.0], [1.0, -1.0], [0.0, 1.0]]) / soft[:, None]
    slow = np.sqrt(np.sort(-np.linalg.eigvals(flow @ node).real)[0])
    spectrum = np.abs(np.fft.rfft((found[:, 2] - found[-1, 2]) * np.hanning(len(found)), 2**20))
    assert 2 * np.pi * np.argmax(spectrum) / (2**20 * 1e-5) == pytest.approx(slow, rel=0.03)


def component_volume() -> float:
    """Twice the oil [m³] of side A in the cylinders with the joint straight, without the dead volume."""
    out = math.sqrt(MADE["mount_squares"] - 2 * MADE["mount_across"]) - MADE["length_low"]
    return 2 * (MADE["bore_area"] * out + MADE["annulus_area"] * (MADE["stroke"] - out)) + MADE["dead_volume"]


def test_a_pipe_is_laminar_first_and_obeys_colebrook_then() -> None:
    reynolds = np.array([10.0, 1000.0, 6000.0, 5e4])
    flow = reynolds * MADE["viscosity"] / MADE["pipe_reynolds"]
    factor = evaluated(flow)[:, 7] / (0.5 * MADE["pipe_resistance"] * MADE["viscosity"] * flow)
    assert factor[:2] == pytest.approx(1.0)
    rough = pine.ROUGHNESS / NOMINAL["pipe_bore"] / 3.7

    def colebrook(re: float) -> float:
        return brentq(lambda f: f**-0.5 + 2 * math.log10(rough + 2.51 / (re * math.sqrt(f))), 1e-3, 0.2)  # type: ignore[return-value]

    assert factor[2:] == pytest.approx([colebrook(re) * re / 64 for re in reynolds[2:]], rel=0.03)  # Swamee, Jain: 3 %


def test_a_ring_leaks_by_hagen_and_poiseuille_first_and_by_blasius_then() -> None:
    wide = component.GROUP.family_of("pine").derived(NOMINAL | {"ring_gap": 1.5e-3})
    area, hydraulic = 2 * math.pi * 0.08 * 1.5e-3, 3e-3
    flow = pine.piston_leakage(wide, 100 * BAR)
    reynolds = pine.OIL_DENSITY * flow / area * hydraulic / MADE["viscosity"]
    assert reynolds > 4000
    speed = flow / area
    loss = 0.316 / reynolds**0.25 * pine.RING_LENGTH / hydraulic * 0.5 * pine.OIL_DENSITY * speed**2
    assert loss == pytest.approx(100 * BAR, rel=0.12)  # where both meet, the root of squares
    small = 2 * math.pi * 0.08 * NOMINAL["ring_gap"] ** 3 * 5 * BAR / (12 * MADE["viscosity"] * pine.RING_LENGTH)
    assert pine.piston_leakage(MADE, 5 * BAR) == pytest.approx(small, rel=0.02)


def test_leakage_is_what_effects_measure_either_way() -> None:
    drops = np.array([5.0, 40.0, 100.0]) * BAR
    for column, law in ((5, pine.piston_leakage), (6, pine.port_leakage)):
        asked = np.array([law(MADE, d) for d in drops])
        assert evaluated(drops)[:, column] == pytest.approx(asked, rel=1e-9)
        assert evaluated(-drops)[:, column] == pytest.approx(-asked, rel=1e-9)


def test_edges_open_as_measured_ever_wider_and_without_a_kink() -> None:
    for side, sign in (("left", 1.0), ("right", -1.0)):
        found = evaluated(sign * np.array([0.0, MADE[f"band_{side}"], 0.5, 0.75, 1.0]))[:, 4]
        assert found == pytest.approx([0.0, 0.0, MADE[f"half_{side}"], MADE[f"most_{side}"], 1.0], abs=1e-12)
        spool = np.linspace(0.0, 1.0, 4001)
        slope = np.diff(evaluated(sign * spool)[:, 4]) / np.diff(spool)
        assert np.all(slope >= -1e-12)
        assert np.abs(np.diff(slope)).max() < 0.02  # a kink of 0.2 of the mean slope would be 10 times as much
    places_ = np.array([0.2, 0.4, 0.6, 0.75, 0.9])
    assert evaluated(places_)[:, 4] == pytest.approx([pine.opening(s, MADE) for s in places_], rel=1e-12)


def test_a_standing_tire_that_is_pushed_holds_back_by_unitire() -> None:
    step, speed = 1e-4, 0.2
    most = MADE["grip"] * MADE["load_mean"]
    force = -moved(steady(1.0, step, across=speed), step)[:, 5] - MADE["tire_damping"] * speed
    demand = MADE["stiffness_across"] * np.arange(len(force)) * step * speed / most
    early = demand < 1.0
    exact = 1 - np.exp(-demand - 0.2 * demand**2 - (0.04 + 1 / 12) * demand**3)
    assert force[early] == pytest.approx(most * exact[early], rel=0.02, abs=0.003 * most)  # r⁵/5/39 yields
    assert 0.95 * most < force[-1] < most
    assert evaluated(np.array([1e-6]))[0, 3] == pytest.approx(1e-6, rel=1e-5)


def test_a_rolling_tire_builds_its_force_over_the_relaxation_length() -> None:
    step, rolling = 1e-4, 2.0
    force = -moved(steady(1.2, step, across=0.01, rolling=rolling), step)[:, 5]
    rolled = np.arange(len(force)) * step * rolling
    stretched = 0.01 / rolling * MADE["relaxation_length"] * -np.expm1(-rolled / MADE["relaxation_length"])
    damped = MADE["tire_damping"] * 0.01 * np.exp(-rolled / MADE["relaxation_length"])
    most = MADE["grip"] * MADE["load_mean"]
    demand = MADE["stiffness_across"] * stretched / most
    exact = most * -np.expm1(-demand - 0.2 * demand**2 - (0.04 + 1 / 12) * demand**3) + damped
    assert force == pytest.approx(exact, rel=1e-3)  # Euler's steps of 1/1100 of the relaxation


def test_a_swivelled_wheel_needs_the_moment_that_effects_measure() -> None:
    step, rate = 1e-4, 0.35
    moment = -moved(steady(20 * DEGREE / rate, step, twist=rate), step)[-1, 6]
    damped = 0.02 * MADE["twist_stiffness"] * rate
    # of a twist of 1 the sixth's square, a 36th, has slipped over at most a third of the way
    assert 0.99 * pine.scrub(MADE, 20 * DEGREE) < moment < pine.scrub(MADE, 20 * DEGREE) + damped


def test_seals_break_away_at_what_effects_measure_and_slide_on_a_film() -> None:
    step = 2e-5
    way = np.zeros((140_000, 6))
    way[:40_000, 5] = 0.003  # a thirtieth of the Stribeck speed: the film is thin
    way[40_000:, 5] = 0.4
    found = moved(way, step)[:, 7]
    lever = MADE["mount_along"] / math.sqrt(MADE["mount_squares"] - 2 * MADE["mount_across"])
    film = 0.6 * (0.003 * lever / 0.1) ** (2 / 3)
    slid = pine.breakaway(MADE) / MADE["seal_ratio"]
    level = slid + ((1 - film) * MADE["seal_force"] - slid) * math.exp(-((0.003 * lever / MADE["stribeck_speed"]) ** 2))
    assert found[39_000] == pytest.approx(2 * lever * level, rel=0.01)  # viscous: 0.1 %, presliding: e^−7 left
    viscous = MADE["seal_viscosity"] * MADE["viscosity"] * 0.4
    assert found[60_000] < 2 * lever * slid + 2.1 * lever**2 * viscous


def test_the_loop_of_the_hysteresis_is_as_wide_as_measured() -> None:
    """Commands 0.4 from below and from above, reached by ramps, held."""
    times = np.arange(140) * 0.01
    steering = np.interp(times, [0.0, 0.3, 0.4, 0.7, 0.9, 1.1, 1.4], [0.0, 0.4, 0.4, 0.4, 0.6, 0.4, 0.4])
    (log,) = component.trace([component.Run("pine", NOMINAL, steering, joint_angle=-0.6)], period=0.01)
    assert log["spool"][138] - log["spool"][68] == pytest.approx(pine.hysteresis(NOMINAL), rel=0.05)


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
        made = component.GROUP.family_of("pine").derived(NOMINAL | {"temperature": celsius})
        density = 880.0 * (1 - 6.5e-4 * (celsius - 15.0))
        assert made["viscosity"] == pytest.approx(kinematic * 1e-6 * density, rel=0.01)


def test_the_cock_holds_back_what_effects_measure() -> None:
    flow = 70 * LITRE_PER_MINUTE
    changed = component.apply("back_pressure", "pine", NOMINAL, 8 * BAR)
    made = component.GROUP.family_of("pine").derived(changed)
    assert pine.back_pressure(made, flow) - pine.back_pressure(MADE, flow) == pytest.approx(8 * BAR, rel=1e-6)
    weisbach = {10: 0.29, 20: 1.56, 30: 5.47, 40: 17.3, 50: 52.6, 60: 206.0}  # of a cock, by its degrees
    for degrees, loss in weisbach.items():
        assert 0.1 * math.exp(0.13 * degrees) == pytest.approx(loss, rel=0.3)


def test_the_relief_of_the_sensing_line_ends_the_supply_at_the_stop() -> None:
    command = np.full(160, 1.0)
    (log,) = component.trace([component.Run("pine", NOMINAL, command, joint_angle=NOMINAL["stop_angle"] - 1e-3)])
    assert log["exact_pump"][-1] == pytest.approx(pine.pump_limit(NOMINAL), rel=0.02)  # slope of the relief: 2.4 bar


def test_flow_is_shared_as_the_drop_over_edges_falls_with_the_margin() -> None:
    """A pump's margin less by a quarter of the edges' drop: flow less by the root, whatever the load."""
    less = NOMINAL["margin"] - 0.25 * MADE["edge_drop"]
    runs = [component.Run("pine", NOMINAL | {"margin": one}, np.full(200, 0.75), joint_angle=-0.6)
            for one in (NOMINAL["margin"], less)]  # fmt: skip
    whole, lessened = (log["volume_rate_a"][1000:1900].mean() for log in component.trace(runs))
    assert lessened / whole == pytest.approx(math.sqrt(0.75), rel=0.05)  # droop of the compensator's spring
