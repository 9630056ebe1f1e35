"""A page in the browser that shows twins, whoever advances them."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Floats, Pose
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.panel import Gauges
from aoro_gym.view.scene import WORLD, Ground, MachineNodes, draw_path, nearest_heights, tints
from aoro_gym.view.server import HOST, start, stop

FRAME = 0.03
"""Time [s] between two pictures."""
GAUGES_EVERY = 7
"""Pictures between two looks at the gauges: five times a second."""


class Shown(Protocol):
    """Twins that a page looks at, such as :class:`~aoro_gym.view.live.LiveTwins`."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        ...

    def poses(self) -> list[Pose]:
        """Where the machines are."""
        ...

    def forces(self) -> tuple[Floats, Floats]:
        """Contact points [m] and forces [N] of their tires, (machines, 4, 3)."""
        ...

    def readings(self) -> list[dict[str, float]]:
        """Outputs of each machine, SI."""
        ...


class MachineScene:
    """Machines in a scene, and the camera that follows the first one."""

    def __init__(self, server: Any, machines: Sequence[Machine], names: Sequence[str]):
        self._world = server.scene.add_frame(WORLD, show_axes=False)
        self._machines = [
            MachineNodes(server.scene, f"machine_{i}", machine, tint)
            for i, (machine, tint) in enumerate(zip(machines, tints(len(machines)), strict=True))
        ]
        self._labels = []
        if len(names) > 1:
            self._labels = [server.scene.add_label(f"{WORLD}/machine_{i}/name", name) for i, name in enumerate(names)]
            for label in self._labels:
                label.position = (0.0, 0.0, 3.2)
        with server.gui.add_folder("View"):
            self._follow = server.gui.add_checkbox("follow", True)
            self._turn = server.gui.add_checkbox("turn with the machine", False)
            self._forces = server.gui.add_checkbox("tire forces", True, hint="1 m is 12.5 kN")
            shadows = server.gui.add_checkbox("shadows", False, hint="takes a graphics card")
        shadows.on_update(lambda _: server.scene.configure_default_lights(True, cast_shadow=shadows.value))

    @property
    def shows_forces(self) -> bool:
        """Whether forces are asked for."""
        return bool(self._forces.value)

    def show(self, poses: Sequence[Pose], forces: tuple[Any, Any] | None) -> None:
        """Move everything to ``poses``, with contact points and forces (machines, 4, 3)."""
        for i, (nodes, pose) in enumerate(zip(self._machines, poses, strict=True)):
            nodes.show(pose)
            nodes.set_forces_visible(forces is not None)
            if forces is not None:
                nodes.show_forces(forces[0][i], forces[1][i])
        if self._follow.value:
            first = poses[0]
            yaw = -first.heading if self._turn.value else 0.0
            s, c = math.sin(yaw), math.cos(yaw)
            x, y, z = first.position
            self._world.position = (-(c * x - s * y), -(s * x + c * y), -z)
            self._world.wxyz = (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))


class TwinPage:
    """Twins, their tire forces and gauges, in the browser.

    Args:
        server: From :func:`~aoro_gym.view.server.start`.
        twins: Somebody else's; they are looked at only.
        machines: Of those that are shown.
        names: Of these.
    """

    def __init__(self, server: Any, twins: Shown, machines: Sequence[Machine], names: Sequence[str] = ("",)):
        self.server = server
        self._twins = twins
        self._scene = MachineScene(server, machines, names)
        self._gauges = Gauges(server.gui, names)
        self._axles = [float(np.max(machine.frame.front.axle_distance)) for machine in machines]
        self._drawn: tuple[Any, Any] = (None, None)
        self._nodes: list[Any] = []
        self.frames = 0
        """Pictures so far."""
        self._due = 0.0

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{HOST}:{self.server.get_port()}"

    def surround(self, terrain: Plane | Terrain | World, path: Path | None, colours: Floats | None = None) -> None:
        """Draw the ground, in ``colours`` (V, 3) of its points where there are any, and the path, if they are others than
        those that are drawn."""
        if self._drawn[0] is terrain and self._drawn[1] is path:
            return
        for node in self._nodes:
            node.remove()
        self._nodes = [Ground(self.server.scene, terrain, colours).node]
        if path is not None:
            self._nodes.append(draw_path(self.server.scene, path, nearest_heights(terrain, path.points)))
        self._drawn = terrain, path

    def draw(self, *, with_forces: bool = True) -> bool:
        """Send what is now; whether the gauges were looked at, too."""
        forces = self._twins.forces() if with_forces and self._scene.shows_forces else None
        with self.server.atomic():
            self._scene.show(self._twins.poses(), forces)
        due = self.frames % GAUGES_EVERY == 0
        if due:
            self._gauges.show(self._twins.time, self._readings())
        self.frames += 1
        return due

    def _readings(self) -> list[dict[str, float]]:
        """Outputs of each machine, and how far it is off the path, if there is one."""
        readings, path = self._twins.readings(), self._drawn[1]
        if path is None:
            return readings
        return [
            one | {"cross_track": cross_track(path, pose, axle)}
            for one, pose, axle in zip(readings, self._twins.poses(), self._axles, strict=True)
        ]

    def show(self, period: float) -> None:
        """Send what is now, if anybody looks, and wait until ``period`` [s] has passed since the last time."""
        if self.server.get_clients():
            self.draw()
        now = time.monotonic()
        self._due = max(self._due + period, now)
        time.sleep(max(self._due - now, 0.0))

    def close(self) -> None:
        """Close the page."""
        stop(self.server)


def cross_track(path: Path, pose: Pose, axle: float) -> float:
    """Distance [m] of the middle of the front axle, ``axle`` [m] before the hinge, from the path's nearest point; positive
    to the left of the path."""
    w, x, y, z = pose.wxyz
    ahead = np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)])
    return float(path.project(pose.position[:2] + axle * ahead)[1])


def page_of(twin: Twin, names: Sequence[str] = ("",), port: int = 0) -> TwinPage:
    """A page, on a server of its own, of as many of the first twins as there are ``names``.

    Raises ValueError if viser is missing, OSError if the port is taken.
    """
    several = twin.machine.num_variants > 1
    machines = [twin.machine.variant(i) if several else twin.machine for i in range(len(names))]
    return TwinPage(start(port), LiveTwins(twin, machines), machines, names)
