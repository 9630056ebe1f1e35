"""What a task adds to a batch of twins: goals, measurements, judgement, and the terms of reward and observation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.randomisation import Draws, Randomisation
from aoro_gym.envs.terms import Array, ObservationTerm, RewardTerm
from aoro_gym.twin import Machine
from aoro_gym.twin.records import Output


@dataclass(frozen=True)
class Outputs:
    """Sampled outputs of the twins over one control step.

    ``values`` has shape (frames, channels, N), SI units as in ``aoro_gym.twin.records.OUTPUT_UNITS``. They may alias
    the twins' memory: they hold until the next step.
    """

    values: Array

    def last(self, channel: str) -> Array:
        """Channel at the end of the step, shape (N,)."""
        return self.values[-1, channel_row(channel)]

    def samples(self, channel: str) -> Array:
        """All samples of the channel over the step, oldest first, shape (frames, N)."""
        return self.values[:, channel_row(channel)]


def channel_row(channel: str) -> int:
    """Row of an output channel; ValueError that lists the channels if there is none of that name."""
    try:
        return int(Output[channel.upper()])
    except KeyError:
        known = ", ".join(row.name.lower() for row in Output)
        raise ValueError(f"there is no output '{channel}'; choose one of: {known}") from None


@dataclass(frozen=True)
class Start:
    """Where K sub-environments start: arrays of shape (K,), ``position`` (K, 2)."""

    joint_angle: NDArray[np.float64]
    """[rad]"""
    heading: NDArray[np.float64]
    """Of the front frame [rad]."""
    position: NDArray[np.float64]
    """Of the hinge in the plan [m]."""


class Task(Protocol):
    """A task for N twins. The environment calls, in this order:

    ``allocate`` once; then ``start`` and ``rest`` for those that reset; and every control step ``commands``,
    ``advance``, the reward terms, ``failures``, ``renew``, ``info``, the observation terms.

    Everything random is drawn in ``start``, from one generator a sub-environment, so that no sub-environment depends
    on its neighbours.
    """

    option_names: ClassVar[tuple[str, ...]]
    """Keys of ``reset(options=...)`` that the task takes."""
    render_channels: ClassVar[tuple[str, ...]]
    """Names of what :meth:`traces` gives."""

    control_step: float
    """[s] between two actions."""
    sample_step: float
    """[s] between two output samples."""
    action_space: spaces.Box[Any]
    """Of one sub-environment."""
    reward_terms: Mapping[str, RewardTerm]
    observation_terms: Mapping[str, ObservationTerm]
    randomisation: Randomisation

    def allocate(self, num_envs: int) -> None:
        """Make the arrays of the state."""
        ...

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        """Begin the episodes of the sub-environments ``where`` (K,), whose machines are ``machine`` (1 or K variants).

        Raises ValueError naming a wrong option.
        """
        ...

    def rest(self, where: NDArray[np.intp], outputs: Outputs) -> None:
        """First measurements of the sub-environments ``where``, at rest."""
        ...

    def commands(self, actions: Array) -> Mapping[str, Array]:
        """Commands of the twins for ``actions`` (N, A) within the action space; remembers them."""
        ...

    def advance(self, outputs: Outputs, time: Array) -> None:
        """Take in what happened over a control step that ended at ``time`` (N,) [s]; goals stay as they were."""
        ...

    def failures(self) -> tuple[Array, list[str]]:
        """Reason by which each sub-environment ends, as an index (N,) into the list of reasons; 0 goes on."""
        ...

    def renew(self) -> None:
        """Set the goals of the next control step."""
        ...

    def view(self) -> Any:
        """What the terms see: an immutable snapshot with an ``xp`` and :class:`Outputs`."""
        ...

    def info(self) -> dict[str, Array]:
        """What is logged beside the reward, by name, each a fresh array of shape (N,)."""
        ...

    def traces(self) -> Array:
        """What rendering keeps of this control step, shape (len(render_channels), N)."""
        ...

    def scene(self, machine: Machine) -> Any:
        """A :class:`aoro_gym.envs.rendering.Scene` of one sub-environment with this machine."""
        ...
