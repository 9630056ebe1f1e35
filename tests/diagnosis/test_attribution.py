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
    ASIDE,
    HOTTEST,
    SWAYS,
    TRUST,
    USUAL_MISFIT,
    Fit,
    Trust,
    attribute,
    beyond,
    fit_p,
    fitting,
    log_priors,
    tempering,
    trust_of,
    ways_of,
    weigh,
    without,
)
from aoro_gym.diagnosis.axes import PRIOR_INFORMATION, Axis, axes_of
from aoro_gym.diagnosis.cross_entropy import Population, evolve
from aoro_gym.diagnosis.linear import Beside, Hypothesis, Linear, Misfit, Tangent
from aoro_gym.diagnosis.noise import MERGED, Floats, ModelError, Noise
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem, references_of
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.replay import USUAL, Steps, Variants
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN
from aoro_gym.diagnosis.search import ALL, DAMPING, EASED, ROUGH, SETTLE, SETTLED, Search, alone, refine, settle, trade
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


@pytest.mark.parametrize("effects", [NAMES[:1], NAMES], ids="+".join)
def test_populations_come_to_the_places_of_effects(effects):
    """From a few spreads off, to where slopes take over: a tenth of the range of effects that are tens of noises long."""
    truth = [0.8, 0.6 * (len(effects) - 1)]
    world = LinearWorld(np.random.default_rng(8), places=truth, error=ModelError(0.0, 0.0))
    start = np.zeros(len(world.centre)), np.array([0.5, 0.3])[: len(effects)]
    population = Population(world, effects, start)
    evolve([population, Population(world, size=16)])
    np.testing.assert_allclose(population.best[1], truth[: len(effects)], atol=0.1)


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


@pytest.mark.parametrize("directions", [0, 2, ALL])
@pytest.mark.parametrize("effects", [(), NAMES[:1], NAMES[1:], NAMES])
def test_a_search_in_a_linear_world_finds_the_least_squares(effects, directions):
    """From far off, within the steps that it has; the fit of what is true passes."""
    places = [0.4 if name in effects else 0.0 for name in NAMES]
    world = LinearWorld(np.random.default_rng(6), nuisances=(0.5, -1.0, 0.3), places=places, error=ModelError(0.0, 0.0))
    world.learn()
    linear = Linear(world, world.error)
    (found,) = refined(linear, Hypothesis(effects, 0.0, (0.9,) * len(effects)), directions=directions)
    nuisances, places, cost = least_squares(world, linear, effects)
    np.testing.assert_allclose(found.places, places, atol=1e-5)
    np.testing.assert_allclose(found.nuisances, nuisances, atol=1e-4)
    assert found.cost == pytest.approx(cost, rel=1e-6)
    assert found.refined
    # in a linear world there is nothing to be gained by refining
    assert found.log_evidence == pytest.approx(linear.screen()[effects].log_evidence, abs=1e-3)
    assert fit_p(found, EXACT, found) > 0.01


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


@pytest.mark.parametrize("effects", [(), NAMES[1:], NAMES])
def test_a_refit_to_all_recordings_is_the_fit_itself(effects):
    world = LinearWorld(np.random.default_rng(6), nuisances=TRUE, places=(0.4, 0.5), error=ModelError(0.01, 0.01))
    world.learn()
    linear = Linear(world, world.error)
    (found,) = refined(linear, Hypothesis(effects, 0.0, (0.5,) * len(effects)))
    nuisances, places = without(linear, [], found)
    np.testing.assert_allclose(nuisances, found.nuisances, atol=1e-6)
    np.testing.assert_allclose(places, found.places, atol=1e-6)


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


