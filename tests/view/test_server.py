"""The page without a browser: what the server would send, and what its controls do."""

import socket

import numpy as np
import pytest

from aoro_gym.cli.place import put
from aoro_gym.machine.kinematics import Pose
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.colours import world_colours
from aoro_gym.terrains.world.objects import Tree, upright
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.view import server as module
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.live_view import LiveView
from aoro_gym.view.page import FRAME, cross_track
from aoro_gym.view.panel import gauges
from aoro_gym.view.scene import FORCE_SCALE, Ground, arrows
from aoro_gym.view.server import start


@pytest.fixture
def server():
    pytest.importorskip("viser", reason="[view] is not installed")
    running = start(0)
    yield running
    running.stop()


@pytest.fixture
def view(server, monkeypatch):
    monkeypatch.setattr(
        LiveTwins, "forces", lambda self: (np.zeros((1, 4, 3)), np.zeros((1, 4, 3)))
    )  # not compiled here
    twin = Twin(threads=1)
    Ground(server.scene, Plane())
    shown = LiveView(server, LiveTwins(twin, [twin.machine]), ["aoro"])
    monkeypatch.setattr(server, "get_clients", lambda: {0: None})
    return shown


def test_nodes_are_where_the_twin_is(server, view):
    view.driving.nudge("drive_signal", 1.0)
    for _ in range(40):
        view.frame()
    twin = view.twins.twin
    x = float(twin.output("position_x")[0])
    assert x > 0.1 and view.twins.time == pytest.approx(40 * FRAME + twin.main_step)
    base = server.scene.get_handle_by_name("/world/machine_0")
    world = server.scene.get_handle_by_name("/world")
    np.testing.assert_allclose(base.position[0], x, atol=1e-6)
    np.testing.assert_allclose(world.position, -base.position, atol=1e-6)  # the camera follows
    wheel = server.scene.get_handle_by_name("/world/machine_0/wheel_fl")
    turned = float(twin.state.numpy()[:, 0][module_row("WHEEL_FL")])
    arm = float(twin.output("arm_angle_fl")[0])
    assert wheel.wxyz[0] == pytest.approx(np.cos(0.5 * (turned - arm)), abs=1e-6)


def test_a_world_is_drawn_with_its_objects_and_driven_in(server, monkeypatch):
    field = Terrain.from_heights(np.zeros((41, 41)), cell=1.0, corner=(-20.0, -20.0))
    pine = Tree((0.0, 0.0, 0.0), upright(), "pine", 0.3, 16.0, 9.0, 1.5, 1)
    made = World(field, (pine,))
    node = Ground(server.scene, made).node
    assert node is server.scene.get_handle_by_name("/world/ground")
    scene = made.scene()
    foliage = scene.vertices[:, 2] > 10.0
    shades = world_colours(scene)[foliage].mean(axis=0)
    assert shades[1] == max(shades)  # green
    twin = Twin(terrain=made, threads=1)
    put(twin, twin.machine, None, None)  # not into the pine
    shown = LiveTwins(twin, [twin.machine], begin=lambda: put(twin, twin.machine, None, None))
    shown.settle()
    reading = shown.readings()[0]
    assert reading["touched_object_front"] == 0.0 and np.hypot(reading["position_x"], reading["position_y"]) > 1.0


def module_row(name):
    from aoro_gym.twin.records import State

    return int(State[name])


def test_pause_single_step_speed_and_restart(view):
    twins, clock = view.twins, view.clock
    clock.toggle()
    before = twins.time
    view.frame()
    assert twins.time == before
    clock.step()
    view.frame()
    view.frame()
    assert twins.time == pytest.approx(before + FRAME)
    clock.toggle()
    clock._speed.value = "0.1"
    for _ in range(10):
        view.frame()
    assert twins.time == pytest.approx(before + 2.0 * FRAME)
    view.driving.nudge("steering_signal", 1.0)
    view._ask_restart()
    view.frame()
    assert twins.time < FRAME and view.driving.commands["steering_signal"] == 0.0


def test_keys_move_signals_within_their_bounds(view):
    for _ in range(15):
        view.driving.nudge("steering_signal", -0.1)
    assert view.driving.commands["steering_signal"] == -1.0
    view.driving.nudge("steering_signal", None)
    assert view.driving.commands["steering_signal"] == 0.0


def test_a_port_that_is_taken_is_named(server):
    with pytest.raises(OSError, match=rf"port is {server.get_port()}, but cannot be bound on 127\.0\.0\.1"):
        start(server.get_port())
    with socket.create_connection((module.HOST, server.get_port()), timeout=5.0):
        pass


def test_without_viser_the_fix_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "viser", None)
    with pytest.raises(ValueError, match=r"the view needs viser: pip install 'aoro-gym\[view\]'"):
        start(0)


def test_arrows_are_as_long_as_their_forces():
    forces = np.array([[0.0, 0.0, 24e3], [3e3, -4e3, 0.0], [0.0, 0.0, 10.0], [0.0, 0.0, 0.0]])
    points = arrows(np.ones((4, 3)), forces)
    assert points.shape == (2, 2, 3)
    np.testing.assert_allclose(
        np.linalg.norm(points[:, 1] - points[:, 0], axis=1),
        [24e3 * FORCE_SCALE, 5e3 * FORCE_SCALE],
        rtol=1e-6,  # float32
    )


def test_gauges_show_what_there_is():
    text = gauges({"pressure_a": 125e5, "joint_angle": -np.radians(20.0)}, "a<b")
    assert "125 bar" in text and "width:50.0%" in text  # half of 250 bar
    assert "-20.0 °" in text and "margin-left:25.0%;width:25.0%" in text
    assert "a&lt;b" in text and "pump" not in text


def test_a_path_is_drawn_and_the_error_shown(server, view):
    axle = float(view.twins.twin.machine.frame.front.axle_distance)
    path = Path(np.array([[-20.0, -0.25], [20.0, -0.25]]))
    view.page.surround(Plane(), path)
    view.page.frames = 0  # gauges are looked at
    view.frame()
    assert "left of path" in view.page._gauges._bars[0].content and "25.0 cm" in view.page._gauges._bars[0].content
    turned = Pose(np.array([3.0, 1.0, 0.0]), np.array([np.sqrt(0.5), 0.0, 0.0, -np.sqrt(0.5)]))  # to the right
    assert cross_track(path, turned, axle) == pytest.approx(1.25 - axle)


@pytest.mark.slow  # compiles a kernel
def test_forces_are_what_the_wheels_bear():
    twin = Twin()
    twin.step({"drive_signal": 0.5}, 2.0)
    feet, forces = LiveTwins(twin, [twin.machine]).forces()
    loads = [float(twin.output(f"wheel_load_{wheel}")[0]) for wheel in ("fl", "fr", "rl", "rr")]
    # a main step later: 1 ms at some kN/s
    np.testing.assert_allclose(forces[0, :, 2], loads, rtol=2e-3)
    np.testing.assert_allclose(feet[0, :, 2], 0.0, atol=1e-5)
