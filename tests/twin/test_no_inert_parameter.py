"""No parameter is inert: each changes what the twin does in one of a few manoeuvres, or says why it cannot.

Every manoeuvre is one batch: twin 0 and the last one are the machine itself, each twin between has one parameter scaled.
The twin is deterministic, so two equal machines log equal bits, and any difference at all is the parameter's; 1e-5 of a
channel's range, some hundred float32 roundings, keeps out a parameter that only stirs the last bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from aoro_gym.machine.laws import LAWS
from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.twin.rig import Log, all_wheels, drive

SEEN = 1e-5
"""Share of a channel's range from which a difference counts."""
FRAME = 0.02
"""Time [s] between frames."""
FROM_ZERO = {
    "oil.gas_fraction": 0.002,
    "joint.backlash": 0.002,
    "joint.compliance": 1e-7,
    "tire.scrub_radius": 0.02,
    "steering.valve.overlap": 0.05,
    "steering.valve.cross_port_leakage": 1.0,
    "steering.tank_line.throttle_drop": 5.0,
    "engine.droop": 0.02,
}
"""Values [file unit] for parameters that are zero and cannot be scaled."""


def varied(machine: Machine, keys: Sequence[str]) -> Machine:
    """Batch of ``len(keys) + 2`` machines; number i + 1 has ``keys[i]`` raised by a fifth, or lowered where it must."""
    values = {}
    for index, key in enumerate(keys):
        value = machine.entries[key].value
        row = np.full(len(keys) + 2, value)
        row[index + 1] = FROM_ZERO.get(key, 1.2 * value)
        try:
            machine.set({key: row[index + 1]})
        except ValueError:  # an efficiency above one, a static friction below the sliding one
            row[index + 1] = value / 1.2
        assert row[index + 1] != value, f"{key} is zero: give it a value in FROM_ZERO"
        values[key] = row
    return machine.set(values)


# ----------------------------------------------------------------------------------------------------------- manoeuvres
def steer(machine: Machine, **options) -> Log:
    """Full turns into both stops, released and reversed, then parts of the signal either way."""
    twin = Twin(machine.num_variants, machine=machine, **options)
    twin.reset(joint_angle=-machine.joint.range)
    signals = ((0.2, 0.0), (2.4, 1.0), (0.3, 0.0), (2.5, -1.0), (0.2, 0.0), (0.7, 0.45), (0.5, 0.65), (0.4, 0.85))
    signals += ((0.3, 0.0), (0.7, -0.45), (0.5, -0.65), (0.4, -0.85), (0.3, 0.0))
    return drive(twin, *((t, {"steering_signal": u}) for t, u in signals), sample_every=FRAME)


def begin(machine: Machine, **options) -> Log:
    """A second of everything at once, which shows most parameters: the others alone go through the long manoeuvres."""
    twin = Twin(machine.num_variants, machine=machine, **options)
    at_once = {"steering_signal": 1.0, "drive_signal": 0.5, "arm_fl": 0.6, "arm_rr": -0.6}
    return drive(twin, (0.7, at_once), (0.4, {"steering_signal": -1.0, "drive_signal": 0.0}), sample_every=FRAME)


def shift(machine: Machine, **options) -> Log:
    """Up a slope through the gears, one wheel throttled, in reverse, to a halt, and parked."""
    twin = Twin(machine.num_variants, machine=machine, terrain=Plane(slope_deg=8.0), **options)
    phases = (
        (1.8, {"drive_signal": 1.0}),
        (1.0, {"gear": 2.0}),
        (1.6, {"gear": 3.0}),
        (0.6, {"traction_fl": 0.2}),
        (1.2, {"gear": 1.0, "traction_fl": 1.0}),
        (2.4, {"drive_signal": -1.0}),
        (0.8, {"drive_signal": 0.0}),
        (0.6, {"parking_brake": 1.0}),
    )
    return drive(twin, *phases, sample_every=FRAME)


