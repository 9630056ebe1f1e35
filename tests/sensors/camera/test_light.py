"""Radiance against closed forms: Lambert's law, the sky's irradiance, Koschmieder's air; shadows beside Embree's."""

from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from aoro_gym.sensors.camera import Appearance, CameraModel, Intrinsics, StereoCamera, daylight
from aoro_gym.sensors.camera.light import Light
from aoro_gym.sensors.lidar import Motion, Mounting, Weather
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.sensors.raytrace.standing import forest_scene
from aoro_gym.terrains.generate.forest import forest

SMALL = CameraModel("small", Intrinsics.of_view(48, 36, 60.0), line_time=0.0)
DOWN = Mounting(position=(0.0, 0.0, 0.0), angles_deg=(0.0, 90.0, 0.0))
ROUND = 1e-5
"""Float32 through a hundred operations."""


def floor(half: float = 2000.0, height: float = 0.0) -> Scene:
    corners = [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    return Scene(corners, [[0, 1, 2], [0, 2, 3]])


def looking_down(scene: Scene, albedo: Any, light: Light, **options: Any) -> StereoCamera:
    return StereoCamera(scene, Appearance.plain(albedo), light, SMALL, mounting=DOWN, **options)


@pytest.mark.parametrize("cloud", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("hour", [6.0, 12.0])
def test_a_level_plane_sends_back_what_lambert_says(cloud, hour):
    """ρ E / π in every band. The mean of 48 · 36 · 64 rays to the sky is off by its deviation over 332, below 0.5 % as the
    sky's radiance deviates by less than 1.5 times its mean."""
    light = daylight("summer", hour=hour, cloud=cloud)
    albedo = np.array([0.5, 0.3, 0.1])
    camera = looking_down(floor(), [albedo], light, samples=8, sky_rays=8, smoothing=0)
    seen = camera.radiance(Motion.still([0.0, 0.0, 3.0]))[0]
    expected = albedo * light.total / np.pi
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), expected, rtol=0.005)
    sunless = albedo * light.diffuse / np.pi
    if cloud == 1.0:
        np.testing.assert_allclose(expected, sunless, rtol=1e-12)


def test_only_the_sun_lights_a_plane_exactly():
    """Without a sky every pixel is ρ E cos θ / π, to float32."""
    light = daylight("summer", hour=15.0)
    none = np.zeros(3)
    sun = Light(
        light.towards_sun, light.sunlight, none + 1e-9, none + 1e-9, none, light.molecule_depth, light.aerosol_depth
    )
    seen = looking_down(floor(), [0.18], sun, samples=1, sky_rays=1).radiance(Motion.still([0.0, 0.0, 3.0]))[0]
    expected = 0.18 * light.sunlight * light.towards_sun[2] / np.pi
    np.testing.assert_allclose(seen, np.broadcast_to(expected, seen.shape), rtol=10 * ROUND)


def test_the_sky_sends_the_irradiance_that_the_model_gives():
    """The device's radiance, summed over the sky by a grid finer than the host's own one."""
    light = daylight("autumn", hour=14.0, cloud=0.3)
    up = CameraModel("up", Intrinsics.of_view(400, 400, 160.0), reach=1.0)
    camera = StereoCamera(
        floor(5.0, -50.0),
        Appearance.plain([0.0]),
        light,
        up,
        mounting=Mounting(position=(0.0, 0.0, 0.0), angles_deg=(0.0, -90.0, 0.0)),
        samples=1,
    )
    seen = camera.radiance(Motion.still([0.0, 0.0, 0.0]))[0].astype(float)
    (fx, fy), (cx, cy) = up.intrinsics.focal, up.intrinsics.centre
    u, v = np.meshgrid(np.arange(400), np.arange(400))
    x, y = (u - cx) / fx, (v - cy) / fy
    cosine = 1.0 / np.sqrt(1.0 + x**2 + y**2)
    weight = cosine**4 / (fx * fy)  # cosine of the angle of incidence times solid angle
    sun = (seen.max(axis=2) > 1e4)[..., None]
    got = (np.where(sun, 0.0, seen) * weight[..., None]).sum(axis=(0, 1))
    # the picture ends at 80° to its sides: the rim that is missing sends sin² 80° to 1 of an even sky's irradiance, 3 %, and
    # the horizon is up to five times as bright as the mean
    assert (got < light.diffuse * 1.01).all() and (got > light.diffuse * 0.85).all()


