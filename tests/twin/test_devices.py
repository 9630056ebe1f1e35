"""The same twin on the CPU and on a GPU."""

import numpy as np
import pytest
import warp as wp

from aoro_gym.twin import Twin


def turn(device):
    twin = Twin(3, device=device)
    twin.reset(joint_angle=-twin.machine.joint.range)
    twin.step({}, 0.5)
    trace = twin.step({"steering_signal": [1.0, 0.75, 0.5], "drive_signal": [0.0, 0.2, 0.0]}, 2.4, sample_every=0.01)
    assert trace is not None and twin.diverged == []
    return trace


@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")
def test_a_turn_is_the_same_on_a_gpu():
    """Both run the same float32 source; they differ by fused multiply-adds, and by CUDA's approximate quotients and roots,
    good to 2 units in the last place.

    Rounding of 6e-8 a step grows with the steps at most linearly while the motion is smooth: 2900 steps × 30 substeps
    × 6e-8 = 5e-3 of a channel's range in the worst case (seen: 1e-4); impacts on the end stop are left out (before 1.9 s).
    """
    cpu, cuda = turn("cpu"), turn("cuda:0")
    before = cpu.time - 0.5 < 1.9
    for channel in ("joint_angle", "joint_flow", "pressure_a", "pressure_b", "pump_pressure", "wheel_rate_fl", "speed"):
        expected, found = cpu[channel][before], cuda[channel][before]
        assert np.abs(found - expected).max() < 5e-3 * max(np.ptp(expected), 1e-9), channel
