"""How the vehicle carries its crane: parameters, the folded crane as a rigid body, and which machines can carry it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from aoro_gym import Machine
from aoro_gym.machine.vehicle_crane import VehicleCrane, bodies, crane_mount_parameters


def test_every_parameter_lies_in_its_range_and_says_where_it_comes_from():
    for entry in crane_mount_parameters().values():
        assert re.match(r"(R|E)\b", entry.source), entry.key
        assert entry.range[0] <= entry.value <= entry.range[1], entry.key


def test_the_folded_crane_is_the_sum_of_its_bodies():
    """Tensor of inertia about the hinge by the kinetic energy of a turn about each axis: ω·T ω = Σ m |ω × r|² + ω·I ω."""
    vehicle = VehicleCrane()
    mass, moment, tensor = (one[0] for one in vehicle.folded())
    masses, places, tensors = (one[:, 0] for one in bodies(vehicle.crane, vehicle.mount.transport.joints))
    places = places + np.array([vehicle.mount.foot.distance, 0.0, vehicle.mount.foot.height])
    assert mass == pytest.approx(vehicle.crane.mass) == masses.sum()
    np.testing.assert_allclose(moment, masses @ places)
    rng = np.random.default_rng(3)
    for omega in rng.normal(size=(5, 3)):
        twice = masses @ np.sum(np.cross(omega, places) ** 2, axis=1) + sum(omega @ one @ omega for one in tensors)
        assert omega @ tensor @ omega == pytest.approx(twice)


@pytest.mark.parametrize("name", ["aoro", "aoro_datasheet"])
def test_bundled_machines_can_have_carried_it(name):
    machine = Machine.load(name)
    VehicleCrane().check_fits(machine)
    with pytest.raises(ValueError, match=r"frame.front.mass is 1700 kg, but must be above the crane's 1750 kg"):
        VehicleCrane().check_fits(machine.set({"frame.front.mass": 1700.0}, check_ranges=False))
    with pytest.raises(ValueError, match=r"without the folded crane has a moment of inertia of -\d+ kg m²"):
        # a body may have that little: no principal moment is above the sum of the others
        flat = float(machine.frame.front.inertia_zz - machine.frame.front.inertia_xx)
        VehicleCrane().check_fits(machine.set({"frame.front.inertia_yy": 1.01 * flat}, check_ranges=False))


def test_what_is_wrong_is_told():
    with pytest.raises(ValueError, match="drive is 'oil', but must be one of: cylinders, torques"):
        VehicleCrane(drive="oil")
    vehicle = VehicleCrane()
    high = replace(vehicle.mount, transport=replace(vehicle.mount.transport, lift=2.0))
    with pytest.raises(ValueError, match=r"lift is 114.6 deg, but must be in"):
        VehicleCrane(mount=high)


def test_places_go_from_frame_to_foot_and_back():
    vehicle = VehicleCrane()
    joints = vehicle.crane.joints_at(vehicle.at_foot([-1.9, 0.5, 2.6]))
    np.testing.assert_allclose(vehicle.tip(joints), [-1.9, 0.5, 2.6])