def test_what_others_gain_is_what_they_explain_of_what_is_left():
    """Against generalised least squares; over what chance has one of them explain, by the upper quartile."""
    rng = np.random.default_rng(3)
    names = ("spool_lag", "seal_friction", "joint_friction", "cylinder_leakage", "cross_port_leakage")
    left = rng.standard_normal(80)
    sizes = np.array([0.4, 0.9, 0.6, 0.5, 0.7])
    directions = 4.0 * rng.standard_normal((80, 5)) + np.outer(left, sizes) * 3.0
    left = left + 0.5 * directions[:, 1]
    jacobian, slope = rng.standard_normal((80, 3)), rng.standard_normal((80, 1))
    bounds = np.full(3, -np.inf), np.full(3, np.inf)
    leader = Hypothesis(
        ("payload",), 0.0, (0.5,), np.zeros(3), left=left, slopes=slope, tangent=Tangent(jacobian, np.eye(3), bounds)
    )
    axes = {name: axes_of(EFFECTS[name]) for name in names}
    assert all(len(mine) == 1 and mine[0].none == 0.0 for mine in axes.values()), "places are sizes"
    shifts = {(n, 0): np.outer(d, axes[n][0].nodes) for n, d in zip(names, directions.T, strict=True)}
    ahead = Beside(leader, ("payload", *names), axes, shifts)

    inner = np.linalg.inv(np.eye(80) + jacobian @ jacobian.T + slope @ slope.T / PRIOR_INFORMATION)

    def explained(*which: int) -> float:
        d = directions[:, which]
        places = np.linalg.solve(d.T @ inner @ d, d.T @ inner @ left)
        assert np.all((places > 0.0) & (places < 1.0)), "no range is in the way"
        return float(left @ inner @ d @ places)

    alone = [explained(k) for k in range(5)]
    np.testing.assert_allclose([ahead.gains[name][0] for name in names], alone, rtol=1e-3)
    assert ahead.excess == pytest.approx(np.quantile(alone, 0.75) / 1.3233, rel=1e-2)


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


def test_a_rough_fit_steps_over_periods_of_a_sway():
    """At three standard deviations, where the sway is three periods ahead, a search that counts it stops on the way; one
    that was told the joint's course ends there, less what the prior takes: u² + (u − 3)² / σ² is least at 3 / (1 + σ²)."""
    world = SwayingWorld(3.0)
    world.learn(effects=False)
    linear = Linear(world, world.error, effects=False)
    stuck, told = (Search(linear, (), directions=ALL) for _ in range(2))
    refine([stuck, told], 4)
    found = alone(world, SETTLE)
    trade([found], told)
    refine([told], 4)
    first = int(np.flatnonzero(world.felt == 0)[0])
    assert abs(stuck.point[0][first] - 3.0) > 0.5
    variance = 1.0 / (told.tangent.jacobian[:, first] @ told.tangent.jacobian[:, first])
    for one in (found, told):
        assert one.point[0][first] == pytest.approx(3.0 / (1.0 + variance), abs=0.05)
    assert told.cost < 0.1 * stuck.cost


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


def test_ways_lead_from_none_to_every_end():
    """Of a play that counts from some width on only upwards, of what touches to either side, each with the other at none."""
    play, compliance = axes_of(EFFECTS["joint_backlash"])
    ways = ways_of([play, compliance], (0.4, 0.9))
    assert play.none < 0.0 < compliance.none < 1.0
    up = np.array([0.4, 0.9])
    expected = [
        [(z, compliance.none) for z in play.none + up * (1.0 - play.none)],
        [(play.none, z) for z in compliance.none * (1.0 - up)],
        [(play.none, z) for z in compliance.none + up * (1.0 - compliance.none)],
    ]
    np.testing.assert_allclose(ways, expected)


def test_every_hypothesis_of_a_catalogue_has_a_prior():
    """Also pairs that no screening had thought of; together they are sure."""
    prior = log_priors(EFFECTS)
    assert len(prior) == 1 + len(EFFECTS) + len(EFFECTS) * (len(EFFECTS) - 1) // 2 + 2
    assert np.sum(np.exp(list(prior.values()))) == pytest.approx(1.0)


MANY = 10**9
"""Samples whose mean square does not scatter."""


NOISE = 0.4
"""What noise alone leaves of a mean square."""


def usual_square(kind: str) -> float:
    """What the right cause leaves of it."""
    fit = TRUST["pressure"].fit[kind]
    return NOISE * fit.noise + (1.0 - NOISE) * fit.error


def left(**misfit: Misfit) -> Hypothesis:
    """A cause that leaves so much."""
    return Hypothesis(("spool_lag",), 0.0, misfit=misfit)


