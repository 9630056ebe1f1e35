"""Rays around the machines of a task: where they are and were, what each episode draws.

What casts them is loaded when a term asks for it: most environments have none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_range
from aoro_gym.envs.core.task import Outputs
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index
from aoro_gym.execution.streams import Generators
from aoro_gym.sensors.noise import draw_seeds

if TYPE_CHECKING:
    from aoro_gym.envs.core.ray_scenes import Ground
    from aoro_gym.sensors.raytrace import Scene

MOST_KEPT = 100
"""Poses of a sub-environment: 5 s of steps of 50 ms."""
_OF_SCENES = ("rays", "meshes", "meshes of the ground")  # keys of what is made anew where a scene is added


class RaySensing:
    """What terms that cast rays know of N sub-environments; see :mod:`aoro_gym.envs.core.ray_terms`.

    Args:
        num_envs: N.
        grounds: Which there are to stand on.
        control_step: [s].
        oldest: Age [s] of the oldest pose that any term asks for; None: no term casts rays, and nothing is kept.
        arrays: Where all lives.
    """

    def __init__(
        self,
        num_envs: int,
        grounds: Sequence[Ground],
        control_step: float,
        oldest: float | None,
        arrays: Arrays = HOST,
    ):
        xp, n = arrays.xp, num_envs
        kept = 0 if oldest is None else math.ceil(oldest / control_step - 1e-6) + 1
        check_range("control steps that a term looks back", kept, le=MOST_KEPT, note="; shorten its latency")
        self.arrays, self.num_envs, self.grounds = arrays, n, tuple(grounds)
        self.control_step, self.oldest = control_step, oldest
        self._ground, self._seeds = arrays.zeros(n, xp.int64), arrays.zeros(n, xp.int64)
        self._noise = arrays.ones(n)
        self._poses = arrays.zeros((kept, n, 7), xp.float32)
        self._met = {0}  # grounds that any machine has stood on
        self._made: dict[Any, Any] = {}
        self._remembered: dict[Any, Array] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_made": {}}  # made anew on its device

    def reset(self, rows: Index, ground: NDArray[Any], noise: Array, generators: Generators) -> None:
        """Episodes of the sub-environments ``rows`` (K,) begin.

        Args:
            rows: Sub-environments.
            ground: Which of the grounds they stand on (K,), on the host.
            noise: Multiples of noise and errors (K,).
            generators: One each, to draw with; where no term casts rays, nothing is drawn.
        """
        if self.oldest is not None:
            for array, values in ((self._ground, ground), (self._noise, noise), (self._seeds, draw_seeds(generators))):
                self.arrays.put(array, rows, values)
            new = set(np.unique(ground).astype(int).tolist()) - self._met
            if new:
                self._met |= new
                for key in _OF_SCENES:
                    self._made.pop(key, None)

    @property
    def device(self) -> str:
        """Warp's name of it."""
        return str(self.arrays.device)

    def made(self, key: Any, make: Any) -> Any:
        """What ``make()`` gives, kept on the device under ``key``."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def once(self, key: Any, view: Any, make: Any) -> Any:
        """What ``make()`` gives for a view, made once for all terms that ask for the same ``key``."""
        kept = self._made.get(("once", key))
        if kept is None or kept[0] is not view:
            kept = self._made["once", key] = view, make()
        return kept[1]

    def remembered(self, key: Any, shape: tuple[int, ...], kind: Any) -> Array:
        """An array under ``key`` that lasts from step to step, of zeros at first."""
        if key not in self._remembered:
            self._remembered[key] = self.arrays.zeros(shape, kind)
        return self._remembered[key]

    def scene(self, number: int) -> Scene:
        """What rays meet on a ground."""
        from aoro_gym.envs.core.ray_scenes import scene_of

        return self.made(("scene", number), lambda: scene_of(self.grounds[number], self.device))

    def rays(self) -> wp.array:
        """The scenes as device code has them, empty where no machine has stood so far: a scene takes 0.1 s to make."""
        from aoro_gym.sensors.raytrace.device import Rays

        struct: Any = Rays
        nothing = struct()
        return self.made(
            _OF_SCENES[0],
            lambda: wp.array(
                [self.scene(k).data if k in self._met else nothing for k in range(len(self.grounds))],
                dtype=struct,
                device=self.device,
            ),
        )

    def meshes(self, *, ground_only: bool) -> wp.array:
        """Identifiers of the scenes' triangles, or of their grounds' alone; 0 where no machine has stood so far."""

        def number(k: int) -> int:
            return (self.scene(k).ground if ground_only else self.scene(k).mesh).id if k in self._met else 0

        return self.made(
            _OF_SCENES[1 + ground_only],
            lambda: wp.array(
                [number(k) for k in range(len(self.grounds))], dtype=cast(Any, wp.uint64), device=self.device
            ),
        )

    def episodes(self, step: Array, outputs: Outputs, oldest: float) -> Any:
        """The struct that device code takes, poses of this step included.

        Args:
            step: Control steps since each episode began (N,).
            outputs: Of the twins, with their state.
            oldest: Age [s] of the oldest pose that is asked for.
        """
        from aoro_gym.envs.core.kernels import rays as kernels

        if self.oldest is None or oldest > self.oldest:
            kept = "no poses" if self.oldest is None else f"poses for {self.oldest:g} s"
            raise ValueError(
                f"a term looks back {oldest:g} s, but the environment keeps {kept}, as its observation terms need them:"
                " give it this term when it is made, as the function of an ObservationTerm"
            )
        shared: Any = kernels.Episodes()
        shared.ground, shared.step, shared.seeds, shared.noise, shared.poses = (
            self.arrays.shared(each) for each in (self._ground, step, self._seeds, self._noise, self._poses)
        )
        shared.control_step = self.control_step
        inputs = [shared, self.arrays.shared(outputs.state)]
        wp.launch(kernels.remember, dim=self.num_envs, inputs=inputs, device=self.device)
        return shared


def looks_back(terms: Any) -> float | None:
    """Age [s] of the oldest pose that any of the observation ``terms`` asks for; None where none casts rays."""
    ages = [getattr(term.function, "oldest", None) for term in terms.values()]
    return max((age for age in ages if age is not None), default=None)
