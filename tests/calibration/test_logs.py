"""Calibration from logs: known parameters of a twin are found again, and what cannot be known is said."""

import numpy as np
import pytest

from aoro_gym.calibration.logs import calibrate_logs
from aoro_gym.calibration.recordings import read_filtered_log
from aoro_gym.machine import Machine
from tests.calibration.turn_logs import write_log

# Sought parameters, and the values of the machine that wrote the logs (file units).
HIDDEN = {
    "steering.valve.nominal_drop_in_left": 8.5,
    "steering.valve.spool_time_constant": 0.035,
    "steering.pump.stroke_up_time": 0.17,
    "frame.front.inertia_zz": 2400.0,
    "joint.friction_torque": 350.0,
    # a standing turn does not feel it
    "arm.valve.time_constant": 0.09,
}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    start = Machine.load("aoro_datasheet")
    machine = start.set(HIDDEN)
    logs = [
        write_log(folder / f"turn{i}.csv", machine, signal, duration, i)
        for i, (signal, duration) in enumerate([(1.0, 1.8), (-1.0, 1.5), (0.6, 1.5)])
    ]
    kept = folder / "kept"
    result = calibrate_logs(start, logs, keys=list(HIDDEN), starts=1, population=16, ensemble=3, folder=kept)
    return start, logs, result, kept


@pytest.mark.slow
def test_identified_parameters_lie_within_their_intervals(found):
    _, _, result, _ = found
    entries = {entry["key"]: entry for entry in result.report["parameters"]}
    identified = {key for key, entry in entries.items() if entry["identified"]}
    assert {
        "steering.valve.nominal_drop_in_left",
        "steering.valve.spool_time_constant",
        "steering.pump.stroke_up_time",
        "frame.front.inertia_zz",
    } <= identified
    for key in identified:
        entry = entries[key]
        # the interval is a 95 % one; half its width more covers 99.7 % of such draws
        slack = 0.25 * (entry["high95"] - entry["low95"])
        assert entry["low95"] - slack <= HIDDEN[key] <= entry["high95"] + slack, entry


@pytest.mark.slow
def test_what_the_logs_do_not_feel_is_named(found):
    _, _, result, _ = found
    assert result.report["not_felt"] == ["arm.valve.time_constant"]
    entry = result.machine.entries["arm.valve.time_constant"]
    assert entry.value == Machine.load("aoro_datasheet").entries["arm.valve.time_constant"].value
    assert not entry.source.startswith("C")


@pytest.mark.slow
def test_the_noise_is_all_that_is_left(found):
    """Residuals of a converged fit are of the order of one standard deviation, less what the floors add."""
    _, _, result, _ = found
    assert 0.2 < result.report["rms_residual_std"] < 1.5
    verdict = result.report["verdict"]
    assert verdict["fits"] and verdict["sentence"].startswith("fits: ")
    assert set(verdict["channels"]) == {"joint_angle", "pressure_a", "pressure_b", "pump_pressure"}


@pytest.mark.slow
def test_ensemble_fits_as_well_and_differs(found):
    _, _, result, _ = found
    assert len(result.ensemble) == 3
    values = np.array([[float(m.entries[k].value) for k in HIDDEN] for m in (result.machine, *result.ensemble)])
    assert len(np.unique(values, axis=0)) == 4


@pytest.mark.slow
def test_a_calibration_that_is_called_again_computes_no_search_again(found):
    start, logs, result, folder = found
    kept = (folder / "search.json").read_text()
    sentences = []
    again = calibrate_logs(
        start, logs, keys=list(HIDDEN), starts=1, population=16, ensemble=3, folder=folder,
        progress=lambda sentence, share: sentences.append(sentence),
    )  # fmt: skip
    assert (folder / "search.json").read_text() == kept
    assert not any("start" in sentence or "population" in sentence for sentence in sentences)
    assert again.report == result.report
    for one, other in zip((again.machine, *again.ensemble), (result.machine, *result.ensemble), strict=True):
        assert one.identity == other.identity


@pytest.mark.parametrize(
    ("columns", "rows", "message"),
    [
        ("time_s,joint_angle_rad", [(0.01 * i, 0.0) for i in range(200)], "neither a column steering_signal"),
        ("time_s,steering_signal", [(0.01 * i, 0.0) for i in range(200)], "no column joint_angle"),
        (
            "time_s,steering_signal,joint_angle_rad",
            [(0.01 * i, 1.0, 0.001 * i) for i in range(200)],
            "begins with 0.01 s",
        ),
        ("time_s,steering_signal,joint_angle_rad", [(0.01 * i, 0.0, 40.0) for i in range(200)], "degrees"),
        (
            "time_s,steering_signal,joint_angle_rad",
            [(0.01 * (i % 7), 0.0, 0.001 * i) for i in range(200)],
            "repeats or runs backwards",
        ),
        (
            "time_s,steering_signal,joint_angle_rad",
            [(0.1 * i, 0.0, 0.0) for i in range(200)],
            "has 10 samples a second; a calibration needs 20",
        ),
        ("time_s,steering_signal,joint_angle_rad", [(0.01 * i, 2.0, 0.0) for i in range(200)], "steering_signal is 2"),
    ],
)
def test_bad_logs_are_named(tmp_path, columns, rows, message):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([columns, *(",".join(map(str, row)) for row in rows)]))
    with pytest.raises(ValueError, match=message):
        read_filtered_log(path)
