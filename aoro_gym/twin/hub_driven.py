"""A twin whose wheels are turned by a driveline outside of it, on dynamometers or in another process."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aoro_gym.checks import check_finite, check_range
from aoro_gym.twin.records import Output, State
from aoro_gym.twin.twin import Twin


class HubDrivenTwin(Twin):
    """A :class:`Twin` without driveline and engine: torques that are measured at its hubs turn its wheels.

    The torques hold until others are set; in return the twin says how fast each wheel turns (:attr:`wheel_rates`), to be the
    set-point of a dynamometer. The cut lies at the flange between hub and wheel: what is measured there is what motor,
    reduction, brake and hub friction leave, and the twin takes nothing off it. All of ``wheel.inertia_spin`` is the twin's;
    what turns with the physical hub must not stand in it.

    Steering, arms, joint and pump 2 stay the twin's, at the engine speed that is measured; the torque that pump 2 asks of
    the engine is :attr:`pump_torque`. The commands ``drive_signal``, ``gear``, ``traction_…`` and ``parking_brake`` are for
    the driveline outside and move nothing here; the outputs of the driveline and of the engine's torque say nothing. It is
    made as a :class:`Twin` is.
    """

    _measured_hubs = True

    def reset(self, mask: npt.ArrayLike | None = None, **start: Any) -> None:
        """As :meth:`Twin.reset`; at the hubs of these twins is what holds them where they stand, at an idle engine."""
        super().reset(mask, **start)
        chosen = np.ones(self.num_twins, dtype=bool) if mask is None else np.asarray(mask)
        state = self.state.numpy()
        friction, hose = int(State.WHEEL_FRICTION_FL), int(State.HOSE_FL)
        stiffness = np.asarray(self.machine.driveline.brake.presliding_stiffness)
        state[hose : hose + 4, chosen] = (-stiffness * state[friction : friction + 4])[:, chosen]
        self.state.assign(state)

    def set_hubs(self, torque: npt.ArrayLike, engine_speed: npt.ArrayLike) -> None:
        """Set what is measured.

        Args:
            torque: On each wheel at its flange [N m], forwards positive, (4,) or (4, num_twins): fl, fr, rl, rr.
            engine_speed: [rad/s], scalar or (num_twins,), not negative.

        Raises:
            ValueError: wrong shape, not finite, or out of bounds; the message names it.
        """
        n = self.num_twins
        torques = np.asarray(torque, dtype=np.float32)
        if torques.shape not in ((4,), (4, n)):
            raise ValueError(f"torque has shape {torques.shape}, but must be (4,) or (4, {n})")
        speed = np.asarray(engine_speed, dtype=np.float32)
        if speed.shape not in ((), (n,)):
            raise ValueError(f"engine_speed has shape {speed.shape}, but must be a scalar or ({n},)")
        check_finite("torque", torques, "N m")
        check_range("engine_speed", speed, "rad/s", ge=0.0)
        first = int(State.HOSE_FL)
        self.state[first : first + 4].assign(np.broadcast_to(torques.reshape(4, -1), (4, n)))
        self.state[int(State.ENGINE_SPEED)].assign(np.broadcast_to(speed, n))

    @property
    def hub_torques(self) -> npt.NDArray[np.float32]:
        """Torques [N m] that are set, (4, num_twins)."""
        first = int(State.HOSE_FL)
        return np.array(self.state.numpy()[first : first + 4], dtype=np.float32)

    @property
    def engine_speed(self) -> npt.NDArray[np.float32]:
        """Speed [rad/s] of the engine that is set, (num_twins,)."""
        return np.array(self.state.numpy()[State.ENGINE_SPEED], dtype=np.float32)

    @property
    def wheel_rates(self) -> npt.NDArray[np.float32]:
        """How fast each wheel turns against its arm [rad/s] at the end of the last step, (4, num_twins); 0 after a reset."""
        first = int(Output.WHEEL_RATE_FL)
        rates = self._outputs.numpy()[-1, first : first + 4]
        return np.asarray(np.where(self._clock.numpy() > 0, rates, 0.0), dtype=np.float32)

    @property
    def pump_torque(self) -> npt.NDArray[np.float32]:
        """Torque [N m] that pump 2 asks of the engine, (num_twins,)."""
        state, pump = self.state.numpy(), self.machine.steering.pump
        supply = np.maximum(state[State.SUPPLY], self.machine.oil.void_pressure)
        return np.asarray(
            state[State.SWASH] * pump.displacement * supply / pump.mechanical_efficiency, dtype=np.float32
        )
