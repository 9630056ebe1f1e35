"""A client that does not read costs nothing but its own sentences, and gets whole blocks only."""

import socket
import time

from aoro_gym.cosimulation.server import publisher as module
from aoro_gym.cosimulation.server.publisher import SentencePublisher


def connected(publisher: SentencePublisher) -> socket.socket:
    reader = socket.socket()
    reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    reader.connect(("127.0.0.1", publisher.port))
    before, end = publisher.connected, time.monotonic() + 10.0
    while publisher.connected == before and time.monotonic() < end:
        publisher.accept()
    return reader


def test_slow_clients_miss_whole_blocks():
    publisher = SentencePublisher("127.0.0.1")
    reader = connected(publisher)
    blocks = [f"{number:08d}".encode() * 500 + b"\r\n" for number in range(500)]
    for block in blocks:
        publisher.send(block)
    assert publisher.missed > 0 and publisher.blocks + publisher.missed == 500
    text = b""
    reader.settimeout(0.5)
    for _ in range(2):  # what stands in buffers, and the rest of the block that was sent in part
        try:
            while True:
                text += reader.recv(65536)
        except TimeoutError:
            publisher.send(b"last\r\n")
    lines = text.split(b"\r\n")
    assert lines[-1] == b"" and b"last" in lines[-2:]
    assert all(line + b"\r\n" in blocks for line in lines[:-2] if line != b"last")
    publisher.close()
    reader.close()


def test_who_is_gone_is_forgotten_and_too_many_are_refused(monkeypatch):
    monkeypatch.setattr(module, "MOST_CLIENTS", 1)
    publisher = SentencePublisher("127.0.0.1")
    first = connected(publisher)
    second = socket.create_connection(("127.0.0.1", publisher.port))
    end = time.monotonic() + 10.0
    while not publisher.refused and time.monotonic() < end:
        publisher.accept()
    assert (publisher.clients, publisher.refused) == (1, 1)
    first.close()
    while publisher.clients and time.monotonic() < end:
        publisher.send(b"x\r\n")
    assert publisher.clients == 0
    publisher.close()
    second.close()
