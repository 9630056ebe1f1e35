"""The tracking script in a process of its own: it needs nothing but Python, follows a path as the package's controller does,
and the twin stays safe whatever becomes of it."""

import os
import runpy
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.cosimulation.protocol import HEADER_SIZE
from aoro_gym.cosimulation.server.geodesy import Geodesy
from aoro_gym.cosimulation.server.records import COMMAND, GRANT, RECORDS, STATE, TELEMETRY
from aoro_gym.cosimulation.server.server import Server, Settings
from aoro_gym.cosimulation.server.starting import start_on_path
from aoro_gym.cosimulation.server.watchdog import LATEST_REACTION, PATIENCE
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin

from .pursuit import followed
from .server.serving import serving

SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "sil" / "track.py"
LINE = Line.spline(np.array([[0.0, 0.0], [5.0, 0.3], [8.0, 1.2], [11.0, 1.3]]), name="weave")
LONG = Line.spline(np.array([[0.0, 0.0], [20.0, 0.5], [40.0, -0.5], [80.0, 0.0]]), name="long")


def recording(line: Line, file: Path) -> Path:
    """The path as latitude and longitude."""
    geodesy = Geodesy(Plane())
    rows = [geodesy.place(float(x), float(y), 0.0)[:2] for x, y in line.points]
    file.write_text("latitude_deg,longitude_deg\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows), encoding="utf-8")
    return file


def on_path(line: Line) -> Twin:
    twin = Twin(threads=1)
    start_on_path(twin, twin.machine, line)
    return twin


@contextmanager
def tracking(server: Server, path: Path, *options: str):
    """The script, isolated from all packages that are installed; it is no more afterwards."""
    addresses = ["--udp", f"127.0.0.1:{server.link.port}", "--tcp", f"127.0.0.1:{server.publisher.port}"]
    command = [sys.executable, "-I", "-S", str(SCRIPT), "--path", str(path), *addresses, *options]
    script = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield script
    finally:
        if script.poll() is None:
            script.send_signal(signal.SIGCONT)
            script.kill()
        script.communicate()


def wait_for(condition, patience: float = 60.0) -> None:
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)


def test_its_layouts_are_those_of_the_records():
    names = runpy.run_path(str(SCRIPT))
    assert names["HEADER"].size == HEADER_SIZE
    for record, layout in ((STATE, "STATE_LAYOUT"), (TELEMETRY, "TELEMETRY_LAYOUT"), (COMMAND, "COMMAND_LAYOUT")):
        assert names[layout].size == record.payload.size, record.name
        assert names[record.name.upper()] == record.kind
    assert names["GRANT_LAYOUT"].size == GRANT.payload.size and len(RECORDS) == 5
    numbers = [float(number) for number in range(len(TELEMETRY.fields))]
    payload = TELEMETRY.payload.pack(
        *(int(n) if f.whole else n for n, f in zip(numbers, TELEMETRY.fields, strict=True))
    )
    place = {one.name: float(number) for number, one in enumerate(TELEMETRY.fields)}
    found = names["telemetry"](payload)
    assert found["wheel_speeds"] == tuple(place[f"wheel_speed_{wheel}"] for wheel in ("fl", "fr", "rl", "rr"))
    for name, field in {
        "yaw_rate": "rate_z",
        **{n: n for n in ("utc", "joint_angle", "roll", "pitch", "watchdog")},
    }.items():
        assert found[name] == place[field], name
    machine, assumed = Twin(threads=1).machine, names["RADIUS"]
    assert assumed == pytest.approx(float(np.max(machine.tire.radius)), abs=5e-4)  # it is given in millimetres
    for name, frame in (("FRONT", machine.frame.front), ("REAR", machine.frame.rear)):
        assert names[name] == pytest.approx(float(np.max(frame.axle_distance)), abs=5e-4), name


def test_it_follows_a_path_as_the_controller_in_process_does(tmp_path):
    """Within 5 % of its cross-track error, on the same readings."""
    settings, file = Settings(lock_step=True, seed=2), recording(LINE, tmp_path / "path.csv")
    inside = followed(Server(on_path(LINE), settings, path=LINE), LINE)
    with serving(settings, on_path(LINE), path=LINE) as server, tracking(server, file) as script:
        output, _ = script.communicate(timeout=120.0)
        assert script.returncode == 0, output
        assert server.judge is not None and server.judge.ended
        outside = server.judge.to_json()
        assert server.link.watchdog.trips == 0 and not server.link.commander.receiver.rejected
    assert inside["reached_end"]
    assert outside["cross_track_rms_m"] == pytest.approx(inside["cross_track_rms_m"], rel=0.05)


