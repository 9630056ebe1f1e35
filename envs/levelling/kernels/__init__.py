"""A control step of levelling on a device, one vehicle a thread: act, then the twins, then sense, judge and observe.

The same as the methods of :class:`aoro_gym.envs.levelling.task.Levelling` do with arrays, on the same memory, and equal to
them up to rounding. What drives is of :mod:`aoro_gym.envs.path_tracking.kernels`.
"""
