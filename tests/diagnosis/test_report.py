"""What a diagnosis says to people: its page and its printed summary, for every verdict."""

import io
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis.report import KINDS, MOST_CURVES, summary, telling, write_report
from aoro_gym.diagnosis.result import PHASES, VERDICTS, Cause, CredibleInterval, Place
from aoro_gym.diagnosis.words import conclusions, gap_closure, probability, readable, shown, title
from aoro_gym.effects.catalogue import EFFECTS
from tests.diagnosis.diagnoses import BARE, CAUSE, DIAGNOSES, SIGNALS, curve

VOID = {"meta", "br", "img", "link"}
SIZES = {"°": np.radians(1.0), "bar": 1e5}
"""SI value of the units that signals are shown in."""


class Page(HTMLParser):
    """Text and tables of a page by the heading above them; addresses and alternative texts."""

    def __init__(self, page: str):
        super().__init__()
        self.open: list[str] = []
        self.heading = ""
        self.text: dict[str, str] = {}
        self.tables: dict[str, list[list[list[str]]]] = {}
        self.alts: list[str] = []
        self.addresses: list[str] = []
        self.feed(page)
        assert self.open == [], "elements that were never closed"

    def handle_starttag(self, tag, attrs):
        self.addresses += [value for name, value in attrs if name in ("href", "src") and value]
        self.alts += [value for name, value in attrs if name == "alt" and value]
        if tag == "h2":
            self.heading = ""
        if tag == "table":
            self.tables.setdefault(self.heading, []).append([])
        if tag == "tr":
            self.tables[self.heading][-1].append([])
        if tag in ("td", "th"):
            self.tables[self.heading][-1][-1].append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" in self.open or "script" in self.open:
            return
        if "h2" in self.open:
            self.heading += data
        self.text[self.heading] = self.text.get(self.heading, "") + data
        if {"td", "th"} & set(self.open):
            self.tables[self.heading][-1][-1][-1] += data


def read(diagnosis, tmp_path, *, curves=False):
    """The page of a diagnosis; drawing its curves takes most of the time."""
    path = write_report(diagnosis if curves else replace(diagnosis, curves=()), tmp_path / "new")
    assert path == tmp_path / "new" / "report.html"
    return Page(path.read_text(encoding="utf-8"))


def number(text: str) -> float:
    """The first number in a text, as the page writes it."""
    found = re.search(r"[−+]?\d+(\.\d+)?", text)
    assert found, text
    return float(found[0].replace("−", "-"))


def last_digit(text: str) -> float:
    """Half the last digit's worth: how far rounding may have moved a number."""
    return 0.5000001 * 10.0 ** -len((re.findall(r"\d+\.?(\d*)", text) or [""])[0])


def close(text: str, value: float) -> bool:
    return abs(number(text) - value) <= last_digit(text)


@pytest.fixture(scope="module", params=VERDICTS)
def verdict(request):
    return request.param


@pytest.fixture(scope="module")
def page(verdict, tmp_path_factory):
    """With curves where there is no gap: those of a cause are drawn by a test of their own."""
    return read(DIAGNOSES[verdict], tmp_path_factory.mktemp(verdict), curves=verdict == "no_gap")


# --- numbers ---


