"""Data sets of pictures that annotate themselves: boxes, masks, depth and poses of what stands in made forests."""

from aoro_gym.sensors.dataset.labels import CATEGORIES, Label, Shapes, labels
from aoro_gym.sensors.dataset.making import make
from aoro_gym.sensors.dataset.settings import FACTORS, NEAR, DatasetSettings

__all__ = ["CATEGORIES", "FACTORS", "NEAR", "DatasetSettings", "Label", "Shapes", "labels", "make"]
