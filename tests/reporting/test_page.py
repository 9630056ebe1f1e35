"""Animations, pictures and plots in pages, and key figures in words."""

import base64
import gzip
import io
import re

import numpy as np
import plotly.graph_objects as go
import pytest
from PIL import Image, features
from scipy.ndimage import gaussian_filter

from aoro_gym.reporting.page import describe, interactive_plot, packed, picture, show, write_animation, write_page
from tests.view.browser import CHROMIUM, Browser


@pytest.fixture
def moving():
    """Three grey pictures."""
    return [np.full((16, 24, 3), shade, dtype=np.uint8) for shade in (0, 120, 255)]


@pytest.mark.parametrize(("has_avif", "suffix"), [(True, ".avif"), (False, ".webp")])
def test_animation_keeps_frames_and_time(has_avif, suffix, moving, tmp_path, monkeypatch):
    monkeypatch.setattr(features, "check", lambda feature: has_avif)
    path = write_animation(tmp_path / "new" / "moving", moving, frames_per_second=10)
    assert path == tmp_path / "new" / f"moving{suffix}"
    with Image.open(path) as film:
        assert film.size == (24, 16)
        assert getattr(film, "n_frames") == 3  # noqa: B009
        for number, frame in enumerate(moving):
            film.seek(number)
            film.load()
            assert film.info["duration"] == 100
            # quantisation in brightness and colour, of 255
            np.testing.assert_allclose(np.asarray(film.convert("RGB")), frame, atol=4)


def shown_in(html):
    """The picture that HTML holds, and its media type."""
    kind, content = re.findall(r'src="data:([^;]+);base64,([^"]+)"', str(html))[0]
    return kind, Image.open(io.BytesIO(base64.b64decode(content)))


def test_drawings_keep_their_pixels_and_relief_takes_few_bytes(tmp_path):
    flat = np.full((200, 300, 3), 255, dtype=np.uint8)
    flat[50:60, :, 1:] = 0
    Image.fromarray(flat).save(tmp_path / "flat.png", compress_level=0)
    kind, image = shown_in(picture(tmp_path / "flat.png"))
    assert kind == "image/webp"
    np.testing.assert_array_equal(np.asarray(image.convert("RGB")), flat)

    smooth = gaussian_filter(np.random.default_rng(0).normal(0.0, 400.0, (200, 300, 3)), (4, 4, 0)) + 128.0
    relief = (smooth + np.random.default_rng(1).normal(0.0, 2.0, smooth.shape)).clip(0, 255).astype(np.uint8)
    Image.fromarray(relief).save(tmp_path / "relief.png")
    html = picture(tmp_path / "relief.png")
    kind, image = shown_in(html)
    assert kind == "image/webp"
    assert len(html) < 0.5 * (tmp_path / "relief.png").stat().st_size
    error = np.asarray(image.convert("RGB")).astype(float) - relief
    assert np.sqrt(np.mean(error**2)) < 6.0


def test_what_is_packed_unpacks_and_is_the_same_each_time():
    text = "ö < 1; " * 1000
    assert gzip.decompress(base64.b64decode(packed(text))).decode() == text
    assert packed(text) == packed(text)
    assert len(packed(text)) < 200


@pytest.fixture
def plots_page(tmp_path):
    """A page of two plots."""
    bodies = []
    for _ in range(2):
        figure = go.Figure(go.Scatter(x0=0.0, dx=0.5, y=np.array([1.0, 3.0, 2.0], dtype=np.float32)))
        bodies.append(("plot", interactive_plot(figure, height=300)))
    write_page(tmp_path / "page.html", "title", "lead", bodies)
    return tmp_path / "page.html"


def test_a_page_of_plots_is_small(plots_page):
    text = plots_page.read_text(encoding="utf-8")
    assert len(text) < 2_200_000
    assert text.count('class="plotly-graph-div"') == 2
    # plotly itself stands once, and neither code nor data can end a script early
    assert text.count("<script") == text.count("</script>") == 2 + 2


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_browser_draws_packed_plots_without_a_network(plots_page):
    browser = Browser(640, 480)
    try:
        browser.call("Runtime.enable")
        browser.call("Log.enable")
        browser.open(plots_page.as_uri())
        events = []
        for _ in range(20):
            events += browser.wait(1.0)
            if browser.evaluate("document.querySelectorAll('.plotly-graph-div path.js-line').length") == 2:
                break
        else:
            pytest.fail("the plots were not drawn within 20 s")
        told = [one for one in events if one.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")]
        asked = [one["params"]["request"]["url"] for one in events if one.get("method") == "Network.requestWillBeSent"]
        assert not told
        assert not [address for address in asked if not address.startswith(("file:", "data:", "blob:"))]
        assert browser.evaluate("document.querySelector('.plotly-graph-div').calcdata[0][1].y") == 3.0
    finally:
        browser.close()


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
