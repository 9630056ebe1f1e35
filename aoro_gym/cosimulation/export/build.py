"""A twin exported: compiled, linked and packed."""

from __future__ import annotations

import hashlib
import platform
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from os import PathLike
from pathlib import Path

from aoro_gym.checks import check_choice
from aoro_gym.cosimulation.export.compiler import find_compiler, link
from aoro_gym.cosimulation.export.description import IDENTIFIER, description
from aoro_gym.cosimulation.export.kernels import CompiledKernels, compiled_kernels
from aoro_gym.cosimulation.export.source import MAIN_STEP, SUBSTEPS, header, model
from aoro_gym.cosimulation.export.variables import Variable, variables
from aoro_gym.execution.files import check_writable, write_bytes, written_whole
from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.raster import CELL, Raster, surface
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.hydraulic_step import check_hydraulic_step
from aoro_gym.twin.physics.ground import Planes, Rasters

FORMATS = {"fmi2": "2.0", "fmi3": "3.0", "c": None}
"""Formats by name, with the version of FMI."""
_SOURCES = {"fmi2": ("aoro.c", "fmi2.c"), "fmi3": ("aoro.c", "fmi3.c"), "c": ("aoro.c",)}
_HEADERS = ("closure.h", "fmi.h")
_EXPORTS = {"fmi2": ("fmi2*",), "fmi3": ("fmi3*",), "c": ("aoro_*",)}
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of files in an archive, so that equal units are equal files but for what tells their time."""


@dataclass(frozen=True)
class Generated:
    """Sources of a library for one machine and ground, in a folder, and what they are of."""

    folder: Path
    kernels: CompiledKernels
    listed: Sequence[Variable]
    token: str


def export_twin(
    format: str,
    out: str | PathLike[str],
    *,
    machine: Machine,
    terrain: Plane | Terrain | None = None,
    cell: float = CELL,
) -> list[Path]:
    """Write a twin that needs no Python, and return the files.

    Args:
        format: ``"fmi2"`` or ``"fmi3"``: a functional mock-up unit for co-simulation; ``"c"``: a folder with ``libaoro.so``
            and ``aoro.h``.
        out: The unit (.fmu), or the folder.
        machine: One machine; its parameters are the start values, its laws are for good.
        terrain: One plane, level asphalt by default, or a terrain, which becomes a raster.
        cell: Distance of the raster's nodes [m].

    Raises:
        ValueError: a value is out of its bound, or there is no C compiler; the message says what to do.
    """
    out = Path(out)
    check_output(format, out)
    if machine.num_variants > 1:
        raise ValueError(f"the machine has {machine.num_variants} variants; export one of them: machine.variant(i)")
    if machine.loaded:
        raise ValueError(
            f"the machine carries a load, which exported twins know nothing of; empty its bunk: --set {PAYLOAD}count=0"
        )
    check_hydraulic_step(machine, MAIN_STEP, SUBSTEPS)
    if sys.platform != "linux":
        raise ValueError(f"twins are exported on Linux, but this is {sys.platform}; export there, for its architecture")
    with tempfile.TemporaryDirectory(prefix="aoro-export-") as temporary:
        made = generate(Path(temporary), machine, Plane() if terrain is None else terrain, cell)
        library = made.folder / "libaoro.so"
        build_library(made, format, library)
        if format == "c":
            written = [out / "libaoro.so", out / "aoro.h"]
            for target in written:
                write_bytes(target, (made.folder / target.name).read_bytes())
            return written
        _pack(made, format, library, machine, out)
    return [out]


def check_output(format: str, out: Path) -> None:
    """``ValueError`` unless there is such a format, ``out`` can be written as it, and there is a C compiler."""
    check_choice("format", format, FORMATS)
    find_compiler()
    if format == "c":
        if out.exists() and not out.is_dir():
            raise ValueError(f"{out} is a file; of the format c name a folder")
        check_writable(out / "aoro.h")
        return
    if out.suffix != ".fmu":
        raise ValueError(f"{out} must end in .fmu")
    check_writable(out)


def generate(folder: Path, machine: Machine, terrain: Plane | Terrain, cell: float = CELL) -> Generated:
    """Write all sources into ``folder``."""
    raster = surface(terrain, "cpu", cell=cell) if isinstance(terrain, Terrain) else None
    listed = variables(machine, terrain if isinstance(terrain, Plane) else None)
    kernels = compiled_kernels(Planes if raster is None else Rasters, default_laws=machine.laws.default)
    package = files("aoro_gym.cosimulation.export") / "c"
    for name in {*sum(_SOURCES.values(), ()), *_HEADERS, "ground.c"}:
        (folder / name).write_text((package / name).read_text(encoding="utf-8"), encoding="utf-8")
    text = header((package / "aoro.h").read_text(encoding="utf-8"), listed, machine)
    (folder / "aoro.h").write_text(text, encoding="utf-8")
    tables = model(machine, listed, kernels, raster)
    digest = hashlib.sha256(tables.encode() + kernels.object_file.read_bytes())
    for name, content in _ground_files(raster).items():
        (folder / name).write_bytes(content)
        digest.update(content)
    token = f"{{{digest.hexdigest()[:32]}}}"
    (folder / "aoro_model.h").write_text(tables, encoding="utf-8")
    (folder / "aoro_token.h").write_text(f'#define AORO_TOKEN "{token}"\n', encoding="utf-8")
    return Generated(folder, kernels, listed, token)


def build_library(made: Generated, format: str, out: Path) -> None:
    """Compile and link the library of a format."""
    names = [*_SOURCES[format], *(("ground.c",) if (made.folder / "nodes.bin").exists() else ())]
    link([made.folder / name for name in names], [made.kernels.object_file], _EXPORTS[format], out)


def _ground_files(raster: Raster | None) -> dict[str, bytes]:
    if raster is None:
        return {}
    arrays = {"nodes": raster.nodes, "cover": raster.cover, "ceilings": raster.ceilings}
    return {f"{name}.bin": array.tobytes() for name, array in arrays.items()}


def _pack(made: Generated, format: str, library: Path, machine: Machine, out: Path) -> None:
    """Write the unit: description, binary, and the machine file as a resource."""
    version = FORMATS[format]
    assert version is not None
    machine_file = made.folder / "machine.toml"
    machine.save(machine_file)
    members = {
        "modelDescription.xml": description(version, machine.name, made.token, made.listed),
        f"binaries/{_platform(version)}/{IDENTIFIER}.so": library.read_bytes(),
        "resources/machine.toml": machine_file.read_bytes(),
    }
    with written_whole(out) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            member = zipfile.ZipInfo(name, _EPOCH)
            member.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
            archive.writestr(member, content, zipfile.ZIP_DEFLATED)


def _platform(version: str) -> str:
    """Folder of the binary by the standard."""
    machine = platform.machine().lower()
    architecture = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    if version == "3.0":
        return f"{architecture}-linux"
    return "linux64" if architecture == "x86_64" else f"{architecture}-linux"
