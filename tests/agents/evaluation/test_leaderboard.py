"""The leaderboard: everyone on the same strange machines, ranks and differences that follow from what was driven."""

import json
import math

import numpy as np
import pytest
from scipy.stats import trim_mean

from aoro_gym.agents.evaluation import leaderboard
from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.metrics import ranked, shown
from aoro_gym.agents.evaluation.perturbations import PERTURBATIONS, perturbed
from aoro_gym.agents.evaluation.statistics import Interval, interquartile_mean, interval, stratified_interval
from tests.agents.episodes import SHORT, shortened_episodes

TURNING = "AORO/Turning-v0"


class Still:
    """Never moves."""

    def __init__(self, env):
        self.told = env.unwrapped.twin.machine.num_variants

    def __call__(self, observations):
        return np.zeros((len(observations), 1), dtype=np.float32)

    def reset(self, mask=None):
        pass


@pytest.fixture(scope="module")
def found():
    policies = {"still": Still, "proportional-derivative": policy_factory(TURNING, "proportional-derivative")}
    with shortened_episodes():
        return leaderboard.compare(TURNING, policies, episodes=4, seed=3)


def test_every_perturbation_is_driven_by_everyone(found):
    assert list(found.found) == list(PERTURBATIONS)
    for result in found.found.values():
        assert list(result.runs) == ["still", "proportional-derivative"]
        assert len(result.runs["still"].endings) == 4
    returns = [result.runs["proportional-derivative"].metrics["return"] for result in found.found.values()]
    assert np.all(returns[0] != returns[1])
    assert np.all(returns[1] != returns[2])


def test_who_does_not_move_is_last(found):
    assert found.policies == ["proportional-derivative", "still"]
    assert found.best_reference == "proportional-derivative"
    assert found.middle["perturbed"]["still"]["success_rate"].mean == 0.0


def test_cells_are_interquartile_means(found):
    run = found.found["perturbed"].runs["proportional-derivative"]
    cell = found.middle["perturbed"]["proportional-derivative"]["overshoot_deg"]
    assert cell.mean == pytest.approx(trim_mean(run.metrics["overshoot_deg"], 0.25))
    assert cell.low95 <= cell.mean <= cell.high95
    result = found.found["perturbed"]
    difference = result.less("still", "proportional-derivative", ["final_error_deg"])["final_error_deg"]
    other = result.runs["still"].metrics["final_error_deg"]
    assert difference.mean == pytest.approx((other - run.metrics["final_error_deg"]).mean())


def test_who_never_settles_is_not_the_quickest(found):
    """Its times are lower bounds, it has no overshoot, and no difference says otherwise."""
    for name in PERTURBATIONS:
        run, cells = found.found[name].runs["still"], found.middle[name]["still"]
        assert run.metrics["success_rate"].sum() == 0.0
        settling = cells["settling_time_s"]
        assert settling.bounds == settling.episodes == 4
        # its only target stands to the end of the episode
        assert settling.mean == pytest.approx(0.02 * SHORT)
        assert settling.mean > found.middle[name]["proportional-derivative"]["settling_time_s"].mean
        assert leaderboard.cell(found, name, "still", "settling_time_s").startswith("≥ ")
        assert (cells["overshoot_deg"].episodes, np.isnan(cells["overshoot_deg"].mean)) == (0, True)
        assert leaderboard.cell(found, name, "still", "overshoot_deg") == "-"
        assert found.differences[name]["still"]["settling_time_s"].episodes == 0
    plain = found.to_json()["evaluations"]["perturbed"]
    assert plain["ranking"] == ["proportional-derivative", "still"]
    assert plain["policies"]["still"]["settling_time_s"]["lower_bounds"] == 4
    assert plain["policies"]["still"]["overshoot_deg"] == {"mean": None, "low95": None, "high95": None, "episodes": 0}
    assert plain["over"]["overshoot_deg"] == "targets that were reached"


