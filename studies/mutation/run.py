"""Run the drawn mutants, each in a copy of the tree: ``python studies/mutation/run.py --workers 16`` writes result.json.

Needs pytest and what the tests need, no network and no git. Every worker has its own copy and its own folder of compiled
kernels; a mutant in device code is compiled anew, as its module's hash is another. Tests that fail without any mutant, on a
machine that lacks something, are left out and listed.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SLACK = (4.0, 120.0)
"""A mutant whose tests take longer than so many times those without it, and so many seconds more, hangs: killed."""


def commands(file: str, wider: dict[str, list[str]]) -> list[tuple[str, ...]]:
    """Tests of ``file``, one command each: its mirror, then what is wider."""
    path = Path(file.removeprefix("aoro_gym/"))
    mirror = Path("tests") / path.parent / f"test_{path.name}"
    (package,) = [name for name in wider if file.startswith(name)]
    return [(str(mirror),)] * (ROOT / mirror).is_file() + [tuple(wider[package])]


def tests(
    copy: Path, command: tuple[str, ...], *options: str, limit: float | None = None
) -> tuple[int, list[str], float]:
    """Exit code (0: they pass), names of what failed, and time [s]; no code of its own has what ran out of time: -1."""
    environment = {
        **os.environ, "PYTHONPATH": os.pathsep.join([str(copy), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "WARP_CACHE_PATH": str(copy / ".warp"), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1",
    }  # fmt: skip
    call = [sys.executable, "-m", "pytest", "-q", "-rfE", "-p", "no:cacheprovider", *command, *options]
    began = time.monotonic()
    process = subprocess.Popen(
        call,
        cwd=copy,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        shown, code = process.communicate(timeout=limit)[0], process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        shown, code = process.communicate()[0], -1
    return code, re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - |$)", shown, re.MULTILINE), time.monotonic() - began


def judged(copy: Path, mutant: dict, wider: dict, sound: dict) -> dict:
    """The mutant with ``killed`` by what, or not, and after how many seconds."""
    path = copy / mutant["file"]
    source = path.read_text(encoding="utf-8")
    lines, first = source.splitlines(), mutant["line"] - 1
    end = first + len(mutant["old"])
    if lines[first:end] != mutant["old"]:
        return {**mutant, "killed": None, "by": "the file is another than the one it was drawn from"}
    lines[first:end] = mutant["new"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    by, seconds = [], 0.0
    try:
        for command in commands(mutant["file"], wider):
            _, broken, least = sound[command]
            limit = SLACK[0] * least + SLACK[1]
            code, by, taken = tests(copy, command, "-x", *(f"--deselect={test}" for test in broken), limit=limit)
            seconds += taken
            if code:
                by = by or [f"{command[0]}, {'time' if code < 0 else f'exit code {code}'}"]
                break
    finally:
        path.write_text(source, encoding="utf-8")
    return {**mutant, "killed": bool(by), "by": by[0] if by else "", "seconds": round(seconds)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--only", type=int, nargs="*", help="numbers of mutants")
    parser.add_argument("--scratch", type=Path, default=Path("/tmp/mutants"))
    parser.add_argument("--out", type=Path, default=HERE / "result.json")
    options = parser.parse_args()
    wider = tomllib.loads((HERE / "config.toml").read_text(encoding="utf-8"))["wider"]
    mutants = json.loads((HERE / "mutants.json").read_text(encoding="utf-8"))
    mutants = [one for i, one in enumerate(mutants) if options.only is None or i in options.only]
    free: SimpleQueue[Path] = SimpleQueue()
    hidden = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".warp", "result.json")
    for number in range(options.workers):
        free.put(Path(shutil.copytree(ROOT, options.scratch / str(number), symlinks=True, ignore=hidden)))

    def on_a_copy(job, *arguments):
        copy = free.get()
        try:
            return job(copy, *arguments)
        finally:
            free.put(copy)

    with ThreadPoolExecutor(options.workers) as pool:
        every = {command: None for one in mutants for command in commands(one["file"], wider)}
        sound = dict(zip(every, pool.map(lambda command: on_a_copy(tests, command), every), strict=True))
        print(f"tests without mutants: {json.dumps([[*key, *value] for key, value in sound.items()])}", flush=True)
        results = []
        for result in pool.map(lambda one: on_a_copy(judged, one, wider, sound), mutants):
            results.append(result)
            print(result["killed"], result["file"], result["line"], result["by"], flush=True)
            broken = sorted({test for _, tests_, _ in sound.values() for test in tests_})
            content = {"killed": sum(bool(one["killed"]) for one in results), "of": len(results), "left_out": broken}
            content["mutants"] = results
            options.out.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
