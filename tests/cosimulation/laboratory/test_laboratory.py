"""Two processes are the whole twin at zero delay; delay beyond the edge makes a parked machine swing; silence is a stop."""

import json
import runpy
import socket
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym import Machine
from aoro_gym.cli.app import app
from aoro_gym.cosimulation.laboratory import process as process_module
from aoro_gym.cosimulation.laboratory.comparison import differences, drive_parted, drive_whole, parted
from aoro_gym.cosimulation.laboratory.coupling import Coupling
from aoro_gym.cosimulation.laboratory.delays import DelayLine
from aoro_gym.cosimulation.laboratory.manoeuvres import MANOEUVRES, Manoeuvre
from aoro_gym.cosimulation.laboratory.process import DrivelineProcess, LaboratoryLost, RemoteDriveline
from aoro_gym.cosimulation.laboratory.protection import Limits
from aoro_gym.cosimulation.laboratory.run import Line, lines
from aoro_gym.twin.driveline import Driveline
from aoro_gym.twin.hub_driven import HubDrivenTwin

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "vil" / "laboratory.py"


@pytest.fixture
def served() -> Iterator[DrivelineProcess]:
    """A driveline that answers from another thread; time stands still while no one asks."""
    process = DrivelineProcess(Driveline(), limits=Limits(silence=60.0), say=lambda text: None)
    thread = threading.Thread(target=process.run, args=(60.0,), daemon=True)
    thread.start()
    yield process
    process.end()
    thread.join()
    process.close()


@pytest.mark.parametrize("name", ["turn", "park"])
def test_in_lock_step_within_one_percent_of_the_whole(name: str) -> None:
    short = {"turn": 1.4, "park": 2.1}
    manoeuvre = replace(MANOEUVRES[name], duration=short[name])
    machine = Machine.load("aoro")
    whole = drive_whole(machine, manoeuvre)
    parts, _ = drive_parted(Coupling(*parted(machine, manoeuvre, hub_inertia=4.0)), manoeuvre)
    worst = max(differences(whole, parts), key=lambda one: one.rms)
    assert worst.rms < 0.01, worst


@pytest.mark.slow
@pytest.mark.parametrize("name", list(MANOEUVRES))
def test_whole_manoeuvres_within_one_percent(name: str) -> None:
    machine, manoeuvre = Machine.load("aoro"), MANOEUVRES[name]
    whole = drive_whole(machine, manoeuvre)
    parts, _ = drive_parted(Coupling(*parted(machine, manoeuvre, hub_inertia=4.0)), manoeuvre)
    worst = max(differences(whole, parts), key=lambda one: one.rms)
    assert worst.rms < 0.01, worst


def test_the_socket_changes_no_bit(served: DrivelineProcess) -> None:
    manoeuvre = replace(MANOEUVRES["turn"], duration=0.2)
    here, _ = drive_parted(Coupling(HubDrivenTwin(), Driveline()), manoeuvre)
    remote = RemoteDriveline(served.address)
    there, _ = drive_parted(Coupling(HubDrivenTwin(), remote), manoeuvre)
    remote.close()
    assert np.array_equal(here, there)
    assert len(remote.round_trips) == 200


def test_the_socket_confirms_a_delay(served: DrivelineProcess) -> None:
    manoeuvre = replace(MANOEUVRES["drive"], duration=0.2)
    runs, remote = [], RemoteDriveline(served.address)
    for driveline in (Driveline(), remote):
        forth, back = lines(Line(delay=3e-3, jitter=2e-3, loss=0.1, seed=5), 1e-3)
        runs.append(drive_parted(Coupling(HubDrivenTwin(), driveline, forth=forth, back=back), manoeuvre)[0])
    remote.close()
    assert np.array_equal(*runs)


