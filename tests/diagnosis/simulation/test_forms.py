"""Forms of effects: each leaves a machine as it was at no magnitude, moves it at some, and agrees with a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from aoro_gym.diagnosis.simulation.days import draw_magnitudes
from aoro_gym.diagnosis.simulation.forms import FORMS, Change, drawn_form
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import MachineEffect
from aoro_gym.machine import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.units import BAR

NUMBERED = [(name, number) for name, several in FORMS.items() for number in range(len(several))]


@pytest.fixture(scope="module")
def machine() -> Machine:
    return Machine.load("aoro_datasheet")


def changed(machine: Machine, change: Change, *magnitudes: float) -> dict[str, Quantity]:
    """Values [SI] that a form leaves at the keys that it moves."""
    return {key: machine.value(key) + np.asarray(by) for key, by in change(machine, *magnitudes).items()}


@pytest.mark.parametrize(("effect", "number"), NUMBERED)
def test_a_form_without_a_magnitude_changes_nothing(machine: Machine, effect: str, number: int) -> None:
    for by in FORMS[effect][number](machine, *EFFECTS[effect].none).values():
        np.testing.assert_allclose(by, 0.0, atol=1e-12)


@pytest.mark.parametrize(("effect", "number"), NUMBERED)
def test_a_form_moves_the_machine(machine: Machine, effect: str, number: int) -> None:
    magnitudes = [one.high for one in EFFECTS[effect].magnitudes]
    moved = FORMS[effect][number](machine, *magnitudes)
    assert any(np.any(np.asarray(by) != 0.0) for by in moved.values())


def test_leaks_of_either_form_pass_the_same_at_the_reference_pressure(machine: Machine) -> None:
    """The laminar one 2 C Δp of two cylinders, the turbulent one Q √(Δp/100 bar)."""
    flow = 5e-5
    (laminar,) = FORMS["cross_port_leakage"][0](machine, flow).values()
    (turbulent,) = FORMS["cylinder_leakage"][0](machine, flow).values()
    assert 2.0 * laminar * 100.0 * BAR == pytest.approx(flow)
    assert turbulent == pytest.approx(flow)


def test_a_curve_pressed_together_opens_as_far_at_the_full_signal(machine: Machine) -> None:
    """On a straight curve o(V) = (V − d)/(2 − d) the new points lie on (V − d′)/(2 − d′)."""
    dead, wider = 0.25, 0.1
    keys = {f"steering.valve.dead_band_{side}": dead for side in ("left", "right")}
    for side in ("left", "right"):
        for name, volts in (("1V0", 1.0), ("1V5", 1.5)):
            keys[f"steering.valve.opening_{side}_{name}"] = (volts - dead) / (2.0 - dead)
    found = changed(machine.set(keys, check_ranges=False), FORMS["dead_band"][0], wider)
    after = dead + wider
    for side in ("left", "right"):
        assert found[f"steering.valve.dead_band_{side}"] == pytest.approx(after)
        assert found[f"steering.valve.opening_{side}_1V0"] == pytest.approx((1.0 - after) / (2.0 - after))
        assert found[f"steering.valve.opening_{side}_1V5"] == pytest.approx((1.5 - after) / (2.0 - after))


def test_a_filter_adds_its_pressure_at_the_reference_flow(machine: Machine) -> None:
    (ramp,) = FORMS["back_pressure"][0](machine, 3e5, 2e5).values()
    assert ramp * 1e-3 / machine.steering.tank_line.back_flow == pytest.approx(5e5)


def test_a_load_on_the_rear_adds_its_moment_of_inertia(machine: Machine) -> None:
    """Parallel axes: about the new centre, I = I₀ + m M/(m + M) r², and the centre moves by m/(m + M) of the way."""
    mass, rear = 800.0, machine.frame.rear
    found = changed(machine, FORMS["payload"][0], mass)
    total = rear.mass + mass
    assert found["frame.rear.mass"] == pytest.approx(total)
    assert found["frame.rear.cog_offset"] == pytest.approx(rear.mass * rear.cog_offset / total)
    assert found["frame.rear.inertia_zz"] == pytest.approx(
        rear.inertia_zz + rear.mass * mass / total * rear.cog_offset**2
    )


def test_machines_have_the_own_form_as_often_as_asked(machine: Machine) -> None:
    """5 σ of a binomial share about 0.3 of 2,000 machines."""
    count, rng = 2000, np.random.default_rng(4)
    effect = EFFECTS["cylinder_leakage"]
    assert isinstance(effect, MachineEffect)
    formed = drawn_form(effect, count, own=0.3, mixed=0.5, varied=0.0, rng=rng)
    assert isinstance(formed, MachineEffect)
    several = machine.variants(np.zeros(1, dtype=int)) if machine.num_variants > 1 else machine
    leaks = formed.change(several, np.full(count, 5e-5))
    none = np.equal(leaks["steering.valve.cross_port_leakage"], 0.0)
    assert abs(none.mean() - 0.3) < 5.0 * np.sqrt(0.3 * 0.7 / count)
    share = leaks["steering.valve.cross_port_leakage"] / 5e-5 + leaks["steering.cylinder.leakage"] * 2e7 / 5e-5
    np.testing.assert_allclose(share, 1.0)


def test_factors_are_the_same_however_often_sizes_are_tried(machine: Machine) -> None:
    """A size that no machine can have is halved; its form stays."""
    effect, rng = EFFECTS["tire_stiffness"], np.random.default_rng(5)
    formed = drawn_form(effect, 50, own=0.0, mixed=1.0, varied=0.3, rng=rng)
    assert isinstance(formed, MachineEffect)
    factor, _ = draw_magnitudes(effect, 50, (0.1, 1.0), rng)
    first, again = formed.change(machine, *factor), formed.change(machine, *factor)
    for key in first:
        np.testing.assert_array_equal(first[key], again[key])


def test_an_effect_of_the_measuring_chain_keeps_its_form() -> None:
    effect = EFFECTS["sensor_delay"]
    assert drawn_form(effect, 3, own=0.0, mixed=1.0, varied=0.3, rng=np.random.default_rng(6)) is effect
