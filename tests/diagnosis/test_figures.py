"""Key figures of logs: which are full turns, and the same figures as a validation reads."""

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis.figures import full_turn, key_figures
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import FINE, Replay, Simulator, Variants
from aoro_gym.diagnosis.result import Curve
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.simulation import key_figures as published
from aoro_gym.simulation.key_figures import FIGURES
from tests.diagnosis.manoeuvres import turn

MACHINE = Machine.load("aoro")
REACH = float(np.asarray(MACHINE.joint.range))


def log(steering, start, drive=0.0):
    commands = np.stack([steering, np.full(len(steering), drive)], axis=1)
    return Recording("log", commands, {}, 30, start)


TURN = np.r_[np.zeros(30), np.full(200, 0.75), np.zeros(50)]


@pytest.mark.parametrize(
    ("recording", "arrival", "level"),
    [
        (log(TURN, -REACH), 200, 0.75),
        (log(-TURN, REACH + 0.01), 200, -0.75),
        (log(TURN, REACH), 200, 0.0),  # starts at the stop that it would turn to
        (log(TURN, -0.5), 200, 0.0),
        (log(TURN, -REACH), -1, 0.0),
        (log(TURN, -REACH, drive=0.5), 200, 0.0),
        (log(np.r_[TURN, 0.5 * TURN], -REACH), 200, 0.0),
        (log(np.r_[TURN, TURN], -REACH), 200, 0.0),  # with a pause
    ],
)
def test_full_turns_are_known(recording, arrival, level):
    assert full_turn(recording, arrival, REACH) == level


def curve(name, measured, before, after):
    time = TICK * np.arange(len(measured))
    return Curve(name, "joint_angle", False, time, measured, before, after, np.zeros(len(measured)))


def test_figures_are_those_of_a_validation():
    """A log that the twin made itself has the figures of the published definition. A repeat that stands still for three
    samples underway moves the measured mean time by one and a half."""
    steering = turn(1.0, 3.6)
    empty = Recording("1", steering, {"joint_angle": np.zeros(len(steering) + 1)}, 60, -REACH)
    lagging = Variants.of(MACHINE, [(EFFECTS["spool_lag"], (0.03,))], 1)
    angle, slower = (
        one["joint_angle"][:, 0].astype(np.float64)
        for one in Simulator().run([Replay(Variants(MACHINE), empty, FINE), Replay(lagging, empty, FINE)])
    )
    late = np.insert(angle, 90, [angle[90]] * 3)[: len(angle)]
    logs = [replace(empty, name=str(k), channels={"joint_angle": one}) for k, one in enumerate((angle, late))]
    curves = [curve(one.name, one.channels["joint_angle"], angle, slower) for one in logs]
    plain, both = (key_figures(logs[:count], curves, MACHINE) for count in (1, 2))
    figures = plain["left, 100 %"]
    assert tuple(figures) == FIGURES
    exact = published.key_figures(TICK * np.arange(len(angle)), angle, MACHINE)
    assert exact["turn_time_s"] and exact["mean_flow_L_per_min"]
    later = TICK / exact["turn_time_s"]
    for name, values in figures.items():  # a log's stop is where it rests, which may be reached a sample later
        sample = {"turn_time_s": TICK, "mean_flow_L_per_min": later * exact["mean_flow_L_per_min"]}.get(name, 0.0)
        assert values["measured"] == values["before"] == pytest.approx(exact[name], rel=2e-3, abs=sample), name
    once, mean = (one["left, 100 %"]["turn_time_s"] for one in (plain, both))
    assert once["measured"] is not None and once["after"] is not None and once["after"] > once["measured"]
    assert mean["measured"] == pytest.approx(once["measured"] + 1.5 * TICK)


def test_without_a_full_turn_there_is_none():
    other = Recording("half", turn(1.0, 2.0), {"joint_angle": np.zeros(201)}, 60, 0.0)
    assert key_figures([other], [curve("half", *np.zeros((3, 201)))], MACHINE) == {}