def test_air_dims_and_adds_as_koschmieder_says():
    """A black plane and a white one at two distances: L exp(-σ d) + A (1 - exp(-σ d))."""
    weather = Weather.fog(50.0, 550.0)
    light = daylight("summer", hour=12.0, cloud=1.0)
    means = {}
    for height in (5.0, 60.0):
        for albedo in (0.0, 0.6):
            camera = looking_down(floor(), [albedo], light, samples=4, sky_rays=16, weather=weather)
            means[height, albedo] = camera.radiance(Motion.still([0.0, 0.0, height]))[0][16:20, 22:26].mean(axis=(0, 1))
    share = {height: np.exp(-weather.extinction * height) for height in (5.0, 60.0)}
    air = means[5.0, 0.0] / (1.0 - share[5.0])  # black shows the air's own light alone
    np.testing.assert_allclose(
        means[60.0, 0.0], air * (1.0 - share[60.0]), rtol=0.005
    )  # the corners' ways are 0.3 % longer
    for height in (5.0, 60.0):
        lit = means[height, 0.6] - means[height, 0.0]
        np.testing.assert_allclose(lit, 0.6 * light.total / np.pi * share[height], rtol=0.02)  # 1024 rays


def test_a_red_wall_lights_a_grey_floor():
    """One bounce: what the wall takes of the sky it gives back in its colour."""
    light = daylight("summer", hour=15.0)  # from the west, which the wall faces
    wall = [[1.0, -99.0, 0.0], [1.0, 99.0, 0.0], [1.0, 99.0, 99.0], [1.0, -99.0, 99.0]]
    ground = [[-99.0, -99.0, 0.0], [99.0, -99.0, 0.0], [99.0, 99.0, 0.0], [-99.0, 99.0, 0.0]]
    scene = Scene(
        ground + wall,
        [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        face_class=np.array([0, 0, 1, 1]),
        face_instance=np.array([0, 0, 1, 1]),
        reflectance=[(0.3, 0.3)] * 2,
    )
    seen = []
    for colour in ((0.0, 0.0, 0.0), (0.6, 0.0, 0.0)):
        camera = looking_down(scene, [(0.3, 0.3, 0.3), colour], light, samples=4, sky_rays=16)
        seen.append(camera.radiance(Motion.still([0.0, 0.0, 1.0]))[0].mean(axis=(0, 1)))
    gained = (seen[1] - seen[0]) / seen[0]
    assert gained[0] > 0.05 and np.abs(gained[1:]).max() < ROUND * 10


def test_shadow_rays_equal_embrees():
    """From the same places on a forest of cones, towards the same sun; where they differ the ray passes an edge."""
    scene: Any = forest_scene(forest(3, size=(60.0, 60.0)))
    light = daylight("summer", hour=20.0)
    model = CameraModel("mast", Intrinsics.of_view(160, 120, 80.0))
    camera = StereoCamera(
        scene,
        Appearance.plain(np.full(3, 0.2)),
        light,
        model,
        samples=1,
        sky_rays=1,
        mounting=Mounting((0.0, 0.0, 0.0)),
    )
    motion = Motion.still([0.0, 0.0, 12.0], pitch=0.6)
    [[left, _]] = camera.take(motion)
    pixel = np.stack(np.meshgrid(np.arange(160), np.arange(120)), axis=-1).reshape(-1, 2)
    seen = np.isfinite(left.depth).ravel()
    (fx, fy), (cx, cy) = model.intrinsics.focal, model.intrinsics.centre
    ahead = np.column_stack([(pixel[:, 0] - cx) / fx, (pixel[:, 1] - cy) / fy, np.ones(len(pixel))])[seen]
    place = _to_world(camera, motion, ahead * left.depth.ravel()[seen, None])
    normal = _to_world(camera, motion, left.normals.reshape(-1, 3)[seen]) - _to_world(camera, motion, np.zeros((1, 3)))
    facing = normal @ light.towards_sun > 1e-3
    origins = (place + 1e-3 * normal)[facing]
    mesh = trimesh.Trimesh(scene.mesh.points.numpy(), scene.mesh.indices.numpy().reshape(-1, 3), process=False)
    towards = np.tile(light.towards_sun, (len(origins), 1))
    theirs = ~RayMeshIntersector(mesh, scale_to_box=False).intersects_any(origins, towards)
    ours = left.sunlit.ravel()[seen][facing]
    assert 0.1 < theirs.mean() < 0.9 and len(ours) > 5000
    # a place is float32 at 30 m, 2 µm: rays that pass edges so closely are some of ten thousand
    assert (ours == theirs).mean() >= 0.999
    assert not left.sunlit.ravel()[seen][normal @ light.towards_sun < -1e-3].any()


def _to_world(camera: StereoCamera, motion: Motion, points: np.ndarray) -> np.ndarray:
    import warp as wp

    pose = wp.transform(*map(float, motion.poses[0, 0])) * camera.pose()
    turn = np.array(wp.quat_to_matrix(wp.transform_get_rotation(pose))).reshape(3, 3)
    return points @ turn.T + np.array(wp.transform_get_translation(pose))
