"""The library that shows the scene: imported on first use, and named with its fix where it is missing."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any


def viser() -> Any:
    """The module of the extra ``[view]``; ``ValueError`` that says how to install it."""
    try:
        return import_module("viser")
    except ImportError:
        raise ValueError("the view needs viser: pip install 'aoro-gym[view]'") from None


def is_installed() -> bool:
    """Whether :func:`viser` would find it."""
    return find_spec("viser") is not None
