"""The machine file and its parameters: units, validation, variants, round trip."""

import copy
import inspect
import pickle
import re
import warnings
from dataclasses import FrozenInstanceError, fields, is_dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine.machine_file import ROLES, bundled_machines
from aoro_gym.machine.parameters import DECLARATIONS, DEFAULT_PRIORS, InvalidMachine, Machine, OutsideRangeWarning
from aoro_gym.machine.quantities import UNITS
from studies.identification.members import SHIPPED

BUNDLED = files("aoro_gym").joinpath("machines", "aoro_datasheet.toml").read_text(encoding="utf-8")


def _edited(tmp_path: Path, key: str, **changes: str | None) -> Path:
    """Copy of the bundled file in which table ``key`` has fields changed (TOML text) or, if None, removed."""
    head, table, tail = re.split(rf"(^\[{re.escape(key)}\]\n(?:.+\n)+)", BUNDLED, maxsplit=1, flags=re.MULTILINE)
    for field, text in changes.items():
        line = "" if text is None else f"{field} = {text}\n"
        table, count = re.subn(rf"^{field} = .*\n", lambda _, line=line: line, table, flags=re.MULTILINE)
        if not count:
            table += line
    path = tmp_path / "edited.toml"
    path.write_text(head + table + tail, encoding="utf-8")
    return path


# --- values ---


def test_masses_sum_to_ten_tonnes(machine: Machine) -> None:
    assert machine.mass == pytest.approx(10_000.0, rel=1e-14)


def test_oil_of_a_full_turn(machine: Machine) -> None:
    """(5026.5 + 3769.9) mm² × 265 mm, known to four decimals of a litre."""
    assert machine.steering.full_turn_volume * 1e3 == pytest.approx(2.3311, abs=0.5e-4)


def test_cylinder_chambers_hold_the_oil_of_a_full_turn(machine: Machine) -> None:
    cylinder = machine.steering.cylinder
    closed, opened = (cylinder.linkage.extension(sign * machine.joint.range) for sign in (-1.0, 1.0))
    # port A feeds the right cylinder's bore, which extends to the left, and the left one's annulus
    rightmost = cylinder.bore_area * closed + cylinder.annulus_area * (cylinder.stroke - opened)
    leftmost = cylinder.bore_area * opened + cylinder.annulus_area * (cylinder.stroke - closed)
    assert leftmost - rightmost == pytest.approx(machine.steering.full_turn_volume, rel=1e-12)


def test_displacements_are_volumes_per_radian(machine: Machine) -> None:
    assert machine.steering.pump.displacement * 2.0 * np.pi == pytest.approx(140e-6, rel=1e-14)
    # 8.2 bar over one motor at full displacement is the published drop that the disc brake stands for: 367 N m, of
    # which the motor loses its own share
    motor = machine.driveline.motor
    brake = 8.2e5 * motor.displacement * motor.mechanical_efficiency
    assert brake == pytest.approx(machine.driveline.brake.disc_torque, abs=1.0)


