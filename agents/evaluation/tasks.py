"""How the episodes of each environment are driven and judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from aoro_gym.agents.evaluation.drives import STATION
from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.forest_run import make_forest_run, run_forests
from aoro_gym.agents.evaluation.levelling import level_lanes, make_levelling
from aoro_gym.agents.evaluation.loading import EVERY, load_logs, make_loading
from aoro_gym.agents.evaluation.path_tracking import drive_limits, drive_paths, make_limit_tracking, make_tracking
from aoro_gym.agents.evaluation.perturbations import Perturbation, fitting
from aoro_gym.agents.evaluation.turning import make_turning, turn_joints
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.forest_run.task import ForestRun
from aoro_gym.envs.levelling.task import Levelling
from aoro_gym.envs.loading.task import Loading
from aoro_gym.envs.path_tracking.task import PathTracking
from aoro_gym.envs.turning.task import Turning
from aoro_gym.machine import Machine
from aoro_gym.machine.vehicle_crane import VehicleCrane


@dataclass(frozen=True)
class EvaluationTask:
    """How an environment's episodes are driven and judged."""

    make: Callable[..., Any]
    """Its vector environment."""
    drive: Callable[[Any, Policy, list[int], Callable[[float], Any]], Episodes]
    """Drives one episode each of all sub-environments, and is told whom to tell the share that is done."""
    interval: float
    """Between the columns of ``Episodes.errors``."""
    along: str
    """What they lie along, with its unit."""
    error: str
    """What they are, with its unit."""
    decisive: tuple[str, ...]
    """Metrics that policies are compared by, after their success; less is better, but for the speed."""
    channels: tuple[str, ...]
    """Of ``Episodes.film``."""
    fits: Callable[[Machine], None] | None = None
    """Raises ValueError for a machine that it cannot be driven with, where machines are drawn; None: any will do."""

    def drawing(self, perturb: Perturbation) -> Perturbation:
        """As ``perturb``, of machines that fit."""
        return perturb if self.fits is None else partial(fitting, perturb=perturb, fits=self.fits)


TASKS: Mapping[str, EvaluationTask] = {
    "AORO/Turning-v0": EvaluationTask(
        make_turning,
        turn_joints,
        0.02,
        "time since the target was set [s]",
        "distance from the target [°]",
        ("settling_time_s", "flow_overshoot_share", "overshoot_deg"),
        Turning.render_channels,
    ),
    "AORO/PathTracking-v0": EvaluationTask(
        make_tracking,
        drive_paths,
        STATION,
        "distance driven along the path [m]",
        "cross-track error [m]",
        ("cross_track_rms_m", "speed_m_per_s"),
        PathTracking.render_channels,
    ),
    "AORO/PathTracking-v1": EvaluationTask(
        make_limit_tracking,
        drive_limits,
        STATION,
        "distance driven along the path [m]",
        "cross-track error [m]",
        ("speed_m_per_s", "cross_track_rms_m"),
        PathTracking.render_channels,
    ),
    "AORO/Levelling-v0": EvaluationTask(
        make_levelling,
        level_lanes,
        STATION,
        "distance driven along the path [m]",
        "tilt [°]",
        ("tilt_rms_deg", "unevenness_rms", "pump_kJ_per_m"),
        Levelling.render_channels,
    ),
    "AORO/ForestRun-v0": EvaluationTask(
        make_forest_run,
        run_forests,
        STATION,
        "way driven [m]",
        "distance to the goal [m]",
        ("damage_kNs", "duration_s", "energy_kJ"),
        ForestRun.render_channels,
    ),
    "AORO/Loading-v0": EvaluationTask(
        make_loading,
        load_logs,
        EVERY,
        "time [s]",
        "way that is left [m]",
        ("sway_rms_deg", "energy_kJ", "duration_s"),
        Loading.render_channels,
        VehicleCrane().check_fits,
    ),
}
"""What can be evaluated, by the environment's id."""
