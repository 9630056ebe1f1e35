"""A steering circuit and its state, for tests of its laws."""

from __future__ import annotations

from typing import Any

import numpy as np

from aoro_gym.twin.physics.steering_circuit import Exchange, Steering, SteeringState
from tests.twin.physics.elements import BAR, LITRE_A_MINUTE, closed_linkage, cv
from tests.twin.physics.launch import record

HALF_RANGE = np.radians(40.0)

# Left and right differ throughout, and the leakages are large enough to be seen beside float32's rounding.
STEERING = record(
    Steering,
    valve_cv_in_left=cv(70.6, 7.0),
    valve_cv_in_right=cv(65.4, 8.0),
    valve_cv_out_left=cv(70.6, 4.0),
    valve_cv_out_right=cv(65.4, 5.0),
    valve_dead_band_left=0.27,
    valve_dead_band_right=0.35,
    valve_opening_left_1V0=0.289,
    valve_opening_left_1V5=0.783,
    valve_opening_right_1V0=0.191,
    valve_opening_right_1V5=0.661,
    valve_spool_time_constant=0.02,
    valve_spool_rate_limit=10.0,
    valve_command_delay=0.01,
    valve_hysteresis=0.03,
    valve_overlap=0.0,
    valve_leakage=2e-12,
    valve_cv_cross_port=0.0,
    valve_cv_compensator=cv(70.6, 3.0),
    valve_compensator_pressure=7.0 * BAR,
    valve_compensator_droop=0.3,
    valve_compensator_time_constant=1e-3,
    valve_shock_pressure=210.0 * BAR,
    valve_shock_ramp=10.0 * BAR,
    valve_shock_flow=100.0 * LITRE_A_MINUTE,
    valve_anticavitation_crack=0.3 * BAR,
    valve_cv_anticavitation=cv(120.0, 5.0),
    hose_volume=0.43e-3,
    hose_compliance=0.43e-3 / 1.2e9,
    cylinder_linkage=closed_linkage(a=0.49, b=0.375, g0=1.35, half_range=HALF_RANGE),
    cylinder_bore_area=5.027e-3,
    cylinder_annulus_area=3.770e-3,
    cylinder_dead_volume=0.05e-3,
    cylinder_leakage=1.5e-12,
    cylinder_seal_preload=250.0,
    cylinder_seal_pressure_coefficient=1e-4,
    cylinder_seal_static_ratio=1.3,
    cylinder_seal_stribeck_velocity=0.01,
    cylinder_seal_viscous=1000.0,
    pump_displacement=140e-6 / (2 * np.pi),
    pump_margin=20.0 * BAR,
    pump_control_band=10.0 * BAR,
    pump_stroke_up_time=0.13,
    pump_stroke_down_time=0.06,
    pump_cutoff=210.0 * BAR,
    pump_ls_time_constant=8e-3,
    pump_cv_bleed=cv(0.5, 200.0),
    pump_leakage=5e-12,
    pump_mechanical_efficiency=0.93,
    pump_line_volume=1.5e-3,
    pump_line_compliance=1.5e-3 / 1.64e9,
    pump_relief_pressure=250.0 * BAR,
    pump_relief_ramp=20.0 * BAR,
    pump_relief_flow=200.0 * LITRE_A_MINUTE,
    tank_line_volume=1e-3,
    tank_line_compliance=1e-3 / 1.2e9,
    tank_line_back_pressure=3.4 * BAR,
    tank_line_back_pressure_ramp=1.0 * BAR,
    tank_line_back_flow=100.0 * LITRE_A_MINUTE,
    tank_line_throttle=0.0,
    tank_line_cv_suction=cv(120.0, 1.0),
    # what only other laws need
    valve_spool_frequency=120.0,
    valve_spool_damping=0.85,
    valve_flow_force_share=0.05,
    valve_compensator_frequency=250.0,
    valve_compensator_damping=0.8,
    valve_shock_time_constant=0.008,
    pump_valve_time_constant=1e-3,
    pump_valve_lead_time=5e-3,
    pump_ls_volume=0.085e-3,
    pump_cv_ls=cv(2.0, 5.0),
    hose_stiffening_pressure=150.0 * BAR,
    hose_delayed_share=0.3,
    hose_delay_time=0.03,
    hose_inertance=1e7,
    hose_resistance=BAR / 1e-3,
)

NO_ARMS = record(Exchange, supply_flow=0.0, tank_flow=0.0, load_pressure=0.0)

IDLE = {
    "supply": 20.0 * BAR,
    "port_a": 3.0 * BAR,
    "port_b": 3.0 * BAR,
    "tank_line": 3.4 * BAR,
    "ls_pressure": 0.0,
    "spool": 0.0,
    "compensator": 1.0,
    "swash": 0.0,
    "flow_in": 0.0,
    "flow_out": 0.0,
}


def state(**values: Any) -> np.ndarray:
    """Idle circuit with some states replaced."""
    return record(SteeringState, **{**IDLE, **values})
