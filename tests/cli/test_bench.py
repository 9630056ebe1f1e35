"""The command ``bench``."""

import json

import pytest

from tests.cli.calling import call, check_refused


def test_bench(tmp_path):
    path = tmp_path / "bench.json"
    shown = call("bench", "--twins", "1,2", "--seconds", "0.05", "--json", path)
    assert shown.exit_code == 0, shown.output
    result = json.loads(path.read_text())
    assert sorted({case["twins"] for case in result["cases"]}) == [1, 2]
    for case in result["cases"]:
        assert case["what"] == "twin"
        assert case["device"] == "cpu"
        assert 0 < case["min"] <= case["steps_per_s"] <= case["max"]
        share = 100.0 * case["share_of_ceiling"]
        assert 0 < share < 100 and f"{share:.3g} %" in shown.output
    assert set(result) == {"machine", "cases", "peers", "ratios", "made_by"}
    assert list(tmp_path.iterdir()) == [path]


def test_other_laws_are_timed_without_a_ceiling(tmp_path):
    path = tmp_path / "bench.json"
    call("bench", "--twins", "1", "--threads", "1", "--seconds", "0.05", "--laws", "library", "--json", path)
    result = json.loads(path.read_text())
    assert result["made_by"]["machine"]["laws"] == "library"
    assert "ceiling" not in result["machine"]
    (case,) = result["cases"]
    assert case["steps_per_s"] > 0
    assert "share_of_ceiling" not in case


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("bench --twins 0", "--twins '0': '0' must be a positive integer"),
        ("bench --twins 1,many", "'many' must be a positive integer"),
        ("bench --seconds nan", "seconds is nan s, but must be in (0, 600] s"),
        ("bench --what twin,drive", "what is 'drive'; choose one of: twin, env, train"),
        ("bench --peer bullet", "--peer is 'bullet'; choose one of: mujoco, mujoco_warp, newton"),
        ("bench --trainer x", "--trainer is 'x'; choose one of"),
        ("bench --threads 0", "--threads '0': '0' must be a positive integer"),
        ("bench --json .", "--json is '.', but must be - or end in .json"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
