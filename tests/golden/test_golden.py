"""Results of the quick scenarios lie where they lay when ``values.json`` was written, as near as rounding lets them.

    python -m tests.golden.test_golden

writes the values anew, after a change that is meant to change them. Bits are compared by :mod:`tests.golden.compare`;
stored ones would hold on one processor only, since processors differ in how they round.

Of every field its mean and its last element are stored, each with its tolerance: how far it moves when every law rounds
otherwise. That is measured, not set: the scenarios run again with machines whose parameters in NUDGED are off by two
units in the last place of a float32 to either side. Such an error acts alike at each of the steps, where rounding acts
at random and partly cancels; MARGIN covers that only some parameters are nudged. What does not move at all gets a few
units in the last place of a float32 of the value itself.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym import Machine
from tests.golden.compare import difference, fields, results
from tests.golden.scenarios import ERROR, SCENARIOS, run

VALUES = Path(__file__).with_name("values.json")
ROOT = Path(__file__).parents[2]
QUICK = [name for name, (group, _) in SCENARIOS.items() if group == "quick"]

ULP = 2.0**-23
"""Unit in the last place of a float32, relative."""
NUDGE = 2.0 * ULP
NUDGED = (
    "frame.front.inertia_zz",
    "joint.friction_torque",
    "oil.bulk_modulus",
    "steering.valve.nominal_flow_left",
    "steering.valve.nominal_flow_right",
    "steering.valve.spool_time_constant",
    "driveline.pump.displacement",
    "engine.inertia",
    "tire.stiffness",
    "tire.sigma0_lateral",
)
"""Parameters of every domain that no closure of the machine ties to others."""
MARGIN = 10.0
FLOOR = 16.0 * ULP
"""Relative tolerance of what a nudge does not move: a sum over a thousand float32 rounds so."""
MOST = 70
"""Fields of a scenario that are stored; of more, some at equal distances."""


def figures(folder: Path) -> dict[str, tuple[float, float]]:
    """Mean and last element of the numeric fields that a scenario wrote."""
    found: dict[str, tuple[float, float]] = {}
    for name, value in fields(folder).items():
        try:
            array = np.asarray(value).astype(float)
        except (TypeError, ValueError):
            continue
        if array.size and np.all(np.isfinite(array)):
            found[name] = float(array.mean()), float(array.flat[-1])
    names = sorted(found)
    return {name: found[name] for name in names[:: -(-len(names) // MOST)]}


def nudged_tree(place: Path, nudge: float) -> Path:
    """A copy of the package whose machines differ by ``nudge``, relative."""
    for part in ("aoro_gym", "envs", "terrains", "agents"):
        shutil.copytree(ROOT / part, place / part, symlinks=True)
    for name in ("aoro", "aoro_datasheet"):
        machine = Machine.load(name).scale(dict.fromkeys(NUDGED, 1.0 + nudge), check_ranges=False)
        machine.save(place / "aoro_gym" / "machines" / f"{name}.toml")
    return place


def measured(tree: Path, out: Path) -> dict[str, dict[str, tuple[float, float]]]:
    """Figures of every quick scenario, run on ``tree``."""
    results(str(tree), out, group="quick", only=None)
    return {name: figures(out / name) for name in QUICK}


def write() -> None:
    """Make ``values.json``."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        plain = measured(ROOT, place / "plain")
        nudged = []
        for side in (-1, 1):
            tree = nudged_tree(place / f"tree{side}", side * NUDGE)
            nudged.append(measured(tree, place / f"nudged{side}"))
    stored: dict[str, dict[str, Any]] = {}
    for name, found in plain.items():
        stored[name] = {}
        for field, values in found.items():
            moved = np.max([np.abs(np.subtract(other[name][field], values)) for other in nudged], axis=0)
            tolerances = np.maximum(MARGIN * moved, FLOOR * np.abs(values))
            stored[name][field] = [float(f"{v:.9g}") for v in values] + [float(f"{t:.2g}") for t in tolerances]
    lines = ",\n".join(
        f"{json.dumps(name)}: {{\n"
        + ",\n".join(f" {json.dumps(field)}: {json.dumps(entry)}" for field, entry in entries.items())
        + "\n}"
        for name, entries in stored.items()
    )
    VALUES.write_text(f"{{\n{lines}\n}}\n")


@pytest.fixture(scope="module")
def today(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the quick scenarios give today, in this process, which has imported most of what they need."""
    out = tmp_path_factory.mktemp("golden")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AORO_GYM_CACHE", "off")
        run(out, "quick")
    return out


@pytest.mark.parametrize("name", QUICK)
def test_stored_values(name: str, today: Path) -> None:
    failed = today / name / ERROR
    assert not failed.exists(), failed.read_text()
    stored, found = json.loads(VALUES.read_text())[name], figures(today / name)
    assert found.keys() == stored.keys()
    for field, (mean, last, *tolerances) in stored.items():
        off = np.abs(np.subtract(found[field], (mean, last)))
        assert np.all(off <= tolerances), f"{field}: {found[field]}, not {(mean, last)} ± {tuple(tolerances)}"


@pytest.mark.slow
def test_a_revision_runs_in_a_process_of_its_own_to_the_same_bits(today: Path, tmp_path: Path) -> None:
    for name in ("driving", "parameters"):
        results(str(ROOT), tmp_path, group="quick", only=name)
        assert difference(today / name, tmp_path / name) is None


def test_a_difference_of_one_bit_is_named(tmp_path: Path) -> None:
    for side, last in (("a", 2.0), ("b", np.nextafter(2.0, 3.0))):
        (tmp_path / side).mkdir()
        np.savez(tmp_path / side / "run.npz", same=np.array([np.nan, 1.0]), speed=np.array([1.0, last]))
    assert difference(tmp_path / "a", tmp_path / "a") is None
    found = difference(tmp_path / "a", tmp_path / "b")
    assert (
        found is not None
        and found.count == 1
        and found.first.startswith("run.npz:speed[1]: 2.0 and 2.0000000000000004")
    )
    (tmp_path / "b" / ERROR).write_text("ValueError: no\n")
    found = difference(tmp_path / "a", tmp_path / "b")
    assert found is not None and "ValueError: no" in found.first


if __name__ == "__main__":
    write()
