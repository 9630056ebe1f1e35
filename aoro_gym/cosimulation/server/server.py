"""The loop that advances a session, in real time or as it is granted, and tells and hears its clients."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from aoro_gym.checks import check_range
from aoro_gym.cosimulation.protocol import Frame, Rejection
from aoro_gym.cosimulation.realtime import Schedule, resident_memory, settle
from aoro_gym.cosimulation.server.geodesy import Geodesy, Origin
from aoro_gym.cosimulation.server.judging import PathJudge
from aoro_gym.cosimulation.server.link import MOST_AT_ONCE, Link
from aoro_gym.cosimulation.server.pose_stream import PoseStream
from aoro_gym.cosimulation.server.publisher import SentencePublisher
from aoro_gym.cosimulation.server.recorder import Recorder
from aoro_gym.cosimulation.server.records import COMMAND, commands_of, neutral
from aoro_gym.cosimulation.server.session import TELEMETRY_RATES, Sensing, Session
from aoro_gym.cosimulation.server.watchdog import PATIENCE
from aoro_gym.terrains import Path
from aoro_gym.twin import Twin

LOCAL_HOST = "127.0.0.1"
SHORTEST_TOKEN = 16
"""Characters."""
LOG_EVERY = 10.0
"""Time [s] between two rows of the log."""
MOST_GRANTED = 10.0
"""Simulated time [s] that one grant may reach ahead."""
MOST_EVENTS = 1000
"""Events that are told; later ones are only counted."""
MEGABYTE = 2**20
_ROUNDING = 1e-3  # of a step, that sums of steps may be off
_POLL = 0.2  # [s] between two looks at the clients while nothing is granted


@dataclass(frozen=True)
class Settings:
    """How a session is served.

    Raises ValueError naming the setting, its value and its bound.
    """

    host: str = LOCAL_HOST
    """Address to bind; any but 127.0.0.1 needs a token."""
    udp_port: int = 0
    """For commands and telemetry; 0: any free one."""
    tcp_port: int = 0
    """For GPS sentences; likewise."""
    token: str | None = None
    """Which all datagrams are authenticated with; None: none."""
    lock_step: bool = False
    """Whether clients grant the steps, instead of real time."""
    spin: bool = False
    """Whether the wait for a step keeps the processor busy."""
    duration: float = math.inf
    """Simulated time [s] after which the server ends."""
    telemetry_rate: int = TELEMETRY_RATES[0]
    """[Hz]"""
    origin: Origin = field(default_factory=Origin)
    """Of grounds that do not say where they lie."""
    sensing: Sensing = field(default_factory=Sensing)
    seed: int = 0
    """Of the sensors' noise."""
    poses: tuple[str, int] | None = None
    """Host and port that get the poses of the machine's parts, for a renderer; None: nobody."""

    def __post_init__(self) -> None:
        for name in ("udp_port", "tcp_port"):
            check_range(name, getattr(self, name), ge=0, le=65_535)
        if self.poses is not None:
            check_range("port of poses", self.poses[1], ge=1, le=65_535)
        check_range("duration", self.duration, "s", gt=0.0)
        if self.token is not None and len(self.token) < SHORTEST_TOKEN:
            raise ValueError(f"token has {len(self.token)} characters, but must have at least {SHORTEST_TOKEN}")
        if self.host != LOCAL_HOST and self.token is None:
            raise ValueError(
                f"host is {self.host}, where others could command the machine; give a token, or {LOCAL_HOST}"
            )


@dataclass(frozen=True)
class LogRow:
    """How a server did since the row before."""

    wall_s: float
    simulated_s: float
    steps: int
    missed_deadlines: int
    worst_lateness_us: float
    resident_MB: float
    sentence_clients: int
    telemetry_clients: int
    accepted: int
    rejected: int
    watchdog_trips: int


