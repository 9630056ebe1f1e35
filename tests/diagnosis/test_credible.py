"""Logs beside the twin: what its machine can have made is believed, what no machine of the kind makes is not."""

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis.credible import BEYOND, FAR, SWING, credible
from aoro_gym.diagnosis.diagnose import diagnose
from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis.replay import Simulator, Variants
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import blank, record, turn

MACHINE = Machine.load("aoro")
LIMIT = float(np.max(MACHINE.joint.range))


@pytest.fixture(scope="module")
def good() -> Recording:
    """A left turn up to the stop, and a second and a half at rest there."""
    commands = np.vstack([turn(1.0, 3.4), np.zeros((110, 2))])
    return record(Variants(MACHINE), [blank("left", commands, -0.7)], np.random.default_rng(3))[0]


def believed(recording: Recording) -> tuple[list[Recording], str]:
    ((found,), said) = credible([[recording]], MACHINE, Simulator())
    return found, " ".join(said)


def changed(recording: Recording, **channels: np.ndarray) -> Recording:
    return replace(recording, channels={**recording.channels, **channels})


def test_a_good_log_is_believed_as_it_is(good):
    found, said = believed(good)
    assert said == "" and found[0].channels.keys() == good.channels.keys()


@pytest.mark.parametrize("which", list(EFFECTS))
def test_every_effect_of_the_catalogue_is_believed(which):
    """At either end of its range, in a full turn and in a slow one: a cause must not look like a broken sensor."""
    effect = EFFECTS[which]
    blanks = [blank("fast", turn(1.0, 2.6), -0.7), blank("slow", turn(-0.4, 4.0), 0.5)]
    for end in ("low", "high"):
        affected = Variants.of(MACHINE, [(effect, tuple(getattr(m, end) for m in effect.magnitudes))], 1)
        logs = record(affected, blanks, np.random.default_rng(4))
        assert credible([logs], MACHINE, Simulator())[1] == [], end


@pytest.mark.parametrize(
    ("factor", "left"), [(1.0, True), (1.4 / FAR, True), (0.7 / FAR, False), (np.pi / 180.0, False), (0.0, False)]
)
def test_a_joint_that_stands_under_its_commands_is_not_believed(good, factor, left):
    """A dead sensor, or radians in a column of degrees."""
    angle = good.channels["joint_angle"]
    found, said = believed(changed(good, joint_angle=angle[0] + factor * (angle - angle[0])))
    assert bool(found) is left
    assert ("radians or degrees" in said) is not left


def test_a_joint_beyond_its_stops_is_not_believed(good):
    angle = good.channels["joint_angle"]
    for off, left in ((0.8 * BEYOND, True), (1.2 * BEYOND, False)):
        found, said = believed(changed(good, joint_angle=angle + off))
        assert bool(found) is left and ("the joint ends at 42.5°" in said) is not left


def test_motion_without_a_command_is_not_believed(good):
    """Most of the command is missing: the joint goes on turning for seconds."""
    commands = good.commands.copy()
    commands[good.rest + 20 :] = 0.0
    found, said = believed(replace(good, commands=commands))
    assert not found and "where nothing is commanded" in said


@pytest.mark.parametrize(
    ("change", "left", "word"),
    [
        (lambda a, b, p: (5e5 + 0.0 * a, b, p), {"pump_pressure"}, "plugs"),
        (lambda a, b, p: (a, b, 5e5 + 0.0 * p), {"pressure_a", "pressure_b"}, "plugs"),
        (lambda a, b, p: (b, a, p), {"pump_pressure"}, "ports"),
        (lambda a, b, p: (0.1 * a, 0.1 * b, 0.1 * p), set(), "units"),
        (lambda a, b, p: (0.5 * a, b, p), {"pressure_a", "pressure_b", "pump_pressure"}, ""),
    ],
    ids=["not connected", "no pump", "swapped", "MPa", "half"],
)
def test_pressures_that_are_none_are_left_out(good, change, left, word):
    names = ("pressure_a", "pressure_b", "pump_pressure")
    assert np.ptp(good.channels["pressure_a"][:200]) > 2.0 * SWING
    values = change(*(good.channels[name] for name in names))
    (found,), said = believed(changed(good, **dict(zip(names, values, strict=True))))
    assert found.channels.keys() - {"joint_angle"} == left
    assert word in said and bool(said) is bool(word)


@pytest.mark.parametrize("bad", ["log", "healthy log"])
def test_without_a_log_that_can_be_believed_no_cause_is_named(good, bad):
    dead = changed(good, joint_angle=np.full(len(good.channels["joint_angle"]), -0.7))
    logs, healthy = ([dead], [good]) if bad == "log" else ([good], [dead])
    found = diagnose(logs, MACHINE, healthy=healthy)
    assert found.verdict == "inconclusive" and found.mode == "commissioned" and not found.causes
    assert "left was left out: the joint turns by 0°" in found.limitations[0]
    assert ("healthy" in found.limitations[1]) is (bad == "healthy log")
