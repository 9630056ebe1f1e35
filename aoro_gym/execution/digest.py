"""One content digest for everything that is kept: two inputs have the same digest if, and only if, they are the same.

Values are told apart by type, shape and bits; files by their contents, never by their names; functions and classes by their
source, and those that are no part of this package also by the global names and modules that they use. What cannot be told
apart raises ``TypeError``, so that nothing is ever found under a digest that leaves it out.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import platform
import struct
import sys
import types
from abc import ABC
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, cached_property, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from aoro_gym.version import VERSION

PACKAGE = "aoro_gym."
"""Where the dotted names of its own modules begin."""
LIBRARIES = (
    "gymnasium", "numpy", "optuna", "ray", "scipy", "stable-baselines3", "skrl", "torch", "trimesh", "warp-lang",
)  # fmt: skip
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
    try:
        for token in _tokens(parts, _Visited()):
            total.update(struct.pack("<Q", len(token)))
            total.update(token)
    except RecursionError:
        raise TypeError("a part is nested too deeply for a digest") from None
    return total.hexdigest()


@cache
def sources() -> Mapping[str, str]:
    """Digests of all files of the installed package, its sources and the data that it ships, by name below its folder."""
    root = Path(__file__).parents[1]
    return types.MappingProxyType({name: digest(Contents(file))[:16] for name, file in _files_below(root)})


@cache
def code_digest() -> str:
    """Digest of all files of the installed package, and of the versions that it computes with."""
    return digest(dict(sources()), versions())


@cache
def versions() -> dict[str, str]:
    """Versions of Python, of this package, and of the libraries that compute, as far as they are installed."""
    found = {"python": platform.python_version(), "aoro-gym": VERSION}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@dataclass
class _Visited:
    """What was met on the way to a value."""

    containers: list[int] = field(default_factory=list)
    """Identities of what the value is in, outermost first: it may hold a reference to one of them."""
    code: dict[int, tuple[int, Any]] = field(default_factory=dict)
    """Functions, classes and modules by identity, numbered: many name one another."""


def _tokens(value: Any, visited: _Visited) -> Iterator[bytes]:
    """Bytes that tell ``value`` from all others."""
    if value is None or isinstance(value, bool | int | str | bytes | PurePath | complex):
        yield f"{type(value).__name__}:".encode() + (value if isinstance(value, bytes) else str(value).encode())
    elif isinstance(value, float):
        yield b"float:" + struct.pack("<d", value)
    elif isinstance(value, Contents):
        yield from _file_tokens(value.path)
    elif id(value) in visited.containers:
        yield f"again:{len(visited.containers) - visited.containers.index(id(value))}".encode()
    elif id(value) in visited.code:
        yield f"code:{visited.code[id(value)][0]}".encode()
    else:
        if isinstance(value, type | types.FunctionType | types.ModuleType):
            visited.code[id(value)] = len(visited.code), value
        visited.containers.append(id(value))
        yield from _compound_tokens(value, visited)
        visited.containers.pop()


def _compound_tokens(value: Any, visited: _Visited) -> Iterator[bytes]:
    if isinstance(value, np.generic | np.ndarray):
        yield from _array_tokens(value, visited)
    elif isinstance(value, Mapping):
        yield from _kind_tokens(value, "mapping", visited)
        yield f"{len(value)}".encode()
        for key, key_digest in sorted(((key, digest(key)) for key in value), key=lambda pair: pair[1]):
            yield key_digest.encode()
            yield from _tokens(value[key], visited)
    elif isinstance(value, Set):
        yield from _kind_tokens(value, "set", visited)
        yield f"{len(value)}".encode()
        yield from sorted(digest(item).encode() for item in value)
    elif isinstance(value, list | tuple):
        yield from _kind_tokens(value, type(value).__name__, visited)
        yield f"{len(value)}".encode()
        for item in value:
            yield from _tokens(item, visited)
    elif isinstance(value, type):
        yield from _class_tokens(value, visited)
    elif isinstance(value, types.FunctionType | types.MethodType | types.BuiltinFunctionType | np.ufunc | partial):
        yield from _function_tokens(value, visited)
    elif isinstance(value, types.ModuleType):
        yield from _module_tokens(value)
    elif is_dataclass(value):
        yield from _class_tokens(type(value), visited)
        for name, part in _state(value).items():
            yield name.encode()
            yield from _tokens(part, visited)
    elif hasattr(value, "detach") and hasattr(value, "numpy"):
        yield from _array_tokens(value.detach().cpu().numpy(), visited)  # a tensor
    else:
        yield from _object_tokens(value, visited)


def _kind_tokens(value: Any, kind: str, visited: _Visited) -> Iterator[bytes]:
    """What a container is; of one of an own class, that and what it holds beside its items."""
    if not _is_own(type(value)):
        yield kind.encode()
        return
    yield from _class_tokens(type(value), visited)
    yield from _tokens(getattr(value, "__dict__", None), visited)


def _array_tokens(array: Any, visited: _Visited) -> Iterator[bytes]:
    if isinstance(array, np.ma.MaskedArray):
        yield b"masked"
        yield from _array_tokens(np.ma.getmaskarray(array), visited)
        array = array.filled(0) if array.dtype.names is None else array.data
    array = np.asarray(array)
    if array.dtype.hasobject:
        yield f"objects:{array.shape}".encode()
        for item in array.ravel().tolist():
            yield from _tokens(item, visited)
    else:
        kind = array.dtype.str if array.dtype.names is None else repr(array.dtype.descr)
        yield f"array:{kind}:{array.shape}".encode()
        yield np.ascontiguousarray(array).tobytes()


def _state(value: Any) -> dict[str, Any]:
    """Fields of a dataclass's instance and whatever else was set on it, less what it has calculated from them."""
    names = (one.name for one in fields(value) if hasattr(value, one.name))
    return {name: getattr(value, name) for name in names} | _uncalculated(value, getattr(value, "__dict__", {}))