def lift(machine: Machine, **options) -> Log:
    """All arms down into their stops (the frame goes up), then up, then one side against the other."""
    twin = Twin(machine.num_variants, machine=machine, **options)
    tilt = dict(zip((f"arm_{wheel}" for wheel in WHEELS), (1.0, -1.0, 1.0, -0.5), strict=True))
    phases = ((1.8, all_wheels("arm", 1.0)), (3.6, all_wheels("arm", -1.0)), (1.4, tilt), (0.4, all_wheels("arm", 0.0)))
    return drive(twin, *phases, sample_every=FRAME)


def stall(machine: Machine, **options) -> Log:
    """Against the parking brakes on a steep slope: up to the relief valves, then so far that the engine lugs at full
    load; let go, so that it races; and stalled."""
    twin = Twin(machine.num_variants, machine=machine, terrain=Plane(slope_deg=20.0), **options)
    phases = (
        (1.6, {"parking_brake": 1.0, "drive_signal": 0.55}),
        (1.2, {"drive_signal": 0.7}),
        (0.6, {"parking_brake": 0.0}),
        (0.5, {"parking_brake": 1.0, "drive_signal": 0.0}),
        (1.3, {"drive_signal": 1.0}),
    )
    return drive(twin, *phases, sample_every=FRAME)


def fall(machine: Machine, **options) -> Log:
    """Dropped on its side, sliding: frames' corners hit the ground."""
    twin = Twin(machine.num_variants, machine=machine, **options)
    state, half = twin.state.numpy(), 0.5 * np.radians(75.0)
    state[State.Z] += 2.2
    state[State.QX], state[State.QW] = np.sin(half), np.cos(half)
    state[State.VX] += 2.0
    state[State.WY] += 0.2
    twin.state.assign(state)
    return drive(twin, (1.6, {}), sample_every=FRAME)


CALM = (begin, steer, shift, lift, stall)
BODIES = ("frame.", "hull.", "arm.", "wheel.", "tire.")
"""Whose parameters the fall may show: a tumbling machine tells everything apart, in the end."""


def differences(log: Log, scale: np.ndarray) -> np.ndarray:
    """Largest difference from twin 0 in any channel, over the channel's ``scale``: one number a twin."""
    values = log.values.astype(float)
    gap = np.abs(values - values[..., :1]).max(axis=0)
    return (gap / np.where(scale > 0.0, scale, np.inf)[:, None]).max(axis=0)


def spans(logs: Sequence[Log]) -> np.ndarray:
    """Range of every channel of twin 0 over all ``logs``."""
    low = np.min([log.values[..., 0].min(axis=0) for log in logs], axis=0)
    high = np.max([log.values[..., 0].max(axis=0) for log in logs], axis=0)
    return (high - low).astype(float)


def strength(machine: Machine, keys: Sequence[str], manoeuvres: Sequence[Callable[..., Log]]) -> dict[str, float]:
    """What each parameter changes, as a share of a channel's range, in the first manoeuvre that shows it or at most."""
    scale = spans([manoeuvre(machine) for manoeuvre in manoeuvres])
    best = dict.fromkeys(keys, 0.0)
    for manoeuvre in manoeuvres:
        left = [key for key in keys if best[key] <= SEEN and (manoeuvre is not fall or key.startswith(BODIES))]
        log = manoeuvre(varied(machine, left))
        assert np.array_equal(log.values[..., 0], log.values[..., -1]), "equal machines must log equal bits"
        for key, value in zip(left, differences(log, scale)[1:-1], strict=True):
            best[key] = max(best[key], float(value))
    return best


# ---------------------------------------------------------------------------------------------------------------- tests
SPECIAL: Mapping[str, tuple[Mapping[str, float], Callable[..., Log]]] = {
    "oil.polytropic_exponent": ({"oil.gas_fraction": 0.005}, steer),
    "tire.scrub_angle": ({"tire.scrub_radius": 0.1}, steer),
    "engine.torque.rpm_2000": ({"engine.set_speed": 2350.0}, stall),
    "engine.torque.rpm_2200": ({"engine.set_speed": 2350.0}, stall),
    "engine.torque.rpm_2400": ({"engine.set_speed": 2350.0}, stall),
}
"""Settings [file units] and manoeuvre in which a parameter shows that its note declares inert."""


