"""Replays: the twin itself, whatever it is batched with."""

from typing import Any

import numpy as np

from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.replay import SIGNALS, Replay, Variants
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Machine, Twin
from aoro_gym.twin.effects import EFFECTS
from tests.diagnosis.manoeuvres import blank, turn

BLANKS = [blank("left", turn(1.0, 1.5), -0.5), blank("right", turn(-0.6, 1.8), 0.3)]
MACHINE = Machine.load("aoro")


def test_a_replay_is_the_twin_under_the_same_commands():
    for recording, found in zip(BLANKS, Replay(BLANKS).run([Variants(MACHINE)]), strict=True):
        twin = Twin(1, machine=MACHINE)
        twin.reset(joint_angle=recording.start_angle)
        rows = {name: [twin.state.numpy()[SIGNALS[name][1], 0]] for name in recording.channels}
        for steering, drive in recording.commands:
            twin.step({"steering_signal": steering, "drive_signal": drive}, TICK)
            for name, row in rows.items():
                row.append(twin.output(name)[0])
        for name, row in rows.items():
            np.testing.assert_array_equal(found[name][:, 0], np.array(row, dtype=np.float32))


def test_variants_do_not_depend_on_their_company():
    """Machines, planes and chains of different kinds in one launch give to the bit what each gives alone."""
    effects: list[tuple[str, tuple[Any, ...]]] = [
        ("spool_lag", (np.array([0.01, 0.03]),)),
        ("sensor_delay", (np.array([0.0, 0.02]),)),
    ]
    effects.append(("ground_slope", (np.array([0.0, 0.05]), np.array([0.02, 0.0]))))
    many = [Variants(MACHINE)]
    many += [Variants.of(MACHINE, [(EFFECTS[name], values)], 2) for name, values in effects]
    together = Replay(BLANKS).run(many)
    first = 1
    for name, values in effects:
        for k in range(2):
            one = Variants.of(MACHINE, [(EFFECTS[name], tuple(float(v[k]) for v in values))], 1)
            alone = Replay(BLANKS).run([one])
            for whole, single in zip(together, alone, strict=True):
                for channel in whole:
                    np.testing.assert_array_equal(whole[channel][:, first + k], single[channel][:, 0], err_msg=name)
        first += 2


def test_batches_are_seamless(monkeypatch):
    factors = np.linspace(0.9, 1.1, 7)
    many = [Variants(MACHINE.scale({"steering.pump.margin": factors}), 7), Variants(MACHINE, 1, Plane(slope_deg=2.0))]
    whole = Replay(BLANKS).run(many)
    monkeypatch.setattr("aoro_gym.diagnosis.replay.BATCH", 6)  # three machines a launch
    for one, other in zip(whole, Replay(BLANKS).run(many), strict=True):
        for channel in one:
            np.testing.assert_array_equal(one[channel], other[channel])


def test_a_lost_variant_is_not_a_number(monkeypatch):
    """What the twin has lost in any recording is NaN there, and its neighbours go on."""
    lost = 2 * len(BLANKS) - 1  # the second variant in the last recording
    monkeypatch.setattr(Twin, "status", property(lambda twin: np.arange(twin.num_twins) == lost))
    *kept, last = Replay(BLANKS).run([Variants(MACHINE.scale({"steering.pump.margin": np.array([0.9, 1.1])}), 2)])
    assert all(np.all(np.isfinite(found["joint_angle"])) for found in kept)
    assert np.all(np.isfinite(last["joint_angle"][:, 0]))
    assert np.all(np.isnan(last["joint_angle"][:, 1]))
