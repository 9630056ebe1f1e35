"""The catalogue: complete, off by default to the bit, vectorised, visible, and as large as its operational magnitudes say.

All effects at both ends of their ranges turn and drive side by side in two launches.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import ANGLE, COMPONENTS, Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.joint import TIGHT
from aoro_gym.effects.oil_and_hoses import COMMISSIONED_TEMPERATURE, kinematic_viscosity, relative_density
from aoro_gym.machine.machine_file import COMMISSIONED_SPREAD
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import State, pack
from aoro_gym.twin.twin import Twin
from tests.twin.physics.launch import ROUNDOFF, launch, record
from tests.twin.physics.test_fluid import Oil, modulus_kernel

IDS = [
    "sensor_delay",
    "sensor_filter",
    "sensor_gain",
    "measuring_chain",
    "engine_droop",
    "pump_response",
    "pump_limit",
    "command_delay",
    "spool_lag",
    "spool_rate",
    "dead_band",
    "valve_gain",
    "valve_hysteresis",
    "compensator_lag",
    "compensator_opening",
    "back_pressure",
    "oil_temperature",
    "oil_bulk_modulus",
    "entrained_air",
    "hose_compliance",
    "cylinder_leakage",
    "cross_port_leakage",
    "seal_friction",
    "joint_friction",
    "joint_backlash",
    "frame_compliance",
    "payload",
    "driveline_resistance",
    "tire_relaxation",
    "tire_stiffness",
    "tire_scrub",
    "soft_ground",
    "ground_slope",
]

NOISE = {
    ANGLE: np.radians(0.1),  # [rad] a step of the quantiser (12 bits)
    "pressure_a": 1e5,  # [Pa] the zero error of a transmitter
    "pressure_b": 1e5,
    "pump_pressure": 1e5,
    "drive_pressure_forward": 1e5,
    "drive_pressure_return": 1e5,
    "engine_speed": 0.5,  # [rad/s] 5 rpm
}
"""What a measured signal has to change by at least."""
RATE = 100.0

TURN = (
    (0.2, {}), (1.0, {"steering_signal": 1.0}), (0.6, {"steering_signal": 0.5}), (0.3, {"steering_signal": 0.0}),
    (0.9, {"steering_signal": -0.6}), (0.3, {"steering_signal": 0.0}),
)  # fmt: skip
DRIVE = (
    (0.2, {}), (1.5, {"drive_signal": 0.5}), (1.5, {"steering_signal": 0.6}),
    (0.8, {"steering_signal": 0.0, "drive_signal": 0.0}),
)  # fmt: skip

effects = pytest.mark.parametrize("effect", EFFECTS.values(), ids=list(EFFECTS))


def ends(effect: Effect) -> list[tuple[float, ...]]:
    """Magnitudes at the ends of the ranges, but for where the effect is absent."""
    corners = [tuple(m.low for m in effect.magnitudes), tuple(m.high for m in effect.magnitudes)]
    return [corner for corner in corners if corner != effect.none]


def batched(base: Machine, machines: Sequence[Machine]) -> Machine:
    """One machine with a variant for each of ``machines``, which differ from ``base`` in values only."""
    values = {key: [float(one.entries[key].value) for one in machines] for key in base.entries}
    return base.set({key: row for key, row in values.items() if any(value != base.entries[key].value for value in row)})


class Case(NamedTuple):
    """One twin of the comparison."""

    effect: Effect
    magnitude: tuple[float, ...]


@pytest.fixture(scope="module")
def shipped() -> Machine:
    """The machine that diagnoses start from by default."""
    return Machine.load()


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    """Every effect, absent first, then at its ends."""
    return [
        *(Case(effect, effect.none) for effect in EFFECTS.values()),
        *(Case(effect, corner) for effect in EFFECTS.values() for corner in ends(effect)),
    ]


def log(machine: Machine, cases: Sequence[Case], phases: Any, start: float) -> Mapping[str, np.ndarray]:
    """Signals (F, twins) as logged; twin 0 is the machine itself, twin i + 1 has case i."""
    machines = [machine, *(case.effect.apply(machine, *case.magnitude) for case in cases)]
    planes = [Plane(), *(case.effect.tilt(Plane(), *case.magnitude) for case in cases)]
    plane = Plane(
        slope_deg=np.array([np.asarray(p.slope_deg).item() for p in planes]),
        direction_deg=np.array([np.asarray(p.direction_deg).item() for p in planes]),
    )
    twin = Twin(len(machines), machine=batched(machine, machines), terrain=plane)
    twin.reset(joint_angle=start)
    traces = [twin.step(commands, duration, sample_every=1.0 / RATE) for duration, commands in phases]
    assert twin.diverged == []
    true = {name: np.concatenate([t[name] for t in traces if t is not None]).astype(float) for name in NOISE}
    logged = {name: values.copy() for name, values in true.items()}
    for i, case in enumerate(cases, start=1):
        column = case.effect.record(
            {name: values[:, i : i + 1] for name, values in true.items()}, RATE, *case.magnitude
        )
        for name, values in column.items():
            logged[name][:, i : i + 1] = values
    return logged


@pytest.fixture(scope="module")
def turn(shipped: Machine, cases: list[Case]) -> Mapping[str, np.ndarray]:
    """A standing turn with a pause and a way back."""
    return log(shipped, cases, TURN, -float(shipped.joint.range))


@pytest.fixture(scope="module")
def drive(shipped: Machine, cases: list[Case]) -> Mapping[str, np.ndarray]:
    """Driving off, into a bend, and to a halt."""
    return log(shipped, cases, DRIVE, 0.0)


# ---- the whole ----


def test_every_id_is_there_and_no_other(shipped: Machine):
    assert list(EFFECTS) == IDS
    assert all(effect.id == key for key, effect in EFFECTS.items())
    assert {effect.component for effect in EFFECTS.values()} == set(COMPONENTS)
    rows = json.loads(json.dumps([effect.describe(shipped) for effect in EFFECTS.values()]))
    assert [row["id"] for row in rows] == IDS
    payload = next(row for row in rows if row["id"] == "payload")
    assert payload["operational"][0]["high"] == pytest.approx(shipped.mass + 1500.0, rel=1e-12)


def test_roles_say_what_effects_move(shipped: Machine):
    """Keys that some effect moves are ``effect`` or ``both``, in every bundled machine, and no others are."""
    moved = set()
    for effect in EFFECTS.values():
        for corner in ends(effect):
            changed = effect.apply(shipped, *corner).entries
            moved |= {key for key in changed if changed[key].value != shipped.entries[key].value}
    for name in ("aoro", "aoro_datasheet"):
        entries = Machine.load(name).parameters()
        assert {entry.key for entry in entries if entry.role in ("effect", "both")} == moved
        # what only effects move is absent from the baseline
        assert all(entry.value == 0.0 for entry in entries if entry.role == "effect")


def test_commissioned_machine_holds_what_effects_move(shipped: Machine):
    fixed, both, nuisance = (shipped.entries[key] for key in ("arm.length", "tire.stiffness", "tire.damping"))
    assert fixed.commissioned == (fixed.value, fixed.value)
    tight = np.array([1.0 - COMMISSIONED_SPREAD, 1.0 + COMMISSIONED_SPREAD]) * both.value
    assert both.commissioned == pytest.approx(tight, rel=1e-12)
    assert nuisance.commissioned == nuisance.range


def test_absent_effects_change_no_bit(shipped: Machine, cases: list[Case], turn: Any, drive: Any):
    bits = pack(shipped)
    for effect in EFFECTS.values():
        assert pack(effect.apply(shipped, *effect.none)).tobytes() == bits.tobytes(), effect.id
        for plane in (Plane(), Plane(slope_deg=3.0, direction_deg=50.0)):
            assert np.array_equal(np.ravel(effect.tilt(plane, *effect.none).normal), np.ravel(plane.normal)), effect.id
    for signals in (turn, drive):
        for name, values in signals.items():
            for i, case in enumerate(cases, start=1):
                if case.magnitude == case.effect.none:
                    assert np.array_equal(values[:, i], values[:, 0]), (case.effect.id, name)


def test_every_end_shows_in_a_measured_signal(cases: list[Case], turn: Any, drive: Any):
    """Above the noise in a standing turn, or where the entry says it is hidden there, while driving."""
    for i, case in enumerate(cases, start=1):
        if case.magnitude == case.effect.none or (case.effect.id == "joint_backlash" and case.magnitude[0] == 0.0):
            continue  # pins that fit do not give
        shows = {
            manoeuvre: max(float(np.abs(v[:, i] - v[:, 0]).max()) / NOISE[name] for name, v in signals.items())
            for manoeuvre, signals in (("turn", turn), ("drive", drive))
        }
        assert shows["turn"] > 1.0, (case, shows)
        assert np.all([np.isfinite(v[:, i]).all() for v in (*turn.values(), *drive.values())])


def test_hidden_effects_hide_where_they_say(cases: list[Case], turn: Any):
    droop = next(i for i, case in enumerate(cases, start=1) if case.effect.id == "engine_droop" and any(case.magnitude))
    for name in (ANGLE, "pressure_a", "pressure_b", "pump_pressure"):
        assert np.abs(turn[name][:, droop] - turn[name][:, 0]).max() < NOISE[name]
    width = next(
        i for i, case in enumerate(cases, start=1) if case.effect.id == "valve_hysteresis" and any(case.magnitude)
    )
    rising = round(1.2 * RATE)
    # a step jumps the play at once; the pause is met late
    assert np.abs(turn[ANGLE][:rising, width] - turn[ANGLE][:rising, 0]).max() < NOISE[ANGLE]
    assert np.abs(turn[ANGLE][:, width] - turn[ANGLE][:, 0]).max() > NOISE[ANGLE]


@effects
def test_operational_magnitude_is_monotonic(effect: Effect, shipped: Machine):
    for index, magnitude in enumerate(effect.magnitudes):
        values: list[Any] = [np.full(9, none) for none in effect.none]
        values[index] = np.linspace(magnitude.low, magnitude.high, 9)
        quantities = effect.measured(shipped, *values)
        steps = [np.diff(np.broadcast_to(quantity, 9)) for quantity in quantities]
        own = steps if len(effect.magnitudes) != len(steps) or len(steps) == 1 else [steps[index]]
        if (effect.id, magnitude.name) == ("joint_backlash", "compliance"):
            assert not np.any(own), "how pins give where they touch is no play"
            continue
        assert all(np.all(step > 0.0) or np.all(step < 0.0) for step in own), effect.id
        # the sign says which way more of the magnitude goes
        falls = effect.id == "entrained_air"
        assert all(np.all(step < 0.0) == falls for step in own), effect.id


def test_worn_pins_give_the_more_the_wider_their_play(shipped: Machine):
    """As they touch along less and less, until the play is as wide as its least; a frame's own give adds to theirs."""
    soft = EFFECTS["frame_compliance"].apply(shipped, 1e-7)
    worn = EFFECTS["joint_backlash"].apply(soft, np.array([0.0, 0.5, 1.0, 8.0]) * TIGHT, 4e-8)
    np.testing.assert_allclose(worn.joint.compliance, [1e-7, 1.2e-7, 1.4e-7, 1.4e-7])
    np.testing.assert_allclose(worn.joint.backlash, np.array([0.0, 0.5, 1.0, 8.0]) * TIGHT)


