"""Animations, and key figures in words."""

import numpy as np
import pytest
from PIL import Image

from aoro_gym.reporting.page import describe, show, write_gif


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
