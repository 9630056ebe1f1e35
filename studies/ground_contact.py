"""Wheel loads and joint torque on a kerb, a rut and a ditch: tires on an averaged plane, of a raster or of the triangles,
beside tires whose discs ask the triangles. ``python -m studies.ground_contact --out FOLDER`` writes a table, JSON and a
picture.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym import Machine, Twin
from aoro_gym.interchange.servos import steering_displacement
from aoro_gym.recording.commands import WHEELS
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.twin import Trace

GROUNDS = ("raster", "mesh", "discs")
DRIVE = 0.59
"""Signal of 0.75 m/s in first gear."""
HALF = 10.0
"""Half of the square's side [m]; what is driven over lies around its middle."""
STARTED = 1.2
"""When the machine has driven off [s] and meets no obstacle yet; what is told of a drive begins here."""
TITLES = {"raster": "averaged plane, raster", "mesh": "averaged plane, triangles", "discs": "each disc"}


@dataclass(frozen=True)
class Obstacle:
    """A profile along x, under the left wheels alone or all across, and the heading of the machine that comes over it."""

    what: str
    profile: Sequence[tuple[float, float]]
    """x, z [m] of its corners, between level ground at the ends; the same x twice is a vertical wall."""
    one_sided: bool = True
    heading: float = 0.0
    """[rad]."""

    @property
    def terrain(self) -> Terrain:
        """Triangles with its corners, no more."""
        x = np.array([-HALF, *(x for x, _ in self.profile), HALF])
        z = np.array([0.0, *(z for _, z in self.profile), self.profile[-1][1]])
        y = np.array([-HALF, 0.0, 0.0, HALF]) if self.one_sided else np.array([-HALF, HALF])
        heights = np.stack([z * (row >= len(y) // 2 or not self.one_sided) for row in range(len(y))])
        grid = np.stack([*np.meshgrid(x, y), heights], axis=-1).reshape(-1, 3)
        index = np.arange(len(grid), dtype=np.int32).reshape(heights.shape)
        a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
        return Terrain(grid, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))


OBSTACLES = {
    "kerb": Obstacle("kerb of 0.15 m under the left wheels", [(0.0, 0.0), (0.0, 0.15)]),
    "rut": Obstacle(
        "rut 0.25 m deep, 0.6 m wide, crossed at 45 deg",
        [(-0.3, 0.0), (-0.2, -0.25), (0.2, -0.25), (0.3, 0.0)],
        one_sided=False,
        heading=np.pi / 4,
    ),
    "ditch": Obstacle("ditch 0.4 m deep, 1 m wide, under the left wheels", [(-0.5, 0.0), (0.0, -0.4), (0.5, 0.0)]),
}


def drive(obstacle: Obstacle, ground: str, seconds: float) -> Trace:
    """Over the obstacle from 3.5 m before it."""
    twin = Twin(terrain=obstacle.terrain, ground=ground)
    start = -3.5 * np.array([np.cos(obstacle.heading), np.sin(obstacle.heading)])
    twin.reset(position=start, heading=obstacle.heading)
    trace = twin.step({"drive_signal": DRIVE}, seconds, sample_every=5e-3)
    if trace is None or twin.diverged:
        raise RuntimeError(f"the twin on {ground} did not get over the {obstacle.what}")
    return trace


def joint_torque(machine: Machine, trace: Trace) -> NDArray[np.float64]:
    """Of the oil in the steering cylinders [N m], (frames,)."""
    found = []
    for angle, a, b in zip(*(trace[name][:, 0] for name in ("joint_angle", "pressure_a", "pressure_b")), strict=True):
        to_right, to_left = steering_displacement(machine, float(angle))
        found.append(float(a) * to_left - float(b) * to_right)
    return np.array(found)


def figures(machine: Machine, trace: Trace) -> dict[str, float]:
    """What the drive asked of tires, joint and driveline, in field units."""
    under_way = trace.time > STARTED
    loads = np.stack([trace[f"wheel_load_{wheel}"][under_way, 0] for wheel in WHEELS])
    torque = joint_torque(machine, trace)[under_way]
    return {
        "largest_load_kN": 1e-3 * float(loads.max()),
        "smallest_load_kN": 1e-3 * float(loads.min()),
        "largest_load_change_kN_in_5_ms": 1e-3 * float(np.abs(np.diff(loads, axis=1)).max()),
        "joint_torque_kN_m": 1e-3 * float(np.abs(torque).max()),
        "drive_pressure_bar": 1e-5 * float(trace["drive_pressure_forward"][under_way].max()),
    }


def picture(drives: dict[str, dict[str, Trace]], machine: Machine, path: Path) -> None:
    """Load of the front left wheel and torque at the joint over time, a column an obstacle."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(drives), figsize=(12.5, 5.6), layout="constrained", sharex=True, squeeze=False)
    for column, (name, traces) in enumerate(drives.items()):
        for ground, trace in traces.items():
            axes[0, column].plot(trace.time, 1e-3 * trace["wheel_load_fl"][:, 0], label=TITLES[ground], lw=1.0)
            axes[1, column].plot(trace.time, 1e-3 * joint_torque(machine, trace), lw=1.0)
        axes[0, column].set_title(OBSTACLES[name].what, fontsize=10)
        axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("load of the front left wheel [kN]")
    axes[1, 0].set_ylabel("torque of the oil on the joint [kN m]")
    axes[0, 0].legend(fontsize=9)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=10.0)
    asked = parser.parse_args()
    machine = Machine.load("aoro")
    drives: dict[str, dict[str, Trace]] = {}
    rows: list[dict[str, Any]] = []
    for name, obstacle in OBSTACLES.items():
        drives[name] = {ground: drive(obstacle, ground, asked.seconds) for ground in GROUNDS}
        rows += [
            {"obstacle": name, "ground": ground, **figures(machine, trace)} for ground, trace in drives[name].items()
        ]
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "ground_contact.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    picture(drives, machine, asked.out / "ground_contact.png")
    keys = list(rows[0])
    print(f"| {' | '.join(keys)} |\n| {' | '.join(['---'] * len(keys))} |")
    for row in rows:
        print("| " + " | ".join(f"{value:.1f}" if isinstance(value, float) else value for value in row.values()) + " |")


if __name__ == "__main__":
    main()
