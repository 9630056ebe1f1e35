"""The stepped laws converge as the steps become short, and single precision does not hide it.

The twin beside its own build in float64 (:mod:`studies.convergence.precision`): half a second of three left turns, from the
signal's step over the first peak to the undershoot, with the switching of valve, compensator and shock valves.
"""

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from studies.convergence.precision import build
from studies.convergence.schemes import SCHEMES

pytestmark = pytest.mark.slow  # a build of its own, compiled

CHANNELS = ("joint_flow", "pressure_a", "pressure_b", "pump_pressure")
REST, TURN = 0.1, 0.5


@pytest.fixture(scope="module")
def float64():
    return build("aoro_float64", wide=True).Twin


def signals(kind, machine, main_step, substeps):
    """Channels by name (samples, 3) as shares of their largest value, one a millisecond."""
    twin = kind(3, machine=machine, main_step=main_step, substeps=substeps, check_step=False)
    twin.reset(joint_angle=-machine.joint.range)
    twin.step(duration=REST)
    trace = twin.step({"steering_signal": [1.0, 0.75, 0.5]}, TURN, sample_every=1e-3)
    assert not twin.diverged
    return {name: trace[name] / np.abs(trace[name]).max() for name in CHANNELS}


def apart(one, other):
    return {name: np.abs(one[name] - other[name]).max() for name in CHANNELS}


def test_both_steps_halved_halve_every_error(float64, machine):
    """First order in float64, monotone. Against steps a sixteenth as long, whose own error takes the factors from 2 to 15/7
    and 7/3; a switching instant more or less may bend one by a quarter."""
    reference = signals(float64, machine, 1.25e-4, 60)
    errors = [apart(signals(float64, machine, h, 30), reference) for h in (1e-3, 5e-4, 2.5e-4)]
    for name in CHANNELS:
        coarse, middle, fine = (one[name] for one in errors)
        assert 1.5 < coarse / middle < 2.7, name
        assert 1.5 < middle / fine < 2.9, name
        assert coarse < 0.01, name


@pytest.mark.parametrize("scheme", [name for name, edits in SCHEMES.items() if edits])
def test_another_scheme_is_another_step_of_the_same_equations(scheme, float64, machine):
    """Its edits change what the twin does, and steps half as long halve what it is off, as they do with the twin's own."""
    kind = build(f"aoro_scheme_{list(SCHEMES).index(scheme)}", wide=True, edits=SCHEMES[scheme]).Twin
    reference = signals(float64, machine, 1.25e-4, 60)
    own, coarse, fine = (
        signals(*one, 30) for one in ((float64, machine, 1e-3), (kind, machine, 1e-3), (kind, machine, 5e-4))
    )
    assert max(apart(own, coarse).values()) > 1e-5
    for name in CHANNELS:
        assert 1.5 < apart(coarse, reference)[name] / apart(fine, reference)[name] < 2.7, name


def test_float32_is_float64_but_for_rounding(float64, machine):
    """A rounding a substep, 6e-8 each and all of one sign, is the worst while the motion is smooth: 1e-3 of the range."""
    roundings = (REST + TURN) / 1e-3 * 30 * 6e-8
    found = apart(signals(Twin, machine, 1e-3, 30), signals(float64, machine, 1e-3, 30))
    assert max(found.values()) < roundings
    assert min(found.values()) > 0.0


def test_finer_steps_are_not_lost_to_rounding(float64):
    """With a quarter of the hydraulic step, four times as many roundings, these are less than a twentieth of what the
    default step's discretisation is: a state that is advanced as the ratio of two sums would make them a tenth (seen:
    0.03)."""
    shipped = Machine.load("aoro")
    reference = signals(float64, shipped, 1.25e-4, 60)
    discretisation = apart(signals(float64, shipped, 1e-3, 30), reference)
    rounding = apart(signals(Twin, shipped, 1e-3, 120), signals(float64, shipped, 1e-3, 120))
    for name in CHANNELS:
        assert rounding[name] < 0.05 * discretisation[name], name
