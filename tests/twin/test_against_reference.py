"""The stepped float32 twin against the continuous float64 reference: two independent writings of one model.

The reference (:mod:`tests.oracles.machine`) starts from the state that the twin's reset leaves, gets the same commands,
and is integrated by an implicit variable-step solver, converged to 1e-4 of every signal's peak. What is left is the twin's
time stepping, its float32, and whatever one of the two got wrong.

The solver takes a minute a run, so two of its trajectories are stored, with digests of what they were computed from;
``python -m tests.twin.test_against_reference`` computes them anew, and a slow test compares.

Impacts amplify: a first-order error of the substeps shifts the bounce off the stop and, with it, all that follows. So
signals are held tightly up to the first touch of the stop, and more loosely after it; that the looser error is one of
the step shows in its fall with the step.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym.calibration.procedure import measured_curve
from aoro_gym.machine import Machine
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests import oracles
from tests.oracles.machine import MachineOracle

STORED = Path(__file__).with_name("reference")
SAMPLE = 1e-3
# channel of the twin: output of the reference, index in it
SIGNALS: dict[str, tuple[str, Any]] = {
    **{
        name: (name, ...)
        for name in (
            "joint_angle", "joint_rate", "joint_flow", "pressure_a", "pressure_b", "pump_pressure", "return_pressure",
            "ls_pressure", "spool", "compensator", "drive_pressure_forward", "drive_pressure_return",
            "charge_pressure", "engine_speed", "engine_torque",
        )
    },
    "pump_swash": ("swash", ...),
    **{f"wheel_rate_{wheel}": ("wheel_rate", i) for i, wheel in enumerate(WHEELS)},
    **{f"arm_angle_{wheel}": ("arm_angle", i) for i, wheel in enumerate(WHEELS)},
    **{f"arm_pressure_bore_{wheel}": ("bore_pressure", i) for i, wheel in enumerate(WHEELS)},
    **{f"arm_pressure_rod_{wheel}": ("rod_pressure", i) for i, wheel in enumerate(WHEELS)},
    **{f"position_{axis}": ("position", i) for i, axis in enumerate("xyz")},
}  # fmt: skip

# state of the reference: rows of the twin
ROWS = {
    "position": ("X", "Y", "Z"), "quaternion": ("QW", "QX", "QY", "QZ"), "theta": ("JOINT",), "phi": "ARM",
    "psi": "WHEEL", "velocity": ("VX", "VY", "VZ"), "angular_velocity": ("WX", "WY", "WZ"),
    "theta_rate": ("JOINT_RATE",), "phi_rate": "ARM_RATE", "wheel_rate": "SPIN", "joint_bristle": ("JOINT_FRICTION",),
    "arm_bristle": "ARM_FRICTION", "wheel_bristle": "WHEEL_FRICTION",
    "tire_bristle": tuple(f"BRISTLE_{axis}_{w.upper()}" for w in WHEELS for axis in "XY"), "supply": ("SUPPLY",),
    "a": ("PORT_A",), "b": ("PORT_B",), "return_line": ("TANK_LINE",), "load_sensing": ("LS_PRESSURE",),
    "spool": ("SPOOL",), "compensator": ("COMPENSATOR",), "swash": ("SWASH",), "bore": "ARM_BORE", "rod": "ARM_ROD",
    "arm_spool": "ARM_SPOOL", "drive_forward": ("FORWARD",), "drive_return": ("BACK",), "wheel_line": "HOSE",
    "charge": ("CHARGE",), "drive_swash": ("DRIVE_SWASH",), "fraction_front": ("SHIFT_FRONT",),
    "fraction_rear": ("SHIFT_REAR",), "traction_opening": "TRACTION", "engine_speed": ("ENGINE_SPEED",),
    "governor": ("GOVERNOR",), "engine_torque": ("ENGINE_TORQUE",),
}  # fmt: skip

Schedule = list[tuple[float, Mapping[str, float]]]


def reset_state(twin):
    """States of the first twin as the reference names them."""
    row = twin.state.numpy()[:, 0].astype(float)
    start = {}
    for name, rows in ROWS.items():
        names = [f"{rows}_{w.upper()}" for w in WHEELS] if isinstance(rows, str) else rows
        start[name] = np.array([row[State[n]] for n in names])
    return start


def run_twin(machine, schedule: Schedule, duration, joint_angle, main_step=1e-3, substeps=30):
    """Signals of the twin by name, one a SAMPLE, and the states that its reset left, as the reference names them."""
    twin = Twin(1, machine=machine, main_step=main_step, substeps=substeps)
    twin.reset(joint_angle=joint_angle)
    start = reset_state(twin)
    edges = [when for when, _ in schedule] + [duration]
    phases = [(edges[0], {})] if edges[0] > 0.0 else []
    phases += [(end - when, commands) for (when, commands), end in zip(schedule, edges[1:], strict=True)]
    traces = [twin.step(commands, round(length, 6), sample_every=SAMPLE) for length, commands in phases]
    assert not twin.diverged
    signals = {name: np.concatenate([t[name] for t in traces if t])[:, 0].astype(float) for name in SIGNALS}
    return signals, start


def run_reference(machine, schedule: Schedule, duration, start, tolerance=1e-6):
    """Instants and outputs of the reference by name, one a SAMPLE from the first on."""
    groups = {"arms": np.zeros(4), "traction": np.ones(4)}
    steps = []
    for when, commands in schedule:
        change: dict[str, Any] = {}
        for name, value in commands.items():
            stem, _, wheel = name.rpartition("_")
            if wheel in WHEELS:
                group = {"arm": "arms", "traction": "traction"}[stem]
                groups[group] = change[group] = groups[group].copy()
                groups[group][WHEELS.index(wheel)] = value
            else:
                change[name] = value
        steps.append((when, change))
    oracle = MachineOracle(machine)
    times = SAMPLE * np.arange(round(duration / SAMPLE) + 1)
    y = oracle.integrate(start, steps, times, rtol=tolerance, atol=tolerance)
    outputs = oracle.outputs(times, y)
    return times[1:], {name: outputs[source][i][..., 1:] for name, (source, i) in SIGNALS.items()}


def deviation(twin, reference, name, where=slice(None)):
    """Largest difference over ``where``, as a share of the reference's peak."""
    return np.abs(twin[name] - reference[name])[where].max() / np.abs(reference[name]).max()


