"""Effects of oil, hoses and return line: stiffness, air, temperature, back pressure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import REFERENCE_FLOW, REFERENCE_PRESSURE, added, factor, given, scaled
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.units import ZERO_CELSIUS

COMMISSIONED_TEMPERATURE = 35.0
"""Temperature [°C] of the oil that the machine files hold for (E)."""


def kinematic_viscosity(temperature: Quantity) -> Quantity:
    """Viscosity [mm²/s] of a VG 46 oil at ``temperature`` [°C]: Walther, lg lg(ν + 0.7) = A − B lg T (ASTM D341), through
    46 mm²/s at 40 °C and 12 mm²/s at 75 °C (S27). Valid from −20 to 120 °C."""
    known = ((40.0, 46.0), (75.0, 12.0))
    (t1, v1), (t2, v2) = ((np.log10(t + ZERO_CELSIUS), np.log10(np.log10(v + 0.7))) for t, v in known)
    slope = (v2 - v1) / (t2 - t1)
    return 10.0**10.0 ** (v1 + slope * (np.log10(np.asarray(temperature) + ZERO_CELSIUS) - t1)) - 0.7


def relative_density(temperature: Quantity) -> Quantity:
    """Density of a mineral oil at ``temperature`` [°C] over that at 15 °C: 1 − 6.5e-4 (T − 15) (R)."""
    return 1.0 - 6.5e-4 * (np.asarray(temperature) - 15.0)


MODULUS_PER_KELVIN = -0.005
"""Relative change of the liquid's bulk modulus with temperature [1/K] (R; S24: −0.4 to −0.7 %)."""


def _oil_temperature(machine: Machine, change: Quantity) -> Mapping[str, Quantity]:
    """Laminar leaks, viscous friction and what the return filter adds with its flow by dynamic viscosity, the steering
    edges' and traction valves' turbulent flows by density, the liquid's modulus."""
    before, after = COMMISSIONED_TEMPERATURE, COMMISSIONED_TEMPERATURE + np.asarray(change)
    lighter = relative_density(after) / relative_density(before)
    thinner = lighter * (kinematic_viscosity(after) / kinematic_viscosity(before))
    leaks = (
        "steering.valve.leakage", "steering.cylinder.leakage", "steering.pump.leakage", "driveline.pump.leakage",
        "driveline.pump.cross_leakage", "driveline.motor.leakage",
    )  # fmt: skip
    turbulent = (
        "steering.valve.nominal_flow_left", "steering.valve.nominal_flow_right", "driveline.traction.nominal_flow",
    )  # fmt: skip
    return {
        **scaled(*leaks)(machine, 1.0 / thinner),
        **scaled("steering.cylinder.seal_viscous", "steering.tank_line.back_pressure_ramp")(machine, thinner),
        **scaled(*turbulent)(machine, 1.0 / np.sqrt(lighter)),
        **scaled("oil.bulk_modulus")(machine, 1.0 + MODULUS_PER_KELVIN * np.asarray(change)),
    }


def _back_pressure(machine: Machine, pressure: Quantity, throttle: Quantity) -> Mapping[str, Quantity]:
    """A spring that holds, and a throttle of this drop at the reference flow."""
    return {
        "steering.tank_line.back_pressure": pressure,
        "steering.tank_line.throttle_drop": throttle * (machine.steering.tank_line.back_flow / REFERENCE_FLOW) ** 2,
    }


def _return_pressure(machine: Machine, *magnitude: Quantity) -> Quantity:
    line = machine.steering.tank_line
    share = REFERENCE_FLOW / line.back_flow
    return line.back_pressure + line.back_pressure_ramp * share + line.throttle_drop * share**2


def _modulus(pressure: float) -> Callable[..., Quantity]:
    return lambda machine, *magnitude: machine.oil.effective_modulus(pressure)


EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="back_pressure",
        component="oil_and_hoses",
        physics="A filter's bypass holds up the return line, whatever its flow, or a pinched hose does by its square.",
        sign="+: higher",
        magnitudes=(
            Magnitude("pressure", "Pa", 0.0, 15e5, "1D: 1.5 to 5.5 bar; E: a clogged filter's bypass"),
            Magnitude("throttle", "Pa", 0.0, 15e5, "E: the same at 60 L/min"),
        ),
        operational=(Operational("pressure of the return line at 60 L/min", "Pa", _return_pressure),),
        change=_back_pressure,
    ),
    MachineEffect(
        id="oil_temperature",
        component="oil_and_hoses",
        physics="Warmer oil is thinner, lighter and softer: leaks, viscous friction, flows and stiffness follow.",
        sign="+: warmer",
        magnitudes=(Magnitude("change", "K", -30.0, 40.0, "E: 10 to 60 °C about 35 °C, and a hot day"),),
        operational=(Operational("temperature of the oil less that at commissioning", "K", given),),
        change=_oil_temperature,
    ),
    MachineEffect(
        id="oil_bulk_modulus",
        component="oil_and_hoses",
        physics="The liquid itself is stiffer or softer.",
        sign="+: stiffer",
        magnitudes=(factor(0.6, 1.6, "P: adjustable; S16, S27: 1.0 to 1.72e9 Pa"),),
        operational=(Operational("bulk modulus of the oil at 100 bar", "Pa", _modulus(REFERENCE_PRESSURE)),),
        change=scaled("oil.bulk_modulus"),
    ),
    MachineEffect(
        id="entrained_air",
        component="oil_and_hoses",
        physics="Free air makes the oil soft at low pressure and little so at high pressure.",
        sign="+: more air, a lower modulus",
        magnitudes=(Magnitude("gas_fraction", "1", 0.0, 0.05, "S17, S18: 0.5 % by default; E: 0.2 to 5 %"),),
        operational=(
            Operational("bulk modulus of the oil with its air at 10 bar", "Pa", _modulus(10e5)),
            Operational("bulk modulus of the oil with its air at 100 bar", "Pa", _modulus(REFERENCE_PRESSURE)),
        ),
        change=added("oil.gas_fraction"),
    ),
    MachineEffect(
        id="hose_compliance",
        component="oil_and_hoses",
        physics="The walls of the joint's hoses give more or less.",
        sign="+: softer",
        magnitudes=(factor(0.4, 5.0, "P: 1.2 and 1.64e9 Pa; S26: static is softer than dynamic"),),
        operational=(
            Operational(
                "volume per pressure that one side's joint hoses take",
                "m^3/Pa",
                lambda machine, *magnitude: machine.steering.hose_compliance,
            ),
        ),
        change=lambda machine, factor: scaled("steering.hose_bulk_modulus")(machine, 1.0 / factor),
    ),
)
