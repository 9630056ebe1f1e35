"""Commands that evaluate controllers, policies and trainings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from aoro_gym.agents.training.plan import JOIN_GAPS_HELP, LOCALISATION_HELP, PATH_CRS_HELP, PATH_HELP, TRACK_HELP
from aoro_gym.checks import check_integer, check_range
from aoro_gym.cli import options
from aoro_gym.cli.courses import load_courses, training_courses
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude, entered, resumable, running
from aoro_gym.cli.place import SoilOption, load_soil
from aoro_gym.cli.training import trained
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.agents.controllers.reference import Factory
    from aoro_gym.agents.evaluation.perturbations import Perturbation
    from aoro_gym.machine import Machine

EvaluatedEnvOption = Annotated[
    str,
    option("--env", "ID", "AORO/PathTracking-v0 by default, or another one.", show_default=False),
]
TrustPickleOption = Annotated[
    bool, option("--trust-pickle", None, "Load .zip files of Stable-Baselines3, which run code of their maker.")
]
TerrainOption = Annotated[
    Path | None,
    option("--terrain", "FILE|FOLDER", "Ground: a mesh, raster or cloud, or a world. Default: generated forests."),
]
PathOption = Annotated[Path | None, option("--path", "FILE", PATH_HELP)]
TrackOption = Annotated[str | None, option("--track", "NAME|N", TRACK_HELP)]
JoinGapsOption = Annotated[bool, option("--join-gaps", None, JOIN_GAPS_HELP)]
PathCrsOption = Annotated[str | None, option("--path-crs", "CRS", PATH_CRS_HELP)]
PathLengthOption = Annotated[float, option("--path-length", "M", "Of the paths that are generated on --terrain.")]
EpisodesOption = Annotated[int, option("--episodes", "N", "Episodes a policy.")]
PerturbationOption = Annotated[
    str | None,
    option("--perturbation", "NAME", "Drive machines drawn as the leaderboard's: perturbed, or 'with an effect'."),
]
LogsOption = Annotated[
    str | None,
    option("--logs", "FORMAT", "Log each policy's first episode, too: csv, parquet, mcap or rosbag2."),
]
LocalisationOption = Annotated[str | None, option("--localisation", "gains|filter", LOCALISATION_HELP)]
FilmsOption = Annotated[bool, option("--films/--no-films", None, "Draw each policy's first episode.")]


def evaluate(
    env: EvaluatedEnvOption = options.TRACKING,
    policy: options.PoliciesOption = None,
    trust_pickle: TrustPickleOption = False,
    terrain: TerrainOption = None,
    path: PathOption = None,
    track: TrackOption = None,
    join_gaps: JoinGapsOption = False,
    path_crs: PathCrsOption = None,
    path_length: PathLengthOption = 60.0,
    soil: SoilOption = None,
    episodes: EpisodesOption = 32,
    repeats: options.RepeatsOption = 1,
    out: options.FolderOption = Path("evaluation"),
    films: FilmsOption = True,
    logs: LogsOption = None,
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    ray: options.RayOption = None,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    localisation: LocalisationOption = None,
    perturbation: PerturbationOption = None,
    device: options.DevicesOption = "cpu",
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Drive the same episodes under several policies, and compare them.

    A policy is a reference controller, one of the package, a file of 'aoro-gym train', or mppi, which plans by the twin.

    Means over the episodes with 95 % intervals: success, cross-track error, speed, energy, tilt, return, endings; of turning
    the joint's responses, on --soil the depth of ruts. Episode i has the seed --seed + i for every policy. A terrain file is
    loaded, checked and repaired as 'aoro-gym terrain' does it; solid objects of a world push back, but not on --soil. With
    --laws families each episode has a machine of other laws, drawn by its seed; policies are made for that of the file.

    FOLDER gets evaluation.json, plots, films (MP4 with the extra 'video', else AVIF) and index.html. Ctrl-C is safe: the
    same command goes on where it stopped.

    [bold]Examples[/]

      aoro-gym evaluate
      aoro-gym evaluate --policy preview --policy stanley --episodes 64 --logs mcap
      aoro-gym evaluate --terrain forest.laz --path lap.gpx --soil peat --policy preview
      aoro-gym evaluate --terrain forest_world --policy preview --policy mppi --episodes 2 --device cpu:simd
      aoro-gym evaluate --env AORO/Turning-v0 --scale steering.valve.spool_time_constant=5
      aoro-gym evaluate --env AORO/Turning-v0 --laws families --perturbation perturbed --device cuda:all
      aoro-gym evaluate --env AORO/Turning-v0 --policy proportional-derivative --policy runs/turning/policy.json
    """
    with checking_input():
        from aoro_gym.agents.evaluation import evaluate as evaluation
        from aoro_gym.agents.evaluation.cached_episodes import accepted
        from aoro_gym.agents.evaluation.report import table, write_report
        from aoro_gym.agents.evaluation.selection import check_episodes
        from aoro_gym.envs.path_tracking.course_files import CourseFiles

        _check_files(out, logs)
        policies = _policies(env, policy, trust_pickle, localisation)
        check_episodes(episodes, repeats)
        run = options.run_spec(machine, set_, scale, device, seed, laws=laws)
        chosen = options.load(run, draw=False, several=True)
        drawn, drawn_by = _drawn_machines(laws, perturbation, chosen)
        files = CourseFiles(env, terrain, path, path_length, track, join_gaps, path_crs)
        asked: dict[str, Any] = {"episodes": episodes, "repeats": repeats, "seed": seed, "machine": chosen}
        asked |= {"courses": load_courses(files), "device": device, "soil": load_soil(soil, None, device)}
        asked |= evaluation.localised(env, localisation)
    inputs = evaluation.asked_of(env, policies, **asked) | drawn_by
    with _keeping(out, inputs, restart, accept_code_change) as kept, terminal.progress(env) as tell:
        driven = 0.5 if films else 0.95
        asked |= {"drawn": drawn, "ray": ray, "kept": kept, "progress": terminal.within(tell, 0.0, driven)}
        with checking_input():  # such as paths that leave the ground
            result = evaluation.evaluate(env, policies, **asked)
        given = _given(perturbation=perturbation, soil=soil, localisation=localisation)
        made_by = run.to_json() | files.to_json() | accepted(kept) | given
        about: dict[str, Any] = {"lead": run.machine.sentence, "made_by": made_by, "films": films, "logs": logs}
        written = write_report(result, out, **about, progress=terminal.within(tell, driven, 1.0))
    conclude(out / "evaluation.json", [table(result)], written, json_to=json_to)