# --------------------------------------------------------------------------------------------------- stored references
TURN: Schedule = [(0.1, {"steering_signal": 1.0})]
TURN_DURATION = 2.7
RAISE = {f"arm_{wheel}": signal for wheel, signal in zip(WHEELS, (0.6, 0.6, 0.5, 0.5), strict=True)}
RAISING: Schedule = [(0.1, RAISE), (1.0, dict.fromkeys(RAISE, 0.0))]
RUNS: dict[str, tuple[Schedule, float, float, float]] = {
    "turn": (TURN, TURN_DURATION, -1.0, 1e-6),
    "raising": (RAISING, 1.5, 0.0, 1e-5),
}
"""Schedule, duration [s], joint angle in its range's half, and the solver's tolerance."""


def computed_from(name: str, machine) -> str:
    """Digest of all that decides a stored reference, but the state that it starts from."""
    made = hashlib.sha256(json.dumps(RUNS[name]).encode())
    made.update(json.dumps({key: entry.value for key, entry in machine.entries.items()}, default=list).encode())
    for source in sorted(Path(oracles.__path__[0]).glob("[a-z]*.py")):
        if not source.name.startswith("test_"):
            made.update(source.read_bytes())
    return made.hexdigest()


def stored_reference(name: str, machine, start) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Instants and outputs by name, as :func:`run_reference` gives them."""
    with np.load(STORED / f"{name}.npz") as kept:
        assert str(kept["computed_from"]) == computed_from(name, machine), (
            f"{name}.npz is of another machine or other oracles: run python -m tests.twin.test_against_reference"
        )
        for state, values in start.items():
            np.testing.assert_allclose(kept[f"start/{state}"], values, rtol=1e-5, atol=1e-5, err_msg=state)
        return kept["times"], {signal: kept[signal].astype(float) for signal in SIGNALS}


def computed_reference(name: str, machine, start) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    schedule, duration, _, tolerance = RUNS[name]
    return run_reference(machine, schedule, duration, start, tolerance)


def start_of(name: str, machine) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Signals of the twin, and the states that its reset left."""
    schedule, duration, bent, _ = RUNS[name]
    return run_twin(machine, schedule, duration, bent * machine.joint.range)


