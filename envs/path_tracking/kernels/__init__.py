"""A control step of path tracking on a device, one vehicle a thread: act, then the twins, then sense, judge and observe.

The same as the methods of :class:`aoro_gym.envs.path_tracking.task.PathTracking` do with arrays, on the same memory, and
equal to them up to rounding.
"""