@effects
def test_one_call_for_many_twins_equals_one_by_one(effect: Effect, shipped: Machine):
    many = [np.linspace(m.low, m.high, 5) for m in effect.magnitudes]
    together = pack(effect.apply(shipped, *many))
    planes = effect.tilt(Plane(), *many)
    rng = np.random.default_rng(0)
    signals = {name: rng.normal(size=(100, 5)).cumsum(axis=0) for name in NOISE}
    logged = effect.record(signals, RATE, *many)
    for i in range(5):
        one = tuple(float(values[i]) for values in many)
        alone = pack(effect.apply(shipped, *one))
        for name in ("oil", "frame_front", "tire", "joint", "steering", "driveline", "engine", "rest"):
            # array and scalar functions of NumPy may differ in the last bit of a double, which may round either way; so
            # may the last round of the rest pose, of 1 m
            for field in together.dtype[name].names or ():
                ours, theirs = together[name][field][i % len(together)], alone[name][field][0]
                if ours.dtype.names is None:
                    np.testing.assert_allclose(ours, theirs, rtol=2 * ROUNDOFF, atol=1e-14, err_msg=f"{name}.{field}")
        np.testing.assert_allclose(
            np.broadcast_to(planes.normal, (5, 3))[i], np.ravel(effect.tilt(Plane(), *one).normal), atol=1e-15
        )
        column = effect.record({name: values[:, i : i + 1] for name, values in signals.items()}, RATE, *one)
        for name in NOISE:
            np.testing.assert_allclose(logged[name][:, i : i + 1], column[name], atol=1e-12)


