"""Changes by effect, how sensitivities are read from figures, and their signs and sizes where a closed form has them."""

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.simulation.key_figures import key_figures_batch
from aoro_gym.validation.theory.circuit import chambers, steady_turn
from aoro_gym.validation.theory.sensitivities import (
    FIGURES,
    LEVELS,
    PHASES,
    RATE,
    SILENT,
    cases,
    changes,
    continued,
)
from studies.sensitivities import twin_angles


def test_every_effect_is_changed_a_little_within_its_range():
    found = changes()
    assert list(dict.fromkeys(change.effect for change in found)) == sorted(IDS)
    assert set(SILENT) < set(IDS)
    for change in found:
        effect = EFFECTS[change.effect]
        for size in change.sizes:
            assert size != effect.none
            for one, value in zip(effect.magnitudes, size, strict=True):
                assert one.low <= value <= one.high


def test_lanes_have_their_effect_at_every_level(machine):
    wanted = [change for change in changes() if change.effect in ("seal_friction", "valve_gain", "ground_slope")]
    turns = cases(machine, wanted)
    assert turns.count == 1 + 1 + 2 + 4
    assert turns.level.tolist() == sorted(turns.level, reverse=True)
    preload = np.asarray(turns.machine.steering.cylinder.seal_preload).reshape(len(LEVELS), turns.count)
    lane = [name for name, _ in turns.lanes].index("seal_friction")
    assert np.all(preload[:, lane] > preload[:, 0]) and np.all(np.delete(preload, lane, axis=1) == preload[0, 0])
    assert np.count_nonzero(turns.plane.slope_deg) == 4 * len(LEVELS)


def test_sensitivities_are_relative_and_even_parts_fall_out(machine):
    two, one = (next(c for c in changes() if c.effect == name) for name in ("valve_gain", "seal_friction"))
    turns = cases(machine, [two, one])
    values = np.ones((PHASES, len(LEVELS), turns.count, len(FIGURES)))
    values[:, :, 1], values[:, :, 2], values[:, :, 3] = 1.05, 0.99, 1.02  # ± 3 % and + 2 % of both
    values[: PHASES // 2, :, 3] += 0.01
    values[PHASES // 2 :, :, 3] -= 0.01
    found, scatter = turns.sensitivities(2.0 * values)
    np.testing.assert_allclose(found[:, 0], 0.03, rtol=1e-12)
    np.testing.assert_allclose(found[:, 1], 0.02, rtol=1e-12)
    np.testing.assert_allclose(scatter[:, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(scatter[:, 1], 0.01, rtol=1e-12)


def test_a_turn_goes_on_at_the_steady_flow_to_its_stop(machine):
    """A joint that starts at once at the steady flow takes the whole oil over it."""
    start = np.full((1, 1), -float(machine.joint.range))
    time, angle = continued(machine, np.array([0.5]), np.zeros(1), start, 0.0)
    read = key_figures_batch(time, angle, machine, interpolate=True)
    flow = float(steady_turn(machine, np.array([0.5]), np.zeros(1)).flow[0])
    # 0.1° at either end do not count
    reach = float(machine.joint.range)
    inner = chambers(machine, np.array([-reach, reach]) + np.radians([0.1, -0.1])).volume_a
    assert float(read["turn_time_s"][0]) == pytest.approx(float(np.diff(inner)[0]) / flow, abs=2.0 / RATE)


@pytest.mark.parametrize("name", ["valve_gain", "dead_band", "cross_port_leakage"])
def test_flow_balance_gives_the_twins_turn_time_at_half_signal(name):
    """T ∝ 1/Q where the first rush of oil is a small part: the turn's first half second is 9 % of it."""
    machine = Machine.load("aoro")
    change = next(c for c in changes() if c.effect == name)
    turns = cases(machine, [change])
    angles = twin_angles(turns, turns.machine)
    twin = turns.sensitivities(turns.figures(*angles))[0][LEVELS.index(0.5), 0, 0]
    flow = [float(steady_turn(EFFECTS[name].apply(machine, *s), 0.5, 0.0, 1800.0).flow) for s in change.sizes]
    base = float(steady_turn(machine, 0.5, 0.0, 1800.0).flow)
    theory = -(flow[0] - (flow[1] if len(flow) == 2 else base)) / (len(flow) * base)
    assert twin == pytest.approx(theory, rel=0.15)
