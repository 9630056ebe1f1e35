"""Up a slope in each gear: how fast, and what it takes.

You learn how to put many twins side by side on grounds of their own, how commands differ between them, and what the outputs
are called. Every twin drives for ten seconds at 60 % of the drive signal.
"""

import numpy as np

from aoro_gym import Plane, Twin

slopes = np.array([0.0, 5.0, 10.0])  # [deg]
gears = np.array([1, 2, 3])
slope, gear = (grid.ravel() for grid in np.meshgrid(slopes, gears, indexing="ij"))

twin = Twin(num_twins=len(slope), terrain=Plane(slope_deg=slope, direction_deg=0.0))  # rising along x
twin.reset()  # at rest, heading along x
trace = twin.step({"drive_signal": 0.6, "gear": gear}, duration=10.0, sample_every=0.01)

last = trace.time > trace.time[-1] - 1.0
speed = trace["speed"][last].mean(axis=0)  # [m/s], (num_twins,)
pressure = (trace["drive_pressure_forward"] - trace["drive_pressure_return"])[last].mean(axis=0) / 1e5  # [bar]
print(f"{'slope':>6} {'gear':>5} {'m/s':>6} {'bar':>6}")
for row in zip(slope, gear, speed, pressure, strict=True):
    print("{:5.0f}° {:5d} {:6.2f} {:6.0f}".format(*row))
