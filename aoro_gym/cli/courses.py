"""Courses that commands drive on, loaded and generated under progress bars."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from rich.markup import escape

from aoro_gym.cli.place import load_soil
from aoro_gym.reporting import terminal

if TYPE_CHECKING:
    from aoro_gym.agents.training.plan import TrainingPlan
    from aoro_gym.envs import Course
    from aoro_gym.envs.path_tracking.course_files import CourseFiles


def load_courses(files: CourseFiles) -> list[Course] | None:
    """The course of the files; None without files, which leaves courses to the environment."""
    if files.terrain is None and files.path is None:
        return None
    ground = None
    if files.terrain is not None:
        doing = f"loading {files.terrain.name}"
        with terminal.progress(doing) as tell:
            ground, warnings = files.load_terrain(progress=partial(tell, doing))
        for warning in warnings:
            terminal.warn(warning)
    course, summary, warnings = files.course(ground)
    if summary and not terminal.is_quiet():
        terminal.err().print(escape(summary), highlight=False, soft_wrap=True)
    for warning in warnings:
        terminal.warn(warning)
    return [course]


def training_courses(plan: TrainingPlan) -> tuple[Sequence[Course] | None, Sequence[Course] | None]:
    """Courses to learn on and to evaluate on; None where the environment has none."""
    from aoro_gym.agents.training.courses import (
        LOADING,
        course_files,
        held_out_courses,
        made_courses,
        training_forests,
    )
    from aoro_gym.envs.path_tracking.course_files import ON_COURSES, TRACKING

    load_soil(plan.soil, None, plan.device)  # there is one of this name
    courses = load_courses(course_files(plan))
    if plan.env == LOADING:
        return made_courses(plan.env, plan.forests)
    if plan.env not in ON_COURSES:
        return None, None
    if courses is not None:
        return courses, held_out_courses(plan, courses)
    doing = "growing forests"
    if plan.env != TRACKING:
        with terminal.progress(doing) as tell:
            return made_courses(plan.env, plan.forests, partial(tell, doing))
    with terminal.progress(doing) as tell:
        return training_forests(plan.forests, partial(tell, doing))
