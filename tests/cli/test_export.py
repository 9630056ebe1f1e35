"""The commands ``export ...``."""

import pytest

from tests.cli.calling import call


@pytest.mark.parametrize("arguments", [("none.json",), ("--out", "x.onnx", "none.json"), ("--quiet", "none.zip")])
def test_a_policy_without_its_word_is_exported_and_warned_of(arguments):
    shown = call("export", *arguments)
    warning, error = shown.stderr.strip().splitlines()
    assert "warning: 'aoro-gym export POLICY' is deprecated" in warning
    assert (shown.exit_code, arguments[-1] in error) == (2, True)


def test_the_word_policy_is_no_longer_missed():
    shown = call("export", "policy", "none.json")
    assert (shown.exit_code, "deprecated" in shown.stderr, "none.json" in shown.stderr) == (2, False, True)


def test_an_unknown_export_is_refused():
    shown = call("export", "polcy")
    assert (shown.exit_code, "No such command 'polcy'" in shown.stderr) == (2, True)
