"""Continuous-time hydraulics, driveline and engine of the machine in float64 NumPy: the reference for the device laws.

Every component takes its INDEPENDENT parameters and derives areas, orifice constants and linkage lengths itself, so that
an error in the project's derived values shows as a difference. All quantities are SI, pressures are gauge (0 = tank), and
every state may carry a trailing batch axis (k,): shapes below are written without it.

A component's method returns the time derivatives of its states, the loads that it puts on its neighbours, and a dictionary
of its volume flows [m^3/s] for the balances that the tests draw up.

Hard limits of a state (a spool at its end, a swash plate at zero) are written as one-sided relaxations of time constant
`LIMIT_TIME`, which keeps the right-hand side continuous: an implicit solver then needs no event at a limit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

ATMOSPHERE = 101325.0  # [Pa]
LIMIT_TIME = 1e-6  # [s] relaxation onto the limit of a saturated state
CLIP_TIME = 1e-5  # [s] relaxation of a friction bristle onto its capacity


# --------------------------------------------------------------------------------------------------------------- laws
def saturated(rate, x, low, high):
    """Rate of a state that is held inside [low, high]: the rate itself inside, one-sided relaxation at a limit."""
    return np.clip(rate, (low - x) / LIMIT_TIME, (high - x) / LIMIT_TIME)


def orifice(cv, drop, laminar):
    """Q = Cv sgn(dp) sqrt(|dp|) [m^3/s]; linear below `laminar` [Pa] and continuous there."""
    size = np.abs(drop)
    return cv * np.where(size < laminar, drop / np.sqrt(laminar), np.sign(drop) * np.sqrt(size))


def check_valve(cv, drop, crack, laminar):
    """One-way orifice that opens at `crack` [Pa]."""
    return orifice(cv, np.maximum(drop - crack, 0.0), laminar)


def relief_valve(drop, setting, ramp, flow):
    """Linear relief: `flow` [m^3/s] at `setting` + `ramp` [Pa]."""
    return flow * np.maximum(drop - setting, 0.0) / ramp


def return_filter(drop, setting, ramp, flow, throttle_drop):
    """Share x of `flow` that drops `setting` + `ramp` x + `throttle_drop` x^2 [Pa]: the root above zero."""
    clean = relief_valve(drop, setting, ramp, flow)
    if not np.any(throttle_drop):
        return clean
    root = np.sqrt(ramp**2 + 4.0 * throttle_drop * np.maximum(drop - setting, 0.0)) - ramp
    return flow * root / (2.0 * throttle_drop)


def bristle_rate(z, v, limit):
    """Prandtl element: z' = v, held within +-limit.

    Beyond the limit the excess relaxes within CLIP_TIME, which is also how z follows a limit that shrinks; the clip of
    the force (not of the state) keeps the force exact meanwhile.
    """
    excess = z - np.clip(z, -limit, limit)
    return v - excess / CLIP_TIME


def bristle_force(z, v, stiffness, damping, capacity):
    """Force or torque on the moving part: -clip(k z + c v, -capacity, capacity)."""
    return -np.clip(stiffness * z + damping * v, -capacity, capacity)


class Oil:
    """Compressibility of oil with free gas, and of the hose around it."""

    def __init__(self, oil):
        self.bulk_modulus = oil.bulk_modulus
        self.slope = oil.bulk_modulus_slope
        self.gas = oil.gas_fraction
        self.exponent = oil.polytropic_exponent
        self.laminar = oil.laminar_pressure
        self.void = oil.void_pressure

    def pressure(self, x):
        """Pressure of a volume from its state: below the void pressure the state counts void volume instead."""
        return np.maximum(x, self.void)

    def compressibility(self, p):
        """1/beta [1/Pa] of oil with a polytropic gas fraction, by volume at pressure p (gauge, Pa)."""
        liquid = 1.0 / (self.bulk_modulus + self.slope * np.maximum(p, 0.0))
        absolute = np.maximum(p, 0.05e5 - ATMOSPHERE) + ATMOSPHERE
        gas = self.gas * (ATMOSPHERE / absolute) ** (1.0 / self.exponent)
        return ((1.0 - self.gas) * liquid + gas / (self.exponent * absolute)) / ((1.0 - self.gas) + gas)

    def rate(self, x, inflow, volume, hose_volume, hose_modulus, void_volume):
        """x' [Pa/s] of a volume: net inflow less the growth of the volume, over the compliance [m^3/Pa].

        Below the void pressure the compliance is that of the constant `void_volume` [m^3] of oil, so that (void - x)*C
        is the void's volume; which constant does not matter, as long as it is one: what was drawn must be refilled.
        """
        compliance = volume * self.compressibility(self.pressure(x)) + hose_volume / hose_modulus
        return inflow / np.where(x > self.void, compliance, void_volume / self.bulk_modulus)

    def line(self, x, inflow, volume, hose_modulus):
        """x' [Pa/s] of a line of constant volume, all of it hose."""
        return self.rate(x, inflow, volume, volume, hose_modulus, volume)


