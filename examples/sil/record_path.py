"""A scan of forest ground and a path recorded over it by GPS, for the tracking script in this folder.

You learn how to load a scan, plan a path on it, and write both where other programs read them: the ground as
``ground.ply`` (with ``ground.json``, which says where on the Earth it lies), the recording as ``path.gpx``.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

from aoro_gym.sensors import Gps, GpsNoise
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import drivable_path, load, save_path
from aoro_gym.terrains.generate.forest import PUBLISHED_SIZE, forest
from aoro_gym.terrains.generate.scan import scan
from aoro_gym.terrains.io.loading import save

PLACE = {"origin": (430_000.0, 7_375_000.0, 120.0), "crs": "EPSG:32635"}  # UTM zone 35, near the Arctic circle
SPEED, RATE = 0.75, 10.0  # [m/s] of who drove the path to record it, [Hz] of the receiver


def record(path: Line, seed: int) -> Line:
    """What a receiver above the middle of the front axle shows while the path is driven."""
    count = int(path.length / SPEED * RATE)
    gps = Gps(noise=GpsNoise.typical(), latency=0.0, interval=1.0 / RATE)
    gps.reset([0], [np.random.default_rng(seed)])
    level, places = np.zeros(1), []
    for number in range(count):
        s = number / RATE * SPEED
        reading = gps.measure(np.array([[*path.position(s), 0.0]]), level, level, path.heading(s)[None], number / RATE)
        lever = np.array(gps.antennas.main[:2])  # from the axle to the antenna, which a recorder takes off
        cosine, sine = np.cos(reading.heading[0]), np.sin(reading.heading[0])
        places.append(
            reading.position[0, :2] - [cosine * lever[0] - sine * lever[1], sine * lever[0] + cosine * lever[1]]
        )
    return Line(np.array(places), name=path.name)


seed, length = (int(word) for word in (sys.argv[1:3] + ["2", "60"][len(sys.argv) - 1 :])[:2])
# nothing lifts a wheel for long: the arms stay where they are, as long as nobody commands them; on the path of seed 2 none
# is lifted, on those of seeds 1 and 3 to 6 one is, and the machine is stuck
wood = forest(seed, PUBLISHED_SIZE, road_width=0.0, trail=False, boulders=0.0, stumps=0.0, hummocks=100.0)
truth = dataclasses.replace(wood.terrain, **PLACE)
scan(truth, seed=seed, density=12.0).save("scan.laz")
loaded = load("scan.laz", crs=PLACE["crs"], cell=0.679, hole_limit=20.0)
print(f"{loaded.report.source}: {loaded.report.points_read:,} points")
for sentence in [change.text for change in loaded.report.changes] + loaded.report.warnings:
    print(f"  {sentence}")
save(loaded, Path("ground.ply"))
ground = load("ground.ply").terrain
path = drivable_path(ground, seed, length=float(length), obstacles=wood.circles())
save_path(record(path, seed), "path.gpx", ground)
print(f"ground of {len(ground.faces):,} triangles, path of {path.length:.1f} m")