@pytest.mark.parametrize(
    ("unit", "median", "low", "high", "expected"),
    [
        ("m^3/s", 4e-5, 3e-5, 5e-5, ("+2.40 L/min", "+1.80 to +3.00")),
        ("m^3/s", -2e-3 / 60, -3e-3 / 60, 0.0, ("−2.0 L/min", "−3.0 to 0.0")),
        ("Pa", 5e5, 4e5, 6.4e5, ("+5.0 bar", "+4.0 to +6.4")),
        ("Pa", -2.8e8, -3.2e8, -2.4e8, ("−0.280 GPa", "−0.320 to −0.240")),
        ("s", 0.0113, 0.0094, 0.0131, ("+11.3 ms", "+9.4 to +13.1")),
        ("rad", np.radians(0.4), np.radians(0.3), np.radians(0.6), ("+0.40°", "+0.30 to +0.60")),
        ("N", 3400.0, 2900.0, 4100.0, ("+3.40 kN", "+2.90 to +4.10")),
        ("N", 340.0, 290.0, 410.0, ("+340 N", "+290 to +410")),
        ("N*m", -1200.0, -1500.0, -700.0, ("−1.20 kN m", "−1.50 to −0.70")),
        ("1", 0.021, 0.018, 0.025, ("+2.10 %", "+1.80 to +2.50")),
        ("kg", 640.0, 500.0, 800.0, ("+640 kg", "+500 to +800")),
        ("K", 12.0, 12.0, 12.0, ("+12.0 K", "+12.0 to +12.0")),
        ("rad/(N*m)", 2e-7, 1e-7, 3e-7, ("+0.0115°/(kN m)", "+0.0057 to +0.0172")),
        ("m^3/Pa", 2e-12, 1e-12, 3e-12, ("+0.20 cm³/bar", "+0.10 to +0.30")),
    ],
)
def test_sizes_stand_in_field_units(unit, median, low, high, expected):
    assert (
        tuple(text.replace("\N{NO-BREAK SPACE}", " ") for text in shown(CredibleInterval(median, low, high, unit)))
        == expected
    )


def test_every_operational_magnitude_is_readable():
    """At the ends of the ranges no effect's size is so large or small that one counts digits."""
    from aoro_gym.machine import Machine

    machine = Machine.load("aoro")
    for effect in EFFECTS.values():
        without = effect.measured(machine, *effect.none)
        most = effect.measured(machine, *(magnitude.high for magnitude in effect.magnitudes))
        for one, before, after in zip(effect.operational, without, most, strict=True):
            size = float(np.asarray(after) - np.asarray(before))
            if size:
                text = shown(CredibleInterval(size, 0.9 * size, 1.1 * size, one.unit))[0]
                assert 1e-3 < abs(number(text)) < 1e4, (effect.id, text)


@pytest.mark.parametrize(
    ("p", "text"),
    [(0.5, "50 %"), (0.004, "0.4 %"), (0.996, "99.6 %"), (0.99999, "> 99.9 %"), (1e-9, "< 0.1 %"), (0.99, "99 %")],
)
def test_probability_is_never_rounded_to_certainty(p, text):
    assert probability(p).replace("\N{NO-BREAK SPACE}", " ") == text


def test_a_gap_that_grew_is_negative():
    assert number(gap_closure(-0.31)) == -31.0
    assert number(gap_closure(0.996)) == 99.6
    assert gap_closure(-0.001) == gap_closure(0.0)


def test_how_far_a_gap_grew_is_told_up_to_ten_times_itself():
    told = [gap_closure(S).replace("\N{NO-BREAK SPACE}", " ") for S in (-9.9, -10.1, -1045.0, 10.1)]
    assert told == ["−990 %", "< −1000 %", "< −1000 %", "> 1000 %"]


def test_a_fitted_manoeuvre_stands_with_and_without_its_own_clock(tmp_path):
    one = replace(CAUSE.shrinkage[0], held_out=False, refitted=False)
    both = replace(CAUSE, shrinkage=(one, replace(one, S=0.5, refitted=True)))
    rows = read(both, tmp_path).tables["How far the gap shrinks"][0][1:]
    assert [row[0].lower() for row in rows if len(row) == 1] == list(KINDS[2:])
    console = Console(record=True, width=200, file=io.StringIO())
    for item in summary(both):
        console.print(item)
    assert all(gap_closure(S) in console.export_text(clear=False) for S in (one.S, 0.5))


def test_titles():
    assert title(()) == "no cause"
    assert title(("unknown",)) == "something outside the catalogue"
    assert title(("spool_lag", "entrained_air")) == "spool lag and entrained air"


def test_a_headline_names_few():
    causes = [Cause((name,), 0.18) for name in list(EFFECTS)[:5]]
    headline = conclusions(replace(DIAGNOSES["ambiguous"], causes=tuple(causes))).headline
    assert headline == "Sensor delay, sensor filter, sensor gain or others"


# --- page ---


def test_page_needs_nothing_else(page):
    assert all(address.startswith(("#", "data:", "machine_")) for address in page.addresses)
    assert "$" not in "".join(page.text.values())


