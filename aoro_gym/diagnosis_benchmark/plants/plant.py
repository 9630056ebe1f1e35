"""A plant: machines with laws of their own, stepped together, that stand in for the machine of a sim-to-real gap.

Symmetric splitting (Strang): over half a step frames and wheels move at constant rates while oil, engine and bristles
follow; then the rates change over a whole step under what oil and ground exert; then the other half. Both parts are of
second order, so is the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.diagnosis_benchmark.plants import circuits as rows
from aoro_gym.diagnosis_benchmark.plants.bodies import FRONT, REAR, Bodies, X, Y
from aoro_gym.diagnosis_benchmark.plants.circuits import Circuits
from aoro_gym.diagnosis_benchmark.plants.fluid import Array, Constants, Oil
from aoro_gym.diagnosis_benchmark.plants.friction import clipped, dahl, prandtl_force
from aoro_gym.diagnosis_benchmark.plants.tires import Tires

LEVELS = (0, 1, 2, 3)
"""0: the twin's laws in other words. 1: another friction law, another law of air in oil. 2: also distributed joint hoses
and tires with a contact patch. 3: yet other laws of all these parts, for development."""

MAIN_STEP = 1e-3
"""[s]"""

SUBSTEPS, STAGES = 4, 5
"""Steps of the circuits in half a main step, and stages of their method: stable up to eigenvalues of 1.3e5/s. The stiffest
there is, an open edge and a suction valve below their laminar drop on a chamber of 0.36 L, has 5e4/s."""

CHANNELS = (
    "joint_angle", "pressure_a", "pressure_b", "pump_pressure", "drive_pressure_forward", "drive_pressure_return",
    "engine_speed", "wheel_rate_fl", "wheel_rate_fr", "wheel_rate_rl", "wheel_rate_rr",
)  # fmt: skip
"""What the machine's logger has sensors for, SI."""

_ROWS = {
    "pressure_a": rows.PORT_A, "pressure_b": rows.PORT_B, "pump_pressure": rows.SUPPLY, "return_pressure": rows.RETURN,
    "drive_pressure_forward": rows.FORWARD, "drive_pressure_return": rows.BACK, "charge_pressure": rows.CHARGE,
    "ls_pressure": rows.LS, "spool": rows.SPOOL, "compensator": rows.COMPENSATOR, "pump_swash": rows.SWASH,
    "engine_speed": rows.ENGINE, "engine_torque": rows.TORQUE,
}  # fmt: skip
_WHEELS = {f"wheel_rate_{wheel}": i for i, wheel in enumerate(("fl", "fr", "rl", "rr"))}


