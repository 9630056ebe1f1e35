"""Parts of a machine, each by the laws of one of the component families: whole families, and mixtures of them.

A mixture has a name, as ``mixed_elm_fir_0012``: the families that its parts may be of, and the number of the draw. Its
constants are those of each part's family; an effect acts on the part that has it, by that family's law.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.independent.constants import Constant

from .vehicle import STILL, Made, geometry

FAMILIES = ("elm", "fir", "hazel", "maple", "oak", "larch")
"""Families that mixtures are of, and that anybody may train on."""
SEALED = ("aspen", "pine", "yew")
"""Families that judge and nothing else: no mixture has a part of them."""
ALL_FAMILIES = FAMILIES + SEALED
"""All families."""
MIXED = "mixed"
"""Begins the names of mixtures."""

CONSTANTS: Mapping[str, tuple[str, ...]] = {
    part: tuple(names.split())
    for part, names in {
        "vehicle": (
            "mass_front_empty mass_rear_empty inertia_front inertia_rear place_front place_rear half_base track tire_radius "
            "wheel_inertia stop_angle payload slope_angle motor_displacement loop_compliance loop_leakage loop_relief "
            "charge_pressure drive_displacement drive_lag stop_stiffness stop_damping"
        ),
        "tires": (
            "brake_torque motor_viscosity soil_modulus cone_number shear_displacement ground_friction patch_radius "
            "inflation scrub_limit shear relaxation_length twist_stiffness twist_base tire_damping bearing adhesion "
            "tread_width carcass churning soil_stress bore_radius stiff_along stiff_across cone_index disc_radius sidewall "
            "contact_pressure lug_height penetration motor_rub turf_stiffness soil_stiffness contact_length belt_rigidity "
            "rut_modulus"
        ),
        "hinge": "hinge_torque",
        "seals": "seal_force seal_ratio stribeck_speed seal_viscosity",
        "rods": "rod_inertia joint_play joint_stiffness joint_damping",
        "engine": "engine_speed engine_inertia engine_idle_torque droop",
        "hydraulics": (
            "pump_efficiency pump_displacement dead_volume hose_volume supply_volume null_shift temperature flow_left "
            "flow_right edge_scale edge_drop compensator_drop return_drop tank_pressure margin pump_leakage shock_pressure "
            "stroke_time sense_lag regulator_lead line_resistance line_loss line_inertance cut_off relief_pressure "
            "sense_relief control_lag tank_drop check_pressure check_slope tank_loss filter_resistance bulk_at_20 air_share "
            "pocket_volume saturation_pressure dissolving_time line_gas hose_modulus hose_creep piston_leakage port_leakage "
            "spool_frequency spool_damping spool_rate spool_lag pilot_lag coil_lag lever_play spool_friction magnetic_width "
            "driver_gain compensator_lag compensator_stop bypass band_left band_right half_left half_right most_left "
            "most_right bore_left bore_right unloading_lag unloading_band unloading_drop override preload return_slope "
            "return_loss return_inertance gas_time line_bore spring_stiffness compensator_spring notch_left notch_right "
            "slot_left slot_right check_drop torque_limit swash_lag swash_friction relief_band relief_lag return_length "
            "return_gas hose_relaxed wall_fast wall_slow coil_radius piston_gap play_width discharge "
            "compensator_frequency spring_travel stroke_down control_band control_time power_end cooler_bore "
            "critical_pressure hose_rubber port_gap spool_acceleration bouc_width curve_scale "
            "priority_lag priority_band priority_drop bypass_drop poppet_pressure poppet_band filter_cake bulk_most "
            "pocket_at_rest neck_resistance hose_expansion piston_clearance bore_opening bristle_friction amplification "
            "pipe_length pipe_bore flexible bubble_share ring_gap crack_width slip_width transducer_scale sense_limit "
            "cock_angle compensator_port drop_spring bridge_ratio bridge_spring strainer_drop lift_pressure lift_band "
            "vane_band foam_share foam_time braid_slack braid_modulus braid_friction barrel_gap land_gap capstan"
        ),
        "command": (
            "command_gain command_delay bus_cycle bus_delay driver_window driver_delay remote_lag remote_delay "
            "input_lag input_delay filter_cycle filter_lag "
            "pulse_period third_lag third_delay median_window median_delay"
        ),
        "angle": (
            "angle_gain angle_offset angle_delay angle_lag sample_hold loading update_period angle_window eccentricity "
            "angle_noise angle_step bus_queue poll_period angle_ladder rail_error stamp_cycle imbalance "
            "queue_time damper_lag linkage "
            "beat_delay tent_window rod_error twin_delay angle_cube slide_error packet_wait hann_window track_wear"
        ),
        "chain": (
            "chain_window chain_delay chain_lag pressure_offset_a pressure_offset_b pressure_offset_pump pressure_noise "
            "dwell decimation resample_period "
            "raised_window"
        ),
    }.items()
}
"""Constants of each part, of whatever family."""
PARTS = tuple(CONSTANTS)
"""Parts that may be of a family of their own."""
PART_OF: Mapping[str, str] = {name: part for part, names in CONSTANTS.items() for name in names}
"""Part that has a constant."""
FORMULAS: Mapping[str, tuple[str, ...]] = {
    "tires": ("drag", "scrub"),
    "seals": ("breakaway",),
    "hydraulics": (
        "pump_response", "pump_limit", "spool_lag", "spool_rate", "regulated_flow", "hysteresis", "open_passage",
        "back_pressure", "bulk_modulus", "gas", "hose", "piston_leakage", "port_leakage",
    ),
    "command": ("command_delay",),
    "angle": ("angle_delay", "angle_lag", "span"),
    "chain": ("chain_lag",),
}  # fmt: skip
"""What effects measure of each part, by the family's function of that name."""
LAWS: Mapping[str, tuple[str, ...]] = {
    "tires": ("tire", "resistance"),
    "hinge": ("hinge",),
    "seals": ("seals",),
    "rods": ("rods",),
    "engine": ("engine",),
    "hydraulics": ("hydraulics", "limit", "start", "hydraulic_signals"),
}
"""Device code of each part, by the family's function of that name."""
DERIVING = ("vehicle", "hydraulics", "command", "tires")
"""Parts whose constants others follow from, in the order in which they need each other."""


