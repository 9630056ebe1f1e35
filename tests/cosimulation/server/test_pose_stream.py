"""Poses that a server streams to a renderer: they are the twin's, and move the nodes of a file."""

import runpy
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from aoro_gym.cosimulation.server.pose_stream import PoseStream
from aoro_gym.cosimulation.server.records import POSES, commands_of
from aoro_gym.cosimulation.server.server import Settings
from aoro_gym.interchange.scene_file import AXES, Y_UP, matrix_of, write_scene
from aoro_gym.machine.kinematics import NODES, Kinematics, node_poses
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state
from tests.cosimulation.server.serving import DEFAULTS, client_of, serving

EXAMPLE = runpy.run_path(str(Path(__file__).parents[3] / "examples/renderer/poses.py"))
POSES_OF: Any = EXAMPLE["poses_of"]


@pytest.fixture
def listener():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.settimeout(20.0)
        yield made


def test_a_loaded_file_follows_the_twin(listener, tmp_path):
    """Numbers of the stream are single precision, of places within 10 m: 1e-6 m, and 1e-7 of a quaternion."""
    settings = Settings(lock_step=True, telemetry_rate=50, poses=listener.getsockname())
    with serving(settings) as server, client_of(server) as client:
        client.greet()
        for _ in range(8):
            client.command(steering_V=1.0, drive_V=4.0)
            client.grant(client.time + 0.1)
    received = []
    while len(received) < 40:
        received.append(POSES_OF(listener.recv(2048)))
    times = [time for time, _ in received]
    np.testing.assert_allclose(times, 0.02 * np.arange(1, 41), atol=1e-9)
    twin, machine = Twin(threads=1), server.session.twin.machine
    file = tmp_path / "machine.glb"
    write_scene(file, machine, pose_of_state(twin.state.numpy()[:, 0]))
    loaded: Any = trimesh.load(file)
    commands, kinematics = commands_of({**DEFAULTS, "steering_V": 1.0, "drive_V": 4.0}), Kinematics(machine)
    for number in range(40):
        twin.step(commands, 0.02)
        true = node_poses(kinematics, pose_of_state(twin.state.numpy()[:, 0]))
        _, places = received[number]
        assert tuple(places) == NODES
        for name in NODES:
            x, y, z, *turned = places[name]
            place = matrix_of((np.array([x, y, z]), np.array(turned)))
            loaded.graph.update(frame_from=AXES, frame_to=name, matrix=place)
            np.testing.assert_allclose(loaded.graph[name][0], Y_UP @ matrix_of(true[name]), atol=2e-6)
    moved = received[-1][1]["wheel_fl"][0] - received[0][1]["wheel_fl"][0]
    assert moved > 0.05  # it did move


def test_the_example_drops_what_is_no_pose(listener):
    machine = Twin(threads=1).machine
    host, port = listener.getsockname()
    stream = PoseStream(host, port, machine, session=5)
    stream.send(pose_of_state(Twin(threads=1).state.numpy()[:, 0]), 1.5)
    datagram = listener.recv(2048)
    stream.close()
    assert stream.sent == 1 and len(datagram) == 40 + POSES.payload.size + 4
    time, places = POSES_OF(datagram)
    assert time == 1.5 and places["front_frame"][3:] == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-3)
    assert tuple(EXAMPLE["NODES"]) == NODES
    assert POSES_OF(datagram[:-1]) is None and POSES_OF(b"AORO") is None
    assert POSES_OF(datagram[:100] + b"\xff" + datagram[101:]) is None


def test_a_port_has_bounds():
    with pytest.raises(ValueError, match="port of poses is 0, but must be"):
        Settings(poses=("127.0.0.1", 0))
