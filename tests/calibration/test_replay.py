"""A log is repeated with all its commands, on its ground and under its conditions, or the verdict says that it is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.calibration.logs import calibrate_logs
from aoro_gym.calibration.recordings import CHANNELS, FilteredLog, read_filtered_log, whitened
from aoro_gym.calibration.replay import repeat, under_conditions
from aoro_gym.calibration.verdict import Match, Verdict, _against, judge
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.recording.manifest import Manifest
from aoro_gym.simulation.log import log_columns, write_log
from aoro_gym.simulation.manoeuvres import from_file, run
from aoro_gym.terrains import Plane
from aoro_gym.twin import Twin

DRIVES = {
    # commands, and the conditions of the manifest
    "steered": ("time_s,steering_signal,drive_signal\n0,0,0\n0.6,0,0.5\n1.2,0.7,0.5\n1.8,-0.7,0.3\n2.3,0,0\n2.5,0,0\n", {}),
    "all": (
        "time_s,steering_signal,drive_signal,arm_fl,arm_rr,gear,traction_fl,parking_brake\n"
        "0,0,0,0,0,2,1,0\n0.6,0.6,0.6,0.8,0,2,0,0\n1.4,-0.6,0.6,-0.5,0.7,2,1,0\n1.9,0,0,0,0,2,1,1\n2.3,0,0,0,0,2,1,1\n",
        {"ground": {"slope_deg": 4.0, "direction_deg": 30.0, "friction": 0.8}},
    ),
    "backwards": (
        "time_s,drive_signal\n0,0\n0.6,-0.6\n2,0\n2.4,0\n",
        {"gear": 3, "oil_temperature_C": 55, "payload_kg": 800.0, "engine_speed_rpm": 1500.0},
    ),
}  # fmt: skip


def write_drive(folder: Path, name: str, machine: Machine, seed: int = 3) -> Path:
    """The log of a drive of ``machine`` under the conditions of its manifest, by the machine's sensors."""
    text, conditions = DRIVES[name]
    commands = folder / f"{name}_commands.csv"
    commands.write_text(text)
    manifest = Manifest(
        ground=conditions.get("ground", {}),
        **{key: conditions.get(key) for key in ("gear", "oil_temperature_C", "payload_kg", "engine_speed_rpm")},
    )
    twin = Twin(
        1,
        machine=under_conditions(machine, manifest),
        terrain=None if manifest.ground is None else Plane(**manifest.ground),
    )
    plan = from_file(commands)
    if manifest.gear:
        gear = {"gear": manifest.gear}
        plan = replace(plan, segments=tuple(replace(one, commands={**one.commands, **gear}) for one in plan.segments))
    recording = run(twin, plan)
    columns = log_columns(recording.time, recording.channels, rng=np.random.default_rng(seed))
    if manifest.gear:
        del columns["gear"]
    write_log(folder / f"{name}.csv", columns, conditions or None)
    return folder / f"{name}.csv"


def verdict_of(machine: Machine, recording: FilteredLog) -> Verdict:
    return judge([(recording, repeat(machine, recording))], 0, 1)


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> dict[str, FilteredLog]:
    folder = tmp_path_factory.mktemp("drives")
    return {name: read_filtered_log(write_drive(folder, name, Machine.load("aoro"))) for name in DRIVES}


@pytest.mark.parametrize("name", DRIVES)
def test_its_own_machine_leaves_noise_of_a_drive(logs, name):
    """The joint's noise has a standard deviation of 1; pressures are counted with a floor of 0.5 bar, and have less."""
    verdict = verdict_of(Machine.load("aoro"), logs[name])
    assert verdict.fits, verdict.sentence
    assert 0.3 < verdict.channels["joint_angle"].residual_std < 2.0
    assert all(match.residual_std < 1.0 for channel, match in verdict.channels.items() if channel != "joint_angle")


@pytest.mark.parametrize(
    ("name", "left_out"),
    [("steered", "drive_signal"), ("all", "arm_fl"), ("all", "traction_fl"), ("all", "gear"), ("backwards", "drive_signal")],
)  # fmt: skip
def test_without_one_of_the_commands_more_than_noise_is_left(logs, name, left_out):
    recording = logs[name]
    whole = verdict_of(Machine.load("aoro"), recording)
    commands = {key: values for key, values in recording.commands.items() if key != left_out}
    part = verdict_of(
        Machine.load("aoro"),
        replace(recording, commands=commands or {"steering_signal": 0.0 * recording.commands[left_out]}),
    )
    assert part.residual_std > 2.0 * whole.residual_std
    if left_out == "drive_signal":
        assert not part.fits
        assert (
            part.sentence.startswith("does not fit: ")
            and "no machine of this kind does what the logs say" in part.sentence
        )


@pytest.mark.parametrize("condition", ["ground", "oil_temperature_C", "payload_kg", "engine_speed_rpm", "gear"])
def test_without_one_of_the_conditions_more_than_noise_is_left(logs, condition):
    recording = logs["all" if condition == "ground" else "backwards"]
    whole = verdict_of(Machine.load("aoro"), recording)
    without = replace(recording, manifest=replace(recording.manifest, **{condition: None}))
    assert verdict_of(Machine.load("aoro"), without).residual_std > 1.3 * whole.residual_std


def test_what_is_used_and_what_not_is_said(tmp_path):
    path = write_drive(tmp_path, "backwards", Machine.load("aoro"))
    manifest = path.with_suffix(".toml")
    manifest.write_text(manifest.read_text() + 'tire_pressure_bar = 3\nfilters = ["2 Hz"]\noil_temp = 3\n')
    recording = read_filtered_log(path)
    used, warnings = "; ".join(recording.used), "; ".join(recording.warnings)
    for text in ("drive_signal", "joint_angle", "engine at 1500 rpm", "oil at 55 °C", "payload 800 kg", "gear 3"):
        assert text in used
    for text in (
        "tire_pressure_bar = 3 was not used",
        "filters (2 Hz) were not used",
        "unknown key 'oil_temp' was not read",
    ):
        assert text in warnings