@pytest.mark.parametrize(
    ("cv", "flow", "drop"),
    [
        ("steering.valve.cv_in_left", "steering.valve.nominal_flow_left", "steering.valve.nominal_drop_in_left"),
        ("steering.valve.cv_in_right", "steering.valve.nominal_flow_right", "steering.valve.nominal_drop_in_right"),
        ("steering.valve.cv_out_left", "steering.valve.nominal_flow_left", "steering.valve.nominal_drop_out_left"),
        ("steering.valve.cv_out_right", "steering.valve.nominal_flow_right", "steering.valve.nominal_drop_out_right"),
        ("steering.valve.cv_compensator", "steering.valve.nominal_flow_left", "steering.valve.compensator_open_drop"),
        (
            "steering.valve.cv_anticavitation",
            "steering.valve.anticavitation_flow",
            "steering.valve.anticavitation_drop",
        ),
        ("steering.pump.cv_bleed", "steering.pump.bleed_flow", "steering.pump.bleed_drop"),
        ("steering.tank_line.cv_suction", "steering.tank_line.suction_flow", "steering.tank_line.suction_drop"),
        ("arm.valve.cv", "arm.valve.nominal_flow", "arm.valve.pressure_drop"),
        ("driveline.charge.cv_check", "driveline.charge.check_flow", "driveline.charge.check_drop"),
        ("driveline.traction.cv", "driveline.traction.nominal_flow", "driveline.traction.pressure_drop"),
    ],
)
def test_orifices_pass_their_nominal_flow_at_their_nominal_drop(
    machine: Machine, cv: str, flow: str, drop: str
) -> None:
    # all inputs differ, so that a mixed-up pair cannot go unnoticed (the larger left flow sets the compensator)
    keys = [key for key in DECLARATIONS if key.endswith(("_flow", "_drop")) or "nominal_" in key]
    machine = machine.scale({key: 1.0 + 0.003 * i for i, key in enumerate(keys)})
    constant: Any = machine
    for name in cv.split("."):
        constant = getattr(constant, name)
    assert constant * np.sqrt(machine.value(drop)) == pytest.approx(machine.value(flow), rel=1e-14)


def test_hose_compliances(machine: Machine) -> None:
    steering, driveline = machine.steering, machine.driveline
    assert steering.hose_compliance == pytest.approx(0.43e-3 / 1.2e9, rel=1e-14)
    assert steering.pump.line_compliance == pytest.approx(1.5e-3 / 1.64e9, rel=1e-14)
    assert steering.tank_line.compliance == pytest.approx(1.0e-3 / 1.2e9, rel=1e-14)
    assert machine.arm.hose_compliance == pytest.approx(0.3e-3 / 1.2e9, rel=1e-14)
    assert driveline.main_compliance == pytest.approx(3.9e-3 / 1.64e9, rel=1e-14)
    assert driveline.wheel_hose_compliance == pytest.approx(0.7e-3 / 1.64e9, rel=1e-14)
    assert driveline.charge_compliance == pytest.approx(0.5e-3 / 1.64e9, rel=1e-14)


def test_signs_of_the_frames(machine: Machine) -> None:
    assert machine.frame.front.cog_x == pytest.approx(1.5)
    assert machine.frame.rear.cog_x == pytest.approx(-1.6)
    assert machine.frame.wheelbase == pytest.approx(3.4)


def test_engine_friction_meets_its_two_points(machine: Machine) -> None:
    engine = machine.engine
    for rpm, torque in ((1500.0, 64.0), (2400.0, 84.0)):
        speed = rpm * np.pi / 30.0
        # both coefficients are rounded: 0.005 N m and 0.5e-4 N m s/rad · 251 rad/s
        assert engine.friction_0 + engine.friction_1 * speed == pytest.approx(torque, abs=0.005 + 0.5e-4 * speed)


# --- units ---


@pytest.mark.parametrize(
    ("key", "value", "si"),
    [
        ("tire.stiffness", 450.0, 450e3),
        ("steering.cylinder.bore", 80.0, 0.08),
        ("joint.range", 90.0 / np.pi, 0.5),
        ("steering.pump.margin", 20.0, 2.0e6),
        ("steering.hose_volume", 0.43, 0.43e-3),
        ("steering.valve.nominal_flow_left", 60.0, 1.0e-3),
        ("driveline.pump.displacement", 40.0 * np.pi, 20e-6),
        ("driveline.motor.displacement", 0.5 * np.pi, 0.25e-3),
        ("engine.set_speed", 5000.0 / np.pi, 500.0 / 3.0),
        ("steering.valve.dead_band_left", 0.25, 0.25),
    ],
)
def test_file_units_become_si(machine: Machine, key: str, value: float, si: float) -> None:
    assert machine.set({key: value}).value(key) == pytest.approx(si, rel=1e-14)
    back = machine.set({key: si}, si=True)
    assert back.parameters(key)[0].value == pytest.approx(value, rel=1e-14)
    assert back.value(key) == pytest.approx(si, rel=1e-14)


