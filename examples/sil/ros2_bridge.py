"""A bridge between the served twin and ROS 2: NMEA, joint, wheels and inertial unit as topics, steering and drive back.

Untested: ``rclpy`` comes with a ROS 2 distribution and is on no package index that this project is tested with. It needs
one of these distributions, sourced, and runs beside the server:

    aoro-gym serve
    python ros2_bridge.py

| topic | type | what it is |
|---|---|---|
| ``nmea_sentence`` | ``nmea_msgs/Sentence`` | as they come over TCP; ``nmea_navsat_driver`` makes ``NavSatFix`` of them |
| ``joint_states`` | ``sensor_msgs/JointState`` | joint angle, wheel speeds |
| ``imu`` | ``sensor_msgs/Imu`` | angular velocity and specific force |
| ``cmd_steering``, ``cmd_drive`` | ``std_msgs/Float64`` | in: signals in [-1, 1], positive left and ahead |

Commands are passed on as they come, ten times a second and more: where they stay away, the server's watchdog stops the
machine.
"""

import rclpy  # pyright: ignore[reportMissingImports]
from nmea_msgs.msg import Sentence  # pyright: ignore[reportMissingImports]
from rclpy.node import Node  # pyright: ignore[reportMissingImports]
from sensor_msgs.msg import Imu, JointState  # pyright: ignore[reportMissingImports]
from std_msgs.msg import Float64  # pyright: ignore[reportMissingImports]
from track import COMMAND, COMMAND_LAYOUT, NEUTRAL, TELEMETRY, TELEMETRY_LAYOUT, Machine

WHEELS = ("wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr")
PERIOD = 0.005  # [s] between two looks at the sockets


class Bridge(Node):
    """Passes on what arrives on either side."""

    def __init__(self):
        super().__init__("aoro_bridge")
        self.machine = Machine(("127.0.0.1", 47800), ("127.0.0.1", 47801))
        self.sentences = self.create_publisher(Sentence, "nmea_sentence", 10)
        self.joints = self.create_publisher(JointState, "joint_states", 10)
        self.inertial = self.create_publisher(Imu, "imu", 10)
        self.create_subscription(Float64, "cmd_steering", self.steer, 1)
        self.create_subscription(Float64, "cmd_drive", self.drive, 1)
        self.volts, self.instant = list(NEUTRAL), 0.0
        self.create_timer(PERIOD, self.look)
        self.create_timer(1.0, self.machine.hello)

    def steer(self, message):
        self.volts[0] = 2.5 - 2.0 * min(max(message.data, -1.0), 1.0)
        self.send()

    def drive(self, message):
        self.volts[1] = 2.5 + 2.0 * min(max(message.data, -1.0), 1.0)
        self.send()

    def send(self):
        self.machine.send(COMMAND, COMMAND_LAYOUT.pack(*self.volts, 1), self.instant)

    def look(self):
        for kind, instant, payload in self.machine.records():
            if kind == TELEMETRY:
                self.instant = instant
                self.publish(TELEMETRY_LAYOUT.unpack(payload))
        for fields in self.machine.sentences():
            message = Sentence()
            message.header.stamp = self.get_clock().now().to_msg()
            body = ",".join(fields)
            check = 0
            for character in body:
                check ^= ord(character)
            message.sentence = f"${body}*{check:02X}"
            self.sentences.publish(message)

    def publish(self, numbers):
        joints, inertial = JointState(), Imu()
        joints.header.stamp = inertial.header.stamp = self.get_clock().now().to_msg()
        joints.name = ["joint", *WHEELS]
        joints.position = [numbers[4], 0.0, 0.0, 0.0, 0.0]
        joints.velocity = [0.0, *numbers[5:9]]
        self.joints.publish(joints)
        inertial.orientation_covariance[0] = -1.0  # not given
        turning, force = inertial.angular_velocity, inertial.linear_acceleration
        turning.x, turning.y, turning.z = numbers[11:14]
        force.x, force.y, force.z = numbers[14:17]
        self.inertial.publish(inertial)


rclpy.init()
rclpy.spin(Bridge())