def test_page_says_the_verdict_first(page, verdict):
    said = conclusions(DIAGNOSES[verdict])
    first, second = list(page.text)[:2]
    assert first == ""  # the page's own title
    assert second == said.headline
    for text in (said.why, *(answer for question, answer in said.answers.items() if question != "How much")):
        assert text in page.text[second]


def test_why_is_the_physics(verdict):
    said = conclusions(DIAGNOSES[verdict])
    named = {"cause": ["cylinder_leakage"], "ambiguous": ["cylinder_leakage", "cross_port_leakage"]}.get(verdict, [])
    for name, effect in EFFECTS.items():
        assert (effect.physics in said.why) == (name in named)
        assert (title([name]) in said.headline.lower()) == (name in named)


def test_size_stands_above_all(tmp_path):
    page = read(CAUSE, tmp_path)
    interval = CAUSE.causes[0].magnitudes["cylinder_leakage"][0]
    top = page.text["Cylinder leakage"].replace("\N{NO-BREAK SPACE}", " ")
    found = re.findall(r"([−+][\d.]+) L/min.*?90 %: ([−+][\d.]+) to ([−+][\d.]+)", top)
    assert len(found) == 1
    for text, value in zip(found[0], (interval.median, interval.low90, interval.high90), strict=True):
        assert close(text, value * 60e3)
    assert "leakage past both pistons at 100 bar" in top.lower()


@pytest.mark.parametrize("name", ["cause", "ambiguous", "unknown", "inconclusive"])
def test_heat_maps_hold_the_shares(name, tmp_path):
    diagnosis = DIAGNOSES[name]
    heats = [table for table in read(diagnosis, tmp_path).tables["Where the gap lies"] if table[0][0] == ""]
    manoeuvres = list(dict.fromkeys(place.manoeuvre for place in diagnosis.where))
    assert len(heats) == 1 + len(manoeuvres)
    for table, manoeuvre in zip(heats, [None, *manoeuvres], strict=True):
        assert [head.replace("\N{SOFT HYPHEN}", "") for head in table[0][1:]] == [readable(phase) for phase in PHASES]
        for signal, *cells in table[1:]:
            for phase, cell in zip(PHASES, cells, strict=True):
                share = sum(
                    place.share
                    for place in diagnosis.where
                    if (readable(place.signal), place.phase) == (signal, phase) and manoeuvre in (None, place.manoeuvre)
                )
                assert share < 0.005 if cell == "·" else close(cell, 100.0 * share)


@pytest.mark.parametrize("name", ["no_gap", "calibration"])
def test_what_is_noise_has_no_place(name, tmp_path):
    assert DIAGNOSES[name].where
    page = read(DIAGNOSES[name], tmp_path)
    assert "Where the gap lies" not in page.tables


def test_a_cause_that_is_likelier_than_none_is_told_though_no_gap_is_said():
    sure = DIAGNOSES["no_gap"]
    doubtful = replace(sure, causes=(Cause((), 0.13), Cause(("spool_lag",), 0.09), Cause(("hose_compliance",), 0.16)))
    assert "likelier" not in conclusions(sure).next
    assert "Hose compliance is likelier than no cause" in conclusions(doubtful).next


def test_a_gap_that_is_not_ruled_out_has_its_set(tmp_path):
    """Beside the verdict that there is none; where one is said, the set should hold the truth."""
    doubtful = read(replace(DIAGNOSES["no_gap"], declared_set=("spool_lag",)), tmp_path).text["Causes"]
    assert "A gap is not ruled out; should there be one, its cause is among: spool lag." in doubtful
    sure = read(DIAGNOSES["cause"], tmp_path / "sure").text["Causes"]
    assert "The least set of effects that should hold the truth: cylinder leakage." in sure and "ruled out" not in sure


def test_causes(page, verdict):
    head, *rows = page.tables["Causes"][0]
    causes = DIAGNOSES[verdict].causes
    assert len(rows) == len(causes)
    for row, cause in zip(rows, causes, strict=True):
        cells = dict(zip(head, row, strict=True))
        assert cells["cause"].lower() == title(cause.effects)
        assert close(cells["probability"], 100.0 * cause.probability)
        for parts in cause.magnitudes.values():
            for part in parts:
                assert all(text in cells["size against the twin (90 %)"] for text in shown(part))
        for values in cause.settings.values():
            assert all(f"{value:.4g}" in cells["magnitude in the twin (SI)"] for value in values)
        assert cells["machine file"] == (cause.machine_file or "-")
        assert not cause.machine_file or cause.machine_file in page.addresses