def _given(**options: str | None) -> dict[str, str]:
    """Of options by name those that were given."""
    return {name: value for name, value in options.items() if value is not None}


def _policies(env: str, asked: list[str] | None, trust_pickle: bool, localisation: str | None) -> dict[str, Factory]:
    """Those of --policy; warns of who learned with another estimate of the pose."""
    from aoro_gym.agents.evaluation.selection import named_policies, strangers

    policies = named_policies(env, asked, trust_pickle=trust_pickle, localisation=localisation)
    for sentence in strangers(policies, localisation):
        terminal.warn(sentence)
    return policies


def _check_files(out: Path, suffix: str | None) -> None:
    """ValueError unless a page, and logs of this suffix, can be written."""
    from aoro_gym.checks import check_choice
    from aoro_gym.simulation.log import SUFFIXES, check_log_path

    options.check_folder(out, "index.html")
    if suffix is not None:
        check_choice("--logs", suffix, [one[1:] for one in SUFFIXES])
        check_log_path(out / f"episode.{suffix}")


def _drawn_machines(
    laws: str | None, perturbation: str | None, machine: Machine
) -> tuple[Perturbation, dict[str, Any]]:
    """What gives the machines that are driven, and what they follow from beside ``machine``, by name."""
    from aoro_gym.agents.evaluation.inputs import machine_ranges
    from aoro_gym.agents.evaluation.perturbations import drawn_machines, unperturbed

    drawn = drawn_machines(laws, perturbation)
    follows = {"laws": laws, "perturbation": perturbation, "machine ranges": machine_ranges(machine)}
    return drawn, {} if drawn is unperturbed else follows


@contextmanager
def _keeping(out: Path, inputs: dict[str, Any], restart: bool, accept_code_change: bool) -> Iterator[Path]:
    """Hold the folder ``out`` with the episodes that an interrupted run has kept there."""
    from aoro_gym.agents.evaluation import cached_episodes

    kept = cached_episodes.resumable(out, inputs, restart=restart, accept_code_change=accept_code_change)
    with resumable(), running(), entered(kept) as folder:
        yield folder