# ---- single effects ----


def test_modulus_on_the_host_is_the_device_law(shipped: Machine):
    for gas in (0.0, 0.005, 0.05):
        oil = shipped.set({"oil.gas_fraction": gas}).oil
        names = (
            "bulk_modulus", "bulk_modulus_slope", "gas_fraction", "polytropic_exponent", "laminar_pressure", "void_pressure",
            "solution_pressure",
        )  # fmt: skip
        pressure = np.array([0.0, 10e5, 100e5, 300e5])
        device = launch(modulus_kernel, record(Oil, **{name: getattr(oil, name) for name in names}), pressure)
        # a power in float32: its exponent rounds, times the logarithm of 300; a dozen operations beside it
        np.testing.assert_allclose(device, oil.effective_modulus(pressure), rtol=24 * ROUNDOFF)


def test_viscosity_goes_through_its_points_and_near_a_third():
    np.testing.assert_allclose(kinematic_viscosity(np.array([40.0, 75.0])), [46.0, 12.0], rtol=1e-12)
    # 80 mm²/s at 30 °C is read from the same chart, good to a tenth
    assert kinematic_viscosity(30.0) == pytest.approx(80.0, rel=0.1)


def test_warm_oil_leaks_by_viscosity_and_flows_by_density(shipped: Machine):
    hot = EFFECTS["oil_temperature"].apply(shipped, 40.0)
    before, after = COMMISSIONED_TEMPERATURE, COMMISSIONED_TEMPERATURE + 40.0
    lighter = relative_density(after) / relative_density(before)
    thinner = kinematic_viscosity(before) / kinematic_viscosity(after) / lighter
    for key, factor in (
        ("steering.cylinder.leakage", thinner),
        ("steering.cylinder.seal_viscous", 1.0 / thinner),
        ("steering.tank_line.back_pressure_ramp", 1.0 / thinner),
        ("steering.valve.nominal_flow_left", lighter**-0.5),
        ("oil.bulk_modulus", 0.8),
    ):
        assert hot.value(key) == pytest.approx(factor * np.asarray(shipped.value(key)), rel=1e-12)
    assert thinner > 3.0