def test_shrinkage(page, verdict):
    found = DIAGNOSES[verdict].shrinkage
    if not found:
        assert "How far the gap shrinks" not in page.tables
        return
    head, *rows = page.tables["How far the gap shrinks"][0]
    kind, shown_rows = "", {}
    for row in rows:
        if len(row) == 1:
            kind = row[0].lower()
        else:
            shown_rows[kind, row[0], row[1]] = dict(zip(head, row, strict=True))
    assert len(shown_rows) == len(found)
    for one in found:
        kind = KINDS[2 * int(not one.held_out) + int(one.refitted)]
        cells = shown_rows[kind, one.manoeuvre, readable(one.signal)]
        assert close(cells["gap gone"], 100.0 * one.S)
        low, high = cells["90 %"].split(" to ")
        assert close(low, 100.0 * one.low90)
        assert close(high, 100.0 * one.high90)
        for column, value in (("error before, rms", one.before), ("after", one.after), ("noise", one.noise)):
            assert close(cells[column], value / SIZES[cells["unit"]])


@pytest.mark.parametrize("name", ["cause", "ambiguous", "unknown"])
def test_the_median_of_manoeuvres_left_out_is_the_controls(name, tmp_path):
    diagnosis = DIAGNOSES[name]
    said = conclusions(diagnosis).closure
    left_out = np.median([one.S for one in diagnosis.shrinkage if one.held_out and not one.refitted])
    assert diagnosis.controls["cause"] == pytest.approx(left_out)
    assert f"{abs(100.0 * left_out):.0f}" in said
    assert ("has grown" in said) == (left_out < 0.0)
    assert gap_closure(left_out) in said
    text = read(diagnosis, tmp_path).text["How far the gap shrinks"]
    for value in diagnosis.controls.values():
        assert "not tried" in text if value is None else gap_closure(value) in text


def test_every_signal_has_a_share_of_its_own():
    """A small gap that stays says nothing of a large one that is gone."""
    one = replace(CAUSE.shrinkage[0], held_out=True, refitted=False, signal="joint_angle", S=0.9)
    other = replace(one, signal="pump_pressure", S=-0.3)
    said = conclusions(replace(CAUSE, shrinkage=(one, replace(one, S=0.7), other))).closure.replace(
        "\N{NO-BREAK SPACE}", " "
    )
    assert "80 % of the gap is gone in joint angle; the gap has grown by 30 % in pump pressure" in said


def test_key_figures(tmp_path):
    rows = read(CAUSE, tmp_path).tables["Key figures"][0][1:]
    assert rows[0] == ["left, 100 %"]
    for row, values in zip(rows[1:], CAUSE.key_figures["left, 100 %"].values(), strict=True):
        for cell, value in zip(row[2:], values.values(), strict=True):
            assert cell == "-" if value is None else float(cell) == value


def test_experiments_and_calibration(tmp_path):
    page = read(CAUSE, tmp_path)
    for row, one in zip(page.tables["Next experiments"][0][1:], CAUSE.next_experiments, strict=True):
        assert row[1] == one.description
        assert float(row[2]) == one.gain
    for row, moved in zip(page.tables["What calibration moved"][0][1:], CAUSE.calibration, strict=True):
        assert (row[0], float(row[1]), float(row[2])) == (moved["key"], moved["before"], moved["after"])
        assert close(row[4], moved["deviations"])


def test_curves_have_their_errors_as_text(tmp_path):
    page = read(CAUSE, tmp_path, curves=True)
    assert len(page.alts) == MOST_CURVES
    for one, alt in zip(telling(CAUSE.curves, CAUSE.where), page.alts, strict=True):
        assert readable(one.signal) in alt
        before, after = re.findall(r"by ([\d.]+)\W*(°|bar)", alt)
        for (text, unit), values in ((before, one.before), (after, one.after)):
            assert close(text, math.sqrt(np.mean((one.measured - values) ** 2)) / SIZES[unit])


