"""Which form of the kernel that advances twins is the faster one on a GPU: one thread a twin, or four warps for 32 twins.

``forms.json`` holds what was measured: main steps/s of both forms, beside each other in one run, by number of twins
(``python -m studies.roles``).
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_name("forms.json")


@cache
def measured() -> dict[str, Any]:
    """The table: ``card``, ``scene``, and ``steps_per_s`` by number of twins, of ``one_thread`` and ``roles``."""
    return json.loads(TABLE.read_text(encoding="utf-8"))


def faster_by_roles(num_twins: int) -> bool:
    """Whether roles were faster at the measured number of twins that is nearest, by ratio."""
    rates = {int(count): rate for count, rate in measured()["steps_per_s"].items()}
    nearest = min(rates, key=lambda count: max(count / num_twins, num_twins / count))
    return rates[nearest]["roles"] > rates[nearest]["one_thread"]


def choose_roles(
    asked: bool | None, num_twins: int, *, on_cuda: bool, obstacle: str | None, as_measured: bool = True
) -> bool:
    """Whether twins are advanced by roles.

    Args:
        asked: Whether they are to be; None: where it is known to be faster.
        num_twins: Of the device.
        on_cuda: Whether it is a GPU.
        obstacle: What they have that roles do not know, or None.
        as_measured: Whether laws and ground are such as were measured; of others nothing is known.

    Raises:
        ValueError: roles are asked for where there are none.
    """
    if not on_cuda:
        obstacle = "run on a CPU"
    if obstacle is not None:
        if asked:
            raise ValueError(
                f"roles is True, but these twins {obstacle}, for which there is no such kernel; leave it out"
            )
        return False
    return as_measured and faster_by_roles(num_twins) if asked is None else asked
