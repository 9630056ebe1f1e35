"""Pictures of path tracking without a display: a view from behind over the terrain, a map, readings, and strips of traces.

The ground and the machine are flat-shaded polygons under one sun, drawn from the far to the near. Nothing but matplotlib
is needed.
"""