def declared(machine: Machine) -> set[str]:
    """Parameters whose note begins with "inert:"; the rest of the note says why."""
    return {entry.key for entry in machine.parameters() if entry.note.startswith("inert:")}


def test_every_parameter_shows_or_says_why_not(machine):
    # those: in the tests of laws and of the load below
    keys = [e.key for e in machine.parameters() if e.role != "law" and not e.key.startswith(PAYLOAD)]
    best = strength(machine, keys, (*CALM, fall))
    silent = {key for key, value in best.items() if value <= SEEN}
    assert silent == declared(machine)


@pytest.mark.parametrize("key", SPECIAL)
def test_declared_parameters_show_where_they_matter(machine, key):
    settings, manoeuvre = SPECIAL[key]
    best = strength(machine.set(settings), [key], (manoeuvre,))
    assert best[key] > SEEN


def test_every_declared_parameter_has_its_own_setting(machine):
    assert declared(machine) == set(SPECIAL)


def haul(machine: Machine, **options) -> Log:
    """Ten logs that slide: parked on a slope steeper than their friction, then the other way into the stop."""
    slope = Plane(slope_deg=20.0)
    twin = Twin(machine.num_variants, machine=machine, terrain=slope, **options)
    first = drive(twin, (1.5, {"parking_brake": 1.0}), sample_every=FRAME)
    twin.reset(heading=np.pi)
    second = drive(twin, (1.5, {"parking_brake": 1.0, "steering_signal": 0.5}), sample_every=FRAME)
    return first.then(second)


def test_every_parameter_of_a_load_shows(machine):
    laden = machine.set({"payload.count": 10.0, "payload.friction": 0.25})
    keys = [entry.key for entry in machine.parameters() if entry.key.startswith(PAYLOAD)]
    best = strength(laden, keys, (haul,))
    assert all(value > SEEN for value in best.values()), best


def soft(machine: Machine, **options) -> Log:
    """The turns of :func:`steer` on ground that yields."""
    return steer(machine, terrain=Plane(rolling_resistance=4.0), **options)


OF_LAWS = {(law, option): keys for law, one in LAWS.items() for option, keys in one.parameters.items()}
"""Parameters that an option of a law alone has."""

WITH: Mapping[tuple[str, str], Mapping[str, float]] = {
    ("gas", "dissolving"): {"oil.gas_fraction": 0.005},
    ("mount", "hardening"): {"joint.compliance": 1e-7},
}
"""Settings [file units] without which an option has nothing to act on."""


def test_every_parameter_of_a_law_belongs_to_an_option(machine):
    assert {key for keys in OF_LAWS.values() for key in keys} == {
        e.key for e in machine.parameters() if e.role == "law"
    }


@pytest.mark.parametrize("chosen", OF_LAWS, ids="=".join)
def test_parameters_of_a_law_show_where_it_is_chosen(machine, chosen):
    law, option = chosen
    other = machine.with_laws(**{law: option}).set(WITH.get(chosen, {}))
    best = strength(other, OF_LAWS[chosen], ({"soft_ground": soft, "arm_valve": lift}.get(law, steer),))
    assert all(value > SEEN for value in best.values()), best


def test_a_rerun_gives_the_same_bits(machine):
    """What the comparison rests on; in a batch and alone."""
    alone, again = stall(machine), stall(machine)
    assert np.array_equal(alone.values, again.values)
    batch = stall(varied(machine, ["tire.radius"]))
    assert np.array_equal(alone.values[..., 0], batch.values[..., 0])
    assert not np.array_equal(alone.values[..., 0], batch.values[..., 1])
