"""A server in a thread of the test, and a client that speaks to it."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from aoro_gym.cosimulation.protocol import Frame, Receiver, Sender, encode, encode_json
from aoro_gym.cosimulation.server.records import COMMAND, GRANT, HELLO, STATE, TELEMETRY
from aoro_gym.cosimulation.server.server import Server, Settings
from aoro_gym.twin import Twin

DEFAULTS: dict[str, float] = {one.name: float(one.default or 0.0) for one in COMMAND.fields}
"""Everything at rest, brakes released."""


@contextmanager
def serving(settings: Settings, twin: Twin | None = None, **options: Any) -> Iterator[Server]:
    """A server that runs meanwhile; it must end by itself when it is told to."""
    server = Server(Twin(threads=1) if twin is None else twin, settings, **options)
    failed: list[BaseException] = []

    def run() -> None:
        try:
            server.run()
        except BaseException as error:
            failed.append(error)
            raise

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(30.0)
        assert not thread.is_alive() and not failed


class Client:
    """A controller."""

    def __init__(self, server: Server, token: bytes | None = None, json: bool = False):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", server.link.port))
        self.sender = Sender(token)
        self.receiver = Receiver((STATE, TELEMETRY), token=token)
        self.session, self.time, self.json = 0, 0.0, json
        self.telemetry: list[Frame] = []
        self.state: Frame | None = None

    def greet(self) -> None:
        """Ask for the session, then for telemetry."""
        for _ in range(2):
            self.state = None
            self.send(HELLO, {})
            self.hear(lambda: self.state is not None)
            assert self.state is not None
            self.session = self.state.session

    def send(self, record: Any, values: dict[str, float], instant: float | None = None) -> None:
        frame = self.sender.frame(record, self.session, self.time if instant is None else instant, values)
        if self.json:
            self.socket.send(encode_json(frame, self.sender.token))
        else:
            self.socket.send(encode(frame, self.sender.token))

    def command(self, **volts: float) -> None:
        self.send(COMMAND, {**DEFAULTS, **volts})

    def grant(self, until: float) -> None:
        """In lock-step: let the twin advance, and hear what it measured."""
        self.state = None
        self.send(GRANT, {"until": until})
        self.hear(lambda: self.state is not None)
        assert self.state is not None
        self.time = self.state.time

    def hear(self, enough: Any, patience: float = 20.0) -> None:
        """Take in datagrams until it is ``enough``."""
        end = time.monotonic() + patience
        while not enough() and time.monotonic() < end:
            if select.select([self.socket], [], [], 0.2)[0]:
                found = self.receiver.decode(self.socket.recv(2000))
                assert isinstance(found, Frame), found
                if found.record is STATE:
                    self.state = found
                else:
                    self.telemetry.append(found)
                    self.time = found.time

    def close(self) -> None:
        self.socket.close()


@contextmanager
def client_of(server: Server, **options: Any) -> Iterator[Client]:
    client = Client(server, **options)
    try:
        yield client
    finally:
        client.close()
