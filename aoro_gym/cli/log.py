"""Commands about logs: what a bag holds, and other formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.application import Application
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.reporting import terminal

app = Application(no_args_is_help=True, rich_markup_mode="rich", help="Logs: what a bag holds, and other formats.")

BagArgument = Annotated[Path, argument("BAG", "MCAP file, folder of rosbag2, .db3, or .bag of ROS 1.")]
MapOption = Annotated[Path | None, option("--out -o", "FILE", "Mapping to write. Default: BAG.map.toml, beside it.")]
LogArgument = Annotated[Path, argument("LOG", "Log of any format that can be read.")]
IntoArgument = Annotated[Path, argument("INTO", "Log to write, .csv, .parquet, .mcap or .rosbag2 (a folder).")]


@app.callback()
def _logs() -> None:
    """Logs: what a bag holds, and other formats."""


@app.command("map")
def propose(
    bag: BagArgument, out: MapOption = None, json_to: options.JsonOption = None, quiet: options.QuietOption = False
) -> None:
    """Propose which fields of a BAG are the columns of a log, as a mapping to be completed by hand.

    Names of topics, fields and joints are held against those that logs use; units follow from the type of a message or the
    end of a name. What is unknown says "?". With the mapping beside it, calibrate and diagnose read BAG as any log.

    [bold]Examples[/]

      aoro-gym log map turn.mcap
      aoro-gym diagnose turn.mcap --check
    """
    with checking_input():
        from aoro_gym.execution.files import check_writable, write_text
        from aoro_gym.recording.bag_mapping import as_toml, mapping_file, proposed
        from aoro_gym.recording.logs import LOOSE, QUANTITIES

        path = out or mapping_file(bag)
        if path.exists():
            raise ValueError(
                f"{path} exists and may hold what was filled in by hand; remove it, or name another by --out"
            )
        check_writable(path)
        # a steering command is a share, unless the end of its name says volts
        asked = {key: one.bases - LOOSE for key, one in QUANTITIES.items() if key != "time"}
        names = {
            key: sorted(own - asked["steering_signal"] if key == "steering_voltage" else own)
            for key, own in asked.items()
        }
        with terminal.progress("reading the bag"):
            columns, left = proposed(bag, names)
        write_text(path, as_toml(bag, columns, left))
    result = {
        "columns": [
            {"column": one.column, "topic": one.topic, "field": one.field, "unit": one.unit} for one in columns
        ],
        "fields_not_read": len(left),
        "mapping": str(path),
    }
    shown = [f"{one.column}: {one.topic} {one.field} {one.unit}" for one in columns]
    shown.append(f"{len(left)} other fields are listed in the file, not read")
    conclude(result, shown, [path], json_to=json_to, markup=False, highlight=False)


@app.command()
def convert(
    log: LogArgument, into: IntoArgument, json_to: options.JsonOption = None, quiet: options.QuietOption = False
) -> None:
    """Write a LOG in another format: CSV, Parquet, MCAP or rosbag2.

    Numbers keep all their digits in Parquet and bags, nine in CSV. The manifest beside LOG goes with it.

    [bold]Examples[/]

      aoro-gym log convert turn.csv turn.mcap
      aoro-gym log convert turn.mcap turn.parquet
      aoro-gym log convert turn.mcap turn.rosbag2
    """
    with checking_input():
        from aoro_gym.recording.bag_writing import WRITTEN
        from aoro_gym.recording.manifest import read_manifest
        from aoro_gym.recording.tables import read_table
        from aoro_gym.simulation.log import check_log_path, write_log

        if log.resolve() == into.resolve():
            raise ValueError(f"INTO is LOG itself ({into}); name another file")
        check_log_path(into)
        with terminal.progress("reading the log"):
            table = read_table(log)
            # what is measured may be blank, such as a receiver's place before its first solution
            columns = {
                name: table.numbers(name) if name == "time_s" else table.numbers_or_blank(name) for name in table.names
            }
        if into.suffix in WRITTEN and "time_s" not in columns:
            raise ValueError(f"{log} has no column time_s, which gives messages their time")
        manifest = read_manifest(log)
    with running(), terminal.progress("writing the log"):
        written = write_log(into, columns, manifest.values if manifest.path else None)
    conclude(written=written, json_to=json_to)
