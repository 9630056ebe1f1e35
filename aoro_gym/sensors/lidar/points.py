"""Points of a sweep, and the files that they are written to."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice
from aoro_gym.execution.files import write_bytes, written_whole
from aoro_gym.terrains.extras import import_extra

FIRST, STRONGEST, LAST = 1, 2, 4
"""Bits of :attr:`Points.echo`."""
SUFFIXES = (".npz", ".pcd", ".laz", ".las")


@dataclass(frozen=True, eq=False)
class Points:
    """K echoes in the order of time."""

    points: NDArray[np.float32]
    """(K, 3) [m] in the sensor's axes at each pulse's own instant, as the sensor reports them."""
    world: NDArray[np.float32]
    """(K, 3) [m] the same in the world's axes, by the true pose at that instant."""
    time: NDArray[np.float64]
    """(K,) [s] since the sweep began."""
    ring: NDArray[np.uint16]
    """(K,) number of the laser."""
    range: NDArray[np.float32]
    """(K,) [m] as reported."""
    intensity: NDArray[np.float32]
    """(K,) received power over that of a white Lambertian surface at right angles 1 m away in clear air, corrected for the
    share of the beam that the receiver sees, as makers calibrate it by range."""
    instance: NDArray[np.int32]
    """(K,) what was hit: 0 ground, -2 rain, fog or snow, -3 undergrowth."""
    class_id: NDArray[np.uint8]
    """(K,) its class, 255 for rain, fog or snow."""
    echo: NDArray[np.uint8]
    """(K,) which of its pulse's echoes: sum of 1 the first, 2 the strongest, 4 the last."""
    echoes: NDArray[np.uint8]
    """(K,) how many its pulse had."""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def reflectance(self) -> NDArray[np.float32]:
        """(K,) intensity times range squared: ρ cos θ in clear air, which makers call reflectivity."""
        return self.intensity * self.range**2

    def chosen(self, mask: NDArray[Any]) -> Points:
        """Those of a mask (K,) or of indices."""
        return Points(*(getattr(self, entry.name)[mask] for entry in fields(self)))

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write ``.npz``, ``.pcd`` (binary), ``.laz`` or ``.las``; the last ones in the world's axes.

        Raises ``ValueError`` for another suffix, or naming what to install.
        """
        target = Path(file)
        check_choice(f"suffix of {target.name}", target.suffix.lower(), SUFFIXES)
        if target.suffix.lower() == ".npz":
            buffer = io.BytesIO()
            arrays: dict[str, Any] = {entry.name: getattr(self, entry.name) for entry in fields(self)}
            np.savez_compressed(buffer, **arrays)
            write_bytes(target, buffer.getvalue())
        elif target.suffix.lower() == ".pcd":
            write_bytes(target, self._pcd())
        else:
            self._save_las(target)

    def _pcd(self) -> bytes:
        """Point cloud data of version 0.7: a header of text, then records."""
        columns = {"x": self.points[:, 0], "y": self.points[:, 1], "z": self.points[:, 2]}
        columns |= {name: getattr(self, name) for name in ("intensity", "time", "ring", "instance", "class_id", "echo")}
        record = np.empty(len(self), dtype=[(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
        for name, values in columns.items():
            record[name] = values
        kinds = [record.dtype[name] for name in columns]
        letters = {"f": "F", "i": "I", "u": "U"}
        header = [
            "# .PCD v0.7 - Point Cloud Data file format",
            "VERSION 0.7",
            f"FIELDS {' '.join(columns)}",
            f"SIZE {' '.join(str(kind.itemsize) for kind in kinds)}",
            f"TYPE {' '.join(letters[kind.kind] for kind in kinds)}",
            f"COUNT {' '.join('1' for _ in kinds)}",
            f"WIDTH {len(self)}",
            "HEIGHT 1",
            "VIEWPOINT 0 0 0 1 0 0 0",
            f"POINTS {len(self)}",
            "DATA binary",
        ]
        return ("\n".join(header) + "\n").encode("ascii") + record.tobytes()

    def _save_las(self, target: Path) -> None:
        laspy = import_extra("laspy", f"the point cloud {target.name}")
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.scales = np.full(3, 1e-3)
        header.offsets = np.floor(self.world.min(axis=0)) if len(self) else np.zeros(3)
        kinds = {"power": np.float32, "ring": np.uint16, "instance": np.int32, "class_id": np.uint8}
        header.add_extra_dims([laspy.ExtraBytesParams(name=name, type=kind) for name, kind in kinds.items()])
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = self.world.astype(np.float64).T
        cloud.gps_time = self.time
        cloud.intensity = np.round(65535.0 * np.clip(self.reflectance, 0.0, 1.0)).astype(np.uint16)
        cloud.number_of_returns = np.minimum(self.echoes, 15)
        cloud.return_number = np.where(self.echo & FIRST, 1, np.where(self.echo & LAST, cloud.number_of_returns, 2))
        cloud.power, cloud.ring = self.intensity, self.ring
        cloud.instance, cloud.class_id = self.instance, self.class_id
        with written_whole(target) as temporary:
            cloud.write(str(temporary), do_compress=target.suffix.lower() == ".laz")


def joined(sweeps: Sequence[Points], period: float) -> Points:
    """Sweeps that followed one another every ``period`` [s] as one; times count from the first one's beginning."""
    later = [replace(one, time=one.time + number * period) for number, one in enumerate(sweeps)]
    return Points(*(np.concatenate([getattr(one, entry.name) for one in later]) for entry in fields(Points)))
