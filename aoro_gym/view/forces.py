"""Contact forces of the tires, of which the twin's outputs hold the loads alone."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.execution import devices
from aoro_gym.recording.commands import WHEELS
from aoro_gym.twin import Twin
from aoro_gym.twin.kernels.tire_forces import build
from aoro_gym.twin.recorded import BLOCK_DIM


class TireForces:
    """Forces of the ground on the tires of all twins, from their state alone; the twins do not notice."""

    def __init__(self, twin: Twin):
        self._twin = twin
        self._laws = twin._laws.laws if twin.has_crane else twin._laws  # tires know no crane
        self._kernel = build(type(twin.ground)._cls, type(self._laws)._cls)
        shape = (twin.num_twins, len(WHEELS))
        self._forces, self._feet = (wp.zeros(shape, dtype=wp.vec3, device=twin.device) for _ in range(2))

    def evaluate(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Contact points [m] and forces [N], (num_twins, 4, 3), in the world, of fl, fr, rl, rr."""
        twin = self._twin
        with devices.compiling(self._kernel, twin.device, BLOCK_DIM):
            wp.launch(
                self._kernel,
                dim=(twin.num_twins, len(WHEELS)),
                inputs=[twin.machines, self._laws, twin.ground, twin.state, self._forces, self._feet, twin.main_step],
                device=twin.device,
                block_dim=BLOCK_DIM,
            )
        feet, forces = (np.asarray(array.numpy(), dtype=np.float64) for array in (self._feet, self._forces))
        return feet, forces
