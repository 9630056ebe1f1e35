"""What a data set is of."""

from __future__ import annotations

from dataclasses import dataclass

from aoro_gym.checks import check_choice, check_integer, check_range
from aoro_gym.sensors.camera import MODELS, CameraModel
from aoro_gym.sensors.dataset.formats import FORMATS
from aoro_gym.sensors.lidar import MODELS as LIDARS

SENSORS = ("stereo", "lidar")
FACTORS = ("light", "weather", "season", "stand", "clutter", "texture", "pose")
"""What is drawn anew: hour and clouds; fog and rain; season with its snow; species and their stand; piles and stumps;
albedos; height and angles of the camera."""
NEAR = ("log", "stump", "boulder", "machine")
"""Kinds of objects that cameras can be put before."""
SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class DatasetSettings:
    """What a data set is of. Raises ``ValueError`` naming the field."""

    frames: int = 30
    worlds: int = 5
    """Forests, of seeds one after the other; a split has forests of its own."""
    size: float = 60.0
    """Side of a forest [m]."""
    seed: int = 0
    """Of the first forest, and of all that is drawn."""
    model: str = "stereo"
    width: int = 320
    samples: int = 4
    formats: tuple[str, ...] = ("coco",)
    left_only: bool = False
    """Without the right picture: in little more than half the time."""
    fixed: tuple[str, ...] = ()
    """Which of :data:`FACTORS` stay the same."""
    near: str | None = None
    """One of :data:`NEAR` that every camera stands before; None: cameras stand anywhere."""
    sensors: tuple[str, ...] = ("stereo",)
    """``stereo``, and ``lidar`` beside it."""
    lidar: str = "os1-64"
    machines: int = 0
    """Others that stand in every world."""
    cranes: bool = False
    """Whether their cranes are unfolded, every other one with a log in its grapple."""
    split: str = "train"
    """Of all pictures where the world is given; made forests share them out."""

    def __post_init__(self) -> None:
        check_integer("frames", self.frames, le=1_000_000)
        check_integer("worlds", self.worlds, ge=3, le=100_000, note=": train, val and test have forests of their own")
        check_range("size", self.size, "m", ge=30.0, le=1000.0)
        check_integer("seed", self.seed, ge=0)
        check_choice("model", self.model, MODELS)
        check_integer("width", self.width, ge=32, le=8192)
        check_integer("samples", self.samples, le=4096)
        for one in self.formats:
            check_choice("format", one, FORMATS)
        for one in self.fixed:
            check_choice("fixed", one, FACTORS)
        if self.near is not None:
            check_choice("near", self.near, NEAR)
        for one in self.sensors:
            check_choice("sensor", one, SENSORS)
        if "stereo" not in self.sensors:
            raise ValueError(
                "sensor is lidar alone, but labels are a picture's; give stereo, too: --sensor stereo,lidar"
            )
        check_choice("lidar", self.lidar, LIDARS)
        check_integer("machines", self.machines, ge=0, le=100)
        if self.cranes and not self.machines:
            raise ValueError(
                "cranes are those of other machines, but machines is 0; let some stand there: --machines 2"
            )
        if self.near == "machine" and not self.machines:
            raise ValueError("near is machine, but machines is 0; let some stand there: --machines 2")
        check_choice("split", self.split, SPLITS)

    @property
    def camera(self) -> CameraModel:
        """The camera's model, so wide."""
        return MODELS[self.model].resized(self.width)
