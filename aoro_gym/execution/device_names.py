"""Names of devices, as users give them."""

SIMD = "cpu:simd"
"""The CPU, on which twins go by several lanes of a core at once (:mod:`aoro_gym.execution.lanes`)."""

ALL_GPUS = "cuda:all"
"""Every GPU of this computer."""


def base(name: str) -> str:
    """``name`` as Warp and torch know it: ``"cpu"`` for :data:`SIMD`."""
    return "cpu" if name == SIMD else name


def on_cpu(name: str) -> bool:
    """Whether ``name`` is the CPU, with lanes or without."""
    return base(name) == "cpu"
