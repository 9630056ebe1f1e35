"""Contacts of the chassis with the solid objects of a world, as environments log, reward and judge them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from aoro_gym.execution.array_api import Array, namespace
from aoro_gym.twin.records import FIRST_OBJECT_OUTPUT, OBJECT_OUTPUT_UNITS

if TYPE_CHECKING:
    from aoro_gym.envs.core.task import Outputs

CHASSIS_ROWS = tuple(
    FIRST_OBJECT_OUTPUT + list(OBJECT_OUTPUT_UNITS).index(f"object_force_x_{part}") for part in ("front", "rear")
)
"""Rows of the outputs from which the force of all objects on a chassis stands, x, y, z [N] in the world's axes."""


OBJECT_ROWS = FIRST_OBJECT_OUTPUT + len(OBJECT_OUTPUT_UNITS)
"""Channels of twins among objects."""


def chassis_force(outputs: Outputs) -> Array:
    """Largest force [N] of the objects of a world on either chassis among the samples of a step (N,); 0 on bare ground.

    A sample is of the 1 ms before it: what comes and goes between two samples is not in it.
    """
    values = outputs.values
    xp = namespace(values)
    if values.shape[1] != OBJECT_ROWS:
        return xp.zeros_like(values[-1, 0])
    squares = [values[:, row] ** 2 + values[:, row + 1] ** 2 + values[:, row + 2] ** 2 for row in CHASSIS_ROWS]
    return xp.sqrt(xp.max(xp.maximum(*squares), axis=0))


def chassis_contact(view: Any) -> Array:
    """1 in each step in which an object of a world pushes a chassis; 0 on bare ground."""
    return (chassis_force(view.outputs) > 0.0) * 1.0


def contact_infos(outputs: Outputs) -> dict[str, Array]:
    """What is logged of twins among objects: ``chassis_contact``, bool, and ``chassis_force`` [N], each (N,)."""
    force = chassis_force(outputs)
    return {"chassis_contact": force > 0.0, "chassis_force": force}
