"""The parts of a crane on the front frame: where they are, and what they look like.

Sections are estimates (E); its cylinders are not drawn.
"""

from __future__ import annotations

import math

from scipy.spatial.transform import Rotation

from aoro_gym.machine.kinematics import CranePose, Kinematics, Placement, Pose, turned
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.solid import Solid
from aoro_gym.machine.solids import IRON, PAINT, PAINT_DARK, WOOD, first_value, front_frame, machine_solids
from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP, VehicleCrane

CRANE_NODES = ("crane_pillar", "crane_boom", "crane_stick", "crane_extension", "crane_grapple")
"""Names of a crane's parts."""
HELD_LOG = "held_log"
"""Name of the log in its grapple."""
PILLAR_RADIUS, BOOM_RADIUS, STICK_RADIUS, EXTENSION_RADIUS = 0.16, 0.13, 0.11, 0.08
"""[m] of the drawn sections. (E)"""
LINK = 0.35
"""[m] of the link from the tip to the rotator. (E)"""


def crane_solids(vehicle: VehicleCrane) -> dict[str, Solid]:
    """Every part of a crane, one variant, in its own axes, by :data:`CRANE_NODES`: of the booms x runs along them from their
    inner pin, of the extension to its end, the tip; the grapple hangs from the tip, a log in it along x."""
    crane = vehicle.crane
    pillar, boom, stick, extension, grapple = (Solid() for _ in CRANE_NODES)
    top = (first_value(crane.lift.offset), 0.0, first_value(crane.lift.height))
    pillar.bar((0.0, 0.0, -0.25), (0.0, 0.0, 0.1), 1.6 * PILLAR_RADIUS, IRON, sides=12)
    pillar.bar((0.0, 0.0, 0.1), (0.0, 0.0, top[2] - 0.1), PILLAR_RADIUS, IRON)
    pillar.bar((0.0, 0.0, top[2] - 0.15), top, 0.8 * PILLAR_RADIUS, IRON)
    boom.bar((0.0, 0.0, 0.0), (first_value(crane.boom.length), 0.0, 0.0), BOOM_RADIUS, PAINT)
    stick.bar((-0.15, 0.0, 0.0), (first_value(crane.stick.length), 0.0, 0.0), STICK_RADIUS, PAINT)
    inside = min(first_value(crane.telescope.stroke) + 0.3, first_value(crane.stick.length))
    extension.bar((-inside, 0.0, 0.0), (0.0, 0.0, 0.0), EXTENSION_RADIUS, PAINT_DARK)
    grapple.bar((0.0, 0.0, 0.0), (0.0, 0.0, -LINK), 0.04, IRON)
    grapple.bar((0.0, 0.0, -LINK), (0.0, 0.0, -LINK - 0.25), 0.12, PAINT_DARK, sides=12)
    grapple.bar((0.0, -0.25, -LINK - 0.3), (0.0, 0.25, -LINK - 0.3), 0.07, IRON)
    for side in (-1.0, 1.0):
        for x in (-0.12, 0.12):
            knee = (x, side * 0.42, -GRAPPLE_DROP + 0.12)
            grapple.bar((x, side * 0.22, -LINK - 0.3), knee, 0.045, PAINT_DARK, sides=6)
            grapple.bar(knee, (x, side * 0.16, -GRAPPLE_DROP - 0.24), 0.045, PAINT_DARK, sides=6)
    return dict(zip(CRANE_NODES, (pillar, boom, stick, extension, grapple), strict=True))


def log_solid(length: float, diameter: float) -> Solid:
    """A log [m] about the origin, its axis along x."""
    out = Solid()
    out.bar((-0.5 * length, 0.0, 0.0), (0.5 * length, 0.0, 0.0), 0.5 * diameter, WOOD, sides=12)
    return out


def crane_placed(pose: CranePose) -> dict[str, Placement]:
    """Where all parts are, and the log if there is one, in the front frame's axes."""
    crane, foot = pose.vehicle.crane, pose.vehicle.mount.foot
    slew, lift, fold, out = pose.joints
    raised = lift + fold
    radius, height = first_value(crane.lift.offset), first_value(foot.height) + first_value(crane.lift.height)

    def place(along: float, up: float) -> tuple[float, float, float]:
        return first_value(foot.distance) + along * math.cos(slew), along * math.sin(slew), up

    boom, stick = first_value(crane.boom.length), first_value(crane.stick.length)
    knee = radius + boom * math.cos(lift), height + boom * math.sin(lift)
    tip = knee[0] + (stick + out) * math.cos(raised), knee[1] + (stick + out) * math.sin(raised)
    found = {
        "crane_pillar": (place(0.0, first_value(foot.height)), turned(slew, 0.0)),
        "crane_boom": (place(radius, height), turned(slew, -lift)),
        "crane_stick": (place(*knee), turned(slew, -raised)),
        "crane_extension": (place(*tip), turned(slew, -raised)),
        "crane_grapple": (place(*tip), turned(slew + pose.yaw, 0.0)),
    }
    if pose.log is not None:
        found[HELD_LOG] = place(tip[0], tip[1] - GRAPPLE_DROP), turned(slew + pose.yaw, 0.0)
    return found


def parts_of(machine: Machine, pose: Pose) -> dict[str, tuple[Solid, Placement]]:
    """Every part of a machine, of its crane and of the log in it, and where it is in the front frame's axes.

    Args:
        machine: One variant.
        pose: Where it is; with a crane whose joints move, the folded one is left out.
    """
    placed = Kinematics(machine).placed(pose.joint, pose.arms, pose.wheels)
    solids = machine_solids(machine)
    if pose.crane is not None:
        solids["front_frame"] = front_frame(machine, folded=False)
        solids |= crane_solids(pose.crane.vehicle)
        placed |= crane_placed(pose.crane)
        if pose.crane.log is not None:
            solids[HELD_LOG] = log_solid(*pose.crane.log)
    return {name: (solid, placed[name]) for name, solid in solids.items()}


def in_world(pose: Pose, placed: Placement) -> Placement:
    """Origin [m] and unit quaternion w, x, y, z in the world's axes of a part that is ``placed`` in the front frame's of a
    machine at ``pose``."""
    frame, own = (Rotation.from_quat(wxyz, scalar_first=True) for wxyz in (pose.wxyz, placed[1]))
    x, y, z = (frame.apply(placed[0]) + pose.position).tolist()
    w, i, j, k = (frame * own).as_quat(scalar_first=True).tolist()
    return (x, y, z), (w, i, j, k)
