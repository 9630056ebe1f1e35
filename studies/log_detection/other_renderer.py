"""Pictures of another make: other woods, drawn by MuJoCo's OpenGL renderer, with boxes from its segmentation.

Nothing of these pictures comes from this project's forests, textures or ray caster: stems are straight tapered cylinders,
crowns ellipsoids, logs cylinders with discs as ends, colours and speckles are drawn anew in each wood, light is OpenGL's
with shadow maps. They stand for pictures of a domain that the detector was not made for; they are no photographs. Rendering
needs MuJoCo and OpenGL without a window (``MUJOCO_GL=egl`` or ``osmesa``).
"""

# MuJoCo takes its names from a compiled module at run time.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_json, written_whole
from aoro_gym.sensors.dataset.formats import run_lengths
from studies.log_detection.pictures import CANVAS, CLASSES

VIEWS = 4
"""Pictures of a wood."""
LEAST = 12
"""Pixels that an object must be seen in, as in the project's data sets."""
REACH = 30.0
"""Half the side of a wood [m]."""


class _Wood:
    """Geoms of MuJoCo, and which part of which object each is."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng
        self.geoms: list[str] = []
        self.parts: dict[str, tuple[int, str]] = {}
        self.bark = rng.uniform([0.15, 0.11, 0.08], [0.5, 0.42, 0.36])
        self.leaf = rng.uniform([0.08, 0.2, 0.05], [0.4, 0.5, 0.2])
        self.number = 0

    def add(self, kind: str, part: str | None, material: str, colour: NDArray[Any], **places: Any) -> None:
        """A geom; of an object that is counted in ``number`` where it is part of one."""
        name = f"g{len(self.geoms)}"
        words = " ".join(f'{key}="{" ".join(f"{x:.4f}" for x in np.ravel(value))}"' for key, value in places.items())
        rgba = " ".join(f"{x:.3f}" for x in np.clip(colour, 0.0, 1.0))
        self.geoms.append(f'<geom name="{name}" type="{kind}" material="{material}" rgba="{rgba} 1" {words}/>')
        if part is not None:
            self.parts[name] = self.number, part

    def tree(self, x: float, y: float) -> None:
        rng, self.number = self.rng, self.number + 1
        height, radius = rng.uniform(8.0, 20.0), rng.uniform(0.06, 0.25)
        lean = rng.normal(0.0, 0.03, 2) * height
        foot, colour = np.array([x, y, -0.3]), self.bark * rng.uniform(0.7, 1.3)
        for low, high, share in ((0.0, 0.35, 1.0), (0.35, 0.7, 0.8), (0.7, 1.0, 0.45)):
            ends = [foot + share_at * np.array([*lean, height]) for share_at in (low, high)]
            self.add("cylinder", "trunk", "bark", colour, fromto=ends, size=radius * share)
        for at in rng.uniform(rng.uniform(0.25, 0.6), 1.0, 5):
            size = rng.uniform(0.5, 1.6, 2) * (1.3 - at)
            middle = foot + at * np.array([*lean, height]) + [*rng.normal(0.0, 0.3, 2), 0.0]
            self.add("ellipsoid", None, "leaf", self.leaf * rng.uniform(0.6, 1.3), pos=middle, size=[*size, 0.9])

    def log(self, middle: NDArray[Any], heading: float, length: float, radius: float, colour: NDArray[Any]) -> None:
        self.number += 1
        along = np.array([np.cos(heading), np.sin(heading), 0.0])
        ends = [middle - 0.5 * length * along, middle + 0.5 * length * along]
        self.add("cylinder", "log", "bark", colour, fromto=ends, size=radius)
        face = self.rng.uniform([0.6, 0.45, 0.28], [0.9, 0.75, 0.55])
        for sign, end in ((-1.0, ends[0]), (1.0, ends[1])):
            disc = [end - 0.01 * along, end + sign * 0.012 * along]
            self.add("cylinder", "log_end", "plain", face, fromto=disc, size=0.97 * radius)

    def lying(self, x: float, y: float) -> None:
        """A log, or a pile."""
        rng = self.rng
        heading, length, radius = rng.uniform(0.0, np.pi), rng.uniform(2.0, 5.0), rng.uniform(0.08, 0.18)
        rows = int(rng.integers(2, 4)) if rng.random() < 0.5 else 1
        aside = np.array([-np.sin(heading), np.cos(heading), 0.0])
        for row in range(rows):
            for place in range(rows - row):
                middle = np.array([x, y, radius * (0.9 + 1.75 * row)]) + (2.05 * place + row) * radius * aside
                end = middle + rng.uniform(-0.15, 0.15) * np.array([np.cos(heading), np.sin(heading), 0.0])
                self.log(end, heading, length, radius * rng.uniform(0.85, 1.0), self.bark * rng.uniform(0.7, 1.3))

    def stump(self, x: float, y: float) -> None:
        rng, self.number = self.rng, self.number + 1
        radius, height = rng.uniform(0.1, 0.3), rng.uniform(0.15, 0.5)
        colour = self.bark * rng.uniform(0.7, 1.2)
        self.add("cylinder", "stump", "bark", colour, fromto=[x, y, -0.1, x, y, height], size=radius)
        face = rng.uniform([0.55, 0.42, 0.28], [0.9, 0.75, 0.55])
        self.add("cylinder", "stump", "plain", face, fromto=[x, y, height, x, y, height + 0.01], size=radius)

    def clutter(self, x: float, y: float) -> None:
        """A bush or a boulder."""
        rng = self.rng
        leafy = rng.random() < 0.7
        colour = self.leaf * rng.uniform(0.6, 1.4) if leafy else np.full(3, rng.uniform(0.25, 0.6))
        size = rng.uniform(0.1, 0.5, 3)
        self.add("ellipsoid", None, "leaf" if leafy else "plain", colour, pos=[x, y, 0.4 * size[2]], size=size)


def _xml(wood: _Wood, size: tuple[int, int]) -> str:
    rng = wood.rng
    ground = rng.uniform([0.12, 0.14, 0.06], [0.5, 0.42, 0.3]) if rng.random() < 0.8 else rng.uniform(0.75, 0.95, 3)
    sky, glow = rng.uniform([0.4, 0.5, 0.6], [0.9, 0.95, 1.0]), rng.uniform(0.6, 1.0, 3)
    sun = np.array([*rng.normal(0.0, 1.0, 2), -rng.uniform(0.6, 2.0)])
    ambient, diffuse = rng.uniform(0.35, 0.7), rng.uniform(0.4, 0.9)

    def triple(values: Any) -> str:
        return " ".join(f"{x:.3f}" for x in np.broadcast_to(values, 3))

    marks = f'markrgb="{triple(0.6 * ground)}" random="{rng.uniform(0.05, 0.4):.2f}"'
    speckled = 'type="2d" builtin="flat" mark="random" width="128" height="128"'
    return f"""<mujoco><visual><global offwidth="{size[1]}" offheight="{size[0]}" fovy="{rng.uniform(45.0, 65.0):.1f}"/>
