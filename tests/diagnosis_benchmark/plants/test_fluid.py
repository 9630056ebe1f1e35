"""Oil, orifices and viscosity of the plants against closed forms."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.fluid import (
    ATMOSPHERE,
    Oil,
    air_for,
    check_valve,
    compressibility,
    compressibility_of,
    oil_of,
    orifice,
    viscosity,
)
from aoro_gym.diagnosis_benchmark.plants.records import evaluate, f64, packed


def test_an_orifice_is_turbulent_above_its_laminar_drop_and_linear_below(mapped):
    flow = mapped(orifice, 2e-6, np.array([4e5, 1e5, 0.5e5, -0.5e5]), 1e5)
    assert flow == pytest.approx([2e-6 * np.sqrt(4e5), 2e-6 * np.sqrt(1e5), 1e-6 * np.sqrt(1e5), -1e-6 * np.sqrt(1e5)])
    assert mapped(check_valve, 2e-6, np.array([0.3e5, -5e5]), 0.3e5, 1e5) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("level", [0, 1])
def test_compressing_oil_with_air_follows_its_volume(constants, level):
    """∫ dp/β from 0 to p is the logarithm of the volumes' ratio, where no air dissolves (below 1 % of p_c, say)."""
    share = np.array([0.02])
    oil = oil_of({**constants, "oil.bulk_modulus_slope": np.zeros(1)}, level, share)
    pressures = np.linspace(0.0, 0.3e5, 20001)[:, None]
    shrunk = np.trapezoid(compressibility_of(oil, pressures)[:, 0], pressures[:, 0])
    end, n, beta = pressures[-1, 0], constants["oil.polytropic_exponent"][0], constants["oil.bulk_modulus"][0]
    atmosphere = float(ATMOSPHERE)
    gas = share[0] * (atmosphere / (atmosphere + end)) ** (1.0 / n)
    liquid = (1.0 - share[0]) * (np.exp(-end / beta) if level else 1.0)
    # level 0 leaves out of the volume, level 1 out of the air's amount, what is at most 1 % of either's share here
    allowed = (1.0 - share[0]) * end / beta * share[0] if level == 0 else 0.0
    dissolved = 3.0 * (end / 30e5) ** 2 * share[0] if level else 0.0
    exact = -np.log(gas + liquid) if level else -np.log(gas + liquid * np.exp(-end / beta))
    assert shrunk == pytest.approx(exact, abs=1e-9 + allowed + dissolved)


@wp.func
def rise(oil: Oil, pressure: f64):
    _value, slope = compressibility(oil, pressure)
    return slope


@pytest.mark.parametrize("level", [0, 1, 3])
def test_the_compressibility_s_slope_is_its_derivative(constants, level):
    """Central differences over 20 Pa: their own error is (10 Pa / P)², and rounding 1e-16 of the value over 20 Pa."""
    oil, pressures = oil_of(constants, level, np.array([0.02])), np.array([[-0.5e5], [5e5], [20e5], [100e5]])
    slope = evaluate(rise, packed(Oil, oil, 1), Oil, pressures)
    lower, value, upper = (compressibility_of(oil, pressures + d) for d in (-10.0, 0.0, 10.0))
    assert np.all(np.abs(slope - (upper - lower) / 20.0) <= 1e-6 * np.abs(slope) + 1e-16 * value)


def test_air_is_found_that_gives_a_modulus(constants):
    for level in (0, 1):
        share = air_for(oil_of(constants, level), 4e8, 10e5)
        assert 1.0 / compressibility_of(oil_of(constants, level, share), 10e5) == pytest.approx(4e8, rel=1e-12)
        assert 0.0 < share[0] < 0.05


def test_dissolved_air_leaves_the_liquid(constants):
    oil = oil_of(constants, 1, np.array([0.03]))
    liquid = oil["modulus"] + oil["slope"] * 50e5
    assert 1.0 / compressibility_of(oil, 50e5) == pytest.approx(liquid, rel=1e-12)


def test_viscosity_passes_the_data_sheet_s_points():
    assert viscosity(np.array([30.0, 75.0])) == pytest.approx([80e-6, 12e-6])
    assert viscosity(40.0) == pytest.approx(46e-6, rel=0.03)  # VG 46 is 46 ± 10 %
