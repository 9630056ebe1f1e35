"""Where things are drawn: projection beside numpy and OpenCV, disparity and flow beside geometry, calibration, shutters."""

from typing import Any, cast

import cv2
import numpy as np
import pytest
import warp as wp

from aoro_gym.sensors.camera import MODELS, Appearance, CameraModel, Intrinsics, StereoCamera, daylight
from aoro_gym.sensors.camera.kernels.lens import Lens, direction_of
from aoro_gym.sensors.lidar import Motion, Mounting
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.sensors.raytrace.standing import forest_scene
from aoro_gym.terrains.generate.forest import forest

WIDE = MODELS["stereo-wide"].intrinsics
AHEAD = Mounting(position=(0.0, 0.0, 0.0))
NOON = daylight("summer", hour=12.0)


@wp.kernel(enable_backward=False)
def directions(lens: Lens, pixels: wp.array(dtype=wp.vec2), out: wp.array(dtype=wp.vec3)):  # type: ignore[valid-type]
    i = wp.tid()
    out[i] = direction_of(lens, pixels[i][0], pixels[i][1])


def rays(lens: Intrinsics, pixels: np.ndarray) -> np.ndarray:
    vec2, vec3 = cast(Any, (wp.vec2, wp.vec3))
    out = wp.empty(len(pixels), dtype=vec3, device="cpu")
    inputs = [lens.on_device(), wp.array(pixels, dtype=vec2, device="cpu")]
    wp.launch(directions, dim=len(pixels), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


def grid(lens: Intrinsics, step: int = 16) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(0, lens.width, step), np.arange(0, lens.height, step)), -1).reshape(-1, 2)


