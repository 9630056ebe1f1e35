"""A machine that drives, shifts and brakes straight on, as one small ODE in float64: the reference of time courses.

One rigid body that rolls on and pitches on its four tires' springs, two axles, the wheels of each turning alike, their
tires' bristles (LuGre along the way) under the load that the axle bears, and the driveline of
:mod:`tests.oracles.hydraulics`. Left out are heave, arms that give way, and what pump 2 idles at. A plane; x forward and
uphill, pitch positive nose down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.bodies import BodyModel
from tests.oracles.hydraulics import Driveline, Engine, Oil

GRAVITY = 9.81
LAYOUT = {
    "position": 0.1, "speed": 0.1, "pitch": 1e-2, "pitch_rate": 0.1, "wheel_rate_front": 0.1, "wheel_rate_rear": 0.1,
    "tire_bristle_front": 1e-2, "tire_bristle_rear": 1e-2,
    "brake_bristle_front": 1e-3, "brake_bristle_rear": 1e-3, "drive_forward": 1e6, "drive_return": 1e6,
    "line_front": 1e6, "line_rear": 1e6, "charge": 1e6, "drive_swash": 1.0, "fraction_front": 1.0, "fraction_rear": 1.0,
    "engine_speed": 10.0, "governor": 100.0, "engine_torque": 100.0,
}  # fmt: skip
"""States and the sizes that the solver sees them in."""
SCALE = np.array(list(LAYOUT.values()))
FOUR = np.ones((4, 1))

Commands = Mapping[str, float]


class StraightDrive:
    """Equations of motion; commands are ``drive_signal``, ``gear`` and ``parking_brake``."""

    def __init__(self, machine: Any, slope: float = 0.0, friction: float = 1.0):
        """On ground that rises by ``slope`` [rad] ahead; ``friction`` scales the tires'."""
        self.machine, self.slope, self.friction = machine, slope, friction
        self.oil = Oil(machine.oil)
        self.line, self.engine = Driveline(machine, self.oil), Engine(machine.engine)
        self.load = machine.mass * GRAVITY * np.cos(slope)
        bodies = BodyModel(machine)
        pose = np.zeros(16)
        tire, arm = machine.tire, machine.arm
        sag = 0.25 * self.load / tire.stiffness
        pose[3] = 1.0
        pose[8:12] = arm.rest_angle
        below = float(np.mean(bodies.kinematics(pose, np.zeros(15)).wheel_center[2]))
        pose[2] = tire.radius - sag - below
        centre = bodies.center_of_mass(pose)
        turning = np.zeros(15)
        turning[4] = 1.0
        turning[11:15] = -1.0  # wheels that do not turn
        self.pitch_inertia = float(bodies.angular_momentum(pose, turning, centre)[1])
        wheels = bodies.kinematics(pose, np.zeros(15)).wheel_center
        reach = wheels[0] - centre[0]
        self.axles = np.array([reach[:2].mean(), reach[2:].mean()])  # [m] ahead of the centre of mass
        self.centre_ahead = float(centre[0] - pose[0])  # of the hinge's origin
        self.wheelbase = float(reach[:2].mean() - reach[2:].mean())
        share = (
            -float(reach[2:].mean()) / self.wheelbase
        )  # of the load, on the front axle of the machine that stands level
        self.level_loads = self.load * np.array([[share], [1.0 - share]])
        self.hub_below = float(centre[2] - wheels[2].mean())
        self.centre_above = float(centre[2] - pose[2])  # the hinge's origin
        self.pitch_stiffness, self.pitch_damping = (c * float(reach @ reach) for c in (tire.stiffness, tire.damping))

    def rates(self, flat: Any, commands: Commands) -> np.ndarray:
        """Rates of scaled states."""
        x = dict(zip(LAYOUT, np.asarray(flat, dtype=float)[:, None] * SCALE[:, None], strict=True))
        m, tire = self.machine, self.machine.tire
        line = x | {
            "traction_opening": FOUR,
            "wheel_line": np.stack([x["line_front"]] * 2 + [x["line_rear"]] * 2),
            "wheel_bristle": np.stack([x["brake_bristle_front"]] * 2 + [x["brake_bristle_rear"]] * 2),
        }
        rate = np.stack([x["wheel_rate_front"], x["wheel_rate_rear"]])
        relative = np.repeat(rate - x["pitch_rate"], 2, axis=0)
        motor, dry, bristle = self.line.wheel_torque(line, relative, commands.get("parking_brake", 0.0))
        oil, drawn, _ = self.line.rates(
            line,
            commands.get("drive_signal", 0.0),
            FOUR,
            int(commands.get("gear", 1)),
            relative,
            x["engine_speed"],
        )
        hub = x["speed"] - x["pitch_rate"] * self.hub_below
        spring = self.pitch_stiffness * x["pitch"] + self.pitch_damping * x["pitch_rate"]
        load = self.level_loads + np.stack([spring, -spring]) / self.wheelbase
        bent_by = np.stack([x["tire_bristle_front"], x["tire_bristle_rear"]])
        slip = tire.radius * rate - hub
        ratio = slip / tire.stribeck_velocity
        grip = self.friction * (
            tire.friction_coulomb + (tire.friction_static - tire.friction_coulomb) * np.exp(-(ratio**2))
        )
        bent = slip - tire.sigma0_longitudinal * np.abs(slip) / grip * bent_by
        force = load * (
            tire.sigma0_longitudinal * bent_by + tire.sigma1_longitudinal * bent + tire.sigma2_longitudinal * slip
        )
        rolling = tire.rolling_resistance * load * tire.radius * np.tanh(rate / 0.05)
        shaft = (motor + dry).reshape(2, 2, -1).sum(axis=1)
        turning = (shaft - force * tire.radius - rolling) / (2.0 * m.wheel.inertia_spin)
        pull = force.sum(axis=0)
        moment = -self.hub_below * pull - shaft.sum(axis=0) - spring
        out = {
            "position": x["speed"],
            "speed": pull / m.mass - GRAVITY * np.sin(self.slope),
            "pitch": x["pitch_rate"],
            "pitch_rate": moment / self.pitch_inertia,
            "wheel_rate_front": turning[0],
            "wheel_rate_rear": turning[1],
            "tire_bristle_front": bent[0],
            "tire_bristle_rear": bent[1],
            "brake_bristle_front": bristle[0],
            "brake_bristle_rear": bristle[2],
            "line_front": oil["wheel_line"][0],
            "line_rear": oil["wheel_line"][2],
            **{name: rate for name, rate in oil.items() if name in LAYOUT},
            **self.engine.rates(x, drawn),
        }
        return np.array([float(np.ravel(out[name])[0]) for name in LAYOUT]) / SCALE

    def start(self, guess: Mapping[str, float]) -> np.ndarray:
        """Scaled states with the values of ``guess``; those that are not named are zero."""
        return np.array([guess.get(name, 0.0) for name in LAYOUT]) / SCALE

    def settled(self, guess: Mapping[str, float], commands: Commands, after: float = 40.0) -> np.ndarray:
        """Scaled states after a long time under ``commands``."""
        state = solve_ivp(
            lambda t, y: self.rates(y, commands), (0.0, after), self.start(guess), method="BDF", rtol=1e-7, atol=1e-8
        ).y[:, -1]
        state[0] = 0.0
        return state

    def run(
        self, state: np.ndarray, phases: Sequence[tuple[float, Commands]], every: float
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Instants [s] (F,) and states (F,) by name over ``phases`` of a duration [s] and commands.

        With ``motor_pressure`` [Pa], the mean over the wheels, and ``hinge_speed`` [m/s], the forward speed of the hinge's
        origin, which a twin calls its speed.
        """
        time, kept, begin = [], [], 0.0
        for duration, commands in phases:
            ticks = begin + every * np.arange(1, round(duration / every) + 1)
            found = solve_ivp(
                lambda t, y, commands=commands: self.rates(y, commands), (begin, begin + duration), state,
                t_eval=ticks, method="BDF", rtol=1e-7, atol=1e-8, max_step=0.05,
            )  # fmt: skip
            assert found.success, found.message
            time.append(ticks)
            kept.append(found.y)
            state, begin = found.y[:, -1], begin + duration
        states = np.concatenate(kept, axis=1) * SCALE[:, None]
        out = dict(zip(LAYOUT, states, strict=True))
        lines = 0.5 * (self.oil.pressure(out["line_front"]) + self.oil.pressure(out["line_rear"]))
        out["motor_pressure"] = lines - self.oil.pressure(out["drive_return"])
        out["hinge_speed"] = out["speed"] - self.centre_above * out["pitch_rate"]
        return np.concatenate(time), out