def test_curves_with_the_largest_gap_are_shown_and_one_that_was_left_out():
    seen = [curve(f"seen_{i}", "joint_angle", gap=10.0 + i, left=0.1) for i in range(MOST_CURVES + 1)]
    unseen = curve("unseen", "joint_angle", gap=1.0, left=0.1, held_out=True)
    assert [one.manoeuvre for one in telling([*seen, unseen])] == ["seen_4", "seen_3", "seen_2", "unseen"]
    assert [one.manoeuvre for one in telling(seen)] == ["seen_4", "seen_3", "seen_2", "seen_1"]
    assert telling([]) == []
    partly = [replace(one, spread=np.where(np.arange(len(one.time)) < 3, np.nan, one.spread)) for one in seen]
    assert [one.manoeuvre for one in telling(partly)] == ["seen_4", "seen_3", "seen_2", "seen_1"]


def test_what_calibration_absorbs_is_not_what_curves_show():
    offset = curve("turn", "pressure_a", gap=50.0, left=50.0)
    told = curve("turn", "joint_angle", gap=1.0, left=0.1)
    other = curve("drive", "joint_angle", gap=9.0, left=9.0)
    where = [Place("valve", phase, "joint_angle", "turn", 0.4) for phase in ("onset", "steady")]
    assert telling([offset, other, told], where) == [told, offset, other]
    assert telling([offset, other, told]) == [offset, other, told]


def test_one_goes_on_with_the_machine_file_that_the_verdict_earns(verdict, page):
    file = {"cause": "machine_1.toml", "calibration": "machine_1.toml", "ambiguous": "machine_1.toml"}
    commands = page.text["How to go on"]
    assert f"new/{file[verdict]}" in commands if verdict in file else "--machine mine.toml" in commands
    verbs = re.findall(r"aoro-gym ([a-z]+)", commands)
    assert verbs
    for verb in verbs:
        assert CliRunner().invoke(app, [verb, "--help"]).exit_code == 0


def test_nothing_is_said_where_nothing_is_known(verdict, tmp_path):
    page = read(BARE[verdict], tmp_path)
    said = conclusions(BARE[verdict])
    assert all(said.answers.values())
    assert set(page.text) == {"", said.headline, "Limitations", "How to go on"}
    assert "nan" not in "".join(page.text.values()).lower().split()
    Console(width=120, file=io.StringIO()).print(*summary(BARE[verdict]))


@pytest.mark.parametrize(
    "field", ["where", "causes", "shrinkage", "controls", "key_figures", "next_experiments", "calibration", "curves"]
)
def test_any_part_may_be_empty(field, tmp_path):
    empty = replace(CAUSE, **{field: type(getattr(CAUSE, field))()})
    assert read(empty, tmp_path).heading == "How to go on"
    assert summary(empty)


def test_effects_of_ones_own(tmp_path):
    """An effect that the catalogue lacks is named by its id, and has no physics."""
    physics = EFFECTS["cylinder_leakage"].physics
    for effects, told in ((EFFECTS, True), ({}, False)):
        page = write_report(replace(CAUSE, curves=()), tmp_path, effects=effects).read_text(encoding="utf-8")
        assert (physics in page) == told
        assert "Cylinder leakage" in page


# --- terminal ---


def test_summary(verdict):
    diagnosis = DIAGNOSES[verdict]
    console = Console(width=200, record=True, file=io.StringIO())
    for item in summary(diagnosis):
        console.print(item)
    text = console.export_text()
    assert conclusions(diagnosis).headline in text
    for cause in diagnosis.causes:
        assert title(cause.effects) in text
        assert probability(cause.probability) in text
        for parts in cause.magnitudes.values():
            for part in parts:
                assert "{} ({})".format(*shown(part)) in text
    for one in diagnosis.shrinkage:
        assert gap_closure(one.S) in text
    for limitation in diagnosis.limitations:
        assert limitation in text
    assert {readable(signal) for signal in SIGNALS if diagnosis.shrinkage} <= set(re.findall(r"\w[\w ]+\w", text))
