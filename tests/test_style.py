"""What no linter holds: functions of a size to hold in mind, and Args where there are many parameters."""

import ast
import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from aoro_gym import units

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("aoro_gym", "envs", "terrains", "agents")
LONGEST = 80
"""Lines of a function, its docstring included."""
LONG = {
    "aoro_gym/twin/kernels/advance.py advance": "a main step from top to bottom, as in the block diagram",
    "aoro_gym/twin/kernels/hydraulics.py hydraulics": "the loop of the substeps, on local variables for speed",
}
"""Functions that may be longer, and why."""
WITH_SIZES_OF_UNITS = {
    "aoro_gym/calibration/replay.py": "reads a log's engine speed, rounded as it was written",
    "aoro_gym/simulation/output.py": "writes a log's engine speed, rounded as ever",
    "envs/path_tracking/rewards.py": "100 kW",
    "terrains/io/masking.py": "marks of missing heights",
}
"""Files other than ``units.py`` with a number of a unit's size, and why."""


KINDS = (ast.FunctionDef, ast.Constant, ast.Attribute, ast.BinOp)
"""Nodes that the tests look at."""


def modules(*folders: str) -> Iterator[tuple[str, list[ast.AST]]]:
    """File and nodes of every module."""
    for folder in folders:
        for file in sorted((ROOT / folder).rglob("*.py")):  # does not follow the links in aoro_gym
            yield file.relative_to(ROOT).as_posix(), nodes(file)


@cache
def nodes(file: Path) -> list[ast.AST]:
    """Those of KINDS, parsed and looked for once for all tests, which leave them as they are."""
    return [node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, KINDS)]


def functions(*folders: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    """File and node of every function."""
    for path, found in modules(*folders):
        for node in found:
            if isinstance(node, ast.FunctionDef):
                yield path, node


def test_only_functions_with_a_reason_are_long():
    lengths = {f"{path} {node.name}": (node.end_lineno or 0) - node.lineno + 1 for path, node in functions(*PACKAGES)}
    assert {name for name, length in lengths.items() if length > LONGEST} == set(LONG)


def test_public_functions_of_five_parameters_have_args():
    without = []
    for path, node in functions(*PACKAGES):
        parameters = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        names = [one.arg for one in parameters if one.arg not in ("self", "cls")]
        document = ast.get_docstring(node)
        if node.name.startswith("_") or len(names) < 5 or document is None:  # a method without one has that of its base
            continue
        if path.startswith("aoro_gym/cli/"):  # of a command, --help shows every option
            continue
        if path.startswith("aoro_gym/twin/kernels/") or any("wp." in ast.unparse(one) for one in node.decorator_list):
            continue  # device code names its parameters by comments
        if "Args:" not in document or any(name not in document for name in names):
            without.append(f"{path}:{node.lineno} {node.name}")
    assert not without


def factor(node: ast.AST) -> float:
    """Product of the numbers and π in ``node``; what else it multiplies counts as 1."""
    match node:
        case ast.Constant(int() | float() as value):
            return value
        case ast.Attribute(attr="pi"):
            return math.pi
        case ast.BinOp(left, ast.Mult(), right):
            return factor(left) * factor(right)
        case ast.BinOp(left, ast.Div(), right):
            return factor(left) / (factor(right) or math.nan)
    return 1.0


def test_units_are_defined_once():
    sizes = [size for name, size in vars(units).items() if name.isupper()]
    digits = {f"{size:.14g}" for size in sizes} | {f"{1.0 / size:.14g}" for size in sizes if size < 1.0}
    again = set()
    for path, found in modules(*PACKAGES):
        for node in found:
            is_count = isinstance(node, ast.Constant) and isinstance(node.value, int)
            if not is_count and f"{factor(node):.14g}" in digits:
                again.add(path)
    own = {path for path in again if path.startswith("aoro_gym/diagnosis_benchmark/plants/")}  # independent of the twin
    assert again - own == {"aoro_gym/units.py", *WITH_SIZES_OF_UNITS}


@pytest.mark.parametrize("folder", PACKAGES)
def test_every_package_is_looked_at(folder):
    assert len(list(functions(folder))) > 100
