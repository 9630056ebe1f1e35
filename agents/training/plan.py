"""What a training is asked to do: one dataclass that is command line, log and configuration at once.

Nothing heavy is imported here: the command line shows its fields.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from aoro_gym.checks import check_choice, check_integer
from aoro_gym.execution.device_names import on_cpu

HYPERPARAMS = Path(__file__).parents[1] / "hyperparams"
"""Hyper-parameters by algorithm, in the RL Zoo's format, and curricula."""
ALGORITHMS = ("ppo", "sac", "dagger")
TRAINERS = {"sb3": ALGORITHMS, "resident": ("ppo",)}
"""Algorithms by what runs them: Stable-Baselines3 (the package itself for dagger), or skrl with all arrays on the device."""


PATH_HELP = "Path on it (.gpx .kml .kmz .geojson .csv). Default: generated, drivable ones."
TRACK_HELP = "Which line of the --path's file, where it holds several: its name or number, N.N a part of it."
PATH_CRS_HELP = "Coordinate reference system of the --path's coordinates, such as EPSG:32633."
LOCALISATION_HELP = "How PathTracking-v0 and -v1 estimate the pose: by constant gains (default), or a Kalman filter."
JOIN_GAPS_HELP = "Bridge gaps of the --path's recording by straight lines."


def option(default: Any, metavar: str | None, text: str) -> Any:
    """A field that the command line offers."""
    return field(default=default, metadata={"metavar": metavar, "help": text})


