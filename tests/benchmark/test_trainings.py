"""Learning is timed by whole rollouts, as it is trained; a trainer that is not there is named."""

from importlib.metadata import PackageNotFoundError

import pytest

from aoro_gym.agents.training import learner as learner_module
from aoro_gym.agents.training.learner import learner_of
from aoro_gym.agents.training.plan import TRAINERS
from aoro_gym.benchmark.report import tables
from aoro_gym.benchmark.run import Plan, run
from aoro_gym.benchmark.timing import RUNS
from aoro_gym.benchmark.trainings import trainings

for library in ("stable_baselines3", "yaml", "array_api_compat"):
    pytest.importorskip(library)

TURNING = "AORO/Turning-v0"


@pytest.fixture(params=TRAINERS)
def trainer(request) -> str:
    if request.param == "resident":
        pytest.importorskip("skrl")
    return request.param


def test_whole_rollouts_are_learned_from(trainer, machine, monkeypatch):
    made = []

    def recorded(*arguments):
        made.append((arguments, learner_of(*arguments)))
        return made[-1][1]

    monkeypatch.setattr(learner_module, "learner_of", recorded)
    subject = trainings(4, machine=machine, trainer=trainer, environment=TURNING, ground="plane", threads=1, seed=3)
    ((plan, hyperparams, *_), learner) = made[0]
    assert (plan.env, plan.trainer, plan.seed) == (TURNING, trainer, 3)
    # the packaged ones have 4 batches in a rollout of 64 steps
    assert (hyperparams["n_envs"], hyperparams["n_steps"], hyperparams["batch_size"]) == (4, 64, 64)
    assert learner.envs.task.reward_terms["flow_excess"].weight == -0.4  # the curriculum's
    assert (subject.copies, subject.steps, subject.step_time) == (4, 64, 0.02)
    assert subject.description["randomised"] is True
    before, weights = learner.steps, learner.policy().weights
    subject.restart()
    subject.advance(2)
    assert learner.steps - before == 2 * 64 * 4
    assert (learner.policy().weights[0] != weights[0]).any()


@pytest.mark.slow
def test_trainers_stand_beside_each_other(machine):
    pytest.importorskip("skrl")
    plan = Plan(twins=(2,), what=("train",), env=TURNING, trainers=("sb3", "resident"), threads=(1,), seconds=0.02)
    kept = []
    result = run(plan, machine, save=kept.append)
    assert len(kept) == 2 * RUNS
    assert [(case["what"], case["trainer"], case["twins"]) for case in result["cases"]] == [
        ("train", "sb3", 2),
        ("train", "resident", 2),
    ]
    sb3, resident = (case["steps_per_s"] for case in result["cases"])
    assert result["ratios"] == {"train_resident_over_sb3_at_2": resident / sb3}
    shown = tables(result)
    assert [table.row_count for table in shown] == [2, 1]
    assert [row[0] for row in shown[0].rows] == [f"2 x train, {trainer}, 1 thread" for trainer in ("sb3", "resident")]


def test_a_missing_trainer_is_named(monkeypatch):
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(learner_module, "version", missing)
    with pytest.raises(ValueError, match=r"pip install 'aoro-gym\[resident\]'"):
        Plan(what=("train",), trainers=("resident",))
    assert Plan(what=("env",), trainers=("resident",)).trainers == ("resident",)
