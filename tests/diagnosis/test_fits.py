"""Fits of sizes: on logs that a twin made, whose sizes are known, and on columns of numbers."""

from functools import cache

import numpy as np
import pytest

from aoro_gym.diagnosis.axes import Axis
from aoro_gym.diagnosis.fits import Fits, _known, _side, fit
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.replay import Variants
from aoro_gym.diagnosis.signatures import Nodes, axes_of, families_of, logs_of, nodes_on
from aoro_gym.diagnosis.sizes import CLOCK, Evidence, Interpolation, settled, weigh
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES
from tests.diagnosis.manoeuvres import blank, record, turn

MACHINE = Machine.load("aoro")
TRUE = MACHINE.with_laws("materials")
PRELOAD, COOLER = 1500.0, -12.0
BLANKS = [blank("left", turn(0.7, 2.5), -0.5), blank("right", turn(-0.6, 2.5), 0.4)]


def changed(name: str, *magnitudes: float) -> float:
    effect = EFFECTS[name]
    return float(effect.measured(MACHINE, *magnitudes)[0]) - float(effect.measured(MACHINE, *effect.none)[0])


@cache
def days() -> tuple[list[Recording], list[Recording], list[Recording]]:
    """Logs of a machine with laws that are not the twin's: healthy, with one effect and with two."""
    rng = np.random.default_rng(0)
    seals = (EFFECTS["seal_friction"], (PRELOAD,))
    both = [seals, (EFFECTS["oil_temperature"], (COOLER,))]
    return (
        record(Variants(TRUE), BLANKS, rng),
        record(Variants.of(TRUE, [seals], 1), BLANKS, rng),
        record(Variants.of(TRUE, both, 1), BLANKS, rng),
    )


@cache
def fitted() -> Fits:
    healthy, later, _ = days()
    return fit(MACHINE, later, healthy, [("seal_friction",), ("sensor_gain",)])


def test_the_size_is_found_under_other_laws_than_the_twins():
    """The interval, which holds other laws, holds the truth and not zero; the family that has the machine's laws finds the
    size but for noise of a hundredth of what it does."""
    found = fitted()["seal_friction",].changes["seal_friction"][0]
    truth = changed("seal_friction", PRELOAD)
    assert 0.0 < found.low90 <= truth <= found.high90
    assert fitted()["seal_friction",].settings["seal_friction"][0] == pytest.approx(PRELOAD, rel=0.05)
    assert fitted()["seal_friction",].family == "materials"
    assert set(fitted()["seal_friction",].misfits) == set(FAMILIES)


def test_the_gap_closes_on_logs_that_were_left_out():
    """With the very laws nearly all of it; the angle's gain explains nothing."""
    right = fitted()["seal_friction",]
    assert right.held_out_S is not None
    assert right.held_out_S > 0.9
    controls = fitted().controls(("seal_friction",))
    assert controls["cause"] == right.held_out_S
    assert controls["wrong_cause"] == fitted()["sensor_gain",].held_out_S
    assert controls["wrong_cause"] is not None
    assert controls["wrong_cause"] < 0.3
    assert {one.manoeuvre for one in right.shrinkage if one.held_out} == {"left", "right"}


def test_curves_and_places_say_what_the_logs_show():
    _, later, _ = days()
    curves = fitted()["seal_friction",].curves
    assert {(one.manoeuvre, one.signal) for one in curves} == {(r.name, c) for r in later for c in r.channels}
    for one in curves:
        measured = next(r for r in later if r.name == one.manoeuvre).channels[one.signal]
        assert np.array_equal(one.measured, measured)
    gap = next(one for one in curves if one.manoeuvre == "left" and one.signal == "pressure_a")
    counts = np.isfinite(gap.spread)
    assert np.std((gap.measured - gap.after)[counts]) < 0.3 * np.std((gap.measured - gap.before)[counts])
    shares = [place.share for place in fitted().places]
    assert shares == sorted(shares, reverse=True)
    assert 0.9 < sum(shares) <= 1.0 + 1e-9


def test_two_effects_are_fitted_together(tmp_path):
    """Both intervals hold their truths; the file holds the machine with both, and gives the settings back."""
    healthy, _, later = days()
    cause = ("seal_friction", "oil_temperature")
    (found,) = fit(MACHINE, later, healthy, [cause], out=tmp_path).causes
    for name, size in zip(cause, (PRELOAD, COOLER), strict=True):
        part = found.changes[name][0]
        assert part.low90 <= changed(name, size) <= part.high90
    saved = Machine.load(tmp_path / found.machine_file)
    own = families_of(MACHINE)[found.family]
    for name in cause:
        own = EFFECTS[name].apply(own, *found.settings[name])
    for key in ("steering.cylinder.seal_preload", "oil.temperature"):
        if key in saved.entries:
            assert saved.value(key) == pytest.approx(own.value(key), rel=1e-6)
    assert saved.laws.names == own.laws.names


