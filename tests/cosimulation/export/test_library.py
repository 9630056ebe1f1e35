"""The library of C: equal to the Python twin to the bit, its checks, its states."""

import math
import os
import shutil
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.terrains import Plane
from tests.cosimulation.export.library import Exported, assert_same_bits, portable_twin, run_twin

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "c"


def turn(signal):
    return lambda step: {"steering_signal": signal} if step == 5 else {}


def drive(step):
    """Straight on, a gear up under way, an arm raised, and the brake."""
    return {
        5: {"drive_signal": 0.5},
        60: {"gear": 2.0},
        90: {"arm_fl": 0.4, "steering_signal": -0.3},
        120: {"drive_signal": 0.0, "parking_brake": 1.0, "traction_rr": 0.5},
    }.get(step, {})


@pytest.mark.parametrize(
    ("schedule", "angle"), [(turn(1.0), -0.6), (turn(-0.5), 0.4), (drive, 0.0)], ids=["left", "right", "drive"]
)
def test_manoeuvres_are_those_of_the_python_twin_to_the_bit(schedule, angle, library, shipped):
    twin = Exported(library)
    assert twin.set({"initial.joint_angle": angle}) == [0]
    assert twin.reset() == 0
    found = twin.run(schedule, 150)
    assert_same_bits(found, run_twin(portable_twin(shipped), schedule, 150, joint_angle=angle))
    assert np.abs(found[-1]).max() > 0.0


@pytest.mark.parametrize("name", ["payload", "seal_friction", "joint_backlash", "frame_compliance", "entrained_air"])
def test_parameters_of_an_effect_give_the_bits_of_the_effect(name, library, shipped):
    effect = EFFECTS[name]
    machine = effect.apply(shipped, *(0.5 * (one.low + one.high) for one in effect.magnitudes))
    changed = {key: float(one.value) for key, one in machine.entries.items() if one.value != shipped.entries[key].value}
    assert changed
    twin = Exported(library)
    assert set(twin.set(changed)) == {0}
    assert twin.reset() == 0
    assert_same_bits(twin.run(turn(1.0), 60), run_twin(portable_twin(machine), turn(1.0), 60))


def test_a_plane_is_the_python_twins_to_the_bit(library, shipped):
    plane = Plane(slope_deg=6.0, direction_deg=130.0, friction=0.7, rolling_resistance=3.0)
    twin = Exported(library)
    ground = {"slope": 6.0, "direction": 130.0, "friction": 0.7, "rolling_resistance": 3.0}
    pose = {"x": 3.0, "y": -2.0, "heading": 0.7, "joint_angle": 0.2}
    assert set(twin.set({f"ground.{name}": value for name, value in ground.items()})) == {0}
    assert set(twin.set({f"initial.{name}": value for name, value in pose.items()})) == {0}
    assert twin.reset() == 0
    expected = run_twin(portable_twin(shipped, plane), drive, 100, position=(3.0, -2.0), heading=0.7, joint_angle=0.2)
    assert_same_bits(twin.run(drive, 100), expected)


def test_steps_of_any_size_come_to_the_same_bits(library):
    twins = [Exported(library) for _ in range(2)]
    for twin, sizes in zip(twins, ([1] * 60, [7, 13, 40]), strict=True):
        assert twin.reset() == 0
        twin.set({"steering_signal": 1.0})
        assert [twin.advance(size) for size in sizes] == [0] * len(sizes)
    assert twins[0].save() == twins[1].save()


def test_what_is_no_value_is_refused_and_changes_nothing(library):
    twin = Exported(library)
    for name, value, message in (
        ("steering_signal", 1.01, "steering_signal is 1.01, but must be at least -1 and at most 1"),
        ("steering_signal", math.nan, "steering_signal is nan, but must be"),
        ("gear", 1.5, "gear is 1.5, but must be a whole number from 1 to 3"),
        ("steering.valve.command_delay", 0.2, "steering.valve.command_delay is 0.2 s, but must be at least 0 s and"),
        ("oil.bulk_modulus", 0.0, "oil.bulk_modulus is 0 Pa, but must be finite and above 0 Pa"),
        ("joint_angle", 0.0, "joint_angle is an output"),
    ):
        before = twin.save()
        assert twin.set({name: value}) == [1]
        assert message in twin.message
        assert twin.save() == before
    assert twin.library.c.aoro_set(twin.pointer, 10**6, 0.0) == 1
    assert math.isnan(library.c.aoro_get(twin.pointer, -1))


