"""The machine's rigid-body tree as a MuJoCo model: a second opinion that shares no dynamics code with the project.

Bodies, joints and inertias only: no contacts, no actuators; torques and wrenches are applied as generalised and
Cartesian forces. MuJoCo's free joint has the velocity of the body's origin in world axes but the angular velocity in
body axes; ``to_mujoco`` and ``acceleration_from_mujoco`` translate from and to the conventions of
``tests/oracles/bodies.py``, in which poses, velocities and wrenches are given here too.

Source: E. Todorov, T. Erez, Y. Tassa, "MuJoCo: A physics engine for model-based control", IROS 2012, and its manual,
chapter "Computation" (free joints).
"""

# MuJoCo takes its names from a compiled module at run time.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

WHEELS = ("fl", "fr", "rl", "rr")
CRANE_JOINTS = ("slew", "lift", "fold", "telescope")


def crane_bodies(crane, place) -> str:
    """MJCF of a ``crane`` whose foot is at ``place`` (3,) [m] of the body that it stands on."""

    def inertial(mass, place, *moments):
        x = " ".join(f"{v:.12g}" for v in moments)
        return f'<inertial mass="{mass}" pos="{place[0]} {place[1]} {place[2]}" diaginertia="{x}"/>'

    pillar, lift, boom, stick, out = crane.pillar, crane.lift, crane.boom, crane.stick, crane.extension
    return f"""
 <body pos="{" ".join(map(str, place))}"><joint name="slew" axis="0 0 1"/>
  {inertial(pillar.mass, (pillar.cog_forward, 0, pillar.cog_height), pillar.inertia_transverse,
            pillar.inertia_transverse, pillar.inertia_axial)}
  <body pos="{lift.offset} 0 {lift.height}"><joint name="lift" axis="0 -1 0"/>
   {inertial(boom.mass, (boom.cog_along, 0, boom.cog_over), boom.inertia_axial, boom.inertia_transverse,
             boom.inertia_transverse)}
   <body pos="{boom.length} 0 0"><joint name="fold" axis="0 -1 0"/>
    {inertial(stick.mass, (stick.cog_along, 0, 0), stick.inertia_axial, stick.inertia_transverse,
              stick.inertia_transverse)}
    <body pos="{stick.length} 0 0"><joint name="telescope" type="slide" axis="1 0 0"/>
     {inertial(out.mass, (out.cog_along, 0, 0), out.inertia_axial, out.inertia_transverse, out.inertia_transverse)}
     <body name="tip"><inertial mass="{crane.grapple.mass}" pos="0 0 0" diaginertia="0 0 0"/></body>
    </body></body></body></body>"""  # fmt: skip


def without_folded(section, x, vehicle) -> str:
    """Inertial element of the front frame (``section``, its centre ``x`` [m] ahead of the hinge) without the crane of
    ``vehicle`` in its transport pose: mass, centre and full tensor of what is left, by Steiner's theorem."""
    mass, moment, tensor = (one[0] for one in vehicle.folded())
    centre = np.array([x, 0.0, section.cog_height])

    def steiner(place):
        return place @ place * np.eye(3) - np.outer(place, place)

    left = section.mass - mass
    place = (section.mass * centre - moment) / left
    moments = np.diag([section.inertia_xx, section.inertia_yy, section.inertia_zz])
    rest = moments + section.mass * steiner(centre) - tensor - left * steiner(place)
    full = [rest[0, 0], rest[1, 1], rest[2, 2], rest[0, 1], rest[0, 2], rest[1, 2]]
    text = [" ".join(f"{v:.17g}" for v in one) for one in ([left], place, full)]
    return f'<inertial mass="{text[0]}" pos="{text[1]}" fullinertia="{text[2]}"/>'


