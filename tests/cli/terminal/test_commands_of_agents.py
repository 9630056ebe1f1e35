"""Commands of agents in a terminal, through a pipe, and with --quiet."""

import re
from pathlib import Path

import pytest

from tests.cli.terminal.running import TURNING, check_everywhere, checked, in_terminal

TINY = ("--steps", 500, "--n-envs", 2, "--checkpoint-every", 250, "--eval-episodes", 1, "--param", "batch_size=64")
"""A training that is over at once."""


@pytest.fixture(scope="module")
def trained(inputs: Path) -> Path:
    """The folder of the inputs, in which a policy was trained in ``run``, in a terminal."""
    pytest.importorskip("stable_baselines3")
    (inputs / "shown.txt").write_text(checked(in_terminal("train", *TINY, "--out", "run", folder=inputs)))
    return inputs


@pytest.mark.slow
def test_a_training_in_a_terminal(trained):
    text = (trained / "shown.txt").read_text()
    assert "--:--" in text  # before anything is known
    assert re.search(r"(learning|evaluating) .* \d+ % +\d+:\d\d", text), text
    assert re.search(r"of 500 steps, [\d,]+ a second", text)
    assert "success rate" in text
    assert "wrote run/best.json" in text


COMMANDS: list[tuple[str, tuple[object, ...]]] = [
    ("evaluate", ("evaluate", *TURNING, "--episodes", 2)),
    (
        "evaluate a drive",
        ("evaluate", "--terrain", "ground.ply", "--policy", "stanley", "--policy", "preview", "--episodes", 1),
    ),
    ("leaderboard", ("leaderboard", *TURNING, "--episodes", 2)),
    ("robustness", ("robustness", *TURNING, "--policy", "bang-bang", "--episodes", 1)),
    ("curves", ("curves", "run")),
    (
        "gap",
        ("gap", *TURNING, "--policy", "bang-bang", "--effect", "spool_lag=0.05", "--improved", "aoro", "--episodes", 2),
    ),
    (
        "gap that retrains",
        (
            *("gap", *TURNING, "--policy", "run/best.json", "--effect", "spool_lag=0.05", "--improved", "aoro"),
            *("--episodes", 1, "--retrain", 300),
        ),
    ),
    ("export policy", ("export", "policy", "run/best.json")),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments"), [pytest.param(*one, id=one[0]) for one in COMMANDS])
def test_in_a_terminal_in_a_pipe_and_quiet(name, arguments, trained):
    if name == "export policy":
        pytest.importorskip("onnx")
    check_everywhere(*arguments, folder=trained)
