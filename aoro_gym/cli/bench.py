"""Command that measures speed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aoro_gym.cli import options
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, is_output, running
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.machine import Machine

TwinsOption = Annotated[str, option("--twins", "N[,N...]", "Numbers of twins, or of environments, stepped together.")]
WhatOption = Annotated[str, option("--what", "twin|env|train[,...]", "Twins, environments, PPO learning in them.")]
EnvOption = Annotated[str, option("--env", "ID", "The environment of --what env and train.")]
TrainerOption = Annotated[str, option("--trainer", "sb3|resident[,...]", "Who learns, see 'aoro-gym train'.")]
GroundOption = Annotated[str, option("--ground", "plane|raster|mesh", "Level asphalt, or a generated forest.")]
RandomiseOption = Annotated[
    bool, option("--randomise", None, "Give every twin parameters of its own, 5 % to either side.")
]
OutputOption = Annotated[str, option("--output", "numpy|torch", "What environments take and give.")]
ThreadsOption = Annotated[str | None, option("--threads", "N[,N...]", "CPU threads. Default: one, and all cores.")]
PeerOption = Annotated[
    list[str] | None,
    option("--peer", "mujoco|mujoco_warp|newton", "Time the vehicle in this engine, too. Repeatable."),
]
WorldsOption = Annotated[
    str | None, option("--worlds", "N[,N...]", "Vehicles at once in a peer. Default: several sizes.")
]
StartupOption = Annotated[
    bool, option("--startup", None, "Time fresh processes, too, with compiled kernels and without.")
]
CheckOption = Annotated[
    bool, option("--check", None, "Instead: ratios of faster and slower ways, each with the least that it may be.")
]
SecondsOption = Annotated[float, option("--seconds", "S", "Time to measure for, each case.")]


def bench(
    twins: TwinsOption = "1,64,4096",
    what: WhatOption = "twin",
    env: EnvOption = options.TRACKING,
    trainers: TrainerOption = "sb3",
    ground: GroundOption = "plane",
    randomise: RandomiseOption = False,
    output: OutputOption = "numpy",
    threads: ThreadsOption = None,
    peers: PeerOption = None,
    worlds: WorldsOption = None,
    startup: StartupOption = False,
    check: CheckOption = False,
    seconds: SecondsOption = 5.0,
    json_to: options.JsonOption = None,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    device: options.DevicesOption = "cpu",
    seed: options.SeedOption = 0,
    quiet: options.QuietOption = False,
) -> None:
    """Measure how fast twins and environments step, beside other engines, and how fast a policy learns.

    Twins steer and drive at random, with new commands every 20 ms; environments take random actions; learning is PPO's,
    rollouts and updates, with the packaged hyper-parameters for the device. Each case is timed in five runs, in rounds over
    all cases, compilation excluded; the table has the median, the slowest and the fastest, in steps a second of all copies:
    main steps of 1 ms of twins and peers, control steps of environments.

    The share of the ceiling is what twins reach of what small kernels do here at best with as many operations and bytes. On
    a CPU it is of one core without SIMD, on a GPU of the whole device. --ground mesh and other --laws have none.

    A peer is the same vehicle without hydraulics (two frames, four sprung arms, four driven spheres as wheels, the forest
    as a height field of 256 x 256, steps of 1 ms) in MuJoCo on the CPU, or on a GPU in MuJoCo Warp or Newton; each counts
    at its best batch. Peers need pip install 'aoro-gym\\[bench]'; newton, besides, pip install newton==1.8.0, and is left
    out without it.

    --check measures nothing of that, but ratios of two ways to do the same, such as lanes over one twin after the other,
    and ends with exit code 1 if one is less than it may be. Of the other options it takes --device, --machine, --seconds.

    The file of --json is written anew after each run, so that an interrupted benchmark keeps what it has.

    [bold]Examples[/]

      aoro-gym bench
      aoro-gym bench --check
      aoro-gym bench --ground raster --randomise --twins 1,64 --peer mujoco --startup
      aoro-gym bench --what twin,env --ground raster --device cuda:0 --twins 4096,65536 --json b.json
      aoro-gym bench --device cuda:0 --ground raster --twins 32768 --peer mujoco_warp --peer newton
      aoro-gym bench --what train --trainer sb3,resident --device cuda:0 --twins 4096,16384
    """
    with checking_input():
        from aoro_gym.execution.files import with_nulls, write_json

        counts = {"twins": _counts("--twins", twins)}
        asked = options.run_spec(machine, set_, scale, device, seed, laws=laws)
        chosen = options.load(asked, several=not check)
        if check:
            _check(chosen, device, seconds, json_to)
            return
        from aoro_gym.benchmark.report import tables
        from aoro_gym.benchmark.run import Plan, run

        counts |= {"threads": _counts("--threads", threads), "worlds": _counts("--worlds", worlds)}
        plan = Plan(
            **counts, what=_parts(what), env=env, trainers=_parts(trainers), ground=ground, randomise=randomise,
            output=output, device=device, peers=tuple(peers or ()), startup=startup, seconds=seconds, seed=seed,
        )  # fmt: skip
        for peer, reason in plan.skipped.items():
            terminal.warn(f"peer {peer} is left out, {reason}")

    def save(so_far: dict[str, Any]) -> None:
        if json_to is not None and not is_output(json_to):
            write_json(json_to, with_nulls(so_far | {"made_by": asked.to_json()}))

    with terminal.progress("bench") as tell, running():
        result = run(plan, chosen, tell, save)
    conclude(result | {"made_by": asked.to_json()}, tables(result), json_to=json_to)


def _check(machine: Machine, device: str, seconds: float, json_to: Path | None) -> None:
    """Measure all guards; exit code 1 if one fails."""
    from aoro_gym.benchmark.guards import check
    from aoro_gym.benchmark.report import guard_table
    from aoro_gym.checks import check_range

    check_range("seconds", seconds, "s", gt=0.0, le=600.0)
    with terminal.progress("bench --check") as tell, running():
        result = check(device, machine, seconds=seconds, progress=tell)
    conclude(result, [guard_table(result)], json_to=json_to)
    if not all(row["passes"] for row in result["guards"]):
        raise typer.Exit(1)


def _parts(text: str) -> tuple[str, ...]:
    """Parts of a list with commas."""
    return tuple(part.strip() for part in text.split(","))


def _counts(option: str, text: str | None) -> tuple[int, ...]:
    """Positive integers of a list with commas; none of None."""
    parts = _parts(text) if text else ()
    for part in parts:
        if not part.isdecimal() or int(part) < 1:
            raise ValueError(f"{option} {text!r}: {part!r} must be a positive integer")
    return tuple(int(part) for part in parts)
