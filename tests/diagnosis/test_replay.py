"""Replays: the twin itself, whatever it is batched with."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import (
    COARSE,
    FINE,
    FRAMES,
    SIGNALS,
    STILL,
    USUAL,
    Replay,
    Signals,
    Simulator,
    Steps,
    Variants,
)
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Twin
from tests.diagnosis.manoeuvres import blank, turn

BLANKS = [blank("left", turn(1.0, 1.5), -0.5), blank("right", turn(-0.6, 1.8), 0.3)]
MACHINE = Machine.load("aoro")


def replayed(*variants: Variants, blanks: list[Recording] = BLANKS) -> list[list[Signals]]:
    """What every one of ``variants`` gives, by recording."""
    found = iter(Simulator().run([Replay(one, recording) for recording in blanks for one in variants]))
    return [[next(found) for _ in variants] for _ in blanks]


def with_effect(name: str, *magnitudes: float) -> Variants:
    return Variants.of(MACHINE, [(EFFECTS[name], magnitudes)], 1)


def test_a_replay_is_the_twin_under_the_same_commands():
    """From shortly before the first of them; until then it stands."""
    for recording, (found,) in zip(BLANKS, replayed(Variants(MACHINE)), strict=True):
        still = Replay(Variants(MACHINE), recording).still
        assert still == recording.rest - STILL > 0
        twin = Twin(1, machine=MACHINE, main_step=USUAL.main, substeps=USUAL.substeps)
        twin.reset(joint_angle=recording.start_angle)
        rows = {name: [twin.state.numpy()[SIGNALS[name][1], 0]] * (1 + still) for name in recording.channels}
        for steering, drive in recording.commands[still:]:
            twin.step({"steering_signal": steering, "drive_signal": drive}, TICK)
            for name, row in rows.items():
                row.append(twin.output(name)[0])
        for name, row in rows.items():
            np.testing.assert_array_equal(found[name][:, 0], np.array(row, dtype=np.float32))


@pytest.mark.parametrize("effect", [None, ("joint_backlash", 0.01, 1e-7), ("cylinder_leakage", 2e-13)])
def test_what_stands_on_level_ground_needs_no_twin(effect, monkeypatch):
    """Begun at rest shortly before the first command it does what it does if it has stood all the time, but for a third of
    the 0.3 bar that usual steps are off by, and a tenth of the angle sensor's noise: in a play the joint creeps at rest."""
    one = with_effect(*effect) if effect else Variants(MACHINE)
    ((short,), _) = replayed(one)
    monkeypatch.setattr("aoro_gym.diagnosis.replay.STILL", 10_000)
    ((whole,), _) = replayed(one)
    for channel, values in whole.items():
        small = 1e-4 if channel == "joint_angle" else 0.1e5
        assert np.sqrt(np.mean((short[channel] - values) ** 2)) < small, channel


@pytest.mark.parametrize("tilted", [Variants(MACHINE, 1, Plane(slope_deg=2.0)), with_effect("ground_slope", 0.0, 0.0)])
def test_what_stands_on_a_slope_is_simulated_all_the_time(tilted):
    """Its ground gives way, and its oil leaks; what an effect says of the slope is not asked, lest it matter."""
    assert all(Replay(tilted, one).still == 0 for one in BLANKS)