class Linkage:
    """Cylinder between two pins at radii a and b = k a about one axis.

    L(gamma)^2 = a^2 + b^2 - 2 a b cos(gamma); gamma runs over g0 +- m while L runs over L0 .. L0 + S. The middle angle g0
    is found here by a scan and bisection of the one closing equation, not by its closed form.
    """

    def __init__(self, closed, stroke, ratio, half_range):
        ratio_squared = ((closed + stroke) / closed) ** 2
        one = 1.0 + ratio**2

        def residual(g):
            low, high = one - 2.0 * ratio * np.cos(g - half_range), one - 2.0 * ratio * np.cos(g + half_range)
            return high - ratio_squared * low

        grid = np.linspace(half_range, np.pi - half_range, 20001)
        value = residual(grid)
        best = None
        for i in np.flatnonzero(value[:-1] * value[1:] <= 0.0):
            lo, hi = grid[i], grid[i + 1]
            for _ in range(60):
                mid = 0.5 * (lo + hi)
                lo, hi = (mid, hi) if residual(lo) * residual(mid) > 0.0 else (lo, mid)
            g0 = 0.5 * (lo + hi)
            a = closed / np.sqrt(one - 2.0 * ratio * np.cos(g0 - half_range))
            angles = g0 + np.linspace(-half_range, half_range, 201)
            self.a, self.b = a, ratio * a
            lever = np.abs(self.lever(angles)).min()
            if best is None or lever > best[0]:
                best = (lever, g0, a)
        if best is None:
            raise ValueError(
                "the cylinder's linkage does not close: stroke, dead_length, mount_ratio and range disagree"
            )
        _, self.middle, self.a = best
        self.b = ratio * self.a

    def length(self, gamma):
        """Pin to pin length [m]."""
        return np.sqrt(self.a**2 + self.b**2 - 2.0 * self.a * self.b * np.cos(gamma))

    def lever(self, gamma):
        """dL/dgamma [m]."""
        return self.a * self.b * np.sin(gamma) / self.length(gamma)


def bore_and_annulus(cylinder):
    """Areas [m^2] of the two sides of a piston."""
    bore = 0.25 * np.pi * cylinder.bore**2
    return bore, bore - 0.25 * np.pi * cylinder.rod**2


def seal_force(cylinder, v, pressure_sum):
    """Sliding capacity of a cylinder's seals [N] with their Stribeck rise (not the viscous part)."""
    level = cylinder.seal_preload + cylinder.seal_pressure_coefficient * pressure_sum
    return level * (1.0 + (cylinder.seal_static_ratio - 1.0) * np.exp(-((v / cylinder.seal_stribeck_velocity) ** 2)))


