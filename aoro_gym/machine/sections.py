"""The machine's components: every independent parameter with its SI unit and bounds, and what follows from it.

Attribute paths are the dotted keys of the machine file. Values are SI (displacements in m³/rad, pressures gauge), as
floats or arrays of shape (N,) with one value a twin; properties follow numpy's broadcasting.
"""

import math
from functools import cached_property
from typing import ClassVar

import numpy as np

from aoro_gym.machine.linkage import Linkage, close_linkage
from aoro_gym.machine.pile import Pile, pile_of
from aoro_gym.machine.quantities import (
    Quantity,
    efficiency,
    finite,
    fraction,
    non_negative,
    positive,
    same_as,
    section,
    within,
)
from aoro_gym.units import ATMOSPHERIC_PRESSURE, RPM

_RIGHT_ANGLE = math.pi / 2.0


def _orifice(flow: Quantity, drop: Quantity) -> Quantity:
    """Orifice constant C = Q/√Δp [m³/s/√Pa]."""
    return flow / np.sqrt(drop)


# --- bodies ---


@section
class HalfFrame:
    """One frame without its arms and wheels. CoG and axle are measured from the hinge axis."""

    direction: ClassVar[float]  # +1 in front of the hinge, −1 behind it

    mass: Quantity = positive("kg")
    axle_distance: Quantity = positive("m")  # hinge to axle with level arms
    cog_offset: Quantity = finite("m")  # CoG from the axle toward the hinge
    cog_height: Quantity = positive("m")
    inertia_xx: Quantity = positive("kg*m^2")  # principal, about the CoG
    inertia_yy: Quantity = positive("kg*m^2")
    inertia_zz: Quantity = positive("kg*m^2")
    hull_length: Quantity = positive("m")
    hull_width: Quantity = positive("m")
    hull_height: Quantity = positive("m")

    @property
    def cog_x(self) -> Quantity:
        """CoG from the hinge [m], forward positive."""
        return self.direction * (self.axle_distance - self.cog_offset)


@section
class FrontFrame(HalfFrame):
    """Front frame."""

    direction: ClassVar[float] = 1.0


@section
class RearFrame(HalfFrame):
    """Rear frame."""

    direction: ClassVar[float] = -1.0


@section
class Frame:
    """What both frames share."""

    track: Quantity = positive("m")
    ground_clearance: Quantity = positive("m")  # underside of the hulls at rest
    front: FrontFrame
    rear: RearFrame

    @property
    def wheelbase(self) -> Quantity:
        """Axle to axle with level arms [m]."""
        return self.front.axle_distance + self.rear.axle_distance


@section
class Hull:
    """Contact of a hull's corner with the ground."""

    stiffness: Quantity = positive("N/m")
    damping: Quantity = non_negative("N*s/m")
    friction: Quantity = non_negative("1")


@section
class Joint:
    """Articulated joint between the frames."""

    range: Quantity = within("rad", 0.0, _RIGHT_ANGLE, low_open=True, high_open=True)  # to either side
    friction_torque: Quantity = non_negative("N*m")
    backlash: Quantity = non_negative("rad")  # free play between cylinders and frames, full width
    compliance: Quantity = non_negative("rad/N/m")  # of mounts and frames, in series with the cylinders
    stop_stiffness: Quantity = positive("N/m")  # of one bottomed cylinder
    stop_damping: Quantity = non_negative("N*s/m")
    presliding_stiffness: Quantity = positive("N*m/rad")
    presliding_damping: Quantity = non_negative("N*m*s/rad")
    friction_velocity: Quantity = positive("rad/s")  # laws friction = stribeck_tanh, coulomb_viscous: at which it fades
    hardening_angle: Quantity = positive("rad")  # law mount = hardening: bend that doubles the stiffness


@section
class Wheel:
    """Wheel with tire and rim, turning on its motor."""

    mass: Quantity = positive("kg")
    inertia_spin: Quantity = positive("kg*m^2")
    inertia_transverse: Quantity = positive("kg*m^2")