def mjcf(machine, gravity: float = 9.81, crane=None, held: float = 0.0) -> str:
    """MJCF of ``machine`` (one machine, float parameters) under ``gravity`` [m/s²], with a ``crane`` (a VehicleCrane) that
    has ``held`` [kg] more at its tip, or none.

    Degrees of freedom in order: free joint of the front frame at the hinge origin (6), joint, and then the four arms,
    each followed by its wheel, in MuJoCo's depth-first order; find them by the names joint, arm_fl, wheel_fl, ...
    """
    arm, wheel = machine.arm, machine.wheel
    half_track = 0.5 * machine.frame.track
    outward = half_track - arm.pivot_lateral

    def vector(*x):
        return " ".join(f"{float(value):.17g}" for value in x)

    def inertial(mass, cog, xx, yy, zz):
        return (
            f'<inertial mass="{vector(mass)}" pos="{vector(*cog)}" fullinertia="{vector(xx, yy, zz, 0.0, 0.0, 0.0)}"/>'
        )

    def corner(name, section, s, side):
        """Arm with motor and wheel; ``s`` +1 front, -1 rear; ``side`` +1 left, -1 right."""
        pivot = (s * (section.axle_distance - arm.length), side * arm.pivot_lateral, arm.pivot_height)
        axle = vector(s * arm.length, side * outward, 0.0)
        middle = (s * arm.cog_fraction * arm.length, side * 0.5 * outward, 0.0)
        link = inertial(arm.mass, middle, arm.inertia_axial, arm.inertia_transverse, arm.inertia_transverse)
        return f"""
        <body name="arm_{name}" pos="{vector(*pivot)}">
          <joint name="arm_{name}" type="hinge" axis="{vector(0, -s, 0)}"/>
          {link}
          <body name="motor_{name}" pos="{axle}">
            <inertial mass="{vector(arm.motor_mass)}" pos="0 0 0" diaginertia="0 0 0"/>
          </body>
          <body name="wheel_{name}" pos="{axle}">
            <joint name="wheel_{name}" type="hinge" axis="0 1 0"/>
            {inertial(wheel.mass, (0, 0, 0), wheel.inertia_transverse, wheel.inertia_spin, wheel.inertia_transverse)}
          </body>
        </body>"""

    def frame(section, s):
        cog = (s * (section.axle_distance - section.cog_offset), 0.0, section.cog_height)
        return inertial(section.mass, cog, section.inertia_xx, section.inertia_yy, section.inertia_zz)

    def load():
        """Logs that slide along the rear frame, or lie fast on it."""
        one = machine.payload
        if not machine.loaded:
            return ""
        place = vector(-one.distance, 0.0, one.cog_height)
        slide = '<joint name="load" type="slide" axis="1 0 0"/>' if one.slide_range > 0.0 else ""
        own = inertial(one.mass, (0, 0, 0), one.inertia_xx, one.inertia_yy, one.inertia_zz)
        return f'<body name="load" pos="{place}">{slide}{own}</body>'

    front, rear = machine.frame.front, machine.frame.rear
    own, chain = frame(front, 1.0), ""
    if crane is not None:
        own = without_folded(front, front.axle_distance - front.cog_offset, crane)
        one = crane.crane.with_grapple(crane.crane.grapple.mass + held)
        chain = crane_bodies(one, (crane.mount.foot.distance, 0.0, crane.mount.foot.height))
    return f"""
<mujoco model="machine">
  <compiler angle="radian" autolimits="false"/>
  <option gravity="{vector(0, 0, -gravity)}">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
    <body name="front">
      <freejoint name="base"/>
      {own}
      {chain}
      <body name="rear">
        <joint name="joint" type="hinge" axis="0 0 -1"/>
        {frame(rear, -1.0)}
        {load()}
        {corner("rl", rear, -1.0, 1.0)}
        {corner("rr", rear, -1.0, -1.0)}
      </body>
      {corner("fl", front, 1.0, 1.0)}
      {corner("fr", front, 1.0, -1.0)}
    </body>
  </worldbody>
</mujoco>
"""


