"""Calibration: make a twin agree with a machine, by the published procedure or from logs.

``space``      which parameters are free, mapped onto the unit cube
``turns``      full turns of a whole population in one launch
``procedure``  the published procedure: valve curve, pressure drops, disc brake
``measured``   what it reads of a machine's own logs; ``procedure_logs`` takes its steps on them
``change``     what a change of parameters does, with the turn time restored
``fit``        bounded least squares whose Jacobian is one population, resumable
``probable``   from there, the most probable machine that has all figures
``right_turns``  the right side of the valve, likewise
``choice``     which family of laws logs speak for, by what it predicts of logs left out
``ensemble``   parameter sets that fit as well and differ as far as the data allow
"""

from aoro_gym.calibration.fit import Fit, least_squares_fit
from aoro_gym.calibration.space import Space

__all__ = ["Fit", "Space", "least_squares_fit"]
