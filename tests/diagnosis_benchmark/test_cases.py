"""Cases of the blind check: what is drawn, what a user gets of it, and that its answers stay sealed."""

import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis.recording import SENSORS
from aoro_gym.diagnosis_benchmark import cases
from aoro_gym.diagnosis_benchmark.cases import (
    DAY,
    FAMILIES,
    INSIDE,
    KINDS,
    MACHINES,
    MODES,
    SUITES,
    Excitation,
    Suite,
    plan,
)
from aoro_gym.diagnosis_benchmark.plants.effects import EFFECTS, OUTSIDE
from aoro_gym.diagnosis_benchmark.plants.sensors import SensorNoise
from aoro_gym.diagnosis_benchmark.sealing import COLUMNS, exact_folder, open_seal, write_cases
from aoro_gym.machine import Machine
from aoro_gym.recording.tables import read_table

SCORE, DEVELOPMENT = FAMILIES["score"], FAMILIES["development"]
TINY = Suite("tiny", null=1, single=1, pair=1, outside=1, nuisance=1)
SEED = 70423987561
SEALED = SEED + 2
"""Of cases all of whose deviations a jerk shows."""


def jerk(rng):
    """A manoeuvre of an eighth of a second."""
    signal = np.zeros(12)
    signal[3:9] = rng.uniform(0.6, 1.0)
    return (Excitation("jerk", 0.0, signal), Excitation("rolling_jerk", 0.1, signal, 0.3 * signal))


SHORT = replace(SCORE, levels=(0, 1), excitations=jerk)


def seal(folder: Path, **options):
    asked = {"mode": "commissioned", "sensors": "full", "family": SHORT, "seed": SEALED, "batch": 3, **options}
    return write_cases(TINY, folder / "check", folder / "answers.json", **asked)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file under ``folder`` by its place in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def standard():
    return {mode: plan(SUITES["standard"], mode=mode, family=SCORE, seed=SEED) for mode in MODES}


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sealed")
    return folder, seal(folder)


def test_a_quick_case_has_one_log_a_day():
    """What two cores can diagnose in minutes."""
    for case in plan(SUITES["quick"], mode="commissioned", family=SCORE, seed=SEED):
        assert [excitation.name for excitation in case.excitations] == ["steps"]
        assert case.seeds.shape == (2, 1)


def test_suites_have_the_cases_that_they_say(standard):
    sizes = {name: [getattr(suite, kind) for kind in KINDS] for name, suite in SUITES.items()}
    assert sizes["standard"] == [60, 90, 45, 30, 15]
    assert {name: sum(size) for name, size in sizes.items()} == {"quick": 12, "standard": 240, "full": 800}
    for mode, drawn in standard.items():
        assert [case.name for case in drawn] == [f"{number:03d}" for number in range(1, 241)]
        assert Counter(case.kind for case in drawn) == dict(zip(KINDS, sizes["standard"], strict=True))
        for case in drawn:
            assert len(case.hidden) == {"single": 1, "pair": 2, "outside": 1}.get(case.kind, 0)
            assert all(one.id in (OUTSIDE if case.kind == "outside" else INSIDE) for one in case.hidden)
            assert (case.healthy is None) == (mode == "day-one")
            if mode == "day-one" and case.kind in ("null", "nuisance"):
                assert case.level == 0, "other laws are a gap"
        single = [case for case in drawn if case.kind == "single"]
        assert set(Counter(case.hidden[0].id for case in single).values()) == {2, 3}  # 90 over 33
        assert Counter(case.level for case in single) == {0: 30, 1: 30, 2: 30}
        assert len({one.id for case in drawn for one in case.hidden if case.kind == "pair"}) > 25


def test_severities_span_the_ranges(standard):
    seen = []
    for case in (case for drawn in standard.values() for case in drawn):
        for one in case.hidden:
            effect = EFFECTS[one.id]
            size, own = np.array(one.magnitude), np.array(one.without)
            share = np.array([np.hypot(*size)]) if effect.parts else size / own if effect.relative else size
            slack = 1e-9 * (effect.high - effect.low)
            assert effect.low - slack <= share.item() <= effect.high + slack, one
            if effect.low < 0.0 < effect.high:
                assert abs(share.item()) > 0.05 * min(-effect.low, effect.high), one
            seen.append(one.severity)
    assert min(seen) >= 0.0 and max(seen) <= 1.0
    assert np.quantile(seen, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.08)  # of 420: 3 standard errors


