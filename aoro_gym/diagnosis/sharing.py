"""Processes that share the launches of one device.

A GPU takes as long for one twin as for thousands, and processes that launch by themselves take turns. So one process
launches for all: what several ask for while a launch runs goes into the next one together.
"""

from __future__ import annotations

import multiprocessing
import pickle
import signal
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Client, Connection, Listener, wait
from multiprocessing.synchronize import Event
from pathlib import Path
from threading import Thread

from aoro_gym.diagnosis.replay import Request, Signals, Simulator

SENDERS = 4
"""Threads that answer."""
PREFIX = "shared:"
"""Of a device's name: what follows is the address of the process that launches."""


def simulator(device: str) -> Simulator:
    """For ``"cpu"``, ``"cuda:N"``, or what :func:`sharing` gives."""
    return Remote(device) if device.startswith(PREFIX) else Simulator(device)


class Remote(Simulator):
    """Has another process launch."""

    def __init__(self, device: str):
        super().__init__(device)
        self._connection = Client(device.removeprefix(PREFIX))

    def launch(self, requests: Sequence[Request]) -> list[Signals]:
        """See :meth:`Simulator.launch`."""
        self._connection.send(list(requests))
        found = self._connection.recv()
        if isinstance(found, Exception):
            raise found
        return found


@contextmanager
def sharing(device: str) -> Iterator[str]:
    """A process that launches on ``device`` while the context lasts; gives the device's name for those that share it."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        address = str(Path(folder) / "launches")
        ready = context.Event()
        process = context.Process(target=_serve, args=(address, device, ready), daemon=True)
        process.start()
        try:
            while not ready.wait(0.1):
                if not process.is_alive():
                    raise RuntimeError(f"the process that launches on {device} ended with {process.exitcode}")
            yield PREFIX + address
        finally:
            process.terminate()
            process.join()


def _serve(address: str, device: str, ready: Event) -> None:
    import warp

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    warp.config.log_level = warp.LOG_ERROR
    simulates = Simulator(device)
    connections: list[Connection] = []
    # the next launch begins while answers to the last are on their way
    with Listener(address, "AF_UNIX", backlog=256) as listener, ThreadPoolExecutor(SENDERS) as sending:

        def accept() -> None:
            while True:
                connections.append(listener.accept())

        Thread(target=accept, daemon=True).start()
        ready.set()
        asked: list[tuple[Connection, list[Request]]] = []
        parent = multiprocessing.parent_process()
        while parent is None or parent.is_alive():
            busy = [connection for connection, _ in asked]
            idle = [connection for connection in connections if connection not in busy]
            heard = wait(idle, timeout=0.0 if asked else 0.05)
            for connection in heard:
                assert isinstance(connection, Connection)
                try:
                    asked.append((connection, connection.recv()))
                except (EOFError, OSError, pickle.UnpicklingError):
                    connections.remove(connection)
            if asked and not heard:
                _answer(simulates, asked, sending)
                asked = []
    with suppress(OSError):  # the parent was killed, and did not clear up
        Path(address).parent.rmdir()


def _answer(
    simulates: Simulator, asked: Sequence[tuple[Connection, list[Request]]], sending: ThreadPoolExecutor
) -> None:
    try:
        found = simulates.launch([request for _, requests in asked for request in requests])
    except Exception as error:
        if len(asked) == 1:
            sending.submit(_send, asked[0][0], error)
        else:  # who asked for what can be done shall have it
            for one in asked:
                _answer(simulates, [one], sending)
        return
    first = 0
    for connection, requests in asked:
        sending.submit(_send, connection, found[first : first + len(requests)])
        first += len(requests)


def _send(connection: Connection, answer: object) -> None:
    with suppress(BrokenPipeError, ConnectionResetError):  # of one that has ended
        connection.send(answer)
