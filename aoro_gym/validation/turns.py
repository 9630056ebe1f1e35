"""The runs that a validation looks at: full turns at standstill, and a straight drive, many twins in one launch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine import Machine
from aoro_gym.machine.laws import Laws
from aoro_gym.sensors.chain import turn_flow
from aoro_gym.simulation.key_figures import TOLERANCE
from aoro_gym.twin import Trace, Twin
from aoro_gym.twin.records import WHEELS

REST_BEFORE = 0.6
"""Standstill [s] before the signal's step: the machine settles, and the filter needs half a second."""
REST_AFTER = 0.7
"""Standstill [s] recorded after the last turn has reached its stop."""
LONGEST_TURN = 30.0
"""Time [s] after which a turn that has not reached its stop is given up."""
CHUNK = 0.5
"""Simulated time [s] of one launch."""

RECORDED = ("joint_angle", "joint_rate", "pressure_a", "pressure_b")
"""Channels that a recording of turns keeps."""

DRIVE_SETTLE, DRIVE_MEAN = 8.0, 1.0
"""Time [s] that the driveline takes to become steady, and that its pressure is averaged over."""


RIM_TURN = 1.8
"""Time [s] of a full left turn in which the wheels are watched: up to short of the stop, whose bounce is no turn."""


@dataclass(frozen=True)
class Turn:
    """A full turn from the opposite stop, at standstill."""

    direction: str  # "left" or "right"
    signal_percent: float

    @property
    def sign(self) -> int:
        """+1 left, -1 right."""
        return 1 if self.direction == "left" else -1

    @property
    def title(self) -> str:
        return f"{self.direction.capitalize()} turn, {self.signal_percent:g} % signal"


TURNS = tuple(Turn(direction, percent) for direction in ("left", "right") for percent in (100.0, 75.0, 50.0))
"""The published levels, to both sides."""


@dataclass(frozen=True, eq=False)
class TurnRecording:
    """T turns of V machines, exact: no sensor, no filter."""

    turns: tuple[Turn, ...]
    machine: Machine  # T x V variants, turn by turn; or one for all
    time: NDArray[np.float64]  # [s] (F,)
    angle: NDArray[np.float64]  # [rad] (F, T, V)
    flow: NDArray[np.float64]  # [m³/s] (F, T, V), positive in the direction of the turn
    pressures: tuple[NDArray[np.float32], NDArray[np.float32]]  # [Pa] (F, T, V) of ports A and B
    diverged: tuple[tuple[int, int, str], ...]  # turn, machine and reason of each twin that was frozen


def stacked(machines: Sequence[Machine]) -> Machine:
    """One machine whose variants are those of ``machines``, in order."""
    first = machines[0]
    counts = [machine.num_variants for machine in machines]
    if sum(counts) == 1:
        return first
    laws = Laws.stacked([machine.laws for machine in machines], counts)
    values = {}
    for key in first.entries:
        si = [np.broadcast_to(m.entries[key].si, n) for m, n in zip(machines, counts, strict=True)]
        joined = np.concatenate(si)
        if np.any(joined != joined[0]):
            values[key] = joined
        elif np.ndim(first.entries[key].value):  # an array of equal values has the first machine's number of variants
            values[key] = joined[0]
    if not any(map(np.ndim, values.values())):  # all alike: any array makes variants of them
        key = next(iter(first.entries))
        values[key] = np.full(sum(counts), first.entries[key].si)
    return first.with_laws("default").set(values, si=True, check_ranges=False).with_laws(**laws.names)


def repeated(machine: Machine, times: int) -> Machine:
    """The variants of ``machine`` one after the other, ``times`` over; a machine with one variant stays as it is."""
    return machine.variants(np.tile(np.arange(machine.num_variants), times))


