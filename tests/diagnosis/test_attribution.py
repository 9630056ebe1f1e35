"""Attribution: the algebra against closed forms, and a cause that the twin itself was given."""

import numpy as np
import pytest

from aoro_gym.calibration.space import Space
from aoro_gym.diagnosis.attribution import PRIOR_INFORMATION, Axis, Problem, Shift, _volume, attribute
from aoro_gym.diagnosis.noise import ModelError
from aoro_gym.twin import Machine
from aoro_gym.twin.effects import EFFECTS
from tests.diagnosis.manoeuvres import blank, record, turn

ALL_AXES = [Axis(effect, i) for effect in EFFECTS.values() for i in range(len(effect.magnitudes))]


@pytest.mark.parametrize("axis", ALL_AXES, ids=lambda axis: f"{axis.effect.id}-{axis.index}")
def test_places_and_magnitudes_belong_together(axis):
    places = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(axis.place(axis.value(places)), places, atol=1e-12)
    assert axis.value(0.0) == pytest.approx(axis.magnitude.low)
    assert axis.value(1.0) == pytest.approx(axis.magnitude.high)
    assert axis.value(axis.none) == pytest.approx(axis.magnitude.none, abs=1e-12)


@pytest.mark.parametrize("axis", ALL_AXES, ids=lambda axis: f"{axis.effect.id}-{axis.index}")
def test_shifts_are_met_at_the_nodes_and_vanish_at_none(axis):
    assert np.all((axis.nodes >= 0.0) & (axis.nodes <= 1.0))
    np.testing.assert_allclose(axis.spline(axis.nodes), np.eye(len(axis.nodes)), atol=1e-12)
    np.testing.assert_allclose(axis.spline(axis.none), 0.0, atol=1e-12)
    # a cubic through the nodes is met between them, too, wherever it vanishes at ``none``
    fine = np.linspace(0.0, 1.0, 21)
    if len(axis.nodes) >= 4:
        cubic = (axis.nodes - axis.none) ** 3 - 0.2 * (axis.nodes - axis.none)
        np.testing.assert_allclose(
            axis.spline(fine) @ cubic, (fine - axis.none) ** 3 - 0.2 * (fine - axis.none), atol=1e-9
        )


def test_least_cost_of_linear_shifts_is_that_of_least_squares():
    """With shifts linear in their places, −2 φ·b + φᵀ G φ is |r − S z|² − |r|², whose least is known."""
    rng = np.random.default_rng(4)
    axes = [Axis(EFFECTS["spool_lag"], 0), Axis(EFFECTS["seal_friction"], 0)]
    directions = rng.standard_normal((50, 2))
    places = np.array([0.4, 0.7])
    residual = directions @ places + 0.01 * rng.standard_normal(50)
    columns = np.concatenate([np.outer(directions[:, k], axis.nodes) for k, axis in enumerate(axes)], axis=1)
    shift = Shift(axes, columns.T @ columns, columns.T @ residual)
    cost, found, information = shift.descend(shift.grid())
    best, square, *_ = np.linalg.lstsq(directions, residual, rcond=None)
    np.testing.assert_allclose(found, best, atol=1e-6)
    assert cost == pytest.approx(float(square[0]) - float(residual @ residual), rel=1e-9)
    np.testing.assert_allclose(information, directions.T @ directions, rtol=1e-9)


@pytest.mark.parametrize("information", [30.0, 3e3, 3e5])
@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_volume_is_the_integral_of_a_normal_over_the_range(information, place):
    """∫₀¹ exp(−½ I (z − ẑ)²) dz; the weak pull of the prior, I + 12, is what both differ by."""
    z = np.linspace(0.0, 1.0, 200_001)
    exact = np.log(np.trapezoid(np.exp(-0.5 * (information + PRIOR_INFORMATION) * (z - place) ** 2), z))
    assert _volume([place], np.array([[information]])) == pytest.approx(exact, abs=1e-4)


KEYS = ("oil.bulk_modulus", "steering.cylinder.seal_preload", "joint.friction_torque")
CANDIDATES = {name: EFFECTS[name] for name in ("spool_lag", "command_delay", "entrained_air", "pump_limit")}
BLANKS = [blank("left", turn(1.0, 2.4), -0.5), blank("right", turn(-0.5, 2.2), 0.5)]
ERROR = ModelError(rate=0.002, pressure=0.01)


@pytest.fixture(scope="module")
def commissioned():
    """A machine, and prior standard deviations of a few nuisances once it is commissioned."""
    machine = Machine.load("aoro")
    spread = []
    for key in KEYS:
        low, high = (Space(machine, [key]).point(machine.set({key: v})) for v in machine.entries[key].commissioned)
        spread.append(float((high - low)[0]) / (2 * 1.96))
    return machine, np.array(spread)


@pytest.mark.parametrize(("effect", "magnitude"), [(None, 0.0), ("spool_lag", 0.02)])
def test_the_given_cause_is_named(commissioned, effect, magnitude):
    """Logs of the twin itself, with noise and a draw of the nuisances: the model is right, so what is true must be likelier
    than all else together, its fit must pass, and the magnitude be right within a twentieth."""
    machine, spread = commissioned
    rng = np.random.default_rng(7)
    plain = Problem(machine, BLANKS, CANDIDATES, keys=KEYS, spread=spread, error=ERROR)
    names = () if effect is None else (effect,)
    place = np.array([[Axis(EFFECTS[name], 0).place(magnitude) for name in names]])
    truth = plain.variants(rng.standard_normal((1, len(KEYS))), names, place)

    problem = Problem(machine, record(truth, BLANKS, rng), CANDIDATES, keys=KEYS, spread=spread, error=ERROR)
    best = attribute(problem)[0]
    assert best.effects == names, best
    assert best.probability > 0.5
    assert problem.fit_p(best) > 0.01
    for name, found in zip(names, best.places, strict=True):
        assert Axis(EFFECTS[name], 0).value(found) == pytest.approx(magnitude, rel=0.05)
