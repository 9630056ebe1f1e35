"""The kernels of a kind of ground, made when first asked for."""

from collections.abc import Callable
from functools import cache
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.advance import advance
from aoro_gym.twin.kernels.laws import ChosenLaws
from aoro_gym.twin.kernels.reset import reset


@cache
def build(kind: Any, laws: Any, *, portable: bool = False) -> tuple[Any, Any]:
    """The kernels ``reset`` and ``advance`` for one kind of ground (``Planes``, ``Rasters`` or ``Meshes``) and of laws
    (``DefaultLaws`` or ``ChosenLaws``); ``portable``: for every CPU of this architecture, not for this one.

    Each pair is a module of its own, compiled when first asked for. On CUDA with approximate division, roots and
    exponentials (``fast_math``; the CPU's compiler ignores it): 4.5 times the speed, and a turn that differs by 1e-4 of a
    channel's range at most.
    """
    module = f"{__package__}.{kind.key.lower()}" + ("_laws" if laws is ChosenLaws else "")
    options = {"fast_math": True, "default_grid_stride": False}
    if portable:
        module += "_portable"
        options |= {"cpu_compiler_flags": "", "block_dim": 1}
    wp.set_module_options(options, module=module)

    def kernel(function: Callable[..., None], **kinds: Any) -> Any:
        generic = wp.kernel(function, enable_backward=False, module=module)
        return wp.overload(generic, kinds)

    return kernel(reset, terrain=kind), kernel(advance, terrain=kind, laws=laws)
