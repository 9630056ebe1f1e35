"""Cranes in the view: live ones with sliders, of a log shown again, and in a scene for a renderer."""

import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.interchange.scene_file import scene
from aoro_gym.machine.crane_solids import CRANE_NODES, HELD_LOG, crane_placed
from aoro_gym.machine.kinematics import Kinematics
from aoro_gym.recording.commands import WHEELS
from aoro_gym.simulation.log import log_columns, write_log
from aoro_gym.simulation.manoeuvres import crane_work, holding, run
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.live_view import LiveView
from aoro_gym.view.replay import Recording, log_channels
from aoro_gym.view.server import start


@pytest.fixture(scope="module")
def twin() -> Twin:
    """A twin with a log in its crane."""
    made = Twin(crane=True)
    made.crane.grasp(180.0, 4.0, 0.26)
    made.crane.place([0.4, 0.6, -1.5, 0.3])
    return made


@pytest.fixture
def server():
    pytest.importorskip("viser", reason="[view] is not installed")
    running = start(0)
    yield running
    running.stop()


def test_a_crane_is_shown_and_moved_by_sliders(twin, server, monkeypatch):
    none = np.zeros((1, 4, 3))
    monkeypatch.setattr(LiveTwins, "forces", lambda self: (none, none))  # not compiled here
    monkeypatch.setattr(server, "get_clients", lambda: {0: None})
    shown = LiveView(server, LiveTwins(twin, [twin.machine]), ["aoro"])
    assert shown.driving is not None
    shown.driving.put("crane_lift", 0.6)
    before = float(twin.crane.joints[1, 0])
    for _ in range(20):
        shown.frame()
    assert float(twin.crane.joints[1, 0]) > before + 0.02
    [pose] = shown.twins.poses()
    assert pose.crane is not None
    placed = crane_placed(pose.crane)
    for name in (*CRANE_NODES, HELD_LOG):
        node = server.scene.get_handle_by_name(f"/world/machine_0/{name}")
        np.testing.assert_allclose(node.position, placed[name][0], atol=1e-6)
    twin.crane.grasp(0.0, 4.0, 0.26)
    shown.frame()
    assert server.scene.get_handle_by_name(f"/world/machine_0/{HELD_LOG}") is None


def test_a_log_with_a_crane_is_shown_again(tmp_path):
    twin = Twin(crane=True)
    plan = holding(crane_work(0.5), 180.0, 4.0, 0.26)
    done = run(twin, plan.__class__(**{**vars(plan), "segments": plan.segments[:2]}))
    write_log(tmp_path / "log.csv", log_columns(done.time, done.channels))
    recording = Recording(twin.machine, *log_channels(tmp_path / "log.csv"))
    pose = recording.pose(recording.reading(1.0))
    assert pose.crane is not None and pose.crane.log == pytest.approx((4.0, 0.26), rel=1e-4)
    at = int(np.argmin(np.abs(done.time - recording.time[0] - 1.01)))
    assert pose.crane.joints[1] == pytest.approx(done["crane_joint_lift"][at], abs=0.01)


def test_a_scene_has_its_parts_as_nodes(twin):
    pose = LiveTwins(twin, [twin.machine]).poses()[0]
    nodes = set(scene(twin.machine, pose).graph.nodes_geometry)
    assert {*CRANE_NODES, *Kinematics(twin.machine).bodies} <= nodes


@pytest.mark.slow
def test_forces_of_its_tires_bear_it(twin):
    """Their kernel is compiled; upright they are the loads that the twin says, within 1 % of the machine's rocking."""
    twin.step({"parking_brake": 1.0}, 3.0)
    forces = LiveTwins(twin, [twin.machine]).forces()[1]
    load = sum(float(twin.output(f"wheel_load_{wheel}")[0]) for wheel in WHEELS)
    assert forces[0, :, 2].sum() == pytest.approx(load, rel=0.01)
