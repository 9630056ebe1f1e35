"""What a training goes on with: the same inputs and whole files alone; what is wrong is named."""

import io
import itertools
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.recipe import read_recipe
from aoro_gym.agents.training.run_folder import begin, continued, load_run
from aoro_gym.envs import Course
from aoro_gym.execution import provenance
from aoro_gym.execution.provenance import ChangedCode, ChangedInput, changed_inputs, check_provenance
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Terrain
from tests.agents.training.small import plan_of, weights

TRACKING = "AORO/PathTracking-v0"


def course(height: float = 0.0, shift: float = 0.0, **changes) -> Course:
    """Level ground with a path over it."""
    ground = Terrain.from_heights(np.full((20, 60), height), cell=0.5, crs="EPSG:32633", **changes)
    return Course(ground, (Line(np.array([[3.0, 5.0 + shift], [12.0, 5.0]]), name="ahead"),))


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Path:
    """A training of one part, with files of its own for everything: policy to start from, hyper-parameters, curriculum."""
    for module in ("stable_baselines3", "tensorboard", "yaml"):
        pytest.importorskip(module)
    from aoro_gym.agents.policies.policy import LearnedPolicy
    from aoro_gym.agents.training import train as training

    folder = tmp_path_factory.mktemp("begun")
    rng = np.random.default_rng(0)
    sizes = [33, 8, 2]
    LearnedPolicy(
        weights=tuple(rng.normal(size=(b, a)).astype(np.float32) for a, b in itertools.pairwise(sizes)),
        biases=tuple(np.zeros(size, np.float32) for size in sizes[1:]),
        activation="tanh",
        squashed=False,
        low=-np.ones(2, np.float32),
        high=np.ones(2, np.float32),
    ).save(folder / "first")
    (folder / "mine.yml").write_text(
        f"{TRACKING}: {{n_timesteps: 100, n_envs: 2, policy: MlpPolicy, normalize: false, n_steps: 25, batch_size: 50,"
        " n_epochs: 1, policy_kwargs: {net_arch: [8]}}\n"
    )
    (folder / "stages.yml").write_text(f"{TRACKING}:\n  - from: 0.0\n    randomisation: fixed\n")
    plan = started_in(folder)
    training.train(plan, begin(plan, folder / "run"), folder / "run", **given())
    return folder


def started_in(folder: Path, **changes) -> TrainingPlan:
    values = {"env": TRACKING, "checkpoint_every": 50, "eval_episodes": 1, "seed": 5, **changes}
    files = {"start": "first.json", "hyperparams": "mine.yml", "curriculum": "stages.yml"}
    return TrainingPlan(**{name: str(folder / file) for name, file in files.items()}, **values)


def given(**changes) -> dict[str, Any]:
    return {"machine": Machine.load("aoro"), "courses": [course()], "held_out": [course(shift=1.0)], **changes}


def test_what_has_not_changed_goes_on(begun, training):
    files = [begun / "run" / name for name in ("policy.safetensors", "best.safetensors")]
    before = [file.read_bytes() for file in files]
    for file in files:
        file.write_bytes(b"damaged")
    (begun / "run" / "evaluations.json").write_text("half of i")
    plan = started_in(begun)
    found = training.train(plan, continued(plan, begun / "run"), begun / "run", **given())
    assert [file.read_bytes() for file in files] == before
    assert json.loads((begun / "run" / "evaluations.json").read_text())["evaluations"] == found


def test_an_evaluation_is_compared_with_what_it_followed_from_alone(tmp_path, training):
    """As ``curves`` asks: other inputs of the training, such as what machines are drawn within, do not count."""
    plan, machine = plan_of(perturbation="perturbed"), Machine.load("aoro")
    record = tmp_path / "provenance.json"
    check_provenance(record, training.inputs_of(plan, read_recipe(plan), machine=machine))
    assert changed_inputs(record, training.evaluation_inputs(plan, machine, None)) == []
    heavier = machine.scale({"frame.front.mass": 1.01})
    (said,) = changed_inputs(record, training.evaluation_inputs(plan, heavier, None))
    assert said.startswith("machine frame.front.mass was")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"seed": 6}, "seed was 5, is 6"),
        ({"steps": 200}, "steps was 100, is 200"),
        ({"checkpoint_every": 25}, "checkpoint_every was 50, is 25"),
        ({"eval_episodes": 2}, "eval_episodes was 1, is 2"),
        ({"param": ["n_epochs=3"]}, "hyperparams n_epochs was 1, is 3"),
        ({"perturbation": "perturbed"}, "ranges .* and .* more"),
    ],
)
def test_another_plan_is_refused(begun, training, changes, says):
    plan = started_in(begun, **changes)
    with pytest.raises(ChangedInput, match=rf"run was begun with other inputs: .*{says}.*; --restart begins anew"):
        training.train(plan, continued(plan, begun / "run"), begun / "run", **given())


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"machine": Machine.load("aoro").scale({"steering.pump.margin": 0.9})}, "machine steering.pump.margin was "),
        ({"machine": Machine.load("aoro_datasheet")}, "machine .* more"),
        ({"courses": [course(height=0.5)]}, "inputs: terrain has changed;"),
        ({"courses": [course(friction=0.8)]}, "inputs: terrain has changed;"),
        ({"courses": [course(origin=(5.0, 0.0, 0.0))]}, "inputs: terrain has changed;"),
        ({"courses": [course(shift=0.01)]}, "inputs: path has changed;"),
        ({"held_out": [course(height=0.5, shift=1.0)]}, "inputs: held-out terrain has changed;"),
        ({"held_out": [course()]}, "inputs: held-out path has changed;"),
    ],
)
def test_another_machine_or_ground_is_refused(begun, training, changes, says):
    plan = started_in(begun)
    with pytest.raises(ChangedInput, match=says):
        training.train(plan, continued(plan, begun / "run"), begun / "run", **given(**changes))


