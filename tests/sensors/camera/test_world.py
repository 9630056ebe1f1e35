"""A made forest before a camera: crowns of the same foliage, undergrowth by Beer and Lambert, textures within bounds."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.sensors.camera import (
    UNDERGROWTH,
    Appearance,
    CameraModel,
    Intrinsics,
    Request,
    StereoCamera,
    daylight,
    take_together,
)
from aoro_gym.sensors.camera.kernels.surfaces import Look, see
from aoro_gym.sensors.camera.picture import LAYERS
from aoro_gym.sensors.lidar import CLEAR, Motion, Mounting, Weather
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.sensors.raytrace.device import Rays
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.crowns import FILLED, crown
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Tree, upright
from aoro_gym.terrains.world.species import SPECIES
from aoro_gym.terrains.world.world import Undergrowth, World

SMALL = CameraModel("small", Intrinsics.of_view(96, 72, 75.0))


@wp.kernel(enable_backward=False)
def look_through(  # type: ignore[no-untyped-def]
    rays: Rays,  # type: ignore[valid-type]
    look: Look,  # type: ignore[valid-type]
    origins: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
    directions: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
    instance: wp.array(dtype=int),  # type: ignore[valid-type]
    distance: wp.array(dtype=float),  # type: ignore[valid-type]
):
    i = wp.tid()
    seen = see(rays, look, origins[i], directions[i], 100.0, 0)
    instance[i] = seen.hit.instance
    distance[i] = seen.hit.distance


def seen_through(scene: Scene, appearance: Appearance, origins, directions) -> tuple[np.ndarray, np.ndarray]:
    count = len(origins)
    look = appearance.on_device(scene, undergrowth=True)
    kinds: Any = (wp.int32, wp.float32)
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in kinds]
    given = [wp.array(part, dtype=wp.vec3, device="cpu") for part in (origins, directions)]
    wp.launch(look_through, dim=count, inputs=[scene.data, look, *given], outputs=out, device="cpu")
    return out[0].numpy(), out[1].numpy()


@pytest.mark.parametrize("species", sorted(SPECIES))
def test_a_fine_crown_has_the_foliage_of_its_tree(species):
    """Twigs' area, gaps taken off, is that of the functions, but for the spread of 0.5 to 1.5 of single twigs."""
    tree = Tree((0.0, 0.0, 0.0), upright(), species, 0.22, 18.0, 8.0, 1.6, 5)
    made = crown(tree)
    leaves = np.isin(made.surfaces, [Surface.PINE_NEEDLES, Surface.SPRUCE_NEEDLES, Surface.BIRCH_LEAVES])
    a, b, c = made.vertices[made.faces[leaves]].transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() * FILLED[species]
    assert area == pytest.approx(SPECIES[species].foliage_area(0.22, 18.0), rel=0.05)  # 2000 twigs: 29 % / 45
    assert np.abs(made.vertices[:, :2]).max() < 1.8 * 1.6 and made.vertices[:, 2].max() < 19.5


@pytest.mark.parametrize("species", sorted(SPECIES))
def test_gaps_of_twigs_leave_the_share_that_is_filled(species):
    """Rays at right angles at triangles: a share of ten thousand is off by 0.5 %."""
    tree = Tree((0.0, 0.0, 0.0), upright(), species, 0.22, 18.0, 8.0, 1.6, 5)
    made = crown(tree)
    kind = {"pine": Surface.PINE_NEEDLES, "spruce": Surface.SPRUCE_NEEDLES, "birch": Surface.BIRCH_LEAVES}[species]
    first = int(np.argmax(made.surfaces == kind))
    corners = made.vertices[made.faces[first]]
    scene = Scene(
        corners,
        [[0, 1, 2]],
        face_instance=np.array([1]),
        face_class=np.array([int(kind)]),
        reflectance=[(0.3, 0.3)] * 19,
    )
    scene.fine = True
    rng = np.random.default_rng(0)
    u, v = rng.random((2, 10_000))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    place = corners[0] + u[:, None] * (corners[1] - corners[0]) + v[:, None] * (corners[2] - corners[0])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    instance, _ = seen_through(scene, Appearance.of_surfaces(), place + normal, np.tile(-normal, (len(place), 1)))
    assert (instance == 1).mean() == pytest.approx(FILLED[species], abs=0.025)


