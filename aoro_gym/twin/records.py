"""What the device holds: the machine record, and the rows of the state, command and output arrays.

State, commands and outputs are structures of arrays, float32, one row a quantity and one column a twin, so that the
loads of neighbouring twins coalesce.
"""

# pyright: reportGeneralTypeIssues=false
import difflib
from collections.abc import Iterable, Mapping
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.machine.laws import OPTIONS
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.recording.commands import COMMAND_BOUNDS, CRANE_COMMAND_BOUNDS, JOINTS, WHEELS
from aoro_gym.twin.physics.arms import Arm, ArmValve
from aoro_gym.twin.physics.bodies import Corner, FrameBody
from aoro_gym.twin.physics.driveline import Driveline
from aoro_gym.twin.physics.engine import Engine
from aoro_gym.twin.physics.fluid import Oil
from aoro_gym.twin.physics.joint import Joint
from aoro_gym.twin.physics.load import Payload
from aoro_gym.twin.physics.steering_circuit import Steering
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
    driveline: Driveline
    engine: Engine
    frame_ground_clearance: float  # [m]
    varies_laws: int  # whether any law may differ from the default one
    # last what a main step by the default laws does not need: laws of the steering at its end, load, rest pose
    steering: Steering
    arm_valve: ArmValve
    payload: Payload
    rest: Rest


LAW_FIELDS: Mapping[str, str] = {
    law: f"{section}.{law}_law"
    for law in OPTIONS
    for section, field in MachineRecord.vars.items()
    if f"{law}_law" in getattr(field.type, "vars", ())
}
"""Where the number of each law's option stands in the record."""


OK = wp.constant(0)
NON_FINITE = wp.constant(1)
RUTS_FULL = wp.constant(2)


def _each(name: str) -> list[str]:
    return [f"{name}_{wheel}" for wheel in WHEELS]


def _rows(name: str, quantities: Iterable[str], start: int = 0) -> Any:
    return IntEnum(name, [quantity.upper() for quantity in quantities], start=start)


State = _rows(
    "State",
    [
        # pose: hinge origin [m] with its rounding remainder [m], quaternion of the front frame (x, y, z, w), angles [rad]
        *("x", "y", "z", "rest_x", "rest_y", "rest_z", "qx", "qy", "qz", "qw", "joint"),
        *(*_each("arm"), *_each("wheel")),
        # velocity: hinge origin [m/s] and angular [rad/s] in front-frame axes, joint, arms, absolute wheel spins
        *("vx", "vy", "vz", "wx", "wy", "wz", "joint_rate", *_each("arm_rate"), *_each("spin")),
        # accelerations over the last main step, in the same order
        *("avx", "avy", "avz", "awx", "awy", "awz", "joint_acceleration"),
        *(*_each("arm_acceleration"), *_each("spin_acceleration")),
        # bristles and dry friction
        *(*_each("bristle_x"), *_each("bristle_y"), "joint_friction"),
        *(*_each("arm_friction"), *_each("wheel_friction"), *_each("twist")),
        # steering circuit
        *("supply", "port_a", "port_b", "tank_line", "ls_pressure", "spool", "play", "compensator", "swash"),
        *("flow_in", "flow_out", "mount", "mount_rate"),
        # arms
        *(*_each("arm_bore"), *_each("arm_rod"), *_each("arm_spool")),
        # driveline
        *("forward", "back", *_each("hose"), "charge", "drive_swash", "shift_front", "shift_rear", *_each("traction")),
        # engine
        *("engine_speed", "governor", "engine_torque"),
        # what only some laws of the steering circuit and of the arms have
        *("spool_rate", "compensator_rate", "pump_valve", "shock_a", "shock_b", "hose_strain_a", "hose_strain_b"),
        *("hose_a", "hose_b", "hose_flow_a", "hose_flow_b", *_each("arm_compensator")),
    ],
)

LoadRow = _rows(
    "LoadRow", ["load_slide", "load_rate", "load_friction", "load_acceleration", "load_pressing"], start=len(State)
)
"""Rows of the state that only twins that carry a load have, after the others:
:class:`aoro_gym.twin.physics.load.LoadState`."""


def _joints(name: str) -> list[str]:
    return [f"{name}_{joint}" for joint in JOINTS]