def test_a_day_moves_what_it_may(standard):
    for case in standard["commissioned"]:
        assert case.healthy is not None
        beyond = 0
        for key, entry in case.healthy.entries.items():
            changed = abs(float(case.later.entries[key].value - entry.value))
            width = entry.range[1] - entry.range[0]
            if entry.role == "both":
                assert changed <= float(entry.commissioned[1] - entry.value) * (1 + 1e-9) + 1e-15, key
            elif entry.role == "nuisance":
                beyond += changed > DAY * width * (1 + 1e-9)
                assert changed <= cases.MOVED * width * (1 + 1e-9), key
            else:
                assert changed == 0.0, key
        assert (beyond > 20) if case.kind == "nuisance" else (beyond == 0), case.name


def test_plants_of_other_laws_are_other_machines(standard):
    for case in standard["commissioned"]:
        assert bool(case.baseline) == (case.level > 0)
        for key, value in case.baseline.items():
            assert case.healthy is not None and case.healthy.entries[key].value == value
            low, high = case.healthy.entries[key].range
            assert max(low, 1e-9) <= value <= high, key


@pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)
def test_logs_begin_and_end_at_rest(family):
    for seed in range(20):
        excitations = family.excitations(np.random.default_rng(seed))
        assert len({excitation.name for excitation in excitations}) == len(excitations) >= 9
        for excitation in excitations:
            for signal in (excitation.steering, np.zeros(1) if excitation.drive is None else excitation.drive):
                assert np.all(np.abs(signal) <= 1.0)
                assert np.all(signal[:60] == 0.0) and np.all(signal[-50:] == 0.0), excitation.name
            assert abs(excitation.start) <= 1.0 and np.any(excitation.steering)


@pytest.mark.slow
def test_families_share_nothing(standard):
    ours = standard["commissioned"]
    theirs = plan(SUITES["standard"], mode="commissioned", family=DEVELOPMENT, seed=SEED)
    assert not {case.twin for case in ours} & {case.twin for case in theirs}
    assert not {seed for case in ours for seed in case.seeds.flat} & {
        seed for case in theirs for seed in case.seeds.flat
    }
    assert {case.level for case in ours} - {case.level for case in theirs} == {2}, "laws that only score"
    assert {case.level for case in theirs} - {case.level for case in ours} == {3}
    assert {one.id for case in theirs for one in case.hidden} < {one.id for case in ours for one in case.hidden}
    assert [case.kind for case in ours] != [case.kind for case in theirs]
    peaks = [
        [np.abs(t.steering).max() for case in drawn for t in case.excitations if t.name == "ramp"]
        for drawn in (ours, theirs)
    ]
    assert np.mean(peaks[0]) > np.mean(peaks[1]) + 0.1


def test_a_case_holds_what_a_user_has(sealed):
    folder, answers = sealed
    members = [Machine.load(path).identity for path in (MACHINES / "ensemble").iterdir()]
    for name, answer in answers["cases"].items():
        place = folder / "check" / "cases" / name
        assert "base =" not in (place / "machine.toml").read_text()  # whole: it stands alone
        assert Machine.load(place / "machine.toml").identity in members
        for day in ("healthy", "logs"):
            assert (
                {path.stem for path in (place / day).glob("*.csv")} == set(answer["logs"]) == {"jerk", "rolling_jerk"}
            )
            for log in (place / day).glob("*.csv"):
                table = read_table(log)
                columns = [
                    "time_s",
                    "steering_signal",
                    "steering_signal_V",
                    *(column for column, _ in COLUMNS.values()),
                ]
                if log.stem == "rolling_jerk":
                    columns.insert(3, "drive_signal")
                assert list(table.names) == columns
                assert np.diff(table["time_s"]) == pytest.approx(0.01)
                assert log.with_suffix(".toml").is_file()
        healthy, later = ((place / day / "jerk.csv").read_bytes() for day in ("healthy", "logs"))
        assert healthy != later


