"""Twins that run in the view: commands in, poses, forces and readings out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Floats, Pose
from aoro_gym.recording.commands import COMMAND_BOUNDS
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state
from aoro_gym.twin.soil_ruts import Ruts
from aoro_gym.view.forces import TireForces

CONTROL_STEP = 0.05
"""Longest simulated time [s] between two looks at the commands, and of the reference controllers."""

Driver = Callable[[Twin], Mapping[str, Any]]
"""Commands of all twins, each a scalar or (num_twins,), by what they see every ``CONTROL_STEP``."""


class LiveTwins:
    """Twins under the commands of a person, or of a driver.

    Args:
        twin: One or several copies, at rest.
        machines: Of each of them, one variant each; of the first ones only, if no others are looked at.
        driver: Commands what it names while ``driven``; the rest is the person's.
        begin: Puts the twins at their start again.
    """

    def __init__(
        self,
        twin: Twin,
        machines: Sequence[Machine],
        *,
        driver: Driver | None = None,
        begin: Callable[[], None] | None = None,
    ):
        self.twin, self.machines, self.driver = twin, tuple(machines), driver
        self.driven = driver is not None
        self.commands = {name: start for name, (_, _, start) in COMMAND_BOUNDS.items()}
        self._begin = begin or twin.reset
        self._forces: TireForces | None = None
        self._left = 0.0  # [s] less than a main step that is still to be simulated

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.twin.time[: len(self.machines)].max())

    @property
    def ground(self) -> Plane | Terrain | World:
        """The first ground that the twins may stand on."""
        terrain = self.twin.terrain
        return terrain if isinstance(terrain, Plane | Terrain | World) else terrain[0]

    @property
    def frozen(self) -> str:
        """Why a twin is frozen; empty if all run."""
        return next((reason for _, reason in self.twin.diverged), "")

    def advance(self, duration: float) -> None:
        """Simulate ``duration`` [s], up to a main step, which is kept for the next time."""
        step = self.twin.main_step
        steps = int((duration + self._left) / step + 1e-6)
        self._left = max(duration + self._left - steps * step, 0.0)
        longest = round(CONTROL_STEP / step)
        while steps > 0:
            part = min(steps, longest)
            commands: dict[str, Any] = dict(self.commands)
            if self.driver is not None and self.driven:
                commands |= self.driver(self.twin)
            self.twin.set_commands(commands)
            self.twin.advance(part * step)
            steps -= part

    def settle(self) -> None:
        """A main step, after which there are outputs to show."""
        self.twin.advance(self.twin.main_step)

    def change(self, index: int, machine: Machine) -> None:
        """Give one of the twins another machine, from the next step on.

        Raises ValueError where the machine cannot be simulated with these steps.
        """
        self.twin.set_machines([index], machine)

    def restart(self) -> None:
        """Begin again, with all commands at rest."""
        self.commands = {name: start for name, (_, _, start) in COMMAND_BOUNDS.items()}
        self._left = 0.0
        self._begin()
        self.settle()

    def poses(self) -> list[Pose]:
        """Where the machines are."""
        state = self.twin.state.numpy()
        crane = self.twin.crane.vehicle if self.twin.has_crane else None
        return [pose_of_state(state[:, i], crane) for i in range(len(self.machines))]

    def forces(self) -> tuple[Floats, Floats]:
        """Contact points [m] and forces [N] of all tires, (num_twins, 4, 3), of all twins; none on soil, where they are not
        known from the state alone."""
        if self.twin.soil is not None:
            none = np.zeros((self.twin.num_twins, 4, 3))
            return none, none
        if self._forces is None:
            self._forces = TireForces(self.twin)
        return self._forces.evaluate()

    def ruts(self) -> list[Ruts]:
        """The ruts of each machine; none on hard ground."""
        return [self.twin.rut_raster(i) for i in range(len(self.machines))] if self.twin.soil is not None else []

    def readings(self) -> list[dict[str, float]]:
        """Outputs of each twin, SI."""
        outputs = np.asarray(self.twin.outputs.numpy()[-1], dtype=np.float64)
        return [dict(zip(self.twin.channels, outputs[:, i].tolist(), strict=True)) for i in range(len(self.machines))]
