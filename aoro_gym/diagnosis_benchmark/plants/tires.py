"""Tires of the plants: what the ground under a standing or slowly rolling wheel resists with.

Vectors are in the wheel's own axes (longitudinal, lateral). A force is the ground's on the wheel.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.friction import dahl
from aoro_gym.diagnosis_benchmark.plants.records import (
    Array,
    Constants,
    f64,
    mean_decay,
    packed,
    record,
    square,
    vec2,
    vec4,
)

NOMINAL_LOAD = wp.constant(f64(24_500.0))
"""[N] on a wheel, at which tire magnitudes are stated."""

SCRUB_ANGLE = wp.constant(f64(0.1))
"""Swivel angle [rad] over which scrub torque builds up (published breakaway of standing tires: 0.05 to 0.2 rad)."""

ROLLING_SPEED = wp.constant(f64(0.05))
"""Spin [rad/s] over which rolling resistance changes its sign."""

RUT_SPEED = wp.constant(f64(0.01))
"""Lateral speed [m/s] over which a rut's resistance changes its sign."""

RUT_SHARE = 1.5
"""Lateral over longitudinal resistance of soft ground above level 0: a wheel pushed sideways bulldozes (estimate)."""

PATCH_OFFSET = wp.constant(f64(0.10))
"""[m] between a patch's five strips across the tire, 0.53 m wide."""

PATCH_SHARES = (0.15, 0.225, 0.25, 0.225, 0.15)
"""Of the load on each strip: less under the shoulders."""

PATCH_HALF_LENGTH = wp.constant(f64(0.10))
"""[m] from the patch's middle to the bristles at its front and its rear half: √(F/πp) = 0.2 m at 24.5 kN and 2 bar."""

PARKING = 1000.0
"""Torque [N m] that a standing tire of level 3 resists swivelling with at its nominal load: 2/3 μ F a of a disc, a = 0.1 m
(estimate)."""

POINTS = wp.constant(10)
"""Of a contact patch."""

TIRE_ROWS = wp.constant(4 * (1 + 2 * 10))
"""Rows of the tires' state: shares of the scrub torque by wheel, then bristles [m] by point, axis and wheel."""

Tire = record(
    "Tire", "sliding sticking stribeck rolling rut scrub length scale",
    stiffness=vec2, damping=vec2, viscous=vec2, shares=wp.types.vector(5, f64), points=wp.int32,
)  # fmt: skip
"""Friction and its speed [m/s], resistances, scrub torque [N m], the length [m] along which bristles roll out (0: they do
not), the scale of the patch; bristles [1/m, s/m, s/m] along and across; load shares of strips; points of the contact."""


def tire_of(p: Constants, level: int) -> dict[str, Any]:
    """Fields of :data:`Tire` (R,)."""
    scale = 1.0 + p["tire.patch_gain"]
    bristles = {
        name: np.stack([p[f"tire.sigma{i}_longitudinal"], p[f"tire.sigma{i}_lateral"]])
        for i, name in enumerate(("stiffness", "damping", "viscous"))
    }
    length = 4.0 * float(PATCH_HALF_LENGTH) * (scale if level == 2 else 1.0)
    return {
        **bristles, "sliding": p["tire.friction_coulomb"], "stribeck": p["tire.stribeck_velocity"],
        "sticking": p["tire.friction_coulomb"] if level == 3 else p["tire.friction_static"],
        "rolling": p["tire.rolling_resistance"], "rut": RUT_SHARE * p["ground.rut"],
        "scrub": p["tire.scrub_torque"] + (PARKING if level == 3 else 0.0),
        "length": length if level >= 2 else 0.0, "scale": scale,
        "shares": np.repeat(np.array(PATCH_SHARES)[:, None] / 2.0, len(scale), axis=1),
        "points": int(POINTS) if level == 2 else 1,
    }  # fmt: skip


@wp.func
def place(t: Tire, point: int):
    """How far a contact's point lies ahead of the middle and to its left [m], and its share of the load."""
    along, across, share = f64(0.0), f64(0.0), f64(1.0)
    if t.points > 1:
        strip = point % 5
        along = wp.where(point < 5, -PATCH_HALF_LENGTH, PATCH_HALF_LENGTH) * t.scale
        across = f64(strip - 2) * PATCH_OFFSET * t.scale
        share = t.shares[strip]
    return along, across, share


@wp.func
def loss(t: Tire, slip: vec2, roll: f64):
    """Rates [1/s] at which bristles along and across lose their stretch."""
    squared = slip[0] * slip[0] + slip[1] * slip[1]
    x = squared / square(t.stribeck)
    grip = t.sliding + (t.sticking - t.sliding) * (f64(1.0) - x * mean_decay(x))
    rolled = f64(0.0)
    if t.length > f64(0.0):
        rolled = wp.abs(roll) / t.length
    return t.stiffness * (wp.sqrt(squared) / grip) + vec2(rolled, rolled)


