"""The machine's parts as solids: frames with their equipment, arms, wheels, cylinders."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from aoro_gym.machine.kinematics import Kinematics
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.pile import rows as pile_rows
from aoro_gym.machine.rigid_bodies import Strut, Tire
from aoro_gym.machine.solid import Points, Solid
from aoro_gym.recording.commands import WHEELS

PAINT, PAINT_DARK, IRON, CHROME = (0.95, 0.66, 0.13), (0.78, 0.50, 0.08), (0.30, 0.34, 0.38), (0.72, 0.76, 0.79)
WOOD = (0.55, 0.40, 0.26)
TIRE, LUG, RIM, GLASS, WHITE = (
    (0.13, 0.14, 0.15),
    (0.21, 0.22, 0.23),
    (0.86, 0.60, 0.14),
    (0.16, 0.20, 0.24),
    (0.93, 0.94, 0.94),
)
COLOURS = {
    "paint": PAINT, "dark_paint": PAINT_DARK, "iron": IRON, "chrome": CHROME, "tire": TIRE, "lug": LUG, "rim": RIM,
    "glass": GLASS, "white": WHITE,
}  # fmt: skip
"""Of all faces, as a screen shows them (E)."""
ROD_SHARE, BARREL_SHARE = 0.9, 0.8
"""Lengths of a cylinder's rod and barrel, as shares of its length when closed (E)."""
BEAM_RADIUS = 0.13
"""[m] of an arm's beam (E)."""


def first_value(parameter: Any) -> float:
    """A parameter of the machine, or of the first of many."""
    return float(np.ravel(parameter)[0])


def front_frame(machine: Machine, *, folded: bool = True) -> Solid:
    """Front frame: chassis, equipment, the ``folded`` crane if it is one, a mast with the two antennas."""
    out, half = Solid(), machine.frame.front
    inner, outer, width, floor, top = _hull(machine, half, 1.0)
    w = 0.5 * width
    out.prism([(0.0, floor), (inner, floor - 0.06), (inner, floor + 0.42), (0.0, floor + 0.36)], (-0.17, 0.17), IRON)
    out.prism(
        [(inner, floor), (outer - 0.25, floor), (outer, floor + 0.2), (outer, floor + 0.48), (inner, floor + 0.48)],
        (-w, w),
        PAINT,
    )
    out.box((inner + 0.12, inner + 0.95), (-w + 0.06, w - 0.06), (floor + 0.48, floor + 0.95), PAINT_DARK)
    out.box((outer - 0.1, outer + 0.02), (-w + 0.12, -w + 0.42), (floor + 0.26, floor + 0.42), WHITE)
    out.box((outer - 0.1, outer + 0.02), (w - 0.42, w - 0.12), (floor + 0.26, floor + 0.42), WHITE)
    if folded:
        _folded_crane(out, (inner, outer, floor, top))
    # the antennas
    height, apart = 2.2, 0.6
    out.bar((1.0, -apart, height - 0.06), (1.0, apart, height - 0.06), 0.03, IRON, sides=6)
    out.bar((1.0, 0.0, floor + 0.95), (1.0, 0.0, height - 0.06), 0.035, IRON, sides=6)
    for side in (-apart, apart):
        out.bar((1.0, side, height - 0.05), (1.0, side, height + 0.03), 0.11, WHITE, sides=10)
    return out


def _folded_crane(out: Solid, hull: tuple[float, float, float, float]) -> None:
    """Add pillar, boom, stick and grapple; ``hull``: inner and outer end, floor and top [m] of the front frame's body."""
    inner, outer, floor, top = hull
    x, base = outer - 0.55, floor + 0.48
    knee, tip = (x - 0.1, 0.0, top + 0.35), (inner + 0.25, 0.12, top + 0.1)
    out.bar((x, 0.0, base), (x, 0.0, top - 0.1), 0.16, IRON)
    out.bar((x, 0.0, top - 0.15), knee, 0.12, PAINT)
    out.bar(knee, tip, 0.1, PAINT, sides=6)
    out.bar((tip[0] + 0.15, -0.14, top + 0.02), (outer - 0.3, -0.14, top - 0.05), 0.085, PAINT_DARK, sides=6)


