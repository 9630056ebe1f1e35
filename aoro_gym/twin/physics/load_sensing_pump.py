"""Pump 2: its swash under load-sensing control, and the line that tells it the load.

Sources: Krus, *On Load Sensing Fluid Power Systems* (1988); Hopsan's pressure-controlled pump for stroke times.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.fluid import Gas, Oil, oil_bulk_modulus, orifice
from aoro_gym.twin.physics.steering_circuit import Steering


@wp.func
def swash_step(m: Steering, swash: float, supply: float, ls_pressure: float, dt: float):
    """Pump 2's swash after ``dt``: rate ∝ the smaller of the load-sensing and the cut-off error, within stroke times."""
    error = wp.min(ls_pressure + m.pump_margin - supply, m.pump_cutoff - supply)
    rate = wp.clamp(
        error * (1.0 / (m.pump_control_band * m.pump_stroke_up_time)),
        -1.0 / m.pump_stroke_down_time,
        1.0 / m.pump_stroke_up_time,
    )
    return wp.clamp(swash + dt * rate, 0.0, 1.0)


@wp.func
def swash_step_second_order(
    m: Steering, swash: float, lagged: float, supply: float, ls_pressure: float, dt: float
):
    """Pump 2's swash, and the error over the control band that its valve has followed so far [-], after ``dt``.

    t_up ε̇ (1 + τ s) = (1 + T s) e/e_band within the stroke times: the valve follows with a lag τ, and the regulator leads by
    T > τ (Krus's pressure-controlled pump in Hopsan: 5 ms over 1 ms). Between the compensator, which holds the flow whatever
    the supply, and the swash, which adds up the error, nothing but the lead damps: a lag without it is unstable.
    """
    error = wp.min(ls_pressure + m.pump_margin - supply, m.pump_cutoff - supply) / m.pump_control_band
    ahead = lagged + (m.pump_valve_lead_time / m.pump_valve_time_constant) * (error - lagged)
    moved = wp.clamp(ahead, -m.pump_stroke_up_time / m.pump_stroke_down_time, 1.0)
    out = lagged + (error - lagged) * dt / (m.pump_valve_time_constant + dt)
    return wp.clamp(swash + dt * moved / m.pump_stroke_up_time, 0.0, 1.0), out


@wp.func
def load_sensing_step(m: Steering, oil: Oil, lam: float, ls_pressure: float, load: float, dt: float):
    """Pressure [Pa] of a load-sensing line with a volume after ``dt``, and the flow [m³/s] that it draws from the load:
    (V/β) ṗ = C √(p_load − p) − C_bleed √p, behind a damping orifice (Krus 1988)."""
    drawn = orifice(m.pump_cv_ls, load - ls_pressure, lam)
    stiffness = oil_bulk_modulus(oil, Gas(), wp.max(ls_pressure, 0.0)) / m.pump_ls_volume
    out = ls_pressure + dt * stiffness * (drawn - orifice(m.pump_cv_bleed, ls_pressure, lam))
    return wp.max(out, 0.0), drawn
