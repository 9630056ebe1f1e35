"""Bodies and driveline, which exchange wheel rates and hub torques once a period.

In a period the bodies say how fast the wheels turn and what pump 2 takes; the driveline moves by the period at these rates,
held, and says its torques, of which it gives the mean; the bodies then move by the period under these, held. At a period of
one main step and without delay this is the order of the whole twin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from aoro_gym.checks import check_integer
from aoro_gym.cosimulation.laboratory.delays import DelayLine
from aoro_gym.cosimulation.laboratory.protection import Phase, Protection
from aoro_gym.twin.driveline import COMMANDS
from aoro_gym.twin.hub_driven import HubDrivenTwin

STOP: Mapping[str, float] = {"drive_signal": 0.0, "gear": 1.0}
"""What a driveline is commanded after a stop; the parking brake follows once its hubs stand."""


class DrivelineSide(Protocol):
    """A driveline here (:class:`~aoro_gym.twin.driveline.Driveline`), in another process or on a rig."""

    def reset(self, torque: npt.ArrayLike = 0.0) -> None:
        """At rest, the brakes bearing ``torque`` [N m]."""
        ...

    def set_commands(self, commands: Mapping[str, Any]) -> None:
        """Set some of the driveline's commands."""
        ...

    def step(
        self, rates: npt.ArrayLike, pump_torque: npt.ArrayLike, steps: int = 1
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Torques [N m] and engine speed [rad/s] over ``steps`` main steps at these rates."""
        ...


class Coupling:
    """One or many machines whose drivelines are apart from their bodies.

    Args:
        bodies: At rest.
        driveline: Is reset to bear what holds the bodies.
        steps: Main steps of a period.
        forth: Way of wheel rates and pump torque to the driveline; without delay by default.
        back: Way of torques and engine speed to the bodies.
        protection: Limits; none by default, for studies of what they would hide.
    """

    def __init__(
        self,
        bodies: HubDrivenTwin,
        driveline: DrivelineSide,
        *,
        steps: int = 1,
        forth: DelayLine | None = None,
        back: DelayLine | None = None,
        protection: Protection | None = None,
    ):
        check_integer("steps", steps)
        self.bodies, self.driveline, self.steps = bodies, driveline, steps
        self.forth, self.back, self.protection = forth, back, protection
        self.period = steps * bodies.main_step
        """[s]"""
        driveline.reset(bodies.hub_torques)
        self._at_rest = np.concatenate([bodies.hub_torques, bodies.engine_speed[None]])

    def exchange(self, commands: Mapping[str, Any]) -> npt.NDArray[np.float32]:
        """Move both sides by a period under ``commands``; returns the torques [N m] at the hubs (4, N).

        After a stop the bodies stand still in time, while the hubs come to rest and are braked.
        """
        bodies, protection = self.bodies, self.protection
        rates = bodies.wheel_rates
        if protection is not None:
            rates = protection.setpoints(rates, self.period)
        self.driveline.set_commands(self._for_driveline(commands))
        demand = np.concatenate([rates, bodies.pump_torque[None]])
        if self.forth is not None:
            demand = self.forth.pass_on(demand, np.zeros_like(demand))
        torque, speed = self.driveline.step(demand[:4], demand[4], self.steps)
        measured = np.concatenate([torque, speed[None]])
        if self.back is not None:
            measured = self.back.pass_on(measured, self._at_rest)
        torques = measured[:4]
        if protection is not None:
            torques = protection.torques(torques, self.period)
            if protection.phase is Phase.STOPPED:
                return torques
        bodies.set_commands({name: value for name, value in commands.items() if name not in COMMANDS})
        bodies.set_hubs(torques, measured[4])
        bodies.advance(self.period)
        if protection is not None and bodies.diverged:
            protection.stop("the twin's simulation diverged")
        return torques

    def _for_driveline(self, commands: Mapping[str, Any]) -> dict[str, Any]:
        told = {name: value for name, value in commands.items() if name in COMMANDS}
        protection = self.protection
        if protection is None or protection.phase is Phase.RUNNING:
            return told
        if protection.phase is Phase.STARTING:
            return told | {"drive_signal": protection.share * np.asarray(told.get("drive_signal", 0.0))}
        return {**STOP, "parking_brake": float(protection.at_rest)}