def rear_frame(machine: Machine) -> Solid:
    """Rear frame: chassis, the engine's hood with its grilles, the exhaust; or the bunk with its logs."""
    out, half = Solid(), machine.frame.rear
    inner, outer, width, floor, top = _hull(machine, half, -1.0)
    if first_value(machine.payload.count) > 0.0:
        return _bunk(machine, (inner, outer, width, floor))
    w = 0.5 * width
    out.prism([(inner, floor - 0.06), (0.0, floor), (0.0, floor + 0.36), (inner, floor + 0.42)], (-0.17, 0.17), IRON)
    out.prism(
        [(outer + 0.15, floor), (inner, floor), (inner, floor + 0.4), (outer, floor + 0.4), (outer, floor + 0.15)],
        (-w, w),
        IRON,
    )
    out.prism(
        [
            (outer, floor + 0.4), (inner - 0.05, floor + 0.4), (inner - 0.05, top - 0.28), (inner - 0.35, top),
            (outer + 0.3, top), (outer, top - 0.25),
        ],
        (-w + 0.04, w - 0.04), PAINT,
    )  # fmt: skip
    for level in np.linspace(floor + 0.52, top - 0.42, 5):  # grilles
        out.box((outer - 0.015, outer + 0.02), (-w + 0.18, w - 0.18), (level, level + 0.07), GLASS)
    for low, high in ((-w + 0.02, -w + 0.05), (w - 0.05, w - 0.02)):
        for place in np.linspace(outer + 0.45, inner - 0.7, 4):
            out.box((place, place + 0.16), (low, high), (floor + 0.6, top - 0.4), GLASS)
    out.bar((inner - 0.55, 0.36, top - 0.02), (inner - 0.55, 0.36, top + 0.42), 0.06, IRON)
    out.bar((outer + 0.5, -0.3, top - 0.02), (outer + 0.5, -0.3, top + 0.12), 0.1, GLASS)
    return out


def _bunk(machine: Machine, hull: tuple[float, float, float, float]) -> Solid:
    """Rear frame under a load: the hood is as high as the bunk's floor, on which stakes and a headboard hold the logs."""
    (inner, outer, width, floor), load = hull, machine.payload
    out, w = Solid(), 0.5 * width
    base = first_value(load.bunk_height)
    length, radius = first_value(load.length), 0.5 * first_value(load.diameter)
    middle, half_bunk = -first_value(load.distance), 0.5 * first_value(load.bunk_width)
    out.prism([(inner, floor - 0.06), (0.0, floor), (0.0, floor + 0.36), (inner, floor + 0.42)], (-0.17, 0.17), IRON)
    out.box((outer, inner), (-w, w), (floor, floor + 0.4), IRON)
    out.box((outer, inner - 0.05), (-w + 0.04, w - 0.04), (floor + 0.4, max(base - 0.15, floor + 0.45)), PAINT)
    lying = list(pile_rows(first_value(load.count), 2.0 * radius, 2.0 * half_bunk))
    high = base + float(lying[-1][2][0]) + radius + 0.15
    reach = 0.5 * length + first_value(load.slide_range)
    out.box((middle - reach, middle + reach), (-0.12, 0.12), (base - 0.15, base - 0.02), IRON)
    for x in (middle - 0.3 * length, middle + 0.3 * length):
        out.box((x - 0.06, x + 0.06), (-half_bunk - 0.08, half_bunk + 0.08), (base - 0.1, base - 0.005), IRON)
        for low, upper in ((-half_bunk - 0.08, -half_bunk), (half_bunk, half_bunk + 0.08)):
            out.box((x - 0.05, x + 0.05), (low, upper), (base - 0.1, high), PAINT_DARK)
    headboard = (middle + reach, middle + reach + 0.05)
    for level in np.arange(base + 0.1, high, 0.25):
        out.box(headboard, (-half_bunk, half_bunk), (level, level + 0.07), IRON)
    for place in (-half_bunk, -0.03, half_bunk - 0.06):
        out.box(headboard, (place, place + 0.06), (base - 0.1, high), IRON)
    for laid, places, height in lying:
        for i in range(round(float(laid[0]))):
            y, z = 2.0 * radius * (i - 0.5 * (float(places[0]) - 1.0)), base + float(height[0])
            out.bar((middle - 0.5 * length, y, z), (middle + 0.5 * length, y, z), radius, WOOD, sides=10)
    return out


