"""The pure pursuit of the package on what a session measures, in the session's own process."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from aoro_gym.agents.controllers.path_tracking import NEEDED, PurePursuit, Vehicle, VehicleState
from aoro_gym.cosimulation.server.records import TELEMETRY, neutral
from aoro_gym.cosimulation.server.server import Server
from aoro_gym.recording.commands import WHEELS
from aoro_gym.sensors import Localisation
from aoro_gym.sensors.attitude import wrapped
from aoro_gym.sensors.joint_angle import slope_weights
from aoro_gym.sensors.wheel_speed import ground_speed
from aoro_gym.terrains import Path

STEPS = 50
"""Main steps between two commands."""
WEIGHTS = slope_weights(6, 0.01)


class Follower:
    """Observes and steers as AORO/PathTracking-v0 with ``PurePursuit`` does; arms and traction valves stay as they are."""

    def __init__(self, server: Server, path: Path):
        self.session, self.path = server.session, path
        frame = self.session.twin.machine.frame
        self.front = np.array([float(np.max(frame.front.axle_distance)), 0.0, 0.0])
        layout = {name: slice(number, number + 1) for number, name in enumerate(NEEDED)}
        self.controller = PurePursuit(Vehicle(layout, float(self.front[0]), float(np.max(frame.rear.axle_distance))))
        self.radius = np.array([float(np.max(self.session.twin.machine.tire.radius))])
        self.localisation: Localisation | None = None
        self.angles: list[float] = []
        self.s: float | None = None
        self.reading: Any = None
        measured = self.session._gps.measure

        def kept(*arguments: Any) -> Any:
            self.reading = measured(*arguments)
            return self.reading

        gps: Any = self.session._gps
        gps.measure = kept
        self.session.on_telemetry = self.see

    def see(self, values: Any, instant: float) -> None:
        self.values = values
        self.angles = [values["joint_angle"], *self.angles][:6]

    def step(self) -> None:
        """One control step on what was measured at its beginning, then the time until the next."""
        v = self.values
        roll, pitch = np.array([v["roll"]]), np.array([v["pitch"]])
        speed = ground_speed(np.array([[v[f"wheel_speed_{wheel}"] for wheel in WHEELS]]), self.radius)
        if self.localisation is None:
            self.localisation = Localisation()
            self.localisation.begin(self.reading, roll, pitch, self.front, np.array([0]))
        else:
            self.localisation.update(
                self.reading, roll, pitch, self.front, speed=speed, yaw_rate=np.array([v["rate_z"]]), step=0.05
            )  # pyright: ignore[reportArgumentType]
        here, heading = self.localisation.position[0], float(self.localisation.heading[0])
        s, error = self.path.project(here, near=self.s, reach=1.5)
        self.s = float(s)
        preview = self.path.position(self.s + np.array(self.controller.vehicle.preview)) - here
        c, n = np.cos(heading), np.sin(heading)
        axes = np.array([[c, n], [-n, c]])
        terms = {
            "cross_track": error,
            "heading_error": wrapped(heading - self.path.heading(self.s)),
            "preview": (preview @ axes.T).ravel(),
            "curvature": self.path.curvature(self.s + np.array([0.0, *self.controller.vehicle.preview])),
            "speed": speed,
            "joint_angle": v["joint_angle"],
            "joint_rate": sum(weight * angle for weight, angle in zip(WEIGHTS, self.angles, strict=False)),
        }
        seen = VehicleState(
            self.controller.vehicle, {name: np.reshape(value, (1, -1)) for name, value in terms.items()}
        )
        steering = np.float32(2.5 - 2.0 * float(self.controller.steer(seen)[0]))
        signal = (2.5 - float(steering)) / 2.0
        self.session.command({**neutral(1.0), "parking_brake": 0.0, "steering_signal": signal, "drive_signal": 0.66})
        self.session.command_sequence += 1
        self.session.run(STEPS)


def followed(server: Server, path: Path, seconds: float = 600.0) -> dict[str, Any]:
    """What the server's judge says of a drive along ``path`` in this process, to its end or so long [s]."""
    follower = Follower(server, path)
    server.session.run(2 * STEPS)  # the first GPS solution of a script comes with the second telemetry step
    for _ in itertools.takewhile(lambda _: server.session.time < seconds, itertools.count()):
        follower.step()
        assert server.judge is not None
        if server.judge.ended:
            break
    assert server.judge is not None and len(TELEMETRY.fields) > 0
    server.publisher.close()
    server.link.close()
    return server.judge.to_json()