def test_without_healthy_logs_the_twin_stands_for_them():
    """The machine has the twin's laws, so that nothing else differs."""
    rng = np.random.default_rng(1)
    later = record(Variants.of(MACHINE, [(EFFECTS["seal_friction"], (PRELOAD,))], 1), BLANKS, rng)
    (found,) = fit(MACHINE, later[:1], (), [("seal_friction",)], held_out=later[1:]).causes
    part = found.changes["seal_friction"][0]
    assert part.low90 <= changed("seal_friction", PRELOAD) <= part.high90
    assert {one.manoeuvre for one in found.shrinkage if one.held_out} == {"right"}
    assert {one.manoeuvre for one in found.shrinkage if not one.held_out} == {"left"}
    assert found.held_out_S is not None
    assert found.held_out_S > 0.9


def test_no_log_is_an_error():
    with pytest.raises(ValueError, match="no recording of the later day"):
        fit(MACHINE, [])


def test_logs_are_paired_by_their_commands():
    """A healthy log that began earlier is read beside the later one's samples."""
    later = blank("later", turn(0.7, 2.5), -0.5)
    early = np.vstack([np.zeros((20, 2)), later.commands])
    healthy = [blank("other", turn(-0.7, 2.5), 0.5), blank("healthy", early, -0.5)]
    (log,) = logs_of([later], healthy)
    assert log.healthy is healthy[1]
    assert np.array_equal(log.beside, np.arange(later.ticks + 1) + 20)
    (alone,) = logs_of([later], healthy[:1])
    assert alone.healthy is None


def test_one_side_is_simulated_where_the_sign_is_known():
    """A spool that follows more slowly has a factor below one and a smaller rate."""
    effect = EFFECTS["spool_rate"]
    none = float(effect.measured(MACHINE, 1.0)[0])
    assert _side(effect, MACHINE, np.array([-0.5, -0.4, -0.3, -0.2, -0.1]) * none) == -1
    assert _side(effect, MACHINE, np.array([0.1, 0.2, 0.3, 0.4, 0.5]) * none) == 1
    assert _side(effect, MACHINE, np.array([-0.1, 0.0, 0.1, 0.2, 0.3]) * none) == 0
    (axis,) = axes_of(effect, -1)
    assert np.all(nodes_on(axis, -1) < axis.none)
    assert len(nodes_on(axis, -1)) == len(axis.shares)


def test_known_quantiles_cost_half_the_square_of_their_score():
    effect = EFFECTS["seal_friction"]
    quantiles = [changed("seal_friction", preload) for preload in (800.0, 1000.0, 1200.0, 1500.0, 1900.0)]
    axes = axes_of(effect)
    cost = _known(effect, MACHINE, axes, quantiles)
    assert cost is not None
    where = np.array([[float(axes[0].place(preload))] for preload in (800.0, 1200.0, 1500.0, 1900.0)])
    assert cost(where) == pytest.approx([0.5 * 1.645**2, 0.0, 0.5 * 0.674**2, 0.5 * 1.645**2], abs=0.02)
    assert _known(effect, MACHINE, axes, None) is None


TIME = np.linspace(0.0, 5.0, 500)
SHAPE = np.sin(3.0 * TIME)


def of_numbers(size: float, clock: float, zero: float) -> tuple[Evidence, Interpolation]:
    """One block, with an effect that is as large as the place on its axis, a clock and a zero, and without noise."""
    axis = Axis(EFFECTS["seal_friction"], 0, (0.5, 1.0))
    nodes = Nodes((axis,), (axis.nodes,), ((SHAPE[:, None] * axis.nodes,),))
    slope = np.cos(7.0 * TIME) / CLOCK
    change = size * SHAPE + clock * slope + zero
    return Evidence.of([0], [np.column_stack([change, nodes.shifts[0][0], slope])], [1e-4], [10.0]), Interpolation(
        [nodes]
    )


def equal(places):
    return np.zeros(len(places))


@pytest.mark.parametrize(("clock", "zero"), [(0.0, 0.0), (0.5 * CLOCK, 0.0), (0.0, 3.0)])
def test_sizes_are_told_apart_from_clocks_and_zeros(clock, zero):
    """The best place is the size, but for the grid and for the little that priors of clock and zero hold back."""
    evidence, interpolation = of_numbers(0.37, clock, zero)
    scale = settled(evidence, interpolation, equal)
    found = weigh(evidence, interpolation, equal, scale, np.array([True]))
    assert found.best[0] == pytest.approx(0.37, abs=0.01)
    _, clocks = evidence.residuals(interpolation(found.best[None]), scale)
    assert clocks[0, 0] == pytest.approx(clock, abs=0.02 * CLOCK)


def test_what_is_known_beforehand_moves_a_size_that_logs_do_not_tell():
    """With residuals far below the floor only the prior's valley is left."""
    evidence, interpolation = of_numbers(0.0, 0.0, 0.0)
    deaf = Evidence(
        evidence.logs, evidence.squares, evidence.means, 1e9 * evidence.floors, evidence.zeros, evidence.pieces
    )

    def prior(places):
        return 0.5 * np.square((places[:, 0] - 0.6) / 0.05)

    scale = settled(deaf, interpolation, prior)
    found = weigh(deaf, interpolation, prior, scale, np.array([True]))
    assert found.best[0] == pytest.approx(0.6, abs=0.005)
    chances = np.exp(-(found.costs - found.least))
    spread = np.sqrt(np.sum(chances * (found.places[:, 0] - 0.6) ** 2) / np.sum(chances))
    assert spread == pytest.approx(0.05, rel=0.05)
