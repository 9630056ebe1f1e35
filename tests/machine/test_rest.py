"""Composite corner and rest pose against point masses and against statics written out body by body."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import root

from aoro_gym.machine.parameters import Machine
from aoro_gym.units import GRAVITY

VARIED = {
    "nominal": {},
    "front heavy": {"frame.front.mass": 4900, "frame.rear.mass": 3400, "frame.front.cog_offset": -0.2},
    "rear heavy, unequal axle distances": {
        "frame.rear.mass": 4700,
        "frame.front.axle_distance": 1.5,
        "frame.rear.axle_distance": 1.9,
    },
    "soft tires, raised arms": {"tire.stiffness": 300, "arm.rest_angle": 5, "arm.cog_fraction": 0.4},
}


@pytest.fixture(params=VARIED.values(), ids=list(VARIED))
def machine(request: pytest.FixtureRequest) -> Any:
    return Machine.load().set(request.param)


def _six_points(mass: float, centre: np.ndarray, principal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masses and positions of six equal points on the axes through ``centre`` with given moments of inertia."""
    # a pair at ±d on an axis adds mass/3·d² to both other axes: squared distances from the half trace
    squares = (0.5 * principal.sum() - principal) * 3.0 / mass
    offsets = np.diag(np.sqrt(squares))
    return np.full(6, mass / 6.0), centre + np.concatenate([offsets, -offsets])


def test_corner_equals_a_sum_of_point_masses(machine: Any) -> None:
    arm, wheel, track = machine.arm, machine.wheel, machine.frame.track
    outside = np.array([arm.length, 0.5 * track, 0.0])
    middle = np.array([arm.cog_fraction * arm.length, 0.5 * (arm.pivot_lateral + 0.5 * track), 0.0])
    parts = [
        _six_points(arm.mass, middle, np.array([arm.inertia_axial, arm.inertia_transverse, arm.inertia_transverse])),
        (np.array([arm.motor_mass]), outside[None]),
        # the wheel turns freely about y: only its inertia about the other axes goes with the arm
        _six_points(wheel.mass, outside, np.array([wheel.inertia_transverse, 0.0, wheel.inertia_transverse])),
    ]
    masses = np.concatenate([m for m, _ in parts])
    points = np.concatenate([x for _, x in parts])
    centre = masses @ points / masses.sum()
    r = points - centre
    tensor = np.einsum(
        "i,ijk->jk", masses, np.einsum("ij,ij->i", r, r)[:, None, None] * np.eye(3) - r[:, :, None] * r[:, None, :]
    )

    corner = machine.corner
    assert corner.mass == pytest.approx(masses.sum(), rel=1e-13)
    np.testing.assert_allclose([corner.rho, corner.lateral, 0.0], centre, rtol=1e-13, atol=1e-15)
    expected = np.array(
        [
            [corner.inertia_ee, corner.inertia_ey, 0.0],
            [corner.inertia_ey, corner.inertia_yy, 0.0],
            [0.0, 0.0, corner.inertia_nn],
        ]
    )
    np.testing.assert_allclose(tensor, expected, rtol=1e-12, atol=1e-12 * corner.inertia_nn)


def _bodies(machine: Any, front: float, rear: float) -> tuple[list[tuple[float, float]], list[float]]:
    """(mass, x) of every body, and x of the front and rear wheels; in frame coordinates."""
    frame, arm = machine.frame, machine.arm
    bodies = [
        (frame.front.mass, frame.front.axle_distance - frame.front.cog_offset),
        (frame.rear.mass, -(frame.rear.axle_distance - frame.rear.cog_offset)),
    ]
    wheels = []
    for sign, half, angle in ((1.0, frame.front, front), (-1.0, frame.rear, rear)):
        pivot = half.axle_distance - arm.length
        wheel_x = sign * (pivot + arm.length * np.cos(angle))
        bodies += 2 * [
            (arm.mass, sign * (pivot + arm.cog_fraction * arm.length * np.cos(angle))),
            (arm.motor_mass + machine.wheel.mass, wheel_x),
        ]
        wheels.append(wheel_x)
    return bodies, wheels


def test_forces_and_moments_balance(machine: Any) -> None:
    rest = machine.rest
    bodies, wheels = _bodies(machine, rest.arm_angle_front, rest.arm_angle_rear)
    loads = 2.0 * np.array([rest.wheel_load_front, rest.wheel_load_rear])
    weights = GRAVITY * np.array([m for m, _ in bodies])
    assert loads.sum() == pytest.approx(weights.sum(), rel=1e-13)
    moment = loads @ wheels - weights @ [x for _, x in bodies]
    # the last iteration moved the rear angle by less than 1e-14 rad; the rest is rounding
    assert abs(moment) < 1e-12 * weights.sum() * machine.frame.wheelbase