class MujocoMachine:
    """``machine`` compiled by MuJoCo, one pose at a time, in the coordinates of ``tests/oracles/bodies.py``."""

    _slides = False
    slide = (0.0, 0.0, 0.0)
    """Of a load that slides: place [m], rate [m/s], and force [N] along the rear frame."""

    crane: Any = None
    """Joints, rates and torques of its crane, each (4,), if it has one."""

    def __init__(self, machine, gravity: float = 9.81, crane=None, held: float = 0.0):
        self.model = mujoco.MjModel.from_xml_string(mjcf(machine, gravity, crane, held))
        self.data = mujoco.MjData(self.model)
        names = ["joint", *(f"arm_{w}" for w in WHEELS), *(f"wheel_{w}" for w in WHEELS)]
        joints = [self.model.joint(name) for name in names]
        self._pose = np.array([*range(7), *(int(j.qposadr[0]) for j in joints)])
        self._freedom = np.array([*range(6), *(int(j.dofadr[0]) for j in joints)])
        self._slides = machine.loaded and machine.payload.slide_range > 0.0
        self._frames = [self.model.body(name).id for name in ("front", "rear")]
        self._wheels = [self.model.body(f"wheel_{w}").id for w in WHEELS]

    def to_mujoco(self, q, v):
        """(qpos, qvel) of pose ``q`` (16,) and velocity ``v`` (15,)."""
        qpos, qvel = np.zeros(self.model.nq), np.zeros(self.model.nv)
        qpos[self._pose] = q
        qpos[3:7] /= np.linalg.norm(qpos[3:7])
        qvel[self._freedom] = v
        qvel[:3] = _matrix(qpos[3:7]) @ v[:3]
        if self.crane is not None:
            for name, angle, rate in zip(CRANE_JOINTS, *self.crane[:2], strict=True):
                joint = self.model.joint(name)
                qpos[joint.qposadr[0]], qvel[joint.dofadr[0]] = angle, rate
        if self._slides:
            joint = self.model.joint("load")
            qpos[joint.qposadr[0]], qvel[joint.dofadr[0]] = self.slide[:2]
        return qpos, qvel

    def from_mujoco(self, qpos, qvel):
        """Pose (16,) and velocity (15,) of MuJoCo's ``qpos`` and ``qvel``."""
        q, v = np.array(qpos)[self._pose], np.array(qvel)[self._freedom]
        v[:3] = _matrix(qpos[3:7]).T @ qvel[:3]
        return q, v

    def kinematics(self, q, v):
        """World rotation (3, 3, 2) of the frames, and of the wheels centre [m], velocity [m/s] and angular velocity
        [rad/s], each (3, 4), at pose ``q`` (16,) and velocity ``v`` (15,)."""
        self.set(q, v)
        rotation = np.stack([self.data.xmat[i].reshape(3, 3) for i in self._frames], -1)
        center = np.stack([self.data.xpos[i] for i in self._wheels], -1)
        twist = np.empty((6, 4))
        for i, body in enumerate(self._wheels):
            out = np.empty(6)
            mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, body, out, 0)
            twist[:, i] = out
        return rotation, center, twist[3:], twist[:3]

    def set(self, q, v):
        """Take pose ``q`` (16,) and velocity ``v`` (15,), with no forces applied, and update all that follows."""
        self.data.qpos[:], self.data.qvel[:] = self.to_mujoco(q, v)
        self.data.qfrc_applied[:] = 0.0
        self.data.xfrc_applied[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def accelerations(
        self,
        q,
        v,
        tau_theta: ArrayLike = 0.0,
        tau_phi: ArrayLike = 0.0,
        tau_wheel: ArrayLike = 0.0,
        wheel_force: ArrayLike | None = None,
        wheel_moment: ArrayLike | None = None,
        frame_force: ArrayLike | None = None,
        frame_moment: ArrayLike | None = None,
    ):
        """dv/dt (15,): arguments and result as ``BodyModel.accelerations``, without a batch axis."""
        self.set(q, v)
        torque = np.zeros(15)
        torque[6], torque[7:11], torque[11:15] = tau_theta, tau_phi, tau_wheel
        self.data.qfrc_applied[self._freedom] = torque
        if self._slides:
            self.data.qfrc_applied[self.model.joint("load").dofadr[0]] = self.slide[2]
        if self.crane is not None:
            for name, torque in zip(CRANE_JOINTS, self.crane[2], strict=True):
                self.data.qfrc_applied[self.model.joint(name).dofadr[0]] = torque
        for bodies, force, moment in (
            (self._wheels, wheel_force, wheel_moment),
            (self._frames, frame_force, frame_moment),
        ):
            force = np.zeros((3, len(bodies))) if force is None else np.asarray(force, float)
            moment = np.zeros((3, len(bodies))) if moment is None else np.asarray(moment, float)
            for i, body in enumerate(bodies):
                # MuJoCo applies at the centre of mass; the wrench is given at the body's origin
                lever = self.data.xpos[body] - self.data.xipos[body]
                self.data.xfrc_applied[body, :3] = force[:, i]
                self.data.xfrc_applied[body, 3:] = moment[:, i] + np.cross(lever, force[:, i])
        mujoco.mj_forward(self.model, self.data)
        return self.acceleration_from_mujoco(self.data.qpos, self.data.qvel, self.data.qacc)

    def crane_accelerations(self) -> np.ndarray:
        """Those of the crane's joints (4,) that belong to the last :meth:`accelerations`."""
        return np.array([self.data.qacc[self.model.joint(name).dofadr[0]] for name in CRANE_JOINTS])

    def acceleration_from_mujoco(self, qpos, qvel, qacc):
        """dv/dt (15,) of MuJoCo's ``qacc``: d/dt(Rᵀ v) = Rᵀ v' − ω × Rᵀ v."""
        rotation = _matrix(qpos[3:7])
        a = np.array(qacc)[self._freedom]
        a[:3] = rotation.T @ qacc[:3] - np.cross(qvel[3:6], rotation.T @ qvel[:3])
        return a

    def mass_matrix(self, q):
        """Mass matrix (15, 15) in the coordinates of ``BodyModel`` at pose ``q`` (16,)."""
        self.set(q, np.zeros(15))
        full = np.zeros((self.model.nv, self.model.nv))
        _full_mass_matrix(self.model, self.data, full)
        turn = np.eye(self.model.nv)
        turn[:3, :3] = _matrix(self.data.qpos[3:7])
        full = turn.T @ full @ turn
        return full[np.ix_(self._freedom, self._freedom)]


def _full_mass_matrix(model, data, out):
    """mj_fullM, whose arguments changed between MuJoCo 3 and 4."""
    try:
        mujoco.mj_fullM(model, out, data.qM)
    except (AttributeError, TypeError):
        mujoco.mj_fullM(model, data, out)


def _matrix(quaternion):
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, np.ascontiguousarray(quaternion, float))
    return out.reshape(3, 3)
