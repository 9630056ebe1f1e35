"""The server of viser that a page comes from."""

from __future__ import annotations

import contextlib
import io
import socket
from typing import Any

from aoro_gym.checks import check_integer
from aoro_gym.view.extras import viser
from aoro_gym.view.scene import WORLD

HOST = "127.0.0.1"
"""Nobody else may look, or drive."""
CAMERA, LOOK_AT = (-6.5, -7.0, 4.2), (0.4, 0.0, 0.9)
"""Where the camera begins and what it looks at [m], from the hinge; x is ahead at first."""


def start(port: int, label: str = "AORO") -> Any:
    """A server of viser on ``HOST``.

    Raises ValueError if viser is missing, and OSError if the port is taken.
    """
    free = free_port(port)
    library = viser()
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


def free_port(port: int) -> int:
    """``port``, if it can be bound, or any free one for 0; viser itself would take the next one without a word.

    Raises ValueError for what is no port, and OSError if it is taken.
    """
    check_integer("port", port, ge=0, le=65535)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise OSError(
                error.errno, f"port is {port}, but cannot be bound on {HOST}: {error.strerror}; choose another, or 0"
            ) from None
        return int(probe.getsockname()[1])