def _uncalculated(value: Any, state: Mapping[str, Any]) -> dict[str, Any]:
    kept = {
        name for base in type(value).__mro__ for name, what in vars(base).items() if isinstance(what, cached_property)
    }
    return {name: part for name, part in state.items() if name not in kept}


def _class_tokens(value: type, visited: _Visited) -> Iterator[bytes]:
    """A class by its name and, of its own bases and itself, source and attributes."""
    yield f"class:{_qualified(value)}".encode()
    for base in value.__mro__:
        if not _is_own(base):
            continue
        yield _source(base)
        if _is_of_package(base):  # all of the package's sources are in code_digest()
            continue
        for name, part in sorted(vars(base).items()):
            part = _defined(part)
            if isinstance(part, types.FunctionType) or not (name.startswith("__") or isinstance(part, _STORAGE)):
                yield name.encode()
                yield from _tokens(part, visited)


_STORAGE = types.MemberDescriptorType | types.GetSetDescriptorType | types.WrapperDescriptorType | type(ABC._abc_impl)  # pyright: ignore[reportAttributeAccessIssue]
"""Attributes of a class that are how Python keeps its instances, not its state."""


def _defined(part: Any) -> Any:
    """The function of a method, property or the like; anything else as it is."""
    if isinstance(part, staticmethod | classmethod):
        return part.__func__
    if isinstance(part, property):
        return part.fget
    return part.func if isinstance(part, cached_property) else part


