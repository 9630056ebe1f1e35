"""The machine as solids."""

import numpy as np
import pytest

from aoro_gym.envs.path_tracking.rendering.machine import SolidMachine


def test_the_solid_machine_has_its_wheels_where_the_twin_has_them(machine):
    solid = SolidMachine(machine)
    rest = [machine.rest.arm_angle_front] * 2 + [machine.rest.arm_angle_rear] * 2
    points, starts, colours, hulls = solid.posed(np.zeros(3), 0.0, 0.0, 0.0, 0.5, rest, [0.0] * 4)
    assert len(starts) == len(colours) + 1 and starts[-1] == len(points)
    radius = machine.tire.radius
    wheels = [hull for hull in hulls if len(hull) == 48]  # two rings of 24
    assert len(wheels) == 4
    for hull, (x, y, turned) in zip(wheels, ((1, 1, 0), (1, -1, 0), (-1, 1, 1), (-1, -1, 1)), strict=True):
        angle = -0.5 * turned  # the front frame points to the left of the rear one
        x, y = x * machine.frame.front.axle_distance, 0.5 * y * machine.frame.track
        middle = (np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y)
        np.testing.assert_allclose(hull.mean(axis=0)[:2], middle, atol=0.15)  # the arms swing the axles a little
        # on the ground but for its deflection, a few centimetres
        assert hull[:, 2].min() == pytest.approx(-0.05, abs=0.06)
        assert np.ptp(hull[:, 2]) == pytest.approx(2 * (radius - 0.035), rel=0.01)
