"""What of the twin a format of another simulator cannot say, and what its file has instead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aoro_gym.interchange.servos import arm_displacement, steering_displacement
from aoro_gym.machine import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.machine.rigid_bodies import check_one

FORMATS = ("mjcf", "urdf")
"""MuJoCo's model format; the Unified Robot Description Format of ROS and many readers."""


@dataclass(frozen=True)
class Limitation:
    """One thing that the file lacks."""

    part: str
    twin: str
    """What the twin does."""
    file: str
    """What the file has instead."""

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        return f"{self.part}: {self.twin}; here {self.file}"


def limitations(machine: Machine, format_: str) -> tuple[Limitation, ...]:
    """What a file of ``machine`` in ``format_`` cannot say; figures are this machine's."""
    check_one(machine)
    steering = _spread(machine.joint.range, 0.0, lambda angle: steering_displacement(machine, angle))
    arms = _spread(machine.arm.swing, machine.rest.arm_angle_front, lambda angle: arm_displacement(machine, angle))
    everywhere = [
        Limitation(
            "cylinder levers",
            "torque and rate change with the angle",
            f"those of the straight joint (true ones are {steering[0]:.2f} to {steering[1]:.2f} times as large) and of the "
            f"arms at rest ({arms[0]:.2f} to {arms[1]:.2f} times); the JSON has torques over the range",
        ),
        Limitation(
            "seals and bearings",
            "friction grows with pressure, sticks harder than it slides, and bends before it breaks away",
            "constant sliding friction and viscous damping, at the pressures of rest",
        ),
        Limitation(
            "brakes", "a parking brake of its own command", "the disc that is always on; the JSON has the torque"
        ),
        Limitation(
            "soft and mapped ground",
            "ground of other friction and rolling resistance, soft ground, scanned terrain",
            "no terrain: export it as a mesh or a height field of its own",
        ),
        Limitation("sensors", "noise, drift, delay and lost fixes", "true values, or places alone"),
        *_of_machine(machine),
    ]
    return (*(_mjcf(machine) if format_ == "mjcf" else _urdf()), *everywhere)


def _mjcf(machine: Machine) -> Sequence[Limitation]:
    held, cutoff = float(machine.arm.valve.port_relief), float(machine.steering.pump.cutoff)
    return (
        Limitation(
            "hydraulics",
            "pressures, flows, hoses, reliefs and the oil's own state",
            "a spring as stiff as the shut-in oil, whose other end moves at the rate that is the control",
        ),
        Limitation(
            "valves",
            "dead band, opening curve, spool and compensator lags, command delay, leakage",
            "a rate in proportion to the control at once; limits are the nominal flow's",
        ),
        Limitation(
            "load sensing and engine",
            "joint and arms share one pump, all pumps one engine that slows down",
            "every servo has all of its rate and torque at any time",
        ),
        Limitation(
            "pressure limits",
            "the pump drives up to its cut-off, the cylinder holds up to its relief valve, which then lets oil go",
            f"the relief's limit for both ({held / cutoff:.2f} times the cut-off in the arms), without loss of oil",
        ),
        Limitation(
            "driveline",
            "a closed loop feeds four motors in parallel: their speeds share the flow, their pressures are alike",
            "a torque a wheel, limited as in first gear; other gears' limits are in <custom> and in the JSON",
        ),
        Limitation(
            "tire law",
            "bristles along and across with static and sliding friction, relaxation, scrub",
            "one isotropic sliding friction, viscous below it, with rolling and torsional friction",
        ),
        Limitation(
            "tire shape",
            "five discs; a tire that leans touches with its shoulder",
            "an ellipsoid of the loaded radius, as wide as the outer discs stand apart; its margin is the rest's deflection",
        ),
    )


def _urdf() -> Sequence[Limitation]:
    return (
        Limitation(
            "actuators and hydraulics",
            "circuits, valves, pumps, engine and driveline",
            "limits of effort and velocity: nothing holds an arm up until a controller does; the JSON has springs and rates",
        ),
        Limitation(
            "unequal directions",
            "a cylinder pushes and pulls with different areas, left and right turns differ",
            "the smaller effort and the larger velocity of both directions",
        ),
        Limitation(
            "contact",
            "tires and hulls are springs and dampers with friction, and the machine does not touch itself",
            "shapes alone, tires as cylinders; the JSON has stiffness, damping and friction",
        ),
        Limitation(
            "end stops", "spring and damper of a bottomed cylinder", "a limit; the JSON has stiffness and damping"
        ),
        Limitation("gears", "three, with their own torques and speeds", "torque of the first, speed of the third"),
        Limitation("rest pose", "arms below level, bent tires", "all angles zero; the JSON has the pose"),
    )


def _of_machine(machine: Machine) -> Sequence[Limitation]:
    """What only some machines have."""
    found = []
    if float(machine.joint.backlash) > 0.0:
        found.append(Limitation("joint", "free play between cylinders and frames", "no play"))
    if machine.loaded:
        found.append(Limitation("load", "logs that slide in their bunk", "a load fixed to the rear frame"))
    if not machine.laws.default:
        found.append(
            Limitation(
                "laws", "components that obey other laws than the default ones", "the default laws' springs and limits"
            )
        )
    return found


def _spread(
    limit: Quantity, usual: Quantity, displacement: Callable[[float], tuple[float, float]]
) -> tuple[float, float]:
    """Least and greatest of what a cylinder's volume a radian is over ±``limit`` [rad], of that at the ``usual`` angle."""
    found = np.array([displacement(angle) for angle in np.linspace(-float(limit), float(limit), 41)])
    shares = found / displacement(float(usual))
    return float(shares.min()), float(shares.max())
