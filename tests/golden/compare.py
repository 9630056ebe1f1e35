"""Compare two revisions on this machine, to the bit: trajectories, environments, reports, a training.

    python -m tests.golden.compare 6000023 main [--group quick|full] [--only NAME] [--keep FOLDER]

REV is a git revision, which is checked out into a temporary worktree, or a folder that holds a working tree. Today's
``scenarios.py`` runs in both with this interpreter. Exits with 1 if anything differs.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SCENARIOS = Path(__file__).with_name("scenarios.py")
ERROR = "error.txt"

VOLATILE = {
    "aoro_gym": "version of the package, in the manifests of logs",
    "answers": "digest of a file that holds a salt",
    "elapsed_s": "wall time of a training until each of its evaluations",
    "provenance.json": "versions and digests of the sources",
    "revision": "git revision that a policy was trained at",
    "salt": "random, so that no one can guess sealed answers from their digest",
    "seconds": "wall time of loading a terrain",
    "time/fps": "steps of a training per wall time",
    "time/time_elapsed": "wall time of a training",
    "versions": "versions of packages that a policy was trained with",
}
"""Names of files, fields and columns that differ from run to run, each with the reason why it says nothing."""


def fields(folder: Path) -> dict[str, Any]:
    """Everything that a scenario wrote, by ``file:field``: arrays, numbers and texts, without what is volatile."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.name not in VOLATILE and path.suffix in READERS:
            found.update({f"{name}:{field}": value for field, value in READERS[path.suffix](path)})
    return found


