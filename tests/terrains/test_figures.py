"""Plan views: the right colours at the right places."""

import io

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb

from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.figures import PATH, ZONE_COLOURS, draw_terrain
from aoro_gym.terrains.generate.forest import COVERS, Obstacle, Zone


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    monkeypatch.setattr("aoro_gym.terrains.figures.MOST_PIXELS", 250)


def pixel(figure, x: float, y: float) -> np.ndarray:
    """Colour (3,) drawn at a place of the plan."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[::-1]
    column, row = np.rint(figure.axes[0].transData.transform((x, y))).astype(int)
    return image[row, column, :3] / 255.0


def halves() -> Terrain:
    """Level ground, asphalt in the west and wet in the east, raised in the north."""
    x, y = np.meshgrid(np.arange(41.0), np.arange(21.0))
    cover = np.where(x[..., None] < 20.0, COVERS[Zone.ASPHALT], COVERS[Zone.WET])
    return Terrain.from_heights(
        np.where(y > 10.0, 0.05, 0.0), cell=1.0, friction=cover[..., 0], rolling_resistance=cover[..., 1], name="halves"
    )


def test_zones_have_their_colours():
    figure = draw_terrain(halves())
    for x, zone in ((5.0, Zone.ASPHALT), (35.0, Zone.WET)):
        np.testing.assert_allclose(pixel(figure, x, 5.0), to_rgb(ZONE_COLOURS[zone]), atol=2 / 255)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["asphalt", "wet"]
    assert figure.axes[0].get_title(loc="left") == "halves"


def test_other_ground_is_coloured_by_height():
    y = np.arange(0.0, 31.0)
    slope = Terrain.from_heights(np.repeat(0.1 * y[:, None], 31, axis=1), cell=1.0, friction=0.9)
    figure = draw_terrain(slope, title="slope")
    assert figure.axes[1].get_ylabel() == "height [m]"
    south, north = pixel(figure, 15.4, 2.3), pixel(figure, 15.4, 27.3)
    assert np.abs(south - north).max() > 0.2


@pytest.mark.parametrize("direction", [(0.0, 1.0), (1.0, 0.0)])
def test_light_comes_from_the_north_west(direction):
    rise = np.add.outer(np.arange(30.0) * direction[1], np.arange(30.0) * direction[0])
    ridge = np.minimum(rise, 29.0 - rise)
    figure = draw_terrain(Terrain.from_heights(ridge * 0.4, cell=1.0))
    # both sides of the ridge have the same heights; which one faces north, or west, is lit
    first, second = ((9.3, 9.3) if d == 0.0 else (7.3, 21.7) for d in direction)
    south_or_west = pixel(figure, first[0], second[0]).sum()
    north_or_east = pixel(figure, first[1], second[1]).sum()
    assert (south_or_west < north_or_east) == (direction[1] == 1.0)


def test_path_and_obstacles_are_drawn():
    path = Path(np.array([[5.0, 10.5], [33.0, 10.5]]))
    figure = draw_terrain(halves(), path, obstacles=[Obstacle("boulder", 30.0, 4.0, 1.0, 0.5)])
    np.testing.assert_allclose(pixel(figure, 12.0, 10.5), to_rgb(PATH), atol=0.02)
    assert np.abs(pixel(figure, 30.0, 4.0) - to_rgb(ZONE_COLOURS[Zone.WET])).max() > 0.05
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert {"boulder", "path, 28 m"} <= {text.get_text() for text in legend.get_texts()}


def test_holes_stay_white():
    z = np.zeros((30, 30))
    z[10:20, 10:20] = np.nan
    figure = draw_terrain(Terrain.from_heights(z, cell=1.0))
    np.testing.assert_allclose(pixel(figure, 14.5, 14.5), 1.0)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["no ground"]


def test_can_be_written():
    file = io.BytesIO()
    draw_terrain(halves()).savefig(file, format="png")
    assert file.getvalue().startswith(b"\x89PNG")


def test_names_that_are_markup_are_drawn_as_they_are():
    figure = draw_terrain(halves(), title=r"$\nope{$ [/x]")
    figure.savefig(io.BytesIO())  # mathtext would fail
    assert figure.axes[0].get_title(loc="left") == r"$\nope{$ [/x]"
