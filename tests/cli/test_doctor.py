"""The command ``doctor``."""

import json

from aoro_gym.benchmark import installation
from tests.cli.calling import call, check_refused


def test_tables_or_json(tmp_path, monkeypatch):
    monkeypatch.setattr(installation, "SIMULATED", 0.05)
    file = tmp_path / "here.json"
    shown = call("doctor", "--json", file)
    assert shown.exit_code == 0, shown.output
    assert "optional parts" in shown.stdout and "cpu" in shown.stdout
    content = json.loads(file.read_text())
    assert {"versions", "parts", "devices", "kernel_cache"} <= set(content)
    assert json.loads(call("doctor", "--json", "-").stdout)["versions"] == content["versions"]


def test_a_file_that_cannot_be_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    check_refused("doctor --json here", "here")
