"""Trainings that are killed just before a file operation end as they would have without."""

from pathlib import Path

import pytest

from tests.agents.killed_training import TRAINING, assert_same_training
from tests.agents.killing import ran


@pytest.mark.slow
def test_a_training_killed_between_its_files_is_the_same(tmp_path: Path, learning: None):
    """After the checkpoint of the first part: before its policy's numbers, its evaluations and the next checkpoint."""
    ran(TRAINING, tmp_path, "calls", "4,5,3", 100)
    assert_same_training(tmp_path / "whole", tmp_path / "parted")


@pytest.mark.slow
def test_a_training_killed_before_every_file_operation_is_the_same(tmp_path: Path, learning: None):
    for call in range(1, 14):
        ran(TRAINING, tmp_path / str(call), "calls", call, 100)
        assert_same_training(tmp_path / str(call) / "whole", tmp_path / str(call) / "parted")
