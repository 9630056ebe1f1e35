"""XML that is the same text for the same machine, with numbers that read back as they were."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

Element = ElementTree.Element


def numbers(*values: ArrayLike) -> str:
    """All numbers of ``values``, each in the fewest digits that read back to the same double; no negative zero."""
    flat = np.concatenate([np.asarray(value, dtype=np.float64).ravel() for value in values])
    return " ".join(f"{float(value) + 0.0!r}".removesuffix(".0") for value in flat)


def add(parent: Element, tag: str, **attributes: str) -> Element:
    """New last child of ``parent``; a trailing underscore of a name is dropped (``type_``)."""
    return ElementTree.SubElement(parent, tag, {name.rstrip("_"): text for name, text in attributes.items()})


def comment(parent: Element, text: str) -> None:
    """Comment as the last child of ``parent``; two hyphens, which would end it, become one."""
    while "--" in text:
        text = text.replace("--", "-")
    parent.append(ElementTree.Comment(f" {text} "))


def text_of(root: Element) -> str:
    """The document, indented by two spaces."""
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