def test_conditions_are_the_effects_of_the_same_name():
    machine = Machine.load("aoro")
    warm = under_conditions(machine, Manifest(oil_temperature_C=55.0, payload_kg=500.0, engine_speed_rpm=1200.0))
    expected = EFFECTS["payload"].apply(EFFECTS["oil_temperature"].apply(machine, 20.0), 500.0)
    assert warm.engine.set_speed == pytest.approx(40.0 * np.pi)
    for key, entry in expected.entries.items():
        if key != "engine.set_speed":
            assert warm.value(key) == entry.si
    with pytest.raises(ValueError, match=r"manifest turn\.toml: engine\.set_speed = "):
        under_conditions(machine, Manifest(Path("turn.toml"), engine_speed_rpm=-1.0))


def test_a_population_is_repeated_as_each_of_its_machines_alone(logs):
    machine = Machine.load("aoro")
    key = "driveline.brake.disc_torque"
    values = np.array([1.0, 1.4]) * float(machine.entries[key].value)
    both = repeat(machine.set({key: values}, check_ranges=False), logs["steered"])
    for index, value in enumerate(values):
        alone = repeat(machine.set({key: value}, check_ranges=False), logs["steered"])
        for channel in both:
            np.testing.assert_array_equal(both[channel][:, index], alone[channel][:, 0])


def test_a_zero_error_of_a_sensor_is_no_misfit():
    """Samples of white noise with a common shift: whitened, they have a mean square of 1."""
    rng = np.random.default_rng(0)
    shifted = 0.3 * rng.standard_normal((100, 4000)) + 2.0 * rng.standard_normal(4000)
    white = whitened(shifted, 0.3, 2.0)
    np.testing.assert_allclose(np.mean(white**2), 1.0, rtol=0.02)
    np.testing.assert_allclose(np.mean(100.0 * np.mean(white, axis=0) ** 2), 1.0, rtol=0.1)  # of the mean alone
    assert np.mean(whitened(shifted, 0.3, 0.0) ** 2) > 20.0


def test_every_channel_is_shown_by_state_and_output():
    twin = Twin(1)
    state, trace = twin.state.numpy(), twin.step({}, 0.01, sample_every=0.01)
    assert trace is not None
    for name, channel in CHANNELS.items():
        assert trace[name][0, 0] == pytest.approx(
            float(state[channel.state, 0]), rel=0.02, abs=2e4 if "pressure" in name else 1e-3
        )


def alien(path: Path) -> Path:
    """The log of something else: its joint swings back and forth under a constant signal."""
    time = np.arange(0.0, 3.0, 0.01)
    moving = np.maximum(time - 0.5, 0.0)
    angle = 0.35 * np.sin(2.2 * moving) + 2e-4 * np.random.default_rng(0).standard_normal(len(time))
    rows = np.column_stack([time, np.where(time >= 0.5, 0.8, 0.0), angle])
    np.savetxt(path, rows, delimiter=",", header="time_s,steering_signal,joint_angle_rad", comments="")
    return path


def test_a_log_of_another_machine_gets_a_verdict(tmp_path):
    keys = ["steering.valve.nominal_flow_left", "joint.friction_torque"]
    found = calibrate_logs(
        Machine.load("aoro_datasheet"), [alien(tmp_path / "alien.csv")], keys=keys, starts=1, population=4
    )
    assert not found.fits
    verdict = found.report["verdict"]
    assert verdict["sentence"].startswith("does not fit: ")
    assert verdict["residual_std"] > 100.0  # not cut off where the search's are
    assert verdict["channels"]["joint_angle"]["unexplained_share"] > 0.5
    assert "does not fit" in found.machine.entries[keys[0]].source


def match(std: float, share: float, *, fits: bool) -> Match:
    return Match(std, share, 0.03, fits)


@pytest.mark.parametrize(
    ("channels", "fit_for", "said"),
    [
        (
            {"joint_angle": (1.0, 0.004), "pressure_a": (1.2, 0.02), "pressure_b": (0.9, 0.02)},
            "control training diagnosis", "diagnosis: yes",
        ),
        ({"joint_angle": (1.0, 0.004)}, "control training", "diagnosis: no, no log of pressure a and pressure b"),
        (
            {"joint_angle": (2.0, 0.004), "pressure_a": (12.0, 0.2), "pressure_b": (0.9, 0.02)}, "control training",
            "diagnosis: no, beyond 3 standard deviations of noise: pressure a by 12",
        ),
        (
            {"joint_angle": (9.0, 0.02), "pressure_a": (40.0, 0.9), "pressure_b": (0.9, 0.02)}, "",
            "no, 2 % of the joint's movement are left, where 1 % may be; training: no, beyond their bounds: pressure a",
        ),
    ],
)  # fmt: skip
def test_what_a_twin_is_fit_for(channels, fit_for, said):
    matches = {name: match(std, share, fits=share < 0.5) for name, (std, share) in channels.items()}
    against = _against(matches)
    assert [use for use, why in against.items() if not why] == fit_for.split()
    assert said in "; ".join(f"{use}: {'no, ' + why if why else 'yes'}" for use, why in against.items())


def test_a_judged_recording_says_what_it_is_fit_for(logs):
    verdict = verdict_of(Machine.load("aoro"), logs["steered"])
    assert verdict.fit_for["training"]
    assert verdict.serves.startswith("fit for control: ")
