"""Trainings: killed and resumed they come to the same weights; what is asked is written down, and what is wrong is named."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.agents.evaluation import leaderboard
from aoro_gym.agents.evaluation.perturbations import PERTURBATIONS, drawn_machines
from aoro_gym.agents.evaluation.selection import MOST_EPISODES
from aoro_gym.agents.training.learner import learner_of
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import read_recipe
from aoro_gym.agents.training.run_folder import begin, continued, load_run
from aoro_gym.cli import app
from aoro_gym.envs import Course
from aoro_gym.execution.provenance import ChangedInput
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Plane
from tests.agents.training.small import plan_of, weights

TURNING, TRACKING = "AORO/Turning-v0", "AORO/PathTracking-v0"
ROOT = Path(__file__).resolve().parents[3]

TRAINERS = ["sb3", "resident"]


# ---- resuming --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("algo", "trainer"), [("ppo", "sb3"), ("sac", "sb3"), ("ppo", "resident"), ("dagger", "sb3")])
def test_resumed_training_is_the_uninterrupted_one_to_the_bit(algo, trainer, training, tmp_path, monkeypatch):
    import torch  # pyright: ignore[reportMissingImports]

    plan, machine = plan_of(algo, trainer=trainer), Machine.load("aoro")
    recipe = begin(plan, tmp_path / "whole")
    found = training.train(plan, recipe, tmp_path / "whole", machine=machine)
    # SAC steps on to the end of a part; PPO's rollouts are 50 steps of the 100 of a part
    assert [one["steps"] for one in found] == [100, 200]

    begin(plan, tmp_path / "parted")
    reports = []

    def interrupt(progress) -> None:
        reports.append(progress)
        if progress.steps > 100:
            raise KeyboardInterrupt

    monkeypatch.setattr("aoro_gym.agents.training.callbacks.REPORT_EVERY", 0.0)
    with pytest.raises(KeyboardInterrupt):
        training.train(plan, recipe, tmp_path / "parted", machine=machine, tell=interrupt)
    assert reports[-1].steps == 102
    np.random.seed(0)  # noqa: NPY002 (what happens between must not matter)
    torch.manual_seed(0)
    again, recalled = load_run(tmp_path / "parted")
    assert (again, recalled.hyperparams) == (plan, recipe.hyperparams)
    resumed = training.train(again, recalled, tmp_path / "parted", machine=machine)

    whole, parted = weights(tmp_path / "whole"), weights(tmp_path / "parted")
    assert set(whole) == set(parted)
    for name, values in whole.items():
        np.testing.assert_array_equal(values, parted[name], err_msg=name)
    for one, other in zip(found, resumed, strict=True):
        assert (one["steps"], one["figures"]) == (other["steps"], other["figures"])
    states = [torch.load(tmp_path / name / "checkpoint.pt", weights_only=True) for name in ("whole", "parted")]
    same(*({key: value for key, value in state.items() if key not in ("notes", "statistics")} for state in states))


def same(one, other) -> None:
    """Fails unless two checkpoints are equal to the bit."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            same(one[key], other[key])
    elif hasattr(one, "numpy"):
        np.testing.assert_array_equal(one.numpy(), other.numpy())
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            same(a, b)
    else:
        assert one == other


@pytest.mark.parametrize("trainer", TRAINERS)
def test_learning_changes_the_policy_and_another_seed_another(trainer, training, tmp_path):
    machine, found = Machine.load("aoro"), {}
    for name, steps, seed in (("short", 100, 5), ("long", 200, 5), ("other", 200, 6)):
        plan = plan_of(trainer=trainer, steps=steps, seed=seed)
        training.train(plan, begin(plan, tmp_path / name), tmp_path / name, machine=machine)
        found[name] = weights(tmp_path / name)["layer0.weight"]
    assert not np.array_equal(found["short"], found["long"])
    assert not np.array_equal(found["other"], found["long"])