def _function_tokens(value: Any, visited: _Visited) -> Iterator[bytes]:
    """A function by its source, its code, its defaults, what it closes over, and the global names that it looks up."""
    if isinstance(value, partial):
        yield b"partial"
        yield from _tokens((value.func, value.args, value.keywords), visited)
    elif isinstance(value, types.MethodType):
        yield b"method"
        yield from _tokens((value.__func__, value.__self__), visited)
    elif isinstance(value, types.FunctionType):
        yield f"function:{_qualified(value)}".encode()
        yield _source(value)
        yield from _code_tokens(value.__code__)
        cells = tuple(_content(cell) for cell in value.__closure__ or ())
        yield from _tokens((value.__defaults__, value.__kwdefaults__, cells), visited)
        if _is_own(value) and not _is_of_package(value):
            for name in sorted(_names(value.__code__) & value.__globals__.keys()):
                yield name.encode()
                yield from _tokens(value.__globals__[name], visited)
    else:
        yield f"builtin:{_qualified(value)}".encode()
        of = getattr(value, "__self__", None)
        if not isinstance(of, types.ModuleType):
            yield from _tokens(of, visited)


def _content(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not yet filled
        return None


def _code_tokens(code: types.CodeType) -> Iterator[bytes]:
    """Two functions on one line have one source; their code differs."""
    yield code.co_code + repr((code.co_names, code.co_varnames, code.co_freevars)).encode()
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _code_tokens(constant)
        else:
            yield from _tokens(constant, _Visited())


def _names(code: types.CodeType) -> set[str]:
    """Names that a function, and the functions within it, look up."""
    inner = (constant for constant in code.co_consts if isinstance(constant, types.CodeType))
    return {*code.co_names}.union(*(_names(one) for one in inner))


def _module_tokens(module: types.ModuleType) -> Iterator[bytes]:
    yield f"module:{module.__name__}".encode()
    file = getattr(module, "__file__", None)
    if file is not None and _is_own_file(file) and not module.__name__.startswith(PACKAGE):
        yield from _file_tokens(Path(file))


def _object_tokens(value: Any, visited: _Visited) -> Iterator[bytes]:
    """Any other object by its class and the state that it would be copied with."""
    try:
        made = value.__reduce_ex__(2)
    except Exception as error:  # whatever an object that cannot be copied raises
        raise TypeError(f"a {_qualified(type(value))} has no digest: {error}") from None
    yield f"object:{_qualified(type(value))}".encode()
    if isinstance(made, str):
        yield made.encode()
        yield from _tokens(getattr(value, "__wrapped__", None), visited)  # such as a function whose results are kept
        return
    yield from _class_tokens(type(value), visited)
    maker, arguments, state, items, pairs = (*made, None, None, None)[:5]
    yield _qualified(maker).encode()
    arguments = [item for item in arguments or () if item is not type(value)]
    state = _uncalculated(value, state) if isinstance(state, dict) else state
    yield from _tokens((arguments, state, list(items or ()), list(pairs or ())), visited)


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
    name = getattr(value, "__qualname__", None) or getattr(value, "__name__", None) or repr(value)
    return f"{getattr(value, '__module__', '')}.{name}"


def _is_own(value: Any) -> bool:
    """Whether a class or function is neither Python's nor a library's, whose versions count instead."""
    module = sys.modules.get(value.__module__ or "")
    if module is None or module.__name__ == "__main__":  # a file that was loaded by hand, or a prompt
        return True
    file = getattr(module, "__file__", None)
    return file is not None and _is_own_file(file)


def _is_own_file(file: str) -> bool:
    return "site-packages" not in file and not file.startswith(os.path.dirname(os.__file__))


def _is_of_package(value: Any) -> bool:
    """Whether a class or function is this package's."""
    return f"{value.__module__}.".startswith(PACKAGE)


_known_sources: WeakKeyDictionary[Any, bytes] = WeakKeyDictionary()
"""Sources that were asked for: of thousands of objects each names that of its class, and a module is parsed to find it."""


def _source(value: Any) -> bytes:
    """The source of a class or function, as it was when it was first asked for; empty where there is none."""
    found = _known_sources.get(value)
    if found is None:
        try:
            found = inspect.getsource(value).encode()
        except (OSError, TypeError):  # typed at a prompt, or compiled
            found = b""
        _known_sources[value] = found
    return found
