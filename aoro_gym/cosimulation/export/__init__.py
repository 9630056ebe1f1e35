"""The twin as a shared library of C and as a functional mock-up unit (FMI 2.0 and 3.0), without Python inside.

:mod:`~aoro_gym.cosimulation.export.kernels` has the twin's kernels compiled ahead of time,
:mod:`~aoro_gym.cosimulation.export.source` writes the tables of C that follow from the machine and its record,
:mod:`~aoro_gym.cosimulation.export.build` compiles and links both with the readable sources in ``c``, and
:mod:`~aoro_gym.cosimulation.export.description` describes the result to importers.
"""

from aoro_gym.cosimulation.export.build import export_twin
from aoro_gym.cosimulation.export.compiler import NoCompiler
from aoro_gym.cosimulation.export.effects import with_effects

__all__ = ["NoCompiler", "export_twin", "with_effects"]