def test_every_unit_leads_to_an_si_unit() -> None:
    assert all(UNITS[si] == (si, 1.0) for si, _ in UNITS.values())
    assert {declaration.unit for declaration in DECLARATIONS.values()} <= {si for si, _ in UNITS.values()}


# --- the bundled file ---


def test_aoro_is_bundled() -> None:
    assert "aoro" in bundled_machines()
    assert Machine.load().name == "aoro"


def test_every_parameter_is_documented(machine: Machine) -> None:
    listed = set(re.findall(r"\bS\d+\b", BUNDLED.split("\n[", 1)[0]))
    assert [parameter.key for parameter in machine.parameters()] == list(DECLARATIONS)
    for parameter in machine.parameters():
        tags = re.match(r"((?:P|A|S\d+|D|1D|R|E|C)(?:, |\b))+", parameter.source)
        assert tags, f"{parameter.key}: source {parameter.source!r} begins with no tag"
        assert set(re.findall(r"\bS\d+\b", parameter.source)) <= listed, parameter.key
        low, high = parameter.range
        assert low <= parameter.value <= high, parameter.key
        assert parameter.role in ROLES


@pytest.mark.parametrize(
    ("name", "base"),
    [
        ("aoro_datasheet", None),
        ("aoro", "aoro_datasheet"),
        ("aoro_least_squares", "aoro_datasheet"),
        ("aoro_published_inputs", "aoro_datasheet"),
        ("aoro_physical", "aoro_datasheet"),
        *((f"ensemble/0{i}", "aoro_least_squares") for i in range(1, 9)),
        *((f"structures/{name}", "aoro_datasheet") for name in SHIPPED),
    ],
)
def test_bundled_files_are_in_the_form_that_save_writes(name: str, base: str | None, tmp_path: Path) -> None:
    file = Path(str(files("aoro_gym").joinpath("machines", f"{name}.toml")))
    Machine.load(file).save(tmp_path / "copy.toml", base)
    assert (tmp_path / "copy.toml").read_text(encoding="utf-8") == file.read_text(encoding="utf-8")


def test_any_sample_of_the_ranges_is_a_valid_machine(machine: Machine) -> None:
    """Priors may be sampled without rejection: inside and at the corners of the box of uncertain parameters."""
    uncertain = [parameter for parameter in machine.parameters() if parameter.role != "fixed"]
    low, high = np.array([parameter.range for parameter in uncertain]).T[..., None]
    share = np.random.default_rng(1).uniform(size=(len(uncertain), 2000))
    share[:, 1000:] = np.round(share[:, 1000:])
    samples = low + share * (high - low)
    assert machine.set({p.key: row for p, row in zip(uncertain, samples, strict=True)}).num_variants == 2000


# --- variation ---


def test_a_machine_is_shown_in_a_line() -> None:
    machine = Machine.load("aoro")
    assert repr(machine) == f"Machine('aoro', {len(machine.entries)} parameters)"
    batch = machine.set({"joint.friction_torque": [80.0, 90.0, 100.0]})
    assert repr(batch) == f"Machine('aoro', {len(machine.entries)} parameters, 3 variants)"


def test_set_makes_a_new_machine(machine: Machine) -> None:
    changed = machine.set({"steering.valve.spool_time_constant": 0.03}, source="E: a test")
    assert changed.steering.valve.spool_time_constant == 0.03
    assert changed.parameters("spool_time_constant")[0].source == "E: a test"
    assert machine.steering.valve.spool_time_constant == 0.02
    with pytest.raises(FrozenInstanceError):
        machine.steering.valve.spool_time_constant = 0.03  # type: ignore[misc]


def test_linked_fields_follow(machine: Machine) -> None:
    changed = machine.set({"joint.range": 38.0, "arm.swing": 27.0})
    assert changed.steering.cylinder.linkage.half_range == changed.joint.range == pytest.approx(np.radians(38.0))
    assert changed.arm.cylinder.linkage.half_range == changed.arm.swing == pytest.approx(np.radians(27.0))


