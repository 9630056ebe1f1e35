"""The plants' bodies: two frames on an upright hinge, standing with held arms on four tires. As in the twin the
contact with the ground is a point of the unloaded tread, so that a wheel rolls on its unloaded radius.

Seven velocities u = (ẋ, ẏ, ψ̇_f, ψ̇_r, ż, α̇, β̇): the hinge at ground height in the plane of the ground, the headings of the
front and the rear frame, and heave, roll and pitch of the whole machine about the hinge's foot, small angles about the
axes x and y of the ground's plane. Wheels spin on their own. Axes x forward (uphill where the ground rises ahead), y left,
z along the ground's normal. Wheels: front left, front right, rear left, rear right.
"""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.fluid import compressibility_of, oil_of
from aoro_gym.diagnosis_benchmark.plants.linkage import Linkage, levers, linkage_of
from aoro_gym.diagnosis_benchmark.plants.records import (
    Array,
    Constants,
    evaluate,
    f64,
    mat77,
    packed,
    positive,
    record,
    square,
    vec4,
    vec7,
)

GRAVITY = 9.81
"""[m/s²]"""

PAYLOAD_HEIGHT = 1.5
"""[m] of the payload over the ground, over the front axle."""

ARM_PRESSURE = 90e5
"""Pressure [Pa] in an arm's cylinder that carries 24.5 kN, at which its oil's stiffness is taken."""

DISC_BLEND = wp.constant(f64(2e-3))
"""Depth [m] by which discs of a tire differ that share the contact."""

X, Y, FRONT, REAR, Z, ROLL, PITCH = (wp.constant(i) for i in range(7))

Half = record("Half", "mass reach height roll pitch yaw product")
"""One frame with its two corners as one body, in the axes of the frame from the hinge's foot [kg, m, kg m²]."""

vec5 = wp.types.vector(5, f64)

Bodies = record(
    "Bodies", "radius spring damper half_track",
    front=Half, rear=Half, gravity=wp.vec3d, axle=vec4, centre=vec4, design_depth=vec4, disc=vec5, drop=vec5,
)  # fmt: skip
"""Frames [kg, m, kg m²], tires [m, N/m, N s/m] and gravity [m/s²]; by wheel the axle's distance [m] ahead of the hinge, the
centre's height and the tire's depth at the design pose; of a tire's discs the place across and the drop [m]."""

Stance = record("Stance", "", cosine=vec4, sine=vec4, x=vec4, y=vec4, across=vec4, bulge=vec4)
"""By wheel: direction of its frame, place of its contact from the hinge in the ground's axes [m] and from its frame's middle
line, and by how much [m] a leaning tire lies deeper."""


# ------------------------------------------------------------------------------------------------------------- constants
def bodies_of(p: Constants, level: int) -> dict[str, Any]:
    """Fields of :data:`Bodies` (R,)."""
    radius, length, rest = p["tire.radius"], p["arm.length"], p["arm.rest_angle"]
    rear, load, axle, height = _level_pose(p)
    angle = {"front": rest, "rear": rear}
    spring = 1.0 / (1.0 / p["tire.stiffness"] + 1.0 / _arm_stiffness(p, level, angle))
    slope_x, slope_y = np.tan(p["ground.slope_ahead"]), np.tan(p["ground.slope_left"])
    upright = 1.0 / np.sqrt(1.0 + slope_x**2 + slope_y**2)
    wheels = ("front", "front", "rear", "rear")
    inner, outer = p["tire.disc_offset_inner"], p["tire.disc_offset_outer"]
    low, lowest, zero = p["tire.disc_drop_inner"], p["tire.disc_drop_outer"], np.zeros_like(length)
    halves = {half: _half(p, half, angle[half], axle[half], height) for half in angle}
    return {
        **halves, "radius": radius, "spring": spring, "damper": p["tire.damping"], "half_track": 0.5 * p["frame.track"],
        "gravity": -GRAVITY * np.stack([slope_x * upright, slope_y * upright, upright]),
        "axle": np.stack([axle["front"], axle["front"], -axle["rear"], -axle["rear"]]),
        "centre": np.stack([radius - load[half] / p["tire.design_stiffness"] for half in wheels]),
        # the tires' depth at the design pose carries the design load; all else is a deviation from it
        "design_depth": np.stack([load[half] / spring for half in wheels]),
        "disc": np.stack([zero, -inner, inner, -outer, outer]), "drop": np.stack([zero, low, low, lowest, lowest]),
    }  # fmt: skip