@pytest.mark.slow
def test_killed_frozen_and_restarted_the_machine_stops_and_goes_on(tmp_path):
    settings, file = Settings(seed=1), recording(LONG, tmp_path / "path.csv")
    with serving(settings, on_path(LONG), path=LONG) as server:
        session, watchdog = server.session, server.link.watchdog

        def driving() -> bool:
            return not session.watchdog and session.true("speed") > 0.3

        def stopped() -> bool:
            return session.watchdog and session.commands["parking_brake"] == 1.0 and abs(session.true("speed")) < 0.02

        for harm in (signal.SIGSTOP, signal.SIGKILL):
            with tracking(server, file) as script:
                wait_for(driving)
                trips = watchdog.trips
                script.send_signal(harm)
                wait_for(lambda before=trips: watchdog.trips > before)
                wait_for(stopped)
                if harm == signal.SIGSTOP:
                    time.sleep(1.0)
                    script.send_signal(signal.SIGCONT)
                    wait_for(driving)
        with tracking(server, file):  # a new process: another sender, a new connection
            wait_for(driving)
        late = server.schedule.starts.worst
        assert np.isfinite(session.twin.state.numpy()).all()
        assert PATIENCE <= watchdog.slowest <= LATEST_REACTION + 2.0 * late
        assert server.judge is not None and server.judge.largest < 0.5


@pytest.mark.slow
def test_a_script_that_sends_garbage_is_as_good_as_a_silent_one(tmp_path):
    text = SCRIPT.read_text(encoding="utf-8")
    broken = tmp_path / "broken.py"
    noise = """            if self.commands > 60:
                self.machine.udp.send(__import__("os").urandom(80))
                return
"""
    place = "            volts = BRAKED if self.ended else volts\n"
    assert text.count(place) == 1
    broken.write_text(text.replace(place, place + "            self.commands += 1\n" + noise), encoding="utf-8")
    file, events = recording(LONG, tmp_path / "path.csv"), []
    with serving(Settings(seed=1), on_path(LONG), path=LONG, on_event=events.append) as server:
        command = [sys.executable, "-I", "-S", str(broken), "--path", str(file)]
        command += ["--udp", f"127.0.0.1:{server.link.port}", "--tcp", f"127.0.0.1:{server.publisher.port}"]
        script = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            wait_for(lambda: server.link.commander.receiver.rejected.total() > 20)
            wait_for(lambda: server.session.watchdog and abs(server.session.true("speed")) < 0.02)
        finally:
            script.kill()
            script.wait()
        assert server.link.watchdog.trips >= 1 and np.isfinite(server.session.twin.state.numpy()).all()
        assert len([one for one in events if "dropped" in one]) == len(server.link.commander.receiver.rejected)


@pytest.mark.slow
def test_the_example_records_a_path_and_the_script_follows_it(tmp_path):
    """As the how-to says it: two commands and two programs."""
    environment = {**os.environ, "AORO_TOKEN": "correct-horse-battery"}
    run = {"cwd": tmp_path, "env": environment, "text": True}
    record = [sys.executable, str(SCRIPT.with_name("record_path.py")), "2", "10"]
    told = subprocess.run(record, check=True, timeout=300, stdout=subprocess.PIPE, **run).stdout.splitlines()
    assert told[0].startswith("scan.laz: ") and told[-1].startswith("ground of ")
    assert max(map(len, told)) < 120
    command = [
        sys.executable,
        "-m",
        "aoro_gym",
        "serve",
        "--terrain",
        "ground.ply",
        "--path",
        "path.gpx",
        "--lock-step",
    ]
    command += ["--udp-port", "0", "--tcp-port", "0", "--json", "served.json"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **run)
    assert server.stderr is not None
    words = next(
        line for line in server.stderr if line.startswith("serving ")
    ).split()  # after lines of progress, if any
    addresses = ["--udp", words[words.index("udp") + 1], "--tcp", words[words.index("tcp") + 1]]
    script = [
        sys.executable,
        "-I",
        "-S",
        str(SCRIPT),
        "--path",
        "path.gpx",
        *addresses,
        "--token",
        environment["AORO_TOKEN"],
    ]
    try:
        found = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    finally:
        server.send_signal(signal.SIGINT)
        _, errors = server.communicate(timeout=60)
    assert found.returncode == 0, found.stdout + found.stderr
    assert server.returncode == 130 and "interrupted:" in errors
    assert '"reached_end": true' in (tmp_path / "served.json").read_text(encoding="utf-8")