@pytest.mark.parametrize(
    ("file", "was", "now", "says"),
    [
        ("mine.yml", "n_steps: 25", "n_steps: 50", "hyperparams n_steps was 25, is 50"),
        ("mine.yml", "[8]", "[8, 8]", r"hyperparams policy_kwargs net_arch was \[8\], is \[8, 8\]"),
        ("mine.yml", "n_timesteps: 100", "n_timesteps: 150", "steps was 100, is 150"),
        ("stages.yml", "fixed", "mild", "inputs: curriculum has changed;"),
        ("first.json", '"tanh"', '"relu"', "inputs: start has changed;"),
    ],
)
def test_a_file_that_says_something_else_now_is_refused(begun, training, file, was, now, says):
    """As the command does it: the plan is the folder's, its files are read again."""
    text = (begun / file).read_text()
    assert was in text
    try:
        (begun / file).write_text(text.replace(was, now))
        plan, recipe = load_run(begun / "run")
        with pytest.raises(ChangedInput, match=says):
            training.train(plan, recipe, begun / "run", **given())
    finally:
        (begun / file).write_text(text)


def test_other_code_is_named_and_may_be_accepted(begun, training, tmp_path, monkeypatch):
    run = tmp_path / "run"
    shutil.copytree(begun / "run", run)
    plan = started_in(begun)
    recipe = continued(plan, run)
    edited = {**provenance.sources(), "agents/training/stable_baselines.py": "0" * 16}
    monkeypatch.setattr(provenance, "sources", lambda: edited)
    with pytest.raises(ChangedCode, match=r"agents/training/stable_baselines.py has changed; --accept-code-change"):
        training.train(plan, recipe, run, **given())
    training.train(plan, recipe, run, **given(), accept_code_change=True)
    record = json.loads((run / "provenance.json").read_text())
    assert record["accepted_code_changes"][0]["changes"] == ["agents/training/stable_baselines.py has changed"]


def cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flipped(content: bytes) -> bytes:
    """One bit of a tensor: nothing but the checksum tells."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        largest = max(archive.infolist(), key=lambda one: one.file_size)
        place = content.index(archive.read(largest)) + largest.file_size // 2
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


@pytest.mark.parametrize(
    ("file", "spoil", "says"),
    [
        ("checkpoint.pt", cut, r"checkpoint.pt is damaged \(.*\); restore it, or begin anew with --restart"),
        ("checkpoint.pt", flipped, r"checkpoint.pt is damaged \(the checksum"),
        ("checkpoint.pt", lambda content: b"", "checkpoint.pt is damaged"),
        ("provenance.json", cut, r"provenance.json is not JSON: .*; --restart begins anew"),
        ("provenance.json", None, r"holds a checkpoint, but no provenance.json .* begin anew with --restart"),
    ],
)
def test_what_is_damaged_is_one_error_with_what_to_do(begun, training, tmp_path, file, spoil, says):
    run = tmp_path / "run"
    shutil.copytree(begun / "run", run)
    if spoil is None:
        (run / file).unlink()
    else:
        (run / file).write_bytes(spoil((run / file).read_bytes()))
    plan = started_in(begun)
    with pytest.raises(ValueError, match=says):
        training.train(plan, continued(plan, run), run, **given())


def test_a_training_begins_anew_in_its_folder(begun, training, tmp_path):
    run, plan = tmp_path / "run", started_in(begun, seed=6)
    shutil.copytree(begun / "run", run)
    (run / "notes.txt").write_text("mine")
    (run / "checkpoint.pt").write_bytes(b"damaged")
    with pytest.raises(ValueError, match=r"holds a training; give --resume .* --restart to begin anew"):
        begin(plan, run)
    recipe = continued(plan, run, restart=True)
    assert {file.name for file in run.iterdir()} == {"training.json", "notes.txt", ".lock"}
    found = training.train(plan, recipe, run, **given())
    assert found[-1]["steps"] == 100
    assert np.any(weights(run)["layer0.weight"] != weights(begun / "run")["layer0.weight"])


def test_another_trainings_checkpoint_is_refused(begun, training, tmp_path):
    run, plan = tmp_path / "run", started_in(begun, seed=6)
    shutil.copytree(begun / "run", run)
    (run / "checkpoint.pt").unlink()
    with pytest.raises(KeyboardInterrupt):
        training.train(plan, begin(plan, run), run, **given(), tell=interrupted)
    shutil.copy(begun / "run" / "checkpoint.pt", run)
    with pytest.raises(ValueError, match=r"checkpoint.pt is another training's; restore it, or begin anew"):
        training.train(plan, continued(plan, run), run, **given())


def interrupted(progress) -> None:
    """While it learns: what it follows from is written before."""
    if progress.steps:
        raise KeyboardInterrupt
