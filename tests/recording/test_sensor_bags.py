"""Clouds and pictures come back to the last digit, and others than us can read them."""

import numpy as np
import pytest

from aoro_gym.recording.sensor_bags import Camera, Cloud, Picture, read_sensors, write_sensors

RNG = np.random.default_rng(0)
COLUMNS = {
    "x": RNG.normal(size=7).astype(np.float32),
    "y": RNG.normal(size=7).astype(np.float32),
    "z": RNG.normal(size=7).astype(np.float32),
    "time": RNG.random(7),
    "ring": np.arange(7, dtype=np.uint16),
    "instance": np.arange(-3, 4, dtype=np.int32),
    "class_id": np.arange(7, dtype=np.uint8),
}
PICTURES = {
    "rgb8": RNG.integers(0, 256, (4, 5, 3), dtype=np.uint8),
    "mono16": RNG.integers(0, 65536, (4, 5), dtype=np.uint16),
    "32FC1": RNG.random((4, 5)).astype(np.float32),
}
MATRIX = np.array([[600.5, 0.0, 2.5], [0.0, 601.25, 2.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module", params=[".mcap", ".rosbag2"])
def bag(tmp_path_factory, request):
    path = tmp_path_factory.mktemp("bag") / f"sensors{request.param}"
    clouds = [Cloud(0.1 * number, {name: values + number for name, values in COLUMNS.items()}) for number in range(3)]
    pictures = {f"/camera/{name.lower()}": [Picture(0.25, one, name)] for name, one in PICTURES.items()}
    camera = [Camera(0.25, (5, 4), MATRIX, np.array([0.1, -0.2, 0.001, 0.002, 0.05]))]
    write_sensors(path, {"/lidar/points": clouds, **pictures, "/camera/info": camera})
    return path


def test_clouds_come_back_to_the_last_digit(bag):
    found = list(read_sensors(bag, "/lidar/points"))
    assert [one.time for one in found] == [0.0, 0.1, 0.2]
    for number, one in enumerate(found):
        assert isinstance(one, Cloud) and list(one.columns) == list(COLUMNS) and one.frame == "lidar"
        for name, values in COLUMNS.items():
            np.testing.assert_array_equal(one.columns[name], values + number)
            assert one.columns[name].dtype == (values + number).dtype


def test_pictures_come_back_to_the_last_digit(bag):
    for name, pixels in PICTURES.items():
        [found] = read_sensors(bag, f"/camera/{name.lower()}")
        assert isinstance(found, Picture) and found.encoding == name
        np.testing.assert_array_equal(found.pixels, pixels)
    [camera] = read_sensors(bag, "/camera/info")
    assert isinstance(camera, Camera) and camera.size == (5, 4)
    np.testing.assert_array_equal(camera.matrix, MATRIX)
    np.testing.assert_array_equal(camera.distortion, [0.1, -0.2, 0.001, 0.002, 0.05])


@pytest.mark.parametrize("bag", [".mcap"], indirect=True)
def test_foxgloves_library_reads_them(bag):
    """With the checksums of all chunks, and the definitions of messages that lie in the file."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with bag.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        found = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
    cloud = next(message for topic, message in found if topic == "/lidar/points")
    assert [one.name for one in cloud.fields] == list(COLUMNS) and cloud.width == 7
    first = np.frombuffer(bytes(cloud.data)[: 3 * 4], dtype="<f4")
    np.testing.assert_array_equal(first, [COLUMNS[name][0] for name in "xyz"])
    assert len(found) == 3 + len(PICTURES) + 1


@pytest.mark.parametrize(
    ("message", "what"),
    [
        (
            Cloud(0.0, {"x": np.zeros(3), "y": np.zeros(2)}),
            r"columns of a cloud are of the shapes .*must all be \(K,\)",
        ),
        (Cloud(0.0, {"x": np.zeros(3, dtype=complex)}), "type of the column x is 'complex128'"),
        (Picture(0.0, np.zeros((2, 2))), r"pixels are float64 of the shape \(2, 2\), but rgb8 is uint8 of \(H, W, 3\)"),
        (Picture(0.0, np.zeros((2, 2)), "jpeg"), "encoding is 'jpeg'"),
        (Camera(0.0, (2, 2), np.eye(4)), r"the matrix of a camera is of the shape \(4, 4\)"),
    ],
)
def test_what_is_no_message_is_refused(message, what, tmp_path):
    for name in ("a.mcap", "a.rosbag2"):
        with pytest.raises(ValueError, match=what):
            write_sensors(tmp_path / name, {"/topic": [message]})
    assert not list(tmp_path.iterdir())


def test_a_topic_that_is_not_there(bag):
    with pytest.raises(ValueError, match=r"topic of .* is '/lidar'; choose one of: /camera/"):
        next(iter(read_sensors(bag, "/lidar")))
    with pytest.raises(ValueError, match=r"suffix of a\.bag is '\.bag'"):
        write_sensors(bag.with_name("a.bag"), {})
