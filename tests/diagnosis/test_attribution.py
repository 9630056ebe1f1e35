"""Attribution: the algebra against closed forms in a linear world, and causes that the twin itself was given."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from aoro_gym.diagnosis.attribution import (
    Fit,
    Trust,
    log_priors,
    tempering,
)
from aoro_gym.diagnosis.axes import PRIOR_INFORMATION
from aoro_gym.diagnosis.linear import Beside, Hypothesis, Linear, Misfit, Tangent
from aoro_gym.diagnosis.noise import MERGED, Floats, ModelError, Noise
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.replay import USUAL, Steps, Variants
from aoro_gym.diagnosis.search import ALL, DAMPING, SETTLED, Search, refine, trade
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import blank, record, turn

EXACT = Trust(1.0, 0.0, dict.fromkeys(("angle", "pressure"), Fit(1.0, 1.0, 0.1)), {"angle": 1.0, "pressure": 1.0})
"""Of logs whose error is that of the model."""

# ---- a linear world ----

COUNT = 100
"""Samples of a recording."""
STD = {"joint_angle": 2e-3, "pressure_a": 0.5e5}
"""Of white noise [SI]."""
NAMES = ("spool_lag", "seal_friction")
"""Effects whose axes begin at none."""
NUISANCES: Any = SimpleNamespace(
    keys=("first", "second", "third"), place=np.full(3, 0.5), std=np.full(3, 0.05), correlation=np.eye(3),
    ends=(np.zeros(3), np.ones(3)),
)  # fmt: skip


class LinearWorld(Problem):
    """Recordings of a world in which nuisances and effects each shift the prediction along a direction of their own.

    Args:
        rng: Draws the directions and the noise.
        nuisances: True ones (3,), in prior standard deviations.
        places: True ones of both effects.
        error: The twin's own, as assumed.
        beyond: Added to the angle (COUNT,): what nothing explains.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        *,
        nuisances: Sequence[float] = (0.0, 0.0, 0.0),
        places: Sequence[float] = (0.0, 0.0),
        error: ModelError,
        beyond: Floats | float = 0.0,
    ):
        time = np.linspace(0.0, 1.0, COUNT)
        scale = np.concatenate([np.full(COUNT, STD["joint_angle"]), np.full(COUNT, STD["pressure_a"])])
        self.base = np.concatenate([0.3 * time**2, 60e5 * np.sin(np.pi * time)])
        waves = np.sin(np.outer(np.tile(time, 2), np.pi * np.arange(1, 6))) @ rng.standard_normal((5, 5))
        self.directions = scale[:, None] * waves
        """Of the nuisances, then of the effects; in noise's standard deviations a few at one of theirs."""
        self.directions[:, 3:] *= 10.0
        truth = (
            self.base + self.directions @ np.concatenate([nuisances, places]) + scale * rng.standard_normal(2 * COUNT)
        )
        channels = {"joint_angle": truth[:COUNT] + beyond, "pressure_a": truth[COUNT:]}
        recording = Recording("linear", np.zeros((COUNT - 1, 2)), channels, 30, 0.0)
        noise = {name: Noise(np.r_[std**2, np.zeros(COUNT)]) for name, std in STD.items()}
        super().__init__([recording], NUISANCES, {name: EFFECTS[name] for name in NAMES}, error=error, noise=noise)

    def at(self, points: Floats, effects: Sequence[str] = (), places: Floats | None = None) -> Any:
        whole = np.zeros((len(points), 5))
        whole[:, self.felt] = points[:, : len(self.felt)]
        for column, name in enumerate(effects):
            assert places is not None
            whole[:, 3 + NAMES.index(name)] = places[:, column]
        return SimpleNamespace(count=len(points), whole=whole)

    def shown(
        self, variants: Sequence[Any], steps: Steps = USUAL
    ) -> Iterator[tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]]:
        predicted = self.base[:, None] + self.directions @ np.concatenate([one.whole for one in variants]).T
        channels: dict[str, NDArray[Any]] = {"joint_angle": predicted[:COUNT], "pressure_a": predicted[COUNT:]}
        yield channels, np.zeros(predicted.shape[1], dtype=bool)


