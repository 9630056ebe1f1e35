"""A real browser without a display, told what to do over its DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless=new", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--disable-quic", "--hide-scrollbars", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--remote-debugging-port=0",
)  # fmt: skip
"""With WebGL in software."""


class Browser:
    """One page of a headless Chromium."""

    def __init__(self, width: int = 1280, height: int = 800):
        assert CHROMIUM is not None
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        command = [
            CHROMIUM,
            *FLAGS,
            f"--user-data-dir={self._folder.name}",
            f"--window-size={width},{height}",
            "about:blank",
        ]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port = self._port(Path(self._folder.name) / "DevToolsActivePort")
        self._socket, self._number = self._connect(port), 0
        self.events: list[dict[str, Any]] = []
        """What the page told since the last look."""

    def _port(self, file: Path) -> str:
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            if file.exists() and file.read_text().strip():
                return file.read_text().split()[0]
            time.sleep(0.1)
        raise TimeoutError("Chromium did not start within 60 s")

    def _connect(self, port: str) -> Any:
        from urllib.request import urlopen

        from websockets.sync.client import connect

        with urlopen(f"http://127.0.0.1:{port}/json") as answer:
            pages = [one for one in json.load(answer) if one["type"] == "page"]
        return connect(pages[0]["webSocketDebuggerUrl"], max_size=None, compression=None)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Result of a command."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=120.0))
            if message.get("id") == self._number:
                assert "error" not in message, message
                return message["result"]
            self.events.append(message)

    def open(self, address: str) -> None:
        """Go to a page whose traffic is told of."""
        self.call("Network.enable")
        self.call("Page.enable")
        self.call("Page.navigate", url=address)

    def wait(self, seconds: float) -> list[dict[str, Any]]:
        """What happens within so many seconds."""
        self.events, end = [], time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            try:
                self.events.append(json.loads(self._socket.recv(timeout=left)))
            except TimeoutError:
                break
        return self.events

    def evaluate(self, script: str) -> Any:
        """Value of JavaScript, which may be a promise."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        return result["result"].get("value")

    def press(self, key: str, *, repeat: int = 0) -> None:
        """A key that goes down, repeats, and comes up."""
        code = {"key": key, "code": f"Key{key.upper()}", "windowsVirtualKeyCode": ord(key.upper())}
        for number in range(repeat + 1):
            self.call("Input.dispatchKeyEvent", type="keyDown", autoRepeat=number > 0, **code)
        self.call("Input.dispatchKeyEvent", type="keyUp", **code)

    def screenshot(self, file: Path) -> None:
        """Picture of the page."""
        file.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        self._process.terminate()
        self._process.wait(timeout=20.0)
        self._folder.cleanup()


def frames_drawn(browser: Browser, seconds: float) -> float:
    """Pictures a second that the page draws."""
    script = (
        "new Promise(done => { let n = 0; const t0 = performance.now(); const tick = () => { n++; "
        f"const t = performance.now() - t0; t > {1000.0 * seconds} ? done(1000 * n / t) : requestAnimationFrame(tick) }}; "
        "requestAnimationFrame(tick) })"
    )
    return float(browser.evaluate(script))
