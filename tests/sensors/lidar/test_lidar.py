"""A lidar against the range equation, the kinematics of its motion, and the statistics of its noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from aoro_gym.sensors.lidar import CLEAR, MODELS, Lidar, LidarModel, Motion, Mounting, Weather
from aoro_gym.sensors.lidar.lidar import NINE_OF_TEN, THRESHOLD_TO_NOISE, beam
from aoro_gym.sensors.raytrace import Scene

FLOAT = 2.0**-23
ORIGIN = Mounting(position=(0.0, 0.0, 0.0))
STANDING = Motion.still([0.0, 0.0, 2.0])


def wall(x: float, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Square across x from y = low to y = high, 40 m high about z = 0, that looks back."""
    corners = [[x, high, -20], [x, low, -20], [x, low, 20], [x, high, 20]]
    return np.array(corners, dtype=float), np.array([[0, 1, 2], [0, 2, 3]])


def walls(*places: tuple[float, float, float], reflectance=(0.3, 0.6)) -> Scene:
    parts = [wall(*place) for place in places]
    vertices = np.concatenate([part[0] for part in parts])
    faces = np.concatenate([part[1] + 4 * number for number, part in enumerate(parts)])
    instance = np.repeat(np.arange(len(parts)) + 1, 2)
    return Scene(vertices, faces, face_instance=instance, reflectance=[reflectance])


def floor(reflectance=(0.3, 0.6)) -> Scene:
    return Scene(
        [[-300, -300, 0], [300, -300, 0], [300, 300, 0], [-300, 300, 0]],
        [[0, 1, 2], [0, 2, 3]],
        reflectance=[reflectance],
    )


def moving(*parts) -> Motion:
    return Motion(*map(np.asarray, parts))


def one_way(**changes) -> LidarModel:
    """A lidar that looks straight on 4000 times."""
    given = {
        "name": "one way",
        "elevation_deg": (0.0,) * 4000,
        "columns": 1,
        "rate": 10.0,
        "range_10": 40.0,
        "max_range": 200.0,
        "min_range": 0.5,
        "noise": ((0.0, 0.02), (100.0, 0.06)),
        "divergence_deg": (0.2, 0.2),
        "wavelength_nm": 905.0,
        "azimuth_offset_deg": (180.0,),
    }
    return LidarModel(**{**given, **changes})


@pytest.mark.parametrize(("nm", "reflectance"), [(905.0, 0.3), (1550.0, 0.6)])
@pytest.mark.parametrize("weather", [CLEAR, Weather(extinction=0.02)])
def test_intensity_follows_the_range_equation(nm, reflectance, weather):
    model = one_way(elevation_deg=tuple(np.linspace(-60, -4, 100)), columns=36, wavelength_nm=nm, range_10=4000.0)
    [points] = Lidar(floor(), model, mounting=ORIGIN, subrays=1, ideal=True, weather=weather).sweep(STANDING)
    assert len(points) > 3000
    elevation = np.radians(np.array(model.elevation_deg))[points.ring]
    distance = -2.0 / np.sin(elevation)
    expected = reflectance * np.sin(-elevation) / distance**2 * np.exp(-2.0 * weather.extinction * distance)
    np.testing.assert_allclose(points.range, distance, atol=2e-6 + 20 * FLOAT * 30)
    # the cosine rounds by FLOAT, which 1 / sin(4 degrees) = 14 magnifies
    np.testing.assert_allclose(points.intensity, expected, rtol=20 * 14 * FLOAT)
    np.testing.assert_allclose(points.world[:, 2], 0.0, atol=20 * FLOAT * 30)


def test_near_surfaces_are_detected_by_the_share_of_the_beam_that_is_seen():
    # white, straight ahead: 1/R² times the share; the threshold is passed where the share reaches threshold R²
    model = one_way(overlap=(1.0, 5.0), range_10=4.0)
    for distance, seen in ((0.9, 0.0), (1.02, 0.005), (1.5, 0.125), (3.0, 0.5), (6.0, 1.0)):
        lidar = Lidar(
            walls((distance, -30.0, 30.0), reflectance=(1.0, 1.0)), model, mounting=ORIGIN, subrays=1, ideal=True
        )
        [points] = lidar.sweep(STANDING)
        detected = seen / distance**2 >= lidar.threshold
        assert len(points) == 4000 * detected, distance
        # what is reported is the range equation's, as makers calibrate it
        np.testing.assert_allclose(points.intensity, 1.0 / distance**2, rtol=20 * FLOAT)


