"""A crane on the front frame: its chain of joints in the tree, its sections on pump 2, and its outputs.

Machines with a crane are advanced by kernels of their own, in which the functions here stand in place of those that do
nothing (:mod:`aoro_gym.twin.kernels.build`); the others know nothing of it. The order of a main step is that of
:mod:`aoro_gym.twin.kernels.advance`: joints drift to the middle, oil in substeps, kick, drift, and the oil takes up what the
joints moved beyond the old velocity.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportRedeclaration=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.corners import Half, HullLoads
from aoro_gym.twin.kernels.hydraulics import Signals, load_signals
from aoro_gym.twin.kernels.laws import ChosenLaws, DefaultLaws, with_laws
from aoro_gym.twin.kernels.state import Velocity, load3, load4, store3, store4
from aoro_gym.twin.kernels.tree import accelerate_with_load
from aoro_gym.twin.physics.bodies import Articulated, CornerLoad, add, halves
from aoro_gym.twin.physics.crane import (
    CraneRecord,
    carried_by_frame,
    crane_motion,
    held_log,
    joint_acceleration,
    place_of_tip,
    pushed,
    slewed,
    tip_specific_force,
)
from aoro_gym.twin.physics.crane_oil import (
    CraneHydraulics,
    CraneSections,
    bank_load,
    crane_chambers,
    crane_opening,
    cylinder_torques,
    displaced,
    friction_and_stops,
    friction_capacity,
    priority_share,
    sections_step,
    with_gas,
)
from aoro_gym.twin.physics.fluid import Oil, pressure
from aoro_gym.twin.physics.friction import lag, presliding
from aoro_gym.twin.physics.ground import ceiling, footing
from aoro_gym.twin.physics.steering_circuit import Exchange, SteeringState
from aoro_gym.twin.physics.steering_valve import metering
from aoro_gym.twin.physics.tires import Hull, hull_contact
from aoro_gym.twin.records import CRANE_OUTPUT_UNITS, CraneCommand, CraneRow, MachineRecord, State

OUTPUTS = wp.constant(len(CRANE_OUTPUT_UNITS))


@wp.struct
class FrameCrane:
    """A crane and how the front frame carries it."""

    chain: CraneRecord
    oil: CraneHydraulics
    has_oil: int  # 0: torques from outside alone move the joints
    has_contact: int  # whether the ground bears a log in the grapple
    contact: Hull  # at each of the log's places
    folded_mass: float  # [kg] in the transport pose, which the front frame's mass includes
    folded_moment: wp.vec3  # [kg m] about the hinge's origin
    folded_inertia: wp.mat33  # [kg m²] about it


@wp.struct
class DefaultLawsWithCrane:
    """Default laws, the cranes, and the machines whose oil they share."""

    laws: DefaultLaws
    cranes: wp.array(dtype=FrameCrane)
    machines: wp.array(dtype=MachineRecord)


@wp.struct
class ChosenLawsWithCrane:
    """Chosen laws, the cranes, and the machines whose oil they share."""

    laws: ChosenLaws
    cranes: wp.array(dtype=FrameCrane)
    machines: wp.array(dtype=MachineRecord)


@wp.func
def with_laws_of_crane(laws: Any, m: MachineRecord):
    """As :func:`aoro_gym.twin.kernels.laws.with_laws`."""
    return with_laws(laws.laws, m)


@wp.func
def load_signals_with_crane(commands: wp.array2d(dtype=float), t: int):
    signals = load_signals(commands, t)
    signals.crane = load4(commands, int(CraneCommand.CRANE_SLEW), t)
    signals.held = load4(commands, int(CraneCommand.CRANE_HELD_MASS), t)
    return signals


@wp.func
def held_chain(c: FrameCrane, state: wp.array2d(dtype=float), t: int):
    """The chain with what twin ``t`` holds in its grapple."""
    out = c.chain
    out.held_mass = state[CraneRow.HELD_MASS, t]
    out.held_yaw = state[CraneRow.HELD_YAW, t]
    out.held_inertia_axial = state[CraneRow.HELD_AXIAL, t]
    out.held_inertia_transverse = state[CraneRow.HELD_TRANSVERSE, t]
    return out


@wp.func
def middle_joints(state: wp.array2d(dtype=float), t: int, h: float):
    """Joints in the middle of the step."""
    return load4(state, int(CraneRow.JOINT_SLEW), t) + 0.5 * h * load4(state, int(CraneRow.RATE_SLEW), t)


@wp.func
def crane_sections(laws: Any, state: wp.array2d(dtype=float), t: int, signals: Signals, oil: Oil, h: float):
    """Oil of twin ``t``'s crane at the start of a main step, its spools half-way on; and what its grapple holds."""
    out = CraneSections()
    store4(state, int(CraneRow.HELD_MASS), t, signals.held)
    number = t % laws.cranes.shape[0]
    if laws.cranes[number].has_oil == 0:
        return out
    c = laws.cranes[number].oil
    spools = load4(state, int(CraneRow.SPOOL_SLEW), t)
    for i in range(4):
        spool = lag(spools[i], signals.crane[i], c.time_constant, c.rate_limit, h)
        out.opening[i] = crane_opening(c, 0.5 * (spools[i] + spool))
        spools[i] = spool
    store4(state, int(CraneRow.SPOOL_SLEW), t, spools)
    out.chambers = crane_chambers(c, middle_joints(state, t, h))
    out.rate = load4(state, int(CraneRow.RATE_SLEW), t)
    out.bore = load4(state, int(CraneRow.BORE_SLEW), t)
    out.annulus = load4(state, int(CraneRow.ANNULUS_SLEW), t)
    out = with_gas(oil, out)
    out.torque = 0.5 * cylinder_torques(c, oil, out)
    return out


