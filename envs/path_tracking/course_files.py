"""Courses from files of a ground and a path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aoro_gym.envs.path_tracking.courses import Course, generated_paths
from aoro_gym.terrains import Plane, Terrain, load, load_path
from aoro_gym.terrains.georeference import horizontal
from aoro_gym.terrains.world.files import load_world
from aoro_gym.terrains.world.world import World

TRACKING, LIMITS, LEVELLING = "AORO/PathTracking-v0", "AORO/PathTracking-v1", "AORO/Levelling-v0"
FOREST_RUN = "AORO/ForestRun-v0"
ON_COURSES = (TRACKING, LIMITS, LEVELLING, FOREST_RUN)
"""The environments that drive on courses."""


@dataclass(frozen=True)
class CourseFiles:
    """A ground and a path over it.

    Args:
        env: Id of the environment.
        terrain: File of the ground, or folder of a world; None: level ground.
        path: File of the path; None: generated ones.
        path_length: Of generated paths [m].
        track: Line of the path's file, where it holds several.
        join_gaps: Whether its gaps are bridged.
        path_crs: Coordinate reference system of its coordinates.

    Raises ValueError where these contradict each other or the environment.
    """

    env: str
    terrain: Path | None = None
    path: Path | None = None
    path_length: float = 60.0
    track: str | None = None
    join_gaps: bool = False
    path_crs: str | None = None

    def __post_init__(self) -> None:
        for option, given in (
            ("--track", self.track is not None),
            ("--join-gaps", self.join_gaps),
            ("--path-crs", self.path_crs is not None),
        ):
            if given and self.path is None:
                raise ValueError(f"{option} is for a path; give its file with --path")
        if self.path_crs is not None:
            horizontal(self.path_crs, "--path-crs")
        if (self.terrain or self.path) and self.env not in ON_COURSES:
            given = "--terrain" if self.path is None else "--path"
            raise ValueError(f"{given} is for {', '.join(ON_COURSES)}; {self.env} stands on level ground")

    def load_terrain(self, progress: Callable[[float], Any]) -> tuple[Terrain | World, list[str]]:
        """The ground, and warnings; calls ``progress`` with the share that is done.

        Raises ValueError if the file holds no ground or cannot be driven on, OSError if it cannot be read.
        """
        assert self.terrain is not None
        if self.terrain.is_dir():
            return load_world(self.terrain), []
        ground, report = load(self.terrain, progress=progress)
        return ground, report.warnings

    def course(self, ground: Terrain | World | None) -> tuple[Course, str, list[str]]:
        """The course over ``ground``, or over level ground; a summary of the path's file, and warnings.

        Raises ValueError if the path cannot be driven there, OSError if its file cannot be read.
        """
        terrain, name = (Plane(), "level ground") if ground is None else (ground, ground.name)
        if self.path is None:
            return Course.over(terrain, generated_paths(terrain, length=self.path_length), name), "", []
        bare = ground.terrain if isinstance(ground, World) else ground
        path, about = load_path(self.path, bare, track=self.track, join_gaps=self.join_gaps, crs=self.path_crs)
        warnings = list(about.warnings)
        if path.speed is not None:
            warnings.append(
                f"{self.path} gives speeds, which {self.env} does not follow: it drives at its working speed"
            )
        return Course.over(terrain, (path,), name), about.summary, warnings

    def to_json(self) -> dict[str, Any]:
        """The files and how the path is read, as results record them."""
        terrain, path = (None if file is None else str(file) for file in (self.terrain, self.path))
        how = {"track": self.track, "join_gaps": self.join_gaps, "path_crs": self.path_crs}
        return {"terrain": terrain, "path": path, **how}
