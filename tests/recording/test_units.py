"""Names with units: whatever unit people write is read as such, and what is no unit is none."""

import math

import pytest

from aoro_gym.recording.units import DIMENSIONS, canonical, find_unit, parse_name, splits

KMH = 1000 / 3600
RPM = 2 * math.pi / 60
LPM = 1e-3 / 60


@pytest.mark.parametrize(
    ("name", "base", "dimension", "factor"),
    [
        ("Speed (km/h)", "speed", "speed", KMH),
        ("speed_kmh", "speed", "speed", KMH),
        ("speed_km_per_h", "speed", "speed", KMH),
        ("speedKmh", "speed", "speed", KMH),
        ("SPEED [KM/H]", "speed", "speed", KMH),
        ("speed/km/h", "speed", "speed", KMH),
        ("v / (km/h)", "v", "speed", KMH),
        ("Speed in km/h", "speed", "speed", KMH),
        ("speed_km_h", "speed", "speed", KMH),
        ("Speed, knots", "speed", "speed", 1852 / 3600),
        ("speed_kn", "speed", "speed", 1852 / 3600),
        ("speed_mps", "speed", "speed", 1.0),
        ("speed_m_s", "speed", "speed", 1.0),
        ("ground_speed_m_per_s", "ground_speed", "speed", 1.0),
        ("speed [m·s⁻¹]", "speed", "speed", 1.0),
        ("speed (m s^-1)", "speed", "speed", 1.0),
        ("speed mph", "speed", "speed", 0.44704),
        ("speed_fps", "speed", "speed", 0.3048),
        ("pressure_a_bar", "pressure_a", "pressure", 1e5),
        ("Pressure A (MPa)", "pressure_a", "pressure", 1e6),
        ("pressureAMPa", "pressure_a", "pressure", 1e6),
        ("pressure_a_mpa", "pressure_a", "pressure", 1e6),
        ("pressure_a [mPa]", "pressure_a", "pressure", 1e-3),
        ("Pressure (A) [psi]", "pressure_a", "pressure", 6894.757293168361),
        ("pressure_a [mbar]", "pressure_a", "pressure", 100.0),
        ("p [kgf/cm²]", "p", "pressure", 98066.5),
        ("p [N/mm2]", "p", "pressure", 1e6),
        ("p_hPa", "p", "pressure", 100.0),
        ("engine speed [1/min]", "engine_speed", "rotational_speed", RPM),
        ("engine_speed_min^-1", "engine_speed", "rotational_speed", RPM),
        ("engineSpeedRpm", "engine_speed", "rotational_speed", RPM),
        ("engine speed (Hz)", "engine_speed", "rotational_speed", 2 * math.pi),
        ("wheel_speed_fl_rad_per_s", "wheel_speed_fl", "rotational_speed", 1.0),
        ("yaw rate (°/s)", "yaw_rate", "angular_rate", math.pi / 180),
        ("yaw_rate_deg_per_s", "yaw_rate", "angular_rate", math.pi / 180),
        ("yaw_rate_rad_s", "yaw_rate", "angular_rate", 1.0),
        ("timeMs", "time", "time", 1e-3),
        ("time [ms]", "time", "time", 1e-3),
        ("timestamp_ns", "timestamp", "time", 1e-9),
        ("time_µs", "time", "time", 1e-6),
        ("time_μs", "time", "time", 1e-6),
        ("time_us", "time", "time", 1e-6),
        ("t/s", "t", "time", 1.0),
        ("time_min", "time", "time", 60.0),
        ("time_s [s]", "time", "time", 1.0),
        ("Joint angle [°]", "joint_angle", "angle", math.pi / 180),
        ("joint_angle_gon", "joint_angle", "angle", math.pi / 200),
        ("joint_angle (mrad)", "joint_angle", "angle", 1e-3),
        ("joint_angle_mil", "joint_angle", "angle", 2 * math.pi / 6400),
        ("flow_L_per_min", "flow", "flow", LPM),
        ("flow [l/min]", "flow", "flow", LPM),
        ("flow_lpm", "flow", "flow", LPM),
        ("flow (gpm)", "flow", "flow", 3.785411784e-3 / 60),
        ("flow [cm³/s]", "flow", "flow", 1e-6),
        ("flow_m3_per_h", "flow", "flow", 1 / 3600),
        ("steering_signal_V", "steering_signal", "voltage", 1.0),
        ("steering_signal [mV]", "steering_signal", "voltage", 1e-3),
        ("steering_signal [%]", "steering_signal", "ratio", 1e-2),
        ("steering_signal_percent", "steering_signal", "ratio", 1e-2),
        ("steering_signal (‰)", "steering_signal", "ratio", 1e-3),
        ("steering_signal [-]", "steering_signal", "ratio", 1.0),
        ("acc_x [m/s²]", "acc_x", "acceleration", 1.0),
        ("acc_x_m_per_s2", "acc_x", "acceleration", 1.0),
        ("acc_x (g)", "acc_x", "acceleration", 9.80665),
        ("force_kN", "force", "force", 1e3),
        ("X (US survey foot)", "x", "length", 1200 / 3937),
        ("x_ft", "x", "length", 0.3048),
        ("torque_N_m", "torque", "torque", 1.0),
    ],
)
def test_units_as_people_write_them(name, base, dimension, factor):
    found = parse_name(name, {base}, dimension)
    assert found is not None and found.unit is not None
    assert found.base == base
    assert found.unit.factor == pytest.approx(factor, rel=1e-12)
    assert found.unit.offset == 0.0


