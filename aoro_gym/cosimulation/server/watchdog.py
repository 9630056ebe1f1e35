"""Who commands the machine, and what happens when nobody does."""

from __future__ import annotations

from dataclasses import dataclass

from aoro_gym.cosimulation.protocol import Frame, Reason, Receiver, Rejection
from aoro_gym.cosimulation.server.records import COMMAND, GRANT, HELLO

PATIENCE = 0.2
"""Time [s] without a valid command after which the machine is stopped: its valves go to the middle, its brakes on. (E)"""
LATEST_REACTION = 0.22
"""Time [s] after the last valid command by which that must have happened."""
_AHEAD = 1e-6  # [s] by which rounding may put a time stamp into the future


@dataclass
class Watchdog:
    """Tells when commands stay away, by whatever clock it is asked with [s]: simulated in lock-step, else monotonic."""

    expired: bool = True
    """Whether the machine is stopped for want of commands; it is before the first one."""
    trips: int = 0
    """How often that happened."""
    slowest: float = 0.0
    """Longest time [s] from a last valid command to the stop."""
    last: float = 0.0
    """When the last valid command came [s]."""

    def feed(self, now: float) -> None:
        """A valid command came."""
        self.last, self.expired = now, False

    def trip(self, now: float) -> bool:
        """Whether the machine must be stopped now, for the first time since the last command."""
        if self.expired or now - self.last < PATIENCE - _AHEAD:
            return False
        self.expired = True
        self.trips += 1
        self.slowest = max(self.slowest, now - self.last)
        return True


class Commander:
    """Lets valid commands through, of one sender at a time.

    The sender of the first valid command is in command until the watchdog has expired; what others send meanwhile is
    dropped. A command that answers telemetry older than ``PATIENCE`` is dropped, too: what waited in some buffer must
    not move the machine.

    Args:
        session: Number that frames must name.
        token: See :class:`~aoro_gym.cosimulation.protocol.Receiver`.
    """

    def __init__(self, session: int, token: bytes | None = None):
        self.receiver = Receiver((HELLO, COMMAND, GRANT), session=session, token=token, greetings=(HELLO,))
        self.sender: int | None = None
        """Who is in command."""

    def decode(self, datagram: bytes, time: float, watchdog: Watchdog) -> Frame | Rejection:
        """The frame in a datagram that arrived at the simulated ``time`` [s], or why it is dropped."""
        found = self.receiver.decode(datagram)
        if isinstance(found, Rejection) or found.record is not COMMAND:
            return found
        if not time - PATIENCE - _AHEAD <= found.time <= time + _AHEAD:
            return self.receiver.withdraw(Reason.STALE, f"answers telemetry of {found.time:.3f} s at {time:.3f} s")
        if found.sender != self.sender and not watchdog.expired:
            return self.receiver.withdraw(Reason.BUSY, f"sender {found.sender}, but {self.sender} is in command")
        self.sender = found.sender
        return found