@pytest.mark.parametrize("trainer", TRAINERS)
def test_a_training_learns_on_from_a_policy(trainer, training, tmp_path):
    from aoro_gym.agents.policies.files import load_policy

    machine, first, second = Machine.load("aoro"), tmp_path / "first", tmp_path / "second"
    training.train(plan_of(), begin(plan_of(), first), first, machine=machine)
    # so small a step that nothing is learned: what is left is the policy that was started from
    plan = plan_of(start=str(first / "policy.json"), seed=6, steps=100, trainer=trainer)
    plan = replace(plan, param=[*(plan.param or []), "learning_rate=1e-30"])
    assert "--start" in plan.command
    training.train(plan, begin(plan, second), second, machine=machine)
    before, after = (load_policy(folder / "policy.json") for folder in (first, second))
    for one, other in zip(before.weights, after.weights, strict=True):
        np.testing.assert_array_equal(one, other)
    assert before.normalisation is not None and after.normalisation is not None
    # its weights are made for it
    np.testing.assert_allclose(after.normalisation.mean, before.normalisation.mean, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(after.normalisation.variance, before.normalisation.variance, rtol=1e-12)

    wide = replace(plan, param=[*(plan.param or []), "policy_kwargs={net_arch: [8]}"])
    with pytest.raises(ValueError, match=r"layers \[8, 64, 64, 1\] with tanh, but the network to train \[8, 8, 1\]"):
        training.train(wide, begin(wide, tmp_path / "wide"), tmp_path / "wide", machine=machine)
    with pytest.raises(FileNotFoundError):
        begin(plan_of(start="none.json"), tmp_path / "none")


def test_a_policy_that_comes_with_the_package_is_started_from_by_its_name():
    from aoro_gym.agents.policies.files import SHIPPED, load_policy
    from aoro_gym.agents.training.recipe import first_policy

    found, wanted = first_policy(plan_of(start="turning-ppo")), load_policy(SHIPPED / "turning-ppo.json")
    for one, other in zip(found.weights, wanted.weights, strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(
        ValueError, match=r"'levelling-ppo' is no policy for .*; choose from: turning-ppo; or give a file"
    ):
        first_policy(plan_of(start="levelling-ppo"))  # of another environment


@pytest.mark.parametrize(("algo", "trainer"), [("ppo", "sb3"), ("sac", "sb3"), ("ppo", "resident")])
def test_a_held_actor_stays_while_the_critic_learns(algo, trainer, training):
    from aoro_gym.agents.training.callbacks import ProgressCallback, StepCounter

    plan = plan_of(algo, trainer=trainer)
    clock = StepCounter(1000)
    learner = learner_of(plan, read_recipe(plan).hyperparams, clock, {"machine": Machine.load("aoro")})
    callback = ProgressCallback(clock, learner.episodes, lambda progress: None, every=0.5)

    def critic() -> np.ndarray:
        state = learner.state()
        if trainer == "resident":
            return next(iter(state["modules"]["value"].values())).numpy().copy()
        name = "mlp_extractor.value_net.0.weight" if algo == "ppo" else "critic.qf0.0.weight"
        return state["parameters"]["policy"][name].numpy().copy()

    try:
        learner.learn(200, callback, seed=0)
        learner.hold_actor(True)
        before = learner.policy().weights, critic()
        learner.learn(200, callback, seed=1)
        for one, other in zip(before[0], learner.policy().weights, strict=True):
            np.testing.assert_array_equal(one, other)
        assert np.any(critic() != before[1])
        learner.hold_actor(False)
        learner.learn(200, callback, seed=2)
        assert all(np.any(one != other) for one, other in zip(before[0], learner.policy().weights, strict=True))
    finally:
        learner.close()


@pytest.mark.slow
def test_the_critic_learns_first_where_there_is_a_policy_to_start_from(training, tmp_path, monkeypatch):
    """A tenth of the steps, whatever the parts are; not without a policy, and not again."""
    from aoro_gym.agents.training.stable_baselines import StableBaselines

    held, hold = [], StableBaselines.hold_actor

    def follow(self, is_held: bool) -> None:
        held.append((self.steps, is_held))
        hold(self, is_held)

    monkeypatch.setattr(StableBaselines, "hold_actor", follow)
    machine, first, second = Machine.load("aoro"), tmp_path / "first", tmp_path / "second"
    training.train(plan_of(), begin(plan_of(), first), first, machine=machine)
    assert held == [(0, False), (100, False)]
    held.clear()
    plan = plan_of(start=str(first / "policy.json"), steps=500, seed=6)
    training.train(plan, begin(plan, second), second, machine=machine)
    assert held == [(0, True), *((steps, False) for steps in range(50, 500, 100))]


@pytest.mark.slow
def test_a_killed_command_goes_on(training, tmp_path):
    """SIGKILL between two checkpoints; then the same weights as without it."""
    from typer.testing import CliRunner

    plan = plan_of(steps=500)
    whole, parted = tmp_path / "whole", tmp_path / "parted"
    training.train(plan, begin(plan, whole), whole, machine=Machine.load("aoro"))
    command = [sys.executable, "-m", *plan.command.replace("aoro-gym", "aoro_gym").split(), "--out", str(parted)]
    running = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 180.0
    while not (parted / "checkpoint.pt").exists() and running.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    done = read_evaluations(parted / "checkpoint.pt")
    assert 1 <= len(done) < 5  # it was killed on the way
    shown = CliRunner().invoke(app, ["train", "--resume", str(parted)], catch_exceptions=False)
    assert f"wrote {parted / 'best.json'}" in shown.stdout
    assert len(list((parted / "log").iterdir())) == 2  # it did not begin anew
    for name, values in weights(whole).items():
        np.testing.assert_array_equal(values, weights(parted)[name], err_msg=name)
    shown = CliRunner().invoke(app, ["train", "--resume", str(parted), "--seed", "3"])
    assert shown.exit_code == 2
    assert "--seed was settled when the training began; leave it out" in " ".join(shown.stderr.split())


def read_evaluations(checkpoint: Path) -> list[Any]:
    from aoro_gym.agents.training.checkpoints import load_checkpoint

    return load_checkpoint(checkpoint)[1]["evaluations"]


# ---- what a training writes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trainer", TRAINERS)
def test_folder_says_what_was_asked_and_found(trainer, training, tmp_path):
    from aoro_gym.agents.policies.policy import LearnedPolicy

    plan = plan_of(steps=100, trainer=trainer)
    found = training.train(plan, begin(plan, tmp_path), tmp_path, machine=Machine.load("aoro"))
    record = json.loads((tmp_path / "training.json").read_text())
    assert TrainingPlan.of(record["plan"]) == plan
    assert record["command"] == plan.command
    assert record["hyperparams"]["n_steps"] == 25
    assert record["curriculum"][0]["from"] == 0.0
    evaluations = json.loads((tmp_path / "evaluations.json").read_text())
    assert evaluations == {"env": TURNING, "evaluations": found}
    assert found[0]["figures"]["return"]["low95"] is None  # of one episode
    policy = LearnedPolicy.load(tmp_path / "policy.json")
    assert policy.environment == TURNING
    assert list(policy.layout) == ["joint_angle", "joint_rate", "target", "error", "signals"]
    assert policy.training["command"] == plan.command
    assert (policy.training["seed"], policy.training["steps"]) == (5, 100)
    logged = (tmp_path / "log" / "from_0" / "progress.csv").read_text().splitlines()[0].split(",")
    assert {"evaluation/return", "train/policy_gradient_loss", "train/std", "time/fps"} <= set(logged)
    assert record["versions"].keys() >= {"torch", "skrl" if trainer == "resident" else "stable-baselines3"}
    assert list((tmp_path / "log" / "from_0").glob("events.out.tfevents.*"))
    with pytest.raises(ValueError, match="holds a training; give --resume"):
        begin(plan, tmp_path)


@pytest.mark.parametrize("trainer", TRAINERS)
def test_terms_of_episodes_are_logged(trainer, training, tmp_path):
    plan = plan_of(steps=1200, checkpoint_every=600, trainer=trainer)
    training.train(plan, begin(plan, tmp_path), tmp_path, machine=Machine.load("aoro"))
    head, *rows = (tmp_path / "log" / "from_0" / "progress.csv").read_text().splitlines()
    column = head.split(",").index("terms/tracking")
    values = [float(row.split(",")[column]) for row in rows if row.split(",")[column]]
    # 0.6 at most in each of 500 steps
    assert values and all(0.0 < value <= 300.0 for value in values)


def test_paths_are_learned_and_evaluated_on_their_courses(training, tmp_path):
    def course(length: float) -> Course:
        return Course(Plane(), (Line(np.array([[0.0, 0.0], [length, 0.0]]), name="ahead"),), name=f"{length} m")

    plan = plan_of(env=TRACKING, steps=100, eval_episodes=2)
    recipe = begin(plan, tmp_path)
    machine = Machine.load("aoro")
    found = training.train(plan, recipe, tmp_path, machine=machine, courses=[course(9.0)], held_out=[course(7.0)])
    # from 4 m along on, and who hardly moves in 20 s is stuck: neither gets farther than to the end of the held-out path
    assert all(found[0]["figures"]["driven_m"][end] <= 3.0 for end in ("mean", "high95"))
    assert json.loads((tmp_path / "policy.json").read_text())["environment"] == TRACKING


def test_machines_to_learn_on_are_drawn_and_none_of_an_evaluation(training, tmp_path, monkeypatch):
    """One a sub-environment, others for another seed; what is evaluated on is the machine of the file."""
    made, evaluated = [], []
    evaluate = training.evaluate
    monkeypatch.setattr(training, "learner_of", lambda *given: made.append(given[3]["machine"]) or learner_of(*given))
    monkeypatch.setattr(
        training, "evaluate", lambda *given, **named: evaluated.append(named["machine"]) or evaluate(*given, **named)
    )
    (tmp_path / "fixed.yml").write_text(f"{TURNING}:\n  - from: 0.0\n")
    machine, key = Machine.load("aoro"), "frame.front.axle_distance"
    for seed in (5, 6):
        plan = plan_of(perturbation="perturbed", curriculum=str(tmp_path / "fixed.yml"), steps=50, seed=seed)
        training.train(plan, begin(plan, tmp_path / str(seed)), tmp_path / str(seed), machine=machine)
    values = np.concatenate([one.entries[key].value for one in made])
    assert values.shape == (4,)
    assert len(np.unique(values)) == 4
    expected = PERTURBATIONS["perturbed"](machine, [6 * training.DRAWN_SEED]).entries[key].value
    assert values[0] == np.ravel(expected)[0]
    assert all(one is machine for one in evaluated)
    assert max(leaderboard.SEED, training.EVALUATION_SEED) + MOST_EPISODES < training.DRAWN_SEED


def test_soil_is_learned_on_and_evaluated_on(training, tmp_path, monkeypatch):
    made, asked = [], []
    evaluate = training.evaluate
    monkeypatch.setattr(training, "learner_of", lambda *given: made.append(learner_of(*given)) or made[-1])
    monkeypatch.setattr(
        training, "evaluate", lambda *given, **named: asked.append(named["soil"]) or evaluate(*given, **named)
    )
    plan, machine = plan_of(soil="peat", steps=50), Machine.load("aoro")
    training.train(plan, begin(plan, tmp_path), tmp_path, machine=machine)
    assert made[0].envs.twin.soil.name == "peat" and asked == ["peat"]
    assert "--soil peat" in json.loads((tmp_path / "training.json").read_text())["command"]
    other = replace(plan, soil="clay")
    with pytest.raises(ChangedInput, match="soil was 'peat', is 'clay'"):
        training.train(other, continued(other, tmp_path), tmp_path, machine=machine)


def test_laws_to_learn_on_are_drawn_for_every_sub_environment(training, tmp_path, monkeypatch):
    """A policy learns on twins of several families at once, and goes on with those alone."""
    made = []
    monkeypatch.setattr(training, "learner_of", lambda *given: made.append(learner_of(*given)) or made[-1])
    plan, machine = plan_of(laws="library,materials", n_envs=8, steps=400), Machine.load("aoro")
    found = training.train(plan, begin(plan, tmp_path), tmp_path, machine=machine)
    assert [one["steps"] for one in found] == [400]
    laws = made[0].envs.twin.machine.laws
    # alike in all eight with a probability of 1 in 128, of this seed not
    assert set(laws.names["gas"]) == {"isothermal", "dissolving"}
    expected = drawn_machines(plan.laws)(machine, range(6 * training.DRAWN_SEED, 6 * training.DRAWN_SEED + 8))
    assert laws.names == expected.laws.names
    assert "--laws library,materials" in json.loads((tmp_path / "training.json").read_text())["command"]
    other = replace(plan, laws="families")
    with pytest.raises(ChangedInput, match="laws was 'library,materials', is 'families'"):
        training.train(other, continued(other, tmp_path), tmp_path, machine=machine)
    with pytest.raises(ChangedInput, match=r"machine .*laws"):
        training.train(plan, continued(plan, tmp_path), tmp_path, machine=machine.with_laws("library"))
    odd = replace(plan, laws="libary")
    with pytest.raises(ValueError, match="there is no family of laws 'libary'"):
        begin(odd, tmp_path / "odd")
