"""Run the drawn mutants, each in a copy of the tree: ``python studies/mutation/run.py --workers 16`` writes result.json.

Needs pytest and what the tests need, no network and no git. Every worker has its own copy and its own folder of compiled
kernels; a mutant in device code is compiled anew, as its module's hash is another. Tests that fail without any mutant, on a
machine that lacks something, are left out and listed; so are whole files that can't be collected there.
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
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from threading import Lock

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SLACK = (4.0, 120.0)
"""A mutant whose tests take longer than so many times those without it, and so many seconds more, hangs: killed."""

NO_TESTS = 5
"""Exit code of pytest where nothing is left to run."""


def package_of(file: str, config: dict) -> str:
    """The package of the config that ``file`` is in."""
    (package,) = [name for name in config["wider"] if file.startswith(name)]
    return package


def commands(file: str, config: dict) -> list[tuple[str, ...]]:
    """Tests of ``file``, one command each: its mirror or what stands for it, then what is wider."""
    path = Path(file.removeprefix("aoro_gym/"))
    mirror = Path("tests") / path.parent / f"test_{path.name}"
    near = config["near"].get(file, [str(mirror)] * (ROOT / mirror).is_file())
    return [tuple(tests) for tests in (near, config["wider"][package_of(file, config)]) if tests]


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


def lines_with(old: list[str], path: Path) -> list[int]:
    """Numbers of the lines in ``path`` at which ``old`` stands, however far indented."""
    lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    wanted = [line.strip() for line in old]
    return [first + 1 for first in range(len(lines)) if lines[first : first + len(wanted)] == wanted]


def found(mutant: dict, config: dict) -> dict | None:
    """The mutant where its code is now: nearest in its own file, else in the one place of its package that has it."""
    own = ROOT / mutant["file"]
    if own.is_file() and (numbers := lines_with(mutant["old"], own)):
        return {**mutant, "line": min(numbers, key=lambda number: abs(number - mutant["line"]))}
    files = (ROOT / package_of(mutant["file"], config)).rglob("*.py")
    spots = [(path, number) for path in files for number in lines_with(mutant["old"], path)]
    if len(spots) != 1:
        return None
    return {**mutant, "file": str(spots[0][0].relative_to(ROOT)), "line": spots[0][1]}


class Baseline:
    """Results of the commands without any mutant, each found once, when it is first asked for.

    Files that can't be collected there don't keep the others from running.
    """

    def __init__(self):
        self.results: dict[tuple[str, ...], tuple[int, list[str], float]] = {}
        self._locks = defaultdict(Lock)

    def of(self, copy: Path, command: tuple[str, ...]) -> tuple[int, list[str], float]:
        with self._locks[command]:
            if command not in self.results:
                self.results[command] = tests(copy, command, "--continue-on-collection-errors")
                print("without any mutant:", *command, *self.results[command], flush=True)
        return self.results[command]


@contextmanager
def mutated(path: Path, mutant: dict) -> Iterator[None]:
    """The file at ``path`` with the mutant in it, as far indented as what it replaces."""
    source = path.read_text(encoding="utf-8")
    lines, first, old = source.splitlines(), mutant["line"] - 1, mutant["old"]
    shift = len(lines[first]) - len(old[0])
    lines[first : first + len(old)] = [" " * shift + line[max(-shift, 0) :] for line in mutant["new"]]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    try:
        yield
    finally:
        path.write_text(source, encoding="utf-8")


def judged(copy: Path, mutant: dict, config: dict, baseline: Baseline) -> dict:
    """The mutant with ``killed`` by what, or why not, and after how many seconds."""
    by, seconds = "", 0.0
    for command in commands(mutant["file"], config):
        code, broken, least = baseline.of(copy, command)
        if code not in (0, 1):
            return {**mutant, "killed": None, "by": f"without any mutant, {command[0]} gives exit code {code}"}
        if set(command) <= set(broken):
            continue
        without = [f"--deselect={name}" if "::" in name else f"--ignore={name}" for name in broken]
        with mutated(copy / mutant["file"], mutant):
            code, failed, taken = tests(copy, command, "-x", *without, limit=SLACK[0] * least + SLACK[1])
        seconds += taken
        if code not in (0, NO_TESTS):
            by = failed[0] if failed else f"{command[0]}, {'time' if code < 0 else f'exit code {code}'}"
            break
    why = by or config["equivalent"].get(mutant["new"][0].strip(), "")
    return {**mutant, "killed": bool(by), "by": why, "seconds": round(seconds)}


def report(results: list[dict], broken: list[str]) -> str:
    """JSON, a mutant a line; what it changes stands in mutants.json under its number."""
    head = json.dumps({"killed": sum(bool(one["killed"]) for one in results), "of": len(results), "left_out": broken})
    kept = ("number", "file", "line", "killed", "by", "seconds")
    rows = (json.dumps({key: one[key] for key in kept if key in one}, ensure_ascii=False) for one in results)
    return f'{head[:-1]}, "mutants": [\n' + ",\n".join(rows) + "\n]}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--only", type=int, nargs="*", help="numbers of mutants")
    parser.add_argument("--scratch", type=Path, default=Path("/tmp/mutants"))
    parser.add_argument("--out", type=Path, default=HERE / "result.json")
    options = parser.parse_args()
    config = tomllib.loads((HERE / "config.toml").read_text(encoding="utf-8"))
    mutants = json.loads((HERE / "mutants.json").read_text(encoding="utf-8"))
    mutants = [{"number": i, **one} for i, one in enumerate(mutants) if options.only is None or i in options.only]
    baseline = Baseline()
    free: SimpleQueue[Path] = SimpleQueue()
    hidden = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".warp", "result.json")
    for number in range(options.workers):
        free.put(Path(shutil.copytree(ROOT, options.scratch / str(number), symlinks=True, ignore=hidden)))

    def result(mutant: dict) -> dict:
        here = found(mutant, config)
        if here is None:
            return {**mutant, "killed": None, "by": "its code is gone"}
        copy = free.get()
        try:
            return judged(copy, here, config, baseline)
        finally:
            free.put(copy)

    with ThreadPoolExecutor(options.workers) as pool:
        results = []
        for one in pool.map(result, mutants):
            results.append(one)
            print(one["killed"], one["file"], one["line"], one["by"], flush=True)
            broken = sorted({name for _, names, _ in baseline.results.values() for name in names})
            options.out.write_text(report(results, broken), encoding="utf-8")


if __name__ == "__main__":
    main()
