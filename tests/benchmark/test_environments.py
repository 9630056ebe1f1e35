"""Environments are asked for as they were ordered, and step with actions that change."""

import gymnasium
import numpy as np
import pytest

from aoro_gym.benchmark.environments import ENVIRONMENT, environments
from aoro_gym.benchmark.scene import CHANGES
from aoro_gym.terrains import Plane


class Recorder:
    """Makes environments and keeps what they were made with and given."""

    def __init__(self, monkeypatch):
        self.options = {}
        self.actions = []
        make = gymnasium.make_vec

        def make_vec(name, **options):
            assert name == ENVIRONMENT
            self.options = options
            options = {key: value for key, value in options.items() if key != "output"}
            env = make(name, **options)
            step = env.step
            monkeypatch.setattr(env, "step", lambda actions: self.actions.append(actions) or step(np.asarray(actions)))
            return env

        monkeypatch.setattr(gymnasium, "make_vec", make_vec)


@pytest.fixture
def recorder(monkeypatch) -> Recorder:
    return Recorder(monkeypatch)


def test_steps_and_actions(machine, recorder):
    subject = environments(2, machine=machine, ground="plane", threads=1, seed=4)
    assert isinstance(recorder.options["terrain"], Plane)
    assert "output" not in recorder.options
    subject.restart()
    subject.advance(CHANGES + 1)
    assert len(recorder.actions) == CHANGES + 1
    actions = np.array(recorder.actions)
    assert len(np.unique(actions[:CHANGES])) == actions[:CHANGES].size
    assert (actions[CHANGES] == actions[0]).all()
    assert np.abs(actions).max() <= 1.0 and np.abs(actions).max() > 0.9
    assert (subject.steps, subject.copies, subject.step_time) == (1, 2, 0.05)
    assert subject.description["threads"] == 1


def test_tensors_and_machines_of_their_own(machine, recorder):
    torch = pytest.importorskip("torch")
    subject = environments(3, machine=machine, ground="mesh", randomise=True, output="torch")
    assert (recorder.options["output"], recorder.options["ground"]) == ("torch", "mesh")
    assert recorder.options["machine"].num_variants == recorder.options["num_envs"] == 3
    subject.advance(1)
    assert isinstance(recorder.actions[0], torch.Tensor)
