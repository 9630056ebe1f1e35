"""Libraries that only some terrains need: imported on first use, and named with their fix where they are missing."""

from importlib import import_module
from typing import Any


def import_extra(module: str, what: str) -> Any:
    """The module of the extra ``[terrain]``; ``ValueError`` naming ``what`` needs it and how to install it."""
    try:
        return import_module(module)
    except ImportError:
        library = module.partition(".")[0]
        raise ValueError(f"{what} needs {library}: pip install 'aoro-gym[terrain]'") from None