def test_rings_are_the_makers():
    for name, rate in (("os1-64", 655_360), ("os1-128", 1_310_720), ("vlp-16", 300_000), ("mid-360", 200_000)):
        model = MODELS[name]
        firings = model.firings()
        assert len(firings.time) * model.rate == pytest.approx(rate, rel=0.04)
        assert (firings.time < 1.0 / model.rate + 1e-4).all() and (np.abs(firings.azimuth) <= np.pi).all()
    puck = MODELS["vlp-16"].firings()
    assert np.degrees(puck.elevation[:16]).round(6).tolist()[:4] == [-15, 1, -13, 3]
    assert puck.time[17] - puck.time[16] == pytest.approx(2.304e-6)
    assert puck.time[16] - puck.time[0] == pytest.approx(55.296e-6, rel=1e-3)


def test_a_rosette_fills_its_view_and_rings_do_not():
    def filled(name, sweeps):
        seen = np.zeros((360, 180), dtype=bool)
        for number in range(sweeps):
            firings = MODELS[name].firings(number)
            azimuth, elevation = np.degrees([firings.azimuth + np.pi, firings.elevation + np.pi / 2])
            seen[azimuth.astype(int) % 360, elevation.astype(int)] = True
        return int(seen.sum())

    assert filled("mid-360", 5) > 1.15 * filled("mid-360", 1)
    assert filled("mid-360", 10) > 0.97 * 360 * 59
    assert filled("vlp-16", 3) == filled("vlp-16", 1)


def test_motion_within_a_sweep():
    """A machine that drives on at 3 m/s, turning, before a wall: every pulse starts where the machine then is."""
    time = np.linspace(0.0, 0.2, 41)
    motion = Motion(time, np.column_stack([3.0 * time, 0 * time, 0 * time + 2.0]), 0 * time, 0 * time, 0.5 * time)
    model = one_way(elevation_deg=(0.0,), columns=3600, azimuth_offset_deg=(0.0,))
    lidar = Lidar(walls((20.0, -300.0, 300.0)), model, mounting=ORIGIN, subrays=1, ideal=True)
    [points] = lidar.sweep(motion, start=0.05)
    assert len(points) > 1000
    azimuth = np.arctan2(points.points[:, 1], points.points[:, 0])
    expected = (20.0 - 3.0 * (0.05 + points.time)) / np.cos(azimuth + 0.5 * (0.05 + points.time))
    # directions round by FLOAT, which tan of the incidence magnifies to the range over its cosine
    np.testing.assert_allclose(points.range, expected, atol=1e-6, rtol=8 * FLOAT * expected.max() / 20.0)
    np.testing.assert_allclose(points.world[:, 0], 20.0, atol=1e-3)
    with pytest.raises(ValueError, match=r"start is 0.15 s.*whole sweep"):
        lidar.sweep(motion, start=0.15)


def test_mounting_and_its_errors():
    off = Mounting(
        position=(1.0, 0.2, 2.0),
        angles_deg=(0.0, 10.0, 0.0),
        position_error=(0.0, 0.0, 0.1),
        angle_errors_deg=(0, 0, 2.0),
    )
    model = one_way(elevation_deg=(0.0,), columns=1, azimuth_offset_deg=(180.0,))
    [points] = Lidar(floor(), model, mounting=off, subrays=1, ideal=True).sweep(
        Motion.still([5.0, 0.0, 0.0], yaw=np.pi / 2)
    )
    distance = 2.1 / np.sin(np.radians(10.0))
    assert points.range[0] == pytest.approx(distance, rel=1e-5)
    flat = distance * np.cos(np.radians(10.0))
    ahead, left = 1.0 + flat * np.cos(np.radians(2.0)), 0.2 + flat * np.sin(np.radians(2.0))
    np.testing.assert_allclose(points.world[0], [5.0 - left, ahead, 0.0], atol=1e-4)


def test_noise_of_ranges():
    scene, model = walls((25.0, -300.0, 300.0)), one_way()
    [points] = Lidar(scene, model, mounting=ORIGIN, subrays=1).sweep(STANDING)
    assert len(points) == 4000
    spread = 0.02 + 0.25 * 0.04  # between 0 m and 100 m
    assert points.range.std() == pytest.approx(spread, rel=5.0 / np.sqrt(2 * 4000))
    assert points.range.mean() == pytest.approx(25.0, abs=5.0 * spread / np.sqrt(4000))
    steps = points.range / model.resolution
    np.testing.assert_allclose(steps, np.round(steps), atol=0.01)