def test_how_well_something_fits_counts_by_its_density():
    """As usual or better: nothing is lost; a spread above: a half; what is unknown shows in a kind of channel or not."""
    trust = TRUST["pressure"]
    mean, usual, spread = trust.surprise["pressure"], usual_square("pressure"), trust.fit["pressure"].spread

    def found(**misfit: Misfit) -> tuple[float, float]:
        """Beside what leaves as much, so that nothing is explained."""
        return fitting(left(**misfit), trust, left(**misfit))

    peak = -np.log(spread * np.sqrt(2.0 * np.pi))
    for square in (0.1 * usual, usual):
        assert found(pressure=Misfit(square, MANY, NOISE)) == pytest.approx((peak, peak - np.log(2.0)))
    worse = Misfit(usual * np.exp(2.0 * spread), MANY, NOISE)
    alone, beside = found(pressure=worse)
    assert alone == pytest.approx(peak - 2.0)
    assert np.exp(beside) == pytest.approx(0.5 * np.exp(peak - 2.0) + 0.5 * np.exp(-2.0 * spread / mean) / mean)
    both = found(**{kind: Misfit(usual_square(kind), MANY, NOISE) for kind in ("pressure", "angle")})
    assert both[0] - both[1] == pytest.approx(np.log(4.0))
    few = found(pressure=worse._replace(count=2))  # whose mean square scatters by one in its logarithm
    assert few[0] == pytest.approx(-0.5 * np.log(2.0 * np.pi * (1.0 + spread**2)) - 2.0 * spread**2 / (1.0 + spread**2))
    p = fit_p(left(pressure=worse), trust, left(pressure=worse))
    assert p == pytest.approx(0.0455, rel=0.01)  # two standard deviations, either side


def test_the_law_of_what_explains_much_may_be_wrong_by_a_share_of_it():
    """So much more may be left as the cause explains times the law's share; what explains nothing, or fits worse than
    nothing, is held to what is usual."""
    trust = TRUST["pressure"]
    usual, fit = usual_square("pressure"), trust.fit["pressure"]
    before = left(pressure=Misfit(20.0 * usual, MANY, NOISE))
    # what is left, usual + law · (before − left), of which two spreads more are seen
    factor = np.exp(2.0 * fit.spread)
    square = factor * (usual + fit.law * 20.0 * usual) / (1.0 + factor * fit.law)
    after = left(pressure=Misfit(square, MANY, NOISE))
    assert square > 3.0 * usual
    assert beyond(after, "pressure", trust, before)[0] == pytest.approx(2.0 * fit.spread)
    assert fit_p(after, trust, before) == pytest.approx(0.0455, rel=0.01)
    assert beyond(after, "pressure", trust, after)[0] == pytest.approx(np.log(square / usual))
    assert beyond(before, "pressure", trust, after)[0] == pytest.approx(np.log(20.0))


@pytest.mark.parametrize("ratio", [0.3, 1.2, 60.0])
def test_what_fits_far_worse_than_the_right_cause_is_unknown(ratio):
    """Whatever it is better than; and the larger the error that the data show, the less they say."""
    trust, square = TRUST["pressure"], ratio * usual_square("pressure")
    misfit = {"pressure": Misfit(square, MANY, NOISE)}
    nothing = Hypothesis((), 0.0, cost=40.0, misfit={"pressure": Misfit(1.1 * square, MANY, NOISE)}, refined=True)
    one = Hypothesis(("spool_lag",), 16.0, cost=4.0, misfit=misfit, refined=True)  # 18 nats of fit, less two of freedom
    other = Hypothesis(("seal_friction",), 15.0, cost=6.0, misfit=misfit, refined=True)
    prior = log_priors(("spool_lag", "seal_friction"))
    found = {h.effects: h.probability for h in weigh([nothing, one, other], prior, trust)}
    assert sum(found.values()) == pytest.approx(1.0)
    assert (found[UNKNOWN,] > 0.9) == (ratio > 2.0)
    odds = np.log(found["spool_lag",] / found["seal_friction",])
    assert odds == pytest.approx(trust.sharpness / (trust.temperature * ratio + trust.doubt * 16.0), rel=1e-9)


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


