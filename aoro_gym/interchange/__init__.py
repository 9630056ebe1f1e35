"""The machine in the formats of other simulators, and with its world in that of renderers."""

from aoro_gym.interchange.export import description, export_machine
from aoro_gym.interchange.limitations import FORMATS, Limitation, limitations
from aoro_gym.interchange.mjcf import mjcf
from aoro_gym.interchange.scene_file import scene, write_scene
from aoro_gym.interchange.urdf import urdf

__all__ = [
    "FORMATS",
    "Limitation",
    "description",
    "export_machine",
    "limitations",
    "mjcf",
    "scene",
    "urdf",
    "write_scene",
]
