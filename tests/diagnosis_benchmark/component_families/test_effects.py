"""Effects of the component families: each moves its magnitude by what is asked, and its logs; so do deviations."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families.parts import FAMILIES, mixture
from aoro_gym.units import BAR

NOISE = {
    "joint_angle": 5e-4, "pressure_a": 0.5 * BAR, "pressure_b": 0.5 * BAR, "pump_pressure": 0.5 * BAR,
    "drive_forward": 0.5 * BAR, "drive_return": 0.5 * BAR, "engine_speed": 0.05,
}  # fmt: skip
"""About what the families' loggers add to each channel (rms)."""


@pytest.mark.parametrize("family", [*component.ALL_FAMILIES, *(mixture(FAMILIES, number) for number in range(6))])
def test_each_effect_moves_its_magnitude_by_what_is_asked(family: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(3):
        machine = component.machine(family, rng)
        for name, one in component.EFFECTS.items():
            for size in [sign * size for sign in one.signs for size in (one.weak, one.strong)]:
                healthy = component.measure(name, family, machine)
                changed = component.measure(name, family, component.apply(name, family, machine, size))
                got = changed / healthy - 1.0 if one.relative else changed - healthy
                assert got == pytest.approx(size, rel=1e-6), name


@pytest.mark.parametrize("family", component.SEALED)
def test_machines_at_the_ends_of_all_ranges_can_have_what_cases_draw(family: str) -> None:
    """A gain of the valve moves how far the compensator may open beside it: the pair that comes closest to what can be."""
    rng, table = np.random.default_rng(6), component.GROUP.family_of(family).TABLE
    opening, gain = (component.EFFECTS[name].strong for name in ("compensator_opening", "valve_gain"))
    for _ in range(40):
        drawn = {name: float(rng.choice((one.low, one.high))) for name, one in table.items()}
        machine = component.another_day(family, drawn, rng)
        for size in (-gain, 0.0, gain):
            made = component.GROUP.apply_all(family, machine, {"valve_gain": size, "compensator_opening": opening})
            before = component.apply("valve_gain", family, machine, size)
            kicks = [component.measure("compensator_opening", family, one) for one in (before, made)]
            assert kicks[1] / kicks[0] == pytest.approx(1 + opening, rel=1e-6)


def test_there_are_all_effects_with_sizes_and_realisations() -> None:
    assert len(component.EFFECTS) == 33
    for family in component.ALL_FAMILIES:
        assert set(component.magnitudes(family, component.nominal(family))) == set(component.EFFECTS)
    assert all(0.0 < one.weak < one.strong for one in component.EFFECTS.values())


def test_what_no_machine_can_be_is_an_error() -> None:
    machine = component.nominal("elm")
    with pytest.raises(ValueError, match="compensator_opening of 3"):
        component.apply("compensator_opening", "elm", machine, 3.0)
    with pytest.raises(ValueError, match="no effect 'rust'"):
        component.GROUP.apply_all("elm", machine, {"rust": 1.0})
    with pytest.raises(ValueError, match="family must be one of"):
        component.nominal("spruce")


def excited(family: str, angle: float = 0.35, **more: object) -> component.Run:
    """A start, a held turn into the stop, with a slow drive."""
    command = np.full(80, 0.85)
    command[:8] = 0.0
    drive = np.where(np.arange(80) > 30, 0.25, 0.0)
    return component.Run(family, component.nominal(family), command, drive=drive, joint_angle=angle, **more)  # type: ignore[arg-type]


def departure(log: dict[str, np.ndarray], healthy: dict[str, np.ndarray]) -> float:
    """Largest rms change of a channel over its noise."""
    return max(float(np.sqrt(np.mean((log[name] - healthy[name]) ** 2))) / NOISE[name] for name in NOISE)


@pytest.mark.parametrize("family", component.ALL_FAMILIES)
def test_strong_effects_show_in_the_logs(family: str) -> None:
    names = list(component.EFFECTS)
    changed = [
        excited(family, effects={name: component.EFFECTS[name].signs[-1] * component.EFFECTS[name].strong})
        for name in names
    ]
    healthy, *logs = component.record([excited(family), *changed], noise=False)
    departures = {name: departure(log, healthy) for name, log in zip(names, logs, strict=True)}
    assert all(np.isfinite(list(departures.values())))
    assert not {name: value for name, value in departures.items() if value < 1.0}


def test_strong_deviations_show_in_the_logs() -> None:
    names = list(component.OUTSIDE)
    assert len(names) >= 16
    assert 2 * len(component.FAMILIAR) <= len(names)
    runs = [excited("hazel", -0.1, outside=name, outside_size=1.0, seed=3) for name in names]
    healthy, *logs = component.record([excited("hazel", -0.1, seed=3), *runs], noise=False)
    departures = {name: departure(log, healthy) for name, log in zip(names, logs, strict=True)}
    assert all(np.isfinite(list(departures.values())))
    assert not {name: value for name, value in departures.items() if value < 1.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "mixed_elm_fir_0000",
        "mixed_elm_hazel_0001",
        "mixed_fir_hazel_0002",
        "mixed_fir_hazel_0005",
        "mixed_fir_maple_0000",
        "mixed_hazel_maple_0002",
        "mixed_elm_oak_0001",
        "mixed_maple_oak_0003",
        "mixed_elm_larch_0001",
        "mixed_hazel_larch_0000",
        *component.SEALED,
    ],
)
def test_effects_and_deviations_on_drawn_machines_leave_finite_logs(name: str) -> None:
    rng, command = np.random.default_rng(5), np.zeros(110)
    command[10:50], command[60:90] = 0.9, -0.6
    asked: list[dict[str, object]] = [
        {"effects": {effect: sign * one.strong}} for effect, one in component.EFFECTS.items() for sign in one.signs
    ]
    asked += [{"outside": deviation, "outside_size": 1.0} for deviation in component.OUTSIDE]
    runs = [
        component.Run(name, component.machine(name, rng), command, joint_angle=rng.uniform(-0.5, 0.5), **more)  # type: ignore[arg-type]
        for more in asked
    ]
    for log in component.record(runs):
        assert all(np.all(np.isfinite(column)) for column in log.values())
        assert np.max(np.abs(log["joint_angle"])) < 0.8 and np.max(log["pump_pressure"]) < 450 * BAR
