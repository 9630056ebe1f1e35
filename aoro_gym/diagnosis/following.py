"""Twins that follow a recording: all that was measured is held to the measurement, and what that takes is kept.

Every part of the machine then works between measured boundaries. After each main step h the measured states are led back.
A port's pressure p goes to its measurement y, for which its volume takes the oil (y − p) dV/dp. The joint is on a leash, a
spring and a damper between the frames, with which the error y − θ of its angle dies out as (1 + ω₀ t) exp(−ω₀ t):

    Δθ̇ = ω₀² (y − θ) h + 2 ω₀ Δ(y − θ).

Oil a second is a flow, the impulse a second that the leash takes a torque: what the parts next to a signal do otherwise
than their laws say, and no other part. The leash is Luenberger's observer (1971), and what it gives his innovation, from
which faults of parts are told in the field (Isermann, *Fault-Diagnosis Systems*, 2006, ch. 11).

The pump runs beside the twin, under the measured pressure of the loaded port and the flow that this port takes, while the
valve has the measured supply. As the pump's control integrates, to hold its pressure to the measured one would let its swash
drift with the least error of a sensor, and to leave it free its line, where it gives all that it can. So it is on a leash,
too: a flow that would bring its line to the measured pressure within :data:`LINE`.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportCallIssue=false
# pyright: reportArgumentType=false, reportOperatorIssue=false
from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.twin import Twin
from aoro_gym.twin.physics.bodies import CornerLoad, accelerate, hinge_rotation
from aoro_gym.twin.physics.fluid import Gas, Oil, fill, free_gas, orifice, pressure, relief_valve, volume_stiffness
from aoro_gym.twin.physics.load_sensing_pump import swash_step
from aoro_gym.twin.physics.steering import steering_geometry
from aoro_gym.twin.physics.steering_circuit import Steering
from aoro_gym.twin.physics.steering_valve import valve_opening
from aoro_gym.twin.records import MachineRecord, State

LED = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
"""Signals that lead."""
LACKED = ("torque", "flow_a", "flow_b", "pump_pressure", "inertia")
"""What comes back: the torque between the frames [N m], the flows into ports A and B [m³/s] and the pump's pressure [Pa]
that are missing, means over a tick; and the inertia [kg m²] that the torque turns against."""
STEPS = 10
"""Main steps a tick."""
LEASH = wp.constant(20.0)
"""ω₀ [rad/s] of the joint's: a torque of 1 kN m, which gives frames of 1.7 Mg m² that lie free 0.6 rad/s², stretches it by
0.08°."""
LINE = wp.constant(0.005)
"""Time constant [s] of the pump's."""
DRAWN = wp.constant(0.1)
"""Time constant [s] over which the flow that the loaded port takes, beyond that which the valve should let pass, is
averaged: between two samples its pressure is not known as well as a stiff line would need."""
UNIT = wp.constant(1e3)
"""Torque [N m] whose effect on the frames is asked for."""
BOTTOM = wp.constant(0.5e5)
"""Pressure [Pa] at the lower end of a sensor's range: what reads less may be a void, whose volume no sensor tells."""


@wp.func
def _weight(distance: float):
    """Weight of a sample so many samples away, in [0, 2], on the cubic through all of them (Catmull and Rom 1974)."""
    x = distance
    near = 1.0 + x * x * (1.5 * x - 2.5)
    far = 2.0 + x * (-4.0 + x * (2.5 - 0.5 * x))
    return wp.where(x < 1.0, near, far)


@wp.func
def _taken(oil: Oil, content: float, measured: float, volume: float, hose_compliance: float):
    """State [Pa] of a volume led to its ``measured`` pressure, and the oil [m³] that this takes."""
    shown = pressure(oil, content)
    if not wp.isfinite(measured) or (measured < BOTTOM and shown < BOTTOM):
        return content, 0.0
    gas = free_gas(oil, measured)
    return measured, (measured - shown) / volume_stiffness(oil, gas, measured, volume, hose_compliance)


@wp.struct
class Pump:
    """Pump 2 by itself."""

    line: float  # [Pa] content of its line
    ls_pressure: float  # [Pa]
    swash: float  # [-]