def test_answers_are_not_in_the_folder(sealed):
    folder, answers = sealed
    words = "|".join([*EFFECTS, *KINDS, "level", str(answers["seed"]), answers["salt"]])
    for name, content in contents(folder / "check").items():
        if name == "provenance.json":  # names all sources of the package, whatever the answers
            content = json.dumps(json.loads(content)["inputs"]).encode()
        if not name.endswith("machine.toml") and name != "seal.json":  # a bundled file; its own test is above
            assert not re.search(rf"\b({words})\b", content.decode()), name
    for name in ("logs", "healthy"):
        manifests = {path.name: path.read_text() for path in (folder / "check").rglob(f"{name}/*.toml")}
        for path in (folder / "check").rglob(f"{name}/*.toml"):
            assert path.read_text() == manifests[path.name], "a manifest tells one case from another"


def test_oracles_get_what_they_need(sealed):
    folder, answers = sealed
    noise = SensorNoise()
    most = sum(size for *_, size in (*noise.angle_orders, *noise.angle_lines))
    most += 5.0 * noise.angle_white + np.pi / 2**noise.angle_bits  # of 39 samples: beyond five sigma once in 4e4 draws
    told = {path.stem for path in exact_folder(folder / "answers.json").iterdir()}
    answer_of = {name: answer["effects"] for name, answer in answers["cases"].items()}
    assert told == {name for name, effects in answer_of.items() if effects}
    for name in told:
        arrays = np.load(exact_folder(folder / "answers.json") / f"{name}.npz")
        table = read_table(folder / "check" / "cases" / name / "logs" / "jerk.csv")
        alone = [f"without {effect}" for effect in answer_of[name]] if len(answer_of[name]) > 1 else []
        assert {key.rpartition("/")[2] for key in arrays.files} == {"with", "without", *alone}
        assert len(arrays.files) == 2 * (2 + len(alone)) * len(SENSORS["full"])
        with_, without = (arrays[f"jerk/joint_angle/{which}"] for which in ("with", "without"))
        assert with_.shape == without.shape == table["joint_angle_rad"].shape
        assert np.abs(with_ - table["joint_angle_rad"]).max() < most
        assert any(
            np.any(arrays[f"{log}/with"] != arrays[f"{log}/without"]) for log in {f[: f.rindex("/")] for f in arrays}
        )


@pytest.mark.slow
def test_an_interrupted_suite_goes_on_to_the_same_files(sealed, tmp_path):
    def interrupt(sentence, share):
        if share > 0.8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seal(tmp_path, progress=interrupt)
    finished = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "check" / "cases").iterdir()}
    assert 0 < len(finished) < 5
    torn = next(name for name in ("001", "002", "003", "004", "005") if name not in finished)
    (tmp_path / "check" / "cases" / f".{torn}.partial").mkdir(exist_ok=True)  # it may have been interrupted writing
    (tmp_path / "check" / "cases" / f".{torn}.partial" / "half_a_log.csv").write_text("time_s,")
    file = tmp_path / "answers.json"
    drawn = file.read_text()
    file.write_text(drawn.replace('"single"', '"null"'))
    with pytest.raises(ValueError, match="do not follow from their seed"):
        seal(tmp_path)
    file.write_text(drawn)
    answers = seal(tmp_path, seed=None)
    for name, time in finished.items():
        assert (tmp_path / "check" / "cases" / name).stat().st_mtime_ns == time, "a finished case was made again"
    folder, expected = sealed
    assert contents(tmp_path / "check" / "cases") == contents(folder / "check" / "cases")
    assert contents(exact_folder(tmp_path / "answers.json")) == contents(exact_folder(folder / "answers.json"))
    assert {**answers, "salt": ""} == {**expected, "salt": ""}
    assert answers["salt"] != expected["salt"]


@pytest.mark.slow
def test_more_workers_write_the_same_files(sealed, tmp_path):
    folder, expected = sealed
    told = []
    answers = seal(tmp_path, workers=2, progress=lambda sentence, share: told.append(share))
    assert contents(tmp_path / "check" / "cases") == contents(folder / "check" / "cases")
    assert contents(exact_folder(tmp_path / "answers.json")) == contents(exact_folder(folder / "answers.json"))
    assert {**answers, "salt": ""} == {**expected, "salt": ""}
    assert told == sorted(told) and told[-1] == 1.0


