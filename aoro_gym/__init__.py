"""A fast digital twin of AORO, a 10 t articulated forestry research machine.

>>> from aoro_gym import Twin
>>> twin = Twin(num_twins=2)
>>> trace = twin.step({"steering_signal": 1.0}, duration=0.5, sample_every=0.01)
>>> trace["joint_angle"].shape
(50, 2)

World and body frames: x forward, y left, z up, right-handed. SI units throughout. A positive joint angle, and a
positive steering signal, is to the left. Names load on first use: ``import aoro_gym`` alone imports nothing of the twin;
it makes the environments known to Gymnasium, so that ``gymnasium.make("AORO/Turning-v0")`` works.
"""

from typing import TYPE_CHECKING

import lazy_loader

from aoro_gym.envs.registration import register_envs
from aoro_gym.version import VERSION as __version__

if TYPE_CHECKING:
    from aoro_gym.machine import Machine
    from aoro_gym.terrains import Plane
    from aoro_gym.twin import Twin

__all__ = ["Machine", "Plane", "Twin", "__version__"]

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "terrains": ("Plane",),
        "machine": ("Machine",),
        "twin": ("Twin",),
    },
)


def __dir__() -> list[str]:
    return list(__all__)


register_envs()
