"""Why a twin that is parked across a steep slope rocks: ``python -m studies.parked_across_slope`` (a minute of a core).

A linear model, written apart from the twin: one rigid body on four tires, whose wheels turn against their parking brakes.
Small motions about rest across a slope of the angle γ, with the left side down. Per wheel, with the displacement u of its
contact, forward, to the left and up:

    F_z = N₀ − k u_z − c u_z'
    F_x = −B (σ0_x u_x + σ1_x u_x')
    F_y = −B (tan γ + σ0_y u_y + σ1_y u_y')

The twin's bristles give a force per load, so B is the load F_z that bears now. Pitching, which shifts load between the
axles, then turns the machine by what its tires hold against the slope; turning moves it along, as the lower wheels,
with more load, are stiffer; and that pitches it. Nothing answers from turning to pitching: a circulatory coupling,
which feeds the motion once tan γ is more than damping holds. With B = N₀, the load at rest, as of a contact that sticks
and keeps its shear, there is none. Both are told, and what the twin does. Valid while no tire slides or lifts, and
joint and arms hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym import Machine, Twin
from aoro_gym.machine.rigid_bodies import composite, machine_bodies, poses, rest_angles
from aoro_gym.recording.commands import WHEELS
from aoro_gym.terrains.plane import Plane
from aoro_gym.units import GRAVITY

SLOPES = (20.0, 22.0, 24.0, 26.0, 28.0, 30.0, 32.0, 34.0)
"""[deg]."""
SECONDS, EVERY = 40.0, 0.02
"""How long a twin is parked, and how often its pitch is kept [s]."""
LEAST, MOST = 2e-3, 1.2e-2
"""Amplitudes of the pitch [deg] that growth is read between: below is what the start leaves, above tires slide."""
SETTLED, DRIFT = 150, 57
"""Samples: what the start leaves, and two periods of the pitch, over whose mean its slow drift is taken out."""
BODY = 6
"""Motions of the body: forward, left, up [m], roll, pitch, yaw [rad]; the turns of the four wheels [rad] follow."""
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Mode:
    """An oscillation that grows by exp(growth t)."""

    growth: float
    """[1/s]."""
    frequency: float
    """[Hz]."""


def modes(machine: Machine, slope_deg: float, *, load_now: bool) -> list[Mode]:
    """Oscillations of the linear model across a slope, the fastest growing first.

    Args:
        machine: One machine.
        slope_deg: The slope [deg].
        load_now: Whether bristles give their force by the load that bears now, or by that at rest.
    """
    bodies, angles = machine_bodies(machine), rest_angles(machine)
    mass, centre, inertia = composite(bodies, angles)
    at = poses(bodies, angles)
    hubs = np.array([at[f"wheel_{wheel}"][1] for wheel in WHEELS]) - centre
    loads = _loads(machine, hubs, mass, float(centre[2]), np.radians(slope_deg))
    inertias = np.zeros((BODY + 4, BODY + 4))
    inertias[:3, :3], inertias[3:BODY, 3:BODY] = mass * np.eye(3), inertia
    spin = float(machine.wheel.inertia_spin)
    for wheel in range(BODY, BODY + 4):  # a wheel turns with the body, and by itself
        inertias[wheel, wheel] = inertias[wheel, 4] = inertias[4, wheel] = spin
    stiffness, damping = np.zeros_like(inertias), np.zeros_like(inertias)
    for number, (hub, load) in enumerate(zip(hubs, loads, strict=True)):
        k, c = _wheel(machine, hub, float(centre[2]), load, np.tan(np.radians(slope_deg)), number, load_now=load_now)
        stiffness += k
        damping += c
    size = len(inertias)
    inverse = np.linalg.inv(inertias)
    system = np.block([[np.zeros((size, size)), np.eye(size)], [-inverse @ stiffness, -inverse @ damping]])
    roots = np.linalg.eigvals(system)
    found = [Mode(float(root.real), float(root.imag) / (2.0 * np.pi)) for root in roots if root.imag > 0.0]
    return sorted(found, key=lambda mode: -mode.growth)


def _loads(machine: Machine, hubs: Floats, mass: float, height: float, slope: float) -> Floats:
    """Loads (4,) [N] at rest across a ``slope`` [rad], the left wheels below."""
    rest = machine.rest
    level = np.array([float(rest.wheel_load_front)] * 2 + [float(rest.wheel_load_rear)] * 2)
    shifted = mass * GRAVITY * np.sin(slope) * height / (4.0 * np.abs(hubs[:, 1]))
    return level * np.cos(slope) + shifted * np.sign(hubs[:, 1])


def _wheel(
    machine: Machine, hub: Floats, height: float, load: float, slope: float, number: int, *, load_now: bool
) -> tuple[Floats, Floats]:
    """Stiffness and damping (10, 10) that a wheel and its brake add.

    Args:
        machine: One machine.
        hub: Place (3,) of the wheel's middle, from the centre of mass [m].
        height: Of the centre of mass above the ground [m].
        load: At rest [N].
        slope: Tangent of the slope's angle.
        number: Of the wheel.
        load_now: See :func:`modes`.
    """
    tire, brake, own = machine.tire, machine.driveline.brake, BODY + number
    at_ground = np.array([hub[0], hub[1], -height])
    moved = np.zeros((3, BODY + 4))  # of the contact, by the motions
    moved[:, :3], moved[:, 3:BODY] = np.eye(3), -_cross(at_ground)
    moved[0, own] = -(hub[2] + height)  # turning on carries it backwards
    stiff = np.diag([load * float(tire.sigma0_longitudinal), load * float(tire.sigma0_lateral), float(tire.stiffness)])
    damp = np.diag([load * float(tire.sigma1_longitudinal), load * float(tire.sigma1_lateral), float(tire.damping)])
    if load_now:  # F_y = −F_z tan γ: less of it where the contact rises
        stiff[1, 2], damp[1, 2] = -slope * stiff[2, 2], -slope * damp[2, 2]
    k, c = moved.T @ stiff @ moved, moved.T @ damp @ moved
    k[own, own] += float(brake.presliding_stiffness)
    c[own, own] += float(brake.presliding_damping)
    return k, c


def _cross(vector: Floats) -> Floats:
    """Matrix (3, 3) of the cross product with ``vector`` on the left."""
    return np.cross(np.eye(3), vector).T


def growth(machine: Machine, slope_deg: float) -> Mode | None:
    """What the twin's pitch does, parked across a slope; None where it comes to rest."""
    twin = Twin(machine=machine, terrain=Plane(slope_deg=slope_deg))
    twin.reset(heading=np.pi / 2.0)
    trace = twin.step({"parking_brake": 1.0}, SECONDS, sample_every=EVERY)
    assert trace is not None
    pitch = np.degrees(trace["pitch"][:, 0].astype(np.float64))
    pitch -= np.convolve(pitch, np.full(DRIFT, 1.0 / DRIFT), mode="same")
    peaks = np.flatnonzero((pitch[1:-1] > pitch[:-2]) & (pitch[1:-1] > pitch[2:])) + 1
    peaks = peaks[(peaks > SETTLED) & (peaks < len(pitch) - DRIFT)]
    large = np.flatnonzero(pitch[peaks] >= MOST)
    if not len(large):
        return None
    small = np.flatnonzero(pitch[peaks[: large[0]]] < LEAST)
    kept = peaks[small[-1] + 1 if len(small) else 0 : large[0]]
    times = EVERY * kept
    return Mode(float(np.polyfit(times, np.log(pitch[kept]), 1)[0]), (len(kept) - 1) / float(np.ptp(times)))


def main() -> None:
    machine = Machine.load("aoro")
    print("| slope | bristles by the load now | by the load at rest | the twin |\n| --- | --- | --- | --- |")
    for slope in SLOPES:
        model = [modes(machine, slope, load_now=now)[0] for now in (True, False)]
        twin = growth(machine, slope)
        cells = [f"{mode.growth:+.2f} /s at {mode.frequency:.2f} Hz" for mode in model]
        cells.append("comes to rest" if twin is None else f"{twin.growth:+.2f} /s at {twin.frequency:.2f} Hz")
        print(f"| {slope:g}° | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
