"""Pictures of worlds: what is nearest is seen, in its colour, where it lies."""

import numpy as np

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.world import figures
from aoro_gym.terrains.world.figures import BACKGROUND, draw_world, view
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Boulder, upright
from aoro_gym.terrains.world.report import summary
from aoro_gym.terrains.world.world import World


def snowfield(monkeypatch) -> World:
    monkeypatch.setattr(figures, "SAMPLES", 60_000)
    ground = Terrain.from_heights(np.zeros((11, 11)), cell=1.0)
    boulder = Boulder((7.5, 2.5, 0.0), upright(), (1.5, 1.5, 1.5), 1.3, 4)
    return World(ground, (boulder,), np.full(len(ground.faces), Surface.SNOW))


def test_what_is_nearest_is_seen_where_it_lies(monkeypatch):
    image = view(snowfield(monkeypatch).scene(), 90.0, 101)
    assert image.shape == (101, 101, 3)
    assert image[20, 20].min() > 0.9  # snow
    assert image[75, 75].max() < 0.75  # the boulder: x 7.5 m, y 2.5 m
    assert not np.isclose(image, BACKGROUND).all(axis=2).any()  # no gaps


def test_a_slanting_view_is_flatter(monkeypatch):
    image = view(snowfield(monkeypatch).scene(), 30.0, 101)
    assert 50 <= image.shape[0] <= 70  # 10 m · sin 30°, and the boulder's 1.3 m


def test_figure_and_summary(monkeypatch):
    world = snowfield(monkeypatch)
    assert len(draw_world(world, width=60).axes) == 2
    figures_of = summary(world)
    assert figures_of["classes"] == {
        "boulder": {"count": 1, "per_hectare": 100.0, "drivable": 0, "mean_diameter_m": None}
    }
    assert (figures_of["objects"], figures_of["area_m2"], figures_of["drivable_ground_share"]) == (1, 100.0, 1.0)
