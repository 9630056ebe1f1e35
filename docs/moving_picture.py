"""Makes docs/pictures/drive.webp, a path followed in generated forest: ``python docs/moving_picture.py``."""

from pathlib import Path

import gymnasium as gym
from PIL import Image

import aoro_gym  # noqa: F401  registers the environments
from aoro_gym.agents import reference_policy

PICTURE = Path(__file__).parent / "pictures" / "drive.webp"
SEED = 3
EVERY, FRAMES = 20, 60
"""Control steps between two frames, which are 1 s, and their number."""
SHOWN = 100
"""Time [ms] that a frame is shown: ten times as fast as real time."""
SIZE = (640, 360)
QUALITY = 55


def frames() -> list[Image.Image]:
    """The preview regulator on a path, a frame a second."""
    env = gym.make("AORO/PathTracking-v0", render_mode="rgb_array")
    policy = reference_policy("AORO/PathTracking-v0", "preview", env)
    observation, _ = env.reset(seed=SEED)
    found: list[Image.Image] = []
    over, step = False, 0
    while not over and len(found) < FRAMES:
        if step % EVERY == 0:
            found.append(Image.fromarray(env.render()).resize(SIZE, Image.Resampling.LANCZOS))  # pyright: ignore[reportArgumentType]
        observation, _, terminated, truncated, _ = env.step(policy(observation[None])[0])
        over, step = terminated or truncated, step + 1
    env.close()
    return found


if __name__ == "__main__":
    first, *rest = frames()
    first.save(PICTURE, save_all=True, append_images=rest, duration=SHOWN, loop=0, quality=QUALITY, method=6)