def test_payload_is_a_point_on_the_frame(shipped: Machine):
    """Mass, centre and inertia about the hinge's foot add up, as of any two bodies."""
    loaded = EFFECTS["payload"].apply(shipped, 1000.0).frame.front
    front = shipped.frame.front

    def about_the_hinge(body: Any) -> np.ndarray:
        x, z = body.cog_x, body.cog_height
        central = np.array([body.inertia_xx, body.inertia_yy, body.inertia_zz])
        return np.array(
            [body.mass, body.mass * x, body.mass * z, *(central + body.mass * np.array([z**2, x**2 + z**2, x**2]))]
        )

    x, z = front.axle_distance, 1.5
    point = 1000.0 * np.array([1.0, x, z, z**2, x**2 + z**2, x**2])
    np.testing.assert_allclose(about_the_hinge(loaded), about_the_hinge(front) + point, rtol=1e-12)


def test_soft_ground_bears_like_a_spring_in_series(shipped: Machine):
    """p = k z carries W at z; the towed wheel's resistance is Bekker's 0.75 √(z/D)."""
    soft = EFFECTS["soft_ground"].apply(shipped, 0.1)
    sinkage = 2.0 * shipped.tire.radius * (0.1 / 0.75) ** 2
    load = 9.81 * np.asarray(shipped.mass) / 4.0
    assert load / soft.tire.stiffness == pytest.approx(load / shipped.tire.stiffness + sinkage, rel=1e-12)
    assert soft.tire.rolling_resistance == pytest.approx(shipped.tire.rolling_resistance + 0.1, rel=1e-12)


def test_slopes_add_up():
    """On a plane that already leans, gradients add: height at any place is the sum of both."""
    plane = EFFECTS["ground_slope"].tilt(Plane(slope_deg=5.0, direction_deg=30.0), 0.03, np.array([-0.02, 0.0, 0.05]))
    x, y = 3.0, -2.0
    expected = Plane(slope_deg=5.0, direction_deg=30.0).height(x, y) + x * np.tan(0.03) + y * np.tan([-0.02, 0.0, 0.05])
    np.testing.assert_allclose(plane.height(x, y), expected, rtol=1e-12)


