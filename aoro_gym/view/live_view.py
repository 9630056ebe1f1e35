"""Live twins, or a replay, on a page with controls, and the loop that keeps it up to date."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from aoro_gym.view.camera_picture import CameraPicture
from aoro_gym.view.changes import Changes
from aoro_gym.view.gamepad import BRAKE, FASTER_GEAR, PAUSE, RESTART, SLOWER_GEAR, Gamepad
from aoro_gym.view.lidar_cloud import LidarCloud
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.page import FRAME, TwinPage
from aoro_gym.view.panel import Driving, TimeControls, Timeline
from aoro_gym.view.replay import Replay
from aoro_gym.view.ruts import RutMarks

RUTS_EVERY = 0.5
"""Time [s] between two pictures of the ruts."""


class LiveView:
    """Live twins, or a replay, on a page.

    Args:
        server: From :func:`aoro_gym.view.server.start`.
        twins: What is shown and driven.
        names: Of the machines.
        driver: What the twins' driver is called.
        gamepad: File of a gamepad that drives, too, see :mod:`aoro_gym.view.gamepad`; not for a replay.
        lidar: On the first machine.
        camera: Likewise.

    Raises OSError if the gamepad's file cannot be opened.
    """

    def __init__(
        self,
        server: Any,
        twins: LiveTwins | Replay,
        names: Sequence[str],
        driver: str | None = None,
        *,
        gamepad: Path | None = None,
        lidar: LidarCloud | None = None,
        camera: CameraPicture | None = None,
    ):
        self.server, self.twins, self.lidar, self.camera = server, twins, lidar, camera
        self._restart = False
        self.clock = TimeControls(server.gui, self._ask_restart)
        replay = isinstance(twins, Replay)
        self.driving = None if replay else Driving(server.gui, driver, crane=twins.twin.has_crane)
        self.gamepad = None if gamepad is None or replay else Gamepad(gamepad, self._press)
        self.changes = None if replay else Changes(server.gui, twins.machines, names)
        self.timeline = Timeline(server.gui, twins.duration, twins.seek) if replay else None
        self.page = TwinPage(server, twins, twins.machines, names)
        self.ruts = (
            None if isinstance(twins, Replay) or twins.twin.soil is None else RutMarks(server.scene, twins.ground)
        )
        self._ruts_due = 0.0
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
            for name, value in ({} if self.gamepad is None else self.gamepad.changes()).items():
                self.driving.put(name, value)
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
        if duration and not self.twins.frozen:
            self.twins.advance(duration)
            self._simulated += duration
        if self.server.get_clients():
            self.draw()

    def _press(self, button: int) -> None:
        """Do what a button of the gamepad is for."""
        assert self.driving is not None
        if button in (SLOWER_GEAR, FASTER_GEAR):
            self.driving.shift(1 if button == FASTER_GEAR else -1)
        elif button == BRAKE:
            self.driving.toggle_brake()
        elif button == PAUSE:
            self.clock.toggle()
        elif button == RESTART:
            self._ask_restart()

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
        for sensor in (self.lidar, self.camera):
            if sensor is not None:
                sensor.show(self.twins.time, self.twins.poses()[0])
        if not self.page.draw(with_forces=with_forces):
            return
        now = time.monotonic()
        if self.ruts is not None and not isinstance(self.twins, Replay) and now >= self._ruts_due:
            self.ruts.show(self.twins.ruts())
            self._ruts_due = now + RUTS_EVERY
        if now - self._since > 0.9:
            self._reached, self._simulated, self._since = self._simulated / (now - self._since), 0.0, now
        frozen = self.twins.frozen
        note = f"; **the twin is frozen**, {frozen}: restart" if frozen else ""
        self.clock.show(self.twins.time, self._reached, note)
        if self.timeline is not None:
            self.timeline.show(self.twins.time)

    def _ask_restart(self) -> None:
        self._restart = True