CraneRow = _rows(
    "CraneRow",
    [
        # joints, rates, accelerations over the last main step, deflections of dry friction, spools
        *(*_joints("joint"), *_joints("rate"), *_joints("acceleration"), *_joints("friction"), *_joints("spool")),
        # contents of the chambers, mean torques of the oil and mean flows from the pump over the last main step
        *(*_joints("bore"), *_joints("annulus"), *_joints("oil_torque"), *_joints("flow")),
        # torques from outside, and the force of grapple and log on the tip
        *(*_joints("torque"), "tip_load"),
        # force of the ground on the log, and its moment about the hinge's origin, in the front frame's axes
        *(
            "ground_force_x",
            "ground_force_y",
            "ground_force_z",
            "ground_moment_x",
            "ground_moment_y",
            "ground_moment_z",
        ),
        # the log that is held over this step, as commanded: mass, angle to the pillar, moments of inertia
        *("held_mass", "held_yaw", "held_axial", "held_transverse"),
    ],
    start=len(State) + len(LoadRow),
)
"""Rows of the state that only twins with a crane have, after those of a load, which they have, too."""

Command = _rows("Command", COMMAND_BOUNDS)

CraneCommand = _rows("CraneCommand", CRANE_COMMAND_BOUNDS, start=len(COMMAND_BOUNDS))
"""Rows of the commands that only twins with a crane have, after the others."""

Demand = _rows("Demand", [*_each("rate"), "pump_torque"])
"""What the bodies demand of a driveline that is held apart from them: wheel rates against the arms [rad/s], and torque of
pump 2 on the engine [N m]."""

DrivelineOutput = _rows(
    "DrivelineOutput",
    [
        *(*_each("torque"), "engine_speed", "engine_torque"),
        *("drive_pressure_forward", "drive_pressure_return", "drive_swash"),
    ],
)
"""What such a driveline gives: torques at the flanges [N m], the engine's speed [rad/s] at the step's start and its torque
[N m], pressures [Pa] and pump 1's swash [-]."""

OUTPUT_UNITS = {
    name: unit
    for unit, names in (
        # commands as given
        ("1", ("steering_signal", "drive_signal")),
        # joint
        ("rad", ("joint_angle",)),
        ("rad/s", ("joint_rate",)),
        ("m^3/s", ("joint_flow",)),
        # steering circuit
        ("Pa", ("pressure_a", "pressure_b", "pump_pressure", "return_pressure", "ls_pressure")),
        ("1", ("spool", "compensator", "pump_swash")),
        ("m^3/s", ("flow_in", "flow_out", "pump_flow")),
        # driveline
        ("Pa", ("drive_pressure_forward", "drive_pressure_return", "charge_pressure")),
        ("1", ("drive_swash", "shift_front", "shift_rear")),
        ("Pa", _each("motor_pressure")),
        ("rad/s", _each("wheel_rate")),
        # arms
        ("rad", _each("arm_angle")),
        ("Pa", (*_each("arm_pressure_bore"), *_each("arm_pressure_rod"))),
        # engine
        ("rad/s", ("engine_speed",)),
        ("N m", ("engine_torque",)),
        # vehicle
        ("m", ("position_x", "position_y", "position_z")),
        ("rad", ("roll", "pitch", "yaw")),
        ("m/s", ("speed",)),
        ("rad/s", ("yaw_rate",)),
        ("N", (*_each("wheel_load"), "hull_force")),
        ("1", ("wheels_off_map",)),
    )
    for name in names
}
"""Unit of each output, in the order of their rows."""

Output = _rows("Output", OUTPUT_UNITS)

CHANNELS = tuple(OUTPUT_UNITS)
"""Names of all outputs, in the order of their rows."""

OBJECT_PARTS = (*WHEELS, "front", "rear")
"""What objects of a world can touch: the wheels, the chassis of the front frame and that of the rear one."""

OBJECT_OUTPUT_UNITS = {
    name: unit
    for part in OBJECT_PARTS
    for name, unit in (*((f"object_force_{axis}_{part}", "N") for axis in "xyz"), (f"touched_object_{part}", "1"))
}
"""Unit of each output that only twins among solid objects have, after the others: the force of all objects on each part in
the world's axes, and the number of the object that presses most (0: none), ``World.objects[number - 1]``."""

FIRST_OBJECT_OUTPUT = len(OUTPUT_UNITS)
"""Row of the first of them."""

SOIL_OUTPUT_UNITS = {
    name: unit
    for kind, unit in (("sinkage", "m"), ("rut_depth", "m"), ("soil_resistance", "N"))
    for name in _each(kind)
}
"""Unit of each output that only twins on soil have, after the others: the depth of a tire's base under the undisturbed
ground, that of the rut which stays below it, and the force of the soil against rolling."""

