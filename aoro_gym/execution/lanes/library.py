"""From a kernel to a function that the machine's own C++ compiler has made of its translation."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp
from filelock import FileLock
from warp import config

from aoro_gym.execution.files import write_text, written_whole
from aoro_gym.execution.lanes.translate import Untranslatable, translated

HEADER, TRANSLATOR = (Path(__file__).with_name(name) for name in ("lanes.h", "translate.py"))
COMPILERS = ("g++", "c++", "clang++")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC", "-w")
"""No flag lets the compiler assume that numbers are finite: a twin that diverges has to be seen."""
INLINED = (
    "-finline-limit=2000", "--param=inline-unit-growth=1000", "--param=large-function-growth=10000",
    "--param=sra-max-scalarization-size-Ospeed=4096",
)  # fmt: skip
"""Of GCC: structs stay in registers where functions are inlined, which is worth 1.7 times the speed."""


def compiled(kernel: Any, device: Any, block_dim: int, say: Callable[[str], None]) -> Any:
    """The function of ``kernel`` on lanes, called as the one that Warp has compiled for the CPU.

    It is compiled once on a computer, and kept beside Warp's kernels by what it is made of.

    Args:
        kernel: Of one dimension.
        device: Warp's CPU.
        block_dim: Threads a block, as for its launches.
        say: Gets a line before and after a compilation, which takes up to a minute.

    Raises ValueError: there is no compiler; or lanes cannot run the kernel, with the reason.
    """
    wp.load_module(kernel.module, device=device, block_dim=block_dim)
    identifier = kernel.module.get_module_identifier(1)
    source = Path(str(config.kernel_cache_dir)) / identifier / f"{identifier}.cpp"
    try:
        path = _library(source.read_text(encoding="utf-8"), kernel.get_mangled_name(), say)
    except Untranslatable as error:
        raise ValueError(f"device 'cpu:simd' cannot run {kernel.key}: {error}; take device='cpu'") from None
    return _loaded(path).advance


def _check_known(text: str) -> None:
    """Untranslatable that names what ``lanes.h`` does not have."""
    known = set(re.findall(r"\w+", HEADER.read_text(encoding="utf-8")))
    unknown = sorted(set(re.findall(r"\bwp::(\w+)", text)) - known)
    if unknown:
        raise Untranslatable(f"lanes have no {', '.join(unknown)}")


def _library(source: str, kernel: str, say: Callable[[str], None]) -> Path:
    """Shared library of a kernel's translation, compiled where there is none yet."""
    compiler, version = cpp_compiler()
    flags = (*FLAGS, *(INLINED if "clang" not in version else ()))
    ours = (file.read_text(encoding="utf-8") for file in (HEADER, TRANSLATOR))
    parts = (source, kernel, *ours, version, " ".join(flags), _processor())
    folder = (
        Path(str(config.kernel_cache_dir)) / f"lanes_{hashlib.sha256(chr(0).join(parts).encode()).hexdigest()[:16]}"
    )
    path = folder / "lanes.so"
    if path.exists():
        return path
    text = translated(source, kernel)
    _check_known(text)
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "lock"):
        if path.exists():  # another process has made it meanwhile
            return path
        say("compiling the twin for cpu:simd, once on a computer: about a minute ...")
        began = time.perf_counter()
        write_text(folder / "lanes.cpp", text)
        with written_whole(path) as temporary:
            command = [compiler, *flags, f"-I{HEADER.parent}", str(folder / "lanes.cpp"), "-o", str(temporary), "-lm"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:300])
                raise ValueError(f"{compiler} cannot compile {folder / 'lanes.cpp'}: {first}; take device='cpu'")
        say(f"compiled in {time.perf_counter() - began:.0f} s")
    return path


@cache
def _loaded(path: Path) -> Any:
    return ctypes.CDLL(str(path))


@cache
def cpp_compiler() -> tuple[str, str]:
    """The C++ compiler, and what it says of itself; ValueError where there is none."""
    asked = os.environ.get("CXX")
    for name in (asked,) if asked else COMPILERS:
        path = shutil.which(name)
        if path:
            said = subprocess.run([path, "--version"], capture_output=True, text=True, check=False).stdout
            return path, said.splitlines()[0] if said else name
    tried = asked or ", ".join(COMPILERS)
    how = "apt install g++" if sys.platform == "linux" else "install one, or set CXX"
    raise ValueError(
        f"device 'cpu:simd' needs a C++ compiler, and there is none ({tried}): {how}; or take device='cpu'"
    )


@cache
def _processor() -> str:
    """What this processor is and can do: code that is compiled for it runs on no other."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n", 1)[0].splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(line for line in lines if re.match(r"model name|flags|Features", line))