def shrubs(density: float) -> Scene:
    flat = Terrain.from_heights(np.zeros((41, 41)), cell=1.0, corner=(-20.0, -20.0))
    grown = Undergrowth((-20.0, -20.0), 1.0, np.full((41, 41), 0.4), np.full((41, 41), density))
    return Scene.of_world(World(flat, (), None, grown))


@pytest.mark.parametrize("density", [1.0, 4.0])
@pytest.mark.parametrize("slope", [1.0, 0.4])
def test_undergrowth_lets_through_what_beer_and_lambert_say(density, slope):
    """exp(-u s / 2) for a layer of 0.4 m. Discs are 2 cm wide: two of one cube hide each other by u a, 2 % to 8 %, less than
    leaves in the law; and a share of 20,000 rays is off by 0.4 %."""
    scene = shrubs(density)
    rng = np.random.default_rng(0)
    origins = np.column_stack([rng.uniform(-5, 5, (20_000, 2)), np.full(20_000, 0.6)])
    turn = rng.uniform(0, 2 * np.pi, 20_000)
    level = np.sqrt(1 - slope**2)
    directions = np.column_stack([level * np.cos(turn), level * np.sin(turn), np.full(20_000, -slope)])
    instance, _ = seen_through(scene, Appearance.of_surfaces(), origins, directions)
    through = (instance == 0).mean()
    assert through == pytest.approx(np.exp(-0.5 * density * 0.4 / slope), abs=0.004 + 0.02 * density * 0.4 / slope)


