"""Units other than those of the SI by their SI values, and constants of nature: each is defined here alone."""

import math

BAR = 1e5  # [Pa]
ATMOSPHERIC_PRESSURE = 101325.0  # [Pa] absolute: the standard atmosphere
ZERO_CELSIUS = 273.15  # [K]
DEGREE = math.pi / 180.0  # [rad]
RPM = math.pi / 30.0  # [rad/s]
LITRE_PER_MINUTE = 1e-3 / 60.0  # [m³/s]
GRAVITY = 9.81  # [m/s²] of the twin and of all that is computed for it
STANDARD_GRAVITY = 9.80665  # [m/s²] the unit g of measurements and of kgf
KNOT = 1852.0 / 3600.0  # [m/s]
