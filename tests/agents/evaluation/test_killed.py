"""Evaluations that are killed at any moment or find no room end as they would have without."""

import json
from pathlib import Path

import pytest

from tests.agents.killing import largest_file, ran, said, small_disk

EVALUATE = ["evaluate", "--env", "AORO/Turning-v0", "--policy", "bang-bang", "--episodes", "2", "--no-films", "--out"]

EVALUATION = """
import aoro_gym.agents.evaluation.evaluate as evaluation
from aoro_gym.agents.evaluation import batches, cached_episodes
from aoro_gym.execution.files import write_json

out, mode = Path(sys.argv[1]), sys.argv[2]
env = "AORO/Turning-v0"
batches.AT_ONCE = 2
policies = {name: evaluation.policy_factory(env, name) for name in ("proportional-derivative", "turning-ppo")}

def work_in(folder):
    def work():
        with cached_episodes.resumable(folder, {"seed": 3}) as kept:
            found = evaluation.evaluate(env, policies, episodes=int(sys.argv[4]), seed=3, kept=kept)
            write_json(folder / "evaluation.json", found.to_json())
    return work
"""


@pytest.mark.slow
def test_an_evaluation_killed_between_its_files_is_the_same(tmp_path: Path):
    ran(EVALUATION, tmp_path, "calls", "1,3,2", 4)
    assert (tmp_path / "whole" / "evaluation.json").read_bytes() == (
        tmp_path / "parted" / "evaluation.json"
    ).read_bytes()
    assert {file.name for file in (tmp_path / "parted").iterdir()} <= {"evaluation.json", ".lock"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_an_evaluation_killed_ten_times_is_the_same(tmp_path: Path, seed: int):
    ran(EVALUATION, tmp_path, "moments", seed, 40)
    assert (tmp_path / "whole" / "evaluation.json").read_bytes() == (
        tmp_path / "parted" / "evaluation.json"
    ).read_bytes()


def test_an_evaluation_without_room_says_so_and_goes_on(tmp_path: Path, short_episodes: None):
    with largest_file(20_000):
        code, text = said([*EVALUATE, str(tmp_path)])
    assert code == 1
    assert "File too large; make room and try again" in text
    assert "afterwards: the same command goes on from where it stopped" in text
    for file in tmp_path.rglob("*.*"):
        assert "partial" not in file.name
        if file.suffix == ".json":
            json.loads(file.read_text())
    assert said([*EVALUATE, str(tmp_path)])[0] == 0
    assert (tmp_path / "index.html").read_text().rstrip().endswith("</html>")


@pytest.mark.slow
def test_an_evaluation_on_a_full_disk_says_so_and_goes_on(tmp_path: Path):
    with small_disk(tmp_path / "disk") as disk:
        code, text = said([*EVALUATE, str(disk / "out")])
        assert (code, "No space left on device; make room" in text) == (1, True)
        assert not [file for file in disk.rglob("*") if "partial" in file.name]
        (disk / "filler").unlink()
        assert said([*EVALUATE, str(disk / "out")])[0] == 0