def store() -> None:
    """Compute the references anew."""
    machine = measured_curve(Machine.load("aoro_datasheet"))
    STORED.mkdir(exist_ok=True)
    for name in RUNS:
        _, start = start_of(name, machine)
        times, outputs = computed_reference(name, machine, start)
        arrays: dict[str, Any] = {f"start/{state}": values for state, values in start.items()}
        arrays |= {signal: values.astype(np.float32) for signal, values in outputs.items()}
        made = computed_from(name, machine)
        np.savez_compressed(STORED / f"{name}.npz", times=times, computed_from=made, **arrays)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_stored_references_are_those_of_the_oracles(name, machine):
    """To ten times what the solver is converged to: a SciPy of another version takes other steps."""
    _, start = start_of(name, machine)
    times, kept = stored_reference(name, machine, start)
    instants, fresh = computed_reference(name, machine, start)
    np.testing.assert_array_equal(times, instants)
    for signal, values in fresh.items():
        if np.ptp(values):
            assert np.abs(kept[signal] - values).max() < 1e-3 * np.abs(values).max(), signal


# ------------------------------------------------------------------------------------------------------- standing turn
@pytest.fixture(scope="module")
def turn(machine):
    """Twin, instants and reference of a full left turn at full signal, and when the joint first touches the stop."""
    twin, start = start_of("turn", machine)
    times, reference = stored_reference("turn", machine, start)
    return twin, times, reference, times[np.argmax(reference["joint_angle"] > machine.joint.range)]


def test_the_whole_turn_keeps_its_flow_within_a_percent(turn):
    """At every instant, the bounces off the stop among them."""
    twin, _, reference, touch = turn
    assert 2.0 < touch < 2.3
    assert np.ptp(reference["joint_angle"]) > np.radians(80.0)
    assert deviation(twin, reference, "joint_flow") < 0.01


def test_up_to_the_stop_twin_and_reference_agree(turn):
    """Every signal within 1 % of its peak, the flow within 0.2 %."""
    twin, times, reference, touch = turn
    free = times < touch - 5e-3
    # The compensator crosses its stroke in 3 ms: a substep more or less is 1 % of it, at each of several crossings.
    bounds = {"compensator": 0.10, "joint_flow": 0.002}
    for name in SIGNALS:
        assert deviation(twin, reference, name, free) < bounds.get(name, 0.01), name


def test_up_to_the_stop_the_deviation_is_one_of_the_substep(turn, machine):
    """Half the substep halves it: first order, and to nothing; a wrong law would leave a remainder."""
    twin, times, reference, touch = turn
    free = times < touch - 5e-3
    half, _ = run_twin(machine, TURN, TURN_DURATION, -machine.joint.range, substeps=60)
    quarter, _ = run_twin(machine, TURN, TURN_DURATION, -machine.joint.range, substeps=120)
    for name in ("pump_swash", "pump_pressure", "compensator", "ls_pressure"):
        usual = deviation(twin, reference, name, free)
        # the compensator's own step, two halves of an implicit one, converges faster than the rest
        least = 0.1 if name == "compensator" else 0.4
        assert least * usual < deviation(half, reference, name, free) < 0.6 * usual, name
        assert deviation(quarter, reference, name, free) < 0.35 * usual, name