def test_sweeps_are_repeatable():
    lidar = Lidar(walls((25.0, -300.0, 300.0)), one_way(), mounting=ORIGIN, seed=3)
    first, again, other = (lidar.sweep(STANDING, number=number)[0] for number in (4, 4, 5))
    np.testing.assert_array_equal(first.range, again.range)
    assert (first.range != other.range).mean() > 0.9
    correlation = np.corrcoef(first.range[:-1], first.range[1:])[0, 1]
    assert abs(correlation) < 5.0 / np.sqrt(4000)


@pytest.mark.parametrize(("distance", "share"), [(40.0, 0.9), (36.0, None), (50.0, None)])
def test_detection_limit(distance, share):
    scene, model = walls((distance, -300.0, 300.0), reflectance=(0.1, 0.1)), one_way()
    lidar = Lidar(scene, model, mounting=ORIGIN, subrays=1)
    [points] = lidar.sweep(STANDING)
    if share is None:
        level = (40.0 / distance) ** 2 * (1.0 + NINE_OF_TEN / THRESHOLD_TO_NOISE)
        share = float(stats.norm.cdf((level - 1.0) * THRESHOLD_TO_NOISE))
    assert len(points) / 4000 == pytest.approx(share, abs=5.0 * np.sqrt(share * (1 - share) / 4000) + 1e-9)


def test_first_strongest_and_last_at_an_edge():
    """A beam half on a board 10 m away, half on a wall at 20 m: the board is four times as strong."""
    scene = walls((10.0, 0.0, 30.0), (20.0, -300.0, 300.0))
    model = one_way(elevation_deg=(0.0,))
    lidar = Lidar(scene, model, mounting=ORIGIN, subrays=16, ideal=True, returns=["first", "last"])
    [points] = lidar.sweep(STANDING)
    assert points.instance.tolist() == [1, 2] and points.echo.tolist() == [1 | 2, 4]
    assert points.echoes.tolist() == [2, 2]
    np.testing.assert_allclose(points.range, [10.0, 20.0], atol=1e-4)
    shares = points.intensity / (0.3 / points.range**2)
    assert shares.sum() == pytest.approx(1.0, rel=1e-4)
    assert shares[0] == pytest.approx(0.5, abs=1.5 / 16)
    [strongest] = Lidar(scene, model, mounting=ORIGIN, subrays=16, ideal=True).sweep(STANDING)
    assert strongest.instance.tolist() == [1]


def test_echoes_within_a_pulse_are_one():
    scene = walls((10.0, 0.0, 30.0), (10.4, -300.0, 300.0))  # a pulse of 5 ns is 0.75 m long
    model = one_way(elevation_deg=(0.0,))
    [points] = Lidar(scene, model, mounting=ORIGIN, subrays=16, ideal=True, returns=["first", "last"]).sweep(STANDING)
    assert points.echoes.tolist() == [1] and points.echo.tolist() == [7]
    left = (np.tan(beam(model, 16)[:, 0]) > 0).mean()
    near, far = left / 10.0**2, (1 - left) / 10.4**2
    assert points.range[0] == pytest.approx((10.0 * near + 10.4 * far) / (near + far), abs=1e-3)


@pytest.mark.parametrize("subrays", [1, 2, 5, 16])
def test_sub_rays_share_the_beam(subrays):
    model = one_way(divergence_deg=(0.4, 0.1))
    spread = np.degrees(beam(model, subrays)) / [0.4, 0.1]
    within = (np.hypot(*spread.T) <= 0.5).mean()  # half of a Gaussian beam's energy is within half its width
    assert within == pytest.approx(0.5, abs=0.5 / subrays + 1e-9)


def test_fog_dims_and_answers():
    fog = Weather.fog(50.0)
    assert fog.extinction == pytest.approx(3.912 / 50.0)
    model = one_way()
    lidar = Lidar(walls((150.0, -300.0, 300.0)), model, mounting=ORIGIN, subrays=1, ideal=True, weather=fog)
    [points] = lidar.sweep(STANDING)
    assert len(points) == 4000 and (points.instance == -2).all() and (points.class_id == 255).all()
    # smooth: the nearest gate is the strongest, by π β L / R² exp(-2 α R) at its middle
    middle = model.min_range + 0.5 * model.gate
    expected = np.pi * fog.backscatter * model.gate / middle**2 * np.exp(-2.0 * fog.extinction * middle)
    drops = fog.number * model.gate * np.pi / 4 * np.radians(0.2) ** 2 * middle**2
    assert points.intensity.mean() == pytest.approx(expected, rel=5.0 / np.sqrt(drops * 4000) + 1e-4)
    assert (np.abs(points.range - middle) <= 0.5 * model.gate + 1e-5).all()