class Server:
    """A session on sockets; :meth:`run` advances it until its duration is over or :meth:`stop` is called.

    Args:
        twin: One, on the CPU, at rest.
        settings: How it is served.
        path: What clients are to follow, to be judged by.
        on_event: Called with one line of text for what happens: a first bad datagram of a kind, a watchdog that trips.
        on_log: Called with a row each ``LOG_EVERY``.
        on_tick: Called between two steps: once for each record of telemetry, in lock-step after each grant.
        recording: Whether :attr:`recorder` keeps what is measured.

    Raises OSError if an address cannot be bound.
    """

    def __init__(
        self,
        twin: Twin,
        settings: Settings | None = None,
        *,
        path: Path | None = None,
        on_event: Callable[[str], None] = lambda _: None,
        on_log: Callable[[LogRow], None] = lambda _: None,
        on_tick: Callable[[], None] = lambda: None,
        recording: bool = False,
    ):
        self.settings = settings = Settings() if settings is None else settings
        self.geodesy = Geodesy(twin.terrain, settings.origin)  # pyright: ignore[reportArgumentType]
        self.judge = None if path is None else PathJudge(path, twin.machine)
        """Of the path."""
        self.recorder = Recorder(self.geodesy) if recording else None
        """Of what is measured, if asked for."""
        solved = {} if self.recorder is None else {"on_solution": self.recorder.solve}
        self.session = Session(
            twin, self.geodesy, sensing=settings.sensing, seed=settings.seed, judge=self.judge,
            telemetry_rate=settings.telemetry_rate,
            on_telemetry=self._publish,
            on_sentences=lambda block: self.publisher.send(block),
            **solved,
        )  # fmt: skip
        token = None if settings.token is None else settings.token.encode()
        try:
            self.link = Link(
                settings.host, settings.udp_port, token=token, state=self._state, on_rejected=self._tell_rejection
            )
        except OSError as error:
            raise _unbound("udp_port", settings.udp_port, settings.host, error) from error
        try:
            self.publisher = SentencePublisher(settings.host, settings.tcp_port)
        except OSError as error:
            self.link.close()
            raise _unbound("tcp_port", settings.tcp_port, settings.host, error) from error
        self.poses = None
        """Stream of poses, if asked for."""
        if settings.poses is not None:
            self.poses = PoseStream(*settings.poses, twin.machine, self.link.session, token)
        self.schedule = Schedule(twin.main_step, spin=settings.spin)
        self.ended = ""
        """Why it ended."""
        self._on_event, self._on_log, self._on_tick = on_event, on_log, on_tick
        self._events = 0
        self._stopped = ""
        self._began = self._logged = time.monotonic()
        self._finished = math.nan
        """Time [s] of the monotonic clock at which it ended."""
        self._memory_at_start = 0
        self._missed_before = 0
        self._last_step = round(min(settings.duration, 1e12) / twin.main_step)

    def stop(self, why: str = "stopped") -> None:
        """End soon; may be called from a signal's handler or another thread."""
        self._stopped = why

    def run(self) -> None:
        """Serve until the end."""
        settle()
        self._began = self._logged = time.monotonic()
        self._memory_at_start = resident_memory()
        try:
            if self.settings.lock_step:
                self._run_in_lock_step()
            else:
                self._run_in_real_time()
        finally:
            self._finished = time.monotonic()
            self._log(self._finished)
            self.publisher.close()
            self.link.close()
            if self.poses is not None:
                self.poses.close()
        self.ended = self._stopped or ("diverged" if self.session.diverged else "duration over")

    @property
    def _over(self) -> bool:
        return bool(self._stopped) or self.session.diverged or self.session.steps >= self._last_step

    # ---- real time

    def _run_in_real_time(self) -> None:
        self.schedule = Schedule(self.session.twin.main_step, spin=self.settings.spin)
        accepting = self.session.tick_steps - 2  # a step in which nothing is measured
        while not self._over:
            now = self.schedule.wait()
            for _ in range(MOST_AT_ONCE):
                taken = self.link.take()
                if taken is None:
                    break
                frame = self.link.handle(*taken, self.session.time, now, now)
                if frame is not None and frame.record is COMMAND:
                    self._obey(frame)
            self._watch(now)
            self.session.step()
            if self.session.steps % self.session.tick_steps == accepting:
                self.publisher.accept()
                self._on_tick()
                if now - self._logged >= LOG_EVERY:
                    self._log(now)
            self.schedule.done()

    # ---- lock-step

    def _run_in_lock_step(self) -> None:
        while not self._over:
            select.select([self.link.socket], [], [], _POLL)
            self.publisher.accept()
            for _ in range(MOST_AT_ONCE):
                taken = self.link.take()
                if taken is None:
                    break
                frame = self.link.handle(*taken, self.session.time, self.session.time, time.monotonic())
                if frame is not None and frame.record is COMMAND:
                    self._obey(frame)
                elif frame is not None:
                    self._advance(frame.values["until"])
                    self.link.answer(taken[1], self.session.time, taken[0][:1] == b"{")
            now = time.monotonic()
            if now - self._logged >= LOG_EVERY:
                self._log(now)

    def _advance(self, until: float) -> None:
        """Up to a granted time [s], stopping the machine on the way if the last command is too old."""
        step, session, watchdog = self.session.twin.main_step, self.session, self.link.watchdog
        end = min(math.floor(min(until, session.time + MOST_GRANTED) / step + _ROUNDING), self._last_step)
        while session.steps < end and not session.diverged:
            self._watch(session.time)
            steps = end - session.steps
            if not watchdog.expired:
                steps = min(steps, max(math.ceil((watchdog.last + PATIENCE - session.time) / step - _ROUNDING), 1))
            session.run(steps)
        self._on_tick()

    # ---- what both do

    def _publish(self, values: Mapping[str, float], instant: float) -> None:
        self.link.publish(values, instant, time.monotonic())
        if self.poses is not None:
            self.poses.send(self.session.pose, instant)
        if self.recorder is not None:
            self.recorder.take(values, instant, *self.session.measured)

    def _obey(self, frame: Frame) -> None:
        if self.session.watchdog:
            self._tell(f"sender {frame.sender} is in command")
        self.session.command(commands_of(frame.values))
        self.session.command_sequence, self.session.watchdog = frame.sequence, False

    def _watch(self, clock: float) -> None:
        watchdog = self.link.watchdog
        if watchdog.trip(clock):
            self.session.command(neutral(self.session.commands["gear"]))
            self.session.watchdog = True
            self._tell(f"no valid command for {1e3 * (clock - watchdog.last):.0f} ms: neutral and brakes")

    def _state(self) -> Mapping[str, float]:
        twin = self.session.twin
        return {
            "lock_step": int(self.settings.lock_step),
            "main_step": twin.main_step,
            "telemetry_step": self.session.telemetry_step,
        }

    def _tell_rejection(self, found: Rejection, address: str) -> None:
        self._tell(f"dropped from {address}: {found.reason}: {found.detail} (further ones are only counted)")

    def _tell(self, text: str) -> None:
        self._events += 1
        if self._events <= MOST_EVENTS:
            self._on_event(f"{self.session.time:.3f} s: {text}")

    def _log(self, now: float) -> None:
        self._logged = now
        receiver, schedule = self.link.commander.receiver, self.schedule
        worst, schedule.worst_since = schedule.worst_since, 0.0
        row = LogRow(
            wall_s=round(now - self._began, 1),
            simulated_s=round(self.session.time, 3),
            steps=self.session.steps,
            missed_deadlines=schedule.missed - self._missed_before,
            worst_lateness_us=round(1e6 * worst, 1),
            resident_MB=round(resident_memory() / MEGABYTE, 3),
            sentence_clients=self.publisher.clients,
            telemetry_clients=self.link.subscribers,
            accepted=receiver.accepted,
            rejected=receiver.rejected.total(),
            watchdog_trips=self.link.watchdog.trips,
        )
        self._missed_before = schedule.missed
        self._on_log(row)

    def to_json(self) -> dict[str, Any]:
        """What was served, how late, and what was dropped."""
        receiver, watchdog = self.link.commander.receiver, self.link.watchdog
        wall = (self._finished if math.isfinite(self._finished) else time.monotonic()) - self._began
        found: dict[str, Any] = {
            "mode": "lock-step" if self.settings.lock_step else "real time",
            "ended": self.ended,
            "simulated_s": round(self.session.time, 6),
            "wall_s": round(wall, 3),
            "telemetry_rate_Hz": self.settings.telemetry_rate,
            "commands_and_grants": receiver.accepted,
            "dropped": {str(reason): count for reason, count in sorted(receiver.rejected.items())},
            "watchdog": {"trips": watchdog.trips, "slowest_s": round(watchdog.slowest, 6)},
            "sentences": {
                "clients": self.publisher.connected,
                "blocks": self.publisher.blocks,
                "missed_blocks": self.publisher.missed,
            },
            "resident_MB": {
                "start": round(self._memory_at_start / MEGABYTE, 3),
                "end": round(resident_memory() / MEGABYTE, 3),
            },
        }
        if self.judge is not None:
            found["tracking"] = self.judge.to_json()
        return found if self.settings.lock_step else {**found, "deadlines": self.schedule.to_json()}


def _unbound(name: str, port: int, host: str, error: OSError) -> OSError:
    """What cannot be bound, and why."""
    return OSError(
        error.errno, f"{name} is {port}, but cannot be bound on {host}: {error.strerror}; choose another, or 0"
    )