MEAN = np.kron(np.eye(2 * COUNT // MERGED), np.full((1, MERGED), 1.0 / MERGED))
"""Merges stacked samples."""


def dense(world: LinearWorld, linear: Linear) -> tuple[Floats, Floats, Floats, Floats]:
    """Merged residual of the prediction without nuisances (n,), what nuisances do to it (n, u), the covariance of all that
    has no cause (n, n), and what the effects do (n, 2)."""
    own = world.own(world.predicted)
    jacobian = MEAN @ np.concatenate([world.directions[:, world.felt], own], axis=1)
    noise: Floats = np.asarray(block_diag(*(w.factor @ w.factor.T for w in linear.whiteners)))
    return MEAN @ (world.measured - world.base), jacobian, noise, MEAN @ world.directions[:, 3:]


def log_density(residual: Floats, covariance: Floats) -> float:
    """Of a normal, without its factors 2 π."""
    return float(-0.5 * residual @ np.linalg.solve(covariance, residual) - 0.5 * np.linalg.slogdet(covariance)[1])


@pytest.fixture(scope="module")
def world():
    """A learned one, its centre off its machine, with both effects."""
    world = LinearWorld(
        np.random.default_rng(1),
        nuisances=(0.5, -1.0, 0.3),
        places=(0.3, 0.6),
        error=ModelError(0.01, 0.01, 0.02, 0.05),
    )
    world.centre = np.random.default_rng(2).standard_normal(len(world.centre))
    world.learn()
    assert len(world.felt) == 3
    return world


def test_evidence_of_nuisances_is_a_normal_density(world):
    linear = Linear(world, world.error)
    residual, jacobian, noise, _ = dense(world, linear)
    assert linear.evidence() == pytest.approx(log_density(residual, noise + jacobian @ jacobian.T), abs=1e-6)


def test_a_larger_error_of_the_twin_costs_its_volume(world):
    """Evidences under different errors of the twin compare: their constants are all there."""
    for change in (0.3, 1.2):
        linear = Linear(world, ModelError(0.02, 0.03, 0.02, change), effects=False)
        residual, jacobian, noise, _ = dense(world, linear)
        assert linear.evidence() == pytest.approx(log_density(residual, noise + jacobian @ jacobian.T), abs=1e-6)


@pytest.mark.parametrize("number", [0, 1])
def test_evidence_of_an_effect_is_the_mean_density_over_its_range(number):
    """∫₀¹ p(y | z) dz by quadrature, the best place far from both ends. Laplace's sum has the information I of the
    recordings and 12 of the prior, which takes ½ ln(1 + 12 / I)."""
    world = LinearWorld(
        np.random.default_rng(4), places=(0.5 * np.eye(2)[number]).tolist(), error=ModelError(0.01, 0.01, 0.02, 0.05)
    )
    world.learn()
    linear = Linear(world, world.error)
    residual, jacobian, noise, shifts = dense(world, linear)
    covariance = noise + jacobian @ jacobian.T
    found = linear.screen()
    shift = shifts[:, number]
    information = shift @ np.linalg.solve(covariance, shift)
    assert 6.0 / np.sqrt(information) < 0.5, "the ends of the range would count"
    coarse, places = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 4001)
    # the logarithm is a parabola
    logs = np.polynomial.Polynomial.fit(coarse, [log_density(residual - z * shift, covariance) for z in coarse], 2)(
        places
    )
    exact = np.log(np.trapezoid(np.exp(logs - logs.max()), places)) + logs.max()
    evidence = found[(NAMES[number],)].log_evidence
    assert evidence == pytest.approx(exact - 0.5 * np.log1p(PRIOR_INFORMATION / information), abs=1e-4)
    assert found[()].log_evidence == pytest.approx(log_density(residual, covariance), abs=1e-6)


def test_evidence_of_a_pair_is_that_of_a_normal_over_both_ranges(world):
    """Far from the ends: the density at the best places times √|2 π I⁻¹|."""
    linear = Linear(world, world.error)
    residual, jacobian, noise, shifts = dense(world, linear)
    covariance = noise + jacobian @ jacobian.T
    information = shifts.T @ np.linalg.solve(covariance, shifts)
    best = np.linalg.solve(information, shifts.T @ np.linalg.solve(covariance, residual))
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    assert np.all((best > 4.0 * std) & (best < 1.0 - 4.0 * std))
    pair = linear.screen()[NAMES]
    np.testing.assert_allclose(pair.places, best, atol=1e-6)
    inner = information + PRIOR_INFORMATION * np.eye(2)
    exact = (
        log_density(residual - shifts @ best, covariance)
        + 0.5 * np.linalg.slogdet(2.0 * np.pi * np.linalg.inv(inner))[1]
    )
    assert pair.log_evidence == pytest.approx(exact, abs=1e-3)
    np.testing.assert_allclose(pair.covariance, np.linalg.inv(inner), rtol=1e-6)


def test_what_explains_most_if_effects_add_up_is_found_at_nodes(world):
    """By hand: over all nodes of both effects, and all pairs of them, where nuisances follow, and where those of the machine
    stay at the centre and only the recording's own follow. Effects that explain less than asked are not given, nor pairs
    that explain no more than an effect."""
    linear = Linear(world, world.error)
    residual, jacobian, noise, shifts = dense(world, linear)
    felt = len(world.felt)
    own = jacobian[:, felt:] @ np.linalg.solve(world.precision[felt:, felt:], jacobian[:, felt:].T)
    views = (
        (residual, noise + jacobian @ jacobian.T),
        (residual - jacobian[:, :felt] @ world.centre[:felt], noise + own),
    )
    places = [[axis.none, *axis.nodes] for name in NAMES for axis in world.axes[name]]
    assert places[0][0] == places[1][0] == 0.0
    expected: dict[tuple[str, ...], set[tuple[float, ...]]] = {}
    for target, covariance in views:
        left = target[:, None] - shifts @ np.array([(a, b) for a in places[0] for b in places[1]]).T
        squares = np.sum(left * np.linalg.solve(covariance, left), axis=0).reshape(len(places[0]), len(places[1]))
        gains = squares[0, 0] - squares
        first, second, both = gains[1:, 0], gains[0, 1:], gains[1:, 1:]
        i, j = np.unravel_index(np.argmax(both), both.shape)
        for effects, gain, at, least in (
            (NAMES[:1], first.max(), (places[0][1 + np.argmax(first)],), 1.0),
            (NAMES[1:], second.max(), (places[1][1 + np.argmax(second)],), 1.0),
            (NAMES, both.max(), (places[0][1 + i], places[1][1 + j]), 1.0 + max(first.max(), second.max())),
        ):
            if gain > least:
                expected.setdefault(effects, set()).add(at)
    assert NAMES in expected and NAMES[:1] not in expected
    assert {effects: set(found) for effects, found in linear.likely(2, 1.0).items()} == expected
    assert linear.likely(2, 1e9) == {} == linear.likely(0, 1.0)


def least_squares(world: LinearWorld, linear: Linear, effects: Sequence[str]) -> tuple[Floats, Floats, float]:
    """Nuisances (u,), places and least cost of the whitened squares, priors included."""
    residual, jacobian, noise, shifts = dense(world, linear)
    root = np.linalg.cholesky(noise)
    columns = np.concatenate([jacobian, shifts[:, [NAMES.index(name) for name in effects]]], axis=1)
    prior = np.eye(jacobian.shape[1], columns.shape[1])
    whole = np.concatenate([np.linalg.solve(root, columns), prior])
    target = np.concatenate([np.linalg.solve(root, residual), np.zeros(len(prior))])
    found, square, *_ = np.linalg.lstsq(whole, target, rcond=None)
    return found[: len(prior)], found[len(prior) :], float(square[0])


def refined(linear: Linear, *starts: Hypothesis, directions: int = ALL) -> list[Hypothesis]:
    searches = [Search(linear, h.effects, [h.places], directions=directions) for h in starts]
    refine(searches, 6)
    assert all(search.done for search in searches)
    return [search.weighed() for search in searches]


@pytest.mark.parametrize("effects", [NAMES[:1], NAMES])
def test_a_search_stays_within_the_range(effects):
    """The best place of the first effect lies beyond: the search ends at the end, and the rest is the best there."""
    places = [1.4, 0.5 if len(effects) == 2 else 0.0]
    world = LinearWorld(np.random.default_rng(3), places=places, error=ModelError(0.0, 0.0))
    world.learn()
    linear = Linear(world, world.error)
    assert least_squares(world, linear, effects)[1][0] > 1.2
    (found,) = refined(linear, Hypothesis(effects, 0.0, (0.5,) * len(effects)))
    residual, jacobian, noise, shifts = dense(world, linear)
    inner = np.linalg.inv(noise + jacobian @ jacobian.T)
    left, other = residual - shifts[:, 0], shifts[:, 1]
    best = [1.0, (other @ inner @ left) / (other @ inner @ other)][: len(effects)]
    left = left - other * sum(best[1:])
    np.testing.assert_allclose(found.places, best, atol=1e-6)
    assert found.cost == pytest.approx(left @ inner @ left, rel=1e-6)


def test_more_effects_fit_no_worse(world):
    linear = Linear(world, world.error)
    found = {h.effects: h for h in refined(linear, *linear.screen().values())}
    for name in NAMES:
        assert found[NAMES].cost <= found[(name,)].cost + SETTLED <= found[()].cost + 2.0 * SETTLED


def test_searches_trade_what_they_find():
    """Of three that have gone no step, one is told the answer: the pair takes the places of its part, nothing its nuisances,
    and none of them is worse than before."""
    error = ModelError(0.0, 0.0)
    world = LinearWorld(np.random.default_rng(6), nuisances=(0.5, -1.0, 0.3), places=(0.4, 0.0), error=error)
    world.learn()
    linear = Linear(world, world.error)
    searches = {e: Search(linear, e, [(0.9,) * len(e)]) for e in ((), NAMES[:1], NAMES)}
    refine(list(searches.values()), 0)
    before = {e: one.cost for e, one in searches.items()}
    (best,) = refined(linear, Hypothesis(NAMES[:1], 0.0, (0.5,)))
    told = searches[NAMES[:1]]
    told.point, told.cost = (best.nuisances, np.array(best.places)), best.cost
    trade(list(searches.values()))
    assert searches[NAMES].cost == pytest.approx(told.cost, rel=1e-9)
    assert searches[NAMES].point[1].tolist() == [*best.places, 0.0]
    assert searches[()].cost <= before[()]


@pytest.mark.parametrize("places", [(0.3, 0.6), (0.6, 0.3)])
def test_a_partner_is_found_beside_where_its_leader_has_come_to(places):
    """In a linear world where both end: what the leader and the nuisances did in the partner's stead is taken back."""
    world = LinearWorld(np.random.default_rng(1), nuisances=(0.5, -1.0, 0.3), places=places, error=ModelError(0.0, 0.0))
    world.learn()
    linear = Linear(world, world.error)
    both, *leaders = refined(linear, *(Hypothesis(e, 0.0, (0.5,) * len(e)) for e in (NAMES, NAMES[:1], NAMES[1:])))
    for number, ahead in enumerate(linear.beside(leaders)):
        assert ahead.leader is leaders[number]
        ((effects, found),) = ahead.partners()
        assert effects == NAMES
        assert found[number] == leaders[number].places[0]
        assert found[1 - number] == pytest.approx(both.places[1 - number], abs=5e-3)
        np.testing.assert_allclose(
            ahead.left(NAMES, np.array(found)),
            ahead.target - linear.shift(effects, np.array(found))[1 - number],
            atol=1e-6,
        )


def test_the_more_nuisances_are_strained_and_the_more_others_explain_the_less_the_evidence_counts():
    """Of the likeliest hypothesis: 2 and −1 standard deviations of a prior that correlates them by a half have the square
    (4 + 2 + 1) / 0.75, a mean of 14/3. Less than usual is as good as usual, and others count only where they are asked."""
    precision = np.linalg.inv([[1.0, 0.5], [0.5, 1.0]])
    tangent = Tangent(np.zeros((3, 2)), precision, (np.full(2, -np.inf), np.full(2, np.inf)))
    bent = Hypothesis(
        (), 0.0, nuisances=np.array([2.0, -1.0]), left=np.zeros(3), slopes=np.zeros((3, 0)), tangent=tangent
    )
    assert bent.strain == pytest.approx(14.0 / 3.0)
    assert Hypothesis((), 0.0).strain == 0.0

    beside = Beside(bent, (), {}, {})
    strained = Trust(2.0, 0.0, strain=3.0, usual=0.5)
    assert strained.beside(beside).bent == pytest.approx(3.0 * (28.0 / 3.0 - 1.0))
    assert replace(strained, usual=5.0).beside(beside).bent == 0.0
    assert Trust(2.0, 0.0, others=0.5).beside(beside).bent == 0.0, "there are no others"
    for excess, bent in ((5.0, 2.0), (0.4, 0.0)):
        beside.__dict__["excess"] = excess
        assert Trust(2.0, 0.0, others=0.5).beside(beside).bent == pytest.approx(bent)

    bound = Trust(2.0, 0.01, half=30.0, bent=8.0)
    for ahead, temperature in ((-5.0, 2.0), (0.0, 2.0), (30.0, 6.3), (270.0, 11.9)):  # 2 + 8 a / (a + 30) + 0.01 a
        hypotheses = [Hypothesis((), 7.0), Hypothesis(("payload",), 7.0 + ahead)]
        assert tempering(hypotheses, bound) == pytest.approx(temperature)


@pytest.mark.parametrize("mine", [NAMES[:1], NAMES], ids="+".join)
def test_an_offer_makes_up_for_what_only_one_of_the_two_has(mine):
    """In a linear world, where slopes hold everywhere: an effect's nuisances make up at once for the other effect of a pair,
    and those of a pair give way at once to what it has beside its part."""
    world = LinearWorld(
        np.random.default_rng(6), nuisances=(0.5, -1.0, 0.3), places=(0.4, 0.3), error=ModelError(0.0, 0.0)
    )
    world.learn()
    linear = Linear(world, world.error)
    done = {e: Search(linear, e, [(0.5,) * len(e)], directions=ALL) for e in (NAMES[:1], NAMES)}
    refine(list(done.values()), 6)
    one, donor = done[mine], done[NAMES if len(mine) == 1 else NAMES[:1]]
    residual, jacobian, noise, shifts = dense(world, linear)
    inner = np.linalg.inv(noise + jacobian @ jacobian.T)
    left, other = residual - shifts[:, 0] * donor.point[1][0], shifts[:, 1]
    # what is best beside the donor's, which is better than none
    places = np.array([donor.point[1][0], (other @ inner @ left) / (other @ inner @ other)])[: len(mine)]
    one.point, one.cost = (np.full(len(world.centre), 3.0), places), np.inf
    one.offered([donor])
    refine([one], 0)
    left = left - other * sum(places[1:])
    assert one.cost == pytest.approx(left @ inner @ left, rel=1e-6)


class SwayingWorld(LinearWorld):
    """The first nuisance makes the joint faster, and with it the sway of its pressure, by a tenth a standard deviation: it
    sways ten times, so that a step of one shifts it by a period."""

    def __init__(self, truth: float):
        super().__init__(np.random.default_rng(6), error=ModelError(0.003, 0.01, 0.06, 0.1, 0.05))
        angle, pressure = self._of(np.array([truth]))
        channels = {"joint_angle": angle[:, 0], "pressure_a": pressure[:, 0]}
        self.recordings = (replace(self.recordings[0], channels=channels),)

    def _of(self, nuisance: Floats) -> tuple[Floats, Floats]:
        course = np.linspace(0.0, 1.0, COUNT)[:, None] * (1.0 + 0.1 * nuisance)
        return 0.3 * course, 60e5 * np.sin(20.0 * np.pi * course) * np.minimum(course, 0.1) / 0.1

    def shown(
        self, variants: Sequence[Any], steps: Steps = USUAL
    ) -> Iterator[tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]]:
        angle, pressure = self._of(np.concatenate([one.whole[:, 0] for one in variants]))
        yield {"joint_angle": angle, "pressure_a": pressure}, np.zeros(angle.shape[1], dtype=bool)


