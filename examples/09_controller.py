"""A controller of your own for a path: pure pursuit, from the observation alone, beside the one that comes with the package.

You learn what an observation holds and where, what a policy is, and how policies are compared on the same episodes.
"""

import gymnasium as gym
import numpy as np

import aoro_gym
from aoro_gym.agents import REFERENCE_POLICIES, evaluate
from aoro_gym.envs import Course
from aoro_gym.terrains import Path, Plane

ENV = "AORO/PathTracking-v0"
LOOK_AHEAD = 2  # which of the points that are previewed, 3 m ahead
GAIN = 2.5  # signal a radian of joint angle


class Pursuit:
    """Steers the joint to the angle whose circle leads through a point of the path ahead."""

    def __init__(self, envs):
        self.layout = envs.unwrapped.observation_layout  # columns by the name of a term

    def __call__(self, observations):
        """Actions (N, 2) for observations (N, columns): steering and drive signal."""
        ahead = observations[:, self.layout["preview"]].reshape(len(observations), -1, 2)[:, LOOK_AHEAD]  # x, y [m]
        angle = observations[:, self.layout["joint_angle"]][:, 0]
        curvature = 2.0 * ahead[:, 1] / np.sum(np.square(ahead), axis=1)
        wanted = 3.5 * curvature  # the axles lie 1.77 and 1.72 m from the joint
        return np.column_stack([np.clip(GAIN * (wanted - angle), -1.0, 1.0), np.full(len(angle), 0.66)])

    def reset(self, mask=None):
        """It remembers nothing."""


if __name__ == "__main__":
    print(gym.spec(ENV).id, "of aoro_gym", aoro_gym.__version__)
    along = np.linspace(0.0, 20.0, 41)
    yard = Course(Plane(), (Path(np.column_stack([along, 2.0 * np.sin(0.3 * along)])),))
    policies = {"mine": Pursuit, "pure-pursuit": REFERENCE_POLICIES[ENV]["pure-pursuit"]}
    found = evaluate(ENV, policies, courses=[yard], episodes=2)  # without courses: on generated forests
    for name, metrics in found.summary.items():
        rms, success = metrics["cross_track_rms_m"], metrics["success_rate"]
        print(
            f"{name:14} cross-track error {rms.mean:.3f} m rms, arrived in {100.0 * success.mean:.0f} % of the drives"
        )
