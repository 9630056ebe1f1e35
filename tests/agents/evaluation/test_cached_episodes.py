"""Episodes that were driven before an evaluation was interrupted are not driven again."""

import json
import re
import subprocess
import sys
import threading
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.agents.evaluation import batches, inputs, leaderboard
from aoro_gym.agents.evaluation.cached_episodes import FOLDER, EpisodeCache, resumable
from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.perturbations import perturbed
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.cli import app
from aoro_gym.envs import Course
from aoro_gym.execution import provenance
from aoro_gym.execution.files import write_json
from aoro_gym.machine import Machine
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Plane, Terrain
from tests.agents.episodes import SHORT

pytestmark = pytest.mark.usefixtures("short_episodes")

TURNING = "AORO/Turning-v0"
NAMES = ("proportional-derivative", "turning-ppo")
"""A controller, and a policy of numbers."""
MACHINE = Machine.load("aoro")


def policies():
    """Made anew, as another process would."""
    return {name: policy_factory(TURNING, name) for name in NAMES}


def assert_same(found, expected):
    for field in fields(Episodes):
        mine, theirs = getattr(found, field.name), getattr(expected, field.name)
        if field.name == "metrics":
            assert mine.keys() == theirs.keys()
            for name, values in mine.items():
                np.testing.assert_array_equal(values, theirs[name])
        elif field.name == "endings":
            assert mine == theirs
        else:
            np.testing.assert_array_equal(mine, theirs)
            assert mine.dtype == theirs.dtype


@pytest.fixture
def drives(monkeypatch):
    """Sizes of what is driven, which a test may limit."""
    driven: list[int] = []
    plain = TASKS[TURNING].drive

    def counted(env, policy, seeds, tell=lambda share: None):
        if len(driven) == limit[0]:
            raise KeyboardInterrupt
        driven.append(len(seeds))
        return plain(env, policy, seeds, tell)

    limit = [10_000]
    monkeypatch.setitem(TASKS, TURNING, replace(TASKS[TURNING], drive=counted))
    return driven, limit


def test_an_interrupted_evaluation_goes_on_where_it_was(tmp_path, monkeypatch, drives):
    """Three parts of two policies on drawn machines, interrupted after the third of six."""
    driven, limit = drives
    monkeypatch.setattr(batches, "AT_ONCE", 2)
    whole = evaluate(TURNING, policies(), episodes=6, seed=3, drawn=perturbed)
    assert driven == [2] * 6
    driven.clear()
    limit[0] = 3
    with pytest.raises(KeyboardInterrupt):
        evaluate(TURNING, policies(), episodes=6, seed=3, drawn=perturbed, kept=tmp_path)
    assert len(list(tmp_path.iterdir())) == 3
    driven.clear()
    limit[0] = 10_000
    again = evaluate(TURNING, policies(), episodes=6, seed=3, drawn=perturbed, kept=tmp_path)
    assert driven == [2] * 3
    for name in NAMES:
        assert_same(again.runs[name], whole.runs[name])


def test_what_would_be_driven_otherwise_is_driven(tmp_path, drives):
    """Other seeds, machines, rewards or policies are none of those that were kept."""
    driven, _ = drives

    def drive(policy: str = NAMES[0], seed: int = 3, **changes: Any) -> int:
        evaluate(TURNING, {NAMES[0]: policies()[policy]}, episodes=2, seed=seed, kept=tmp_path, **changes)
        return len(driven)

    assert (drive(), drive()) == (1, 1)
    assert drive(seed=4) == 2
    assert drive(machine=MACHINE.scale({"steering.pump.margin": 0.9})) == 3
    assert drive(reward_terms={"overshoot": -20.0}) == 4
    assert drive(policy=NAMES[1]) == 5
    assert drive() == 5


def test_a_broken_file_is_driven_again(tmp_path, drives):
    driven, _ = drives
    pd = {NAMES[0]: policies()[NAMES[0]]}
    first = evaluate(TURNING, pd, episodes=2, kept=tmp_path)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:100])
    again = evaluate(TURNING, pd, episodes=2, kept=tmp_path)
    assert len(driven) == 2
    assert_same(again.runs[NAMES[0]], first.runs[NAMES[0]])


