"""The command that writes world and machine for a renderer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude
from aoro_gym.cli.place import CranePoseOption, StartOption, WorldOption, load_ground, posed_crane, put
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from rich.table import Table

    from aoro_gym.machine import Machine
    from aoro_gym.machine.kinematics import Pose
    from aoro_gym.terrains import Plane, Terrain
    from aoro_gym.terrains.world.world import World

FileOption = Annotated[Path, option("--out -o", "FILE.glb", "File to write.")]
TerrainOption = Annotated[
    Path | None, option("--terrain", "FILE", "Ground: a mesh, raster or cloud. Default: none is drawn.")
]
WorldAloneOption = Annotated[bool, option("--no-machine", None, "The ground and its objects alone.")]


def scene(
    out: FileOption,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    terrain: TerrainOption = None,
    world: WorldOption = None,
    start: StartOption = None,
    crane_pose: CranePoseOption = None,
    no_machine: WorldAloneOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Write world and machine as a binary glTF file (GLB), for a renderer that 'aoro-gym serve --poses' moves.

    Every part of the machine is a node by its name, at rest where a twin stands: at --start, or on a world's free place;
    with --crane-pose parts of the crane, too. A world's objects are a node a kind. Lengths are metres; below the node
    'aoro' axes are x forward, y left, z up.

    [bold]Examples[/]

      aoro-gym export scene --out machine.glb
      aoro-gym export scene --world forest --start 3 4 90 --out scene.glb
      aoro-gym export scene --crane-pose 40 35 -100 0.5 --out crane.glb
      aoro-gym export scene --terrain ground.ply --no-machine --out ground.glb
    """
    with checking_input():
        from aoro_gym.execution.files import check_writable
        from aoro_gym.interchange.scene_file import SUFFIX, write_scene
        from aoro_gym.terrains import Plane

        if out.suffix != SUFFIX:
            raise ValueError(f"--out {out} ends in {out.suffix!r}; name a file that ends in {SUFFIX}")
        check_writable(out)
        options.check_device("cpu")
        if no_machine and start is not None:
            raise ValueError("--start puts the machine, and --no-machine leaves it out; drop one of them")
        chosen = None if no_machine else options.load_machine(options.run_spec(machine, set_, scale).machine)
        ground = load_ground(terrain, world)
        if chosen is None and isinstance(ground, Plane):
            raise ValueError("--no-machine leaves nothing to draw; give --terrain or --world")
        pose = None if chosen is None else _pose(chosen, ground, start, crane_pose)
        with terminal.progress("writing triangles"):
            write_scene(out, chosen, pose, None if isinstance(ground, Plane) else ground)
    found = _nodes(out)
    conclude({"nodes": found}, [_table(found)], [out], json_to=json_to)


def _pose(
    machine: Machine,
    ground: Plane | Terrain | World,
    start: tuple[float, float, float] | None,
    crane: tuple[float, float, float, float] | None,
) -> Pose:
    """Of a twin at rest, its ``crane`` folded or with joints [deg, deg, deg, m]."""
    from aoro_gym.twin import Twin
    from aoro_gym.twin.poses import pose_of_state

    vehicle = None if crane is None else posed_crane(crane)
    twin = Twin(1, machine=machine, terrain=ground, crane=vehicle or False, threads=1)
    put(twin, machine, None, start)
    return pose_of_state(twin.state.numpy()[:, 0], vehicle)


def _nodes(file: Path) -> list[dict[str, Any]]:
    """Name, triangles and extents [m] of every node with a mesh, as the file has them."""
    import trimesh

    made: Any = trimesh.load(file)
    out = []
    for name in sorted(made.graph.nodes_geometry):
        mesh = made.geometry[made.graph[name][1]]
        out.append(
            {"node": name, "triangles": len(mesh.faces), "extents_m": [round(float(x), 4) for x in mesh.extents]}
        )
    return out


def _table(found: list[dict[str, Any]]) -> Table:
    from rich.table import Table

    table = Table("node", "triangles", "extents", title="Nodes", title_justify="left")
    for one in found:
        table.add_row(one["node"], f"{one['triangles']:,}", " x ".join(f"{x:.2f}" for x in one["extents_m"]) + " m")
    return table