def _hull(machine: Machine, half: Any, sign: float) -> tuple[float, float, float, float, float]:
    """Inner and outer end, width, floor and top [m] of a frame's body."""
    middle, length = first_value(half.cog_x), first_value(half.hull_length)
    floor = first_value(machine.frame.ground_clearance)
    inner, outer = middle - 0.5 * sign * length, middle + 0.5 * sign * length
    return inner, outer, first_value(half.hull_width), floor, floor + first_value(half.hull_height)


def wheel(radius: float, width: float) -> Solid:
    """A wheel about the origin, its axle along y."""
    out, segments, half = Solid(), 24, 0.5 * width
    turn = 2.0 * np.pi * np.arange(segments) / segments

    def ring(r: float, y: float) -> Points:
        return np.stack([r * np.cos(turn), np.full(segments, y), r * np.sin(turn)], axis=1)

    inner = radius - 0.035
    rows = [ring(inner - 0.07, -half), ring(inner, -half + 0.06), ring(inner, half - 0.06), ring(inner - 0.07, half)]
    for before, after in pairwise(rows):
        for i in range(segments):
            j = (i + 1) % segments
            out.face([before[i], after[i], after[j], before[j]], TIRE)
    for side in (-1.0, 1.0):
        for r, y, colour in (
            (inner - 0.07, half, TIRE),
            (0.6 * radius, half + 0.004, RIM),
            (0.24 * radius, half + 0.03, IRON),
        ):
            disc = ring(r, side * y)
            out.face(disc if side < 0.0 else disc[::-1], colour)
    # lugs in chevrons
    for k in range(14):
        for side in (-1.0, 1.0):
            a, b = 2.0 * np.pi * (k + 0.25 * (side + 1.0)) / 14.0, 0.20
            corners = [
                (radius * math.cos(a + t), side * y, radius * math.sin(a + t))
                for t, y in ((0.0, 0.0), (b, half - 0.03), (b + 0.13, half - 0.03), (0.13, 0.0))
            ]
            out.face(corners if side < 0.0 else corners[::-1], LUG)
    out.hulls.append(np.concatenate([rows[1], rows[2]]))
    return out


def machine_solids(machine: Machine) -> dict[str, Solid]:
    """Every part of a machine in its own axes, by the names of :class:`~aoro_gym.machine.kinematics.Kinematics`."""
    kinematics = Kinematics(machine)
    solids = {"front_frame": front_frame(machine), "rear_frame": rear_frame(machine)}
    half_width = float(machine.tire.disc_offset_outer)
    for name, body in kinematics.bodies.items():
        if isinstance(body.shape, Strut):
            solids[name] = beam = Solid()
            inside = np.array([0.0, math.copysign(half_width, body.shape.end[1]), 0.0])
            beam.bar(np.zeros(3), body.shape.end - inside, BEAM_RADIUS, IRON)
        elif isinstance(body.shape, Tire):
            solids[name] = wheel(body.shape.radius, body.shape.width)
    sizes = {f"arm_{name}": machine.arm.cylinder for name in WHEELS}
    sizes |= dict.fromkeys(("steering_left", "steering_right"), machine.steering.cylinder)
    for name, cylinder in sizes.items():
        closed = float(cylinder.dead_length)
        solids[f"barrel_{name}"], solids[f"rod_{name}"] = barrel, rod = Solid(), Solid()
        barrel.bar(np.zeros(3), (BARREL_SHARE * closed, 0.0, 0.0), 0.6 * float(cylinder.bore), IRON, sides=12)
        rod.bar((-ROD_SHARE * closed, 0.0, 0.0), np.zeros(3), 0.5 * float(cylinder.rod), CHROME, sides=12)
    return solids
