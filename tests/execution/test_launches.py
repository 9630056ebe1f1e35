"""A recorded launch does what a launch does."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false, reportIndexIssue=false, reportOperatorIssue=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.execution.launches import RecordedLaunch


@wp.struct
class Given:
    values: wp.array(dtype=float)
    factor: float


@wp.kernel(enable_backward=False)
def add(given: Given, first: int, out: wp.array(dtype=float)):
    i = first + wp.tid()
    out[i] = out[i] + given.factor * given.values[i]


def made():
    given = Given()
    given.values, given.factor = wp.array(np.arange(6.0), dtype=float, device="cpu"), 2.0
    out = wp.zeros(6, dtype=float, device="cpu")
    return given, out, RecordedLaunch(add, 6, [given, 0, out], device="cpu", block_dim=32)


def test_each_launch_does_it_again():
    given, out, recorded = made()
    recorded.launch()
    given.values.fill_(1.0)  # in place
    recorded.launch()
    assert np.array_equal(out.numpy(), 2.0 * np.arange(6.0) + 2.0)


def test_other_threads_and_another_argument():
    _, out, recorded = made()
    recorded.set(2, {1: 3})
    recorded.launch()
    assert np.array_equal(out.numpy(), [0.0, 0.0, 0.0, 6.0, 8.0, 0.0])


def test_on_the_cpu_it_is_the_compiled_function_alone(monkeypatch):
    """Of the pinned Warp: should its commands change, they still work, but are slower, and this says so."""
    _, out, recorded = made()
    monkeypatch.setattr(type(recorded._recorded), "launch", lambda *_: pytest.fail("the slow way"))
    recorded.launch()
    assert out.numpy()[1] == 2.0


def test_memory_lives_as_long_as_the_launch():
    out, recorded = made()[1:]
    for _ in range(100):  # would take the place of what was freed
        wp.array(np.full(6, 7.0), dtype=float, device="cpu")
    recorded.launch()
    assert np.array_equal(out.numpy(), 2.0 * np.arange(6.0))
