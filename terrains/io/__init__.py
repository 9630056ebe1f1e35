"""Readers of terrains: meshes, elevation rasters, point clouds; checks and repairs."""
