"""Runs: in any company a run gives the same log, in the order given, with bounded chunks and progress."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.runs import Run, record


def test_company_and_chunks_change_nothing(machine):
    signal = np.zeros(12)
    signal[3:] = 1.0
    shorter = signal[:8]
    runs = [
        Run(machine.entries, signal, 0, {"payload": 400.0}, seed=1),
        Run(machine.entries, shorter, 1, joint_angle=0.2, seed=2),
        Run(machine.entries, signal, 0, {"entrained_air": -3e8, "ground_slope": [0.02, -0.01]}, seed=3),
        Run(machine.entries, shorter, 0, drive=0.3 * shorter, seed=4),
    ]
    told = []
    together = record(runs, progress=told.append)
    assert [len(log.time) for log in together] == [13, 9, 13, 9]
    assert sum(told) == sum(len(run.steering) for run in runs)
    for run, log in zip(runs, together, strict=True):
        (alone,) = record([run], chunk=1)
        assert np.array_equal(alone.steering, log.steering) and np.array_equal(alone.drive, log.drive)
        for name, values in alone.channels.items():
            assert values == pytest.approx(log.channels[name], rel=1e-9, abs=1e-9), name
    assert together[3].drive.max() == 0.3


def test_a_run_has_commands_that_fit(machine):
    with pytest.raises(ValueError, match=r"must be in \[-1, 1\]"):
        Run(machine.entries, np.array([0.0, 1.2]))
    with pytest.raises(ValueError, match="same K"):
        Run(machine.entries, np.zeros(5), drive=np.zeros(4))
