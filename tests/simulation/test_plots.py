"""Plots: the right panels for a recording, a readable picture, and a page that needs no network."""

import re

import numpy as np
import pytest

from aoro_gym.reporting.page import Passage, write_animation
from aoro_gym.simulation.key_figures import recording_figures
from aoro_gym.simulation.plots import Section, _instants, panels, write_html, write_png


@pytest.fixture(scope="module")
def sections(left_turn, drive, machine):
    cylinder = machine.steering.cylinder
    return [Section(recording, recording_figures(recording, cylinder)) for recording in (left_turn, drive)]


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


def test_page_holds_copies_of_pictures(tmp_path, sections):
    frames = [np.full((16, 24, 3), shade, dtype=np.uint8) for shade in (0, 120, 255)]
    moving = write_animation(tmp_path / "moving", frames, frames_per_second=10)
    path = tmp_path / "page.html"
    write_html(path, "T", "lead", sections[:1], [Passage("A & b", "more < less", [moving], more="other/index.html")])
    page = path.read_text(encoding="utf-8")
    assert 'A &amp; b</h2><p>more &lt; less <a href="other/index.html">' in page
    assert f'src="data:image/{moving.suffix[1:]};base64,' in page


def test_even_instants_are_a_start_and_a_step():
    """As plotly takes them; uneven ones are written out."""
    even = _instants(np.linspace(0.25, 0.35, 101), 2)
    assert even == {"x0": 0.25, "dx": 0.002}
    uneven = _instants(np.array([0.0, 0.1, 0.3, 0.4]), 1)
    np.testing.assert_allclose(uneven["x"], [0.0, 0.1, 0.3, 0.4], rtol=1e-6)
    assert _instants(np.array([0.5]), 1)["x0"] == 0.5
