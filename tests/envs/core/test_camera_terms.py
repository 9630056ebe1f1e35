"""Terms of cameras: depths beside a closed form and beside the camera itself, noise, age, and the same by every way."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aoro_gym import Plane
from aoro_gym.envs.core.camera_terms import camera, depth, look_of
from aoro_gym.envs.core.ray_scenes import scene_of
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.sensors.camera import CameraModel, StereoCamera, daylight
from aoro_gym.sensors.lidar import Motion, Mounting
from tests.envs.core.test_ray_terms import COURSES, DRIVE, LEVEL, driven, made, poses, shown

LOW = Mounting(position=(1.0, 0.0, 2.0), angles_deg=(0.0, 20.0, 0.0))
SMALL: dict[str, Any] = {"width": 16, "height": 12, "latency": 0.0, "mounting": LOW}


def of_recorded(env: Any, row: int) -> Motion:
    return Motion.still(
        [env.output(name)[row] for name in ("position_x", "position_y", "position_z")],
        **{name: float(env.output(name)[row]) for name in ("roll", "pitch", "yaw")},
    )


def test_depths_of_level_ground_are_a_closed_form():
    """Height over the ray's fall a metre of depth, by the machine's pose; a fall is 0.04 at least, so float32 keeps 1e-4."""
    env = made(3, {"depth": depth(max_depth=50.0, **SMALL)}, courses=[Course(Plane(), LEVEL.paths)])
    observation, _ = env.reset(seed=2)
    view = env.task.observation_terms["depth"].function
    (fx, fy), (cx, cy) = view.lens.focal, view.lens.centre
    u, v = np.meshgrid(np.arange(16), np.arange(12))
    tilt = Rotation.from_euler("y", 20.0, degrees=True)
    ahead = tilt.apply(np.stack([np.ones(u.size), -(u.ravel() - cx) / fx, -(v.ravel() - cy) / fy], axis=1))
    for pose, seen in zip(poses(env), shown(env, "depth", observation), strict=True):
        turn = Rotation.from_quat(pose[3:])
        height = pose[2] + turn.apply(LOW.position)[2]
        fall = -turn.apply(ahead)[:, 2]
        expected = np.where(fall > height / 50.0, height / np.maximum(fall, 1e-9), 50.0)
        assert (expected < 15.0).sum() > 100
        np.testing.assert_allclose(seen, expected, rtol=1e-4)


def test_depths_are_the_cameras():
    """Of ground and trees: the sensor's own truth at the recorded pose is the oracle."""
    env = made(2, {"depth": depth(max_depth=30.0, **SMALL)})
    env.reset(seed=3)
    for _ in range(10):
        observation, *_ = env.step(np.tile(DRIVE, (2, 1)))
    view = env.task.observation_terms["depth"].function
    for row, ground in enumerate(env.task._course):
        surroundings = COURSES[ground].surroundings
        scene = scene_of(surroundings, "cpu")
        model = CameraModel("small", view.lens, reach=1000.0)
        sensor = StereoCamera(
            scene, look_of(surroundings, "summer"), daylight(), model, mounting=LOW, undergrowth=False
        )
        truth = np.minimum(sensor.truth(of_recorded(env, row))["depth"][0], 30.0).ravel()
        seen = shown(env, "depth", observation)[row]
        close = np.isclose(seen, truth, rtol=1e-3, atol=1e-3)  # angles are rounded to float32
        assert close.mean() > 0.98 and np.ptp(truth) > 5.0  # but for edges


def test_noise_is_the_disparitys():
    """Depth² / (f b) times its deviation, of 3 x 192 pixels within four deviations of a deviation."""
    terms = {"depth": depth(max_depth=50.0, **SMALL), "noisy": depth(max_depth=50.0, noise=0.02, **SMALL)}
    env = made(3, terms, courses=[Course(Plane(), LEVEL.paths)])
    observation, _ = env.reset(seed=2)
    true, noisy = (shown(env, name, observation) for name in terms)
    near = true < 6.0
    focal = env.task.observation_terms["depth"].function.lens.focal[0]
    scaled = (noisy - true)[near] * focal * 0.12 / true[near] ** 2 / 0.02
    assert near.sum() > 200 and np.std(scaled) == pytest.approx(1.0, rel=4.0 / math.sqrt(2 * near.sum()) + 0.05)


def test_colours_are_those_of_the_light():
    """Level asphalt in even light: its albedo over white's 1, times the brightness, by the square root. A tenth is what the
    stones of its texture and two rays to the sky of 400 pixels leave of the mean."""
    light = daylight("summer", hour=12.0, cloud=1.0)
    env = made(1, {"camera": camera(light=light, sky_rays=8, **SMALL)}, courses=[Course(Plane(), LEVEL.paths)])
    observation, _ = env.reset(seed=0)
    seen = shown(env, "camera", observation).reshape(12, 16, 3)
    assert (seen**2)[6:].mean() == pytest.approx(0.1 * 2.0, rel=0.1)
    assert np.ptp((seen[6:] ** 2).mean(axis=(0, 1))) < 0.02  # grey


@pytest.mark.parametrize("name", ["depth", "camera"])
def test_both_ways_to_make_a_step_show_the_same_and_late(name):
    make = {"depth": depth, "camera": camera}[name]
    late = {**SMALL, "latency": 0.1}
    runs = [
        driven(made(2, {name: make(**settings)}, kernels=kernels), 5)
        for settings, kernels in ((SMALL, True), (SMALL, False), (late, True))
    ]
    for a, b in zip(runs[0], runs[1], strict=True):
        np.testing.assert_array_equal(a, b)
    if name == "depth":  # colours have other rays to the sky each step
        for step in range(2, 6):
            np.testing.assert_allclose(runs[2][step], runs[0][step - 2], atol=1e-4)


def test_they_are_asked_for_by_name():
    env = made(1, {"depth": True, "camera": True})
    observation, _ = env.reset(seed=0)
    assert shown(env, "depth", observation).shape == (1, 64 * 48)
    assert shown(env, "camera", observation).shape == (1, 64 * 48 * 3)
    assert env.observation_space.contains(observation)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: depth(width=1), "width is 1"),
        (lambda: depth(max_depth=0.0), "max_depth is 0 m"),
        (lambda: depth(width=1000, height=1000), "number of the picture's pixels is .*take fewer"),
        (lambda: camera(sky_rays=0), "sky_rays is 0"),
        (lambda: camera(brightness=-1.0), "brightness is -1"),
        (lambda: camera(noise=-1.0), "noise is -1"),
    ],
)
def test_what_cannot_be_is_said(make, message):
    with pytest.raises(ValueError, match=message):
        make()
