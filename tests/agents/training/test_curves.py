"""Learning curves: seeds of one training make one curve, what is judged otherwise is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.agents.training import curves
from aoro_gym.agents.training.curves import read
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.cli import app
from aoro_gym.machine import Machine

pytestmark = pytest.mark.usefixtures("short_episodes")

PLAN = TrainingPlan(env="AORO/Turning-v0", eval_episodes=2, param=["n_steps=16"])
METRICS = ("settling_time_s", "flow_overshoot_share", "overshoot_deg", "success_rate")


def trained(folder: Path, plan: TrainingPlan, values: list[float | None]) -> Path:
    """What a training leaves whose every metric has these means, one an evaluation."""
    folder.mkdir()
    (folder / "training.json").write_text(
        json.dumps({"plan": plan.to_json(), "hyperparams": {}, "curriculum": []}), encoding="utf-8"
    )
    evaluations = [
        {
            "steps": 100 * (k + 1),
            "elapsed_s": 60.0 * (k + 1) + plan.seed,
            "figures": {name: {"mean": value, "low95": None, "high95": None, "episodes": 2} for name in METRICS},
        }
        for k, value in enumerate(values)
    ]
    (folder / "evaluations.json").write_text(json.dumps({"env": plan.env, "evaluations": evaluations}))
    return folder


def test_seeds_make_one_curve(tmp_path):
    folders = [
        trained(tmp_path / "a", PLAN, [0.5, 0.75, 1.0]),
        trained(tmp_path / "b", replace(PLAN, algo="sac"), [None]),
        trained(tmp_path / "c", replace(PLAN, seed=6), [0.25, 0.5]),  # still on the way
    ]
    one, other = read(folders)
    assert (one.name, one.seeds, other.name, other.seeds) == ("ppo", (0, 6), "sac", (0,))
    assert (one.steps, one.minutes) == ([100, 200], [1.1, 2.1])
    np.testing.assert_array_equal(one.metrics["success_rate"], [[0.5, 0.75], [0.25, 0.5]])
    assert np.isnan(other.metrics["success_rate"]).all()
    started = read([trained(tmp_path / "d", replace(PLAN, start="some/taught.json"), [1.0])])
    assert started[0].name == "ppo, from taught"


def test_a_curve_is_the_interquartile_mean_over_the_seeds(tmp_path):
    """Of five, the middle three count in full, by SciPy's trimmed mean; a wild one does not move it."""
    values = [1.0, 2.0, 4.0, 6.0, 1000.0]
    folders = [trained(tmp_path / str(k), replace(PLAN, seed=k), [value, 3.0]) for k, value in enumerate(values)]
    (one,) = read(folders)
    first, last = one.over_seeds("overshoot_deg")
    assert first.mean == 4.0  # (2 + 4 + 6) / 3
    assert 1.0 <= first.low95 <= 4.0 <= first.high95 <= 1000.0
    assert last[:3] == (3.0, 3.0, 3.0)
    (alone,) = read(folders[:1])
    assert alone.over_seeds("overshoot_deg")[0].mean == 1.0 and np.isnan(alone.over_seeds("overshoot_deg")[0].low95)


def test_trainings_of_a_gpu_are_drawn_without_one(tmp_path):
    folder = trained(tmp_path / "a", replace(PLAN, device="cuda:99"), [0.5])
    out = tmp_path / "out"
    call = ["curves", str(folder), "--out", str(out)]
    shown = CliRunner().invoke(app, call)
    assert shown.exit_code == 2 and "cuda:99" in shown.output
    shown = CliRunner().invoke(app, [*call, "--device", "cpu"], catch_exceptions=False)
    assert shown.exit_code == 0 and (out / "curves.json").exists()


def test_failed_episodes_of_an_older_version_are_not_drawn(tmp_path):
    """It let them count: a policy that never settles was the quickest."""
    folder = trained(tmp_path / "a", PLAN, [0.5, 1.0])
    text = (folder / "evaluations.json").read_text()
    (folder / "evaluations.json").write_text(text.replace(', "episodes": 2', ""))
    (one,) = read([folder])
    np.testing.assert_array_equal(one.metrics["success_rate"], [[0.5, 1.0]])
    np.testing.assert_array_equal(one.metrics["settling_time_s"], [[np.nan, 1.0]])