@section
class Tire:
    """Five discs across the width, a spring and damper, and LuGre friction a unit of load."""

    radius: Quantity = positive("m")  # of the middle disc, unloaded
    disc_offset_inner: Quantity = positive("m")  # lateral, to either side
    disc_offset_outer: Quantity = positive("m")
    disc_drop_inner: Quantity = non_negative("m")  # by which the disc is smaller than the middle one
    disc_drop_outer: Quantity = non_negative("m")
    stiffness: Quantity = positive("N/m")
    damping: Quantity = non_negative("N*s/m")
    sigma0_longitudinal: Quantity = positive("1/m")  # bristle stiffness
    sigma0_lateral: Quantity = positive("1/m")
    sigma1_longitudinal: Quantity = non_negative("s/m")  # bristle damping
    sigma1_lateral: Quantity = non_negative("s/m")
    sigma2_longitudinal: Quantity = non_negative("s/m")  # viscous
    sigma2_lateral: Quantity = non_negative("s/m")
    friction_coulomb: Quantity = positive("1")
    friction_static: Quantity = positive("1")
    stribeck_velocity: Quantity = positive("m/s")
    rolling_resistance: Quantity = non_negative("1")
    scrub_radius: Quantity = non_negative("m")  # lever of the friction that resists swivelling
    scrub_angle: Quantity = positive("rad")  # by which the patch twists before it slides
    bore_radius: Quantity = positive("m")  # law swivel = bore_torque: lever of the patch's friction
    bore_stiffness: Quantity = positive("N*m/rad")  # law swivel = bore_torque: of the patch about the vertical
    relaxation_longitudinal: Quantity = positive("m")  # law slip = relaxation: way after which the force is there
    relaxation_lateral: Quantity = positive("m")
    bulldozing_resistance: Quantity = non_negative("1")  # law soft_ground = bulldozing: sideways, a unit of load


# --- cylinders ---


@section
class Cylinder:
    """Double-acting cylinder and the linkage that it closes."""

    half_range: Quantity  # [rad] of the joint that it drives
    bore: Quantity = positive("m")
    rod: Quantity = positive("m")
    stroke: Quantity = positive("m")
    dead_length: Quantity = positive("m")  # pin to pin, fully retracted
    mount_ratio: Quantity = positive("1")  # of the pins' distances from the hinge
    dead_volume: Quantity = non_negative("m^3")  # at either end
    seal_preload: Quantity = non_negative("N")
    seal_pressure_coefficient: Quantity = non_negative("N/Pa")
    seal_static_ratio: Quantity = within("1", 1.0, math.inf)
    seal_stribeck_velocity: Quantity = positive("m/s")
    seal_viscous: Quantity = non_negative("N*s/m")

    @property
    def bore_area(self) -> Quantity:
        """Piston area [m²]."""
        return math.pi / 4.0 * self.bore**2

    @property
    def annulus_area(self) -> Quantity:
        """Piston area on the rod's side [m²]."""
        return math.pi / 4.0 * (self.bore**2 - self.rod**2)

    @cached_property
    def linkage(self) -> Linkage:
        """Mounting that makes the stroke span the range exactly."""
        return close_linkage(self.dead_length, self.stroke, self.mount_ratio, self.half_range)


@section
class ArmCylinder(Cylinder):
    """Cylinder of one pendulum arm; drop-tight."""

    half_range: Quantity = same_as("arm.swing")


@section
class SteeringCylinder(Cylinder):
    """One of the two cylinders of the articulated joint."""

    half_range: Quantity = same_as("joint.range")
    leakage: Quantity = non_negative("m^3/s/Pa")  # past the piston


# --- pendulum arms ---


