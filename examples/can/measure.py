"""How quick the simulated bus and the machine on it are: round trips, rates, the time until a lost controller is noticed.

python examples/can/measure.py

The bus is shared by two processes, as in ``vehicle.py``. For comparison the same frames also go through python-can's
``virtual`` bus, which two threads of one process share.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import can
import numpy as np

from aoro_gym import Twin
from aoro_gym.cosimulation.canbus.vehicle import CONTROLLER, VEHICLE, CanVehicle, multicast_bus

ASK, ANSWER, RESET, COUNT, TELL, TOTAL, END = range(0x100, 0x107)
"""Identifiers of the frames that are sent to and fro."""
FULL = 2000.0
"""Frames a second of a bus at 250 kbit/s that is never silent: some 125 bits each, with 8 bytes of data."""
PATIENCE = 20.0
"""[s] to wait for a frame, and for a process that begins."""
HEARTBEAT = can.Message(arbitration_id=0x700 + CONTROLLER, data=[5], is_extended_id=False)


def frame(identifier: int, data: bytes = bytes(8)) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def number_of(found: can.Message) -> int:
    return int.from_bytes(found.data, "little")


def virtual_bus(channel: int) -> can.BusABC:
    return can.Bus(interface="virtual", channel=f"measure {channel}")


def wait_for(bus: can.BusABC, wanted: Callable[[can.Message], bool], patience: float = PATIENCE) -> float:
    """Time [s] of the monotonic clock at which the first frame that is ``wanted`` was there."""
    end = time.monotonic() + patience
    while (left := end - time.monotonic()) > 0.0:
        found = bus.recv(left)
        if found is not None and wanted(found):
            return time.monotonic()
    raise TimeoutError(f"no such frame came within {patience:g} s")


def answer(open_bus: Callable[[int], can.BusABC], channel: int) -> None:
    """The other side: answers ``ASK``, counts ``COUNT``, ends after ``END``."""
    total = 0
    with open_bus(channel) as bus:
        bus.send(frame(ANSWER))  # here I am
        while (found := bus.recv(PATIENCE)) is not None and found.arbitration_id != END:
            if found.arbitration_id == COUNT:
                total += 1
            elif found.arbitration_id == RESET:
                total = 0
            elif found.arbitration_id == TELL:
                bus.send(frame(TOTAL, total.to_bytes(8, "little")))
            elif found.arbitration_id == ASK:
                bus.send(frame(ANSWER, bytes(found.data)))


def count(bus: can.BusABC, frames: int, pause: float) -> tuple[float, float]:
    """Frames a second that were sent with a ``pause`` [s] between two, and the share of them that was lost.

    The total is asked for until it comes, as this frame may be lost like the others while a buffer is full.
    """
    bus.send(frame(RESET))
    begun = time.monotonic()
    for number in range(frames):
        if pause:
            time.sleep(max(begun + number * pause - time.monotonic(), 0.0))
        bus.send(frame(COUNT))
    rate = frames / (time.monotonic() - begun)
    counted: list[int] = []
    for _ in range(round(PATIENCE)):
        bus.send(frame(TELL))
        with contextlib.suppress(TimeoutError):
            wait_for(bus, lambda found: found.arbitration_id == TOTAL and not counted.append(number_of(found)), 1.0)
            return rate, 1.0 - counted[-1] / frames
    raise TimeoutError(f"the other side was silent for {PATIENCE:g} s")


def there_and_back(bus: can.BusABC, frames: int) -> np.ndarray:
    """Round trips [s], one after the other."""
    trips = []
    for number in range(frames):
        begun = time.monotonic()
        bus.send(frame(ASK, number.to_bytes(8, "little")))
        wait_for(bus, lambda found, n=number: found.arbitration_id == ANSWER and number_of(found) == n)
        trips.append(time.monotonic() - begun)
    return np.array(trips)


def drive(port: int, ended: Any) -> None:
    """The machine, in a process of its own."""
    with contextlib.closing(CanVehicle(Twin(threads=1), multicast_bus(port))) as vehicle:
        while not ended.is_set():
            vehicle.run(0.1)


def command(bus: can.BusABC, gear: int) -> None:
    """Neutral, in a gear."""
    bus.send(frame(0x200 + VEHICLE, bytes([gear, 0, 0, 0, 0, 1])))
    bus.send(frame(0x300 + VEHICLE))


def shows(gear: int, fault: int) -> Callable[[can.Message], bool]:
    """Whether a frame is the machine's, and shows a gear and a fault."""
    return lambda found: found.arbitration_id == 0x180 + VEHICLE and bytes(found.data[6:8]) == bytes([gear, fault])


def measure_machine(bus: can.BusABC, shifts: int, silences: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s] from a command until the machine shows it, between two of its objects, and from the last heartbeat until the
    emergency object says that it is missed."""
    shown, every, noticed = [], [], []
    wait_for(bus, shows(1, 1))
    for _ in range(silences):
        beat = bus.send_periodic(HEARTBEAT, 0.05)
        time.sleep(0.1)
        for number in range(shifts):
            gear = 2 + number % 2
            begun = time.monotonic()
            command(bus, gear)
            shown.append(wait_for(bus, shows(gear, 0)) - begun)
            every.append(wait_for(bus, shows(gear, 0)) - begun - shown[-1])
            time.sleep(0.02 * np.random.default_rng(number).random())  # at any time of the machine's period
        beat.stop()
        bus.send(HEARTBEAT)
        begun = time.monotonic()
        noticed.append(
            wait_for(bus, lambda found: found.arbitration_id == 0x80 + VEHICLE and found.data[1] == 0x81) - begun
        )
    return np.array(shown), np.array(every), np.array(noticed)


def tell(what: str, seconds: np.ndarray) -> None:
    half, most, worst = 1e3 * np.percentile(seconds, (50.0, 99.0, 100.0))
    print(f"{what:46s} {half:8.3f} {most:8.3f} {worst:8.3f}   {len(seconds)}")


def main(frames: int = 5000, shifts: int = 100, silences: int = 10) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    print(f"{'[ms]':46s} {'50 %':>8} {'99 %':>8} {'worst':>8}   number")
    context = multiprocessing.get_context("spawn")
    for name, begin, open_bus in (
        ("virtual, two threads", threading.Thread, virtual_bus),
        ("udp_multicast, two processes", context.Process, multicast_bus),
    ):
        with open_bus(port) as bus:
            other = begin(target=answer, args=(open_bus, port), daemon=True)
            other.start()
            wait_for(bus, lambda found: found.arbitration_id == ANSWER)
            tell(f"{name}: there and back", there_and_back(bus, frames))
            for how, pause in ((f"at {FULL:.0f} frames/s", 1.0 / FULL), ("without waiting", 0.0)):
                rate, lost = count(bus, frames, pause)
                print(f"{name}, {how}: {rate:.0f} frames/s, {lost:.2%} lost")
            bus.send(frame(END))
            other.join()
    ended = context.Event()
    machine = context.Process(target=drive, args=(port, ended), daemon=True)
    machine.start()
    with multicast_bus(port) as bus:
        shown, every, noticed = measure_machine(bus, shifts, silences)
    ended.set()
    machine.join()
    tell("machine: from a command until it is shown", shown)
    tell("machine: between two objects", every)
    tell("machine: from the last heartbeat to the fault", noticed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=5000, help="sent to and fro")
    parser.add_argument("--shifts", type=int, default=100, help="between two silences")
    parser.add_argument("--silences", type=int, default=10, help="of the controller")
    asked = parser.parse_args()
    main(asked.frames, asked.shifts, asked.silences)
