"""Draws docs/pictures/mujoco.png, the exported machine in MuJoCo: ``MUJOCO_GL=egl python docs/mujoco_picture.py``."""

# MuJoCo takes its names from a compiled module at run time.
# pyright: reportAttributeAccessIssue=false
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from aoro_gym import Machine
from aoro_gym.interchange import mjcf

PICTURE = Path(__file__).parent / "pictures" / "mujoco.png"


def rendered() -> np.ndarray:
    """The machine after 1 s of turning left while it drives, (height, width, 3) of bytes."""
    model = mujoco.MjModel.from_xml_string(mjcf(Machine.load("aoro")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("rest").id)
    data.actuator("articulated_joint").ctrl[0] = 0.6
    for name in ("fl", "fr", "rl", "rr"):
        data.actuator(f"wheel_{name}").ctrl[0] = 1500.0
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = data.body("front_frame").xpos + np.array([0.0, 0.0, 0.7])
    camera.distance, camera.azimuth, camera.elevation = 8.5, 125.0, -24.0
    with mujoco.Renderer(model, height=540, width=960) as renderer:
        renderer.update_scene(data, camera)
        return renderer.render()


if __name__ == "__main__":
    Image.fromarray(rendered()).save(PICTURE, optimize=True)
