"""The table of materials has a row for every surface, in bounds, in the order of their numbers."""

import doctest

import numpy as np

import aoro_gym.terrains.world.materials as module
from aoro_gym.terrains.world.materials import MATERIALS, Surface, material_table


def test_rows_are_surfaces():
    assert [int(surface) for surface in Surface] == list(range(len(Surface)))
    table = material_table()
    for surface in Surface:
        material = MATERIALS[surface]
        np.testing.assert_allclose(table.albedo[surface], material.albedo, rtol=1e-6)
        assert table.roughness[surface] == np.float32(material.roughness)
        assert table.reflectance_905nm[surface] == np.float32(material.reflectance_905nm)
        assert table.reflectance_1550nm[surface] == np.float32(material.reflectance_1550nm)


def test_values_are_shares_with_sources():
    for column in material_table():
        assert column.dtype == np.float32
        assert ((column >= 0.0) & (column <= 1.0)).all()
    for material in MATERIALS.values():
        tags = [part.strip()[:1] for part in material.source.split(";")]
        assert len(tags) == 2 and set(tags) <= set("SRE")


def test_what_holds_water_or_ice_is_darker_at_1550_nm():
    for surface in (Surface.SNOW, Surface.WET_SOIL, Surface.GRASS, Surface.SPRUCE_NEEDLES, Surface.BIRCH_LEAVES):
        assert MATERIALS[surface].reflectance_1550nm < 0.7 * MATERIALS[surface].reflectance_905nm


def test_example():
    tried = doctest.testmod(module)
    assert (tried.attempted > 0, tried.failed) == (True, 0)
