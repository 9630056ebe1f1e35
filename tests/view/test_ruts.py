"""Ruts on the page, without a browser."""

import numpy as np
import pytest

from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.soil_ruts import Ruts
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.live_view import LiveView
from aoro_gym.view.ruts import ABOVE, DEEP, squares
from aoro_gym.view.server import start


def test_squares_lie_on_the_ground_around_the_nodes_in_ruts():
    depth = np.zeros((3, 2), dtype=np.float32)
    depth[2, 1] = 0.4
    vertices, faces, colours = squares([Ruts((1.0, 2.0), 0.1, depth, depth)], Plane(slope_deg=10.0))
    np.testing.assert_allclose(vertices[:, :2].mean(axis=0), [1.1, 2.2])
    np.testing.assert_allclose(np.ptp(vertices[:, :2], axis=0), [0.1, 0.1])
    np.testing.assert_allclose(vertices[:, 2], np.tan(np.radians(10.0)) * vertices[:, 0] + ABOVE)
    assert faces.shape == (2, 3) and set(faces.ravel()) == {0, 1, 2, 3}
    np.testing.assert_array_equal(colours[:, :3], np.tile(DEEP, (4, 1)))
    assert squares([], Plane())[0].shape == (0, 3)


def test_a_twin_on_soil_leaves_ruts_on_the_page(monkeypatch):
    pytest.importorskip("viser", reason="[view] is not installed")
    server = start(0)
    try:
        twin = Twin(soil="peat", threads=1)
        shown = LiveView(server, LiveTwins(twin, [twin.machine]), ["aoro"])
        monkeypatch.setattr(server, "get_clients", lambda: {0: None})
        shown.frame()
        assert server.scene.get_handle_by_name("/world/ruts") is not None
        assert not shown.twins.forces()[1].any()
    finally:
        server.stop()
