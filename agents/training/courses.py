"""Courses of a training: those to learn on, and those that are held out for its evaluations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.envs.core.ray_sensing import looks_back
from aoro_gym.envs.core.vector import TwinVectorEnv
from aoro_gym.envs.forest_run import courses as forest_run
from aoro_gym.envs.levelling import courses as levelling
from aoro_gym.envs.limit_tracking import courses as limit_tracking
from aoro_gym.envs.loading import logs as loading
from aoro_gym.envs.path_tracking.course_files import FOREST_RUN, LEVELLING, LIMITS, CourseFiles
from aoro_gym.envs.path_tracking.courses import Course, forest_course, generated_paths
from aoro_gym.execution.cache import cache_folder
from aoro_gym.execution.workers import spread
from aoro_gym.terrains.paths.planning import NoDrivablePath
from aoro_gym.twin.recorded import cores

LOADING = "AORO/Loading-v0"
HELD_OUT_FORESTS = (101, 102, 103)
"""Seeds of the forests that evaluations drive in; those that are learned in have lower ones."""
HELD_OUT_PATHS = 100
"""First seed of the paths that evaluations drive on a ground that is given."""


def training_forests(
    count: int, progress: Callable[[float], Any] = lambda share: None
) -> tuple[list[Course], list[Course]]:
    """Generated forests to learn in, and others to evaluate in.

    Args:
        count: Forests to learn in; those too dense to drive in are passed over.
        progress: Called with the share that is done.

    Raises ValueError if there are fewer.
    """
    learned: list[Course] = []
    total = count + len(HELD_OUT_FORESTS)
    for seed in range(1, min(HELD_OUT_FORESTS)):
        progress(len(learned) / total)
        with suppress(NoDrivablePath):
            learned.append(forest_course(seed))
        if len(learned) == count:
            break
    else:
        raise ValueError(f"forests is {count}, but there are {len(learned)} to learn on; ask for fewer")
    held_out = []
    for seed in HELD_OUT_FORESTS:
        progress((count + len(held_out)) / total)
        held_out.append(forest_course(seed))
    return learned, held_out


GROWN_HERE = 16
"""Worlds that one process grows sooner than others would have begun."""


def made_courses(
    env: str, count: int, progress: Callable[[float], Any] = lambda share: None
) -> tuple[Sequence[Any], Sequence[Any]]:
    """``count`` courses of an environment that has its own, from easy to difficult, and others to evaluate on meanwhile:
    neither is one that ``aoro-gym evaluate`` drives on. ``progress`` is called with the share that is made."""
    if env == LOADING:
        return loading.learned_sites(min(count, loading.SPLITS.validation_seed)), loading.validation_sites()
    if env == FOREST_RUN and cache_folder() is not None:
        _grow(count, progress)
    made = {LEVELLING: levelling, LIMITS: limit_tracking, FOREST_RUN: forest_run}[env]
    return made.learned_courses(count), made.validation_courses()


def meet_worlds(
    courses: Sequence[Any] | None, envs: TwinVectorEnv, progress: Callable[[float], Any] = lambda share: None
) -> None:
    """Make what the rays of an environment meet in all worlds, where it casts some, as first episodes there do otherwise.
    ``progress`` is called with the share that is made."""
    if looks_back(envs.task.observation_terms) is None:
        return
    from aoro_gym.envs.core.ray_scenes import scene_of  # most environments cast none

    worlds = [one for one in courses or () if isinstance(one, Course) and one.world is not None]
    with envs.arrays.ordered():
        for number, course in enumerate(worlds):
            progress(number / len(worlds))
            scene_of(course.surroundings, str(envs.arrays.device))


def _grow(count: int, progress: Callable[[float], Any]) -> None:
    """Grow the worlds that the disk lacks, each a second or two and many on all cores, to be taken from there afterwards."""
    asked = [*forest_run.SPLITS.asked(count), *forest_run.SPLITS.asked_to_validate()]
    lacking = [one for one in asked if not forest_run.is_kept(*one)]
    if len(lacking) > GROWN_HERE:
        jobs = {str(seed): (seed, difficulty) for seed, difficulty in lacking}
        # one that failed fails again afterwards, with its own error
        grown: Iterator[Any] = spread(_keep, jobs, workers=min(cores(), len(jobs)))
    else:
        grown = (forest_run.forest_run_course(*one) for one in lacking)
    for done, _ in enumerate(grown):
        progress((done + 1) / len(lacking))


def _keep(tell: Callable[[int], Any], seed: int, difficulty: float) -> None:
    forest_run.forest_run_course(seed, difficulty)


def course_files(plan: TrainingPlan) -> CourseFiles:
    """The files that a plan names; raises as :class:`CourseFiles`."""
    terrain, path = (None if name is None else Path(name) for name in (plan.terrain, plan.path))
    return CourseFiles(plan.env, terrain, path, plan.path_length, plan.track, plan.join_gaps, plan.path_crs)


def held_out_courses(plan: TrainingPlan, courses: Sequence[Course]) -> Sequence[Course]:
    """Courses to evaluate on: other paths over the first ground of ``courses``, or ``courses`` if the path is given."""
    if plan.path is not None:
        return courses
    ground = courses[0].ground
    others = generated_paths(ground, length=plan.path_length, first=HELD_OUT_PATHS)
    return [Course.over(ground, others, courses[0].name)]
