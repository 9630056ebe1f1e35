"""The plants' bodies against closed forms."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.bodies import (
    FRONT,
    PITCH,
    REAR,
    ROLL,
    Bodies,
    X,
    Y,
    Z,
    bodies_of,
    leaning,
    lifted,
    mass_factor,
    solved,
    standing,
    weighed,
    wheel_load,
)
from aoro_gym.diagnosis_benchmark.plants.records import f64, packed, vec7
from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD


@wp.kernel(enable_backward=False)
def factored(
    bodies: wp.array(dtype=Bodies), q: wp.array(dtype=vec7), force: wp.array(dtype=vec7),
    factor: wp.array2d(dtype=f64), accelerations: wp.array(dtype=vec7),
):  # fmt: skip
    found = mass_factor(bodies[0], q[0])
    accelerations[0] = solved(found, force[0])
    for i in range(7):
        for j in range(i + 1):
            factor[i, j] = found[i, j]


@wp.kernel(enable_backward=False)
def stood(
    bodies: wp.array(dtype=Bodies), angle: f64, loads: wp.array(dtype=f64), force: wp.array(dtype=vec7)
):  # fmt: skip
    b = bodies[0]
    q, _across = standing(b, angle)
    s = leaning(b, q)
    total = weighed(b.rear, REAR, b.gravity, q, weighed(b.front, FRONT, b.gravity, q, vec7()))
    for w in range(4):
        load = wheel_load(b, s, w, q, vec7())
        loads[w] = load
        total = lifted(s, w, q, load, total)
    force[0] = total


def at_rest(constants, angle):
    """Wheel loads (4,) [N] and generalised force (7,) on bodies that stand at the joint ``angle`` [rad]."""
    bodies = wp.array(packed(Bodies, bodies_of(constants, 0), 1), dtype=Bodies, device="cpu")
    loads, force = wp.zeros(4, dtype=f64, device="cpu"), wp.zeros(1, dtype=vec7, device="cpu")
    wp.launch(stood, dim=1, inputs=[bodies, angle, loads, force], device="cpu")
    return loads.numpy(), force.numpy()[0]


def test_the_mass_matrix_is_that_of_two_bodies(constants):
    """Kinetic energy from point velocities of both frames, by finite differences of their places."""
    bodies = packed(Bodies, bodies_of(constants, 0), 1)
    rng = np.random.default_rng(1)
    position = rng.uniform(-0.4, 0.4, 7) * np.array([1, 1, 1, 1, 0, 0, 0])
    u, force = rng.uniform(-1.0, 1.0, 7), rng.uniform(-1.0, 1.0, 7)
    factor, accelerations = wp.zeros((7, 7), dtype=f64, device="cpu"), wp.zeros(1, dtype=vec7, device="cpu")
    vectors = [wp.array(v[None], dtype=vec7, device="cpu") for v in (position, force)]
    wp.launch(factored, dim=1, inputs=[wp.array(bodies, dtype=Bodies), *vectors, factor, accelerations], device="cpu")
    matrix = factor.numpy() @ factor.numpy().T
    energy = 0.5 * u @ matrix @ u
    expected = 0.0
    for half, row in ((bodies["front"][0], FRONT), (bodies["rear"][0], REAR)):
        heading = position[row]
        turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
        place = turn @ np.array([half["reach"], 0.0, half["height"]])
        rate = np.array([u[ROLL], u[PITCH], u[row]])
        velocity = np.array([u[X], u[Y], u[Z]]) + np.cross(rate, place)
        own = np.diag([half["roll"], half["pitch"], half["yaw"]])
        own[0, 2] = own[2, 0] = half["product"]
        local = turn.T @ rate
        expected += 0.5 * half["mass"] * velocity @ velocity + 0.5 * local @ own @ local
    assert energy == pytest.approx(expected, rel=1e-12)
    assert matrix @ accelerations.numpy()[0] == pytest.approx(force)


def test_tires_bear_the_machine_in_balance(constants, machine):
    load, force = at_rest(constants, 0.6)
    assert load.sum() == pytest.approx(9.81 * machine.mass, rel=1e-3)
    # in balance to a thousandth of what one wheel's moment is
    assert np.abs(force[Z:]).max() < 1e-3 * float(NOMINAL_LOAD)


def test_level_frames_carry_the_design_loads(constants, machine):
    rest = machine.rest
    loads = [rest.wheel_load_front] * 2 + [rest.wheel_load_rear] * 2
    assert at_rest(constants, 0.0)[0] == pytest.approx(loads, rel=1e-6)
