"""One sub-environment as a plain ``Env``: a thin view, so that both agree to the bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aoro_gym.envs.core.rendering import RENDER_MODES
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.twin import Twin

BATCH_ARGUMENTS = ("num_envs", "autoreset_mode", "output")
"""Arguments that only vector environments have."""


class TwinEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A vector environment with one sub-environment and no autoreset, without its batch axis.

    Takes the same arguments as ``vector_type``, less ``num_envs``, ``autoreset_mode`` and ``output``.
    ``reset(options=...)`` takes the same keys, less ``reset_mask``.
    """

    vector_type: ClassVar[type[TwinVectorEnv]]
    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **arguments: Any):
        for name in BATCH_ARGUMENTS:
            if name in arguments:
                raise ValueError(f"{name} belongs to gymnasium.make_vec; one environment has none")
        check_keywords(self.vector_type, arguments, BATCH_ARGUMENTS)
        self.vector = self.vector_type(
            num_envs=1, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode, **arguments
        )
        """The vector environment behind this one."""
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": self.vector.metadata["render_fps"]}
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    @property
    def action_layout(self) -> dict[str, slice]:
        """Where each signal stands in the action, of tasks that name their signals."""
        return self.vector.action_layout

    @property
    def observation_layout(self) -> dict[str, slice]:
        """Where each observation term stands in the observation."""
        return self.vector.observation_layout

    @property
    def twin(self) -> Twin:
        """The one twin."""
        return self.vector.twin

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        if options and "reset_mask" in options:
            raise ValueError("options['reset_mask'] belongs to vector environments; leave it out")
        self.vector.generators[0] = self.np_random
        observations, infos = self.vector.reset(options=options)
        return observations[0], _first(infos)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by one control step; see :meth:`TwinVectorEnv.step`."""
        observations, rewards, terminated, truncated, infos = self.vector.step(np.asarray(action)[None])
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), _first(infos)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """A frame (height, width, 3), or None."""
        frames = self.vector.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window, if there is one."""
        self.vector.close()


def _first(infos: dict[str, Any]) -> dict[str, Any]:
    """Infos of the only sub-environment."""
    return {
        name: value[0].item() if isinstance(value[0], np.generic) else value[0]
        for name, value in infos.items()
        if not name.startswith("_") and infos[f"_{name}"][0]
    }