def test_success_ranks_before_all_else():
    def metrics(success: float, settling: float) -> dict[str, Interval]:
        return {
            name: Interval(value, value, value)
            for name, value in (("success_rate", success), ("settling_time_s", settling), ("speed_m_per_s", settling))
        }

    policies = {
        "quick": metrics(0.5, 0.1),
        "never": metrics(0.0, math.nan),
        "slow": metrics(1.0, 2.0),
        "good": metrics(1.0, 1.0),
    }
    assert ranked(policies, "settling_time_s") == ["good", "slow", "quick", "never"]
    assert ranked(policies, "speed_m_per_s") == ["slow", "good", "quick", "never"]


def test_policies_know_the_machine_of_the_file_only():
    told = []

    def make(env):
        told.append(Still(env).told)
        return Still(env)

    result = evaluate(TURNING, {"still": make}, episodes=3, seed=3, drawn=perturbed)
    assert told == [1]
    assert result.machine.num_variants == 1


def test_files_hold_the_table(found, tmp_path):
    readme = tmp_path / "README.md"
    mark = f"<!-- leaderboard {TURNING}"
    readme.write_text(f"before\n{mark} -->\nold\n{mark} end -->\nafter\n")
    written = leaderboard.write(found, tmp_path / "out", readme=readme)
    assert [path.name for path in written] == ["leaderboard.json", "leaderboard.md", "leaderboard.png", "README.md"]
    content = json.loads(written[0].read_text())
    assert content["policies"] == ["proportional-derivative", "still"]
    assert set(content["interquartile_means"]) == set(PERTURBATIONS)
    assert content["evaluations"]["perturbed"]["policies"]["still"]["success_rate"]["mean"] == 0.0
    text = readme.read_text()
    table = written[1].read_text()
    assert text == f"before\n{mark} -->\n{table}{mark} end -->\nafter\n"
    assert "| settling time [s], with an effect |" in table
    head, *body = leaderboard.rows(found)
    assert {len(row) for row in body} == {len(head)}


@pytest.mark.slow
def test_cells_of_repeats_have_both_intervals(tmp_path):
    policies = {name: policy_factory(TURNING, name) for name in ("bang-bang", "proportional-derivative")}
    found = leaderboard.compare(TURNING, policies, episodes=3, repeats=2, seed=3)
    run = found.found["perturbed"].runs["bang-bang"]
    values = run.metrics["settling_time_s"]
    assert values.shape == (6,)
    narrow = found.stratified["perturbed"]["bang-bang"]["settling_time_s"]
    bounds = int((run.metrics["settled_share"] < 1.0).sum())
    assert narrow == stratified_interval(values, np.tile(np.arange(3), 2), statistic=interquartile_mean)._replace(
        bounds=bounds
    )
    wide = found.middle["perturbed"]["bang-bang"]["settling_time_s"]
    assert wide == interval(values.reshape(2, 3).T, statistic=interquartile_mean)._replace(bounds=bounds)
    assert wide.mean == narrow.mean
    cell = leaderboard.cell(found, "perturbed", "bang-bang", "settling_time_s")
    assert cell == f"{shown(narrow, 's', finer=1)}, [{shown(wide, 's').partition('[')[2]}"
    assert cell.count("[") == 2
    assert leaderboard.cell(found, "perturbed", "bang-bang", "success_rate").count("[") == 1
    assert "3 episodes a cell, each driven 2 times" in leaderboard.markdown(found)
    content = found.to_json()
    assert set(content["stratified_interquartile_means"]) == set(PERTURBATIONS)
    other = found.found["perturbed"].runs["proportional-derivative"].exact("settling_time_s")
    gap = (run.exact("settling_time_s") - other) * (1.0 if found.best_reference == "proportional-derivative" else -1.0)
    (worse,) = found.differences["perturbed"].values()
    assert worse["settling_time_s"] == interval(gap.reshape(2, 3).T, statistic=np.nanmean)


def test_a_readme_without_marks_is_said(tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("nothing")
    with pytest.raises(ValueError, match="lacks the lines <!-- leaderboard"):
        leaderboard.around_table(readme, TURNING)
