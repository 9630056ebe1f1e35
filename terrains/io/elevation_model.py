"""What a reader hands on: heights in local metres, and the file's own triangles where they are whole."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.heights import Heights
from aoro_gym.terrains.io.frame import CoordinateFrame


@dataclass(frozen=True, eq=False)
class ElevationModel:
    """Ground in local x, y and world z [m]."""

    heights: Heights
    frame: CoordinateFrame
    mesh: tuple[NDArray[np.float64], NDArray[np.int32]] | None = None
    """Vertices (V, 3) and faces (F, 3) of one whole surface without overhangs, the same as ``heights``."""

    def with_heights_scaled(self, factor: float) -> ElevationModel:
        """The same with all heights multiplied by ``factor``."""
        mesh = None if self.mesh is None else (self.mesh[0] * [1.0, 1.0, factor], self.mesh[1])
        frame = replace(self.frame, z_scale=self.frame.z_scale * factor)
        return ElevationModel(self.heights.replaced(self.heights.z * factor), frame, mesh)
