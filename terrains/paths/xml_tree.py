"""XML files of unknown origin as a tree of bounded size: no entities, no deep nesting, tags without namespaces."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

DEEPEST = 100
"""Elements within one another."""
MOST_ELEMENTS = 3_000_000
"""Of one file: about one million points."""

_DECLARED = re.compile(
    rb"""\s*<\?xml[^>]{0,200}encoding\s*=\s*["']((?:iso|windows|cp|koi8|mac|gb|big5|shift|euc)[\w\-]{1,20})["']""",
    re.IGNORECASE,
)


@dataclass(slots=True)
class Element:
    """An element with the line on which it starts."""

    tag: str
    """Lower case, without a namespace."""
    line: int
    attributes: dict[str, str]
    """By lower-case name."""
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Its own text, without that of its children."""
        return "".join(self.pieces).strip()

    def all(self, *tags: str) -> Iterator[Element]:
        """Its children of these tags."""
        return (child for child in self.children if child.tag in tags)

    def child_text(self, tag: str) -> str:
        """Text of its first child of this tag; empty without one."""
        return next((child.text for child in self.all(tag)), "")

    def walk(self) -> Iterator[Element]:
        """It and all elements within it, in the file's order."""
        waiting: list[Element] = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


def parse(data: bytes) -> Element:
    """The root element.

    Raises ``ValueError`` in one sentence, without the file's name, where the file is no XML, declares entities, or is
    larger than its bounds.
    """
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    top = Element("", 0, {})
    opened = [top]
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(opened) > DEEPEST or count > MOST_ELEMENTS:
            bound = (
                f"{DEEPEST} elements within one another" if count <= MOST_ELEMENTS else f"{MOST_ELEMENTS:,} elements"
            )
            raise ValueError(f"line {parser.CurrentLineNumber}: more than {bound} are not read")
        names = {_bare(name): value for name, value in attributes.items()}
        element = Element(_bare(tag), parser.CurrentLineNumber, names)
        opened[-1].children.append(element)
        opened.append(element)

    def end(_: str) -> None:
        opened.pop()

    def text(piece: str) -> None:
        opened[-1].pieces.append(piece)

    def entity(name: str, *_: object) -> None:
        raise ValueError(f"line {parser.CurrentLineNumber}: it declares the entity {name[:40]!r}, which is not read")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = text, entity
    try:
        parser.Parse(_as_utf8(data), True)
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code)
        raise ValueError(f"line {error.lineno}, column {error.offset + 1}: broken XML ({what})") from None
    return top.children[0]


def looks_like_xml(data: bytes) -> bool:
    """Whether a file starts as XML does, in any encoding of Unicode."""
    return data[:200].replace(b"\0", b"").lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n").startswith(b"<")


def _bare(name: str) -> str:
    return name.rpartition(":")[2].lower()


def _as_utf8(data: bytes) -> bytes:
    """The file's text as UTF-8: by its byte order mark, else as UTF-8, else as it declares, else as Latin-1."""
    for mark, encoding in (
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF32_BE, "utf-32"),
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if data.startswith(mark):
            return data.decode(encoding, errors="replace").encode()
    declared = _DECLARED.match(data)
    for encoding in ("utf-8", declared.group(1).decode() if declared else "utf-8"):
        try:
            return data.decode(encoding).encode()
        except (UnicodeError, LookupError):
            continue
    return data.decode("latin-1").encode()
