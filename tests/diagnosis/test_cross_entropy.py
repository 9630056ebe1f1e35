"""The valley that a population finds, in a world whose sway is a sine of known frequency."""

import numpy as np

from aoro_gym.diagnosis.cross_entropy import explore, misfit
from aoro_gym.diagnosis.problem import Problem
from tests.diagnosis.synthetic import MACHINE, STD, problem_of

SECONDS, FREQUENCY, HEIGHT = 5.0, 20.0, 20e5
TIME = np.arange(0.0, SECONDS + 0.005, 0.01)
KEY = "oil.bulk_modulus"


def swaying(machine):
    """Pressure (F, N) that sways with the root of the oil's stiffness."""
    stiffness = np.atleast_1d(machine.value(KEY)) / MACHINE.value(KEY)
    return 50e5 + HEIGHT * np.sin(2.0 * np.pi * FREQUENCY * np.sqrt(stiffness) * TIME[:, None])


def test_a_population_crosses_what_slopes_stop_at(monkeypatch):
    """Three standard deviations of stiffness are more than a period at the end, and between here and there no twin fits
    better than the first. A thousandth of the frequency is 0.6 rad at the end, a third of which, 7 bar in the mean, would be
    seen beside a zero of a bar."""

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
    line[:, k] = np.linspace(0.0, 3.0, 31)
    truth = problem.at(line[-1:]).machine
    pressure = swaying(truth)[:, 0] + rng.normal(0.0, STD["pressure_a"], len(TIME))
    problem.recordings[0].channels["pressure_a"][:] = pressure
    along = misfit(problem, line)
    assert np.argmin(along) == 30 and along[1:20].max() > along[0]

    found = explore(problem)
    stiffness = problem.at(found[None]).machine.value(KEY) / truth.value(KEY)
    assert abs(np.sqrt(stiffness) - 1.0) < 1e-3
    assert misfit(problem, found[None]) < along[0]