def test_what_data_sheets_leave_out_is_usual_and_uncertain(machine: Machine) -> None:
    found = machine.with_default_priors()
    assert found.oil.gas_fraction == 0.005 and found.tire.scrub_radius == 0.05
    for key, entry in found.entries.items():
        if key in DEFAULT_PRIORS:
            assert entry.role == "both" and entry.range[0] < entry.value < entry.range[1]
        else:
            assert entry is machine.entries[key]
    own = machine.set({"oil.gas_fraction": 0.008}).with_default_priors()
    assert own.oil.gas_fraction == 0.008, "what a file does say stays"
    again = own.set({"oil.gas_fraction": 0.0}).with_default_priors()
    assert again.oil.gas_fraction == 0.0, "a fit may have found none"


def test_scale_multiplies(machine: Machine) -> None:
    scaled = machine.scale({"frame.front.mass": 1.1, "oil.bulk_modulus": [0.5, 2.0]})
    assert scaled.frame.front.mass == pytest.approx(1.1 * 3840.0)
    np.testing.assert_allclose(scaled.oil.bulk_modulus, [0.7e9, 2.8e9])


def test_parameters_by_part_of_a_key_or_glob(machine: Machine) -> None:
    assert [p.key for p in machine.parameters("1v0")] == [
        "steering.valve.opening_left_1V0",
        "steering.valve.opening_right_1V0",
    ]
    assert [p.key for p in machine.parameters("steering.*.leakage")] == [
        "steering.valve.leakage",
        "steering.cylinder.leakage",
        "steering.pump.leakage",
    ]
    assert machine.parameters("no such thing") == []


def _derived(section: Any, path: str = "") -> dict[str, Any]:
    """Every field and property of a machine and its sections, by path."""
    values: dict[str, Any] = {}
    names = [f.name for f in fields(section)]
    names += [n for n, m in inspect.getmembers(type(section)) if isinstance(m, property | cached_property)]
    for name in names:
        value = getattr(section, name)
        if is_dataclass(value):
            values |= _derived(value, f"{path}{name}.")
        elif name not in ("name", "entries", "identity", "num_variants", "choices", "names"):
            values[path + name] = value
    return values


def test_batched_machine_equals_its_variants(machine: Machine) -> None:
    count = 5
    rng = np.random.default_rng(2)
    uncertain = [parameter for parameter in machine.parameters() if parameter.role != "fixed"]
    batch = machine.set({p.key: rng.uniform(*p.range, count) for p in uncertain})
    assert batch.num_variants == count
    together = _derived(batch)
    assert {"rest.bore_pressure_rear", "corner.inertia_ey", "steering.cylinder.linkage.g0"} <= set(together)
    for i in range(count):
        for path, alone in _derived(batch.variant(i)).items():
            value = np.broadcast_to(together[path], count)[i]
            # rounding, and the rest pose's iteration that stops below 1e-14 rad
            np.testing.assert_allclose(value, alone, rtol=1e-12, err_msg=path)


def test_one_value_is_no_batch(machine: Machine) -> None:
    single = machine.set({"frame.front.mass": [3900.0]})
    assert single.num_variants == machine.num_variants == 1
    assert single.frame.front.mass == 3900.0
    assert single.variant(0).frame.front.mass == 3900.0


def test_arrays_are_copied_and_read_only(machine: Machine) -> None:
    masses = np.array([3800.0, 3900.0])
    batch = machine.set({"frame.front.mass": masses})
    masses[0] = 0.0
    assert batch.frame.front.mass.tolist() == [3800.0, 3900.0]  # type: ignore[union-attr]
    for array in (batch.frame.front.mass, batch.value("frame.front.mass"), batch.entries["frame.front.mass"].value):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0  # type: ignore[index]


