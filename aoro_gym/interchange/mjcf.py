"""The machine as a MuJoCo model (MJCF): free base, hinges with stops and seals, tires as springs, servos, sensors, ground.

Source: MuJoCo's documentation, chapters *Computation* (solver parameters) and *XML reference*.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from aoro_gym.interchange.limitations import Limitation
from aoro_gym.interchange.sensor_places import sensor_places
from aoro_gym.interchange.servos import Servo, WheelMotor, servos, wheel_motors
from aoro_gym.interchange.xml_text import Element, add, comment, numbers, text_of
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import OPTIONS
from aoro_gym.machine.rigid_bodies import (
    BASE,
    JOINT,
    Body,
    Box,
    Strut,
    Tire,
    check_one,
    inverse_weights,
    machine_bodies,
    rest_angles,
)
from aoro_gym.recording.commands import WHEELS
from aoro_gym.units import GRAVITY

TIME_STEP = 1e-3
"""[s] As the twin's."""
IMPEDANCE = 0.01
"""Of contacts and stops: so soft a constraint is a spring and a damper and little else. What else it is weighs
d/((1 - d) w), with w the body's inverse weight: one hundredth of what the contact moves."""
FRICTION_IMPEDANCE_RATIO = 1000.0
"""How much stiffer friction is than the normal force (E): a tire that holds a force F creeps at F/(1000 c), with c its
damping: a parked machine on a slope of 5 degrees at less than 1 mm/s."""
DRY_FRICTION = {"solreffriction": numbers(2.0 * TIME_STEP, 1), "solimpfriction": numbers(0.999, 0.999, 1, 0.5, 2)}
"""Of seals and brakes (E): the shortest time that MuJoCo takes, and so hard that a held hinge creeps below 1e-4 rad/s."""
GROUND_SIZE = 100.0
"""[m] Half the edge of the ground."""
TOUCHING, TOUCHED = {"contype": "0", "conaffinity": "1"}, {"contype": "1", "conaffinity": "1"}
"""Bits by which the machine's parts touch the ground and not each other, as in the twin."""
FRAME_COLOUR, ARM_COLOUR, TIRE_COLOUR = "0.95 0.7 0.1 1", "0.3 0.3 0.3 1", "0.1 0.1 0.1 1"
GROUPS = {"visual": "2", "collision": "3"}
"""Of geoms, by MuJoCo's custom: the viewer shows the first and hides the second."""