class BentWorld(LinearWorld):
    """The pressure follows the square of what it would follow, so that slopes change along the way."""

    def shown(
        self, variants: Sequence[Any], steps: Steps = USUAL
    ) -> Iterator[tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]]:
        for signals, stops in super().shown(variants, steps):
            yield signals | {"pressure_a": signals["pressure_a"] + signals["pressure_a"] ** 2 / 3e5}, stops


def test_slopes_bend_to_what_a_step_has_done():
    """The secant condition (Broyden 1965): along the step, changed slopes promise what it did."""
    world = BentWorld(
        np.random.default_rng(6), nuisances=(0.5, -1.0, 0.3), places=(0.4, 0.0), error=ModelError(0.0, 0.0)
    )
    world.learn()
    search = Search(Linear(world, world.error), NAMES[:1], [(0.9,)], directions=ALL)
    refine([search], 0)
    search.resume()
    search.learn(world.residuals(search.linear.whiteners, [search.variants()]))  # slopes
    before, residual, slopes = search.point, search.residual, search.slopes
    steps = search.variants()
    assert steps.count == len(DAMPING)
    search.learn(world.residuals(search.linear.whiteners, [steps]))
    moved, along = (after - one for after, one in zip(search.point, before, strict=True))
    assert np.any(moved != 0.0) and np.any(along != 0.0)
    promised = search.tangent.moved(moved) + search.slopes @ along
    np.testing.assert_allclose(promised, residual - search.residual, rtol=1e-9, atol=1e-9 * np.abs(promised).max())
    assert np.linalg.norm(search.slopes - slopes) > 1e-3 * np.linalg.norm(slopes)
    search.trying = True  # as if there were more to be gained
    assert search.variants().count <= 3, "the next are damped much like the best one"


