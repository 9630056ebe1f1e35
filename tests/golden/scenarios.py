"""Fixed scenarios whose results show whether two revisions behave alike: trajectories, environments, reports, a training.

    python tests/golden/scenarios.py FOLDER [--group quick|full] [--only NAME]

Runs on any revision that PYTHONPATH names, so it uses doors alone that stay when modules move: ``aoro_gym``,
``aoro_gym.terrains``, Gymnasium's ids and the command line. Every scenario writes into FOLDER/NAME: arrays as .npz, and
what its commands write; one that fails leaves its error in FOLDER/NAME/error.txt.
"""

from __future__ import annotations

import argparse
import io
import os
import runpy
import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from aoro_gym import Machine, Plane, Twin
from aoro_gym.terrains import Path as DrivenPath
from aoro_gym.terrains import Terrain

SCENARIOS: dict[str, tuple[str, Callable[[Path], None]]] = {}
"""Group and function by name."""
ERROR = "error.txt"

DRIVE_AND_TURN = (
    {"drive_signal": 0.5},
    {"steering_signal": 0.8},
    {"steering_signal": -1.0, "drive_signal": 0.9},
    {"steering_signal": 0.0, "drive_signal": -0.2},
)
"""Straight on, left, right and faster, then back."""
EFFECTS = {
    "engine.droop": 1.5,
    "joint.friction_torque": 1.5,
    "oil.bulk_modulus": 0.7,
    "oil.gas_fraction": 2.0,
    "steering.hose_bulk_modulus": 0.6,
    "steering.pump.stroke_up_time": 1.5,
    "steering.valve.compensator_open_drop": 1.3,
    "steering.valve.cross_port_leakage": 5.0,
    "steering.valve.spool_rate_limit": 0.6,
    "tire.sigma0_lateral": 0.8,
    "tire.stiffness": 0.9,
}
"""Factors on parameters: a machine with several things wrong at once."""