def test_what_cannot_be_told_apart_is_not_kept(tmp_path):
    """A policy that holds a lock, say."""
    inner, lock = policies()[NAMES[0]], threading.Lock()

    def locking(env):
        with lock:
            return inner(env)

    evaluate(TURNING, {"mine": locking}, episodes=1, kept=tmp_path)
    assert not list(tmp_path.iterdir())
    assert EpisodeCache(None).file(inner, [1], MACHINE) is None
    assert EpisodeCache(None).read(None) is None


class Turner:
    """A policy of one's own, with a memory."""

    def __init__(self, gain: float):
        self.gain, self.steps = gain, 0

    def __call__(self, observations):
        self.steps += 1
        return np.clip(self.gain * observations[:, 3:4], -1.0, 1.0)

    def reset(self, mask=None):
        pass


@pytest.mark.slow
def test_own_policies_and_rewards_count_by_source_and_state(tmp_path, drives):
    driven, _ = drives

    def drive(policy, **changes) -> int:
        evaluate(TURNING, {"mine": policy}, episodes=1, kept=tmp_path, **changes)
        return len(driven)

    def made(gain: float):
        return lambda env: Turner(gain)

    assert (drive(made(1.0)), drive(made(1.0)), drive(made(2.0))) == (1, 1, 2)
    shared = Turner(1.0)
    assert (drive(lambda env: shared), shared.steps) == (3, SHORT)
    assert drive(lambda env: Turner(1.0)) == 4
    rewards = [lambda view: 0.0 * view.error, lambda view: 1.0 * view.error]
    assert [drive(made(1.0), reward_terms={"mine": (1.0, term)}) for term in (*rewards, rewards[0])] == [5, 6, 6]


def test_a_policy_that_changes_while_it_drives_is_kept_as_it_was_before(tmp_path, drives):
    """Its state at the end is another one's at the beginning."""
    driven, _ = drives
    shared = Turner(1.0)
    for _ in range(2):
        evaluate(TURNING, {"mine": lambda env: shared}, episodes=1, kept=tmp_path)
    assert len(driven) == 2


def test_units_count_and_names_do_not(tmp_path, drives):
    driven, _ = drives
    pd = {NAMES[0]: policies()[NAMES[0]]}
    for name, value, unit in (("a", 80.0, "mm"), ("b", 80.0, "mm"), ("c", 0.08, "m"), ("d", 100.0, "mm")):
        low, high = (40.0, 160.0) if unit == "mm" else (0.04, 0.16)
        bore = f'[steering.cylinder.bore]\nvalue = {value}\nunit = "{unit}"\nrange = [{low}, {high}]\n'
        (tmp_path / f"{name}.toml").write_text(f'base = "aoro"\n{bore}')
    count = []
    for name in "abcd":
        evaluate(TURNING, pd, episodes=1, machine=str(tmp_path / f"{name}.toml"), kept=tmp_path / "kept")
        count.append(len(driven))
    assert count == [1, 1, 1, 2]


