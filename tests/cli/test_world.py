"""The command ``world``: its files, its table, and wrong input in one line."""

import json

import numpy as np
import pytest

from aoro_gym.terrains.world.files import load_world
from tests.cli.calling import call, check_refused


def test_world_on_ground_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("ground.npy", np.add.outer(np.zeros(21), 0.1 * np.arange(31.0)))
    assert call("terrain", "ground.npy", "--cell", 1, "--out", "ground.ply").exit_code == 0
    shown = call("world", "--terrain", "ground.ply", "--seed", 4, "--stems", 500, "--json", "--out", "made")
    assert shown.exit_code == 0, shown.output
    figures = json.loads(shown.stdout)
    made = load_world("made")
    assert figures["objects"] == len(made.objects)
    trees = sum(row["count"] for name, row in figures["classes"].items() if name.startswith("tree"))
    assert trees == made.counts["tree"] > 10
    assert (tmp_path / "made" / "world.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("world --stand palms", "--stand is 'palms'; choose one of: pine, spruce, birch, mixed"),
        ("world --stems -3", "--stems is -3, but must be in [0, 4000]"),
        ("world --size 10 50", "--size, value 1, is 10 m, but must be in [30, 500] m"),
        ("world --out good.csv", "--out good.csv is a file; name a folder"),
        ("world --terrain none.ply", "none.ply: No such file or directory"),
        ("world --seed -1", "--seed is -1"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
