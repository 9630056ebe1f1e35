"""Pictures a second that the view sends of one machine on a scanned ground, with and without a lidar and a camera.

    python -m studies.view_speed [--seconds N] [--lidar MODEL ...] [--camera MODEL ...] [--world] [--browser]

The machine drives over a forest of 204,800 triangles, with ``--world`` among the trees of a made one. A client in a process
of its own takes what a page would get, and draws nothing: what is measured is the program, not a browser's graphics. With
``--browser`` the client is Chromium, which draws by WebGL in software on the same cores.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.cli.place import put
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.forest import ForestSettings, forest
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.view.camera_picture import CameraPicture
from aoro_gym.view.lidar_cloud import LidarCloud
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.live_view import LiveView
from aoro_gym.view.server import HOST, start, stop
from tests.view.browser import Browser, frames_drawn

GROUND = ForestSettings(size=(80.0, 80.0))
"""Two triangles a square of 0.25 m."""
SEED = 3
"""Of the made forest."""
DRIVE = 0.3
"""Drive signal."""
WARM_UP = 60
"""Pictures before it counts: kernels are compiled, the ground is sent."""
PATIENCE = 180.0
"""Time [s] for these."""
CLIENT = """
import sys
from msgspec.msgpack import encode
from viser import __version__
from viser._messages import ViewerCameraMessage
from websockets.sync.client import connect

ahead, up, eye = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-6.5, -7.0, 4.2)
look = ViewerCameraMessage((1.0, 0.0, 0.0, 0.0), eye, 1.0, 0.1, 1000.0, 800, 1280, ahead, up)
with connect(sys.argv[1], subprotocols=[f"viser-v{__version__}"], max_size=None, compression=None) as socket:
    socket.send(encode(look.as_serializable_dict()))
    while True:
        socket.recv()
"""
"""What a page does, but for drawing."""


@dataclass(frozen=True)
class Speed:
    """What a view reached."""

    rate: float
    """Pictures sent a second."""
    gaps: NDArray[np.float64]
    """Times [s] between two pictures."""
    share: float
    """Simulated time over real time."""
    cores: float
    """Which the program, without its client, took."""
    driven: float
    """Way of the machine [m]."""
    seen: float = 0.0
    """Pictures a second of the camera."""
    drawn: float | None = None
    """Pictures a second that the browser drew."""

    def __str__(self) -> str:
        late, longest = 1e3 * np.quantile(self.gaps, 0.95), 1e3 * self.gaps.max()
        drawn = "" if self.drawn is None else f", {self.drawn:.1f} drawn"
        drawn += f", {self.seen:.1f} of the camera" if self.seen else ""
        return (
            f"{self.rate:.1f} pictures/s{drawn}, 95 % within {late:.0f} ms, longest {longest:.0f} ms; "
            f"{self.share:.2f} of real time, {self.cores:.2f} cores"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures a second of the view")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--lidar", nargs="*", default=["vlp-16", "mid-360", "os1-64", "os1-128"])
    parser.add_argument("--camera", nargs="*", default=["stereo"])
    parser.add_argument("--world", action="store_true")
    parser.add_argument("--browser", action="store_true")
    asked = parser.parse_args()
    ground = world(SEED) if asked.world else forest(1, GROUND).terrain
    faces = ground.scene().faces if isinstance(ground, World) else ground.faces
    print(f"{len(faces):,} triangles, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    sensors = [(None, None), *((model, None) for model in asked.lidar), *((None, model) for model in asked.camera)]
    for lidar, camera in sensors:
        found = measure(ground, lidar, asked.seconds, camera=camera, in_browser=asked.browser)
        print(f"{lidar or camera or 'none':9s} {found}", flush=True)


def measure(
    ground: Terrain | World, lidar: str | None, seconds: float, *, camera: str | None = None, in_browser: bool = False
) -> Speed:
    """Speed of a view of one machine that drives.

    Args:
        ground: Where.
        lidar: Model of one, or none.
        seconds: To look for.
        camera: Model of one, or none.
        in_browser: Whether Chromium shows it.

    Raises TimeoutError where no page connects.
    """
    twin = Twin(terrain=ground, threads=1)
    put(twin, twin.machine, None, None)
    twins, server = LiveTwins(twin, [twin.machine]), start(0)
    cloud = None if lidar is None else LidarCloud(server, ground, lidar)
    picture = None if camera is None else CameraPicture(server, ground, camera)
    view = LiveView(server, twins, ["aoro"], lidar=cloud, camera=picture)
    view.page.surround(ground, None)
    sent, ended = _told(view), threading.Event()
    thread = threading.Thread(target=view.run, args=(ended.is_set,))
    thread.start()
    try:
        with _client(f"{HOST}:{server.get_port()}", in_browser=in_browser) as browser:
            _wait_for(sent)
            assert view.driving is not None
            view.driving.put("drive_signal", DRIVE)
            count, first, place = len(sent), twins.time, _place(twins)
            taken = 0 if picture is None else picture.pictures
            used, begun = time.process_time(), time.monotonic()
            drawn = None if browser is None else frames_drawn(browser, seconds)
            time.sleep(max(0.0, begun + seconds - time.monotonic()))
            took, used, times = time.monotonic() - begun, time.process_time() - used, np.array(sent[count:])
            driven = float(np.linalg.norm(_place(twins) - place))
            seen = 0.0 if picture is None else (picture.pictures - taken) / took
            share = (twins.time - first) / took
            return Speed(len(times) / took, np.diff(times), share, used / took, driven, seen, drawn)
    finally:
        ended.set()
        thread.join()
        stop(server)


def _told(view: LiveView) -> list[float]:
    """Instants [s] of all pictures from now on."""
    instants: list[float] = []
    draw: Any = view.page.draw

    def told(*, with_forces: bool = True) -> bool:
        instants.append(time.monotonic())
        return draw(with_forces=with_forces)

    view.page.draw = told
    return instants


@contextmanager
def _client(address: str, *, in_browser: bool) -> Iterator[Browser | None]:
    """Who looks: Chromium, or a process that draws nothing."""
    if in_browser:
        browser = Browser()
        try:
            browser.open(f"http://{address}")
            yield browser
        finally:
            browser.close()
        return
    process = subprocess.Popen([sys.executable, "-c", CLIENT, f"ws://{address}"])
    try:
        yield None
    finally:
        process.kill()
        process.wait()


def _wait_for(sent: list[float]) -> None:
    end = time.monotonic() + PATIENCE
    while len(sent) < WARM_UP:
        if time.monotonic() > end:
            raise TimeoutError(f"{len(sent)} pictures within {PATIENCE:.0f} s")
        time.sleep(0.1)


def _place(twins: LiveTwins) -> NDArray[np.float64]:
    return np.asarray(twins.poses()[0].position, dtype=np.float64)


if __name__ == "__main__":
    main()