@pytest.mark.parametrize(("factor", "hotter"), [(0.2, 1.0), (2.0, 4.0), (3.0, HOTTEST)])
def test_trust_goes_by_the_square_of_what_the_twin_errs(factor, hotter, monkeypatch):
    """As healthy logs show it in the pressures where they were logged, however little it is no cooler than usual, however
    much no hotter than was ever seen; without healthy logs, as usual."""
    world = LinearWorld(np.random.default_rng(5), error=ModelError(0.05, 0.05))
    assert trust_of(world) == TRUST["day-one"]
    fit = TRUST["pressure"].fit
    usual = replace(TRUST["pressure"], temperature=1.5, doubt=0.01)
    monkeypatch.setattr("aoro_gym.diagnosis.attribution.TRUST", {**TRUST, "pressure": usual})
    names = [name for name in world.signals if world.kinds.get(name) == "pressure"]
    world.misfit = {"joint_angle": 9.0, **dict.fromkeys(names, factor * USUAL_MISFIT["pressure"])}
    found = trust_of(world)
    assert found.temperature == pytest.approx(1.5 * hotter) and found.doubt == pytest.approx(0.01 * factor**2)
    assert found.fit["pressure"].error == pytest.approx(factor**2 * fit["pressure"].error)
    assert found.fit["angle"] == fit["angle"]
    assert replace(found, temperature=1.5, doubt=0.01, fit=fit) == usual
    world.misfit = dict.fromkeys(names, 1e3)
    assert trust_of(world).fit["pressure"].error == 1.0, "all of what was assumed"


TRUE = (0.3, -0.5, 0.8)
KNOWN_LAWS: dict[str, Any] = {"temperature": 1.0, "doubt": 0.0, "sharpness": 1.0}
"""Trust where the evidence counts in full."""
GAPS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "nothing": ({"nuisances": TRUE}, ()),
    "single": ({"nuisances": TRUE, "places": (0.0, 0.5)}, NAMES[1:]),
    "pair": ({"nuisances": TRUE, "places": (0.4, 0.5)}, NAMES),
    "unknown": ({"beyond": 0.05 * np.sign(np.sin(40.0 * np.linspace(0.0, 1.0, COUNT)))}, (UNKNOWN,)),
}


@pytest.fixture
def calibrated_alike(monkeypatch):
    """Other calibration is fitted with the twin itself, which a linear world has none of."""
    monkeypatch.setattr(
        "aoro_gym.diagnosis.attribution.other_calibration",
        lambda problem: Search(Linear(problem, problem.error), ()),
    )


@pytest.mark.parametrize("kind", GAPS)
def test_the_kind_of_a_gap_is_told(kind, calibrated_alike):
    """Each kind of gap, large beside the noise, in a world whose laws are known."""
    gap, named = GAPS[kind]
    world = LinearWorld(np.random.default_rng(5), **gap, error=ModelError(0.001, 0.002, 0.01, 0.02))
    world.learn()
    found, _ = attribute(world, replace(trust_of(world), **KNOWN_LAWS))
    assert found[0].effects == named, [(h.effects, h.probability) for h in found[:4]]
    assert found[0].probability > 0.5
    assert sum(h.probability for h in found) == pytest.approx(1.0)
    (other,) = [h for h in found if h.effects == (CALIBRATION,)]
    assert not other.refined, "its nuisances are not those of the problem"
    assert {h.effects for h in found} == {(), *((name,) for name in NAMES), NAMES, (UNKNOWN,), (CALIBRATION,)}


def test_what_does_best_alone_makes_a_pair(calibrated_alike, monkeypatch):
    """Where nothing else is tried as a partner, and nothing afresh, two effects that are far before nothing alone are still
    tried together."""
    for name in ("PARTNERS", "FRESH"):
        monkeypatch.setattr(f"aoro_gym.diagnosis.attribution.{name}", 0)
    gap, named = GAPS["pair"]
    world = LinearWorld(np.random.default_rng(5), **gap, error=ModelError(0.001, 0.002, 0.01, 0.02))
    world.learn()
    found, _ = attribute(world, trust_of(world))
    assert found[0].effects == named


