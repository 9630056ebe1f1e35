"""What the pictures are drawn from: the task, and the channels that it has written so far."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.path_tracking.courses import Course, HeightMap
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.machine.solid import Points


class Tracked(Protocol):
    """What the pictures need of the task."""

    render_channels: ClassVar[tuple[str, ...]]
    """Names of the columns of a history."""

    @property
    def courses(self) -> tuple[Course, ...]:
        """By the channel ``course``."""
        ...

    table: PathTable
    """Paths by the channel ``path``."""
    height_map: HeightMap
    """Grounds by the channel ``course``."""


class History:
    """The channels (frames, channels) of one sub-environment, without the rows before its start."""

    def __init__(self, names: Sequence[str], channels: NDArray[np.float32]):
        self._rows = channels[~np.isnan(channels[:, 0])].astype(np.float64)
        self._columns = {name: i for i, name in enumerate(names)}
        self.now = dict(zip(names, self._rows[-1], strict=True))
        """The newest row by name."""
        self.course, self.path = int(self.now["course"]), int(self.now["path"])

    def __getitem__(self, name: str) -> Points:
        """A channel (frames,)."""
        return self._rows[:, self._columns[name]]

    def places(self, x: str, y: str) -> Points:
        """Two channels beside each other (frames, 2)."""
        return np.stack([self[x], self[y]], axis=1)
