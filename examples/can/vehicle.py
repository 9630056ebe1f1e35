"""The twin as a node of a CAN bus, and a controller in another process that shifts its gears, is lost, and comes back.

python examples/can/vehicle.py
"""

import socket
import subprocess
import sys
import time
from pathlib import Path

from aoro_gym import Twin
from aoro_gym.cosimulation.canbus.vehicle import CanVehicle, multicast_bus

CONTROLLER = Path(globals().get("__file__", "examples/can/vehicle.py")).with_name("controller.py")

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]

twin = Twin()
vehicle = CanVehicle(twin, multicast_bus(port))
history = []  # time [s], gear, speed [m/s], fault


def drive_with_controller(seconds: float) -> None:
    """Move the twin while a controller runs, until two seconds after it has ended: a braked machine rocks on its tires."""
    command = [sys.executable, str(CONTROLLER), "--port", str(port), "--seconds", str(seconds)]
    controller = subprocess.Popen(command)
    ended = None
    while ended is None or time.monotonic() < ended + 2.0:
        if ended is None and controller.poll() is not None:
            ended = time.monotonic()
        vehicle.run(0.1)
        speed = float(twin.output("speed")[0])
        history.append((float(twin.time[0]), int(vehicle.commands["gear"]), speed, int(vehicle.watch.fault)))


drive_with_controller(3.0)  # and then its heartbeat is missed: neutral and brake
stopped = history[-1]
drive_with_controller(3.0)  # it comes back, and the machine drives again
vehicle.close()

fastest = max(speed for _, _, speed, _ in history)
print(f"fastest {fastest:.2f} m/s, gears {sorted({gear for _, gear, _, _ in history})}, faults {vehicle.faults}")
print(f"after the first controller had ended: {stopped[2]:.3f} m/s, fault {stopped[3]}")
