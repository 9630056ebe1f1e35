"""What the machine measures: joint angle and pressures with their noise, and the chain from the angle to the flow."""

from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor, NoiseLine
from aoro_gym.sensors.pressure import PressureNoise, PressureSensor

__all__ = ["JointAngleNoise", "JointAngleSensor", "NoiseLine", "PressureNoise", "PressureSensor"]
