"""Tables of docs/validation.md as the figures that were kept have them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from aoro_gym.execution.files import read_json
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES
from aoro_gym.reporting.page import describe
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import Row, published_rows
from aoro_gym.validation.study import TARGETS, Miss
from aoro_gym.validation.turns import TURNS, Turn
from studies.identification.structures import STRUCTURES
from studies.identification.table import LEVELS, NAMES, table
from studies.validation.members import MEMBERS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "validation.md"
PICTURES = ROOT / "docs" / "pictures"
RESULTS = Path(__file__).parent / "results.json"
IDENTIFICATION = ROOT / "studies" / "identification" / "results"

Results = Mapping[str, Any]


@cache
def known() -> dict[tuple[str, Turn], Row]:
    """Published rows by source and turn."""
    rows = published_rows()
    return {(str(row["source"]), Turn(str(row["direction"]), float(str(row["signal_percent"])))): row for row in rows}


def turned(member: Mapping[str, Any]) -> dict[Turn, Row]:
    """A member's rows by turn."""
    return {Turn(row["direction"], row["signal_percent"]): row for row in member["rows"]}


def miss_of(figure: str, turn: Turn, value: Any, wanted: float) -> Miss:
    """How far a figure is from what is wanted."""
    kind, bound = TARGETS[figure]
    error = None if value is None else value - wanted if kind == "difference" else value / wanted - 1.0
    return Miss(figure, turn.signal_percent, turn.direction, error, kind, bound)


def shown(miss: Miss) -> str:
    """An error, bold beyond its bound."""
    if miss.error is None:
        return "-"
    text = f"{100.0 * miss.error:+.1f} %" if miss.kind == "relative" else f"{miss.error:+.2f} s"
    return text if miss.in_bounds <= 1.0 else f"**{text}**"


def of_the_machine(results: Results) -> str:
    """Every figure of the machine, and how far its published twin and all members are from it."""
    found = {"published twin": {turn: row for (source, turn), row in known().items() if source == "mevea"}}
    found |= {f"`{name}`": turned(member) for name, member in results["members"].items()}
    near: dict[str, list[bool]] = {name: [] for name in found}
    rows = []
    for turn in TURNS:
        for figure in FIGURES:
            wanted = known()["physical", turn][figure]
            if not isinstance(wanted, float):
                continue
            name, unit, _ = describe(figure)
            cells = []
            for source, own in found.items():
                if turn not in own:
                    cells.append("")
                    continue
                miss = miss_of(figure, turn, own[turn][figure], wanted)
                near[source].append(miss.in_bounds <= 1.0)
                cells.append(shown(miss))
            rows.append([f"{turn.direction} {turn.signal_percent:g} %, {name}", f"{wanted:g} {unit}", *cells])
    rows.append(["within the bounds", "", *(f"{sum(marks)} of {len(marks)}" for marks in near.values())])
    return table(["turn, figure", "machine", *found], rows)


def members(results: Results) -> str:
    """What all members meet, what their structures predict, their bounds, and how far theory is from them."""
    rows = []
    for name, one in results["members"].items():
        member, met = MEMBERS[name], one["met"]
        rows.append([
            f"`{name}`", laws_of(member.structure), NAMES[member.reference],
            *(f"{met[key][0]} of {met[key][1]}" for key in ("physical", "mevea", "shape")),
            f"{one['worst']:.2f}, {one['misfit']['filtered']:.2f}",
            *(left_out(member.structure, reference) for reference in ("physical", "mevea")),
            str(len(one["at_bounds"])), from_theory(one["theory"]),
        ])  # fmt: skip
    head = [
        "machine",
        "laws",
        "fitted to the",
        "machine's figures",
        "published twin's",
        "shape",
        "worst and rms miss",
    ]
    return table(
        [*head, "machine's level left out", "twin's level left out", "at a bound", "farthest from theory"], rows
    )


def laws_of(structure: str) -> str:
    """Family of a structure, and the options that differ from it."""
    family, options = STRUCTURES[structure]
    assert family in FAMILIES
    return " ".join(
        [f"`{family}`", *(["with", ", ".join(f"`{option}`" for option in options.values())] if options else [])]
    )


@cache
def fits(structure: str) -> dict[str, Any]:
    """Fits of a structure that leave figures out."""
    return read_json(IDENTIFICATION / f"{structure}.json")["splits"]


def left_out(structure: str, reference: str) -> str:
    """Errors of what a structure's fits without 100, 75 and 50 % predict."""
    splits = fits(structure)
    return ", ".join(f"{100.0 * splits[f'{reference}-{level:g}']['score']:.1f}" for level in LEVELS) + " %"


def from_theory(deviations: Mapping[str, list[float]]) -> str:
    """Largest deviations of the figures that theory speaks of."""
    return ", ".join(f"{100.0 * max(abs(one) for one in three):.1f}" for three in deviations.values()) + " %"


def bounds(results: Results) -> str:
    """Parameters on an end of their range, by machine."""
    rows = [
        [f"`{name}`", ", ".join(f"`{key}` {end}" for key, end in one["at_bounds"].items()) or "none"]
        for name, one in results["members"].items()
    ]
    return table(["machine", "on an end of its range"], rows)


