"""Cross-references in docstrings, such as ``:class:`Twin```, as links. One that names nothing is a warning."""

import re
from typing import Any

import griffe

ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`(~?)([\w.]+)`")
LITERAL = re.compile(r"::$", re.MULTILINE)
DOCTEST = re.compile(r"^>>> .+(?:\n.+)*", re.MULTILINE)
log = griffe.get_logger(__name__)


class Roles(griffe.Extension):
    """Markdown in place of reStructuredText, in every docstring of a package."""

    def on_package(self, *, pkg: griffe.Module, **kwargs: Any) -> None:
        rewrite(pkg)


def rewrite(thing: griffe.Object) -> None:
    """Rewrite the docstrings of a module or class and of all that is defined in it."""
    if thing.docstring:
        text = ROLE.sub(lambda role: link(thing, short=bool(role[1]), name=role[2]), thing.docstring.value)
        thing.docstring.value = DOCTEST.sub(r"```pycon\n\g<0>\n```", LITERAL.sub(":", text))
    for member in thing.members.values():
        if isinstance(member, griffe.Object):
            rewrite(member)


def link(scope: griffe.Object, name: str, *, short: bool) -> str:
    """Link to what ``name`` means in ``scope``, which leads there if the documentation has it."""
    shown = name.rpartition(".")[2] if short else name.lstrip(".")
    try:
        path = find(scope, name)
    except (KeyError, griffe.GriffeError):
        log.warning("%s: the docstring refers to %s, which does not exist", scope.path, name)
        return f"`{shown}`"
    return f'<autoref optional identifier="{path}"><code>{shown}</code></autoref>'


def find(scope: griffe.Object, name: str) -> str:
    """Path of what a full name, one with a leading dot (of the same package), or one that is known in ``scope`` means."""
    if name.startswith("."):
        module = scope.module
        package = module if module.is_init_module or module.parent is None else module.parent
        return package[name[1:]].canonical_path
    first, *rest = name.split(".")
    path = ".".join([first if first == scope.package.name else scope.resolve(first), *rest])
    if path.split(".")[0] != scope.package.name:
        return path  # of another library
    return scope.modules_collection[path].canonical_path
