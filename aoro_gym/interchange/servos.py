"""What the hydraulics do to the hinges, as far as a spring, a rate and limits can say it.

A valve that is shut locks oil in: the hinge is held by a spring, the oil's, up to the pressure at which a relief valve
opens. An open valve moves the spring's other end at the rate of its flow. Levers and volumes are those of the straight
joint, and of the arms at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.machine.rigid_bodies import JOINT, rest_angles
from aoro_gym.machine.sections import Cylinder
from aoro_gym.recording.commands import WHEELS
from aoro_gym.units import GRAVITY

Ends = tuple[float, float]
"""Lower and upper end."""


@dataclass(frozen=True)
class Servo:
    """A hinge moved by cylinders; ends are negative and positive."""

    hinge: str
    stiffness: float  # [N m/rad] of the oil behind the shut valve, and of the joint's mount
    damping: float  # [N m s/rad] of the seals
    friction: float  # [N m] of seals and bearing, sliding
    held_torque: Ends  # [N m] at which a relief valve opens
    driven_torque: Ends  # [N m] that the pump drives at its cut-off
    rate: Ends  # [rad/s] at full signal
    load: float  # [N m] that the oil bears at rest on level ground
    stop_stiffness: float  # [N m/rad] of a bottomed cylinder
    stop_damping: float  # [N m s/rad]

    @property
    def set_point(self) -> float:
        """By how much [rad] the spring's other end is ahead of the hinge at rest."""
        return self.load / self.stiffness


@dataclass(frozen=True)
class WheelMotor:
    """Limits of one wheel motor, by gear."""

    hinge: str
    torque: dict[str, float]  # [N m] at the cross-port relief pressure
    speed: dict[str, float]  # [rad/s] under the whole flow of pump 1, all wheels alike
    brake: float  # [N m] of the disc that stands for unmodelled losses
    parking_brake: float  # [N m]


def servos(machine: Machine) -> tuple[Servo, ...]:
    """The articulated joint's and the four arms'."""
    angles = rest_angles(machine)
    return (_steering(machine), *(_arm(machine, f"arm_{name}", angles[f"arm_{name}"]) for name in WHEELS))


def wheel_motors(machine: Machine) -> tuple[WheelMotor, ...]:
    """The four wheels', in the order of ``WHEELS``."""
    drive = machine.driveline
    full = float(drive.motor.displacement)
    greatest = full * float(drive.relief.pressure * drive.motor.mechanical_efficiency)
    flow = float(drive.pump.displacement * machine.engine.set_speed)
    geared = gears(machine)
    speed = {gear: flow / (2.0 * full * sum(shares)) for gear, shares in geared.items()}
    return tuple(
        WheelMotor(
            hinge=f"wheel_{name}",
            torque={gear: greatest * shares[0 if name[0] == "f" else 1] for gear, shares in geared.items()},
            speed=speed,
            brake=float(drive.brake.disc_torque),
            parking_brake=float(drive.brake.parking_torque),
        )
        for name in WHEELS
    )


def gears(machine: Machine) -> dict[str, Ends]:
    """Share of a wheel motor's displacement in each gear, of a front and of a rear one."""
    second = (0.5, 1.0) if machine.laws.obeys("second_gear", "front") else (1.0, 0.5)
    return {"gear_1": (1.0, 1.0), "gear_2": second, "gear_3": (0.5, 0.5)}


def steering_displacement(machine: Machine, angle: float) -> Ends:
    """Volume a radian [m³/rad] that ports B and A take at a joint ``angle`` [rad]; torque a unit of their pressure."""
    cylinder = machine.steering.cylinder
    right, left = (float(cylinder.linkage.lever(turned)) for turned in (angle, -angle))
    bore, annulus = float(cylinder.bore_area), float(cylinder.annulus_area)
    return bore * left + annulus * right, bore * right + annulus * left


def arm_displacement(machine: Machine, angle: float) -> Ends:
    """Volume a radian [m³/rad] that bore and rod side of an arm's cylinder take at an arm ``angle`` [rad]."""
    cylinder = machine.arm.cylinder
    lever = float(cylinder.linkage.lever(-angle))
    return float(cylinder.bore_area) * lever, float(cylinder.annulus_area) * lever


