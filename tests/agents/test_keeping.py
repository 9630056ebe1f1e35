"""Episodes that were driven before an evaluation was interrupted are not driven again."""

import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import aoro_gym
from aoro_gym.agents import evaluation, leaderboard
from aoro_gym.agents.evaluation import TRIALS, Episodes, evaluate, policy_factory
from aoro_gym.agents.keeping import FOLDER, PACKAGES, Kept, resumable
from aoro_gym.agents.perturbations import perturbed
from aoro_gym.twin import Machine

TURNING = "AORO/Turning-v0"
NAMES = ("proportional-derivative", "turning-ppo")
"""A controller, and a policy of numbers."""
MACHINE = Machine.load("aoro")


def policies():
    """Made anew, as another process would."""
    return {name: policy_factory(TURNING, name) for name in NAMES}


def assert_same(found, expected):
    for field in fields(Episodes):
        mine, theirs = getattr(found, field.name), getattr(expected, field.name)
        if field.name == "figures":
            assert mine.keys() == theirs.keys()
            for name, values in mine.items():
                np.testing.assert_array_equal(values, theirs[name])
        elif field.name == "endings":
            assert mine == theirs
        else:
            np.testing.assert_array_equal(mine, theirs)
            assert mine.dtype == theirs.dtype


@pytest.fixture
def drives(monkeypatch):
    """Sizes of what is driven, which a test may limit."""
    driven: list[int] = []
    plain = TRIALS[TURNING].drive

    def counted(env, policy, seeds, tell=lambda share: None):
        if len(driven) == limit[0]:
            raise KeyboardInterrupt
        driven.append(len(seeds))
        return plain(env, policy, seeds, tell)

    limit = [10_000]
    monkeypatch.setitem(TRIALS, TURNING, replace(TRIALS[TURNING], drive=counted))
    return driven, limit


def test_an_interrupted_evaluation_goes_on_where_it_was(tmp_path, monkeypatch, drives):
    """Three parts of two policies on drawn machines, interrupted after the third of six."""
    driven, limit = drives
    monkeypatch.setattr(evaluation, "AT_ONCE", 2)
    whole = evaluate(TURNING, policies(), episodes=6, seed=3, drawn=perturbed)
    assert driven == [2] * 6
    driven.clear()
    limit[0] = 3
    with pytest.raises(KeyboardInterrupt):
        evaluate(TURNING, policies(), episodes=6, seed=3, drawn=perturbed, kept=tmp_path)
    assert len(list(tmp_path.iterdir())) == 3
    driven.clear()
    limit[0] = 10_000
    again = evaluate(TURNING, policies(), episodes=6, seed=3, drawn=perturbed, kept=tmp_path)
    assert driven == [2] * 3
    for name in NAMES:
        assert_same(again.runs[name], whole.runs[name])


def test_what_would_be_driven_otherwise_is_driven(tmp_path, drives):
    """Other seeds, machines, rewards or policies are none of those that were kept."""
    driven, _ = drives

    def drive(policy: str = NAMES[0], seed: int = 3, **changes: Any) -> int:
        evaluate(TURNING, {NAMES[0]: policies()[policy]}, episodes=2, seed=seed, kept=tmp_path, **changes)
        return len(driven)

    assert (drive(), drive()) == (1, 1)
    assert drive(seed=4) == 2
    assert drive(machine=MACHINE.scale({"steering.pump.margin": 0.9})) == 3
    assert drive(reward_terms={"overshoot": -20.0}) == 4
    assert drive(policy=NAMES[1]) == 5
    assert drive() == 5


def test_every_source_of_an_episode_is_looked_at():
    folder = Path(aoro_gym.__file__).parent
    assert all(any((folder / package).rglob("*.py")) for package in PACKAGES)


def test_a_broken_file_is_driven_again(tmp_path, drives):
    driven, _ = drives
    pd = {NAMES[0]: policies()[NAMES[0]]}
    first = evaluate(TURNING, pd, episodes=2, kept=tmp_path)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:100])
    again = evaluate(TURNING, pd, episodes=2, kept=tmp_path)
    assert len(driven) == 2
    assert_same(again.runs[NAMES[0]], first.runs[NAMES[0]])


def test_what_cannot_be_told_apart_is_not_kept(tmp_path):
    """A policy that is made by a function of a function, say."""
    inner = policies()[NAMES[0]]
    evaluate(TURNING, {"mine": lambda env: inner(env)}, episodes=1, kept=tmp_path)
    assert not list(tmp_path.iterdir())
    assert Kept(None).find(inner, [1], MACHINE) is None


def test_another_process_finds_what_was_kept(tmp_path):
    """Digests do not hang on the process."""
    program = (
        "from aoro_gym.agents.evaluation import evaluate, policy_factory\n"
        "from pathlib import Path\n"
        f"policies = {{name: policy_factory({TURNING!r}, name) for name in {NAMES!r}}}\n"
        f"evaluate({TURNING!r}, policies, episodes=1, kept=Path({str(tmp_path)!r}))\n"
    )
    files = []
    for _ in range(2):
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
        files.append(sorted(path.name for path in tmp_path.iterdir()))
    assert len(files[0]) == 2
    assert files[1] == files[0]


def test_the_leaderboard_keeps_all_perturbations_and_clears_up(tmp_path, drives):
    driven, _ = drives
    pd = {NAMES[0]: policies()[NAMES[0]]}
    with pytest.raises(KeyboardInterrupt), resumable(tmp_path) as kept:
        leaderboard.compare(TURNING, pd, episodes=1, kept=kept)
        raise KeyboardInterrupt
    assert len(driven) == len(list((tmp_path / FOLDER).iterdir())) == 3
    with resumable(tmp_path) as kept:
        leaderboard.compare(TURNING, pd, episodes=1, kept=kept)
    assert len(driven) == 3
    assert not (tmp_path / FOLDER).exists()
