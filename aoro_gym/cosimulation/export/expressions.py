"""Arithmetic of NumPy written down as C: a machine whose parameters are names gives the formulas of its record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from aoro_gym.machine.linkage import Linkage
from aoro_gym.machine.parameters import DECLARATIONS, Machine
from aoro_gym.machine.rest import Corner, RestPose
from aoro_gym.machine.sections import Cylinder

_C: Mapping[Any, str] = {
    np.add: "({} + {})",
    np.subtract: "({} - {})",
    np.multiply: "({} * {})",
    np.true_divide: "({} / {})",
    np.power: "pow({}, {})",
    np.square: "({0} * {0})",
    np.negative: "(-{})",
    np.sqrt: "sqrt({})",
    np.cos: "cos({})",
    np.sin: "sin({})",
    np.absolute: "fabs({})",
    np.maximum: "larger({}, {})",
    np.minimum: "smaller({}, {})",
    np.less: "({} < {})",
    np.less_equal: "({} <= {})",
    np.greater: "({} > {})",
    np.greater_equal: "({} >= {})",
    np.bitwise_and: "({} && {})",
    np.bitwise_or: "({} || {})",
    np.isfinite: "isfinite({})",
}
"""C of the functions that laws of the record are made of."""


class Expression(np.lib.mixins.NDArrayOperatorsMixin):
    """A number or a truth value as C writes it; what NumPy does with it is one, too."""

    def __init__(self, text: str):
        self.text = text

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options or ufunc not in _C:
            raise NotImplementedError(f"no C is known for {ufunc.__name__}")
        return Expression(_C[ufunc].format(*map(c_text, inputs)))

    def __array_function__(self, function: Any, _: Any, values: tuple[Any, ...], options: Mapping[str, Any]) -> Any:
        if function is not np.where or options:
            raise NotImplementedError(f"no C is known for {function.__name__}")
        condition, first, second = values
        if not isinstance(condition, Expression):
            return first if np.asarray(condition).item() else second
        return Expression("({} ? {} : {})".format(*map(c_text, values)))


def c_text(value: Any) -> str:
    """An expression or a number as C."""
    if isinstance(value, np.ndarray):
        value = value.item()
    if isinstance(value, Expression):
        return value.text
    if isinstance(value, bool | np.bool_ | int | np.integer):
        return str(int(value))
    number = float(value)
    if not math.isfinite(number):
        return "NAN" if math.isnan(number) else "INFINITY" if number > 0.0 else "(-INFINITY)"
    return repr(number)


def c_name(key: str) -> str:
    """Variable of C for a parameter's dotted ``key``."""
    return key.replace(".", "_")


def symbolic(machine: Machine) -> Machine:
    """``machine`` with names in place of values: of each parameter in SI, of its linkages, corner and rest pose. Its bunk is
    empty."""
    parts = {
        field.name: _section(getattr(machine, field.name), f"{field.name}.")
        for field in fields(machine)
        if is_dataclass(getattr(machine, field.name)) and field.name not in ("laws", "payload")
    }
    entries: Any = {key: SimpleNamespace(si=Expression(c_name(key))) for key in DECLARATIONS}
    out = Machine(name=machine.name, entries=entries, laws=machine.laws, payload=machine.payload, **parts)
    vars(out)["corner"] = Corner(**_members(Corner, "corner_"))
    vars(out)["rest"] = RestPose(**_members(RestPose, "rest."))
    return out


def _section(section: Any, prefix: str) -> Any:
    members: dict[str, Any] = {}
    for field in fields(section):
        value = getattr(section, field.name)
        if is_dataclass(value):
            members[field.name] = _section(value, f"{prefix}{field.name}.")
        else:
            members[field.name] = Expression(c_name(field.metadata.get("same_as", prefix + field.name)))
    out = type(section)(**members)
    if isinstance(section, Cylinder):
        vars(out)["linkage"] = Linkage(**_members(Linkage, f"{prefix.split('.')[0]}_linkage."))
    return out


def _members(kind: Any, prefix: str) -> dict[str, Any]:
    return {field.name: Expression(prefix + field.name) for field in fields(kind)}