def scenario(group: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    """Register a function that writes its results into the folder that it gets."""

    def register(function: Callable[[Path], None]) -> Callable[[Path], None]:
        SCENARIOS[function.__name__] = group, function
        return function

    return register


# ---- trajectories


def save_run(
    folder: Path, twin: Twin, commands: tuple[Mapping[str, Any], ...] = DRIVE_AND_TURN, each: float = 0.5
) -> None:
    """Hold every set of commands for ``each`` [s]; save all outputs, sampled every 10 ms, and the final state."""
    traces: list[Any] = [twin.step(held, each, sample_every=0.01) for held in commands]
    found: dict[str, Any] = {name: np.concatenate([trace[name] for trace in traces]) for name in traces[0]}
    np.savez(folder / "run.npz", state=twin.state.numpy(), **found)


@scenario("quick")
def standing_turn(folder: Path) -> None:
    save_run(folder, Twin(), ({"steering_signal": 1.0}, {"steering_signal": -1.0}), each=2.2)


@scenario("quick")
def standing_turn_datasheet(folder: Path) -> None:
    twin = Twin(machine="aoro_datasheet")
    twin.reset(joint_angle=-0.5)
    save_run(folder, twin, ({"steering_signal": 0.6}, {"steering_signal": 0.0}), each=1.0)


@scenario("quick")
def driving(folder: Path) -> None:
    save_run(folder, Twin())


@scenario("quick")
def driving_with_effects(folder: Path) -> None:
    machine = Machine.load().scale(EFFECTS, check_ranges=False)
    machine = machine.set({"steering.valve.command_delay": 0.03, "joint.backlash": 0.2}, check_ranges=False)
    save_run(folder, Twin(machine=machine))


@scenario("quick")
def driving_on_a_slope(folder: Path) -> None:
    twin = Twin(terrain=Plane(slope_deg=8.0, direction_deg=30.0, friction=0.7, rolling_resistance=3.0))
    twin.reset(heading=0.4, joint_angle=0.2)
    save_run(folder, twin)


@scenario("quick")
def arms_gears_and_brake(folder: Path) -> None:
    commands = (
        {"arm_fl": 0.6, "arm_fr": -0.6, "gear": 2, "drive_signal": 0.6},
        {"arm_fl": 0.0, "arm_fr": 0.0, "arm_rl": 1.0, "gear": 3, "traction_fl": 0.5},
        {"arm_rl": 0.0, "drive_signal": 0.0, "parking_brake": 1.0},
    )
    save_run(folder, Twin(), commands)


def hilly() -> Terrain:
    """Waves of 0.15 m with a step of 0.1 m and a stripe of soft, slippery ground; 40 m x 40 m."""
    x, y = np.meshgrid(np.arange(-20.0, 20.1, 0.5), np.arange(-20.0, 20.1, 0.5))
    heights = 0.15 * np.sin(0.9 * x + 0.3 * y) * np.cos(0.7 * y) + 0.1 * (x > 3.0)
    return Terrain.from_heights(heights, cell=0.5, corner=(-20.0, -20.0), friction=0.8, rolling_resistance=2.0)


@scenario("quick")
def driving_on_a_raster(folder: Path) -> None:
    save_run(folder, Twin(terrain=hilly(), ground="raster"))


@scenario("quick")
def driving_on_a_mesh(folder: Path) -> None:
    save_run(folder, Twin(terrain=hilly(), ground="mesh"))


@scenario("quick")
def many_twins(folder: Path) -> None:
    """64 machines and slopes; a quarter is put back to rest, and gets other machines, half-way."""
    rng, count = np.random.default_rng(0), 64
    factors = {key: rng.uniform(0.8, 1.2, count) for key in EFFECTS if not key.startswith("tire")}
    machine = Machine.load().scale(factors, check_ranges=False)
    twin = Twin(count, machine=machine, terrain=Plane(slope_deg=rng.uniform(-6.0, 6.0, count)))
    twin.reset(heading=rng.uniform(-3.0, 3.0, count), joint_angle=rng.uniform(-0.6, 0.6, count))
    twin.step({"steering_signal": rng.uniform(-1.0, 1.0, count), "drive_signal": rng.uniform(-1.0, 1.0, count)}, 0.3)
    chosen = np.arange(0, count, 4)
    twin.set_machines(chosen, Machine.load("aoro_datasheet"))
    twin.reset(np.isin(np.arange(count), chosen))
    save_run(folder, twin, DRIVE_AND_TURN[:2], each=0.2)


# ---- environments


def numbers(infos: Mapping[str, Any], prefix: str = "") -> dict[str, np.ndarray]:
    """The numeric entries of nested infos, by dotted name."""
    found: dict[str, np.ndarray] = {}
    for name, value in infos.items():
        if isinstance(value, Mapping):
            found.update(numbers(value, f"{prefix}{name}."))
        elif np.asarray(value).dtype.kind in "biuf":
            found[prefix + name] = np.asarray(value)
    return found


def save_steps(folder: Path, env: Any, steps: int, reset_at: int) -> None:
    """Slowly varying actions from a seed; all sub-environments are reset anew at one step."""
    rng = np.random.default_rng(1)
    observations, infos = env.reset(seed=7)
    results: dict[str, list[Any]] = {}

    def keep(**found: Any) -> None:
        for name, value in numbers(found).items():
            results.setdefault(name, []).append(value.copy())

    keep(observations=observations, infos=infos)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    for step in range(steps):
        if step == reset_at:
            observations, infos = env.reset(seed=8)
            keep(observations=observations, infos=infos)
        action = np.clip(0.9 * action + 0.3 * rng.standard_normal(action.shape), -1.0, 1.0).astype(np.float32)
        observations, rewards, terminated, truncated, infos = env.step(action)
        keep(observations=observations, rewards=rewards, terminated=terminated, truncated=truncated, infos=infos)
    env.close()
    stacked: dict[str, Any] = {name: np.stack(values) for name, values in results.items()}
    np.savez(folder / "steps.npz", **stacked)


@scenario("quick")
def turning_steps(folder: Path) -> None:
    save_steps(folder, gymnasium.make_vec("AORO/Turning-v0", num_envs=4), 60, 40)


@scenario("quick")
def path_tracking_steps(folder: Path) -> None:
    x = np.linspace(-12.0, 12.0, 49)
    path = DrivenPath(np.column_stack([x, 2.0 * np.sin(0.3 * x)]))
    env = gymnasium.make_vec("AORO/PathTracking-v0", num_envs=4, terrain=hilly(), path=path)
    save_steps(folder, env, 40, 25)


@scenario("quick")
def turning_step_alone(folder: Path) -> None:
    """One environment, not a vector of them, through a time limit."""
    env = gymnasium.make("AORO/Turning-v0", max_episode_steps=30)
    save_steps(folder, env, 30, 20)


@scenario("full")
def path_tracking_in_forests(folder: Path) -> None:
    """The forests and paths that come by default."""
    save_steps(folder, gymnasium.make_vec("AORO/PathTracking-v0", num_envs=8), 150, 100)


# ---- commands


def command(folder: Path, *arguments: str, output: str | None = None) -> None:
    """Run ``aoro-gym`` in ``folder``, so that what it writes names no other; keep what it prints as ``output``.

    It runs in this process: one of its own would import everything again.
    """
    shown, said, before = io.StringIO(), io.StringIO(), (Path.cwd(), sys.argv, dict(os.environ))
    os.environ.update(AORO_GYM_CACHE="off", COLUMNS="120")
    os.chdir(folder)
    sys.argv = ["aoro-gym", *arguments]
    code: Any = 0
    try:
        with redirect_stdout(shown), redirect_stderr(said):
            runpy.run_module("aoro_gym", run_name="__main__")
    except SystemExit as end:
        code = end.code
    finally:
        place, sys.argv, environment = before
        os.chdir(place)
        os.environ.clear()
        os.environ.update(environment)
    if code:
        last = (said.getvalue().strip() or shown.getvalue().strip()).splitlines()[-1:]
        raise RuntimeError(f"aoro-gym {arguments[0]}: {last}")
    if output is not None:
        (folder / output).write_text(shown.getvalue())


@scenario("quick")
def parameters(folder: Path) -> None:
    command(folder, "parameters", "--json", "--scale", "oil.bulk_modulus=0.9", output="parameters.json")
    command(folder, "parameters", "--effects", "--json", output="effects.json")


@scenario("quick")
def simulate(folder: Path) -> None:
    turn = ("--manoeuvre", "left", "--signal", "75", "--duration", "3.4", "--seed", "3")
    command(folder, "simulate", *turn, "--scale", "steering.valve.spool_time_constant=1.5", "--out", "turn.csv", "-q")


@scenario("quick")
def load_terrain(folder: Path) -> None:
    x, y = np.meshgrid(np.arange(40), np.arange(30))
    heights = 100.0 + 0.4 * np.sin(0.3 * x) + 0.02 * y
    heights[10:12, 8:11] = -9999.0
    heights[20, 30] += 9.0
    head = "ncols 40\nnrows 30\nxllcorner 500000\nyllcorner 5400000\ncellsize 0.5\nNODATA_value -9999\n"
    rows = "\n".join(" ".join(f"{height:.3f}" for height in row) for row in heights)
    (folder / "ground.asc").write_text(f"{head}{rows}\n")
    command(folder, "terrain", "ground.asc", "--crs", "EPSG:32633", "--out", "ground.ply", "-q")


@scenario("quick")
def evaluate_turning(folder: Path) -> None:
    policies = ("--policy", "turning-ppo", "--policy", "proportional-derivative")
    what = ("--env", "AORO/Turning-v0", *policies, "--episodes", "3", "--seed", "5")
    command(folder, "evaluate", *what, "--no-films", "--out", "evaluation", "-q")


@scenario("full")
def evaluate_path_tracking(folder: Path) -> None:
    policies = ("--policy", "paths-dagger", "--policy", "stanley")
    what = ("--env", "AORO/PathTracking-v0", *policies, "--episodes", "3", "--seed", "5")
    command(folder, "evaluate", *what, "--no-films", "--out", "evaluation", "-q")


@scenario("full")
def validate(folder: Path) -> None:
    command(folder, "validate", "--out", "validation", "-q")


@scenario("full")
def train(folder: Path) -> None:
    size = ("--steps", "1024", "--n-envs", "4", "--param", "n_steps=64", "--param", "batch_size=64")
    command(folder, "train", "--algo", "ppo", *size, "--eval-episodes", "2", "--seed", "3", "--out", "training", "-q")


@scenario("full")
def diagnose(folder: Path) -> None:
    """A worn compensator, on two short logs."""
    changed = ("--scale", "steering.valve.compensator_open_drop=1.6")
    for side, seed in (("left", "1"), ("right", "2")):
        what = ("--manoeuvre", side, "--signal", "100", "--seed", seed, "--out", f"{side}.csv", "-q")
        command(folder, "simulate", *what, *changed)
    command(folder, "diagnose", "left.csv", "right.csv", "--holdout", "right", "--out", "diagnosis", "-q")


@scenario("full")
def calibrate(folder: Path) -> None:
    changed = ("--scale", "steering.valve.nominal_flow_left=1.05", "--duration", "1.7", "--seed", "4")
    command(folder, "simulate", "--manoeuvre", "left", *changed, "--out", "log.csv", "-q")
    budget = ("--population", "8", "--starts", "1", "--machine", "aoro", "--laws", "default", "--force")
    command(folder, "calibrate", "--logs", "log.csv", *budget, "--out", "machine.toml", "-q")


@scenario("full")
def seal(folder: Path) -> None:
    command(folder, "blind", "seal", "cases", "--suite", "quick", "--seed", "1", "--answers", "answers.json", "-q")


# ---- running


def run(folder: Path, group: str, only: str | None = None) -> None:
    """Run the scenarios of ``group`` (full: all of them), or one by name."""
    if only is not None and only not in SCENARIOS:
        raise ValueError(f"no scenario is called {only!r}; there are {', '.join(SCENARIOS)}")
    for name, (of, function) in SCENARIOS.items():
        if name == only or (only is None and group in (of, "full")):
            place = folder / name
            place.mkdir(parents=True)
            try:
                function(place)
            except Exception as error:
                last = (str(error).strip() or type(error).__name__).splitlines()[-1]
                (place / ERROR).write_text(f"{type(error).__name__}: {last}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--group", choices=("quick", "full"), default="quick")
    parser.add_argument("--only", metavar="NAME")
    run(**vars(parser.parse_args()))


if __name__ == "__main__":
    main()
