"""What a picture shows, object by object: masks of the visible pixels, boxes of the visible and of all, boxes in space.

The rays through the middles of pixels say what is seen, so a mask is exactly those pixels. What is hidden comes from the
objects' triangles, drawn over an empty picture; a crown's are those of
:func:`~aoro_gym.terrains.world.meshes.foliage`, so what is hidden of a crown is rough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.sensors.camera import Intrinsics, Picture
from aoro_gym.sensors.dataset.machines import StandingMachine
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.meshes import FOLIAGE, mesh
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Object, Stump, Tree, matrix
from aoro_gym.terrains.world.world import World

Array = NDArray[np.float64]

CATEGORIES = ("trunk", "crown", "log", "log_end", "stump", "boulder", "machine")
"""In the order of their numbers, from 1 in COCO and from 0 in YOLO."""
NEAR_STEM = (1.2, 0.03)
"""Factor and margin [m] of the stem's radius within which wood of a tree is its trunk; the rest is its crown's. (E)"""
NEAREST = 0.1
"""Depth [m] before which triangles are left out of what is hidden."""
LEAF_SURFACES = tuple(FOLIAGE.values())


@dataclass(frozen=True, eq=False)
class Label:
    """One part of one object in one picture."""

    instance: int
    category: str
    mask: NDArray[np.bool_]
    """(H, W) pixels in which it is seen."""
    box: tuple[float, float, float, float]
    """Left, upper, right and lower edge [pixels] around the mask; the first pixel's are 0 and 1."""
    full_box: tuple[float, float, float, float]
    """Around all of it that lies ahead, beyond the picture's edges, too, as if nothing hid it."""
    truncation: float
    """Share of the full box outside of the picture."""
    occlusion: float
    """Share of its silhouette in the picture that something hides."""
    size: tuple[float, float, float]
    """Length, width and height [m] of an upright box around it, the length along logs and machines, east otherwise."""
    location: tuple[float, float, float]
    """Middle of that box's floor [m] in the camera's axes."""
    turn: float
    """Angle [rad] of its length about the camera's y axis: 0 to the right, as KITTI's rotation_y."""
    camera_size: tuple[float, float, float]
    """Length, width and height [m] of the box around it with the same turn whose height is along the camera's y axis, as
    KITTI's readers have it."""
    camera_location: tuple[float, float, float]
    """Middle of that box's lower side [m] in the camera's axes."""


class Shapes:
    """Triangles of a world's objects by their parts, made once.

    Args:
        world: Its objects are instances 1 to N.
        machines: Instances N + 1 and on.
    """

    def __init__(self, world: World, machines: Sequence[StandingMachine] = ()):
        self.world, self.machines = world, tuple(machines)
        self._known: dict[tuple[int, str], tuple[Array, NDArray[np.int64]]] = {}

    def of(self, instance: int) -> Object | StandingMachine:
        """The object, or the machine, of an instance from 1 on."""
        objects = self.world.objects
        return objects[instance - 1] if instance <= len(objects) else self.machines[instance - 1 - len(objects)]

    def part(self, instance: int, category: str) -> tuple[Array, NDArray[np.int64]]:
        """Vertices (V, 3) [m] and faces (F, 3) of a part in the world's axes."""
        one, key = self.of(instance), (instance, category)
        if isinstance(one, StandingMachine):
            return one.vertices, one.faces
        if key not in self._known:
            made = mesh(one, leaves=self.world.leaves)
            chosen = np.ones(len(made.faces), dtype=bool)
            if category in ("trunk", "crown"):
                leaves = np.isin(made.surfaces, LEAF_SURFACES)
                chosen = leaves if category == "crown" and leaves.any() else ~leaves
            if category == "log_end":
                chosen = made.surfaces == Surface.END_GRAIN
            faces = made.faces[chosen]
            used, numbers = np.unique(faces, return_inverse=True)
            self._known[key] = _above_ground(one, made.vertices[used]), numbers.reshape(-1, 3)
        return self._known[key]


def _above_ground(one: Object, vertices: Array) -> Array:
    """Vertices, those below the ground lifted to it: what is buried is neither seen nor hidden."""
    if isinstance(one, Boulder):
        ground = one.position[2] + one.half_axes[2] - one.above
        return np.column_stack([vertices[:, :2], np.maximum(vertices[:, 2], ground)])
    if isinstance(one, Tree | Stump):
        turn = matrix(one.rotation)
        own = (vertices - np.asarray(one.position)) @ turn
        own[:, 2] = np.maximum(own[:, 2], 0.0)
        return own @ turn.T + np.asarray(one.position)
    return vertices


