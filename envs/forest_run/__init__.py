"""``AORO/ForestRun-v0``: from a start to a goal between trees, stumps, boulders, logs and wet ground, by what a lidar
shows."""
