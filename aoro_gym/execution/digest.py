"""One content digest for everything that is kept: two inputs have the same digest if, and only if, they are the same.

Values are told apart by type, shape and bits; files by their contents, never by their names; functions and classes by their
source. What cannot be told apart raises ``TypeError``, so that nothing is ever found under a digest that leaves it out.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import platform
import struct
import sys
import types
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath
from typing import Any

import numpy as np

import aoro_gym

LIBRARIES = ("gymnasium", "numpy", "scipy", "stable-baselines3", "skrl", "torch", "trimesh", "warp-lang")
"""Whose versions change what is computed."""


@dataclass(frozen=True)
class Contents:
    """A file, or a folder with all files below it, that counts by its contents."""

    path: Path


def digest(*parts: Any) -> str:
    """Hexadecimal SHA-256 of ``parts``.

    Args:
        parts: Plain values, arrays and tensors, mappings (whatever their order), sequences, sets, dataclasses,
            :class:`Contents`, functions, classes, and objects by their class and state. A path is text: what it holds is
            ``Contents(path)``.

    Raises:
        TypeError: names the type of a part whose state cannot be told.
        OSError: a file cannot be read.
    """
    total = hashlib.sha256()
    for token in _tokens(parts, []):
        total.update(struct.pack("<Q", len(token)))
        total.update(token)
    return total.hexdigest()


@cache
def sources() -> Mapping[str, str]:
    """Digests of all files of the installed package, its sources and the data that it ships, by name below its folder."""
    root = Path(aoro_gym.__file__).parent
    return types.MappingProxyType({name: digest(Contents(file))[:16] for name, file in _files_below(root)})


@cache
def code_digest() -> str:
    """Digest of all files of the installed package, and of the versions that it computes with."""
    return digest(dict(sources()), versions())


@cache
def versions() -> dict[str, str]:
    """Versions of Python, of this package, and of the libraries that compute, as far as they are installed."""
    found = {"python": platform.python_version(), "aoro-gym": aoro_gym.__version__}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _tokens(value: Any, inside: list[int]) -> Iterator[bytes]:
    """Bytes that tell ``value`` from all others; ``inside`` are the containers around it."""
    if value is None or isinstance(value, bool | int | str | bytes | PurePath | complex):
        yield f"{type(value).__name__}:".encode() + (value if isinstance(value, bytes) else str(value).encode())
    elif isinstance(value, float):
        yield b"float:" + struct.pack("<d", value)
    elif isinstance(value, np.generic | np.ndarray):
        yield from _array_tokens(np.asarray(value))
    elif isinstance(value, Contents):
        yield from _file_tokens(value.path)
    elif id(value) in inside:
        yield f"again:{len(inside) - inside.index(id(value))}".encode()  # a reference to what is around it
    else:
        inside.append(id(value))
        yield from _compound_tokens(value, inside)
        inside.pop()


def _compound_tokens(value: Any, inside: list[int]) -> Iterator[bytes]:
    if isinstance(value, Mapping):
        yield f"mapping:{len(value)}".encode()
        for key, key_digest in sorted(((key, digest(key)) for key in value), key=lambda pair: pair[1]):
            yield key_digest.encode()
            yield from _tokens(value[key], inside)
    elif isinstance(value, Set):
        yield f"set:{len(value)}".encode()
        yield from sorted(digest(item).encode() for item in value)
    elif isinstance(value, list | tuple):
        yield f"{type(value).__name__}:{len(value)}".encode()
        for item in value:
            yield from _tokens(item, inside)
    elif is_dataclass(value) and not isinstance(value, type):
        yield _qualified(type(value)).encode()
        for field in fields(value):
            yield field.name.encode()
            yield from _tokens(getattr(value, field.name), inside)
    elif isinstance(value, type | types.FunctionType | types.MethodType | types.BuiltinFunctionType | partial):
        yield from _code_tokens(value, inside)
    elif hasattr(value, "detach") and hasattr(value, "numpy"):
        yield from _array_tokens(value.detach().cpu().numpy())  # a tensor
    else:
        yield from _object_tokens(value, inside)


def _array_tokens(array: np.ndarray) -> Iterator[bytes]:
    if array.dtype.hasobject:
        yield f"objects:{array.shape}".encode()
        for item in array.ravel().tolist():
            yield from _tokens(item, [])
    else:
        yield f"array:{array.dtype.str}:{array.shape}".encode()
        yield np.ascontiguousarray(array).tobytes()


def _code_tokens(value: Any, inside: list[int]) -> Iterator[bytes]:
    """A function by its source, defaults and what it closes over; a class by its source and its bases'."""
    if isinstance(value, partial):
        yield b"partial"
        yield from _tokens((value.func, value.args, value.keywords), inside)
    elif isinstance(value, types.MethodType):
        yield b"method"
        yield from _tokens((value.__func__, value.__self__), inside)
    elif isinstance(value, type):
        yield f"class:{_qualified(value)}".encode()
        for base in value.__mro__:
            if _is_own(base):
                yield _source(base)
    elif isinstance(value, types.FunctionType):
        yield f"function:{_qualified(value)}".encode()
        yield _source(value)
        cells = tuple(cell.cell_contents for cell in value.__closure__ or ())
        yield from _tokens((value.__defaults__, value.__kwdefaults__, cells), inside)
    else:
        yield f"builtin:{_qualified(value)}".encode()


def _object_tokens(value: Any, inside: list[int]) -> Iterator[bytes]:
    """Any other object by its class and the state that it would be copied with."""
    try:
        made = value.__reduce_ex__(2)
    except Exception as error:  # whatever an object that cannot be copied raises
        raise TypeError(f"a {_qualified(type(value))} cannot be told from others: {error}") from None
    yield f"object:{_qualified(type(value))}".encode()
    if isinstance(made, str):
        yield made.encode()
        return
    yield from _code_tokens(type(value), inside)
    _, arguments, state, items, pairs = (*made, None, None, None)[:5]
    arguments = [item for item in arguments or () if item is not type(value)]
    yield from _tokens((arguments, state, list(items or ()), list(pairs or ())), inside)


def _file_tokens(path: Path) -> Iterator[bytes]:
    if path.is_dir():
        for name, file in _files_below(path):
            yield f"file:{name}".encode()
            yield file.read_bytes()
    else:
        yield b"file"
        yield path.read_bytes()


def _files_below(root: Path) -> Iterator[tuple[str, Path]]:
    """Names below ``root`` and paths of its files, through links, in a fixed order; without compiled Python."""
    for folder, names, files in os.walk(root, followlinks=True):
        names[:] = sorted(name for name in names if name != "__pycache__")
        for name in sorted(files):
            file = Path(folder) / name
            yield file.relative_to(root).as_posix(), file


def _qualified(value: Any) -> str:
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', repr(value))}"


def _is_own(base: type) -> bool:
    """Whether a class is neither Python's nor a library's, whose versions count instead."""
    module = sys.modules.get(base.__module__)
    file = getattr(module, "__file__", None)
    return base.__module__ == "__main__" or (
        file is not None and "site-packages" not in file and not file.startswith(os.path.dirname(os.__file__))
    )


def _source(value: Any) -> bytes:
    try:
        return inspect.getsource(value).encode()
    except (OSError, TypeError):  # typed at a prompt, or compiled
        code = getattr(value, "__code__", None)
        return b"" if code is None else code.co_code + repr(code.co_consts).encode()
