"""The bridge to ROS 2 between stand-ins for ``rclpy`` and for the sockets: what is passed on, and in which units.

With ROS 2 itself it is untested: its packages are on no package index.
"""

import runpy
import sys
from collections import defaultdict
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from aoro_gym.cosimulation.server.records import TELEMETRY

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "sil"


class Message:
    """Any message: its members come into being."""

    def __init__(self) -> None:
        self.header, self.angular_velocity, self.linear_acceleration = (SimpleNamespace() for _ in range(3))
        self.orientation_covariance = [0.0] * 9


class Node:
    """As much of ``rclpy.node.Node`` as the bridge asks for."""

    def __init__(self, name: str) -> None:
        self.published: dict[str, list[Any]] = defaultdict(list)
        self.heard: dict[str, Any] = {}

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        return SimpleNamespace(publish=self.published[topic].append)

    def create_subscription(self, kind: type, topic: str, call: Any, depth: int) -> None:
        self.heard[topic] = lambda value: call(SimpleNamespace(data=value))

    def create_timer(self, period: float, call: Any) -> None:
        pass

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now"))


@pytest.fixture
def bridge(monkeypatch: pytest.MonkeyPatch) -> Any:
    nodes: list[Any] = []
    members = {
        "rclpy": {"init": lambda: None, "spin": nodes.append},
        "rclpy.node": {"Node": Node},
        "nmea_msgs.msg": {"Sentence": Message},
        "sensor_msgs.msg": {"Imu": Message, "JointState": Message},
        "std_msgs.msg": {"Float64": Message},
    }
    for name in [*members, *(name.partition(".")[0] for name in members if name.endswith(".msg"))]:
        module = ModuleType(name)
        vars(module).update(members.get(name, {}))
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "track", raising=False)
    monkeypatch.syspath_prepend(EXAMPLES)
    runpy.run_path(str(EXAMPLES / "ros2_bridge.py"))
    nodes[0].machine.udp.close()
    return nodes[0]


def test_readings_become_messages(bridge: Any) -> None:
    place = {one.name: float(number) for number, one in enumerate(TELEMETRY.fields)}
    payload = TELEMETRY.payload.pack(*(int(place[f.name]) if f.whole else place[f.name] for f in TELEMETRY.fields))
    fields = ["GPHDT", "79.29", "T"]
    bridge.machine = SimpleNamespace(records=lambda: [(TELEMETRY.kind, 1.25, payload)], sentences=lambda: [fields])
    bridge.look()
    (joints,), (inertial,), (sentence,) = (bridge.published[t] for t in ("joint_states", "imu", "nmea_sentence"))
    assert joints.position[0] == place["joint_angle"]
    assert joints.velocity[1:] == [place[f"wheel_speed_{wheel}"] for wheel in ("fl", "fr", "rl", "rr")]
    turning, force = vars(inertial.angular_velocity), vars(inertial.linear_acceleration)
    assert turning == {axis: place[f"rate_{axis}"] for axis in "xyz"}
    assert force == {axis: place[f"force_{axis}"] for axis in "xyz"}
    assert inertial.orientation_covariance[0] == -1.0  # REP 145: no orientation
    assert sentence.sentence == "$GPHDT,79.29,T*30"  # exclusive or of its characters


def test_signals_become_volts_and_answer_the_newest_telemetry(bridge: Any) -> None:
    sent: list[tuple[int, bytes, float]] = []
    bridge.machine = SimpleNamespace(send=lambda *arguments: sent.append(arguments))
    bridge.instant = 1.25
    bridge.heard["cmd_steering"](1.0)  # full left
    bridge.heard["cmd_drive"](-3.0)  # full astern, limited
    names = runpy.run_path(str(EXAMPLES / "track.py"))
    volts = [names["COMMAND_LAYOUT"].unpack(payload)[:3] for _, payload, _ in sent]
    assert volts == [(0.5, 2.5, 0.5), (0.5, 0.5, 0.5)]
    assert {(kind, instant) for kind, _, instant in sent} == {(names["COMMAND"], 1.25)}