@pytest.mark.parametrize("afresh", [5, 0])
def test_what_adds_up_to_a_pair_is_searched_afresh(afresh, calibrated_alike, monkeypatch):
    """Where no effect leads, so that none gets a partner, a pair is found from the start, or not at all."""
    for name, value in (("LEADERS", 0), ("PARTNERS", 0), ("FRESH", afresh)):
        monkeypatch.setattr(f"aoro_gym.diagnosis.attribution.{name}", value)
    gap, named = GAPS["pair"]
    world = LinearWorld(np.random.default_rng(5), **gap, error=ModelError(0.001, 0.002, 0.01, 0.02))
    world.learn()
    found, _ = attribute(world, replace(trust_of(world), **KNOWN_LAWS))
    assert (named in {h.effects for h in found}) == bool(afresh)
    assert (found[0].effects == named) == bool(afresh)


@pytest.mark.parametrize("strained", [1e-6, 1e6])
def test_where_parameters_are_strained_the_likeliest_are_searched_by_other_ways(
    strained, calibrated_alike, monkeypatch
):
    """From a rough error, from where they were found and from beside it; and a better end may not get lost by it."""
    begun: list[tuple[float, tuple[float, ...]]] = []  # by the volume of the error, and its places

    class Watched(Search):
        def __init__(self, linear: Linear, effects: tuple[str, ...], starts: Any = ((),), *args: Any, **more: Any):
            if effects == NAMES[1:]:
                begun.extend((linear.log_volume, tuple(places)) for places in starts)
            super().__init__(linear, effects, starts, *args, **more)

    monkeypatch.setattr("aoro_gym.diagnosis.attribution.Search", Watched)
    monkeypatch.setattr("aoro_gym.diagnosis.attribution.STRAINED", strained)
    gap, named = GAPS["single"]
    world = LinearWorld(np.random.default_rng(5), **gap, error=ModelError(0.001, 0.002, 0.01, 0.02))
    world.learn()
    found, _ = attribute(world, replace(trust_of(world), **KNOWN_LAWS))
    assert found[0].effects == named
    (place,) = found[0].places
    rough, eased = (Linear(world, error).log_volume for error in (ROUGH, world.error.scaled(EASED)))
    near = [at for volume, (at,) in begun if volume == rough]
    assert bool(near) == (strained < 1.0)
    if near:
        assert near == [pytest.approx(place, abs=1e-2)]
        for aside in (-ASIDE, 0.0, ASIDE):
            assert any(abs(at - place - aside) < 1e-2 for volume, (at,) in begun if volume == eased)


def test_hypotheses_are_weighed_with_the_trust_that_the_likeliest_deserves(calibrated_alike):
    """As by hand: hotter by how far its nuisances, as they were drawn, are from where they should be."""
    gap, named = GAPS["single"]
    world = LinearWorld(np.random.default_rng(5), **gap, error=ModelError(0.001, 0.002, 0.01, 0.02))
    world.learn()
    cool = replace(trust_of(world), others=0.0)
    found, _ = attribute(world, replace(cool, strain=1e3, usual=0.01))
    known = [h for h in found if h.effects != (UNKNOWN,)]
    likeliest = max(known, key=lambda h: h.log_evidence)
    assert set(named) <= set(likeliest.effects) and likeliest.strain > 0.1
    hot = replace(cool, bent=1e3 * (likeliest.strain / 0.01 - 1.0))
    expected, sure = (
        {h.effects: h.probability for h in weigh(known, log_priors(NAMES), trust)} for trust in (hot, cool)
    )
    assert {h.effects: h.probability for h in found} == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert expected[()] > 1e3 * sure[()], "nothing gains by it"