@pytest.mark.parametrize("what", ["answers", "exact logs", "cases"])
def test_the_seal_shows_what_was_changed(sealed, what):
    folder, answers = sealed
    check, file = folder / "check", folder / "answers.json"
    assert open_seal(check, file) == answers
    path = {
        "answers": file,
        "exact logs": next(exact_folder(file).iterdir()),
        "cases": check / "cases" / "001" / "logs" / "jerk.csv",
    }[what]
    before = path.read_bytes()
    middle = len(before) // 2
    path.write_bytes(before[:middle] + bytes([before[middle] ^ 1]) + before[middle + 1 :])
    try:
        with pytest.raises(ValueError, match=f"the {what} have the digest"):
            open_seal(check, file)
        if what != "answers":
            with pytest.raises(ValueError, match="was sealed"):
                seal(folder)  # nor is anything sealed anew
    finally:
        path.write_bytes(before)
    assert open_seal(check, file) == answers


@pytest.mark.parametrize("text", ["{broken", "[]", b"\xff\xfe"], ids=["cut", "list", "bytes"])
def test_broken_answers_are_named_and_kept(tmp_path, text):
    answers = tmp_path / "answers.json"
    answers.write_bytes(text if isinstance(text, bytes) else text.encode())
    before = answers.read_bytes()
    with pytest.raises(ValueError, match=r"answers\.json (is not JSON|holds no JSON object).*restore it"):
        write_cases(TINY, tmp_path / "suite", answers, mode="commissioned", sensors="full", family=SHORT, seed=1)
    assert answers.read_bytes() == before
    assert not (tmp_path / "suite").exists()


def test_what_belongs_to_another_suite_is_refused(sealed, tmp_path):
    folder, _ = sealed
    with pytest.raises(ValueError, match=r"are of sensors full, not angle; name another file"):
        seal(folder, sensors="angle")
    with pytest.raises(ValueError, match=rf"are of seed {SEALED}, not 8"):
        seal(folder, seed=8)
    with pytest.raises(ValueError, match=r"lie within .*keep them outside"):
        write_cases(TINY, tmp_path, tmp_path / "a.json", mode="day-one", sensors="angle", family=SHORT, seed=1)
    with pytest.raises(ValueError, match=r"holds cases, but their answers are not in"):
        write_cases(
            TINY, folder / "check", tmp_path / "a.json", mode="commissioned", sensors="full", family=SHORT, seed=1
        )
    with pytest.raises(ValueError, match=r"mode is 'tomorrow'"):
        seal(tmp_path, mode="tomorrow")
    with pytest.raises(ValueError, match=r"sensors is 'nose'"):
        seal(tmp_path, sensors="nose")


def test_the_command_seals(tmp_path, monkeypatch):
    monkeypatch.setitem(dict_of(SUITES), "quick", Suite("quick", null=0, single=1, pair=0, outside=0, nuisance=0))
    monkeypatch.setitem(dict_of(FAMILIES), "score", SHORT)
    runner, check = CliRunner(), tmp_path / "check"
    asked = ["blind", "seal", "--mode", "day-one", "--sensors", "angle", str(check)]
    done = runner.invoke(app, asked, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    published = json.loads((check / "seal.json").read_text())
    answers = json.loads((tmp_path / "check.answers.json").read_text())
    assert published["blind"] and "seed" not in published
    assert answers["seed"] > 2**64  # chance of the operating system: smaller once in 2^64
    assert len(answers["salt"]) == 64
    assert open_seal(check, tmp_path / "check.answers.json") == answers
    assert not list(check.rglob("healthy"))
    table = read_table(check / "cases" / "001" / "logs" / "jerk.csv")
    assert list(table.names) == ["time_s", "steering_signal", "steering_signal_V", "joint_angle_rad"]
    assert Machine.load(check / "cases" / "001" / "machine.toml").identity == Machine.load("aoro").identity

    wrong = runner.invoke(app, ["blind", "seal", "--suite", "huge", str(check)])
    assert wrong.exit_code == 2 and "quick, standard, full" in wrong.output
    wrong = runner.invoke(app, ["blind", "seal", "--workers", "0", str(tmp_path / "other")])
    assert wrong.exit_code == 2 and "--workers is 0, but must be a positive integer" in wrong.output
    assert "Examples" in runner.invoke(app, ["blind", "seal", "--help"]).output


def dict_of(mapping) -> dict:
    """The mapping, which is a dict, as one that may be changed for a test."""
    assert isinstance(mapping, dict)
    return mapping
