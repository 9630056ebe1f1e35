"""Physics of the component families and mixtures: oil is conserved, work is not made, steps are small, what stands stays."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families.figures import PUBLISHED, key_figures, turn
from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR

GRID = 1e-3
KINDS = (*component.ALL_FAMILIES, *(f"mixed_elm_fir_hazel_{number:04d}" for number in (1, 2, 7)))
"""Families, and mixtures with the hydraulics of each on tires, hinge, seals and rods of others."""


def command(*parts: tuple[int, float]) -> np.ndarray:
    """Command of parts: count of 10 ms and value."""
    return np.concatenate([np.full(count, value) for count, value in parts])


def compliances(hydraulics: str, made: dict[str, float], pressure: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Compliance [m³/Pa] of side A by the textbooks' formulas, written a second time; without gas but on elm."""
    if hydraulics == "elm":
        absolute, share, beta = pressure + ATMOSPHERIC_PRESSURE, made["air_share"], made["bulk_modulus"]
        gas = share * (ATMOSPHERIC_PRESSURE / absolute) ** 0.8
        liquid = (1 - share) * np.exp((ATMOSPHERIC_PRESSURE - absolute) / beta)
        mixture = (gas / (1.25 * absolute) + liquid / beta) / (gas + liquid)
        return (volume + made["hose_volume"]) * mixture + made["hose_volume"] / made["hose_modulus"]
    if hydraulics == "fir":
        return volume / (made["bulk_modulus"] + 10.0 * np.maximum(pressure, 0.0))
    if hydraulics == "maple":
        beta, above, size = made["bulk_modulus"], np.maximum(pressure, 0.0), made["hose_volume"]
        left = 1 - above / (beta + 5.0 * above)  # volume over that without pressure
        wall = 0.7 / made["hose_modulus"] * np.exp(-above / (350 * BAR)) + 0.3 / 2.6e10
        return (volume + size) * beta / (beta + 5.0 * above) ** 2 / left + size * wall
    if hydraulics == "oak":
        start, growth, above = 1 / made["bulk_modulus"], 1.7e-9, np.maximum(pressure, 0.0)
        density = 1 + start * above / (1 + growth * above)
        return (volume + made["hose_volume"]) * start / (1 + growth * above) ** 2 / density + (
            made["hose_volume"] / made["hose_relaxed"]
        )
    if hydraulics == "larch":
        modulus = made["bulk_modulus"] + 11.0 * np.maximum(pressure, 0.0)
        return (volume + made["hose_volume"]) / modulus + made["hose_volume"] / made["wall_modulus"]
    if hydraulics == "aspen":
        above, reference = np.maximum(pressure, 0.0), 100 * BAR
        modulus = 0.5 * made["bulk_modulus"] * np.log10(90.0 * above / (280 * BAR) + 3.0)
        strain = 0.7 * made["hose_expansion"] * ((above + 4 * BAR) / reference) ** -0.3 / reference
        return (volume + made["hose_volume"]) / modulus + made["hose_volume"] * strain
    if hydraulics == "pine":  # a quarter of the pipe is the chamber's
        modulus = made["bulk_modulus"] + 10.5 / 4e-9 * (1 - np.exp(-4e-9 * np.maximum(pressure, 0.0)))
        quarter = 0.25 * made["hose_volume"]
        return (volume + quarter) / modulus + quarter * made["wall_softness"]
    if hydraulics == "yew":
        q = np.maximum(pressure, 0.0) / made["bulk_modulus"]
        oil = (1 - 11 * q) / (1 - q + 5.5 * q * q) / made["bulk_modulus"]  # −dv/dp over v
        return (volume + made["hose_volume"]) * oil + made["hose_volume"] / made["braid_slack"]
    above, scale = np.maximum(pressure, 0.0), 0.0894 * made["bulk_modulus"]
    beta = (scale + above) * (1 - 0.0894 * np.log(1 + above / scale)) / 0.0894
    return (volume + made["hose_volume"]) / beta + made["hose_volume"] / made["hose_modulus"]


