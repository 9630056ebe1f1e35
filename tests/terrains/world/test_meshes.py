"""Triangles of objects against the volumes and areas of what they stand for; closed, wound outward."""

import numpy as np
import pytest
import trimesh

from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.meshes import BUMPS, FOLIAGE, MOST_LEAVES, crown_profile, foliage, mesh, stem_rings
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Stump, Tree, along, matrix, upright
from aoro_gym.terrains.world.species import SPECIES

ORIGIN = (0.0, 0.0, 0.0)


def tree(species: str = "pine", **changes) -> Tree:
    usual = {"diameter": 0.2, "height": 15.0, "crown_base": 8.0, "crown_radius": 1.7, "shape": 3}
    return Tree(ORIGIN, upright(0.03, 2.0), species, **(usual | changes))


def solid(made) -> trimesh.Trimesh:
    return trimesh.Trimesh(made.vertices, made.faces, process=False)


def test_logs_are_closed_frusta_with_two_end_faces():
    log = Log((3.0, -2.0, 1.0), along((1.0, 2.0, 0.3)), "birch", 4.0, 0.15, 0.1, 0.3, 1)
    made = mesh(log)
    shape = solid(made)
    assert shape.is_watertight and shape.is_winding_consistent
    frustum = np.pi * 4.0 / 3.0 * (0.15**2 + 0.15 * 0.1 + 0.1**2)  # rings have the area of their circles
    assert shape.volume == pytest.approx(frustum, rel=1e-3)
    ends = made.surfaces == Surface.END_GRAIN
    assert shape.area_faces[ends].sum() == pytest.approx(np.pi * (0.15**2 + 0.1**2), rel=1e-9)
    assert set(made.surfaces) == {Surface.END_GRAIN, Surface.BIRCH_BARK}
    far = np.array([3.0, -2.0, 1.0]) + 4.0 * matrix(log.rotation)[:, 2]
    np.testing.assert_allclose(np.linalg.norm(made.vertices - far, axis=1).min(), 0.0, atol=1e-9)


@pytest.mark.parametrize("species", SPECIES)
def test_stems_have_the_volume_of_their_taper_curve(species):
    one = tree(species)
    made = mesh(one)
    along_stem = (made.vertices @ matrix(one.rotation))[made.faces][:, :, 2].min(axis=1)
    above_ground = (made.surfaces < Surface.END_GRAIN) & (along_stem > -1e-9)
    at = np.linspace(0.0, 15.0, 4001)
    volume = np.trapezoid(0.25 * np.pi * one.diameter_at(at) ** 2, at)
    heights, radii = stem_rings(one)
    frusta = np.sum(np.pi * np.diff(heights) / 3.0 * (radii[1:] ** 2 + radii[1:] * radii[:-1] + radii[:-1] ** 2))
    assert frusta == pytest.approx(volume, rel=0.02)  # chords of the curve between ten rings
    lateral = np.sum(np.pi * (radii[1:] + radii[:-1]) * np.hypot(np.diff(heights), np.diff(radii)))
    # a decagon of the circle's area is 1.7 % longer around
    assert solid(made).area_faces[above_ground].sum() == pytest.approx(lateral, rel=0.02)


@pytest.mark.parametrize("species", SPECIES)
def test_foliage_has_the_area_of_its_function_within_its_crown(species):
    one = tree(species, diameter=0.24, height=18.0)
    leaves = foliage(one)
    assert len(leaves.faces) <= MOST_LEAVES
    area = SPECIES[species].foliage_area(0.24, 18.0)
    assert solid(leaves).area == pytest.approx(area, rel=1e-9)
    middles = leaves.vertices[leaves.faces].mean(axis=1)
    share = (middles[:, 2] - 8.0) / 10.0
    assert (share >= 0.0).all() and (share <= 1.0).all()
    assert (np.hypot(*middles[:, :2].T) <= 1.7 * crown_profile(species, share) + 1e-9).all()
    normals = solid(leaves).face_normals
    # of planes of random direction, the mean of |n z| is 1/2, whose standard error is sqrt(1/12/N)
    assert np.abs(normals[:, 2]).mean() == pytest.approx(0.5, abs=4.0 * np.sqrt(1.0 / 12.0 / len(normals)))


def test_light_gets_through_crowns_as_beer_and_lamberts_law_says():
    one = tree("pine", diameter=0.2, height=15.0, crown_radius=3.0)
    hits, expected = [], []
    for shape in range(40):
        leaves = foliage(tree("pine", diameter=0.2, height=15.0, crown_radius=3.0, shape=shape))
        corners = leaves.vertices[leaves.faces][:, :, :2]
        ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        # mean number of triangles over a square metre of the crown's plan
        plan = 0.5 * np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
        hits.append(plan.sum() / (np.pi * 3.0**2))
    expected = 0.5 * SPECIES["pine"].foliage_area(one.diameter, one.height) / (np.pi * 3.0**2)
    assert np.mean(hits) == pytest.approx(expected, abs=4.0 * np.std(hits) / np.sqrt(40.0))


def test_boulders_are_closed_and_within_their_half_axes():
    boulder = Boulder((1.0, 2.0, 3.0), upright(0.0, 0.0, 0.6), (0.9, 0.6, 0.4), 0.5, 11)
    made = mesh(boulder)
    shape = solid(made)
    assert shape.is_watertight and shape.is_winding_consistent
    own = (made.vertices - boulder.position) @ matrix(boulder.rotation) / boulder.half_axes
    reach = np.linalg.norm(own, axis=1)
    assert reach.max() <= 1.0 + 1e-12
    assert reach.min() >= 1.0 - 2.0 * BUMPS
    top = made.surfaces == Surface.MOSSY_ROCK
    assert top.any() and (shape.face_normals[top, 2] > 0.5).all()
    again = mesh(boulder)
    np.testing.assert_array_equal(again.vertices, made.vertices)
    assert not np.array_equal(
        mesh(Boulder((1.0, 2.0, 3.0), boulder.rotation, (0.9, 0.6, 0.4), 0.5, 12)).vertices, made.vertices
    )


def test_stumps_end_in_a_sawn_face():
    stump = Stump((0.0, 0.0, 2.0), upright(), "spruce", 0.2, 0.3)
    made = mesh(stump)
    cut = made.surfaces == Surface.END_GRAIN
    assert solid(made).area_faces[cut].sum() == pytest.approx(np.pi * 0.2**2)
    assert solid(made).face_normals[cut, 2].min() == pytest.approx(1.0)
    assert made.vertices[:, 2].max() == pytest.approx(2.3)


def test_bare_birches_and_needles():
    birch = tree("birch")
    assert FOLIAGE["birch"] in mesh(birch).surfaces
    assert FOLIAGE["birch"] not in mesh(birch, leaves=False).surfaces
    assert FOLIAGE["spruce"] in mesh(tree("spruce"), leaves=False).surfaces


def test_branches_are_thin():
    made = mesh(Branch(ORIGIN, along((0.0, 1.0, 0.0)), "pine", 2.0, 0.02))
    assert len(made.faces) < 30
    assert made.vertices[:, 1].max() == pytest.approx(2.0)
