"""Plots: the right panels for a recording, a readable picture, and a page that needs no network."""

import re

import pytest

from aoro_gym.figures import key_figures
from aoro_gym.report import Section, describe, panels, show, write_html, write_png


@pytest.fixture(scope="module")
def sections(left_turn, drive, machine):
    cylinder = machine.steering.cylinder
    return [Section(recording, key_figures(recording, cylinder)) for recording in (left_turn, drive)]


def test_panels_follow_what_the_recording_uses(left_turn, drive):
    turning, driving = ([panel.title for panel in panels(recording)] for recording in (left_turn, drive))
    assert "Flows of the steering circuit" in turning
    assert "Pressures of the driveline" not in turning
    assert "Pressures of the driveline" in driving
    assert "Flows of the steering circuit" not in driving
    assert "Wheel speeds" in turning
    assert "Wheel speeds" in driving


def test_every_line_has_its_channel(left_turn, drive):
    for recording in (left_turn, drive):
        for panel in panels(recording):
            for line in panel.lines:
                assert line.channel in recording, line.channel


def test_png(tmp_path, sections):
    path = tmp_path / "new" / "turn.png"
    write_png(path, sections[0])
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 30_000


def test_page_is_self_contained(tmp_path, sections):
    path = tmp_path / "page.html"
    write_html(path, "Two <runs>", "of a & b", sections)
    page = path.read_text(encoding="utf-8")
    assert "<title>Two &lt;runs&gt;</title>" in page
    assert "of a &amp; b" in page
    for section in sections:
        assert f">{section.title}</h2>" in page
    assert page.count('class="plotly-graph-div"') == 2
    assert not re.search(r"""<(?:script|link|img)[^>]+(?:src|href)=["']?(?:https?:)?//""", page)
    assert "$" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("key", "value", "name", "shown"),
    [
        ("turn_time_s", 1.98, "turn time", "1.980"),
        ("raw_first_peak_L_per_min", 104.44, "raw first peak", "104.4"),
        ("final_speed_m_per_s", 0.75, "final speed", "0.750"),
        ("distance_m", 2.951, "distance", "2.95"),
        ("turn_time_s", None, "turn time", "-"),
    ],
)
def test_figures_in_words(key, value, name, shown):
    assert describe(key)[0] == name
    assert show(key, value) == shown
