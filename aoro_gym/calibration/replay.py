"""Twins that repeat logs: all commands of a log, on its ground and under the conditions that its manifest names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.recordings import CHANNELS, CUTOFF, FilteredLog
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.oil_and_hoses import COMMISSIONED_TEMPERATURE
from aoro_gym.machine import Machine
from aoro_gym.recording.logs import TICK
from aoro_gym.recording.manifest import Manifest
from aoro_gym.sensors.chain import low_pass
from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin

CHUNK = 50
"""Ticks after which it is told how far the twins are."""

ENGINE_SPEED = "engine.set_speed"


def under_conditions(machine: Machine, manifest: Manifest) -> Machine:
    """``machine`` with the engine's speed, the oil's temperature and the payload of a manifest.

    A machine file describes the machine at the temperature of :data:`COMMISSIONED_TEMPERATURE`.

    Raises:
        ValueError: names the manifest if the machine cannot be had under its conditions.
    """
    try:
        if manifest.engine_speed_rpm is not None:
            # not ``units.RPM``: pi / 30 rounded first gives other last bits
            machine = machine.set({ENGINE_SPEED: manifest.engine_speed_rpm * np.pi / 30.0}, si=True, check_ranges=False)
        if manifest.oil_temperature_C is not None:
            warmer = manifest.oil_temperature_C - COMMISSIONED_TEMPERATURE
            machine = EFFECTS["oil_temperature"].apply(machine, warmer) if warmer else machine
        if manifest.payload_kg:
            machine = EFFECTS["payload"].apply(machine, manifest.payload_kg)
    except ValueError as error:
        raise ValueError(f"manifest {manifest.path}: {error}") from None
    return machine


def repeat(
    machine: Machine,
    recording: FilteredLog,
    *,
    device: str = "cpu",
    progress: Callable[[float], None] = lambda seconds: None,
) -> dict[str, NDArray[np.float64]]:
    """What the twins of ``machine`` (N variants) log under a recording's commands: (F, N) SI a channel, low-passed.

    Args:
        machine: N variants; those that diverge give NaN.
        recording: Commands, start and conditions.
        device: Where the twins run.
        progress: Called with the simulated twin-seconds since the last call.
    """
    count = machine.num_variants
    twin = Twin(
        count,
        machine=under_conditions(machine, recording.manifest),
        terrain=None if recording.manifest.ground is None else Plane(**recording.manifest.ground),
        device=device,
        check_step=False,
    )
    limit = np.asarray(machine.joint.range)
    twin.reset(joint_angle=np.clip(recording.start_angle, -limit, limit))
    if recording.manifest.gear is not None:
        twin.set_commands({"gear": recording.manifest.gear})
    state = twin.state.numpy().copy()  # on the CPU the array is the memory that the twins go on with
    parts = {name: [state[CHANNELS[name].state][None]] for name in recording.channels}
    for begin, end, commands in _stretches(recording):
        # the sample at a tick shows what the commands before it have done
        trace = twin.step(commands, round((end - begin) * TICK, 6), sample_every=TICK)
        assert trace is not None
        for name, part in parts.items():
            part.append(trace[name])
        progress((end - begin) * TICK * count)
    diverged = twin.status != 0
    out = {}
    for name, part in parts.items():
        values = np.concatenate(part).astype(np.float64)
        values[:, diverged] = 0.0
        out[name] = low_pass(values, rate=1.0 / TICK, cutoff=CUTOFF)
        out[name][:, diverged] = np.nan
    return out


def _stretches(recording: FilteredLog) -> Iterator[tuple[int, int, dict[str, float]]]:
    """Ticks from which and up to which commands hold, none longer than :data:`CHUNK`."""
    names = list(recording.commands)
    held = np.stack([recording.commands[name] for name in names], axis=1)
    last = len(held) - 1
    changes = np.flatnonzero(np.any(np.diff(held[:last], axis=0), axis=1)) + 1
    edges = np.unique(np.r_[0, changes, np.arange(0, last, CHUNK), last])
    for begin, end in pairwise(edges.tolist()):
        yield begin, end, dict(zip(names, held[begin].tolist(), strict=True))