@dataclass(frozen=True)
class TrainingPlan:
    """Raises ValueError naming the field, its value and its bound."""

    env: str = option(
        "AORO/Turning-v0", "ID", "AORO/Turning-v0, or PathTracking-v0, -v1, Levelling-v0, ForestRun-v0, Loading-v0."
    )
    algo: str = option("ppo", "|".join(ALGORITHMS), "Algorithm; dagger imitates a controller that knows the truth.")
    trainer: str = option(
        "sb3", "|".join(TRAINERS), "Stable-Baselines3, or skrl's PPO with all arrays on the device, for GPUs."
    )
    terrain: str | None = option(
        None, "FILE|FOLDER", "Ground: a mesh, raster or cloud, or a world. Default: generated forests."
    )
    path: str | None = option(None, "FILE", PATH_HELP)
    track: str | None = option(None, "NAME|N", TRACK_HELP)
    join_gaps: bool = option(False, None, JOIN_GAPS_HELP)
    path_crs: str | None = option(None, "CRS", PATH_CRS_HELP)
    path_length: float = option(60.0, "M", "Of the paths that are generated on --terrain.")
    observe: list[str] | None = option(
        None,
        "TERM",
        "Observe what is not observed by default, too: obstacle_map of ForestRun-v0, or lidar. Repeatable.",
    )
    soil: str | None = option(
        None, "NAME[:WATER]", "Soft ground everywhere, such as peat, see 'aoro-gym evaluate'. Default: hard."
    )
    forests: int = option(12, "N", "Generated grounds to learn on, where there is no --terrain.")
    machine: str = option("aoro", "NAME|FILE", "Bundled machine, or a machine file (.toml).")
    set: list[str] | None = option(None, "KEY=VALUE", "Set a parameter, in the unit of the machine file. Repeatable.")
    scale: list[str] | None = option(None, "KEY=FACTOR", "Multiply a parameter. Repeatable.")
    laws: str | None = option(
        None,
        "NAME",
        "Family of laws, see 'aoro-gym laws'; A,B, families or any: drawn for each sub-environment. Default: the file's.",
    )
    localisation: str | None = option(None, "gains|filter", LOCALISATION_HELP)
    perturbation: str | None = option(
        None,
        "NAME",
        "Learn on machines drawn as the leaderboard draws them: perturbed, or 'with an effect'. Default: the machine alone.",
    )
    device: str = option(
        "cpu",
        "DEVICE",
        "Where twins run and networks learn: cpu, cpu:simd (several twins at once on a core) or cuda:N.",
    )
    seed: int = option(0, "N", "Seed of all that is random.")
    steps: int | None = option(None, "N", "Environment steps. Default: the hyper-parameters' n_timesteps.")
    n_envs: int | None = option(None, "N", "Sub-environments. Default: the hyper-parameters'.")
    hyperparams: str | None = option(None, "FILE.yml", "Hyper-parameters, in the RL Zoo's format. Default: ours.")
    param: list[str] | None = option(None, "NAME=VALUE", "Another value of a hyper-parameter. Repeatable.")
    start: str | None = option(
        None,
        "NAME|FILE",
        "Policy to learn on from, with a network as the hyper-parameters say: a file, or a shipped one.",
    )
    curriculum: str | None = option(None, "FILE.yml", "What differs from episode to episode, and when. Default: ours.")
    checkpoint_every: int = option(
        4000,
        "N",
        "Control steps of each sub-environment between checkpoints, with an evaluation; several episodes long.",
    )
    eval_episodes: int = option(32, "N", "Episodes of an evaluation, on seeds and terrains that are held out.")

    def __post_init__(self) -> None:
        check_choice("algo", self.algo, ALGORITHMS)
        check_choice("trainer", self.trainer, TRAINERS)
        if self.algo not in TRAINERS[self.trainer]:
            raise ValueError(
                f"algo is {self.algo!r}, but the trainer {self.trainer!r} has {', '.join(TRAINERS[self.trainer])} only; "
                "give that, or another --trainer"
            )
        if self.observe is not None:
            from aoro_gym.envs.core.offered_terms import FURTHER, OFFERED

            for name in self.observe:
                check_choice("observe", name, FURTHER if self.env == "AORO/ForestRun-v0" else OFFERED)
        for name, least in (
            ("seed", 0), ("steps", 1), ("n_envs", 1), ("forests", 1), ("checkpoint_every", 1), ("eval_episodes", 1),
        ):  # fmt: skip
            if getattr(self, name) is not None:
                check_integer(name, getattr(self, name), ge=least)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> TrainingPlan:
        """The plan of such a dictionary as :meth:`to_json` gives."""
        return cls(**values)

    def to_json(self) -> dict[str, Any]:
        """Every field by name."""
        return asdict(self)

    def folder(self, end: str = "") -> Path:
        """Default folder of the training, such as ``runs/Turning-v0_ppo`` and ``end``."""
        return Path("runs") / f"{self.env.split('/')[-1]}_{self.algo}{end}"

    def by_seed(self, folder: Path, count: int) -> dict[Path, TrainingPlan]:
        """So many plans that differ by their seed, by their folders in ``folder``."""
        return {folder / f"seed_{seed}": replace(self, seed=seed) for seed in range(self.seed, self.seed + count)}

    @property
    def command(self) -> str:
        """The command line that asks for this plan."""
        words = ["aoro-gym", "train"]
        for one in fields(self):
            value = getattr(self, one.name)
            if value != one.default:
                name = f"--{one.name.replace('_', '-')}"
                for each in value if isinstance(value, list) else [value]:
                    words += [name] if each is True else [name, str(each)]
        return shlex.join(words)

    @property
    def hyperparams_file(self) -> Path:
        """The YAML file of the hyper-parameters: the given one, or that of the algorithm on this kind of device."""
        if self.hyperparams is not None:
            return Path(self.hyperparams)
        cuda = HYPERPARAMS / f"{self.algo}_cuda.yml"
        return cuda if not on_cpu(self.device) and cuda.exists() else HYPERPARAMS / f"{self.algo}.yml"

    @property
    def curriculum_file(self) -> Path:
        """The YAML file of the curriculum."""
        return HYPERPARAMS / "curricula.yml" if self.curriculum is None else Path(self.curriculum)
