"""Vehicle in the loop: bodies and steering here, the driveline in another process; a kick of delay, an emergency stop.

python examples/vil/laboratory.py
"""

import sys

import numpy as np

from aoro_gym import Machine
from aoro_gym.cosimulation.laboratory.coupling import Coupling
from aoro_gym.cosimulation.laboratory.process import RemoteDriveline
from aoro_gym.cosimulation.laboratory.protection import Limits, Protection
from aoro_gym.cosimulation.laboratory.run import driveline_process
from aoro_gym.twin.hub_driven import HubDrivenTwin

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 1.5
HUB_INERTIA = 4.0  # kg m² of the wheels' inertia, on the driveline's side

machine = Machine.load("aoro")
wheels = {"wheel.inertia_spin": machine.wheel.inertia_spin - HUB_INERTIA}
twin = HubDrivenTwin(machine=machine.set(wheels))

with driveline_process("aoro", HUB_INERTIA) as address:
    driveline = RemoteDriveline(address)
    protection = Protection(Limits(soft_start=0.5), twin.hub_torques)
    coupling = Coupling(twin, driveline, protection=protection)
    while twin.time[0] < SECONDS:
        torques = coupling.exchange({"drive_signal": 0.6, "steering_signal": 0.3, "parking_brake": 0.0})
    speed, angle = float(twin.output("speed")[0]), float(twin.output("joint_angle")[0])
    print(f"{speed:.2f} m/s, joint at {np.degrees(angle):.1f}°, hub torques {torques[:, 0].round()} N m")

    protection.stop("someone has pressed the button")
    periods = 0
    while not protection.at_rest:
        coupling.exchange({"drive_signal": 0.6})  # no longer obeyed
        periods += 1
    coupling.exchange({})  # and braked
    print(f"{protection.phase}: {protection.reason}; hubs at rest after {1e3 * periods * coupling.period:.0f} ms")
    driveline.close()
