"""Commands of README and documentation run: those of the tutorials as written, the others on small inputs."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from tests.cli.terminal.running import in_pipe, in_terminal
from tests.test_docs import PAGES, ROOT, blocks, commands, name_of

pytestmark = pytest.mark.filterwarnings("default")  # what warns a user stops no command

TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
LEAVES = {
    "drive": ("turn.html", "slow.csv", "uphill.json"),
    "train": ("runs/turning/best.json", "evaluation/index.html", "curves/curves.png", "slow/evaluation.json"),
    "scan": ("ground.ply", "evaluation/preview.mcap"),
    "calibrate": ("mine.toml", "validation/index.html", "again.csv"),
    "diagnose": ("diagnosis/report.html",),
    "detect_logs": ("logs.safetensors", "score.json", "found.png"),
}
"""What each tutorial ends with."""
DETECTION = "python -m studies.log_detection "
"""How the command of a study begins that a tutorial shows, beside those of aoro-gym."""
TRACKING = ("--env", "AORO/PathTracking-v0")
TRAINING = ("--steps", "500", "--n-envs", "2", "--checkpoint-every", "250", "--eval-episodes", "1")
SHORTER = {
    "bench": ("--twins", "1", "--seconds", "0.02"),
    "calibrate": ("--laws", "default", "--starts", "1", "--population", "2", "--force"),
    "camera": ("--width", "48", "--samples", "1", "--frames", "1"),
    "curves": (),
    "dataset": ("--frames", "3", "--width", "48", "--samples", "1"),
    "evaluate": ("--episodes", "1", "--no-films"),
    "leaderboard": ("--episodes", "1", "--policy", "bang-bang"),
    "robustness": ("--episodes", "1", "--policy", "bang-bang"),
    "serve": ("--duration", "0.3", "--udp-port", "0", "--tcp-port", "0"),
    "train": (*TRAINING, "--restart"),
    "view": ("--no-browser", "--port", "0"),
}
"""What makes a command end soon: of an option that is given twice the last counts."""
NOT_HERE = {
    "cuda:": "needs a GPU",
    "--gamepad": "needs a gamepad",
    "--fifo": "needs the right to real-time priority",
    "--connect": "the other end of the command before; tests/cosimulation/laboratory runs both",
    "--driveline": "likewise",
    "_0 runs/": "draws trainings that a loop of the shell before it makes",
    "loading_1 runs/": "likewise",
    "export policy": "[onnx] is not installed by `make test`",
    "--diagnosis diagnosis --retrain": "needs a cause that was found; tests/agents/training/test_gap.py has the command",
    "calibrate --published": "minutes; tests/calibration has the procedure",
    "calibrate --procedure": "logs of turns at six levels; tests/calibration/test_measured.py makes them",
    "diagnosis train": "minutes of a GPU",
    "--lock-step": "waits for a client; tests/cosimulation has one",
    "--peer mujoco --startup": "fresh processes, minutes each; tests/benchmark runs both",
}
"""Commands that are not executed, by a part of theirs, and why."""


def run(line: str) -> None:
    """Run a command of a page in the current folder, as the shell would; a live view is closed once it is there."""
    if line.startswith(DETECTION):
        from studies.log_detection.__main__ import main

        assert main(shlex.split(line.removeprefix(DETECTION))) == 0, line
        return
    words = [
        found
        for word in shlex.split(line, comments=True)[1:]
        for found in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    if words[0] == "view":
        shown = in_terminal(*words, folder=Path.cwd(), interrupt="view:", after=3.0)
        assert shown.code == 130 and "Traceback" not in shown.text, f"{line}: {shown.text}"
        return
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, f"{line}: {done.output}"


@pytest.mark.slow
@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_can_be_done_as_written(page, monkeypatch, tmp_path):
    """All of its blocks, in their order, in an empty folder."""
    if page.stem in ("train", "detect_logs"):
        pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    steps = [(text.index(block), "python", block) for block in blocks(page, "python")]
    steps += [(text.index(block), "sh", block) for block in blocks(page, "sh")]
    for _, language, block in sorted(steps):
        if language == "python":
            exec(compile(block, page.name, "exec"), {})
            continue
        for line in block.splitlines():
            assert line.startswith(("aoro-gym ", DETECTION)), line
            run(f"{line} --no-browser --port 0" if line.startswith("aoro-gym view") else line)
    for name in LEAVES[page.stem]:
        assert (tmp_path / name).exists(), name


def wanted(page: Path) -> list[str]:
    """Commands of a page, each once, that can be run here."""
    found = dict.fromkeys(line.partition("  #")[0].strip() for line in commands(page))
    return [line for line in found if not any(part in line for part in NOT_HERE)]


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with all that the pages take as given: ground, paths, logs of two days, machines, tables, trainings."""
    pytest.importorskip("stable_baselines3")
    from aoro_gym.agents.evaluation.pictured_drives import planned
    from aoro_gym.terrains.generate.forest import forest
    from aoro_gym.terrains.generate.scan import scan
    from aoro_gym.terrains.world.files import load_world

    folder = tmp_path_factory.mktemp("place")
    scanned = scan(forest(seed=1), seed=1)
    scanned.save_mesh(folder / "scan.ply")
    scanned.save(folder / "scan.laz")
    line = "x,y\n" + "".join(f"{x},0\n" for x in np.linspace(-15.0, 15.0, 61))
    (folder / "line.csv").write_text(line)
    (folder / "my_crane.csv").write_text("time_s,crane_lift,crane_held_mass_kg\n0,0,0\n0.6,0.5,180\n1.2,0,180\n")
    slow = ("--scale", "steering.valve.spool_time_constant=4")
    turning = ("train", "--env", "AORO/Turning-v0", *TRAINING)
    for words in (
        ("simulate", "-m", "left", "--out", "healthy/left.csv"),
        ("simulate", "-m", "left", *slow, "--out", "later/left.csv"),
        ("terrain", "scan.ply", "--out", "ground.ply"),
        ("world", "--seed", "3", "--size", "60", "60", "--out", "forest"),
        ("validate", "--uncalibrated", "none", "--ensemble", "none", "--out", "validation"),
        (*turning, "--out", "runs/turning"),
        *((*turning, "--seed", str(seed), "--out", f"runs/{seed}") for seed in range(3)),
        (*turning, "--laws", "default,library", "--out", "runs/robust"),
        ("train", *TRACKING, "--terrain", "ground.ply", *TRAINING, "--out", "runs/mine"),
        ("train", *TRACKING, "--algo", "dagger", *TRAINING, "--out", "runs/taught"),
        ("diagnose", "later/left.csv", "--healthy", "healthy/left.csv", "--out", "diagnosis"),
    ):
        made = in_pipe(*words, "--quiet", folder=folder)
        assert made.returncode == 0, f"{words}: {made.stderr}"
    way = planned(load_world(folder / "forest"), 0).points
    np.savetxt(folder / "track.csv", way, delimiter=",", header="x,y", comments="")
    for copy in ("before", "healthy"):
        shutil.copy(folder / "healthy/left.csv", folder / f"{copy}.csv")
    for copy in ("after", "later"):
        shutil.copy(folder / "later/left.csv", folder / f"{copy}.csv")
    table = (ROOT / "aoro_gym/validation/data/left_turn_metrics.csv").read_text(encoding="utf-8")
    figures = [line for line in table.splitlines() if not line.startswith("#")]
    own = [
        line.replace(",physical,", f",{name},")
        for name in ("later", "machine")
        for line in figures
        if ",physical," in line
    ]
    before = [line.replace(",mevea,", ",before,") for line in figures if ",mevea," in line]
    (folder / "table.csv").write_text("\n".join([figures[0], *own, *before]) + "\n")
    for name in ("mine.toml", "field.toml", "library.toml"):
        shutil.copy(ROOT / "aoro_gym/machines/aoro.toml", folder / name)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page not in TUTORIALS and wanted(page)], ids=name_of)
def test_commands_of_a_page_run(page, place, monkeypatch):
    monkeypatch.chdir(place)
    for line in wanted(page):
        verb = shlex.split(line)[1]
        shorter = () if "--resume" in line else SHORTER.get(verb, ())
        line = re.sub(
            r"(?<= )(aoro_gym/validation/data|aoro_gym/agents/policies|agents/hyperparams)", rf"{ROOT}/\1", line
        )
        line = re.sub(r"\b(path|lap|drive)\.gpx", "line.csv", line)  # a forest lies nowhere on the Earth
        run(" ".join([line, *shorter]))


def test_what_is_not_executed_is_there():
    """A reason for which nothing is left out any more goes."""
    lines = [line for page in PAGES for line in commands(page)]
    assert [part for part in NOT_HERE if not any(part in line for line in lines)] == []
