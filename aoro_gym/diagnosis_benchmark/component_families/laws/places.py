"""Where the states of a component family stand behind those of the vehicle, and numbers of device code."""

import warp as wp

from aoro_gym import units

TIRE = 22  # three a wheel: deflections along and across, twist
HINGE = 34  # presliding of the bearing
SEAL = 35  # two of the seals
CREEP = 37  # of rods and brackets
SIDE_A, SIDE_B, SUPPLY, SENSE = 38, 39, 40, 41  # [Pa]
STROKE, CONTROL = 42, 43  # of the pump, share of the full one; its controller
COMPENSATOR, SPOOL, SPOOL_RATE, DRIVER, HYSTERESIS = 44, 45, 46, 47, 48
LINE = 49  # four of the lines: pressures and flows of A and B, or creep of their walls
GAS = 53  # two: free share of the gas in A and B
WAVE = 55  # two: flows in the far halves of long lines
N_STATES = 57

State = wp.types.vector(length=N_STATES, dtype=wp.float64)
Tire = wp.types.vector(length=6, dtype=wp.float64)
Hydraulic = wp.types.vector(length=6, dtype=wp.float64)
vec2d = wp.types.vector(length=2, dtype=wp.float64)
vec3d = wp.types.vector(length=3, dtype=wp.float64)
vec4d = wp.types.vector(length=4, dtype=wp.float64)

BAR = wp.constant(wp.float64(units.BAR))
ATMOSPHERE = wp.constant(wp.float64(units.ATMOSPHERIC_PRESSURE))
GROUND_FLOOR = wp.constant(wp.float64(-0.98 * units.BAR))  # least gauge pressure: oil boils
