"""Episodes that show what controllers and policies do: a controlled turn, and a drive over a scanned forest."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.controllers.turning import ProportionalDerivative
from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.films import write_film
from aoro_gym.agents.evaluation.plots import write_plans
from aoro_gym.envs import Course, TurningEnv
from aoro_gym.machine import Machine
from aoro_gym.reporting.page import Passage, write_animation
from aoro_gym.terrains import drivable_path, load
from aoro_gym.terrains.generate.forest import forest
from aoro_gym.terrains.generate.scan import scan

TARGETS_DEG, HOLD = (-22.0, 18.0, -8.0), 2.5
"""Joint angles of the turn, one after the other from 15 degrees to the left, and the time [s] for each."""
FOREST_SEED, FOREST_SIZE, SCAN_DENSITY = 7, (60.0, 60.0), 15.0
"""The forest, its sides [m], and the density [points/m²] of its scan."""
TRACKING, PATH_LENGTH, DRIVERS = "AORO/PathTracking-v0", 40.0, ("paths-dagger", "pure-pursuit")
"""The drive: its environment, its path [m], a shipped policy, and a reference controller for comparison."""

Progress = Callable[[str, float], Any]


def controlled_turn(machine: Machine, stem: Path, *, device: str, seed: int, progress: Progress) -> Passage:
    """Film an episode of ``AORO/Turning-v0`` under its reference controller.

    Args:
        machine: Machine that is driven.
        stem: Of the film to write, without its suffix.
        device: Of the twin.
        seed: Of the episode.
        progress: Called with what is done and the share of it.
    """
    env = TurningEnv(machine=machine, device=device, render_mode="rgb_array")
    policy = ProportionalDerivative(env.observation_layout)
    start = {"joint_angle": math.radians(15.0), "targets": np.radians(TARGETS_DEG), "hold": HOLD}
    observation, info = env.reset(seed=seed, options=start)
    steps = round(len(TARGETS_DEG) * HOLD * env.metadata["render_fps"])
    frames = []
    for step in range(steps):
        progress("AORO/Turning-v0", step / steps)
        observation, _, terminated, _, info = env.step(policy(observation[None])[0])
        if step % 5 == 0:
            frames.append(env.render())
        if terminated:
            break
    env.close()
    film = write_animation(stem, frames, frames_per_second=env.metadata["render_fps"] / 5)
    targets = ", ".join(f"{target:g}°" for target in TARGETS_DEG)
    verdict = "settled on every one in time" if info["is_success"] else "did not settle on every one in time"
    text = (
        f"The reference controller of AORO/Turning-v0 (proportional-derivative, from the noisy angle sensor alone) is asked "
        f"for joint angles of {targets}, left positive, and {verdict}."
    )
    return Passage("A controlled turn", text, [film])


def forest_drive(machine: Machine, folder: Path, *, device: str, seed: int, progress: Progress) -> Passage:
    """Drive over the scan of a generated forest, by a learned policy and by a controller.

    Args:
        machine: Machine that is driven.
        folder: Gets the scan, a plan view and a film.
        device: Of the twins.
        seed: Of the episode.
        progress: Called with what is done and the share of it.
    """
    grown = forest(FOREST_SEED, size=FOREST_SIZE)
    file = folder / "scan.ply"
    folder.mkdir(parents=True, exist_ok=True)
    scan(grown, FOREST_SEED, density=SCAN_DENSITY).save_mesh(file)
    terrain, report = load(
        file, name="scanned forest", progress=lambda share: progress("loading the scan", 0.2 * share)
    )
    path = drivable_path(terrain, FOREST_SEED, length=PATH_LENGTH, obstacles=grown.circles("tree"))
    result = evaluate(
        TRACKING,
        {name: policy_factory(TRACKING, name) for name in DRIVERS},
        episodes=1,
        seed=seed,
        courses=[Course(terrain, (path,), name=terrain.name, trees=grown.trees)],
        machine=machine,
        device=device,
        progress=lambda _, share: progress(TRACKING, 0.2 + 0.4 * share),
    )
    run, other = (result.runs[name] for name in DRIVERS)
    film = write_film(
        result, run, folder / "drive", progress=lambda share: progress("drawing the drive", 0.6 + 0.4 * share)
    )
    changes = "; ".join(change.text for change in report.changes)
    text = (
        f"A generated forest is scanned with noise and holes, saved as a mesh and loaded back ({changes}). The learned "
        f"policy {DRIVERS[0]} of {TRACKING} follows a generated path by the machine's own sensors: "
        f"{_driven(run)}; {DRIVERS[1]} on the same path: {_driven(other)}. They ended so: {run.endings[0]}; "
        f"{other.endings[0]}."
    )
    return Passage("A drive over scanned ground", text, [film, *write_plans(result, folder)])


def _driven(run: Episodes) -> str:
    """Metrics of a policy's first episode."""
    metrics = {name: float(values[0]) for name, values in run.metrics.items()}
    text = f"{metrics['driven_m']:.1f} m driven"
    if not metrics["success_rate"]:
        return f"{text}, not to the end"
    error, speed = metrics["cross_track_rms_m"], metrics["speed_m_per_s"]
    return f"{text} at {speed:.2f} m/s, {error:.3f} m off the path (root mean square)"
