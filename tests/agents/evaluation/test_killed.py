"""Killed at any moment, on a full disk or twice at once: what is resumed is what would have been without, to the bit."""

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app

TURNING = "AORO/Turning-v0"
ROOT = Path(__file__).resolve().parents[3]
SMALL = [
    *("train", "--env", TURNING, "--seed", "5", "--steps", "100", "--n-envs", "2", "--checkpoint-every", "25"),
    *("--eval-episodes", "1", "--param", "n_steps=25", "--param", "batch_size=50", "--param", "n_epochs=2"),
]
"""A training of two parts in seconds."""
EVALUATE = ["evaluate", "--env", TURNING, "--policy", "bang-bang", "--episodes", "2", "--no-films", "--out"]

KILLS = """
import os, random, signal, sys, time
from pathlib import Path

def child(work):
    begun = os.fork()
    if begun:
        return begun
    try:
        work()
        os._exit(0)
    except BaseException:
        import traceback
        traceback.print_exc()
        os._exit(1)

def whole(work):
    ended = os.waitpid(child(work), 0)[1]
    assert ended == 0, ended

def killed(work, longest, times, rng):
    'Begin again and again, kill at random moments; how often it was killed before it was done.'
    count = 0
    while count < times:
        begun = child(work)
        time.sleep(rng.uniform(0.0, longest))
        os.kill(begun, signal.SIGKILL)
        if os.WIFSIGNALED(os.waitpid(begun, 0)[1]):
            count += 1
    return count

def killed_at(work, call):
    'Die just before the file operation of this number.'
    replace, done = os.replace, [0]
    def counted(*names):
        done[0] += 1
        if done[0] == call:
            os.kill(os.getpid(), signal.SIGKILL)
        replace(*names)
    def mortal():
        os.replace = counted
        work()
    ended = os.waitpid(child(mortal), 0)[1]
    return os.WIFSIGNALED(ended)
"""

TRAINING = """
import torch
from aoro_gym import Machine
from aoro_gym.agents.training import train as training
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.run_folder import continued
from aoro_gym.cli import app
import aoro_gym.agents.training.stable_baselines

out, mode = Path(sys.argv[1]), sys.argv[2]
machine = Machine.load("aoro")
values = {"steps": int(sys.argv[4]), "n_envs": 2, "checkpoint_every": 25, "eval_episodes": 1, "seed": 5}
plan = TrainingPlan(param=["n_steps=25", "batch_size=50", "n_epochs=2"], **values)

def work_in(folder):
    return lambda: training.train(plan, continued(plan, folder), folder, machine=machine)
"""

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


COMPARISON = """began = time.perf_counter()
whole(work_in(out / "whole"))
took = time.perf_counter() - began
if mode == "moments":
    killed(work_in(out / "parted"), took / 3.0, 10, random.Random(int(sys.argv[3])))
else:
    for call in map(int, sys.argv[3].split(",")):
        assert killed_at(work_in(out / "parted"), call)
whole(work_in(out / "parted"))
"""
"""Once without, and once with kills."""


def ran(program: str, *arguments: object) -> None:
    done = subprocess.run(
        [sys.executable, "-c", KILLS + program + COMPARISON, *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


def assert_same_training(one: Path, other: Path) -> None:
    for name in ("policy.safetensors", "best.safetensors", "policy.json", "best.json"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    evaluations = [json.loads((folder / "evaluations.json").read_text())["evaluations"] for folder in (one, other)]
    assert [[part["steps"], part["figures"]] for part in evaluations[0]] == [
        [part["steps"], part["figures"]] for part in evaluations[1]
    ]
    assert not [file for file in other.rglob("*") if "partial" in file.name]


@pytest.fixture
def learning() -> None:
    for module in ("stable_baselines3", "tensorboard", "yaml"):
        pytest.importorskip(module)


@pytest.mark.slow
def test_a_training_killed_between_its_files_is_the_same(tmp_path: Path, learning: None):
    """After the checkpoint of the first part: before its policy's numbers, its evaluations and the next checkpoint."""
    ran(TRAINING, tmp_path, "calls", "4,5,3", 100)
    assert_same_training(tmp_path / "whole", tmp_path / "parted")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_training_killed_ten_times_is_the_same(tmp_path: Path, learning: None, seed: int):
    ran(TRAINING, tmp_path, "moments", seed, 600)
    assert_same_training(tmp_path / "whole", tmp_path / "parted")


@pytest.mark.slow
def test_a_training_killed_before_every_file_operation_is_the_same(tmp_path: Path, learning: None):
    for call in range(1, 14):
        ran(TRAINING, tmp_path / str(call), "calls", call, 100)
        assert_same_training(tmp_path / str(call) / "whole", tmp_path / str(call) / "parted")


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


# ---- no room ---------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    """A limit on the size of files, which the kernel reports much as it does a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@contextlib.contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A file system of 1 MB of which 0.1 MB are free until its file ``filler`` goes."""
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no file system of 1 MB: {mounted.stderr.decode().strip()}")
    try:
        (folder / "filler").write_bytes(bytes(920_000))
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def said(command: list[str]) -> tuple[int, str]:
    shown = CliRunner().invoke(app, command, catch_exceptions=False)
    return shown.exit_code, " ".join(shown.stderr.split())


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


def test_an_evaluation_without_room_says_so_and_goes_on(tmp_path: Path):
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


# ---- twice at once ---------------------------------------------------------------------------------------------------


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
