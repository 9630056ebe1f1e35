"""How a command ends: what it wrote, or one line for an error and an exit code."""

from __future__ import annotations

import errno
import json
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


def conclude(
    result: Any = None,
    shown: Iterable[Any] = (),
    written: Sequence[Path] = (),
    *,
    json_to: Path | None = None,
    **style: Any,
) -> None:
    """Show what a command found: tables and the names of its files, or JSON on the standard output and nothing else.

    Args:
        result: Content of the JSON, or the JSON file that has it. Default: the names of the files.
        shown: Tables and lines. With --quiet those of a command that wrote files are left out.
        written: Files that were written.
        json_to: Value of --json: a file that gets the result, too, or ``-``.
        style: How a console prints ``shown``.
    """
    from aoro_gym.execution.files import read_json, with_nulls, write_text

    names = list(written)
    if json_to is not None:
        content = read_json(result) if isinstance(result, Path) else result
        content = {"written": [str(path) for path in written]} if content is None else with_nulls(content)
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        if is_output(json_to):
            typer.echo(text)
            return
        with running():
            write_text(json_to, text + "\n")
        names.append(json_to)
    if not (terminal.is_quiet() and written):
        for item in shown:
            terminal.out().print(item, **style)
    say_written(names)


def is_output(json_to: Path | None) -> bool:
    """Whether --json asks for the standard output."""
    return str(json_to) == "-"


def check_json_to(json_to: Path | None) -> Path | None:
    """Value of --json, of which a file can be written; else the command ends."""
    from aoro_gym.execution.files import check_writable

    if json_to is None or is_output(json_to):
        return json_to
    with checking_input():
        if json_to.suffix != ".json":
            raise ValueError(f"--json is '{json_to}', but must be - or end in .json")
        check_writable(json_to)
    return json_to


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
