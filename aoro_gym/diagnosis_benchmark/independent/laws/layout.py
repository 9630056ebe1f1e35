"""Where every state and signal of a plant stands. The first states are those of the vehicle, alike in all families."""

# States: the vehicle. Velocity of the common centre of mass in axes of the rear frame; yaw rates against the ground.
VX, VY, YAW, ANGLE, RATE_REAR, RATE_FRONT = 0, 1, 2, 3, 4, 5  # [m/s], [rad], [rad/s]
ROD, ROD_RATE = 6, 7  # joint angle as the cylinders see it [rad], its rate
WHEEL = 8  # speeds of wheels front left, front right, rear left, rear right [rad/s]
LOOP_FORWARD, LOOP_RETURN, PUMP_FLOW = 12, 13, 14  # closed loop [Pa], [m³/s]
ENGINE, GOVERNOR = 15, 16  # [rad/s], [N m]
LAG = 17  # first-order filters of joint angle [rad], pressures a, b and pump [Pa]
LAG_TWO = 21  # second filter of the joint angle [rad]
TIRES = 22  # the family's tires, then its joint bearing, cylinders and hydraulics

# What drives a plant during a step.
COMMAND, DRIVE, DELAYED, TIME, VISCOSITY = 0, 1, 2, 3, 4
N_INPUTS = 5

# Signals: measured ones first, then exact ones for tests.
SIGNALS = (
    "joint_angle", "pressure_a", "pressure_b", "pump_pressure", "drive_forward", "drive_return", "engine_speed",
    "angle", "rate", "exact_a", "exact_b", "exact_pump", "flow_a", "flow_b", "volume_rate_a", "volume_rate_b",
    "volume_a", "volume_b", "kinetic_energy", "spool",
)  # fmt: skip
N_SIGNALS = len(SIGNALS)
