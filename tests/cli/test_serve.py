"""The command ``serve``."""

import csv
import json
import socket

import pytest

from aoro_gym.cli import serve as module
from aoro_gym.cosimulation.realtime import NotPermitted
from aoro_gym.recording.tables import read_table

from .calling import call, check_refused

PORTS = ("--udp-port", "0", "--tcp-port", "0")


def test_it_serves_for_so_long_and_tells_how_late_it_was(tmp_path):
    out, file = tmp_path / "session", tmp_path / "result.json"
    shown = call("serve", *PORTS, "--duration", "0.3", "--out", out, "--json", file, "--origin", "60.5,25,7")
    assert shown.exit_code == 0, shown.output
    assert (
        "serving in real time: udp 127.0.0.1:" in shown.stderr and "origin 60.5000000,25.0000000,7.00" in shown.stderr
    )
    assert "deadlines" in shown.stdout and "99.9 %" in shown.stdout and "300 deadlines missed" in shown.stdout
    result = json.loads(file.read_text())
    assert result == json.loads((out / "serve.json").read_text())
    assert result["simulated_s"] == 0.3 and result["ended"] == "duration over"
    assert result["deadlines"]["steps"] == 300
    with (out / "serve.csv").open() as rows:
        assert [row["steps"] for row in csv.DictReader(rows)] == ["300"]
    assert (out / "events.log").exists()


@pytest.mark.parametrize("suffix", [".mcap", ".rosbag2"])
def test_a_log_of_the_sensors_is_written(tmp_path, suffix):
    file = tmp_path / f"session{suffix}"
    shown = call("serve", *PORTS, "--duration", "0.3", "--log", file)
    assert shown.exit_code == 0, shown.output
    assert f"wrote {file}" in shown.stdout.replace("\n", "") and file.with_suffix(".toml").exists()
    assert len(read_table(file)) == 29  # a record leaves after the instant that it shows
    short = call("serve", *PORTS, "--duration", "0.01", "--log", tmp_path / "short.csv")
    assert short.exit_code == 0 and "nothing was measured in 0.01 s" in short.stderr
    assert not (tmp_path / "short.csv").exists()


def test_json_goes_to_the_standard_output_alone():
    shown = call("serve", *PORTS, "--duration", "0.05", "--json", "-", "--quiet")
    assert json.loads(shown.stdout)["mode"] == "real time"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("serve --host 0.0.0.0", "host is 0.0.0.0, where others could command the machine; give a token"),
        ("serve --token short", "token has 5 characters, but must have at least 16"),
        ("serve --origin 66", "--origin is '66', but must be LAT,LON or LAT,LON,HEIGHT"),
        ("serve --origin 99,0", "latitude of the origin is 99 deg, but must be in [-89, 89]"),
        ("serve --telemetry-rate 30", "--telemetry-rate is 30; choose one of: 100, 50, 20"),
        ("serve --duration -1", "duration is -1 s, but must be above 0"),
        ("serve --udp-port 70000", "--udp-port is 70000, but must be in [0, 65535]"),
        ("serve --terrain nothing.ply", "nothing.ply"),
        ("serve --track 2", "--track 2 is one of a path's tracks; give its file with --path"),
        ("serve --path a.gpx --start 0 0 0", "--path and --start both say where to start"),
        ("serve --ground grid", "ground is 'grid'; choose one of: raster, mesh"),
        ("serve --view 99999", "--view is 99999, but must be an integer in [0, 65535]"),
        ("serve --log session.txt", "log session.txt must end in .csv, .parquet, .mcap or .rosbag2"),
        ("serve --fifo 0", "--fifo is 0, but must be an integer in [1, 99]"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refused(arguments, message)


def test_what_is_not_permitted_is_said_in_one_line(monkeypatch):
    def refuse(_: int) -> None:
        raise NotPermitted("FIFO priority 50 is refused")

    monkeypatch.setattr("aoro_gym.cosimulation.realtime.request_realtime", refuse)
    shown = call("serve", *PORTS, "--fifo", "50")
    assert shown.exit_code == 2 and shown.stderr == "error: --fifo 50: FIFO priority 50 is refused\n"
    assert module.serve.__doc__


def test_a_views_port_that_is_taken_is_named_by_its_option():
    pytest.importorskip("viser")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        check_refused(f"serve --view {taken.getsockname()[1]}", "--view is")


def test_the_page_is_closed_when_the_server_cannot_be(monkeypatch):
    closed = []

    class Page:
        address = "http://127.0.0.1:1"

        def __init__(self, *_, **__):
            pass

        def publish(self):
            pass

        def close(self):
            closed.append(self)

    monkeypatch.setattr("aoro_gym.view.mirror.MirrorPage", Page)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        shown = call("serve", "--view", "0", "--udp-port", taken.getsockname()[1])
    assert shown.exit_code == 2 and "error: --udp-port is" in shown.stderr
    assert len(closed) == 1
