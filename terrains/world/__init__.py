"""Worlds: a terrain, the objects that stand and lie on it, their materials, and all of it as triangles.

What an object is stands in :mod:`~aoro_gym.terrains.world.objects`; a :class:`~aoro_gym.terrains.world.world.World` holds
them.
"""
