"""Policies that an evaluation is asked for."""

import pytest

from aoro_gym.agents.evaluation.selection import named_policies, strangers


@pytest.mark.parametrize("localisation", [None, "gains", "filter"])
def test_who_learned_with_another_pose_is_named(localisation):
    policies = named_policies("AORO/PathTracking-v1", ["limits-dagger", "limits-filter-dagger", "preview"])
    found = strangers(policies, localisation)
    assert [sentence.partition(" ")[0] for sentence in found] == (["limits-dagger"] if localisation == "filter" else [])