class Plant:
    """R machines of one level, from rest on.

    Args:
        constants: SI values by key, each (R,); see :func:`aoro_gym.diagnosis_benchmark.plants.constants.constants_of`.
        level: Which laws, see :data:`LEVELS`.
        joint_angle: [rad] at rest (R,).
        main_step: [s].
        substeps: Of the circuits, in half a main step.
    """

    def __init__(
        self,
        constants: Constants,
        level: int = 0,
        *,
        joint_angle: ArrayLike = 0.0,
        main_step: float = MAIN_STEP,
        substeps: int = SUBSTEPS,
        stages: int = STAGES,
    ):
        if level not in LEVELS:
            raise ValueError(f"level is {level!r}; choose one of: {', '.join(map(str, LEVELS))}")
        self.constants, self.level = constants, level
        self.main_step, self.substeps = main_step, substeps
        self.circuits = Circuits(constants, level, stages)
        self.tires = Tires(constants, level)
        self.bodies = Bodies(constants, Oil(constants, level))
        runs = self.circuits.runs
        angle = np.broadcast_to(np.asarray(joint_angle, dtype=np.float64), (runs,)).copy()
        reach = self.circuits.cylinders.reach
        if np.any(np.abs(angle) > reach + 1e-9):
            worst = int(np.argmax(np.abs(angle) - reach))
            raise ValueError(
                f"joint_angle is {angle[worst]:.4f} rad, but the joint of run {worst} reaches only ±{reach[worst]:.4f} rad"
            )
        self.bodies.stand(angle)
        self.state = self.circuits.at_rest(angle)
        self.u = np.zeros((7, runs))
        self.spin = np.zeros((4, runs))
        self.joint_stretch = np.zeros(runs)  # [rad] of the joint's dry friction, level 0
        self.brake_stretch = np.zeros(
            (4, runs)
        )  # [rad] of the wheels' (level 0), or share of its capacity (the others)
        self._play = np.zeros(runs)  # what the hysteresis has remembered of the steering signal
        self._half_play = 0.5 * constants["steering.valve.hysteresis"]
        p = constants
        drag = np.zeros((4, runs))
        drag[0] = p["driveline.brake.drag_fl"]
        self._brake = p["driveline.brake.disc_torque"] + drag
        self._motor_loss = 1.0 - p["driveline.motor.mechanical_efficiency"]
        self._brake_spring = p["driveline.brake.presliding_stiffness"], p["driveline.brake.presliding_damping"]
        self._spin_inertia = p["wheel.inertia_spin"]

    @property
    def joint_angle(self) -> Array:
        """[rad] (R,), positive left."""
        return self.bodies.position[FRONT] - self.bodies.position[REAR]

    @property
    def joint_rate(self) -> Array:
        """[rad/s] (R,)."""
        return self.u[FRONT] - self.u[REAR]

    def step(self, steering: tuple[Array, Array], drive: Array) -> None:
        """One main step; ``steering`` (R,), (R,): the delayed signal over its first and its second half; ``drive`` (R,)."""
        half = 0.5 * self.main_step
        self._drift(half, self._after_play(steering[0]), drive)
        self._kick(self.main_step)
        self._drift(half, self._after_play(steering[1]), drive)

    def channel(self, name: str) -> Array:
        """Present value (R,) of an output, SI."""
        if name in _ROWS:
            value = self.state[_ROWS[name]]
            return np.maximum(value, self.circuits.least) if "pressure" in name else value
        if name in _WHEELS:
            return self.bodies.relative_spin(self.u, self.spin)[_WHEELS[name]]
        if name.startswith("position_"):
            return self.bodies.position[{"x": X, "y": Y}[name[-1]]]
        return getattr(self, name)

    def _after_play(self, signal: Array) -> Array:
        """What the hysteresis lets through: a play of half width w about the signal, then w back toward its centre, so that
        a signal that has only risen passes unchanged."""
        w = self._half_play
        self._play = np.minimum(np.maximum(self._play, signal - w), signal + w)
        return self._play + clipped(self._play, w)

    def _drift(self, duration: float, steering: Array, drive: Array) -> None:
        """Move places and states on at constant rates of frames and wheels."""
        bodies, circuits = self.bodies, self.circuits
        angle = self.joint_angle
        bodies.position += 0.5 * duration * self.u
        ahead, aside, turn = bodies.contact_velocities(self.u, self.spin)
        self.tires.advance(ahead, aside, turn, bodies.radius * self.spin, duration)
        wheel_rate = bodies.relative_spin(self.u, self.spin)
        self._hold_wheels(wheel_rate * duration)
        bodies.position += 0.5 * duration * self.u
        self.state, self.joint_stretch = circuits.advance(
            self.state, self.joint_stretch, angle, self.joint_rate, wheel_rate, steering, drive, duration, self.substeps
        )
        if self.level == 0:
            at = circuits.cylinders.at(self.joint_angle)
            p_a, p_b = circuits.cylinder_pressures(self.state)
            limit = circuits.capacity(at, self.joint_angle, self.joint_rate, p_a, p_b) / circuits.presliding[0]
            moved = clipped(self.joint_stretch + duration * self.joint_rate, limit)
            self.joint_stretch = np.where(circuits.elastic, self.joint_stretch, moved)

    def _hold_wheels(self, travel: Array) -> None:
        stiffness, capacity = self._brake_spring[0], self._wheel_capacity()
        if self.level == 0:
            self.brake_stretch = clipped(self.brake_stretch + travel, capacity / stiffness)
        else:
            self.brake_stretch = dahl(self.brake_stretch, travel, stiffness / capacity)

    def _motor_torque(self) -> Array:
        p = self.circuits.pressure(self.state[rows.VOLUMES])
        return self.circuits.motor_size * (p[rows.WHEEL_LINE] - p[rows.BACK])

    def _wheel_capacity(self) -> Array:
        return self._brake + self._motor_loss * np.abs(self._motor_torque()) + 1e-9

    def _kick(self, duration: float) -> None:
        """Change the rates under forces at the present places: Heun's method."""
        bodies = self.bodies
        bodies.lean_on_tires()
        factor = bodies.mass_factor()
        fixed = bodies.weight()
        at = self.circuits.cylinders.at(self.joint_angle)
        first, first_spin = self._accelerations(self.u, self.spin, factor, fixed, at)
        second, second_spin = self._accelerations(
            self.u + duration * first, self.spin + duration * first_spin, factor, fixed, at
        )
        self.u = self.u + 0.5 * duration * (first + second)
        self.spin = self.spin + 0.5 * duration * (first_spin + second_spin)

    def _accelerations(self, u: Array, spin: Array, factor: Array, fixed: Array, at: Any) -> tuple[Array, Array]:
        bodies, tires = self.bodies, self.tires
        load = bodies.loads(u)
        ahead, aside, turn = bodies.contact_velocities(u, spin)
        longitudinal, lateral, swivel = tires.forces(load, ahead, aside, turn, bodies.radius * spin)
        rate = bodies.relative_spin(u, spin)
        capacity = self._wheel_capacity()
        if self.level == 0:
            dry = prandtl_force(self.brake_stretch, rate, *self._brake_spring, capacity)
        else:
            dry = -capacity * self.brake_stretch
        shaft = self._motor_torque() + dry
        force = fixed + bodies.lift(load) + bodies.turning(u) + bodies.ground(longitudinal, lateral, swivel, shaft)
        joint = self._joint_torque(u[FRONT] - u[REAR], at)
        force[FRONT] += joint
        force[REAR] -= joint
        moment = shaft - bodies.radius * longitudinal + tires.rolling_moment(load, bodies.radius, spin)
        return bodies.solve(factor, force), moment / self._spin_inertia

    def _joint_torque(self, rate: Array, at: Any) -> Array:
        circuits, angle = self.circuits, self.joint_angle
        p_a, p_b = circuits.cylinder_pressures(self.state)
        torque = circuits.cylinder_torque(at, angle, rate, self.joint_stretch, p_a, p_b)
        if not circuits.elastic.any():
            return torque
        pin, pin_rate = self.state[rows.PIN_ANGLE], self.state[rows.PIN_RATE]
        return np.where(circuits.elastic, circuits.series_torque(pin, pin_rate, angle, rate), torque)


