"""Trainings that are killed at random moments, without room or twice in a folder end as they would have without."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.agents.killed_training import TRAINING, assert_same_training
from tests.agents.killing import ROOT, largest_file, ran, said, small_disk

SMALL = [
    *(
        "train",
        "--env",
        "AORO/Turning-v0",
        "--seed",
        "5",
        "--steps",
        "100",
        "--n-envs",
        "2",
        "--checkpoint-every",
        "25",
    ),
    *("--eval-episodes", "1", "--param", "n_steps=25", "--param", "batch_size=50", "--param", "n_epochs=2"),
]
"""A training of two parts in seconds."""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_training_killed_ten_times_is_the_same(tmp_path: Path, learning: None, seed: int):
    ran(TRAINING, tmp_path, "moments", seed, 600)
    assert_same_training(tmp_path / "whole", tmp_path / "parted")


@pytest.mark.slow
def test_a_training_without_room_says_so_and_goes_on(tmp_path: Path, learning: None):
    run = tmp_path / "run"
    with largest_file(50_000):
        code, text = said([*SMALL, "--out", str(run)])
    assert code == 1
    assert f"error: {run / 'checkpoint.pt'}: File too large; make room and try again" in text
    assert f"afterwards: aoro-gym train --resume {run} goes on" in text
    assert not [file for file in run.rglob("*") if "partial" in file.name or file.name.startswith("policy")]
    assert said(["train", "--resume", str(run)])[0] == 0
    assert len(json.loads((run / "evaluations.json").read_text())["evaluations"]) == 2


@pytest.mark.slow
def test_a_training_on_a_full_disk_says_so_and_goes_on(tmp_path: Path, learning: None):
    with small_disk(tmp_path / "disk") as disk:
        code, text = said([*SMALL, "--out", str(disk / "run")])
        assert code == 1
        assert f"{disk / 'run' / 'checkpoint.pt'}: No space left on device; make room" in text
        assert not [file for file in disk.rglob("*") if "partial" in file.name]
        (disk / "filler").unlink()
        assert said(["train", "--resume", str(disk / "run")])[0] == 0


@pytest.mark.slow
def test_of_two_trainings_in_one_folder_one_is_refused(tmp_path: Path, learning: None):
    command = [sys.executable, "-m", "aoro_gym", *SMALL, "--out", str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT, "env": dict(os.environ)}
    both = [subprocess.Popen(command, **pipes) for _ in range(2)]
    texts = [one.communicate(timeout=300)[1] for one in both]
    codes = [one.returncode for one in both]
    assert sorted(codes) == [0, 2], texts
    refused = texts[codes.index(2)]
    other = both[codes.index(0)].pid
    assert f"is in use by process {other} on" in refused or "holds a training" in refused
    assert len(json.loads((tmp_path / "evaluations.json").read_text())["evaluations"]) == 2
