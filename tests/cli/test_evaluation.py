"""The commands ``evaluate``, ``leaderboard``, ``robustness`` and ``gap``; an evaluated policy is exported, too."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.agents.episodes import shortened_episodes
from tests.cli.calling import call, check_refused


def test_evaluate_a_terrain_and_a_path(tmp_path):
    """Heights of a gentle slope, and 9 m of path across it."""
    x = np.arange(0.0, 20.0, 0.5)
    heights = 0.05 * x[:, None] + np.zeros(len(x))
    np.savetxt(
        tmp_path / "slope.csv",
        [(a, b, z) for row, b in zip(heights, x, strict=True) for a, z in zip(x, row, strict=True)],
        delimiter=",",
        header="x,y,z",
        comments="",
    )
    (tmp_path / "lane.csv").write_text("x,y\n5,10\n8,10\n11,10\n14,10\n")
    options = ["--terrain", tmp_path / "slope.csv", "--path", tmp_path / "lane.csv", "--policy", "stanley"]
    out = tmp_path / "evaluation"
    shown = call(
        "evaluate",
        *options,
        "--policy",
        "preview",
        "--episodes",
        2,
        "--seed",
        3,
        "--no-films",
        "--logs",
        "csv",
        "--out",
        out,
    )
    assert shown.exit_code == 0, shown.output
    assert "lane.csv: 4 points, x, y; local x, y [m]" in shown.stderr.replace("\n", " ")
    content = json.loads((out / "evaluation.json").read_text())
    assert (content["env"], content["episodes"], content["seed"]) == ("AORO/PathTracking-v0", 2, 3)
    assert list(content["policies"]) == ["stanley", "preview"]
    assert content["courses"] == ["slope"]
    figures = content["policies"]["preview"]
    assert figures["success_rate"]["mean"] == 1.0
    assert 0.0 < figures["cross_track_rms_m"]["mean"] < 0.5
    # 9 m of lane, less 4 m before the start and 0.25 m before the end; a step covers less than 0.1 m
    assert figures["driven_m"]["mean"] == pytest.approx(4.75, abs=0.1)
    # of a machine across a slope of atan 0.05
    assert figures["worst_tilt_deg"]["mean"] > math.degrees(math.atan(0.04))
    for name in ("stanley", "cross track rms", "success rate", "ended: end of path reached"):
        assert name in shown.stdout
    for name in ("evaluation.json", "figures.png", "errors.png", "plan_1.png", "preview.csv", "index.html"):
        assert f"wrote {out / name}" in shown.stdout

    (tmp_path / "short.csv").write_text("x,y\n5,10\n8,10\n")
    options = ["--terrain", tmp_path / "slope.csv", "--path", tmp_path / "short.csv", "--out", out]
    shown = call("evaluate", *options)
    assert shown.exit_code == 2
    assert "path 'short' is 3.00 m long, but must be at least 6.00 m" in " ".join(shown.stderr.split())


@pytest.fixture
def still(tmp_path) -> Path:
    """File of a policy that never turns."""
    from aoro_gym.agents.policies.policy import LearnedPolicy

    policy = LearnedPolicy(
        weights=(np.zeros((1, 8), dtype=np.float32),),
        biases=(np.zeros(1, dtype=np.float32),),
        activation="tanh",
        squashed=False,
        low=-np.ones(1, dtype=np.float32),
        high=np.ones(1, dtype=np.float32),
        environment="AORO/Turning-v0",
    )
    return policy.save(tmp_path / "still")[1]


@pytest.fixture
def short_episodes() -> Iterator[None]:
    with shortened_episodes():
        yield


def test_a_policy_in_a_file_is_exported(still):
    pytest.importorskip("onnx")
    assert call("export", "policy", still).stdout == f"wrote {still.with_suffix('.onnx')}\n"


def test_policies_in_files_are_evaluated(tmp_path, still, short_episodes):
    file = still
    options = ["--env", "AORO/Turning-v0", "--episodes", 1, "--no-films", "--out", tmp_path / "evaluation"]
    shown = call("evaluate", "--policy", file, "--policy", "proportional-derivative", *options)
    assert shown.exit_code == 0, shown.output
    figures = json.loads((tmp_path / "evaluation" / "evaluation.json").read_text())["policies"]
    name = "-".join(file.with_suffix("").parts[1:])
    assert figures[name]["settled_share"]["mean"] == 0.0
    assert figures["proportional-derivative"]["settled_share"]["mean"] > 0.0
    shown = call("evaluate", "--policy", file, "--policy", file, *options)
    assert (shown.exit_code, "twice; give each once" in shown.stderr) == (2, True)
    shown = call("evaluate", "--policy", tmp_path / "model.zip", *options)
    assert (shown.exit_code, "--trust-pickle" in shown.stderr) == (2, True)

    board = tmp_path / "board"
    options = ["--env", "AORO/Turning-v0", "--episodes", 2, "--seed", 5, "--out", board]
    shown = call("leaderboard", "--policy", file, "--policy", "bang-bang", *options)
    assert shown.exit_code == 0, shown.output
    content = json.loads((board / "leaderboard.json").read_text())
    assert (content["policies"], content["seed"]) == (["bang-bang", name], 5)
    assert content["best_reference"] == "bang-bang"
    for end in ("json", "md", "png"):
        assert f"wrote {board / 'leaderboard'}.{end}" in shown.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("evaluate --out good.csv", "--out good.csv is a file; name a folder"),
        ("evaluate --env X", "--env is 'X'; choose one of: AORO/Turning-v0, AORO/PathTracking-v0"),
        ("evaluate --policy walker", "'walker' is no policy for AORO/PathTracking-v0; choose from: pure-pursuit"),
        ("evaluate --episodes 0", "--episodes is 0, but must be an integer in [1, 10000]"),
        ("evaluate --seed -1", "--seed is -1, but must be an integer of at least 0"),
        ("evaluate --env AORO/Turning-v0 --path x.csv", "--path is for AORO/PathTracking-v0"),
        ("evaluate --terrain none.ply", "none.ply: No such file or directory"),
        ("evaluate --path none.gpx", "none.gpx: No such file or directory"),
        ("leaderboard --env X", "--env is 'X'; choose one of"),
        ("leaderboard --episodes 0", "--episodes is 0, but must be an integer in [1, 10000]"),
        ("leaderboard --readme good.csv", "good.csv lacks the lines <!-- leaderboard AORO/PathTracking-v0 -->"),
        ("robustness --episodes 0", "--episodes is 0, but must be an integer in [1, 10000]"),
        ("robustness --size 0", "--size is 0"),
        ("robustness --size 1.2", "--size is 1.2"),
        ("gap --policy preview", "give one of --diagnosis and --improved"),
        ("gap --policy preview --improved aoro", "the plant is the baseline; give --plant or --effect"),
        ("gap --policy preview --diagnosis empty", "empty/diagnosis.json: No such file"),
        ("gap --policy preview --improved aoro --effect x=1", "'x' is no effect here; choose from"),
        (
            "gap --policy preview --improved aoro --effect payload=9 --retrain 9",
            "preview cannot be retrained; give a file",
        ),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