def test_wheels_press_into_the_ground_by_their_deflection(machine: Any) -> None:
    rest, tire, arm = machine.rest, machine.tire, machine.arm
    assert rest.arm_angle_front == arm.rest_angle
    for angle, deflection, load in (
        (rest.arm_angle_front, rest.deflection_front, rest.wheel_load_front),
        (rest.arm_angle_rear, rest.deflection_rear, rest.wheel_load_rear),
    ):
        lowest = rest.height + arm.pivot_height + arm.length * np.sin(angle) - tire.radius
        assert lowest == pytest.approx(-deflection, abs=1e-13)
        assert tire.stiffness * deflection == pytest.approx(load, rel=1e-13)


def test_cylinders_carry_the_arms(machine: Any) -> None:
    rest, arm = machine.rest, machine.arm
    for angle, load, bore_pressure in (
        (rest.arm_angle_front, rest.wheel_load_front, rest.bore_pressure_front),
        (rest.arm_angle_rear, rest.wheel_load_rear, rest.bore_pressure_rear),
    ):

        def work(phi: float, load: float = load, bore_pressure: float = bore_pressure) -> float:
            """Work [J] of all forces on one arm up to ``phi``: stationary in equilibrium."""
            length = arm.cylinder.linkage.length(-phi)  # shortens as the wheel rises
            bore, rod = arm.cylinder.bore_area * length, -arm.cylinder.annulus_area * length
            lifted = arm.mass * arm.cog_fraction + arm.motor_mass + machine.wheel.mass
            return (
                bore_pressure * bore
                + arm.rod_rest_pressure * rod
                + (load - GRAVITY * lifted) * arm.length * np.sin(phi)
            )

        # central difference of terms near 5e4 J: rounding ε·5e4/h and third derivatives h²·5e4, both below 1e-5 N m
        step = np.cbrt(np.finfo(float).eps)
        slope = (work(angle + step) - work(angle - step)) / (2.0 * step)
        assert abs(slope) < 1e-5


def test_rest_pose_equals_an_independent_solution(machine: Any) -> None:
    arm, tire = machine.arm, machine.tire

    def residual(unknowns: np.ndarray) -> list[float]:
        load_front, load_rear, height, rear = unknowns * scale
        bodies, wheels = _bodies(machine, arm.rest_angle, rear)
        weight = GRAVITY * sum(m for m, _ in bodies)
        return [
            (2.0 * (load_front + load_rear) - weight) / weight,
            (2.0 * (load_front * wheels[0] + load_rear * wheels[1]) - GRAVITY * sum(m * x for m, x in bodies)) / weight,
            height + arm.length * np.sin(arm.rest_angle) - tire.radius + load_front / tire.stiffness,
            height + arm.length * np.sin(rear) - tire.radius + load_rear / tire.stiffness,
        ]

    scale = np.array([2.5e4, 2.5e4, 1.0, 1.0])
    solution = root(residual, np.array([1.0, 1.0, 0.6, -0.1]), tol=1e-13)
    assert solution.success
    rest = machine.rest
    found = [rest.wheel_load_front, rest.wheel_load_rear, rest.height + arm.pivot_height, rest.arm_angle_rear]
    np.testing.assert_allclose(found, solution.x * scale, rtol=1e-10)


def test_a_levelled_machine_stands_on_its_design_plane(machine: Any) -> None:
    """Only the pivots move, and by what it stood too high."""
    other = machine.scale({"tire.stiffness": 0.7})
    level = other.levelled()
    assert abs(other.rest.height) > 5e-3
    assert level.rest.height == pytest.approx(0.0, abs=1e-15)
    assert level.arm.pivot_height == pytest.approx(other.arm.pivot_height + other.rest.height, abs=1e-15)
    changed = {key for key, entry in level.entries.items() if entry.value != other.entries[key].value}
    assert changed == {"arm.pivot_height"}
    # as before levelling: statics know no heights
    assert level.rest.arm_angle_rear == pytest.approx(other.rest.arm_angle_rear, abs=1e-15)


def test_nominal_axle_loads_and_pressures_are_those_of_the_budget() -> None:
    rest = Machine.load().rest
    axle_loads = np.array([rest.wheel_load_front, rest.wheel_load_rear]) * 2.0 / GRAVITY
    assert np.all((axle_loads > 4200.0) & (axle_loads < 5800.0))  # kg, range of the mass budget
    pressures = np.array([rest.bore_pressure_front, rest.bore_pressure_rear])
    assert np.all((pressures > 60e5) & (pressures < 110e5))  # about 95 bar without the unsprung weight
