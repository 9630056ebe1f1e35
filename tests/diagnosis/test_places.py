"""Where a gap lies: its energy by manoeuvre, signal and phase."""

import numpy as np
import pytest

from aoro_gym.diagnosis.places import Gap, phases, places
from aoro_gym.diagnosis.result import PHASES
from tests.diagnosis.manoeuvres import REST, blank, turn

STD = 2.0
TURN = blank("turn", turn(0.6, 3.0), 0.0)
BEGIN = round(REST / 0.01)


def gap(signal: str, residual: np.ndarray, arrival: int = -1) -> Gap:
    return Gap(TURN, signal, residual, STD, arrival)


def test_a_bump_is_where_it_is():
    """Energies beyond the number of samples: 24 · (9 − 1) within the undershoot, 10 · (4 − 1) at the onset."""
    one, other = np.full(TURN.ticks + 1, STD), np.full(TURN.ticks + 1, STD)
    one[BEGIN + 31 : BEGIN + 55] *= 3.0
    other[BEGIN + 2 : BEGIN + 12] *= 2.0
    found = places([gap("pressure_a", one), gap("joint_angle", other)])
    assert [(p.manoeuvre, p.signal, p.phase) for p in found] == [
        ("turn", "pressure_a", "undershoot"),
        ("turn", "joint_angle", "onset"),
    ]
    assert [p.share for p in found] == pytest.approx([192.0 / 222.0, 30.0 / 222.0])


def test_what_is_no_more_than_noise_is_nowhere():
    assert places([gap("pressure_a", np.full(TURN.ticks + 1, 0.9 * STD))]) == ()


def test_after_the_arrival_all_is_stop():
    phased = phases(TURN, BEGIN + 100)
    assert np.all(phased[BEGIN + 100 :] == PHASES.index("stop"))
    assert np.all(phased[BEGIN + 90 : BEGIN + 100] == PHASES.index("steady"))