@pytest.mark.parametrize(("key", "magnitude"), [("tire_stiffness", 0.5), ("payload", 1500.0), ("soft_ground", 0.15)])
def test_tires_and_loads_leave_the_frames_geometry_and_stand_still(key: str, magnitude: float, shipped: Machine):
    """Wheels, pivots and hulls stay where they are on the frames; the machine sinks by what the tires give, and rests."""
    changed = EFFECTS[key].apply(shipped, magnitude)
    before, after = pack(shipped), pack(changed)
    assert before["corner"].tobytes() == after["corner"].tobytes()
    for half in ("frame_front", "frame_rear"):
        assert before[half]["pivot_x"] == after[half]["pivot_x"]
    sunk = np.asarray(changed.rest.deflection_front) - np.asarray(shipped.rest.deflection_front)
    assert sunk > 5e-3
    assert changed.rest.height == pytest.approx(-sunk, abs=1e-12)
    twin = Twin(machine=changed)
    start = twin.state.numpy()[State.Z, 0]
    twin.step({}, 0.5)
    # a rest pose that missed the tires' bend would drop or rise by it; the oil's and the dry friction's own settling is less
    assert abs(twin.state.numpy()[State.Z, 0] - start) < 0.02 * sunk


def test_mount_with_little_compliance_is_nearly_the_rigid_joint(shipped: Machine):
    """No mount, and the stiffest: 5e-9 rad/(N m) of the oil's 3e-7 (1.8 to 4.1 MN m/rad) and a first peak that moves by
    less than the measured angle's noise."""
    compliance = np.array([0.0, 1e-15])
    twin = Twin(2, machine=shipped.set({"joint.compliance": compliance}))
    twin.reset(joint_angle=-float(shipped.joint.range))
    trace = twin.step({"steering_signal": 1.0}, 0.5, sample_every=0.01)
    assert trace is not None
    angle = trace[ANGLE]
    assert 0.0 < np.abs(angle[:, 1] - angle[:, 0]).max() < NOISE[ANGLE]


# ---- a user's own ----


def test_a_user_adds_an_effect(shipped: Machine):
    weak_relief = MachineEffect(
        id="weak_relief",
        component="valve",
        physics="The ports' shock valves open early.",
        sign="+: lower setting",
        magnitudes=(Magnitude("drop", "Pa", 0.0, 1e7, "E"),),
        operational=(
            Operational("opening pressure of a shock valve", "Pa", lambda m, drop: m.steering.valve.shock_pressure),
        ),
        change=lambda machine, drop: {"steering.valve.shock_pressure": -drop},
    )
    catalogue = {**EFFECTS, weak_relief.id: weak_relief}
    weak = catalogue["weak_relief"].apply(shipped, np.array([0.0, 5e6]))
    np.testing.assert_allclose(weak.steering.valve.shock_pressure, [21e6, 16e6])
    assert weak_relief.measured(shipped, 5e6) == (pytest.approx(16e6),)
    assert Twin(2, machine=weak).diverged == []


def test_a_cause_is_a_machine_file(tmp_path: Any, shipped: Machine):
    path = tmp_path / "cause.toml"
    EFFECTS["seal_friction"].apply(shipped, 1234.5).save(path)
    loaded = Machine.load(path)
    assert loaded.entries["steering.cylinder.seal_preload"].source == "effect seal_friction"
    assert loaded.steering.cylinder.seal_preload == pytest.approx(shipped.steering.cylinder.seal_preload + 1234.5)


def test_effects_combine(shipped: Machine):
    both = EFFECTS["payload"].apply(EFFECTS["tire_stiffness"].apply(shipped, 0.8), 500.0)
    assert both.mass == pytest.approx(shipped.mass + 500.0)
    assert both.tire.stiffness == pytest.approx(0.8 * shipped.tire.stiffness)