@section
class ArmValve:
    """Proportional section of one arm, with load-holding valves."""

    nominal_flow: Quantity = positive("m^3/s")
    pressure_drop: Quantity = positive("Pa")  # over the open edge, kept by the compensator
    compensator_time_constant: Quantity = positive("s")  # law arm_valve = section
    compensator_open_drop: Quantity = positive("Pa")  # law arm_valve = section: fully open at nominal_flow
    dead_band: Quantity = within("1", 0.0, 1.0, high_open=True)
    time_constant: Quantity = positive("s")
    rate_limit: Quantity = positive("1/s")
    holding_pressure: Quantity = positive("Pa")
    holding_ramp: Quantity = positive("Pa")
    pilot_ratio: Quantity = non_negative("1")
    port_relief: Quantity = positive("Pa")
    port_ramp: Quantity = positive("Pa")
    port_flow: Quantity = positive("m^3/s")

    @property
    def cv(self) -> Quantity:
        """Orifice constant of an open edge [m³/s/√Pa]."""
        return _orifice(self.nominal_flow, self.pressure_drop)

    @property
    def cv_compensator(self) -> Quantity:
        """Orifice constant of the open compensator [m³/s/√Pa]."""
        return _orifice(self.nominal_flow, self.compensator_open_drop)


@section
class Arm:
    """Pendulum arm; all four are alike. Front arms lead, rear arms trail."""

    length: Quantity = positive("m")  # pivot to wheel centre
    swing: Quantity = within("rad", 0.0, _RIGHT_ANGLE, low_open=True, high_open=True)  # to either side of level
    rest_angle: Quantity = within(
        "rad", -_RIGHT_ANGLE, _RIGHT_ANGLE, low_open=True, high_open=True
    )  # of the front arms
    pivot_lateral: Quantity = positive("m")
    pivot_height: Quantity = positive("m")  # of the frame that stands on design tires and arms at rest
    mass: Quantity = positive("kg")
    motor_mass: Quantity = non_negative("kg")  # non-rotating part, at the wheel centre
    cog_fraction: Quantity = fraction()  # of the length, from the pivot
    inertia_transverse: Quantity = positive("kg*m^2")
    inertia_axial: Quantity = positive("kg*m^2")
    stop_stiffness: Quantity = positive("N/m")  # of the bottomed cylinder
    stop_damping: Quantity = non_negative("N*s/m")
    presliding_stiffness: Quantity = positive("N*m/rad")
    presliding_damping: Quantity = non_negative("N*m*s/rad")
    rod_rest_pressure: Quantity = non_negative("Pa")
    hose_volume: Quantity = positive("m^3")  # a side
    hose_bulk_modulus: Quantity = positive("Pa")
    cylinder: ArmCylinder
    valve: ArmValve

    @property
    def hose_compliance(self) -> Quantity:
        """Of one hose's wall [m³/Pa]."""
        return self.hose_volume / self.hose_bulk_modulus


# --- oil and steering circuit ---


@section
class Oil:
    """The fluid of all circuits."""

    bulk_modulus: Quantity = positive("Pa")  # at 0 Pa gauge, without gas
    bulk_modulus_slope: Quantity = non_negative("1")
    gas_fraction: Quantity = within("1", 0.0, 1.0, high_open=True)  # volume share at atmospheric pressure
    polytropic_exponent: Quantity = within("1", 1.0, 2.0)
    solution_pressure: Quantity = positive("Pa")  # law gas = dissolving: from which on all air is dissolved
    laminar_pressure: Quantity = positive("Pa")
    void_pressure: Quantity = within("Pa", -ATMOSPHERIC_PRESSURE, 0.0, low_open=True)

    def effective_modulus(self, pressure: Quantity) -> Quantity:
        """Tangent bulk modulus [Pa] of the oil with its gas at gauge ``pressure`` [Pa] ≥ 0, without any walls.

        1/β = [(1−α)/β_l + α e/(n P)] / [(1−α) + α e], e = (p_atm/P)^(1/n): the law of :mod:`aoro_gym.twin.physics.fluid`.
        """
        absolute = pressure + ATMOSPHERIC_PRESSURE
        gas = self.gas_fraction * (ATMOSPHERIC_PRESSURE / absolute) ** (1.0 / self.polytropic_exponent)
        liquid = 1.0 - self.gas_fraction
        compliance = liquid / (self.bulk_modulus + self.bulk_modulus_slope * pressure)
        return (liquid + gas) / (compliance + gas / (self.polytropic_exponent * absolute))