@pytest.mark.parametrize(
    ("name", "kelvin"),
    [("oil (°C)", 313.15), ("oil_degC", 313.15), ("oil_C", 313.15), ("oil [deg C]", 313.15), ("oil_K", 40.0),
     ("oil (°F)", 277.594444444), ("oil_F", 277.594444444)],
)  # fmt: skip
def test_temperatures_have_their_zero(name, kelvin):
    found = parse_name(name, {"oil"}, "temperature")
    assert found is not None and found.unit is not None
    assert found.unit.to_si(40.0) == pytest.approx(kelvin)


@pytest.mark.parametrize(
    ("name", "base", "dimension"),
    [("pressure_a", "pressure_a", "pressure"), ("Pressure (A)", "pressure_a", "pressure"), ("h", "h", "length"),
     ("position_x", "position_x", "length"), ("wheel_speed_fl", "wheel_speed_fl", "rotational_speed"),
     ("Time", "time", "time"), ("header.stamp", "header_stamp", "time")],
)  # fmt: skip
def test_a_last_word_that_is_no_unit_belongs_to_the_name(name, base, dimension):
    found = parse_name(name, {base}, dimension)
    assert found is not None
    assert (found.base, found.unit, found.is_unknown) == (base, None, False)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("joint_angle [furlong]", "furlong"), ("joint_angle (bar)", "bar"), ("joint_angle_rad [deg]", "rad and deg")],
)
def test_a_unit_that_is_unknown_is_not_passed_over(name, unit):
    found = parse_name(name, {"joint_angle"}, "angle")
    assert found is not None
    assert found.is_unknown
    assert found.unit_text == unit


@pytest.mark.parametrize("name", ["joint_angle_filtered", "joint_angle_bar", "angle_joint", "", "[rad]", "x" * 5000])
def test_another_name_is_another_column(name):
    assert parse_name(name, {"joint_angle"}, "angle") is None


def test_the_first_dimension_that_fits_is_taken():
    voltage, signal = (parse_name(name, {"u"}, "voltage", "ratio") for name in ("u_V", "u [%]"))
    assert voltage and voltage.unit and voltage.unit.dimension == "voltage"
    assert signal and signal.unit and signal.unit.dimension == "ratio"
    assert find_unit("mil", "angle") and find_unit("mil", "length") is None
    torque = find_unit("N m", "torque")
    assert torque and torque.factor == 1.0


def test_names_are_compared_without_regard_to_their_dress():
    assert {
        canonical(name) for name in ("Joint angle", "jointAngle", "JOINT_ANGLE", "joint-angle", "/joint.angle")
    } == {"joint_angle"}


def test_hostile_names_take_no_time():
    for name in ("(" * 150, "_" * 200, "/" * 200, "a_" * 100, "s " * 100, "m^" * 99, "°" * 200):
        assert len(splits(name)) < 200
        for dimension in DIMENSIONS:
            find_unit(name, dimension)
