"""The C compiler of this computer."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

CANDIDATES = ("cc", "gcc", "clang")
"""Compilers that are looked for where the environment variable CC names none."""
FLAGS = ("-std=gnu11", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-builtin-pow")
"""No fused multiplications and no square in place of a power: formulas give the bits that they give in Python."""


class NoCompiler(ValueError):
    """There is no C compiler, or it failed."""


def find_compiler() -> list[str]:
    """Command of the C compiler: ``$CC``, or the first of :data:`CANDIDATES`; raises NoCompiler."""
    asked = shlex.split(os.environ.get("CC", ""))
    if asked:
        if shutil.which(asked[0]) is None:
            raise NoCompiler(f"CC is {asked[0]!r}, but there is no such program; let CC name a C compiler")
        return asked
    for name in CANDIDATES:
        if shutil.which(name) is not None:
            return [name]
    raise NoCompiler(
        f"no C compiler was found ({', '.join(CANDIDATES)}): install one, for example gcc, or let CC name it"
    )


def link(sources: Sequence[Path], objects: Sequence[Path], exports: Sequence[str], out: Path) -> None:
    """Compile and link a shared library that offers symbols by the patterns ``exports`` and needs libc and libm alone.

    Raises NoCompiler with what the compiler said.
    """
    compiler, folder = find_compiler(), sources[0].parent
    script = folder / "exports.map"
    script.write_text("{ global: " + " ".join(f"{name};" for name in exports) + " local: *; };\n", encoding="utf-8")
    files = [str(path) for path in (*sources, *objects)]
    # the kernels' object is of the large code model, which a linker may keep apart
    linking = [f"-Wl,--version-script={script}", "-Wl,--gc-sections", "-Wl,--no-undefined", "-Wl,-s", "-lm"]
    command = [*compiler, *FLAGS, *files, *linking, "-o", str(out)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = next((line for line in done.stderr.splitlines() if "error" in line or "undefined" in line), done.stderr)
        raise NoCompiler(f"{compiler[0]} failed: {said.strip()[:300]}; is it a C compiler of this computer?")
