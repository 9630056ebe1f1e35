"""What tests of peers share."""

import numpy as np
import pytest
from mujoco.rollout import Rollout


@pytest.fixture
def rolled(monkeypatch):
    """Rollouts of MuJoCo: threads, controls, first states and all states, each state as time, positions, velocities."""
    seen = []
    rollout = Rollout.rollout

    def spy(pool, model, data, state, control):
        before = np.array(state)
        states, sensors = rollout(pool, model, data, state, control)
        seen.append((pool.nthread, np.array(control), before, np.array(states)))
        return states, sensors

    monkeypatch.setattr(Rollout, "rollout", spy)
    return seen
