"""Sentences over TCP to any number of clients, none of which can hold up the twin."""

from __future__ import annotations

import socket
from dataclasses import dataclass

MOST_CLIENTS = 256
"""Clients at once; the next one is refused. Each costs some 10 µs ten times a second."""
KEPT = 65_536
"""Bytes that the system keeps for a client which does not read: about a quarter of a minute of sentences. (E)"""


@dataclass
class _Client:
    connection: socket.socket
    rest: bytes = b""
    """End of what was sent in part."""


class SentencePublisher:
    """Listens, and sends every client whole blocks of sentences.

    A client that does not read fast enough misses blocks, and never gets a part of one; a client that is gone is forgotten.

    Args:
        host: Address to bind.
        port: 0: any free one.
    """

    def __init__(self, host: str, port: int = 0):
        self._listener = socket.create_server((host, port), backlog=16)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._clients: list[_Client] = []
        self.connected, self.refused = 0, 0
        """Clients so far."""
        self.blocks, self.missed = 0, 0
        """Blocks that were sent to a client, and that one missed."""

    @property
    def clients(self) -> int:
        """Clients now."""
        return len(self._clients)

    def accept(self) -> None:
        """Let in who waits."""
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # nobody, or gone already
                return
            if len(self._clients) >= MOST_CLIENTS:
                connection.close()
                self.refused += 1
                continue
            connection.setblocking(False)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KEPT)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(_Client(connection))
            self.connected += 1

    def send(self, block: bytes) -> None:
        """Give every client ``block``, or nothing of it."""
        self._clients = [client for client in self._clients if self._gets(client, block)]

    def _gets(self, client: _Client, block: bytes) -> bool:
        """Whether a client is still there."""
        try:
            if client.rest:
                client.rest = client.rest[client.connection.send(client.rest) :]
            if client.rest:
                self.missed += 1
                return True
            client.rest = block[client.connection.send(block) :]
        except BlockingIOError:
            self.missed += 1
            return True
        except OSError:
            client.connection.close()
            return False
        self.blocks += 1
        return True

    def close(self) -> None:
        """Let all go."""
        for client in self._clients:
            client.connection.close()
        self._clients = []
        self._listener.close()
