"""``AORO/PathTracking-v0``: drive along a path over rough ground, at 20 Hz.

The **reference point** is the middle of the front axle: its distance to the path is the cross-track error, positive where
it is LEFT of the path; its heading is the front frame's, and the heading error is positive where that points left of the
path. The action steers and drives; the observation is what the machine's own sensors give: GPS with two antennas, inertial
unit, wheel speeds, joint angle, and the path, which is known. The true errors are seen by the reward only.

An episode ends well at the path's end, badly when the machine rolls over, leaves the terrain, loses the path or is stuck
(``info["termination"]`` says which), and is truncated when its time is up: ``time_margin`` times what the rest of the path
takes at ``working_speed``.

The configuration, the terms and the judgement stand here; a default is changed by name when the environment is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.envs.core.randomisation import COMMISSIONED, Draws, Randomisation, Range
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.task import Outputs, Start, Terrains, chosen, divides, given, sensing
from aoro_gym.envs.core.terms import Frozen, ObservationTerm, RewardTerm, changed_observations, changed_rewards
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.envs.path_tracking.assistance import (
    ArmControl,
    ArmController,
    AutomaticGear,
    GearShift,
    Stance,
    TractionControl,
)
from aoro_gym.envs.path_tracking.courses import Course, HeightMap, as_courses
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.machine import Machine
from aoro_gym.sensors import (
    Antennas,
    Gps,
    GpsNoise,
    GpsReading,
    Imu,
    ImuNoise,
    JointAngleNoise,
    Localisation,
    LocalisationGains,
    PressureNoise,
    PressureSensor,
    WheelSpeedNoise,
    WheelSpeedSensor,
)
from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.imu import specific_force
from aoro_gym.sensors.wheel_speed import ground_speed
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.twin.records import WHEELS, Output, State

CROSS_TRACK_SCALE = 0.5
"""Cross-track error [m] that costs 1."""
EXACT_SCALE = 0.03
"""Cross-track error [m] at which exact progress is worth half: what the reference controllers come to."""
BRISK = 1.1
"""Pace, as a share [-] of the working speed, at which exact progress is worth most."""
TIPPING_RESERVE = 0.5
"""Tipping margin [-] below which it costs."""
FULL_POWER = 1e5
"""Engine power [W] that stands for 1: about what the engine gives at its governed speed."""
PROJECTION_REACH = 1.5
"""Distance [m] along the path from the last projection within which the next one is looked for: 30 m/s at 20 Hz."""
ALL = slice(None)
"""Rows of all sub-environments."""
STEERING, DRIVE, ARMS, TRACTION, GEAR = "steering_signal", "drive_signal", "arms", "traction", "gear"

END_OF_PATH = "end of path reached"
ENDINGS = ["", END_OF_PATH, "rolled over", "left the terrain", "lost the path", "stuck"]
"""Reasons for which an episode terminates; a lost twin says so itself."""

# ---- what the terms see ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PathTrackingView:
    """All sub-environments at the end of a control step; arrays of shape (N,) unless said otherwise, SI.

    What begins with ``measured`` is what sensors and dead reckoning give; ``cross_track``, ``heading_error`` and what
    follows them are exact.
    """

    xp: Any
    """Array namespace of all arrays."""
    control_step: float
    """[s]"""
    working_speed: float
    """[m/s]"""
    cross_track: Array
    """Of the reference point [m], positive left of the path."""
    heading_error: Array
    """Heading of the front frame less that of the path [rad], in [−π, π)."""
    progress: Array
    """Length of path [m] that the step gained."""
    remaining: Array
    """Length of path [m] to its end."""
    speed: Array
    """Of the hinge, along the front frame [m/s]."""
    tipping_margin: Array
    """1 less the larger share [-] of the weight that has moved across or along: 1 even, 0 when two wheels lift."""
    engine_power: Array
    """Mean over the step [W]."""
    finished: Array
    """Whether the end of the path was reached in this step."""
    failed: Array
    """Whether the episode ended badly in this step."""
    measured_cross_track: Array
    """[m]"""
    measured_heading_error: Array
    """[rad]"""
    measured_remaining: Array
    """[m]"""
    preview: Array
    """Places on the path ahead, x forward, y left of the reference point as measured [m], shape (N, K, 2)."""
    curvature: Array
    """Of the path beside the vehicle and at the preview's places [1/m], positive left, shape (N, 1 + K)."""
    measured_speed: Array
    """Over ground, from the wheel speeds [m/s]."""
    measured_angle: Array
    """Joint angle [rad]."""
    measured_rate: Array
    """Joint rate [rad/s]: slope of the line through the last measured angles."""
    measured_roll: Array
    """[rad], positive where the left side is up."""
    measured_pitch: Array
    """[rad], positive where the nose is down."""
    measured_rates: Array
    """Angular velocity in the front frame's axes [rad/s], shape (N, 3)."""
    measured_force: Array
    """Specific force in the front frame's axes [m/s²], shape (N, 3); zero unless it is observed."""
    measured_wheel_rates: Array
    """[rad/s], shape (N, 4)."""
    gear: Array
    """1, 2 or 3."""
    actions: Array
    """The last actions, newest first, shape (N, M, A)."""
    heights: Array
    """Ground at the scan's places over that at the reference point [m], shape (N, G)."""
    outputs: Outputs
    """Exact output channels of the twins over the step."""

    def output(self, channel: str) -> Array:
        """Any exact output channel of the twin at the end of the step, SI; see ``aoro_gym.twin.records.Output``."""
        return self.outputs.last(channel)


# ---- reward terms: each a number a sub-environment, weighted below ---------------------------------------------------


def progress(view: PathTrackingView) -> Array:
    """Path gained, 1 at the working speed: what all of it is worth does not depend on the speed."""
    return view.progress / (view.control_step * view.working_speed)


def cross_track_cost(view: PathTrackingView) -> Array:
    """Square of the cross-track error in units of 0.5 m, at most 4."""
    return view.xp.clip((view.cross_track / CROSS_TRACK_SCALE) ** 2, None, 4.0)


