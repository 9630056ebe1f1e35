"""What the results of policies follow from, as :mod:`aoro_gym.execution.digest` tells it apart.

A machine is its values in SI and its laws, a course its ground and its paths, a policy what it does: what they are called,
and in which file they stand, does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.machine import Machine
from aoro_gym.terrains.soil import Soil

MICROMETRE_DECIMALS = 6
"""To which metres are rounded."""


def machine_values(machine: Machine) -> dict[str, Any]:
    """Every parameter in SI, by dotted key, and laws, where they are not the default ones."""
    return machine.identity["value"] | ({} if machine.laws.default else {"laws": machine.laws.names})


def machine_ranges(machine: Machine) -> dict[str, Any]:
    """Range in SI and role of every parameter, by dotted key: what other machines are drawn by."""
    return {name: machine.identity[name] for name in ("range", "role")}


def grounds(courses: Sequence[Course] | None) -> list[Any]:
    """Of each course the ground: its arrays, its coordinate system and where its origin lies in it; of a world the objects,
    too."""
    return [] if courses is None else [_ground(course) for course in courses]


def paths(courses: Sequence[Course] | None) -> list[Any]:
    """Of each course its paths."""
    return [] if courses is None else [[_unnamed(path) for path in getattr(course, "paths", ())] for course in courses]


def soft(soil: Soil | None) -> dict[str, Any]:
    """The soil, if the ground is soft."""
    return {} if soil is None else {"soil": soil.to_json()}


def policy_content(policy: Any) -> Any:
    """What a policy, or what makes one, does; of a learned one without how it came about."""
    made_of = getattr(policy, "__self__", policy)
    if not isinstance(made_of, LearnedPolicy):
        return policy
    content = {one.name: getattr(made_of, one.name) for one in fields(made_of) if one.init and one.name != "training"}
    parts = {name: content.pop(name) for name in ("normalisation", "memory")}  # by their values, not by their class
    normalisation, memory = ({name: None if one is None else vars(one)} for name, one in parts.items())
    return [content | normalisation | ({} if made_of.memory is None else memory)]


def _ground(course: Any) -> dict[str, Any]:
    """What machines stand on, and what rays meet on it; of what is no drive, whatever it is."""
    if not isinstance(course, Course):
        return _unnamed(course)
    bare = _unnamed(course.terrain)
    return bare if course.world is None else _unnamed(course.world) | {"terrain": bare}


def _unnamed(part: Any) -> dict[str, Any]:
    """A terrain or a path by its kind and its fields, but for its name."""
    found = {one.name: _to_micrometres(getattr(part, one.name)) for one in fields(part) if one.name != "name"}
    return {"kind": type(part).__name__} | found


def _to_micrometres(value: Any) -> Any:
    """An array [m] by its micrometres, anything else as it is: of a ground that is made from a seed, what lies below is the
    rounding of the computer that made it."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.round(value, MICROMETRE_DECIMALS) + 0.0  # no -0.0
    return value
