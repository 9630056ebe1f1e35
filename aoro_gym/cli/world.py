"""Command that makes worlds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.cli.place import load_terrain
from aoro_gym.reporting import terminal

OutOption = Annotated[Path, option("--out -o", "FOLDER", "Folder to write the world to.")]
StandOption = Annotated[str, option("--stand", "NAME", "pine, spruce, birch or mixed.")]
SizeOption = Annotated[tuple[float, float], option("--size", "X Y", "Sides of made ground, in metres.")]
TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Ground to plant, such as a scan. Default: made ground.")
]
StemsOption = Annotated[float | None, option("--stems", "N", "Trees a hectare. Default: the stand's.")]
BouldersOption = Annotated[float, option("--boulders", "N", "Boulders a hectare.")]
SnowOption = Annotated[bool, option("--snow", None, "Snow on the ground, and bare birches.")]


def world(
    out: OutOption = Path("world"),
    seed: options.SeedOption = 0,
    stand: StandOption = "mixed",
    size: SizeOption = (100.0, 100.0),
    terrain: TerrainOption = None,
    stems: StemsOption = None,
    boulders: BouldersOption = 120.0,
    snow: SnowOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Make a forest of objects on made or scanned ground: trees, stumps, boulders, logs, branches.

    Every object has a class, a pose and dimensions; the same seed makes the same world. The table tells how many there
    are, and how many a machine with 0.6 m of ground clearance drives over.

    Writes into FOLDER: the objects (world.json), the ground (ground.npz, and ground.ply for --terrain of other commands),
    and a picture (world.png).

    [bold]Examples[/]

      aoro-gym world --seed 3
      aoro-gym world --stand pine --size 60 60 --out heath
      aoro-gym world --terrain scan.laz --stems 600 --snow --out winter
      aoro-gym world --json -
    """
    with checking_input():
        from aoro_gym.terrains.generate.world import WorldSettings, populate
        from aoro_gym.terrains.generate.world import world as make
        from aoro_gym.terrains.world.figures import draw_world
        from aoro_gym.terrains.world.files import save_world
        from aoro_gym.terrains.world.report import summary, table

        options.check_seed(seed)
        options.check_folder(out, "world.json")
        settings = WorldSettings(size=size, stand=stand, stems=stems, boulders=boulders, snow=snow)
        ground = None if terrain is None else load_terrain(terrain)
        with terminal.progress("planting"):
            made = make(seed, settings) if ground is None else populate(ground, seed, settings)
    with running():
        written = [*save_world(made, out), out / "world.png"]
        draw_world(made).savefig(written[-1])
    figures = summary(made)
    conclude(figures, [table(figures)], written, json_to=json_to, highlight=False)
