"""``AORO/Loading-v0``: grasp a log that lies beside the machine, and put it on the bunk, at 10 Hz.

The machine stands on level ground, its brake set, its crane unfolded. Four signals open the crane's valves, one turns the
grapple (a rotator without inertia), one closes it. A closed grapple gets hold of the log where it is near enough, along it
and slow; the log is then fast in the grapple, with its mass and inertia on the twin's crane, until the grapple opens. It
ends well where the log then lies on the bunk, badly where it drops elsewhere, where the grapple is driven into the ground
or the machine tips; it is truncated after ``time_limit``.

What is not modelled: log, crane, stakes and ground do not touch each other but for that grasp, and the grapple does not
swing: :attr:`LoadingView.sway` is how far a grapple that hangs freely would swing under the tip's motion, a pendulum that
takes no part in the twin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import Outputs, Start, StepResult, Terrains, chosen, sensing
from aoro_gym.envs.loading.config import SIGNALS, LoadingConfig
from aoro_gym.envs.loading.logs import LogSite
from aoro_gym.envs.loading.sensing import LoadingSensors
from aoro_gym.envs.loading.view import LoadingView
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.machine import Machine
from aoro_gym.terrains import Plane
from aoro_gym.twin.frame_cranes import GRAPPLE_DROP, moments_of_log
from aoro_gym.twin.records import CRANE_OUTPUT_UNITS, CraneRow, Output
from aoro_gym.units import GRAVITY

PLACED = "on the bunk"
TERMINATION_REASONS = ("", PLACED, "dropped beside the bunk", "grapple in the ground", "tipped over")
"""Why an episode terminates, besides a simulation that diverged."""
SWAY_DAMPING = 0.05
"""Of the pendulum of :attr:`LoadingView.sway`, a share of the critical damping. (E)"""


class Loading:
    """Logs, measurements and judgement of N cranes; see :class:`aoro_gym.envs.core.task.Task`.

    Args:
        courses: Sites with logs to draw from.
        config: The task.
    """

    option_names: ClassVar[tuple[str, ...]] = ("site", "log")
    termination_reasons: ClassVar[tuple[str, ...]] = TERMINATION_REASONS
    render_channels: ClassVar[tuple[str, ...]] = (
        "time", "slew", "lift", "fold", "telescope", "rotator", "closed", "held", "log_x", "log_y", "log_z", "log_yaw",
        "log_length", "log_diameter", "remaining", "sway", "power", "load", "roll", "pitch",
        *(f"signal_{name}" for name in SIGNALS),
    )  # fmt: skip
    render_span: ClassVar[float] = 20.0

    def __init__(self, courses: Sequence[LogSite], config: LoadingConfig | None = None):
        self.config = LoadingConfig() if config is None else config
        self.sites = tuple(courses)
        """With logs to draw from."""
        if not self.sites:
            raise ValueError("courses are empty; give at least one site with logs")
        self.crane = replace(self.config.crane, log_contact=False)
        """Of the twins, where nothing touches the log but the grapple."""
        self.control_step, self.sample_step = self.config.control_step, self.config.sample_step
        self.reward_terms = self.config.reward_terms
        self.observation_terms = self.config.observation_terms
        self.randomisation = self.config.randomisation
        self.action_layout = {name: slice(i, i + 1) for i, name in enumerate(SIGNALS)}
        """Columns of the action by name."""
        self.action_space: spaces.Box[Any] = spaces.Box(-1.0, 1.0, (len(SIGNALS),), np.float32)

    def allocate(self, num_envs: int, terrains: Terrains, arrays: Arrays = HOST) -> None:
        if not isinstance(terrains, Plane):
            raise ValueError("logs are loaded on level ground yet; leave terrain out, or give a Plane")
        self._arrays, n, xp = arrays, num_envs, arrays.xp
        frames, channels = round(self.control_step / self.sample_step), len(Output) + len(CRANE_OUTPUT_UNITS)
        self._outputs = Outputs(
            arrays.zeros((frames, channels, n), xp.float32), arrays.zeros((int(max(CraneRow)) + 1, n), xp.float32)
        )
        self._log = arrays.zeros((6, n))  # x, y, z, yaw [m, rad] in the world; length, diameter [m]
        self._held_record = arrays.zeros((3, n))  # mass, moments of inertia along and across, of the log
        self._bunk = arrays.zeros((3, n))  # [m] place of a log on the bunk in the front frame
        self._half_width = arrays.zeros(n)  # [m] of the bunk, for this log
        self._rotator, self._closed, self._held = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._signals = arrays.zeros((n, 2, len(SIGNALS)))
        self._tip, self._tip_rate = arrays.zeros((3, n)), arrays.zeros((3, n))  # [m] in the world
        self._swing, self._swing_rate = arrays.zeros((2, n)), arrays.zeros((2, n))  # [rad]
        self._grasp_point, self._in_frame = arrays.zeros((3, n)), arrays.zeros((3, n))  # in the world, in the frame
        self._remaining, self._nearer = arrays.zeros(n), arrays.zeros(n)
        self._misaligned, self._turned = arrays.zeros(n), arrays.zeros(n)
        self._grasped, self._ending = arrays.zeros(n, xp.bool), arrays.zeros(n, xp.int64)
        self._power, self._work, self._tilt = arrays.zeros(n), arrays.zeros(n), arrays.zeros(n)
        self._swayed, self._peak = arrays.zeros(n), arrays.zeros(n)
        self._step, self._time = arrays.zeros(n, xp.int64), arrays.zeros(n)
        self._sensors = LoadingSensors(n, self.config, arrays)
        self._view: LoadingView | None = None

    # ---- start

    def start(
        self,
        where: NDArray[np.intp],
        generators: list[np.random.Generator],
        draws: Draws,
        machine: Machine,
        options: Mapping[str, Any],
    ) -> Start:
        n, arrays = len(self._remaining), self._arrays
        by_difficulty = np.minimum((draws.task["difficulty"] * len(self.sites)).astype(int), len(self.sites) - 1)
        site = by_difficulty
        if options.get("site") is not None:
            site = chosen(options, "site", len(self.sites), where, n, generators)
        counts = np.array([len(self.sites[number].logs) for number in site])
        number = chosen(options, "log", counts, where, n, generators)
        logs = [self.sites[i].logs[k] for i, k in zip(site, number, strict=True)]
        length, diameter, mass = (
            np.array([getattr(one, name) for one in logs]) for name in ("length", "diameter", "mass")
        )
        x, y, yaw = (np.array([getattr(one, name) for one in logs]) for name in ("x", "y", "yaw"))
        bunk = machine.payload
        rows, put = arrays.index(where), arrays.put
        put(self._log, (slice(None), rows), np.stack([x, y, 0.5 * diameter, yaw, length, diameter]))
        put(self._held_record, (slice(None), rows), np.stack([mass, *moments_of_log(mass, length, diameter)]))
        place = np.broadcast_arrays(-bunk.distance, 0.0 * diameter, bunk.bunk_height + 0.5 * diameter)
        put(self._bunk, (slice(None), rows), np.stack(place))
        put(self._half_width, rows, 0.5 * (bunk.bunk_width - diameter))
        for state in (
            self._rotator, self._closed, self._held, self._nearer, self._turned, self._ending, self._power, self._work,
            self._tilt, self._swayed, self._peak, self._step, self._time,
        ):  # fmt: skip
            put(state, rows, 0)
        for state in (self._tip_rate, self._swing, self._swing_rate):
            put(state, (slice(None), rows), 0.0)
        put(self._grasped, rows, False)
        put(self._signals, rows, 0.0)
        self._sensors.reset(where, sensing(options, where, n, generators), draws.sensor_noise)
        zero = np.zeros(len(where))
        return Start(joint_angle=zero, heading=zero, position=np.zeros((len(where), 2)))

    def rest(self, where: Index, outputs: Outputs) -> None:
        self._outputs, self._view = outputs, None
        tip, point, frame = self._places()
        for state, value in ((self._tip, tip), (self._grasp_point, point), (self._in_frame, frame)):
            state[:, where] = value[:, where]
        remaining, misaligned = self._left()
        self._remaining[where], self._misaligned[where] = remaining[where], misaligned[where]
        self._sensors.begin(outputs, where)

    def _tip_at(self, joints: Array) -> Array:
        """Tip in the front frame [m] (3, N) at ``joints`` (4, N)."""
        xp, crane, foot = self._arrays.xp, self.crane.crane, self.crane.mount.foot
        slew, lift, fold, out = joints
        length, raised = crane.stick.length + out, lift + fold
        radius = crane.lift.offset + crane.boom.length * xp.cos(lift) + length * xp.cos(raised)
        height = crane.lift.height + crane.boom.length * xp.sin(lift) + length * xp.sin(raised)
        return xp.stack([foot.distance + radius * xp.cos(slew), radius * xp.sin(slew), foot.height + height])

    def _places(self) -> tuple[Array, Array, Array]:
        """Tip and grapple in the world, and the grapple in the front frame [m], each (3, N)."""
        tip = self._tip_at(self._crane_state(CraneRow.JOINT_SLEW, 4))
        frame = self._arrays.xp.stack([tip[0], tip[1], tip[2] - GRAPPLE_DROP])
        position = floats(self._outputs.states("X", 3))
        return position + self._turned_by(tip), position + self._turned_by(frame), frame

    def _crane_state(self, first: int, count: int) -> Array:
        """Rows of the twins' exact state of their cranes (count, N)."""
        assert self._outputs.state is not None
        return floats(self._outputs.state[int(first) : int(first) + count])

    def _turned_by(self, v: Array) -> Array:
        """Vectors (3, N) of the front frame in the world's axes: v + 2 q × (q × v + w v)."""
        xp = self._arrays.xp
        x, y, z, w = floats(self._outputs.states("QX", 4))

        def cross(b: Array) -> Array:
            return xp.stack([y * b[2] - z * b[1], z * b[0] - x * b[2], x * b[1] - y * b[0]])

        return v + 2.0 * cross(cross(v) + w * v)

    def _grapple_yaw(self) -> Array:
        """Angle of the grapple in the world's plan [rad]."""
        x, y, z, w = floats(self._outputs.states("QX", 4))
        heading = self._arrays.xp.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return self._crane_state(CraneRow.JOINT_SLEW, 1)[0] + self._rotator + heading

    def _left(self) -> tuple[Array, Array]:
        """Way [m] and angle [rad] that are left (N,)."""
        xp = self._arrays.xp
        to_bunk = _length(xp, self._bunk - self._in_frame)
        to_log = _length(xp, self._log[:3] - self._grasp_point)
        carry = _length(xp, self._bunk - self._log[:3])  # the front frame stands at the world's origin
        off_log = xp.abs(_half_turn(xp, self._log[3] - self._grapple_yaw()))
        off_bunk = xp.abs(_half_turn(xp, self._grapple_yaw()))
        held = self._held > 0.5
        return xp.where(held, to_bunk, to_log + carry), xp.where(held, off_bunk, off_log)

    # ---- step

    def commands(self, actions: Array) -> Mapping[str, Array]:
        xp, config = self._arrays.xp, self.config
        given = floats(actions)
        self._signals = xp.stack([given, self._signals[:, 0]], axis=1)
        self._rotator = self._rotator + config.control_step * config.rotator_rate * given[:, 4]
        self._closed = floats(given[:, 5] > 0.0)
        mass, axial, across = self._held_record
        return {
            **{name: actions[:, i] for i, name in enumerate(SIGNALS[:4])},
            "parking_brake": xp.ones_like(actions[:, 0]),
            "crane_held_mass": xp.astype(self._held * mass, xp.float32),
            "crane_held_yaw": xp.astype(self._rotator, xp.float32),
            "crane_held_axial": xp.astype(axial, xp.float32),
            "crane_held_transverse": xp.astype(across, xp.float32),
        }

    def advance(self, outputs: Outputs, time: Array) -> StepResult:
        xp, step = self._arrays.xp, self.config.control_step
        self._outputs, self._view = outputs, None
        tip, self._grasp_point, self._in_frame = self._places()
        rate = (tip - self._tip) / step
        self._swung((rate - self._tip_rate) / step)
        self._tip, self._tip_rate = tip, rate
        self._sensors.update(outputs, time)
        self._power = xp.mean(floats(outputs.samples("pump_pressure")) * floats(outputs.samples("pump_flow")), axis=0)
        self._work = self._work + step * self._power
        roll, pitch = floats(outputs.last("roll")), floats(outputs.last("pitch"))
        self._tilt = xp.acos(xp.clip(xp.cos(roll) * xp.cos(pitch), -1.0, 1.0))
        self._swayed = self._swayed + xp.sum(self._swing**2, axis=0)
        self._peak = xp.maximum(self._peak, _length(xp, self._swing))
        self._step, self._time = self._step + 1, xp.asarray(time, copy=True)
        self._judge()
        return StepResult(self.view(), self._ending, time >= self.config.time_limit - 0.5 * step)

    def _swung(self, acceleration: Array) -> None:
        """The pendulum's two swings after a step of the tip's ``acceleration`` [m/s²] (3, N), exact where that is constant:
        l φ̈ = −g φ − 2 ζ √(g l) φ̇ − a."""
        xp, step = self._arrays.xp, self.config.control_step
        omega = math.sqrt(GRAVITY / GRAPPLE_DROP)
        decay, own = SWAY_DAMPING * omega, omega * math.sqrt(1.0 - SWAY_DAMPING**2)
        fade, s, c = math.exp(-decay * step), math.sin(own * step), math.cos(own * step)
        rest = -acceleration[:2] / GRAVITY
        off, rate = self._swing - rest, self._swing_rate
        self._swing = rest + fade * (off * c + (rate + decay * off) / own * s)
        self._swing_rate = fade * (rate * c - (decay * rate + omega**2 * off) / own * s)
        self._swing = xp.clip(self._swing, -1.5, 1.5)

    def _judge(self) -> None:
        """Grasp, drop, and how episodes end; of several reasons the worst."""
        xp, config = self._arrays.xp, self.config
        held, closed = self._held > 0.5, self._closed > 0.5
        off = self._log[:3] - self._grasp_point
        aligned = xp.abs(_half_turn(xp, self._log[3] - self._grapple_yaw())) < config.grasp_angle
        near = (_length(xp, off[:2]) < config.grasp_distance) & (xp.abs(off[2]) < config.grasp_height)
        slow = _length(xp, self._tip_rate) < config.grasp_speed
        grasped = ~held & closed & near & aligned & slow
        let_go = held & ~closed
        # before the grasp counts as holding, so that what is left goes on from where it was
        remaining, misaligned = self._left()
        self._nearer, self._turned = self._remaining - remaining, self._misaligned - misaligned
        way = self._in_frame - self._bunk
        on_bunk = (xp.abs(way[0]) < config.bunk_length) & (xp.abs(way[1]) < self._half_width)
        on_bunk = on_bunk & (way[2] > -0.2) & (way[2] < config.bunk_height)
        on_bunk = on_bunk & (xp.abs(_half_turn(xp, self._grapple_yaw())) < config.bunk_angle)
        ending = xp.zeros_like(self._ending)
        for reason, holds in (
            (PLACED, let_go & on_bunk),
            ("dropped beside the bunk", let_go & ~on_bunk),
            ("grapple in the ground", self._grasp_point[2] < -config.ground_limit),
            ("tipped over", self._tilt > config.tilt_limit),
        ):
            ending = xp.where(holds, TERMINATION_REASONS.index(reason), ending)
        self._ending, self._grasped = ending, grasped
        self._held = floats((held | grasped) & ~let_go)
        after, misaligned = self._left()
        self._remaining, self._misaligned = after, misaligned
        moves = held | grasped
        carried = xp.stack([*self._grasp_point, self._grapple_yaw()])
        self._log = xp.concat([xp.where(moves, carried, self._log[:4]), self._log[4:]])

    # ---- what others see

    def view(self) -> LoadingView:
        if self._view is None:
            self._view = self._seen()
        return self._view

    def _seen(self) -> LoadingView:
        xp, sensors = self._arrays.xp, self._sensors
        free, placed = 1.0 - self._held, TERMINATION_REASONS.index(PLACED)
        # in the front frame, which stands on level ground: its lean moves the log by less than the camera's error
        to_log = (self._log[:3] - self._grasp_point) * free
        seen = xp.stack([to_log[0] + sensors.offset[0] * free, to_log[1] + sensors.offset[1] * free, to_log[2]])
        angle = _half_turn(xp, self._log[3] - self._grapple_yaw() + sensors.offset[2]) * free
        tip = self._tip_at(sensors.joints)
        to_bunk = self._bunk - xp.stack([tip[0], tip[1], tip[2] - GRAPPLE_DROP])
        return LoadingView(
            xp=xp,
            control_step=self.control_step,
            remaining=self._remaining,
            nearer=self._nearer,
            misaligned=self._misaligned,
            turned=self._turned,
            held=self._held,
            grasped=self._grasped,
            sway=_length(xp, self._swing),
            power=self._power,
            tilt=self._tilt,
            placed=self._ending == placed,
            failed=self._ending > placed,
            measured_joints=sensors.joints.T,
            measured_rates=sensors.rates.T,
            measured_load=xp.asarray(sensors.load, copy=True),
            measured_pressures=sensors.pressures.T,
            rotator=self._rotator,
            closed=self._closed,
            measured_log=seen.T,
            measured_log_angle=angle,
            bunk=to_bunk.T,
            bunk_angle=_half_turn(xp, -sensors.joints[0] - self._rotator),
            signals=self._signals,
            step=self._step,
            outputs=self._outputs,
        )

    def info(self) -> dict[str, Array]:
        """``is_success``: the log lies on the bunk, brought there with little swing (``LoadingConfig.sway_limit``).
        ``held``; ``remaining`` [m]; over the episode ``work`` [J] of the pump, ``sway_rms`` and ``largest_sway`` [rad];
        ``duration`` [s]."""
        xp = self._arrays.xp
        sway = xp.sqrt(self._swayed / xp.clip(floats(self._step), 1.0, None))
        return {
            "held": self._held > 0.5,
            "remaining": xp.asarray(self._remaining, copy=True),
            "work": xp.asarray(self._work, copy=True),
            "sway_rms": xp.asarray(sway, copy=True),
            "largest_sway": xp.asarray(self._peak, copy=True),
            "duration": xp.asarray(self._time, copy=True),
            "is_success": (self._ending == TERMINATION_REASONS.index(PLACED)) & (sway <= self.config.sway_limit),
        }

    def traces(self) -> Array:
        xp = self._arrays.xp
        rows = [
            self._time, *self._crane_state(CraneRow.JOINT_SLEW, 4), self._rotator, self._closed, self._held, *self._log,
            self._remaining, _length(xp, self._swing), self._power, self._crane_state(CraneRow.TIP_LOAD, 1)[0],
            floats(self._outputs.last("roll")), floats(self._outputs.last("pitch")), *self._signals[:, 0].T,
        ]  # fmt: skip
        return xp.stack(rows)

    def scene(self, machine: Machine) -> Any:
        from aoro_gym.envs.loading.rendering import LoadingScene

        return LoadingScene(machine, self.crane, self.render_channels)


def _length(xp: Any, v: Array) -> Array:
    """Lengths (N,) of vectors (2, N) or (3, N)."""
    return xp.sqrt(xp.sum(v**2, axis=0))


def _half_turn(xp: Any, angle: Array) -> Array:
    """Angles in [−90°, 90°) that mean the same to a log, whose ends are alike."""
    return angle - math.pi * xp.floor(angle / math.pi + 0.5)