def _steering(machine: Machine) -> Servo:
    steering, joint = machine.steering, machine.joint
    cylinder, valve = steering.cylinder, steering.valve
    to_right, to_left = steering_displacement(machine, 0.0)
    lever, stop_lever = float(cylinder.linkage.lever(0.0)), float(cylinder.linkage.mean_lever)
    rest = float(steering.tank_line.back_pressure)
    oil = float(cylinder.bore_area * cylinder.linkage.extension(0.0)) + float(
        cylinder.annulus_area * (cylinder.stroke - cylinder.linkage.extension(0.0))
    )
    volume = oil + float(steering.hose_volume + 2.0 * cylinder.dead_volume)
    compliance = volume / float(machine.oil.effective_modulus(rest)) + float(steering.hose_compliance)
    stiffness = (to_left**2 + to_right**2) / compliance
    driven = min(float(steering.pump.cutoff), float(valve.shock_pressure))
    return Servo(
        hinge=JOINT,
        stiffness=1.0 / (1.0 / stiffness + float(joint.compliance)),
        damping=2.0 * float(cylinder.seal_viscous) * lever**2,
        friction=float(joint.friction_torque) + 2.0 * lever * _seal(cylinder, 2.0 * rest),
        held_torque=(-to_right * float(valve.shock_pressure), to_left * float(valve.shock_pressure)),
        driven_torque=(-to_right * driven, to_left * driven),
        rate=(-float(valve.nominal_flow_right) / to_right, float(valve.nominal_flow_left) / to_left),
        load=0.0,
        stop_stiffness=2.0 * float(joint.stop_stiffness) * stop_lever**2,
        stop_damping=2.0 * float(joint.stop_damping) * stop_lever**2,
    )


def _arm(machine: Machine, hinge: str, angle: float) -> Servo:
    arm, corner, rest = machine.arm, machine.corner, machine.rest
    cylinder, valve = arm.cylinder, arm.valve
    front = hinge.startswith("arm_f")
    wheel_load = float(rest.wheel_load_front if front else rest.wheel_load_rear)
    bore_pressure = float(rest.bore_pressure_front if front else rest.bore_pressure_rear)
    rod_pressure = float(arm.rod_rest_pressure)
    bore, rod = arm_displacement(machine, angle)
    extension, fixed = float(cylinder.linkage.extension(-angle)), float(arm.hose_volume + cylinder.dead_volume)
    volumes = (
        fixed + float(cylinder.bore_area) * extension,
        fixed + float(cylinder.annulus_area * (cylinder.stroke - extension)),
    )
    stiffness = sum(
        displacement**2 / (volume / float(machine.oil.effective_modulus(pressure)) + float(arm.hose_compliance))
        for displacement, volume, pressure in zip((bore, rod), volumes, (bore_pressure, rod_pressure), strict=True)
    )
    lever, stop_lever = bore / float(cylinder.bore_area), float(cylinder.linkage.mean_lever)
    relief = float(valve.port_relief)
    driven = min(float(machine.steering.pump.cutoff), relief)
    flow = float(valve.nominal_flow)
    return Servo(
        hinge=hinge,
        stiffness=stiffness,
        damping=float(cylinder.seal_viscous) * lever**2,
        friction=lever * _seal(cylinder, bore_pressure + rod_pressure),
        held_torque=(-bore * relief, rod * relief),
        driven_torque=(-bore * driven, rod * driven),
        rate=(-flow / bore, flow / rod),
        load=-(wheel_load * float(arm.length) - GRAVITY * float(corner.mass * corner.rho)) * float(np.cos(angle)),
        stop_stiffness=float(arm.stop_stiffness) * stop_lever**2,
        stop_damping=float(arm.stop_damping) * stop_lever**2,
    )


def _seal(cylinder: Cylinder, pressures: float) -> float:
    """Friction [N] of a cylinder's seals that slide, under the sum of both ``pressures`` [Pa]."""
    return float(cylinder.seal_preload) + float(cylinder.seal_pressure_coefficient) * pressures
