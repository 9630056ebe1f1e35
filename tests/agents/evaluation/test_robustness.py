"""Robustness: each condition differs in one way, changes are those of the same episodes, the worst comes first."""

import json

import numpy as np
import pytest

from aoro_gym.agents.evaluation import batches, robustness
from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.leaderboard import SEED
from aoro_gym.agents.evaluation.perturbations import SWITCHABLE
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES
from tests.agents.episodes import shortened_episodes

TURNING = "AORO/Turning-v0"
CHOSEN = ("as calibrated", "laws of vehicle", "all parameters drawn", "spool_lag +0.04 s", "seal_friction +2e+03 N")


def named(conditions, name):
    return next(one for one in conditions if one.name == name)


@pytest.fixture(scope="module")
def machine():
    """One on which a slower spool makes controllers overshoot: of `aoro` a bang-bang controller does not."""
    return Machine.load("aoro_least_squares")


@pytest.fixture(scope="module")
def every(machine):
    return robustness.conditions(machine)


@pytest.fixture(scope="module")
def found(every, machine):
    policies = {name: policy_factory(TURNING, name) for name in ("bang-bang", "proportional-derivative")}
    with shortened_episodes(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(robustness, "conditions", lambda machine, share: [named(every, name) for name in CHOSEN])
        patch.setattr(batches, "AT_ONCE", 4)  # of which some hold episodes of two conditions
        return robustness.measure(TURNING, policies, episodes=6, machine=machine)


def test_all_effects_and_laws_have_their_turn(every, machine):
    names = [one.name for one in every]
    assert len(set(names)) == len(names)
    assert {one.name.split()[0] for one in every if one.kind in {e.component for e in EFFECTS.values()}} == set(
        SWITCHABLE
    )
    assert {one.name.split()[-1] for one in every if one.kind == "laws"} == set(FAMILIES) - {"default"}
    both = [name for name in names if name.startswith("valve_gain ")]
    factor = EFFECTS["valve_gain"].magnitudes[0]
    assert both == [
        f"valve_gain ×{np.sqrt(end):.3g}" for end in (factor.high, factor.low)
    ]  # half of the logarithm's way
    assert len([name for name in names if name.startswith("seal_friction ")]) == 1  # its range has one side


def test_a_condition_is_its_effect_and_nothing_else(every, machine):
    driven = named(every, "spool_lag +0.04 s").machines(machine, [1, 2])
    differing = {key for key, entry in driven.entries.items() if entry.value != machine.entries[key].value}
    assert differing == {"steering.valve.spool_time_constant"}
    assert driven.steering.valve.spool_time_constant == pytest.approx(machine.steering.valve.spool_time_constant + 0.04)
    laws = named(every, "laws of vehicle").machines(machine, [1])
    assert laws.laws.names == machine.laws.names | FAMILIES["vehicle"]


def test_sizes_that_no_machine_can_have_are_left_out(machine, monkeypatch):
    def refuses(self, of, *size):
        if self.id == "spool_lag":
            raise ValueError("no")
        return of

    monkeypatch.setattr(robustness.MachineEffect, "apply", refuses)
    assert not any(one.name.startswith("spool_lag") for one in robustness.conditions(machine))


@pytest.mark.parametrize("share", [0.0, -0.5, 1.1])
def test_a_share_beyond_the_range_is_refused(machine, share):
    with pytest.raises(ValueError, match=f"share is {share:g}"):
        robustness.conditions(machine, share)


def test_changes_are_those_of_the_same_episodes(found, every, machine):
    name = "spool_lag +0.04 s"
    with shortened_episodes():
        policies = {"bang-bang": policy_factory(TURNING, "bang-bang")}
        lagging = evaluate(TURNING, policies, episodes=6, seed=SEED, machine=machine, drawn=named(every, name).machines)
        as_is = evaluate(TURNING, policies, episodes=6, seed=SEED, machine=machine)
    difference = lagging.runs["bang-bang"].metrics["overshoot_deg"] - as_is.runs["bang-bang"].metrics["overshoot_deg"]
    change = found.changes[name]["bang-bang"]["overshoot_deg"]
    assert change.mean == pytest.approx(np.nanmean(difference))
    for metric, values in lagging.runs["bang-bang"].metrics.items():
        np.testing.assert_array_equal(found.found[name].runs["bang-bang"].metrics[metric], values)
    assert change.mean > 0.1  # a slower spool overshoots: what is measured is not noise
    assert found.changes["seal_friction +2e+03 N"]["bang-bang"]["overshoot_deg"].mean < change.mean


@pytest.mark.parametrize("name", ["all parameters drawn", "laws of vehicle"])
def test_every_condition_is_driven_as_alone(found, every, machine, name):
    with shortened_episodes():
        policies = {"proportional-derivative": policy_factory(TURNING, "proportional-derivative")}
        alone = evaluate(TURNING, policies, episodes=6, seed=SEED, machine=machine, drawn=named(every, name).machines)
    (run,) = alone.runs.values()
    together = found.found[name].runs["proportional-derivative"]
    assert together.endings == run.endings
    for metric, values in run.metrics.items():
        np.testing.assert_array_equal(together.metrics[metric], values)


def test_the_worst_for_the_best_policy_comes_first(found):
    assert found.policies[0] == "proportional-derivative"
    lost = [found.changes[name]["proportional-derivative"]["success_rate"].mean for name in found.worst_first]
    later = [found.changes[name]["proportional-derivative"]["settling_time_s"].mean for name in found.worst_first]
    order = list(zip(np.negative(lost), later, strict=True))
    assert order == sorted(order, reverse=True) and order[0] > order[-1]
    assert set(found.worst_first) == set(CHOSEN[1:])


def test_files_and_tables(found, tmp_path):
    summary, picture = robustness.write(found, tmp_path, made_by={"seed": 1})
    content = json.loads(summary.read_text())
    assert content["share"] == 0.5
    assert content["conditions"]["spool_lag +0.04 s"] == {"kind": "valve"}
    assert content["worst_first"] == found.worst_first
    assert content["changes"]["all parameters drawn"]["bang-bang"]["success_rate"]["episodes"] == 6
    assert picture.read_bytes().startswith(b"\x89PNG")
    success, settling, *_ = robustness.tables(found)
    assert [row[0] for row in success.rows] == ["as calibrated", *found.worst_first]
    assert str(settling.rows[1][1]).startswith("+")
