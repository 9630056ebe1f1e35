"""Largest deviations of laws from their oracles: ``python -m tests.twin.physics.deviations`` prints them as a table."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

RECORD = "AORO_DEVIATIONS"
"""Environment variable with the file that deviations are appended to."""


def within(off, tolerance, *, law, oracle, source):
    """Assert that ``off`` is nowhere beyond ``tolerance``, and record how near it came.

    Args:
        off: Deviations of a law from its oracle, any shape.
        tolerance: What rounding and the step leave, of a shape that goes with it.
        law: The law and its option.
        oracle: What it is held against.
        source: Where the tolerance comes from.
    """
    size, tolerance = np.broadcast_arrays(np.abs(off), tolerance)
    share = np.max(size / np.where(tolerance > 0.0, tolerance, np.inf))
    worst = np.unravel_index(np.argmax(size / np.maximum(tolerance, 1e-300)), size.shape)
    if RECORD in os.environ:
        row = {"law": law, "oracle": oracle, "off": float(size[worst]), "tolerance": float(tolerance[worst])}
        with Path(os.environ[RECORD]).open("a") as file:
            file.write(json.dumps(row | {"share": float(share), "source": source}) + "\n")
    assert np.all(size <= tolerance), (law, size[worst], tolerance[worst])


def table(rows):
    """Markdown: the case of each law and oracle that came nearest to its tolerance."""
    worst = {}
    for row in rows:
        key = row["law"], row["oracle"]
        worst[key] = max(worst.get(key, row), row, key=lambda one: one["share"])
    lines = ["| law | oracle | largest deviation | tolerance | from |", "|---|---|---|---|---|"]
    for row in sorted(worst.values(), key=lambda one: (one["law"], one["oracle"])):
        lines.append(
            f"| {row['law']} | {row['oracle']} | {row['off']:.2g} | {row['tolerance']:.2g} | {row['source']} |"
        )
    return "\n".join(lines)


def main():
    record = Path(sys.argv[1] if len(sys.argv) > 1 else "deviations.jsonl")
    record.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(Path(__file__).parent)]
    status = subprocess.run(command, env=os.environ | {RECORD: str(record)}, stdout=sys.stderr).returncode
    print(table([json.loads(line) for line in record.read_text().splitlines()]))
    record.unlink()
    sys.exit(status)


if __name__ == "__main__":
    main()