def test_lower_bounds_are_marked_and_success_ranks_first(tmp_path):
    folder = trained(tmp_path / "a", PLAN, [0.1])
    text = (folder / "evaluations.json").read_text()
    (folder / "evaluations.json").write_text(text.replace('"episodes": 2', '"episodes": 2, "lower_bounds": 1', 1))
    (one,) = read([folder])
    assert one.bounds["settling_time_s"].tolist() == [[True]]
    assert not one.bounds["overshoot_deg"].any()
    out = tmp_path / "out"
    shown = CliRunner().invoke(app, ["curves", str(folder), "--out", str(out)], catch_exceptions=False)
    lines = [line for line in shown.output.splitlines() if line.startswith("│")]
    # 0.1 s would be the quickest of all
    assert [line.split()[1] for line in lines][-1] == "ppo"
    assert "≥ 0.1" in lines[-1]


def test_what_cannot_be_drawn_is_named(tmp_path):
    first = trained(tmp_path / "a", PLAN, [0.5])
    other = trained(tmp_path / "b", replace(PLAN, machine="mine.toml"), [0.5])
    with pytest.raises(ValueError, match=r"machine is 'aoro' in one training and 'mine.toml' in another"):
        read([first, other])
    with pytest.raises(ValueError, match=r"are \(0, 0\); give each training once"):
        read([first, first])
    with pytest.raises(ValueError, match="nothing was trained there"):
        read([tmp_path])
    (other / "evaluations.json").write_text("half of it", encoding="utf-8")
    with pytest.raises(ValueError, match=r"evaluations.json is not JSON"):
        read([other])
    (other / "evaluations.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ValueError, match=r"evaluations.json holds no evaluations"):
        read([other])
    (other / "evaluations.json").unlink()
    with pytest.raises(ValueError, match="let its training reach the first evaluation"):
        read([other])
    (other / "training.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ValueError, match=r"training.json is no training's of this version: 'plan'"):
        read([other])
    shown = CliRunner().invoke(app, ["curves", str(tmp_path / "none"), "--out", str(tmp_path / "out")])
    assert shown.exit_code == 2 and "nothing was trained there" in " ".join(shown.output.split())
    assert not (tmp_path / "out").exists()


def test_controllers_drive_with_the_pose_that_trainings_had(tmp_path, monkeypatch):
    plan = replace(PLAN, env="AORO/PathTracking-v1", localisation="filter", device="cpu")
    first, other = (
        trained(tmp_path / "a", plan, [0.5]),
        trained(tmp_path / "b", replace(plan, localisation=None), [0.5]),
    )
    with pytest.raises(ValueError, match="localisation is 'filter' in one training and None in another"):
        read([first, other])
    asked: dict[str, Any] = {}
    monkeypatch.setattr(curves, "evaluate", lambda *_, **others: asked.update(others))
    curves.references(plan, Machine.load("aoro"), None)
    assert asked["localisation"] == "filter"
    assert curves.references_asked(plan, Machine.load("aoro"), None)["localisation"] == "filter"


def test_the_command_draws_them_beside_the_controllers(tmp_path):
    folders = [trained(tmp_path / str(seed), replace(PLAN, seed=seed), [0.4, 0.6 + 0.1 * seed]) for seed in (0, 1)]
    out = tmp_path / "out"
    shown = CliRunner().invoke(app, ["curves", *map(str, folders), "--out", str(out)], catch_exceptions=False)
    assert shown.exit_code == 0, shown.output
    assert (out / "curves.png").read_bytes()[:4] == b"\x89PNG"
    found = json.loads((out / "curves.json").read_text())
    assert found["curves"][0]["figures"]["success_rate"] == [[0.4, 0.6], [0.4, 0.7]]
    assert set(found["references"]) == {"bang-bang", "proportional-derivative"}
    words = " ".join(shown.output.split())
    assert found["curves"][0]["over_seeds"]["overshoot_deg"]["200"] == pytest.approx(
        {"mean": 0.65, "low95": 0.6, "high95": 0.7}
    )
    assert "0.65 [0.6, 0.7]" in words and "bang-bang" in words and "wrote" in words
