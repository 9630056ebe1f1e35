"""Episodes that were drawn ahead begin where others end: at the end of a step, one launch for each part of it.

All launches are of a fixed number of threads, as they are recorded; what does not begin is left at once.
"""

import warp as wp

from aoro_gym.envs.core.kernels.step import (
    BEGUN,
    DONE,
    LEFT,
    UNMEANT,
    WRONG_OBSERVATION,
    WRONG_REWARD,
    StepMemory,
)
from aoro_gym.execution.scatter import store


@wp.struct
class Drawn:
    """Episodes that are drawn ahead, each M writes of the start of its sub-environment."""

    ready: wp.array(dtype=wp.bool)  # (N,) of whom there is one
    places: wp.array2d(dtype=wp.int64)  # (3, M) addresses of row 0, bytes to the next row, bytes that are written
    bits: wp.array2d(dtype=wp.int64)  # (N, M)
    marks: wp.array(dtype=wp.bool)  # (N,) which twins are reset


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels")
def choose(m: StepMemory, drawn: Drawn):
    """Whose episode begins: all that have ended and have one that is drawn, unless the host has to complain."""
    i = wp.tid()
    right = m.flags[UNMEANT] == 0 and m.flags[WRONG_REWARD] == 0 and m.flags[WRONG_OBSERVATION] == 0
    begins = right and m.ended[DONE, i] and drawn.ready[i]
    drawn.marks[i] = begins
    m.keeps[i] = not begins
    if begins:
        m.begun[wp.atomic_add(m.flags, BEGUN, 1)] = wp.int64(i)
    elif m.ended[DONE, i]:
        m.flags[LEFT] = 1


@wp.kernel(enable_backward=False, module="aoro_gym.envs.core.kernels")
def write_drawn(m: StepMemory, drawn: Drawn, threads: int):
    """Write the starts of those that begin; ``threads`` share the writes."""
    each = drawn.bits.shape[1]
    for number in range(wp.tid(), m.flags[BEGUN] * each, threads):
        i = m.begun[number / each]
        t = number % each
        store(drawn.places[0, t] + i * drawn.places[1, t], drawn.bits[int(i), t], drawn.places[2, t])
        if t == 0:
            drawn.ready[int(i)] = False
