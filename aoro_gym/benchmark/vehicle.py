"""The machine as a MuJoCo model: its bodies, wheels and ground, springs and servos in place of its hydraulics."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.machine.sections import HalfFrame
from aoro_gym.twin.records import WHEELS
from aoro_gym.units import GRAVITY

TIME_STEP = 1e-3
"""[s]"""
OPTIONS = 'integrator="implicitfast" solver="Newton" iterations="3" ls_iterations="6" tolerance="1e-6"'
"""Of the solver, for speed: it converges in two or three iterations, and with one or two the wheels bounce. One vehicle is
one island, so looking for islands is off."""
SPRING_FREQUENCY, SPRING_DAMPING = 1.5, 0.5
"""Natural frequency [Hz] and damping ratio of a quarter of the machine on its arm's spring: an off-road vehicle's."""
STEERING_RATE, STEERING_TORQUE = 0.75, 4e4
"""Of the joint at full signal: stop to stop in 2 s [rad/s], and what two cylinders give at 200 bar [N m]."""
RIM_SPEED = 1.5
"""Of a wheel at full signal [m/s]."""
SERVO_LAG = 0.1
"""Share of its full speed by which a servo must lag to give all of its torque."""

_ORDER = ("rl", "rr", "fl", "fr")  # of the corners, in MuJoCo's depth-first order


def mjcf(machine: Machine, ground: NDArray[np.float64], cell: float) -> str:
    """MJCF of ``machine``, one variant, on a height field like ``ground`` (N, N) [m] with nodes ``cell`` [m] apart.

    15 degrees of freedom: two frames and the hinge between them, four arms on springs, four wheels. Masses, inertias and
    geometry are the machine's, and so is the rest pose, which the springs hold. A wheel is a sphere with the radius of the
    tire under its load; only wheels touch the ground. Servos turn the joint and the wheels at a speed: the controls, in
    rad/s, are the joint's and the wheels' in the order of ``WHEELS``.

    The text has the height field's size, :func:`load` fills in its heights.
    """
    if machine.num_variants != 1:
        raise ValueError(f"the machine has {machine.num_variants} variants, but a MuJoCo model is one; give variant(i)")
    frame, joint, rest = machine.frame, machine.joint, machine.rest
    arms = {"fl": rest.arm_angle_front, "fr": rest.arm_angle_front} | dict.fromkeys(("rl", "rr"), rest.arm_angle_rear)
    pose = [0, 0, rest.height, 1, 0, 0, 0, 0, *(value for name in _ORDER for value in (arms[name], 0.0))]
    corners = {name: _corner(machine, name) for name in WHEELS}
    servos = "".join(
        _servo(f"wheel_{name}", RIM_SPEED / machine.tire.radius, _spinning_torque(machine, name)) for name in WHEELS
    )
    half = 0.5 * cell * (len(ground) - 1)
    return f"""\
<mujoco model="{machine.name}">
  <compiler angle="radian"/>
  <option timestep="{TIME_STEP}" gravity="0 0 {-GRAVITY}" {OPTIONS}>
    <flag island="disable"/>
  </option>
  <asset>
    <hfield name="ground" nrow="{len(ground)}" ncol="{len(ground)}" size="{_numbers(half, half, _relief(ground), 1)}"/>
  </asset>
  <worldbody>
    <geom name="ground" type="hfield" hfield="ground" pos="{_numbers(0, 0, ground.min())}" contype="0"/>
    <body name="front">
      <freejoint name="base"/>
      {_half(frame.front, 1.0)}
      <body name="rear">
        <joint name="joint" axis="0 0 -1" range="{_numbers(-joint.range, joint.range)}"/>
        {_half(frame.rear, -1.0)}{corners["rl"]}{corners["rr"]}
      </body>{corners["fl"]}{corners["fr"]}
    </body>
  </worldbody>
  <actuator>{_servo("joint", STEERING_RATE, STEERING_TORQUE)}{servos}
  </actuator>
  <keyframe>
    <key name="rest" qpos="{_numbers(*pose)}"/>
  </keyframe>
</mujoco>
"""


def load(machine: Machine, ground: NDArray[np.float64], cell: float) -> Any:
    """``mujoco.MjModel`` of :func:`mjcf` on ``ground``, rows from south to north, its middle at the origin."""
    model = import_module("mujoco").MjModel.from_xml_string(mjcf(machine, ground, cell))
    model.hfield_data[:] = ((ground - ground.min()) / _relief(ground)).ravel()
    return model


def poses(
    model: Any, ground: NDArray[np.float64], cell: float, position: NDArray[np.float64], heading: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Positions of all joints (K, nq) at rest with level frames, K plan positions (K, 2) [m] and headings (K,) [rad], on
    the highest ground within the machine's reach.

    Args:
        model: MuJoCo's model of the vehicle.
        ground: Heights [m] of the field (rows, columns).
        cell: Distance [m] of the heights.
        position: Plan positions (K, 2) [m].
        heading: Headings (K,) [rad].
    """
    reach = 3.0
    middle = 0.5 * (len(ground) - 1)
    out = np.tile(model.key("rest").qpos, (len(position), 1))
    out[:, :2] = position
    for pose, (x, y) in zip(out, position, strict=True):
        rows, columns = (
            slice(max(int(middle + (at - reach) / cell), 0), int(middle + (at + reach) / cell) + 2) for at in (y, x)
        )
        pose[2] += ground[rows, columns].max()
    out[:, 3], out[:, 6] = np.cos(0.5 * heading), np.sin(0.5 * heading)
    return out


