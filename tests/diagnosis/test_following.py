"""Twins that follow a recording: what leads them is what is missing, in its own unit, and where it is missing."""

import numpy as np
import pytest

from aoro_gym.diagnosis.following import LACKED, LED
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import Replay, Simulator, Variants
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import FULL, blank, turn

MACHINE = Machine.load("aoro")
BLANKS = [blank("left", turn(0.9, 3.0), -0.6), blank("right", turn(-0.6, 3.0), 0.6)]
STEADY = slice(110, 255)
"""Samples of a turn in which the joint slides, after its spool has opened and before it shuts."""
FRICTION = 1500.0
"""Torque [N m] of the joint's bearing beyond that of the twin."""
GAIN = 0.9
"""Of a valve whose edges let less pass, of 1.2e-3 m³/s."""
LITTLE = {
    "torque": 0.1 * FRICTION, "flow_a": 0.2 * (1.0 - GAIN) * 1.2e-3, "flow_b": 0.2 * (1.0 - GAIN) * 1.2e-3,
    "pump_pressure": 1e5,
}  # fmt: skip
"""Root mean square [SI] of what an innocent part may lack: a tenth of what that friction takes, a fifth of what that valve
does, 1 of 50 bar. It comes from between the samples: where a check valve opens, pressures have corners."""


def recorded(variants, blanks=BLANKS):
    """What one variant does, without noise."""
    found = Simulator().run([Replay(variants, one) for one in blanks])
    return [
        Recording(one.name, one.commands, {k: v[:, 0].astype(np.float64) for k, v in rows.items()}, one.rest, start)
        for one, rows in zip(blanks, found, strict=True)
        for start in [one.start_angle]
    ]


def followed(recordings, variants=None):
    """What the twin lacks (F, N), by name."""
    one = variants or Variants(MACHINE)
    zeros = [np.zeros((len(LED), one.count))] * len(recordings)
    found = Simulator().follow([Replay(one, recording) for recording in recordings], zeros)
    return [dict(zip(LACKED, rows, strict=True)) for rows in found]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values[STEADY]))))


@pytest.fixture(scope="module")
def healthy():
    return followed(recorded(Variants(MACHINE)))


@pytest.fixture(scope="module")
def stiff_joint():
    return followed(recorded(Variants.of(MACHINE, [(EFFECTS["joint_friction"], (FRICTION,))], 1)))


def test_a_twin_that_follows_itself_lacks_nothing(healthy):
    for one in healthy:
        assert all(rms(one[name]) < little for name, little in LITTLE.items())


def test_friction_of_the_joint_is_what_the_torque_lacks(stiff_joint):
    """To the newton metre, nearly: what slides at FRICTION takes as much torque, against the motion. The leash follows at
    20 rad/s, so that the mean over 1.4 s leaves 4 % of how the torque has changed until then."""
    for one, side in zip(stiff_joint, (1.0, -1.0), strict=True):
        assert np.mean(one["torque"][STEADY]) == pytest.approx(-side * FRICTION, rel=0.04)
        assert np.std(one["torque"][STEADY]) < 0.04 * FRICTION


def test_friction_of_the_joint_is_nothing_that_oil_and_pump_lack(stiff_joint):
    for one in stiff_joint:
        assert all(rms(one[name]) < LITTLE[name] for name in ("flow_a", "flow_b", "pump_pressure"))


def test_a_larger_valve_is_what_the_flows_lack():
    """The loaded port lacks what edges that let less pass keep back, torque and pump lack nothing."""
    recordings = recorded(Variants.of(MACHINE, [(EFFECTS["valve_gain"], (GAIN,))], 1))
    loaded = ("flow_a", "flow_b")
    for recording, one, port, side in zip(recordings, followed(recordings), loaded, (1.0, -1.0), strict=True):
        turned = side * (recording.channels["joint_angle"][STEADY][-1] - recording.channels["joint_angle"][STEADY][0])
        volume = -np.sum(one[port][STEADY]) * TICK
        swept = float(np.asarray(MACHINE.steering.full_turn_volume)) * turned / (2.0 * float(MACHINE.joint.range))
        # levers change by a tenth on the way
        assert volume == pytest.approx(swept * (1.0 / GAIN - 1.0), rel=0.15)
        assert all(rms(one[name]) < LITTLE[name] for name in ("torque", "pump_pressure"))


def test_a_slow_pump_is_what_its_pressure_lacks(healthy):
    found = followed(recorded(Variants.of(MACHINE, [(EFFECTS["pump_response"], (3.0,))], 1)))
    first = slice(60, 100)  # while the pump swivels out
    for one, without in zip(found, healthy, strict=True):
        assert np.max(np.abs(one["pump_pressure"][first])) > 2.0 * np.max(np.abs(without["pump_pressure"][first]))
        assert all(rms(one[name]) < LITTLE[name] for name in ("torque", "flow_a", "flow_b"))


def test_signals_that_were_not_logged_lead_nothing():
    """Without the pump's pressure the valve has that of the pump that runs beside it, and nothing is said of that."""
    recordings = recorded(Variants(MACHINE))
    for recording in recordings:
        del recording.channels["pump_pressure"]
    for one in followed(recordings):
        assert np.all(one["pump_pressure"] == 0.0)
        assert rms(one["torque"]) < LITTLE["torque"]


def test_twins_together_lack_what_each_lacks_alone():
    """To the bit: variants of one launch, and recordings of other lengths and commands."""
    recordings = recorded(Variants(MACHINE))
    gains = np.array([0.9, 1.0])
    both = followed(recordings, Variants.of(MACHINE, [(EFFECTS["valve_gain"], (gains,))], 2))
    for recording, together in zip(recordings, both, strict=True):
        for column, gain in enumerate(gains):
            (alone,) = followed([recording], Variants.of(MACHINE, [(EFFECTS["valve_gain"], (float(gain),))], 1))
            for name in LACKED:
                np.testing.assert_array_equal(together[name][:, column], alone[name][:, 0])


def test_free_twins_and_led_ones_share_a_list_of_requests():
    """What leads some twins leads no others."""
    recordings = recorded(Variants(MACHINE))
    assert set(recordings[0].channels) == set(FULL)
    alone = Simulator().run([Replay(Variants(MACHINE), one) for one in recordings])
    followed(recordings)
    for first, again in zip(alone, Simulator().run([Replay(Variants(MACHINE), o) for o in recordings]), strict=True):
        for name in FULL:
            np.testing.assert_array_equal(first[name], again[name])
