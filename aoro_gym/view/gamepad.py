"""A gamepad of this computer, read from its joystick device: viser's pages do not tell of gamepads.

Events of Linux's joystick interface (``linux/joystick.h``) have eight bytes: time [ms], value, type, number. Numbers are
those of the driver ``xpad``, which most gamepads follow: axes 0 the left stick to the right, 2 and 5 the left and right
trigger; buttons 0 A, 1 B, 4 and 5 the shoulders, 7 start.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path

EVENT = struct.Struct("<IhBB")
BUTTON, AXIS, INITIAL = 0x01, 0x02, 0x80
"""Types; a device tells its state when it is opened, and marks that."""
FULL = 32767
"""Value of an axis at its end."""
STICK, LEFT_TRIGGER, RIGHT_TRIGGER = 0, 2, 5
SLOWER_GEAR, FASTER_GEAR, PAUSE, BRAKE, RESTART = 4, 5, 0, 1, 7
DEAD_BAND = 0.08
"""Share of an axis that is taken for its rest. (E)"""
MOST_EVENTS = 256
"""That are read at once."""
DEVICES = "/dev/input/js*"


class Gamepad:
    """Signals and buttons of a gamepad.

    Args:
        file: Its device, such as ``/dev/input/js0``.
        on_button: Called with the number of each button that goes down.

    Raises OSError if the device cannot be opened.
    """

    def __init__(self, file: Path, on_button: Callable[[int], None] = lambda _: None):
        self.file = file
        self._on_button = on_button
        self._axes = {STICK: 0.0, LEFT_TRIGGER: -1.0, RIGHT_TRIGGER: -1.0}
        self._told: dict[str, float] = {}
        self._device: int | None = os.open(file, os.O_RDONLY | os.O_NONBLOCK)

    @property
    def connected(self) -> bool:
        """Whether it is still there."""
        return self._device is not None

    def changes(self) -> dict[str, float]:
        """Commands that the sticks have moved since the last call, by name; nothing of those that rest.

        A gamepad that was unplugged lets the machine go: its signals are zero once, and it is connected no more.
        """
        if self._device is None:
            return {}
        try:
            content = os.read(self._device, MOST_EVENTS * EVENT.size)
        except BlockingIOError:
            return {}
        except OSError:
            content = b""
        if not content:
            self.close()
            return {name: 0.0 for name, value in self._told.items() if value}
        for _, value, kind, number in EVENT.iter_unpack(content[: len(content) // EVENT.size * EVENT.size]):
            if kind & ~INITIAL == AXIS:
                self._axes[number] = value / FULL
            elif kind == BUTTON and value:
                self._on_button(number)
        signals = self._signals()
        moved = {name: value for name, value in signals.items() if value != self._told.get(name, 0.0)}
        self._told = signals
        return moved

    def _signals(self) -> dict[str, float]:
        """Steering, left positive, and drive: right trigger forward, left trigger backward."""
        drive = 0.5 * (self._axes[RIGHT_TRIGGER] - self._axes[LEFT_TRIGGER])
        return {"steering_signal": -_beyond_rest(self._axes[STICK]), "drive_signal": _beyond_rest(drive)}

    def close(self) -> None:
        """Let the device go."""
        if self._device is not None:
            os.close(self._device)
            self._device = None


def _beyond_rest(share: float) -> float:
    """A share without its dead band, from -1 to 1, in hundredths as the sliders have them."""
    size = min(max(abs(share) - DEAD_BAND, 0.0) / (1.0 - DEAD_BAND), 1.0)
    return round(size if share > 0.0 else -size, 2) + 0.0  # no negative zero
