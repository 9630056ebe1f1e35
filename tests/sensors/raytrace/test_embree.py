"""The caster beside Embree, through trimesh, on a lidar's view of a generated forest."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from aoro_gym.sensors.raytrace import Hits
from aoro_gym.sensors.raytrace.standing import TRUNK, forest_scene
from aoro_gym.terrains.generate.forest import PUBLISHED_SIZE, forest

RANGE = 50.0


@dataclass
class Views:
    """Both casters' views of one forest."""

    triangles: np.ndarray
    """(F, 3, 3) [m], as both hold them: in float32."""
    instance: np.ndarray
    """(F,)."""
    origins: np.ndarray
    directions: np.ndarray
    ours: Hits
    face: np.ndarray
    """(R,) that Embree met, -1: none."""
    distance: np.ndarray
    """(R,) [m] to the plane of Embree's face, in float64."""


@pytest.fixture(scope="module")
def views() -> Views:
    world: Any = forest_scene(forest(3, PUBLISHED_SIZE))
    vertices, faces = world.mesh.points.numpy(), world.mesh.indices.numpy().reshape(-1, 3)
    rng = np.random.default_rng(0)
    azimuth, elevation = np.meshgrid(np.arange(0, 360, 0.4), np.linspace(-22.5, 22.5, 64), indexing="ij")
    a, e = np.radians(azimuth.ravel()), np.radians(elevation.ravel())
    directions = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]).astype(np.float32)
    places = np.column_stack([rng.uniform(-10, 10, (4, 2)), np.full(4, 4.0)])
    origins = np.repeat(places, len(directions) // 4, axis=0).astype(np.float32)
    ours = world.cast(origins, directions, max_range=RANGE)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    face = RayMeshIntersector(mesh, scale_to_box=False).intersects_first(origins, directions)
    triangles = vertices.astype(np.float64)[faces]
    distance = planes_met(triangles, face, origins, directions)
    face = np.where(distance < RANGE, face, -1)
    return Views(triangles, world.data.face_instance.numpy(), origins, directions, ours, face, distance)


def planes_met(triangles, face, origins, directions) -> np.ndarray:
    """Distances [m] to the planes of the faces, by float64; infinite for face -1."""
    a, b, c = triangles[face].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    distance = ((a - origins) * normal).sum(axis=1) / (directions * normal).sum(axis=1)
    return np.where(face < 0, np.inf, distance)


def test_instances_are_equal(views):
    assert ((views.face >= 0) & (views.distance > 40.0)).sum() > 200
    ours, theirs = views.ours.instance, np.where(views.face < 0, -1, views.instance[views.face])
    assert len(np.unique(theirs)) > 30  # trees
    assert (views.ours.class_id == TRUNK).sum() > 100
    assert (ours == theirs).mean() >= 0.9999


def test_depths_are_equal(views):
    same = (views.face >= 0) & (views.face == views.ours.face)
    assert same.mean() > 0.3
    assert np.abs(views.ours.distance[same] - views.distance[same]).max() < 1e-3


def test_normals_are_equal(views):
    same = (views.face >= 0) & (views.face == views.ours.face)
    a, b, c = views.triangles[views.face[same]].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(normal, views.ours.normal[same]), axis=1)
    assert np.degrees(np.arcsin(sine.max())) < 0.1
    assert ((views.ours.normal[same] * views.directions[same]).sum(axis=1) < 0.0).all()


def test_where_faces_differ_the_ray_passes_an_edge(views):
    """Within what float32 leaves of a place 50 m away: 8 roundings of a coordinate below 64 m, 30 µm."""
    differ = np.flatnonzero(views.face != views.ours.face)
    for ray in differ:
        face = views.face[ray] if views.face[ray] >= 0 else views.ours.face[ray]
        distance = planes_met(views.triangles, np.array([face]), views.origins[ray], views.directions[ray])[0]
        place = views.origins[ray] + distance * views.directions[ray].astype(np.float64)
        corners = views.triangles[face]
        along = np.roll(corners, -1, axis=0) - corners
        share = np.clip(((place - corners) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        off = np.linalg.norm(place - corners - share[:, None] * along, axis=1).min()
        assert off < 8 * 64 * 2.0**-24 or abs(distance - RANGE) < 1e-4, (ray, off)
