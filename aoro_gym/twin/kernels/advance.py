"""The kernel ``advance``: moves twins by many main steps in one launch.

One thread is one twin. A main step is drift – hydraulics – kick – drift:

1. half a step of the pose with the old velocity;
2. slow actuators (arm spools, pump 1, gears, traction valves: once a main step), then all hydraulic substeps, with the
   geometry of the middle pose and the old joint rates; the oil's mean torques over the step are kept;
3. contacts, friction and bodies at the middle pose, with velocities extrapolated to the middle of the step where a force
   depends on them: one kick of the velocity. Deflections of dry friction belong to the middle of the step, too, moved
   there by the velocity between (leapfrog);
4. half a step of the pose with the new velocity; the oil takes up the difference of volume between the old and the mean
   velocity.

Bodies and shut-in oil together form a symplectic scheme of second order (Störmer–Verlet): without losses their energy
does not drift. Flows through orifices are of first order in the substep.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.corners import Half, corner_contact, deflections, hull_loads
from aoro_gym.twin.kernels.hydraulics import (
    actuators_step,
    chambers_at,
    delay,
    displace,
    driveline_control,
    hydraulics,
    load_signals,
    pumps_torque,
)
from aoro_gym.twin.kernels.laws import with_laws
from aoro_gym.twin.kernels.motion import drift, kick, rear_rate, rear_rate_change, turn, wheel_rates
from aoro_gym.twin.kernels.outputs import GroundContact, record_further_outputs, record_outputs
from aoro_gym.twin.kernels.state import load_state, rest, store_state, watched
from aoro_gym.twin.kernels.tree import further_contact, tree
from aoro_gym.twin.physics.bodies import hinge_rotation
from aoro_gym.twin.physics.engine import engine_step
from aoro_gym.twin.physics.fluid import without_gas
from aoro_gym.twin.physics.joint import least_inertia, rigid_joint_torque
from aoro_gym.twin.physics.steering_valve import play_output
from aoro_gym.twin.records import NON_FINITE, OK, MachineRecord

TWO_PI = wp.constant(6.283185307179586)


@wp.func
def lost(terrain: Any, t: int):
    """Status of a twin whose state is not finite."""
    return NON_FINITE


def advance(
    # parameters
    machines: wp.array(dtype=MachineRecord),
    laws: Any,
    terrain: Any,
    # commands (set, row, twin): each set holds for an equal number of frames
    commands: wp.array3d(dtype=float),
    # state in and out
    state: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    clock: wp.array(dtype=int),
    status: wp.array(dtype=int),
    # outputs (frame, row, twin): one frame every ``frame_steps`` main steps
    outputs: wp.array3d(dtype=float),
    # time stepping
    first: int,
    num_frames: int,
    frame_steps: int,
    num_substeps: int,
    h: float,
):
    """Advance the twins from ``first`` on by ``num_frames`` times ``frame_steps`` main steps of ``h`` [s] with
    ``num_substeps`` each.

    Longer than other functions: it is the block diagram of a main step, a block a paragraph, and its variables are the
    state that a thread keeps in registers.
    """
    t = first + wp.tid()
    if status[t] != OK:
        return
    m = with_laws(laws, machines[t % machines.shape[0]])
    ground = terrain.twins[t]

    pose, velocity, change, bent, actuators, circuits, engine = load_state(state, t, m.varies_laws)
    tick = clock[t]
    half = 0.5 * h

    for frame in range(num_frames):
        signals = load_signals(commands[frame * commands.shape[0] // num_frames], t)
        contact = GroundContact(wp.vec4(0.0, 0.0, 0.0, 0.0), wp.vec4(1.0, 1.0, 1.0, 1.0), 0.0)
        for step in range(frame_steps):
            # half a drift: the middle pose
            pose.orientation = turn(pose.orientation, velocity.angular, half)
            rotation = wp.quat_to_matrix(pose.orientation)
            pose = drift(pose, velocity, rotation, half)
            to_rear = hinge_rotation(pose.joint)
            omega_rear = rear_rate(to_rear, velocity)
            wheel_rate = wheel_rates(velocity.angular, omega_rear, velocity.arms, velocity.spins)
            pose.wheels += half * wheel_rate

            # slow actuators: their value in the middle of the step
            delayed = delay(history, t, tick, signals.steering, m.steering.valve_command_delay / h)
            old = actuators
            actuators = actuators_step(m, signals, delayed, old, h)
            spool_demand = play_output(actuators.play, m.steering.valve_hysteresis)
            control = driveline_control(m.driveline.motor_displacement, old, actuators, engine.speed)

            # hydraulic substeps
            chambers = chambers_at(m, pose, old, actuators)
            if m.oil.gas_fraction > 0.0 or m.joint.mount_stiffness > 0.0:
                circuits, oil = hydraulics(
                    m, laws, m.oil, m.joint.mount_stiffness, chambers, control, spool_demand, pose.joint, velocity.joint,
                    velocity.arms, wheel_rate, circuits, state, t, signals, h, num_substeps,
                )
            else:  # compiled without gas and mount
                circuits, oil = hydraulics(
                    m, laws, without_gas(m.oil), 0.0, chambers, control, spool_demand, pose.joint, velocity.joint,
                    velocity.arms, wheel_rate, circuits, state, t, signals, h, num_substeps,
                )

            # motion in the middle of the step, extrapolated
            middle = kick(velocity, change, half)
            middle_omega_rear = rear_rate(to_rear, middle)
            middle_wheel_rate = wheel_rate + half * wheel_rates(
                change.angular, rear_rate_change(to_rear, velocity, change), change.arms, change.spins
            )

            # joint: oil, friction, stops; or the mount, whose cylinders feel them
            joint_torque = oil.joint
            if m.joint.mount_stiffness == 0.0:
                joint_torque, friction = rigid_joint_torque(
                    m.joint, m.steering, m.oil, chambers.steering, pose.joint, middle.joint, velocity.joint, oil.joint,
                    circuits.steering, circuits.mount.friction, least_inertia(m.frame_front, m.frame_rear), h,
                )
                circuits.mount.friction = friction

            # corners: arms, wheels, tires; hulls
            front = Half(
                1.0, m.frame_front.pivot_x, rotation, pose.position, middle.linear, middle.angular,
                control.displacement_front,
            )
            rear = Half(
                -1.0, m.frame_rear.pivot_x, rotation * wp.transpose(to_rear), pose.position, to_rear * middle.linear,
                middle_omega_rear, control.displacement_rear,
            )
            fl = corner_contact(
                m, terrain, ground, front, 0, chambers.fl, circuits.fl, pose.arms, velocity, middle, wheel_rate,
                middle_wheel_rate, change, oil, bent, signals.parking_brake, h,
            )
            fr = corner_contact(
                m, terrain, ground, front, 1, chambers.fr, circuits.fr, pose.arms, velocity, middle, wheel_rate,
                middle_wheel_rate, change, oil, bent, signals.parking_brake, h,
            )
            rl = corner_contact(
                m, terrain, ground, rear, 2, chambers.rl, circuits.rl, pose.arms, velocity, middle, wheel_rate,
                middle_wheel_rate, change, oil, bent, signals.parking_brake, h,
            )
            rr = corner_contact(
                m, terrain, ground, rear, 3, chambers.rr, circuits.rr, pose.arms, velocity, middle, wheel_rate,
                middle_wheel_rate, change, oil, bent, signals.parking_brake, h,
            )
            bent = deflections(fl, fr, rl, rr)
            front_hull = hull_loads(m.hull, m.frame_front, m.frame_ground_clearance, terrain, ground, front)
            rear_hull = hull_loads(m.hull, m.frame_rear, m.frame_ground_clearance, terrain, ground, rear)
            contact.wheel_load = wp.vec4(fl.normal, fr.normal, rl.normal, rr.normal)
            contact.on_map = wp.vec4(fl.known, fr.known, rl.known, rr.known)
            contact.hull_force = front_hull.touch + rear_hull.touch

            further_contact(laws, state, t, terrain, ground, front, h)

            # accelerations of the tree
            weight = wp.transpose(rotation) * wp.vec3(0.0, 0.0, -ground.gravity)
            change = tree(
                m, laws, state, t, weight, to_rear, middle, joint_torque, fl.load, fr.load, rl.load, rr.load, front_hull,
                rear_hull, h,
            )

            # kick, and half a drift to the end of the step
            start = velocity
            velocity = kick(start, change, h)
            pose = drift(pose, velocity, rotation, half)
            pose.orientation = turn(pose.orientation, velocity.angular, half)
            omega_rear = rear_rate(hinge_rotation(pose.joint), velocity)
            end_wheel_rate = wheel_rates(velocity.angular, omega_rear, velocity.arms, velocity.spins)
            wheels = pose.wheels + half * end_wheel_rate
            for i in range(4):
                wheels[i] = wheels[i] - TWO_PI * wp.floor(wheels[i] / TWO_PI)
            pose.wheels = wheels

            # the oil takes up what the joints moved beyond the old velocity: volumes stay exact
            circuits = displace(
                m, chambers, control, half * (velocity.joint - start.joint), half * (velocity.arms - start.arms),
                half * (end_wheel_rate - wheel_rate), circuits,
            )
            engine = engine_step(m.engine, engine, pumps_torque(m, circuits, actuators.drive_swash), h)
            tick += 1

            # any NaN or infinity in a velocity or a pressure reaches this sum within a step
            watch = watched(pose, velocity, circuits, oil, engine)
            if not wp.isfinite(watch):
                status[t] = lost(terrain, t)
                return

        record_outputs(outputs, frame, t, m, signals, pose, velocity, actuators, circuits, engine, contact, terrain)
        record_further_outputs(laws, outputs, frame, state, t)

    if not wp.isfinite(rest(pose, change, bent, actuators, circuits, engine)):
        status[t] = lost(terrain, t)
        return
    store_state(state, t, pose, velocity, change, bent, actuators, circuits, engine, m.varies_laws)
    clock[t] = tick
