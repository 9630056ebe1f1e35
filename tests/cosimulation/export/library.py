"""A library of ``aoro-gym export twin --format c`` in Python's hands, and the twin that it must agree with."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.cosimulation.export.kernels import portable_kernels
from aoro_gym.cosimulation.export.variables import Variable, variables
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.twin import Twin

Schedule = Callable[[int], Mapping[str, float]]
"""Commands that change at the begin of a step of 10 ms, by its number."""


class Library:
    """The functions of ``aoro.h`` on variables by name."""

    def __init__(self, file: Path, listed: Sequence[Variable]):
        self.numbers = {one.name: number for number, one in enumerate(listed)}
        self.listed = listed
        self.c = ctypes.CDLL(str(file))
        pointer, number, real = ctypes.c_void_p, ctypes.c_int, ctypes.c_double
        for name, result, arguments in (
            ("aoro_new", pointer, []),
            ("aoro_free", None, [pointer]),
            ("aoro_renew", None, [pointer]),
            ("aoro_set", number, [pointer, number, real]),
            ("aoro_get", real, [pointer, number]),
            ("aoro_reset", number, [pointer]),
            ("aoro_advance", number, [pointer, number]),
            ("aoro_message", ctypes.c_char_p, [pointer]),
            ("aoro_state_size", ctypes.c_size_t, []),
            ("aoro_save", None, [pointer, ctypes.c_char_p]),
            ("aoro_restore", number, [pointer, ctypes.c_char_p, ctypes.c_size_t]),
            ("aoro_name", ctypes.c_char_p, [number]),
            ("aoro_unit", ctypes.c_char_p, [number]),
            ("aoro_kind_of", number, [number]),
            ("aoro_find", number, [ctypes.c_char_p]),
        ):
            function = getattr(self.c, name)
            function.restype, function.argtypes = result, arguments


class Exported:
    """One twin of a :class:`Library`."""

    def __init__(self, library: Library):
        self.library = library
        self.pointer = library.c.aoro_new()
        assert self.pointer

    def __del__(self):
        self.library.c.aoro_free(self.pointer)

    def set(self, values: Mapping[str, float]) -> list[int]:
        numbers = self.library.numbers
        return [self.library.c.aoro_set(self.pointer, numbers[name], value) for name, value in values.items()]

    def get(self, name: str) -> float:
        return self.library.c.aoro_get(self.pointer, self.library.numbers[name])

    def reset(self) -> int:
        return self.library.c.aoro_reset(self.pointer)

    def advance(self, milliseconds: int) -> int:
        return self.library.c.aoro_advance(self.pointer, milliseconds)

    @property
    def message(self) -> str:
        return self.library.c.aoro_message(self.pointer).decode()

    def save(self) -> bytes:
        buffer = ctypes.create_string_buffer(self.library.c.aoro_state_size())
        self.library.c.aoro_save(self.pointer, buffer)
        return buffer.raw

    def restore(self, state: bytes) -> int:
        return self.library.c.aoro_restore(self.pointer, state, len(state))

    def run(self, schedule: Schedule, steps: int) -> np.ndarray:
        """Outputs (steps, outputs) after each step of 10 ms, float32."""
        names = outputs(self.library.listed)
        rows = np.empty((steps, len(names)), dtype=np.float32)
        for step in range(steps):
            assert set(self.set(schedule(step))) <= {0}, self.message
            assert self.advance(10) == 0, self.message
            rows[step] = [self.get(name) for name in names]
        return rows


def outputs(listed: Sequence[Variable]) -> list[str]:
    return [one.name for one in listed[1:] if one.kind == "output"]


def listed_for(machine: Machine, terrain: Plane | Terrain) -> list[Variable]:
    return variables(machine, terrain if isinstance(terrain, Plane) else None)


def portable_twin(machine: Machine, terrain: Plane | Terrain | None = None) -> Twin:
    """The Python twin of the kernels that are exported."""
    twin = Twin(machine=machine, terrain=terrain)
    kernels = portable_kernels(type(twin.ground)._cls, default_laws=machine.laws.default)
    twin._reset_kernel, twin._advance_kernel = kernels
    return twin


def run_twin(twin: Twin, schedule: Schedule, steps: int, **pose: Any) -> np.ndarray:
    """Outputs (steps, outputs) of a Python twin after each step of 10 ms, float32."""
    names = outputs(listed_for(twin.machine, Plane()))
    twin.reset(**pose)
    rows = np.empty((steps, len(names)), dtype=np.float32)
    for step in range(steps):
        twin.step(schedule(step), 0.01)
        rows[step] = [twin.output(name)[0] for name in names]
    return rows


def assert_same_bits(found: np.ndarray, expected: np.ndarray) -> None:
    assert found.shape == expected.shape
    assert found.tobytes() == expected.tobytes(), f"{np.abs(found - expected).max()} apart"