@wp.func
def pump_step(m: Steering, oil: Oil, gas: Gas, engine_speed: float, load: float, drawn: float, s: Pump, dt: float):
    """Pump 2 and its line with its ``gas`` after ``dt``, under a ``load`` [Pa] that is sensed while a flow [m³/s] is
    ``drawn``: its share of :func:`~aoro_gym.twin.physics.steering.steering_step`."""
    p = pressure(oil, s.line)
    net = (
        s.swash * m.pump_displacement * engine_speed
        - m.pump_leakage * p
        - orifice(m.pump_cv_bleed, s.ls_pressure, oil.laminar_pressure)
        - relief_valve(p, m.pump_relief_pressure, m.pump_relief_ramp, m.pump_relief_flow)
        - drawn
    )
    out = Pump()
    out.line = fill(oil, gas, s.line, net, dt, m.pump_line_volume, m.pump_line_compliance)
    out.ls_pressure = s.ls_pressure + (dt / m.pump_ls_time_constant) * (wp.max(load, 0.0) - s.ls_pressure)
    out.swash = swash_step(m, s.swash, p, s.ls_pressure, dt)
    return out


@wp.func
def _push(m: MachineRecord, kick: float, t: int, state: wp.array2d(dtype=float)):
    """Change the joint's rate by ``kick`` [rad/s] with the impulse of a torque between the frames, which moves them all;
    returns the inertia [kg m²] against it."""
    none = wp.vec3(0.0, 0.0, 0.0)
    fl, fr, rl, rr = CornerLoad(), CornerLoad(), CornerLoad(), CornerLoad()
    fl.angle = state[State.ARM_FL, t]
    fr.angle = state[State.ARM_FR, t]
    rl.angle = state[State.ARM_RL, t]
    rr.angle = state[State.ARM_RR, t]
    to_rear = hinge_rotation(state[State.JOINT, t])
    of_one = accelerate(
        m.frame_front, m.frame_rear, m.corner, none, to_rear, none, none, 0.0, UNIT, fl, fr, rl, rr, none, none, none,
        none,
    )  # fmt: skip
    share = kick / of_one.joint
    state[State.JOINT_RATE, t] += kick
    for i in range(3):
        state[int(State.VX) + i, t] += share * of_one.linear[i]
        state[int(State.WX) + i, t] += share * of_one.angular[i]
    for i in range(4):
        state[int(State.ARM_RATE_FL) + i, t] += share * of_one.arms[i]
    return UNIT / of_one.joint


