"""The twin's kernels, compiled ahead of time for any CPU of this architecture, and the C of their arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.execution import devices
from aoro_gym.twin.kernels.build import build
from aoro_gym.twin.kernels.laws import ChosenLaws, DefaultLaws

_SCALARS = {"float32": "float", "int32": "int32_t", "uint64": "uint64_t", "bool": "uint8_t"}
"""Types of C by those of Warp and NumPy."""


@dataclass(frozen=True)
class CompiledKernels:
    """Object file with the kernels ``reset`` and ``advance``, and what calls them."""

    object_file: Path
    symbols: Mapping[str, str]
    """Entry point by kernel."""
    arguments: Mapping[str, str]
    """Structure of C by kernel."""


def compiled_kernels(ground: Any, *, default_laws: bool) -> CompiledKernels:
    """The kernels for a kind of ground (``Planes`` or ``Rasters``); compiled once on a computer, by Warp's own cache."""
    devices.start()
    kernels = portable_kernels(ground, default_laws=default_laws)
    with devices.compiling(kernels[0], devices.find("cpu"), 1):
        [file] = wp.compile_aot_module(kernels[0].module, device="cpu")
    return CompiledKernels(
        Path(file),
        {kernel.key: f"{kernel.get_mangled_name()}_cpu_forward" for kernel in kernels},
        {kernel.key: _structure({one.label: one.type for one in kernel.adj.args}) for kernel in kernels},
    )


def portable_kernels(ground: Any, *, default_laws: bool) -> tuple[Any, Any]:
    """The kernels ``reset`` and ``advance`` as they are exported, for a twin that is to agree to the bit."""
    laws = DefaultLaws if default_laws else ChosenLaws
    return build(ground, laws, portable=True)


def structure_of(dtype: Any) -> str:
    """Structure of C with the layout of NumPy's ``dtype``, without a tag."""
    layout = np.dtype(dtype)
    lines = []
    for name in layout.names or ():
        field = layout[name]
        if field.names:
            lines.append(f"{structure_of(field)} {name};")
        else:
            dimensions = "".join(f"[{size}]" for size in field.shape)
            lines.append(f"{_SCALARS[field.base.name]} {name}{dimensions};")
    return "struct {\n    " + "\n".join(lines).replace("\n", "\n    ") + "\n}"


def _structure(members: Mapping[str, Any]) -> str:
    """Structure of C of a kernel's arguments by their names."""
    lines = []
    for name, kind in members.items():
        if wp.types.is_array(kind):
            lines.append(f"struct warp_array {name};")
        elif hasattr(kind, "vars"):
            lines.append(f"{_structure({label: one.type for label, one in kind.vars.items()})} {name};")
        else:
            lines.append(f"{_SCALARS[kind.__name__]} {name};")
    return "struct {\n    " + "\n".join(lines).replace("\n", "\n    ") + "\n}"
