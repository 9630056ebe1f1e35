"""``AORO/PathTracking-v1``: the task of ``AORO/PathTracking-v0`` on courses of a difficulty that episodes draw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import Start
from aoro_gym.envs.path_tracking.courses import drawn_by_difficulty
from aoro_gym.envs.path_tracking.task import PathTracking
from aoro_gym.execution.streams import Generators
from aoro_gym.machine import Machine


class LimitTracking(PathTracking):
    """See :class:`aoro_gym.envs.path_tracking.task.PathTracking`; only the courses are drawn otherwise."""

    def start(
        self,
        where: NDArray[np.intp],
        generators: Generators,
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        options = drawn_by_difficulty(options, draws, where, len(self._s), len(self.courses))
        return super().start(where, generators, draws, machine, options)

    @property
    def has_kernels(self) -> bool:
        return type(self) is LimitTracking