@wp.kernel(enable_backward=False)
def _lead(
    machines: wp.array(dtype=MachineRecord),
    measured: wp.array3d(dtype=float),
    zeros: wp.array2d(dtype=float),
    which: wp.array(dtype=int),
    tick: int,
    step: int,
    h: float,
    substeps: int,
    state: wp.array2d(dtype=float),
    own: wp.array2d(dtype=float),
    taken: wp.array3d(dtype=float),
):
    """Lead twins back after a main ``step`` of a ``tick``; ``taken`` (as in LACKED, ticks + 1, twins) adds up what it
    takes. ``measured`` (recordings, ticks + 1, signals) less the sensors' ``zeros`` (signals, twins)."""
    t = wp.tid()
    m = machines[t % machines.shape[0]]
    x = float(step + 1) / float(STEPS)
    log = which[t]
    # samples around the tick; a log that has ended stays as it ended
    before = wp.max(tick - 1, 0)
    behind = wp.min(tick + 2, measured.shape[1] - 1)
    y = wp.vec4()
    for i in range(4):
        y[i] = (
            _weight(1.0 + x) * measured[log, before, i]
            + _weight(x) * measured[log, tick, i]
            + _weight(1.0 - x) * measured[log, tick + 1, i]
            + _weight(2.0 - x) * measured[log, behind, i]
            - zeros[i, t]
        )

    ahead = y[0] - state[State.JOINT, t]
    if wp.isfinite(ahead):
        kick = LEASH * LEASH * h * ahead + 2.0 * LEASH * (ahead - own[3, t])
        own[3, t] = ahead
        inertia = _push(m, kick, t, state)
        taken[0, tick + 1, t] += inertia * kick / TICK
        taken[4, tick + 1, t] = inertia

    st = m.steering
    g = steering_geometry(st, state[State.JOINT, t])
    content, oil_a = _taken(m.oil, state[State.PORT_A, t], y[1], g.volume_a, st.hose_compliance)
    state[State.PORT_A, t] = content
    taken[1, tick + 1, t] += oil_a / TICK
    content, oil_b = _taken(m.oil, state[State.PORT_B, t], y[2], g.volume_b, st.hose_compliance)
    state[State.PORT_B, t] = content
    taken[2, tick + 1, t] += oil_b / TICK

    left = state[State.SPOOL, t] > 0.0
    opening = valve_opening(
        state[State.SPOOL, t],
        st.valve_overlap,
        wp.where(left, st.valve_dead_band_left, st.valve_dead_band_right),
        wp.where(left, st.valve_opening_left_1V0, st.valve_opening_right_1V0),
        wp.where(left, st.valve_opening_left_1V5, st.valve_opening_right_1V5),
    )
    load = wp.where(opening > 0.0, wp.where(left, y[1], y[2]), 0.0)
    lacking = wp.where(opening > 0.0, wp.where(left, oil_a, oil_b) / h, 0.0)
    own[4, t] += h / DRAWN * (lacking - own[4, t])
    drawn = state[State.FLOW_IN, t] + own[4, t]
    pump = Pump(own[0, t], own[1, t], own[2, t])
    gas = free_gas(m.oil, pump.line)
    for _ in range(substeps):
        pump = pump_step(st, m.oil, gas, state[State.ENGINE_SPEED, t], load, drawn, pump, h / float(substeps))
    own[1, t] = pump.ls_pressure
    own[2, t] = pump.swash
    state[State.LS_PRESSURE, t] = pump.ls_pressure
    state[State.SWASH, t] = pump.swash  # what the engine drives
    if wp.isfinite(y[3]):
        state[State.SUPPLY, t] = y[3]
        ahead = y[3] - pressure(m.oil, pump.line)
        pump.line = pressure(m.oil, pump.line) + h / LINE * ahead
        taken[3, tick + 1, t] += ahead / float(STEPS)
    else:
        state[State.SUPPLY, t] = pump.line
    own[0, t] = pump.line


class Leader:
    """Leads twins.

    Args:
        twin: At rest.
        measured: (recordings, ticks + 1, signals) as in :data:`LED`; NaN where a signal was not logged.
        zeros: (signals, twins): what the sensors read too much.
        which: (twins,) recording that each follows.
    """

    def __init__(self, twin: Twin, measured: Floats, zeros: Floats, which: wp.array):
        device = twin.device
        schedule = wp.array(measured.astype(np.float32), dtype=float, device=device)
        offsets = wp.array(zeros.astype(np.float32), dtype=float, device=device)
        self.taken = wp.zeros((len(LACKED), measured.shape[1], twin.num_twins), dtype=float, device=device)
        """(len(LACKED), ticks + 1, twins); zero at the start."""
        at_rest = np.zeros((5, twin.num_twins), dtype=np.float32)
        at_rest[:3] = twin.state.numpy()[[int(row) for row in (State.SUPPLY, State.LS_PRESSURE, State.SWASH)]]
        own = wp.array(at_rest, dtype=float, device=device)
        self._advance = partial(twin.advancing(TICK / STEPS), 0, twin.num_twins)
        arguments = [
            twin.machines, schedule, offsets, which, 0, 0, TICK / STEPS, twin.substeps, twin.state, own, self.taken,
        ]  # fmt: skip
        self._lead: Any = wp.launch(_lead, twin.num_twins, arguments, device=device, record_cmd=True)

    def advance(self, tick: int) -> None:
        """Under the commands that the twins hold."""
        self._lead.set_param_at_index(4, tick)
        for step in range(STEPS):
            self._advance()
            self._lead.set_param_at_index(5, step)
            self._lead.launch()
