"""Data sets of pictures that annotate themselves: boxes, masks, depth and poses of what stands in forests."""

from aoro_gym.sensors.dataset.drives import Drive
from aoro_gym.sensors.dataset.labels import CATEGORIES, Label, Shapes, labels
from aoro_gym.sensors.dataset.making import make
from aoro_gym.sensors.dataset.settings import FACTORS, NEAR, DatasetSettings

__all__ = ["CATEGORIES", "FACTORS", "NEAR", "DatasetSettings", "Drive", "Label", "Shapes", "labels", "make"]