<headlight ambient="{triple(ambient)}" diffuse="0.1 0.1 0.1" specular="0 0 0"/><quality shadowsize="2048"/>
<map fogstart="1" fogend="{rng.uniform(2.0, 6.0):.2f}" znear="0.005" zfar="4"/><rgba fog="{triple(sky)} 1"/></visual>
<statistic extent="20" center="0 0 0"/>
<asset><texture type="skybox" builtin="gradient" rgb1="{triple(sky)}" rgb2="{triple(glow)}" width="64" height="64"/>
<texture name="soil" {speckled} rgb1="{triple(ground)}" {marks}/>
<texture name="skin" {speckled} rgb1="1 1 1" markrgb="0.5 0.5 0.5" random="{rng.uniform(0.0, 0.4):.2f}"/>
<material name="soil" texture="soil" texrepeat="{rng.uniform(6.0, 25.0):.1f} {rng.uniform(6.0, 25.0):.1f}"/>
<material name="bark" texture="skin" specular="0.1"/><material name="leaf" texture="skin" texrepeat="2 2" specular="0"/>
<material name="plain" specular="0.1"/></asset>
<worldbody><light directional="true" castshadow="true" dir="{triple(sun)}" pos="0 0 30" diffuse="{triple(diffuse)}"/>
<geom type="plane" size="{2 * REACH} {2 * REACH} 1" material="soil"/>{"".join(wood.geoms)}</worldbody></mujoco>"""


def wood(seed: int, size: tuple[int, int]) -> tuple[Any, dict[str, tuple[int, str]], list[NDArray[Any]]]:
    """A model of MuJoCo for pictures of a size, object and part of its geoms by name, and where logs lie (x, y)."""
    rng = np.random.default_rng([seed, 77])
    made = _Wood(rng)
    lying = [rng.uniform(-0.6 * REACH, 0.6 * REACH, 2) for _ in range(int(rng.integers(8, 16)))]
    for place in lying:
        made.lying(*place)
    for x, y in rng.uniform(-REACH, REACH, (int(rng.integers(60, 180)), 2)):
        if min(np.hypot(*(place - [x, y])) for place in lying) > 1.5:
            made.tree(x, y)
    for x, y in rng.uniform(-REACH, REACH, (int(rng.integers(20, 60)), 2)):
        made.stump(x, y)
    for x, y in rng.uniform(-REACH, REACH, (int(rng.integers(50, 200)), 2)):
        made.clutter(x, y)
    import mujoco

    return mujoco.MjModel.from_xml_string(_xml(made, size)), made.parts, lying


def _labels(geoms: NDArray[np.int32], parts: dict[int, tuple[int, str]]) -> list[tuple[str, NDArray[np.bool_]]]:
    """Category and mask of each part of each object that is seen in enough pixels; ``geoms`` (H, W), -1: none."""
    found: dict[tuple[int, str], NDArray[np.bool_]] = {}
    for geom in np.unique(geoms):
        if geom in parts:
            key = parts[geom]
            mask = geoms == geom
            if key[1] == "log_end":  # both ends of a log are two
                found[(int(1e6 + geom), "log_end")] = mask
            else:
                found[key] = found.get(key, np.zeros_like(mask)) | mask
    return [(name, mask) for (_, name), mask in found.items() if mask.sum() >= LEAST]


def _looking(model: Any, rng: np.random.Generator, lying: list[NDArray[Any]]) -> Any:
    """A camera some metres before a log."""
    import mujoco

    place = lying[int(rng.integers(len(lying)))]
    camera = mujoco.MjvCamera()
    away, height = rng.uniform(3.0, 9.0), rng.uniform(1.5, 2.8)
    camera.azimuth = float(rng.uniform(0.0, 360.0))
    camera.lookat[:] = [*(place + rng.normal(0.0, 0.8, 2)), rng.uniform(0.3, 1.2)]
    camera.distance = float(np.hypot(away, height))
    camera.elevation = -float(np.degrees(np.arctan2(height - camera.lookat[2], away)))
    return camera


def make(
    folder: Path,
    count: int,
    seed: int = 0,
    *,
    size: tuple[int, int] = CANVAS,
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Make pictures and their COCO file, which is returned.

    Args:
        folder: Where to.
        count: Of pictures.
        seed: Of the first wood.
        size: Height and width [pixels].
        progress: Told the share that is done.
    """
    import mujoco
    from PIL import Image

    file = folder / "annotations.json"
    if file.exists():
        return file
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number in range(count):
        if number % VIEWS == 0:
            model, names, lying = wood(seed + number // VIEWS, size)
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            parts = {model.geom(name).id: part for name, part in names.items()}
            rng = np.random.default_rng([seed + number // VIEWS, 78])
            foggy = rng.random() < 0.3
            renderer = mujoco.Renderer(model, *size)
        camera = _looking(model, rng, lying)
        renderer.update_scene(data, camera)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = foggy
        pixels = renderer.render().copy()
        renderer.enable_segmentation_rendering()
        segments = renderer.render()
        renderer.disable_segmentation_rendering()
        geoms = np.where(segments[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, segments[..., 0], -1)
        name = f"{number:06d}.png"
        with written_whole(folder / "images" / name) as temporary:
            Image.fromarray(pixels).save(temporary)
        one = {"id": number, "file_name": name, "height": size[0], "width": size[1]}
        images.append({**one, "world_seed": seed + number // VIEWS})
        for category, mask in _labels(geoms, parts):
            rows, columns = np.nonzero(mask)
            x, y = int(columns.min()), int(rows.min())
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": number,
                    "category_id": CLASSES.index(category) + 1,
                    "bbox": [x, y, int(columns.max()) + 1 - x, int(rows.max()) + 1 - y],
                    "area": int(mask.sum()),
                    "iscrowd": 0,
                    "segmentation": {"size": list(size), "counts": run_lengths(mask)},
                }
            )
        if number % VIEWS == VIEWS - 1 or number == count - 1:
            renderer.close()
        if progress is not None:
            progress((number + 1) / count)
    categories = [{"id": place, "name": name} for place, name in enumerate(CLASSES, start=1)]
    write_json(file, {"images": images, "annotations": annotations, "categories": categories})
    return file