def exact_progress(view: PathTrackingView) -> Array:
    """Path gained, worth half at 0.03 m off the path, and the less the more it is driven faster than a little over the
    working speed: what is left to gain is to be nearer to the path. Nobody saves anything by standing still, as where
    errors cost more than progress brings."""
    pace = progress(view)
    worth = pace - 2.0 * view.xp.clip(pace - BRISK, 0.0, None)
    return worth / (1.0 + (view.cross_track / EXACT_SCALE) ** 2)


def signal_change(view: PathTrackingView) -> Array:
    """Sum of the squared changes of all signals."""
    change = (view.actions[:, 0] - view.actions[:, 1]) ** 2
    total = change[:, 0]
    for column in range(1, change.shape[1]):
        total = total + change[:, column]
    return total


def tipping(view: PathTrackingView) -> Array:
    """Square of what the tipping margin lacks to a half, 1 when two wheels lift."""
    return view.xp.clip((TIPPING_RESERVE - view.tipping_margin) / TIPPING_RESERVE, 0.0, 1.0) ** 2


def energy(view: PathTrackingView) -> Array:
    """Mean engine power in units of 100 kW: its sum is the engine's work."""
    return view.engine_power / FULL_POWER


def elapsed(view: PathTrackingView) -> Array:
    """1 in every step: what is done sooner costs less."""
    return view.xp.ones_like(view.progress)


def finish(view: PathTrackingView) -> Array:
    """1 in the step that reaches the path's end."""
    return view.finished * 1.0


def failure(view: PathTrackingView) -> Array:
    """1 in the step in which the episode ends badly."""
    return view.failed * 1.0


REWARD_TERMS = Frozen(
    {
        "progress": RewardTerm(1.0, progress),
        "cross_track": RewardTerm(-0.5, cross_track_cost),
        "signal_change": RewardTerm(-0.2, signal_change),
        "tipping": RewardTerm(-1.0, tipping),
        "energy": RewardTerm(-0.1, energy),
        "time": RewardTerm(-0.1, elapsed),
        "finish": RewardTerm(20.0, finish),
        "failure": RewardTerm(-50.0, failure),
    }
)
"""The reward: about 1 a step for following the path's middle at the working speed."""
FURTHER_REWARD_TERMS = Frozen({"exact_progress": exact_progress})
"""What it can be made of besides, by name."""

# ---- observation terms -----------------------------------------------------------------------------------------------


def cross_track(view: PathTrackingView) -> Array:
    """Measured cross-track error [m], positive left of the path."""
    return view.measured_cross_track


def heading_error(view: PathTrackingView) -> Array:
    """Measured heading error [rad], positive left of the path's heading."""
    return view.measured_heading_error


def preview(view: PathTrackingView) -> Array:
    """Path ahead in the vehicle's axes [m]: x1, y1, x2, y2, … at the configuration's ``preview`` distances (N, 2 K)."""
    return view.preview.reshape(len(view.preview), -1)


def curvature(view: PathTrackingView) -> Array:
    """Curvature [1/m] beside the vehicle, then at the preview's places (N, 1 + K)."""
    return view.curvature


def remaining(view: PathTrackingView) -> Array:
    """Path left [m], clipped at 20 m."""
    return view.measured_remaining


def speed(view: PathTrackingView) -> Array:
    """Speed over ground from the wheels [m/s]."""
    return view.measured_speed


def joint_angle(view: PathTrackingView) -> Array:
    """Measured joint angle [rad]."""
    return view.measured_angle


def joint_rate(view: PathTrackingView) -> Array:
    """Estimated joint rate [rad/s]."""
    return view.measured_rate


def roll(view: PathTrackingView) -> Array:
    """Measured roll [rad], positive where the left side is up."""
    return view.measured_roll


def pitch(view: PathTrackingView) -> Array:
    """Measured pitch [rad], positive where the nose is down."""
    return view.measured_pitch


def yaw_rate(view: PathTrackingView) -> Array:
    """Measured yaw rate [rad/s]."""
    return view.measured_rates[:, 2]


def wheel_speeds(view: PathTrackingView) -> Array:
    """Measured wheel speeds [rad/s], front left, front right, rear left, rear right (N, 4)."""
    return view.measured_wheel_rates


def actions(view: PathTrackingView) -> Array:
    """The last actions, newest first, each as the action space has it (N, M A)."""
    return view.actions.reshape(len(view.actions), -1)


def gear(view: PathTrackingView) -> Array:
    """The gear, 1, 2 or 3."""
    return view.gear


def inertial(view: PathTrackingView) -> Array:
    """Roll rate and pitch rate [rad/s], then the specific force in units of 9.81 m/s² (N, 5)."""
    return view.xp.concat([view.measured_rates[:, :2], view.measured_force / 9.81], axis=1)


def heights(view: PathTrackingView) -> Array:
    """Ground at the scan's places over that at the reference point [m] (N, G), rows of ``scan_x`` by ``scan_y``."""
    return view.heights


OBSERVATION_TERMS = Frozen(
    {
        "cross_track": ObservationTerm(cross_track, -10.0, 10.0),
        "heading_error": ObservationTerm(heading_error, -math.pi, math.pi),
        "preview": ObservationTerm(preview, -30.0, 30.0),
        "curvature": ObservationTerm(curvature, -1.0, 1.0),
        "remaining": ObservationTerm(remaining, -1.0, 20.0),
        "speed": ObservationTerm(speed, -10.0, 10.0),
        "joint_angle": ObservationTerm(joint_angle, -math.pi, math.pi),
        "joint_rate": ObservationTerm(joint_rate, -5.0, 5.0),
        "roll": ObservationTerm(roll, -math.pi, math.pi),
        "pitch": ObservationTerm(pitch, -math.pi, math.pi),
        "yaw_rate": ObservationTerm(yaw_rate, -5.0, 5.0),
        "wheel_speeds": ObservationTerm(wheel_speeds, -30.0, 30.0),
        "actions": ObservationTerm(actions, -1.0, 1.0),
    }
)
"""What the machine measures, in this order; ``observation_layout`` gives the columns of each by name."""
EXACT_TERMS: Mapping[str, Callable[[PathTrackingView], Array]] = {
    "cross_track": lambda view: view.cross_track,
    "heading_error": lambda view: view.heading_error,
}
"""True values of terms that localisation gives with errors that last, for teachers."""
GEAR_TERMS = Frozen({"gear": ObservationTerm(gear, 1.0, 3.0)})
"""What a gear that changes adds."""
INERTIAL_TERMS = Frozen({"inertial": ObservationTerm(inertial, -20.0, 20.0)})
"""What ``observe_inertial=True`` adds."""
HEIGHT_TERMS = Frozen({"heights": ObservationTerm(heights, -5.0, 5.0)})
"""What a height scan adds."""

