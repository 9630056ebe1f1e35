"""What objects cost: twins begin where nothing solid is, and all that is said of them is there."""

import numpy as np

from aoro_gym.terrains.generate.world import world
from aoro_gym.twin import Twin
from studies import objects_speed


def test_twins_begin_in_no_object(monkeypatch):
    made = world(3, size=(40.0, 40.0))
    twin = Twin(8, terrain=made)
    position, _ = objects_speed.put(twin, made, np.random.default_rng(0))
    np.testing.assert_allclose(twin.state.numpy()[:2].T, position, atol=1e-5)
    objects = twin._grounds.objects
    assert objects is not None
    assert objects.overlaps(twin.machines, twin.state)[1].max() <= objects_speed.CLEAR
    monkeypatch.setattr(objects_speed, "ROUNDS", 1)
    found = objects_speed.cost(made, 8, "cpu")
    assert 0.2 < found["ratio"]["median"] < 5.0 and found["diverged"] == 0
