"""Peers stay finite and on the ground, and their results do not depend on how they are spread."""

import numpy as np
import pytest
from mujoco.rollout import Rollout

from aoro_gym.benchmark import peers
from aoro_gym.benchmark.scene import CHANGES, CONTROL_STEP, EPISODE


def test_ten_seconds_of_changing_controls(machine):
    """An episode over the forest: all finite, none dug in or flown away."""
    worlds = peers.mujoco(16, machine=machine)
    worlds.restart()
    worlds.advance(EPISODE)
    assert EPISODE * CONTROL_STEP == 10.0
    assert worlds.check() == {"finite": 16, "dropped": []}


def test_threads_change_nothing(machine, monkeypatch):
    seen = []
    rollout = Rollout.rollout

    def spy(pool, model, data, state, control):
        states, sensors = rollout(pool, model, data, state, control)
        seen.append((pool.nthread, np.array(control), np.array(states)))
        return states, sensors

    monkeypatch.setattr(Rollout, "rollout", spy)
    for threads in (1, 2):
        subject = peers.mujoco(3, machine=machine, threads=threads)
        subject.restart()
        subject.advance(CHANGES)
    (one, control, alone), (two, _, spread) = seen
    assert (one, two) == (0, 2)
    np.testing.assert_array_equal(alone, spread)
    assert alone.shape[:2] == (3, CHANGES * subject.steps)
    # held for a control step, then another
    held = control.reshape(3, CHANGES, subject.steps, -1)
    assert (held == held[:, :, :1]).all()
    assert (np.diff(held[:, :, 0, 0], axis=1) != 0.0).all()


def test_mujoco_warp_steps_the_same_vehicle(machine):
    mjw = pytest.importorskip("mujoco_warp")
    held = []
    put_data = mjw.put_data
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mjw, "put_data", lambda *a, **k: held.append(put_data(*a, **k)) or held[-1])
        subject = peers.mujoco_warp(2, machine=machine, device="cpu")
    subject.restart()
    subject.advance(10)
    assert subject.check() == {"finite": 2, "dropped": []}
    states = []
    rollout = Rollout.rollout
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Rollout, "rollout", lambda *a: states.append(rollout(*a)) or states[-1])
        other = peers.mujoco(2, machine=machine)
        other.restart()
        other.advance(10)
    # single precision, and another choice among the contacts of a wheel: centimetres in 0.2 s would be another vehicle
    np.testing.assert_allclose(held[0].qpos.numpy()[:, :3], states[0][0][:, -1, 1:4], atol=0.01)


def test_unsound_rows_do_not_count():
    good = {"worlds": 4, "finite": 4, "dropped": []}
    assert peers.sound([good, good | {"finite": 3}, good | {"dropped": ["HFIELD"]}]) == [good]


def test_missing_packages_are_named(monkeypatch):
    def missing(module):
        raise ImportError(module)

    monkeypatch.setattr(peers, "import_module", missing)
    with pytest.raises(ValueError, match=r"the peers need mujoco_warp: pip install 'aoro-gym\[bench\]'"):
        peers.package("mujoco_warp")
