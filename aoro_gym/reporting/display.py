"""Whether somebody can look at this computer's screen."""

from __future__ import annotations

import os
import sys


def has_display() -> bool:
    """Whether a window, or a browser, can be opened: on Linux by what X11 and Wayland set."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
