"""Worlds in folders: ``world.json`` with the objects, ``ground.npz`` with the ground exactly as it was, and ``ground.ply``
for whatever else reads terrains, which is written only.

>>> import tempfile
>>> from aoro_gym.terrains.generate.world import world
>>> made = world(7, size=(40.0, 40.0))
>>> with tempfile.TemporaryDirectory() as folder:
...     names = [path.name for path in save_world(made, folder)]
...     again = load_world(folder)
>>> names, again.objects == made.objects
(['ground.npz', 'ground.ply', 'ground.json', 'world.json'], True)
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import check_writable, read_json, write_json, written_whole
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.loading import Loaded, save
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.entries import object_entry, object_of
from aoro_gym.terrains.world.world import Undergrowth, World, check_count

FORMAT, VERSION = "aoro-gym world", 1
MOST_BYTES = 256_000_000
"""Of ``world.json``: more than the most objects take."""
ARRAYS = ("vertices", "faces", "friction", "rolling_resistance")
"""Of ``ground.npz``; beside them may be ``surfaces`` and the undergrowth's."""


def save_world(world: World, folder: str | os.PathLike[str]) -> list[Path]:
    """Write a world into a folder; returns the paths of its files. :func:`load_world` reads it back to the bit."""
    place = Path(folder)
    if place.exists() and not place.is_dir():
        raise ValueError(f"{place} is a file; name a folder")
    check_writable(place / "world.json")
    terrain, plants = world.terrain, world.undergrowth
    arrays: dict[str, Any] = {name: getattr(terrain, name) for name in ARRAYS}
    if world.ground is not None:
        arrays["surfaces"] = world.ground
    if plants is not None:
        arrays |= {"plant_height": plants.height, "plant_density": plants.density}
        arrays["plant_grid"] = np.array([*plants.corner, plants.cell])
    ground = place / "ground.npz"
    with written_whole(ground) as temporary:
        np.savez_compressed(temporary, **arrays)
    report = Report(world.name, kind="mesh", units="m", crs=terrain.crs, origin_m=terrain.origin)
    written = [ground, *save(Loaded(terrain, report), place / "ground.ply"), place / "world.json"]
    content = {
        "format": FORMAT,
        "version": VERSION,
        "name": world.name,
        "leaves": world.leaves,
        "terrain": {"name": terrain.name, "origin_m": terrain.origin, "crs": terrain.crs},
        "objects": [object_entry(one) for one in world.objects],
    }
    write_json(written[-1], content)
    return written


def load_world(folder: str | os.PathLike[str]) -> World:
    """The world of a folder that :func:`save_world` wrote.

    Raises:
        TerrainError: (a ``ValueError``) in one sentence with the file, the value, its bound and the fix.
        OSError: if a file cannot be opened.
    """
    place = Path(folder)
    path = place / "world.json" if place.is_dir() else place
    if path.stat().st_size > MOST_BYTES:
        raise TerrainError(
            f"{path} has {path.stat().st_size:,} bytes, but a world's file at most {MOST_BYTES:,}; split it"
        )
    content = read_json(path)
    if content.get("format") != FORMAT or content.get("version") != VERSION:
        raise TerrainError(
            f"{path}: format is {content.get('format')!r}, version {content.get('version')!r}, but must be {FORMAT!r},"
            f" version {VERSION}; write it anew"
        )
    head, entries = content.get("terrain"), content.get("objects")
    if not isinstance(head, dict) or not isinstance(entries, list):
        raise TerrainError(f"{path}: it lacks its terrain or the list of its objects; write it anew")
    try:
        check_count(len(entries), str(path))
        objects = tuple(object_of(f"{path}: objects[{number}]", entry) for number, entry in enumerate(entries))
    except ValueError as error:
        raise TerrainError(str(error)) from None
    ground = path.with_name("ground.npz")
    arrays = _arrays(ground)
    try:
        origin = tuple(float(value) for value in head["origin_m"])
        if len(origin) != 3 or not np.isfinite(origin).all():
            raise ValueError(f"origin_m is {head['origin_m']}, but must be three finite numbers")
        terrain = Terrain(
            **{name: arrays[name][()] for name in ARRAYS}, origin=origin, crs=head["crs"], name=str(head["name"])
        )
        plants = None
        if "plant_height" in arrays:
            x, y, cell = (float(value) for value in arrays["plant_grid"])
            plants = Undergrowth((x, y), cell, arrays["plant_height"], arrays["plant_density"])
        return World(
            terrain,
            objects,
            arrays.get("surfaces"),
            plants,
            bool(content.get("leaves", True)),
            str(content.get("name")),
        )
    except KeyError as error:
        raise TerrainError(f"{place}: {error.args[0]} is missing; write it anew") from None
    except (TypeError, ValueError, IndexError) as error:
        raise TerrainError(f"{ground}: {error}") from None


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Arrays of a file; ``TerrainError`` for one that is broken, lacks some, or holds no faces."""
    try:
        with np.load(path, allow_pickle=False) as held:
            arrays = {name: held[name] for name in held.files}
    except OSError:
        raise
    except Exception as error:  # whatever numpy and zipfile find wrong with a broken file
        text = " ".join(str(error).split())[:150] or type(error).__name__
        raise TerrainError(f"{path}: cannot be read as arrays: {text}; write it anew") from None
    lacking = [name for name in ARRAYS if name not in arrays]
    if lacking:
        raise TerrainError(f"{path}: it lacks {', '.join(lacking)}; write it anew")
    if not arrays["faces"].size:
        raise TerrainError(
            f"{path}: it holds {len(arrays['vertices']):,} points, but no faces to stand on; write it anew"
        )
    return arrays
