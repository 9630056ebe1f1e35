"""Where Warp is started, and what it says while it is.

Warp greets at its start. Without an NVIDIA driver it also warns that there is no GPU, from native code, whether or not one
was asked for. Both are left out here, unless Warp was started before; who asks for a GPU that is not there gets an error
that says why.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp
from warp import config

from aoro_gym.execution.device_names import ALL_GPUS, SIMD, base

NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"
"""Of the line that Warp writes to the standard error, file descriptor 2, where there is none."""
NO_GPU = "the NVIDIA driver (libcuda) was not found"


_quiet = False


def set_quiet(quiet: bool) -> None:
    """Whether nothing is said of compilations, which take long enough to look like a fault."""
    global _quiet
    _quiet = quiet


def say(text: str) -> None:
    """Say what keeps a user waiting, unless nothing is to be said."""
    if not _quiet:
        print(text, file=sys.stderr, flush=True)


@cache
def start() -> None:
    """Start Warp; does nothing if it is started already."""
    if config.log_level == wp.LOG_INFO and _not_started():
        config.log_level = wp.LOG_WARNING
    if _driver():
        wp.init()
        return
    with _without(NO_DRIVER):
        wp.init()


def find(name: str) -> Any:
    """The Warp device ``name``; ValueError that lists those that there are, and says what a GPU lacks."""
    start()
    try:
        return wp.get_device(base(name))
    except Exception as error:
        cpu, *others = (one.alias for one in wp.get_devices())
        known = ", ".join([cpu, SIMD, *others])
        why = f" ({NO_GPU})" if str(name).startswith("cuda") and not _driver() else ""
        several_named = "," in str(name) or (name == ALL_GPUS and others)
        fault = "is several devices, of which one is wanted" if several_named else "is not available"
        raise ValueError(f"device {name!r} {fault} here; choose one of: {known}{why}") from error


def several(names: str) -> tuple[str, ...]:
    """The devices of a list with commas, each of which there is. ``"cuda:all"`` stands for all GPUs; one that is named twice
    takes two shares of the work.

    Raises ValueError as :func:`find` does.
    """
    found: list[str] = []
    for name in (part.strip() for part in names.split(",")):
        start()
        gpus = [device.alias for device in wp.get_cuda_devices()] if name == ALL_GPUS else []
        found += gpus or [name]
        find(found[-1])
    return tuple(found)


@contextmanager
def compiling(kernel: Any, device: Any, block_dim: int) -> Iterator[None]:
    """Around the first launch of ``kernel``: says so if its module has to be compiled for ``device``."""
    if _compiled(kernel.module, device, 1 if device.is_cpu else block_dim):
        yield
        return
    say(f"compiling the twin for {device.alias}, once on a computer: about half a minute ...")
    began = time.perf_counter()
    yield
    say(f"compiled in {time.perf_counter() - began:.0f} s")


def _compiled(module: Any, device: Any, block_dim: int) -> bool:
    """Whether the module is loaded, or compiled on the disk."""
    if (device.context, block_dim) in module.execs:
        return True
    folder = Path(str(config.kernel_cache_dir)) / module.get_module_identifier(block_dim)
    ends = (".o",) if device.is_cpu else (".cubin", ".ptx")
    return folder.is_dir() and any(file.suffix in ends for file in folder.iterdir())


def _not_started() -> bool:
    from warp._src import context  # no public name tells

    return context.runtime is None


@cache
def _driver() -> bool:
    """Whether there is an NVIDIA driver."""
    for name in ("libcuda.so", "libcuda.so.1") if sys.platform == "linux" else ():
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return sys.platform != "linux"


@contextmanager
def _without(text: str) -> Iterator[None]:
    """Lines that hold ``text`` and are written to file descriptor 2 meanwhile are left out; others come at the end."""
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # closed: nothing is written
        yield
        return
    with tempfile.TemporaryFile() as written:
        os.dup2(written.fileno(), 2)
        try:
            yield
        finally:
            sys.stderr.flush()
            os.dup2(kept, 2)
            os.close(kept)
            written.seek(0)
            rest = b"".join(line for line in written if text.encode() not in line)
            if rest:
                os.write(2, rest)
