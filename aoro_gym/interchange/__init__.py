"""The machine in the formats of other simulators."""

from aoro_gym.interchange.export import description, export_machine
from aoro_gym.interchange.limitations import FORMATS, Limitation, limitations
from aoro_gym.interchange.mjcf import mjcf
from aoro_gym.interchange.urdf import urdf

__all__ = ["FORMATS", "Limitation", "description", "export_machine", "limitations", "mjcf", "urdf"]
