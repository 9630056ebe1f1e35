"""Notebooks are as their examples are, and run from their first cell to their last."""

import json
import runpy
from pathlib import Path
from typing import Any

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "examples/notebooks").glob("*.ipynb"))


def test_notebooks_are_as_the_examples_are():
    made = runpy.run_path(str(ROOT / "docs/notebooks.py"))["made"]()
    assert sorted(made) == NOTEBOOKS
    for file, text in made.items():
        assert file.read_text(encoding="utf-8") == text, "run `python docs/notebooks.py`"


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebooks_have_the_format_and_all_of_their_example(file):
    nbformat.validate(nbformat.read(file, as_version=4))
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    source = (ROOT / "examples" / f"{file.stem}.py").read_text(encoding="utf-8")
    words = " ".join("".join(cell["source"]) for cell in cells).split()
    assert words == source.replace('"""', "", 2).split()


@pytest.mark.slow
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebooks_run(file, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{file.name}, {cell['id']}", "exec"), names)
    assert "least" in names or "returns" in names