@dataclass(frozen=True, eq=False)
class Family:
    """A machine type: a family by :attr:`parts`. Formulas of :data:`FORMULAS` are attributes, too."""

    name: str
    parts: Mapping[str, str]

    @cached_property
    def modules(self) -> Mapping[str, ModuleType]:
        """Constants and formulas by part."""
        return {part: importlib.import_module(f"{__package__}.{family}") for part, family in self.parts.items()}

    @cached_property
    def families(self) -> tuple[str, ...]:
        """Families of the parts, in their order."""
        return tuple(family for family in ALL_FAMILIES if family in self.parts.values())

    @cached_property
    def TABLE(self) -> Mapping[str, Constant]:
        """Constants of all parts, family by family in the order in which each has them."""
        return {
            name: one
            for family in self.families
            for name, one in importlib.import_module(f"{__package__}.{family}").TABLE.items()
            if self.parts[PART_OF[name]] == family
        }

    @cached_property
    def REALISED(self) -> Mapping[str, Mapping[str, float]]:
        """Constants that an effect changes, and how, by the family of the part that has it."""
        return {
            effect: constants
            for family in self.families
            for effect, constants in importlib.import_module(f"{__package__}.{family}").REALISED.items()
            if self.parts[PART_OF[next(iter(constants))]] == family
        }

    def derived(self, m: Made) -> dict[str, float]:
        """All constants of the kernel."""
        made = {**STILL, **m, **geometry(m)}
        for part in DERIVING:
            follows: Callable[[Made], dict[str, float]] | None = self.modules[part].DERIVED.get(part)
            made |= follows(made) if follows else {}
        return made

    def __getattr__(self, formula: str) -> Callable[..., float]:
        for part, names in FORMULAS.items():
            if formula in names:
                return getattr(self.modules[part], formula)
        raise AttributeError(f"a family has no {formula!r}")


def mixture(families: Sequence[str], number: int) -> str:
    """Name of a mixture: the ``number``-th draw of parts from some ``families``."""
    return "_".join((MIXED, *(one for one in FAMILIES if one in families), f"{number:04d}"))


def mixed_of(name: str) -> list[str]:
    """Families that the parts of a mixture may be of, by its name."""
    return name.split("_")[1:-1]


@lru_cache(maxsize=512)
def family_of(name: str) -> Family:
    """A family, or a mixture, by its name.

    Raises:
        ValueError: There is no such family.
    """
    if name in ALL_FAMILIES:
        return Family(name, dict.fromkeys(PARTS, name))
    families, number = mixed_of(name), name.rpartition("_")[2]
    if not families or not number.isdecimal() or mixture(families, int(number)) != name:
        known = ", ".join(ALL_FAMILIES)
        raise ValueError(f"family must be one of {known}, or a mixture such as mixed_elm_fir_0012, not {name!r}")
    rng = np.random.default_rng([int(number), *" ".join(families).encode()])
    return Family(name, {part: str(rng.choice(families)) for part in PARTS})


def laws_of(name: str, kind: Any) -> Any:
    """Device code of a family or mixture for a Warp struct of its constants, as the integrator takes it."""
    from .laws import assembly, places

    modules = {
        part: importlib.import_module(f"{__package__}.laws.{family}") for part, family in family_of(name).parts.items()
    }
    laws = SimpleNamespace(**{law: getattr(modules[part], law) for part, names in LAWS.items() for law in names})
    laws.State, laws.remembered = places.State, assembly.nothing_remembered
    laws.derivative = assembly.assemble(laws, kind)
    return laws