def labels(picture: Picture, shapes: Shapes, lens: Intrinsics, pose: Array, *, least: int = 12) -> list[Label]:
    """Labels of all parts of objects that a picture shows in ``least`` pixels or more.

    Args:
        picture: What a camera saw.
        shapes: Of the world that it stood in.
        lens: Of the camera.
        pose: (4, 4) from the camera's axes to the world's, in the middle of the picture's exposure.
        least: Pixels.
    """
    category = categories(picture, shapes, lens, pose)
    known = category >= 0
    parts, numbers, counts = np.unique(
        picture.instance[known] * len(CATEGORIES) + category[known], return_inverse=True, return_counts=True
    )
    numbered = np.zeros(category.shape, dtype=np.int32)
    numbered[known] = numbers + 1
    found = []
    for number, window in enumerate(_windows(numbered)):
        if counts[number] >= least:
            instance, kind = divmod(int(parts[number]), len(CATEGORIES))
            mask = np.zeros(category.shape, dtype=bool)
            mask[window] = numbered[window] == number + 1
            found.append(_label(instance, CATEGORIES[kind], mask, window, shapes, lens, pose))
    return found


def _windows(numbered: NDArray[np.int32]) -> list[Any]:
    """Slices of rows and columns around each of the numbers from 1 on."""
    from scipy import ndimage

    windows: Any = ndimage.find_objects(numbered)
    return windows


def categories(picture: Picture, shapes: Shapes, lens: Intrinsics, pose: Array) -> NDArray[np.int64]:
    """(H, W) number of each pixel's category, -1: none."""
    out = np.full(picture.instance.shape, -1)
    rows, columns = np.nonzero(picture.instance > 0)
    ahead = lens.unproject(np.column_stack([columns, rows])) * picture.depth[rows, columns, None]
    places = ahead @ pose[:3, :3].T + pose[:3, 3]
    out[rows, columns] = part_categories(
        picture.instance[rows, columns], picture.class_id[rows, columns], places, shapes
    )
    return out


def part_categories(
    instances: NDArray[np.integer], classes: NDArray[np.integer], places: Array, shapes: Shapes
) -> NDArray[np.int64]:
    """(K,) number of the category of what rays met, -1: none.

    Args:
        instances: (K,)
        classes: (K,) surfaces.
        places: (K, 3) [m] in the world's axes.
        shapes: Of the world.
    """
    out = np.full(len(instances), -1)
    for instance in np.unique(instances[instances > 0]):
        one = shapes.of(int(instance))
        of_it = instances == instance
        if isinstance(one, Branch):
            continue
        if isinstance(one, Tree):
            out[of_it] = CATEGORIES.index("crown")
            wood = np.flatnonzero(of_it & ~np.isin(classes, LEAF_SURFACES))
            out[wood[_on_stem(one, places[wood])]] = CATEGORIES.index("trunk")
        elif isinstance(one, Log):
            out[of_it] = CATEGORIES.index("log")
            out[of_it & (classes == Surface.END_GRAIN)] = CATEGORIES.index("log_end")
        else:
            names = {Stump: "stump", Boulder: "boulder", StandingMachine: "machine"}
            out[of_it] = CATEGORIES.index(names[type(one)])
    return out


def _on_stem(tree: Tree, places: Array) -> NDArray[np.bool_]:
    own = (places - np.asarray(tree.position)) @ matrix(tree.rotation)
    radius = 0.5 * tree.diameter_at(np.clip(own[:, 2], 0.0, tree.height))
    factor, margin = NEAR_STEM
    return np.hypot(own[:, 0], own[:, 1]) <= factor * radius + margin


