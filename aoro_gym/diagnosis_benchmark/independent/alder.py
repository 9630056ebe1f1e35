"""The family alder: constants and what its device code needs besides."""

from collections.abc import Mapping

from aoro_gym.units import BAR, LITRE_PER_MINUTE

from . import common
from .constants import Constant, Table
from .laws import alder as laws

__all__ = ["TABLE", "derived", "laws"]

L = LITRE_PER_MINUTE

TABLE: Table = {
    **common.COMMON,
    "stiffness_along": Constant("N/m", 3.0e5, 4.0e5, 5.0e5, "E: tire shear stiffness", 0.02),
    "stiffness_across": Constant("N/m", 1.6e5, 2.0e5, 2.6e5, "E: as above", 0.02),
    "relaxation_along": Constant("m", 0.3, 0.4, 0.55, "Pacejka 2012: about half a tire's radius to one"),
    "relaxation_across": Constant("m", 0.4, 0.55, 0.75, "Pacejka 2012: as above"),
    "relaxation_swivel": Constant("m", 0.8, 1.2, 1.8, "E: rolling gives back part of the swivel torque"),
    "swivel_stiffness": Constant("N m/rad", 10e3, 15e3, 22e3, "E: Sharp, Granger 2003; breakaway at 0.05–0.2 rad"),
    "bearing_bend": Constant("rad", 2e-4, 4e-4, 8e-4, "E: elastic twist of a dry bearing before it slides"),
    "seal_friction": Constant("N", 150, 250, 400, "E: 20–600 N of preload", 0.08),
    "seal_pressure": Constant("N/Pa", 0.6e-4, 1e-4, 1.5e-4, "Excavator models: 1e-4"),
    "seal_static": Constant("", 1.2, 1.3, 1.45, "R: F_s/F_c 1.2–1.5"),
    "seal_speed": Constant("m/s", 0.006, 0.01, 0.016, "R: 1e-4…1e-2"),
    "seal_viscous": Constant("N s/m", 700, 1200, 2000, "Hopsan 500–1000; 300–5000"),
    "seal_bend": Constant("m", 8e-5, 1.5e-4, 3e-4, "E: presliding of rubber seals, 0.1 mm"),
    "dead_left": Constant("", 0.125, 0.135, 0.145, "P: opens between 0.23 and 0.30 V of 2 V"),
    "dead_right": Constant("", 0.155, 0.175, 0.195, "P: opens above 0.30 V"),
    "curve_left_50": Constant("m³/s", 19.6 * L, 20.4 * L, 21.2 * L, "P: measured, ±4 %"),
    "curve_left_75": Constant("m³/s", 53.5 * L, 55.3 * L, 57.0 * L, "P: measured"),
    "curve_left_100": Constant("m³/s", 68.5 * L, 70.6 * L, 72.7 * L, "P: measured"),
    "curve_right_50": Constant("m³/s", 12.0 * L, 12.5 * L, 13.0 * L, "P: measured"),
    "curve_right_75": Constant("m³/s", 41.8 * L, 43.2 * L, 44.6 * L, "P: measured"),
    "curve_right_100": Constant("m³/s", 63.4 * L, 65.4 * L, 67.4 * L, "P: measured"),
    "spool_gap": Constant("m³/s", 0.01 * L, 0.02 * L, 0.05 * L, "R: spool leakage 5–60 cm³/min"),
    "spool_frequency": Constant("rad/s", 80, 110, 160, "Hopsan: 100 rad/s; 50–250"),
    "spool_damping": Constant("", 0.7, 0.85, 1.0, "0.7–1"),
    "spool_rate": Constant("1/s", 10, 14, 20, "E: 5–25 full strokes a second"),
    "valve_play": Constant("", 0.004, 0.008, 0.013, "E: hysteresis 1–6 % is twice this", 0.05),
    "compensator_drop": Constant("Pa", 6 * BAR, 7 * BAR, 8.5 * BAR, "P: fitted, not printed; 4–14"),
    "compensator_spring": Constant("Pa", 0.8 * BAR, 1.2 * BAR, 1.8 * BAR, "E: spring's rise over the stroke"),
    "compensator_conductance": Constant("m³/s/√Pa", 2.6e-6, 3.2e-6, 4.0e-6, "E: 90 L/min at 2–3 bar, fully open"),
    "compensator_stroke": Constant("m", 3e-3, 4e-3, 5e-3, "E"),
    "compensator_area": Constant("m²", 2.5e-4, 3.1e-4, 3.8e-4, "E: Ø20 mm"),
    "compensator_mass": Constant("kg", 0.08, 0.12, 0.16, "E: steel spool with a third of its spring"),
    "compensator_damping": Constant("N s/m", 250, 450, 800, "E: damping orifice of 0.8 mm"),
    "return_conductance": Constant("m³/s/√Pa", 1.6e-6, 1.9e-6, 2.3e-6, "P: fitted, not printed; 2–11 bar at 70 L/min"),
    "sense_start": Constant("", 0.06, 0.08, 0.10, "E: the load-sensing tap opens before the edge"),
    "sense_lag": Constant("s", 0.005, 0.008, 0.014, "E: orifice and 3 m of Ø6 mm line"),
    "sense_bleed": Constant("m³/s", 0.3 * L, 0.5 * L, 0.9 * L, "E: 0.3–1.5 L/min"),
    "pump_flow": Constant("m³/s", 205 * L, 214 * L, 220 * L, "D: 140 cm³/rev at 1595 rpm, 96 %"),
    "pump_leakage": Constant("m³/s/Pa", 1e-12, 2e-12, 4e-12, "E: 1–3 L/min at 100 bar"),
    "pump_limit": Constant("Pa", 190 * BAR, 210 * BAR, 240 * BAR, "E: cut-off 180–280 bar"),
    "margin": Constant("Pa", 18 * BAR, 21 * BAR, 24 * BAR, "R: 14–25 bar", 0.01),
    "control_band": Constant("Pa", 6 * BAR, 9 * BAR, 13 * BAR, "E: control spool fully open"),
    "control_frequency": Constant("rad/s", 200, 300, 420, "E: spool of the pressure–flow controller on its spring"),
    "control_damping": Constant("", 0.7, 0.9, 1.2, "E"),
    "control_lead": Constant("s", 0.007, 0.010, 0.014, "E: damping of the control spool; Hopsan's lead form"),
    "stroke_up": Constant("s", 0.09, 0.12, 0.16, "R: 0.13 s; Hopsan 0.15"),
    "stroke_down": Constant("s", 0.05, 0.07, 0.10, "R: 0.06 s; Hopsan 0.12"),
}
"""Constants of the family."""


def derived(machine: Mapping[str, float]) -> dict[str, float]:
    """All that the device code reads."""
    made = common.derived(machine)
    for name in ("compensator_conductance", "return_conductance"):
        made[name] *= made["thinner"]
    return made