def test_both_cameras_meet_the_same_leaf():
    """A leaf that one ray meets is met from elsewhere, too, unless another one is before it."""
    scene = shrubs(2.0)
    rng = np.random.default_rng(1)
    origins = np.column_stack([rng.uniform(-1, 1, (3000, 2)), np.full(3000, 1.5)])
    directions = np.column_stack([rng.normal(0, 0.4, (3000, 2)), np.full(3000, -1.0)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    instance, distance = seen_through(scene, Appearance.of_surfaces(), origins, directions)
    met = instance == UNDERGROWTH
    assert met.sum() > 200
    place = origins[met] + distance[met, None] * directions[met]
    other = origins[met] + [0.12, 0.0, 0.0]
    way = place - other
    far = np.linalg.norm(way, axis=1)
    again, at = seen_through(scene, Appearance.of_surfaces(), other, way / far[:, None])
    assert (at <= far + 2e-4).all()  # it is there, or something nearer; float32 at 2 m and the discs' slant
    assert (np.abs(at - far) < 2e-4).mean() > 0.7 and (again[np.abs(at - far) < 2e-4] == UNDERGROWTH).all()


@pytest.fixture(scope="module")
def made() -> tuple[World, Scene]:
    forest = world(3, size=(40.0, 40.0))
    return forest, Scene.of_world(forest, fine=True)


@pytest.mark.parametrize("season", ["spring", "summer", "autumn", "winter"])
def test_a_forest_in_every_season(made, season):
    forest, scene = made
    camera = StereoCamera(
        scene,
        Appearance.of_world(forest, season, wetness=0.5),
        daylight(season, hour=12.0),
        SMALL,
        samples=1,
        sky_rays=1,
        mounting=Mounting(position=(0.0, 0.0, 0.0)),
    )
    motion = Motion.still([0.0, 0.0, 4.0], yaw=0.7)
    [[left, right]] = camera.take(motion)
    for picture in (left, right):
        assert 20 < picture.rgb.mean() < 235 and picture.rgb.std() > 15
        trees = {n for n, one in enumerate(forest.objects, 1) if isinstance(one, Tree)}
        assert len(trees & set(np.unique(picture.instance).tolist())) > 5
        surfaces = set(np.unique(picture.class_id).tolist())
        assert (Surface.BIRCH_LEAVES in surfaces) <= (season != "winter")
    unit = np.linalg.norm(left.normals, axis=-1)
    assert np.abs(unit[left.instance != -1] - 1.0).max() < 1e-5 and (unit[left.instance == -1] == 0.0).all()
    again = camera.take(motion)[0].left
    np.testing.assert_array_equal(left.rgb, again.rgb)


def test_pictures_taken_together_are_those_taken_alone(made):
    """Of two scenes in other lights, one from a machine that moves: rays, exposures and noise are each picture's own."""
    forest, scene = made
    looks = Appearance.of_world(forest), Appearance.plain([0.3])
    scenes = scene, Scene([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], [[0, 1, 2], [0, 2, 3]])
    lights, weathers = (
        (daylight("summer", hour=12.0), daylight("autumn", hour=15.0, cloud=0.3)),
        (CLEAR, Weather.fog(80.0)),
    )
    time = np.linspace(0.0, 0.5, 6)
    driven = Motion(time, np.column_stack([2.0 * time, 0 * time, 0 * time + 3.0]), 0 * time, 0 * time, 0.3 * time)
    requests = [
        Request(
            StereoCamera(scenes[k], looks[k], lights[k], SMALL, samples=2, sky_rays=1, weather=weathers[k], seed=4 + k),
            (Motion.still([1.0, 2.0, 4.0], yaw=0.7), driven)[k],
            (None, 0.1)[k],
            number=k,
        )
        for k in (0, 1)
    ]
    together = take_together(requests)
    for one, found in zip(requests, together, strict=True):
        [pair] = one.camera.take(one.motion, start=one.start, number=one.number)
        for alone, [picture] in zip(pair, found, strict=True):
            assert picture.exposure == alone.exposure and picture.time == alone.time
            for name in ("rgb", "numbers", *LAYERS):
                np.testing.assert_array_equal(getattr(picture, name), getattr(alone, name))
    assert together[0][0][0].exposure != together[1][0][0].exposure
    other = StereoCamera(scenes[1], looks[1], lights[1], SMALL, samples=1)
    with pytest.raises(ValueError, match="take pictures together must be alike"):
        take_together([requests[0], Request(other, driven)])


def test_textures_keep_to_the_table_of_materials(made):
    """The mean albedo of a surface in a picture, by the light that an even sky sends, is the table's within a third."""
    forest, scene = made
    light = daylight("summer", hour=12.0, cloud=1.0)
    means = {}
    for textured in (True, False):
        look = Appearance.of_world(forest)
        if not textured:
            look = Appearance(look.albedo, np.full(len(look.albedo), -1, dtype=np.int32), look.poses)
        camera = StereoCamera(
            scene,
            look,
            light,
            SMALL,
            samples=2,
            sky_rays=2,
            undergrowth=False,
            mounting=Mounting(position=(0.0, 0.0, 0.0), angles_deg=(0.0, 50.0, 0.0)),
        )
        means[textured] = camera.radiance(Motion.still([0.0, 0.0, 5.0]))[0].mean(axis=(0, 1))
    np.testing.assert_allclose(means[True], means[False], rtol=0.35)


def test_wrong_input_is_refused(made):
    forest, scene = made
    look, light = Appearance.of_world(forest), daylight()
    with pytest.raises(ValueError, match="hour is 1 h, when the sun stands at"):
        daylight("winter", hour=1.0)
    with pytest.raises(ValueError, match="camera model is 'x'; choose one of"):
        StereoCamera(scene, look, light, "x")
    with pytest.raises(ValueError, match="the scene has 19 classes, but the appearance 2"):
        StereoCamera(scene, Appearance.plain([0.1, 0.2]), light)
    camera = StereoCamera(scene, look, light, SMALL, samples=1)
    with pytest.raises(ValueError, match=r"the left camera at .* lies inside the ground"):
        camera.take(Motion.still([0.0, 0.0, -9.0]))
    time = np.array([0.0, 0.05])
    with pytest.raises(ValueError, match="has to last until the next picture"):
        camera.take(Motion(time, np.array([[0.0, 0.0, 4.0]] * 2), 0 * time, 0 * time, 0 * time))
