"""Command that loads ground to drive on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.reporting import terminal

FileArgument = Annotated[Path, argument("FILE", "Mesh, elevation raster, point cloud or .npy heights to drive on.")]
MeshOption = Annotated[
    Path | None, option("--out -o", "MESH", "Terrain to write (.ply). Default: FILE_terrain.ply, here.")
]
UnitsOption = Annotated[str | None, option("--units", "UNIT", "m, km, dm, cm, mm, ft, us-ft or in.")]
HeightUnitsOption = Annotated[str | None, option("--z-units", "UNIT", "Of heights, if another.")]
UpOption = Annotated[str | None, option("--up", "AXIS", "Axis that points up: x, y or z.")]
CrsOption = Annotated[str | None, option("--crs", "CODE", "Coordinate system, such as EPSG:32633.")]
CellOption = Annotated[float | None, option("--cell", "M", "Distance of heights.")]
WindowOption = Annotated[
    tuple[float, float, float, float] | None,
    option("--window", "W S E N", "West, south, east, north of the part to take, in metres."),
]
HoleLimitOption = Annotated[float, option("--hole-limit", "M", "Widest gap that is bridged.")]
SpikeLimitOption = Annotated[float, option("--spike-limit", "M", "Height of spikes to remove.")]
GroundOption = Annotated[
    str | None, option("--ground", "class|filter|all", "What is ground. Default: the class, if given.")
]
NodataOption = Annotated[
    list[str] | None, option("--nodata", "VALUE", "Height that means unknown; none: there is no other. Repeatable.")
]
BandOption = Annotated[int | None, option("--band", "N", "Band of a raster with the heights.")]


def terrain(
    file: FileArgument,
    out: MeshOption = None,
    units: UnitsOption = None,
    z_units: HeightUnitsOption = None,
    up: UpOption = None,
    crs: CrsOption = None,
    cell: CellOption = None,
    window: WindowOption = None,
    hole_limit: HoleLimitOption = 5.0,
    spike_limit: SpikeLimitOption = 0.5,
    ground: GroundOption = None,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
    nodata: NodataOption = None,
    band: BandOption = None,
) -> None:
    """Load ground to drive on, check and repair it, and say what was done.

    Units, up axis and coordinate system are taken from the options, the file, or recognised. Trees and buildings are
    told from the ground, gaps up to --hole-limit are bridged, wider ones are named. What cannot be driven on is refused.

    Writes MESH in local metres, and beside it the report (.json, with the origin of the local frame) and a plan (.png).

    [bold]Examples[/]

      aoro-gym terrain dem.tif
      aoro-gym terrain forest.laz --hole-limit 10 --out forest.ply
      aoro-gym terrain scan.obj --units mm --up y
      aoro-gym terrain big.tif --window 430000 5150000 430400 5150400
      aoro-gym terrain depth.tif --z-units dm --nodata 0 --nodata -999 --band 1
    """
    with checking_input():
        from aoro_gym.terrains.figures import draw_terrain
        from aoro_gym.terrains.io.loading import check_output, load, save
        from aoro_gym.terrains.report import tables

        mesh = out if out is not None else Path(f"{file.stem}_terrain.ply")
        check_output(mesh, file)
        with terminal.progress(file.name) as tell:
            loaded = load(
                file,
                units=units,
                z_units=z_units,
                up=up,
                crs=crs,
                cell=cell,
                window=window,
                hole_limit=hole_limit,
                spike_limit=spike_limit,
                ground=ground,  # pyright: ignore[reportArgumentType]  load checks it
                nodata=_nodata(nodata),
                band=band,
                progress=lambda share: tell(file.name, share),
            )
    with running():
        written = [*save(loaded, mesh), mesh.with_suffix(".png")]
        draw_terrain(loaded.terrain).savefig(written[-1], bbox_inches="tight")
    conclude(mesh.with_suffix(".json"), tables(loaded.report), written, json_to=json_to, highlight=False)


def _nodata(texts: list[str] | None) -> list[float] | None:
    """Heights that mean unknown, of ``--nodata``; ``none`` says that there are no others than the file's."""
    if not texts:
        return None
    values = []
    for text in texts:
        if text.casefold() == "none":
            continue
        try:
            values.append(float(text.replace("_", "?")))
        except ValueError:
            raise ValueError(f"--nodata {text} is no number; give a height such as -9999, or none") from None
    return values
