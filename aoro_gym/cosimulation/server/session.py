"""One twin with its sensors: advanced step by step, read out a hundred times a second, its GPS ten times."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aoro_gym.checks import check_choice
from aoro_gym.cosimulation.server.geodesy import Geodesy
from aoro_gym.cosimulation.server.judging import PathJudge
from aoro_gym.cosimulation.server.nmea import Sentences, Solution, second_of_day, utc_of
from aoro_gym.cosimulation.server.records import MEASURED_PRESSURES, TELEMETRY, neutral, within_bounds
from aoro_gym.machine.kinematics import Pose
from aoro_gym.recording.commands import WHEELS
from aoro_gym.sensors import (
    Antennas,
    Gps,
    GpsNoise,
    Imu,
    ImuNoise,
    JointAngleNoise,
    JointAngleSensor,
    PressureNoise,
    PressureSensor,
    WheelSpeedNoise,
    WheelSpeedSensor,
)
from aoro_gym.sensors.gps import NONE, RATE
from aoro_gym.sensors.imu import specific_force
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state
from aoro_gym.twin.records import Output, State

TELEMETRY_RATES = (100, 50, 20)
"""Records of telemetry a second [Hz] to choose from: samples of joint angle, wheels, inertial unit and pressures."""
GPS_STEP = 0.05
"""Time [s] between two looks at the GPS receiver, ten solutions a second of which come out with a latency; as in
AORO/PathTracking-v0."""
_STAGES = 7


@dataclass(frozen=True)
class Sensing:
    """Errors of the sensors, typical ones by default, and where the antennas stand."""

    joint_angle: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    pressure: PressureNoise = field(default_factory=PressureNoise.typical)
    wheel_speed: WheelSpeedNoise = field(default_factory=WheelSpeedNoise.typical)
    imu: ImuNoise = field(default_factory=ImuNoise.typical)
    gps: GpsNoise = field(default_factory=GpsNoise.typical)
    antennas: Antennas = field(default_factory=Antennas)
    gps_latency: float = 0.04
    """[s]"""

    @classmethod
    def ideal(cls) -> Sensing:
        """No errors; GPS keeps its rate and latency."""
        return cls(JointAngleNoise(), PressureNoise(), WheelSpeedNoise(), ImuNoise(), GpsNoise())


class Session:
    """A twin with its sensors.

    What is measured at a tick (a multiple of ``telemetry_step``) is computed in the main steps that follow it, a part in
    each, so that no step takes long: a record leaves some milliseconds after the instant that it shows, as over a bus.

    Args:
        twin: One, on the CPU, at rest.
        geodesy: Where its ground lies.
        sensing: Errors of its sensors.
        seed: Of these.
        judge: Told the true pose every ``GPS_STEP``, once somebody commands.
        telemetry_rate: One of ``TELEMETRY_RATES`` [Hz].
        on_telemetry: Called with each record of telemetry and the time [s] that it shows.
        on_sentences: Called with the sentences of each GPS solution.
        on_solution: Called with the solution itself.

    Raises ValueError if the twin is not one on the CPU, or its main step does not divide a tick into enough parts.
    """

    def __init__(
        self,
        twin: Twin,
        geodesy: Geodesy,
        *,
        sensing: Sensing | None = None,
        seed: int = 0,
        judge: PathJudge | None = None,
        telemetry_rate: int = TELEMETRY_RATES[0],
        on_telemetry: Callable[[Mapping[str, float], float], None] = lambda *_: None,
        on_sentences: Callable[[bytes], None] = lambda _: None,
        on_solution: Callable[[Solution], None] = lambda _: None,
    ):
        if twin.num_twins != 1 or not twin.device.is_cpu:
            raise ValueError(f"{twin.num_twins} twins on {twin.device.alias}: a session has one, on the CPU")
        check_choice("telemetry_rate", telemetry_rate, TELEMETRY_RATES)
        self.telemetry_step = 1.0 / telemetry_rate
        """[s]"""
        self.tick_steps = round(self.telemetry_step / twin.main_step)
        if abs(self.tick_steps * twin.main_step - self.telemetry_step) > 1e-9 or self.tick_steps < _STAGES:
            raise ValueError(
                f"main_step is {twin.main_step} s, but must divide the {self.telemetry_step} s between two records into"
                f" {_STAGES} parts or more"
            )
        self.twin, self.on_telemetry = twin, on_telemetry
        self.on_sentences, self.on_solution = on_sentences, on_solution
        self.steps = 0
        """Main steps so far."""
        self.command_sequence, self.watchdog = 0, True
        """What telemetry says of the commands that are obeyed."""
        self.commands = neutral(1.0)
        twin.set_commands(self.commands)
        sensing = Sensing() if sensing is None else sensing
        self._joint = JointAngleSensor(noise=sensing.joint_angle, interval=self.telemetry_step)
        self._wheels, self._imu = WheelSpeedSensor(noise=sensing.wheel_speed), Imu(noise=sensing.imu)
        self._pressures = PressureSensor(noise=sensing.pressure, count=len(MEASURED_PRESSURES))
        self._gps = Gps(noise=sensing.gps, antennas=sensing.antennas, latency=sensing.gps_latency, interval=GPS_STEP)
        self._clock_late = _reset_sensors((self._joint, self._wheels, self._imu, self._pressures, self._gps), seed)
        self._sentences = Sentences(geodesy)
        self._launches: dict[int, Callable[[int, int], None]] = {}
        self._launch(1)
        self._output_row, self._state_column = twin.outputs.numpy()[-1, :, 0], twin.state.numpy()[:, 0]  # not copied
        self._status = twin.status_codes.numpy()
        self._outputs, self._state, self._time = self._output_row.copy(), self._state_column.copy(), 0.0
        self._commanded = self.commands
        self._reading: dict[str, float] = {}
        self._solution: Solution | None = None
        self._judge = judge
        self._stages = (
            self._sense_joint, self._sense_wheels, self._sense_inertial, self._sense_gps, self._write, self._publish,
            self._see,
        )  # fmt: skip

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.twin.main_step

    @property
    def diverged(self) -> bool:
        """Whether the twin is frozen as its state was not finite."""
        return bool(self._status[0])

    def command(self, commands: Mapping[str, float]) -> None:
        """Obey other commands from now on; raises as :meth:`Twin.set_commands`."""
        if commands != self.commands:
            self.twin.set_commands(commands)
            self.commands = dict(commands)

    def step(self) -> None:
        """One main step, and the part of the measurements that falls into it; of a diverged twin nothing is measured."""
        self._launch(1)(0, 1)
        self.steps += 1
        if self.diverged:
            return
        phase = self.steps % self.tick_steps
        if phase == 0:
            self._take()
        if phase < _STAGES and self.steps >= self.tick_steps:
            self._stages[phase]()

    def run(self, steps: int) -> None:
        """Several main steps under the same commands, and all that is measured at ticks within them at once."""
        end = self.steps + steps
        while self.steps < end and not self.diverged:
            part = min(self.tick_steps - self.steps % self.tick_steps, end - self.steps)
            self._launch(part)(0, 1)
            self.steps += part
            if self.steps % self.tick_steps == 0 and not self.diverged:
                self._take()
                for stage in self._stages:
                    stage()

    def true(self, channel: str) -> float:
        """An output of the twin at the last step."""
        return float(self._output_row[Output[channel.upper()]])

    @property
    def measured(self) -> tuple[Any, Mapping[str, float]]:
        """What telemetry was measured of last: all outputs of the twin, and the commands up to that instant."""
        return self._outputs, self._commanded

    @property
    def pose(self) -> Pose:
        """Where the machine was at the instant that telemetry was measured of last."""
        return pose_of_state(self._state)

    def _launch(self, steps: int) -> Callable[[int, int], None]:
        if steps not in self._launches:
            self._launches[steps] = self.twin.advancing(steps * self.twin.main_step)
        return self._launches[steps]

    # ---- the parts of a tick

    def _take(self) -> None:
        """Keep what is to be measured."""
        self._outputs[:], self._state[:], self._time = self._output_row, self._state_column, self.time
        self._commanded = self.commands

    def _out(self, first: str, count: int = 1) -> Any:
        row = Output[first.upper()]
        return self._outputs[row : row + count].astype(np.float64)

    def _motion(self, first: str) -> Any:
        row = State[first]
        return self._state[None, row : row + 3].astype(np.float64)

    def _sense_joint(self) -> None:
        self._reading = {"joint_angle": float(self._joint.measure(self._out("joint_angle"), self._time)[0])}

    def _sense_wheels(self) -> None:
        shown = self._wheels.measure(self._out(f"wheel_rate_{WHEELS[0]}", len(WHEELS))[None], self._time)[0]
        self._reading |= {f"wheel_speed_{wheel}": float(value) for wheel, value in zip(WHEELS, shown, strict=True)}

    def _sense_inertial(self) -> None:
        roll, pitch, rates = self._out("roll"), self._out("pitch"), self._motion("WX")
        force = specific_force(self._motion("VX"), self._motion("AVX"), rates, self._motion("AWX"), roll, pitch)
        shown = self._imu.measure(rates, force, roll, pitch, self._time)
        assert shown.force is not None
        self._reading |= {"roll": float(shown.roll[0]), "pitch": float(shown.pitch[0])}
        for index, axis in enumerate("xyz"):
            self._reading |= {
                f"rate_{axis}": float(shown.rates[0, index]),
                f"force_{axis}": float(shown.force[0, index]),
            }

    def _publish(self) -> None:
        true = np.array([self._outputs[Output[name.upper()]] for name in MEASURED_PRESSURES])
        shown = self._pressures.measure(true[:, None], self._time)[:, 0]
        self._reading |= dict(zip(MEASURED_PRESSURES, map(float, shown), strict=True))
        for wheel in WHEELS:
            self._reading[f"arm_angle_{wheel}"] = float(self._outputs[Output[f"ARM_ANGLE_{wheel.upper()}"]])
        self._reading |= {
            "utc": second_of_day(utc_of(self._time + self._clock_late)),
            "command_sequence": self.command_sequence,
            "watchdog": self.watchdog,
            "gear": self.commands["gear"],
            "engine_speed": float(self._outputs[Output["ENGINE_SPEED"]]),
        }
        self.on_telemetry(within_bounds(TELEMETRY, self._reading), self._time)

    @property
    def _at_gps_step(self) -> bool:
        return (self.steps // self.tick_steps) % round(GPS_STEP / self.telemetry_step) == 0

    def _sense_gps(self) -> None:
        if not self._at_gps_step:
            return
        roll, pitch, yaw = (self._out(name) for name in ("roll", "pitch", "yaw"))
        shown = self._gps.measure(self._out("position_x", 3)[None], roll, pitch, yaw, self._time)
        instant = self._time - float(shown.age[0])
        lost = int(shown.quality[0]) == NONE
        if lost:  # what would have come out now
            number = math.floor((self._time - GPS_STEP + self._clock_late) * RATE)
            instant = (
                number / RATE - self._clock_late if math.floor((self._time + self._clock_late) * RATE) > number else 0.0
            )
        if instant > 0.0 and (lost or shown.fresh[0]):
            utc = utc_of(round((instant + self._clock_late) * RATE) / RATE)
            self._solution = Solution(utc, shown.position[0].copy(), float(shown.heading[0]), int(shown.quality[0]))

    def _write(self) -> None:
        if self._solution is not None:
            self.on_sentences(self._sentences.write(self._solution))
            self.on_solution(self._solution)
            self._solution = None

    def _see(self) -> None:
        if self._judge is not None and self.command_sequence and self._at_gps_step:
            roll, pitch, yaw = (self._out(name) for name in ("roll", "pitch", "yaw"))
            self._judge.see(self._out("position_x", 3)[None], roll, pitch, yaw)


def _reset_sensors(sensors: tuple[Any, ...], seed: int) -> float:
    """Begin new runs of sensors, the GPS last among them; time [s] by which its solutions come before whole tenths."""
    generators = [np.random.default_rng(part) for part in np.random.SeedSequence(seed).spawn(len(sensors))]
    for sensor, generator in zip(sensors, generators, strict=True):
        sensor.reset([0], [generator])
    # a receiver without errors whose clock is as late
    probe, zero = Gps(noise=GpsNoise(), latency=0.0), np.zeros(1)
    probe.reset([0], [np.random.default_rng(np.random.SeedSequence(seed).spawn(len(sensors))[-1])])
    age = float(probe.measure(np.zeros((1, 3)), zero, zero, zero, 2.0 / RATE).age[0])
    return age % (1.0 / RATE)
