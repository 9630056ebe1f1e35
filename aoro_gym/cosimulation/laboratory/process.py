"""The laboratory's two processes: a driveline that answers datagrams, and the bodies' view of it.

In lock-step the bodies ask and wait for each answer; a lost datagram is asked for again, and a period is never moved twice.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from aoro_gym.cosimulation.laboratory.coupling import STOP
from aoro_gym.cosimulation.laboratory.protection import Limits
from aoro_gym.cosimulation.laboratory.wire import BEGIN, DEMAND, MEASURED
from aoro_gym.cosimulation.protocol import LARGEST_DATAGRAM, Frame, Receiver, Sender, draw_identifier
from aoro_gym.recording.commands import WHEELS
from aoro_gym.twin.driveline import COMMANDS, Driveline

ASK_AGAIN = 0.25
"""Time [s] after which an answer that has not come is asked for again."""
POLL = 0.1
"""Time [s] after which a driveline that hears nothing looks at its clock."""
GIVE_UP = 5.0
"""Time [s] after which the other process is taken for gone."""


class LaboratoryLost(ConnectionError):
    """The other process does not answer, or has stopped."""


class DrivelineProcess:
    """Answers demands on a UDP socket with a digital driveline, which stands for a physical one.

    Where demands stay away for longer than the limit of silence, the driveline goes to neutral and is braked, and says so in
    whatever it answers until it begins anew.

    Args:
        driveline: To be moved; one machine.
        host: Address to bind to.
        port: 0: any free one.
        limits: Of torque, speed and silence.
        token: Which datagrams must be authenticated with.
        say: Takes one line for a log, of what went wrong.
        note: Takes one of what went well.

    Raises OSError if the address cannot be bound.
    """

    def __init__(
        self,
        driveline: Driveline,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        limits: Limits | None = None,
        token: bytes | None = None,
        say: Callable[[str], None] = print,
        note: Callable[[str], None] = lambda _: None,
    ):
        self.driveline, self.limits, self._say, self._note = driveline, limits or Limits(), say, note
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            message = f"port is {port}, but cannot be bound on {host}: {error.strerror}; choose another, or 0"
            raise OSError(error.errno, message) from None
        self.address: tuple[str, int] = self._socket.getsockname()
        self.receiver = Receiver([BEGIN, DEMAND], session=draw_identifier(), token=token, greetings=[BEGIN])
        self._sender = Sender(token)
        self._tick, self._steps, self._answer = 0, 1, dict[str, float]()
        self._ended = False
        self.stopped = "no one has begun"
        """Why the driveline is braked; empty while it runs."""

    def close(self) -> None:
        """Close the socket; no thread may be in :meth:`run`."""
        self._socket.close()

    def end(self) -> None:
        """Let :meth:`run` return, from another thread."""
        self._ended = True

    def run(self, duration: float | None = None) -> None:
        """Answer for ``duration`` [s], or until interrupted."""
        end = None if duration is None else time.monotonic() + duration
        heard = time.monotonic()
        self._socket.settimeout(min(self.limits.silence, POLL))
        while not self._ended and (end is None or time.monotonic() < end):
            try:
                datagram, peer = self._socket.recvfrom(LARGEST_DATAGRAM + 1)
            except TimeoutError:
                datagram, peer = b"", None
            now = time.monotonic()
            if now - heard > self.limits.silence:
                self._stop(f"no demand for {1e3 * self.limits.silence:g} ms")
            if peer is None:
                continue
            frame = self.receiver.decode(datagram)
            if isinstance(frame, Frame):
                heard = now
                self._take(frame)
                self._socket.sendto(self._encoded(frame), peer)

    def _encoded(self, frame: Frame) -> bytes:
        values = {**self._answer, "tick": self._tick, "stopped": float(bool(self.stopped))}
        return self._sender.encode(MEASURED, self.receiver.session or 0, frame.time, values)

    def _take(self, frame: Frame) -> None:
        values = frame.values
        if frame.record is BEGIN:
            torque = [values[f"torque_{wheel}"] for wheel in WHEELS]
            if abs(values["main_step"] - self.driveline.main_step) > 1e-6 * self.driveline.main_step:
                self._say(f"refused: the bodies' main step is {values['main_step']:g} s, the driveline's another")
                return
            self.driveline.reset(torque)
            self._tick, self._steps, self.stopped = 0, int(values["steps"]), ""
            self._answer = self._values(np.array(torque, dtype=np.float32), self.driveline.output("engine_speed"))
            self._note("the bodies began")
        elif values["tick"] == self._tick + 1 and not self.stopped:
            self._move(values)

    def _move(self, values: Mapping[str, float]) -> None:
        rates = np.array([values[f"rate_{wheel}"] for wheel in WHEELS])
        if np.max(np.abs(rates)) > self.limits.speed:
            self._stop(f"a set-point of {np.max(np.abs(rates)):.3g} rad/s is beyond {self.limits.speed:g} rad/s")
            return
        self.driveline.set_commands({name: values[name] for name in COMMANDS})
        torque, speed = self.driveline.step(rates, values["pump_torque"], self._steps)
        self._tick += 1
        self._answer = self._values(torque[:, 0], speed)

    def _values(self, torque: npt.NDArray[np.float32], speed: npt.NDArray[np.float32]) -> dict[str, float]:
        pressures = ("drive_pressure_forward", "drive_pressure_return")
        return {
            **{f"torque_{wheel}": float(one) for wheel, one in zip(WHEELS, torque, strict=True)},
            "engine_speed": float(speed[0]),
            **{name: float(self.driveline.output(name)[0]) for name in pressures},
        }

    def _stop(self, reason: str) -> None:
        if self.stopped:
            return
        self.stopped = reason
        self._say(f"stopped: {reason}; neutral and brakes until the bodies begin anew")
        self.driveline.set_commands({**STOP, "parking_brake": 1.0})


class RemoteDriveline:
    """A driveline in another process, as :class:`~aoro_gym.cosimulation.laboratory.coupling.Coupling` wants one.

    Args:
        address: Of a :class:`DrivelineProcess`.
        main_step: Of the bodies [s].
        steps: Main steps of a period.
        token: Which datagrams are authenticated with.
    """

    def __init__(
        self, address: tuple[str, int], *, main_step: float = 1e-3, steps: int = 1, token: bytes | None = None
    ):
        self._address, self._main_step, self._steps = address, main_step, steps
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(ASK_AGAIN)
        self._sender = Sender(token)
        self._token, self._session, self._tick = token, 0, 0
        self._commands = {
            "drive_signal": 0.0,
            "gear": 1.0,
            "parking_brake": 0.0,
            **{f"traction_{w}": 1.0 for w in WHEELS},
        }
        self.round_trips: list[float] = []
        """Time [s] from each demand to its answer."""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def reset(self, torque: npt.ArrayLike = 0.0) -> None:
        """See :class:`~aoro_gym.cosimulation.laboratory.coupling.DrivelineSide`."""
        torques = np.broadcast_to(np.asarray(torque, dtype=float).reshape(-1), (4,))
        values = {f"torque_{wheel}": float(one) for wheel, one in zip(WHEELS, torques, strict=True)}
        self._session, self._tick = 0, 0
        self._receiver = Receiver([MEASURED], token=self._token)
        frame = self._ask(BEGIN, {**values, "main_step": self._main_step, "steps": self._steps})
        self._session = self._receiver.session = frame.session

    def set_commands(self, commands: Mapping[str, Any]) -> None:
        """See :class:`~aoro_gym.cosimulation.laboratory.coupling.DrivelineSide`."""
        self._commands |= {name: float(np.asarray(value)) for name, value in commands.items()}

    def step(
        self, rates: npt.ArrayLike, pump_torque: npt.ArrayLike, steps: int = 1
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """See :class:`~aoro_gym.cosimulation.laboratory.coupling.DrivelineSide`; (4, 1) and (1,)."""
        if steps != self._steps:
            raise ValueError(f"steps is {steps}, but this laboratory began with {self._steps}")
        self._tick += 1
        asked = np.asarray(rates, dtype=float).reshape(4)
        values = {f"rate_{wheel}": float(one) for wheel, one in zip(WHEELS, asked, strict=True)}
        values |= {"tick": self._tick, "pump_torque": float(np.asarray(pump_torque).reshape(-1)[0]), **self._commands}
        begun = time.perf_counter()
        found = self._ask(DEMAND, values).values
        self.round_trips.append(time.perf_counter() - begun)
        torque = np.array([[found[f"torque_{wheel}"]] for wheel in WHEELS], dtype=np.float32)
        return torque, np.array([found["engine_speed"]], dtype=np.float32)

    def _ask(self, record: Any, values: Mapping[str, float]) -> Frame:
        """The answer of this tick."""
        give_up = time.monotonic() + GIVE_UP
        while time.monotonic() < give_up:
            moment = self._tick * self._steps * self._main_step
            self._socket.sendto(self._sender.encode(record, self._session, moment, values), self._address)
            again = time.monotonic() + ASK_AGAIN
            while time.monotonic() < again:
                try:
                    found = self._receiver.decode(self._socket.recv(LARGEST_DATAGRAM + 1))
                except (TimeoutError, ConnectionRefusedError):
                    break
                if not isinstance(found, Frame):
                    continue
                if found.values["stopped"] and record is DEMAND:
                    raise LaboratoryLost("the driveline has stopped and is braked; begin anew")
                if found.values["tick"] == self._tick:
                    return found
            else:
                continue
            time.sleep(0.01)
        host, port = self._address
        raise LaboratoryLost(
            f"the driveline at {host}:{port} has not answered for {GIVE_UP:g} s; start it, or check the port"
        )
