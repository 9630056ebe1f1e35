"""The plants' oil and engine: load-sensing steering circuit, closed driveline loop, diesel engine.

The equations of the published twin's kind, written for many runs at once: a state is a row of an array (rows, R). Within
a call of :meth:`Circuits.advance` the frames and wheels move at constant rates; the rows are integrated by a stabilised
explicit Runge-Kutta-Chebyshev method of second order, so that stiff valves need no Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aoro_gym.diagnosis_benchmark.plants.fluid import (
    ATMOSPHERE,
    Array,
    Constants,
    Oil,
    check_valve,
    density,
    orifice,
    relief_valve,
    viscosity,
)
from aoro_gym.diagnosis_benchmark.plants.friction import (
    BEARING_RATIO,
    clipped,
    dry_law,
    prandtl_force,
    stribeck_level,
)
from aoro_gym.diagnosis_benchmark.plants.linkage import Displacement, SteeringCylinders

SUPPLY, PORT_A, PORT_B, RETURN, FORWARD, BACK, CHARGE = range(7)
WHEEL_LINE = slice(7, 11)
VOLUMES = slice(0, 11)
LS, SPOOL, COMPENSATOR, SWASH, ENGINE, GOVERNOR, TORQUE, DRIVE_SWASH = range(11, 19)
PIN_ANGLE, PIN_RATE = 19, 20
NODES, COLUMNS = slice(21, 25), slice(25, 29)
VALVES, WALLS, LEGS = slice(21, 23), slice(23, 25), slice(25, 27)
"""Rows of the state. Pins exist where a joint is elastic; nodes (valve A, valve B, middle A, middle B) and columns of oil
(valve to middle A, B, middle to cylinder A, B) where hoses are distributed (level 2); nodes at the valve, what their walls
have stretched slowly [m³], and one column of oil a side, where hoses are in two halves (level 3)."""

OPERATING = 1e-3
"""Flow [m³/s], 60 L/min, at which resistances are stated."""

HOSE_BORE = 12.7e-3
"""[m] of each of the two legs that a joint hose divides into."""

UNSTEADY = 8.0
"""Unsteady over steady laminar friction of a joint hose at its own frequencies (Zielke's weighting at ω r²/ν ≈ 2000)."""

PISTON_INERTIA = 2.0
"""[kg m²] about the joint of what moves between play and oil: rods and pistons, about 30 kg each at 0.18 m."""

PIN_STIFFNESS = 1.3e7
"""[N m/rad] about the joint of pins that touch: 2e8 N/m each at a lever of 0.18 m."""

LEAST_COMPLIANCE = 1e-8
"""[rad/(N m)] below which a frame's flexibility cannot be stepped, nor seen: 0.005° at 10 kN m."""


SLOW_SHARE, SLOW_TIME = 0.4, 0.02
"""Share of a hose's wall that stretches late, and its time constant [s] (level 3, estimates; rubber: 10 to 100 ms)."""


@dataclass(frozen=True)
class Chebyshev:
    """Coefficients of the Runge-Kutta-Chebyshev method of second order with ``stages`` ≥ 2 stages, damping 2/13.

    Stable for real eigenvalues up to about 0.65 stages² / h. Source: Sommeijer, Shampine and Verwer, J. Comput. Appl. Math.
    88 (1998) 315.
    """

    stages: int

    def __post_init__(self) -> None:
        if self.stages < 2:
            raise ValueError(f"stages is {self.stages}, but must be an integer of at least 2")

    def steps(self) -> tuple[float, list[tuple[float, float, float, float, float]], list[float]]:
        """First stage's μ̃, then (1 − μ − ν, μ, ν, μ̃, γ̃) of each further one, and the instants c of all stages."""
        w0 = 1.0 + 2.0 / 13.0 / self.stages**2
        value, first, second = [1.0, w0], [0.0, 1.0], [0.0, 0.0]
        for _ in range(2, self.stages + 1):
            value.append(2.0 * w0 * value[-1] - value[-2])
            first.append(2.0 * w0 * first[-1] - first[-2] + 2.0 * value[-2])
            second.append(2.0 * w0 * second[-1] - second[-2] + 4.0 * first[-2])
        w1 = first[-1] / second[-1]
        b = [0.0, 0.0] + [second[j] / first[j] ** 2 for j in range(2, self.stages + 1)]
        b[0] = b[1] = b[2]
        a = [1.0 - b[j] * value[j] for j in range(self.stages + 1)]
        rest, times = [], [0.0, b[1] * w1]
        for j in range(2, self.stages + 1):
            mu, nu, slope = 2.0 * b[j] * w0 / b[j - 1], -b[j] / b[j - 2], 2.0 * b[j] * w1 / b[j - 1]
            back = -a[j - 1] * slope
            rest.append((1.0 - mu - nu, mu, nu, slope, back))
            times.append(mu * times[-1] + nu * times[-2] + slope + back)
        return b[1] * w1, rest, times


@dataclass
class StepConstants:
    """What stays for the length of one call, such as what belongs to the side that the spool stands on; (R,)."""

    left: Array
    inlet: Array  # conductance of the open edges
    outlet: Array
    start: Array  # [V] signal at which the curve begins
    slopes: tuple[Array, Array, Array]  # of the opening curve [1/V]
    full_load: Array  # brake torque [N m] that the engine can give; half a millisecond changes it by 0.1 N m


@dataclass(frozen=True)
class ValveFlows:
    """Flows [m³/s] and pressures [Pa] of the steering valve at one instant; (R,)."""

    inflow: Array  # from the supply
    returned: Array  # to the return line
    into_a: Array
    into_b: Array
    sensed: Array  # pressure that the load-sensing line takes up
    stroke: Array  # of the compensator, [0, 1]
    edge_drop: Array  # pressure over the open inlet edge


class Circuits:
    """Steering circuit, driveline and engine of R runs."""

    def __init__(self, constants: Constants, level: int, stages: int):
        self.constants = p = constants
        self.level = level
        self.oil = Oil(p, level)
        self.cylinders = SteeringCylinders(p)
        self.runs = len(p["oil.bulk_modulus"])
        self.elastic = (p["joint.play"] > 0.0) | (p["joint.compliance"] > 0.0)
        self.hoses = level >= 2
        self.cells = 1 if level == 3 else 2  # of a hose, beside its end at the cylinders
        self.nodes = VALVES if level == 3 else NODES
        self.dry = dry_law(level)
        self.pocket = p["steering.pocket_a"]
        self._first, self._rest, self._times = Chebyshev(stages).steps()
        self._valve()
        self._pump_and_lines()
        self._driveline()
        self._engine()
        self._seals()
        self.rows = PIN_RATE + 1 if self.elastic.any() else PIN_ANGLE
        if self.hoses:
            self.rows = COLUMNS.stop if self.cells == 2 else LEGS.stop

    # ------------------------------------------------------------------------------------------------------- constants
    def _valve(self) -> None:
        p, valve = self.constants, "steering.valve."
        edge = 1.0 + p[valve + "edge_gain"]
        kink = p[valve + "kink_b"]  # Δp/Q² [Pa s²/m⁶] in series with port B's outlet

        def nominal(side: str, way: str) -> Array:
            return edge * p[valve + f"nominal_flow_{side}"] / np.sqrt(p[valve + f"nominal_drop_{way}_{side}"])

        self.edges = {
            "inlet": (nominal("left", "in"), nominal("right", "in")),
            "outlet": ((nominal("left", "out") ** -2 + kink) ** -0.5, nominal("right", "out")),
        }
        self.compensator = np.maximum(p[valve + "nominal_flow_left"], p[valve + "nominal_flow_right"]) / np.sqrt(
            p[valve + "compensator_open_drop"]
        )
        self.curve = {}
        for side in ("left", "right"):
            start, low, middle = (
                p[valve + f"{name}_{side}{suffix}"]
                for name, suffix in (("dead_band", ""), ("opening", "_1V0"), ("opening", "_1V5"))
            )
            self.curve[side] = (start, low / (1.0 - start), 2.0 * (middle - low), 2.0 * (1.0 - middle))
        self.shift = p[valve + "curve_shift"]
        self.setting = p[valve + "compensator_pressure"]
        self.droop = p[valve + "compensator_droop"]
        self.compensator_rate = 1.0 / (self.setting * p[valve + "compensator_time_constant"])
        self.spool_pace = 1.0 / p[valve + "spool_time_constant"]
        self.spool_rate = p[valve + "spool_rate_limit"]
        self.shock_setting = np.stack(
            [p[valve + "shock_pressure"] - p[valve + "shock_drop_a"], p[valve + "shock_pressure"]]
        )
        self.shock_gain = p[valve + "shock_flow"] / p[valve + "shock_ramp"]
        self.suction = p[valve + "anticavitation_flow"] / np.sqrt(p[valve + "anticavitation_drop"])
        self.crack = p[valve + "anticavitation_crack"]
        self.port_leak = np.stack([p[valve + "leakage"] + p[valve + "leak_a"], p[valve + "leakage"]])
        self.cylinder_leak = 2.0 * p["steering.cylinder.leakage"]
        self.cross_orifice = p[valve + "cross_orifice"]
        self.crossing = bool(np.any(self.cross_orifice > 0.0))
        self.laminar = p["oil.laminar_pressure"]

    def _pump_and_lines(self) -> None:
        p, pump, tank = self.constants, "steering.pump.", "steering.tank_line."
        self.pump_size = p[pump + "displacement"]
        self.pump_leak = p[pump + "leakage"]
        self.bleed = p[pump + "bleed_flow"] / np.sqrt(p[pump + "bleed_drop"])
        self.supply_setting = p[pump + "relief_pressure"]
        self.supply_gain = p[pump + "relief_flow"] / p[pump + "relief_ramp"]
        self.margin, self.cutoff = p[pump + "margin"], p[pump + "cutoff"]
        self.swash_gain = 1.0 / (p[pump + "control_band"] * p[pump + "stroke_up_time"])
        self.swash_up, self.swash_down = 1.0 / p[pump + "stroke_up_time"], -1.0 / p[pump + "stroke_down_time"]
        self.ls_pace = 1.0 / p[pump + "ls_time_constant"]
        self.back_pressure = p[tank + "back_pressure"]
        self.back_slope = p[tank + "back_pressure_ramp"] / p[tank + "back_flow"]
        self.throttle = p[tank + "throttle"]
        self.throttled = bool(np.any(self.throttle > 0.0))
        self.tank_suction = p[tank + "suction_flow"] / np.sqrt(p[tank + "suction_drop"])
        # volumes [m³] of oil and compliances [m³/Pa] of walls, a row a volume; chambers change and are set in `advance`
        hose = p["steering.hose_volume"]
        wall = hose / p["steering.hose_bulk_modulus"] + p["steering.hose_wall"]
        self.fixed = hose + 2.0 * p["steering.cylinder.dead_volume"]
        drive_modulus = p["driveline.hose_bulk_modulus"]
        main, wheel, charge = (p[f"driveline.{n}"] for n in ("main_volume", "wheel_hose_volume", "charge.volume"))
        supply, back = p[pump + "line_volume"], p[tank + "volume"]
        self.volume = np.stack([supply, self.fixed, self.fixed, back, main, main, charge, wheel, wheel, wheel, wheel])
        drive = np.stack([main, main, charge, wheel, wheel, wheel, wheel]) / drive_modulus
        self.wall = np.concatenate(
            [[supply / p[pump + "hose_bulk_modulus"], wall, wall, back / p[tank + "hose_bulk_modulus"]], drive]
        )
        middle = self.cylinders.at(np.zeros(self.runs))
        self.void = self.volume.copy()
        self.void[PORT_A] += middle.volume_a
        self.void[PORT_B] += middle.volume_b
        self.void /= p["oil.bulk_modulus"]
        self.least = p["oil.void_pressure"]
        if self.hoses:
            # two volumes a side or three, the last joined to the cylinders; columns of oil between them
            part, area = hose / (self.cells + 1), 2.0 * 0.25 * np.pi * HOSE_BORE**2
            self.hose_volume, self.hose_wall = part, wall / (self.cells + 1)
            self.hose_void = part / p["oil.bulk_modulus"]
            self.volume[PORT_A:RETURN] -= self.cells * part
            self.wall[PORT_A:RETURN] -= self.cells * self.hose_wall
            length = hose / area
            self.column = density(p["oil.celsius"]) * length / self.cells / area  # inertance [Pa s²/m³]
            radius_squared = 0.25 * HOSE_BORE**2
            self.column_decay = UNSTEADY * 8.0 * viscosity(p["oil.celsius"]) / radius_squared  # [1/s]

    def _driveline(self) -> None:
        p, drive = self.constants, "driveline."
        self.drive_size, self.drive_leak = p[drive + "pump.displacement"], p[drive + "pump.leakage"]
        self.drive_cross = p[drive + "pump.cross_leakage"]
        self.drive_pace, self.drive_stroke = 1.0 / p[drive + "pump.time_constant"], 1.0 / p[drive + "pump.stroke_time"]
        self.charge_size = p[drive + "charge.displacement"]
        self.charge_setting = p[drive + "charge.relief_pressure"]
        self.charge_gain = p[drive + "charge.relief_flow"] / p[drive + "charge.relief_ramp"]
        self.charge_check = p[drive + "charge.check_flow"] / np.sqrt(p[drive + "charge.check_drop"])
        self.charge_crack = p[drive + "charge.check_crack"]
        self.shift_pressure = p[drive + "flush.shift_pressure"]
        self.flush_setting, self.flush_gain = (
            p[drive + "flush.pressure"],
            p[drive + "flush.flow"] / p[drive + "flush.ramp"],
        )
        self.cross_setting = p[drive + "relief.pressure"]
        self.cross_gain = p[drive + "relief.flow"] / p[drive + "relief.ramp"]
        self.traction = p[drive + "traction.nominal_flow"] / np.sqrt(p[drive + "traction.pressure_drop"])
        self.motor_size, self.motor_leak = p[drive + "motor.displacement"], p[drive + "motor.leakage"]
        self.efficiency = {
            name: p[f"{key}.mechanical_efficiency"]
            for name, key in (("steer", "steering.pump"), ("drive", drive + "pump"), ("charge", drive + "charge"))
        }

    def _engine(self) -> None:
        p, rpm = self.constants, np.pi / 30.0
        speeds = np.array([0.0, 300.0, 900.0, 1200.0, 1400.0, 1600.0, 1800.0, 2000.0, 2200.0, 2400.0, 2600.0]) * rpm
        zero = np.zeros(self.runs)
        torques = [zero, zero, *(p[f"engine.torque.rpm_{n}"] for n in (900, 1200, 1400, 1600, 1800, 2000, 2200, 2400))]
        self.full_speeds, self.full_torque = speeds, np.stack([*torques, zero])
        self.set_speed = p["engine.set_speed"]
        self.engine_friction = p["engine.friction_0"], p["engine.friction_1"]
        self.proportional, self.integral = p["engine.governor_proportional"], p["engine.governor_integral"]
        self.torque_pace, self.smoke = 1.0 / p["engine.torque_time_constant"], p["engine.smoke_rate"]
        self.engine_inertia = p["engine.inertia"]
        # fall [rad/s per N m of brake torque] of the speed that the governor holds
        self.engine_droop = p["engine.droop"] * self.set_speed / self.ceiling(self.set_speed)

    def _seals(self) -> None:
        p, part = self.constants, "steering.cylinder."
        self.preload, self.pressed = p[part + "seal_preload"], p[part + "seal_pressure_coefficient"]
        self.static_ratio, self.stribeck = p[part + "seal_static_ratio"], p[part + "seal_stribeck_velocity"]
        self.viscous = p[part + "seal_viscous"]
        self.bearing = p["joint.friction_torque"]
        self.bump = p["joint.bump"]
        self.presliding = p["joint.presliding_stiffness"], p["joint.presliding_damping"]
        stop = 2.0 * self.cylinders.mean_lever**2
        self.stop = stop * p["joint.stop_stiffness"], stop * p["joint.stop_damping"]
        self.play = 0.5 * p["joint.play"]
        compliance = np.where(p["joint.compliance"] > 0.0, np.maximum(p["joint.compliance"], LEAST_COMPLIANCE), 0.0)
        compliance = compliance + np.where(p["joint.play"] > 0.0, 1.0 / PIN_STIFFNESS, 0.0)
        self.series = np.where(self.elastic, 1.0 / np.where(self.elastic, compliance, 1.0), 0.0)
        self.series_damping = np.sqrt(2.0 * self.series * PISTON_INERTIA)  # 0.7 of critical for rods and pistons alone

    # ----------------------------------------------------------------------------------------------------------- start
    def at_rest(self, angle: Array) -> Array:
        """State (rows, R) of idle circuits at the joint ``angle`` [rad]: pumps make up the leaks, the charge relief takes
        what is left."""
        y = np.zeros((self.rows, self.runs))
        y[SUPPLY] = self.margin
        y[PORT_A] = y[PORT_B] = y[RETURN] = self.back_pressure
        y[COMPENSATOR] = 1.0
        y[ENGINE] = self.set_speed
        y[SWASH] = self.pump_leak * self.margin / (self.pump_size * self.set_speed)
        supplied, main = self.charge_size * self.set_speed, self.charge_setting
        for _ in range(50):
            charge = self.charge_setting + (supplied - 2.0 * self.drive_leak * main) / self.charge_gain
            main = charge - self.charge_crack - self.drive_leak * main * np.sqrt(self.laminar) / self.charge_check
        y[CHARGE], y[FORWARD], y[BACK], y[WHEEL_LINE] = charge, main, main, main
        load = self.loads(y[SWASH], y[SUPPLY], np.zeros(self.runs), main, main, charge)
        y[ENGINE] -= self.engine_droop * load
        y[TORQUE] = y[GOVERNOR] = self.engine_friction[0] + self.engine_friction[1] * y[ENGINE] + load
        if self.rows > PIN_ANGLE:
            y[PIN_ANGLE] = angle
        if self.hoses:
            y[self.nodes] = self.back_pressure
        if self.cells == 1:
            y[WALLS] = SLOW_SHARE * self.hose_wall * self.back_pressure
        return y

    def loads(
        self, swash: Array, supply: Array, drive_swash: Array, forward: Array, back: Array, charge: Array
    ) -> Array:
        """Torque [N m] that the three pumps take from the engine.

        Args:
            swash: Of pump 2 (R,), 0 to 1.
            supply: Its pressure (R,) [Pa].
            drive_swash: Of pump 1 (R,), −1 to 1.
            forward: Pressure (R,) [Pa] of the loop's forward side.
            back: Pressure (R,) [Pa] of its other side.
            charge: Charge pressure (R,) [Pa].
        """
        drive = drive_swash * self.drive_size * (forward - back)
        return (
            swash * self.pump_size * supply / self.efficiency["steer"]
            + drive
            + (1.0 - self.efficiency["drive"]) * np.abs(drive)
            + self.charge_size * charge / self.efficiency["charge"]
        )

    def ceiling(self, speed: Array) -> Array:
        """Brake torque at full load [N m] at ``speed`` [rad/s]: straight lines between the curve's points."""
        right = np.clip(np.searchsorted(self.full_speeds, speed), 1, len(self.full_speeds) - 1)
        each = np.arange(self.runs)
        low, high = self.full_speeds[right - 1], self.full_speeds[right]
        share = np.clip((speed - low) / (high - low), 0.0, 1.0)
        return (1.0 - share) * self.full_torque[right - 1, each] + share * self.full_torque[right, each]

    # ----------------------------------------------------------------------------------------------------------- forces
    def pressure(self, state: Array) -> Array:
        """Pressures of volume states: below the void pressure a state counts the void instead."""
        return np.maximum(state, self.least)

    def seal_levels(self, lever: Array, rate: Array, pressed: Array) -> tuple[Array, Array]:
        """Sliding and static torque [N m] of the seals of one cylinder; ``pressed`` [Pa]: sum of its ports' pressures."""
        sliding = np.abs(lever) * (self.preload + self.pressed * pressed)
        return sliding, sliding * self.static_ratio

    def bearing_torque(self, angle: Array) -> Array:
        """Breakaway torque of the joint's bearing [N m]; a damaged spot 0.1 rad wide lies at 0.4 rad to the right."""
        return self.bearing + self.bump * np.exp(-(((angle + 0.4) / 0.1) ** 2))

    def cylinder_torque(
        self, at: Displacement, angle: Array, rate: Array, stretch: Array, p_a: Array, p_b: Array
    ) -> Array:
        """Torque [N m] of oil, seals, bearing and end stops on the joint angle.

        Args:
            at: Geometry of the cylinders at ``angle``.
            angle: Joint angle (R,) [rad].
            rate: Joint rate (R,) [rad/s].
            stretch: Bristle (R,) [rad] of the dry friction.
            p_a: Pressure (R,) [Pa] of port A.
            p_b: Pressure (R,) [Pa] of port B.
        """
        torque = p_a * at.slope_a + p_b * at.slope_b - self.viscous * (at.right**2 + at.left**2) * rate
        torque += self._stop(angle, rate)
        if self.level == 0:
            return torque + prandtl_force(stretch, rate, *self.presliding, self.capacity(at, angle, rate, p_a, p_b))
        bearing = self.bearing_torque(angle)
        lever = self.cylinders.mean_lever
        torque += self.dry(lever * rate, bearing / BEARING_RATIO, bearing)
        pressed = np.maximum(p_a, 0.0) + np.maximum(p_b, 0.0)
        for arm in (at.right, at.left):
            sliding, static = self.seal_levels(arm, rate, pressed)
            torque += self.dry(np.abs(arm) * rate, sliding, static)
        return torque

    def capacity(self, at: Displacement, angle: Array, rate: Array, p_a: Array, p_b: Array) -> Array:
        """Torque [N m] at which the dry friction of level 0 slides.

        Args:
            at: Geometry of the cylinders at ``angle``.
            angle: Joint angle (R,) [rad].
            rate: Joint rate (R,) [rad/s].
            p_a: Pressure (R,) [Pa] of port A.
            p_b: Pressure (R,) [Pa] of port B.
        """
        pressed = np.maximum(p_a, 0.0) + np.maximum(p_b, 0.0)
        total = self.bearing_torque(angle)
        for lever in (at.right, at.left):
            sliding, _ = self.seal_levels(lever, rate, pressed)
            total = total + stribeck_level(sliding, self.static_ratio, lever * rate, self.stribeck)
        return total

    def side(self, left: Array, engine_speed: Array) -> StepConstants:
        """What belongs to a spool on its left side where ``left`` (R,) says so, else on its right one, and to the engine's
        speed [rad/s]."""
        sides = self.curve["left"], self.curve["right"]
        start, *slopes = (np.where(left, one, other) for one, other in zip(*sides, strict=True))
        inlet, outlet = (np.where(left, *self.edges[name]) for name in ("inlet", "outlet"))
        return StepConstants(left, inlet, outlet, start, (slopes[0], slopes[1], slopes[2]), self.ceiling(engine_speed))

    def opening(self, volts: Array, side: StepConstants) -> Array:
        """Opening [0, 1] of the edges at the spool's ``volts`` [V] from the middle: three straight lines."""
        signal = np.maximum(volts - self.shift, 0.0)
        return (
            side.slopes[0] * np.minimum(np.maximum(signal - side.start, 0.0), 1.0 - side.start)
            + side.slopes[1] * np.minimum(np.maximum(signal - 1.0, 0.0), 0.5)
            + side.slopes[2] * np.minimum(np.maximum(signal - 1.5, 0.0), 0.5)
        )

    def return_flow(self, tank: Array) -> Array:
        """Flow [m³/s] from the return line at ``tank`` [Pa] through its filter, p − p₀ = r Q + a Q²."""
        over = np.maximum(tank - self.back_pressure, 0.0)
        if not self.throttled:
            return over / self.back_slope
        return 2.0 * over / (self.back_slope + np.sqrt(self.back_slope**2 + 4.0 * self.throttle * over))

    def _stop(self, angle: Array, rate: Array) -> Array:
        side = np.sign(angle)
        depth = np.abs(angle) - self.cylinders.reach
        push = np.maximum(self.stop[0] * depth + self.stop[1] * side * rate, 0.0)
        return np.where(depth > 0.0, -side * push, 0.0)

    def series_torque(self, pin: Array, pin_rate: Array, angle: Array, rate: Array) -> Array:
        """Torque [N m] that play and frame pass on to the joint; zero within the play, and it never pulls at the edge."""
        apart = pin - angle
        stretch = apart - clipped(apart, self.play)
        torque = self.series * stretch + self.series_damping * (pin_rate - rate)
        touching = (self.play == 0.0) | ((stretch != 0.0) & (torque * stretch > 0.0))
        return np.where(touching, torque, 0.0)

    # -------------------------------------------------------------------------------------------------------- integrator
    def advance(
        self, y: Array, stretch: Array, angle: Array, rate: Array, wheel_rate: Array, steer: Array, drive: Array,
        duration: float, steps: int,
    ) -> tuple[Array, Array]:  # fmt: skip
        """State (rows, R) and joint bristle (R,) after ``duration`` [s] in ``steps`` steps.

        Args:
            y: State (rows, R).
            stretch: Joint bristle (R,) [rad].
            angle: Joint angle (R,) [rad] at the start.
            rate: Its rate (R,) [rad/s].
            wheel_rate: Wheel speeds (4, R) [rad/s].
            steer: Command (R,) that reaches the spool.
            drive: Command (R,) that reaches the drive pump.
            duration: Time [s].
            steps: Number of steps.
        """
        side = self.side(y[SPOOL] > 0.0, y[ENGINE])
        pin = np.where(self.elastic, y[PIN_ANGLE], angle) if self.elastic.any() else angle
        at = self.cylinders.at(pin)
        step = duration / steps
        before = angle
        inputs = side, at, pin, rate, wheel_rate, steer, drive
        for _ in range(steps):
            first = self._rates(y, stretch, before, *inputs, 0.0)
            older, newer = y, y + (self._first * step) * first
            for (rest, mu, nu, slope, back), instant in zip(self._rest, self._times[1:-1], strict=True):
                now = self._rates(newer, stretch, before, *inputs, instant * step)
                older, newer = newer, rest * y + mu * newer + nu * older + step * (slope * now + back * first)
            y = newer
            np.clip(y[COMPENSATOR], 0.0, 1.0, out=y[COMPENSATOR])
            np.clip(y[SWASH], 0.0, 1.0, out=y[SWASH])
            before = before + step * rate
            if self.elastic.any():
                y[PIN_ANGLE] = np.where(self.elastic, y[PIN_ANGLE], before)
                y[PIN_RATE] = np.where(self.elastic, y[PIN_RATE], rate)
                p_a, p_b = self.cylinder_pressures(y)
                limit = self.capacity(at, y[PIN_ANGLE], y[PIN_RATE], p_a, p_b) / self.presliding[0]
                stretch = np.where(self.elastic, clipped(stretch + step * y[PIN_RATE], limit), stretch)
        return y, stretch

    def cylinder_pressures(self, y: Array) -> tuple[Array, Array]:
        """Pressures [Pa] (R,) at the cylinders' ports A and B."""
        return self.pressure(y[PORT_A]), self.pressure(y[PORT_B])

    def _rates(
        self, y: Array, stretch: Array, before: Array, side: StepConstants, at: Displacement, middle: Array, rate: Array,
        wheel_rate: Array, steer: Array, drive: Array, elapsed: float,
    ) -> Array:  # fmt: skip
        """Time derivatives (rows, R) at ``elapsed`` [s] after the start of a step."""
        out = np.empty_like(y)
        p = np.maximum(y[VOLUMES], self.least)
        port_a, port_b = p[PORT_A], p[PORT_B]
        pin_angle, pin_rate = self._pin_rates(out, y, stretch, at, before + elapsed * rate, rate, p)
        moved = pin_angle - middle

        # the valve meets the ports at the cylinders, or at the hoses' other end
        nodes = np.maximum(y[self.nodes], self.least) if self.hoses else p[PORT_A:RETURN]
        valve = self._valve_flows(y, p, nodes[0], nodes[1], side)
        into_a, into_b = valve.into_a, valve.into_b
        if self.hoses:
            into_a, into_b = self._hose_rates(out, y, nodes, into_a, into_b, p)
        cross = self.cylinder_leak * (port_a - port_b)
        swash = np.minimum(np.maximum(y[SWASH], 0.0), 1.0)

        net = np.empty((11, self.runs))
        net[SUPPLY] = self._pump_flow(swash, y[ENGINE], p[SUPPLY], y[LS]) - valve.inflow
        net[RETURN] = valve.returned - self.return_flow(p[RETURN])
        net[RETURN] += check_valve(self.tank_suction, -p[RETURN], 0.0, self.laminar)
        net[PORT_A] = into_a - cross - (at.slope_a + at.curve_a * moved) * pin_rate
        net[PORT_B] = into_b + cross - (at.slope_b + at.curve_b * moved) * pin_rate
        self._driveline_flows(net, p, y[DRIVE_SWASH], y[ENGINE], wheel_rate)
        # oil and walls yield; a volume that has run empty collects its void first
        out[VOLUMES] = net / np.where(y[VOLUMES] > self.least, self._compliance(p, at, moved), self.void)

        self._control_rates(out, y, valve, p[SUPPLY], steer, drive)
        load = self.loads(swash, p[SUPPLY], y[DRIVE_SWASH], p[FORWARD], p[BACK], p[CHARGE])
        self._engine_rates(out, y, side.full_load, load)
        return out

    def _pin_rates(
        self, out: Array, y: Array, stretch: Array, at: Displacement, angle: Array, rate: Array, p: Array
    ) -> tuple[Array, Array]:
        """Angle [rad] and rate of the cylinders: they follow the frames, or turn within play and flexible frame."""
        if self.elastic.any():
            pin_angle = np.where(self.elastic, y[PIN_ANGLE], angle)
            pin_rate = np.where(self.elastic, y[PIN_RATE], rate)
            series = self.series_torque(pin_angle, pin_rate, angle, rate)
            push = self.cylinder_torque(at, pin_angle, pin_rate, stretch, p[PORT_A], p[PORT_B])
            out[PIN_RATE] = np.where(self.elastic, (push - series) / PISTON_INERTIA, 0.0)
            out[PIN_ANGLE] = pin_rate
            return pin_angle, pin_rate
        if self.rows > PIN_ANGLE:
            out[PIN_ANGLE] = out[PIN_RATE] = 0.0
        return angle, rate

    def _valve_flows(self, y: Array, p: Array, valve_a: Array, valve_b: Array, side: StepConstants) -> ValveFlows:
        """Flows of compensator, edges, shock and suction valves, and leaks, at the valve's ports A and B [Pa]."""
        supply, tank = p[SUPPLY], p[RETURN]
        opening = self.opening(2.0 * np.abs(y[SPOOL]), side)
        is_open = opening > 0.0
        loaded, emptied = np.where(side.left, valve_a, valve_b), np.where(side.left, valve_b, valve_a)
        stroke = np.minimum(np.maximum(y[COMPENSATOR], 0.0), 1.0)
        throttle_squared = (stroke * self.compensator) ** 2
        edge = opening * side.inlet
        both = throttle_squared + edge**2 + 1e-30
        available = np.maximum(supply - loaded, 0.0)
        inflow = orifice(edge * np.sqrt(throttle_squared / both), available, self.laminar)
        outflow = orifice(opening * side.outlet, emptied - tank, self.laminar)

        over = np.stack([valve_a, valve_b]) - tank
        shock = relief_valve(over, self.shock_setting, self.shock_gain)
        suction = check_valve(self.suction, -over, self.crack, self.laminar)
        out_of_ports = shock - suction + self.port_leak * over
        cross = orifice(self.cross_orifice, valve_a - valve_b, self.laminar) if self.crossing else 0.0
        return ValveFlows(
            inflow=inflow,
            returned=outflow + out_of_ports[0] + out_of_ports[1],
            into_a=np.where(side.left, inflow, -outflow) - out_of_ports[0] - cross,
            into_b=np.where(side.left, -outflow, inflow) - out_of_ports[1] + cross,
            sensed=np.maximum(np.where(is_open, loaded, 0.0), 0.0),
            stroke=stroke,
            edge_drop=np.where(is_open, available * throttle_squared / both, 0.0),
        )

    def _hose_rates(
        self, out: Array, y: Array, nodes: Array, into_a: Array, into_b: Array, p: Array
    ) -> tuple[Array, Array]:
        """Flows [m³/s] out of the hoses into the cylinders, where ``into_a`` and ``into_b`` enter them at the valve."""
        ports = p[PORT_A:RETURN]
        if self.cells == 1:
            legs = y[LEGS]
            out[WALLS] = (SLOW_SHARE * self.hose_wall * nodes - y[WALLS]) / SLOW_TIME
            yielding = self.hose_volume * self.oil.compressibility(nodes) + (1.0 - SLOW_SHARE) * self.hose_wall
            gained = np.stack([into_a, into_b]) - legs - out[WALLS]
            out[VALVES] = gained / np.where(y[VALVES] > self.least, yielding, self.hose_void)
            out[LEGS] = (nodes - ports) / self.column - self.column_decay * legs
            return legs[0], legs[1]
        columns = y[COLUMNS]
        gained = np.stack([into_a, into_b, columns[0], columns[1]]) - columns
        yielding = self.hose_volume * self.oil.compressibility(nodes) + self.hose_wall
        out[NODES] = gained / np.where(y[NODES] > self.least, yielding, self.hose_void)
        ends = np.concatenate([nodes[2:], ports])
        out[COLUMNS] = (nodes - ends) / self.column - self.column_decay * columns
        return columns[2], columns[3]

    def _pump_flow(self, swash: Array, speed: Array, supply: Array, sensed: Array) -> Array:
        """Flow [m³/s] of the steering pump, less its leak, the bleed of the load-sensing line and the relief valve's."""
        return (
            swash * self.pump_size * speed
            - self.pump_leak * supply
            - orifice(self.bleed, sensed, self.laminar)
            - relief_valve(supply, self.supply_setting, self.supply_gain)
        )

    def _driveline_flows(self, net: Array, p: Array, swash: Array, speed: Array, wheel_rate: Array) -> None:
        """Write the net flows [m³/s] into the closed loop's volumes."""
        forward, back, charge, wheel = p[FORWARD], p[BACK], p[CHARGE], p[WHEEL_LINE]
        across = forward - back
        size = np.abs(across)
        passed = self.drive_cross * across + np.sign(across) * relief_valve(size, self.cross_setting, self.cross_gain)
        pumped = swash * self.drive_size * speed - passed
        checks = check_valve(self.charge_check, charge - p[FORWARD : BACK + 1], self.charge_crack, self.laminar)
        shifted = np.minimum(np.maximum(size / self.shift_pressure - 1.0, 0.0), 1.0)
        flush = shifted * relief_valve(np.minimum(forward, back), self.flush_setting, self.flush_gain)
        lower = forward < back
        traction = orifice(self.traction, forward - wheel, self.laminar)
        motor = self.motor_size * wheel_rate + self.motor_leak * (wheel - back)
        net[FORWARD] = (
            pumped - self.drive_leak * forward + checks[0] - np.where(lower, flush, 0.0) - traction.sum(axis=0)
        )
        net[BACK] = -pumped - self.drive_leak * back + checks[1] - np.where(lower, 0.0, flush) + motor.sum(axis=0)
        relief = relief_valve(charge, self.charge_setting, self.charge_gain)
        net[CHARGE] = self.charge_size * speed - checks[0] - checks[1] - relief
        net[WHEEL_LINE] = traction - motor

    def _compliance(self, p: Array, at: Displacement, moved: Array) -> Array:
        """Volume [m³/Pa] that oil and walls of every volume yield."""
        volume = self.volume.copy()
        volume[PORT_A] += at.volume_a + moved * (at.slope_a + 0.5 * at.curve_a * moved)
        volume[PORT_B] += at.volume_b + moved * (at.slope_b + 0.5 * at.curve_b * moved)
        compliance = volume * self.oil.compressibility(p) + self.wall
        compliance[PORT_A] += self.pocket * ATMOSPHERE / np.maximum(p[PORT_A] + ATMOSPHERE, 5e3) ** 2
        return compliance

    def _control_rates(
        self, out: Array, y: Array, valve: ValveFlows, supply: Array, steer: Array, drive: Array
    ) -> None:
        """Write the rates of load sensing, spool, compensator and swash plates."""
        out[LS] = (valve.sensed - y[LS]) * self.ls_pace
        out[SPOOL] = clipped((steer - y[SPOOL]) * self.spool_pace, self.spool_rate)
        reference = self.setting * (1.0 + self.droop * (0.5 - valve.stroke))
        out[COMPENSATOR] = _held((reference - valve.edge_drop) * self.compensator_rate, y[COMPENSATOR])
        error = np.minimum(y[LS] + self.margin, self.cutoff) - supply
        out[SWASH] = _held(np.minimum(np.maximum(error * self.swash_gain, self.swash_down), self.swash_up), y[SWASH])
        out[DRIVE_SWASH] = clipped((drive - y[DRIVE_SWASH]) * self.drive_pace, self.drive_stroke)

    def _engine_rates(self, out: Array, y: Array, full_load: Array, load: Array) -> None:
        """Write the engine's rates: an isochronous governor, whose set speed falls with the torque where it droops."""
        speed, torque = y[ENGINE], y[TORQUE]
        friction = self.engine_friction[0] + self.engine_friction[1] * speed
        most = full_load + friction
        slow = self.set_speed - self.engine_droop * np.maximum(torque - friction, 0.0) - speed
        demand = np.minimum(np.maximum(self.proportional * slow + y[GOVERNOR], 0.0), most)
        out[ENGINE] = (torque - friction - load) / self.engine_inertia
        saturated = ((y[GOVERNOR] >= most) & (slow > 0.0)) | ((y[GOVERNOR] <= 0.0) & (slow < 0.0))
        out[GOVERNOR] = np.where(saturated, 0.0, self.integral * slow)
        out[TORQUE] = np.minimum((demand - torque) * self.torque_pace, self.smoke)


def _held(rate: Array, x: Array) -> Array:
    """``rate`` of a state in [0, 1], stopped at the end that it would leave."""
    return np.where(((x >= 1.0) & (rate > 0.0)) | ((x <= 0.0) & (rate < 0.0)), 0.0, rate)