LeaderboardEpisodesOption = Annotated[int, option("--episodes", "N", "Episodes a policy, under each perturbation.")]
ReadmeOption = Annotated[
    Path | None, option("--readme", "FILE.md", "Put the table between the marks of this file, too.")
]
LeaderboardSeedOption = Annotated[
    int | None, option("--seed", None, "Of the first episode. Default: one that is held out.")
]


def leaderboard(
    env: options.EnvOption = options.TRACKING,
    policy: options.PoliciesOption = None,
    episodes: LeaderboardEpisodesOption = 100,
    repeats: options.RepeatsOption = 1,
    out: options.FolderOption = Path("leaderboard"),
    readme: ReadmeOption = None,
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    ray: options.RayOption = None,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    device: options.DevicesOption = "cpu",
    seed: LeaderboardSeedOption = None,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Rank policies and tuned controllers on seeds, grounds and machines that none of them saw.

    All drive the same episodes three times: on the machine as it is; with all of its uncertain parameters drawn within
    their ranges; and with an effect of the catalogue switched on in addition. Metrics are means of the middle half of the
    episodes (interquartile means), with bootstrapped 95 % intervals, and differences from the best controller, episode by
    episode. With --repeats the same is asked for N times, with other noise and other machines: beside the interval over
    episodes, which might have been others, there is one over what might have happened in these (stratified bootstrap).

    Ctrl-C is safe: the same command goes on where it stopped. FOLDER gets leaderboard.json, leaderboard.md and
    leaderboard.png. In --readme the table replaces what stands between
    <!-- leaderboard ID --> and <!-- leaderboard ID end -->.

    [bold]Examples[/]

      aoro-gym leaderboard
      aoro-gym leaderboard --env AORO/Turning-v0 --episodes 350 --repeats 4 --readme README.md
      aoro-gym leaderboard --policy preview --policy runs/mine/best.json
      aoro-gym leaderboard --laws vehicle --out leaderboard_vehicle
    """
    with checking_input():
        from aoro_gym.agents.evaluation import leaderboard as board
        from aoro_gym.agents.evaluation.cached_episodes import accepted
        from aoro_gym.agents.evaluation.evaluate import asked_of
        from aoro_gym.agents.evaluation.inputs import machine_ranges
        from aoro_gym.agents.evaluation.selection import check_episodes, named_policies

        options.check_folder(out, "leaderboard.json")
        policies = named_policies(env, policy)
        check_episodes(episodes, repeats)
        if readme is not None:
            board.around_table(readme, env)
        run = options.run_spec(machine, set_, scale, device, board.SEED if seed is None else seed, laws=laws)
        chosen = options.load(run, several=True)
    asked: dict[str, Any] = {
        "episodes": episodes, "repeats": repeats, "seed": run.seed, "machine": chosen, "device": device,
    }  # fmt: skip
    inputs = asked_of(env, policies, **asked) | {"machine ranges": machine_ranges(chosen)}
    with _keeping(out, inputs, restart, accept_code_change) as kept, terminal.progress(env) as tell:
        with checking_input():  # such as a cluster that is not there
            result = board.compare(env, policies, **asked, ray=ray, kept=kept, progress=tell)
        written = board.write(result, out, readme=readme, made_by=run.to_json() | accepted(kept))
    conclude(out / "leaderboard.json", [board.table(result)], written, json_to=json_to)


SizeOption = Annotated[
    float, option("--size", "SHARE", "Of the effects, as a share of their range: 0.5 is medium, 1 its end.")
]
RobustnessEpisodesOption = Annotated[int, option("--episodes", "N", "Episodes a policy, on each machine.")]


def robustness(
    env: options.EnvOption = options.TRACKING,
    policy: options.PoliciesOption = None,
    size: SizeOption = 0.5,
    episodes: RobustnessEpisodesOption = 32,
    out: options.FolderOption = Path("robustness"),
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    device: options.DevicesOption = "cpu",
    seed: LeaderboardSeedOption = None,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Say which gap between twin and machine hurts which policy, as a heat map.

    Policies are made for the machine of the file, and drive the same episodes on machines that differ from it in one way
    each: every effect of the catalogue that acts on the machine, to either side; every family of laws; all uncertain
    parameters drawn within their ranges. What is told is the change of success and of the metrics that policies are compared
    by, episode by episode, with 95 % intervals; the worst first, for the policy that is best on the machine of the file.

    Ctrl-C is safe: the same command goes on where it stopped. FOLDER gets robustness.json and robustness.png. What
    retraining wins back of what an effect costs, 'aoro-gym gap' says.

    [bold]Examples[/]

      aoro-gym robustness --env AORO/Turning-v0
      aoro-gym robustness --policy preview --policy runs/mine/best.json --device cpu:simd
      aoro-gym robustness --env AORO/Turning-v0 --size 1 --episodes 100
    """
    with checking_input():
        from aoro_gym.agents.evaluation import robustness as study
        from aoro_gym.agents.evaluation.cached_episodes import accepted
        from aoro_gym.agents.evaluation.evaluate import asked_of
        from aoro_gym.agents.evaluation.inputs import machine_ranges
        from aoro_gym.agents.evaluation.leaderboard import SEED
        from aoro_gym.agents.evaluation.selection import check_episodes, named_policies

        options.check_folder(out, "robustness.json")
        policies = named_policies(env, policy)
        check_episodes(episodes)
        check_range("--size", size, "", gt=0.0, le=1.0)
        run = options.run_spec(machine, set_, scale, device, SEED if seed is None else seed, laws=laws)
        chosen = options.load(run, several=True)
    asked: dict[str, Any] = {"episodes": episodes, "seed": run.seed, "machine": chosen, "device": device}
    inputs = asked_of(env, policies, **asked) | {"size": size, "machine ranges": machine_ranges(chosen)}
    with _keeping(out, inputs, restart, accept_code_change) as kept, terminal.progress(env) as tell:
        with checking_input():
            result = study.measure(env, policies, share=size, **asked, kept=kept, progress=tell)
        written = study.write(result, out, made_by=run.to_json() | accepted(kept))
    conclude(out / "robustness.json", study.tables(result), written, json_to=json_to)


TrainingsArgument = Annotated[list[Path], argument("FOLDER...", "Of 'aoro-gym train', done or on the way.")]

PlaceOption = Annotated[
    str | None, option("--device", "DEVICE", "Where the controllers drive. Default: where the trainings ran.")
]


def curves(
    folders: TrainingsArgument,
    device: PlaceOption = None,
    out: options.FolderOption = Path("curves"),
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Learning curves of trainings, beside the reference controllers on the episodes that they were evaluated on.

    Trainings that differ by their seed alone make one curve, the interquartile mean over the seeds, in a band of its 95 %
    interval and a paler one from the least to the largest of them. FOLDER gets curves.png and curves.json. Trainings of a
    GPU are drawn elsewhere with --device: there the controllers drive.

    [bold]Examples[/]

      for s in 0 1 2 3 4; do aoro-gym train --env AORO/Turning-v0 --seed $s --out runs/turning_$s; done
      aoro-gym curves runs/turning_*
      aoro-gym curves runs/of_a_gpu_* --device cpu:simd
    """
    with checking_input():
        from aoro_gym.agents.evaluation.cached_episodes import accepted
        from aoro_gym.agents.training import curves as drawing
        from aoro_gym.execution.files import with_nulls, write_json

        options.check_folder(out, "curves.json")
        found = drawing.read(folders)
        plan = found[0].plan if device is None else replace(found[0].plan, device=device)
        chosen = options.load(
            options.run_spec(plan.machine, plan.set, plan.scale, plan.device, laws=plan.laws), draw=False
        )
        held_out = training_courses(replace(plan, forests=1))[1]
        for warning in drawing.check_inputs(folders, chosen, held_out):
            terminal.warn(warning)
    inputs = drawing.references_asked(plan, chosen, held_out)
    with _keeping(out, inputs, restart, accept_code_change) as kept, terminal.progress(plan.env) as tell:
        beside = drawing.references(plan, chosen, held_out, tell, kept)
        write_json(out / "curves.json", with_nulls(drawing.to_json(found, beside) | accepted(kept)))
        drawing.write_figure(found, beside, out / "curves.png")
    written = [out / "curves.png", out / "curves.json"]
    conclude(written[-1], [drawing.table(found, beside)], written, json_to=json_to)


PolicyOption = Annotated[str, option("--policy", "NAME|FILE", "Who drives; with --retrain a file of 'aoro-gym train'.")]
PlantOption = Annotated[str | None, option("--plant", "NAME|FILE", "Machine to drive. Default: --machine.")]
EffectOption = Annotated[
    list[str] | None, option("--effect", "NAME=VALUE", "Effect that the plant has, too, in SI. Repeatable.")
]
DiagnosisOption = Annotated[
    Path | None, option("--diagnosis", "FOLDER", "What 'aoro-gym diagnose' wrote: its likeliest machine.")
]
ImprovedOption = Annotated[str | None, option("--improved", "NAME|FILE", "Instead: machine of the improved twin.")]
RetrainOption = Annotated[int, option("--retrain", "STEPS", "Environment steps of retraining; 0 does not retrain.")]
GapEpisodesOption = Annotated[int, option("--episodes", "N", "Episodes in each place.")]


def gap(
    policy: PolicyOption,
    env: options.EnvOption = options.TRACKING,
    plant: PlantOption = None,
    effect: EffectOption = None,
    diagnosis: DiagnosisOption = None,
    improved: ImprovedOption = None,
    retrain: RetrainOption = 0,
    episodes: GapEpisodesOption = 64,
    out: options.FolderOption = Path("gap"),
    restart: options.RestartOption = False,
    accept_code_change: options.AcceptCodeChangeOption = False,
    machine: options.MachineOption = options.MACHINE,
    set_: options.SetOption = None,
    scale: options.ScaleOption = None,
    laws: options.LawsOption = None,
    device: options.DeviceOption = "cpu",
    seed: options.SeedOption = 0,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """What a gap costs a policy, how much of that a diagnosis foresees, and how much retraining wins back.

    The policy drives the same episodes in the baseline (--machine), in the plant (--plant, --effect) and in the twin that a
    diagnosis improved (--diagnosis or --improved). With --retrain it learns on for so many steps in the improved twin, and
    as many in the baseline for comparison, and both drive in the plant. Ctrl-C is safe: the same command goes on where it
    stopped, and a retraining that is done is not done again. With another twin or policy --restart begins anew.

    FOLDER gets gap.json, and the retrained policies.

    [bold]Examples[/]

      aoro-gym gap --policy runs/mine/best.json --effect spool_lag=0.05 --diagnosis diagnosis
      aoro-gym gap --policy preview --plant field.toml --improved diagnosis/cause_1.toml
      aoro-gym gap --policy preview --laws vehicle --effect spool_lag=0.05 --improved aoro
      aoro-gym gap --policy runs/mine/best.json --plant field.toml --diagnosis diagnosis --retrain 500000
    """
    with checking_input():
        from aoro_gym.agents.evaluation.cached_episodes import accepted
        from aoro_gym.agents.evaluation.evaluate import asked_of
        from aoro_gym.agents.evaluation.inputs import machine_values
        from aoro_gym.agents.evaluation.selection import check_episodes, named_policies
        from aoro_gym.agents.training import gap as gaps
        from aoro_gym.execution.files import with_nulls, write_json

        options.check_folder(out, "gap.json")
        _, make = next(iter(named_policies(env, [policy]).items()))
        check_episodes(episodes)
        check_integer("--retrain", retrain, ge=0)
        run = options.run_spec(machine, set_, scale, device, seed, laws=laws)
        improved = gaps.improved_machine(diagnosis, improved)
        chosen = options.load(run)
        driven = gaps.with_effects(chosen if plant is None else options.load_machine(plant), effect or [])
        if plant is None and not effect:
            raise ValueError("the plant is the baseline; give --plant or --effect")
        found = options.load_machine(improved)
        plan = gaps.retraining_plan(env, policy, steps=retrain, seed=seed, device=device) if retrain else None
    asked: dict[str, Any] = {
        "episodes": episodes, "seed": gaps.SEED + seed, "courses": gaps.courses(env), "device": device,
    }  # fmt: skip
    inputs = asked_of(env, {policy: make}, machine=chosen, retrain=retrain, **asked)
    inputs |= {"plant": machine_values(driven), "improved": machine_values(found)}
    with _keeping(out, inputs, restart, accept_code_change) as kept:
        others = {
            name: trained(plan, out / name, where, restart=restart, accept_code_change=accept_code_change)
            for name, where in (("retrained", found), ("control", chosen))
            if plan is not None
        }
        with terminal.progress(env) as tell:
            result = gaps.measure(
                env, make, baseline=chosen, plant=driven, improved=found, **others, **asked, kept=kept, progress=tell
            )
        made_by = run.to_json() | {"policy": policy, "plant": plant, "effects": effect, "improved": found.name}
        made_by |= {"retrain": retrain} | accepted(kept)
        write_json(out / "gap.json", with_nulls(result.to_json() | {"made_by": made_by}))
    conclude(out / "gap.json", [gaps.table(result)], [out / "gap.json"], json_to=json_to)
