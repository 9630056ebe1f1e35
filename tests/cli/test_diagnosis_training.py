"""The command ``diagnosis train``."""

import pytest

from tests.cli.calling import check_refused

pytest.importorskip("torch")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("diagnosis train --device cpu --out good.csv", "good.csv"),
        ("diagnosis train --device abacus", "error: --device 'abacus' is not available here; choose one of: cpu"),
        ("diagnosis train --device cpu --start .", "no network_*.safetensors"),
        ("diagnosis train --device cpu --tables --start .", "leave it out with --tables"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
