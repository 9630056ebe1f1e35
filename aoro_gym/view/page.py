"""A page for twins that somebody else advances: those of an environment, or of a server."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Protocol

from aoro_gym.machine import Machine
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.twin import Twin
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.panel import Gauges
from aoro_gym.view.poses import Floats, Pose
from aoro_gym.view.scene import Ground, draw_path, nearest_heights
from aoro_gym.view.server import GAUGES_EVERY, HOST, MachineScene, start, stop


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


class TwinPage:
    """Twins, their tire forces and gauges, in the browser.

    Args:
        twins: Somebody else's; they are looked at only.
        machines: Of those that are shown.
        names: Of these.
        port: Of the page on 127.0.0.1; 0: any free one.

    Raises ValueError if viser is missing, OSError if the port is taken.
    """

    def __init__(self, twins: Shown, machines: Sequence[Machine], names: Sequence[str] = ("",), port: int = 0):
        self.server = start(port)
        self._twins = twins
        self._scene = MachineScene(self.server, machines, names)
        self._gauges = Gauges(self.server.gui, names)
        self._drawn: tuple[Any, Any] = (None, None)
        self._nodes: list[Any] = []
        self.frames = 0
        """Pictures so far."""
        self._due = 0.0

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{HOST}:{self.server.get_port()}"

    def surround(self, terrain: Plane | Terrain, path: Path | None) -> None:
        """Draw the ground and the path, if they are others than those that are drawn."""
        if self._drawn[0] is terrain and self._drawn[1] is path:
            return
        for node in self._nodes:
            node.remove()
        self._nodes = [Ground(self.server.scene, terrain).node]
        if path is not None:
            self._nodes.append(draw_path(self.server.scene, path, nearest_heights(terrain, path.points)))
        self._drawn = terrain, path

    def show(self, period: float) -> None:
        """Send what is now, and wait until ``period`` [s] has passed since the last time."""
        if self.server.get_clients():
            forces = self._twins.forces() if self._scene.shows_forces else None
            with self.server.atomic():
                self._scene.show(self._twins.poses(), forces)
            if self.frames % GAUGES_EVERY == 0:
                self._gauges.show(self._twins.time, self._twins.readings())
            self.frames += 1
        now = time.monotonic()
        self._due = max(self._due + period, now)
        time.sleep(max(self._due - now, 0.0))

    def close(self) -> None:
        """Close the page."""
        stop(self.server)


def page_of(twin: Twin, names: Sequence[str] = ("",), port: int = 0) -> TwinPage:
    """A page of as many of the first twins as there are ``names``."""
    several = twin.machine.num_variants > 1
    machines = [twin.machine.variant(i) if several else twin.machine for i in range(len(names))]
    return TwinPage(LiveTwins(twin, machines), machines, names, port)