@wp.func
def crane_step(
    laws: Any, t: int, m: MachineRecord, oil: Oil, steering: SteeringState, exchange: Exchange, sections: CraneSections,
    dt: float,
):  # fmt: skip
    """``exchange`` with what the crane draws and gives back, and its ``sections``, after a substep of ``dt`` [s]."""
    number = t % laws.cranes.shape[0]
    after = sections
    sums = exchange
    if laws.cranes[number].has_oil > 0:
        c = laws.cranes[number].oil
        supply = pressure(oil, steering.supply)
        tank = pressure(oil, steering.tank_line)
        edges = metering(
            m.steering, oil.laminar_pressure, steering, supply, pressure(oil, steering.port_a),
            pressure(oil, steering.port_b), tank,
        )  # fmt: skip
        steers = wp.where(edges.opening > 0.0, wp.max(edges.load_pressure, 1.0), 0.0)
        load = bank_load(oil, sections)
        share = priority_share(c, supply, steers)
        after, drawn, returned = sections_step(c, oil, sections, supply, tank, load, share, dt)
        sums.supply_flow += drawn
        sums.tank_flow += returned
        sums.load_pressure = wp.max(sums.load_pressure, load)
    return sums, after


@wp.func
def keep_sections(
    laws: Any, state: wp.array2d(dtype=float), t: int, oil: Oil, sections: CraneSections, share: float
):
    """Keep the oil, and the means of its torques and flows, by the trapezoidal rule over 1/``share`` substeps."""
    number = t % laws.cranes.shape[0]
    if laws.cranes[number].has_oil > 0:
        c = laws.cranes[number].oil
        store4(state, int(CraneRow.BORE_SLEW), t, sections.bore)
        store4(state, int(CraneRow.ANNULUS_SLEW), t, sections.annulus)
        mean = share * (sections.torque - 0.5 * cylinder_torques(c, oil, sections))
        store4(state, int(CraneRow.OIL_TORQUE_SLEW), t, mean)
        store4(state, int(CraneRow.FLOW_SLEW), t, share * sections.drawn)


@wp.func
def unfolded(front: Articulated, c: FrameCrane, omega: wp.vec3):
    """The ``front`` half, turning at ``omega`` [rad/s], without the folded crane that its masses include."""
    out = front
    out.a -= c.folded_inertia
    out.b -= wp.skew(c.folded_moment)
    out.c -= c.folded_mass * wp.identity(n=3, dtype=float)
    out.n -= wp.cross(omega, c.folded_inertia * omega)
    out.f -= wp.cross(omega, wp.cross(omega, c.folded_moment))
    return out


@wp.func
def crane_torques(
    c: FrameCrane, state: wp.array2d(dtype=float), t: int, q: wp.vec4, rate: wp.vec4, deflection: wp.vec4
):
    """Torques [N m] (N) on the joints ``q`` in the middle of the step: from outside, of oil, friction and stops."""
    out = load4(state, int(CraneRow.TORQUE_SLEW), t)
    if c.has_oil > 0:
        chambers = crane_chambers(c.oil, q)
        out += load4(state, int(CraneRow.OIL_TORQUE_SLEW), t)
        out += friction_and_stops(c.oil, chambers, q, rate, deflection)
    return out


@wp.func
def bent_friction(c: FrameCrane, state: wp.array2d(dtype=float), t: int, q: wp.vec4, h: float):
    """Deflections of the joints' friction, moved to the middle of the step by the velocity between."""
    out = load4(state, int(CraneRow.FRICTION_SLEW), t)
    rate = load4(state, int(CraneRow.RATE_SLEW), t)
    if c.has_oil > 0:
        chambers = crane_chambers(c.oil, q)
        for i in range(4):
            capacity = wp.max(friction_capacity(c.oil, chambers, i), 1.0e-6)
            out[i] = presliding(out[i], rate[i], h, capacity, capacity / c.oil.presliding)
    return out