# ------------------------------------------------------------------------------------------------------- steering joint
class SteeringCylinders:
    """The joint's two cross-connected cylinders, its end stops and its dry friction."""

    def __init__(self, machine):
        steering, joint = machine.steering, machine.joint
        self.cylinder = steering.cylinder
        self.joint = joint
        self.bore, self.annulus = bore_and_annulus(self.cylinder)
        self.stroke, self.closed = self.cylinder.stroke, self.cylinder.dead_length
        self.link = Linkage(self.closed, self.stroke, self.cylinder.mount_ratio, joint.range)
        self.fixed_volume = steering.hose_volume + 2.0 * self.cylinder.dead_volume
        mean_lever = self.stroke / (2.0 * joint.range)
        self.stop_stiffness = 2.0 * joint.stop_stiffness * mean_lever**2
        self.stop_damping = 2.0 * joint.stop_damping * mean_lever**2

    def geometry(self, theta):
        """Levers dL/dtheta of the right and of the left cylinder, volumes A and B and their derivatives by theta."""
        right, left = self.link.length(self.link.middle + theta), self.link.length(self.link.middle - theta)
        lever_right, lever_left = self.link.lever(self.link.middle + theta), -self.link.lever(self.link.middle - theta)
        open_ = self.closed + self.stroke
        volume_a = self.fixed_volume + self.bore * (right - self.closed) + self.annulus * (open_ - left)
        volume_b = self.fixed_volume + self.bore * (left - self.closed) + self.annulus * (open_ - right)
        slope_a = self.bore * lever_right - self.annulus * lever_left
        slope_b = self.bore * lever_left - self.annulus * lever_right
        return lever_right, lever_left, volume_a, volume_b, slope_a, slope_b

    def torque(self, theta, rate, z, p_a, p_b):
        """Torque on theta [N m] with its parts, and the bristle's rate."""
        lever_right, lever_left, _, _, slope_a, slope_b = self.geometry(theta)
        hydraulic = p_a * slope_a + p_b * slope_b
        pressure_sum = np.maximum(p_a, 0.0) + np.maximum(p_b, 0.0)
        capacity = self.joint.friction_torque
        for lever in (np.abs(lever_right), np.abs(lever_left)):
            capacity = capacity + lever * seal_force(self.cylinder, lever * rate, pressure_sum)
        viscous = -self.cylinder.seal_viscous * (lever_right**2 + lever_left**2) * rate
        dry = bristle_force(z, rate, self.joint.presliding_stiffness, self.joint.presliding_damping, capacity)
        z_rate = bristle_rate(z, rate, capacity / self.joint.presliding_stiffness)
        stop = end_stop(theta, rate, self.joint.range, self.stop_stiffness, self.stop_damping)
        parts = {"hydraulic": hydraulic, "viscous": viscous, "dry": dry, "stop": stop}
        return hydraulic + viscous + dry + stop, z_rate, parts


def end_stop(angle, rate, limit, stiffness, damping):
    """One-sided spring and damper beyond |angle| = limit; it never pulls."""
    side = np.sign(angle)
    depth = np.abs(angle) - limit
    push = np.maximum(0.0, stiffness * depth + damping * side * rate)
    return np.where(depth > 0.0, -side * push, 0.0)