def test_impacts_leave_the_pressures_within_a_percent_of_the_circuit_s(turn):
    """After the stop: pressures of one circuit against the largest in it, rates and angles against their own peak."""
    twin, _, reference, _ = turn
    circuits = (
        ("pump_pressure", "pressure_a", "pressure_b", "return_pressure", "ls_pressure"),
        ("drive_pressure_forward", "drive_pressure_return", "charge_pressure"),
        tuple(name for name in SIGNALS if name.startswith("arm_pressure")),
    )
    for circuit in circuits:
        largest = max(np.abs(reference[name]).max() for name in circuit)
        for name in circuit:
            assert np.abs(twin[name] - reference[name]).max() < 0.01 * largest, name
    for name in SIGNALS:
        if name.startswith(("joint", "wheel_rate", "arm_angle", "position", "engine")):
            assert deviation(twin, reference, name) < 0.015, name


def test_bounces_come_closer_with_the_step(turn, machine):
    """Half the main step and half the substep: less than half as far off, voids on the emptied side included."""
    twin, times, reference, touch = turn
    fine, _ = run_twin(machine, TURN, TURN_DURATION, -machine.joint.range, main_step=5e-4)
    for name in ("joint_flow", "pressure_b", "return_pressure"):
        bounces = times > touch
        assert deviation(fine, reference, name, bounces) < 0.5 * deviation(twin, reference, name, bounces), name


# ------------------------------------------------------------------------------------------------ driving, and the arms
@pytest.mark.slow
def test_driving_steering_shifting_and_braking(machine):
    schedule: Schedule = [
        (0.1, {"drive_signal": 0.6}),
        (1.0, {"steering_signal": 0.6}),
        (1.5, {"gear": 2, "traction_fl": 0.2}),
        (2.0, {"drive_signal": -0.3, "gear": 3, "steering_signal": 0.0}),
        (2.8, {"parking_brake": 1.0, "drive_signal": 0.0}),
    ]
    twin, start = run_twin(machine, schedule, 3.3, 0.0)
    times, reference = run_reference(machine, schedule, 3.3, start, tolerance=1e-5)
    assert np.ptp(reference["position_x"]) > 0.5 and np.ptp(reference["joint_angle"]) > 0.2
    rolling = times < 2.8
    # once the valve is shut the pump rings at idle, damped by little but its leakage: its phase drifts between the two
    looser = {"compensator": 0.10, "pump_swash": 0.10, "pump_pressure": 0.03}
    for name in SIGNALS:
        if name == "joint_flow":  # meaningful only in the direction of a turn
            continue
        assert deviation(twin, reference, name, rolling) < looser.get(name, 0.02), name

    # The parking brake snaps: the wheels ring at 20 to 100 Hz, and the instant at which one sticks is known to a step.
    # Half the step is nearly half as far off.
    fine, _ = run_twin(machine, schedule, 3.3, 0.0, main_step=5e-4, substeps=15)
    for name in SIGNALS:
        if name.startswith(("wheel_rate", "arm_pressure")):
            coarse = deviation(twin, reference, name, ~rolling)
            assert coarse < 0.08, name
            assert deviation(fine, reference, name, ~rolling) < 0.6 * coarse, name


def test_raising_the_machine_on_its_arms(machine):
    twin, start = start_of("raising", machine)
    _, reference = stored_reference("raising", machine, start)
    assert np.ptp(reference["arm_angle_fl"]) > 0.1 and reference["position_z"][-1] > 0.05
    still = ("joint", "position_y", "spool")  # nothing moves there but rounding errors
    # The twin's arm spools move once a main step, so that the load-sensing line learns of a closed valve up to 1 ms late.
    bounds = {"ls_pressure": 1e-3 / machine.steering.pump.ls_time_constant}
    for name in SIGNALS:
        if not name.startswith(still):
            assert deviation(twin, reference, name) < bounds.get(name, 0.02), name


if __name__ == "__main__":
    store()
