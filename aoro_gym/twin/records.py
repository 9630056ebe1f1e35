"""What the device holds: the machine record, and the rows of the state, command and output arrays.

State, commands and outputs are structures of arrays, float32, one row a quantity and one column a twin, so that the
loads of neighbouring twins coalesce.
"""

# pyright: reportGeneralTypeIssues=false
import difflib
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.recording.commands import COMMAND_BOUNDS, WHEELS
from aoro_gym.twin.physics.arms import Arm
from aoro_gym.twin.physics.bodies import Corner, FrameBody
from aoro_gym.twin.physics.driveline import Driveline
from aoro_gym.twin.physics.engine import Engine
from aoro_gym.twin.physics.fluid import Oil
from aoro_gym.twin.physics.joint import Joint
from aoro_gym.twin.physics.steering import Steering
from aoro_gym.twin.physics.tires import Hull, Tire


@wp.struct
class Rest:
    """The rest pose on level ground (derived)."""

    height: float  # [m] of the frames' design ground plane over the ground
    arm_angle_front: float  # [rad]
    arm_angle_rear: float
    bore_pressure_front: float  # [Pa]
    bore_pressure_rear: float


@wp.struct
class MachineRecord:
    """All parameters of one twin."""

    oil: Oil
    frame_front: FrameBody
    frame_rear: FrameBody
    hull: Hull
    corner: Corner
    arm: Arm
    tire: Tire
    joint: Joint
    steering: Steering
    driveline: Driveline
    engine: Engine
    rest: Rest
    frame_ground_clearance: float  # [m]


OK = wp.constant(0)
NON_FINITE = wp.constant(1)


def _each(name: str) -> list[str]:
    return [f"{name}_{wheel}" for wheel in WHEELS]


State: Any = IntEnum(
    "State",
    [
        # pose: hinge origin [m] with its rounding remainder [m], quaternion of the front frame (x, y, z, w), angles [rad]
        *("X", "Y", "Z", "REST_X", "REST_Y", "REST_Z", "QX", "QY", "QZ", "QW", "JOINT"),
        *[n.upper() for n in (*_each("arm"), *_each("wheel"))],
        # velocity: hinge origin [m/s] and angular [rad/s] in front-frame axes, joint, arms, absolute wheel spins
        *("VX", "VY", "VZ", "WX", "WY", "WZ", "JOINT_RATE"),
        *[n.upper() for n in (*_each("arm_rate"), *_each("spin"))],
        # accelerations over the last main step, in the same order
        *("AVX", "AVY", "AVZ", "AWX", "AWY", "AWZ", "JOINT_ACCELERATION"),
        *[n.upper() for n in (*_each("arm_acceleration"), *_each("spin_acceleration"))],
        # bristles and dry friction
        *[n.upper() for n in (*_each("bristle_x"), *_each("bristle_y"))],
        "JOINT_FRICTION",
        *[n.upper() for n in (*_each("arm_friction"), *_each("wheel_friction"), *_each("twist"))],
        # steering circuit
        *("SUPPLY", "PORT_A", "PORT_B", "TANK_LINE", "LS_PRESSURE", "SPOOL", "PLAY", "COMPENSATOR", "SWASH"),
        *("FLOW_IN", "FLOW_OUT", "MOUNT", "MOUNT_RATE"),
        # arms
        *[n.upper() for n in (*_each("arm_bore"), *_each("arm_rod"), *_each("arm_spool"))],
        # driveline
        *("FORWARD", "BACK", *[n.upper() for n in _each("hose")], "CHARGE", "DRIVE_SWASH", "SHIFT_FRONT", "SHIFT_REAR"),
        *[n.upper() for n in _each("traction")],
        # engine
        *("ENGINE_SPEED", "GOVERNOR", "ENGINE_TORQUE"),
    ],
    start=0,
)

Command: Any = IntEnum("Command", [n.upper() for n in COMMAND_BOUNDS], start=0)

Output: Any = IntEnum(
    "Output",
    [
        n.upper()
        for n in (
            # commands as given
            *("steering_signal", "drive_signal"),
            # joint
            *("joint_angle", "joint_rate", "joint_flow"),
            # steering circuit
            *("pressure_a", "pressure_b", "pump_pressure", "return_pressure", "ls_pressure", "spool", "compensator"),
            *("pump_swash", "flow_in", "flow_out", "pump_flow"),
            # driveline
            *("drive_pressure_forward", "drive_pressure_return", "charge_pressure", "drive_swash"),
            *("shift_front", "shift_rear"),
            *_each("motor_pressure"),
            *_each("wheel_rate"),
            # arms
            *_each("arm_angle"),
            *_each("arm_pressure_bore"),
            *_each("arm_pressure_rod"),
            # engine
            *("engine_speed", "engine_torque"),
            # vehicle
            *("position_x", "position_y", "position_z", "roll", "pitch", "yaw", "speed", "yaw_rate"),
            *_each("wheel_load"),
            "hull_force",
            "wheels_off_map",
        )
    ],
    start=0,
)