def of_the_twin(results: Results) -> str:
    """Every figure of the published twin, and all members' values."""
    found = {f"`{name}`": turned(member) for name, member in results["members"].items()}
    near: dict[str, list[bool]] = {name: [] for name in found}
    rows = []
    for turn in (turn for turn in TURNS if turn.direction == "left"):
        for figure in FIGURES:
            wanted = known()["mevea", turn][figure]
            assert isinstance(wanted, float)
            name, unit, _ = describe(figure)
            digits, cells = 2 if figure.endswith("_s") else 1, []
            for source, own in found.items():
                value = own[turn][figure]
                near[source].append(miss_of(figure, turn, value, wanted).in_bounds <= 1.0)
                text = "-" if value is None else f"{value:.{digits}f}"
                cells.append(text if near[source][-1] else f"**{text}**")
            what = f"left {turn.signal_percent:g} %, {name}"
            rows.append([what, f"{wanted:.{digits}f} {unit}", *cells])
    rows.append(["within the bounds", "", *(f"{sum(marks)} of {len(marks)}" for marks in near.values())])
    return table(["turn, figure", "published twin", *found], rows)


def shape(results: Results) -> str:
    """What the text says of the published twin's curve, beside all members'."""
    found = {name: one["shape"] for name, one in results["members"].items()}
    rows = []
    for at, figure in enumerate(found["aoro"]):
        digits, unit = (2, " s") if figure["unit"] == "s" else (0, "") if figure["unit"] == "1" else (1, " bar")
        asked = f"± {figure['bound']:g}{unit}" if figure["bound"] else "the same"
        cells = []
        for one in found.values():
            text = "none" if one[at]["value"] is None else f"{one[at]['value']:.{digits}f}"
            cells.append(text if one[at]["reached"] else f"**{text}**")
        rows.append([figure["what"], f"{figure['published']:g}{unit}", asked, *cells])
    return table(["left turn, 100 %", "published twin", "asked for", *(f"`{name}`" for name in found)], rows)


def single(results: Results) -> str:
    """Right turns, driving pressure, rim speed, mass and swings of the steady flow of all members."""
    found = {name: one["checks"] for name, one in results["members"].items()}
    digits = {"s": 3, "bar": 2, "m/s": 3, "kg": 0, "L/min": 1, "%": 2, "1": 4}
    rows = []
    for at, check in enumerate(found["aoro"]):
        unit = check["unit"]
        cells = []
        for one in found.values():
            value, wanted = one[at]["value"], check["published"]
            text = "-" if value is None else f"{value:.{digits[unit]}f}"
            if unit == "L/min" and value is not None:
                text += f" ({100.0 * (value / wanted - 1.0):+.1f} %)"
            cells.append(text if one[at]["reached"] else f"**{text}**")
        wanted = "-" if check["published"] is None else f"{check['published']:g} {unit}"
        rows.append([check["what"], wanted, f"± {check['bound']:.3g}", *cells])
    return table(["figure", "published", "bound", *(f"`{name}`" for name in found)], rows)


def inputs(results: Results) -> str:
    """Published values of uncertain parameters, and what the calibration of the default machine made of them."""
    rows = []
    for one in Machine.load("aoro").parameters():
        if one.published is None or one.deviation is None:
            continue
        deviation = round(100.0 * float(one.deviation), 1) + 0.0
        rows.append([f"`{one.key}`", f"{one.published:.4g}", f"{one.value:.4g}", f"{deviation:+.1f} %", one.unit])
    return table(["parameter", "published", "`aoro`", "deviation", "unit"], rows)


def driving(results: Results) -> str:
    """Figures of driving, braking and lifting beside closed forms and ODEs written apart."""
    rows = []
    for figures in results["driving"].values():
        for one in figures:
            wanted = "" if one["published"] is None else f"{one['published']:g}"
            text = f"{one['twin']:.4g}" if one["met"] else f"**{one['twin']:.4g}**"
            bound = f"± {one['bound']:.2g}"
            rows.append([one["what"], one["unit"], wanted, text, f"{one['expected']:.4g}", bound])
    return table(["figure", "unit", "published", "`aoro`", "theory", "bound"], rows)


def tires(results: Results) -> str:
    """Side force over load of a measured tire and of the twin's laws, by slip angle."""
    found = results["tires"]
    rows = [
        [f"{angle:g}", f"{own:.2f}", f"{lugre:.2f}", f"{way:.1f}", f"{relaxed:.2f}"]
        for angle, own, lugre, way, relaxed in zip(
            found["angle_deg"],
            found["measured"],
            found["lugre"],
            found["lugre_way_m"],
            found["relaxation"],
            strict=True,
        )
    ]
    head = [
        "slip angle, °",
        "measured, 335/65R22.5",
        "`lugre`, steady",
        "way to 63 % of it, m",
        "`relaxation`, steady",
    ]
    return table(head, rows)


def stiffnesses(results: Results) -> str:
    """Vertical stiffness of measured tires and of the twin's."""
    found = results["tires"]["stiffness_kN_per_m"]
    rows = [[tire, pressure, f"{value:.0f}"] for tire, pressure, value in found["measured"]]
    rows.append(["the data sheet's", "2.0 bar", f"{found['twin']:.0f}"])
    rows.append(["`aoro`, fitted to turns", "-", f"{float(Machine.load('aoro').tire.stiffness) / 1e3:.0f}"])
    return table(["tire", "inflation", "kN/m"], rows)


PARTS: Mapping[str, Callable[[Results], str]] = {
    "of_the_machine": of_the_machine,
    "members": members,
    "bounds": bounds,
    "of_the_twin": of_the_twin,
    "shape": shape,
    "single": single,
    "inputs": inputs,
    "driving": driving,
    "tires": tires,
    "stiffnesses": stiffnesses,
}
"""What is made of the figures, by the mark on the page that it stands under."""


def page(text: str, results: Results) -> str:
    """The page with its tables as the figures have them."""
    for name, made in PARTS.items():
        mark, end = f"<!-- {name} -->\n\n", f"\n\n<!-- {name} end -->"
        before, rest = text.split(mark)
        text = before + mark + made(results) + end + rest.split(end)[1]
    return text
