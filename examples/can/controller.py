"""A controller of its own process: shifts gears and steers over CAN. Knows nothing of the twin but its object dictionary.

python examples/can/controller.py --port 43113 --seconds 4
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import can
import canopen

DICTIONARY = Path(__file__).with_name("aoro.eds")
VEHICLE, CONTROLLER = 0x10, 0x20
PERIOD = 0.02


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=43113, help="UDP port of the simulated bus")
    parser.add_argument("--seconds", type=float, default=4.0, help="how long")
    asked = parser.parse_args()

    network = canopen.Network(can.Bus(interface="udp_multicast", channel="239.74.163.2", port=asked.port, hop_limit=0))
    network.connect()
    vehicle = network.add_node(VEHICLE, str(DICTIONARY))
    vehicle.rpdo.read(from_od=True)
    vehicle.tpdo.read(from_od=True)
    network.send_periodic(0x700 + CONTROLLER, b"\x05", 0.05)  # heartbeat: operational

    begun = time.monotonic()
    while (now := time.monotonic() - begun) < asked.seconds:
        moving = now > 1.0  # neutral first, which ends the fault of having had no controller
        drive, gear, steer = vehicle.rpdo[1], vehicle.rpdo[1], vehicle.rpdo[1]
        drive["drive_signal"].raw = 500 if moving else 0
        gear["gear"].raw = 1 if now < 2.0 else 2
        steer["steering_signal"].raw = 300 if now > 3.0 else 0
        drive["parking_brake"].raw = 0 if moving else 1
        vehicle.rpdo[1].transmit()
        vehicle.rpdo[2].transmit()  # arms: their valves stay shut
        time.sleep(PERIOD)
    shown = vehicle.tpdo[1]
    network.disconnect()
    if shown.timestamp is None:
        raise SystemExit("no machine answered on the bus")
    print(f"speed {shown['speed'].raw} mm/s, gear {shown['gear_shown'].raw}, fault {shown['fault'].raw}")


if __name__ == "__main__":
    main()
