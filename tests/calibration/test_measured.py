"""The published procedure on logs of a machine whose values were hidden, and what it refuses."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.calibration.measured import read_measured
from aoro_gym.calibration.procedure_logs import TIME_ACCURACY, calibrate_procedure
from aoro_gym.calibration.report import tables
from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.validation.turns import Turn

V = "steering.valve."
HIDDEN = {
    f"{V}dead_band_left": 0.285, f"{V}dead_band_right": 0.33, f"{V}nominal_flow_left": 66.0, f"{V}nominal_flow_right": 64.0,
    f"{V}opening_left_1V0": 0.33, f"{V}opening_left_1V5": 0.75, f"{V}opening_right_1V0": 0.25, f"{V}opening_right_1V5": 0.68,
    f"{V}nominal_drop_in_left": 6.0, f"{V}nominal_drop_in_right": 8.5, "driveline.brake.disc_torque": 300.0,
}  # fmt: skip
ANGLE_NOISE, PRESSURE_NOISE = 5e-4, 0.3
"""Standard deviations of the sensors [rad], [bar]."""
Plan = Sequence[tuple[float, float]]
"""Signals and how long [s] each holds."""
RAMP = [(0.0, 0.6), *((signal, 0.1) for signal in np.arange(0.08, 0.3, 0.002))]
"""0.04 V/s from within the dead band."""


@pytest.fixture(scope="module")
def machine() -> Machine:
    return Machine.load("aoro_datasheet").set(HIDDEN)


def write(path: Path, machine: Machine, start: float, plan: Plan, *, command: str = "steering_signal") -> float:
    """A log of 100 Hz with noise; gives the last speed [m/s]."""
    twin = Twin(1, machine=machine)
    twin.reset(joint_angle=start)
    parts = [twin.step({command: signal}, round(seconds, 2), sample_every=0.01) for signal, seconds in plan]
    channels = {
        name: np.concatenate([part[name][:, 0] for part in parts if part is not None])
        for name in ("joint_angle", "drive_pressure_forward", "drive_pressure_return", "speed")
    }
    held = np.repeat([signal for signal, _ in plan], [round(seconds / 0.01) for _, seconds in plan])
    held = np.append(held[1:], held[-1])  # a row's command holds from that row on
    rng = np.random.default_rng(len(held))
    columns = {
        "time_s": 0.01 * np.arange(len(held)),
        "steering_signal": held if command == "steering_signal" else 0.0 * held,
        "drive_signal": held if command == "drive_signal" else 0.0 * held,
        "joint_angle_rad": channels["joint_angle"] + ANGLE_NOISE * rng.standard_normal(len(held)),
    }
    for name in ("drive_pressure_forward", "drive_pressure_return"):
        columns[f"{name}_bar"] = channels[name] / 1e5 + PRESSURE_NOISE * rng.standard_normal(len(held))
    np.savetxt(
        path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="", fmt="%.7g"
    )
    return float(channels["speed"][-1])


def turn(folder: Path, machine: Machine, side: int, level: float, seconds: float) -> Path:
    path = folder / f"{'left' if side > 0 else 'right'}{100 * level:g}.csv"
    write(path, machine, -side * float(machine.joint.range), [(0.0, 0.6), (side * level, seconds)])
    return path


def test_a_ramp_gives_the_end_of_the_dead_band(machine, tmp_path):
    for side, name in ((1, "left"), (-1, "right")):
        write(tmp_path / f"{name}.csv", machine, -0.3 * side, [(side * signal, seconds) for signal, seconds in RAMP])
    found = read_measured(machine, [tmp_path / "left.csv", tmp_path / "right.csv"])
    assert [one.side for one in found.ramps] == ["left", "right"]
    for one in found.ramps:
        # 0.04 V/s times the lag of spool and command of 30 ms are 1.2 mV; three standard deviations of the noise
        assert abs(one.volts - HIDDEN[f"{V}dead_band_{one.side}"]) < 0.002 + 3.0 * max(one.std, 1e-3), one
        assert one.std < 0.005


def test_a_turn_gives_time_and_mean_flow(machine, tmp_path):
    found = read_measured(machine, [turn(tmp_path, machine, 1, 1.0, 3.0)]).turns[0]
    assert found.turn == Turn("left", 100.0)
    oil = 2.331 * 60.0  # L of a full turn, by geometry, in L/min s
    assert found.flow * found.time == pytest.approx(oil, rel=2e-3)


def test_what_is_no_turn_ramp_or_drive_is_refused(machine, tmp_path):
    half = tmp_path / "half.csv"
    write(half, machine, 0.1, [(0.0, 0.6), (1.0, 2.0)])
    with pytest.raises(
        ValueError,
        match=r"half\.csv begins at 5\.7°, but a full turn at \+100 % signal begins at the stop.*--set joint\.range",
    ):
        read_measured(machine, [half])
    quick = tmp_path / "quick.csv"
    write(quick, machine, -0.3, [(0.0, 0.6), *((signal, 0.02) for signal in np.arange(0.08, 0.6, 0.01))])
    with pytest.raises(ValueError, match=r"quick\.csv.*(ramp more slowly)"):
        read_measured(machine, [quick])
    both = tmp_path / "both.csv"
    write(both, machine, 0.0, [(0.0, 0.6), (0.4, 0.5), (-0.5, 1.0)])
    with pytest.raises(ValueError, match=r"both\.csv steers to both sides"):
        read_measured(machine, [both])


def test_a_zero_error_of_a_drives_sensor_is_taken_off(machine, tmp_path):
    write(tmp_path / "drive.csv", machine, 0.0, [(0.0, 0.6), (0.3, 2.0)], command="drive_signal")
    lines = (tmp_path / "drive.csv").read_text().splitlines()
    at = lines[0].split(",").index("drive_pressure_forward_bar")
    cells = [line.split(",") for line in lines[1:]]
    wrong = [",".join([*row[:at], f"{float(row[at]) + 0.8:.7g}", *row[at + 1 :]]) for row in cells]
    (tmp_path / "wrong.csv").write_text("\n".join([lines[0], *wrong, ""]))
    right, other = read_measured(machine, [tmp_path / "drive.csv", tmp_path / "wrong.csv"]).drives
    assert right.pressure > 5.0
    assert other.pressure == pytest.approx(right.pressure, abs=1e-5)


def test_a_curve_needs_three_levels_and_a_drive_its_speed(machine, tmp_path):
    with pytest.raises(
        ValueError, match="full turns to the left are at 100 % signal, but an opening curve needs 3 levels"
    ):
        calibrate_procedure(machine, [turn(tmp_path, machine, 1, 1.0, 3.0)])
    write(tmp_path / "drive.csv", machine, 0.0, [(0.0, 0.6), (0.3, 2.0)], command="drive_signal")
    with pytest.raises(ValueError, match=r"drive\.csv is a straight drive; say at which speed"):
        calibrate_procedure(machine, [tmp_path / "drive.csv"])


@pytest.mark.slow
def test_hidden_values_are_found_again(machine, tmp_path):
    logs = [
        turn(tmp_path, machine, side, level, seconds)
        for side in (1, -1)
        for level, seconds in ((1.0, 3.2), (0.75, 4.6), (0.5, 13.0))
    ]
    for side, name in ((1, "left"), (-1, "right")):
        logs.append(tmp_path / f"ramp_{name}.csv")
        write(logs[-1], machine, -0.3 * side, [(side * signal, seconds) for signal, seconds in RAMP])
    logs.append(tmp_path / "drive.csv")
    speed = write(logs[-1], machine, 0.0, [(0.0, 0.6), (0.3, 9.0)], command="drive_signal")
    found = calibrate_procedure(Machine.load("aoro_datasheet"), logs, drive_speed=speed)
    value = {key: float(found.machine.entries[key].value) for key in HIDDEN}
    # noise of 0.3 bar in 100 samples of either line, and the bracket's last straight line
    assert value["driveline.brake.disc_torque"] == pytest.approx(300.0, rel=0.01)
    for side in ("left", "right"):
        # what carries the oil is the edge's coefficient; a turn's mean is its steady flow but for 3.5 %
        known, mine = (
            one[f"{V}nominal_flow_{side}"] / np.sqrt(one[f"{V}nominal_drop_in_{side}"]) for one in (HIDDEN, value)
        )
        assert mine == pytest.approx(known, rel=0.035)
        for name in ("1V0", "1V5"):
            # openings are shares of the flow at full signal, which runs short of the nominal one at its end
            assert value[f"{V}opening_{side}_{name}"] == pytest.approx(HIDDEN[f"{V}opening_{side}_{name}"], rel=0.06)
    assert found.fits
    report = found.report
    full = [one for one in report["turns"] if one["signal_percent"] == 100.0]
    assert all(abs(one["twin_s"] - one["measured_s"]) <= 0.0101 for one in full), "to a sample"
    assert all(abs(one["relative"]) < TIME_ACCURACY for one in report["turns"])
    assert report["left_as_they_were"] == []
    assert len(list(tables(report))) == 4
