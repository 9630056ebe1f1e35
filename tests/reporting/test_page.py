"""Plots: the right panels for a recording, a readable picture, and a page that needs no network."""

import re

import numpy as np
import pytest
from PIL import Image

from aoro_gym.reporting.page import Passage, Section, describe, panels, show, write_gif, write_html, write_png
from aoro_gym.simulation.figures import key_figures


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


def test_page_holds_copies_of_pictures(tmp_path, sections):
    moving = tmp_path / "moving.gif"
    write_gif(moving, [np.full((8, 12, 3), shade, dtype=np.uint8) for shade in (0, 120, 255)], frames_per_second=10)
    path = tmp_path / "page.html"
    write_html(path, "T", "lead", sections[:1], [Passage("A & b", "more < less", [moving], more="other/index.html")])
    page = path.read_text(encoding="utf-8")
    assert 'A &amp; b</h2><p>more &lt; less <a href="other/index.html">' in page
    assert 'src="data:image/gif;base64,' in page


def test_gif_keeps_frames_and_time(tmp_path):
    path = tmp_path / "new" / "moving.gif"
    shades = (0, 120, 255)
    frames = [np.full((8, 12, 3), shade, dtype=np.uint8) for shade in shades]
    frames[-1][:4] = np.arange(12)[:, None] * 20  # the palette is that of the last frame
    write_gif(path, frames, frames_per_second=10)
    with Image.open(path) as gif:
        assert gif.size == (12, 8)
        assert getattr(gif, "n_frames") == 3  # noqa: B009
        assert gif.info["duration"] == 100


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
