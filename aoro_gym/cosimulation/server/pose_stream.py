"""Poses of the machine's parts for a renderer, in datagrams that nobody has to ask for."""

from __future__ import annotations

import socket

from aoro_gym.cosimulation.protocol import Sender
from aoro_gym.cosimulation.server.records import POSE, POSES
from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Kinematics, Pose, node_poses


class PoseStream:
    """Sends :data:`~aoro_gym.cosimulation.server.records.POSES` to one address; who listens there is not known.

    Args:
        host: Where to.
        port: Likewise.
        machine: Whose parts.
        session: Of the server.
        token: Which all frames are authenticated with; None: none.

    Raises OSError if the host is not known.
    """

    def __init__(self, host: str, port: int, machine: Machine, session: int, token: bytes | None = None):
        family, _, _, _, self._address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._kinematics, self._session, self._sender = Kinematics(machine), session, Sender(token)
        self.sent, self.unsent = 0, 0
        """Datagrams, and those that the system did not take."""

    def send(self, pose: Pose, time: float) -> None:
        """Send where all parts are at the simulated ``time`` [s]."""
        values = {
            f"{node}_{name}": float(value)
            for node, (place, turned) in node_poses(self._kinematics, pose).items()
            for name, value in zip(POSE, (*place, *turned), strict=True)
        }
        try:
            self._socket.sendto(self._sender.encode(POSES, self._session, time, values), self._address)
            self.sent += 1
        except OSError:  # a full buffer, or nobody there
            self.unsent += 1

    def close(self) -> None:
        """Send no more."""
        self._socket.close()
