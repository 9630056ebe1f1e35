"""Python's collection of garbage, where there is none."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def paused_collection() -> Iterator[None]:
    """Within it no cycles are collected. While modules are imported next to nothing becomes garbage, but Warp makes so many
    objects of the twin's functions that looking through them takes a tenth of the start. What was made counts as old."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() == 0:  # nobody keeps anything out of collections
            gc.freeze()
            gc.unfreeze()  # into the oldest generation, without being looked through
        if was_on:
            gc.enable()
