"""Makes notebooks in examples/notebooks from examples: ``python docs/notebooks.py``."""

import ast
import json
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
FOLDER = EXAMPLES / "notebooks"
NAMES = ("02_environment", "03_diagnose_a_log")
"""Examples that are notebooks, too."""
IMPORTS = (ast.Import, ast.ImportFrom)


def notebook(source: str) -> dict[str, Any]:
    """A notebook (nbformat 4.5) of a program: its docstring as text, then a cell for each part between empty lines
    but for imports, which are one."""
    tree = ast.parse(source)
    lines = source.splitlines()
    begins = [0]
    for before, node in zip(tree.body[:-1], tree.body[1:], strict=True):
        between = lines[before.end_lineno or 0 : node.lineno - 1]
        if "" in between and not (isinstance(before, IMPORTS) and isinstance(node, IMPORTS)):
            begins.append((before.end_lineno or 0) + len(between) - list(reversed(between)).index(""))
    parts = [
        "\n".join(lines[begin:end]).strip("\n") for begin, end in zip(begins, [*begins[1:], len(lines)], strict=True)
    ]
    assert tree.body and ast.get_docstring(tree) is not None, "an example begins with what it shows"
    cells = [("markdown", ast.get_docstring(tree) or ""), *(("code", part) for part in parts[1:])]
    return {
        "cells": [cell(number, kind, text) for number, (kind, text) in enumerate(cells)],
        "metadata": {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }


def cell(number: int, kind: str, text: str) -> dict[str, Any]:
    """One cell, as it is before anything has run."""
    own = {"execution_count": None, "outputs": []} if kind == "code" else {}
    return {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, **own, "source": text.splitlines(keepends=True)}


def made() -> dict[Path, str]:
    """Text of the notebooks by file."""
    return {
        FOLDER / f"{name}.ipynb": json.dumps(
            notebook((EXAMPLES / f"{name}.py").read_text(encoding="utf-8")), indent=1, ensure_ascii=False
        )
        + "\n"
        for name in NAMES
    }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for file, text in made().items():
        file.write_text(text, encoding="utf-8")
