"""Which families of plants have taught a network, by what is told of its training."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from aoro_gym.diagnosis_benchmark.component_families.parts import MIXED, mixed_of
from aoro_gym.diagnosis_benchmark.independent import FAMILIES as INDEPENDENT
from aoro_gym.execution.files import read_json

FIRST: tuple[str, ...] = (*INDEPENDENT, "level_0", "level_1", "level_2", "level_3")
"""Families that taught networks of which only is told what they left out."""
TOLD = "training.json"
"""File beside networks that tells of their training."""


def families_in(names: Iterable[str]) -> set[str]:
    """Families that wrote the laws of plants: of a mixture, all that its parts may be of."""
    return {family for name in names for family in (mixed_of(name) if name.startswith(MIXED) else [name])}


def teachers(network: Mapping[str, Any]) -> set[str]:
    """Families that have taught a network of ``training.json``."""
    return families_in(network["taught"]) if "taught" in network else set(FIRST) - set(network["left_out"])


def told_of(folder: Path) -> list[dict[str, Any]]:
    """What ``training.json`` tells of the networks in a folder; nothing where no plants have taught them."""
    path = folder / TOLD
    return read_json(path).get("networks", []) if path.exists() else []


def unbiased(folder: Path, family: str) -> list[Path]:
    """Files of the networks in a folder that learnt nothing from a family.

    Raises:
        ValueError: All of them did.
    """
    found = [folder / one["file"] for one in told_of(folder) if family not in teachers(one)]
    if not found:
        raise ValueError(f"{folder}: {family} has taught all networks; name networks that left it out")
    return found