@wp.func
def move_crane(
    c: FrameCrane, m: MachineRecord, state: wp.array2d(dtype=float), t: int, q: wp.vec4, change: wp.vec4, h: float
):
    """Kick the joints of twin ``t``, drift them from the middle ``q`` to the end of the step, and let the oil take up what
    they moved beyond the old velocity."""
    rate = load4(state, int(CraneRow.RATE_SLEW), t)
    kicked = rate + h * change
    store4(state, int(CraneRow.JOINT_SLEW), t, q + 0.5 * h * kicked)
    store4(state, int(CraneRow.RATE_SLEW), t, kicked)
    store4(state, int(CraneRow.ACCELERATION_SLEW), t, change)
    if c.has_oil > 0:
        s = CraneSections()
        s.chambers = crane_chambers(c.oil, q)
        s.bore = load4(state, int(CraneRow.BORE_SLEW), t)
        s.annulus = load4(state, int(CraneRow.ANNULUS_SLEW), t)
        s = displaced(c.oil, m.oil, s, 0.5 * h * (kicked - rate))
        store4(state, int(CraneRow.BORE_SLEW), t, s.bore)
        store4(state, int(CraneRow.ANNULUS_SLEW), t, s.annulus)


@wp.func
def log_on_ground(
    laws: Any, state: wp.array2d(dtype=float), t: int, terrain: Any, ground: Any, front: Half, h: float
):  # fmt: skip
    """What the ground does to the log of twin ``t`` in the middle of the step: at its lower side's ends and middle, each a
    spring and damper with friction as a hull's corner."""
    force = wp.vec3()
    moment = wp.vec3()
    number = t % laws.cranes.shape[0]
    if laws.cranes[number].has_contact > 0 and state[CraneRow.HELD_MASS, t] > 0.0:
        c = laws.cranes[number]
        q = middle_joints(state, t, h)
        rate = load4(state, int(CraneRow.RATE_SLEW), t) + 0.5 * h * load4(state, int(CraneRow.ACCELERATION_SLEW), t)
        chain = held_chain(c, state, t)
        tip, slopes = place_of_tip(chain, q)
        along, below = held_log(chain, q[0])
        for i in range(3):
            point = tip + below + float(i - 1) * along
            world = front.origin + front.rotation * point
            if world[2] < ceiling(terrain, ground, world[0], world[1]):
                under = footing(terrain, ground, world)
                velocity = front.velocity + slopes * rate + slewed(rate[0], point - tip)
                one = hull_contact(c.contact, under, front.rotation, front.origin, point, velocity, front.omega)
                force += one
                moment += wp.cross(point, one)
    store3(state, int(CraneRow.GROUND_FORCE_X), t, force)
    store3(state, int(CraneRow.GROUND_MOMENT_X), t, moment)


@wp.func
def log_on_covered_ground(
    laws: Any, state: wp.array2d(dtype=float), t: int, terrain: Any, ground: Any, front: Half, h: float
):  # fmt: skip
    """As :func:`log_on_ground`, among objects, which do not touch it, or on soil, which is hard for it."""
    log_on_ground(laws, state, t, terrain.ground, terrain.ground.twins[ground.twin], front, h)


@wp.func
def tree_with_crane(
    m: MachineRecord, laws: Any, state: wp.array2d(dtype=float), t: int, weight: wp.vec3, to_rear: wp.mat33,
    middle: Velocity, joint_torque: float, fl: CornerLoad, fr: CornerLoad, rl: CornerLoad, rr: CornerLoad,
    front_hull: HullLoads, rear_hull: HullLoads, h: float,
):  # fmt: skip
    """As :func:`aoro_gym.twin.kernels.tree.tree_with_load`, with the crane's chain on the front frame."""
    c = laws.cranes[t % laws.cranes.shape[0]]
    q = middle_joints(state, t, h)
    accelerated = load4(state, int(CraneRow.ACCELERATION_SLEW), t)
    rate = load4(state, int(CraneRow.RATE_SLEW), t) + 0.5 * h * accelerated
    deflection = bent_friction(c, state, t, q, h)
    store4(state, int(CraneRow.FRICTION_SLEW), t, deflection)
    chain = held_chain(c, state, t)
    at = crane_motion(chain, q, rate, middle.angular)
    force = load3(state, int(CraneRow.GROUND_FORCE_X), t)
    moment = load3(state, int(CraneRow.GROUND_MOMENT_X), t)
    torque = crane_torques(c, state, t, q, rate, deflection) + pushed(at, chain.foot, force, moment)
    at.carried.f -= force
    at.carried.n -= moment

    omega_rear = to_rear * middle.angular - wp.vec3(0.0, 0.0, middle.joint)
    both = halves(
        m.frame_front, m.frame_rear, m.corner, middle.angular, omega_rear, fl, fr, rl, rr, front_hull.force,
        front_hull.moment, rear_hull.force, rear_hull.moment,
    )  # fmt: skip
    both.front = add(unfolded(both.front, c, middle.angular), carried_by_frame(at, torque))
    change = accelerate_with_load(
        m, state, t, both, weight, to_rear, omega_rear, middle, joint_torque, fl, fr, rl, rr, h
    )

    # without gravity, as the chain's law has it
    linear = change.linear + wp.cross(middle.angular, middle.linear) - weight
    joints = joint_acceleration(at, torque, change.angular, linear)
    specific = tip_specific_force(at, joints, change.angular, linear)
    state[CraneRow.TIP_LOAD, t] = wp.length((chain.grapple_mass + chain.held_mass) * specific - force)
    move_crane(c, m, state, t, q, joints, h)
    return change


