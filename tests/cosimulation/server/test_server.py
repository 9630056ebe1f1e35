"""A twin on sockets: what it answers, when it stops, what it drops."""

import random
import socket
import struct
import time
import zlib

import numpy as np
import pytest

from aoro_gym.cosimulation.protocol import Frame, Reason, encode
from aoro_gym.cosimulation.server.records import COMMAND, HELLO, commands_of, neutral
from aoro_gym.cosimulation.server.server import Server, Settings
from aoro_gym.cosimulation.server.watchdog import LATEST_REACTION, PATIENCE
from aoro_gym.twin import Twin

from .serving import DEFAULTS, client_of, serving

LOCK_STEP = Settings(lock_step=True)
SPARSE = Settings(lock_step=True, telemetry_rate=20)
"""Without what takes longest."""
TOKEN = "correct-horse-battery"


def test_volts_are_the_machines():
    assert commands_of({**DEFAULTS, "steering_V": 0.5})["steering_signal"] == 1.0  # full left
    assert commands_of({**DEFAULTS, "steering_V": 4.5})["steering_signal"] == -1.0
    found = commands_of({**DEFAULTS, "drive_V": 4.5, "brake_V": 4.5, "arm_fl_V": 0.5, "traction_rr_V": 0.5, "gear": 3})
    expected = {"drive_signal": 1.0, "parking_brake": 1.0, "arm_fl": -1.0, "traction_rr": 0.0, "gear": 3}
    assert {name: found[name] for name in expected} == expected
    assert commands_of(DEFAULTS) == {**neutral(1.0), "parking_brake": 0.0}


@pytest.mark.parametrize("json", [False, True])
def test_in_lock_step_the_twin_advances_as_granted_and_obeys(json):
    with serving(LOCK_STEP) as server, client_of(server, json=json) as client:
        client.greet()
        assert client.state is not None and client.state.values["lock_step"] == 1
        client.grant(0.05)
        assert server.session.time == pytest.approx(0.05) and len(client.telemetry) == 5
        for _ in range(10):
            client.command(steering_V=0.5, drive_V=4.5)
            client.grant(client.time + 0.1)
        assert server.session.time == pytest.approx(1.05)
        assert server.session.commands["steering_signal"] == 1.0
        last = client.telemetry[-1].values
        assert last["joint_angle"] > 0.05 and last["wheel_speed_fl"] > 0.5 and last["watchdog"] == 0
        # a time whose sum was rounded down is the next step all the same
        client.grant(1.06 - 1e-7)
        assert server.session.steps == 1060
        # granting the past again moves nothing
        client.grant(0.5)
        assert server.session.steps == 1060


def test_what_is_served_is_what_a_twin_does():
    """To the bit: the same commands in one launch after the other."""
    with serving(LOCK_STEP) as server, client_of(server) as client:
        client.greet()
        for _ in range(8):
            client.command(steering_V=1.0, drive_V=4.0)
            client.grant(client.time + 0.05)
        served = server.session.twin.state.numpy().copy()
    twin = Twin(threads=1)
    twin.step(commands_of({**DEFAULTS, "steering_V": 1.0, "drive_V": 4.0}), 0.4)
    np.testing.assert_array_equal(served, twin.state.numpy())


def test_without_commands_it_stops_in_time_and_goes_on_with_the_next():
    with serving(SPARSE) as server, client_of(server) as client:
        client.greet()
        assert server.session.watchdog  # nobody commands yet
        for _ in range(10):
            client.command(drive_V=4.5)
            client.grant(client.time + 0.1)
        speed = server.session.true("speed")
        assert speed > 0.3 and not server.session.watchdog
        client.command(drive_V=4.5)
        last = client.time
        client.grant(last + PATIENCE - 0.001)
        assert server.session.commands["drive_signal"] == 1.0
        client.grant(last + PATIENCE + 0.001)
        assert server.session.commands == {**neutral(1.0)}
        assert (
            server.link.watchdog.slowest == pytest.approx(PATIENCE, abs=1.5e-3) and PATIENCE + 1.5e-3 < LATEST_REACTION
        )
        client.grant(client.time + 2.0)
        assert client.telemetry[-1].values["watchdog"] == 1
        assert abs(server.session.true("speed")) < 0.02 and np.isfinite(server.session.twin.state.numpy()).all()
        client.command(drive_V=4.5)
        client.grant(client.time + 0.1)
        assert not server.session.watchdog and server.session.commands["drive_signal"] == 1.0
        assert server.link.watchdog.trips == 1


def test_garbage_is_counted_and_changes_nothing():
    """What the twin does, to the bit, is what it does without."""
    rng, states, events = random.Random(1), [], []
    for dirty in (False, True):
        with serving(LOCK_STEP, on_event=events.append) as server, client_of(server) as client:
            client.greet()
            for _ in range(10):
                client.command(steering_V=1.5, drive_V=4.0)
                if dirty:
                    good = encode(
                        client.sender.frame(COMMAND, client.session, client.time, DEFAULTS | {"drive_V": 0.5})
                    )
                    client.sender.sequence -= 1
                    bad = bytearray(good)
                    struct.pack_into("<f", bad, 40, float("nan"))
                    bad[-4:] = struct.pack("<I", zlib.crc32(bytes(bad[:-4])))
                    for datagram in (
                        rng.randbytes(60), b"", good[:-1], bytes(bad), b"{" * 900, bytes(2000), b"AORO" + rng.randbytes(80),
                    ):  # fmt: skip
                        client.socket.send(datagram)
                    client.send(COMMAND, DEFAULTS, instant=client.time + 1.0)
                client.grant(client.time + 0.05)
            states.append(server.session.twin.state.numpy().copy())
            rejected = dict(server.link.commander.receiver.rejected)
    np.testing.assert_array_equal(*states)
    assert rejected[Reason.OVERSIZED] == 10 and rejected[Reason.NON_FINITE] == 10 and rejected[Reason.STALE] == 10
    assert rejected[Reason.FOREIGN] >= 20 and rejected[Reason.MALFORMED] >= 10
    told = [event for event in events if "dropped" in event]
    assert len(told) == len(rejected)  # once a reason


