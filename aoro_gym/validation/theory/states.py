"""States of the planar machine and its circuit, and the limits that can be taken away from both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aoro_gym.units import BAR

STATES = (
    "supply", "port_a", "port_b", "return_line", "load_sensing", "swash", "compensator", "spool", "half_angle",
    "half_rate", "hinge_speed", "bristle", "twist", "roll", "roll_rate", "joint_bristle",
    "spool_rate", "compensator_rate", "pump_valve", "shock_a", "shock_b", "strain_a", "strain_b", "hose_a", "hose_b",
    "hose_flow_a", "hose_flow_b",
)  # fmt: skip
"""Rows of a state (27, N): pressures [Pa], openings [-], φ [rad], φ̇ [rad/s], v [m/s], tires' lateral stretch [m], twist
[rad], roll [rad] and its rate [rad/s], stretch of the joint's dry friction [rad]; and what only some laws have: rates of
spool and compensator [1/s], the error that the pump's valve has followed [-], flows of late shock valves [m³/s], oil in
walls that creep [m³], pressures [Pa] of the hoses' segments at the valve and the flows [m³/s] from there."""

(
    SUPPLY, PORT_A, PORT_B, RETURN, LS, SWASH, COMPENSATOR, SPOOL, PHI, RATE, HINGE, BRISTLE, TWIST, ROLL, ROLL_RATE,
    JOINT_BRISTLE, SPOOL_RATE, COMPENSATOR_RATE, PUMP_VALVE, SHOCK_A, SHOCK_B, STRAIN_A, STRAIN_B, HOSE_A, HOSE_B,
    HOSE_FLOW_A, HOSE_FLOW_B,
) = range(len(STATES))  # fmt: skip

SCALES = np.array(
    [BAR] * 5 + [0.1, 0.1, 1.0, 1.0, 0.1, 0.1, 0.01, 0.01, 0.01, 0.1, 0.001]
    + [1.0, 1.0, 0.1, 1e-5, 1e-5, 1e-7, 1e-7, BAR, BAR, 1e-4, 1e-4]
)  # fmt: skip
"""What each state changes by."""

LIMITS: Mapping[str, Mapping[str, float]] = {
    "cut-off": {"cutoff": np.inf, "relief_pressure": np.inf},
    "shock valves": {"shock_pressure": np.inf},
    "anti-cavitation valves": {"cv_anticavitation": 0.0},
    "swash rate": {"swash_limited": 0.0},
    "spool rate": {"spool_rate_limit": np.inf},
    "tire grip": {"tire_slides": 0.0},
    "roll": {"rolls": 0.0},
}
"""Laws that bound what linear theory says, and the roll that the plane leaves out: what takes each of them away."""
