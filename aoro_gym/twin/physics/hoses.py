"""The joint's hoses: what their walls give, at once or late, and oil that moves between two segments.

Sources: Johnston, Drew & Longmore (J. Vib. Acoust. 132, 2010, 021011) for moduli that rise with frequency and pressure;
Merritt (1967) ch. 3 for inertance and resistance of a line.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.fluid import Gas, Oil, fill_chamber, pressure
from aoro_gym.twin.physics.laws import option
from aoro_gym.twin.physics.steering_circuit import Steering

HOSE_STIFFENING = option("hose", "stiffening")
HOSE_VISCOELASTIC = option("hose", "viscoelastic")
HOSE_TWO_SEGMENTS = option("hose", "two_segments")


@wp.func
def port_nominal_volume(m: Steering):
    """Oil [m³] on one side at half stroke."""
    return (
        m.hose_volume
        + 2.0 * m.cylinder_dead_volume
        + 0.5 * (m.cylinder_bore_area + m.cylinder_annulus_area) * m.cylinder_linkage.stroke
    )


@wp.func
def wall_compliance(m: Steering, p: float):
    """Compliance dV/dp [m³/Pa] of one side's hose walls at gauge pressure ``p`` [Pa], by the law of hoses.

    Linear: C = V_h/E_h. Stiffening: C/(1 + p/p_s), the volume V_h + C p_s ln(1 + p/p_s) of a braid that locks. Viscoelastic:
    the part (1 − s) C that is there at once (Zener's solid; the rest is :func:`creep`). Two segments: half of C at either
    end.
    """
    compliance = m.hose_compliance
    if m.hose_law == HOSE_STIFFENING:
        compliance = compliance / (1.0 + wp.max(p, 0.0) / m.hose_stiffening_pressure)
    if m.hose_law == HOSE_VISCOELASTIC:
        compliance = compliance * (1.0 - m.hose_delayed_share)
    if m.hose_law == HOSE_TWO_SEGMENTS:
        compliance = compliance * 0.5
    return compliance


@wp.func
def fill_port(m: Steering, oil: Oil, gas: Gas, content: float, net_flow: float, dt: float, volume: float):
    """State [Pa] of one side after ``dt`` [s] of ``net_flow`` [m³/s]; of two segments that on the cylinders' end.

    ``volume`` [m³] is all the oil on the side.
    """
    nominal = port_nominal_volume(m)
    held = volume
    if m.hose_law == HOSE_TWO_SEGMENTS:
        nominal = nominal - 0.5 * m.hose_volume
        held = volume - 0.5 * m.hose_volume
    return fill_chamber(oil, gas, content, net_flow, dt, held, wall_compliance(m, pressure(oil, content)), nominal)


@wp.func
def creep(m: Steering, strain: float, p: float):
    """Flow [m³/s] into walls that widen late: v̇ = (s C max(p, 0) − v)/τ, with ``strain`` v [m³] so far."""
    return (m.hose_delayed_share * m.hose_compliance * wp.max(p, 0.0) - strain) / m.hose_delay_time


@wp.func
def hose_flow_step(m: Steering, flow: float, drop: float, dt: float):
    """Flow [m³/s] between a hose's two segments after ``dt``: L q̇ = Δp − R q, with L = ρl/A, implicit in R. Laminar: at
    60 L/min through two hoses of 14 mm a Reynolds number is about 1000."""
    return (flow + (dt / m.hose_inertance) * drop) / (1.0 + (dt / m.hose_inertance) * m.hose_resistance)
