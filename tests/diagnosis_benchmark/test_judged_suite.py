"""The judged suite as files: both variants, their seals, and what is withheld."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.judge.features import CHANNEL_SETS, CHANNELS
from aoro_gym.diagnosis_benchmark.judge.library import Extent, build
from aoro_gym.diagnosis_benchmark.judge.observed import observe
from aoro_gym.diagnosis_benchmark.judge.suite import Suite
from aoro_gym.diagnosis_benchmark.judged_suite import STOCK, VARIANTS, draw, write_machines, write_suite
from aoro_gym.diagnosis_benchmark.running import sealed_cases
from aoro_gym.diagnosis_benchmark.sealing import COLUMNS, open_seal
from aoro_gym.machine import Machine
from aoro_gym.recording.tables import read_table
from tests.diagnosis_benchmark.judge.families import Made

SUITE = Suite("by hand", 2, 2, 1, 1, 2, 1, 2, 1, ("left_50", "steps_1"))
FAMILIES = (Made("law_0.05", 0.05),)
KEY = "steering.pump.margin"


def margin(machine: int) -> float:
    """What calibration finds of a machine [bar]."""
    return 20.0 + machine


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folder and answers of a sealed suite of six cases."""
    folder, answers = (tmp_path_factory.mktemp("suite") / name for name in ("suite", "answers.json"))
    made = draw(SUITE, FAMILIES, answers)
    excitations = list(made.excitations.values())
    laws = [Made(f"law_{law}", law) for law in (-0.1, -0.05, 0.0, 0.1)]
    books = [build(one, excitations, Extent(12, 4, 2, (0.0, 0.5, 1.0)), seed=1) for one in (*laws, *FAMILIES)]

    def calibrate(logs: Sequence[Path], out: Path) -> None:
        assert [path.stem for path in logs] == ["left_50"]
        Machine.load(STOCK).set({KEY: margin(int(out.parent.name[-1]))}, check_ranges=False).save(out)

    write_machines(folder, made, FAMILIES, calibrate)
    seen = {name: one for plants in FAMILIES for name, one in observe(made, plants).items()}
    write_suite(folder, answers, made, FAMILIES, seen, books)
    return folder, answers


def test_both_variants_are_suites_with_the_same_answers(written: tuple[Path, Path]) -> None:
    folder, answers = written
    for variant in VARIANTS:
        assert sealed_cases(folder / variant) == [f"{n:04d}" for n in range(1, 7)]
        found = open_seal(folder / variant, answers)
        assert set(found["cases"]) == set(sealed_cases(folder / variant))


def test_variants_differ_in_the_machine_file_alone(written: tuple[Path, Path]) -> None:
    folder, answers = written
    truth = open_seal(folder / "stock", answers)["cases"]
    files = sorted(p.relative_to(folder / "stock/cases") for p in (folder / "stock/cases").rglob("*") if p.is_file())
    for file in files:
        one, two = (folder / variant / "cases" / file for variant in VARIANTS)
        if file.name != "machine.toml":
            assert one.read_bytes() == two.read_bytes()
            continue
        case = truth[file.parent.name]
        assert Machine.load(one).entries[KEY].value == Machine.load(STOCK).entries[KEY].value
        assert Machine.load(two).entries[KEY].value == pytest.approx(margin(case["machine"]))


def test_a_case_holds_what_a_user_would_have(written: tuple[Path, Path]) -> None:
    folder, answers = written
    (name, truth), *_ = open_seal(folder / "stock", answers)["cases"].items()
    place = folder / "stock/cases" / name
    for purpose in ("healthy", "logs"):
        assert sorted(p.stem for p in (place / purpose).glob("*.csv")) == sorted(truth["logs"])
        columns = read_table(place / purpose / f"{truth['logs'][0]}.csv")
        assert {COLUMNS[channel][0] for channel in CHANNELS} <= set(columns.names)
        assert np.diff(columns["time_s"]) == pytest.approx(0.01)
        assert (place / purpose / f"{truth['logs'][0]}.toml").exists()


def test_answers_hold_magnitudes_and_verdicts(written: tuple[Path, Path]) -> None:
    folder, answers = written
    sealed = open_seal(folder / "stock", answers)
    assert draw(SUITE, FAMILIES, answers).digest == sealed["plan"]
    for case in sealed["cases"].values():
        assert set(case["verdicts"]) == set(CHANNEL_SETS)
        for effect, size in case["effects"].items():
            assert size["magnitude"]
            assert case["kind"] == "pair" or effect in case["verdicts"]["pressures"]["class"]


def test_what_was_changed_since_is_refused(written: tuple[Path, Path]) -> None:
    folder, answers = written
    path = folder / "calibrated/cases/0001/machine.toml"
    before = path.read_bytes()
    path.write_bytes(before + b"\n")
    with pytest.raises(ValueError, match="was sealed"):
        open_seal(folder / "calibrated", answers)
    path.write_bytes(before)
    with pytest.raises(ValueError, match="sealed already"):
        write_suite(folder, answers, draw(SUITE, FAMILIES, answers), FAMILIES, {}, [])


def test_answers_do_not_lie_where_a_diagnosis_reads(tmp_path: Path) -> None:
    made = draw(SUITE, FAMILIES, tmp_path / "answers.json")
    with pytest.raises(ValueError, match="keep them outside"):
        write_suite(tmp_path, tmp_path / "answers.json", made, FAMILIES, {}, [])
