"""The machine: its independent parameters, their units, bounds and sources, and what follows from them."""

from aoro_gym.machine.parameters import Machine, OutsideRangeWarning

__all__ = ["Machine", "OutsideRangeWarning"]