def test_a_factor_has_as_many_values_as_its_parameter(machine: Machine) -> None:
    batch = machine.set({"oil.bulk_modulus": [1.2e9, 1.4e9]})
    assert batch.scale({"oil.bulk_modulus": [1.0, 0.5]}).value("oil.bulk_modulus") == pytest.approx([1.2e9, 0.7e9])
    with pytest.raises(ValueError, match=r"oil\.bulk_modulus has 2 variants, its factor 3"):
        batch.scale({"oil.bulk_modulus": [1.0, 1.0, 1.0]})


def test_variants_that_do_not_exist(machine: Machine) -> None:
    with pytest.raises(ValueError, match=r"variant is 1, but must be in \[-1, 0\]"):
        machine.variant(1)


# --- round trip ---


def test_save_and_load(machine: Machine, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    uncertain = [parameter for parameter in machine.parameters() if parameter.role != "fixed"]
    odd = 'E: "quoted", back\\slash,\n new line, β'
    first = machine.set({p.key: float(rng.uniform(*p.range)) for p in uncertain}, source=odd)
    first.save(tmp_path / "other.toml")
    second = Machine.load(tmp_path / "other.toml")
    assert second.name == "other"
    for a, b in zip(first.parameters(), second.parameters(), strict=True):
        assert vars(a) == vars(b)
        assert a.si == b.si


@pytest.mark.parametrize("value", [1e-17, 6.67e-14, 1.0 / 3.0, 999_999.0, 1e6, 1.2345678901234567e9, 3e200])
def test_numbers_survive_the_file_exactly(machine: Machine, tmp_path: Path, value: float) -> None:
    machine.set({"steering.cylinder.seal_viscous": value}).save(tmp_path / "number.toml")
    assert Machine.load(tmp_path / "number.toml").steering.cylinder.seal_viscous == value


def test_a_batch_cannot_be_saved(machine: Machine, tmp_path: Path) -> None:
    batch = machine.set({"oil.bulk_modulus": [1.2e9, 1.4e9]})
    with pytest.raises(ValueError, match=r"oil\.bulk_modulus have 2 values.*variant"):
        batch.save(tmp_path / "batch.toml")
    batch.variant(1).save(tmp_path / "one.toml")


# --- errors of values ---


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frame.front.mass": -3840.0}, r"frame\.front\.mass = -3840 kg: must be finite and above 0 kg"),
        ({"wheel.mass": 0.0}, r"wheel\.mass = 0 kg: .* above 0 kg"),
        ({"frame.front.mass": [3800.0, -1.0]}, r"frame\.front\.mass\[1\] = -1 kg"),
        ({"frame.front.cog_offset": float("nan")}, r"frame\.front\.cog_offset = nan m: must be finite"),
        ({"steering.pump.margin": float("inf")}, r"steering\.pump\.margin = inf bar"),
        ({"steering.pump.mechanical_efficiency": 0.0}, r"= 0: must be finite and above 0 and at most 1"),
        ({"driveline.motor.mechanical_efficiency": 1.01}, r"= 1\.01: .* at most 1"),
        ({"arm.cog_fraction": 1.5}, r"arm\.cog_fraction = 1\.5: .* at least 0 and at most 1"),
        ({"oil.gas_fraction": 1.0}, r"oil\.gas_fraction = 1: .* below 1"),
        ({"oil.polytropic_exponent": 0.9}, r"polytropic_exponent = 0\.9: .* at least 1"),
        ({"oil.void_pressure": -1.02}, r"void_pressure = -1\.02 bar: .* above -1\.01325 bar and at most 0 bar"),
        ({"steering.valve.dead_band_right": 1.0}, r"dead_band_right = 1 V: .* below 1 V"),
        ({"steering.valve.command_delay": 0.101}, r"command_delay = 0\.101 s: .* at most 0\.1 s"),
        ({"steering.valve.overlap": -0.3}, r"dead_band_left = 0\.27 V, steering\.valve\.overlap = -0\.3 V: .*raise"),
        ({"steering.cylinder.seal_static_ratio": 0.9}, r"seal_static_ratio = 0\.9: .* at least 1"),
        ({"joint.range": 90.0}, r"joint\.range = 90 deg: .* below 90 deg"),
        ({"engine.set_speed": 2700.0}, r"engine\.set_speed = 2700 rpm: .* below 2600 rpm"),
        ({"frame.rear.inertia_zz": 3300.0}, r"inertia_yy = 2250 kg\*m\^2, .*inertia_zz = 3300 kg\*m\^2: .*lower"),
        ({"wheel.inertia_spin": 60.0}, r"wheel\.inertia_spin = 60 .*at most twice .*lower wheel\.inertia_spin"),
        ({"arm.inertia_axial": 17.0}, r"arm\.inertia_axial = 17 .*lower arm\.inertia_axial"),
        ({"tire.friction_static": 0.6}, r"friction_static = 0\.6, tire\.friction_coulomb = 0\.7: .*raise"),
        ({"tire.disc_offset_inner": 0.25}, r"disc_offset_inner = 0\.25 m, .*lower"),
        ({"tire.disc_drop_inner": 0.02}, r"disc_drop_inner = 0\.02 m, .*lower"),
        ({"steering.valve.opening_left_1V0": 0.8}, r"opening_left_1V0 = 0\.8, .*raise .*opening_left_1V5"),
        ({"steering.valve.opening_right_1V5": 0.1}, r"opening_right_1V5 = 0\.1: the opening curve rises"),
        ({"steering.cylinder.rod": 80.0}, r"steering\.cylinder\.rod = 80 mm, .*bore = 80 mm: .*lower"),
        ({"arm.cylinder.rod": 90.0}, r"arm\.cylinder\.rod = 90 mm"),
        (
            {"steering.cylinder.stroke": 600.0},
            r"steering\.cylinder\.stroke = 600 mm, .*dead_length = 0\.505 m: .*lower",
        ),
    ],
)
def test_impossible_values(machine: Machine, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        machine.set(changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"steering.cylinder.mount_ratio": 0.2},
            r"steering\.cylinder\.stroke = 265 mm, .*dead_length = 0\.505 m, .*mount_ratio = 0\.2, joint\.range = 40",
        ),
        ({"steering.cylinder.dead_length": 0.27, "joint.range": 70.0}, r"dead_length = 0\.27 m, .*no mounting"),
        ({"arm.cylinder.mount_ratio": [0.55, 0.3]}, r"arm\.cylinder\.mount_ratio\[1\] = 0\.3, arm\.swing = 28 deg"),
        ({"arm.pivot_lateral": 0.8}, r"arm\.pivot_lateral = 0\.8 m, .*lower arm\.pivot_lateral"),
        ({"frame.front.axle_distance": 1.0}, r"frame\.front\.axle_distance = 1 m, .*meet at full articulation"),
        ({"frame.rear.axle_distance": 1.0}, r"frame\.rear\.axle_distance = 1 m, .*meet at full articulation"),
        ({"frame.front.cog_offset": 5.5}, r"frame\.front\.cog_offset = 5\.5 m, .*between the axles"),
        ({"tire.stiffness": 30.0, "arm.rest_angle": 5.0}, r"tire\.stiffness = 30 kN/m, .*crush"),
        ({"tire.stiffness": 1.0}, r"tire\.stiffness = 1 kN/m: the rear wheels cannot reach the ground"),
        ({"arm.rest_angle": -28.5}, r"arm\.rest_angle = -28\.5 deg, arm\.swing = 28 deg"),
        (
            {"frame.front.cog_offset": -2.5, "frame.rear.cog_offset": 1.5},
            r"frame\.rear\.cog_offset = 1\.5 m: .*would have to pull",
        ),
    ],
)
def test_machines_that_do_not_close(machine: Machine, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        machine.set(changes)


@pytest.mark.parametrize("key", ["steering.valve.spool_time_constnat", "spool_time_constant"])
def test_unknown_keys_get_a_suggestion(machine: Machine, key: str) -> None:
    for attempt in (lambda: machine.set({key: 1.0}), lambda: machine.scale({key: 1.0}), lambda: machine.value(key)):
        with pytest.raises(
            ValueError, match=r"unknown parameter .*did you mean 'steering\.valve\.spool_time_constant'"
        ):
            attempt()


def test_a_key_like_no_other_gets_none(machine: Machine) -> None:
    with pytest.raises(ValueError, match=r"unknown parameter '@@'$"):
        machine.value("@@")


@pytest.mark.parametrize("value", ["3800", True, None, 1j])
def test_values_are_numbers(machine: Machine, value: Any) -> None:
    with pytest.raises(ValueError, match=r"frame\.front\.mass = .*: must be a number"):
        machine.set({"frame.front.mass": value})


@pytest.mark.parametrize("value", [[], [[1.0, 2.0], [3.0, 4.0]]])
def test_values_are_one_a_twin(machine: Machine, value: Any) -> None:
    with pytest.raises(ValueError, match=r"frame\.front\.mass has shape"):
        machine.set({"frame.front.mass": value})


def test_numbers_of_variants_agree(machine: Machine) -> None:
    with pytest.raises(ValueError, match=r"frame\.front\.mass \(2\), frame\.rear\.mass \(3\)"):
        machine.set({"frame.front.mass": [3800.0, 3900.0], "frame.rear.mass": [3900.0, 4000.0, 4100.0]})


# --- errors of files ---


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"unit": '"stone"'}, r"wheel\.mass: unit 'stone' is unknown; use one of: kg"),
        ({"unit": '"bar"'}, r"wheel\.mass: unit 'bar' does not measure it; use one of: kg"),
        ({"unit": None}, r"wheel\.mass: lacks unit"),
        ({"value": None}, r"wheel\.mass: lacks value"),
        ({"value": '"220"'}, r"wheel\.mass = '220': must be a finite number"),
        ({"value": "true"}, r"wheel\.mass = True: must be a finite number"),
        ({"value": "nan"}, r"wheel\.mass = nan: must be a finite number"),
        ({"value": "-220"}, r"wheel\.mass = -220 kg: .* above 0 kg"),
        ({"range": "[300, 170]"}, r"wheel\.mass: range = \[300, 170\]: must be \[low, high\]"),
        ({"range": "[170]"}, r"wheel\.mass: range"),
        ({"range": "[nan, 300]"}, r"wheel\.mass: range"),
        ({"source": '""'}, r"wheel\.mass: source is empty"),
        ({"source": "5"}, r"wheel\.mass: source = 5: must be text"),
        ({"role": '"guess"'}, r"wheel\.mass: role = 'guess': must be one of fixed, nuisance, effect, both"),
        ({"colour": '"red"'}, r"wheel\.mass: unknown field colour"),
        ({"value": "220\nvalue = 221"}, r"edited\.toml is not TOML: "),
    ],
)
def test_bad_tables(tmp_path: Path, changes: dict[str, str | None], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Machine.load(_edited(tmp_path, "wheel.mass", **changes))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BUNDLED + '\n[wheel.mass]\nvalue = 1\nunit = "kg"\n', "bad.toml is not TOML: "),
        (BUNDLED.replace("[wheel.mass]", "[wheel.mas]"), r"unknown parameter 'wheel\.mas': did you mean 'wheel\.mass'"),
        (re.sub(r"\[wheel\.mass\]\n(.+\n)+", "", BUNDLED), r"missing parameters: wheel\.mass"),
        ("wheel = 3\n" + BUNDLED.replace("[wheel.", "[tire."), "bad.toml: |wheel: not a table"),
        ("mass = 3\n", "mass: not a table"),
        ("value =", "bad.toml is not TOML: "),
        ("", "missing parameters: frame.track, "),
    ],
)
def test_bad_files(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        Machine.load(path)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no bundled machine 'aorro': use one of aoro"):
        Machine.load("aorro")
    with pytest.raises(FileNotFoundError, match=r"no machine file .*none\.toml"):
        Machine.load(tmp_path / "none.toml")


def test_another_unit_of_the_same_kind_is_welcome(tmp_path: Path) -> None:
    path = _edited(tmp_path, "steering.cylinder.dead_length", value="505", unit='"mm"', range="[490, 600]")
    assert Machine.load(path).steering.cylinder.dead_length == pytest.approx(0.505, rel=1e-14)


# --- plausible ranges ---


@pytest.mark.parametrize(
    ("key", "value", "shown"),
    [
        ("steering.valve.spool_time_constant", 1e6, " = 1e+06 s: outside of its plausible range 0.008 to 0.06 s"),
        ("steering.valve.spool_time_constant", 0.07, " = 0.07 s: outside of its plausible range 0.008 to 0.06 s"),
        ("frame.front.mass", 1.0, " = 1 kg: outside of its plausible range 3200 to 4500 kg"),
        ("steering.pump.margin", 1e5, " = 100000 bar: outside of its plausible range 14 to 25 bar"),
        ("steering.valve.spool_time_constant", [0.02, 0.5, 0.7], "[1] = 0.5 s (and 1 more): outside of its plausible"),
    ],
)
def test_values_outside_of_their_plausible_range_are_named(key, value, shown) -> None:
    with pytest.warns(OutsideRangeWarning) as caught:
        machine = Machine.load("aoro").set({key: value, "wheel.mass": 215.0})
    assert [str(warning.message).startswith(f"{key}{shown}") for warning in caught] == [True]
    np.testing.assert_array_equal(machine.entries[key].value, value)  # taken all the same
    with pytest.warns(OutsideRangeWarning, match=re.escape(shown.partition(":")[2])):
        machine.scale({key: 1.01})


def test_plausible_values_pass_in_silence(machine: Machine) -> None:
    drawn = np.random.default_rng(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for entry in machine.parameters():
            if entry.role in ("nuisance", "both"):
                for value in (*entry.range, entry.value, drawn.uniform(*entry.range)):
                    try:
                        machine.set({entry.key: value})
                    except InvalidMachine:  # at this end parts do not fit together
                        continue
                machine.set({entry.key: machine.value(entry.key)}, si=True)  # rounded at the range's end
        machine.set({"steering.valve.spool_time_constant": 0.5}, check_ranges=False)
        machine.set({"steering.valve.spool_time_constant": 0.5}, ranges={"steering.valve.spool_time_constant": (0, 1)})
        EFFECTS["spool_lag"].apply(machine, 0.06)  # leaves the range on purpose


@pytest.mark.parametrize("value", [[[1.0], [2.0, 3.0]], {"a": 1}, [None, 1.0], "12", 1 + 2j, 10**400, [True, False]])
def test_what_is_no_number_is_named(machine: Machine, value) -> None:
    with pytest.raises(ValueError, match=r"^tire\.radius = .*: must be a number"):
        machine.set({"tire.radius": value})


def test_machines_are_copied_and_pickled(machine: Machine) -> None:
    varied = machine.scale({"tire.stiffness": np.array([0.9, 1.0, 1.1])})
    for made in (copy.deepcopy(varied), copy.copy(varied), pickle.loads(pickle.dumps(varied))):
        assert made.num_variants == 3
        for key, entry in varied.entries.items():
            np.testing.assert_array_equal(made.entries[key].value, entry.value)
            np.testing.assert_array_equal(made.value(key), varied.value(key))
        assert made.rest.height == pytest.approx(varied.rest.height, abs=0.0)
    with pytest.raises(ValueError, match=r"wheel\.mass = -1 kg") as refused:
        machine.set({"wheel.mass": -1.0})
    assert str(pickle.loads(pickle.dumps(refused.value))) == str(refused.value)
