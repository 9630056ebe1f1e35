"""Skipped tests: those that are listed may be, every other one fails."""

import pytest

from tests.conftest import MAY_SKIP, ROOT, _refuse


def skipped(nodeid: str) -> pytest.TestReport:
    report = pytest.TestReport(nodeid, ("f.py", 1, "t"), {}, "skipped", ("f.py", 1, "Skipped: no ray"), "call")
    _refuse(report)
    return report


def test_a_skip_that_is_not_listed_fails():
    report = skipped("tests/agents/test_training.py::test_it_learns")
    assert report.failed
    assert "Skipped: no ray" in report.longreprtext
    assert all(skipped(listed).skipped for listed in MAY_SKIP)


@pytest.mark.parametrize("listed", MAY_SKIP)
def test_what_is_listed_exists(listed):
    file, _, test = listed.partition("::")
    assert f"def {test.partition('[')[0]}" in (ROOT / file).read_text(encoding="utf-8")