def _label(
    instance: int,
    category: str,
    mask: NDArray[np.bool_],
    window: tuple[slice, slice],
    shapes: Shapes,
    lens: Intrinsics,
    pose: Array,
) -> Label:
    """The label of a part.

    Args:
        instance: Of the object.
        category: Of the part.
        mask: (H, W) pixels in which it is seen.
        window: Rows and columns around the mask.
        shapes: Of the world.
        lens: Of the camera.
        pose: (4, 4) from the camera's axes to the world's.
    """
    vertices, faces = shapes.part(instance, category)
    own = (vertices - pose[:3, 3]) @ pose[:3, :3]
    ahead = own[:, 2] > NEAREST
    rows, columns = window
    box = (float(columns.start), float(rows.start), float(columns.stop), float(rows.stop))
    full, occlusion = box, 0.0
    if ahead.any():
        pixels = lens.project(np.where(ahead[:, None], own, [0.0, 0.0, 1.0])) + 0.5
        drawn = pixels[ahead]
        low, high = drawn.min(axis=0), drawn.max(axis=0)
        full = (min(box[0], low[0]), min(box[1], low[1]), max(box[2], high[0]), max(box[3], high[1]))
        silhouette = _drawn(pixels, faces[ahead[faces].all(axis=1)], lens) | mask
        occlusion = 1.0 - np.count_nonzero(mask) / np.count_nonzero(silhouette)
    area = (full[2] - full[0]) * (full[3] - full[1])
    inside = (min(full[2], lens.width) - max(full[0], 0.0)) * (min(full[3], lens.height) - max(full[1], 0.0))
    size, location, turn = _box(shapes.of(instance), vertices, pose)
    camera_size, camera_location = _camera_box(own, turn)
    edges: Any = tuple(float(edge) for edge in full)
    return Label(
        instance,
        category,
        mask,
        box,
        edges,
        truncation=1.0 - inside / area,
        occlusion=occlusion,
        size=size,
        location=location,
        turn=turn,
        camera_size=camera_size,
        camera_location=camera_location,
    )


def _drawn(pixels: Array, faces: NDArray[np.int64], lens: Intrinsics) -> NDArray[np.bool_]:
    """(H, W) which pixels triangles cover, by Pillow, which takes corners as whole pixels: those that lie beyond an edge of
    the picture, or are drawn already, are left out."""
    from PIL import Image, ImageDraw

    corners = np.clip(pixels - 0.5, -1e4, 1e4).astype(np.int64)[faces].reshape(-1, 6)
    x, y = corners[:, 0::2], corners[:, 1::2]
    outside = (x < 0).all(axis=1) | (y < 0).all(axis=1) | (x >= lens.width).all(axis=1) | (y >= lens.height).all(axis=1)
    image = Image.new("L", (lens.width, lens.height))
    draw = ImageDraw.Draw(image)
    for triangle in dict.fromkeys(map(tuple, corners[~outside].tolist())):
        draw.polygon(triangle, fill=1)
    return np.asarray(image) > 0


def _box(one: Object | StandingMachine, vertices: Array, pose: Array) -> tuple[Any, Any, float]:
    """Size, location and turn of an upright box around vertices, see :class:`Label`."""
    along = np.array([1.0, 0.0])
    if isinstance(one, Log):
        along = matrix(one.rotation)[:2, 2]
    elif isinstance(one, StandingMachine):
        along = np.array([np.cos(one.heading), np.sin(one.heading)])
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    across = np.array([-along[1], along[0]])
    frame = np.column_stack([vertices[:, :2] @ along, vertices[:, :2] @ across, vertices[:, 2]])
    low, high = frame.min(axis=0), frame.max(axis=0)
    middle = 0.5 * (low + high)
    floor = np.array([*(middle[0] * along + middle[1] * across), low[2]])
    location = (floor - pose[:3, 3]) @ pose[:3, :3]
    heading = np.array([*along, 0.0]) @ pose[:3, :3]
    size = tuple(float(edge) for edge in high - low)
    return size, tuple(float(x) for x in location), float(-np.arctan2(heading[2], heading[0]))


def _camera_box(own: Array, turn: float) -> tuple[Any, Any]:
    """Size and location in the camera's axes of a box around vertices (V, 3) of these axes, see :class:`Label`."""
    along, across = np.array([np.cos(turn), 0.0, -np.sin(turn)]), np.array([np.sin(turn), 0.0, np.cos(turn)])
    frame = np.column_stack([own @ along, own @ across, own[:, 1]])
    low, high = frame.min(axis=0), frame.max(axis=0)
    middle = 0.5 * (low + high)
    location = middle[0] * along + middle[1] * across + np.array([0.0, high[2], 0.0])
    return tuple(float(edge) for edge in high - low), tuple(float(x) for x in location)