def _level_pose(p: Constants) -> tuple[Array, dict[str, Array], dict[str, Array], Array]:
    """The rear arms' angle [rad] with which the frames lie level, and then by half a wheel's load [N] and the axle's
    distance [m] from the hinge, and the height [m] of the arms' pivots; a few rounds suffice."""
    length, rest, design = p["arm.length"], p["arm.rest_angle"], p["tire.design_stiffness"]
    mass = {half: p[f"frame.{half}.mass"] for half in ("front", "rear")}
    corner = p["arm.mass"] + p["arm.motor_mass"] + p["wheel.mass"]
    out = (p["arm.mass"] * p["arm.cog_fraction"] + p["arm.motor_mass"] + p["wheel.mass"]) * length / corner
    pivot = {half: p[f"frame.{half}.axle_distance"] - length for half in mass}
    rear = rest
    for _ in range(50):
        angle = {"front": rest, "rear": rear}
        axle = {half: pivot[half] + length * np.cos(angle[half]) for half in mass}
        centre = {half: pivot[half] + out * np.cos(angle[half]) for half in mass}
        offset = {half: p[f"frame.{half}.axle_distance"] - p[f"frame.{half}.cog_offset"] for half in mass}
        moment = mass["front"] * offset["front"] - mass["rear"] * offset["rear"]
        moment = moment + 2.0 * corner * (centre["front"] - centre["rear"])
        total = mass["front"] + mass["rear"] + 4.0 * corner
        front = 0.5 * GRAVITY * (moment + total * axle["rear"]) / (axle["front"] + axle["rear"])
        load = {"front": front, "rear": 0.5 * GRAVITY * total - front}
        height = p["tire.radius"] - load["front"] / design - length * np.sin(rest)
        rear = np.arcsin((p["tire.radius"] - load["rear"] / design - height) / length)
    return rear, load, axle, height


def _half(p: Constants, half: str, angle: Array, axle: Array, height: Array) -> dict[str, Any]:
    """Fields of :data:`Half` (R,), from parts: mass, place ahead, lateral distance of a mirrored pair or 0, height, and
    inertias (xx, yy, zz) about the own centre."""
    zero, sign = np.zeros_like(axle), 1.0 if half == "front" else -1.0
    cosine, sine, length = np.cos(angle), np.sin(angle), p["arm.length"]
    distance, share = p[f"frame.{half}.axle_distance"], p["arm.cog_fraction"]
    offset = distance - p[f"frame.{half}.cog_offset"]
    middle = distance - length + share * length * cosine
    wheels = 2.0 * (p["arm.motor_mass"] + p["wheel.mass"])
    frame = tuple(p[f"frame.{half}.inertia_{axes}"] for axes in ("xx", "yy", "zz"))
    arms = tuple(2.0 * p[f"arm.inertia_{axis}"] for axis in ("axial", "transverse", "transverse"))
    spun = 2.0 * p["wheel.inertia_transverse"]  # about its axle a wheel spins on its own
    half_track = 0.5 * p["frame.track"]
    lateral = 0.5 * (p["arm.pivot_lateral"] + half_track)
    parts = [
        (p[f"frame.{half}.mass"], sign * offset, zero, p[f"frame.{half}.cog_height"], frame),
        (2.0 * p["arm.mass"], sign * middle, lateral, height + share * length * sine, arms),
        (wheels, sign * axle, half_track, height + length * sine, (spun, zero, spun)),
    ]  # fmt: skip
    if half == "front":
        parts.append((p["payload.mass"], axle, zero, zero + PAYLOAD_HEIGHT, (zero, zero, zero)))
    mass = sum(m for m, *_ in parts)
    reach, high = sum(m * x for m, x, *_ in parts) / mass, sum(m * z for m, _, _, z, _ in parts) / mass
    return {
        "mass": mass, "reach": reach, "height": high,
        "roll": sum(own[0] + m * (y**2 + (z - high) ** 2) for m, _, y, z, own in parts),
        "pitch": sum(own[1] + m * ((x - reach) ** 2 + (z - high) ** 2) for m, x, _, z, own in parts),
        "yaw": sum(own[2] + m * ((x - reach) ** 2 + y**2) for m, x, y, _, own in parts),
        "product": -sum(m * (x - reach) * (z - high) for m, x, _, z, _ in parts),
    }  # fmt: skip


