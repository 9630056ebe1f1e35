"""What a gap costs: shares that are known, places that are the same machine, and the command that retrains."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.agents.policies.files import shipped_policies
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training import gap
from aoro_gym.agents.training.gap import BASELINE, CONTROL, IMPROVED, PLANT, RETRAINED, Gap, measure, share_of
from aoro_gym.agents.training.run_folder import begin
from aoro_gym.cli import app
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine

TURNING = "AORO/Turning-v0"
MACHINE = Machine.load("aoro")
NAMES = ("success_rate", "settling_time_s", "flow_overshoot_share", "overshoot_deg", "return")


def gap_of(**returns) -> Gap:
    """Of 50 episodes, which differ by what all places share."""
    easy = np.random.default_rng(0).normal(0.0, 30.0, 50)

    def driven(value: float) -> Episodes:
        metrics = dict.fromkeys(NAMES, easy + value) | {"settled_share": np.ones(50)}
        none = np.zeros((50, 0))
        return Episodes(
            metrics,
            ["time is up"] * 50,
            np.zeros((50, 2), dtype=np.intp),
            none,
            none[..., None],
            none.astype(np.float32),
        )

    return Gap(TURNING, 50, 0, {place: driven(value) for place, value in returns.items()})


def test_shares_of_a_known_loss():
    found = gap_of(
        **{BASELINE: 100.0, PLANT: 60.0, IMPROVED: 70.0, RETRAINED: 90.0, CONTROL: 64.0},
    )
    assert found.changes["loss"]["return"].mean == pytest.approx(-40.0)
    # what the episodes share cancels, though it spreads as much as the loss
    assert found.changes["loss"]["return"].low95 == pytest.approx(-40.0)
    shares = {name: values["return"] for name, values in found.shares.items()}
    assert {name: value.mean for name, value in shares.items()} == pytest.approx(
        {"predicted": 0.75, "recovered": 0.75, "control": 0.1}
    )
    assert shares["recovered"].low95 == pytest.approx(0.75)


def test_share_of_noisy_pairs_has_an_interval_that_covers():
    rng = np.random.default_rng(2)
    whole = rng.normal(2.0, 1.0, 400)
    part = 0.5 * whole + rng.normal(0.0, 0.5, 400)
    found = share_of(part, whole)
    # by the delta method, with the residual 0.5 whole - part: 0.5 / (2 sqrt 400)
    assert found.high95 - found.low95 == pytest.approx(2 * 1.96 * 0.5 / (2.0 * 20.0), rel=0.15)
    assert found.low95 < 0.5 < found.high95
    assert math.isnan(share_of(part, np.zeros(400)).mean)
    assert share_of(np.append(part, np.nan), np.append(whole, 1.0)) == found


def test_an_improved_twin_that_is_the_plant_predicts_all_of_the_loss(short_episodes):
    plant = EFFECTS["spool_lag"].apply(MACHINE, 0.06)
    make = policy_factory(TURNING, "proportional-derivative")
    found = measure(TURNING, make, baseline=MACHINE, plant=plant, improved=plant, episodes=3)
    # a slower spool settles later
    assert found.changes["loss"]["settling_time_s"].mean > 0.0
    assert found.shares["predicted"]["settling_time_s"][:3] == (1.0, 1.0, 1.0)
    again = measure(TURNING, make, baseline=MACHINE, plant=plant, improved=MACHINE, episodes=3)
    assert again.shares["predicted"]["settling_time_s"].mean == 0.0
    assert set(again.driven) == {BASELINE, PLANT, IMPROVED}


def test_effects_of_the_command_line():
    found = gap.with_effects(MACHINE, ["spool_lag=0.06", "payload=800"])
    assert float(found.mass) == pytest.approx(float(MACHINE.mass) + 800.0)
    for asked, message in (
        (["gremlins=1"], "--effect gremlins=1: 'gremlins' is no effect here; choose from: engine_droop"),
        (["sensor_delay=0.01"], "'sensor_delay' is no effect here"),
        (["payload=much"], "--effect payload=much is not payload=MASS, numbers in SI"),
        (["payload=1,2"], "--effect payload=1,2 is not payload=MASS"),
        (["spool_lag=1e9"], r"spool_lag: time_constant is 1000000000 s, but must be in \[0, 0.08\] s"),
    ):
        with pytest.raises(ValueError, match=message):
            gap.with_effects(MACHINE, asked)


def test_likeliest_machine_of_a_diagnosis(tmp_path):
    causes = [{"effects": ["unknown"], "machine_file": ""}, {"effects": ["payload"], "machine_file": "cause_2.toml"}]
    (tmp_path / "diagnosis.json").write_text(json.dumps({"causes": causes}))
    assert gap.likeliest_machine_file(tmp_path) == tmp_path / "cause_2.toml"
    (tmp_path / "diagnosis.json").write_text(json.dumps({"causes": causes[:1]}))
    with pytest.raises(ValueError, match="names no machine file"):
        gap.likeliest_machine_file(tmp_path)
    (tmp_path / "diagnosis.json").write_text("{broken")
    with pytest.raises(ValueError, match=r"diagnosis\.json is not JSON"):
        gap.likeliest_machine_file(tmp_path)


@pytest.mark.parametrize("env", ["AORO/PathTracking-v1", "AORO/ForestRun-v0"])
def test_a_policy_with_a_memory_learns_on_from_the_teacher(env, tmp_path):
    pytest.importorskip("torch")
    from aoro_gym.agents.training.memory_network import MemoryNetwork
    from aoro_gym.agents.training.recipe import read_recipe

    name = {"AORO/PathTracking-v1": "limits-dagger", "AORO/ForestRun-v0": "forest-dagger"}[env]
    plan = gap.retraining_plan(env, name, steps=100, seed=0, device="cpu")
    learned, asked = LearnedPolicy.load(shipped_policies(env)[name]), read_recipe(plan).hyperparams
    assert (plan.algo, plan.start) == ("dagger", str(shipped_policies(env)[name]))
    assert learned.memory is not None
    actions = len(learned.low)
    MemoryNetwork(learned.memory.sizes[0], asked["memory"], asked["net_arch"], actions, 0).take(learned)
    with pytest.raises(ValueError, match="has a memory, which --algo dagger learns on from"):
        begin(replace(plan, algo="ppo", param=None, curriculum=None), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_command_retrains_and_goes_on(tmp_path):
    for name in ("stable_baselines3", "tensorboard", "yaml"):
        pytest.importorskip(name)
    from aoro_gym.agents.training import train as training
    from aoro_gym.agents.training.plan import TrainingPlan

    small = ["n_steps=25", "batch_size=50", "n_epochs=1", "policy_kwargs={net_arch: [4]}"]
    plan = TrainingPlan(steps=100, n_envs=2, checkpoint_every=50, eval_episodes=1, param=small)
    training.train(plan, begin(plan, tmp_path / "run"), tmp_path / "run", machine=MACHINE)

    EFFECTS["spool_lag"].apply(MACHINE, 0.05).save(tmp_path / "found.toml")
    command = [
        "gap", "--env", TURNING, "--policy", str(tmp_path / "run" / "policy.json"), "--effect", "spool_lag=0.06",
        "--improved", str(tmp_path / "found.toml"), "--retrain", "1", "--episodes", "2", "--out", str(tmp_path / "gap"),
    ]  # fmt: skip
    shown = CliRunner().invoke(app, command, catch_exceptions=False)
    assert shown.exit_code == 0, shown.output
    content = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert list(content["figures"]) == [BASELINE, PLANT, IMPROVED, RETRAINED, CONTROL]
    assert set(content["shares"]) == {"predicted", "recovered", "control"}
    record = json.loads((tmp_path / "gap" / "retrained" / "training.json").read_text())
    assert record["plan"]["start"].endswith("policy.json")
    trained = (tmp_path / "gap" / "retrained" / "checkpoint.pt").stat().st_mtime_ns
    shown = CliRunner().invoke(app, command, catch_exceptions=False)
    assert shown.exit_code == 0
    assert (tmp_path / "gap" / "retrained" / "checkpoint.pt").stat().st_mtime_ns == trained  # it was done

    def refused(*others: str) -> str:
        shown = CliRunner().invoke(app, [*command, *others], catch_exceptions=False)
        assert shown.exit_code == 2
        return " ".join(shown.stderr.split())

    place = tmp_path / "gap" / "retrained"
    assert f"{place} was begun with other inputs: seed was 0, is 1; --restart begins anew" in refused("--seed", "1")
    assert "steps was 1, is 2" in refused("--retrain", "2")
    # the baseline's policy is looked at after the improved twin's
    assert "control was begun with other inputs: machine oil.gas_fraction" in refused("--set", "oil.gas_fraction=0.01")
    EFFECTS["spool_lag"].apply(MACHINE, 0.055).save(tmp_path / "found.toml")
    assert "retrained was begun with other inputs: machine steering.valve.spool_time_constant" in refused()
    before = (place / "best.safetensors").read_bytes()
    shown = CliRunner().invoke(app, [*command, "--restart"], catch_exceptions=False)
    assert shown.exit_code == 0, shown.output
    assert (place / "best.safetensors").read_bytes() != before
    (tmp_path / "run" / "policy.json").write_text("{}")
    assert "policy.json" in refused()
