"""What the machine measures: joint angle, pressures, crane, GPS, inertial unit and wheel speeds with their errors, the pose
that a controller makes of them, and the chain from the joint angle to the flow."""

from aoro_gym.sensors.chain import CHAINS, MeasuringChain
from aoro_gym.sensors.crane import CraneNoise, CraneSensors
from aoro_gym.sensors.gps import Antennas, FixLoss, Gps, GpsNoise, GpsReading
from aoro_gym.sensors.imu import Imu, ImuNoise, ImuReading
from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor, NoiseLine
from aoro_gym.sensors.localisation import Localisation, LocalisationGains
from aoro_gym.sensors.pose_filter import PoseFilter, PoseFilterSettings
from aoro_gym.sensors.pressure import PressureNoise, PressureSensor
from aoro_gym.sensors.wheel_speed import WheelSpeedNoise, WheelSpeedSensor

__all__ = [
    "CHAINS",
    "Antennas",
    "CraneNoise",
    "CraneSensors",
    "FixLoss",
    "Gps",
    "GpsNoise",
    "GpsReading",
    "Imu",
    "ImuNoise",
    "ImuReading",
    "JointAngleNoise",
    "JointAngleSensor",
    "Localisation",
    "LocalisationGains",
    "MeasuringChain",
    "NoiseLine",
    "PoseFilter",
    "PoseFilterSettings",
    "PressureNoise",
    "PressureSensor",
    "WheelSpeedNoise",
    "WheelSpeedSensor",
]