@wp.func
def _length(link: Linkage, angle: f64):
    length, _lever, _curve = levers(link, angle)
    return length


@wp.func
def _lever(link: Linkage, angle: f64):
    _length, lever, _curve = levers(link, angle)
    return lever


def _arm_stiffness(p: Constants, level: int, angle: dict[str, Array]) -> Array:
    """Stiffness [N/m] at a wheel of the oil that holds its arm, the mean of front and rear."""
    part = "arm.cylinder."
    bore = 0.25 * np.pi * p[part + "bore"] ** 2
    rod = bore - 0.25 * np.pi * p[part + "rod"] ** 2
    stroke = p[part + "stroke"]
    link = linkage_of(p[part + "dead_length"], stroke, p[part + "mount_ratio"], p["arm.swing"])
    links = packed(Linkage, link, len(stroke))
    fixed, oil = p["arm.hose_volume"] + p[part + "dead_volume"], oil_of(p, level)
    wall = p["arm.hose_volume"] / p["arm.hose_bulk_modulus"]
    pressed, resting = (compressibility_of(oil, at) for at in (ARM_PRESSURE, p["arm.rod_rest_pressure"]))
    total = np.zeros_like(stroke)
    for at in angle.values():
        extended, lever = evaluate(_length, links, Linkage, -at) - link["closed"], evaluate(_lever, links, Linkage, -at)
        loaded = (fixed + bore * extended) * pressed + wall
        other = (fixed + rod * (stroke - extended)) * resting + wall
        stiffness = lever**2 * (bore**2 / loaded + rod**2 / other)
        total += 0.5 * stiffness / (p["arm.length"] * np.cos(at)) ** 2
    return total


# ------------------------------------------------------------------------------------------------------------ kinematics
@wp.func
def stance_of(b: Bodies, q: vec7, across: vec4):
    """The stance at the position ``q`` with the contacts' lateral places ``across`` [m]."""
    s = Stance()
    for half in range(2):
        heading = q[wp.where(half == 0, FRONT, REAR)]
        cosine, sine = wp.cos(heading), wp.sin(heading)
        for side in range(2):
            w = 2 * half + side
            s.cosine[w] = cosine
            s.sine[w] = sine
            s.x[w] = b.axle[w] * cosine - across[w] * sine
            s.y[w] = b.axle[w] * sine + across[w] * cosine
    s.across = across
    return s


@wp.func
def leaning(b: Bodies, q: vec7):
    """The stance at the position ``q``, its leaning wheels where across their tires they touch the ground.

    The tire's crown is five discs that share the contact by their depths, as exp(depth / 2 mm); a lean of 1 mrad moves
    the contact by some 3 mm, which stiffens the machine in roll by a seventh.
    """
    across, bulge = vec4(), vec4()
    for half in range(2):
        heading = q[wp.where(half == 0, FRONT, REAR)]
        lean = q[ROLL] * wp.cos(heading) + q[PITCH] * wp.sin(heading)
        total, moment, level = f64(0.0), f64(0.0), f64(0.0)
        for i in range(5):
            straight = wp.exp(-b.drop[i] / DISC_BLEND)
            weight = straight * wp.exp(-b.disc[i] * lean / DISC_BLEND)
            level += straight
            total += weight
            moment += b.disc[i] * weight
        across[2 * half] = b.half_track + moment / total
        across[2 * half + 1] = -b.half_track + moment / total
        bulge[2 * half] = DISC_BLEND * wp.log(total / level)
        bulge[2 * half + 1] = bulge[2 * half]
    s = stance_of(b, q, across)
    s.bulge = bulge
    return s