def test_replays_stale_commands_and_a_second_sender_are_dropped():
    with serving(LOCK_STEP) as server, client_of(server) as client, client_of(server) as other:
        client.greet()
        other.greet()
        client.grant(0.5)
        client.command(drive_V=4.0)
        client.grant(0.6)
        old = encode(client.sender.frame(COMMAND, client.session, client.time, {**DEFAULTS, "drive_V": 0.5}))
        client.socket.send(old)
        client.command(drive_V=4.0)
        client.socket.send(old)
        client.send(COMMAND, {**DEFAULTS, "drive_V": 1.0}, instant=0.3)
        client.grant(0.65)
        other.time = 0.65
        other.command(drive_V=1.0)
        client.command(drive_V=4.0)
        client.grant(0.7)
        assert server.session.commands["drive_signal"] == 0.75
        rejected = server.link.commander.receiver.rejected
        assert rejected == {Reason.REPLAYED: 1, Reason.STALE: 1, Reason.BUSY: 1}
        client.grant(1.2)  # the first one is silent now
        other.time = client.time
        other.command(drive_V=4.5)
        other.grant(1.25)
        assert server.session.commands["drive_signal"] == 1.0 and rejected.total() == 3


def test_a_token_keeps_others_out():
    with serving(Settings(lock_step=True, token=TOKEN)) as server:
        with client_of(server) as stranger:
            stranger.send(HELLO, {})
            stranger.hear(lambda: stranger.state is not None, patience=0.5)
            assert stranger.state is None
        with client_of(server, token=TOKEN.encode()) as client:
            client.greet()
            client.command(drive_V=4.0)
            client.grant(0.1)
            assert server.session.commands["drive_signal"] == 0.75
        assert server.link.commander.receiver.rejected == {Reason.UNAUTHENTICATED: 1}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"host": "0.0.0.0"}, "host is 0.0.0.0, where others could command"),
        ({"token": "short"}, "token has 5 characters, but must have at least 16"),
        ({"udp_port": 70000}, "udp_port is 70000"),
        ({"duration": 0.0}, "duration is 0"),
    ],
)
def test_wrong_settings_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        Settings(**settings)


def test_in_real_time_it_keeps_the_pace_and_measures_the_watchdog_by_the_wall():
    settings = Settings(duration=1.5)
    with serving(settings) as server, client_of(server) as client:
        began = time.monotonic()
        client.greet()
        while server.session.time < 0.6:
            client.hear(lambda: False, patience=0.02)
            client.command(drive_V=4.0)
        client.hear(lambda: bool(server.ended), patience=20.0)
        assert server.ended == "duration over"
        # a busy computer is late, never early; of what it was late for more than a second, the clock was set anew
        assert time.monotonic() - began >= 1.4
        result = server.to_json()
    time.sleep(0.01)
    assert result["wall_s"] >= 1.499 and server.to_json()["wall_s"] == result["wall_s"], (
        "it ended before that was asked"
    )
    assert result["deadlines"]["steps"] == 1500 and result["deadlines"]["start_lateness"]["worst_us"] >= 0.0
    assert result["watchdog"]["trips"] >= 1
    # the stop comes with the next step: a step after the patience, and what that step was late
    late = 1e-6 * result["deadlines"]["start_lateness"]["worst_us"]
    # it may be early by the microsecond that time stamps are rounded by, and half of one is rounded in the report
    assert PATIENCE - 1.5e-6 <= result["watchdog"]["slowest_s"] <= PATIENCE + 2e-3 + 2.0 * late + 0.05
    assert 100 <= len(client.telemetry) <= 151


def test_sentences_come_over_tcp_and_a_client_that_does_not_read_stalls_nothing():
    with serving(LOCK_STEP) as server, client_of(server) as client:
        readers = [socket.create_connection(("127.0.0.1", server.publisher.port)) for _ in range(3)]
        client.greet()
        client.grant(1.0)
        readers[0].settimeout(5.0)
        text = b""
        while text.count(b"HDT") < 9:
            text += readers[0].recv(10_000)
        assert text.count(b"GGA") >= 9 and text.count(b"RMC") >= 9 and text.count(b"VTG") >= 9
        readers[1].close()
        client.grant(1.5)
        assert server.session.time == pytest.approx(1.5)
        for reader in readers:
            reader.close()


def test_an_address_in_use_is_an_error():
    with (
        serving(LOCK_STEP) as server,
        pytest.raises(OSError, match=r"udp_port is \d+, but cannot be bound on 127\.0\.0\.1"),
    ):
        Server(Twin(threads=1), Settings(udp_port=server.link.port))


def test_frames_of_an_earlier_run_are_foreign():
    with serving(LOCK_STEP) as server, client_of(server) as client:
        client.greet()
        client.session += 1
        client.send(COMMAND, DEFAULTS)
        client.session -= 1
        client.grant(0.1)
        assert server.link.commander.receiver.rejected == {Reason.SESSION: 1}
        assert isinstance(client.state, Frame)
