"""The sensors on a device: the laws of the modules of the same names, one twin a thread, on the memory of their classes.

They differ from these by rounding alone. Clocks, phases and places are float64 here as there.
"""
