"""A control step of turning on a device, one joint a thread: act, then the twins, then sense, judge and observe.

The same as the methods of :class:`aoro_gym.envs.turning.task.Turning` do with arrays, on the same memory, and equal to them
up to rounding.
"""