def test_grounds_and_paths_count_by_their_contents(tmp_path, monkeypatch):
    """Of a terrain every array, its coordinate system and its origin; of a course not its name."""
    heights = np.zeros((30, 30))
    line = np.array([[2.0, 5.0], [8.0, 5.0]])

    def key(terrain=None, path=None, name="a") -> str | None:
        course = Course(terrain or ground(), (path or Line(line),), name=name)
        kept = EpisodeCache(tmp_path, inputs.grounds([course]), inputs.paths([course]))
        file = kept.file(Turner(1.0), [1], MACHINE)
        return None if file is None else file.name

    def ground(**changes) -> Terrain:
        return Terrain.from_heights(**{"heights": heights, "cell": 0.5, "crs": "EPSG:32633", **changes})

    raised = heights.copy()
    raised[3, 3] = 0.01
    variants = [
        ground(), ground(heights=raised), ground(friction=0.9), ground(rolling_resistance=2.0), ground(crs=None),
        ground(origin=(1.0, 0.0, 0.0)), ground(cell=0.51), Plane(), Plane(slope_deg=1.0),
    ]  # fmt: skip
    found = {key(terrain=one) for one in variants}
    assert None not in found and len(found) == len(variants)
    assert key(name="b", terrain=ground(name="other")) == key()
    ways = [
        Line(line),
        Line(line + 0.1),
        Line(line, speed=np.array([1.0, 1.0])),
        Line(line, speed=np.array([1.0, 2.0])),
    ]
    found = {key(path=one) for one in ways}
    assert None not in found and len(found) == len(ways)
    assert key(path=Line(line, name="other")) == key()


@pytest.mark.slow
def test_another_process_finds_what_was_kept(tmp_path):
    """Digests do not hang on the process."""
    program = (
        "from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory\n"
        "from pathlib import Path\n"
        f"policies = {{name: policy_factory({TURNING!r}, name) for name in {NAMES!r}}}\n"
        f"evaluate({TURNING!r}, policies, episodes=1, kept=Path({str(tmp_path)!r}))\n"
    )
    files = []
    for _ in range(2):
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
        files.append(sorted(path.name for path in tmp_path.iterdir()))
    assert len(files[0]) == 2
    assert files[1] == files[0]


def test_the_leaderboard_keeps_all_perturbations_and_clears_up(tmp_path, drives):
    driven, _ = drives
    pd = {NAMES[0]: policies()[NAMES[0]]}
    with pytest.raises(KeyboardInterrupt), resumable(tmp_path, {}) as kept:
        leaderboard.compare(TURNING, pd, episodes=1, kept=kept)
        raise KeyboardInterrupt
    assert len(driven) == len(list((tmp_path / FOLDER).glob("*.npz"))) == 3
    with resumable(tmp_path, {}) as kept:
        leaderboard.compare(TURNING, pd, episodes=1, kept=kept)
    assert len(driven) == 3
    assert not (tmp_path / FOLDER).exists()


# ---- the commands ----------------------------------------------------------------------------------------------------


def interrupted(command: list[str], limit: list[int], after: int = 1) -> str:
    """What a command says that Ctrl-C ends after so many parts."""
    limit[0] = after
    shown = CliRunner().invoke(app, command, catch_exceptions=False)
    limit[0] = 10_000
    assert shown.exit_code == 130, shown.output
    return " ".join(shown.stderr.split())


def refused(command: list[str]) -> str:
    shown = CliRunner().invoke(app, command, catch_exceptions=False)
    assert shown.exit_code == 2, shown.output
    return " ".join(shown.stderr.split())


def command_of(tmp_path: Path, *others: str) -> list[str]:
    return [
        "evaluate", "--env", TURNING, *(f"--policy={name}" for name in NAMES), "--episodes", "2", "--no-films",
        "--out", str(tmp_path / "out"), *others,
    ]  # fmt: skip


def test_an_interrupted_command_says_how_to_go_on_and_does(tmp_path, drives, plain_report):
    driven, limit = drives
    command = command_of(tmp_path)
    assert "interrupted: the same command goes on from where it stopped" in interrupted(command, limit)
    assert CliRunner().invoke(app, command, catch_exceptions=False).exit_code == 0
    assert driven == [2, 2]
    assert not (tmp_path / "out" / FOLDER).exists()
    # what is done is done anew, whatever it is
    assert CliRunner().invoke(app, [*command, "--seed", "1"], catch_exceptions=False).exit_code == 0
    assert json.loads((tmp_path / "out" / "evaluation.json").read_text())["seed"] == 1


