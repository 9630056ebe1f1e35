"""How far a parted machine is from the whole one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aoro_gym.cosimulation.laboratory.coupling import Coupling
from aoro_gym.cosimulation.laboratory.manoeuvres import Manoeuvre
from aoro_gym.machine.parameters import Machine
from aoro_gym.twin.driveline import Driveline
from aoro_gym.twin.hub_driven import HubDrivenTwin
from aoro_gym.twin.records import CHANNELS
from aoro_gym.twin.twin import Twin

COMPARED: dict[str, float] = {
    "speed": 0.1,
    "yaw_rate": 0.05,
    "joint_angle": 0.05,
    **{f"wheel_rate_{wheel}": 0.2 for wheel in ("fl", "fr", "rl", "rr")},
    **{f"wheel_load_{wheel}": 2e3 for wheel in ("fl", "fr", "rl", "rr")},
    "pitch": 0.01,
    "position_x": 0.1,
    "pressure_a": 5e5,
}
"""Channels that are compared, and the least range of each (SI) by which a difference is divided, a choice: a channel that a
manoeuvre does not move is not to be blown up."""
HUB_INERTIA = 4.0
"""Of what turns with a hub on the driveline's side [kg m²] (E: rotor and hub of 60 kg at 0.25 m), out of the machine's
``wheel.inertia_spin``."""


@dataclass(frozen=True)
class Difference:
    """Of one channel between parted and whole machine, relative to the range that the whole one covers."""

    channel: str
    rms: float
    largest: float


def parted(
    machine: Machine,
    manoeuvre: Manoeuvre,
    *,
    num_machines: int = 1,
    hub_inertia: float = 0.0,
    main_step: float = 1e-3,
    substeps: int = 30,
) -> tuple[HubDrivenTwin, Driveline]:
    """Bodies on the manoeuvre's ground, and their driveline with ``hub_inertia`` [kg m²] of the wheels' inertia.

    Args:
        machine: The whole machine.
        manoeuvre: Whose ground they stand on.
        num_machines: Side by side.
        hub_inertia: Of a hub [kg m²], behind the cut.
        main_step: [s].
        substeps: Hydraulic substeps a main step.
    """
    steps = {"main_step": main_step, "substeps": substeps}
    bodies = machine
    if hub_inertia > 0.0:
        left = {"wheel.inertia_spin": np.asarray(machine.wheel.inertia_spin) - hub_inertia}
        bodies = machine.set(left, check_ranges=False)
    return (
        HubDrivenTwin(num_machines, machine=bodies, terrain=manoeuvre.ground(), **steps),
        Driveline(num_machines, machine=machine, hub_inertia=hub_inertia, **steps),
    )


def drive_whole(
    machine: Machine, manoeuvre: Manoeuvre, period: float = 1e-3, done: Callable[[float], None] = lambda _: None
) -> npt.NDArray[np.float32]:
    """Outputs (periods, channels) of the whole twin; ``done`` is told the share that is done."""
    twin, rows = Twin(machine=machine, terrain=manoeuvre.ground()), []
    for number in range(round(manoeuvre.duration / period)):
        done(number * period / manoeuvre.duration)
        twin.set_commands(manoeuvre.commands(number * period))
        twin.advance(period)
        rows.append(twin.outputs.numpy()[-1, :, 0].copy())
    return np.array(rows)


def drive_parted(
    coupling: Coupling, manoeuvre: Manoeuvre, done: Callable[[float], None] = lambda _: None
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Outputs (periods, channels) of the first machine's bodies, and its torques (periods, 4) [N m].

    ``done`` is told the share that is done.
    """
    rows, torques = [], []
    for number in range(round(manoeuvre.duration / coupling.period)):
        done(number * coupling.period / manoeuvre.duration)
        torques.append(coupling.exchange(manoeuvre.commands(number * coupling.period))[:, 0].copy())
        rows.append(coupling.bodies.outputs.numpy()[-1, :, 0].copy())
    return np.array(rows), np.array(torques)


def differences(whole: npt.NDArray[np.float32], parts: npt.NDArray[np.float32]) -> list[Difference]:
    """Root mean square and largest difference of each of :data:`COMPARED`, over its range in the whole twin's run."""
    found = []
    for channel, least in COMPARED.items():
        column = CHANNELS.index(channel)
        error = parts[:, column].astype(float) - whole[:, column]
        span = max(float(np.ptp(whole[:, column])), least)
        found.append(Difference(channel, float(np.sqrt(np.mean(error**2))) / span, float(np.max(np.abs(error))) / span))
    return found