def mjcf(machine: Machine, limitations: Sequence[Limitation] = ()) -> str:
    """MJCF text of ``machine``, one variant; it says in comments what of the twin it cannot say.

    Names: bodies, hinges and actuators of the corners end in ``fl``, ``fr``, ``rl``, ``rr``; the hinge between the frames is
    ``articulated_joint``. Controls: rates [rad/s] of joint and arms, which 0 holds where they are, and torques [N m] of the
    wheels. The keyframe ``rest`` stands on level ground.
    """
    check_one(machine)
    bodies, held, motors = machine_bodies(machine), servos(machine), wheel_motors(machine)
    root = Element("mujoco", model=machine.name)
    for line in limitations:
        comment(root, f"not said: {line.sentence}")
    add(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    add(
        root,
        "option",
        timestep=numbers(TIME_STEP),
        gravity=numbers(0, 0, -GRAVITY),
        integrator="implicitfast",
        cone="elliptic",
        impratio=numbers(FRICTION_IMPEDANCE_RATIO),
    )
    _appearance(root)
    world = add(root, "worldbody")
    add(world, "light", name="sun", type_="directional", pos="0 0 10", dir_="0.1 0.1 -1", diffuse="0.7 0.7 0.7")
    add(
        world,
        "geom",
        name="ground",
        type_="plane",
        size=numbers(GROUND_SIZE, GROUND_SIZE, 1),
        material="ground",
        **TOUCHED,
    )
    _add_bodies(world, machine, bodies, held, motors)
    _actuators(add(root, "actuator"), held, motors)
    _sensors(add(root, "sensor"), bodies)
    _gears(add(root, "custom"), motors)
    _rest(add(root, "keyframe"), machine, bodies, held)
    return text_of(root)


def contact_attributes(machine: Machine, body: Body, inverse_weight: float) -> dict[str, str]:
    """Attributes of the geom that touches the ground: the tire's spring, damper and friction, or the hull's.

    MuJoCo lets a contact act in the middle between both surfaces. So that a tire rolls on its loaded radius, the geom is as
    large as that, and its margin, in which the spring is pressed already, is the deflection at rest.
    """
    tire, hull = machine.tire, machine.hull
    if isinstance(body.shape, Tire):
        rolling = float(tire.rolling_resistance) * loaded_radius(machine, body)
        friction = float(tire.friction_coulomb), float(tire.friction_coulomb) * scrub_lever(machine), rolling
        spring = float(tire.stiffness), float(tire.damping)
    else:
        friction, spring = (float(hull.friction), 0.0, 0.0), (float(hull.stiffness), float(hull.damping))
    margin = (
        {"margin": numbers(float(tire.radius) - loaded_radius(machine, body))} if isinstance(body.shape, Tire) else {}
    )
    return {
        "condim": "6" if isinstance(body.shape, Tire) else "3",
        "priority": "1",  # over the ground's own numbers
        "friction": numbers(friction),
        "solref": spring_and_damper(*spring, inverse_weight),
        "solimp": numbers(IMPEDANCE, IMPEDANCE, 1, 0.5, 2),
        **margin,
    }


def loaded_radius(machine: Machine, body: Body) -> float:
    """Height [m] of a wheel's centre over level ground at rest."""
    front = body.name.startswith("wheel_f")
    deflection = machine.rest.deflection_front if front else machine.rest.deflection_rear
    return float(machine.tire.radius - deflection)


def spring_and_damper(stiffness: float, damping: float, inverse_weight: float) -> str:
    """``solref`` of a constraint that is a spring [N/m] and damper [N s/m], or [N m/rad] and [N m s/rad].

    A constraint of impedance d on an inverse weight w bears f with f R = −b v − k r and R = w (1 − d)/d, so that k = R K and
    b = R C; of two negative numbers (−s₁, −s₂) MuJoCo makes k = s₁/d and b = s₂/d.
    """
    scale = (1.0 - IMPEDANCE) * inverse_weight
    return numbers(-scale * stiffness, -scale * damping)


def scrub_lever(machine: Machine) -> float:
    """Lever [m] of the friction with which a tire resists swivelling on the spot, by the machine's law of swivelling."""
    tire, law = machine.tire, OPTIONS["swivel"][int(np.asarray(machine.laws.swivel))]
    if law == "bore_torque":
        return float(tire.bore_radius)
    discs = 0.4 * float(tire.disc_offset_inner + tire.disc_offset_outer) if law == "five_discs" else 0.0
    return discs + float(tire.scrub_radius)


def _appearance(root: Element) -> None:
    add(root, "statistic", center="0 0 1", extent="4")
    visual = add(root, "visual")
    add(visual, "global", offwidth="1280", offheight="720", azimuth="125", elevation="-24")
    add(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.4 0.4 0.4", specular="0 0 0")
    add(visual, "quality", shadowsize="4096")
    add(visual, "map", shadowclip="5")
    asset = add(root, "asset")
    size = {"width": "300", "height": "300"}
    colours = {"rgb1": "0.55 0.6 0.5", "rgb2": "0.5 0.55 0.45"}
    add(asset, "texture", name="ground", type_="2d", builtin="checker", **size, **colours)
    add(asset, "texture", name="sky", type_="skybox", builtin="gradient", rgb1="0.7 0.8 0.9", rgb2="1 1 1", **size)
    add(asset, "material", name="ground", texture="ground", texrepeat="1 1", texuniform="true")


def _add_bodies(
    world: Element, machine: Machine, bodies: Sequence[Body], held: Sequence[Servo], motors: Sequence[WheelMotor]
) -> None:
    """The tree, from the base on; the base stands at rest."""
    by_body, by_hinge = inverse_weights(bodies)
    dry = {motor.hinge: motor.brake for motor in motors}
    servo_of = {servo.hinge: servo for servo in held}
    elements = {}
    for body in bodies:
        parent = world if body.parent is None else elements[body.parent]
        place = np.array([0.0, 0.0, float(machine.rest.height)]) if body.parent is None else body.place
        element = elements[body.name] = add(parent, "body", name=body.name, pos=numbers(place))
        if body.parent is None:
            add(element, "freejoint", name=body.hinge)
        else:
            hinge = add(element, "joint", name=body.hinge, type_="hinge", axis=numbers(body.axis))
            if body.hinge in servo_of:
                hinge.attrib |= _stops(body, servo_of[body.hinge], by_hinge[body.hinge])
            else:
                hinge.attrib |= {"frictionloss": numbers(dry[body.hinge]), **DRY_FRICTION}
        moments = body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        add(element, "inertial", pos=numbers(body.centre), mass=numbers(body.mass), fullinertia=numbers(moments))
        loaded = loaded_radius(machine, body) if isinstance(body.shape, Tire) else 0.0
        _geoms(element, body, contact_attributes(machine, body, by_body[body.name]), loaded)
        if body.name == BASE:
            for name, at in sensor_places().items():
                add(element, "site", name=name, pos=numbers(at), size="0.05", rgba="0.9 0.1 0.1 1")


def _stops(body: Body, servo: Servo, inverse_weight: float) -> dict[str, str]:
    return {
        "range": numbers(-body.limit, body.limit),
        "solreflimit": spring_and_damper(servo.stop_stiffness, servo.stop_damping, inverse_weight),
        "solimplimit": numbers(IMPEDANCE, IMPEDANCE, 1, 0.5, 2),
        "damping": numbers(servo.damping),
        "frictionloss": numbers(servo.friction),
        **DRY_FRICTION,
    }


def _geoms(element: Element, body: Body, contact: Mapping[str, str], loaded: float) -> None:
    """What the ground touches, a wheel with its ``loaded`` radius [m], and what a viewer shows."""
    shape, name = body.shape, body.name
    seen = {"contype": "0", "conaffinity": "0", "group": GROUPS["visual"], "mass": "0"}
    touching = {"mass": "0", **TOUCHING, **contact}
    if isinstance(shape, Box):
        hull = {"type_": "box", "pos": numbers(shape.centre), "size": numbers(0.5 * shape.size), "rgba": FRAME_COLOUR}
        add(element, "geom", name=f"{name}_hull", group=GROUPS["visual"], **hull, **touching)
    elif isinstance(shape, Strut):
        ends = numbers(np.zeros(3), shape.end)
        add(element, "geom", type_="capsule", fromto=ends, size=numbers(shape.radius), rgba=ARM_COLOUR, **seen)
    else:
        drawn = {"type_": "cylinder", "zaxis": "0 1 0", "size": numbers(shape.radius, 0.5 * shape.width)}
        add(element, "geom", rgba=TIRE_COLOUR, **drawn, **seen)
        tread = numbers(loaded, 0.5 * shape.width, loaded)
        add(element, "geom", name=f"{name}_tread", type_="ellipsoid", size=tread, group=GROUPS["collision"], **touching)
        add(element, "site", name=f"{name}_load", size=numbers(1.05 * shape.radius), group="4", rgba="0 0 0 0")


def _actuators(parent: Element, held: Sequence[Servo], motors: Sequence[WheelMotor]) -> None:
    """A servo a hinge: the control is the rate of the spring's other end, whose angle is the servo's activation."""
    for servo in held:
        add(
            parent,
            "intvelocity",
            name=servo.hinge,
            joint=servo.hinge,
            kp=numbers(servo.stiffness),
            ctrlrange=numbers(servo.rate),
            forcerange=numbers(servo.held_torque),
            inheritrange="1",
        )
    for motor in motors:
        torque = max(motor.torque.values())
        limits = numbers(-torque, torque)
        add(parent, "motor", name=motor.hinge, joint=motor.hinge, ctrlrange=limits, forcerange=limits)


def _sensors(parent: Element, bodies: Sequence[Body]) -> None:
    add(parent, "jointpos", name="joint_angle", joint=JOINT)
    add(parent, "jointvel", name="joint_rate", joint=JOINT)
    for body in bodies:
        if isinstance(body.shape, Strut):
            add(parent, "jointpos", name=f"arm_angle_{body.name[-2:]}", joint=body.hinge)
    for name in WHEELS:
        add(parent, "jointvel", name=f"wheel_rate_{name}", joint=f"wheel_{name}")
    for name in WHEELS:
        add(parent, "touch", name=f"wheel_load_{name}", site=f"wheel_{name}_load")
    for name in ("gps_main", "gps_auxiliary"):
        add(parent, "framepos", name=name, objtype="site", objname=name)
    add(parent, "gyro", name="imu_rates", site="imu")
    add(parent, "accelerometer", name="imu_force", site="imu")
    add(parent, "framequat", name="imu_attitude", objtype="site", objname="imu")


def _gears(parent: Element, motors: Sequence[WheelMotor]) -> None:
    """Largest torques of the wheels in the order of ``WHEELS``, and speeds, by gear."""
    for gear in motors[0].torque:
        add(parent, "numeric", name=f"wheel_torque_{gear}", data=numbers([motor.torque[gear] for motor in motors]))
        add(parent, "numeric", name=f"wheel_speed_{gear}", data=numbers([motor.speed[gear] for motor in motors]))


def _rest(parent: Element, machine: Machine, bodies: Sequence[Body], held: Sequence[Servo]) -> None:
    angles = rest_angles(machine)
    hinges = [angles[body.hinge] for body in bodies if body.parent is not None]
    springs = [angles[servo.hinge] + servo.set_point for servo in held]
    assert all(math.isfinite(angle) for angle in springs)
    add(parent, "key", name="rest", qpos=numbers(0, 0, machine.rest.height, 1, 0, 0, 0, hinges), act=numbers(springs))
