"""What a stereo camera on the first machine sees, as a picture in the panel."""

from __future__ import annotations

import os
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice
from aoro_gym.execution import devices
from aoro_gym.machine.kinematics import Pose
from aoro_gym.sensors.camera import MODELS, Appearance, StereoCamera, daylight
from aoro_gym.sensors.camera.kernels.render import render
from aoro_gym.sensors.camera.rendering import BLOCK_DIM
from aoro_gym.sensors.lidar import Motion
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.world import World
from aoro_gym.view.lidar_cloud import angles, colours, meshed

EVERY = 0.25
"""Time [s] between two pictures at least."""
WIDTH = 160
"""[pixels] of a picture, of which two lie side by side in a panel of 320."""
SAMPLES, SKY_RAYS = 1, 1
"""Of a pixel: a person sees at once, and noise matters less."""
NICENESS = 10
"""Of the threads that render: the page comes first."""
HORIZON_DEG = 6.0
"""Mean elevation of the far tree line round a scanned ground, as round a world."""
SKY = (235, 240, 245)
"""Colour of what has no depth."""


class CameraPicture:
    """The left picture of a stereo camera and its depths, rendered beside the view by threads of their own.

    The camera stands still within a picture, in the light of a summer's morning. Depths are true ones.

    Args:
        server: From :func:`aoro_gym.view.server.start`.
        ground: What it sees, and nothing else; of a world its objects, too.
        model: Name among :data:`aoro_gym.sensors.camera.MODELS`; its pictures are made :data:`WIDTH` wide.

    Raises ValueError for an unknown model.
    """

    def __init__(self, server: Any, ground: Terrain | Plane | World, model: str):
        check_choice("camera model", model, MODELS)
        scene, appearance = _seen(ground)
        small = MODELS[model].resized(WIDTH)
        self._camera = StereoCamera(scene, appearance, daylight(), small, samples=SAMPLES, sky_rays=SKY_RAYS)
        with devices.compiling(render, devices.find("cpu"), BLOCK_DIM):  # now, as a view would stand still meanwhile
            self._camera.take_left(Motion.still((*scene.extent[1][:2], scene.extent[1][2] + 1.0)))
        empty = np.zeros((small.intrinsics.height, 2 * WIDTH, 3), dtype=np.uint8)
        with server.gui.add_folder("Camera"):
            self._wanted = server.gui.add_checkbox(model, True, hint="below the cab's roof; does not see the machine")
            self._image = server.gui.add_image(empty, label="colour | depth to 40 m", format="jpeg", visible=False)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="camera", initializer=_stand_back)
        self._rendering: Future[NDArray[np.uint8] | None] | None = None
        self._seen: float | None = None  # simulated time [s] of the last picture
        self._due = 0.0
        self.pictures = 0
        """Shown so far."""

    def show(self, time_s: float, pose: Pose) -> None:
        """Show the picture that is ready, and begin another one where it is asked for and time has gone on.

        Args:
            time_s: Simulated [s].
            pose: Of the machine that carries it.
        """
        if not self._wanted.value:
            self._image.visible, self._seen = False, None
            return
        if self._rendering is not None and self._rendering.done():
            image, self._rendering = self._rendering.result(), None
            self._image.visible = image is not None
            if image is not None:
                self._image.image = image
                self.pictures += 1
        now = time.monotonic()
        if self._rendering is None and now >= self._due and time_s != self._seen:
            self._seen, self._due = time_s, now + EVERY
            self._rendering = self._worker.submit(self.take, pose, self.pictures)

    def take(self, pose: Pose, number: int = 0) -> NDArray[np.uint8] | None:
        """Colours, and beside them depths as colours, (H, 2 :data:`WIDTH`, 3); None where the camera lies in something."""
        roll, pitch, yaw = angles(pose)
        try:
            [picture] = self._camera.take_left(
                Motion.still(pose.position, roll=roll, pitch=pitch, yaw=yaw), number=number
            )
        except ValueError:
            return None
        depths = colours(picture.depth)
        depths[np.isinf(picture.depth)] = SKY
        return np.concatenate([picture.rgb, depths], axis=1)


def _seen(ground: Terrain | Plane | World) -> tuple[Scene, Appearance]:
    """What rays meet and how it looks: a plane as asphalt, a scanned ground as a forest's; crowns without twigs."""
    if isinstance(ground, World):
        return Scene.of_world(ground), Appearance.of_world(ground)
    looks = replace(Appearance.of_surfaces(), horizon_deg=HORIZON_DEG)
    if isinstance(ground, Plane):
        of = [Surface.ASPHALT]
        looks = replace(looks, albedo=looks.albedo[of], texture=looks.texture[of])
    return Scene.of_terrain(meshed(ground)), looks


def _stand_back() -> None:
    """Let the other threads go first, where threads have a priority of their own."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
