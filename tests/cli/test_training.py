"""The command ``train``."""

import pytest

from tests.cli.calling import check_refused


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("train --seeds 3", "--seeds needs --ray"),
        ("train --ray local --seeds 0", "--seeds is 0, but must be a positive integer"),
        ("train --trials 3", "--trials needs --ray"),
        ("train --space mine.yml", "--space needs --trials"),
        ("train --ray local --trials 0", "--trials is 0, but must be a positive integer"),
        ("train --ray local --trials 2 --seeds 2", "--seeds and --trials are both given"),
        ("train --ray local --resume runs", "--resume and --ray are both given"),
        ("train --algo dqn", "algo is 'dqn'; choose one of: ppo, sac"),
        ("train --terrain good.csv", "--terrain is for AORO/PathTracking-v0"),
        ("train --out good.csv", "--out good.csv is a file; name a folder"),
        ("train --resume empty", "empty holds no training.json; nothing was trained there"),
        ("train --machine nothing.toml", "nothing.toml"),
        ("train --soil mud --out runs", "--soil is 'mud'; choose one of: peat"),
        (
            "train --soil peat --device cpu:simd --out runs",
            "--device cpu:simd cannot run twins on --soil peat; take cpu",
        ),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
