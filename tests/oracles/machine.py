"""The whole machine as one continuous ODE y' = f(t, y) in float64 NumPy: the reference of the stepped float32 twin.

Bodies come from :mod:`tests.oracles.bodies`, oil from :mod:`tests.oracles.hydraulics`, tires from
:mod:`tests.oracles.tires`. Nothing here knows of time steps: an implicit variable-step solver integrates the equations,
restarted wherever a command jumps.

States are held by name (`LAYOUT`), in SI; the solver sees them divided by `SCALE` (pressures in MPa, ...), so that one
absolute tolerance suits all. The state vector may carry a trailing batch axis (n, k), which is how the finite-difference
Jacobian is taken in one call.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from tests.oracles.bodies import HALF_OF_WHEEL, BodyModel
from tests.oracles.hydraulics import ArmCircuit, Driveline, Engine, Hysteresis, Oil, SteeringCircuit, check_valve
from tests.oracles.tires import Plane, Tire, cross, hull_force

# name: (number, scale in SI)
LAYOUT = {
    "position": (3, 0.1),
    "quaternion": (4, 0.1),
    "theta": (1, 0.1),
    "phi": (4, 0.1),
    "psi": (4, 0.1),
    "velocity": (3, 0.1),
    "angular_velocity": (3, 0.1),
    "theta_rate": (1, 0.1),
    "phi_rate": (4, 0.1),
    "wheel_rate": (4, 0.1),
    "joint_bristle": (1, 1e-3),
    "arm_bristle": (4, 1e-3),
    "wheel_bristle": (4, 1e-3),
    "tire_bristle": (8, 1e-2),
    "supply": (1, 1e6),
    "a": (1, 1e6),
    "b": (1, 1e6),
    "return_line": (1, 1e6),
    "load_sensing": (1, 1e6),
    "spool": (1, 1.0),
    "compensator": (1, 1.0),
    "swash": (1, 1.0),
    "bore": (4, 1e6),
    "rod": (4, 1e6),
    "arm_spool": (4, 1.0),
    "drive_forward": (1, 1e6),
    "drive_return": (1, 1e6),
    "wheel_line": (4, 1e6),
    "charge": (1, 1e6),
    "drive_swash": (1, 1.0),
    "fraction_front": (1, 1.0),
    "fraction_rear": (1, 1.0),
    "traction_opening": (4, 1.0),
    "engine_speed": (1, 10.0),
    "governor": (1, 100.0),
    "engine_torque": (1, 100.0),
}
_STARTS = np.cumsum([0, *(count for count, _ in LAYOUT.values())])
SLICES = {name: slice(a, b) for name, (a, b) in zip(LAYOUT, pairwise(_STARTS), strict=True)}
SIZE = int(_STARTS[-1])
SCALE = np.concatenate([np.full(count, scale) for count, scale in LAYOUT.values()])
POSE, VELOCITY = slice(0, SLICES["psi"].stop), slice(SLICES["velocity"].start, SLICES["wheel_rate"].stop)


@dataclass
class Command:
    """Constant commands between two instants; arms and traction by wheel (fl, fr, rl, rr)."""

    steering_signal: float = 0.0
    drive_signal: float = 0.0
    arms: np.ndarray = field(default_factory=lambda: np.zeros(4))
    traction: np.ndarray = field(default_factory=lambda: np.ones(4))
    gear: int = 1
    parking_brake: float = 0.0


def unpack(y):
    """States by name from a solver vector (n,) or (n, k): scalars (k,), groups (4, k); k = 1 for a single vector."""
    y = np.asarray(y, float)
    if y.ndim == 1:
        y = y[:, None]
    x = y * SCALE[:, None]
    return {name: x[part] if part.stop - part.start > 1 else x[part.start] for name, part in SLICES.items()}


def pack(states):
    """Solver vector (n, k) from states by name."""
    k = max(
        np.atleast_1d(v).shape[-1] if np.ndim(v) == 2 or count == 1 else 1
        for (count, _), v in zip(LAYOUT.values(), (states[name] for name in LAYOUT), strict=True)
    )
    y = np.empty((SIZE, k))
    for name, part in SLICES.items():
        value = np.asarray(states[name], float)
        y[part] = value[:, None] if value.ndim == 1 and part.stop - part.start > 1 else value
    return y / SCALE[:, None]


def _heeded(law, command, signal):
    """A law of time and states whose floating-point errors are treated as where this was called."""
    usual = np.geterr()

    def rate(t, y):
        with np.errstate(**usual):
            return law(y, command, signal)

    return rate


class MachineOracle:
    """Right-hand side of the machine on plane ground."""

    def __init__(self, machine, ground: Plane | None = None, gravity: float = 9.81):
        self.machine = machine
        self.ground = ground or Plane()
        self.bodies = BodyModel(machine, gravity=gravity)
        self.oil = Oil(machine.oil)
        self.steering = SteeringCircuit(machine, self.oil)
        self.arms = ArmCircuit(machine, self.oil)
        self.driveline = Driveline(machine, self.oil)
        self.engine = Engine(machine.engine)
        self.tire = Tire(machine.tire)
        corners = []
        for s, part in ((1.0, machine.frame.front), (-1.0, machine.frame.rear)):
            middle = s * (part.axle_distance - part.cog_offset)
            low = machine.frame.ground_clearance
            corners.append(
                [
                    (middle + dx * part.hull_length, dy * part.hull_width, low + dz * part.hull_height)
                    for dx in (-0.5, 0.5)
                    for dy in (-0.5, 0.5)
                    for dz in (0.0, 1.0)
                ]
            )
        self.hull_corners = np.array(corners).transpose(2, 0, 1)  # (3, 2, 8)

    # ------------------------------------------------------------------------------------------------------- contacts
    def tires(self, kin, bristles):
        """World force (3, 4, k) and moment on the wheels, bristle rates (8, k) and contact data."""
        n_world = self.ground.normal
        k = kin.spin.shape[-1]
        gap = self.ground.gap(kin.wheel_center)
        n = kin.to_half(np.broadcast_to(n_world[:, None, None], (3, 4, k)), HALF_OF_WHEEL)
        velocity = kin.to_half(kin.wheel_velocity, HALF_OF_WHEEL)
        angular = kin.to_half(kin.frame_angular[:, HALF_OF_WHEEL], HALF_OF_WHEEL)
        z = bristles.reshape(4, 2, k).swapaxes(0, 1)
        force, moment, z_rate, info = self.tire.contact(
            gap, n, n_world[2], z, velocity, angular, kin.spin, self.ground.friction, self.ground.rolling_resistance
        )
        return (
            kin.to_world(force, HALF_OF_WHEEL),
            kin.to_world(moment, HALF_OF_WHEEL),
            z_rate.swapaxes(0, 1).reshape(8, k),
            info,
        )

    def hulls(self, kin):
        """World force and moment (about the hinge) of the ground on the two hulls (3, 2, k), or None without contact."""
        r = np.einsum("ijhk,jhc->ihck", kin.rotation, self.hull_corners)
        depth = self.ground.gap(kin.hinge[:, None, None] + r) * self.ground.normal[2]
        if not (depth > 0.0).any():
            return None, None
        velocity = kin.hinge_velocity[:, None, None] + cross(kin.frame_angular[:, :, None], r)
        force = hull_force(self.machine.hull, depth, self.ground.normal.reshape(3, 1, 1, 1), velocity)
        return force.sum(axis=2), cross(r, force).sum(axis=2)

    # ------------------------------------------------------------------------------------------------ right-hand side
    def evaluate(self, y, command: Command, steering_signal: float):
        """Rates by name and a dictionary of loads and flows; steering_signal: after delay and hysteresis."""
        s = unpack(y)
        flat = np.asarray(y, float).reshape(SIZE, -1) * SCALE[:, None]
        q, v = flat[POSE], flat[VELOCITY]
        oil = self.oil
        kin = self.bodies.kinematics(q, v)
        p_a, p_b = oil.pressure(s["a"]), oil.pressure(s["b"])
        p_s, p_t = oil.pressure(s["supply"]), oil.pressure(s["return_line"])
        theta, theta_rate, phi, phi_rate, w = (s[n] for n in ("theta", "theta_rate", "phi", "phi_rate", "wheel_rate"))

        tau_theta, joint_z, joint_parts = self.steering.cylinders.torque(
            theta, theta_rate, s["joint_bristle"], p_a, p_b
        )
        tau_phi, arm_z, arm_parts = self.arms.torque(
            phi, phi_rate, s["arm_bristle"], oil.pressure(s["bore"]), oil.pressure(s["rod"])
        )
        motor, brake, wheel_z = self.driveline.wheel_torque(s, w, command.parking_brake)
        tire_force, tire_moment, tire_z, contact = self.tires(kin, s["tire_bristle"])
        hull_f, hull_m = self.hulls(kin)
        acceleration = self.bodies.accelerations(
            q, v, tau_theta, tau_phi, motor + brake, tire_force, tire_moment, hull_f, hull_m
        )
        pose_rate = self.bodies.pose_rate(q, v)

        arm_rates, drawn, given, arm_load, arm_flows = self.arms.rates(
            s, command.arms[:, None], phi, phi_rate, p_s, p_t
        )
        omega = s["engine_speed"]
        steer_rates, steer_load, steer_flows = self.steering.rates(
            s, steering_signal, theta, theta_rate, omega, drawn, given, arm_load
        )
        drive_rates, drive_load, drive_flows = self.driveline.rates(
            s, command.drive_signal, command.traction[:, None], command.gear, w, omega
        )
        rates = {
            **arm_rates,
            **steer_rates,
            **drive_rates,
            **self.engine.rates(s, steer_load + drive_load),
            "joint_bristle": joint_z,
            "arm_bristle": arm_z,
            "wheel_bristle": wheel_z,
            "tire_bristle": tire_z,
        }
        rate = np.empty_like(flat)
        rate[POSE], rate[VELOCITY] = pose_rate, acceleration
        for name, value in rates.items():
            rate[SLICES[name]] = value
        info = {
            "kinematics": kin,
            "joint": joint_parts,
            "arms": arm_parts,
            "motor": motor,
            "brake": brake,
            "contact": contact,
            "tire_force": tire_force,
            "tire_moment": tire_moment,
            "steering": steer_flows,
            "arm_flows": arm_flows,
            "driveline": drive_flows,
            "steer_load": steer_load,
            "drive_load": drive_load,
        }
        return rate / SCALE[:, None], info

    def rhs(self, y, command, steering_signal):
        """y' in the shape of y."""
        return self.evaluate(y, command, steering_signal)[0].reshape(np.shape(y))

    def jacobian(self, y, command, steering_signal, step=1e-7):
        """d y'/d y (n, n) by forward differences of `step` scaled units, all columns in one call."""
        columns = np.concatenate([y[:, None], y[:, None] + step * np.eye(SIZE)], axis=1)
        f = self.evaluate(columns, command, steering_signal)[0]
        return (f[:, 1:] - f[:, :1]) / step

    # ----------------------------------------------------------------------------------------------------------- rest
    def rest_state(self, theta=0.0):
        """States by name (k = 1) of the machine at rest on flat ground with level frames; joint angle `theta` [rad].

        Every circuit is in its own equilibrium: leaks are made up by the pumps, the engine carries its idle load.
        """
        m, rest = self.machine, self.machine.rest
        s = {name: np.zeros(count) for name, (count, _) in LAYOUT.items()}
        s["quaternion"][0] = 1.0
        s["position"][2] = rest.height
        s["theta"][:] = theta
        s["phi"][:] = np.array([rest.arm_angle_front] * 2 + [rest.arm_angle_rear] * 2)
        pump, tank, charge = m.steering.pump, m.steering.tank_line, m.driveline.charge
        speed = m.engine.set_speed
        s["supply"][:] = pump.margin
        s["a"][:] = s["b"][:] = s["return_line"][:] = tank.back_pressure
        s["compensator"][:] = 1.0
        s["swash"][:] = pump.leakage * pump.margin / (pump.displacement * speed)
        s["rod"][:] = m.arm.rod_rest_pressure
        # An arm holds the wheel's load less the weight outward of its pivot.
        weight = 9.81 * (m.arm.mass * m.arm.cog_fraction + m.arm.motor_mass + m.wheel.mass) * m.arm.length
        load = np.array([rest.wheel_load_front] * 2 + [rest.wheel_load_rear] * 2) * m.arm.length
        torque = -(load - weight) * np.cos(s["phi"])
        _, _, _, slope_bore, slope_rod = self.arms.geometry(s["phi"])
        s["bore"][:] = (torque - s["rod"] * slope_rod) / slope_bore
        # Charge circuit: all of its flow but the two case leaks goes over its relief valve.
        line, cv, lam = m.driveline.pump.leakage, self.driveline.cv_check, self.oil.laminar
        supplied = charge.displacement * speed
        main = charge.relief_pressure
        for _ in range(50):
            p_c = charge.relief_pressure + charge.relief_ramp * (supplied - 2.0 * line * main) / charge.relief_flow
            main = p_c - charge.check_crack - line * main * np.sqrt(lam) / cv
        assert abs(check_valve(cv, p_c - main, charge.check_crack, lam) - line * main) < 1e-12
        s["charge"][:] = p_c
        s["drive_forward"][:] = s["drive_return"][:] = s["wheel_line"][:] = main
        s["fraction_front"][:] = s["fraction_rear"][:] = 1.0
        s["traction_opening"][:] = 1.0
        s["engine_speed"][:] = speed
        load = (
            s["swash"] * pump.displacement * pump.margin / pump.mechanical_efficiency
            + charge.displacement * p_c / charge.mechanical_efficiency
        )
        s["engine_torque"][:] = s["governor"][:] = self.engine.friction(speed) + load
        return s

    # ----------------------------------------------------------------------------------------------------- integration
    def integrate(self, start, steps, times, rtol=1e-6, atol=1e-6, method="BDF", max_step=np.inf, stats=None):
        """Solver vectors (n, len(times)) at ascending `times` from states `start` at t = 0.

        steps: (time, {command: value}) in ascending time, each holding until it is changed; the steering signal reaches
        the spool a command delay later, through the hysteresis. The solver restarts at every such instant.
        """
        times = np.asarray(times, float)
        delay = self.machine.steering.valve.command_delay
        hysteresis = Hysteresis(self.machine.steering.valve.hysteresis)
        events = []
        for when, change in steps:
            now = {name: value for name, value in change.items() if name != "steering_signal"}
            if now:
                events.append((when, now))
            if "steering_signal" in change:
                events.append((when + delay, {"steering_signal": change["steering_signal"]}))
        events.sort(key=lambda e: e[0])
        end = times[-1]
        edges = [0.0, *(t for t, _ in events if 0.0 < t < end), end]
        command, y, out = Command(), pack(start)[:, 0], []
        pending = list(events)
        signal = 0.0
        for left, right in pairwise(sorted(set(edges))):
            while pending and pending[0][0] <= left + 1e-12:
                for name, value in pending.pop(0)[1].items():
                    setattr(command, name, value)
                signal = hysteresis(command.steering_signal)
            wanted = times[(times >= left) & (times < right)]
            rate, jacobian = (_heeded(law, command, signal) for law in (self.rhs, self.jacobian))
            # SciPy's BDF subtracts memory that it has not written yet
            with np.errstate(invalid="ignore", over="ignore"):
                solution = solve_ivp(
                    rate,
                    (left, right),
                    y,
                    method=method,
                    t_eval=np.append(wanted, right),
                    rtol=rtol,
                    atol=atol,
                    max_step=max_step,
                    first_step=1e-6,
                    jac=jacobian,
                )
            if not solution.success or not np.isfinite(solution.y).all():
                raise RuntimeError(f"integration failed: {solution.message}")
            if stats is not None:
                for name in ("nfev", "njev", "nlu"):
                    stats[name] = stats.get(name, 0) + getattr(solution, name)
            out.append(solution.y[:, :-1])
            y = solution.y[:, -1]
        out.append(y[:, None])
        return np.concatenate(out, axis=1)[:, : times.size]

    def outputs(self, times, y):
        """Trajectory by name, SI: what the twin observes too; arrays (len(times),) or (number, len(times))."""
        s = unpack(y)
        oil = self.oil
        _, _, _, _, slope_a, _ = self.steering.cylinders.geometry(s["theta"])
        pressures = {
            name: oil.pressure(s[state])
            for name, state in (
                ("pump_pressure", "supply"),
                ("pressure_a", "a"),
                ("pressure_b", "b"),
                ("return_pressure", "return_line"),
                ("bore_pressure", "bore"),
                ("rod_pressure", "rod"),
                ("drive_pressure_forward", "drive_forward"),
                ("drive_pressure_return", "drive_return"),
                ("wheel_line_pressure", "wheel_line"),
                ("charge_pressure", "charge"),
            )
        }
        return {
            "time": np.asarray(times),
            "joint_angle": s["theta"],
            "joint_rate": s["theta_rate"],
            "joint_flow": slope_a * s["theta_rate"],
            **pressures,
            "ls_pressure": s["load_sensing"],
            "spool": s["spool"],
            "compensator": s["compensator"],
            "swash": s["swash"],
            "wheel_rate": s["wheel_rate"],
            "position": s["position"],
            "quaternion": s["quaternion"],
            "velocity": s["velocity"],
            "angular_velocity": s["angular_velocity"],
            "arm_angle": s["phi"],
            "arm_rate": s["phi_rate"],
            "engine_speed": s["engine_speed"],
            "engine_torque": s["engine_torque"],
        }


def simulate(machine, steps, theta0, duration, t_eval, ground=None, start=None, **options):
    """Integrate `machine` from rest at joint angle theta0 [rad] and return its trajectory by name (SI).

    steps: see MachineOracle.integrate; t_eval: instants wanted within [0, duration]; start: states by name instead of rest.
    """
    oracle = MachineOracle(machine, ground=ground)
    times = np.asarray(t_eval, float)
    inner = times if times[-1] >= duration else np.append(times, duration)
    y = oracle.integrate(oracle.rest_state(theta0) if start is None else start, steps, inner, **options)
    return oracle.outputs(times, y[:, : times.size])
