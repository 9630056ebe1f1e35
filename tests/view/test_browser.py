"""The page in a real browser."""

import re
import threading
from contextlib import contextmanager

import pytest

from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin
from aoro_gym.view.camera_picture import CameraPicture
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.live_view import LiveView
from aoro_gym.view.scene import Ground
from aoro_gym.view.server import start
from aoro_gym.view.server import stop as close

from .browser import CHROMIUM, Browser

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")]


def shown_time(browser):
    """Simulated time [s] that the page shows; -1: none yet."""
    found = re.search(r"t = ([\d.]+) s", browser.evaluate("document.body.innerText"))
    return float(found[1]) if found else -1.0


@contextmanager
def opened(**sensors):
    """A view that runs, and a browser that its page is open in; ``sensors`` are made from the server and the ground."""
    pytest.importorskip("viser", reason="[view] is not installed")
    server, stop = start(0), threading.Event()
    twin = Twin(threads=1)
    Ground(server.scene, Plane())
    made = {name: make(server, Plane()) for name, make in sensors.items()}
    view = LiveView(server, LiveTwins(twin, [twin.machine]), ["aoro"], **made)
    thread = threading.Thread(target=view.run, args=(stop.is_set,))
    thread.start()
    browser = Browser(640, 480)
    try:
        browser.open(f"http://127.0.0.1:{server.get_port()}")
        for _ in range(60):
            browser.wait(2.0)
            if server.get_clients():
                break
        assert server.get_clients(), "no page has connected within two minutes"
        yield view, browser
    finally:
        browser.close()
        stop.set()
        thread.join()
        close(server)


def test_a_page_connects_frames_arrive_and_keys_drive():
    with opened() as (view, browser):
        shown = [shown_time(browser)]
        before = view.page.frames
        for _ in range(30):
            browser.wait(2.0)
            shown.append(shown_time(browser))
            if shown[-1] > shown[-2] >= 0.0:
                break
        assert view.page.frames - before > 10
        assert shown[-1] > shown[-2] >= 0.0, shown  # the page shows that time goes on
        browser.press("w", repeat=4)
        browser.wait(10.0)
        assert view.driving is not None and view.driving.commands["drive_signal"] > 0.0


def test_the_page_shows_what_a_camera_sees():
    images = "[...document.images].filter(i => i.complete && i.naturalWidth == 320).map(i => [i.naturalHeight, i.src])"
    with opened(camera=lambda server, ground: CameraPicture(server, ground, "stereo")) as (_, browser):
        addresses = set()
        for _ in range(40):
            browser.wait(1.0)
            for height, address in browser.evaluate(images) or []:
                assert height == 120
                addresses.add(address)
            if len(addresses) > 1:
                break
        assert len(addresses) > 1  # another one as time goes on
        assert "colour | depth" in browser.evaluate("document.body.innerText")
