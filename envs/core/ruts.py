"""Ruts in soft ground, as environments log and reward them: forestry's own measure of the damage that a machine does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from aoro_gym.execution.array_api import Array, namespace
from aoro_gym.twin.records import FIRST_SOIL_OUTPUT, SOIL_OUTPUT_UNITS

if TYPE_CHECKING:
    from aoro_gym.envs.core.task import Outputs

DEEP_RUT = 0.1
"""Depth [m] of a rut by which the term ``rut_depth`` is measured: about from there on guides for thinning count it as
damage. (R)"""
SOIL_ROWS = FIRST_SOIL_OUTPUT + len(SOIL_OUTPUT_UNITS)
"""Channels of twins on soil."""
RUT_ROWS = tuple(FIRST_SOIL_OUTPUT + i for i, name in enumerate(SOIL_OUTPUT_UNITS) if name.startswith("rut_depth"))
"""Rows of the outputs with the ruts below the wheels."""


def mean_rut_depth(outputs: Outputs) -> Array:
    """Mean depth [m] of the ruts below the four wheels at the end of a step (N,), as they stay; 0 on hard ground."""
    values = outputs.values
    xp = namespace(values)
    if values.shape[1] != SOIL_ROWS:
        return xp.zeros_like(values[-1, 0])
    return sum(values[-1, row] for row in RUT_ROWS) / len(RUT_ROWS)


def rut_depth(view: Any) -> Array:
    """Mean depth of the ruts below the wheels that stay, in units of 10 cm, from where forestry counts damage; 0 on
    hard ground."""
    return mean_rut_depth(view.outputs) / DEEP_RUT


def rut_infos(outputs: Outputs) -> dict[str, Array]:
    """What is logged of twins on soil: ``rut_depth`` [m] (N,)."""
    return {"rut_depth": mean_rut_depth(outputs)}