@section
class SteeringValve:
    """Pressure-compensated section with its measured opening curve, shock and anti-cavitation valves."""

    nominal_flow_left: Quantity = positive("m^3/s")
    nominal_flow_right: Quantity = positive("m^3/s")
    nominal_drop_in_left: Quantity = positive("Pa")
    nominal_drop_in_right: Quantity = positive("Pa")
    nominal_drop_out_left: Quantity = positive("Pa")
    nominal_drop_out_right: Quantity = positive("Pa")
    dead_band_left: Quantity = within("V", 0.0, 1.0, high_open=True)  # of the signal's distance from 2.5 V
    dead_band_right: Quantity = within("V", 0.0, 1.0, high_open=True)
    opening_left_1V0: Quantity = fraction()
    opening_left_1V5: Quantity = fraction()
    opening_right_1V0: Quantity = fraction()
    opening_right_1V5: Quantity = fraction()
    spool_time_constant: Quantity = positive("s")
    spool_rate_limit: Quantity = positive("1/s")
    spool_frequency: Quantity = positive("rad/s")  # law spool = second_order: undamped natural frequency
    spool_damping: Quantity = positive("1")  # law spool = second_order: damping ratio
    flow_force_share: Quantity = fraction()  # law flow_force = steady: of the stroke, at nominal flow and compensator
    command_delay: Quantity = within("s", 0.0, 0.100)  # the twin's command buffer holds 100 ms
    hysteresis: Quantity = within("1", 0.0, 1.0, high_open=True)  # width of the play
    overlap: Quantity = within("V", -0.5, 1.0)  # by which the whole opening curve lies farther out, both sides
    leakage: Quantity = non_negative("m^3/s/Pa")  # port to tank
    cross_port_leakage: Quantity = non_negative("m^3/s")  # port to port through the block, at 100 bar
    compensator_pressure: Quantity = positive("Pa")
    compensator_droop: Quantity = within("1", 0.0, 2.0, high_open=True)
    compensator_time_constant: Quantity = positive("s")
    compensator_open_drop: Quantity = positive("Pa")
    compensator_frequency: Quantity = positive("rad/s")  # law compensator = spring_mass: √(setting area / mass stroke)
    compensator_damping: Quantity = positive("1")  # law compensator = spring_mass: of such an oscillator
    shock_pressure: Quantity = positive("Pa")
    shock_ramp: Quantity = positive("Pa")
    shock_flow: Quantity = positive("m^3/s")
    shock_time_constant: Quantity = positive("s")  # law shock_valve = lag
    anticavitation_crack: Quantity = non_negative("Pa")
    anticavitation_flow: Quantity = positive("m^3/s")
    anticavitation_drop: Quantity = positive("Pa")

    @property
    def cv_in_left(self) -> Quantity:
        """P→A, fully open [m³/s/√Pa]."""
        return _orifice(self.nominal_flow_left, self.nominal_drop_in_left)

    @property
    def cv_in_right(self) -> Quantity:
        """P→B, fully open [m³/s/√Pa]."""
        return _orifice(self.nominal_flow_right, self.nominal_drop_in_right)

    @property
    def cv_out_left(self) -> Quantity:
        """B→T, fully open [m³/s/√Pa]."""
        return _orifice(self.nominal_flow_left, self.nominal_drop_out_left)

    @property
    def cv_out_right(self) -> Quantity:
        """A→T, fully open [m³/s/√Pa]."""
        return _orifice(self.nominal_flow_right, self.nominal_drop_out_right)

    @property
    def cv_compensator(self) -> Quantity:
        """Compensator, fully open [m³/s/√Pa]; passes the larger nominal flow."""
        return _orifice(np.maximum(self.nominal_flow_left, self.nominal_flow_right), self.compensator_open_drop)

    @property
    def cv_cross_port(self) -> Quantity:
        """Leak from port to port [m³/s/√Pa]."""
        return _orifice(self.cross_port_leakage, 100e5)

    @property
    def cv_anticavitation(self) -> Quantity:
        """Anti-cavitation check [m³/s/√Pa]."""
        return _orifice(self.anticavitation_flow, self.anticavitation_drop)