def leaves(value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested mappings and lists by dotted path, without volatile ones."""
    if isinstance(value, Mapping | list):
        for key, item in value.items() if isinstance(value, Mapping) else enumerate(value):
            if key not in VOLATILE:
                yield from leaves(item, f"{where}.{key}" if where else str(key))
        if not value:
            yield where, str(value)
    else:
        yield where, value


def read_columns(path: Path) -> Iterator[tuple[str, Any]]:
    """Columns of a CSV file: texts, so that every digit counts."""
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    yield "columns", ", ".join(head)
    for name, *column in zip(head, *rows, strict=True):
        if name not in VOLATILE:
            yield name, np.array(column)


def read_weights(path: Path) -> Iterator[tuple[str, Any]]:
    from safetensors.numpy import load_file

    yield from load_file(path).items()


READERS = {
    ".npz": lambda path: np.load(path).items(),
    ".json": lambda path: leaves(json.loads(path.read_text())),
    ".toml": lambda path: leaves(tomllib.loads(path.read_text())),
    ".csv": read_columns,
    ".ply": lambda path: [("bytes", hashlib.sha256(path.read_bytes()).hexdigest())],
    ".safetensors": read_weights,
    ".txt": lambda path: [("text", path.read_text())],
}
"""How files are read, by suffix; plots and pages show what the reports hold."""


def same(a: Any, b: Any) -> bool:
    """Equal in type, shape and every bit; NaN equals itself."""
    first, second = np.asarray(a), np.asarray(b)
    return first.dtype == second.dtype and first.shape == second.shape and first.tobytes() == second.tobytes()


def distance(a: Any, b: Any) -> float:
    """Largest absolute difference; infinite between what are not numbers, or not of one shape."""
    try:
        first, second = np.asarray(a).astype(float), np.asarray(b).astype(float)
    except (TypeError, ValueError):
        return np.inf
    if first.shape != second.shape or not first.size or np.any(np.isnan(first) != np.isnan(second)):
        return np.inf
    return float(np.nanmax(np.abs(first - second), initial=0.0))


@dataclass(frozen=True)
class Difference:
    """How two results of a scenario differ."""

    count: int
    largest: float
    first: str
    """First field that differs, with both values."""


def difference(a: Path, b: Path) -> Difference | None:
    """Compare what a scenario wrote into two folders; None if all of it is equal to the bit."""
    for side, folder in (("first", a), ("second", b)):
        if not folder.is_dir() or (folder / ERROR).exists():
            last = (folder / ERROR).read_text().splitlines()[-1] if folder.is_dir() else "it has no such scenario"
            return Difference(1, np.inf, f"fails on the {side}: {last}")
    one, other = fields(a), fields(b)
    if not one:
        return Difference(1, np.inf, "wrote nothing to compare")
    names = [
        name for name in {**one, **other} if name not in one or name not in other or not same(one[name], other[name])
    ]
    if not names:
        return None
    largest = max(distance(one[name], other[name]) if name in one and name in other else np.inf for name in names)
    return Difference(len(names), largest, f"{names[0]}{shown(one.get(names[0]), other.get(names[0]))}")


def shown(a: Any, b: Any) -> str:
    """The first element in which two values differ."""
    first, second = np.asarray(a), np.asarray(b)
    where = ""
    if first.shape == second.shape and first.ndim and first.dtype == second.dtype:
        at = np.argwhere(~((first == second) | ((first != first) & (second != second))))
        if len(at):
            index = tuple(map(int, at[0]))
            where, first, second = str(list(index)), first[index], second[index]
    elif first.shape != second.shape:
        return f": {first.shape} and {second.shape}" if a is not None and b is not None else ": on one side only"
    return f"{where}: {first} and {second}"


@contextmanager
def tree(revision: str) -> Iterator[Path]:
    """The working tree of a revision: that folder, or a temporary worktree."""
    if Path(revision).is_dir():
        yield Path(revision).resolve()
        return
    repository = SCENARIOS.parents[2]
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch) / "tree"
        git = ["git", "-C", str(repository), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(place), revision], check=True)
        try:
            yield place
        finally:
            subprocess.run([*git, "remove", "--force", str(place)], check=True)


def results(revision: str, out: Path, *, group: str, only: str | None) -> None:
    """Run the scenarios on ``revision`` into ``out``, one folder a scenario.

    Raises:
        RuntimeError: the scenarios could not run at all; with the last line of the error.
    """
    with tree(revision) as place:
        # sets of texts, such as a training log's columns, have the same order in every process
        environment = {**os.environ, "PYTHONPATH": str(place), "AORO_GYM_CACHE": "off", "PYTHONHASHSEED": "0"}
        options = ["--group", group, *(["--only", only] if only else [])]
        if not (place / "aoro_gym").is_dir():
            raise RuntimeError(f"{revision} holds no aoro_gym")
        command = [sys.executable, str(SCENARIOS), str(out), *options]
        done = subprocess.run(command, cwd=place, env=environment, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(f"{revision}: {done.stderr.strip().splitlines()[-1]}")


def kept_results(revision: str, keep: Path, *, group: str, only: str | None) -> Path:
    """Results of a revision that are kept in ``keep``, by its commit and today's scenarios; made if they are not there."""
    git = ["git", "-C", str(SCENARIOS.parent), "rev-parse", f"{revision}^{{commit}}"]
    commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    of = hashlib.sha256(SCENARIOS.read_bytes()).hexdigest()
    place = keep / f"{commit[:12]}-{of[:12]}-{only or group}"
    if not place.exists():
        keep.mkdir(parents=True, exist_ok=True)
        making = Path(tempfile.mkdtemp(dir=keep))
        results(revision, making, group=group, only=only)
        making.rename(place)
    return place


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("revisions", nargs=2, metavar="REV", help="git revision, or folder of a working tree")
    parser.add_argument("--group", choices=("quick", "full"), default="quick")
    parser.add_argument("--only", metavar="NAME", help="one scenario")
    parser.add_argument(
        "--keep", metavar="FOLDER", type=Path, help="keep results of git revisions there, and reuse them"
    )
    asked = parser.parse_args()
    scratch = Path(tempfile.mkdtemp())
    try:
        places = []
        for number, revision in enumerate(asked.revisions):
            if asked.keep is not None and not Path(revision).is_dir():
                places.append(kept_results(revision, asked.keep, group=asked.group, only=asked.only))
            else:
                places.append(scratch / str(number))
                results(revision, places[-1], group=asked.group, only=asked.only)
        return report(*places)
    finally:
        shutil.rmtree(scratch)


def report(a: Path, b: Path) -> int:
    """Print a line a scenario; 1 if any differs or none ran, else 0."""
    names = sorted({path.name for folder in (a, b) for path in folder.iterdir()})
    differing = 0
    for name in names:
        found = difference(a / name, b / name)
        differing += found is not None
        print(
            f"{name:26} "
            + ("equal" if found is None else f"{found.count} differ, by {found.largest:.3g}; {found.first}")
        )
    print(f"{differing} of {len(names)} scenarios differ")
    return int(bool(differing) or not names)


if __name__ == "__main__":
    sys.exit(main())
