"""The kernels of a kind of ground, made when first asked for."""

from collections.abc import Callable
from functools import cache, update_wrapper
from types import FunctionType
from typing import Any

import warp as wp

from aoro_gym.twin.kernels import hubs
from aoro_gym.twin.kernels.advance import advance
from aoro_gym.twin.kernels.hydraulics import displace, hydraulics
from aoro_gym.twin.kernels.laws import ChosenLaws, DefaultLaws
from aoro_gym.twin.kernels.outputs import record_outputs
from aoro_gym.twin.kernels.reset import reset
from aoro_gym.twin.kernels.roles import BLOCK_DIM
from aoro_gym.twin.kernels.tree import tree_with_load

BLOCKS = 3
"""Blocks of roles that a multiprocessor is to hold, which limits the registers of a thread."""


def build(
    kind: Any,
    laws: Any,
    *,
    portable: bool = False,
    measured_hubs: bool = False,
    objects: bool = False,
    soil: bool = False,
    passes: bool = False,
    load: bool = False,
    crane: bool = False,
    by_roles: bool = False,
) -> tuple[Any, Any]:
    """The kernels ``reset`` and ``advance`` for one kind of ground (``Planes``, ``Rasters`` or ``Meshes``) and of laws
    (``DefaultLaws`` or ``ChosenLaws``); ``portable``: for every CPU of this architecture, not for this one;
    ``measured_hubs``: without the driveline (:mod:`aoro_gym.twin.kernels.hubs`); ``objects``: with the solid objects of
    worlds (:mod:`aoro_gym.twin.kernels.solids`), where ``advance`` takes the kind of ``OBJECT_GROUNDS``; ``soil``: on soft
    ground (:mod:`aoro_gym.twin.kernels.soil`), where it takes that of ``SOIL_GROUNDS``, or with ``passes`` that of
    ``PASS_GROUNDS``; ``load``: of machines that carry one (:mod:`aoro_gym.twin.kernels.tree`); ``crane``: of machines with a
    crane (:mod:`aoro_gym.twin.kernels.crane_on_frame`), which carry a load, too, if they have one; ``by_roles``: with
    ``advance_by_roles`` (:mod:`aoro_gym.twin.kernels.roles.advance`) in place of ``advance``, on CUDA and without any of
    these others.

    Each pair is a module of its own, compiled when first asked for. On CUDA with approximate division, roots and
    exponentials (``fast_math``; the CPU's compiler ignores it): about twice the speed, and a turn that differs by 1e-4 of a
    channel's range at most.
    """
    return _build(kind, laws, portable, measured_hubs, objects, soil, passes, load and not crane, crane, by_roles)


@cache
def _build(
    kind: Any,
    laws: Any,
    portable: bool,
    measured_hubs: bool,
    objects: bool,
    soil: bool,
    passes: bool,
    load: bool,
    crane: bool,
    by_roles: bool,
) -> tuple[Any, Any]:
    module = f"{__package__}.{kind.key.lower()}" + ("_laws" if laws is ChosenLaws else "")
    module += "_hubs" if measured_hubs else ""
    module += "_objects" if objects else ""
    module += "_soil" if soil else ""
    module += "_passes" if passes else ""
    module += "_load" if load else ""
    module += "_crane" if crane else ""
    options = {"fast_math": True, "default_grid_stride": False}
    if portable:
        module += "_portable"
        options |= {"cpu_compiler_flags": "", "block_dim": 1}

    def kernel(function: Callable[..., None], module: str = module, limits: Any = None, **kinds: Any) -> Any:
        wp.set_module_options(options, module=module)
        generic = wp.kernel(function, enable_backward=False, module=module, launch_bounds=limits)
        return wp.overload(generic, kinds)

    if by_roles:  # apart: whoever moves by roles has no need of the other form
        resetting = kernel(reset, f"{module}_reset", terrain=kind)
        options["block_dim"] = BLOCK_DIM
        return resetting, kernel(_by_roles(laws), f"{module}_roles", (BLOCK_DIM, BLOCKS), terrain=kind, laws=laws)
    advancing = advance_with_measured_hubs() if measured_hubs else advance
    felt = kind
    if objects:
        advancing, felt = among_objects(advancing, kind)
    elif soil:
        advancing, felt = on_soil(advancing, kind, passes)
    if load:
        advancing = with_others(advancing, {"tree": tree_with_load})
    elif crane:
        advancing, laws = with_crane(advancing, laws, covered=objects or soil)
    return kernel(reset, terrain=kind), kernel(advancing, terrain=felt, laws=laws)


