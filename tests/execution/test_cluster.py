"""Jobs on a cluster of several nodes, whose workers and nodes die half-way: nothing is lost, and results are the same."""

import json
import os
import signal
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ray")
import ray  # pyright: ignore[reportMissingImports]
from ray import cloudpickle  # pyright: ignore[reportMissingImports]
from ray.cluster_utils import Cluster  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.training.run_folder import begin
from aoro_gym.agents.training.seeds import train_seeds
from aoro_gym.execution.cluster import Failed, connected, on_ray
from aoro_gym.machine import Machine

pytestmark = pytest.mark.filterwarnings("ignore")  # what Ray warns of is its own
TURNING = "AORO/Turning-v0"
cloudpickle.register_pickle_by_value(sys.modules[__name__])  # nodes cannot import the tests


@pytest.fixture
def cluster():
    """A head that does no work, and two nodes that do one job each."""
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    for _ in range(2):
        made.add_node(num_cpus=1)
    ray.init(address=made.address, log_to_driver=False)
    yield made
    ray.shutdown()
    made.shutdown()


def die_once(mark: Path) -> None:
    """SIGKILL to this process, the first time."""
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)


def squared(number: int, folder: Path) -> int:
    if number == 3:
        die_once(folder / "killed")
    if number == 4:
        raise ValueError("4 is not liked")
    (folder / str(number)).touch()
    time.sleep(0.5)
    return number**2


def test_jobs_outlive_their_processes_and_nodes(cluster, tmp_path):
    found: dict[str, Any] = {}
    for name, result in on_ray(squared, {str(k): (k, tmp_path) for k in range(8)}):
        found[name] = result
        if len(found) == 2:
            cluster.remove_node(next(iter(cluster.worker_nodes)), allow_graceful=False)
            cluster.add_node(num_cpus=1)
    assert (tmp_path / "killed").exists()
    failed = found.pop("4")
    assert isinstance(failed, Failed)
    assert failed.reason == "ValueError: 4 is not liked"
    assert "squared" in failed.trace
    assert found == {str(k): k**2 for k in range(8) if k != 4}


class Dying:
    """A controller whose process dies in the middle of its episodes, the first time."""

    def __init__(self, env: Any, mark: Path):
        self.policy, self.mark, self.steps = policy_factory(TURNING, "proportional-derivative")(env), mark, 0

    def __call__(self, observations):
        self.steps += 1
        if self.steps == 250:
            die_once(self.mark)
        return self.policy(observations)

    def reset(self, mask=None):
        self.policy.reset(mask)


