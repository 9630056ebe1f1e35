"""Plans of trainings: their command, their help, and what is wrong in them."""

import json
import shlex
from dataclasses import fields

import pytest
from typer.testing import CliRunner

from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.cli import app


def test_command_is_the_plan(monkeypatch):
    plan = TrainingPlan(
        seed=3,
        param=["n_steps=16", "policy_kwargs={net_arch: [8]}"],
        set=["oil.gas_fraction=0.01"],
        path="two.gpx",
        track="[/x] day 2",
        join_gaps=True,
    )
    asked = []
    monkeypatch.setattr(
        "aoro_gym.cli.training.TrainingPlan", lambda **values: asked.append(TrainingPlan(**values)) or _stop()
    )
    CliRunner().invoke(app, shlex.split(plan.command)[1:])
    assert asked == [plan]
    assert TrainingPlan.of(json.loads(json.dumps(plan.to_json()))) == plan


def _stop():
    raise ValueError("far enough")


def test_every_field_has_a_help_text():
    for one in fields(TrainingPlan):
        assert one.metadata["help"].endswith(".")
        assert one.metadata["metavar"] or one.default is False  # a switch has no value


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"algo": "dqn"}, "algo is 'dqn'; choose one of: ppo, sac"),
        ({"steps": 0}, "steps is 0, but must be a positive integer"),
        ({"seed": -1}, "seed is -1, but must be an integer of at least 0"),
        ({"observe": ["obstacle_map"]}, "observe is 'obstacle_map'; choose one of: lidar, height_map, depth, camera$"),
        (
            {"env": "AORO/ForestRun-v0", "observe": ["lidar", "map"]},
            "observe is 'map'; choose one of: lidar, height_map, depth, camera, obstacle_map$",
        ),
        ({"trainer": "rllib"}, "trainer is 'rllib'; choose one of: sb3, resident"),
        ({"trainer": "resident", "algo": "sac"}, "algo is 'sac', but the trainer 'resident' has ppo only; give that"),
    ],
)
def test_wrong_plans_are_named(values, message):
    with pytest.raises(ValueError, match=message):
        TrainingPlan(**values)
