"""The steering circuit's motion in a left turn, each component by the law that the machine chooses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.machine import Machine
from aoro_gym.validation.theory.circuit import (
    Array,
    Chambers,
    edge_flow,
    either,
    modulus,
    obeys,
    opening,
    return_flow,
    turbulent,
    walls,
)
from aoro_gym.validation.theory.states import (
    COMPENSATOR,
    COMPENSATOR_RATE,
    HOSE_A,
    HOSE_B,
    HOSE_FLOW_A,
    HOSE_FLOW_B,
    LS,
    PORT_A,
    PORT_B,
    PUMP_VALVE,
    RETURN,
    SHOCK_A,
    SHOCK_B,
    SPOOL,
    SPOOL_RATE,
    STRAIN_A,
    STRAIN_B,
    SUPPLY,
    SWASH,
)

STEP = 1e-4
"""Time step [s] of the fourth-order Runge-Kutta method, stable up to poles of 2.8/STEP: those of the anti-cavitation valve
into a port of least volume are near 1.9e4 1/s. Halved for hoses of two segments: half a hose alone has near 4.5e4 1/s."""
NEWTON_STEPS = 4
"""Steps towards the balance of a static compensator, from the last one."""
PLAY_TORQUE = 100.0
"""Torque [N m] over which a free play is crossed."""


class Side(NamedTuple):
    """States of one side's hose and chambers."""

    port: int  # pressure at the cylinders
    hose: int  # at the valve
    between: int  # flow from there
    strain: int
    shock: int


SIDES = (
    Side(PORT_A, HOSE_A, HOSE_FLOW_A, STRAIN_A, SHOCK_A),
    Side(PORT_B, HOSE_B, HOSE_FLOW_B, STRAIN_B, SHOCK_B),
)


