"""Logs of simulated days: what exact sensors would show while machines do their manoeuvres, on the device.

All days of a machine do the same manoeuvres. Samples stay on the device as 16-bit integers in units of :data:`UNITS`, finer
than any sensor resolves.
"""

# pyright: reportInvalidTypeForm=false
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.diagnosis.simulation import outsiders
from aoro_gym.diagnosis.simulation.days import Days, planes
from aoro_gym.diagnosis.simulation.manoeuvres import CHANNELS, SAMPLES, TICK, Manoeuvre
from aoro_gym.machine import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.records import Command, MachineRecord, Output, State

_OUTPUTS = (Output.JOINT_ANGLE, Output.PRESSURE_A, Output.PRESSURE_B, Output.PUMP_PRESSURE)
_STATES = (State.JOINT, State.PORT_A, State.PORT_B, State.SUPPLY)
UNITS = (2.5e-5, 1.5e3, 1.5e3, 1.5e3)
"""Of the channels' samples: [rad] and [Pa]."""
COMMANDS = (Command.STEERING_SIGNAL, Command.DRIVE_SIGNAL)

MAIN_STEP, SUBSTEPS = 2e-3, 30
"""[s], and hydraulic steps within it: pressures are off by about 0.3 bar, what effects do to them by one or two per cent."""
SETTLE = 0.4
"""Time [s] that twins stand before their log begins: on a slope they settle."""
STRETCH = 16
"""Ticks a launch."""
BATCH, CPU_BATCH = 131072, 2048
"""Twins that run together on a GPU and on a CPU."""


@dataclass(frozen=True)
class Logs:
    """Samples of M machines on D days doing J manoeuvres each.

    Attributes:
        samples: int16 on the device, (M · D · J, channels, SAMPLES), in :data:`UNITS`.
        commands: As logged (M, J, 2, SAMPLES − 1).
        diverged: Whether a twin diverged (M, D, J); its samples mean nothing.
    """

    samples: wp.array
    commands: NDArray[np.float32]
    diverged: NDArray[np.bool_]


@wp.kernel(enable_backward=False)
def _hold(
    schedule: wp.array3d(dtype=float), which: wp.array(dtype=int), first_tick: int, commands: wp.array3d(dtype=float)
):
    """Commands of a stretch, from the schedules (S, ticks, rows) that twins follow by number."""
    tick, row, t = wp.tid()  # pyright: ignore
    target = wp.where(row == 0, wp.static(int(COMMANDS[0])), wp.static(int(COMMANDS[1])))
    commands[tick, target, t] = schedule[which[t], first_tick + tick, row]


@wp.func
def _whole(value: float, channel: int) -> wp.int16:
    unit = wp.where(channel == 0, wp.static(UNITS[0]), wp.static(UNITS[1]))
    return wp.int16(wp.clamp(wp.round(value / unit), -32767.0, 32767.0))


@wp.kernel(enable_backward=False)
def _keep(
    values: wp.array3d(dtype=float), rows: wp.array(dtype=int), first: int, last: int, kept: wp.array3d(dtype=wp.int16)
):
    """Samples (frames, rows, N) of a stretch into (N, channels, SAMPLES)."""
    frame, channel, t = wp.tid()  # pyright: ignore
    if first + frame < last:
        kept[t, channel, first + frame] = _whole(values[frame, rows[channel], t], channel)


