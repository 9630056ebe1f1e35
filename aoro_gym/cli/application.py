"""Typer's application, with commands whose errors name options as they are typed."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand, TyperOption

from aoro_gym.cli.outcome import FLAGS


def flowing(text: str) -> str:
    """``text`` with each paragraph on one line, which fills any terminal; what is indented stays as it is."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(
        paragraph if any(line.startswith(" ") for line in paragraph.splitlines()) else paragraph.replace("\n", " ")
        for paragraph in paragraphs
    )


class Command(TyperCommand):
    """A command that says, while it runs, which options stand for which arguments."""

    def __init__(self, *arguments: Any, help: str | None = None, **settings: Any):
        super().__init__(*arguments, help=None if help is None else flowing(help), **settings)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Arguments of the command; --json without a file means the standard output."""
        for place, text in reversed(list(enumerate(args))):
            following = args[place + 1 : place + 2]
            if text == "--json" and (not following or (following[0].startswith("-") and following[0] != "-")):
                args = [*args[: place + 1], "-", *args[place + 1 :]]
        for parameter in self.params:
            if isinstance(parameter, TyperOption) and parameter.nargs > 1:
                _check_count(parameter, args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        flags: dict[str, str] = {}
        for parameter in self.params:
            if isinstance(parameter, TyperOption):
                flag = max(parameter.opts, key=len)
                flags |= {str(parameter.name): flag, flag.lstrip("-").replace("-", "_"): flag}
        before = FLAGS.set(flags)
        try:
            return super().invoke(ctx)
        finally:
            FLAGS.reset(before)


def _check_count(option: TyperOption, args: list[str]) -> None:
    """Raise where ``option``, which takes several numbers, is given fewer: else the next option would be taken for one."""
    for place, text in enumerate(args):
        if text in option.opts:
            given = []
            for value in args[place + 1 : place + 1 + option.nargs]:
                if value.startswith("-") and value[1:2] not in "0123456789.":
                    break
                given.append(value)
            if len(given) < option.nargs:
                takes = f"takes {option.nargs} numbers, {option.metavar}"
                raise typer.BadParameter(f"{text} {takes}, but got {len(given)}: {' '.join(given) or 'none'}")


class Application(typer.Typer):
    """An application all of whose commands are of :class:`Command`."""

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        return super().command(name, cls=Command, **settings)
