"""Electrons, their noise, the converter and the colours of a screen against closed forms."""

import numpy as np
import pytest

from aoro_gym.sensors.camera import Appearance, CameraModel, Intrinsics, SensorModel, StereoCamera, daylight
from aoro_gym.sensors.camera.film import developed, metered, white_balance
from aoro_gym.sensors.lidar import Motion, Mounting
from aoro_gym.sensors.raytrace import Scene

NOON = daylight("summer", hour=12.0, cloud=1.0)


def numbers(exposure: float, albedo: float = 0.2, **options) -> tuple[np.ndarray, np.ndarray, SensorModel]:
    """Numbers of an even surface, and the electrons that its light makes."""
    model = CameraModel("even", Intrinsics.of_view(160, 120, 20.0))
    scene = Scene([[-999, -999, 0], [999, -999, 0], [999, 999, 0], [-999, 999, 0]], [[0, 1, 2], [0, 2, 3]])
    camera = StereoCamera(
        scene,
        Appearance.plain([albedo]),
        NOON,
        model,
        mounting=Mounting(position=(0.0, 0.0, 0.0), angles_deg=(0.0, 90.0, 0.0)),
        exposure=exposure,
        samples=8,
        sky_rays=8,
        smoothing=6,
        **options,
    )
    [[left, _]] = camera.take(Motion.still([0.0, 0.0, 5.0]))
    electrons = albedo * NOON.total / np.pi * model.sensor.electrons(exposure)
    return left.numbers.astype(float), electrons, model.sensor


@pytest.mark.parametrize("exposure", [2e-6, 2e-4])
def test_noise_is_poissons_and_the_darks(exposure):
    """Variance = mean + dark noise² + step² / 12 (EMVA 1288), within five deviations of a variance of 19,200 pixels, 5 %.

    The light itself differs between pixels by what 1600 rays and the smoothing leave of it: below 0.4 % of the mean, whose
    square is small beside the electrons' own variance.
    """
    seen, electrons, sensor = numbers(exposure)
    for band in range(3):
        found = (seen[..., band] - sensor.black) * sensor.step
        assert found.mean() == pytest.approx(electrons[band], rel=0.005, abs=0.2)
        expected = electrons[band] + sensor.dark_noise**2 + sensor.step**2 / 12.0
        assert found.var() == pytest.approx(expected, rel=0.05)


def test_a_full_pixel_holds_no_more():
    seen, electrons, sensor = numbers(5e-2)
    assert (electrons > sensor.full_well).all()
    assert abs((seen - sensor.black).mean() * sensor.step - sensor.full_well) < 3.0 * sensor.dark_noise
    assert seen.max() <= sensor.most


def test_an_ideal_camera_has_no_noise_and_seeds_differ_otherwise():
    ideal = [numbers(2e-4, ideal=True, seed=7)[0] for _ in range(2)]
    np.testing.assert_array_equal(ideal[0], ideal[1])
    noisy = [numbers(2e-4, seed=seed)[0] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(noisy[0], noisy[1])
    assert (noisy[0] != noisy[2]).mean() > 0.5


def test_the_left_picture_alone_is_that_of_the_pair():
    scene = Scene([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], [[0, 1, 2], [0, 2, 3]])
    model = CameraModel("small", Intrinsics.of_view(32, 24, 60.0))
    camera = StereoCamera(scene, Appearance.plain([0.2]), NOON, model, samples=1, seed=5)
    motion = Motion.still([0.0, 0.0, 0.0])
    [[left, right]] = camera.take(motion, number=2)
    [alone] = camera.take_left(motion, number=2)
    assert np.array_equal(alone.rgb, left.rgb) and np.array_equal(alone.depth, left.depth)
    assert alone.exposure == left.exposure and not np.array_equal(alone.rgb, right.rgb)
    with pytest.raises(ValueError, match="the left camera"):
        camera.take_left(Motion.still([0.0, 0.0, -9.0]))


def test_white_is_white_and_grey_is_118():
    """sRGB's curve takes 18 % of white to 118 of 255 (IEC 61966-2-1)."""
    sensor = SensorModel()
    gains = white_balance(sensor, NOON)
    electrons = NOON.total / np.pi * sensor.electrons(1.0)
    white = electrons / (electrons * gains).max()
    assert developed(sensor, sensor.black + (sensor.most - sensor.black) * white, gains).tolist() == [255] * 3
    assert developed(sensor, sensor.black + (sensor.most - sensor.black) * 0.18 * white, gains).tolist() == [118] * 3


def test_exposure_follows_the_light():
    sensor = SensorModel()
    even = np.full((20, 20, 3), 4.0)
    exposure = metered(sensor, even, (1e-6, 1.0))
    assert metered(sensor, 10.0 * even, (1e-6, 1.0)) == pytest.approx(0.1 * exposure)
    assert metered(sensor, 1e-9 * even, (1e-6, 1e-2)) == 1e-2
    assert metered(sensor, 0.0 * even, (1e-6, 1e-2)) == 1e-2


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [("bits", 3, "bits is 3"), ("f_number", 0.0, "f_number is 0"), ("efficiency", (2.0, 0.5, 0.5), "efficiency")],
)
def test_wrong_sensors_are_refused(field, value, message):
    with pytest.raises(ValueError, match=message):
        SensorModel(**{field: value})