def test_a_changed_input_is_refused_by_its_name(tmp_path, drives, plain_report):
    driven, limit = drives
    MACHINE.save(tmp_path / "mine.toml")
    other = policy_factory(TURNING, NAMES[1]).__self__  # pyright: ignore[reportFunctionMemberAccess]
    other.save(tmp_path / "mine")
    mine = ["--machine", str(tmp_path / "mine.toml"), "--policy", str(tmp_path / "mine.json")]
    command = command_of(tmp_path, *mine)
    interrupted(command, limit)
    assert "episodes was 2, is 3; --restart begins anew" in refused([*command, "--episodes", "3"])
    assert "seed was 0, is 4" in refused([*command, "--seed", "4"])
    assert "machine oil.gas_fraction was " in refused([*command, "--set", "oil.gas_fraction=0.011"])
    assert "policy bang-bang was absent, is another" in refused([*command, "--policy", "bang-bang"])
    MACHINE.scale({"tire.friction_coulomb": 0.95}).save(tmp_path / "mine.toml")
    assert "machine tire.friction_coulomb was " in refused(command)
    MACHINE.save(tmp_path / "mine.toml")
    replace(other, biases=(*other.biases[:-1], other.biases[-1] + 0.01)).save(tmp_path / "mine")
    assert re.search(r"policy \S*mine has changed; --restart begins anew", refused(command))
    other.save(tmp_path / "mine")
    driven.clear()
    assert CliRunner().invoke(app, command, catch_exceptions=False).exit_code == 0
    assert driven == [2, 2]  # of three, one was kept


@pytest.fixture
def plain_report(monkeypatch):
    """Only the JSON of a report, without pictures."""

    def write(result, folder, *, made_by, **_):
        write_json(folder / "evaluation.json", result.to_json() | {"made_by": made_by})
        return []

    monkeypatch.setattr("aoro_gym.agents.evaluation.report.write_report", write)


def test_changed_code_is_named_and_may_be_accepted(tmp_path, drives, plain_report, monkeypatch):
    driven, limit = drives
    command = command_of(tmp_path)
    interrupted(command, limit)
    edited = {**provenance.sources(), "twin/kernels/advance.py": "0" * 16}
    monkeypatch.setattr(provenance, "sources", lambda: edited)
    assert "begun with other code: twin/kernels/advance.py has changed; --accept-code-change" in refused(command)
    driven.clear()
    shown = CliRunner().invoke(app, [*command, "--accept-code-change"], catch_exceptions=False)
    assert (shown.exit_code, driven) == (0, [2])
    made_by = json.loads((tmp_path / "out" / "evaluation.json").read_text())["made_by"]
    assert made_by["accepted_code_changes"][0]["changes"] == ["twin/kernels/advance.py has changed"]


def test_restarting_forgets_what_was_kept(tmp_path, drives, plain_report):
    driven, limit = drives
    interrupted(command_of(tmp_path), limit)
    command = command_of(tmp_path, "--seed", "7", "--restart")
    driven.clear()
    assert CliRunner().invoke(app, command, catch_exceptions=False).exit_code == 0
    assert driven == [2, 2]


@pytest.mark.parametrize(
    "command",
    [
        ["evaluate", "--env", TURNING, "--policy", "bang-bang", "--episodes", "1"],
        ["leaderboard", "--env", TURNING, "--policy", "bang-bang", "--episodes", "1"],
        ["gap", "--env", TURNING, "--policy", "bang-bang", "--effect", "payload=500", "--improved", "aoro"],
    ],
    ids=lambda command: command[0],
)
def test_a_second_process_is_told_who_writes_to_the_folder(tmp_path, command, drives):
    driven, _ = drives
    hold = (
        "import sys; from pathlib import Path; from aoro_gym.execution.locking import locked\n"
        "with locked(Path(sys.argv[1])): print(flush=True); sys.stdin.read()\n"
    )
    given = [sys.executable, "-c", hold, str(tmp_path)]
    with subprocess.Popen(given, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None and holder.stdout.readline()
        try:
            assert f"{tmp_path} is in use by process {holder.pid} on " in refused([*command, "--out", str(tmp_path)])
        finally:
            holder.kill()
    assert not driven