@pytest.mark.parametrize(
    ("magnitude", "message"),
    [
        ((), "has 0 magnitudes, but takes preload"),
        ((1.0, 2.0), "has 2 magnitudes, but takes preload"),
        ((np.nan,), "preload is nan, but must be a finite number"),
        ((np.zeros((2, 2)),), "must be a finite number, or one a twin"),
        ((-1e4,), r"seal_preload = .* must be finite and at least 0 N"),
    ],
)
def test_wrong_magnitudes_are_named(magnitude: Any, message: str, shipped: Machine):
    with pytest.raises(ValueError, match=message):
        EFFECTS["seal_friction"].apply(shipped, *magnitude)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scale": "cubic"}, "scale of magnitude .* is 'cubic'; choose one of: linear, log"),
        ({"none": 2.0}, r"none of magnitude .* is 2.*, but must be in \[0, 1\]"),
        ({"least": 2.0}, r"least of magnitude .* is 2.*, but must be in \(0, 1\)"),
        ({"scale": "log"}, "low of magnitude .* is 0.*, but must be above 0.* on a log scale"),
    ],
)
def test_wrong_entries_are_named(options: Any, message: str):
    with pytest.raises(ValueError, match=message):
        Magnitude("size", "1", 0.0, 1.0, "E", **options)
    entry: dict[str, Any] = {"id": "x", "physics": "", "sign": "", "operational": ()}
    with pytest.raises(ValueError, match=r"component of effect .* is 'wings'; choose one of: sensor, pump"):
        Effect(component="wings", magnitudes=(Magnitude("size", "1", 0.0, 1.0, "E"),), **entry)
    with pytest.raises(ValueError, match="has 0 magnitudes, but must have one or two"):
        Effect(component="valve", magnitudes=(), **entry)


# ---- on the twin ----


def test_the_cut_off_and_the_back_pressure_are_what_is_measured(shipped: Machine):
    """Held against the stop the pump's pressure comes to rest at the cut-off; in the turn the return line is as high as its
    flow asks for."""
    limits, lines = EFFECTS["pump_limit"], EFFECTS["back_pressure"]
    limited, held_up, throttled = np.array([1.0, 0.6, 1.0]), np.array([8e5, 0.0, 0.0]), np.array([0.0, 0.0, 8e5])
    machine = lines.apply(limits.apply(shipped, limited), held_up, throttled)
    twin = Twin(3, machine=machine)
    twin.reset(joint_angle=-float(shipped.joint.range))
    turning = twin.step({"steering_signal": 1.0}, 1.4, sample_every=0.01)
    held = twin.step({}, 6.0, sample_every=0.5)
    assert turning is not None
    assert held is not None
    cutoff = limits.measured(shipped, limited)[0]
    # ε̇ vanishes with the error; the last tenth of a bar takes the swash's integrator some seconds
    np.testing.assert_allclose(held["pump_pressure"][-1], cutoff, rtol=5e-3)
    line = machine.steering.tank_line
    flow = turning["flow_out"][90:130]
    expected = line.back_pressure + line.back_pressure_ramp * flow / line.back_flow + throttled * (flow / 1e-3) ** 2
    # all of it comes through the outer edge but for leaks and a quasi-steady line: below 1 L/min, 2 % of the ramp of 1 bar;
    # of a flow near 60 L/min squared that is 2/60 of its drop
    slack = 0.05e5 + 2.0 / 60.0 * throttled
    assert np.all(np.abs(turning["return_pressure"][90:130] - expected) < slack)


LOSSES = (
    "joint.friction_torque", "steering.cylinder.seal_preload", "steering.cylinder.seal_pressure_coefficient",
    "steering.cylinder.seal_viscous", "steering.cylinder.leakage", "steering.valve.leakage", "tire.rolling_resistance",
    "tire.sigma1_longitudinal", "tire.sigma1_lateral", "tire.sigma2_longitudinal", "tire.sigma2_lateral",
)  # fmt: skip
GRIP = dict.fromkeys(("tire.sigma0_longitudinal", "tire.sigma0_lateral"), 1e-3)