@pytest.mark.parametrize("overlap", [(0.0, 0.0), (0.5, 5.0), (2.0, 12.0)])
def test_the_strongest_echo_of_fog_is_where_the_receiver_sees_most_of_it(overlap):
    fog = Weather.fog(60.0)
    model = one_way(overlap=overlap)
    lidar = Lidar(walls((150.0, -300.0, 300.0)), model, mounting=ORIGIN, subrays=1, ideal=True, weather=fog)
    [points] = lidar.sweep(STANDING)
    middle = model.min_range + model.gate * (np.arange(60) + 0.5)
    power = np.pi * fog.backscatter * model.gate / middle**2 * np.exp(-2.0 * fog.extinction * middle)
    share = np.clip((middle - overlap[0]) / max(overlap[1] - overlap[0], 1e-9), 0.0, 1.0)
    # the number of droplets in a gate scatters by its root: gates within six of them of the strongest may be it
    drops = fog.number * model.gate * np.pi / 4 * np.radians(0.2) ** 2 * middle**2
    level = share * power
    likely = level * (1.0 + 6.0 / np.sqrt(drops)) >= level.max()
    gate = np.floor((points.range - model.min_range) / model.gate).astype(int)
    assert len(points) == 4000 and likely[gate].all() and likely.sum() < 6
    assert (gate == np.argmax(level)).mean() > 0.5
    np.testing.assert_allclose(points.intensity, power[gate], rtol=6.0 / np.sqrt(drops[gate].min()))


def test_walls_are_seen_through_fog_that_would_blind_a_shared_axis():
    def strongest(distance: float, model: LidarModel) -> Any:
        scene = walls((distance, -300.0, 300.0))
        return Lidar(scene, model, mounting=ORIGIN, weather=Weather.fog(60.0), ideal=True).sweep(STANDING)[0]

    makers = one_way(min_range=0.8, overlap=MODELS["os1-64"].overlap)
    for model, within in ((makers, True), (replace(makers, overlap=(0.0, 0.0)), False)):
        assert (strongest(8.0, model).instance >= 0).all() == within
    assert (strongest(40.0, makers).instance == -2).all()


def test_rain_answers_as_often_as_its_drops_do():
    rain = Weather(extinction=1e-3, backscatter=1e-3, number=3e4)
    model = one_way(max_range=30.0)
    lidar = Lidar(
        walls((150.0, -300.0, 300.0)), model, mounting=ORIGIN, subrays=1, ideal=True, weather=rain, returns=["first"]
    )
    [points] = lidar.sweep(STANDING)
    middle = model.min_range + model.gate * (np.arange(100) + 0.5)
    middle = middle[middle < 30.0]
    mean = rain.number * model.gate * np.pi / 4 * np.radians(0.2) ** 2 * middle**2
    power = np.pi * rain.backscatter * model.gate / middle**2 * np.exp(-2.0 * rain.extinction * middle) / mean
    chance = stats.poisson.sf(np.ceil(lidar.threshold / power) - 1, mean)
    assert 0.5 < chance.sum() < 20.0
    spread = np.sqrt((chance * (1 - chance)).sum() / 4000)
    assert points.echoes.sum() / 4000 == pytest.approx(chance.sum(), abs=5.0 * spread)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Lidar(floor(), "os9"), "lidar model is 'os9'; choose one of: os1-64"),
        (lambda: Lidar(floor(), subrays=17), "subrays is 17"),
        (lambda: Lidar(floor(), returns=[]), "at least one of first"),
        (lambda: Lidar(floor(), returns=["best"]), "choose one of: first"),
        (lambda: Lidar(floor()).sweep(Motion.still([0.0, 0.0, -4.0])), "the lidar at .* inside the ground"),
        (lambda: Lidar(floor()).sweep(moving([0.0], np.zeros((1, 2, 3)), *[[[0, 0]]] * 3)), "2 worlds"),
        (lambda: moving([0.0, 0.0], np.zeros((2, 3)), *[[0, 0]] * 3), "step of motion time"),
        (lambda: moving([0.0], np.zeros((2, 3)), *[[0]] * 3), "have the shapes"),
        (lambda: Weather.fog(1.0), "visibility is 1 m"),
        (lambda: Weather.named("hail", 1.0), "choose one of: rain"),
        (lambda: one_way(range_10=0.0), "range_10 is 0"),
        (lambda: one_way(overlap=(3.0, 1.0)), "two ranges, the nearer one first"),
        (lambda: one_way(overlap=(-1.0, 1.0)), "overlap.* is -1 m"),
    ],
)
def test_wrong_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()