class Circuit:
    """Rates of the circuit's states, each of shape (N,).

    Args:
        machine: One machine, or N variants.
        limits: Values of what bounds the circuit, by the keys of :data:`~aoro_gym.validation.theory.states.LIMITS`.
    """

    def __init__(self, machine: Machine, limits: Mapping[str, Array]) -> None:
        self.machine, self.limits = machine, limits
        valve, pump = machine.steering.valve, machine.steering.pump
        self.cv_in, self.cv_out = np.asarray(valve.cv_in_left), np.asarray(valve.cv_out_left)
        self.cv_compensator, self.cv_bleed = np.asarray(valve.cv_compensator), np.asarray(pump.cv_bleed)
        self.cv_cross_port, self.cv_suction = valve.cv_cross_port, machine.steering.tank_line.cv_suction
        self.cv_ls = np.asarray(pump.cv_ls)
        cylinder = machine.steering.cylinder
        stroked = 0.5 * (cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke
        self.nominal = machine.steering.hose_volume + 2.0 * cylinder.dead_volume + stroked
        """Oil [m³] on one side at half stroke, which a void's compliance is counted with."""
        self.is_static = obeys(machine, "compensator", "static")
        self.has_mass = obeys(machine, "compensator", "spring_mass")
        self.senses_line = obeys(machine, "compensator_sensing", "load_sensing_line")
        self.spool_swings = obeys(machine, "spool", "second_order")
        self.force = np.where(obeys(machine, "flow_force", "steady"), valve.flow_force_share, 0.0)
        self.shock_lags = obeys(machine, "shock_valve", "lag")
        self.pump_leads = obeys(machine, "pump", "second_order")
        self.line_has_volume = obeys(machine, "load_sensing_line", "volume")
        self.two_segments = obeys(machine, "hose", "two_segments")
        self.creeps = obeys(machine, "hose", "viscoelastic")
        self.hardens = obeys(machine, "mount", "hardening")

    @property
    def step(self) -> float:
        """Time step [s] that resolves the circuit."""
        return 0.5 * STEP if np.any(self.two_segments) else STEP

    def felt(self, content: Array) -> Array:
        """Pressure [Pa] of a volume: none is below that of a void."""
        return np.maximum(content, self.machine.oil.void_pressure)

    def torque(self, x: Array, ports: Chambers) -> Array:
        """Torque [N m] of the oil on the joint."""
        return self.felt(x[PORT_A]) * ports.displacement_a - self.felt(x[PORT_B]) * ports.displacement_b

    def derivative(self, x: Array, command: ArrayLike, ports: Chambers, joint_rate: Array, out: Array) -> None:
        """Rates of the circuit's states into ``out``.

        Args:
            x: States (27, N).
            command: Demand on the spool, of the full signal.
            ports: Chambers at the joint's angle.
            joint_rate: Rate of the joint [rad/s].
            out: Rates (27, N).
        """
        machine, steering, laminar = self.machine, self.machine.steering, self.machine.oil.laminar_pressure
        pump, line = steering.pump, steering.tank_line
        p_s, p_t = self.felt(x[SUPPLY]), self.felt(x[RETURN])
        valve_a, valve_b = self._at_valve(x)
        edge, available, bias = self._metering(x, valve_a)
        load = np.where(edge > 0.0, np.maximum(valve_a, 0.0), 0.0)
        y = either(self.is_static, lambda: self._balance(x[COMPENSATOR], edge, available, bias), lambda: x[COMPENSATOR])
        self._compensator(x, edge, available, bias, out)
        self._spool(x, command, edge, self._edge_share(y, edge) ** 2 * available, out)
        drawn = self._load_sensing(x, load, out)
        self._swash(x, p_s, out)

        flow_in = edge_flow(machine, edge * self.cv_in * self._edge_share(y, edge), available)
        flow_out = edge_flow(machine, edge * self.cv_out, valve_b - p_t)
        tank_a, tank_b = self._past(x, valve_a, valve_b, p_t, out)
        across = turbulent(self.cv_cross_port, valve_a - valve_b, laminar)
        self._ports(x, flow_in - tank_a - across - drawn, -flow_out - tank_b + across, ports, joint_rate, out)

        delivered = x[SWASH] * pump.displacement * machine.engine.set_speed
        relief = pump.relief_flow / pump.relief_ramp * np.maximum(p_s - self.limits["relief_pressure"], 0.0)
        bled = np.where(self.line_has_volume, 0.0, turbulent(self.cv_bleed, x[LS], laminar))
        supply_compliance = pump.line_volume / modulus(machine, p_s) + pump.line_compliance
        out[SUPPLY] = (delivered - pump.leakage * p_s - bled - relief - flow_in) / supply_compliance
        sucked = turbulent(self.cv_suction, np.maximum(-p_t, 0.0), laminar)
        return_compliance = line.volume / modulus(machine, p_t) + line.compliance
        out[RETURN] = (flow_out + tank_a + tank_b - return_flow(machine, p_t) + sucked) / return_compliance

    def _edge_share(self, y: Array, edge: Array) -> Array:
        """Root of the edge's share of the drop over compensator and edge: y/√(y² + ρ²)."""
        return y / np.sqrt(np.maximum(y**2 + np.square(edge * self.cv_in / self.cv_compensator), 1e-12))

    def _excess(self, y: Array, edge: Array, available: Array, bias: Array) -> tuple[Array, Array]:
        """Pressures on the compensator less its spring, over its setting, and how that rises with y."""
        valve = self.machine.steering.valve
        square = np.square(edge * self.cv_in / self.cv_compensator)
        wide = np.maximum(y**2 + square, 1e-12)
        drop = available / valve.compensator_pressure
        excess = drop * y**2 / wide + bias / valve.compensator_pressure - 1.0 - valve.compensator_droop * (0.5 - y)
        return excess, 2.0 * drop * y * square / wide**2

    def _metering(self, x: Array, valve_a: Array) -> tuple[Array, Array, Array]:
        """Opening of the edges, drop [Pa] over compensator and metering edge, and what the compensator feels beyond."""
        edge = opening(self.machine, x[SPOOL])
        available = np.where(edge > 0.0, np.maximum(self.felt(x[SUPPLY]) - valve_a, 0.0), 0.0)
        return edge, available, np.where(self.senses_line & (edge > 0.0), valve_a - x[LS], 0.0)

    def balanced(self, x: Array) -> Array:
        """Opening at which a static compensator is in balance."""
        return self._balance(x[COMPENSATOR], *self._metering(x, self._at_valve(x)[0]))

    def _at_valve(self, x: Array) -> list[Array]:
        """Pressures [Pa] of both sides on the valve's end."""
        return [
            self.felt(either(self.two_segments, lambda side=side: x[side.hose], lambda side=side: x[side.port]))
            for side in SIDES
        ]

    def _balance(self, y: Array, edge: Array, available: Array, bias: Array) -> Array:
        """Opening of a compensator in balance: Newton's method from near ``y``, within the stops.

        The excess is convex in y up to ρ/√3 and concave beyond, so that it is started there where ``y`` is far.
        """
        droop = np.asarray(self.machine.steering.valve.compensator_droop)
        turn = np.minimum(np.maximum(edge * self.cv_in / self.cv_compensator, 1e-6) / np.sqrt(3.0), 1.0)
        above = self._excess(turn, edge, available, bias)[0] > 0.0
        low, high = np.where(above, 0.0, turn), np.where(above, turn, 1.0)
        y = np.clip(y, low, high)
        for _ in range(NEWTON_STEPS):
            excess, slope = self._excess(y, edge, available, bias)
            y = np.clip(y - excess / np.maximum(slope + droop, 1e-9), low, high)
        return y

    def _compensator(self, x: Array, edge: Array, available: Array, bias: Array, out: Array) -> None:
        """ẏ of a damped compensator, or ÿ = ω² push − 2 ζ ω ẏ of one with mass; none of one that is in balance."""
        valve, y = self.machine.steering.valve, x[COMPENSATOR]
        excess, slope = self._excess(y, edge, available, bias)
        speed = -excess / valve.compensator_time_constant
        # its pole grows without bound as the edge closes; damped by the square of what a step resolves
        pole = slope / valve.compensator_time_constant
        speed = speed / (1.0 + (STEP * pole / 2.8) ** 2)
        speed = np.where(self.has_mass, x[COMPENSATOR_RATE], speed)
        omega = np.asarray(valve.compensator_frequency)
        push = -np.square(omega) * excess / (1.0 + (STEP * STEP * np.square(omega) * slope / 4.0) ** 2)
        push = np.where(self.has_mass, push - 2.0 * valve.compensator_damping * omega * x[COMPENSATOR_RATE], 0.0)
        held = (y >= 1.0) & (speed > 0.0) | (y <= 0.0) & (speed < 0.0) | self.is_static
        out[COMPENSATOR] = np.where(held, 0.0, speed)
        out[COMPENSATOR_RATE] = push

    def _spool(self, x: Array, command: ArrayLike, edge: Array, edge_drop: Array, out: Array) -> None:
        """ẋ of a lag, or ẍ = ω² (u − x) − 2 ζ ω ẋ, within the pilot's rate; flow moves the demand back."""
        valve, fastest = self.machine.steering.valve, self.limits["spool_rate_limit"]
        demand = np.maximum(np.asarray(command) - self.force * edge * edge_drop / valve.compensator_pressure, 0.0)
        omega, rate = np.asarray(valve.spool_frequency), x[SPOOL_RATE]
        push = np.square(omega) * (demand - x[SPOOL]) - 2.0 * valve.spool_damping * omega * rate
        held = (rate >= fastest) & (push > 0.0) | (rate <= -fastest) & (push < 0.0) | ~self.spool_swings
        out[SPOOL_RATE] = np.where(held, 0.0, push)
        speed = np.where(self.spool_swings, rate, (demand - x[SPOOL]) / valve.spool_time_constant)
        out[SPOOL] = np.clip(speed, -fastest, fastest)

    def _load_sensing(self, x: Array, load: Array, out: Array) -> Array:
        """Rate of the load-sensing line's pressure; the flow [m³/s] that it draws from the load."""
        pump, laminar = self.machine.steering.pump, self.machine.oil.laminar_pressure
        drawn = turbulent(self.cv_ls, load - x[LS], laminar)
        filling = drawn - turbulent(self.cv_bleed, x[LS], laminar)
        volume = modulus(self.machine, np.maximum(x[LS], 0.0)) / pump.ls_volume * filling
        out[LS] = np.where(self.line_has_volume, volume, (load - x[LS]) / pump.ls_time_constant)
        return np.where(self.line_has_volume & (load > 0.0), drawn, 0.0)

    def _swash(self, x: Array, p_s: Array, out: Array) -> None:
        """Rate of the swash: of the margin's error, or of that behind a lag and a lead; within the stroke times."""
        pump = self.machine.steering.pump
        error = (np.minimum(x[LS] + pump.margin, self.limits["cutoff"]) - p_s) / pump.control_band
        lead = np.asarray(pump.valve_lead_time) / pump.valve_time_constant
        out[PUMP_VALVE] = np.where(self.pump_leads, (error - x[PUMP_VALVE]) / pump.valve_time_constant, 0.0)
        ahead = np.where(self.pump_leads, x[PUMP_VALVE] + lead * (error - x[PUMP_VALVE]), error)
        free = ahead / pump.stroke_up_time
        limited = self.limits["swash_limited"] > 0.0
        speed = np.where(limited, np.clip(free, -1.0 / pump.stroke_down_time, 1.0 / pump.stroke_up_time), free)
        at_stop = (x[SWASH] >= 1.0) & (speed > 0.0) | (x[SWASH] <= 0.0) & (speed < 0.0)
        out[SWASH] = np.where(at_stop, 0.0, speed)

    def _past(self, x: Array, valve_a: Array, valve_b: Array, p_t: Array, out: Array) -> tuple[Array, Array]:
        """Flows [m³/s] from either port to the return line past the edges: shock valve, leakage, anti-cavitation valve."""
        valve, laminar, past = self.machine.steering.valve, self.machine.oil.laminar_pressure, []
        for port, side in zip((valve_a, valve_b), SIDES, strict=True):
            shock = valve.shock_flow / valve.shock_ramp * np.maximum(port - p_t - self.limits["shock_pressure"], 0.0)
            out[side.shock] = np.where(self.shock_lags, (shock - x[side.shock]) / valve.shock_time_constant, 0.0)
            shock = np.where(self.shock_lags, x[side.shock], shock)
            opens = np.maximum(p_t - port - valve.anticavitation_crack, 0.0)
            past.append(
                shock + valve.leakage * (port - p_t) - turbulent(self.limits["cv_anticavitation"], opens, laminar)
            )
        return past[0], past[1]

    def _ports(self, x: Array, in_a: Array, in_b: Array, ports: Chambers, joint_rate: Array, out: Array) -> None:
        """Rates of the ports' pressures under flows [m³/s] from the valve, by the law of hoses: shut oil in series with
        mounts and their play."""
        steering, flows, compliances = self.machine.steering, [], []
        for side, flow, volume in zip(SIDES, (in_a, in_b), (ports.volume_a, ports.volume_b), strict=True):
            p, gone = self.felt(x[side.port]), 0.0
            wall = walls(self.machine, p)
            out[[side.hose, side.between, side.strain]] = 0.0
            if self.two_segments.any():
                at_valve = self.felt(x[side.hose])
                half = 0.5 * steering.hose_volume / modulus(self.machine, at_valve) + wall
                drop = at_valve - p - steering.hose_resistance * x[side.between]
                out[side.hose] = np.where(self.two_segments, (flow - x[side.between]) / half, 0.0)
                out[side.between] = np.where(self.two_segments, drop / steering.hose_inertance, 0.0)
                flow = np.where(self.two_segments, x[side.between], flow)
                gone = np.where(self.two_segments, 0.5 * steering.hose_volume, 0.0)
            if self.creeps.any():
                late = steering.hose_delayed_share * steering.hose_compliance * np.maximum(p, 0.0)
                out[side.strain] = np.where(self.creeps, (late - x[side.strain]) / steering.hose_delay_time, 0.0)
            flows.append(flow - out[side.strain])
            full = (volume - gone) / modulus(self.machine, p) + wall
            void = (self.nominal - gone) / self.machine.oil.bulk_modulus
            compliances.append(np.where(x[side.port] < self.machine.oil.void_pressure, void, full))
        leak = 2.0 * steering.cylinder.leakage * (self.felt(x[PORT_A]) - self.felt(x[PORT_B]))
        rise_a = (flows[0] - leak - ports.displacement_a * joint_rate) / compliances[0]
        rise_b = (flows[1] + leak + ports.displacement_b * joint_rate) / compliances[1]
        bend = self._bend(self.torque(x, ports))
        spring = ports.displacement_a**2 / compliances[0] + ports.displacement_b**2 / compliances[1]
        torque_rate = (ports.displacement_a * rise_a - ports.displacement_b * rise_b) / (1.0 + bend * spring)
        out[PORT_A] = rise_a - ports.displacement_a / compliances[0] * bend * torque_rate
        out[PORT_B] = rise_b + ports.displacement_b / compliances[1] * bend * torque_rate

    def _bend(self, torque: Array) -> Array:
        """Compliance [rad/(N m)] between cylinders and frames at ``torque``: mounts, and play that a torque crosses. A mount
        that hardens, T = k b (1 + |b|/2b₀), gives 1/(k (1 + |b|/b₀)) with 1 + |b|/b₀ = √(1 + 2 |T|/(k b₀))."""
        joint = self.machine.joint
        crossing = 1.0 / np.cosh(np.clip(torque / PLAY_TORQUE, -50.0, 50.0)) ** 2
        bent = np.abs(torque) * joint.compliance / joint.hardening_angle
        harder = np.where(self.hardens, np.sqrt(1.0 + 2.0 * bent), 1.0)
        return np.asarray(joint.compliance / harder + 0.5 * joint.backlash / PLAY_TORQUE * crossing)
