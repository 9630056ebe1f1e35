"""Processes that share the launches of one device.

A GPU takes as long for one twin as for thousands, and processes that launch by themselves take turns. So one process
launches for all: what several ask for while others are served goes into the next launch together, and some launches are
under way at once. Who asks must know the key that a process shares with those that it starts. Answers are written into
memory that the one who asks shares with the one who launches: they are hundreds of megabytes, which pipes would take longer
for than the twins do.
"""

from __future__ import annotations

import mmap
import multiprocessing
import os
import pickle
import signal
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Client, Connection, Listener
from multiprocessing.reduction import recv_handle, send_handle
from multiprocessing.synchronize import Event
from pathlib import Path
from queue import SimpleQueue
from selectors import EVENT_READ, DefaultSelector
from threading import Thread

import numpy as np
import warp as wp

from aoro_gym.diagnosis.replay import Launching, Request, Signals, Simulator, Steps
from aoro_gym.execution.workers import interrupts_held

WRITERS = 4
"""Threads that write answers."""
FLIGHTS = 8
"""Launches at once: the twins of one do not fill a GPU, and who asks for a short one need not wait for a long one."""
TOLD = 4
"""Stretches that a device is told at once: it has enough to do while another launch is made ready, and a stream's queue
holds two such parts."""
SPARE = 1 << 25
"""Bytes for answers that a process keeps, however few it asks for."""
PAUSE, IDLE = 1e-3, 0.05
"""Between looks at the device, and at who has joined [s]."""
PREFIX = "shared:"
"""Of a device's name: what follows is the address of the process that launches."""


def simulator(device: str) -> Simulator:
    """For ``"cpu"``, ``"cuda:N"``, or what :func:`sharing` gives."""
    return Remote(device) if device.startswith(PREFIX) else Simulator(device)


class Remote(Simulator):
    """Has another process launch."""

    def __init__(self, device: str):
        super().__init__(device)
        self._connection = Client(device.removeprefix(PREFIX), authkey=multiprocessing.current_process().authkey)
        self._memory: mmap.mmap | None = None

    def launch(self, requests: Sequence[Request]) -> list[Signals]:
        """See :meth:`Simulator.launch`. What it returns holds until the next launch."""
        size = sum(_size(request) for request in requests)
        anew = self._memory is None or not size <= len(self._memory) <= max(2 * size, SPARE)
        self._connection.send((anew, list(requests)))
        if anew:
            handle = _memory(size)
            self._memory = mmap.mmap(handle, size)
            send_handle(self._connection, handle, 0)
            os.close(handle)
        error = self._connection.recv()
        if error is not None:
            raise error
        assert self._memory is not None
        return _answers(requests, self._memory)


def _memory(size: int) -> int:
    """Handle of that many bytes that processes can share, which go with the last of these."""
    if hasattr(os, "memfd_create"):
        handle = os.memfd_create("launches")
    else:
        with tempfile.TemporaryFile() as file:
            handle = os.dup(file.fileno())
    os.ftruncate(handle, size)
    return handle


def _shape(request: Request) -> tuple[int, int]:
    """Of every channel of its answer: samples, variants."""
    return len(request.commands) * request.frames + 1, request.count


def _size(request: Request) -> int:
    """Bytes of its answer."""
    samples, count = _shape(request)
    return 4 * len(request.channels) * samples * count


def _answers(requests: Sequence[Request], memory: mmap.mmap) -> list[Signals]:
    """Where the answers to all ``requests`` lie in the memory, one after the other."""
    out, first = [], 0
    for request in requests:
        shape = (len(request.channels), *_shape(request))
        values = np.frombuffer(memory, np.float32, int(np.prod(shape)), first).reshape(shape)
        out.append(dict(zip(request.channels, values, strict=True)))
        first += _size(request)
    return out


