"""Jobs spread over processes, one thread of arithmetic each.

Processes are spawned: they share nothing with their parent, and a CUDA context or a thread pool there does them no harm. One
that dies takes only its own job with it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from threading import Thread
from typing import Any

from aoro_gym.checks import check_integer

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What BLAS libraries ask when they are loaded for the number of their threads."""

Tell = Callable[[int], Any]
"""Takes an amount of work that was done."""


@dataclass(frozen=True)
class Failure:
    """Why a job has no result."""

    reason: str
    """In a line."""
    trace: str = ""
    """Where in the code, if the job raised an exception."""


def spread(
    work: Callable[..., Any], jobs: Mapping[str, tuple[Any, ...]], *, workers: int, tell: Tell = lambda amount: None
) -> Generator[tuple[str, Failure | None], None, None]:
    """Call ``work(tell, *arguments)`` for every job, and yield its name as soon as it ended, with why if it failed.

    Whatever ends the iteration ends the processes: jobs must leave files whole or not at all.

    Args:
        work: A function of a module. What it returns is lost.
        jobs: Arguments by name, begun in this order.
        workers: Most processes at once.
        tell: Told what jobs tell, by calling their first argument.

    Raises:
        ValueError: there is less than one worker.
    """
    check_integer("workers", workers)
    waiting = list(jobs.items())[::-1]
    staff: dict[Connection, _Worker] = {}
    try:
        while waiting or staff:
            while waiting and len(staff) < workers:
                new = _Worker(work)
                staff[new.connection] = new
                new.begin(*waiting.pop())
            for connection in wait(list(staff)):
                assert isinstance(connection, Connection)
                worker = staff[connection]
                message = worker.hear()
                if isinstance(message, int):
                    tell(message)
                    continue
                if worker.process.is_alive() and waiting:
                    name = worker.job
                    worker.begin(*waiting.pop())
                else:
                    name = staff.pop(connection).job
                    worker.end()
                yield name, message
    finally:
        for worker in staff.values():
            worker.end()


class _Worker:
    """A process that does one job after the other."""

    def __init__(self, work: Callable[..., Any]):
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(work, theirs), daemon=True)
        with _single_threaded(), interrupts_held():
            self.process.start()
        theirs.close()  # so that the pipe ends with the process
        self.job = ""

    def begin(self, name: str, arguments: tuple[Any, ...]) -> None:
        self.job = name
        with suppress(BrokenPipeError):  # of a process that died: hear() tells
            self.connection.send(arguments)

    def hear(self) -> int | Failure | None:
        """What the job told, or how it ended."""
        try:
            return self.connection.recv()
        except (EOFError, ConnectionResetError):
            self.process.join()
            return Failure(f"its process ended with exit code {self.process.exitcode}; was there memory enough?")

    def end(self) -> None:
        self.process.terminate()
        self.process.join()
        self.connection.close()


def _serve(work: Callable[..., Any], connection: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes of a terminal; the parent ends these
    Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            arguments = connection.recv()
        except EOFError:
            return
        try:
            work(lambda amount: connection.send(int(amount)), *arguments)
        except Exception as error:
            connection.send(Failure(f"{type(error).__name__}: {error}", traceback.format_exc()))
        else:
            connection.send(None)


def _end_with_parent() -> None:
    """End this process once its parent has ended, however that was: nobody waits for its job any more."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Processes that begin meanwhile never see Ctrl-C, not even before their first line of code, which would end in a
    traceback; it reaches this one afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes that begin meanwhile load BLAS with one thread: as many processes as cores need no more."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
