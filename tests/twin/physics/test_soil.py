"""Pressure, sinkage, resistance and shear of soil against closed forms and SciPy's quadrature in float64."""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false, reportCallIssue=false
import numpy as np
import pytest
import warp as wp
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import beta

from aoro_gym.terrains.soil import PRESETS, Soil
from aoro_gym.twin.physics.soil import (
    FIRM,
    Patch,
    Reaction,
    remembered,
    rut_depth,
    shear_step,
    sinkage_step,
    soil_pressure,
    wheel_reaction,
)
from aoro_gym.twin.physics.soil import Soil as DeviceSoil
from aoro_gym.twin.soil_ruts import device_records, remaining_depth
from tests.twin.physics.launch import ROUNDOFF, changed, launch, record

WIDTH, RADIUS = 0.53, 0.6
LOOSE = Soil.preset("sand")


@wp.struct
class RutBehind:
    """A rut that ends below the axle."""

    axle: float  # [m] x
    deepest: float  # [m] behind it


@wp.func
def remembered(memory: RutBehind, twin: int, x: float, y: float):  # noqa: F811 (an overload)
    return wp.where(x < memory.axle, memory.deepest, 0.0)


@wp.kernel(enable_backward=False)
def pressure_kernel(soil: wp.array(dtype=DeviceSoil), size: wp.array(dtype=wp.vec2), sinkage: wp.array(dtype=float),
                    deepest: wp.array(dtype=float), pressure: wp.array(dtype=float), slope: wp.array(dtype=float),
                    rut: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    p, s = soil_pressure(soil[i], size[i][0], size[i][1], sinkage[i], deepest[i])
    pressure[i] = p
    slope[i] = s
    rut[i] = rut_depth(soil[i], size[i][0], size[i][1], deepest[i])


@wp.kernel(enable_backward=False)
def wheel_kernel(soil: wp.array(dtype=DeviceSoil), memory: wp.array(dtype=RutBehind), patch: wp.array(dtype=Patch),
                 out: wp.array(dtype=Reaction)):  # fmt: skip
    i = wp.tid()
    out[i] = wheel_reaction(soil[i], memory[i], 0, patch[i])


@wp.kernel(enable_backward=False)
def sink_kernel(soil: wp.array(dtype=DeviceSoil), memory: wp.array(dtype=RutBehind), patch: wp.array(dtype=Patch),
                stiffness: wp.array(dtype=float), sinkage: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    w = patch[i]
    steps = 600
    for _ in range(steps):
        w.sinkage = sinkage_step(stiffness[i], w, wheel_reaction(soil[i], memory[i], 0, w))
    sinkage[i] = w.sinkage


@wp.kernel(enable_backward=False)
def shear_kernel(slip: wp.array(dtype=wp.vec2), roll: wp.array(dtype=float), way: wp.array(dtype=float),
                 length: wp.array(dtype=float), steps: wp.array(dtype=int), shear: wp.array(dtype=float)):  # fmt: skip
    i = wp.tid()
    j = float(0.0)
    for _ in range(steps[i]):
        j = shear_step(j, slip[i][0], slip[i][1], roll[i], way[i], length[i], 0.53, 1.0e-3)
    shear[i] = j


def soils(*names):
    return np.concatenate([device_records(Soil.preset(name)) for name in names])


def patches(depth, sinkage, shear=0.0, roll=1.0):
    return record(Patch, radius=RADIUS, width=WIDTH, depth=depth, sinkage=sinkage, shear=shear, roll=roll,
                  x=0.0, y=0.0, east=1.0, north=0.0)  # fmt: skip


def virgin(soil, z, length=1e9):
    """p [Pa] at first sinkage under a plate of the wheel's width, by the equation."""
    mat = 2.0 * soil.mat * (WIDTH + length) / (WIDTH * length)
    return (soil.k_c / WIDTH + soil.k_phi) * z**soil.exponent + mat * z * z + FIRM * max(z - soil.layer, 0.0)


@pytest.mark.parametrize("name", PRESETS)
def test_a_plate_sinks_by_bekkers_law_and_comes_up_by_wongs(name):
    """Pressure at a first sinkage, below it after deeper ones, and the rut that stays. pow and what cancels on unloading are
    good to some units of the last place of p_u: 1e-5."""
    soil = Soil.preset(name)
    z_u = np.geomspace(0.005, 0.35, 7)
    share = np.array([0.0, 0.5, 0.9, 0.95, 0.98, 1.0, 1.5])
    deepest, sinkage = (grid.ravel() for grid in np.meshgrid(z_u, share))
    sinkage = sinkage * deepest
    length = 0.7
    pressure, slope, rut = launch(
        pressure_kernel, soils(*[name] * len(deepest)), np.full((len(deepest), 2), (WIDTH, length)), sinkage, deepest,
    )  # fmt: skip
    for i, (z, most) in enumerate(zip(sinkage, deepest, strict=True)):
        p_u = virgin(soil, max(most, 1e-6), length)
        k_u = max(soil.k_0 + soil.a_u * most, 2.0 * p_u / most)
        assert rut[i] == pytest.approx(max(most - p_u / k_u, 0.0), abs=1e-5 * most)
        if z >= most:
            assert pressure[i] == pytest.approx(virgin(soil, z, length), rel=1e-5)
        else:
            assert pressure[i] == pytest.approx(max(p_u - k_u * (most - z), 0.0), abs=1e-5 * (p_u + k_u * most))
        assert slope[i] >= 0.0
    square = launch(pressure_kernel, soils(name), np.full((1, 2), WIDTH), np.zeros(1), np.full(1, 0.2))[2]
    assert remaining_depth(soils(name)[0], WIDTH, np.array([0.2]))[0] == pytest.approx(square[0], rel=1e-4)


def wheel_integrals(soil, depth, sinkage):
    """Load and resistance [N] of the half of a wheel ahead of its axle, and half its flat base, by SciPy in float64."""
    flat = np.sqrt((depth - sinkage) * (2.0 * RADIUS - depth + sinkage))
    end = np.sqrt(depth * (2.0 * RADIUS - depth))
    length = flat + end

    def z(x):
        return depth - RADIUS + np.sqrt(RADIUS**2 - x**2)

    load = WIDTH * (
        flat * virgin(soil, sinkage, length) + quad(lambda x: virgin(soil, max(z(x), 0), length), flat, end)[0]
    )
    return load, WIDTH * quad(lambda z: virgin(soil, z, length), 0.0, sinkage)[0]


@pytest.mark.parametrize("name", ["peat", "moraine", "sand", "sandy_loam", "loam"])
@pytest.mark.parametrize("bent", [0.0, 0.03, 0.07])
def test_a_rolling_wheel_bears_and_resists_as_the_integral_of_its_pressure(name, bent):
    """Virgin soil ahead, its own rut behind: load and ∫ b p dz, of a rigid wheel Bekker's b (k_c/b + k_φ) z₀ⁿ⁺¹/(n + 1).

    Four Gauss points on an arc are within 1.7 % of the integral, worst for a rigid wheel and n = 0.73. Soil that comes
    up behind presses forwards: the wheel there is left out by a rut too deep to touch."""
    soil = Soil.preset(name)
    for sinkage in (0.02, 0.06, 0.15):
        depth = sinkage + bent
        memory = record(RutBehind, axle=0.0, deepest=1.0)
        out = launch(wheel_kernel, soils(name), memory, patches([depth], [sinkage]))
        load, resistance = wheel_integrals(soil, depth, sinkage)
        assert np.ravel(out.load)[0] == pytest.approx(load, rel=0.018)
        assert np.ravel(out.resistance)[0] == pytest.approx(resistance, rel=0.018)
        if soil.mat == 0.0:
            k, n = soil.k_c / WIDTH + soil.k_phi, soil.exponent
            assert np.ravel(out.resistance)[0] == pytest.approx(WIDTH * k * sinkage ** (n + 1) / (n + 1), rel=0.018)


def test_a_rigid_wheel_sinks_by_bekkers_closed_form():
    """W = b k √D z₀^(n + ½) ½ B(n + 1, ½) of a shallow parabola; Bekker's first terms have (3 − n)/3 for ½ B, 6 % more at
    n = ½ and the same at 1. The circle's arc is shorter than the parabola's by √(1 − z/D): some z₀/(4 D) of the load."""
    for exponent in (0.5, 0.8, 1.0):
        soil = Soil(k_c=0.0, k_phi=2e6, exponent=exponent, cohesion=0.0, friction_angle_deg=30.0, shear_modulus=0.02)
        z = 0.02
        memory = record(RutBehind, axle=0.0, deepest=1.0)
        out = launch(wheel_kernel, device_records(soil), memory, patches([z], [z]))
        shape = WIDTH * 2e6 * np.sqrt(2.0 * RADIUS) * z ** (exponent + 0.5)
        exact = shape * 0.5 * beta(exponent + 1.0, 0.5)
        assert np.ravel(out.load)[0] == pytest.approx(exact, rel=0.01 + z / (8.0 * RADIUS))
        assert shape * (3.0 - exponent) / 3.0 == pytest.approx(exact, rel=0.07)


def test_a_standing_wheel_is_pushed_neither_way():
    memory = record(RutBehind, axle=0.0, deepest=0.0)
    out = launch(wheel_kernel, soils("peat"), memory, patches([0.2], [0.15]))
    assert abs(np.ravel(out.resistance)[0]) <= 20.0 * ROUNDOFF * np.ravel(out.load)[0]


def test_tire_and_soil_bear_the_same_load():
    """Newton's steps end where k (D − z₀) = F(z₀): the root by SciPy, to the quadrature's 1 %."""
    soil = Soil.preset("peat")
    memory = record(RutBehind, axle=0.0, deepest=1.0)
    stiffness, depth = 3.4e5, 0.2
    sinkage = launch(sink_kernel, soils("peat"), memory, patches([depth], [0.0]), np.array([stiffness]))
    root = brentq(lambda z: stiffness * (depth - z) - wheel_integrals(soil, depth, z)[0], 1e-4, depth)
    assert sinkage[0] == pytest.approx(root, rel=0.01)


def test_shear_strength_over_a_contact_is_janosis_integral():
    """Under a long plate of uniform pressure T = (A c + W tan φ) (1 − K/(iℓ) (1 − exp(−iℓ/K))), and over a rolling wheel the
    integral of its pressure: two and four points are within 1.5 % of it."""
    soil = Soil.preset("sandy_loam", k_0=0.0)
    k = soil.shear_modulus
    depth, sinkage = 0.12, 0.06
    flat, end = (np.sqrt(h * (2.0 * RADIUS - h)) for h in (depth - sinkage, depth))
    length = flat + end
    memory = record(RutBehind, axle=-1.0, deepest=1.0)
    for slip in (0.02, 0.1, 0.3, 1.0):
        shear = slip * length
        memory = record(RutBehind, axle=-flat, deepest=1.0)  # the arc behind bears nothing
        out = launch(wheel_kernel, soils("sandy_loam"), memory, patches([depth], [sinkage], shear))

        def stress(x, shear=shear):
            z = min(sinkage, max(depth - RADIUS + np.sqrt(RADIUS**2 - x**2), 0.0))
            strength = soil.cohesion + virgin(soil, z, length) * soil.tan_phi
            return strength * (1.0 - np.exp(-shear * (end - x) / length / k))

        exact = WIDTH * quad(stress, -flat, end, points=[flat])[0]
        assert np.ravel(out.grip)[0] == pytest.approx(exact, rel=0.015)
    # a plate: the firm ground of a thin layer, whose arcs are short
    plate = Soil.preset("sandy_loam", layer=0.01, cohesion=2e5, friction_angle_deg=0.0)
    depth, sinkage = 0.3, 0.0105
    out = launch(wheel_kernel, device_records(plate), record(RutBehind, axle=-0.1, deepest=0.0),
                    patches([depth], [sinkage], 0.04))  # fmt: skip
    whole = WIDTH * 2.0 * np.sqrt(depth * (2.0 * RADIUS - depth)) * 2e5
    closed = whole * (1.0 - k / 0.04 * (1.0 - np.exp(-0.04 / k)))
    assert np.ravel(out.grip)[0] == pytest.approx(closed, rel=0.05)  # arcs of 2 % of the way


def test_shear_grows_to_slip_times_length_in_rolling_and_by_the_way_in_standing():
    """Driven i = 1 − V/(Ω r), braked i = 1 − Ω r/V, a locked wheel at most its length; one that stands by the way
    slipped."""
    roll, way = np.array([1.0, 0.6, 0.0, 0.0]), np.array([0.8, 1.0, 1.0, 0.0])
    slip = np.stack([np.array([-0.2, 0.4, 1.0, 0.01]), np.zeros(4)], axis=1)
    steps = np.array([20000, 20000, 20000, 1000])
    shear = launch(shear_kernel, slip, roll, way, np.full(4, 0.5), steps)
    np.testing.assert_allclose(shear, [0.1, 0.2, 0.5, 0.01], rtol=1e-4)


def test_passes_over_one_rut_sink_ever_less_and_come_to_the_pressure_of_the_flat_base():
    """The arc ahead bears a virgin soil's pressure in the first pass and almost none later, so the base must bear it:
    the second pass sinks deeper by less than a tenth, and each one after that by less than half of what the one before
    did. The limit bears k δ on the base alone, but for the strips at both ends that reload within their rebound (less
    than 10 % of the load)."""
    soil = Soil.preset("sandy_loam")
    stiffness, load = 3.4e5, 25e3
    bent = load / stiffness
    depths, deepest = [], 0.0
    for _ in range(6):
        # D at which the tire bears the load, by bisection over D with the device's own balance
        low, high = bent, 0.55
        for _ in range(25):
            depth = 0.5 * (low + high)
            ahead = (
                record(RutBehind, axle=9.0, deepest=deepest) if deepest else record(RutBehind, axle=0.0, deepest=0.0)
            )
            z = launch(sink_kernel, soils("sandy_loam"), ahead, patches([depth], [max(deepest - 0.02, 0.0)]),
                          np.array([stiffness]))  # fmt: skip
            low, high = (low, depth) if stiffness * (depth - z[0]) > load else (depth, high)
        depths.append(float(z[0]))
        deepest = max(deepest, float(z[0]))
    gains = np.diff(depths)
    assert gains[0] < 0.1 * depths[0] and (gains[1:] < 0.5 * gains[:-1]).all() and 0.0 <= gains[-1] < 1e-5
    flat = np.sqrt(bent * (2.0 * RADIUS - bent))
    limit = brentq(lambda z: 2.0 * WIDTH * flat * virgin(soil, z) - load, 1e-4, 0.5)
    lighter = brentq(lambda z: 2.0 * WIDTH * flat * virgin(soil, z) - 0.9 * load, 1e-4, 0.5)
    assert lighter <= depths[-1] <= limit


@pytest.mark.parametrize(("name", "dry", "wet"), [("sandy_loam", 0.11, 0.32), ("clay", 0.25, 0.4)])
def test_soil_that_is_wet_carries_less(name, dry, wet):
    """Between measured states, too, at a sinkage of 10 cm; at the ends it is what was measured."""
    pressures = [virgin(Soil.preset(name, moisture=float(m)), 0.1) for m in np.linspace(dry, wet, 9)]
    assert np.all(np.diff(pressures) < 0.0)
    assert pressures[0] == pytest.approx(virgin(Soil.preset(name), 0.1), rel=1e-12)


def test_a_sunk_flank_is_held_by_passive_earth_pressure():
    """∫ 2 c z √N_φ + ½ γ z² N_φ over the length that is sunk, within 0.5 % as the quadrature of the arcs is."""
    soil = Soil.preset("sandy_loam")
    passive = np.tan(np.radians(45.0 + 0.5 * soil.friction_angle_deg))
    for depth, sinkage in ((0.2, 0.2), (0.2, 0.13), (0.12, 0.05)):
        flat, end = (np.sqrt(h * (2.0 * RADIUS - h)) for h in (depth - sinkage, depth))

        def borne(x, depth=depth, sinkage=sinkage):
            z = min(sinkage, max(depth - RADIUS + np.sqrt(RADIUS**2 - x**2), 0.0))
            return 2.0 * soil.cohesion * z * passive + 0.5 * soil.unit_weight * z**2 * passive**2

        memory = record(RutBehind, axle=0.0, deepest=0.0)
        out = launch(wheel_kernel, device_records(soil), memory, patches([depth], [sinkage]))
        exact = quad(borne, -end, end, points=[-flat, flat])[0]
        assert np.ravel(out.flank)[0] == pytest.approx(exact, rel=0.005)


def test_bad_soils_are_named():
    for arguments, message in (
        ({"name": "mud"}, "soil"),
        ({"name": "peat", "moisture": 0.5}, "moisture is 0.5, but peat"),
        ({"name": "clay", "moisture": 0.5}, "moisture"),
        ({"name": "peat", "tiles": 1000}, "tiles is 1000, but must be a power of two"),
        ({"name": "peat", "cohesion": -1.0}, "cohesion"),
        ({"name": "peat", "stickiness": 1.0}, "stickiness"),
        ({"name": "peat", "cohesion": [1.0, 2.0], "k_phi": [1e6] * 3}, "differ in length"),
    ):
        with pytest.raises(ValueError, match=message):
            Soil.preset(**arguments)
    assert changed(device_records(LOOSE), k_c=1.0)["k_c"] == 1.0
