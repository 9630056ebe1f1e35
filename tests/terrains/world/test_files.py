"""Worlds in folders: read back to the bit; what is broken is named with its file, entry, value and bound."""

import doctest
import json
from typing import Any

import numpy as np
import pytest

import aoro_gym.terrains.world.files as module
from aoro_gym.terrains import Terrain, load
from aoro_gym.terrains.generate.world import populate
from aoro_gym.terrains.io.check import TerrainError
from aoro_gym.terrains.world import world as worlds
from aoro_gym.terrains.world.files import load_world, save_world
from aoro_gym.terrains.world.world import World


@pytest.fixture(scope="module")
def made() -> World:
    x, y = np.meshgrid(np.arange(0.0, 30.5, 0.5), np.arange(0.0, 20.5, 0.5))
    friction = 0.6 + 0.01 * y
    terrain = Terrain.from_heights(
        0.1 * x + np.sin(0.3 * y), cell=0.5, friction=friction, origin=(430_000.0, 7.2e6, 12.0), crs="EPSG:32635"
    )
    return populate(terrain, 2)


@pytest.fixture
def folder(made, tmp_path):
    save_world(made, tmp_path / "kept")
    return tmp_path / "kept"


def test_read_back_to_the_bit(made, folder):
    again = load_world(folder)
    assert again.objects == made.objects
    assert (again.name, again.leaves) == (made.name, made.leaves)
    for name in ("vertices", "faces", "friction", "rolling_resistance"):
        np.testing.assert_array_equal(getattr(again.terrain, name), getattr(made.terrain, name))
    assert (again.terrain.origin, again.terrain.crs) == (made.terrain.origin, made.terrain.crs)
    assert again.undergrowth is not None and made.undergrowth is not None
    np.testing.assert_array_equal(again.undergrowth.density, made.undergrowth.density)
    assert again.undergrowth.corner == made.undergrowth.corner
    for a, b in zip(again.scene()[:5], made.scene()[:5], strict=True):
        np.testing.assert_array_equal(a, b)


def test_its_ground_is_a_terrain_for_all_commands(made, folder):
    terrain, _ = load(folder / "ground.ply")
    assert (terrain.crs, len(terrain.faces)) == (made.terrain.crs, len(made.terrain.faces))
    np.testing.assert_allclose(terrain.extent[1], made.terrain.extent[1], atol=1e-5)


def test_a_world_without_objects(made, tmp_path):
    save_world(World(made.terrain), tmp_path / "bare")
    again = load_world(tmp_path / "bare" / "world.json")
    assert (again.objects, again.ground, again.undergrowth) == ((), None, None)


def change(content, number, **changes):
    content["objects"][number] |= changes


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda c: change(c, 3, height=-2.0),
            r"world.json: objects\[3\]: tree height is -2 m, but must be in \[2, 40\] m",
        ),
        (lambda c: change(c, 0, height="tall"), r"objects\[0\]: height is 'tall', but must be a number"),
        (lambda c: change(c, 0, kind="palm"), r"objects\[0\] has kind 'palm'; choose one of: tree, stump"),
        (lambda c: change(c, 0, colour=1), r"objects\[0\] \(tree\) has colour, which is no field of it"),
        (lambda c: c["objects"][0].pop("species"), r"objects\[0\] \(tree\) lacks species"),
        (lambda c: change(c, 0, position=[1.0, 2.0]), r"objects\[0\]: tree has position \(1.0, 2.0\)"),
        (lambda c: c.update(version=9), "version 9, but must be 'aoro-gym world', version 1; write it anew"),
        (lambda c: c.update(objects=3), "lacks its terrain or the list of its objects"),
        (lambda c: c["terrain"].update(origin_m=[0.0]), r"origin_m is \[0.0\], but must be three finite numbers"),
    ],
)
def test_broken_entries_are_named(folder, spoil, message):
    path = folder / "world.json"
    content = json.loads(path.read_text())
    spoil(content)
    path.write_text(json.dumps(content))
    with pytest.raises(TerrainError, match=message):
        load_world(folder)


def test_too_many_objects_and_no_faces(folder, monkeypatch):
    with np.load(folder / "ground.npz") as held:
        arrays: dict[str, Any] = dict(held)
    arrays["faces"] = np.zeros((0, 3), dtype=np.int32)
    np.savez(folder / "ground.npz", **arrays)
    with pytest.raises(TerrainError, match=r"ground.npz: it holds [\d,]+ points, but no faces to stand on"):
        load_world(folder)
    (folder / "ground.npz").write_bytes(b"PK broken")
    with pytest.raises(TerrainError, match=r"ground.npz: cannot be read as arrays"):
        load_world(folder)
    monkeypatch.setattr(worlds, "MOST_OBJECTS", 5)
    with pytest.raises(TerrainError, match=r"world.json holds [\d,]+ objects, but a world at most 5"):
        load_world(folder)


def test_what_is_no_folder(made, tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ValueError, match="is a file; name a folder"):
        save_world(made, tmp_path / "file")
    with pytest.raises(FileNotFoundError):
        load_world(tmp_path / "none")


def test_example():
    tried = doctest.testmod(module)
    assert (tried.attempted > 0, tried.failed) == (True, 0)
