"""Peers stay finite and on the ground, and their results do not depend on how they are spread."""

import numpy as np
import pytest

from aoro_gym.benchmark import peers
from aoro_gym.benchmark.scene import CELL, CHANGES, CONTROL_STEP, EPISODE, SIDE, heights


@pytest.mark.slow
def test_ten_seconds_of_changing_controls(machine, rolled):
    """An episode over the forest: it begins at rest and stays finite, and nobody falls through the ground or flies."""
    worlds = peers.mujoco(16, machine=machine)
    rolled.clear()
    worlds.restart()
    worlds.advance(EPISODE)
    assert EPISODE * CONTROL_STEP == 10.0
    assert worlds.check() == {"finite": 16, "dropped": []}
    first = rolled[0][2]
    assert np.abs(first[:, 17:20]).max() < 0.2  # [m/s]; in the air it would be 9.81 m/s² x 1.5 s
    states = np.concatenate([states for *_, states in rolled], axis=1)
    ground = heights("raster")
    rows, columns = (((states[..., axis] + 0.5 * SIDE) / CELL).astype(int) for axis in (2, 1))
    above = states[..., 3] - ground[rows, columns]
    # the hinge's ground is within a boulder or a ditch of the wheels' ground
    assert above.min() > -1.0 and above.max() < 2.0
    assert np.abs(states[..., -1, 1:3] - first[:, 1:3]).max() > 0.1  # and it drives


def test_threads_change_nothing(machine, rolled):
    for threads in (1, 2):
        subject = peers.mujoco(3, machine=machine, threads=threads)
        subject.restart()
        subject.advance(CHANGES)
    (one, control, _, alone), (two, _, _, spread) = rolled[1], rolled[3]
    assert (one, two) == (0, 2)
    np.testing.assert_array_equal(alone, spread)
    assert alone.shape[:2] == (3, CHANGES * subject.steps)
    # held for a control step, then another
    held = control.reshape(3, CHANGES, subject.steps, -1)
    assert (held == held[:, :, :1]).all()
    assert (np.diff(held[:, :, 0, 0], axis=1) != 0.0).all()


def test_mujoco_warp_steps_the_same_vehicle(machine, rolled):
    mjw = pytest.importorskip("mujoco_warp")
    held = []
    put_data = mjw.put_data
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mjw, "put_data", lambda *a, **k: held.append(put_data(*a, **k)) or held[-1])
        subject = peers.mujoco_warp(2, machine=machine, device="cpu")
    subject.restart()
    subject.advance(10)
    assert subject.check() == {"finite": 2, "dropped": []}
    other = peers.mujoco(2, machine=machine)
    other.restart()
    other.advance(10)
    # single precision, and another choice among the contacts of a wheel: centimetres would be another vehicle
    np.testing.assert_allclose(held[0].qpos.numpy()[:, :3], rolled[-1][-1][:, -1, 1:4], atol=0.02)


def test_unsound_rows_do_not_count():
    good = {"worlds": 4, "finite": 4, "dropped": []}
    assert peers.valid_runs([good, good | {"finite": 3}, good | {"dropped": ["HFIELD"]}]) == [good]


def test_missing_packages_are_named(monkeypatch):
    def missing(module):
        raise ImportError(module)

    monkeypatch.setattr(peers, "import_module", missing)
    with pytest.raises(ValueError, match=r"the peers need mujoco_warp: pip install 'aoro-gym\[bench\]'"):
        peers.package("mujoco_warp")
