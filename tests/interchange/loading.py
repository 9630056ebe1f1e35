"""Exported machines in MuJoCo, on level ground and at rest."""

# MuJoCo takes its names from a compiled module at run time.
# pyright: reportAttributeAccessIssue=false
import mujoco
import numpy as np

from aoro_gym.interchange import description, urdf
from aoro_gym.machine.rigid_bodies import BASE, JOINT, REAR
from tests.oracles.mujoco_model import WHEELS, MujocoMachine

HINGES = (JOINT, *(f"arm_{name}" for name in WHEELS), *(f"wheel_{name}" for name in WHEELS))
"""In the order of the oracle's coordinates."""


class LoadedMachine(MujocoMachine):
    """A model that MuJoCo has read, in the coordinates of ``tests/oracles/bodies.py``."""

    def __init__(self, model):
        self.model, self.data = model, mujoco.MjData(model)
        joints = [model.joint(name) for name in HINGES]
        self._pose = np.array([*range(7), *(int(joint.qposadr[0]) for joint in joints)])
        self._freedom = np.array([*range(6), *(int(joint.dofadr[0]) for joint in joints)])
        self._frames = [model.body(name).id for name in (BASE, REAR)]
        self._wheels = [model.body(f"wheel_{name}").id for name in WHEELS]


def at_rest(model):
    """Data of an MJCF model in its keyframe."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("rest").id)
    return data


def step(model, data, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return data


def wheel_forces(model, data):
    """Normal force [N] of the ground on each wheel (fl, fr, rl, rr)."""
    force, found = np.zeros(6), dict.fromkeys((f"wheel_{name}" for name in WHEELS), 0.0)
    for i, contact in enumerate(data.contact[: data.ncon]):
        mujoco.mj_contactForce(model, data, i, force)
        found[model.body(model.geom_bodyid[max(contact.geom)]).name] += force[0]
    return np.array(list(found.values()))


def urdf_on_ground(machine):
    """Model and data of the URDF at rest: on a plane, with what its JSON says of tires and arms.

    A cylinder touches a plane along its tread, whose two ends MuJoCo lets bear: each is half of the tire.
    """
    figures = description(machine)
    spec = mujoco.MjSpec.from_string(urdf(machine))
    spec.option.timestep, spec.option.cone = 1e-3, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 1])
    impedance = 0.01
    for name in WHEELS:
        body = spec.body(f"wheel_{name}")
        scale = 0.5 * (1.0 - impedance) * figures["inverse_weight"][body.name]
        for geom in body.geoms:
            geom.priority = 1
            geom.solimp = [impedance, impedance, 1, 0.5, 2]
            geom.solref = [-scale * figures["tire"]["stiffness"], -scale * figures["tire"]["damping"]]
    for hinge, servo in figures["servos"].items():
        actuator = spec.add_actuator(name=hinge, target=hinge, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=servo["stiffness"])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[2] = figures["rest"]["base_height"]
    for hinge, angle in figures["rest"]["angles"].items():
        data.joint(hinge).qpos[0] = angle
        if hinge in figures["servos"]:
            data.actuator(hinge).ctrl[0] = angle + figures["servos"][hinge]["set_point_ahead_at_rest"]
    mujoco.mj_forward(model, data)
    return model, data
