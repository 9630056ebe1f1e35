"""Typer's application, with commands whose errors name options as they are typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand, TyperOption

from aoro_gym.cli.outcome import FLAGS


class Command(TyperCommand):
    """A command that says, while it runs, which options stand for which arguments."""

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


class Application(typer.Typer):
    """An application all of whose commands are of :class:`Command`."""

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        return super().command(name, cls=Command, **settings)