FIRST_SOIL_OUTPUT = len(OUTPUT_UNITS)
"""Row of the first of them: no twin has these and those of objects."""

CRANE_OUTPUT_UNITS = {
    **dict(zip(_joints("crane_joint"), ("rad", "rad", "rad", "m"), strict=True)),
    **dict(zip(_joints("crane_rate"), ("rad/s", "rad/s", "rad/s", "m/s"), strict=True)),
    **dict.fromkeys(_joints("crane_pressure_bore"), "Pa"),
    **dict.fromkeys(_joints("crane_pressure_annulus"), "Pa"),
    **dict.fromkeys(_joints("crane_flow"), "m^3/s"),
    "crane_tip_load": "N",
    "crane_ground_force": "N",
}
"""Unit of each output that only twins with a crane have, after all others: joints and their rates, pressures of the
chambers, flows from the pump into the sections, the force on the tip that a load cell there feels, and that of the ground on
the log."""


def command_row(name: str) -> int:
    """Row of a command; ValueError that lists the names if there is none such."""
    return row_of(CraneCommand if name in CRANE_COMMAND_BOUNDS else Command, name, "command")


def row_of(rows: type[IntEnum], name: Any, what: str) -> int:
    """Row of ``name``, ``what`` it is called; ValueError that lists the names if there is none such."""
    try:
        return int(rows[name.upper()])
    except (KeyError, AttributeError):
        known = [row.name.lower() for row in rows]
        near = difflib.get_close_matches(str(name), known, n=1)
        hint = f": did you mean '{near[0]}'? Choose" if near else "; choose"
        raise ValueError(f"there is no {what} '{name}'{hint} one of: {', '.join(known)}") from None


MIDDLE_PRESSURE = 50e5
"""Pressure [Pa] at which oil of a constant modulus is as stiff as the oil whose modulus rises with pressure."""

STIFFEST_MOUNT = 2e8
"""Torsional stiffness [N m/rad] between cylinders and frames that the main step resolves, more than 40 times the oil's. What
is stiffer is taken as that: between no mount and the least one the twin jumps by 5e-9 rad/(N m), 1 % of a soft frame."""


def _mount_stiffness(machine: Machine) -> Quantity:
    """Stiffness [N m/rad] between cylinders and frames; 0 where they are one, without compliance and play."""
    joint = machine.joint
    is_there = np.greater(joint.compliance, 0.0) | np.greater(joint.backlash, 0.0)
    return np.where(is_there, 1.0 / np.maximum(joint.compliance, 1.0 / STIFFEST_MOUNT), 0.0)


def _geometry(machine: Machine) -> dict[str, Any]:
    """Device fields that join several sections of the machine, and the numbers of its laws, by their path in the record."""
    frame, arm = machine.frame, machine.arm
    return {
        **{path: machine.laws.choices[law] for law, path in LAW_FIELDS.items()},
        "varies_laws": not machine.laws.default,
        **_oil(machine),
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


def _oil(machine: Machine) -> dict[str, Quantity]:
    """Fields of the oil that its laws give: exponent of the free air, and a liquid that is as stiff at any pressure as it is
    at :data:`MIDDLE_PRESSURE`."""
    oil, laws = machine.oil, machine.laws
    exponent = np.where(np.equal(laws.gas, OPTIONS["gas"].index("isothermal")), 1.0, oil.polytropic_exponent)
    exponent = np.where(np.equal(laws.gas, OPTIONS["gas"].index("adiabatic")), 1.4, exponent)
    constant = np.equal(laws.liquid, OPTIONS["liquid"].index("constant"))
    middle = oil.bulk_modulus + oil.bulk_modulus_slope * np.asarray(MIDDLE_PRESSURE)
    return {
        "oil.polytropic_exponent": exponent,
        "oil.bulk_modulus": np.where(constant, middle, oil.bulk_modulus),
        "oil.bulk_modulus_slope": np.where(constant, 0.0, oil.bulk_modulus_slope),
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


def _fill(row: Any, section: object, geometry: dict[str, Quantity], path: str = "") -> None:
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
    fill(rows, machine)
    return rows


def fill(row: Any, machine: Machine) -> None:
    """Write what the device needs of ``machine`` into a record: rows of the layout of :class:`MachineRecord`, or whatever
    takes values by the same names."""
    _fill(row, machine, _geometry(machine))