@pytest.mark.parametrize("steps", [USUAL, FINE])
@pytest.mark.parametrize(("delay", "late_by"), [(0.012, 0.5), (0.013, 1.0)])
def test_a_replay_is_closer_to_what_converges_than_half_a_step_is_long(steps, delay, late_by):
    """Steps and substeps that are far shorter differ by less than if all came half a main step late, as what happens within
    one, blows against the stop among it, is felt at its end; by root mean squares. A command whose delay is half a step more
    than whole ones comes by halves in two steps, and a spool whose rate is limited leaves with the first: up to half a step
    sooner."""
    machine = MACHINE.set({"steering.valve.command_delay": delay})
    twin = Twin(1, machine=machine, main_step=FINE.main / 4.0, substeps=FINE.substeps // 2)
    for recording in BLANKS:
        (found,) = Simulator().run([Replay(Variants(machine), recording, steps)])
        twin.reset(joint_angle=recording.start_angle)
        rows: dict[str, list[float]] = {name: [] for name in recording.channels}
        for steering, drive in recording.commands:
            twin.step({"steering_signal": steering, "drive_signal": drive}, TICK)
            for name, row in rows.items():
                row.append(float(twin.output(name)[0]))
        for name, row in rows.items():
            late = steps.main / TICK * np.gradient(row)
            off = found[name][1:, 0] - row
            assert np.sqrt(np.mean(off**2)) < late_by * np.sqrt(np.mean(late**2)), name


@pytest.mark.parametrize(("effect", "magnitude"), [("spool_lag", 0.03), ("seal_friction", 1500.0)])
def test_what_an_effect_does_is_much_the_same_by_coarse_steps(effect, magnitude):
    """A step of Gauss and Newton on slopes that are off by a share e of them leaves e² of what it could gain: a twentieth at
    most."""
    pair = Variants(MACHINE), with_effect(effect, magnitude)

    def added(steps: Steps) -> list[Signals]:
        found = Simulator().run([Replay(one, BLANKS[0], steps) for one in pair])
        return [{name: found[1][name] - values for name, values in found[0].items()}]

    ((coarse,), (usual,)) = added(COARSE), added(USUAL)
    for channel, values in usual.items():
        assert np.linalg.norm(coarse[channel] - values) < np.sqrt(0.05) * np.linalg.norm(values), channel


def test_steps_of_either_kind_in_one_call():
    """Each as in a call of its own."""
    tasks = [Replay(Variants(MACHINE), BLANKS[0], steps) for steps in (USUAL, FINE, USUAL)]
    found = Simulator().run(tasks)
    for task, signals in zip(tasks, found, strict=True):
        (alone,) = Simulator().run([task])
        for name, values in alone.items():
            np.testing.assert_array_equal(signals[name], values, err_msg=name)
    assert np.any(found[0]["joint_angle"] != found[1]["joint_angle"]), "the steps are not those that were asked for"


def test_variants_do_not_depend_on_their_company():
    """Machines, planes and chains of different kinds in one launch give to the bit what each gives alone."""
    effects: list[tuple[str, tuple[Any, ...]]] = [
        ("spool_lag", (np.array([0.01, 0.03]),)),
        ("sensor_delay", (np.array([0.0, 0.02]),)),
        ("ground_slope", (np.array([0.0, 0.05]), np.array([0.02, 0.0]))),
    ]
    many = [Variants(MACHINE), *(Variants.of(MACHINE, [(EFFECTS[name], values)], 2) for name, values in effects)]
    together = replayed(*many)
    for number, (name, values) in enumerate(effects, start=1):
        for k in range(2):
            alone = replayed(with_effect(name, *(float(v[k]) for v in values)))
            for whole, (single,) in zip(together, alone, strict=True):
                for channel, found in whole[number].items():
                    np.testing.assert_array_equal(found[:, k], single[channel][:, 0], err_msg=name)


def test_a_measuring_chain_shows_what_was_a_while_ago():
    """A delay of three ticks, exact in samples of a fifth of a tick, of the angle alone."""
    delay = 3
    ((plain, delayed),) = replayed(Variants(MACHINE), with_effect("sensor_delay", delay * TICK), blanks=BLANKS[:1])
    np.testing.assert_allclose(delayed["joint_angle"][delay:], plain["joint_angle"][:-delay], rtol=1e-6)
    np.testing.assert_array_equal(delayed["joint_angle"][:delay], np.repeat(plain["joint_angle"][:1], delay, axis=0))
    np.testing.assert_array_equal(delayed["pressure_a"], plain["pressure_a"])


def test_the_chain_acts_on_dense_samples():
    """A delay between two and three ticks shows what lies between the two: within a tick the joint turns evenly, but for
    the bend that its acceleration gives, an eighth of the second difference at most."""
    ((two, three, between),) = replayed(
        *(with_effect("sensor_delay", n * TICK) for n in (2.0, 3.0, 2.4)), blanks=BLANKS[:1]
    )
    assert 2.4 * FRAMES == 12.0, "a whole number of samples"
    straight = 0.6 * two["joint_angle"] + 0.4 * three["joint_angle"]
    bend = np.abs(np.diff(two["joint_angle"], 2, axis=0)).max() / 8.0
    moved = np.abs(np.diff(two["joint_angle"], axis=0)).max()
    assert bend < 0.1 * moved, "a whole sample off would not show"
    np.testing.assert_allclose(between["joint_angle"], straight, atol=bend + 1e-7)


def test_behind_a_gain_the_joint_starts_where_its_sensor_shows_the_measured_angle():
    error = 0.03
    gain = 1.0 + error
    for recording, (found,) in zip(BLANKS, replayed(with_effect("sensor_gain", error)), strict=True):
        np.testing.assert_allclose(found["joint_angle"][0], recording.start_angle, rtol=1e-6)
        true = Twin(1, machine=MACHINE, main_step=USUAL.main, substeps=USUAL.substeps)
        true.reset(joint_angle=recording.start_angle / gain)
        for steering, drive in recording.commands:
            true.step({"steering_signal": steering, "drive_signal": drive}, TICK)
        # from starts that differ in the last bit of single precision
        np.testing.assert_allclose(found["joint_angle"][-1], gain * true.output("joint_angle"), atol=1e-5)


def test_batches_are_seamless(monkeypatch):
    factors = np.linspace(0.9, 1.1, 7)
    many = [Variants(MACHINE.scale({"steering.pump.margin": factors}), 7), Variants(MACHINE, 1, Plane(slope_deg=2.0))]
    whole = replayed(*many)
    monkeypatch.setattr("aoro_gym.diagnosis.replay.CPU_BATCH", 7)  # a launch each
    for one, other in zip(whole, replayed(*many), strict=True):
        for mine, theirs in zip(one, other, strict=True):
            for channel, found in mine.items():
                np.testing.assert_array_equal(found, theirs[channel])


def test_a_lost_variant_is_not_a_number(monkeypatch):
    """What diverges in a recording is NaN there, and its neighbours go on."""
    monkeypatch.setattr("aoro_gym.diagnosis.replay.CPU_BATCH", 1)  # every recording by itself
    launches = iter(np.arange(len(BLANKS)))
    diverged = [np.array([0, 0]), np.array([0, 1])]
    monkeypatch.setattr(Twin, "status_codes", property(lambda twin: wp.array(diverged[next(launches)], dtype=int)))
    pair = Variants(MACHINE.scale({"steering.pump.margin": np.array([0.9, 1.1])}), 2)
    finite = [{name: np.isfinite(rows) for name, rows in found.items()} for (found,) in replayed(pair)]
    whole = [by_name for by_name in finite if np.all([rows.all() for rows in by_name.values()])]
    assert len(whole) == 1
    (other,) = (by_name for by_name in finite if by_name is not whole[0])
    assert all(np.all(rows[:, 0]) and not np.any(rows[:, 1]) for rows in other.values())
