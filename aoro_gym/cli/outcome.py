"""How a command ends: what it wrote, or one line for an error and an exit code."""

from __future__ import annotations

import errno
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import typer
from rich.markup import escape

from aoro_gym.reporting import terminal

DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors that are no fault of the input."""
ARGUMENT = re.compile(r"([a-z][a-z0-9_]*)(?:\[(\d+)\])?( (?:is|has) )")
"""What a message about an argument, or a number of an argument, begins with, see :mod:`aoro_gym.checks`."""
FLAGS: ContextVar[Mapping[str, str]] = ContextVar("flags", default=MappingProxyType({}))
"""Options of the command that runs (``--udp-port``) by the names of arguments (``udp_port``)."""


def say_written(paths: Sequence[Path]) -> None:
    """Name the files that were written."""
    for path in paths:
        typer.echo(f"wrote {path}")


def print_all(items: Iterable[Any], **options: Any) -> None:
    """Print tables and lines to the standard output."""
    for item in items:
        terminal.out().print(item, **options)


def say_error(text: str, head: str = "[bold red]error:[/]") -> None:
    """One line on the standard error."""
    terminal.err().print(f"{head} {escape(' '.join(text.split()))}", soft_wrap=True, highlight=False)


@contextmanager
def checking_input() -> Iterator[None]:
    """Turn what is wrong with the input into one line and exit code 2."""
    try:
        yield
    except (ValueError, OSError) as error:
        fail(error, 2)


@contextmanager
def running() -> Iterator[None]:
    """Turn a run that failed into one line and exit code 1; with 2 where its folder is another run's."""
    from aoro_gym.execution.cluster import ClusterError
    from aoro_gym.execution.locking import FolderInUse
    from aoro_gym.execution.provenance import ChangedCode, ChangedInput
    from aoro_gym.simulation.manoeuvres import SimulationDiverged

    try:
        yield
    except (ChangedCode, ChangedInput, FolderInUse) as error:
        fail(error, 2)
    except (SimulationDiverged, ClusterError, OSError) as error:
        fail(error, 1)


@contextmanager
def resumable(
    goes_on: Callable[[], str] = lambda: "the same command goes on from where it stopped",
) -> Iterator[None]:
    """Turn Ctrl-C into one line that says how to go on, and exit code 130; a full disk gets that line, too."""
    try:
        yield
    except KeyboardInterrupt:
        interrupted(goes_on())
    except _DiskFull:
        terminal.err().print(f"[bold]afterwards:[/] {escape(goes_on())}", soft_wrap=True, highlight=False)
        raise


class _DiskFull(typer.Exit):
    """No room for what was to be written."""


def say_interrupted(what_next: str) -> None:
    """One line on the standard error."""
    terminal.err().print(f"[bold]interrupted:[/] {escape(what_next)}", soft_wrap=True, highlight=False)


def interrupted(what_next: str) -> NoReturn:
    say_interrupted(what_next)
    raise typer.Exit(130) from None


@contextmanager
def entered(context: AbstractContextManager[Any]) -> Iterator[Any]:
    """Hold ``context``; what keeps it from being entered, such as a folder in use, is wrong input."""
    with ExitStack() as held:
        with checking_input():
            found = held.enter_context(context)
        yield found


def fail(error: Exception, code: int) -> NoReturn:
    message, full = str(error), isinstance(error, OSError) and error.errno in DISK_FULL
    if isinstance(error, OSError) and error.strerror:
        message = error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    message = naming_option(message)
    if full:
        message += "; make room and try again"
    terminal.err().print(f"[bold red]error:[/] {escape(' '.join(message.split()))}", soft_wrap=True, highlight=False)
    raise (_DiskFull(1) if full else typer.Exit(code)) from None


def naming_option(message: str) -> str:
    """The message of an error, with the option that was typed in place of the Python argument that it begins with."""
    begin = ARGUMENT.match(message)
    flag = FLAGS.get().get(begin[1]) if begin else None
    if begin is None or flag is None:
        return message
    which = f", value {int(begin[2]) + 1}," if begin[2] else ""
    return flag + which + message[begin.end() - len(begin[3]) :]