def test_a_machine_that_cannot_be_is_refused(library):
    for values, message in (
        ({"steering.cylinder.rod": 300.0}, "the rod fits into the bore"),
        ({"steering.cylinder.mount_ratio": 50.0}, "no mounting lets the stroke span the range"),
        ({"steering.pump.line_volume": 1e-4}, "circuits would be unstable"),
        ({"initial.joint_angle": 1.2}, "initial.joint_angle is 1.2000 rad, but the joint reaches only"),
    ):
        twin = Exported(library)
        assert set(twin.set(values)) == {0}, twin.message
        assert (twin.reset(), message in twin.message) == (1, True), twin.message
        assert twin.advance(1) == 1
        assert "stands nowhere" in twin.message


def test_a_state_goes_on_to_the_bit_and_no_other_is_taken(library):
    twin, other = Exported(library), Exported(library)
    assert (twin.reset(), twin.advance(1)) == (0, 0)
    twin.run(drive, 80)
    state = twin.save()
    assert other.restore(state) == 0
    assert_same_bits(other.run(lambda step: drive(step + 80), 60), twin.run(lambda step: drive(step + 80), 60))
    assert twin.restore(state[:-1]) == 1
    assert twin.restore(b"x" + state[1:]) == 1
    assert "no state of this library" in twin.message


def test_a_non_finite_state_is_said_and_a_reset_revives(library):
    twin = Exported(library)
    assert twin.reset() == 0
    twin.set({"steering_signal": 1.0})
    assert twin.advance(100) == 0
    rate = np.float32(twin.get("joint_rate")).tobytes()
    state = twin.save()
    assert state.count(rate) == 2, "in the state and in the outputs"
    assert twin.restore(state.replace(rate, np.float32(np.nan).tobytes(), 1)) == 0
    for _ in range(2):
        assert twin.advance(1) == 2
        assert twin.message == "simulation diverged (non-finite state at t = 0.100 s)"
    assert (twin.reset(), twin.advance(1)) == (0, 0)


def test_twins_in_threads_do_not_disturb_each_other(library):
    twins = [Exported(library) for _ in range(4)]
    found = [np.empty(0)] * 4

    def run(number):
        twins[number].reset()
        found[number] = twins[number].run(turn(0.25 * (number % 2 + 1)), 60)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert_same_bits(found[0], found[2])
    assert_same_bits(found[1], found[3])
    assert found[0].tobytes() != found[1].tobytes()


def test_names_units_and_kinds(library):
    for number, one in enumerate(library.listed):
        assert library.c.aoro_find(one.name.encode()) == number
        assert library.c.aoro_name(number).decode() == one.name
        assert library.c.aoro_unit(number).decode() == one.unit
        assert library.c.aoro_kind_of(number) == ("input", "output", "parameter").index(one.kind)
    assert library.c.aoro_find(b"nothing") == len(library.listed)
    assert library.c.aoro_name(-1) is None


def test_nothing_but_libc_and_libm_is_needed(unit):
    shown = subprocess.run(["ldd", unit("c") / "libaoro.so"], capture_output=True, text=True, check=True).stdout
    needed = {line.split()[0].split("/")[-1].split(".")[0] for line in shown.splitlines() if line.strip()}
    assert needed <= {"libc", "libm", "ld-linux-x86-64", "ld-linux-aarch64", "linux-vdso"}


def test_a_host_of_c_turns_as_python_does(unit, shipped, tmp_path):
    folder = unit("c")
    compiler = shutil.which(os.environ.get("CC", "cc")) or "cc"
    host = tmp_path / "host"
    arguments = [
        str(EXAMPLE / "host.c"),
        f"-I{folder}",
        f"-L{folder}",
        "-laoro",
        f"-Wl,-rpath,{folder}",
        "-o",
        str(host),
    ]
    subprocess.run([compiler, "-std=c11", "-Wall", "-Wextra", "-Werror", *arguments], check=True)
    shown = subprocess.run([host], env={}, capture_output=True, text=True, check=True).stdout
    found = np.array([line.split() for line in shown.splitlines()], dtype=float)
    twin = portable_twin(shipped)
    twin.reset(joint_angle=-0.6)
    trace = twin.step({"steering_signal": 1.0}, 3.0, sample_every=0.1)
    assert trace is not None
    np.testing.assert_array_equal(found[:, 1].astype(np.float32), trace["joint_angle"][:, 0])
    np.testing.assert_allclose(found[:, 2], trace["pressure_a"][:, 0].astype(float) / 1e5, rtol=1e-8)  # of nine digits
