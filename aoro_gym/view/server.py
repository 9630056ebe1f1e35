"""The page in the browser, and the loop that keeps it up to date."""

from __future__ import annotations

import contextlib
import io
import math
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

from aoro_gym.checks import check_integer
from aoro_gym.machine import Machine
from aoro_gym.view.changes import Changes
from aoro_gym.view.extras import viser
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.panel import Driving, Gauges, TimeControls, Timeline
from aoro_gym.view.poses import Pose
from aoro_gym.view.replay import Replay
from aoro_gym.view.scene import WORLD, MachineNodes, tints

HOST = "127.0.0.1"
"""Nobody else may look, or drive."""
FRAME = 0.03
"""Time [s] between two pictures."""
GAUGES_EVERY = 7
"""Pictures between two looks at the gauges: five times a second."""
CAMERA, LOOK_AT = (-6.5, -7.0, 4.2), (0.4, 0.0, 0.9)
"""Where the camera begins and what it looks at [m], from the hinge; x is ahead at first."""


def start(port: int, label: str = "AORO") -> Any:
    """A server of viser on ``HOST``.

    Raises ValueError if viser is missing, and OSError if the port is taken.
    """
    check_integer("port", port, ge=0, le=65535)
    library = viser()
    free = _free_port(port)
    with contextlib.redirect_stdout(io.StringIO()):  # its own banner
        server = library.ViserServer(host=HOST, port=free, label=label, verbose=False)
    server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
    server.scene.configure_default_lights(True, cast_shadow=False)
    server.scene.world_axes.visible = False
    server.scene.add_frame(WORLD, show_axes=False)
    server.initial_camera.position, server.initial_camera.look_at = CAMERA, LOOK_AT
    return server


def stop(server: Any) -> None:
    """Close the page; viser's own word about it is left out."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _free_port(port: int) -> int:
    """``port``, if it can be bound, or any free one for 0; viser itself would take the next one without a word."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise OSError(
                error.errno, f"port is {port}, but cannot be bound on {HOST}: {error.strerror}; choose another, or 0"
            ) from None
        return int(probe.getsockname()[1])


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


class LiveView:
    """Live twins, or a replay, on a page.

    Args:
        server: From :func:`start`.
        twins: What is shown and driven.
        names: Of the machines.
        driver: What the twins' driver is called.
    """

    def __init__(self, server: Any, twins: LiveTwins | Replay, names: Sequence[str], driver: str | None = None):
        self.server, self.twins = server, twins
        self.frames = 0
        """Pictures so far."""
        self._restart = False
        self.clock = TimeControls(server.gui, self._ask_restart)
        replay = isinstance(twins, Replay)
        self.driving = None if replay else Driving(server.gui, driver)
        self.changes = None if replay else Changes(server.gui, twins.machines, names)
        self.timeline = Timeline(server.gui, twins.duration, twins.seek) if replay else None
        self.scene = MachineScene(server, twins.machines, names)
        self.gauges = Gauges(server.gui, names)
        self._simulated, self._since = 0.0, time.monotonic()
        self._reached = 0.0
        twins.settle()
        self.draw(with_forces=False)

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Keep the page up to date, in real time where the computer can, until ``stopped`` or Ctrl-C."""
        due = time.monotonic()
        while not stopped():
            self.frame()
            due += FRAME
            left = due - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            else:  # what was missed is not caught up with
                due -= left

    def frame(self) -> None:
        """One picture: what has happened since the last one, and what the page asks for."""
        if self._restart:
            self._restart = False
            if self.driving is not None:
                self.driving.rest()
            self.twins.restart()
        if self.driving is not None:
            self.twins.commands = self.driving.commands
            if self.driving.driver is not None:
                self.twins.driven = bool(self.driving.driver.value)
        self._change()
        duration = 0.0
        if not self.clock.paused:
            duration = FRAME * self.clock.speed
        elif self.clock.steps:
            self.clock.steps -= 1
            duration = FRAME
        if duration and not self.twins.diverged:
            self.twins.advance(duration)
            self._simulated += duration
        if self.server.get_clients():
            self.draw()

    def _change(self) -> None:
        """Give the twins the machine that a person asks for."""
        asked = None if self.changes is None else self.changes.take()
        if asked is None or self.changes is None or isinstance(self.twins, Replay):
            return
        try:
            self.twins.change(*asked)
        except ValueError as error:
            self.changes.say(str(error))

    def draw(self, *, with_forces: bool = True) -> None:
        """Send what is now."""
        forces = self.twins.forces() if with_forces and self.scene.shows_forces else None
        with self.server.atomic():
            self.scene.show(self.twins.poses(), forces)
        if self.frames % GAUGES_EVERY == 0:
            now = time.monotonic()
            if now - self._since > 0.9:
                self._reached, self._simulated, self._since = self._simulated / (now - self._since), 0.0, now
            note = "; **the simulation has diverged**: restart" if self.twins.diverged else ""
            self.clock.show(self.twins.time, self._reached, note)
            if self.timeline is not None:
                self.timeline.show(self.twins.time)
            self.gauges.show(self.twins.time, self.twins.readings())
        self.frames += 1

    def _ask_restart(self) -> None:
        self._restart = True