@wp.func
def contact(b: Bodies, s: Stance, w: int, u: vec7, spin: f64):
    """Longitudinal and lateral slip [m/s] and yaw rate [rad/s] of a tire; ``spin`` [rad/s] is absolute."""
    turn = u[wp.where(w < 2, FRONT, REAR)]
    tip = -u[ROLL] * s.sine[w] + u[PITCH] * s.cosine[w]  # pitch rate about the axle
    lean = u[ROLL] * s.cosine[w] + u[PITCH] * s.sine[w]  # roll rate about the frame's own axis
    ahead = u[X] * s.cosine[w] + u[Y] * s.sine[w] - s.across[w] * turn
    aside = -u[X] * s.sine[w] + u[Y] * s.cosine[w] + b.axle[w] * turn
    # a wheel's centre moves by its height × pitch rate, the tread under it by −radius × spin; it lies below the ground
    return wp.vec2d(ahead + b.centre[w] * tip - b.radius * spin, aside + (b.radius - b.centre[w]) * lean), turn


@wp.func
def relative_spin(s: Stance, w: int, u: vec7, spin: f64):
    """Spin [rad/s] of a wheel relative to its arm, which the motor sees."""
    return spin - (-u[ROLL] * s.sine[w] + u[PITCH] * s.cosine[w])


# ---------------------------------------------------------------------------------------------------------------- forces
@wp.func
def uphill(q: vec7, x: f64, y: f64):
    """Rise [m/rad] of a point at (x, y) as its frame turns about the leaning hinge."""
    return x * q[ROLL] + y * q[PITCH]


@wp.func
def wheel_load(b: Bodies, s: Stance, w: int, q: vec7, u: vec7):
    """Normal load of a tire [N]."""
    x = s.x[w]
    y = s.y[w]
    raised = q[Z] + y * q[ROLL] - x * q[PITCH]
    rising = u[Z] + y * u[ROLL] - x * u[PITCH] + u[wp.where(w < 2, FRONT, REAR)] * uphill(q, x, y)
    return positive(b.spring * (b.design_depth[w] + s.bulge[w] - raised) - b.damper * rising)


@wp.func
def lifted(s: Stance, w: int, q: vec7, load: f64, force: vec7):
    """Generalised ``force`` with that of a tire's normal load [N]."""
    x = s.x[w]
    y = s.y[w]
    force[Z] += load
    force[ROLL] += load * y
    force[PITCH] -= load * x
    force[wp.where(w < 2, FRONT, REAR)] += load * uphill(q, x, y)
    return force


@wp.func
def weighed(h: Half, row: int, gravity: wp.vec3d, q: vec7, force: vec7):
    """Generalised ``force`` with that of gravity on a half, to first order in the tilts."""
    x, y = h.reach * wp.cos(q[row]), h.reach * wp.sin(q[row])
    m, high = h.mass, h.height
    force[X] += m * gravity[0]
    force[Y] += m * gravity[1]
    force[row] += m * (x * gravity[1] - y * gravity[0] + gravity[2] * uphill(q, x, y))
    force[Z] += m * gravity[2]
    force[ROLL] += m * (y * gravity[2] - high * gravity[1] - high * gravity[2] * q[ROLL])
    force[PITCH] += m * (high * gravity[0] - x * gravity[2] - high * gravity[2] * q[PITCH])
    return force


@wp.func
def turning(h: Half, row: int, q: vec7, u: vec7, force: vec7):
    """Generalised ``force`` with that of a half's centrifugal acceleration."""
    outward = h.mass * square(u[row]) * h.reach
    x, y = outward * wp.cos(q[row]), outward * wp.sin(q[row])
    force[X] += x
    force[Y] += y
    force[ROLL] -= h.height * y
    force[PITCH] += h.height * x
    return force