def simulate(
    plant: Plant,
    commands: Mapping[str, Array],
    *,
    keep_every: int = 1,
    channels: tuple[str, ...] = CHANNELS,
    progress: Callable[[int], Any] | None = None,
) -> dict[str, Array]:
    """Run a plant from rest: outputs (frames, R) by name, the first at time 0, one every ``keep_every`` main steps.

    Args:
        plant: At rest; it is used up.
        commands: ``steering_signal`` and, where it is driven, ``drive_signal``, each (main steps, R), held over a step.
        keep_every: Main steps between two frames.
        channels: Names of the outputs.
        progress: Called with the number of main steps done.
    """
    signal = commands["steering_signal"]
    drive = commands.get("drive_signal", np.zeros_like(signal))
    delayed = delay(signal, plant.constants["steering.valve.command_delay"], plant.main_step)
    kept: dict[str, list[Array]] = {name: [np.array(plant.channel(name))] for name in channels}
    for index in range(len(signal)):
        plant.step((delayed[2 * index], delayed[2 * index + 1]), drive[index])
        if (index + 1) % keep_every == 0:
            for name, values in kept.items():
                values.append(np.array(plant.channel(name)))
            if progress is not None:
                progress(index + 1)
    diverged = ~np.isfinite(plant.state).all(axis=0)
    if diverged.any():
        raise FloatingPointError(
            f"run {int(np.argmax(diverged))}: simulation diverged (non-finite state); "
            "raise stages or substeps, or check its constants"
        )
    return {name: np.stack(values) for name, values in kept.items()}


def delay(signal: Array, age: Array, step: float) -> Array:
    """Means (2 K, R) over half steps of ``signal`` (K, R), held over steps of ``step`` [s], ``age`` [s] (R,) earlier; it was
    zero before its start."""
    count = len(signal)
    total = np.concatenate([np.zeros((1, signal.shape[1])), np.cumsum(signal, axis=0)]) * step
    edges = 0.5 * step * np.arange(2 * count + 1)[:, None] - age
    place = np.maximum(edges / step, 0.0)
    whole = np.minimum(place.astype(np.int64), count - 1)
    each = np.arange(signal.shape[1])
    integral = total[whole, each] + (place - whole) * step * signal[whole, each]
    return np.diff(integral, axis=0) / (0.5 * step)