def test_a_lens_draws_where_opencv_does():
    rng = np.random.default_rng(0)
    points = rng.uniform([-1.0, -0.7, 1.0], [1.0, 0.7, 3.0], (500, 3))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), WIDE.matrix, np.array(WIDE.distortion))
    np.testing.assert_allclose(WIDE.project(points), theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_a_pixels_ray_is_drawn_at_the_pixel(name):
    """Float32's 6e-8 of a slope up to 1.1, times 640 pixels and ten operations: a thousandth of a pixel."""
    lens = MODELS[name].intrinsics
    pixels = grid(lens)
    np.testing.assert_allclose(lens.project(rays(lens, pixels)), pixels, atol=1e-3)


def test_what_folds_is_refused():
    with pytest.raises(ValueError, match=r"folds the picture.*take weaker coefficients"):
        Intrinsics.of_view(640, 480, 95.0, distortion=(-0.6, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="distortion has 4 numbers"):
        Intrinsics.of_view(640, 480, 95.0, distortion=(0.0, 0.0, 0.0, 0.0))


def checkerboard(squares: tuple[int, int], edge: float, pose: np.ndarray) -> Scene:
    """Black and white squares on a white border, in a camera's axes by a (4, 4) pose, put before a camera at the origin."""
    columns, rows = squares
    vertices, faces, kinds = [], [], []
    for j in range(-1, rows + 1):
        for i in range(-1, columns + 1):
            inside = 0 <= i < columns and 0 <= j < rows
            corners = np.array([[i, j, 0], [i + 1, j, 0], [i + 1, j + 1, 0], [i, j + 1, 0]]) * edge
            faces += [[len(vertices) + k for k in three] for three in ((0, 2, 1), (0, 3, 2))]
            vertices += list((corners - 0.5 * edge * np.array([columns, rows, 0])) @ pose[:3, :3].T + pose[:3, 3])
            kinds += [int(inside and (i + j) % 2 == 0)] * 2
    x, y, z = np.array(vertices).T
    return Scene(
        np.column_stack([z, -x, 50.0 - y]),
        faces,
        face_class=np.array(kinds),
        face_instance=np.ones(len(faces), dtype=int),
        reflectance=[(0.3, 0.3)] * 2,
    )


def test_opencv_calibrates_a_checkerboard_back_to_the_intrinsics():
    """Within half a percent of the focal lengths, and half a percent of the width for the principal point.

    Twelve boards of 54 corners, each found within some hundredths of a pixel: the focal lengths are known to a few tenths
    of a pixel of 457 then.
    """
    lens = Intrinsics.of_view(640, 480, 70.0, distortion=(-0.1, 0.02, 5e-4, -4e-4, 0.0))
    model = CameraModel("calibrated", lens, baseline=0.1)
    inner, edge = (9, 6), 0.03
    board = np.zeros((inner[0] * inner[1], 3), dtype=np.float32)
    board[:, :2] = np.stack(np.meshgrid(np.arange(inner[0]), np.arange(inner[1])), axis=-1).reshape(-1, 2) * edge
    rng = np.random.default_rng(1)
    drawn = []
    for number in range(12):
        turn, _ = cv2.Rodrigues(np.radians(rng.uniform([-35, -35, -20], [35, 35, 20])))
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = [0.12 * (number % 4 - 1.5), 0.12 * (number // 4 - 1), rng.uniform(0.45, 0.7)]
        scene = checkerboard((inner[0] + 1, inner[1] + 1), edge, pose)
        camera = StereoCamera(
            scene,
            Appearance.plain([0.8, 0.05]),
            daylight("summer", hour=15.0, cloud=1.0),
            model,
            mounting=Mounting(position=(0.0, 0.0, 50.0)),
            samples=16,
            sky_rays=1,
            seed=number,
        )
        [[left, _]] = camera.take(Motion.still([0.0, 0.0, 0.0]))
        grey = cv2.cvtColor(left.rgb, cv2.COLOR_RGB2GRAY)
        found, corners = cv2.findChessboardCorners(grey, inner)
        if found:
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
            drawn.append(cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), stop))
    assert len(drawn) >= 9
    error, matrix, _, _, _ = cv2.calibrateCamera([board] * len(drawn), drawn, (640, 480), None, None)  # type: ignore[call-overload]
    assert error < 0.3  # [pixels]
    np.testing.assert_allclose([matrix[0, 0], matrix[1, 1]], lens.focal, rtol=0.005)
    np.testing.assert_allclose([matrix[0, 2], matrix[1, 2]], lens.centre, atol=0.005 * 640)


def camera_axes(camera: StereoCamera, motion: Motion, time: float, offset: float, places: np.ndarray) -> np.ndarray:
    """Places (N, 3) of the world in the axes of a camera at a time, by numpy."""
    position = np.array([np.interp(time, motion.time, motion.position[:, 0, k]) for k in range(3)])
    roll, pitch, yaw = (np.interp(time, motion.time, getattr(motion, name)[:, 0]) for name in ("roll", "pitch", "yaw"))
    c, s = np.cos, np.sin
    turn = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    turn = turn @ np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    turn = turn @ np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    p = (places - position) @ turn - np.array(camera.mounting.position)
    return np.column_stack([-p[:, 1] - offset, -p[:, 2], p[:, 0]])


def to_world(motion_turn: np.ndarray, position: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.column_stack([points[:, 2], -points[:, 0], -points[:, 1]]) @ motion_turn.T + position


@pytest.fixture(scope="module")
def trees() -> Scene:
    return forest_scene(forest(3, size=(60.0, 60.0)))


STRAIGHT, BENT = Intrinsics.of_view(160, 120, 75.0), Intrinsics.of_view(160, 120, 95.0, distortion=WIDE.distortion)


@pytest.mark.parametrize("lens", [STRAIGHT, BENT])
def test_disparity_is_where_the_right_camera_draws_a_place(trees, lens):
    """Left column less right column, distortion taken out, within a tenth of a pixel; the right picture has its depth."""
    model = CameraModel("pair", lens, baseline=0.4)
    camera = StereoCamera(trees, Appearance.plain(np.full(3, 0.2)), NOON, model, mounting=AHEAD, samples=1, sky_rays=1)
    motion = Motion.still([2.0, -3.0, 6.0])
    [[left, right]] = camera.take(motion)
    pixels = grid(lens, 3)
    depth = left.depth[pixels[:, 1], pixels[:, 0]].astype(float)
    keep = np.isfinite(depth) & (depth < 100.0)
    ahead = rays(lens, pixels[keep]).astype(float)
    place = ahead / ahead[:, 2:] * depth[keep, None]
    straight = Intrinsics(lens.width, lens.height, lens.focal, lens.centre)
    apart = straight.project(place)[:, 0] - straight.project(place - [model.baseline, 0.0, 0.0])[:, 0]
    told = left.disparity[pixels[keep, 1], pixels[keep, 0]]
    assert keep.sum() > 500 and np.abs(apart - told).max() < 0.1
    other = np.rint(lens.project(place - [model.baseline, 0.0, 0.0])).astype(int)
    inside = (other >= 0).all(axis=1) & (other < [lens.width, lens.height]).all(axis=1)
    theirs = right.depth[other[inside, 1], other[inside, 0]]
    # hidden places and pixels' edges aside, the right camera sees the same surface
    assert np.median(np.abs(theirs / depth[keep][inside] - 1.0)) < 0.01


@pytest.mark.parametrize("line_time", [0.0, 100e-6])
def test_flow_is_where_the_next_picture_draws_a_place(trees, line_time):
    """Within a tenth of a pixel of an own projection, for a machine that drives, turns and pitches; each row at its time."""
    lens = Intrinsics.of_view(160, 120, 80.0, distortion=(-0.08, 0.01, 2e-4, 1e-4, 0.0))
    model = CameraModel("driven", lens, rate=10.0, line_time=line_time)
    camera = StereoCamera(
        trees, Appearance.plain(np.full(3, 0.2)), NOON, model, mounting=AHEAD, samples=1, sky_rays=1, exposure=4e-3
    )
    time = np.linspace(0.0, 0.4, 401)
    way = np.column_stack([2.0 + 3.0 * time, -3.0 + 0.5 * time, 6.0 + 0.0 * time])
    motion = Motion(time, way, 0.1 * time, 0.3 * time, 0.4 * time)
    [[left, _]] = camera.take(motion, start=0.05)
    pixels = grid(lens, 3)
    depth = left.depth[pixels[:, 1], pixels[:, 0]].astype(float)
    keep = np.isfinite(depth) & (depth < 100.0)
    pixels, depth = pixels[keep], depth[keep]
    ahead = rays(lens, pixels).astype(float)
    point = ahead / ahead[:, 2:] * depth[:, None]
    flow = left.flow[pixels[:, 1], pixels[:, 0]]
    for index in range(0, len(pixels), 7):
        row = pixels[index, 1]
        at = 0.05 + line_time * row + 2e-3
        basis = np.array([camera_axes(camera, motion, at, 0.0, np.eye(3)[k : k + 1])[0] for k in range(3)])
        origin = camera_axes(camera, motion, at, 0.0, np.zeros((1, 3)))[0]
        place = np.linalg.solve((basis - origin).T, point[index] - origin)
        moved = pixels[index].astype(float)
        for _ in range(6):
            later = 0.05 + 0.1 + line_time * np.clip(moved[1], -1, lens.height) + 2e-3
            moved = lens.project(camera_axes(camera, motion, later, 0.0, place[None]))[0]
        assert np.abs(moved - pixels[index] - flow[index]).max() < 0.1, pixels[index]


def pole() -> Scene:
    """A thin white pole before a black wall; 5 m and 20 m ahead."""
    wall = [[20.0, 40.0, -40.0], [20.0, -40.0, -40.0], [20.0, -40.0, 40.0], [20.0, 40.0, 40.0]]
    thin = [[5.0, 0.05, -9.0], [5.0, -0.05, -9.0], [5.0, -0.05, 9.0], [5.0, 0.05, 9.0]]
    return Scene(
        np.array(wall + thin),
        [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
        face_class=np.array([0, 0, 1, 1]),
        face_instance=np.array([1, 1, 2, 2]),
        reflectance=[(0.3, 0.3)] * 2,
    )


def seen_pole(speed: float, exposure: float, line_time: float) -> np.ndarray:
    """(rows, columns) brightness of the pole while the camera moves to the left at a speed [m/s]."""
    lens = Intrinsics.of_view(128, 96, 60.0)
    model = CameraModel("moved", lens, line_time=line_time, rate=10.0)
    camera = StereoCamera(
        pole(),
        Appearance.plain([0.0, 0.9]),
        daylight("summer", hour=15.0, cloud=1.0),
        model,
        mounting=Mounting(position=(0.0, 0.0, 0.0)),
        exposure=exposure,
        samples=64,
        sky_rays=1,
    )
    time = np.array([0.0, 1.0])
    way = np.array([[0.0, 0.0, 0.0], [0.0, speed, 0.0]])
    return camera.radiance(Motion(time, way, 0 * time, 0 * time, 0 * time))[0, :, :, 1]


def test_motion_blurs_by_what_passes_in_an_exposure():
    """A pole 2.2 pixels wide is spread over speed · exposure / 5 m · fx pixels: 9 and 18; it loses no light on the way."""
    focal = Intrinsics.of_view(128, 96, 60.0).focal[0]
    columns = np.arange(128) - 63.5
    light = []
    for speed in (8.0, 16.0):
        row = seen_pole(speed, 0.05, 0.0)[40:56].mean(axis=0)
        light.append(row.sum())
        middle = (row * columns).sum() / row.sum()
        deviation = np.sqrt((row * (columns - middle) ** 2).sum() / row.sum())
        wide, moved = 0.1 * focal / 5.0, speed * 0.05 * focal / 5.0
        # uniform distributions: of the pole, of the pixel and of the motion; the machine's left is the picture's left
        assert deviation == pytest.approx(np.sqrt((wide**2 + 1.0 + moved**2) / 12.0), rel=0.02)
        assert middle == pytest.approx(0.5 * moved, abs=0.1)
    assert light[0] == pytest.approx(light[1], rel=0.02)


def test_a_rolling_shutter_shears_what_moves():
    """The pole leans by speed · line time / 5 m · fx pixels a row."""
    focal = Intrinsics.of_view(128, 96, 60.0).focal[0]
    seen = seen_pole(4.0, 1e-4, 500e-6)
    columns = np.arange(128) - 63.5
    middles = (seen * columns).sum(axis=1) / seen.sum(axis=1)
    slope = np.polyfit(np.arange(96), middles, 1)[0]
    assert slope == pytest.approx(4.0 * 500e-6 / 5.0 * focal, rel=0.03)
