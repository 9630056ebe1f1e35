"""The mean half of the machine against its masses, and the joint's inertia against a rod that is free or held."""

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.units import GRAVITY
from aoro_gym.validation.theory.half import half_of, joint_inertia


def test_the_half_is_the_mean_of_both(machine):
    half = half_of(machine)
    assert half.mass == pytest.approx(0.5 * machine.mass)
    assert half.load == pytest.approx(0.5 * machine.mass * GRAVITY, rel=1e-9)
    free, held = joint_inertia(half, np.radians([0.0, 40.0]))
    assert np.all(free < held) and np.all(np.diff([free, held]) > 0.0)


def test_inertia_of_two_free_rods(machine):
    """Rods without wheels and height turn about their centres at the middle pose: J = ½ m l²/12."""
    mass, length = 1000.0, 2.0
    rod = replace(
        half_of(machine), mass=mass, moment=0.5 * mass * length, inertia=mass * length**2 / 3.0, wheel_mass=0.0,
        ahead_high=0.0, high=0.0, axle=0.5 * length,
    )  # fmt: skip
    free, held = joint_inertia(rod, 0.0)
    assert free == pytest.approx(0.5 * mass * length**2 / 12.0)
    assert held == pytest.approx(free)  # an axle at the centre holds what stands still anyhow


def test_a_load_adds_its_moments_about_the_hinge(machine):
    laden = machine.set({"payload.count": 20.0})
    empty, full, load = half_of(machine), half_of(laden), laden.payload
    assert full.mass - empty.mass == pytest.approx(0.5 * load.mass)
    # the rear arms swing by 0.02 rad as the tires give, which moves their own masses by 0.1 % of the load's moment
    assert full.moment - empty.moment == pytest.approx(0.5 * load.mass * load.distance, rel=2e-3)
    assert full.inertia - empty.inertia == pytest.approx(
        0.5 * (load.inertia_zz + load.mass * load.distance**2), rel=2e-3
    )
    assert full.load == pytest.approx(0.5 * laden.mass * GRAVITY, rel=1e-9)