@section
class SteeringPump:
    """Load-sensing pump (pump 2), its control and its pressure line."""

    displacement: Quantity = positive("m^3/rad")
    margin: Quantity = positive("Pa")
    control_band: Quantity = positive("Pa")  # error that moves the swash at full rate
    stroke_up_time: Quantity = positive("s")
    stroke_down_time: Quantity = positive("s")
    cutoff: Quantity = positive("Pa")
    ls_time_constant: Quantity = positive("s")
    valve_time_constant: Quantity = positive("s")  # law pump = second_order: of the control valve's spool
    valve_lead_time: Quantity = positive("s")  # law pump = second_order: by which the regulator is ahead of the error
    ls_volume: Quantity = positive("m^3")  # law load_sensing_line = volume: of the line
    ls_flow: Quantity = positive("m^3/s")  # law load_sensing_line = volume: through its damping orifice at ls_drop
    ls_drop: Quantity = positive("Pa")
    bleed_flow: Quantity = positive("m^3/s")
    bleed_drop: Quantity = positive("Pa")
    leakage: Quantity = non_negative("m^3/s/Pa")
    mechanical_efficiency: Quantity = efficiency()
    line_volume: Quantity = positive("m^3")
    hose_bulk_modulus: Quantity = positive("Pa")
    relief_pressure: Quantity = positive("Pa")
    relief_ramp: Quantity = positive("Pa")
    relief_flow: Quantity = positive("m^3/s")

    @property
    def cv_bleed(self) -> Quantity:
        """Bleed of the load-sensing line [m³/s/√Pa]."""
        return _orifice(self.bleed_flow, self.bleed_drop)

    @property
    def cv_ls(self) -> Quantity:
        """Damping orifice of the load-sensing line [m³/s/√Pa]."""
        return _orifice(self.ls_flow, self.ls_drop)

    @property
    def line_compliance(self) -> Quantity:
        """Of the line's wall [m³/Pa]."""
        return self.line_volume / self.hose_bulk_modulus


@section
class TankLine:
    """Return line, with the back pressure of its filter."""

    volume: Quantity = positive("m^3")
    hose_bulk_modulus: Quantity = positive("Pa")
    back_pressure: Quantity = non_negative("Pa")
    back_pressure_ramp: Quantity = positive("Pa")
    back_flow: Quantity = positive("m^3/s")
    throttle_drop: Quantity = non_negative("Pa")  # of a clogged filter at back_flow, on top
    suction_flow: Quantity = positive("m^3/s")
    suction_drop: Quantity = positive("Pa")

    @property
    def throttle(self) -> Quantity:
        """Drop over the squared flow [Pa s²/m⁶]."""
        return self.throttle_drop / np.square(self.back_flow)

    @property
    def cv_suction(self) -> Quantity:
        """Suction check from the tank [m³/s/√Pa]."""
        return _orifice(self.suction_flow, self.suction_drop)

    @property
    def compliance(self) -> Quantity:
        """Of the line's wall [m³/Pa]."""
        return self.volume / self.hose_bulk_modulus


