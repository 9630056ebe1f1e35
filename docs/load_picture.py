"""Draws docs/pictures/load.jpg, a laden machine at the start of a path: ``python docs/load_picture.py``."""

from pathlib import Path

import gymnasium as gym
from PIL import Image

import aoro_gym  # noqa: F401  registers the environments
from aoro_gym import Machine

PICTURE = Path(__file__).parent / "pictures" / "load.jpg"
LOGS = 30.0
SEED = 1
BOX = (100, 200, 620, 520)
"""What is shown of the environment's picture [px]: left, upper, right, lower."""
QUALITY = 85


def laden() -> Image.Image:
    """The default machine with its logs, as path tracking shows it from behind."""
    machine = Machine.load("aoro").set({"payload.count": LOGS})
    env = gym.make("AORO/PathTracking-v0", render_mode="rgb_array", machine=machine)
    env.reset(seed=SEED)
    picture = Image.fromarray(env.render())  # pyright: ignore[reportArgumentType]
    env.close()
    return picture.crop(BOX)


if __name__ == "__main__":
    laden().save(PICTURE, quality=QUALITY)
