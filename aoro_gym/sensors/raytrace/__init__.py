"""Rays at ground, still objects and moving bodies: one caster for lidars, height maps and cameras, on the CPU and on CUDA.

Device code calls :func:`aoro_gym.sensors.raytrace.device.cast` with :attr:`Scene.data`; :meth:`Scene.cast` takes arrays.
"""

from aoro_gym.sensors.raytrace.bodies import Bodies, Body
from aoro_gym.sensors.raytrace.scene import NO_CLASS, Hits, Scene

__all__ = ["NO_CLASS", "Bodies", "Body", "Hits", "Scene"]
