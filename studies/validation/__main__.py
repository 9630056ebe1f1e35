"""Measures all that docs/validation.md shows, draws its pictures and writes its tables anew.

    python -m studies.validation [--parts turns theory driving] [--device cpu:simd]

Figures are kept in ``studies/validation/results.json``; a part that is not asked for keeps those that it has, and
``--parts`` without any only writes the page. On a free core turns and theory take some minutes each, driving one.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image

from aoro_gym.execution.files import read_json, write_json, write_text
from aoro_gym.machine import Machine
from aoro_gym.reporting import terminal
from aoro_gym.validation.report import write_turns
from studies.validation.driving import MANOEUVRES, rounded, write_courses
from studies.validation.members import against_theory, digests, machines, measured
from studies.validation.page import PAGE, PICTURES, RESULTS, page
from studies.validation.tires import compared

PARTS = ("turns", "theory", "driving")


def smaller(path: Path) -> None:
    """Writes a drawing anew with 128 colours."""
    with Image.open(path) as picture:
        picture.convert("RGB").quantize(128).save(path, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--parts", nargs="*", default=list(PARTS), choices=PARTS, help="what is measured; all by default"
    )
    parser.add_argument("--device", default="cpu", help="cpu, cpu:simd or cuda:N, for the turns")
    given = parser.parse_args()
    kept = read_json(RESULTS) if RESULTS.exists() else {"members": {}}
    with terminal.progress("validation") as tell:
        if "turns" in given.parts:
            found, (calibrated, physical) = measured(given.device, tell)
            theory = {name: {"theory": one["theory"]} for name, one in kept["members"].items() if "theory" in one}
            kept |= {
                "machines": digests(),
                "members": {name: one | theory.get(name, {}) for name, one in found.items()},
            }
            write_turns(calibrated, "left", PICTURES / "left_turns.png")
            write_turns(physical, "left", PICTURES / "left_turns_physical.png")
            write_json(RESULTS, kept)
            smaller(PICTURES / "left_turns.png")
            smaller(PICTURES / "left_turns_physical.png")
        if "theory" in given.parts:
            tell("theory of all machines", 0.0)
            for name, deviations in against_theory(machines(), given.device).items():
                kept["members"][name]["theory"] = deviations
            write_json(RESULTS, kept)
        if "driving" in given.parts:
            kept["driving"], courses = {}, []
            for at, (name, manoeuvre) in enumerate(MANOEUVRES.items()):
                tell(f"driving: {name}", at / len(MANOEUVRES))
                figures, drawn = manoeuvre(Machine.load())
                kept["driving"][name] = [rounded(one) for one in figures]
                courses += drawn
            kept["tires"] = compared()
            write_courses(courses, PICTURES / "driving.png")
            smaller(PICTURES / "driving.png")
            write_json(RESULTS, kept)
    write_text(PAGE, page(PAGE.read_text(encoding="utf-8"), kept))
    print(f"docs/{PAGE.name}")


if __name__ == "__main__":
    main()
