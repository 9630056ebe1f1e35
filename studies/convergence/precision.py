"""A build of the twin in another precision: the same laws and the same steps, with float64 in place of float32.

The sources of :mod:`aoro_gym.twin` are rewritten as a package of another name, in a temporary folder: in code for the
device, and wherever an array is allocated, ``float`` becomes ``wp.float64``, vectors, matrices and quaternions become those
of it, and literals get that type. Nothing is written twice, so that the two builds differ in rounding alone.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

PACKAGE = "aoro_gym.twin"
WIDE = {name: f"{name}d" for name in ("vec2", "vec3", "vec4", "quat", "mat22", "mat33", "mat44")}
KERNELS = ("advance", "reset")
"""Kernels that are made by a call, not by a decorator."""
NATIVE = {"1.0f": "1.0", "rsqrtf": "rsqrt"}
"""What stands in native snippets."""

Edit = Callable[[str], str]
"""From a file's source to another one: a variant of a law or of a step that is to be tried."""


def _warp(name: str) -> ast.Attribute:
    return ast.Attribute(ast.Name("wp", ast.Load()), name, ast.Load())


def _double(value: ast.expr) -> ast.Call:
    return ast.Call(_warp("float64"), [value], [])


class _Widen(ast.NodeTransformer):
    """float32 to float64. Literals and annotations only change in code for the device."""

    def __init__(self) -> None:
        self.device = False

    def _definition(self, node: Any) -> Any:
        marks = [ast.unparse(mark) for mark in node.decorator_list]
        outer, self.device = self.device, self.device or any(mark.startswith("wp.") for mark in marks)
        self.device = self.device or (node.name in KERNELS and "self" not in ast.unparse(node.args))
        native = [mark for mark in marks if mark.startswith("wp.func_native")]
        if native:
            text = native[0]
            for narrow, wide in NATIVE.items():
                text = text.replace(narrow, wide)
            node.decorator_list = [ast.parse(text, mode="eval").body]
        else:
            node.body = [self.visit(part) for part in node.body]
        if isinstance(node, ast.FunctionDef):
            node.args = self.visit(node.args)
            node.returns = self.visit(node.returns) if node.returns and self.device else node.returns
        self.device = outer
        return node

    visit_FunctionDef = visit_ClassDef = _definition

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return _double(node) if self.device and isinstance(node.value, float) else node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return _warp("float64") if self.device and node.id == "float" else node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        owner = ast.unparse(node.value)
        if owner == "wp" and node.attr in WIDE:
            return _warp(WIDE[node.attr])
        if owner == "np" and node.attr == "float32":
            node.attr = "float64"
        self.generic_visit(node)
        return node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        for keyword in node.keywords:
            if keyword.arg == "dtype" and ast.unparse(keyword.value) == "float":
                keyword.value = _warp("float64")
        whole = node.args and isinstance(node.args[0], ast.Constant) and isinstance(node.args[0].value, int)
        if ast.unparse(node.func) == "wp.constant" and not whole and not ast.unparse(node.args[0]).startswith("wp."):
            node.args = [_double(node.args[0])]
        return node


def build(name: str, *, wide: bool, edits: Mapping[str, Edit] | None = None) -> Any:
    """The package :mod:`aoro_gym.twin` under another ``name``, imported.

    Args:
        name: Of the package; no module may have it yet.
        wide: Whether in float64, else in float32 as it stands.
        edits: Changes of the source by file, its path within the package.
    """
    found = importlib.util.find_spec(PACKAGE)
    assert found is not None and found.origin is not None and name not in sys.modules
    source = Path(found.origin).parent
    folder = Path(tempfile.mkdtemp(prefix="precision_"))
    left = dict(edits or {})
    for path in source.rglob("*.py"):
        inner = path.relative_to(source)
        text = left.pop(str(inner), lambda text: text)(path.read_text(encoding="utf-8"))
        if wide:
            text = ast.unparse(ast.fix_missing_locations(_Widen().visit(ast.parse(text))))
        target = folder / name / inner
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text.replace(PACKAGE, name), encoding="utf-8")
    if left:
        raise ValueError(f"there is no file {', '.join(left)} in {PACKAGE}")
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(folder))