def test_a_machine_that_is_lost_is_no_way():
    """Its residuals are NaN, and only its: the others are those that they are without it."""

    class Losing(LinearWorld):
        def shown(
            self, variants: Sequence[Any], steps: Steps = USUAL
        ) -> Iterator[tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]]:
            for signals, stops in super().shown(variants, steps):
                signals["pressure_a"] = np.where(np.arange(stops.size) == 1, np.nan, signals["pressure_a"])
                yield signals, stops

    worlds = [kind(np.random.default_rng(6), error=ModelError(0.0, 0.0)) for kind in (LinearWorld, Losing)]
    points = np.zeros((4, len(worlds[0].centre)))
    points[:, 0] = [0.0, 1.0, 2.0, 3.0]
    sound, lossy = (world.residuals(world.held(world.error), [world.at(points)]) for world in worlds)
    assert np.isnan(np.sum(lossy[:, 1]))
    np.testing.assert_array_equal(np.delete(lossy, 1, axis=1), np.delete(sound, 1, axis=1))
    world = worlds[1]
    world.learn(effects=False)
    search = Search(Linear(world, world.error, effects=False), (), directions=ALL)
    refine([search], 2)
    assert np.isfinite(search.cost)


def test_whiteners_are_held_until_what_they_rest_on_moves():
    """The same for all who ask; others once the twin that they are held to, or the noise, is another."""
    world = LinearWorld(np.random.default_rng(1), error=ModelError(0.01, 0.01, 0.02, 0.05))
    world.learn()
    held = world.held(world.error)
    assert world.held(ModelError(0.01, 0.01, 0.02, 0.05)) is held
    noise = world.louder()
    assert world.noise is noise and world.held(world.error) is not held
    again = world.held(world.error)
    world.hold_to(world.centre + 1.0)
    assert world.held(world.error) is not again


