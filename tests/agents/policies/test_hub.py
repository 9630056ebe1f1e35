"""Policies in a folder as they would be on the Hub, and what its client is asked for."""

import json
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aoro_gym.agents.policies import hub
from aoro_gym.agents.policies.files import SHIPPED
from aoro_gym.agents.policies.policy import LearnedPolicy
from tests.cli.calling import call

FIGURES = {"return": {"mean": 1.0, "low95": 0.5, "high95": 1.5, "episodes": 32}}


@pytest.fixture
def trained(tmp_path) -> Path:
    """A policy with two evaluations beside it, of which the second is the better one."""
    folder = tmp_path / "run"
    folder.mkdir()
    for suffix in (".json", ".safetensors"):
        shutil.copy(SHIPPED / f"turning-ppo{suffix}", folder / f"best{suffix}")
    better = {
        "return": {"mean": 385.25, "low95": 380.0, "high95": 390.0, "episodes": 32},
        "settling_time_s": {"mean": 0.7413, "low95": 0.711, "high95": 0.772, "episodes": 32},
    }
    (folder / "evaluations.json").write_text(
        json.dumps({"evaluations": [{"steps": 1, "figures": FIGURES}, {"steps": 2, "figures": better}]})
    )
    return folder / "best.json"


@pytest.fixture
def client(monkeypatch, tmp_path):
    """A stand-in of huggingface_hub whose Hub is a folder."""
    hub_folder, asked = tmp_path / "hub", []

    class Api:
        def create_repo(self, repo_id, *, private, exist_ok):
            asked.append(("create", repo_id, private, exist_ok))

        def upload_folder(self, *, repo_id, folder_path, commit_message):
            asked.append(("upload", repo_id, commit_message))
            shutil.copytree(folder_path, hub_folder / repo_id)
            return f"https://hub/{repo_id}"

    def snapshot_download(repo_id, *, local_dir, allow_patterns):
        if not (hub_folder / repo_id).exists():
            raise RuntimeError("404 Client Error\nmore")
        for name in allow_patterns:
            shutil.copy(hub_folder / repo_id / name, local_dir)

    module = SimpleNamespace(HfApi=Api, snapshot_download=snapshot_download)
    monkeypatch.setitem(sys.modules, "huggingface_hub", module)
    return asked


def test_a_policy_goes_to_a_folder_and_back(trained, tmp_path):
    address = hub.push(trained, str(tmp_path / "shared"))
    found = hub.pull(address, tmp_path / "pulled")
    observations = np.random.default_rng(0).normal(size=(5, 8)).astype(np.float32)
    np.testing.assert_array_equal(LearnedPolicy.load(found)(observations), LearnedPolicy.load(trained)(observations))
    assert sorted(path.name for path in (tmp_path / "pulled").iterdir()) == sorted(hub.FILES)
    assert hub.pull(address, tmp_path / "pulled") == found  # again, over what is there


def test_the_card_says_what_it_is_for_and_how_well_it_does(trained, tmp_path):
    hub.push(trained, str(tmp_path / "my-turning"))
    card = (tmp_path / "my-turning" / "README.md").read_text()
    front, _, text = card.removeprefix("---\n").partition("---\n")
    assert "library_name: aoro-gym" in front and "pipeline_tag: reinforcement-learning" in front
    assert "# my-turning" in text and "`AORO/Turning-v0`" in text
    assert "| 4 to 7 | `signals` |" in text
    assert "| settling time s | 0.7413 | 0.711 to 0.772 | 32 |" in text
    assert "--seed" in text or "| seed | `0` |" in text


def test_without_an_evaluation_the_card_says_so(tmp_path):
    hub.push(SHIPPED / "turning-ppo.json", str(tmp_path / "shared"))
    assert "None stood beside the policy" in (tmp_path / "shared" / "README.md").read_text()


def test_figures_of_one_episode_have_no_interval(trained, tmp_path):
    alone = {"return": {"mean": 12.5, "low95": None, "high95": None, "episodes": 1}}
    (trained.parent / "evaluations.json").write_text(json.dumps({"evaluations": [{"steps": 1, "figures": alone}]}))
    hub.push(trained, str(tmp_path / "shared"))
    assert "| return | 12.5 | none | 1 |" in (tmp_path / "shared" / "README.md").read_text()


def test_a_repository_gets_the_same(trained, tmp_path, client):
    assert hub.push(trained, "me/turning", private=True) == "https://hub/me/turning"
    assert client[0] == ("create", "me/turning", True, True)
    found = hub.pull("me/turning", tmp_path / "pulled")
    assert LearnedPolicy.load(found).environment == "AORO/Turning-v0"


def test_what_cannot_be_had_is_one_line(tmp_path, client, monkeypatch):
    with pytest.raises(OSError, match=r"me/none cannot be fetched: 404 Client Error$"):
        hub.pull("me/none", tmp_path / "pulled")
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ValueError, match=r"needs huggingface_hub: pip install 'aoro-gym\[hub\]'"):
        hub.pull("me/none", tmp_path / "pulled")


def test_a_damaged_policy_is_not_fetched(trained, tmp_path):
    folder = Path(hub.push(trained, str(tmp_path / "shared")))
    (folder / "policy.safetensors").write_bytes(b"no numbers")
    with pytest.raises(ValueError, match="policy"):
        hub.pull(str(folder), tmp_path / "pulled")
    assert not list((tmp_path / "pulled").iterdir())


def test_commands(trained, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "pushed to shared" in call("hub", "push", trained, "./shared").stdout
    found = json.loads(call("hub", "pull", "./shared", "--out", "pulled", "--json", "-").stdout)
    assert Path(found["policy"]).exists()
    refused = call("hub", "pull", "./nothing")
    assert refused.exit_code == 2 and "nothing" in refused.stderr
