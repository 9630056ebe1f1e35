"""A film of loading and driving off: a log beside the machine, on the bunk, and away with it.

``python -m studies.loading_film --out loading.webp`` lets ``loading-ppo``, or another policy, load a held-out log, puts it
into the bunk of the same twin as its payload, folds the crane by proportional signals, and drives off to the left. Eight
pictures a second, at twice the speed.
"""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs import LoadingVectorEnv
from aoro_gym.envs.core.rendering import Canvas
from aoro_gym.envs.loading.logs import GroundLog, held_out_sites
from aoro_gym.envs.loading.rendering import WOOD, chain
from aoro_gym.machine import Machine
from aoro_gym.machine.vehicle_crane import VehicleCrane
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, RED, SOFT
from aoro_gym.twin.twin import Twin

ENV = "AORO/Loading-v0"
SIZE = (760, 460)
"""[px]"""
VIEW = (-6.0, 10.0, -4.0, 5.68)
"""What is seen [m]."""
EVERY = 0.25
"""Time [s] between two pictures."""
DRIVE_OFF = 9.0
"""[s]"""


class Ground:
    """The machine with its crane and the log on level ground, from above."""

    def __init__(self, machine: Machine, vehicle: VehicleCrane):
        self._machine, self._vehicle = machine, vehicle
        self._canvas = Canvas(SIZE)
        axes = self._axes = self._canvas.axes(0, 0, *SIZE)
        axes.set_xlim(VIEW[0], VIEW[1])
        axes.set_ylim(VIEW[2], VIEW[3])
        axes.set_axis_off()
        self._parts: list[Any] = []

    def _box(self, origin: NDArray[Any], turn: NDArray[Any], box: tuple[float, ...], colour: str, **style: Any) -> None:
        """A rectangle: its middle (x, y), length and width, in the axes ``turn`` (2, 2) at ``origin``."""
        from matplotlib.patches import Polygon

        x, y, length, width = box
        corners = np.array(
            [[x + 0.5 * i * length, y + 0.5 * j * width] for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        )
        self._parts.append(self._axes.add_patch(Polygon(origin + corners @ turn.T, facecolor=colour, **style)))

    def picture(self, twin: Twin, log: tuple[float, ...], says: str) -> Image.Image:
        """A picture of the first twin and a ``log`` (x, y, yaw, length, diameter) in the world; it ``says`` what is done."""
        frame, payload, track = self._machine.frame, self._machine.payload, float(np.asarray(self._machine.frame.track))
        for part in self._parts:
            part.remove()
        self._parts = []
        origin = np.array([twin.output("position_x")[0], twin.output("position_y")[0]])
        yaw, joint = float(twin.output("yaw")[0]), float(twin.output("joint_angle")[0])
        turned = _turn(yaw), _turn(yaw - joint)
        for half, turn, sign in ((frame.front, turned[0], 1.0), (frame.rear, turned[1], -1.0)):
            axle = sign * float(np.asarray(half.axle_distance))
            self._box(origin, turn, (0.55 * axle, 0.0, 1.1 * abs(axle), 1.2), "#d9dee2", edgecolor=SOFT)
            for side in (1.0, -1.0):
                self._box(origin, turn, (axle, 0.5 * side * track, 1.3, 0.53), "#5b636a")
        far, wide = float(np.asarray(payload.distance)), float(np.asarray(payload.bunk_width))
        self._box(origin, turned[1], (-far, 0.0, 2.8, wide), "none", edgecolor=AMBER, linewidth=2.0)
        x, y, angle, length, diameter = log
        self._box(np.array([x, y]), _turn(angle), (0.0, 0.0, length, diameter), WOOD, edgecolor=INK)
        joints = twin.crane.joints[:, 0].astype(float)
        pins, foot = chain(self._vehicle, joints), np.array([float(np.asarray(self._vehicle.mount.foot.distance)), 0.0])
        places = origin + (foot + pins[:, :1] * [math.cos(joints[0]), math.sin(joints[0])]) @ turned[0].T
        for part, colour, width in ((places[:3], BLUE, 5), (places[2:], GREEN, 4), (places[3:], RED, 8)):
            self._parts += self._axes.plot(*part.T, color=colour, linewidth=width, marker="o", markersize=0.9 * width)
        self._parts.append(self._axes.text(VIEW[0] + 0.3, VIEW[3] - 0.5, says, fontsize=13, color=INK))
        self._canvas.forget()
        return Image.fromarray(self._canvas.picture())


def _turn(angle: float) -> NDArray[np.float64]:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def loaded(env: LoadingVectorEnv, ground: Ground, policy: Policy, site: int, number: int) -> list[Image.Image]:
    """Pictures of how a policy loads a log."""
    observations, _ = env.reset(seed=1, options={"site": site, "log": number})
    pictures = []
    for step in range(600):
        observations, _, terminated, _, infos = env.step(policy(observations))
        if step % round(EVERY / env.task.control_step * 1.2) == 0:
            x, y, _, yaw, length, diameter = (float(one) for one in env.task._log[:, 0])
            held = "lifting" if infos["held"][0] else "reaching"
            says = f"{held}, {1e-3 * float(env.twin.crane.tip_load[0]):.1f} kN at the tip"
            pictures.append(ground.picture(env.twin, (x, y, yaw, length, diameter), says))
        if terminated[0]:
            print(f"after {step / 10:.1f} s: {infos['termination'][0]}")
            return pictures
    raise RuntimeError("the log was not loaded in a minute")


def driven_off(env: LoadingVectorEnv, ground: Ground, log: GroundLog) -> list[Image.Image]:
    """Pictures of the same machine with the log as its payload: it folds its crane and drives off."""
    twin = env.twin
    payload = {"count": 1.0, "length": log.length, "diameter": log.diameter, "density": log.density}
    twin.set_machines([0], twin.machine.set({f"payload.{name}": value for name, value in payload.items()}))
    twin.crane.grasp(0.0, 0.0, 0.0)
    aim = np.array([0.0, 0.35, -2.3, 0.0])
    pictures, offset = [], None
    for step in range(round(DRIVE_OFF / EVERY)):
        off = aim - twin.crane.joints[:, 0]
        off[0] = math.remainder(off[0], 2.0 * math.pi)
        signals = np.clip(2.0 * off, -0.6, 0.6)
        commands = dict(
            zip(("crane_slew", "crane_lift", "crane_fold", "crane_telescope"), signals.tolist(), strict=True)
        )
        drive = {"parking_brake": 0.0, "drive_signal": 0.6, "steering_signal": 0.25 if step < 14 else 0.0}
        twin.step({**commands, **(drive if step > 6 else {})}, EVERY)
        yaw, joint = float(twin.output("yaw")[0]), float(twin.output("joint_angle")[0])
        here = np.array([twin.output("position_x")[0], twin.output("position_y")[0]])
        if offset is None:
            offset = _turn(yaw - joint).T @ (env.task._log[:2, 0] - here)
        x, y = here + _turn(yaw - joint) @ offset
        speed = abs(float(twin.output("speed")[0]))
        pictures.append(
            ground.picture(twin, (x, y, yaw - joint, log.length, log.diameter), f"driving off, {speed:.1f} m/s")
        )
    return pictures


def main() -> None:
    """Make the film."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, default=Path("loading.webp"))
    parser.add_argument("--policy", default="loading-ppo", help="who loads, as of 'aoro-gym evaluate'")
    parser.add_argument("--site", type=int, default=24)
    parser.add_argument("--log", type=int, default=1)
    arguments = parser.parse_args()
    sites = held_out_sites()
    machine = Machine.load("aoro")
    env = LoadingVectorEnv(1, courses=sites, autoreset_mode="Disabled", machine=machine)
    ground = Ground(machine, env.task.crane)
    policy = policy_factory(ENV, arguments.policy)(env)
    pictures = loaded(env, ground, policy, arguments.site, arguments.log)
    pictures += driven_off(env, ground, sites[arguments.site].logs[arguments.log])
    pictures[0].save(
        arguments.out, save_all=True, append_images=pictures[1:], duration=125, loop=0, quality=60, method=4
    )
    print(f"{arguments.out}: {len(pictures)} pictures, {arguments.out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