@wp.func
def gripped(
    b: Bodies, s: Stance, w: int, ahead: f64, aside: f64, torque: f64, shaft: f64, force: vec7
):  # fmt: skip
    """Generalised ``force`` with that of a tire's forces ``ahead`` and ``aside`` [N] and swivel ``torque`` [N m], and of the
    reaction to the torque ``shaft`` [N m] that the arm exerts on the wheel."""
    cosine, sine = s.cosine[w], s.sine[w]
    force[X] += ahead * cosine - aside * sine
    force[Y] += ahead * sine + aside * cosine
    force[wp.where(w < 2, FRONT, REAR)] += b.axle[w] * aside - s.across[w] * ahead + torque
    tipped = b.centre[w] * ahead - shaft
    leaned = (b.radius - b.centre[w]) * aside
    force[ROLL] += leaned * cosine - tipped * sine
    force[PITCH] += leaned * sine + tipped * cosine
    return force


# ----------------------------------------------------------------------------------------------------------- mass matrix
@wp.func
def massed(h: Half, row: int, q: vec7, m: mat77):
    """The mass matrix, its lower triangle, with a half's share."""
    cosine, sine = wp.cos(q[row]), wp.sin(q[row])
    mass, high = h.mass, h.height
    x, y = h.reach * cosine, h.reach * sine
    rise = mass * uphill(q, x, y)
    m[X, X] += mass
    m[Y, Y] += mass
    m[row, X] = -mass * y
    m[row, Y] = mass * x
    m[row, row] = mass * square(h.reach) + h.yaw
    m[Z, row] = rise
    m[Z, Z] += mass
    m[ROLL, Y] -= mass * high
    m[ROLL, row] = -mass * high * x + h.product * cosine + y * rise
    m[ROLL, Z] += mass * y
    m[ROLL, ROLL] += mass * (square(high) + square(y)) + h.roll * square(cosine) + h.pitch * square(sine)
    m[PITCH, X] += mass * high
    m[PITCH, row] = -mass * high * y + h.product * sine - x * rise
    m[PITCH, Z] -= mass * x
    m[PITCH, ROLL] += -mass * x * y + (h.roll - h.pitch) * cosine * sine
    m[PITCH, PITCH] += mass * (square(high) + square(x)) + h.roll * square(sine) + h.pitch * square(cosine)
    return m


@wp.func
def mass_factor(b: Bodies, q: vec7):
    """Cholesky factor, lower, of the mass matrix at the position ``q``."""
    m = massed(b.rear, REAR, q, massed(b.front, FRONT, q, mat77()))
    for j in range(7):
        for i in range(j, 7):
            rest = m[i, j]
            for k in range(j):
                rest -= m[i, k] * m[j, k]
            m[i, j] = rest
        scale = f64(1.0) / wp.sqrt(m[j, j])
        for i in range(j, 7):
            m[i, j] = m[i, j] * scale
    return m


@wp.func
def solved(factor: mat77, force: vec7):
    """Accelerations under the generalised ``force``."""
    x = force
    for i in range(7):
        for k in range(i):
            x[i] -= factor[i, k] * x[k]
        x[i] = x[i] / factor[i, i]
    for j in range(7):
        i = 6 - j
        for k in range(i + 1, 7):
            x[i] -= factor[k, i] * x[k]
        x[i] = x[i] / factor[i, i]
    return x


@wp.func
def standing(b: Bodies, joint_angle: f64):
    """Position at rest at ``joint_angle`` [rad] with the front frame at heading 0, on tires that bear their loads, and the
    contacts' places across then."""
    q = vec7()
    q[REAR] = -joint_angle
    across = vec4()
    for _ in range(12):  # the tires' springs alone are the slope: what gravity and crowns add is a fifth of them
        s = leaning(b, q)
        across = s.across
        force = weighed(b.rear, REAR, b.gravity, q, weighed(b.front, FRONT, b.gravity, q, vec7()))
        stiffness = wp.mat33d()
        for w in range(4):
            force = lifted(s, w, q, wheel_load(b, s, w, q, vec7()), force)
            raised = wp.vec3d(f64(1.0), s.y[w], -s.x[w])  # of a wheel by heave, roll, pitch
            stiffness += b.spring * wp.outer(raised, raised)
        change = wp.inverse(stiffness) * wp.vec3d(force[Z], force[ROLL], force[PITCH])
        q[Z] += change[0]
        q[ROLL] += change[1]
        q[PITCH] += change[2]
    return q, across