@pytest.mark.parametrize(("errs", "least"), [(1.0, SWAYS), (2.0, 4.0 * SWAYS), (4.0, 1.0)])
def test_hypotheses_are_weighed_where_pressures_sway_less(errs, least, calibrated_alike, monkeypatch):
    """Where all is linear, searches end in the same valley whatever they are held to: so those that began where pressures
    may sway by all that was assumed are weighed as if they had begun where they may not, the less the twin errs. How well
    they fit stays theirs."""
    gap, named = GAPS["single"]
    runs: dict[str, dict[tuple[str, ...], Hypothesis]] = {}
    for name, begun, weighed_under in (("loose", 1.0, 1.0), ("firm", 1.0, SWAYS), ("from the beginning", least, 1.0)):
        error = ModelError(0.001, 0.002, swing=0.01, change=0.02, sways=begun)
        world = LinearWorld(np.random.default_rng(5), **gap, error=error)
        world.misfit = {"pressure_a": errs * USUAL_MISFIT["pressure"]}
        world.learn()
        monkeypatch.setattr("aoro_gym.diagnosis.attribution.SWAYS", weighed_under)
        found, _ = attribute(world, trust_of(world))
        assert found[0].effects == named
        runs[name] = {h.effects: h for h in found if h.refined}
    loose, firm, expected = runs.values()
    for effects, h in expected.items():
        assert firm[effects].log_evidence == pytest.approx(h.log_evidence, abs=SETTLED)
        assert firm[effects].misfit == loose[effects].misfit and firm[effects].places == loose[effects].places
    gain, before = (of[named].log_evidence - of[()].log_evidence for of in (firm, loose))
    assert gain > before + 10.0 if least < 1.0 else gain == before, "what is held to less tells more"


# ---- logs of the twin itself ----

ERROR = ModelError(rate=0.002, pressure=0.01, swing=0.1, change=0.1)
CANDIDATES = {name: EFFECTS[name] for name in ("spool_lag", "entrained_air")}
BLANKS = [blank("left", turn(1.0, 1.6), -0.4), blank("right", turn(-0.5, 1.6), 0.4)]


class Commissioned:
    """A machine whose parameters were drawn, the twin that was fitted to its healthy logs, and what they show beyond it."""

    def __init__(self) -> None:
        rng = np.random.default_rng(7)
        around = Nuisances(Machine.load("aoro"), "commissioning")
        self.machine = around.machines(rng.standard_normal((1, len(around.keys))))
        healthy = record(Variants(self.machine), BLANKS, rng)
        fit = Problem(healthy, around, {}, error=ModelError(ERROR.rate, ERROR.pressure, ERROR.swing))
        tangent = settle(fit, 2)
        self.day = Nuisances(fit.machine, "day", fit.uncertain(tangent.covariance))
        self.references = references_of(fit)


@pytest.fixture(scope="module")
def commissioned():
    return Commissioned()


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        {},
        {"spool_lag": 0.3},
        {"spool_lag": 0.3, "entrained_air": 0.4},
        {"entrained_air": 0.5},
    ],
    ids=lambda given: "+".join(given) or "none",
)
def test_the_given_cause_is_named(commissioned, given):
    """Logs of another day, with noise and the machine's parameters a little elsewhere: the laws are right, so what is true
    must be likelier than all else together, its fit must pass, and its magnitude lie within four of its standard deviations
    and what the linear model of a day leaves, a twentieth of the range."""
    rng = np.random.default_rng(11)
    today = Nuisances(commissioned.machine, "day")
    machine = today.machines(rng.standard_normal((1, len(today.keys))))
    effects = [(EFFECTS[name], (float(Axis(EFFECTS[name], 0).value(place)),)) for name, place in given.items()]
    later = record(Variants.of(machine, effects, 1), BLANKS, rng)
    problem = Problem(later, commissioned.day, CANDIDATES, error=ERROR, references=commissioned.references)
    problem.learn()
    found, _ = attribute(problem, trust_of(problem))
    best = found[0]
    assert set(best.effects) == set(given), best
    assert best.probability > 0.5
    nothing = next(h for h in found if not h.effects)
    assert fit_p(best, trust_of(problem), nothing) > 0.01
    axes = [axis for name in best.effects for axis in axes_of(EFFECTS[name])]
    for axis, place, variance in zip(axes, best.places, np.diag(best.covariance), strict=True):
        assert place == pytest.approx(given[axis.effect.id], abs=4.0 * np.sqrt(variance) + 0.05)