@pytest.mark.parametrize("family", KINDS)
def test_oil_that_flows_in_moves_the_pistons_or_is_compressed(family: str) -> None:
    machine, hydraulics = component.nominal(family), component.GROUP.family_of(family).parts["hydraulics"]
    machine |= {
        "fir": {"pocket_volume": 1e-15},
        "hazel": {"line_gas": 1e-15, "hose_creep": 1e-20},
        "maple": {"line_gas": 1e-15},
        "oak": {"air_share": 1e-15, "wall_fast": 1e-3, "wall_slow": 1e-3},
        "larch": {"air_share": 1e-15},
        "aspen": {"neck_resistance": 1e20},
        "pine": {"bubble_share": 1e-15},
        "yew": {"foam_share": 1e-15, "braid_modulus": 1e-3},
    }.get(hydraulics, {})
    log = component.trace([component.Run(family, machine, command((10, 0.0), (50, 0.9), (30, 0.6)))])[0]
    made = component.GROUP.family_of(family).derived(machine)
    stored = compliances(hydraulics, made, log["exact_a"], log["volume_a"])
    middle = 0.5 * (stored[1:] + stored[:-1])
    compressed = np.r_[0.0, np.cumsum(middle * np.diff(log["exact_a"]))]
    flown = cumulative_trapezoid(log["flow_a"], dx=GRID, initial=0.0)
    taken = log["volume_a"] - log["volume_a"][0]
    assert np.ptp(taken) > 1e-4
    error = np.abs(flown - taken - compressed).max()
    assert error < (2 * np.pi * 100.0 * GRID) ** 2 / 12 * np.ptp(compressed)  # trapezoids of 1 ms over waves of 100 Hz


@pytest.mark.parametrize("family", KINDS)
def test_motion_needs_the_work_of_the_oil_and_dies_without(family: str) -> None:
    log = component.trace(
        [component.Run(family, component.nominal(family), command((10, 0.0), (60, 1.0), (120, 0.0)))]
    )[0]
    power = log["exact_a"] * log["volume_rate_a"] + log["exact_b"] * log["volume_rate_b"]
    work = cumulative_trapezoid(power, dx=GRID, initial=0.0)
    assert log["kinetic_energy"].max() > 300.0
    assert np.all(log["kinetic_energy"] <= work + 0.01 * work.max())
    assert log["kinetic_energy"][-200:].max() < 0.01 * log["kinetic_energy"].max()


@pytest.mark.parametrize("family", KINDS)
def test_halved_steps_agree(family: str) -> None:
    rng = np.random.default_rng(7)
    runs = [
        component.Run(
            family,
            component.machine(family, rng),
            command((10, 0.0), (80, sign * 0.9), (30, 0.0)),
            joint_angle=-0.4 * sign,
        )
        for sign in (1.0, -1.0)
    ]
    for whole, half in zip(component.trace(runs), component.trace(runs, step=5e-5), strict=True):
        assert np.sqrt(np.mean((whole["angle"] - half["angle"]) ** 2)) < 0.1 * 2.4e-4  # of the quietest sensor's noise
        for name in ("exact_a", "exact_b", "exact_pump"):
            assert np.sqrt(np.mean((whole[name] - half[name]) ** 2)) < 0.05 * BAR


@pytest.mark.parametrize("family", KINDS)
def test_a_standing_machine_stands(family: str) -> None:
    machine = component.nominal(family)
    runs = [component.Run(family, machine, np.zeros(100), joint_angle=angle) for angle in (-0.4, 0.0, 0.3)]
    runs.append(component.Run(family, machine, np.zeros(100), {"ground_slope": 0.05}))
    for log in component.trace(runs, period=0.01):
        assert np.ptp(log["angle"]) < 2e-3
        assert log["exact_pump"][-1] == pytest.approx(machine["margin"], rel=0.2)
        assert log["kinetic_energy"][-1] < 0.5


@pytest.mark.parametrize("family", component.ALL_FAMILIES)
def test_turns_are_near_the_published_ones(family: str) -> None:
    machine = component.nominal(family)
    for percent, log in zip(
        (100, 75), component.trace([turn(family, machine, p) for p in (100, 75)], period=0.01), strict=True
    ):
        got = key_figures(log["angle"], machine)
        assert got[:4] == pytest.approx(PUBLISHED[percent][:4], rel=0.22)
        assert got[:3] == pytest.approx(PUBLISHED[percent][:3], rel=0.10)


def test_days_differ_most_on_hazel() -> None:
    spread = {}
    for family in component.FAMILIES:
        rng, machine = np.random.default_rng(3), component.nominal(family)
        days = [component.another_day(family, machine, rng)["seal_force"] / machine["seal_force"] for _ in range(200)]
        spread[family] = np.std(days)
    assert spread["hazel"] > 2.0 * spread["elm"]
