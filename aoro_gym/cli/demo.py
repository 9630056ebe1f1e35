"""Command that shows everything on one page."""

from __future__ import annotations

from pathlib import Path

from aoro_gym.cli import options
from aoro_gym.cli.calibration import comparison_machine, ensemble_machines, validated
from aoro_gym.cli.outcome import checking_input, conclude, running
from aoro_gym.cli.simulation import simulated
from aoro_gym.reporting import terminal


def demo(
    out: options.FolderOption = Path("demo"),
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    device: options.DeviceOption = "cpu",
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Validate the twin, let controllers steer and policies drive it, turn fully left and drive straight on: one page.

    FOLDER/index.html holds it all; the whole validation stands in FOLDER/validation, as from 'aoro-gym validate'. The
    controlled turn is an episode of the learning environment AORO/Turning-v0 with its reference controller, the drive one
    of AORO/PathTracking-v0 with a learned policy, beside pure pursuit: over a forest that is scanned with noise and holes,
    saved, loaded back and repaired.

    [bold]Examples[/]

      aoro-gym demo
      aoro-gym demo --out cold --scale steering.valve.spool_time_constant=5
    """
    with checking_input():
        from aoro_gym.agents.evaluation.demonstration import controlled_turn, forest_drive
        from aoro_gym.simulation import output
        from aoro_gym.simulation.manoeuvres import standing_turn, straight_drive
        from aoro_gym.simulation.plots import write_html
        from aoro_gym.twin import Twin
        from aoro_gym.validation import report

        options.check_folder(out, "index.html")
        run = options.run_spec(machine, set_, scale, device, seed)
        chosen = options.load(run)
        plans = {"left_turn": standing_turn(1, 1.0, float(chosen.joint.range)), "straight_drive": straight_drive(0.5)}
        second, family = comparison_machine(run.machine, options.DATASHEET), ensemble_machines(run.machine, None)
        twin = Twin(machine=chosen, device=device)
        twin.step(duration=twin.main_step)  # says so where kernels are compiled first
    result = validated(chosen, second, family, run)
    with running():
        report.write_report(result, out / "validation")
    passages = [report.passage(result, out / "validation")]
    with terminal.progress("AORO/Turning-v0") as tell, running():
        passages.append(controlled_turn(chosen, out / "turning", device=device, seed=seed, progress=tell))
    with terminal.progress("scanning a forest") as tell, running():
        passages.append(forest_drive(chosen, out / "drive", device=device, seed=seed, progress=tell))
    sections = []
    for name, plan in plans.items():
        sections.append(simulated(twin, plan))
        with running():
            output.write(sections[-1], twin, out / f"{name}.csv", run, page=False)
    page = out / "index.html"
    write_html(page, "AORO twin: demo", run.machine.sentence, sections, passages)
    shown = [*report.printed(result), *(output.figure_table(one) for one in sections)]
    found = {name: dict(one.figures) for name, one in zip(plans, sections, strict=True)} | {"page": str(page.resolve())}
    conclude(found, shown, [page.resolve()], json_to=json_to, highlight=False)
