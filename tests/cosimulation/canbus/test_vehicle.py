"""The machine on a CAN bus: a controller in another process shifts gears; a missed heartbeat is a fault, and it recovers."""

import runpy
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import canopen
import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.cosimulation.canbus import DICTIONARY
from aoro_gym.cosimulation.canbus.vehicle import (
    CONSUMED,
    CONTROLLER,
    HEARTBEAT_ERROR,
    PERIOD,
    VEHICLE,
    CanVehicle,
    Fault,
    Watch,
    multicast_bus,
)

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "can"


def virtual_bus(channel: str) -> can.BusABC:
    return can.Bus(interface="virtual", channel=channel)


class Controller:
    """Another node of the bus, here in the same process."""

    def __init__(self, bus: can.BusABC):
        self.network = canopen.Network(bus)
        self.network.connect()
        self.vehicle: Any = self.network.add_node(VEHICLE, str(DICTIONARY))
        self.vehicle.rpdo.read(from_od=True)
        self.vehicle.tpdo.read(from_od=True)

    def beat(self) -> None:
        self.network.send_message(0x700 + CONTROLLER, b"\x05")

    def command(self, **values: int) -> None:
        for name, value in values.items():
            self.vehicle.rpdo[name].raw = value
        self.vehicle.rpdo[1].transmit()
        self.vehicle.rpdo[2].transmit()


@pytest.fixture
def both(request: pytest.FixtureRequest) -> Iterator[tuple[CanVehicle, Controller]]:
    channel = request.node.name
    vehicle, controller = CanVehicle(Twin(), virtual_bus(channel)), Controller(virtual_bus(channel))
    yield vehicle, controller
    controller.network.disconnect()
    vehicle.close()


def until(condition: Callable[[], bool]) -> None:
    """Wait for the bus' threads, 5 s at most."""
    end = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end, "nothing came over the bus"
        time.sleep(0.002)


def take_over(vehicle: CanVehicle, controller: Controller, **values: int) -> None:
    """Heartbeat and commands on their way to the machine."""
    controller.beat()
    until(lambda: vehicle.watch.is_alive(time.monotonic()))
    vehicle._fresh.clear()
    controller.command(**values)
    until(lambda: vehicle._fresh >= {1, 2})


def test_a_fault_ends_with_the_heartbeat_and_neutral() -> None:
    watch = Watch(0.25)
    assert watch.judge(0.0, True) is Fault.HEARTBEAT  # no one was there yet
    watch.hear(1.0)
    assert watch.judge(1.0, False) is Fault.HEARTBEAT  # a lever is held over
    assert watch.judge(1.1, True) is Fault.NONE
    assert watch.judge(1.2, False) is Fault.NONE  # from now on it may move
    assert watch.judge(1.25, False) is Fault.NONE
    assert watch.judge(1.26, False) is Fault.HEARTBEAT
    assert watch.judge(1.27, True) is Fault.HEARTBEAT


def test_gears_are_shifted_and_shown(both: tuple[CanVehicle, Controller]) -> None:
    vehicle, controller = both
    take_over(vehicle, controller, gear=1)
    vehicle.step(time.monotonic())
    assert not vehicle.watch.fault
    take_over(vehicle, controller, gear=3, drive_signal=400, steering_signal=-250, parking_brake=0, arm_rl=100)
    vehicle.step(time.monotonic())
    assert vehicle.commands["gear"] == 3.0
    assert vehicle.commands["drive_signal"] == pytest.approx(0.4)
    assert vehicle.commands["steering_signal"] == pytest.approx(-0.25)
    assert vehicle.commands["arm_rl"] == pytest.approx(0.1)
    until(lambda: controller.vehicle.tpdo[1]["gear_shown"].raw == 3)
    assert controller.vehicle.tpdo[1]["fault"].raw == Fault.NONE


def test_a_missed_heartbeat_is_neutral_and_brake(both: tuple[CanVehicle, Controller]) -> None:
    vehicle, controller = both
    take_over(vehicle, controller, gear=1)
    vehicle.step(time.monotonic())
    take_over(vehicle, controller, gear=2, drive_signal=500)
    late = time.monotonic() + CONSUMED + PERIOD
    vehicle.step(late)
    assert vehicle.watch.fault is Fault.HEARTBEAT
    assert vehicle.commands["drive_signal"] == 0.0
    assert vehicle.commands["parking_brake"] == 1.0
    assert vehicle.commands["gear"] == 1.0
    until(lambda: any(one.code == HEARTBEAT_ERROR for one in controller.vehicle.emcy.log))
    # back with the lever held over: still braked; neutral ends it
    time.sleep(CONSUMED)
    take_over(vehicle, controller, drive_signal=500)
    vehicle.step(time.monotonic())
    assert vehicle.watch.fault is Fault.HEARTBEAT
    take_over(vehicle, controller, drive_signal=0, gear=1)
    vehicle.step(time.monotonic())
    assert vehicle.watch.fault is Fault.NONE
    assert vehicle.faults == 1