def swaying(machine: Machine, compliance: NDArray[np.float64], cylinders: float) -> NDArray[np.float64]:
    """Frequencies (N,) [rad/s] of the joint, on mounts of a ``compliance`` (N,), that turns at 0.01 rad/s while the valve is
    shut; the cylinders, where they move on their own, at ``cylinders`` [rad/s]."""
    twin = Twin(len(compliance), machine=EFFECTS["frame_compliance"].apply(machine, compliance))
    state = twin.state.numpy()
    state[State.JOINT_RATE], state[State.MOUNT_RATE] = 0.01, cylinders
    twin.state.assign(state)
    trace = twin.step({}, 0.6, sample_every=1e-3)
    assert trace is not None
    assert trace["pressure_a"].min() > 0.0
    omega = []
    for column in trace["joint_rate"].astype(float).T:
        crossing = np.flatnonzero(np.diff(np.sign(column)))
        times = trace.time[crossing] + 1e-3 * column[crossing] / (column[crossing] - column[crossing + 1])
        omega.append(np.pi / np.mean(np.diff(times)))
    return np.array(omega)


def shut_in_stiffness(machine: Machine) -> float:
    """Σ D²/C [N m/rad] of the oil on both sides of the straight joint."""
    steering, cylinder = machine.steering, machine.steering.cylinder
    lever = cylinder.linkage.lever(0.0)
    swept = (cylinder.bore_area + cylinder.annulus_area) * lever
    half_stroke = [cylinder.linkage.extension(0.0), cylinder.stroke - cylinder.linkage.extension(0.0)]
    volume = steering.hose_volume + 2.0 * cylinder.dead_volume
    volume += cylinder.bore_area * half_stroke[0] + cylinder.annulus_area * half_stroke[1]
    modulus = machine.oil.effective_modulus(steering.tank_line.back_pressure)
    return float(np.asarray(2.0 * swept**2 / (volume / modulus + steering.hose_compliance)))


def test_compliance_lowers_the_joints_frequency(shipped: Machine):
    """Shut-in oil of stiffness K = Σ D²/C, and a mount in series: ω² falls by 1 + c K, as the inertia is the same.

    No friction, no leaks, no grip; small enough that no valve opens.
    """
    free = shipped.set({**dict.fromkeys(LOSSES, 0.0), **GRIP})
    compliance = np.array([0.0, 1e-7, 3e-7, 5e-7])
    omega = swaying(free, compliance, 0.01)
    expected = np.sqrt(1.0 / (1.0 + compliance * shut_in_stiffness(free)))
    # the modulus changes by 1e-3 over the swing of 1 bar, the mount's losses shift ω by ζ²/2 < 1e-3, seven half periods are
    # timed to some µs
    np.testing.assert_allclose(omega / omega[0], expected, rtol=3e-3)


def test_seals_hold_the_cylinders_and_not_the_frames(shipped: Machine):
    """Seals too tight to slide are a spring s beside the oil's K, in series with a mount: ω² = 1 / (I (c + 1 / (K + s))), so
    a soft frame sways on them as a rigid one without friction sways on oil, ω² = K / I."""
    free = shipped.set({**dict.fromkeys(LOSSES, 0.0), **GRIP, "joint.presliding_damping": 0.0})
    tight = free.set({"steering.cylinder.seal_preload": 1e5})
    compliance = np.array([1e-7, 3e-7, 5e-7])
    (rigid,) = swaying(free, np.zeros(1), 0.0)
    omega = swaying(tight, compliance, 0.0)
    oil, seals = shut_in_stiffness(free), free.joint.presliding_stiffness
    expected = np.sqrt(1.0 / (oil * (compliance + 1.0 / (oil + seals))))
    np.testing.assert_allclose(omega / rigid, expected, rtol=3e-3)  # as above


def test_stops_end_the_cylinders_stroke(shipped: Machine):
    """Full oil pressure against the end of the stroke bends no frame: a soft one rests where a rigid one does, within what
    the seals and the bearing hold, while a stop of the frames would bend it by the oil's torque."""
    compliance = np.array([0.0, 5e-7])
    twin = Twin(2, machine=EFFECTS["frame_compliance"].apply(shipped, compliance))
    twin.step({"steering_signal": 1.0}, 6.0)
    angle, bent = twin.state.numpy()[[State.JOINT, State.MOUNT]]
    pushed = twin.state.numpy()[State.PORT_A] - twin.state.numpy()[State.PORT_B]
    assert np.all(np.abs(pushed) > 100e5)
    assert abs(bent[1]) < 2e-3
    np.testing.assert_allclose(angle[1], angle[0], atol=2e-3)


