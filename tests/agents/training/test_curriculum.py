"""Curricula: their stages, and what is wrong in them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aoro_gym.agents.training.curriculum import SPREADS, curriculum, stage_at
from aoro_gym.agents.training.plan import HYPERPARAMS
from aoro_gym.agents.training.recipe import entry_of
from aoro_gym.envs.loading.config import MILD as LOADING_MILD
from aoro_gym.envs.loading.rewards import REWARD_TERMS as LOADING_TERMS
from aoro_gym.envs.path_tracking.config import MILD as TRACKING_MILD
from aoro_gym.envs.path_tracking.rewards import REWARD_TERMS as TRACKING_TERMS
from aoro_gym.envs.turning.config import FIXED, MILD
from aoro_gym.envs.turning.rewards import REWARD_TERMS
from aoro_gym.envs.turning.task import Turning

TURNING, TRACKING, LOADING = "AORO/Turning-v0", "AORO/PathTracking-v0", "AORO/Loading-v0"


def test_stages_follow_each_other():
    stages = curriculum(
        TURNING,
        [
            {"from": 0.0},
            {
                "from": 0.4,
                "randomisation": {"base": "mild", "sensor_noise": [0.0, 1.0]},
                "reward_terms": {"overshoot": -3.0},
            },
            {"from": 0.7, "randomisation": "mild"},
        ],
    )
    assert [stage_at(stages, share).start for share in (0.0, 0.39, 0.4, 0.69, 0.7, 1.0)] == [
        0.0,
        0.0,
        0.4,
        0.4,
        0.7,
        0.7,
    ]
    assert stages[0].randomisation == FIXED
    assert stages[1].randomisation.sensor_noise == (0.0, 1.0)
    assert stages[1].randomisation.machine_scale == MILD.machine_scale
    task = Turning()
    stages[1].apply(task, REWARD_TERMS)
    assert task.reward_terms["overshoot"].weight == -3.0
    assert task.randomisation is stages[1].randomisation
    stages[2].apply(task, REWARD_TERMS)
    assert task.reward_terms["overshoot"] == REWARD_TERMS["overshoot"]


def test_stages_may_add_what_a_task_does_without():
    first, *_ = curriculum(TRACKING, [{"from": 0, "randomisation": "mild", "reward_terms": {"exact_progress": 2.0}}])
    assert first.randomisation == TRACKING_MILD
    task: Any = SimpleNamespace()
    first.apply(task, TRACKING_TERMS)
    assert set(task.reward_terms) == {*TRACKING_TERMS, "exact_progress"}
    # 0.025 m in a step of 0.05 s at 0.75 m/s of working speed is 2/3; at 0.03 m off the path it is worth half; 0.05 m are
    # 4/3, of which what is beyond 1.1 counts against
    view = SimpleNamespace(
        progress=np.array([0.025, 0.025, 0.05]),
        control_step=0.05,
        working_speed=0.75,
        cross_track=np.array([0.0, -0.03, 0.0]),
        xp=np,
    )
    term = task.reward_terms["exact_progress"]
    np.testing.assert_allclose(term.weight * term.function(view), [4.0 / 3.0, 2.0 / 3.0, 2.0 * (2.2 - 4.0 / 3.0)])


def test_flow_beyond_the_full_one_can_cost():
    first, *_ = curriculum(TURNING, [{"from": 0, "reward_terms": {"flow_excess": -2.0}}])
    task: Any = SimpleNamespace()
    first.apply(task, REWARD_TERMS)
    term = task.reward_terms["flow_excess"]
    # of 1.2e-3 m3/s, either side
    view = SimpleNamespace(flows=np.array([[1.8e-3, -1.8e-3, 1.2e-3, 0.0]]), xp=np)
    np.testing.assert_allclose(term.weight * term.function(view), [-1.0, -1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("name", ["fixed", "mild"])
@pytest.mark.parametrize("env", SPREADS)
def test_a_packaged_curriculum_is_one_spread_from_the_beginning(env, name):
    pytest.importorskip("yaml")
    (stage,) = curriculum(env, entry_of(HYPERPARAMS / f"{name}.yml", env))
    spread = SPREADS[env][name]
    assert (stage.start, stage.reward_terms) == (0.0, {})
    assert (stage.randomisation.machine_scale, stage.randomisation.sensor_noise) == (
        spread.machine_scale,
        spread.sensor_noise,
    )


def test_swing_costs_more_where_loading_ppo_learned():
    pytest.importorskip("yaml")
    (stage,) = curriculum(LOADING, entry_of(HYPERPARAMS / "loading_sway.yml", LOADING))
    assert stage.start == 0.0 and stage.randomisation == LOADING_MILD
    task: Any = SimpleNamespace()
    stage.apply(task, LOADING_TERMS)
    weights = {name: (term.weight, LOADING_TERMS[name].weight) for name, term in task.reward_terms.items()}
    changed = {name: both for name, both in weights.items() if both[0] != both[1]}
    assert changed == {"sway": (pytest.approx(3.0 * LOADING_TERMS["sway"].weight), LOADING_TERMS["sway"].weight)}


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([], "must be a list of at least one stage"),
        ([{"randomisation": "mild"}], "stage 0 .* must have 'from'"),
        ([{"from": 0, "randomisation": "wild"}], "stage 0 .* randomisation is 'wild'; choose one of: fixed, mild"),
        (
            [{"from": 0, "randomisation": {"noise": [0, 1]}}],
            "field of randomisation is 'noise'; choose one of: machine, ",
        ),
        ([{"from": 0, "reward_terms": {"exact_progress": 1.0}}], "has no 'exact_progress' to weigh"),
        ([{"from": 0, "randomisation": {"sensor_noise": [1, 0]}}], "randomisation.sensor_noise is .1, 0., but must be"),
        ([{"from": 0}, {"from": 0}], "but must begin at 0 and rise"),
    ],
)
def test_wrong_curricula_are_named(entries, message):
    with pytest.raises(ValueError, match=message):
        curriculum(TURNING, entries)
