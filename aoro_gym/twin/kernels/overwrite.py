"""Kernels that overwrite parameters of some twins."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.records import MachineRecord


@wp.kernel(enable_backward=False)
def exchange(
    records: wp.array(dtype=MachineRecord), indices: wp.array(dtype=int), machines: wp.array(dtype=MachineRecord)
):
    """Write ``records`` into ``machines`` at ``indices``."""
    i = wp.tid()
    machines[indices[i]] = records[i]


@wp.kernel(enable_backward=False)
def multiply(indices: wp.array(dtype=int), values: wp.array2d(dtype=float), twins: wp.array(dtype=Any)):
    """Write multipliers of friction and rolling resistance into ``twins`` at ``indices``; negative ones leave the old."""
    i = wp.tid()
    one = twins[indices[i]]
    if values[0, i] >= 0.0:
        one.friction = values[0, i]
    if values[1, i] >= 0.0:
        one.rolling_resistance = values[1, i]
    twins[indices[i]] = one
