"""What circuit theory says of a full turn, apart from the twin's kernels: NumPy in float64, from the machine's parameters.

From the closed form to the time course, each a module:

- :mod:`~aoro_gym.validation.theory.circuit`: static flow balance and the linearised circuit's closed forms;
- :mod:`~aoro_gym.validation.theory.half`: the bodies' masses about the hinge;
- :mod:`~aoro_gym.validation.theory.states`: states of machine and circuit, and limits that can be taken away;
- :mod:`~aoro_gym.validation.theory.hydraulics`: the circuit's motion, each component by the law that the machine chooses;
- :mod:`~aoro_gym.validation.theory.planar`: a planar machine of two equal halves on that circuit, its linearisation about
  the steady turn, and its motion;
- :mod:`~aoro_gym.validation.theory.sensitivities`: what each effect does to the key figures, and why theory says nothing of
  some.

Sources: Merritt, *Hydraulic Control Systems* (1967); Krus, *On Load Sensing Fluid Power Systems* (1988).
"""
