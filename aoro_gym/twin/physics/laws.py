"""Numbers of the options of laws, for the branches of device code."""

import warp as wp

from aoro_gym.machine.laws import OPTIONS


def option(law: str, name: str) -> int:
    """The number by which device code knows the option ``name`` of a ``law``."""
    return wp.constant(OPTIONS[law].index(name))
