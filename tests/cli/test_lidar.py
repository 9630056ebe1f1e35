"""A sweep from the command line: points, picture, JSON, and what is wrong input."""

import json

import numpy as np
import pytest

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.world.files import save_world
from aoro_gym.terrains.world.objects import Tree, upright
from aoro_gym.terrains.world.world import World
from tests.cli.calling import call


@pytest.fixture
def ground(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import trimesh

    x, y = np.meshgrid(np.arange(-20, 21), np.arange(-20, 21))
    terrain = Terrain.from_heights(0.02 * x + 0.0 * y, cell=1.0, corner=(-20.0, -20.0))
    trimesh.Trimesh(terrain.vertices, terrain.faces, process=False).export("ground.ply")
    return ("lidar", "--terrain", "ground.ply", "--model", "vlp-16")


def test_points_and_picture(ground, tmp_path):
    shown = call(*ground, "--speed", "2", "--sweeps", "2", "--out", "a.npz", "--json", "-")
    assert shown.exit_code == 0, shown.output
    found = json.loads(shown.stdout)
    with np.load(tmp_path / "a.npz") as points:
        assert found["points"] == len(points["time"]) > 1000
        assert found["share_of_ground"] == 1.0 and found["objects"] == 0
        assert 0.1 < points["time"].max() < 0.2
        np.testing.assert_allclose(points["world"][:, 2], 0.02 * points["world"][:, 0], atol=0.1)  # six deviations
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_in_a_world_its_objects_are_seen_from_a_free_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    field = Terrain.from_heights(np.zeros((41, 41)), cell=1.0, corner=(-20.0, -20.0))
    pine = Tree((0.0, 0.0, 0.0), upright(), "pine", 0.3, 16.0, 9.0, 1.5, 1)  # where a machine would stand
    save_world(World(field, (pine,)), "clearing")
    common = ("lidar", "--world", "clearing", "--model", "vlp-16", "--json", "-")
    shown = call(*common, "--out", "a.npz")
    assert shown.exit_code == 0, shown.output
    assert json.loads(shown.stdout)["objects"] == 1
    with np.load(tmp_path / "a.npz") as points:
        stem = points["world"][points["instance"] == 1]
        # mixed points of its edges lie up to a pulse's length behind it, which is less than 1 m
        assert len(stem) > 10 and np.hypot(*stem[:, :2].T).max() < 1.5 + 1.0
    assert call(*common, "--at", "8", "0", "--out", "b.npz", "--sweeps", "2").exit_code == 0
    shown = call(*common, "--terrain", "ground.ply")
    assert shown.exit_code == 2 and "drop one of them" in " ".join(shown.stderr.split())


@pytest.mark.parametrize("name", ["a.mcap", "a.rosbag2"])
def test_a_bag_has_a_cloud_a_sweep(ground, tmp_path, name):
    from aoro_gym.recording.sensor_bags import Cloud, read_sensors

    common = (*ground, "--speed", "2", "--sweeps", "2")
    assert call(*common, "--out", "a.npz").exit_code == 0
    assert call(*common, "--out", name).exit_code == 0
    clouds = [one for one in read_sensors(tmp_path / name, "/lidar/points") if isinstance(one, Cloud)]
    assert [one.time for one in clouds] == [0.0, 0.1]  # ten sweeps a second
    with np.load(tmp_path / "a.npz") as points:
        for column, axis in enumerate("xyz"):
            both = np.concatenate([one.columns[axis] for one in clouds])
            np.testing.assert_array_equal(both, points["points"][:, column])
        rings = np.concatenate([one.columns["ring"] for one in clouds])
        np.testing.assert_array_equal(rings, points["ring"])


def test_a_table_and_its_files(ground):
    shown = call(*ground, "--weather", "fog=40", "--out", "a.pcd")
    assert "of rain, fog or snow" in shown.stdout
    assert "wrote a.pcd" in shown.stdout and "wrote a.png" in shown.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "a.xyz"], "suffix of --out is '.xyz'"),
        (["--model", "os9"], "--model is 'os9'; choose one of"),
        (["--weather", "rain"], "--weather is 'rain', but must be KIND=AMOUNT"),
        (["--weather", "hail=2"], "weather is 'hail'; choose one of"),
        (["--at", "500", "0"], "there is no ground at x = 500.0 m"),
        (["--speed", "99"], "--speed is 99 m/s"),
        (["--sweeps", "0"], "--sweeps is 0"),
        (["--return", "best"], "is 'best'; choose one of: first"),
    ],
)
def test_wrong_input(ground, words, message):
    shown = call(*ground, *words)
    assert shown.exit_code == 2
    assert message in " ".join(shown.stderr.split())
