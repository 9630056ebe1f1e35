"""Commands about the networks that a diagnosis asks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.application import Application
from aoro_gym.cli.options import option
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.reporting import terminal

app = Application(no_args_is_help=True, rich_markup_mode="rich", help="Networks that a diagnosis asks.")

OutOption = Annotated[Path, option("--out -o", "DIR", "Folder to write to.")]
MachinesOption = Annotated[
    int, option("--machines", "N", "Simulated machines, each with six days of six logs.", min=20)
]
NetworksOption = Annotated[int, option("--networks", "N", "Networks, whose mean a diagnosis takes.", min=1)]
MinutesOption = Annotated[float, option("--minutes", "T", "Most time for each network.", min=0.01)]
StepsOption = Annotated[int, option("--steps", "N", "Batches of each network.", min=1)]
BatchOption = Annotated[int, option("--batch", "N", "Cases in a batch.", min=1)]
StartOption = Annotated[Path | None, option("--start", "DIR", "Folder of networks whose weights training begins with.")]
ProcessesOption = Annotated[int, option("--processes", "N", "Processes that draw machines.", min=1)]
TablesOption = Annotated[bool, option("--tables", None, "Networks of tables of key figures, instead of logs.")]


@app.callback()
def _networks() -> None:
    """Networks that a diagnosis asks."""


@app.command()
def train(
    out: OutOption = Path("networks"),
    tables: TablesOption = False,
    machines: MachinesOption = 102400,
    networks: NetworksOption = 3,
    minutes: MinutesOption = 10.0,
    steps: StepsOption = 16000,
    batch: BatchOption = 1024,
    start: StartOption = None,
    processes: ProcessesOption = 1,
    device: options.DeviceOption = "cuda:0",
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Train networks that name the cause of a gap, on machines, laws, days and sensors drawn by a prior.

    Simulates N machines with two healthy and four later days, on which there is nothing, one effect, two, or something that
    the catalogue lacks, and trains networks on them. The twentieth part of the machines is held out: DIR/training.json says
    how well each network and all of them name causes there, with each usual set of sensors. That is on simulated machines;
    aoro-gym blind says how well a diagnosis does on machines whose laws nobody here wrote.

    With --tables they are networks for diagnose --metrics TABLE: of the key figures of six full turns on one healthy and
    four later days. DIR/tables_calibration.json then says how sure they may be, by the machines that were held out.

    Networks that the same command finished before it was stopped are kept, and more are trained beside them.

    The same seed draws the same machines, whichever number of processes. The whole needs a GPU with 32 GB; a CPU serves for
    a trial.

    [bold]Examples[/]

      aoro-gym diagnosis train --processes 16
      aoro-gym diagnosis train --machines 20 --networks 1 --steps 20 --batch 8 --device cpu
      aoro-gym diagnosis train --tables --machines 40000 --networks 1 --minutes 2 --processes 16
    """
    with checking_input():
        from aoro_gym.execution.files import check_writable

        if tables and start is not None:
            raise ValueError(f"--start {start} holds networks of logs; leave it out with --tables")
        options.check_device(device)
        check_writable(out / "training.json")
        from aoro_gym.diagnosis.network import program, tables_program
        from aoro_gym.diagnosis.network.dataset import Amount
        from aoro_gym.diagnosis.network.forward import networks_in
        from aoro_gym.diagnosis.network.tables_forward import CALIBRATION, TRAINING, file_name
        from aoro_gym.diagnosis.network.tables_model import SHAPE
        from aoro_gym.diagnosis.network.training import Course

        begin = () if start is None else networks_in(start)
        amount = Amount(machines, seed=seed, processes=processes)
        what = program.Program(amount, networks, Course(steps=steps, batch=batch), 60.0 * minutes, start=begin)
        if tables:
            what = replace(what, course=tables_program.course(steps, batch), shape=SHAPE)
    with terminal.progress("train networks") as tell, running():
        (tables_program if tables else program).run(what, device, out, tell)
    files = (
        [*map(file_name, range(networks)), CALIBRATION, TRAINING]
        if tables
        else [*(f"network_{number}.safetensors" for number in range(networks)), "training.json"]
    )
    conclude(out / files[-1], written=[out / name for name in files], json_to=json_to)