@contextmanager
def sharing(device: str) -> Iterator[str]:
    """A process that launches on ``device`` while the context lasts; gives the device's name for those that share it."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        address = str(Path(folder) / "launches")
        ready = context.Event()
        process = context.Process(target=_serve, args=(address, device, ready), daemon=True)
        with interrupts_held():
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    wp.config.log_level = wp.LOG_ERROR
    simulates = Simulator(device)
    joined: SimpleQueue[Connection] = SimpleQueue()
    memories: dict[Connection, mmap.mmap] = {}
    with (
        Listener(address, "AF_UNIX", backlog=256, authkey=multiprocessing.current_process().authkey) as listener,
        ThreadPoolExecutor(WRITERS) as writers,
        DefaultSelector() as selector,
    ):

        def accept() -> None:
            while True:
                with suppress(multiprocessing.AuthenticationError, EOFError, ConnectionError):  # of no process of ours
                    joined.put(listener.accept())

        Thread(target=accept, daemon=True).start()
        ready.set()
        asked: list[_Asked] = []
        flights: list[_Flight] = []
        parent = multiprocessing.parent_process()
        while parent is None or parent.is_alive():
            while not joined.empty():
                selector.register(joined.get(), EVENT_READ)
            heard = selector.select(0.0 if asked else PAUSE if flights else IDLE)
            for key, _ in heard:
                connection = key.fileobj
                assert isinstance(connection, Connection)
                try:
                    anew, requests = connection.recv()
                    if anew:
                        handle = recv_handle(connection)
                        memories[connection] = mmap.mmap(handle, 0)
                        os.close(handle)
                    asked.append(_Asked(connection, requests, memories[connection]))
                except (EOFError, OSError, pickle.UnpicklingError):
                    selector.unregister(connection)
                    memories.pop(connection, None)
            if asked and not heard and len(flights) < FLIGHTS:
                alike: dict[frozenset[Steps], list[_Asked]] = {}
                for one in asked:  # whoever asks for coarse steps need not wait for what others ask by finer ones
                    alike.setdefault(frozenset(request.steps for request in one.requests), []).append(one)
                flights += [_Flight(simulates, those) for those in alike.values()]
                asked = []
            for flight in list(flights):
                if flight.go_on(writers):
                    flights.remove(flight)
    with suppress(OSError):  # the parent was killed, and did not clear up
        Path(address).parent.rmdir()


@dataclass(frozen=True)
class _Asked:
    """What one process asks for, and where the answer goes."""

    connection: Connection
    requests: list[Request]
    memory: mmap.mmap


class _Flight:
    """A launch for several who asked. On a GPU it has a stream of its own: launches that do not fill the device share it."""

    def __init__(self, simulates: Simulator, asked: list[_Asked]):
        self.asked = asked
        self._simulates = simulates
        self._stream: wp.Stream | None = None
        self._launching: Launching | None = None
        self._taken: Callable[[], list[Signals]] | None = None
        self._told: deque[wp.Event] = deque()  # the ends of parts that the device may not have come to

    def go_on(self, writers: ThreadPoolExecutor) -> bool:
        """Tell the device the next part, if it has done all but one of those before. True once it has done all: what was
        asked for is on its way."""
        while self._told and self._told[0].is_complete:
            self._told.popleft()
        if self._taken is not None:
            if not self._told:
                writers.submit(_answer, self.asked, self._taken)
            return not self._told
        if len(self._told) > 1:
            return False
        try:
            if self._launching is None:
                device = wp.get_device(self._simulates.device)
                self._stream = wp.Stream(device) if device.is_cuda else None
                self._launching = self._simulates.launching([request for one in self.asked for request in one.requests])
            with wp.ScopedStream(self._stream, sync_enter=False):
                for _ in range(TOLD):
                    next(self._launching)
        except StopIteration as end:
            self._taken = end.value
        except Exception as error:
            if len(self.asked) == 1:
                _tell(self.asked[0].connection, error)
            else:  # who asked for what can be done shall have it
                for one in self.asked:
                    alone = _Flight(self._simulates, [one])
                    while not alone.go_on(writers):
                        pass
            return True
        if self._stream is not None:
            self._told.append(self._stream.record_event())
        return False


def _answer(asked: Sequence[_Asked], taken: Callable[[], list[Signals]]) -> None:
    """Write what was asked for where it belongs."""
    waiting = list(asked)
    try:
        found = iter(taken())
        while waiting:
            for place in _answers(waiting[0].requests, waiting[0].memory):
                for name, values in next(found).items():
                    place[name][:] = values
            _tell(waiting.pop(0).connection, None)
    except Exception as error:
        for one in waiting:
            _tell(one.connection, error)


def _tell(connection: Connection, error: Exception | None) -> None:
    with suppress(BrokenPipeError, ConnectionResetError):  # of one that has ended
        connection.send(error)