def _by_roles(laws: Any) -> Any:
    """The function ``advance_by_roles`` with room in shared memory for what the laws need."""
    from aoro_gym.twin.kernels.roles.advance import advance_by_roles  # few twins need it
    from aoro_gym.twin.kernels.roles.board import record_words, shared_words

    default = laws is not ChosenLaws
    return with_others(
        advance_by_roles,
        {"WORDS": wp.constant(record_words(default)), "ROOM": wp.constant(shared_words(default))},
    )


def among_objects(function: Any, kind: Any) -> tuple[Any, Any]:
    """An ``advance`` as it is for machines that solid objects touch, and the kind of ground with objects on it that it
    takes."""
    from aoro_gym.twin.kernels.solids import (  # few twins need them
        OBJECT_GROUNDS,
        object_corner_contact,
        object_hull_loads,
        record_object_outputs,
    )

    recorded = {"record_outputs": function.__globals__["record_outputs"]}
    outputs = wp.func(with_others(record_object_outputs.func, recorded), module=function.__module__)
    parts = {"corner_contact": object_corner_contact, "hull_loads": object_hull_loads, "record_outputs": outputs}
    return with_others(function, parts), OBJECT_GROUNDS[kind]


def on_soil(function: Any, kind: Any, passes: bool) -> tuple[Any, Any]:
    """An ``advance`` as it is for machines on soft ground, with passes or without, and the kind of ground of soil that it
    takes."""
    from aoro_gym.twin.kernels.soil import (  # few twins need them
        PASS_GROUNDS,
        SOIL_GROUNDS,
        lost_on_soil,
        record_soil_outputs,
        soil_corner_contact,
        soil_hull_loads,
    )

    recorded = {"record_outputs": function.__globals__["record_outputs"]}
    outputs = wp.func(with_others(record_soil_outputs.func, recorded), module=function.__module__)
    parts = {"corner_contact": soil_corner_contact, "hull_loads": soil_hull_loads, "record_outputs": outputs}
    parts["lost"] = lost_on_soil
    return with_others(function, parts), (PASS_GROUNDS if passes else SOIL_GROUNDS)[kind]


def with_crane(function: Any, laws: Any, *, covered: bool) -> tuple[Any, Any]:
    """An ``advance`` as it is for machines with a crane, and the kind of ``laws`` with cranes that it takes; ``covered``:
    whether objects or soil are on the ground."""
    from aoro_gym.twin.kernels import crane_on_frame as crane  # few twins have one

    sections = {
        "further_sections": crane.crane_sections,
        "further_step": crane.crane_step,
        "keep_further": crane.keep_sections,
    }
    oil = wp.func(with_others(hydraulics.func, sections), module=function.__module__)
    parts = {
        "hydraulics": oil,
        "tree": crane.tree_with_crane,
        "further_contact": crane.log_on_covered_ground if covered else crane.log_on_ground,
        "with_laws": crane.with_laws_of_crane,
        "load_signals": crane.load_signals_with_crane,
        "record_further_outputs": crane.record_crane_outputs,
    }
    kinds = {DefaultLaws: crane.DefaultLawsWithCrane, ChosenLaws: crane.ChosenLawsWithCrane}
    return with_others(function, parts), kinds[laws]


@cache
def advance_with_measured_hubs() -> Callable[..., None]:
    """The function ``advance`` as it is for wheels that a driveline outside turns."""
    loop = {"driveline_step": hubs.measured_driveline_step, "motor_pressures": hubs.measured_motor_pressures}
    shut = {"driveline_displace": hubs.measured_driveline_displace}
    outputs = {"motor_pressures": hubs.unknown_motor_pressures}
    parts = {
        part.key: wp.func(with_others(part.func, others), module=hubs.__name__)
        for part, others in ((hydraulics, loop), (displace, shut), (record_outputs, outputs))
    }
    return with_others(
        advance,
        {
            **parts,
            "with_laws": hubs.measured_with_laws,
            "driveline_control": hubs.measured_driveline_control,
            "engine_step": hubs.measured_engine_step,
        },
    )


def with_others(function: Any, others: dict[str, Any]) -> Any:
    """A copy of a Python ``function`` that finds ``others`` by the names of some that it calls."""
    missing = sorted(others.keys() - function.__globals__.keys())
    if missing:
        raise NameError(f"{function.__name__} knows nothing by the name of {', '.join(missing)}")
    copied = FunctionType(function.__code__, {**function.__globals__, **others}, function.__name__)
    return update_wrapper(copied, function, updated=())
