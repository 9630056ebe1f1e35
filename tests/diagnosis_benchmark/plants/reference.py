"""Short runs of every law, whose results of the plants' first writing, in NumPy, stand in ``reference.npz``."""

import numpy as np

COUNT = 500
"""Main steps of each run."""
EVERY = 20
CHANNELS = (
    "joint_angle", "pressure_a", "pressure_b", "pump_pressure", "drive_pressure_forward", "engine_speed",
    "wheel_rate_fl", "pump_swash", "compensator",
)  # fmt: skip
EFFECTS = (
    {},
    {"joint_backlash": 0.006, "frame_compliance": 2e-7, "pump_limit": -30e5},
    {"entrained_air": -3e8, "hose_compliance": 2e-12, "back_pressure": 8e5, "oil_temperature": 20.0, "spool_lag": 0.02},
    {
        "cross_port_leakage": 5e-5, "x_return_kink": 2e6, "x_port_leak": 4e-5, "valve_hysteresis": 0.1,
        "command_delay": 0.0135, "engine_droop": 0.05, "dead_band": 0.1, "compensator_lag": 0.005,
    },
    {
        "payload": 800.0, "ground_slope": (0.05, -0.03), "soft_ground": 0.08, "driveline_resistance": 300.0,
        "x_dragging_brake": 800.0, "tire_scrub": 1000.0, "tire_stiffness": 1e5,
    },
    {
        "x_air_pocket": 2e-4, "x_hinge_bump": 3000.0, "seal_friction": 1000.0, "joint_friction": 1000.0,
        "x_low_shock_valve": 1e7, "cylinder_leakage": 3e-5, "x_ls_restriction": 0.02,
    },
)  # fmt: skip
"""ΔQ of each run."""
START = np.array([-0.6, 0.3, 0.0, -0.3, 0.1, 0.6])
"""Joint angle [rad] of each run at rest."""


def commands():
    """Signals (COUNT, R): to one side, back, to a stop; the fifth run drives."""
    steering = np.zeros((COUNT, len(START)))
    steering[20:] = [1.0, -0.8, 0.6, 0.7, 0.5, 1.0]
    steering[300:] = [0.4, 0.8, -0.6, 0.3, -0.9, 1.0]
    drive = np.zeros_like(steering)
    drive[40:, 4] = 0.5
    return {"steering_signal": steering, "drive_signal": drive}


def magnitudes():
    """ΔQ by effect, each (R,) or (2, R)."""
    names = dict.fromkeys(name for effects in EFFECTS for name in effects)
    none = {name: np.zeros(2) if name == "ground_slope" else np.zeros(()) for name in names}
    return {name: np.stack([np.asarray(e.get(name, none[name])) for e in EFFECTS], axis=-1) for name in names}