CHANNELS = tuple(output.name.lower() for output in Output)
"""Names of all outputs, in the order of their rows."""

OUTPUT_UNITS: dict[str, str] = {}
for _output in Output:
    _name = _output.name.lower()
    if "pressure" in _name:
        OUTPUT_UNITS[_name] = "Pa"
    elif "flow" in _name:
        OUTPUT_UNITS[_name] = "m^3/s"
    elif _name.endswith("rate") or "wheel_rate" in _name or _name == "engine_speed":
        OUTPUT_UNITS[_name] = "rad/s"
    elif "angle" in _name or _name in ("roll", "pitch", "yaw"):
        OUTPUT_UNITS[_name] = "rad"
    elif "position" in _name:
        OUTPUT_UNITS[_name] = "m"
    elif _name == "speed":
        OUTPUT_UNITS[_name] = "m/s"
    elif "load" in _name or "force" in _name:
        OUTPUT_UNITS[_name] = "N"
    elif "torque" in _name:
        OUTPUT_UNITS[_name] = "N m"
    else:
        OUTPUT_UNITS[_name] = "1"


def row_of(rows: type[IntEnum], name: Any, what: str) -> int:
    """Row of ``name``, ``what`` it is called; ValueError that lists the names if there is none such."""
    try:
        return int(rows[name.upper()])
    except (KeyError, AttributeError):
        known = [row.name.lower() for row in rows]
        near = difflib.get_close_matches(str(name), known, n=1)
        hint = f": did you mean '{near[0]}'? Choose" if near else "; choose"
        raise ValueError(f"there is no {what} '{name}'{hint} one of: {', '.join(known)}") from None


STIFFEST_MOUNT = 2e8
"""Torsional stiffness [N m/rad] between cylinders and frames that the main step resolves, 40 times the oil's. What
is stiffer is taken as that: between no mount and the least one the twin jumps by 5e-9 rad/(N m), 1 % of a soft frame."""


def _mount_stiffness(machine: Machine) -> Quantity:
    """Stiffness [N m/rad] between cylinders and frames; 0 where they are one, without compliance and play."""
    joint = machine.joint
    is_there = np.greater(joint.compliance, 0.0) | np.greater(joint.backlash, 0.0)
    return np.where(is_there, 1.0 / np.maximum(joint.compliance, 1.0 / STIFFEST_MOUNT), 0.0)


def _geometry(machine: Machine) -> dict[str, Quantity]:
    """Device fields that join several sections of the machine, by their path in the record."""
    frame, arm = machine.frame, machine.arm
    return {
        "frame_front.pivot_x": frame.front.axle_distance - arm.length,
        "frame_rear.pivot_x": arm.length - frame.rear.axle_distance,
        "corner.wheel_lateral": 0.5 * frame.track,
        "corner.arm_length": arm.length,
        "corner.pivot_height": arm.pivot_height,
        "corner.spin_inertia": machine.wheel.inertia_spin,
        "arm.stop_torsional_stiffness": arm.stop_stiffness * arm.cylinder.linkage.mean_lever**2,
        "arm.stop_torsional_damping": arm.stop_damping * arm.cylinder.linkage.mean_lever**2,
        "joint.mount_stiffness": _mount_stiffness(machine),
        "joint.stop_torsional_stiffness": 2.0
        * machine.joint.stop_stiffness
        * machine.steering.cylinder.linkage.mean_lever**2,
        "joint.stop_torsional_damping": 2.0
        * machine.joint.stop_damping
        * machine.steering.cylinder.linkage.mean_lever**2,
    }


def _find(section: object, name: str) -> object:
    """Attribute of ``section`` whose dotted path, joined by underscores, is ``name``."""
    if hasattr(section, name):
        return getattr(section, name)
    for end in range(len(name) - 1, 0, -1):
        if name[end] == "_" and hasattr(section, name[:end]):
            try:
                return _find(getattr(section, name[:end]), name[end + 1 :])
            except AttributeError:
                continue
    raise AttributeError(f"the machine has no value for the device field '{name}' of {type(section).__name__}")


def _fill(row: np.ndarray, section: object, geometry: dict[str, Quantity], path: str = "") -> None:
    for name in row.dtype.names or ():
        here = f"{path}{name}"
        if here in geometry:
            row[name] = geometry[here]
        elif row.dtype[name].names:
            _fill(row[name], _find(section, name), geometry, f"{here}.")
        else:
            row[name] = _find(section, name)


def pack(machine: Machine) -> np.ndarray:
    """Device records of ``machine``: structured float32 array of shape (machine.num_variants,)."""
    layout: Any = MachineRecord.numpy_dtype()
    rows = np.zeros(machine.num_variants, dtype=layout)
    _fill(rows, machine, _geometry(machine))
    return rows