@section
class Steering:
    """Steering circuit from pump 2 to the articulated joint's cylinders."""

    hose_volume: Quantity = positive("m^3")  # a side
    hose_bulk_modulus: Quantity = positive("Pa")
    hose_stiffening_pressure: Quantity = positive("Pa")  # law hose = stiffening: that doubles the walls' modulus
    hose_delayed_share: Quantity = fraction()  # law hose = viscoelastic: of the walls' compliance that comes late
    hose_delay_time: Quantity = positive("s")  # law hose = viscoelastic
    hose_inertance: Quantity = positive("kg/m^4")  # law hose = two_segments: of the oil between them, a side
    hose_drop: Quantity = non_negative("Pa")  # law hose = two_segments: between them at 60 L/min
    valve: SteeringValve
    cylinder: SteeringCylinder
    pump: SteeringPump
    tank_line: TankLine

    @property
    def hose_compliance(self) -> Quantity:
        """Of the hose walls of one side [m³/Pa]."""
        return self.hose_volume / self.hose_bulk_modulus

    @property
    def hose_resistance(self) -> Quantity:
        """Of the hose of one side, drop over flow [Pa s/m³]."""
        return self.hose_drop / 1e-3

    @property
    def full_turn_volume(self) -> Quantity:
        """Oil that either port takes or gives in a turn from stop to stop [m³]."""
        return (self.cylinder.bore_area + self.cylinder.annulus_area) * self.cylinder.stroke


# --- driveline and engine ---


@section
class DrivePump:
    """Pump 1, over centre."""

    displacement: Quantity = positive("m^3/rad")
    time_constant: Quantity = positive("s")
    stroke_time: Quantity = positive("s")  # zero to full
    leakage: Quantity = non_negative("m^3/s/Pa")  # each side to the case
    cross_leakage: Quantity = non_negative("m^3/s/Pa")
    mechanical_efficiency: Quantity = efficiency()


@section
class Charge:
    """Charge pump with its relief and check valves."""

    displacement: Quantity = positive("m^3/rad")
    relief_pressure: Quantity = positive("Pa")
    relief_ramp: Quantity = positive("Pa")
    relief_flow: Quantity = positive("m^3/s")
    volume: Quantity = positive("m^3")
    check_flow: Quantity = positive("m^3/s")
    check_drop: Quantity = positive("Pa")
    check_crack: Quantity = non_negative("Pa")
    mechanical_efficiency: Quantity = efficiency()

    @property
    def cv_check(self) -> Quantity:
        """Check valve to one main [m³/s/√Pa]."""
        return _orifice(self.check_flow, self.check_drop)


@section
class Flush:
    """Loop-flushing shuttle and its relief."""

    shift_pressure: Quantity = positive("Pa")
    pressure: Quantity = positive("Pa")
    ramp: Quantity = positive("Pa")
    flow: Quantity = positive("m^3/s")


@section
class CrossRelief:
    """High-pressure relief from main to main."""

    pressure: Quantity = positive("Pa")
    ramp: Quantity = positive("Pa")
    flow: Quantity = positive("m^3/s")


@section
class Traction:
    """Traction control valve of one wheel."""

    nominal_flow: Quantity = positive("m^3/s")
    pressure_drop: Quantity = positive("Pa")
    time_constant: Quantity = positive("s")

    @property
    def cv(self) -> Quantity:
        """Fully open [m³/s/√Pa]."""
        return _orifice(self.nominal_flow, self.pressure_drop)


@section
class Motor:
    """Wheel motor."""

    displacement: Quantity = positive("m^3/rad")  # full; half of it in the higher gears
    leakage: Quantity = non_negative("m^3/s/Pa")
    mechanical_efficiency: Quantity = efficiency()
    shift_time: Quantity = positive("s")


@section
class Brake:
    """Disc that stands for unmodelled losses, and the parking brake."""

    disc_torque: Quantity = non_negative("N*m")
    parking_torque: Quantity = non_negative("N*m")
    presliding_stiffness: Quantity = positive("N*m/rad")
    presliding_damping: Quantity = non_negative("N*m*s/rad")