# ---- randomisation and configuration ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class PathTrackingRandomisation(Randomisation):
    """Also where an episode starts; terrain and path are drawn among the courses."""

    BOUNDS: ClassVar[Mapping[str, Range]] = {
        **Randomisation.BOUNDS,
        "start": (0.0, 1.0),
        "lateral_offset": (-5.0, 5.0),
        "heading_offset": (-1.0, 1.0),
    }

    joint_angle: Range = (-0.1, 0.1)
    """Joint angle at the start beyond what the path's bend asks for, as a share [-] of the largest one."""
    start: Range = (0.0, 0.0)
    """Where on the path an episode starts, as a share [-] of what can be started from."""
    lateral_offset: Range = (-0.2, 0.2)
    """Cross-track error at the start [m]."""
    heading_offset: Range = (-0.05, 0.05)
    """Heading error at the start [rad]."""


FIXED = PathTrackingRandomisation()
"""The machine as it is, with typical sensor noise; terrain, path and start still differ."""
MILD = PathTrackingRandomisation(
    machine_scale=Frozen({**COMMISSIONED, "tire.stiffness": (0.8, 1.25)}),
    ground_friction=(0.5, 1.1),
    sensor_noise=(0.5, 1.5),
    start=(0.0, 0.8),
    lateral_offset=(-0.5, 0.5),
    heading_offset=(-0.15, 0.15),
)
"""Spread of a commissioned machine over grounds, payloads and receptions, and starts anywhere on a path."""


