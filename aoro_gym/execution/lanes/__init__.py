"""Kernels of Warp on several lanes of a CPU core at once, a thread a lane: translated and compiled when first asked for."""

from aoro_gym.execution.lanes.library import compiled, cpp_compiler

__all__ = ["compiled", "cpp_compiler"]