@wp.func
def advance_tire(
    t: Tire, state: wp.array2d(dtype=f64), row: int, run: int, wheel: int, slip: vec2, turn: f64,
    roll: f64, duration: f64,
):  # fmt: skip
    """Move a tire's bristles on by ``duration`` [s] at constant slip: exact, as their law is linear in them.

    LuGre bristles a unit of load, at one point a wheel (level 0 and 1) or at ten points of its contact patch (level 2)::

        ż = v − σ₀ |v| z / g(|v|) [− |Ω r| z / ℓ],    F = −N (σ₀ z + σ₁ ż + σ₂ v)

    The term in brackets is the patch's: tread that rolls out of the contact takes its bristles along. With a patch a wheel
    that is swivelled builds up a torque; with one point a torque of Dahl's form is added where the effect asks for one.
    Source: Canudas de Wit, Tsiotras, Velenis, Basset and Gissinger, Vehicle System Dynamics 39 (2003) 189.

    Level 3 has one point a wheel whose bristles roll out of the contact, too, slides at one level of friction, and a torque
    of Dahl's form on every wheel that is swivelled.

    Args:
        t: Constants.
        state: Of all runs; the tires' begins at ``row``.
        row: See there.
        run: Whose tire it is.
        wheel: Which it is.
        slip: Of the patch's middle along and across the wheel [m/s].
        turn: Yaw rate [rad/s] of the wheel's frame.
        roll: Rolling speed [m/s].
        duration: Time [s].
    """
    state[row + wheel, run] = dahl(state[row + wheel, run], turn * duration, f64(1.0) / SCRUB_ANGLE)
    for point in range(t.points):
        along, across, _share = place(t, point)
        here = vec2(slip[0] - across * turn, slip[1] + along * turn)
        lost = loss(t, here, roll)
        for axis in range(2):
            z = row + 4 + (2 * point + axis) * 4 + wheel
            passed = lost[axis] * duration
            gained = mean_decay(passed)
            state[z, run] = state[z, run] * (f64(1.0) - passed * gained) + here[axis] * gained * duration


@wp.func
def tire_force(
    t: Tire, state: wp.array2d(dtype=f64), row: int, run: int, wheel: int, load: f64, slip: vec2, turn: f64,
    roll: f64,
):  # fmt: skip
    """Longitudinal and lateral force [N] and torque about the vertical [N m] on a wheel under a ``load`` [N]."""
    longitudinal = f64(0.0)
    lateral = f64(0.0)
    if t.rut != f64(0.0):
        lateral = -t.rut * load * wp.tanh(slip[1] / RUT_SPEED)
    torque = -t.scrub * state[row + wheel, run] * load / NOMINAL_LOAD
    for point in range(t.points):
        along, across, share = place(t, point)
        here = vec2(slip[0] - across * turn, slip[1] + along * turn)
        lost = loss(t, here, roll)
        push = vec2()
        for axis in range(2):
            z = state[row + 4 + (2 * point + axis) * 4 + wheel, run]
            stretching = here[axis] - lost[axis] * z
            push[axis] = t.stiffness[axis] * z + t.damping[axis] * stretching + t.viscous[axis] * here[axis]
        push = push * (-load * share)
        longitudinal += push[0]
        lateral += push[1]
        torque += push[1] * along - push[0] * across
    return longitudinal, lateral, torque


@wp.func
def rolling_moment(t: Tire, load: f64, radius: f64, spin: f64):
    """Moment [N m] of rolling resistance on a wheel's ``spin`` [rad/s]."""
    return -t.rolling * load * radius * wp.tanh(spin / ROLLING_SPEED)


@wp.kernel(enable_backward=False)
def _push(
    tires: wp.array(dtype=Tire), pushes: wp.array2d(dtype=f64), state: wp.array2d(dtype=f64), load: f64, slip: vec4,
    forces: wp.array2d(dtype=f64),
):  # fmt: skip
    run = wp.tid()
    tire = tires[run]
    for i in range(pushes.shape[0]):
        here = vec2(pushes[i, 0], pushes[i, 1])
        advance_tire(tire, state, 0, run, 0, here, pushes[i, 2], pushes[i, 3], pushes[i, 4])
    longitudinal, lateral, torque = tire_force(tire, state, 0, run, 0, load, vec2(slip[0], slip[1]), slip[2], slip[3])
    forces[0, run] = longitudinal
    forces[1, run] = lateral
    forces[2, run] = torque
    forces[3, run] = rolling_moment(tire, load, f64(1.0), slip[3])


def pushed(
    p: Constants, level: int, pushes: Sequence[Sequence[float]], slip: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
) -> Array:
    """Longitudinal, lateral force [N], torque [N m] and rolling resistance [N] (4, R) on one wheel on a bench.

    Args:
        p: Constants (R,).
        level: Of the laws.
        pushes: What it undergoes in turn: slip along and across [m/s], yaw rate [rad/s], rolling speed [m/s], time [s].
        slip: At which it is measured then, at :data:`NOMINAL_LOAD`; a spin [rad/s] in the place of the rolling speed.
    """
    runs = len(p["tire.stiffness"])
    forces = wp.zeros((4, runs), dtype=f64, device="cpu")
    inputs = [
        wp.array(packed(Tire, tire_of(p, level), runs), dtype=Tire, device="cpu"),
        wp.array(np.array(pushes, dtype=np.float64).reshape(-1, 5), dtype=f64, device="cpu"),
        wp.zeros((TIRE_ROWS, runs), dtype=f64, device="cpu"), NOMINAL_LOAD, vec4(*slip), forces,
    ]  # fmt: skip
    wp.launch(_push, dim=runs, inputs=inputs, device="cpu")
    return np.asarray(forces.numpy(), dtype=np.float64)
