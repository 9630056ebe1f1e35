"""Logs of simulated days are what a twin gives, in whole units, whatever runs beside them."""

from __future__ import annotations

import numpy as np
import pytest

from aoro_gym.diagnosis.simulation import outsiders
from aoro_gym.diagnosis.simulation.days import CHAIN, Days
from aoro_gym.diagnosis.simulation.logs import CHANNELS, MAIN_STEP, SETTLE, SUBSTEPS, UNITS, Logs, simulate
from aoro_gym.diagnosis.simulation.manoeuvres import OTHERS, REST, SAMPLES, TICK, TURNS, draw, full_turn
from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.twin.records import pack


def plain(machines: list[Machine], outsider: tuple[int, ...]) -> Days:
    count = len(machines)
    zeros = np.zeros((count, 2))
    return Days(
        records=np.concatenate([pack(one) for one in machines]),
        joint_range=np.array([float(one.joint.range) for one in machines]),
        slope=zeros,
        chain=np.zeros((count, len(CHAIN))),
        kind=np.zeros(count, dtype=np.int8),
        effects=np.full((count, 2), -1, dtype=np.int16),
        outsider=np.array(outsider, dtype=np.int16),
        without=zeros,
        change=zeros,
        severity=zeros,
    )


@pytest.fixture(scope="module")
def machines() -> list[Machine]:
    shipped = Machine.load("aoro")
    return [shipped, shipped.with_laws("materials")]


@pytest.fixture(scope="module")
def logs(machines: list[Machine]) -> Logs:
    """One machine on two days of different laws, and on one whose valve gets another command; two manoeuvres."""
    rng = np.random.default_rng(1)
    held = outsiders.ALL.index("held_command")
    turns = [[full_turn(rng, 1.0, 1.0), OTHERS["pulse"](rng)]]
    return simulate(plain([*machines, machines[0]], (-1, -1, held)), turns)


def test_a_log_is_what_a_twin_gives(logs: Logs, machines: list[Machine]) -> None:
    rng = np.random.default_rng(1)
    turn = full_turn(rng, 1.0, 1.0)
    samples = logs.samples.numpy().reshape(3, 2, len(CHANNELS), SAMPLES)
    for day, machine in enumerate(machines):
        twin = Twin(machine=machine, choose_laws=True, main_step=MAIN_STEP, substeps=SUBSTEPS)
        twin.reset(joint_angle=turn.start * float(machine.joint.range))
        twin.step(duration=SETTLE)
        expected = [[float(twin.output(name)[0]) for name in CHANNELS]]
        for steering, _ in turn.commands[:200]:
            twin.step({"steering_signal": float(steering)}, TICK)
            expected.append([float(twin.output(name)[0]) for name in CHANNELS])
        got = samples[day, 0, :, :201].T * np.array(UNITS)
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=0.51 * np.array(UNITS).max())
        np.testing.assert_allclose(got[:, 0], np.array(expected)[:, 0], rtol=0.0, atol=0.51 * UNITS[0])


def test_a_valve_that_gets_another_command_moves_the_joint_elsewhere(logs: Logs) -> None:
    """What is logged is the command that was given."""
    samples = logs.samples.numpy().reshape(3, 2, len(CHANNELS), SAMPLES)
    assert logs.commands.shape == (1, 2, 2, SAMPLES - 1)
    assert np.abs(samples[2, 1, 0] - samples[0, 1, 0]).max() * UNITS[0] > 0.01
    assert not logs.diverged.any()


def test_manoeuvres_begin_at_rest_and_stay_within_bounds() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        for one in draw(rng, len(TURNS) + len(OTHERS)):
            assert one.commands.shape == (SAMPLES - 1, 2)
            assert np.all(one.commands[: round(REST / TICK)] == 0.0)
            assert np.all(np.abs(one.commands) <= 1.0)
            assert np.any(one.commands != 0.0)
            assert abs(one.start) <= 1.0
