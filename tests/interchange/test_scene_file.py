"""Scenes in glTF: what a loader finds in the file beside the machine's solids, the twin's pose and the world."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from aoro_gym.interchange.scene_file import AXES, Y_UP, matrix_of, scene, write_scene
from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import NODES, Kinematics, Pose, node_poses
from aoro_gym.machine.solids import machine_solids
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.world.objects import Boulder, Log, Stump, along, upright
from aoro_gym.terrains.world.world import World
from tests.cli.calling import call, check_refused

FLAT = Terrain.from_heights(np.zeros((21, 21)), cell=1.0, corner=(-10.0, -10.0))
WORLD = World(
    FLAT,
    (
        Stump((6.0, 1.5, 0.0), upright(), "pine", 0.3, 0.5),
        Boulder((7.0, -1.5, 0.3), upright(), (0.7, 0.6, 0.5), 0.8, 3),
        Log((2.0, -1.0, 0.2), along((0.6, 0.8, 0.0)), "spruce", 4.0, 0.2, 0.18, 0.4, 1),
    ),
)
POSE = Pose(
    np.array([3.0, -2.0, 0.4]),
    Rotation.from_euler("ZYX", [0.7, 0.1, -0.05]).as_quat(scalar_first=True),
    0.3,
    (0.1, -0.1, 0.2, 0.0),
    (1.0, 2.0, 3.0, 4.0),
)


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.glb"
    write_scene(path, Machine.load("aoro"), POSE, WORLD)
    return path


def read(file: Path) -> tuple[dict[str, Any], bytes]:
    """Content and buffer of a GLB by its specification: a header of 12 bytes, then a chunk of JSON and a binary one."""
    data = file.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and size % 4 == 0
    _, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def test_nodes_have_the_names_of_the_parts_and_stand_below_one(file):
    content, _ = read(file)
    nodes = content["nodes"]
    [root] = content["scenes"][content["scene"]]["nodes"]
    by_name = {node["name"]: node for node in nodes}
    assert len(by_name) == len(nodes)
    assert set(by_name) >= {AXES, "ground", "stumps", "boulders", "logs", *NODES}
    top = next(node for node in nodes if node["name"] == AXES)
    assert nodes[root] is top or nodes.index(top) in nodes[root]["children"]
    assert {nodes[child]["name"] for child in top["children"]} == set(by_name) - {AXES, nodes[root]["name"]}
    np.testing.assert_allclose(np.array(top["matrix"]).reshape(4, 4).T, Y_UP)


def test_transforms_and_corners_are_those_of_the_pose_and_the_solids(file):
    """By the file's own numbers; corners are single precision of a few metres, so 1e-6 m."""
    content, buffer = read(file)
    places, solids = node_poses(Kinematics(Machine.load("aoro")), POSE), machine_solids(Machine.load("aoro"))
    for node in content["nodes"]:
        if node["name"] not in NODES:
            continue
        np.testing.assert_allclose(
            np.array(node["matrix"]).reshape(4, 4).T, matrix_of(places[node["name"]]), atol=1e-12
        )
        [primitive] = content["meshes"][node["mesh"]]["primitives"]
        accessor = content["accessors"][primitive["attributes"]["POSITION"]]
        view = content["bufferViews"][accessor["bufferView"]]
        begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        corners = np.frombuffer(buffer, "<f4", 3 * accessor["count"], begin).reshape(-1, 3)
        np.testing.assert_allclose(corners, solids[node["name"]].triangles()[0], atol=1e-6)


def test_trimesh_finds_the_machine_where_it_is(file):
    loaded: Any = trimesh.load(file)
    kinematics = Kinematics(Machine.load("aoro"))
    for name, place in node_poses(kinematics, POSE).items():
        found, geometry = loaded.graph[name]
        np.testing.assert_allclose(found, Y_UP @ matrix_of(place), atol=1e-6)
        solid = machine_solids(Machine.load("aoro"))[name].triangles()[0]
        np.testing.assert_allclose(loaded.geometry[geometry].extents, np.ptp(solid, axis=0), atol=1e-5)
    ground = loaded.geometry["ground"]
    np.testing.assert_allclose(ground.extents, [20.0, 20.0, 0.0], atol=1e-6)
    assert loaded.geometry["logs"].extents.max() > 3.0
    assert {"trees", "branches"} & set(loaded.geometry) == set()


def test_poses_of_nodes_are_the_frames_turned_by_the_machines():
    """Wheels stand the track apart, across the frame, whatever the machine's attitude."""
    machine = Machine.load("aoro")
    places = node_poses(Kinematics(machine), POSE)
    level = node_poses(Kinematics(machine), Pose(POSE.position, POSE.wxyz, 0.0, (0.0,) * 4, (0.0,) * 4))
    across = level["wheel_fl"][0] - level["wheel_fr"][0]
    assert np.linalg.norm(across) == pytest.approx(float(machine.frame.track), abs=1e-9)
    np.testing.assert_allclose(
        across / np.linalg.norm(across), Rotation.from_quat(POSE.wxyz, scalar_first=True).apply([0, 1, 0]), atol=1e-12
    )
    np.testing.assert_allclose(places["front_frame"][0], POSE.position)
    np.testing.assert_allclose([np.linalg.norm(turned) for _, turned in places.values()], 1.0)


def test_the_command_names_its_nodes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = call("export", "scene", "--out", "machine.glb", "--json", "-")
    assert shown.exit_code == 0, shown.output
    assert {one["node"] for one in json.loads(shown.stdout)["nodes"]} == set(NODES)
    lowest = trimesh.load("machine.glb").bounds[0, 1]  # y is up
    assert -0.1 < lowest <= 0.001
    check_refused("export scene --out scene.gltf", "ends in '.gltf'; name a file that ends in .glb")
    check_refused("export scene --out a.glb --no-machine", "leaves nothing to draw; give --terrain or --world")


def test_a_machine_needs_a_pose():
    with pytest.raises(ValueError, match="give machine and pose, or neither"):
        scene(Machine.load("aoro"), None)
    with pytest.raises(ValueError, match="a scene has a machine or a ground"):
        scene(None, None)
