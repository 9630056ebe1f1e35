"""What is searched: the packaged spaces fit their algorithms, and a file that does not is named."""

import inspect
import json
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("yaml")
from aoro_gym.agents.training.plan import ALGORITHMS, TrainingPlan
from aoro_gym.agents.training.recipe import read_recipe
from aoro_gym.agents.training.search import SPACES, WORST, Dimension, read_space, read_trials


@pytest.mark.parametrize("env", ["AORO/Turning-v0", "AORO/PathTracking-v0"])
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_the_packaged_spaces_are_of_hyper_parameters(algo, env):
    """Whatever is drawn of them, the algorithm takes it."""
    plan = TrainingPlan(env=env, algo=algo)
    space = read_space(SPACES, algo)
    for pick in (0, -1):
        params = [one.text(one.choices[pick] if one.choices else (one.low, one.high)[pick]) for one in space]
        recipe = read_recipe(replace(plan, param=params)).hyperparams
        assert not {one.name for one in space} - set(recipe)
        if algo == "ppo":  # no truncated batches
            assert recipe["n_envs"] * recipe["n_steps"] % recipe["batch_size"] == 0
        if algo == "dagger":
            pytest.importorskip("torch")
            from aoro_gym.agents.training.dagger import Hyperparams

            assert Hyperparams(**recipe).learning_rate == recipe["learning_rate"]
        else:
            library = pytest.importorskip("stable_baselines3")
            known = inspect.signature(getattr(library, algo.upper())).parameters
            assert {one.name for one in space} <= set(known)


def test_numbers_and_choices_are_written_as_after_param():
    assert Dimension("tau", low=0.001, high=0.1, log=True).text(0.0123456) == "tau=0.0123"
    assert (
        Dimension("learning_rate", low=0.001, high=0.1, form="lin_{:.2g}").text(0.0123456) == "learning_rate=lin_0.012"
    )
    assert Dimension("net_arch", choices=("[64, 64]",)).text("[64, 64]") == "net_arch=[64, 64]"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sac: {tau: [1]}", "space.yml says nothing of ppo"),
        ("ppo: []", r"space.yml: ppo is \[\]; give it hyper-parameters by name"),
        ("ppo: {tau: []}", r"space.yml, ppo: tau lies from nan to nan; give low < high, or a list of choices"),
        ("ppo: {tau: 3}", r"space.yml, ppo: "),
        ("ppo: {tau: {low: 2, high: 1}}", "tau lies from 2 to 1; give low < high"),
        ("ppo: {tau: {low: 0, high: 1, log: true}}", "low of tau is 0, but must be above 0 where log is true"),
        ("ppo: {tau: {least: 0}}", "space.yml, ppo: .*least"),
    ],
)
def test_a_wrong_space_is_named(tmp_path, text, said):
    file: Path = tmp_path / "space.yml"
    file.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_space(file, "ppo")


def test_a_trial_that_failed_comes_last_and_says_why(tmp_path):
    for name, mean in (("a", 1.0), ("b", 3.0), ("c", None)):
        place = tmp_path / "trials" / name
        place.mkdir(parents=True)
        (place / "trial.json").write_text('{"params": ["tau=1"]}')
        if mean is None:
            (place / "error.txt").write_text("ValueError: no\n")
        else:
            (place / "evaluations.json").write_text(
                json.dumps({"evaluations": [{"steps": 5, "figures": {"return": {"mean": mean}}}]})
            )
    (tmp_path / "trials" / "d").mkdir()  # about to begin
    found = read_trials(tmp_path)
    assert [(one.folder.name, one.value, one.failed) for one in found] == [
        ("b", 3.0, ""), ("a", 1.0, ""), ("c", WORST, "ValueError: no"),
    ]  # fmt: skip
    assert found[0].params == ("tau=1",) and found[2].best is None