@wp.func
def record_crane_outputs(laws: Any, outputs: wp.array3d(dtype=float), frame: int, state: wp.array2d(dtype=float), t: int):
    """Write the rows of ``CRANE_OUTPUT_UNITS``, the last of all."""
    first = outputs.shape[1] - OUTPUTS
    oil = laws.machines[t % laws.machines.shape[0]].oil
    for i in range(4):
        outputs[frame, first + i, t] = state[int(CraneRow.JOINT_SLEW) + i, t]
        outputs[frame, first + 4 + i, t] = state[int(CraneRow.RATE_SLEW) + i, t]
        outputs[frame, first + 8 + i, t] = pressure(oil, state[int(CraneRow.BORE_SLEW) + i, t])
        outputs[frame, first + 12 + i, t] = pressure(oil, state[int(CraneRow.ANNULUS_SLEW) + i, t])
        outputs[frame, first + 16 + i, t] = state[int(CraneRow.FLOW_SLEW) + i, t]
    outputs[frame, first + 20, t] = state[CraneRow.TIP_LOAD, t]
    outputs[frame, first + 21, t] = wp.length(load3(state, int(CraneRow.GROUND_FORCE_X), t))


@wp.kernel(enable_backward=False)
def open_grapples(
    chosen: wp.array(dtype=wp.bool), state: wp.array2d(dtype=float), commands: wp.array2d(dtype=float)
):  # fmt: skip
    """Let the grapple of each chosen twin hold nothing, now and as commanded."""
    t = wp.tid()
    if chosen[t]:
        store4(state, int(CraneRow.HELD_MASS), t, wp.vec4())
        store4(commands, int(CraneCommand.CRANE_HELD_MASS), t, wp.vec4())


@wp.kernel(enable_backward=False)
def settle_cranes(
    cranes: wp.array(dtype=FrameCrane), chosen: wp.array(dtype=wp.bool), joints: wp.array2d(dtype=float), gravity: float,
    rest_pressure: float, state: wp.array2d(dtype=float),
):  # fmt: skip
    """Put the crane of each chosen twin at rest at ``joints``: shut oil that holds it against gravity, with
    ``rest_pressure`` [Pa] in the chambers that do not bear. Its frame's tilt counts, its motion does not."""
    t = wp.tid()
    if not chosen[t]:
        return
    c = cranes[t % cranes.shape[0]]
    for row in range(int(CraneRow.JOINT_SLEW), int(CraneRow.HELD_MASS)):
        state[row, t] = 0.0
    q = load4(joints, 0, t)
    store4(state, int(CraneRow.JOINT_SLEW), t, q)
    orientation = wp.quat(
        state[State.QX, t], state[State.QY, t], state[State.QZ, t], state[State.QW, t]
    )
    weight = wp.quat_rotate_inv(orientation, wp.vec3(0.0, 0.0, -gravity))
    at = crane_motion(held_chain(c, state, t), q, wp.vec4(), wp.vec3())
    needed = -(wp.transpose(at.u_linear) * weight)
    state[CraneRow.TIP_LOAD, t] = gravity * (c.chain.grapple_mass + state[CraneRow.HELD_MASS, t])
    if c.has_oil == 0:
        store4(state, int(CraneRow.TORQUE_SLEW), t, needed)
        return
    chambers = crane_chambers(c.oil, q)
    for i in range(4):
        push = needed[i] / chambers.slope[i]
        back = rest_pressure
        bore = (push + back * c.oil.annulus_area[i]) / c.oil.bore_area[i]
        annulus = (back * c.oil.bore_area[i] - push) / c.oil.annulus_area[i]
        state[int(CraneRow.BORE_SLEW) + i, t] = wp.max(bore, back)
        state[int(CraneRow.ANNULUS_SLEW) + i, t] = wp.max(annulus, back)
