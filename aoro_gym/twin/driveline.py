"""Engine, pump 1, motors and brakes without a vehicle: hubs that dynamometers turn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import warp as wp

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.execution import devices
from aoro_gym.machine.parameters import Machine
from aoro_gym.recording.commands import COMMAND_BOUNDS
from aoro_gym.twin.hydraulic_step import check_hydraulic_step
from aoro_gym.twin.kernels.driveline import drive
from aoro_gym.twin.recorded import BLOCK_DIM
from aoro_gym.twin.records import Command, Demand, DrivelineOutput, MachineRecord, State, pack, row_of
from aoro_gym.twin.twin import Twin

COMMANDS = ("drive_signal", "gear", "parking_brake", "traction_fl", "traction_fr", "traction_rl", "traction_rr")
"""What a driveline is commanded."""


class Driveline:
    """Drivelines of one machine, each with its engine: what :class:`~aoro_gym.twin.hub_driven.HubDrivenTwin` lacks.

    Args:
        num_drivelines: At least 1.
        machine: Name of a bundled machine, path of a machine file, or a :class:`Machine`.
        hub_inertia: Of what turns with a hub on this side of the flange [kg m²]; its torque is taken off what is measured.
            It must not stand in the ``wheel.inertia_spin`` of the vehicle, too.
        main_step: [s].
        substeps: Hydraulic substeps a main step.

    Raises:
        ValueError: a value is out of its bound; the message names it.
    """

    def __init__(
        self,
        num_drivelines: int = 1,
        *,
        machine: str | Path | Machine = "aoro",
        hub_inertia: float = 0.0,
        main_step: float = 1e-3,
        substeps: int = 30,
    ):
        check_integer("num_drivelines", num_drivelines)
        check_integer("substeps", substeps)
        check_range("hub_inertia", hub_inertia, "kg m²", ge=0.0)
        self.machine = machine if isinstance(machine, Machine) else Machine.load(machine)
        self.num_drivelines, self.hub_inertia = int(num_drivelines), float(hub_inertia)
        self.main_step, self.substeps = float(main_step), int(substeps)
        check_hydraulic_step(self.machine, self.main_step, self.substeps)
        self._device = devices.find("cpu")
        n = self.num_drivelines
        self._machines = wp.array(pack(self.machine), dtype=MachineRecord, device=self._device)
        self._commands = wp.zeros((len(Command), n), dtype=float, device=self._device)
        self._demands = wp.zeros((len(Demand), n), dtype=float, device=self._device)
        self._state = wp.zeros((len(State), n), dtype=float, device=self._device)
        self._clock = wp.zeros(n, dtype=int, device=self._device)
        self._outputs = wp.zeros((len(DrivelineOutput), n), dtype=float, device=self._device)
        idle = Twin(n, machine=self.machine, main_step=main_step, substeps=substeps)
        self._idle = idle.state.numpy()[: len(State)].copy()
        self.reset()

    def reset(self, torque: npt.ArrayLike = 0.0) -> None:
        """Idle circuits and engine, hubs at rest; the brakes bear ``torque`` [N m], (4,) or (4, num_drivelines)."""
        self._state.assign(self._idle)
        self._clock.zero_()
        state, commands = self._state.numpy(), self._commands.numpy()
        bent, stiffness = int(State.WHEEL_FRICTION_FL), np.asarray(self.machine.driveline.brake.presliding_stiffness)
        torques = np.asarray(torque, dtype=float)
        state[bent : bent + 4] = -(torques[:, None] if torques.ndim == 1 else torques) / stiffness
        for name, (_, _, initial) in COMMAND_BOUNDS.items():
            commands[row_of(Command, name, "command")] = initial

    def set_commands(self, commands: Mapping[str, npt.ArrayLike]) -> None:
        """Set some of :data:`COMMANDS`, each a scalar or of shape (num_drivelines,); the others keep their last value."""
        held = self._commands.numpy()  # the same memory
        for name, value in commands.items():
            if name not in COMMANDS:
                raise ValueError(f"there is no command '{name}' of a driveline; choose one of: {', '.join(COMMANDS)}")
            low, high, _ = COMMAND_BOUNDS[name]
            check_range(name, value, ge=low, le=high)
            held[row_of(Command, name, "command")] = value

    def step(
        self, rates: npt.ArrayLike, pump_torque: npt.ArrayLike, steps: int = 1
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Move by ``steps`` main steps while the dynamometers hold the wheel rates.

        Args:
            rates: Of the wheels against their arms [rad/s], (4,) or (4, num_drivelines).
            pump_torque: That pump 2 asks of the engine [N m], scalar or (num_drivelines,).
            steps: Main steps.

        Returns:
            torques (4, num_drivelines) at the flanges [N m], the mean over the steps; the engine's speed (num_drivelines,)
            [rad/s] at their start.
        """
        demands = self._demands.numpy()  # the same memory
        asked = np.asarray(rates, dtype=np.float32)
        check_finite("rates", asked, "rad/s")
        check_finite("pump_torque", pump_torque, "N m")
        demands[:4] = asked[:, None] if asked.ndim == 1 else asked
        demands[4] = pump_torque
        wp.launch(
            drive,
            dim=self.num_drivelines,
            inputs=[
                self._machines, self.hub_inertia, self._commands, self._demands, self._state, self._clock, self._outputs,
                steps, self.substeps, self.main_step,
            ],
            device=self._device,
            block_dim=BLOCK_DIM,
        )  # fmt: skip
        outputs = np.array(self._outputs.numpy(), dtype=np.float32)
        return outputs[:4], outputs[4]

    def output(self, channel: str) -> npt.NDArray[np.float32]:
        """Last value of one of :class:`~aoro_gym.twin.records.DrivelineOutput`, (num_drivelines,)."""
        return self._outputs.numpy()[row_of(DrivelineOutput, channel, "output")].copy()
