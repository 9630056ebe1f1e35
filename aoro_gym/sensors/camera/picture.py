"""A picture with all that is known of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

UNDERGROWTH, NOTHING = -3, -1
"""Instances of the undergrowth's leaves, and of what met nothing."""
LAYERS = ("depth", "disparity", "instance", "class_id", "normals", "flow", "sunlit")
"""Fields of :class:`Picture` that are true."""


@dataclass(frozen=True, eq=False)
class Picture:
    """H rows of W pixels; but for ``rgb`` and ``numbers`` all is true: of the ray through the middle of the pixel, in the
    middle of its row's exposure."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) of a screen (sRGB)."""
    numbers: NDArray[np.uint16]
    """(H, W, 3) of the converter, linear."""
    depth: NDArray[np.float32]
    """(H, W) [m] along the camera's axis; infinite where nothing was met."""
    disparity: NDArray[np.float32]
    """(H, W) fx b / depth [pixels]: columns between the left and the right camera's view, distortion taken out."""
    instance: NDArray[np.int32]
    """(H, W) 0: ground, -1: nothing, -3: undergrowth."""
    class_id: NDArray[np.uint8]
    """(H, W) 255: nothing."""
    normals: NDArray[np.float32]
    """(H, W, 3) unit, in the camera's axes, of the surface without the bumps of its texture; zeros: nothing."""
    flow: NDArray[np.float32]
    """(H, W, 2) [pixels] right and down to where the place is drawn in the next picture, distortion included; NaN: nothing,
    or behind the camera then. Whether it is hidden there is not looked at."""
    sunlit: NDArray[np.bool_]
    """(H, W) whether the sun shines on it."""
    exposure: float
    """[s]"""
    time: float
    """[s] of the motion at which the first row's exposure began."""


class Stereo(NamedTuple):
    """What both cameras saw; the left one is the reference of the disparity."""

    left: Picture
    right: Picture
