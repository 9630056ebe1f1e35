"""Small kernels that measure what a device does at best: chains of an operation, and a stream through memory."""

# Kernels: Warp reads their annotations.
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import time
from typing import Any

import numpy as np
import warp as wp

WIDTH = 8
"""Independent chains a thread, where units shall be full; one chain shows their latency."""
REPEATS = 8
"""Operations of a chain in one turn of the loop."""
RUNS, RUN = 15, 0.02
"""Runs, of which the best counts, and the time [s] of each."""


@wp.struct
class Factors:
    """Opaque operands, so that no compiler knows a result beforehand."""

    a: float
    b: float


@wp.func
def multiply_add(x: float, p: Any):
    return x * p.a + p.b


def factors(device: Any) -> Any:
    """:class:`Factors` that keep every chain of :func:`multiply_add` near 1."""
    layout: Any = Factors
    return wp.array(np.array([(0.999, 0.001)], dtype=layout.numpy_dtype()), dtype=Factors, device=device)


def chains(operation: Any, operands: Any, width: int, *, simd: bool = False) -> Any:
    """Kernel of ``width`` independent chains of ``operation(x, operands)`` a thread; on a CPU scalar, as the twin is, or
    SIMD. ``operands`` is a struct with a small ``b``, by which chains begin apart."""
    lanes = wp.types.vector(length=width, dtype=float)

    def run(probes: wp.array(dtype=operands), turns: int, last: wp.array(dtype=float)):
        t = wp.tid()
        p = probes[t % probes.shape[0]]
        x = lanes()
        for lane in range(width):
            x[lane] = 1.0 + p.b * float(t % 7 + lane)  # pyright: ignore[reportOperatorIssue]
        for _turn in range(turns):
            for _repeat in range(REPEATS):
                for lane in range(width):
                    x[lane] = operation(x[lane], p)
        last[t] = wp.dot(x, x)  # pyright: ignore

    flags = "-march=native" if simd else "-march=native -fno-slp-vectorize"
    options = {"fast_math": True, "default_grid_stride": False, "cpu_compiler_flags": flags}
    return wp.kernel(run, enable_backward=False, module="unique", module_options=options)


@wp.kernel(enable_backward=False)
def copy(source: wp.array(dtype=float), target: wp.array(dtype=float), b: float):
    t = wp.tid()
    target[t] = source[t] + b


def best(launch: Any, device: Any) -> float:
    """Shortest time [s] of a turn: ``launch(turns)`` with turns enough for ``RUN``, ``RUNS`` times. On a CPU the
    process's own time, in which waiting for other work does not count."""
    clock = time.process_time if device.is_cpu else time.perf_counter

    def timed(turns: int) -> float:
        wp.synchronize_device(device)
        began = clock()
        launch(turns)
        wp.synchronize_device(device)
        return clock() - began

    turns = 1
    timed(turns)
    while (spent := timed(turns)) < 0.5 * RUN:
        turns *= 2
    turns = max(1, round(turns * RUN / spent))
    return min(timed(turns) for _ in range(RUNS)) / turns


def probe_time(operation: Any, operands: Any, width: int, threads: int, *, simd: bool = False) -> float:
    """Time [s] of one operation of each of ``threads`` x ``width`` chains on the device of ``operands`` (1,).

    Args:
        operation: Function of the device that a chain repeats.
        operands: Array (1,) of what it takes.
        width: Chains of a thread.
        threads: Threads of the launch.
        simd: Whether the compiler may make vectors of the chains.

    Raises:
        RuntimeError: a result is not what chains that stay near 1 give.
    """
    device = operands.device
    kernel = chains(operation, operands.dtype, width, simd=simd)
    last = wp.zeros(threads, dtype=float, device=device)
    block = 256  # two warps for each of a multiprocessor's four schedulers

    def launch(turns: int) -> None:
        wp.launch(kernel, dim=threads, inputs=[operands, turns, last], device=device, block_dim=block)

    spent = best(launch, device) / REPEATS
    mean = last.numpy() / width  # square
    if not (np.all(mean > 0.3) and np.all(mean < 3.0)):
        raise RuntimeError(f"{operation.key} ended between {mean.min()} and {mean.max()}, but must stay near 1")
    return spent


def full(device: Any) -> int:
    """Threads that keep all units of ``device`` busy; of a CPU it is one core that is measured."""
    return 1 if device.is_cpu else 4096 * device.sm_count


def bandwidth(device: Any) -> float:
    """Bytes [1/s] of a stream read and written."""
    size = 2**24 if device.is_cpu else 2**27
    source, target = (wp.ones(size, dtype=float, device=device) for _ in range(2))

    def launch(turns: int) -> None:
        for _ in range(turns):
            wp.launch(copy, dim=size, inputs=[source, target, 1.0], device=device)

    spent = best(launch, device)
    if target.numpy()[:: size // 8].tolist() != [2.0] * 8:
        raise RuntimeError("the copied stream is not what was written")
    return 8.0 * size / spent
