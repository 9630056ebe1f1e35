"""Stereo cameras: lens, shutter and noise, sun and sky, textures, rain and fog; and what each pixel truly shows.

>>> from aoro_gym.sensors.lidar import Motion
>>> from aoro_gym.sensors.raytrace import Scene
>>> scene = Scene([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], [[0, 1, 2], [0, 2, 3]])
>>> model = CameraModel("small", Intrinsics.of_view(32, 24, 60.0))
>>> camera = StereoCamera(scene, Appearance.plain([0.18]), daylight(), model, samples=1)
>>> [[left, right]] = camera.take(Motion.still([0.0, 0.0, 0.0]))
>>> left.rgb.shape, bool(left.depth[-1, 16] < 10.0), int(left.instance[-1, 16])
((24, 32, 3), True, 0)
"""

from aoro_gym.sensors.camera.appearance import Appearance
from aoro_gym.sensors.camera.camera import CAMERA_MOUNTING, Request, StereoCamera, take_together
from aoro_gym.sensors.camera.film import SensorModel
from aoro_gym.sensors.camera.lens import Intrinsics
from aoro_gym.sensors.camera.light import SEASONS, Light, daylight
from aoro_gym.sensors.camera.models import MODELS, CameraModel
from aoro_gym.sensors.camera.picture import NOTHING, UNDERGROWTH, Picture, Stereo

__all__ = [
    "CAMERA_MOUNTING",
    "MODELS",
    "NOTHING",
    "SEASONS",
    "UNDERGROWTH",
    "Appearance",
    "CameraModel",
    "Intrinsics",
    "Light",
    "Picture",
    "Request",
    "SensorModel",
    "Stereo",
    "StereoCamera",
    "daylight",
    "take_together",
]
