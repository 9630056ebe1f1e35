"""Soft ground on the device: soils, and the ruts that each twin remembers.

What a wheel does in it stands in ``aoro_gym/twin/physics/soil.py``, how ruts are found in ``aoro_gym/twin/kernels/soil.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aoro_gym.terrains.soil import MOST_TILES, TILES_PER_METRE
from aoro_gym.terrains.soil import Soil as SoilParameters
from aoro_gym.twin.kernels import soil_start
from aoro_gym.twin.kernels.soil import (
    FARTHEST,
    LEG_ROWS,
    MOST_PASSES,
    PASS_GROUNDS,
    SOIL_GROUNDS,
    TILE,
    WHEEL_ROWS,
    PassRuts,
    SoilSite,
)
from aoro_gym.twin.kernels.soil import Ruts as DeviceRuts
from aoro_gym.twin.physics.soil import EDGE, LEAST_REBOUND, Soil
from aoro_gym.twin.records import WHEELS

OF_A_TWIN = ("keys", "depths", "passes")
"""Arrays of the device with a row a twin."""


@dataclass(frozen=True, eq=False)
class Ruts:
    """The ruts of one twin, on a raster around all of them: rows from south to north, columns from west to east."""

    corner: tuple[float, float]
    """x, y [m] of the first node."""
    cell: float
    """Distance of the nodes [m]."""
    deepest: npt.NDArray[np.float32]
    """Deepest sinkage of each node [m], (rows, columns); 0 where no wheel was."""
    depth: npt.NDArray[np.float32]
    """Depth that stays once the wheel is gone [m], likewise."""
    passes: npt.NDArray[np.int32] | None = None
    """Wheels that have gone over each node, likewise; None of soil whose passes do not count."""

    @property
    def volume(self) -> float:
        """Volume [m³] of the ruts that stay."""
        return float(self.depth.sum(dtype=np.float64)) * self.cell**2


class SoilRuts:
    """Soil under twins, and their ruts.

    Args:
        soil: Its parameters; one for all, or one a twin.
        ground: The hard ground on the device that becomes soft.
        num_twins: Twins.
        gravity: [m/s²].
        device: Warp device.
    """

    def __init__(self, soil: SoilParameters, ground: Any, num_twins: int, *, gravity: float, device: Any):
        if soil.num_variants not in (1, num_twins):
            raise ValueError(f"the soil has {soil.num_variants} variants, but must have 1 or num_twins = {num_twins}")
        self._soil = soil
        slots, nodes = soil.tiles, soil.tiles * TILE * TILE
        passes = soil.has_passes
        self._ruts: Any = PassRuts() if passes else DeviceRuts()
        counting = (("passes", (num_twins, nodes), int), ("legs", (LEG_ROWS * len(WHEELS), num_twins), float))
        for name, shape, kind in (
            ("keys", (num_twins, slots), int),
            ("depths", (num_twins, nodes), float),
            ("count", (num_twins,), int),
            ("full", (num_twins,), int),
            ("wheels", (WHEEL_ROWS * len(WHEELS), num_twins), float),
            *(counting if passes else ()),
        ):
            setattr(self._ruts, name, wp.zeros(shape, dtype=kind, device=device))
        self._ruts.inverse_cell = 1.0 / soil.cell
        layout: Any = SoilSite.numpy_dtype()
        sites: Any = np.zeros(num_twins, dtype=layout)
        sites["gravity"], sites["twin"] = gravity, np.arange(num_twins)
        self.device_struct: Any = (PASS_GROUNDS if passes else SOIL_GROUNDS)[type(ground)._cls]()
        """What ``advance`` takes as its ``terrain``."""
        self.device_struct.twins = wp.array(sites, dtype=SoilSite, device=device)
        self.device_struct.ground = ground
        self.device_struct.soils = wp.array(device_records(soil), dtype=Soil, device=device)
        self.device_struct.ruts = self._ruts
        self._settle = soil_start.build(type(self.device_struct)._cls)

    def start(self, machines: wp.array, mask: wp.array, state: wp.array) -> None:
        """Twins of the ``mask`` have no ruts, and sink into fresh ground from where they stand on hard one."""
        ruts, count, device = self._ruts, len(mask), mask.device
        wp.launch(soil_start.forget, count, [ruts.keys, ruts.count, ruts.full, ruts.wheels, mask], device=device)
        if self._soil.has_passes:
            wp.launch(soil_start.begin_legs, count, [ruts.legs, mask], device=device)
        wp.launch(self._settle, count, [machines, self.device_struct, mask, state], device=device)

    @property
    def full(self) -> str:
        """Why a twin is frozen whose memory of ruts is full."""
        tiles = self._soil.tiles
        most, edge = tiles * 3 // 4, TILE * self._soil.cell
        more = f"make the Soil with more tiles, as tiles={2 * tiles}, or reset" if tiles < MOST_TILES else "reset"
        return (
            f"memory of ruts is full: {most} tiles of {edge:g} m x {edge:g} m, about {most // TILES_PER_METRE} m of fresh"
            f" track; {more} the twin before, which forgets them"
        )

    def raster(self, machines: wp.array, twin: int) -> Ruts:
        """The ruts of a ``twin``."""
        keys = self._ruts.keys[twin].numpy()
        taken = np.flatnonzero(keys)
        cell = self._soil.cell
        if not len(taken):
            empty = np.zeros((0, 0), dtype=np.float32)
            return Ruts((0.0, 0.0), cell, empty, empty, empty.astype(np.int32) if self._soil.has_passes else None)
        packed = keys[taken] - 1
        wide = 2 * int(FARTHEST) + 1
        columns, rows = packed // wide - int(FARTHEST), packed % wide - int(FARTHEST)
        west, south = columns.min(), rows.min()

        def mosaic(nodes: wp.array) -> npt.NDArray[Any]:
            tiles = nodes[twin].numpy().reshape(-1, TILE, TILE)[taken]
            shape = (int(rows.max() - south + 1), TILE, int(columns.max() - west + 1), TILE)
            out = np.zeros(shape, dtype=tiles.dtype)
            out[rows - south, :, columns - west] = tiles
            return out.reshape(shape[0] * TILE, shape[2] * TILE)

        deepest = mosaic(self._ruts.depths)
        passes = mosaic(self._ruts.passes) & int(MOST_PASSES) if self._soil.has_passes else None
        machine = machines[twin % machines.shape[0] : twin % machines.shape[0] + 1].numpy()[0]
        soil = device_records(self._soil)[twin % self._soil.num_variants]
        width = 2.0 * (float(machine["tire"]["disc_offset_outer"]) + float(EDGE))
        depth = remaining_depth(soil, width, deepest, 1 if passes is None else passes).astype(np.float32)
        return Ruts((float(west * TILE * cell), float(south * TILE * cell)), cell, deepest, depth, passes)

    def standing(self) -> dict[str, npt.NDArray[Any]]:
        """What twins have to do with their soil, for :meth:`stand`; twins lie along the last axis."""
        names = ("keys", "depths", "count", "full", "wheels", *(("passes", "legs") if self._soil.has_passes else ()))
        arrays = {name: getattr(self._ruts, name).numpy().copy() for name in names}
        return {f"ruts_{name}": array.T if name in OF_A_TWIN else array for name, array in arrays.items()}

    def stand(self, standing: Mapping[str, npt.NDArray[Any]]) -> None:
        """Inverse of :meth:`standing`."""
        for key, values in standing.items():
            name = key.removeprefix("ruts_")
            array = getattr(self._ruts, name)
            rows = np.ascontiguousarray(values.T if name in OF_A_TWIN else values)
            wp.copy(array, wp.array(rows, dtype=array.dtype, device=array.device))


def device_records(soil: SoilParameters) -> npt.NDArray[Any]:
    """Records (num_variants,) of a soil on the device."""
    layout: Any = Soil.numpy_dtype()
    rows: Any = np.zeros(soil.num_variants, dtype=layout)
    for name in (
        "k_c",
        "k_phi",
        "exponent",
        "mat",
        "cohesion",
        "shear_modulus",
        "k_0",
        "a_u",
        "tan_phi",
        "slip_sinkage",
        "pass_exponent",
    ):
        rows[name] = getattr(soil, name)
    rows["depth"] = soil.layer
    passive = np.tan(np.radians(45.0 + 0.5 * np.asarray(soil.friction_angle_deg)))
    rows["flank_cohesion"] = 2.0 * np.asarray(soil.cohesion) * passive
    rows["flank_weight"] = 0.5 * np.asarray(soil.unit_weight) * passive**2
    return rows


def remaining_depth(soil: Any, width: float, deepest: npt.NDArray[Any], passes: Any = 1) -> npt.NDArray[np.float64]:
    """Depth [m] that stays of a ``deepest`` sinkage [m] under a tire of ``width`` [m], the last of some ``passes``, as
    ``rut_depth`` of ``aoro_gym/twin/physics/soil.py``; the mat's share of the pressure as under a square plate."""
    z = np.maximum(deepest.astype(np.float64), 1e-6)
    virgin = z / np.maximum(passes, 1.0) ** float(soil["pass_exponent"])
    pressure = (soil["k_c"] / width + soil["k_phi"]) * virgin ** soil["exponent"]
    pressure += 4.0 * soil["mat"] / width * virgin * virgin
    pressure += 1e8 * np.maximum(z - soil["depth"], 0.0)
    modulus = np.maximum(soil["k_0"] + soil["a_u"] * z, LEAST_REBOUND * pressure / z)
    return np.where(deepest > 0.0, np.maximum(z - pressure / modulus, 0.0), 0.0)
