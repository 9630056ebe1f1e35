"""The twin on a CAN bus (CANopen, CiA 301).

The machine is a node. A controller, another node, commands it by two process data objects and sends a heartbeat; the machine
answers with one that shows what a driver would see. A heartbeat that is missed is a fault: neutral and brake, an emergency
object with code 0x8130 on the bus, and no command is taken until the heartbeat is back and the controller has commanded
neutral. Sources: CiA 301 (CANopen application layer), section 7.2.8.3 (heartbeat), 7.2.7 (emergency).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import can
import canopen
import numpy as np

from aoro_gym.checks import check_integer, check_range
from aoro_gym.cosimulation.canbus import DICTIONARY
from aoro_gym.recording.commands import WHEELS
from aoro_gym.twin.twin import Twin
from aoro_gym.units import RPM

CHANNEL = "239.74.163.2"
"""Multicast group of the simulated bus: the one that python-can takes by default."""
VEHICLE, CONTROLLER = 0x10, 0x20
"""Node-IDs, a choice."""
PRODUCED, CONSUMED = 0.05, 0.25
"""Heartbeats [s]: how often each node sends one, and after how long without the controller's it is a fault. A choice: five
heartbeats, so that none is missed because an ordinary scheduler is late."""
HEARTBEAT_ERROR = 0x8130
"""Emergency error code of CiA 301."""
COMMUNICATION = 0x10
"""Bit of the error register: communication."""
PERIOD = 0.02
"""[s] between two steps of the twin, and two process data objects."""
ROUNDING = 1e-6
"""[s] that sums of periods may be beside a duration."""
THOUSANDTH = 1e-3
SIGNALS = ("drive_signal", "steering_signal", *(f"arm_{wheel}" for wheel in WHEELS))
NEUTRAL = {**dict.fromkeys(SIGNALS, 0.0), "gear": 1.0, "parking_brake": 1.0}


def multicast_bus(port: int = 43113, channel: str = CHANNEL) -> can.BusABC:
    """A simulated CAN bus of all processes on this computer: UDP multicast that no router and no network card passes on."""
    return can.Bus(interface="udp_multicast", channel=channel, port=port, hop_limit=0)


class Fault(IntEnum):
    """What the node shows as its fault."""

    NONE = 0
    HEARTBEAT = 1


@dataclass
class Watch:
    """Whether the controller's heartbeat is there, and whether commands are taken.

    A fault ends once the heartbeat is back and neutral has been commanded since: a lever that is held over does not move the
    machine.
    """

    timeout: float = CONSUMED
    """[s]"""
    fault: Fault = Fault.HEARTBEAT
    """To begin with there is no controller."""
    _heard: float = -np.inf

    def hear(self, now: float) -> None:
        """A heartbeat at time ``now`` [s]."""
        self._heard = now

    def is_alive(self, now: float) -> bool:
        """Whether a heartbeat is there."""
        return now - self._heard <= self.timeout

    def judge(self, now: float, neutral: bool) -> Fault:
        """The fault at time ``now`` [s], where the latest command since the heartbeat is back is ``neutral``."""
        if not self.is_alive(now):
            self.fault = Fault.HEARTBEAT
        elif neutral:
            self.fault = Fault.NONE
        return self.fault


class CanVehicle:
    """A twin as a node of a CAN bus.

    Args:
        twin: One machine; it is moved in real time.
        bus: A python-can bus; closed with :meth:`close`.
        node_id: Of the machine, 1 to 127.
        controller_id: Whose heartbeat is watched.
        timeout: After how long without it [s] there is a fault.
    """

    def __init__(
        self,
        twin: Twin,
        bus: can.BusABC,
        *,
        node_id: int = VEHICLE,
        controller_id: int = CONTROLLER,
        timeout: float = CONSUMED,
    ):
        check_integer("node_id", node_id, ge=1, le=127)
        check_integer("controller_id", controller_id, ge=1, le=127)
        check_range("timeout", timeout, "s", ge=2.0 * PRODUCED)
        self.twin, self.watch = twin, Watch(timeout)
        self.network = canopen.Network(bus)
        self.network.connect()
        self.node: Any = self.network.create_node(node_id, str(DICTIONARY))
        self.node.rpdo.read(from_od=True)
        self.node.tpdo.read(from_od=True)
        for number in (1, 2):
            self.node.rpdo[number].add_callback(self._command)
        self.network.subscribe(0x700 + controller_id, self._heartbeat)
        self.node.nmt.state = "OPERATIONAL"
        self.node.nmt.start_heartbeat(round(1e3 * PRODUCED))
        self.commanded = dict(NEUTRAL)
        self._fresh: set[int] = set()
        self.faults = 0
        """Times that there was a fault since a controller was there first."""

    def close(self) -> None:
        """Leave the bus."""
        self.node.nmt.stop_heartbeat()
        self.network.disconnect()

    @property
    def commands(self) -> dict[str, float]:
        """What moves the twin: what was commanded, or neutral and brake."""
        return dict(NEUTRAL) if self.watch.fault else dict(self.commanded)

    def step(self, now: float) -> None:
        """Move the twin by a period, and send what a driver would see; ``now`` is the time [s] of a monotonic clock."""
        before = self.watch.fault
        fault = self.watch.judge(now, self._commands_neutral())
        if fault and not before:
            self.faults += 1
            self._fresh.clear()
            self.node.emcy.send(HEARTBEAT_ERROR, COMMUNICATION)
        elif before and not fault:
            self.node.emcy.reset()
        self.twin.step(self.commands, PERIOD)
        self._show(fault)

    def run(self, duration: float) -> None:
        """Step for ``duration`` [s], a period each, and wait for the end of the last one: another call goes on in real time.

        What is late is caught up with, at most a second of it.
        """
        begun = time.monotonic()
        due = begun
        while due < begun + duration - ROUNDING:
            _wait_until(due)
            self.step(time.monotonic())
            due = max(due + PERIOD, time.monotonic() - 1.0)
        _wait_until(due)

    def _commands_neutral(self) -> bool:
        """Whether both objects have come since the heartbeat is back, and command nothing that moves the machine."""
        return self._fresh >= {1, 2} and all(self.commanded[name] == 0.0 for name in SIGNALS)

    def _heartbeat(self, cob_id: int, data: Any, timestamp: float) -> None:
        self.watch.hear(time.monotonic())

    def _command(self, pdo: Any) -> None:
        """Take over what an object commands, unless a value is outside of the dictionary's limits: then nothing of it."""
        if not self.watch.is_alive(time.monotonic()):
            return
        values = {variable.name: variable.raw for variable in pdo}
        limits = {variable.name: (variable.od.min, variable.od.max) for variable in pdo}
        if any(not low <= values[name] <= high for name, (low, high) in limits.items()):
            return
        scale = {name: THOUSANDTH if name in SIGNALS else 1.0 for name in values}
        self.commanded |= {name: scale[name] * value for name, value in values.items()}
        self._fresh.add(2 if "arm_fl" in values else 1)

    def _show(self, fault: Fault) -> None:
        shown = self.node.tpdo[1]
        shown["speed"].raw = round(1e3 * float(self.twin.output("speed")[0]))
        shown["joint_angle"].raw = round(1e4 * float(self.twin.output("joint_angle")[0]))
        shown["engine_speed"].raw = round(float(self.twin.output("engine_speed")[0]) / RPM)
        shown["gear_shown"].raw = int(self.commands["gear"])
        shown["fault"].raw = int(fault)
        shown.transmit()


def _wait_until(instant: float) -> None:
    """Sleep until ``instant`` [s] of the monotonic clock, if it is not over."""
    wait = instant - time.monotonic()
    if wait > 0.0:
        time.sleep(wait)