def test_what_is_out_of_range_is_not_taken(both: tuple[CanVehicle, Controller]) -> None:
    vehicle, controller = both
    take_over(vehicle, controller, gear=2)
    bad = bytes([9]) + (100).to_bytes(2, "little", signed=True) + bytes(3)  # gear 9
    controller.network.send_message(0x200 + VEHICLE, bad)
    good = bytes([3]) + (100).to_bytes(2, "little", signed=True) + bytes(3)
    time.sleep(0.05)
    assert vehicle.commanded["gear"] == 2.0
    controller.network.send_message(0x200 + VEHICLE, good)
    until(lambda: vehicle.commanded["gear"] == 3.0)
    assert vehicle.commanded["drive_signal"] == pytest.approx(0.1)


def test_calls_in_a_row_keep_the_pace_of_the_clock(both: tuple[CanVehicle, Controller], monkeypatch) -> None:
    vehicle, _ = both
    clock, steps = [100.0], []

    def step(now: float) -> None:
        steps.append(now)
        clock[0] += 0.3 * PERIOD  # what a step takes

    monkeypatch.setattr(vehicle, "step", step)
    told = SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda s: clock.__setitem__(0, clock[0] + s))
    monkeypatch.setattr("aoro_gym.cosimulation.canbus.vehicle.time", told)
    for _ in range(3):
        vehicle.run(0.1)
    assert clock[0] == pytest.approx(100.3)
    assert steps == pytest.approx([100.0 + PERIOD * number for number in range(15)])


def test_multicast_reaches_others_on_this_computer() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with multicast_bus(port) as one, multicast_bus(port) as other:
        one.send(can.Message(arbitration_id=0x123, data=[1, 2, 3], is_extended_id=False))
        found = other.recv(5.0)
    assert found is not None
    assert (found.arbitration_id, bytes(found.data)) == (0x123, b"\x01\x02\x03")


def test_the_example_has_the_same_dictionary() -> None:
    assert (EXAMPLES / "aoro.eds").read_bytes() == DICTIONARY.read_bytes()


def test_a_controller_alone_says_so_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = virtual_bus("alone")
    monkeypatch.setattr("can.Bus", lambda **_: bus)
    monkeypatch.setattr("sys.argv", ["controller.py", "--seconds", "0.1"])
    with pytest.raises(SystemExit, match="no machine answered on the bus"):
        runpy.run_path(str(EXAMPLES / "controller.py"), run_name="__main__")


@pytest.mark.slow
def test_the_example_in_two_processes() -> None:
    found = runpy.run_path(str(EXAMPLES / "vehicle.py"))
    gears = {gear for _, gear, _, fault in found["history"] if not fault}
    assert gears >= {1, 2}
    assert found["fastest"] > 0.2
    _, _, speed, fault = found["stopped"]
    assert fault == Fault.HEARTBEAT
    assert abs(speed) < 0.05
    assert found["vehicle"].faults == 2  # either controller ended, and its heartbeat was missed


def test_measured_times_are_those_of_the_machine(request: pytest.FixtureRequest) -> None:
    """A command is shown after a step, a period at most on a free computer; silence is a fault when ``CONSUMED`` is over."""
    measure, name = runpy.run_path(str(EXAMPLES / "measure.py")), request.node.name
    vehicle, ended = CanVehicle(Twin(), virtual_bus(name)), threading.Event()

    def drive() -> None:
        while not ended.is_set():
            vehicle.run(PERIOD)

    machine = threading.Thread(target=drive)
    with virtual_bus(name) as bus:
        machine.start()
        try:
            shown, every, noticed = measure["measure_machine"](bus, 3, 2)
        finally:
            ended.set()
            machine.join()
            vehicle.close()
    assert len(shown) == len(every) == 6 and (shown > 0.0).all()
    assert np.median(every) >= 0.5 * PERIOD
    assert len(noticed) == 2 and (noticed >= CONSUMED - 0.5 * PERIOD).all()  # the heartbeat is heard before it is timed
    assert vehicle.faults == 2


def test_measured_trips_and_losses_are_those_of_the_bus(request: pytest.FixtureRequest) -> None:
    measure = runpy.run_path(str(EXAMPLES / "measure.py"))

    def leaky(channel: int) -> can.BusABC:
        """Every other frame that is only counted is lost."""
        bus, seen = virtual_bus(request.node.name), [0]
        receive = bus.recv

        def recv(timeout: float | None = None) -> can.Message | None:
            found = receive(timeout)
            if found is not None and found.arbitration_id == measure["COUNT"]:
                seen[0] += 1
                if seen[0] % 2:
                    found.arbitration_id = 0
            return found

        bus.recv = recv
        return bus

    with virtual_bus(request.node.name) as bus:
        other = threading.Thread(target=measure["answer"], args=(leaky, 0))
        other.start()
        trips = measure["there_and_back"](bus, 20)
        rate, lost = measure["count"](bus, 20, 0.002)
        bus.send(measure["frame"](measure["END"]))
        other.join()
    assert len(trips) == 20 and (trips > 0.0).all()
    assert 0.0 < rate < 20 / (19 * 0.002) and lost == 0.5