def simulate(
    days: Days,
    manoeuvres: Sequence[Sequence[Manoeuvre]],
    *,
    seed: int = 0,
    device: str = "cpu",
    progress: Callable[[int, int], Any] = lambda done, total: None,
) -> Logs:
    """Logs of ``days``.

    Args:
        days: (M · D,) machine by machine.
        manoeuvres: J of each of the M machines.
        seed: Of what outsiders do to commands.
        device: Of the twins.
        progress: Called with the number of twins that are done, in shares of those that are simulated, and of all.
    """
    machines, each = len(manoeuvres), len(manoeuvres[0])
    later = len(days.kind) // machines
    commands = np.stack([[one.commands.T for one in own] for own in manoeuvres])
    start = np.array([[one.start for one in own] for own in manoeuvres])
    rng = np.random.default_rng(seed)
    samples = wp.zeros((machines * later * each, len(CHANNELS), SAMPLES), dtype=wp.int16, device=device)
    diverged = np.zeros((machines, later, each), dtype=bool)
    batch = BATCH if wp.get_device(device).is_cuda else CPU_BATCH
    stride = max(batch // (later * each), 1)
    for first in range(0, machines, stride):
        own = slice(first, min(first + stride, machines))
        rows = slice(own.start * later, own.stop * later)
        into: Any = samples[own.start * later * each : own.stop * later * each]
        outsider = days.outsider[rows].reshape(-1, later)
        told = schedules(commands[own], outsider, lambda machine, day: int(rng.integers(2**63)))
        angle = (start[own][:, None] * days.joint_range[rows].reshape(-1, later, 1)).ravel()
        records, slope = np.repeat(days.records[rows], each), np.repeat(days.slope[rows], each, axis=0)
        begun, count = own.start * later * each, len(records)

        def done(share: float, begun: int = begun, count: int = count) -> None:
            progress(begun + int(share * count), len(samples))

        status = follow(records, planes(slope), angle, *told, _keeper(into, done), device=device)
        diverged[own] = status.reshape(-1, later, each) != 0
    return Logs(samples, commands, diverged)


def schedules(
    commands: NDArray[np.float32], outsider: NDArray[np.int16], seed_of: Callable[[int, int], int]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Commands (S, ticks, 2) as valves get them, and their numbers by twin (M D J): those of a machine's manoeuvres
    (M, J, 2, ticks) on all its days (M, D), but for days whose ``outsider`` lies in the command: these draw what it does
    with the seed of their machine and day."""
    machines, each, _, ticks = commands.shape
    later = outsider.shape[1]
    own = commands.transpose(0, 1, 3, 2).reshape(machines * each, ticks, 2)
    which = np.broadcast_to(np.arange(machines * each).reshape(machines, 1, each), (machines, later, each)).copy()
    first = len(outsiders.MACHINE) + len(outsiders.DRAWN)
    kinds = list(outsiders.COMMAND.values())
    other = []
    for m, d in np.argwhere((outsider >= first) & (outsider < first + len(kinds))):
        deviates, state = kinds[outsider[m, d] - first], seed_of(int(m), int(d))
        for j in range(each):
            told = own[m * each + j].copy()
            told[:, 0] = deviates(told[:, 0].astype(np.float64), np.random.default_rng(state))
            which[m, d, j] = machines * each + len(other)
            other.append(told)
    return (np.concatenate([own, np.stack(other)]) if other else own), which.ravel().astype(np.int32)


def _keeper(into: wp.array, done: Callable[[float], Any]) -> Callable[[wp.array, wp.array, int], None]:
    """Keeps samples (N, channels, SAMPLES) of twins; ``done`` is told which share of them are there."""

    def keep(values: wp.array, rows: wp.array, first: int) -> None:
        count = (len(values), len(CHANNELS), values.shape[2])
        wp.launch(_keep, count, [values, rows, first, SAMPLES, into], device=into.device)
        done(min((first + len(values)) / SAMPLES, 1.0))

    return keep


def follow(
    records: NDArray[np.void],
    plane: Plane,
    angle: NDArray[np.float64],
    schedule: NDArray[np.float32],
    which: NDArray[np.int32],
    keep: Callable[[wp.array, wp.array, int], object],
    *,
    device: str,
) -> NDArray[np.int32]:
    """Simulate twins (N,) that do as they are told; their status codes.

    Args:
        records: Of the twins.
        plane: Under each of them.
        angle: Joint angles [rad] at the beginning.
        schedule: Commands (S, ticks, 2).
        which: Number in ``schedule`` of each twin.
        keep: Called with values (frames, rows, N) on the device, which of the rows are :data:`CHANNELS`, and the number of
            the first frame; the last call may go beyond the last sample.
        device: Of the twins.
    """
    count, ticks = len(records), schedule.shape[1]
    twin = Twin(
        count, machine=any_machine(), terrain=plane, own_machines=True, choose_laws=True,
        carry_load=bool(np.any(records["payload"]["mass"])), device=device,
        main_step=MAIN_STEP, substeps=SUBSTEPS, check_step=False,
    )  # fmt: skip
    twin.machines.assign(wp.array(records, dtype=MachineRecord, device=device))
    limit = float(np.max(any_machine().joint.range))
    twin.reset(joint_angle=np.clip(angle, -limit, limit))
    stretches = -(-ticks // STRETCH)
    padded = np.zeros((len(schedule), stretches * STRETCH, len(COMMANDS)), dtype=np.float32)
    padded[:, :ticks] = schedule
    held = wp.array(padded, dtype=float, device=device)
    numbers = wp.array(which, dtype=int, device=device)
    told = wp.empty((STRETCH, *twin.commands.shape), dtype=float, device=device)
    for tick in range(STRETCH):
        part: Any = told[tick]
        wp.copy(part, twin.commands)
    twin.advance(SETTLE)
    state_rows = wp.array([int(row) for row in _STATES], dtype=int, device=device)
    keep(twin.state.reshape((1, *twin.state.shape)), state_rows, 0)
    advance = twin.advancing(STRETCH * TICK, sample_every=TICK, commands=told)
    rows = wp.array([int(row) for row in _OUTPUTS], dtype=int, device=device)
    for stretch in range(stretches):
        first = stretch * STRETCH
        wp.launch(_hold, (STRETCH, len(COMMANDS), count), [held, numbers, first, told], device=device)
        advance(0, count)
        keep(twin.outputs, rows, first + 1)
    return np.asarray(twin.status_codes.numpy(), dtype=np.int32)


@cache
def any_machine() -> Machine:
    """A machine in whose place the records of others come; its joint reaches as far as any range allows."""
    widest = Machine.load("aoro")
    return widest.set({"joint.range": widest.entries["joint.range"].range[1]}, check_ranges=False)
