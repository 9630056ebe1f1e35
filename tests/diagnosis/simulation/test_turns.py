"""Key figures of simulated turns: those that a calibration sees, behind a sensor, and where something is wrong."""

import numpy as np
import pytest

from aoro_gym.calibration.turns import SAMPLING, population_figures
from aoro_gym.diagnosis.simulation import outsiders, turns
from aoro_gym.diagnosis.simulation.days import CHAIN, Days
from aoro_gym.diagnosis.simulation.turns import LEVELS, READ, SLOWEST, draw_signals, simulate_figures
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.twin.records import pack
from aoro_gym.validation.turns import Turn

MACHINE = Machine.load("aoro")
GAIN = 0.03


def days_of(count: int) -> Days:
    """Days of the machine itself on which nothing is wrong."""
    reach = float(np.asarray(MACHINE.joint.range))
    none, nothing = -np.ones((count, 2), np.int16), np.zeros((count, 2))
    return Days(
        np.repeat(pack(MACHINE), count), np.full(count, reach), nothing, np.zeros((count, len(CHAIN))),
        np.zeros(count, np.int8), none, none[:, 0].copy(), nothing, nothing, nothing,
    )  # fmt: skip


@pytest.fixture(scope="module")
def figures() -> np.ndarray:
    """Of a machine with exact sensors and of one with noisy ones (2, D, 1, figures) at full signal to the left: a healthy
    day, one with a gain of the angle, and one whose spool is kept from opening wholly."""
    days = days_of(6)
    days.chain[1::3, CHAIN.index("sensor_gain")] = GAIN
    days.outsider[2::3] = outsiders.ALL.index("limited_spool")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(turns, "NOISY", 0.6)
        return simulate_figures(days, np.ones((2, 1)), seed=3)


def exact_and_noisy(figures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The days (D, figures) of either machine."""
    noisy = np.random.default_rng([3, 2]).random(2) < 0.6
    assert sorted(noisy) == [False, True]
    return figures[int(np.argmin(noisy)), :, 0], figures[int(np.argmax(noisy)), :, 0]


def test_exact_figures_are_those_that_a_calibration_sees(figures):
    """Steps are coarser, and a turn ends where the joint comes to rest, which the stop's giving way moves by 0.1° or less:
    0.3 % of a turn's 85°."""
    exact, _ = exact_and_noisy(figures)
    expected = population_figures(MACHINE, [Turn("left", 100.0)])[0, [FIGURES.index(name) for name in READ], 0]
    np.testing.assert_allclose(exact[0], expected, rtol=4e-3)


def test_a_sensors_gain_leaves_a_turn_its_time_and_raises_its_flow(figures):
    """Its lever hardly changes with the angle: by 3 % ± 1 %."""
    exact, _ = exact_and_noisy(figures)
    time, steady = READ.index("turn_time_s"), READ.index("steady_flow_L_per_min")
    assert exact[1, time] == pytest.approx(exact[0, time], abs=0.01)
    assert exact[1, steady] == pytest.approx((1.0 + GAIN) * exact[0, steady], rel=0.01)


def test_what_lies_in_the_command_is_seen(figures):
    """A spool that opens to 85 % at most turns the joint more slowly."""
    for of_machine in exact_and_noisy(figures):
        assert of_machine[2, READ.index("turn_time_s")] > 1.1 * of_machine[0, READ.index("turn_time_s")]


def test_noise_widens_extremes(figures):
    """Of the published lines, which swing by several L/min; the time of a turn stays within a few samples."""
    exact, noisy = exact_and_noisy(figures)
    off = np.abs(noisy[0] - exact[0])
    assert off[READ.index("second_peak_L_per_min")] > 0.2
    assert off[READ.index("turn_time_s")] < 0.1


def test_a_turn_that_does_not_end_has_no_figures():
    time = SAMPLING * np.arange(400)
    angle = np.clip(-0.7 + 0.5 * np.clip(time - 0.6, 0.0, None), -0.7, 0.7)
    both = np.stack([angle, np.minimum(angle, 0.3)], axis=1).astype(np.float64)
    found = turns._read(both, np.ones(2), np.full(2, 0.7))
    assert np.all(np.isfinite(found[0])) and np.all(np.isnan(found[1]))
    assert np.all(np.isnan(turns._read(np.full((400, 1), np.nan), np.ones(1), np.full(1, 0.7))))


def test_no_two_turns_of_a_machine_are_alike():
    signals = draw_signals(np.random.default_rng(0), 500, 6)
    assert np.all(np.abs(signals) >= SLOWEST) and np.all(np.abs(signals) <= 1.0)
    assert all(len(set(own)) == 6 for own in signals)
    usual = np.isin(np.abs(signals), LEVELS).all(axis=1)
    assert 0.74 < np.mean(usual) < 0.86  # 0.8 with a standard error of 0.018
    one_sided = np.all(signals[:, :3] > 0.0, axis=1)
    assert 0.5 < np.mean(one_sided) < 0.9
