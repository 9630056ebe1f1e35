"""Families that judge stay unknown to whatever trains: no module that takes plants names them or takes all families."""

import re
from pathlib import Path

from aoro_gym.diagnosis_benchmark import component_families
from aoro_gym.diagnosis_benchmark.judge.plants import OPEN, ComponentPlants, judged_plants

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("aoro_gym", "agents", "envs", "examples", "studies", "terrains")
JUDGES = ("studies/seal.py", "studies/seal_score.py", "aoro_gym/diagnosis_benchmark/judge/plants.py")
"""Modules that judge, or hand out what is judged."""
PLANTS = re.compile(r"component_families|judge\.plants|judge import plants|diagnosis_benchmark import")
"""What a module says that can take a plant of any family."""
NAMES = "|".join(component_families.SEALED)
TAKES = re.compile(rf"\b(?:{NAMES}|SEALED|ALL_FAMILIES|JUDGED|SealedPlants)\b|[\"']sealed[\"']")


def takers() -> list[str]:
    """Modules that can take plants and are none of the judges."""
    files = [
        (file.relative_to(ROOT).as_posix(), file)
        for folder in FOLDERS
        for file in sorted((ROOT / folder).rglob("*.py"))
    ]
    own = "aoro_gym/diagnosis_benchmark/component_families/"
    return [
        name
        for name, file in files
        if name not in JUDGES and not name.startswith(own) and PLANTS.search(file.read_text(encoding="utf-8"))
    ]


def test_nothing_that_takes_plants_names_those_that_judge() -> None:
    found = takers()
    assert {"studies/judge.py", "studies/cross_fitting/__main__.py", "studies/development/cases.py"} <= set(found)
    told = {name: TAKES.findall((ROOT / name).read_text(encoding="utf-8")) for name in found}
    assert not {name: words for name, words in told.items() if words}


def test_open_groups_and_all_that_teaches_have_none_of_them() -> None:
    sealed = set(component_families.SEALED)
    assert not sealed & set(component_families.FAMILIES)
    assert not sealed & set(ComponentPlants.JUDGING)
    assert not sealed & {one.name for group in OPEN for one in judged_plants(group)}