@pytest.mark.parametrize("factor", [0.12, 0.5, 1.0, 4.0])
def test_an_error_other_than_assumed_is_found_and_counted(factor: float):
    """Residuals drawn from ``factor`` times the assumed error, by channel: the likeliest of :data:`MISFITS` is the true one,
    with which they are white again. Of n samples, a factor twice as large or half as large is less likely by
    n (ln 2 - 3/8) or n (3/2 - ln 2) nats on average, eight or more here, so that chance hardly finds another."""
    error, rng, count = ModelError(0.05, 0.05, 0.1), np.random.default_rng(3), 40
    found: dict[str, list[float]] = {name: [] for name in STD}
    again: dict[str, list[float]] = {name: [] for name in STD}
    for seed in range(count):
        world = LinearWorld(np.random.default_rng(seed), error=error)
        world.sound = True
        world.noise = {name: Noise(1e-6 * noise.covariance) for name, noise in world.noise.items()}
        world.predicted = world.base
        whiteners = world.whiteners(error.scaled(factor), world.base)
        drawn = [np.repeat(w.factor @ rng.standard_normal(len(w.factor)), MERGED) for w in whiteners]
        vars(world)["measured"] = world.base + np.concatenate(drawn)
        for name, ratio in world.misfits().items():
            found[name].append(ratio)
        world.misfit = dict.fromkeys(STD, factor)
        for name, w, part in zip(STD, world.whiteners(error, world.base), drawn, strict=True):
            again[name].append(float(np.mean(w(part) ** 2)))
    for name in STD:
        assert np.mean(np.array(found[name]) == factor) > 0.9
        scatter = 4.0 * np.sqrt(2.0 / (count * COUNT // MERGED))  # of a mean of squares of so many normal numbers
        assert np.mean(again[name]) == pytest.approx(1.0, rel=scatter)


def test_sways_of_a_machine_that_may_differ_are_as_uncertain_as_was_assumed():
    """However well its healthy logs were fitted, which are held to the error that was found in them."""
    error = ModelError(0.0, 0.0, swing=0.1, phase=0.05, sways=1.0)
    world = LinearWorld(np.random.default_rng(1), error=error)
    expected = {}
    for world.sound, factor in ((False, 1.0), (True, 0.1)):
        expected[world.sound] = world.whiteners(error.scaled(factor), world.base)
    world.misfit = dict.fromkeys(STD, 0.1)
    for world.sound, those in expected.items():
        for one, other in zip(world.whiteners(error, world.base), those, strict=True):
            np.testing.assert_allclose(one.factor, other.factor)
    pressure = list(STD).index("pressure_a")
    assert np.trace(expected[False][pressure].factor) > np.trace(expected[True][pressure].factor)


def test_nuisances_are_those_of_the_same_machine_in_another_problem():
    """A wider prior has larger standard deviations, and feels more."""
    machine = Machine.load("aoro")
    logs = record(Variants(machine), BLANKS[:1], np.random.default_rng(2))
    narrow, wide = (Problem(logs, Nuisances(machine, spread), {}, error=ERROR) for spread in ("day", "recalibration"))
    for problem in (narrow, wide):
        problem.learn()
    search = Search(Linear(narrow, narrow.error), ())
    search.point = np.random.default_rng(3).uniform(-0.5, 0.5, len(narrow.centre)), np.empty(0)
    there = search.nuisances_of(wide)
    assert set(narrow.felt) <= set(wide.felt)
    mine, its = narrow.at(search.point[0][None]).machine, wide.at(there[None]).machine
    for key in narrow.nuisances.keys:
        assert its.value(key) == pytest.approx(mine.value(key), rel=1e-9), key
    own = len(narrow.centre) - len(narrow.felt)
    np.testing.assert_array_equal(there[-own:], search.point[0][-own:])


def test_every_hypothesis_of_a_catalogue_has_a_prior():
    """Also pairs that no screening had thought of; together they are sure."""
    prior = log_priors(EFFECTS)
    assert len(prior) == 1 + len(EFFECTS) + len(EFFECTS) * (len(EFFECTS) - 1) // 2 + 2
    assert np.sum(np.exp(list(prior.values()))) == pytest.approx(1.0)


MANY = 10**9
"""Samples whose mean square does not scatter."""


NOISE = 0.4
"""What noise alone leaves of a mean square."""


def left(**misfit: Misfit) -> Hypothesis:
    """A cause that leaves so much."""
    return Hypothesis(("spool_lag",), 0.0, misfit=misfit)


@pytest.mark.parametrize("loud", [0.1, 1.0, 10.0])
def test_what_noise_alone_leaves_is_known(loud: float):
    """Noise is drawn that was not drawn for any fit, ``loud`` times the usual power, and whitened with the covariance of it
    and of the twin's own error: its mean square is, within four standard deviations of a mean of so many, what was said.
    An angle that has no error is white, and a pressure's is less so, the larger its error beside the noise."""
    world, count = LinearWorld(np.random.default_rng(3), error=ModelError(0.0, 0.01)), 400
    world.noise = {name: noise.inflated(loud) for name, noise in world.noise.items()}
    world.learn()
    linear = Linear(world, world.error)
    std = np.repeat([np.sqrt(loud) * STD[name] for name in STD], COUNT)
    drawn = std[:, None] * np.random.default_rng(8).standard_normal((2 * COUNT, count))
    found = [linear.misfit(one) for one in world.white(linear.whiteners, drawn).T]
    for kind in ("angle", "pressure"):
        squares = [one[kind].square for one in found]
        scatter = 4.0 * float(np.std(squares)) / np.sqrt(count)
        assert np.mean(squares) == pytest.approx(found[0][kind].noise, abs=scatter)
    assert found[0]["angle"].noise == pytest.approx(1.0)
    assert 0.0 < found[0]["pressure"].noise < 0.95


TRUE = (0.3, -0.5, 0.8)
KNOWN_LAWS: dict[str, Any] = {"temperature": 1.0, "doubt": 0.0, "sharpness": 1.0}
"""Trust where the evidence counts in full."""


# ---- logs of the twin itself ----

ERROR = ModelError(rate=0.002, pressure=0.01, swing=0.1, change=0.1)
CANDIDATES = {name: EFFECTS[name] for name in ("spool_lag", "entrained_air")}
BLANKS = [blank("left", turn(1.0, 1.6), -0.4), blank("right", turn(-0.5, 1.6), 0.4)]