@dataclass(frozen=True)
class PathTrackingConfig:
    """The task as data; SI. Raises ValueError naming the field, its value and its bound."""

    control_step: float = 0.05
    """[s] between two actions."""
    sample_step: float = 0.01
    """[s] between two samples of the joint-angle sensor."""
    working_speed: float = 0.75
    """[m/s] that an episode's time is reckoned with, and that progress is measured by: the published driving speed."""
    time_margin: float = 2.0
    """An episode is truncated after this many times what its path takes at the working speed."""
    preview: tuple[float, ...] = (1.0, 2.0, 3.0, 5.0, 8.0)
    """Distances along the path [m] at which it is previewed."""
    action_memory: int = 2
    """Past actions in the observation."""
    rate_samples: int = 6
    """Angle samples that the joint's rate estimate takes its slope from."""
    start_distance: float = 4.0
    """Open paths are started this far [m] from their first point, so that the rear axle stands on the path, too."""
    end_tolerance: float = 0.25
    """The path's end is reached this far [m] before it."""
    path_limit: float = 3.0
    """Cross-track error [m] beyond which the path is lost."""
    rollover: float = math.radians(45.0)
    """Tilt [rad] of the front frame beyond which the machine has rolled over."""
    stuck_distance: float = 0.5
    """A machine is stuck that gains less than this [m] …"""
    stuck_time: float = 20.0
    """… in this time [s]."""
    gear: int | str = 1
    """1, 2, 3 or ``"automatic"``; see :class:`aoro_gym.envs.path_tracking.assistance.AutomaticGear`."""
    gear_shift: GearShift = field(default_factory=GearShift)
    arms: ArmControl | None = field(default_factory=ArmControl.sharing)
    """How the pendulum arms move; None: they hold."""
    traction: TractionControl | None = field(default_factory=TractionControl)
    """How the traction valves throttle spinning wheels; None: they stay open."""
    act_arms: bool = False
    """Add the four pendulum arms to the action, in place of ``arms``."""
    act_traction: bool = False
    """Add the four traction valves to the action, in place of ``traction``: 0 and above is open, −1 is closed."""
    act_gear: bool = False
    """Add the gear to the action: thirds of its range."""
    observe_inertial: bool = False
    """Add roll rate, pitch rate and specific force to the observation."""
    scan_x: tuple[float, ...] = ()
    """Places ahead of the reference point [m] whose ground is scanned, each at all of ``scan_y``; none by default."""
    scan_y: tuple[float, ...] = (-1.5, -0.75, 0.0, 0.75, 1.5)
    """Places to its left [m]."""
    antennas: Antennas = field(default_factory=Antennas)
    gps_latency: float = 0.04
    """[s]"""
    gps_noise: GpsNoise = field(default_factory=GpsNoise.typical)
    imu_noise: ImuNoise = field(default_factory=ImuNoise.typical)
    wheel_speed_noise: WheelSpeedNoise = field(default_factory=WheelSpeedNoise.typical)
    joint_angle_noise: JointAngleNoise = field(default_factory=JointAngleNoise.published)
    pressure_noise: PressureNoise = field(default_factory=PressureNoise.typical)
    localisation: LocalisationGains = field(default_factory=LocalisationGains)
    reward_terms: Mapping[str, RewardTerm] = field(default_factory=lambda: REWARD_TERMS)
    observation_terms: Mapping[str, ObservationTerm] = field(default_factory=lambda: OBSERVATION_TERMS)
    randomisation: PathTrackingRandomisation = FIXED

    def __post_init__(self) -> None:
        for name in ("working_speed", "stuck_distance", "stuck_time", "path_limit", "end_tolerance"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, but must be positive and finite")
        for holds, message in (
            (0.0 < self.control_step <= 0.1, f"control_step is {self.control_step} s, but must be in (0, 0.1] s"),
            (divides(self.sample_step, self.control_step), f"sample_step is {self.sample_step} s, but must divide "
             f"control_step = {self.control_step} s"),
            (self.time_margin >= 1.0, f"time_margin is {self.time_margin}, but must be at least 1"),
            (len(self.preview) > 0 and all(0.0 < d <= 50.0 for d in self.preview), f"preview is {self.preview} m, but must "
             "be at least one distance in (0, 50] m"),
            (self.action_memory >= 2, f"action_memory is {self.action_memory}, but must be at least 2"),
            (self.rate_samples >= 2, f"rate_samples is {self.rate_samples}, but must be at least 2"),
            (self.start_distance >= 0.0, f"start_distance is {self.start_distance} m, but must be at least 0"),
            (0.0 < self.rollover < 0.5 * math.pi, f"rollover is {self.rollover} rad, but must be in (0, π/2)"),
            (self.gear in (1, 2, 3, "automatic"), f"gear is {self.gear!r}; choose 1, 2, 3 or 'automatic'"),
            (not (self.act_gear and self.gear == "automatic"), "act_gear is set and gear is 'automatic'; drop one of them"),
            (isinstance(self.randomisation, PathTrackingRandomisation), "randomisation must be a "
             f"PathTrackingRandomisation, but is a {type(self.randomisation).__name__}"),
        ):  # fmt: skip
            if not holds:
                raise ValueError(message)


# ---- the task --------------------------------------------------------------------------------------------------------


class PathTracking:
    """Paths, measurements and judgement of N vehicles; see :class:`aoro_gym.envs.core.task.Task`."""

    option_names: ClassVar[tuple[str, ...]] = ("path", "start", "lateral_offset", "heading_offset", "joint_angle")
    render_channels: ClassVar[tuple[str, ...]] = (
        "time", "course", "path", "s", "x", "y", "z", "roll", "pitch", "yaw", "joint_angle",
        *(f"arm_{wheel}" for wheel in WHEELS), *(f"wheel_{wheel}" for wheel in WHEELS), "reference_x", "reference_y",
        "cross_track", "measured_cross_track", "speed", "steering_signal", "drive_signal", "gear", "tipping_margin",
    )  # fmt: skip
    render_span: ClassVar[float] = 90.0

    def __init__(self, courses: Sequence[Course], config: PathTrackingConfig | None = None):
        self.config = PathTrackingConfig() if config is None else config
        self.courses = tuple(courses)
        self.control_step = self.config.control_step
        self.sample_step = self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        config = self.config
        sizes = {
            STEERING: 1,
            DRIVE: 1,
            ARMS: 4 * config.act_arms,
            TRACTION: 4 * config.act_traction,
            GEAR: config.act_gear,
        }
        self.action_layout: dict[str, slice] = {}
        """Columns of the action by name."""
        end = 0
        for name, size in sizes.items():
            if size:
                self.action_layout[name] = slice(end, end + size)
                end += size
        self.action_space: spaces.Box[Any] = spaces.Box(-1.0, 1.0, (end,), np.float32)
        paths = [path for course in self.courses for path in course.paths]
        for path in paths:
            self._check_length(path)
        self._library = len(paths)
        self._num_paths = np.array([len(course.paths) for course in self.courses])
        self._first_path = np.cumsum(self._num_paths) - self._num_paths

    def _check_length(self, path: Path) -> None:
        least = (0.0 if path.closed else self.config.start_distance) + 2.0
        if path.length < least:
            raise ValueError(f"path {path.name!r} is {path.length:.2f} m long, but must be at least {least:.2f} m")

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        self._arrays, xp = arrays, arrays.xp
        n, config = num_envs, self.config
        paths = [path for course in self.courses for path in course.paths]
        self.table = PathTable(paths, ahead=max(*config.preview, 10.0) + 2.0, arrays=arrays)
        """All paths, those of a course after those of the course before."""
        self.height_map = HeightMap([course.terrain for course in self.courses], arrays)
        frames = round(config.control_step / config.sample_step)
        self._outputs = Outputs(
            arrays.zeros((frames, len(Output), n), xp.float32), arrays.zeros((len(State), n), xp.float32)
        )
        self._distances = arrays.asarray([0.0, *config.preview])
        self._scan = arrays.asarray([(x, y) for x in config.scan_x for y in config.scan_y])
        # where to drive
        self._course, self._path = arrays.zeros(n, xp.int64), arrays.zeros(n, xp.int64)
        self._path_number = arrays.zeros(n, xp.int64)  # among the course's own
        self._length = arrays.zeros(n)
        self._steps_allowed = arrays.ones(n, xp.int64)
        self._step = arrays.zeros(n, xp.int64)
        # the machine
        self._front, self._rear, self._half_track = arrays.ones(n), arrays.ones(n), arrays.ones(n)
        self._rolling_radius, self._top_speed = arrays.ones(n), arrays.ones(n)
        self._rod_share, self._arm_length, self._arm_dead_band = arrays.ones(n), arrays.ones(n), arrays.zeros(n)
        self._arm_rest = arrays.zeros((4, n))
        # true motion
        self._s, self._start_s, self._progress = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._reference, self._rear_axle = arrays.zeros((n, 2)), arrays.zeros((n, 2))
        self._cross_track, self._heading_error = arrays.zeros(n), arrays.zeros(n)
        self._tipping_margin, self._power, self._work = arrays.ones(n), arrays.zeros(n), arrays.zeros(n)
        self._squares = arrays.zeros(n)  # [m²] sum of the squared cross-track errors
        self._mark_s, self._mark_step = arrays.zeros(n), arrays.zeros(n, xp.int64)
        self._ending = arrays.zeros(n, xp.int64)
        # measurement
        self._noise = arrays.ones(n)
        self._measured_s, self._measured_cross_track = arrays.zeros(n), arrays.zeros(n)
        self._measured_heading_error = arrays.zeros(n)
        self._roll, self._pitch = arrays.zeros(n), arrays.zeros(n)
        self._rates, self._force = arrays.zeros((n, 3)), arrays.zeros((n, 3))
        self._wheel_rates, self._speed = arrays.zeros((n, 4)), arrays.zeros(n)
        self._actions = arrays.zeros((config.action_memory, n, self.action_space.shape[0]), xp.float32)
        self._view: PathTrackingView | None = None
        # sensors and controllers
        self._joint = MeasuredJoint(
            n,
            config.joint_angle_noise,
            interval=config.sample_step,
            frames=frames,
            kept=config.rate_samples,
            arrays=arrays,
        )
        self._imu = Imu(n, config.imu_noise, accelerometers=config.observe_inertial, arrays=arrays)
        self._wheel_sensor = WheelSpeedSensor(n, config.wheel_speed_noise, arrays=arrays)
        self._gps = Gps(
            n, config.gps_noise, antennas=config.antennas, latency=config.gps_latency, interval=config.control_step,
            arrays=arrays,
        )  # fmt: skip
        self._localisation = Localisation(n, antennas=config.antennas, gains=config.localisation, arrays=arrays)
        self._pressure_rows = {channel: row for row, channel in enumerate(self._pressures_used())}
        self._pressures = arrays.zeros((len(self._pressure_rows), n))
        self._pressure_sensor = PressureSensor(n, config.pressure_noise, count=len(self._pressure_rows), arrays=arrays)
        self._gear = AutomaticGear(n, config.gear_shift, arrays)
        self._arms = ArmController(n, config.arms, arrays)
        self._openings = arrays.ones((n, 4))

    def _pressures_used(self) -> list[str]:
        """Channels of the pressure sensors that a controller reads."""
        used = ["drive_pressure_forward", "drive_pressure_return"] if self.config.gear == "automatic" else []
        if self.config.arms is not None and not self.config.act_arms:
            used += [f"arm_pressure_{end}_{wheel}" for end in ("bore", "rod") for wheel in WHEELS]
        return used

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        config, arrays, n = self.config, self._arrays, len(self._s)
        course = chosen(options, "terrain", len(self.courses), where, n, generators)
        path = self._asked_path(options, course, where, generators)
        front, rear = self._know(machine, where)

        # the front axle's middle and, one machine behind, the rear one's
        length = self.table.lengths[path]
        first = np.array([0.0 if self.table.paths[row].closed else config.start_distance for row in path])
        last = np.maximum(length - 2.0, first)
        s = given(options, "start", where, n, first + draws.task["start"] * (last - first), 0.0, np.inf, "m")
        if np.any(s > last):
            bad = int(np.argmax(s > last))
            raise ValueError(
                f"options['start'] is {s[bad]:g} m, but that path is {length[bad]:.2f} m long; start 2 m before its end"
            )
        offset = given(options, "lateral_offset", where, n, draws.task["lateral_offset"], -np.inf, np.inf, "m")
        turned = given(options, "heading_offset", where, n, draws.task["heading_offset"], -np.pi, np.pi, "rad")
        place, along, bend = map(arrays.host, self.table.at(arrays.index(path), arrays.asarray(s)))
        heading = wrapped(along + turned)
        reference = place + offset[:, None] * np.stack([-np.sin(along), np.cos(along)], axis=1)
        hinge = reference - front[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        limit = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), len(where))
        # a steady turn of curvature κ bends the joint by κ times the wheelbase, at small angles
        angle = bend * (front + rear) + draws.joint_angle * limit
        angle = given(options, "joint_angle", where, n, np.clip(angle, -limit, limit), -limit, limit, "rad")
        behind = hinge - rear[:, None] * np.stack([np.cos(heading - angle), np.sin(heading - angle)], axis=1)
        axles = arrays.asarray(np.stack([reference, behind]))
        there = arrays.host(self.height_map.known(arrays.index(course), axles)).all(axis=0)
        if not there.all():
            bad = int(np.argmin(there))
            raise ValueError(
                f"path {self.table.paths[path[bad]].name!r} starts at "
                f"({reference[bad, 0]:.1f}, {reference[bad, 1]:.1f}) m, where "
                f"terrain {course[bad]} has no ground for both axles; give a path within it"
            )

        rows = arrays.index(where)
        duration = (length - s) / config.working_speed * config.time_margin
        allowed = np.maximum(np.ceil(duration / config.control_step), 1)
        number = np.where(path < self._library, path - self._first_path[course], path)
        values = arrays.asarray(np.stack([course, path, number, length, s, allowed, draws.sensor_noise]))
        for states, value in zip(
            (
                (self._course,), (self._path,), (self._path_number,), (self._length,), (self._s, self._measured_s),
                (self._steps_allowed,), (self._noise, self._joint.scale, self._gps.scale, self._imu.scale),
            ),
            values, strict=True,
        ):  # fmt: skip
            for state in states:
                arrays.put(state, rows, value)
        for state in (
            self._step, self._mark_step, self._ending, self._progress, self._power, self._work, self._squares,
        ):  # fmt: skip
            state[rows] = 0
        self._tipping_margin[rows] = 1.0
        sensor_draws = sensing(options, where, n, generators)
        for sensor in (self._joint, self._imu, self._wheel_sensor, self._gps, self._pressure_sensor):
            sensor.reset(rows, sensor_draws)
        self._actions[:, rows] = 0.0
        self._gear.reset(rows)
        self._arms.reset(rows)
        self._openings[rows] = 1.0
        if config.gear != "automatic":
            self._gear.gear[rows] = 1.0 if config.act_gear else float(config.gear)
        return Start(
            joint_angle=angle,
            heading=heading,
            position=hinge,
            terrain=None if isinstance(self.courses[0].terrain, Plane) else course,
        )

    def _asked_path(
        self,
        options: Mapping[str, Any],
        course: NDArray[np.intp],
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
    ) -> NDArray[np.intp]:
        """Rows (K,) of the table: a path of the course, drawn or asked for, or one that the option brings along."""
        asked = options.get("path")
        if isinstance(asked, Path):
            self._check_length(asked)
            others = np.delete(self._arrays.host(self._path), where)
            if self.table.paths[-1] is not asked:
                if not np.any(others >= self._library):  # nobody drives on what was brought before
                    self.table.shortened(self._library)
                self.table.add([asked])
            return np.full(len(where), len(self.table) - 1, dtype=np.intp)
        return self._first_path[course] + chosen(
            options, "path", self._num_paths[course], where, len(self._s), generators
        )

    def _know(self, machine: Machine, where: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take over the machine's measures: the controller knows its vehicle. Gives the distances (K,) [m] of the front and
        of the rear axle from the hinge."""
        arrays, rows, driveline, tire = self._arrays, self._arrays.index(where), machine.driveline, machine.tire
        radius = tire.radius  # the rims of the twin's discs roll where the ground is pressed in: calibrated, as it were
        flow = driveline.pump.displacement * machine.engine.set_speed
        front, rear = (
            np.broadcast_to(np.asarray(frame.axle_distance, dtype=np.float64), where.shape)
            for frame in (machine.frame.front, machine.frame.rear)
        )
        for state, value in (
            (self._front, front),
            (self._rear, rear),
            (self._half_track, 0.5 * machine.frame.track),
            (self._rolling_radius, radius),
            (self._top_speed, flow / (4.0 * driveline.motor.displacement) * radius),
            (self._arm_length, machine.arm.length),
            (self._arm_dead_band, machine.arm.valve.dead_band),
            (self._rod_share, machine.arm.cylinder.annulus_area / machine.arm.cylinder.bore_area),
        ):
            arrays.put(state, rows, value)
        arrays.put(self._arm_rest, (slice(0, 2), rows), machine.rest.arm_angle_front)
        arrays.put(self._arm_rest, (slice(2, 4), rows), machine.rest.arm_angle_rear)
        return front, rear

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs, self._view = outputs, None
        self._joint.begin(outputs.last("joint_angle")[where], where)
        fix = self._sense(where, self._arrays.zeros(len(where)))
        self._localisation.begin(fix, self._roll[where], self._pitch[where], self._place()[where], where)
        self._follow(where)
        self._start_s[where] = self._mark_s[where] = self._s[where]

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        config, layout = self.config, self.action_layout
        xp = self._arrays.xp
        self._actions = xp.concat([actions[None], self._actions[:-1]])
        drive = actions[:, layout[DRIVE]][:, 0]
        commands = {STEERING: actions[:, layout[STEERING]][:, 0], DRIVE: drive}
        if config.act_gear:
            part = actions[:, layout[GEAR]][:, 0]
            self._gear.gear = 1.0 + floats(part >= -1.0 / 3.0) + floats(part >= 1.0 / 3.0)
        elif config.gear == "automatic":
            rows = self._pressure_rows
            drop = self._pressures[rows["drive_pressure_forward"]] - self._pressures[rows["drive_pressure_return"]]
            self._gear.update(drive, self._speed, drop, self._top_speed, self.control_step)
        commands[GEAR] = self._gear.gear
        if config.act_arms:
            commands |= _each("arm", actions[:, layout[ARMS]].T)
        elif config.arms is not None:
            commands |= _each("arm", self._arm_signals())
        if config.act_traction:
            commands |= _each("traction", xp.clip(1.0 + actions[:, layout[TRACTION]], None, 1.0).T)
        elif config.traction is not None:
            self._openings = config.traction.openings(self._openings, self._wheel_rates, self.control_step)
            commands |= _each("traction", self._openings.T)
        return commands

    def _arm_signals(self) -> Array:
        stance = Stance(
            self._front, self._rear, self._half_track, self._arm_length, self._arm_rest, self._arm_dead_band
        )
        # the channels of the four corners follow each other
        first = (self._pressure_rows[f"arm_pressure_{end}_{WHEELS[0]}"] for end in ("bore", "rod"))
        bore, rod = (self._pressures[row : row + len(WHEELS)] for row in first)
        return self._arms.update(
            bore - self._rod_share * rod, self._arm_angles(), self._roll, self._pitch, self._joint.angle, stance,
            self.control_step,
        )  # fmt: skip

    def advance(self, outputs: Outputs, time: Array) -> None:
        xp, config = self._arrays.xp, self.config
        self._outputs, self._view = outputs, None
        self._step = self._step + 1

        # what is measured
        self._joint.update(outputs.samples("joint_angle"), time)
        fix = self._sense(ALL, time)
        self._localisation.update(
            fix, self._roll, self._pitch, self._place(),
            speed=self._speed, yaw_rate=self._rates[:, 2], step=config.control_step,
        )  # fmt: skip

        # what happened
        before = xp.asarray(self._s, copy=True)
        self._follow(ALL)
        self._progress = self._s - before
        fl, fr, rl, rr = _mean(outputs.group("wheel_load_fl", len(WHEELS)))
        total = xp.clip(fl + fr + rl + rr, 1.0, None)
        self._tipping_margin = 1.0 - xp.maximum(xp.abs(fl + rl - fr - rr), xp.abs(fl + fr - rl - rr)) / total
        self._power = _mean(outputs.samples("engine_torque") * outputs.samples("engine_speed"))
        self._work = self._work + self._power * config.control_step
        self._squares = self._squares + self._cross_track**2
        self._judge()

    def _judge(self) -> None:
        """How episodes end; of several reasons the worst."""
        xp, config = self._arrays.xp, self.config
        gained = self._s >= self._mark_s + config.stuck_distance
        self._mark_s = xp.where(gained, self._s, self._mark_s)
        self._mark_step = xp.where(gained, self._step, self._mark_step)
        roll, pitch = self._outputs.last("roll"), self._outputs.last("pitch")
        on_ground = self.height_map.known(self._course, xp.stack([self._reference, self._rear_axle]))
        ending = xp.zeros_like(self._ending)
        for reason, holds in (
            (END_OF_PATH, self._s >= self._length - config.end_tolerance),
            ("stuck", floats(self._step - self._mark_step) * config.control_step >= config.stuck_time),
            ("lost the path", xp.abs(self._cross_track) > config.path_limit),
            ("left the terrain", ~(on_ground[0] & on_ground[1])),
            ("rolled over", xp.cos(roll) * xp.cos(pitch) < math.cos(config.rollover)),
        ):
            ending = xp.where(holds, ENDINGS.index(reason), ending)
        self._ending = ending

    def endings(self) -> tuple[Array, list[str]]:
        return self._ending, ENDINGS

    def overdue(self) -> Array:
        return self._step >= self._steps_allowed

    def renew(self) -> None:
        """The path stays as it is."""

    # ---- geometry and sensors

    def _place(self) -> Array:
        """The reference point in the front frame's axes [m] (N, 3)."""
        zero = self._arrays.xp.zeros_like(self._front)
        return self._arrays.xp.stack([self._front, zero, zero], axis=1)

    def _true_pose(self, rows: Index) -> tuple[Array, Array, Array, Array]:
        """Position of the hinge [m] (K, 3), roll, pitch and yaw [rad] (K,) of the sub-environments ``rows``."""
        values = floats(self._outputs.group("position_x", 6)[-1][:, rows])
        return values[:3].T, values[3], values[4], values[5]

    def _follow(self, rows: Index) -> None:
        """Where the sub-environments ``rows`` are, and where on their paths they are and believe to be."""
        xp = self._arrays.xp
        position, roll, pitch, yaw = self._true_pose(rows)
        reference = (position + in_world(roll, pitch, yaw, self._place()[rows]))[:, :2]
        rear = yaw - self._outputs.last("joint_angle")[rows]
        behind = self._rear[rows][:, None] * xp.stack([xp.cos(rear), xp.sin(rear)], axis=1)
        self._reference[rows], self._rear_axle[rows] = reference, position[:, :2] - behind

        path = xp.concat([self._path[rows]] * 2)
        s, cross_track = self.table.project(
            path,
            xp.concat([reference, self._localisation.position[rows]]),
            xp.concat([self._s[rows], self._measured_s[rows]]),
            reach=PROJECTION_REACH,
        )
        _, _, cosine, sine, _ = self.table.places(path, s)
        error = wrapped(xp.concat([yaw, self._localisation.heading[rows]]) - xp.atan2(sine, cosine))
        for value, (true, measured) in (
            (s, (self._s, self._measured_s)),
            (cross_track, (self._cross_track, self._measured_cross_track)),
            (error, (self._heading_error, self._measured_heading_error)),
        ):
            true[rows], measured[rows] = value[: len(yaw)], value[len(yaw) :]

    def _arm_angles(self) -> Array:
        return self._outputs.group(f"arm_angle_{WHEELS[0]}", len(WHEELS))[-1]

    def _sense(self, rows: Index, time: Array) -> GpsReading:
        """One reading of every other sensor of the sub-environments ``rows``; gives that of the GPS."""
        xp, config, outputs = self._arrays.xp, self.config, self._outputs
        asked = None if rows is ALL else rows
        position, roll, pitch, yaw = self._true_pose(rows)
        noise = self._noise[rows]

        rates, force = floats(outputs.states("WX", 3)[:, rows]).T, None
        if config.observe_inertial:
            force = specific_force(
                outputs.states("VX", 3)[:, rows].T, outputs.states("AVX", 3)[:, rows].T, rates,
                outputs.states("AWX", 3)[:, rows].T, roll, pitch,
            )  # fmt: skip
        inertial = self._imu.measure(rates, force, roll, pitch, time, asked)
        self._roll[rows], self._pitch[rows], self._rates[rows] = inertial.roll, inertial.pitch, inertial.rates
        if inertial.force is not None:
            self._force[rows] = inertial.force

        true = floats(outputs.group(f"wheel_rate_{WHEELS[0]}", len(WHEELS))[-1][:, rows]).T
        shown = true + noise[:, None] * (self._wheel_sensor.measure(true, time, asked) - true)
        self._wheel_rates[rows] = shown
        self._speed[rows] = ground_speed(shown, self._rolling_radius[rows])
        if self._pressure_rows:
            level = floats(xp.stack([outputs.last(channel)[rows] for channel in self._pressure_rows]))
            self._pressures[:, rows] = level + noise * (self._pressure_sensor.measure(level, time, asked) - level)
        return self._gps.measure(position, roll, pitch, yaw, time, asked)

    # ---- what others see

    def view(self) -> PathTrackingView:
        if self._view is None:
            self._view = self._seen()
        return self._view

    def _seen(self) -> PathTrackingView:
        xp, config = self._arrays.xp, self.config
        here, heading = self._localisation.position, self._localisation.heading
        x, y, _, _, bends = self.table.places(self._path[:, None], self._measured_s[:, None] + self._distances)
        x, y = x[:, 1:] - here[:, :1], y[:, 1:] - here[:, 1:]
        s, c = xp.sin(heading)[:, None], xp.cos(heading)[:, None]
        return PathTrackingView(
            xp=xp,
            control_step=self.control_step,
            working_speed=config.working_speed,
            cross_track=self._cross_track,
            heading_error=self._heading_error,
            progress=self._progress,
            remaining=self._length - self._s,
            speed=self._outputs.last("speed"),
            tipping_margin=self._tipping_margin,
            engine_power=self._power,
            finished=self._ending == ENDINGS.index(END_OF_PATH),
            failed=self._ending > ENDINGS.index(END_OF_PATH),
            measured_cross_track=self._measured_cross_track,
            measured_heading_error=self._measured_heading_error,
            measured_remaining=self._length - self._measured_s,
            preview=xp.stack([c * x + s * y, c * y - s * x], axis=-1),
            curvature=bends,
            measured_speed=self._speed,
            measured_angle=self._joint.angle,
            measured_rate=self._joint.rate,
            measured_roll=self._roll,
            measured_pitch=self._pitch,
            measured_rates=self._rates,
            measured_force=self._force,
            measured_wheel_rates=self._wheel_rates,
            gear=self._gear.gear,
            actions=xp.permute_dims(self._actions, (1, 0, 2)),
            heights=self._heights(),
            outputs=self._outputs,
        )

    def _heights(self) -> Array:
        """Ground at the scan's places over that at the reference point [m] (N, G), at the true pose."""
        if not len(self._scan):
            return self._arrays.zeros((len(self._s), 0))
        xp, yaw = self._arrays.xp, floats(self._outputs.last("yaw"))[:, None]
        s, c = xp.sin(yaw), xp.cos(yaw)
        x, y = self._scan[:, 0], self._scan[:, 1]
        places = self._reference[:, None] + xp.stack([c * x - s * y, s * x + c * y], axis=-1)
        base = self.height_map.height(self._course, self._reference)
        return self.height_map.height(self._course[:, None], places) - base[:, None]

    def info(self) -> dict[str, Array]:
        """``is_success``: the end of the path was reached. Errors are true ones; ``cross_track_rms`` is over the episode,
        ``engine_work`` [J], too; ``mean_speed`` is path gained over time."""
        xp, steps = self._arrays.xp, floats(self._arrays.xp.clip(self._step, 1, None))
        return {
            "cross_track": xp.asarray(self._cross_track, copy=True),
            "heading_error": xp.asarray(self._heading_error, copy=True),
            "cross_track_rms": xp.sqrt(self._squares / steps),
            "mean_speed": (self._s - self._start_s) / (steps * self.control_step),
            "remaining": self._length - self._s,
            "tipping_margin": xp.asarray(self._tipping_margin, copy=True),
            "engine_work": xp.asarray(self._work, copy=True),
            "gear": xp.astype(self._gear.gear, xp.int64),
            "gps_quality": xp.asarray(self._gps.quality, copy=True),
            "terrain": xp.asarray(self._course, copy=True),
            "path": xp.asarray(self._path_number, copy=True),
            "is_success": self._ending == ENDINGS.index(END_OF_PATH),
        }

    def traces(self) -> Array:
        last, layout = self._outputs.last, self.action_layout
        newest = self._actions[0]
        return self._arrays.xp.stack(
            [
                self._step * self.control_step, self._course, self._path, self._s,
                *(last(name) for name in ("position_x", "position_y", "position_z", "roll", "pitch", "yaw", "joint_angle")),
                *self._arm_angles(), *self._outputs.states("WHEEL_FL", len(WHEELS)),
                self._reference[:, 0], self._reference[:, 1], self._cross_track, self._measured_cross_track, last("speed"),
                newest[:, layout[STEERING]][:, 0], newest[:, layout[DRIVE]][:, 0], self._gear.gear, self._tipping_margin,
            ]
        )  # fmt: skip

    def scene(self, machine: Machine) -> Any:
        from aoro_gym.envs.path_tracking.rendering import PathTrackingScene

        return PathTrackingScene(machine, self)


def _each(name: str, rows: Array) -> dict[str, Array]:
    """Commands of the four corners from rows (4, N)."""
    return {f"{name}_{wheel}": row for wheel, row in zip(WHEELS, rows, strict=True)}


def _mean(samples: Array) -> Array:
    """Mean over the frames (F, ...), in an order that does not depend on their number of columns."""
    total = floats(samples[0])
    for frame in samples[1:]:
        total = total + frame
    return total / len(samples)


def _arm_control(arms: ArmControl | str) -> ArmControl | None:
    if isinstance(arms, ArmControl):
        return arms
    known = {"hold": None, "share": ArmControl.sharing(), "level": ArmControl.levelling()}
    if arms not in known:
        raise ValueError(f"arms is {arms!r}; choose one of: {', '.join(map(repr, known))}, or give an ArmControl")
    return known[arms]


# ---- the environments ------------------------------------------------------------------------------------------------


class PathTrackingVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/PathTracking-v0", num_envs=N)``: N vehicles on their paths, the twins of one launch.

    **Action**: steering signal (positive left) and drive signal (positive forward), then what the options add, by
    ``action_layout``. **Observation**: the terms of ``OBSERVATION_TERMS`` in their order; ``observation_layout`` gives the
    columns. **Reward**: the weighted terms of ``REWARD_TERMS``.

    **Episode**: see :mod:`aoro_gym.envs.path_tracking.task`. ``info["is_success"]`` tells that the end of the path was
    reached, and ``info["termination"]`` why an episode terminated.

    ``reset(options=...)`` also takes ``path``, a whole number (of the terrain's paths) or (num_envs,) of them, or a
    :class:`~aoro_gym.terrains.Path`; ``start`` [m] along it; ``lateral_offset`` [m]; ``heading_offset`` [rad];
    ``joint_angle`` [rad], each a number or (num_envs,).

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`PathTrackingConfig`.
        courses: Terrains with their paths to draw from; by default a small library of generated forests.
        terrain: Instead: one ground, with ``path`` or with paths that are generated.
        path: The only path on it.
        reward_terms: Changes to the reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to the observation terms by name.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        gear: 1, 2, 3 or ``"automatic"``.
        arms: ``"share"`` the weight (the default), ``"level"`` the frames, too, or ``"hold"``; or an
            :class:`~aoro_gym.envs.path_tracking.assistance.ArmControl`.
        act_arms: Add the arms to the action; likewise ``act_traction`` and ``act_gear``.
        act_traction: See :class:`PathTrackingConfig`.
        act_gear: See there.
        observe_inertial: Add roll rate, pitch rate and specific force to the observation.
        scan_x: Places ahead [m] whose ground is scanned.
        arguments: See :class:`TwinVectorEnv`: machine, ground, device, output, own_machines, autoreset_mode,
            max_episode_steps, render_mode.
    """

    task: PathTracking

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: PathTrackingConfig | None = None,
        courses: Sequence[Course] | None = None,
        terrain: Terrain | Plane | None = None,
        path: Path | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | None] | None = None,
        randomisation: PathTrackingRandomisation | None = None,
        gear: int | str | None = None,
        arms: ArmControl | str | None = None,
        act_arms: bool | None = None,
        act_traction: bool | None = None,
        act_gear: bool | None = None,
        observe_inertial: bool | None = None,
        scan_x: tuple[float, ...] | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        config = PathTrackingConfig() if config is None else config
        if arms is not None:
            config = replace(config, arms=_arm_control(arms))
        changes = {
            "randomisation": randomisation,
            "gear": gear,
            "act_arms": act_arms,
            "act_traction": act_traction,
            "act_gear": act_gear,
            "observe_inertial": observe_inertial,
            "scan_x": scan_x,
        }
        config = replace(config, **{name: value for name, value in changes.items() if value is not None})
        observed = {
            **config.observation_terms,
            **(GEAR_TERMS if config.act_gear or config.gear == "automatic" else {}),
            **(INERTIAL_TERMS if config.observe_inertial else {}),
            **(HEIGHT_TERMS if config.scan_x else {}),
        }
        config = replace(
            config,
            reward_terms=changed_rewards(config.reward_terms, reward_terms),
            observation_terms=changed_observations(observed, observation_terms),
        )
        library = as_courses(courses, terrain, path)
        grounds = [course.terrain for course in library]
        terrains = [ground for ground in grounds if isinstance(ground, Terrain)]
        super().__init__(PathTracking(library, config), num_envs, terrain=terrains or grounds[0], **arguments)

    @property
    def action_layout(self) -> dict[str, slice]:
        """Where each signal stands in the action."""
        return self.task.action_layout


class PathTrackingEnv(TwinEnv):
    """``gymnasium.make("AORO/PathTracking-v0")``: one vehicle on its path; see :class:`PathTrackingVectorEnv`."""

    vector_type = PathTrackingVectorEnv
    vector: PathTrackingVectorEnv

    @property
    def action_layout(self) -> dict[str, slice]:
        """Where each signal stands in the action."""
        return self.vector.action_layout