def test_a_mount_that_bears_nothing_is_in_the_middle_of_its_play(shipped: Machine):
    """On level ground no side of it is nearer, whatever the oil does to the cylinders; on a slope it is at an edge, another
    one on the joint's other side."""
    play = 0.01
    machine = shipped.set({"joint.backlash": np.full(2, play), "joint.compliance": 5e-7}, si=True)

    def rest(slope: float, angle: float) -> Any:
        twin = Twin(2, machine=machine, terrain=Plane(slope_deg=slope))
        twin.reset(joint_angle=np.array([angle, -angle]))
        return twin.state.numpy()[State.MOUNT]

    assert np.all(rest(0.0, 0.3) == 0.0)
    left, right = rest(10.0, 0.3)
    assert left * right < 0.0
    assert min(abs(left), abs(right)) > 0.5 * play


def test_a_mount_is_bent_from_the_start_by_what_it_bears():
    """On a slope a soft frame with play stands as still as a rigid one, within 0.05 mrad; from an unbent mount it falls
    through most of half the play. The mounts of `aoro` bear less on that slope, which a reset takes for nothing: they fall,
    too; on steeper ones oil that leaks lets either joint settle by more than this bound."""
    shipped, play = Machine.load("aoro_least_squares"), 0.006
    soft = EFFECTS["frame_compliance"].apply(shipped, np.array([0.0, 5e-7]))
    machine = soft.set({"joint.backlash": np.array([0.0, play])}, si=True)
    moved = []
    for bent in (1.0, 0.0):
        twin = Twin(2, machine=machine, terrain=Plane(slope_deg=5.0))
        twin.reset(joint_angle=np.full(2, 0.3))
        state = twin.state.numpy()
        state[State.MOUNT] *= bent
        twin.state.assign(state)
        trace = twin.step({}, 0.7, sample_every=0.01)
        assert trace is not None
        moved.append(np.abs(trace["joint_angle"] - 0.3).max(axis=0))
    assert np.all(moved[0] < 5e-5)
    assert moved[1][1] > 0.25 * play


def test_every_effect_of_a_component_is_in_the_catalogue() -> None:
    components = [import_module(f"aoro_gym.effects.{name}") for name in COMPONENTS]
    assert sorted(one.id for component in components for one in component.EFFECTS) == sorted(EFFECTS)
    assert all(one.component == name for name, of in zip(COMPONENTS, components, strict=True) for one in of.EFFECTS)


@pytest.mark.parametrize(
    ("effect_id", "law", "option", "moved"),
    [
        ("spool_lag", "spool", "second_order", "steering.valve.spool_frequency"),
        ("compensator_lag", "compensator", "spring_mass", "steering.valve.compensator_frequency"),
        ("tire_scrub", "swivel", "bore_torque", "tire.bore_radius"),
        ("tire_scrub", "swivel", "five_discs", "tire.scrub_radius"),
    ],
)
def test_effects_move_what_the_machines_law_reads(
    effect_id: str, law: str, option: str, moved: str, shipped: Machine
) -> None:
    """Whatever law a component obeys, the effect changes its operational magnitude, by a parameter of that very law."""
    effect, machine = EFFECTS[effect_id], shipped.with_laws(**{law: option})
    most = [one.high for one in effect.magnitudes]
    affected = effect.apply(machine, *most)
    assert affected.value(moved) != machine.value(moved)
    default = effect.measured(shipped, *most)[0] - effect.measured(shipped, *effect.none)[0]
    change = effect.measured(machine, *most)[0] - effect.measured(machine, *effect.none)[0]
    assert np.sign(change) == np.sign(default)
    absent = effect.apply(machine, *effect.none)
    assert all(absent.value(key) == machine.value(key) for key in machine.entries)


def test_a_lag_of_second_order_is_as_long_as_one_of_first(shipped: Machine) -> None:
    """A spool of second order behind a ramp lags by 2ζ/ω: the effect adds its time constant to that."""
    second = shipped.with_laws(spool="second_order")
    valve = EFFECTS["spool_lag"].apply(second, 0.03).steering.valve
    before = second.steering.valve
    added = 2.0 * valve.spool_damping / valve.spool_frequency - 2.0 * before.spool_damping / before.spool_frequency
    assert added == pytest.approx(0.03, rel=1e-12)


def test_a_static_compensator_is_never_late(shipped: Machine) -> None:
    machine = shipped.with_laws(compensator="static")
    assert EFFECTS["compensator_lag"].measured(machine, 5.0)[0] == 0.0
