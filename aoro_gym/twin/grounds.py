"""Grounds on the device: planes, or terrains as rasters or triangles, hard or of soil, with or without solid objects on
them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aoro_gym.checks import check_choice, check_range
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.raster import CELL, surface, triangles
from aoro_gym.terrains.soil import Soil
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.kernels.overwrite import multiply
from aoro_gym.twin.physics.ground import Discs, Ground, Meshes, Planes, Rasters, Site
from aoro_gym.twin.records import OBJECT_OUTPUT_UNITS, SOIL_OUTPUT_UNITS
from aoro_gym.units import GRAVITY

if TYPE_CHECKING:
    from aoro_gym.terrains.world.objects import Object
    from aoro_gym.terrains.world.world import World
    from aoro_gym.twin.objects import WorldObjects
    from aoro_gym.twin.soil_ruts import SoilRuts

KINDS = {"raster": Rasters, "mesh": Meshes, "discs": Discs}
"""How twins feel a terrain, by name."""


class Grounds:
    """What the twins stand on.

    Args:
        terrain: One plane (its arrays hold one value a twin), one terrain or world, or several of these.
        num_twins: Twins that stand on it; on the first terrain, to begin with.
        kind: ``"raster"``, ``"mesh"`` or ``"discs"``; planes need none.
        cell: Distance of the rasters' nodes [m].
        soil: What the ground is made of; None: it is hard.
        gravity: [m/s²].
        device: Warp device.

    Raises:
        ValueError: a value is out of its bound; the message names it.
    """

    def __init__(
        self,
        terrain: Plane | Terrain | World | Sequence[Terrain | World],
        *,
        num_twins: int,
        kind: str = "raster",
        cell: float = CELL,
        soil: Soil | None = None,
        gravity: float = GRAVITY,
        device: Any = "cpu",
    ):
        check_choice("ground", kind, KINDS)
        self.objects: WorldObjects | None = None
        """Solid objects, if there are any."""
        self.ruts: SoilRuts | None = None
        """What twins remember of soft ground, if it is soft."""
        self.count = 0
        """Terrains to choose from; 0 for planes."""
        if isinstance(terrain, Plane):
            self.device_struct: Any = _planes(terrain, num_twins, gravity, device)
            """What kernels take as their ``terrain`` (see :mod:`aoro_gym.twin.physics.ground`)."""
            self._soften(soil, num_twins, gravity, device)
            return
        terrains, objects = _with_objects(list(terrain) if isinstance(terrain, Iterable) else [terrain])
        self.count = len(terrains)
        self.device_struct, self._meshes = _terrains(terrains, num_twins, KINDS[kind], cell, gravity, device)
        if kind == "discs" and (any(objects) or soil is not None):
            what = "soil" if soil is not None else "solid objects"
            raise ValueError(f"ground is 'discs', but there is {what}, which discs do not know yet; take 'mesh'")
        if any(objects):
            if soil is not None:
                raise ValueError(
                    "the ground has soil and solid objects, but twins feel only one of them yet; take a ground without"
                    " objects (world.terrain), or drop soil"
                )
            from aoro_gym.twin.objects import WorldObjects

            self.objects = WorldObjects(objects, num_twins, gravity=gravity, device=device)
        self._soften(soil, num_twins, gravity, device)

    def _soften(self, soil: Soil | None, num_twins: int, gravity: float, device: Any) -> None:
        if soil is not None:
            from aoro_gym.twin.soil_ruts import SoilRuts  # few twins need them

            self.ruts = SoilRuts(soil, self.device_struct, num_twins, gravity=gravity, device=device)

    @property
    def advancing(self) -> Any:
        """What ``advance`` takes as its ``terrain``: :attr:`device_struct`, with objects or of soil if there are any."""
        if self.ruts is not None:
            return self.ruts.device_struct
        return self.device_struct if self.objects is None else self.objects.on(self.device_struct)

    @property
    def further_outputs(self) -> tuple[str, ...]:
        """Names of the outputs that twins have on this ground alone, after the others."""
        if self.ruts is not None:
            return tuple(SOIL_OUTPUT_UNITS)
        return () if self.objects is None else tuple(OBJECT_OUTPUT_UNITS)

    def standing(self) -> dict[str, npt.NDArray[Any]]:
        """What each twin stands on, with its multipliers, for :meth:`stand`."""
        out = {"twins": self.device_struct.twins.numpy().copy()}
        if self.count:
            sites = self.device_struct.terrains.numpy()
            out["number"] = np.argmax(out["twins"]["first"][:, None] == sites["first"], axis=1)
        if self.objects is not None:
            out |= self.objects.standing()
        if self.ruts is not None:
            out |= self.ruts.standing()
        return out

    def stand(self, standing: Mapping[str, npt.NDArray[Any]]) -> None:
        """Put the twins where others stood on the same grounds."""
        twins, rows = self.device_struct.twins, standing["twins"].copy()
        if self.count:
            rows["mesh"] = self.device_struct.terrains.numpy()["mesh"][standing["number"]]  # an address
        wp.copy(twins, wp.array(rows, dtype=twins.dtype, device=twins.device))
        others = {name: standing[name] for name in standing if name not in ("twins", "number")}
        if self.objects is not None:
            self.objects.stand(others)
        if self.ruts is not None:
            self.ruts.stand(others)

    def set_multipliers(
        self, chosen: npt.NDArray[np.int32], friction: npt.ArrayLike | None, rolling_resistance: npt.ArrayLike | None
    ) -> None:
        """See :meth:`Twin.set_ground`, for indices that are checked."""
        rows = []
        for name, value, low, high in (
            ("friction", friction, 0.01, 2.0),
            ("rolling_resistance", rolling_resistance, 0.0, 50.0),
        ):
            # what is not given stays: a negative multiplier
            array = np.asarray(-1.0 if value is None else value, dtype=np.float32)
            if array.shape not in ((), chosen.shape):
                raise ValueError(f"{name} has shape {array.shape}, but must be a scalar or {chosen.shape}")
            if value is not None:
                check_range(name, array, ge=low, le=high, note=" x the ground's own")
            rows.append(np.broadcast_to(array, chosen.shape))
        twins = self.device_struct.twins
        wp.launch(
            multiply,
            dim=len(chosen),
            inputs=[
                wp.array(chosen, dtype=int, device=twins.device),
                wp.array(np.stack(rows), dtype=float, device=twins.device),
                twins,
            ],
            device=twins.device,
        )


def _with_objects(grounds: list[Any]) -> tuple[list[Terrain], list[tuple[Object, ...]]]:
    """Terrains of ``grounds``, which may be worlds, and the objects of each; none if nothing on it is solid."""
    terrains, objects, wrong = [], [], []
    for one in grounds:
        if isinstance(one, Terrain):
            terrains.append(one)
            objects.append(())
            continue
        from aoro_gym.terrains.world.objects import is_solid
        from aoro_gym.terrains.world.world import World

        if isinstance(one, World):
            terrains.append(one.terrain)
            objects.append(one.objects if any(map(is_solid, one.objects)) else ())
        else:
            wrong.append(type(one).__name__)
    if wrong or not terrains:
        listed = f"holds a {wrong[0]}" if wrong else "is empty"
        raise ValueError(f"terrain {listed}; give a Plane, a Terrain or World, or a sequence of them")
    return terrains, objects


def _planes(plane: Plane, num_twins: int, gravity: float, device: Any) -> Any:
    normal = np.atleast_2d(np.asarray(plane.normal, dtype=np.float64))
    friction = np.atleast_1d(np.asarray(plane.friction, dtype=np.float64))
    rolling = np.atleast_1d(np.asarray(plane.rolling_resistance, dtype=np.float64))
    count = max(len(normal), len(friction), len(rolling))
    if count not in (1, num_twins):
        raise ValueError(f"the terrain has {count} variants, but must have 1 or num_twins = {num_twins}")
    layout: Any = Ground.numpy_dtype()
    rows: Any = np.zeros(num_twins, dtype=layout)
    rows["normal"] = normal
    rows["friction"] = friction
    rows["rolling_resistance"] = rolling
    rows["gravity"] = gravity
    out: Any = Planes()
    out.twins = wp.array(rows, dtype=Ground, device=device)
    return out


def _terrains(
    terrains: list[Terrain], num_twins: int, kind: Any, cell: float, gravity: float, device: Any
) -> tuple[Any, list[wp.Mesh | None]]:
    layout: Any = Site.numpy_dtype()
    sites: Any = np.zeros(len(terrains), dtype=layout)
    rasters, meshes, first = [], [], 0
    for site, terrain in zip(sites, terrains, strict=True):
        mesh = triangles(terrain, device) if kind is not Rasters else None  # rasters are asked alone
        raster = surface(terrain, str(device), cell=cell, mesh=mesh)
        rows, columns = raster.ceilings.shape
        site["x"], site["y"] = raster.corner
        site["inverse_cell"] = 1.0 / raster.cell
        site["columns"], site["rows"], site["first"] = columns, rows, first
        site["mesh"] = 0 if mesh is None else mesh.id
        site["friction"], site["rolling_resistance"], site["gravity"] = 1.0, 1.0, gravity
        first += rows * columns
        rasters.append(raster)
        meshes.append(mesh)  # it lives as long as what asks it
    if first >= 2**31:
        raise ValueError(
            f"cell is {cell} m, which makes {first:.3g} nodes in all, but 2^31 is the limit; take larger cells"
        )
    out: Any = kind()
    out.terrains = wp.array(sites, dtype=Site, device=device)
    out.twins = wp.array(np.repeat(sites[:1], num_twins), dtype=Site, device=device)
    out.nodes = wp.array(np.concatenate([r.nodes.reshape(-1, 4) for r in rasters]), dtype=wp.vec4, device=device)
    out.cover = wp.array(np.concatenate([r.cover.reshape(-1, 2) for r in rasters]), dtype=wp.vec2, device=device)
    out.ceilings = wp.array(np.concatenate([r.ceilings.ravel() for r in rasters]), dtype=float, device=device)
    return out, meshes
