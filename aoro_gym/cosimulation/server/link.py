"""The datagram socket: what arrives, and who gets telemetry."""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from aoro_gym.cosimulation.protocol import (
    LARGEST_DATAGRAM,
    Frame,
    Record,
    Rejection,
    Sender,
    draw_identifier,
    encode,
    encode_json,
)
from aoro_gym.cosimulation.server.records import COMMAND, HELLO, STATE, TELEMETRY
from aoro_gym.cosimulation.server.watchdog import Commander, Watchdog

MOST_AT_ONCE = 8
"""Datagrams that are looked at in one step, about 30 µs each; more wait, and what the system cannot keep is lost."""
MOST_SUBSCRIBERS = 16
"""Addresses that get telemetry; the next one is refused."""
SUBSCRIBED = 5.0
"""Time [s] that telemetry goes on after the last valid frame of its receiver."""


@dataclass
class _Subscriber:
    json: bool
    """Whether it speaks JSON."""
    last: float
    """Time [s] of its last frame, by the monotonic clock."""


class Link:
    """Decodes and answers datagrams of one session.

    Args:
        host: Address to bind.
        port: 0: any free one.
        token: Which all frames are authenticated with; None: none.
        state: Gives the values of the answer to a hello.
        on_rejected: Called with the first datagram that is dropped for each reason.
    """

    def __init__(
        self,
        host: str,
        port: int = 0,
        *,
        token: bytes | None = None,
        state: Callable[[], Mapping[str, float]],
        on_rejected: Callable[[Rejection, str], None] = lambda *_: None,
    ):
        family = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0][0]
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self.socket.bind((host, port))
        except OSError:
            self.socket.close()
            raise
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.session = draw_identifier()
        """Number that clients must name."""
        self.commander = Commander(self.session, token)
        self.watchdog = Watchdog()
        self.unsent, self.refused = 0, 0
        """Datagrams that the system did not take, and subscribers that were one too many."""
        self._sender = Sender(token)
        self._state, self._on_rejected = state, on_rejected
        self._subscribers: dict[Any, _Subscriber] = {}

    @property
    def subscribers(self) -> int:
        """Addresses that get telemetry now."""
        return len(self._subscribers)

    def take(self) -> tuple[bytes, Any] | None:
        """The next datagram that waits, and its sender's address."""
        while True:
            try:
                return self.socket.recvfrom(LARGEST_DATAGRAM + 1)
            except BlockingIOError:
                return None
            except OSError:  # an answer of ours found nobody
                continue

    def handle(self, datagram: bytes, address: Any, time: float, clock: float, monotonic: float) -> Frame | None:
        """The command or grant in a datagram; greetings are answered here, and what is wrong is dropped.

        Args:
            datagram: As it arrived.
            address: From where.
            time: Simulated time [s].
            clock: Time [s] that the watchdog is fed with.
            monotonic: Time [s] of the monotonic clock.
        """
        found = self.commander.decode(datagram, time, self.watchdog)
        if isinstance(found, Rejection):
            if self.commander.receiver.rejected[found.reason] == 1:
                self._on_rejected(found, f"{address[0]}:{address[1]}")
            return None
        is_json = datagram[:1] == b"{"
        if found.session:
            self._subscribe(address, is_json, monotonic)
        if found.record is HELLO:
            self.answer(address, time, is_json)
            return None
        if found.record is COMMAND:
            self.watchdog.feed(clock)
        return found

    def answer(self, address: Any, time: float, is_json: bool) -> None:
        """Tell an address the state of the session."""
        self._send(STATE, time, dict(self._state()), address, is_json)

    def publish(self, values: Mapping[str, float], time: float, monotonic: float) -> None:
        """Send telemetry of the simulated ``time`` [s] to all subscribers, and forget those that are silent."""
        for address, subscriber in list(self._subscribers.items()):
            if monotonic - subscriber.last > SUBSCRIBED:
                del self._subscribers[address]
            else:
                self._send(TELEMETRY, time, values, address, subscriber.json)

    def close(self) -> None:
        self.socket.close()

    def _subscribe(self, address: Any, is_json: bool, monotonic: float) -> None:
        if address not in self._subscribers and len(self._subscribers) >= MOST_SUBSCRIBERS:
            self.refused += 1
            return
        self._subscribers[address] = _Subscriber(is_json, monotonic)

    def _send(self, record: Record, time: float, values: Mapping[str, float], address: Any, is_json: bool) -> None:
        frame = self._sender.frame(record, self.session, time, values)
        datagram = (encode_json if is_json else encode)(frame, self._sender.token)
        try:
            self.socket.sendto(datagram, address)
        except OSError:  # a full buffer, or nobody there
            self.unsent += 1
