"""The catalogue of effects, each off by default; :mod:`aoro_gym.effects.effect` says what an effect is.

Source tags are those of the machine file, and:

- S13 Project Chrono, 335/65 R22.5 tire; S15 Simscape excavator model, parameter scripts
- S19 Sharp & Granger, On car steering torques at parking speeds; S20 Mateichyk et al., Appl. Sci. 14, 2024, 10925;
  S21 doi:10.1177/1687814016668765: steering torque of a standing wheel
- S24 Yuan et al., Chin. J. Mech. Eng. 2022: bulk modulus of oil with air; S26 Johnston, Drew & Longmore, J. Vib. Acoust.
  132, 2010, 021011: dynamic modulus of hoses
- S34 Novotechnik, RFC-4800 rotary sensors, data sheets
"""

from __future__ import annotations

from collections.abc import Mapping

from aoro_gym.effects import (
    cylinders,
    driveline,
    engine,
    joint,
    mass,
    oil_and_hoses,
    pump,
    sensor,
    valve,
    wheels_and_ground,
)
from aoro_gym.effects.effect import Effect

IDS = (
    "sensor_delay", "sensor_filter", "sensor_gain", "measuring_chain", "engine_droop", "pump_response",
    "pump_limit", "command_delay", "spool_lag", "spool_rate", "dead_band", "valve_gain", "valve_hysteresis",
    "compensator_lag", "compensator_opening", "back_pressure", "oil_temperature", "oil_bulk_modulus",
    "entrained_air", "hose_compliance", "cylinder_leakage", "cross_port_leakage", "seal_friction", "joint_friction",
    "joint_backlash", "frame_compliance", "payload", "driveline_resistance", "tire_relaxation", "tire_stiffness",
    "tire_scrub", "soft_ground", "ground_slope",
)  # fmt: skip
"""Ids of all effects in the order in which they are listed everywhere."""

_COMPONENTS = (cylinders, driveline, engine, joint, mass, oil_and_hoses, pump, sensor, valve, wheels_and_ground)
_BY_ID = {effect.id: effect for component in _COMPONENTS for effect in component.EFFECTS}

EFFECTS: Mapping[str, Effect] = {name: _BY_ID[name] for name in IDS}
"""Every effect by its id."""


def matching(pattern: str | None = None) -> list[Effect]:
    """Effects whose id or component holds ``pattern``, all if None; raises ValueError if there is none."""
    found = [one for one in EFFECTS.values() if pattern is None or pattern in one.id or pattern in one.component]
    if not found:
        raise ValueError(f"no effect matches {pattern!r}; choose from: {', '.join(EFFECTS)}")
    return found