@section
class Driveline:
    """Closed hydrostatic loop."""

    hose_bulk_modulus: Quantity = positive("Pa")
    main_volume: Quantity = positive("m^3")  # a side
    wheel_hose_volume: Quantity = positive("m^3")  # traction valve to motor
    pump: DrivePump
    charge: Charge
    flush: Flush
    relief: CrossRelief
    traction: Traction
    motor: Motor
    brake: Brake

    @property
    def main_compliance(self) -> Quantity:
        """Of one main's wall [m³/Pa]."""
        return self.main_volume / self.hose_bulk_modulus

    @property
    def wheel_hose_compliance(self) -> Quantity:
        """Of one wheel hose's wall [m³/Pa]."""
        return self.wheel_hose_volume / self.hose_bulk_modulus

    @property
    def charge_compliance(self) -> Quantity:
        """Of the charge line's wall [m³/Pa]."""
        return self.charge.volume / self.hose_bulk_modulus


@section
class TorqueCurve:
    """Brake torque at full load; zero at 300 and at 2600 rpm."""

    rpm_900: Quantity = positive("N*m")
    rpm_1200: Quantity = positive("N*m")
    rpm_1400: Quantity = positive("N*m")
    rpm_1600: Quantity = positive("N*m")
    rpm_1800: Quantity = positive("N*m")
    rpm_2000: Quantity = positive("N*m")
    rpm_2200: Quantity = positive("N*m")
    rpm_2400: Quantity = positive("N*m")


@section
class Engine:
    """Diesel engine with its governor."""

    set_speed: Quantity = within("rad/s", 300.0 * RPM, 2600.0 * RPM, low_open=True, high_open=True)
    inertia: Quantity = positive("kg*m^2")  # with flywheel and pumps
    friction_0: Quantity = non_negative("N*m")
    friction_1: Quantity = non_negative("N*m*s/rad")
    governor_proportional: Quantity = positive("N*m*s/rad")
    governor_integral: Quantity = non_negative("N*m/rad")
    droop: Quantity = within("1", 0.0, 0.5)  # relative fall of the governed speed from no load to full load
    torque_time_constant: Quantity = positive("s")
    smoke_rate: Quantity = positive("N*m/s")
    torque: TorqueCurve


# --- load ---


@section
class Payload:
    """Logs in a bunk on the rear frame, alike and lengthwise; none by default."""

    count: Quantity = non_negative("1")  # of logs; 0: the bunk is empty
    length: Quantity = positive("m")
    diameter: Quantity = positive("m")
    density: Quantity = positive("kg/m^3")  # green, with bark
    distance: Quantity = finite("m")  # of the logs' middle behind the hinge
    bunk_height: Quantity = positive("m")  # of its floor over the design ground plane
    bunk_width: Quantity = positive("m")  # between the stakes
    friction: Quantity = non_negative("1")  # of the logs in the bunk
    presliding_distance: Quantity = positive("m")  # way after which friction is all there, at a load's own weight
    presliding_damping: Quantity = non_negative("1")  # ratio of that spring's damping to the critical one
    slide_range: Quantity = non_negative("m")  # to headboard and gate from the middle; 0: the load is fixed
    stop_stiffness: Quantity = positive("N/m")  # of headboard and gate
    stop_damping: Quantity = non_negative("N*s/m")

    @cached_property
    def pile(self) -> Pile:
        """Mass, height and inertia of the pile."""
        return pile_of(self.count, self.length, self.diameter, self.density, self.bunk_width)

    @property
    def mass(self) -> Quantity:
        """All logs [kg]."""
        return self.pile.mass

    @property
    def cog_x(self) -> Quantity:
        """CoG from the hinge [m], forward positive."""
        return -self.distance

    @property
    def cog_height(self) -> Quantity:
        """CoG over the design ground plane [m]."""
        return self.bunk_height + self.pile.cog_height

    @property
    def inertia_xx(self) -> Quantity:
        """About the CoG [kg m²]."""
        return self.pile.inertia_xx

    @property
    def inertia_yy(self) -> Quantity:
        """About the CoG [kg m²]."""
        return self.pile.inertia_yy

    @property
    def inertia_zz(self) -> Quantity:
        """About the CoG [kg m²]."""
        return self.pile.inertia_zz
