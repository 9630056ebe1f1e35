"""What a session measures, in which steps, and what its GPS sentences say."""

import math

import numpy as np
import pytest
from pynmeagps import NMEAReader

from aoro_gym.cosimulation.protocol import field_table
from aoro_gym.cosimulation.server.geodesy import Geodesy
from aoro_gym.cosimulation.server.judging import PathJudge
from aoro_gym.cosimulation.server.records import MEASURED_PRESSURES, RECORDS, TELEMETRY, neutral
from aoro_gym.cosimulation.server.session import Sensing, Session
from aoro_gym.cosimulation.server.starting import start_on_path
from aoro_gym.sensors import FixLoss, GpsNoise
from aoro_gym.terrains import Path
from aoro_gym.twin import Twin

DRIVING = {**neutral(1.0), "parking_brake": 0.0, "drive_signal": 0.7}


def session_of(heading: float = 0.0, **options) -> tuple[Session, list, list]:
    twin = Twin(threads=1)
    twin.reset(heading=heading)
    telemetry, blocks = [], []
    session = Session(
        twin,
        Geodesy(twin.terrain),  # pyright: ignore[reportArgumentType]
        on_telemetry=lambda values, instant: telemetry.append((instant, values)),
        on_sentences=lambda block: blocks.append(block),
        **options,
    )
    return session, telemetry, blocks


def parsed(block: bytes) -> dict:
    """The sentences of a block by kind."""
    found = [NMEAReader.parse(line + b"\r\n", validate=1) for line in block.split(b"\r\n") if line]
    return {message.msgID: message for message in found if message is not None and not isinstance(message, str)}


def test_step_by_step_and_at_once_are_the_same():
    """To the bit: records and sentences of the real-time loop and of lock-step."""
    found = []
    for at_once in (False, True):
        session, telemetry, blocks = session_of(seed=3)
        session.command(DRIVING)
        for _ in range(50):
            if at_once:
                session.run(10)
            else:
                for _ in range(10):
                    session.step()
        for _ in range(0 if at_once else 9):
            session.step()  # the last tick's parts
        found.append((telemetry[:50], blocks[:4], session.twin.time[0] if at_once else None))
    assert found[0][0] == found[1][0] and found[0][1] == found[1][1] and len(found[0][0]) == 50


def test_ideal_sensors_show_the_truth():
    session, telemetry, blocks = session_of(heading=math.radians(60.0), sensing=Sensing.ideal())
    session.command({**DRIVING, "steering_signal": 0.5})
    session.run(2000)
    instant, values = telemetry[-1]
    assert instant == pytest.approx(2.0) and values.keys() == {one.name for one in TELEMETRY.fields}
    for name in (*MEASURED_PRESSURES, "joint_angle", "engine_speed", "arm_angle_rl", "roll", "pitch"):
        assert values[name] == pytest.approx(session.true(name), rel=1e-6, abs=1e-6), name
    assert values["wheel_speed_rr"] == pytest.approx(session.true("wheel_rate_rr"))
    assert values["force_z"] == pytest.approx(9.81, abs=0.5)  # it drives over level ground
    sentences = parsed(blocks[-1])
    assert sorted(sentences) == ["GGA", "HDT", "RMC", "VTG"]
    # the solution is at most 0.1 s + 0.04 s + 0.05 s old
    age = values["utc"] - (sentences["GGA"].time.second + 1e-6 * sentences["GGA"].time.microsecond + 43200.0)
    assert 0.0 < age <= 0.19
    turned = math.degrees(session.true("yaw_rate")) * age
    assert sentences["HDT"].headingT == pytest.approx(
        (90.0 - math.degrees(session.true("yaw"))) % 360.0 + turned, abs=0.2
    )
    assert sentences["VTG"].sogk / 3.6 == pytest.approx(session.true("speed"), abs=0.1)
    assert sentences["GGA"].quality == 4 and sentences["RMC"].status == "A"


def test_solutions_stand_on_whole_tenths_ten_times_a_second():
    session, _, blocks = session_of(seed=5, telemetry_rate=20)
    session.run(2000)
    tenths = [round(10.0 * (m.time.second + 1e-6 * m.time.microsecond), 6) for m in (parsed(b)["GGA"] for b in blocks)]
    assert all(value == int(value) for value in tenths)
    assert np.all(np.diff(tenths) == 1.0) and 18 <= len(tenths) <= 20


def test_without_satellites_sentences_are_empty_and_go_on():
    loss = FixLoss(interval=0.5, none_duration=0.5, none_share=1.0)
    session, _, blocks = session_of(seed=1, sensing=Sensing(gps=GpsNoise.typical(loss)), telemetry_rate=20)
    session.run(5_000)
    found = [parsed(block)["GGA"] for block in blocks]
    qualities = [message.quality for message in found]
    assert {0, 4} == set(qualities) and 45 <= len(found) <= 50
    assert all(message.lat == "" for message in found if message.quality == 0)
    tenths = [round(10.0 * (m.time.second + 1e-6 * m.time.microsecond)) for m in found]
    assert np.all(np.diff(tenths) >= 1)


@pytest.mark.parametrize("rate, count", [(50, 50), (20, 20)])
def test_telemetry_comes_at_its_rate(rate, count):
    session, telemetry, blocks = session_of(telemetry_rate=rate)
    session.run(1000)
    assert len(telemetry) == count and len(blocks) >= 8


def test_more_twins_and_other_rates_are_refused():
    with pytest.raises(ValueError, match="2 twins on cpu"):
        Session(Twin(2, threads=1), Geodesy(Twin(2).terrain))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="telemetry_rate is 30"):
        session_of(telemetry_rate=30)
    twin = Twin(threads=1, main_step=2e-3)
    with pytest.raises(ValueError, match=r"main_step is 0\.002 s"):
        Session(twin, Geodesy(twin.terrain))  # pyright: ignore[reportArgumentType]


def test_a_path_is_judged_by_the_front_axle():
    line = Path(np.array([[0.0, 2.0], [30.0, 2.0]]))
    twin = Twin(threads=1)
    start_on_path(twin, twin.machine, line)
    state = np.array([[twin.state.numpy()[0, 0], twin.state.numpy()[1, 0], 0.0]])
    judge, level = PathJudge(line, twin.machine), np.zeros(1)
    judge.see(state, level, level, level)
    judge.see(state + np.array([1.0, 0.3, 0.0]), level, level, level)
    found = judge.to_json()
    assert found["cross_track_rms_m"] == pytest.approx(0.3 / math.sqrt(2.0), abs=1e-5) and not found["reached_end"]
    assert found["driven_m"] == pytest.approx(1.0, abs=1e-5) and found["cross_track_largest_m"] == pytest.approx(
        0.3, abs=1e-5
    )
    with pytest.raises(ValueError, match=r"is 3\.00 m long"):
        start_on_path(twin, twin.machine, Path(np.array([[0.0, 0.0], [3.0, 0.0]])))


def test_records_are_documented():
    assert all(one.text and one.unit for record in RECORDS for one in record.fields)
    assert field_table(TELEMETRY).count("\n") == len(TELEMETRY.fields) + 1