def run_turns(
    machine: Machine,
    turns: Sequence[Turn] = TURNS,
    *,
    device: str = "cpu",
    main_step: float = 1e-3,
    substeps: int = 30,
    progress: Callable[[float], Any] | None = None,
) -> TurnRecording:
    """Full turns of every variant of ``machine``, all side by side in one twin.

    Args:
        machine: One machine, or V variants.
        turns: What to run.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        main_step: Time step of the bodies [s]; the recording keeps every one.
        substeps: Hydraulic substeps a main step.
        progress: Called with the simulated time [s] so far.
    """
    variants, count = machine.num_variants, len(turns)
    batch = repeated(machine, count)
    sign = np.repeat([turn.sign for turn in turns], variants)
    signal = sign * np.repeat([turn.signal_percent / 100.0 for turn in turns], variants)
    reach = np.broadcast_to(batch.joint.range, sign.shape)
    twin = Twin(
        len(sign),
        machine=batch,
        device=device,
        main_step=main_step,
        substeps=substeps,
        check_step=machine.num_variants == 1,
    )
    twin.reset(joint_angle=-sign * reach)
    kept: list[dict[str, NDArray[Any]]] = []

    def keep(trace: Trace | None) -> NDArray[np.float32]:
        assert trace is not None
        kept.append({"time": trace.time} | {name: trace[name].copy() for name in RECORDED})
        return trace["joint_angle"]

    keep(twin.step({"steering_signal": 0.0}, REST_BEFORE, sample_every=main_step))
    rested, done = 0.0, REST_BEFORE
    twin.set_commands({"steering_signal": signal})
    while rested < REST_AFTER and done < LONGEST_TURN:
        angle = keep(twin.step(duration=CHUNK, sample_every=main_step))
        done += CHUNK
        there = sign * (sign * reach - angle) <= TOLERANCE
        there |= twin.status > 0
        rested += main_step * float(np.count_nonzero(there.all(axis=1)))
        if progress is not None:
            progress(done)

    time, *channels = (np.concatenate([part[name] for part in kept]) for name in ("time", *RECORDED))
    angle, rate = (channel.astype(np.float64) for channel in channels[:2])
    shape = (-1, count, variants)
    return TurnRecording(
        turns=tuple(turns),
        machine=batch,
        time=time,
        angle=angle.reshape(shape),
        flow=turn_flow(batch.steering.cylinder, angle, rate, sign).reshape(shape),
        pressures=(channels[2].reshape(shape), channels[3].reshape(shape)),
        diverged=tuple((index // variants, index % variants, reason) for index, reason in twin.diverged),
    )


def motor_pressure_at(
    speed: float, machine: Machine, *, brake: bool = True, device: str = "cpu", substeps: int = 30
) -> NDArray[np.float64]:
    """Mean pressure drop over the wheel motors [Pa] (V,) of a machine that drives straight on at ``speed`` [m/s].

    Level ground, first gear. NaN where full pump stroke does not reach the speed.

    Args:
        speed: Speed [m/s], positive.
        machine: One machine, or V variants.
        brake: With its disc brake, or without.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        substeps: Hydraulic substeps a main step.
    """
    if not brake:
        machine = machine.set({"driveline.brake.disc_torque": 0.0}, check_ranges=False)
    return _driven(speed, machine, device, substeps)[0]


def drive_pressure_at(
    speed: float, machine: Machine, *, device: str = "cpu", substeps: int = 30
) -> NDArray[np.float64]:
    """Mean pressure difference between the drive's two lines [Pa] (V,) of a machine that drives straight on at ``speed``:
    what :func:`motor_pressure_at` has over the motors, and what the traction valves take.

    Args:
        speed: Speed [m/s], positive.
        machine: One machine, or V variants.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        substeps: Hydraulic substeps a main step.
    """
    return _driven(speed, machine, device, substeps)[1]


def _driven(
    speed: float, machine: Machine, device: str, substeps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pressure over the motors and between the lines [Pa] (V,) at a speed [m/s]; NaN where it is not reached."""
    variants = machine.num_variants
    tried = np.array([0.2, 0.4, 0.6, 0.8, 1.0])
    batch = repeated(machine, len(tried))
    speeds = _drive(np.repeat(tried, variants), batch, device, substeps)[0].reshape(len(tried), variants)
    signal = np.array([np.interp(speed, speeds[:, v], tried, right=np.nan) for v in range(variants)])
    _, motors, lines = _drive(np.nan_to_num(signal), machine, device, substeps)
    reached = np.isfinite(signal)
    return np.where(reached, motors, np.nan), np.where(reached, lines, np.nan)


def rim_speed(machine: Machine, *, device: str = "cpu", substeps: int = 30) -> NDArray[np.float64]:
    """Largest rim speed [m/s] (V,) of any wheel in a full left turn at full signal: tire radius times wheel rate.

    Args:
        machine: One machine, or V variants.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        substeps: Hydraulic substeps a main step.
    """
    twin = Twin(machine.num_variants, machine=machine, device=device, substeps=substeps, check_step=False)
    twin.reset(joint_angle=-np.asarray(machine.joint.range))
    twin.step(duration=REST_BEFORE)
    trace = twin.step({"steering_signal": 1.0}, RIM_TURN, sample_every=0.01)
    assert trace is not None
    fastest = np.max([np.abs(trace[f"wheel_rate_{wheel}"]) for wheel in WHEELS], axis=(0, 1)).astype(np.float64)
    return np.where(twin.status == 0, machine.tire.radius * fastest, np.nan)


def _drive(
    signal: NDArray[np.float64], machine: Machine, device: str, substeps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Steady speed [m/s], pressure drop over the motors [Pa] and between the drive's lines [Pa] by drive signal."""
    twin = Twin(len(signal), machine=machine, device=device, substeps=substeps, check_step=False)
    twin.step({"drive_signal": 0.0}, REST_BEFORE)
    twin.step({"drive_signal": signal}, DRIVE_SETTLE)
    trace = twin.step(duration=DRIVE_MEAN, sample_every=0.01)
    assert trace is not None
    motors = np.mean([trace[f"motor_pressure_{wheel}"] for wheel in WHEELS], axis=(0, 1)).astype(np.float64)
    lines = np.mean(trace["drive_pressure_forward"] - trace["drive_pressure_return"], axis=0).astype(np.float64)
    return trace["speed"].mean(axis=0).astype(np.float64), motors, lines