def controls(model: Any, signals: NDArray[np.float32]) -> NDArray[np.float64]:
    """Controls (..., K, 5) of steering and drive signals (..., 2, K)."""
    steering, drive = np.moveaxis(np.asarray(signals, dtype=np.float64), -2, 0)
    return np.stack([steering, drive, drive, drive, drive], axis=-1) * model.actuator_ctrlrange[:, 1]


def _corner(machine: Machine, name: str) -> str:
    """Arm, motor and wheel; angles of the arm are positive where the wheel is above the pivot."""
    arm, wheel, tire, rest = machine.arm, machine.wheel, machine.tire, machine.rest
    s, side = (1.0 if name[0] == "f" else -1.0), (1.0 if name[1] == "l" else -1.0)
    section = machine.frame.front if s > 0.0 else machine.frame.rear
    angle = rest.arm_angle_front if s > 0.0 else rest.arm_angle_rear
    load, deflection = _load(machine, name)
    lever = arm.length * np.cos(angle)
    quarter, omega = 0.25 * machine.mass, 2.0 * np.pi * SPRING_FREQUENCY
    stiffness, damping = quarter * (omega * lever) ** 2, 2.0 * SPRING_DAMPING * quarter * omega * lever**2
    torque = load * lever - GRAVITY * machine.corner.mass * machine.corner.rho * np.cos(angle)
    slack = angle - torque / stiffness
    outward = 0.5 * machine.frame.track - arm.pivot_lateral
    pivot = s * (section.axle_distance - arm.length), side * arm.pivot_lateral, arm.pivot_height
    axle = _numbers(s * arm.length, side * outward, 0.0)
    middle = s * arm.cog_fraction * arm.length, side * 0.5 * outward, 0.0
    return f"""
        <body name="arm_{name}" pos="{_numbers(*pivot)}">
          <joint name="arm_{name}" axis="{_numbers(0, -s, 0)}" range="{_numbers(-arm.swing, arm.swing)}"
            stiffness="{_numbers(stiffness)}" damping="{_numbers(damping)}" springref="{_numbers(slack)}"/>
          {_inertial(arm.mass, middle, arm.inertia_axial, arm.inertia_transverse, arm.inertia_transverse)}
          <body name="motor_{name}" pos="{axle}">
            {_inertial(arm.motor_mass, (0, 0, 0), 0, 0, 0)}
          </body>
          <body name="wheel_{name}" pos="{axle}">
            <joint name="wheel_{name}" axis="0 1 0"/>
            {_inertial(wheel.mass, (0, 0, 0), wheel.inertia_transverse, wheel.inertia_spin, wheel.inertia_transverse)}
            <geom name="wheel_{name}" type="sphere" size="{_numbers(tire.radius - deflection)}" mass="0"
              friction="{_numbers(tire.friction_coulomb)}" priority="1" conaffinity="0"/>
          </body>
        </body>"""


def _load(machine: Machine, name: str) -> tuple[float, float]:
    """Load [N] and deflection [m] of a wheel at rest."""
    rest: Any = machine.rest
    if name[0] == "f":
        return rest.wheel_load_front, rest.deflection_front
    return rest.wheel_load_rear, rest.deflection_rear


def _spinning_torque(machine: Machine, name: str) -> float:
    """Torque [N m] that just spins a wheel on dry ground."""
    return float(machine.tire.friction_coulomb * machine.tire.radius * _load(machine, name)[0])


def _half(section: HalfFrame, s: float) -> str:
    cog = s * (section.axle_distance - section.cog_offset), 0.0, section.cog_height
    return _inertial(section.mass, cog, section.inertia_xx, section.inertia_yy, section.inertia_zz)


def _inertial(mass: ArrayLike, cog: Sequence[ArrayLike], *moments: ArrayLike) -> str:
    return f'<inertial mass="{_numbers(mass)}" pos="{_numbers(*cog)}" diaginertia="{_numbers(*moments)}"/>'


def _servo(joint: str, speed: ArrayLike, torque: float) -> str:
    top = float(np.asarray(speed))
    return f"""
    <velocity name="{joint}" joint="{joint}" kv="{_numbers(torque / (SERVO_LAG * top))}"
      ctrlrange="{_numbers(-top, top)}" forcerange="{_numbers(-torque, torque)}"/>"""


def _relief(ground: NDArray[np.float64]) -> float:
    """Height [m] of the field from its lowest to its highest node; a level one has some, which MuJoCo asks for."""
    return max(float(np.ptp(ground)), 1e-3)


def _numbers(*values: ArrayLike) -> str:
    return " ".join(f"{float(np.asarray(value)):.9g}" for value in values)
