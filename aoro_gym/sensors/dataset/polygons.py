"""Polygons of masks along the edges of pixels, so that they hold exactly the mask's pixels.

A pixel in row r and column c is the square from (c, r) to (c + 1, r + 1). Edges between a pixel of the mask and one that is
none are chained to closed lines; a hole is joined with the line around it by a cut of no width, as COCO's polygons have no
holes. Drawn by parity, the polygons are the mask.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.int64]
LEFT_TURN = {(1, 0): (0, -1), (0, -1): (-1, 0), (-1, 0): (0, 1), (0, 1): (1, 0)}
"""Direction after a left turn, y down."""


def polygons(mask: NDArray[np.bool_]) -> list[list[int]]:
    """x, y by turns of a polygon for each connected piece of a mask (H, W), pixels being connected by their sides.

    >>> polygons(np.array([[True, True], [True, False]]))
    [[0, 0, 2, 0, 2, 1, 1, 1, 1, 2, 0, 2]]
    """
    from scipy import ndimage

    labelled: Any = ndimage.label(mask)
    pieces = labelled[0]
    boxes: Any = ndimage.find_objects(pieces)
    out = []
    for number, (rows, columns) in enumerate(boxes):
        lines = _lines(pieces[rows, columns] == number + 1)
        shift = np.array([columns.start, rows.start])
        out.append((_joined(lines) + shift).ravel().tolist())
    return out


def _lines(mask: NDArray[np.bool_]) -> list[Points]:
    """Closed lines (K, 2) around one connected piece, corners alone: the outer one clockwise on the picture, then holes."""
    padded = np.pad(mask, 1).astype(np.int8)
    starts: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)  # the mask lies to the right of every edge
    across, down = np.diff(padded, axis=1)[1:-1], np.diff(padded, axis=0)[:, 1:-1]
    for r, c in np.argwhere(across):  # left edge of the mask: upwards; right edge: downwards
        if across[r, c] > 0:
            starts[c, r + 1].append((0, -1))
        else:
            starts[c, r].append((0, 1))
    for r, c in np.argwhere(down):  # upper edge: to the right; lower edge: to the left
        if down[r, c] > 0:
            starts[c, r].append((1, 0))
        else:
            starts[c + 1, r].append((-1, 0))
    lines = []
    for begin in sorted(starts, key=lambda point: (point[1], point[0])):
        while starts[begin]:
            lines.append(_chained(starts, begin))
    return lines


def _chained(starts: dict[tuple[int, int], list[tuple[int, int]]], begin: tuple[int, int]) -> Points:
    """The line from ``begin`` on, whose edges are taken out of ``starts``.

    Where two pixels touch at a corner alone, it turns to the right: they are not connected there.
    """
    (x, y), step = begin, starts[begin].pop()
    first, corners = step, [begin]
    while True:
        x, y = x + step[0], y + step[1]
        if (x, y) == begin and not starts[begin]:
            return np.array(corners if step != first else corners[1:])
        options = starts[x, y]
        following = options[0] if len(options) == 1 else next(one for one in options if one != LEFT_TURN[step])
        options.remove(following)
        if following != step:
            corners.append((x, y))
        step = following


def _joined(lines: list[Points]) -> Points:
    """One closed line: every hole by a cut from its uppermost corner straight up to what is there."""
    outer = lines[0]
    for hole in lines[1:]:  # by rows: what lies above was joined before
        top = int(np.lexsort((hole[:, 0], hole[:, 1]))[0])
        x, y = hole[top]
        ends = np.roll(outer, -1, axis=0)
        level = outer[:, 1] == ends[:, 1]
        low, high = np.minimum(outer[:, 0], ends[:, 0]), np.maximum(outer[:, 0], ends[:, 0])
        above = level & (low <= x) & (x <= high) & (outer[:, 1] < y)
        at = int(np.argmax(np.where(above, outer[:, 1], -1)))
        foot = np.array([[x, outer[at, 1]]])
        cut = np.concatenate([foot, np.roll(hole, -top, axis=0), hole[top : top + 1], foot])
        outer = np.concatenate([outer[: at + 1], cut, outer[at + 1 :]])
    return outer