def test_a_lost_answer_is_asked_for_again(served: DrivelineProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_module, "ASK_AGAIN", 0.05)
    remote = RemoteDriveline(served.address)
    remote.reset([0.0] * 4)
    for _ in range(3):
        remote.step([0.1] * 4, 0.0)
    taken = served._tick
    # an answer that never comes: as if this demand had been answered into the void
    remote._socket.sendto(b"garbage", served.address)
    forged = remote._sender.encode(process_module.DEMAND, remote._session, 0.0, _demand(remote._tick + 1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as void:
        void.sendto(forged, served.address)
    remote.step([0.1] * 4, 0.0)
    remote.close()
    assert served._tick == taken + 1  # moved once
    assert sum(served.receiver.rejected.values()) == 1


def _demand(tick: int) -> dict[str, float]:
    fields = {one.name: 0.0 for one in process_module.DEMAND.fields}
    return {**fields, "tick": tick, "gear": 1, **{name: 0.1 for name in fields if name.startswith("rate_")}}


def test_silence_stops_the_driveline_and_a_beginning_revives_it() -> None:
    told, noted = list[str](), list[str]()
    process = DrivelineProcess(Driveline(), limits=Limits(silence=0.3), say=told.append, note=noted.append)
    thread = threading.Thread(target=process.run, args=(60.0,), daemon=True)
    thread.start()
    remote = RemoteDriveline(process.address)
    remote.set_commands({"drive_signal": 0.5})
    remote.reset([0.0] * 4)
    remote.step([0.0] * 4, 0.0)
    for _ in range(100):  # 3 s at most
        if process.stopped:
            break
        threading.Event().wait(0.05)
    assert "no demand for 300 ms" in process.stopped
    assert process.driveline._commands.numpy()[:, 0][-1] == 1.0  # the parking brake
    with pytest.raises(LaboratoryLost, match="stopped"):
        remote.step([0.0] * 4, 0.0)
    remote.reset([0.0] * 4)
    remote.step([0.0] * 4, 0.0)
    assert not process.stopped
    assert noted == ["the bodies began"] * 2
    assert len(told) == 1 and told[0].startswith("stopped: no demand for 300 ms")
    remote.close()
    process.end()
    thread.join()
    process.close()


def test_a_set_point_beyond_the_limit_stops_the_driveline(served: DrivelineProcess) -> None:
    remote = RemoteDriveline(served.address)
    remote.reset([0.0] * 4)
    with pytest.raises(LaboratoryLost):
        remote.step([13.0, 0.0, 0.0, 0.0], 0.0)
    assert "13 rad/s is beyond 12 rad/s" in served.stopped
    remote.close()


def test_no_one_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_module, "GIVE_UP", 0.2)
    remote = RemoteDriveline(("127.0.0.1", 9))
    with pytest.raises(LaboratoryLost, match=r"127\.0\.0\.1:9 has not answered"):
        remote.reset([0.0] * 4)
    remote.close()


def test_a_parked_machine_bears_little_delay() -> None:
    """The brake's own damping outweighs c/k = 2 ms; ten times that is beyond all that tires add."""
    case = Manoeuvre(
        "parked", 1.6, lambda time: {"drive_signal": 0.5 * (time < 0.6), "parking_brake": float(time > 0.8)}
    )
    delays = np.array([0, 1, 20])
    sides = parted(Machine.load("aoro"), case, num_machines=3)
    coupling = Coupling(*sides, forth=DelayLine(delays, num_machines=3))
    torques = np.array([coupling.exchange(case.commands(k * 1e-3)) for k in range(1600)])
    swings = np.ptp(torques[-300:], axis=0).max(axis=0)
    assert swings[1] < 2.0 * swings[0]
    assert swings[2] > 3.0 * swings[0]


def test_what_is_no_whole_number_of_periods() -> None:
    with pytest.raises(ValueError, match=r"delay is 2\.5 ms"):
        lines(Line(delay=2.5e-3), 1e-3)
    forth, back = lines(Line(delay=5e-3), 1e-3)
    assert (int(forth.delay[0]), int(back.delay[0])) == (3, 2)


@pytest.mark.slow
def test_the_example_in_two_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), "0.7"])
    found = runpy.run_path(str(EXAMPLE))
    assert found["speed"] > 0.05
    assert found["protection"].phase == "stopped"
    assert found["protection"].at_rest


def test_shares_that_are_done_rise_to_the_end() -> None:
    manoeuvre, shares = replace(MANOEUVRES["park"], duration=0.02), list[float]()
    drive_whole(Machine.load("aoro"), manoeuvre, 1e-3, shares.append)
    assert shares == pytest.approx(np.arange(20) / 20.0)
    shares.clear()
    drive_parted(Coupling(HubDrivenTwin(), Driveline()), manoeuvre, shares.append)
    assert shares == pytest.approx(np.arange(20) / 20.0)


def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"port is {port}, but cannot be bound on 127.0.0.1"):
            DrivelineProcess(Driveline(), port=port)


def test_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MANOEUVRES, "drive", replace(MANOEUVRES["drive"], duration=0.3))
    done = CliRunner().invoke(app, ["laboratory", "--delay", "2", "--out", str(tmp_path), "--quiet"])
    assert done.exit_code == 0, done.output
    assert done.stderr == ""
    found = json.loads((tmp_path / "laboratory.json").read_text())
    assert found["phase"] == "running"
    assert found["line"]["delay"] == pytest.approx(2e-3)
    assert {one["channel"] for one in found["differences"]} >= {"speed", "yaw_rate"}


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["--manoeuvre", "fly"], "--manoeuvre is 'fly'"),
        (["--connect", "here"], "must be HOST:PORT"),
        (["--host", "0.0.0.0"], "give --token"),
        (["--limit-torque", "0"], "--limit-torque is 0 N m, but must be above 0"),
        (["--limit-silence", "-5"], "--limit-silence is -5 ms"),
        (["--delay", "-1"], "--delay is -1 ms"),
        (["--delay", "0.5"], "--delay is 0.5 ms, but must be a whole multiple"),
        (["--hub-inertia", "-1"], "--hub-inertia is -1 kg m²"),
        (["--period", "0"], "--period"),
    ],
)
def test_command_refuses(asked: list[str], message: str) -> None:
    done = CliRunner().invoke(app, ["laboratory", *asked])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
