"""Parameters and state of the steering circuit: valve section, hoses, cylinders, load-sensing pump, return line.

Port A is pressurised in a left turn (positive command, positive joint rate). Machine section ``steering``.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.cylinders import Linkage
from aoro_gym.twin.physics.fluid import Gas


@wp.struct
class Steering:
    """Parameters of the steering circuit, its pump and its return line (C = Q_nom/√Δp_nom in m³/s/√Pa)."""

    # valve section
    valve_cv_in_left: float  # [m³/s/√Pa] meter-in edge P→A, fully open
    valve_cv_in_right: float  # P→B
    valve_cv_out_left: float  # meter-out edge B→T in a left turn
    valve_cv_out_right: float  # A→T in a right turn
    valve_dead_band_left: float  # [V] of the signal
    valve_dead_band_right: float
    valve_opening_left_1V0: float  # [-] measured opening at 1.0 V
    valve_opening_left_1V5: float
    valve_opening_right_1V0: float
    valve_opening_right_1V5: float
    valve_spool_time_constant: float  # [s]
    valve_spool_rate_limit: float  # [1/s] full strokes a second
    valve_command_delay: float  # [s]
    valve_hysteresis: float  # [-] width, share of the full signal
    valve_overlap: float  # [V] by which the opening curve lies farther out
    valve_leakage: float  # [m³/s/Pa] port to tank
    valve_cv_cross_port: float  # leak from port to port
    valve_cv_compensator: float  # fully open
    valve_compensator_pressure: float  # [Pa]
    valve_compensator_droop: float  # [-] of the setting over the stroke
    valve_compensator_time_constant: float  # [s] full stroke under an excess of one setting
    valve_shock_pressure: float  # [Pa]
    valve_shock_ramp: float  # [Pa]
    valve_shock_flow: float  # [m³/s]
    valve_anticavitation_crack: float  # [Pa]
    valve_cv_anticavitation: float
    # hoses and cylinders
    hose_volume: float  # [m³] a side
    hose_compliance: float  # [m³/Pa] walls, a side
    cylinder_linkage: Linkage
    cylinder_bore_area: float  # [m²]
    cylinder_annulus_area: float  # [m²]
    cylinder_dead_volume: float  # [m³] an end
    cylinder_leakage: float  # [m³/s/Pa] a cylinder
    cylinder_seal_preload: float  # [N]
    cylinder_seal_pressure_coefficient: float  # [N/Pa]
    cylinder_seal_static_ratio: float  # [-]
    cylinder_seal_stribeck_velocity: float  # [m/s]
    cylinder_seal_viscous: float  # [N s/m]
    # load-sensing pump (pump 2) and its line
    pump_displacement: float  # [m³/rad]
    pump_margin: float  # [Pa]
    pump_control_band: float  # [Pa] error that moves the swash at full rate
    pump_stroke_up_time: float  # [s]
    pump_stroke_down_time: float  # [s]
    pump_cutoff: float  # [Pa]
    pump_ls_time_constant: float  # [s]
    pump_cv_bleed: float
    pump_leakage: float  # [m³/s/Pa]
    pump_mechanical_efficiency: float  # [-]
    pump_line_volume: float  # [m³]
    pump_line_compliance: float  # [m³/Pa]
    pump_relief_pressure: float  # [Pa]
    pump_relief_ramp: float  # [Pa]
    pump_relief_flow: float  # [m³/s]
    # return line
    tank_line_volume: float  # [m³]
    tank_line_compliance: float  # [m³/Pa]
    tank_line_back_pressure: float  # [Pa]
    tank_line_back_pressure_ramp: float  # [Pa]
    tank_line_back_flow: float  # [m³/s]
    tank_line_throttle: float  # [Pa s²/m⁶]
    tank_line_cv_suction: float
    # laws, by the numbers of aoro_gym.machine.laws, and what only they need
    spool_law: int
    valve_spool_frequency: float  # [rad/s]
    valve_spool_damping: float  # [-]
    opening_law: int
    orifice_law: int
    flow_force_law: int
    valve_flow_force_share: float  # [-]
    compensator_law: int
    valve_compensator_frequency: float  # [rad/s]
    valve_compensator_damping: float  # [-]
    compensator_sensing_law: int
    shock_valve_law: int
    valve_shock_time_constant: float  # [s]
    pump_law: int
    pump_valve_time_constant: float  # [s]
    pump_valve_lead_time: float  # [s]
    load_sensing_line_law: int
    pump_ls_volume: float  # [m³]
    pump_cv_ls: float
    return_line_law: int
    hose_law: int
    hose_stiffening_pressure: float  # [Pa]
    hose_delayed_share: float  # [-]
    hose_delay_time: float  # [s]
    hose_inertance: float  # [kg/m⁴]
    hose_resistance: float  # [Pa s/m³]


@wp.struct
class SteeringLawState:
    """States that only some laws have."""

    spool_rate: float  # [1/s]
    compensator_rate: float  # [1/s]
    pump_valve: float  # [-] error over the control band that pump 2's control valve has followed
    shock_a: float  # [m³/s] through the relief valve of port A
    shock_b: float
    hose_strain_a: float  # [m³] by which the walls of side A have crept
    hose_strain_b: float
    hose_a: float  # [Pa] content of side A's hose on the valve's end
    hose_b: float
    hose_flow_a: float  # [m³/s] from there to the cylinders
    hose_flow_b: float


@wp.struct
class SteeringState:
    supply: float  # [Pa] content of pump 2's line
    port_a: float  # [Pa] content of hose A with its chambers
    port_b: float  # [Pa]
    tank_line: float  # [Pa] content of the return line
    ls_pressure: float  # [Pa]
    spool: float  # [-] −1 (right) … 1 (left)
    compensator: float  # [-] 0 (closed) … 1 (open)
    swash: float  # [-] 0 … 1 of pump 2
    flow_in: float  # [m³/s] metered into the loaded port
    flow_out: float  # [m³/s] metered out of the other port
    law: SteeringLawState


@wp.struct
class SteeringGas:
    """Free gas of the circuit's volumes at the start of a main step."""

    supply: Gas
    port_a: Gas
    port_b: Gas
    tank_line: Gas


@wp.struct
class SteeringGeometry:
    """Chambers at one joint angle."""

    volume_a: float  # [m³] all oil on side A: hose, dead volumes, right bore, left annulus
    volume_b: float
    displacement_a: float  # [m³/rad] dV_A/dθ
    displacement_b: float
    lever_left: float  # [m] dL/dγ of the left cylinder
    lever_right: float


@wp.struct
class Exchange:
    """What the pendulum arms take from the pump's line and give to the return line."""

    supply_flow: float  # [m³/s] drawn
    tank_flow: float  # [m³/s] returned
    load_pressure: float  # [Pa] highest load of a working section
