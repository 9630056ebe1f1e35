"""The valley that a population finds, in a world whose sway is a sine of known frequency."""

import numpy as np

from aoro_gym.diagnosis.cross_entropy import SPREAD, Population, evolve, misfit
from aoro_gym.diagnosis.noise import ModelError
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem
from tests.diagnosis.synthetic import MACHINE, STD, problem_of

DAY = Nuisances(MACHINE, "day")

SECONDS, FREQUENCY, HEIGHT = 5.0, 24.0, 20e5
TIME = np.arange(0.0, SECONDS + 0.005, 0.01)
KEY = "oil.bulk_modulus"


def swaying(machine):
    """Pressure (F, N) that sways with the root of the oil's stiffness."""
    stiffness = np.atleast_1d(machine.value(KEY)) / MACHINE.value(KEY)
    return 50e5 + HEIGHT * np.sin(2.0 * np.pi * FREQUENCY * np.sqrt(stiffness) * TIME[:, None])


def test_a_population_crosses_what_slopes_stop_at(monkeypatch):
    """2.4 standard deviations of stiffness, a little less than what may be, are more than a period at the end; between here
    and there no twin fits better than the first. A thousandth of the frequency is 0.75 rad at the end, a third of which,
    8 bar in the mean, would be seen beside a zero of a bar."""

    def simulate(self, variants):
        (one,) = variants
        pressure = np.broadcast_to(swaying(one.machine), (len(TIME), one.count))
        return np.concatenate(
            [{"joint_angle": 0.0 * pressure, "pressure_a": pressure}[name] for _, name in self.blocks]
        )

    monkeypatch.setattr(Problem, "simulate", simulate)
    rng = np.random.default_rng(1)
    problem = problem_of({"turn": {"joint_angle": rng.normal(0.0, STD["joint_angle"], len(TIME)), "pressure_a": TIME}})
    k = problem.nuisances.keys.index(KEY)
    line = np.zeros((31, len(problem.centre)))
    line[:, k] = np.linspace(0.0, 2.4, 31)
    truth = problem.at(line[-1:]).machine
    pressure = swaying(truth)[:, 0] + rng.normal(0.0, STD["pressure_a"], len(TIME))
    problem.recordings[0].channels["pressure_a"][:] = pressure
    along = misfit(problem, problem.simulate([problem.at(line)]))
    assert np.argmin(along) == 30 and along[1:20].max() > along[0]

    population = Population(problem)
    evolve([population])
    found, places = population.best
    assert not places.size
    stiffness = problem.at(found[None]).machine.value(KEY) / truth.value(KEY)
    assert abs(np.sqrt(stiffness) - 1.0) < 1e-3


def test_nuisances_are_drawn_by_their_correlated_prior(monkeypatch):
    """Covariance of a first generation of 20,000, where what effects move may go as far as all others: of a normal's, an
    entry scatters by √2 / √20,000 = 0.01 of SPREAD² at most, of which five standard deviations are allowed over some
    thousand entries."""
    monkeypatch.setattr("aoro_gym.diagnosis.nuisances.FARTHEST", np.inf)
    root = 0.03 * np.random.default_rng(2).standard_normal((len(DAY.keys), 3))
    problem = Problem(
        problem_of({"turn": {"joint_angle": TIME, "pressure_a": TIME}}).recordings,
        Nuisances(MACHINE, "day", root @ root.T), {}, error=ModelError(0.0, 0.0),
    )  # fmt: skip
    asked = []
    problem.at = lambda points, effects, places: asked.append(points)  # type: ignore[method-assign,assignment]
    Population(problem, size=20_001).variants()
    drawn = asked[0][1:, : len(DAY.keys)]
    inside = 5.0 * SPREAD * problem.nuisances.std < np.minimum(DAY.place, 1.0 - DAY.place)  # no draw leaves their range
    assert inside.sum() > 5
    expected = SPREAD**2 * problem.nuisances.correlation[np.ix_(inside, inside)]
    np.testing.assert_allclose(np.cov(drawn[:, inside].T), expected, atol=0.05 * SPREAD**2)
    assert np.ptp(asked[0][:, len(DAY.keys) :]) == 0.0, "a recording's own stay"