class SteeringCircuit:
    """Load-sensing pump, compensated directional valve, two cylinder volumes and a throttled return line.

    States: supply, A, B, return line (volume states, Pa), load-sensing pressure (Pa), spool [-1, 1], compensator [0, 1],
    swash plate [0, 1].
    """

    def __init__(self, machine, oil: Oil):
        self.oil = oil
        self.valve = v = machine.steering.valve
        self.pump = machine.steering.pump
        self.tank = machine.steering.tank_line
        self.cylinders = SteeringCylinders(machine)
        self.cylinder_leakage = 2.0 * machine.steering.cylinder.leakage
        self.hose_volume = machine.steering.hose_volume
        self.hose_modulus = machine.steering.hose_bulk_modulus
        self.mid_volume = self.cylinders.geometry(0.0)[2]
        self.cv_in = {
            "left": v.nominal_flow_left / np.sqrt(v.nominal_drop_in_left),
            "right": v.nominal_flow_right / np.sqrt(v.nominal_drop_in_right),
        }
        self.cv_out = {
            "left": v.nominal_flow_left / np.sqrt(v.nominal_drop_out_left),
            "right": v.nominal_flow_right / np.sqrt(v.nominal_drop_out_right),
        }
        self.cv_compensator = max(v.nominal_flow_left, v.nominal_flow_right) / np.sqrt(v.compensator_open_drop)
        self.cv_anticavitation = v.anticavitation_flow / np.sqrt(v.anticavitation_drop)
        self.cv_bleed = self.pump.bleed_flow / np.sqrt(self.pump.bleed_drop)
        self.cv_suction = self.tank.suction_flow / np.sqrt(self.tank.suction_drop)
        self.displacement = self.pump.displacement  # [m^3/rad]
        self.curve_signal = {"left": (v.dead_band_left, 1.0, 1.5, 2.0), "right": (v.dead_band_right, 1.0, 1.5, 2.0)}
        self.curve_opening = {
            "left": (0.0, v.opening_left_1V0, v.opening_left_1V5, 1.0),
            "right": (0.0, v.opening_right_1V0, v.opening_right_1V5, 1.0),
        }

    def opening(self, spool):
        """Opening [0, 1] of the edges and whether the spool stands on the left side."""
        volts = 2.0 * np.abs(spool)
        left = spool > 0.0
        opening = np.where(
            left,
            np.interp(volts, self.curve_signal["left"], self.curve_opening["left"]),
            np.interp(volts, self.curve_signal["right"], self.curve_opening["right"]),
        )
        return opening, left

    def valve_flows(self, spool, y, p_s, p_a, p_b, p_t):
        """Flow through the inlet edge with its compensator, through the outlet edge, and the drop over the inlet edge."""
        lam = self.oil.laminar
        opening, left = self.opening(spool)
        p_load, p_return = np.where(left, p_a, p_b), np.where(left, p_b, p_a)
        c1 = np.maximum(y, 0.0) * self.cv_compensator
        c2 = opening * np.where(left, self.cv_in["left"], self.cv_in["right"])
        square = c1**2 + c2**2
        available = np.maximum(p_s - p_load, 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            series = np.where(square > 0.0, c1 * c2 / np.sqrt(square), 0.0)
            share = np.where((opening > 0.0) & (square > 0.0), c1**2 / square, 0.0)
        inflow = orifice(series, available, lam)
        outflow = orifice(opening * np.where(left, self.cv_out["left"], self.cv_out["right"]), p_return - p_t, lam)
        return opening, left, p_load, inflow, outflow, available * share

    def rates(self, s, signal, theta, theta_rate, omega, arms_in, arms_out, arms_load):
        """Derivatives of the circuit's states.

        s: states by name; signal: the spool's command after delay and hysteresis; arms_in, arms_out [m^3/s]: what the
        arms draw from the supply and give to the return line; arms_load [Pa]: their highest load pressure.
        """
        oil, v, pump, lam = self.oil, self.valve, self.pump, self.oil.laminar
        p_s, p_a, p_b, p_t = (oil.pressure(s[name]) for name in ("supply", "a", "b", "return_line"))
        p_ls, swash, y = s["load_sensing"], s["swash"], s["compensator"]
        opening, left, p_load, q_in, q_out, drop_edge = self.valve_flows(s["spool"], y, p_s, p_a, p_b, p_t)

        def ports(port, other):
            shock = relief_valve(port - p_t, v.shock_pressure, v.shock_ramp, v.shock_flow)
            suction = check_valve(self.cv_anticavitation, p_t - port, v.anticavitation_crack, lam)
            return shock, suction, v.leakage * (port - p_t), self.cylinder_leakage * (port - other)

        shock_a, suction_a, leak_a, cross_a = ports(p_a, p_b)
        shock_b, suction_b, leak_b, _ = ports(p_b, p_a)
        into_a = np.where(left, q_in, -q_out) - shock_a + suction_a - leak_a - cross_a
        into_b = np.where(left, -q_out, q_in) - shock_b + suction_b - leak_b + cross_a

        pump_flow = swash * self.displacement * omega
        pump_leak = pump.leakage * p_s
        bleed = orifice(self.cv_bleed, p_ls, lam)
        supply_relief = relief_valve(p_s, pump.relief_pressure, pump.relief_ramp, pump.relief_flow)
        into_supply = pump_flow - pump_leak - bleed - supply_relief - q_in - arms_in

        to_tank = return_filter(
            p_t, self.tank.back_pressure, self.tank.back_pressure_ramp, self.tank.back_flow, self.tank.throttle_drop
        )
        from_tank = check_valve(self.cv_suction, -p_t, 0.0, lam)
        into_return = (
            q_out + shock_a + shock_b + leak_a + leak_b - suction_a - suction_b + arms_out - to_tank + from_tank
        )

        _, _, volume_a, volume_b, slope_a, slope_b = self.cylinders.geometry(theta)
        hose, modulus = self.hose_volume, self.hose_modulus
        target = np.maximum(np.maximum(np.where(opening > 0.0, p_load, 0.0), arms_load), 0.0)
        error = np.minimum(p_ls + pump.margin - p_s, pump.cutoff - p_s)
        swash_rate = np.clip(
            error / (pump.control_band * pump.stroke_up_time), -1.0 / pump.stroke_down_time, 1.0 / pump.stroke_up_time
        )
        reference = v.compensator_pressure * (1.0 + v.compensator_droop * (0.5 - y))
        y_rate = (reference - drop_edge) / (v.compensator_pressure * v.compensator_time_constant)
        rates = {
            "supply": oil.line(s["supply"], into_supply, pump.line_volume, pump.hose_bulk_modulus),
            "a": oil.rate(s["a"], into_a - slope_a * theta_rate, volume_a, hose, modulus, self.mid_volume),
            "b": oil.rate(s["b"], into_b - slope_b * theta_rate, volume_b, hose, modulus, self.mid_volume),
            "return_line": oil.line(s["return_line"], into_return, self.tank.volume, self.tank.hose_bulk_modulus),
            "load_sensing": (target - p_ls) / pump.ls_time_constant,
            "spool": np.clip((signal - s["spool"]) / v.spool_time_constant, -v.spool_rate_limit, v.spool_rate_limit),
            "compensator": saturated(y_rate, y, 0.0, 1.0),
            "swash": saturated(swash_rate, swash, 0.0, 1.0),
        }
        load = swash * self.displacement * p_s / pump.mechanical_efficiency
        flows = {
            "pump": pump_flow,
            "pump_leak": pump_leak,
            "bleed": bleed,
            "supply_relief": supply_relief,
            "valve_in": q_in,
            "valve_out": q_out,
            "shock_a": shock_a,
            "shock_b": shock_b,
            "suction_a": suction_a,
            "suction_b": suction_b,
            "leak_a": leak_a,
            "leak_b": leak_b,
            "cylinder_leak": cross_a,
            "to_tank": to_tank,
            "from_tank": from_tank,
            "into_a": into_a,
            "into_b": into_b,
            "into_supply": into_supply,
            "into_return": into_return,
            "opening": opening,
            "edge_drop": drop_edge,
        }
        return rates, load, flows


class Hysteresis:
    """Play operator of half width w on a piecewise constant command, evaluated exactly step by step.

    r' follows r = clip(r, u - w, u + w); the spool is told r + clip(r, -w, w), which is exact for a command that only rose.
    """

    def __init__(self, width):
        self.half = 0.5 * width
        self.r = 0.0

    def __call__(self, u):
        self.r = float(np.clip(self.r, u - self.half, u + self.half))
        return self.r + float(np.clip(self.r, -self.half, self.half))


# ---------------------------------------------------------------------------------------------------------------- arms
class ArmCircuit:
    """Four arm cylinders, each behind a proportional valve with load-holding checks. Arrays are (4,) by arm."""

    def __init__(self, machine, oil: Oil):
        self.oil = oil
        self.arm = arm = machine.arm
        self.cylinder = arm.cylinder
        self.valve = arm.valve
        self.bore, self.annulus = bore_and_annulus(self.cylinder)
        self.stroke, self.closed = self.cylinder.stroke, self.cylinder.dead_length
        self.link = Linkage(self.closed, self.stroke, self.cylinder.mount_ratio, arm.swing)
        self.hose_volume = arm.hose_volume
        self.hose_modulus = arm.hose_bulk_modulus
        self.cv = self.valve.nominal_flow / np.sqrt(self.valve.pressure_drop)
        mean_lever = self.stroke / (2.0 * arm.swing)
        self.stop_stiffness = arm.stop_stiffness * mean_lever**2
        self.stop_damping = arm.stop_damping * mean_lever**2

    def geometry(self, phi):
        """Lever dL/dphi (negative: the cylinder extends as the wheel goes down), volumes and their derivatives by phi."""
        length = self.link.length(self.link.middle - phi)
        lever = -self.link.lever(self.link.middle - phi)
        fixed = self.hose_volume + self.cylinder.dead_volume
        volume_bore = fixed + self.bore * (length - self.closed)
        volume_rod = fixed + self.annulus * (self.closed + self.stroke - length)
        return lever, volume_bore, volume_rod, self.bore * lever, -self.annulus * lever

    def torque(self, phi, rate, z, p_bore, p_rod):
        """Torque on phi [N m] with its parts, and the bristle's rate."""
        lever, _, _, slope_bore, slope_rod = self.geometry(phi)
        hydraulic = p_bore * slope_bore + p_rod * slope_rod
        pressure_sum = np.maximum(p_bore, 0.0) + np.maximum(p_rod, 0.0)
        capacity = np.abs(lever) * seal_force(self.cylinder, lever * rate, pressure_sum)
        viscous = -self.cylinder.seal_viscous * lever**2 * rate
        dry = bristle_force(z, rate, self.arm.presliding_stiffness, self.arm.presliding_damping, capacity)
        z_rate = bristle_rate(z, rate, capacity / self.arm.presliding_stiffness)
        stop = end_stop(phi, rate, self.arm.swing, self.stop_stiffness, self.stop_damping)
        parts = {"hydraulic": hydraulic, "viscous": viscous, "dry": dry, "stop": stop}
        return hydraulic + viscous + dry + stop, z_rate, parts

    def rates(self, s, signal, phi, phi_rate, p_s, p_t):
        """Derivatives of bore, rod and spool; draw on the supply, gift to the return line, highest load pressure."""
        oil, v, lam = self.oil, self.valve, self.oil.laminar
        p_bore, p_rod, spool = oil.pressure(s["bore"]), oil.pressure(s["rod"]), s["arm_spool"]
        opening = np.maximum(0.0, (np.abs(spool) - v.dead_band) / (1.0 - v.dead_band))
        extend = spool > 0.0
        loaded, emptied = np.where(extend, p_bore, p_rod), np.where(extend, p_rod, p_bore)
        q_in = orifice(opening * self.cv, np.clip(p_s - loaded, 0.0, v.pressure_drop), lam)
        held = np.clip((emptied + v.pilot_ratio * loaded - v.holding_pressure) / v.holding_ramp, 0.0, 1.0)
        q_out = held * orifice(opening * self.cv, np.maximum(emptied - p_t, 0.0), lam)
        relief_bore = relief_valve(p_bore - p_t, v.port_relief, v.port_ramp, v.port_flow)
        relief_rod = relief_valve(p_rod - p_t, v.port_relief, v.port_ramp, v.port_flow)
        into_bore = np.where(extend, q_in, -q_out) - relief_bore
        into_rod = np.where(extend, -q_out, q_in) - relief_rod
        _, volume_bore, volume_rod, slope_bore, slope_rod = self.geometry(phi)
        hose, modulus = self.hose_volume, self.hose_modulus
        fixed = hose + self.cylinder.dead_volume
        rates = {
            "bore": oil.rate(s["bore"], into_bore - slope_bore * phi_rate, volume_bore, hose, modulus, fixed),
            "rod": oil.rate(s["rod"], into_rod - slope_rod * phi_rate, volume_rod, hose, modulus, fixed),
            "arm_spool": np.clip((signal - spool) / v.time_constant, -v.rate_limit, v.rate_limit),
        }
        load_pressure = np.where(opening > 0.0, loaded, 0.0).max(axis=0)
        drawn, given = q_in.sum(axis=0), (q_out + relief_bore + relief_rod).sum(axis=0)
        flows = {"into_bore": into_bore, "into_rod": into_rod, "valve_in": q_in, "valve_out": q_out}
        return rates, drawn, given, load_pressure, flows


# ----------------------------------------------------------------------------------------------------------- driveline
class Driveline:
    """Closed circuit: variable pump, four wheel motors behind traction valves, charge, flushing and cross-port reliefs."""

    def __init__(self, machine, oil: Oil):
        self.oil = oil
        self.d = d = machine.driveline
        self.pump_displacement = d.pump.displacement  # [m^3/rad]
        self.charge_displacement = d.charge.displacement
        self.motor_displacement = d.motor.displacement
        self.cv_check = d.charge.check_flow / np.sqrt(d.charge.check_drop)
        self.cv_traction = d.traction.nominal_flow / np.sqrt(d.traction.pressure_drop)

    def motor_size(self, fraction_front, fraction_rear):
        """Displacement [m^3/rad] of the four motors."""
        return self.motor_displacement * np.stack([fraction_front, fraction_front, fraction_rear, fraction_rear])

    def wheel_torque(self, s, w, parking):
        """Motor torque and brake torque (both on the wheel, reacting on the arm), and the brake bristles' rates."""
        brake = self.d.brake
        p_w, p_r = self.oil.pressure(s["wheel_line"]), self.oil.pressure(s["drive_return"])
        motor = self.motor_size(s["fraction_front"], s["fraction_rear"]) * (p_w - p_r)
        capacity = (
            brake.disc_torque
            + parking * brake.parking_torque
            + (1.0 - self.d.motor.mechanical_efficiency) * np.abs(motor)
        )
        dry = bristle_force(s["wheel_bristle"], w, brake.presliding_stiffness, brake.presliding_damping, capacity)
        return motor, dry, bristle_rate(s["wheel_bristle"], w, capacity / brake.presliding_stiffness)

    def rates(self, s, drive_signal, traction, gear, w, omega):
        """Derivatives of the driveline's states, its load on the engine [N m] and its flows."""
        oil, d, lam = self.oil, self.d, self.oil.laminar
        p_f, p_r, p_w, p_c = (oil.pressure(s[n]) for n in ("drive_forward", "drive_return", "wheel_line", "charge"))
        swash = s["drive_swash"]
        pumped = swash * self.pump_displacement * omega
        cross = (
            d.pump.cross_leakage * (p_f - p_r)
            + relief_valve(p_f - p_r, d.relief.pressure, d.relief.ramp, d.relief.flow)
            - relief_valve(p_r - p_f, d.relief.pressure, d.relief.ramp, d.relief.flow)
        )
        case_f, case_r = d.pump.leakage * p_f, d.pump.leakage * p_r
        check_f = check_valve(self.cv_check, p_c - p_f, d.charge.check_crack, lam)
        check_r = check_valve(self.cv_check, p_c - p_r, d.charge.check_crack, lam)
        shift = np.clip((np.abs(p_f - p_r) - d.flush.shift_pressure) / d.flush.shift_pressure, 0.0, 1.0)
        flush = shift * relief_valve(np.minimum(p_f, p_r), d.flush.pressure, d.flush.ramp, d.flush.flow)
        flush_f, flush_r = np.where(p_f < p_r, flush, 0.0), np.where(p_f < p_r, 0.0, flush)

        q_traction = orifice(s["traction_opening"] * self.cv_traction, p_f - p_w, lam)
        size = self.motor_size(s["fraction_front"], s["fraction_rear"])
        q_motor = size * w + d.motor.leakage * (p_w - p_r)
        into_f = pumped - cross - case_f + check_f - flush_f - q_traction.sum(axis=0)
        into_r = -pumped + cross - case_r + check_r - flush_r + q_motor.sum(axis=0)
        charge_flow = self.charge_displacement * omega
        charge_relief = relief_valve(p_c, d.charge.relief_pressure, d.charge.relief_ramp, d.charge.relief_flow)
        into_c = charge_flow - check_f - check_r - charge_relief

        main, hose, modulus = d.main_volume, d.wheel_hose_volume, d.hose_bulk_modulus
        half = 0.5
        target_front, target_rear = (half if gear >= 3 else 1.0), (half if gear >= 2 else 1.0)
        stroke = 1.0 / d.pump.stroke_time
        rates = {
            "drive_forward": oil.line(s["drive_forward"], into_f, main, modulus),
            "drive_return": oil.line(s["drive_return"], into_r, main, modulus),
            "wheel_line": oil.line(s["wheel_line"], q_traction - q_motor, hose, modulus),
            "charge": oil.line(s["charge"], into_c, d.charge.volume, modulus),
            "drive_swash": np.clip((drive_signal - swash) / d.pump.time_constant, -stroke, stroke),
            "fraction_front": (target_front - s["fraction_front"]) / d.motor.shift_time,
            "fraction_rear": (target_rear - s["fraction_rear"]) / d.motor.shift_time,
            "traction_opening": (traction - s["traction_opening"]) / d.traction.time_constant,
        }
        torque = swash * self.pump_displacement * (p_f - p_r)
        load = (
            torque
            + (1.0 - d.pump.mechanical_efficiency) * np.abs(torque)
            + self.charge_displacement * p_c / d.charge.mechanical_efficiency
        )
        flows = {
            "pump": pumped,
            "case_forward": case_f,
            "case_return": case_r,
            "check_forward": check_f,
            "check_return": check_r,
            "flush": flush,
            "charge": charge_flow,
            "charge_relief": charge_relief,
            "into_forward": into_f,
            "into_return": into_r,
            "into_wheel": q_traction - q_motor,
            "into_charge": into_c,
        }
        return rates, load, flows


# -------------------------------------------------------------------------------------------------------------- engine
@dataclass
class Engine:
    """Diesel engine with an isochronous governor; torque states are indicated torque (brake torque + own friction)."""

    parameters: Any  # section `engine` of the machine
    speeds: np.ndarray = field(init=False)
    torques: np.ndarray = field(init=False)

    def __post_init__(self):
        table = self.parameters.torque
        inner = (900, 1200, 1400, 1600, 1800, 2000, 2200, 2400)
        self.speeds = np.array([0.0, 300.0, *inner, 2600.0]) * np.pi / 30.0
        self.torques = np.array([0.0, 0.0, *(getattr(table, f"rpm_{n}") for n in inner), 0.0])

    def friction(self, omega):
        """Friction torque [N m], linear in speed."""
        return self.parameters.friction_0 + self.parameters.friction_1 * omega

    def rates(self, s, load):
        """Derivatives of speed, governor integral and indicated torque."""
        e = self.parameters
        omega, integral, torque = s["engine_speed"], s["governor"], s["engine_torque"]
        friction = self.friction(omega)
        ceiling = np.interp(omega, self.speeds, self.torques) + friction
        error = e.set_speed - omega
        demand = np.clip(e.governor_proportional * error + integral, 0.0, ceiling)
        omega_rate = (torque - friction - load) / e.inertia
        return {
            "engine_speed": np.where(omega > 0.0, omega_rate, np.maximum(omega_rate, 0.0)),
            "governor": saturated(e.governor_integral * error, integral, 0.0, ceiling),
            "engine_torque": np.minimum((demand - torque) / e.torque_time_constant, e.smoke_rate),
        }