def test_an_evaluation_with_a_killed_worker_is_the_one_made_here(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr("aoro_gym.agents.evaluation.batches.SHARD", 2)
    told = []
    there = evaluate(
        TURNING,
        {"dying": partial(Dying, mark=tmp_path / "killed"), "bang-bang": policy_factory(TURNING, "bang-bang")},
        episodes=5,
        seed=3,
        ray="auto",
        progress=lambda what, share: told.append(share),
    )
    assert (tmp_path / "killed").exists()
    here = evaluate(
        TURNING,
        {name: policy_factory(TURNING, name) for name in ("proportional-derivative", "bang-bang")},
        episodes=5,
        seed=3,
    )
    for one, other in (("dying", "proportional-derivative"), ("bang-bang", "bang-bang")):
        for name, values in here.runs[other].metrics.items():
            np.testing.assert_array_equal(there.runs[one].metrics[name], values, err_msg=name)
        np.testing.assert_array_equal(there.runs[one].errors, here.runs[other].errors)
        np.testing.assert_array_equal(there.runs[one].film, here.runs[other].film)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_trainings_outlive_a_node_and_come_to_the_same_weights(cluster, tmp_path):
    for name in ("stable_baselines3", "tensorboard", "yaml"):
        pytest.importorskip(name)
    from safetensors.numpy import load

    from aoro_gym.agents.training import train as training
    from aoro_gym.agents.training.plan import TrainingPlan

    machine = Machine.load("aoro")
    small = ["n_steps=25", "batch_size=50", "n_epochs=1"]
    plans = {
        tmp_path / f"seed_{seed}": TrainingPlan(
            steps=1000, n_envs=2, checkpoint_every=50, eval_episodes=1, seed=seed, param=small
        )
        for seed in (0, 1)
    }
    recipes = {folder: begin(plan, folder) for folder, plan in plans.items()}

    def kill() -> None:
        deadline = time.monotonic() + 120.0
        while not all((folder / "checkpoint.pt").exists() for folder in plans) and time.monotonic() < deadline:
            time.sleep(0.02)
        cluster.remove_node(next(iter(cluster.worker_nodes)), allow_graceful=False)

    killer = threading.Thread(target=kill)
    killer.start()
    found = train_seeds(plans, recipes, ray="auto", machine=machine)
    killer.join()
    starts = [len(list((folder / "log").iterdir())) for folder in plans]
    assert sorted(starts) == [1, 2]  # one went on elsewhere, from a checkpoint
    for folder, plan in plans.items():
        assert [one["steps"] for one in found[folder]] == list(range(100, 1001, 100))
        alone = tmp_path / f"alone_{plan.seed}"
        training.train(plan, begin(plan, alone), alone, machine=machine)
        whole, parted = (load((one / "policy.safetensors").read_bytes()) for one in (alone, folder))
        for name, values in whole.items():
            np.testing.assert_array_equal(values, parted[name], err_msg=name)


def test_a_search_outlives_its_workers_and_its_trials_can_be_had_again(cluster, tmp_path, monkeypatch):
    for name in ("stable_baselines3", "tensorboard", "yaml", "optuna"):
        pytest.importorskip(name)
    psutil = pytest.importorskip("psutil")
    from safetensors.numpy import load

    from aoro_gym.agents.training import search as trials
    from aoro_gym.agents.training import train as training
    from aoro_gym.agents.training.plan import HYPERPARAMS, TrainingPlan

    machine, folder = Machine.load("aoro"), tmp_path / "search"
    monkeypatch.chdir(tmp_path)  # where the recipe is found; trials work elsewhere
    Path("mine.yml").write_text((HYPERPARAMS / "ppo.yml").read_text(encoding="utf-8"), encoding="utf-8")
    plan = TrainingPlan(
        steps=900,
        n_envs=2,
        checkpoint_every=50,
        eval_episodes=1,
        param=["n_steps=25", "batch_size=50"],
        hyperparams="mine.yml",
    )
    space = (trials.Dimension("learning_rate", low=1e-3, high=5e-3, log=True), trials.Dimension("n_epochs", ("1", "2")))

    def kill() -> None:
        """SIGKILL to the processes of all trials, once one of them has a checkpoint."""
        deadline = time.monotonic() + 120.0
        while not list(folder.glob("trials/*/checkpoint.pt")) and time.monotonic() < deadline:
            time.sleep(0.02)
        for one in psutil.Process().children(recursive=True):
            if "ImplicitFunc" in "".join(one.cmdline()):
                one.kill()

    killer = threading.Thread(target=kill)
    killer.start()
    told: list[float] = []

    def seek(sought: tuple[trials.Dimension, ...] = space) -> list[trials.Trial]:
        return trials.search(
            plan, sought, folder, trials=3, ray="auto", machine=machine, progress=lambda what, share: told.append(share)
        )

    found = seek()
    killer.join()
    assert len(found) == 3 and told == sorted(told) and told[-1] <= 1.0
    assert [one.value for one in found] == sorted((one.value for one in found), reverse=True)
    for one in found:
        steps = [evaluation["steps"] for evaluation in one.evaluations]
        assert steps == list(range(100, 100 * len(steps) + 1, 100)), one.failed
    assert max(len(list((one.folder / "log").iterdir())) for one in found) == 2  # went on elsewhere, from a checkpoint
    best = found[0]
    alone = TrainingPlan(**{**plan.to_json(), "hyperparams": str(folder / "best.yml"), "param": None, "steps": None})
    again = training.train(alone, begin(alone, tmp_path / "alone"), tmp_path / "alone", machine=machine)
    count = len(best.evaluations)
    assert [one["figures"] for one in again[:count]] == [one["figures"] for one in best.evaluations]
    if count == len(again):
        whole, parted = (load((one / "policy.safetensors").read_bytes()) for one in (tmp_path / "alone", best.folder))
        for name, values in whole.items():
            np.testing.assert_array_equal(values, parted[name], err_msg=name)
    assert [one.folder for one in seek()] == [one.folder for one in found]  # nothing is left to do
    with pytest.raises(ValueError, match="holds a search whose space is"):
        seek(space[:1])


def diagnose(place: Path, out: Path, *, sensors: str, device: str) -> None:
    """Stands for a diagnosis."""
    if place.name == "002":
        die_once(out.parent / "killed")
    if place.name == "003":
        raise RuntimeError("no logs")
    (out / "diagnosis.json").write_text(json.dumps({"case": place.name, "sensors": sensors, "device": device}))


def test_blind_runs_outlive_a_worker(cluster, tmp_path):
    from aoro_gym.diagnosis_benchmark.running import run_cases

    suite, out = tmp_path / "suite", tmp_path / "out"
    for name in ("001", "002", "003", "004"):
        (suite / "cases" / name).mkdir(parents=True)
    (suite / "seal.json").write_text(json.dumps({"sensors": "full", "sha256": {"cases": "abc"}}))
    failures = run_cases(suite, out, sensors="full", ray="auto", diagnose=diagnose)
    assert (out / "killed").exists()
    assert failures == {"003": "RuntimeError: no logs"}
    assert "no logs" in (out / "003" / "error.txt").read_text()
    for name in ("001", "002", "004"):
        assert json.loads((out / name / "diagnosis.json").read_text())["case"] == name


@pytest.mark.parametrize("address", ["127.0.0.1:1", "there:x"])
def test_a_cluster_that_is_not_there_is_said(address):
    with pytest.raises(ValueError, match=f"no Ray cluster at '{address}'.*ray start --head"), connected(address):
        pass
