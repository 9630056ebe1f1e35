"""Deviations that a plant can be given, each by a magnitude that can be measured on any plant whatever its laws.

An effect's size is ΔQ = Q(with) − Q(without) of its operational quantity Q, SI; zero is none. :meth:`PlantEffect.apply`
turns ΔQ into constants of the plant's own law at a level, :meth:`PlantEffect.measure` finds Q on a plant by a bench test of
the part.
Ids that begin with ``x_`` are outside of the diagnosis's catalogue.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportArgumentType=false
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.diagnosis_benchmark.plants.bodies import bodies_of
from aoro_gym.diagnosis_benchmark.plants.circuits import OPERATING, PORT_A, Engine, Lines, Valve, circuit_of
from aoro_gym.diagnosis_benchmark.plants.fluid import air_for, compressibility_of, density, oil_of, viscosity
from aoro_gym.diagnosis_benchmark.plants.friction import BEARING_RATIO, dry_law, stribeck_level
from aoro_gym.diagnosis_benchmark.plants.hydraulics import droop_slope, full_load, opening, return_flow
from aoro_gym.diagnosis_benchmark.plants.joint import Joint, bearing_torque, seal_torque, series_torque
from aoro_gym.diagnosis_benchmark.plants.plant import (
    PlantRecord,
    after_play,
    delay,
    held_wheel,
    plant_of,
    wheel_capacity,
)
from aoro_gym.diagnosis_benchmark.plants.records import Array, Constants, evaluate, f64, packed
from aoro_gym.diagnosis_benchmark.plants.sensors import angle_chain, half_gain_time
from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD, SCRUB_ANGLE, pushed

HUNDRED_BAR, TEN_BAR = 100e5, 10e5
SWIVEL = np.radians(20.0)
"""[rad] by which a wheel is swivelled to measure its scrub torque."""

Changes = dict[str, Array]
Apply = Callable[[Constants, Array, int], Changes]
Measure = Callable[[Constants, int], Array]


@dataclass(frozen=True)
class PlantEffect:
    """One deviation.

    Attributes:
        id: As in a diagnosis.
        component: Where it sits.
        quantity: Q and how it is measured.
        unit: Of Q, SI.
        low, high: Range of ΔQ that cases draw from; a share of the plant's own Q where ``relative``.
        source: Of the range.
        apply: Constants of the plant that change, by key, for ΔQ (R,), or (2, R) for two parts.
        measure: Q (R,), or (2, R), of a plant with these constants.
        parts: Names of the parts of a magnitude that has several.
        relative: Whether low and high are shares of Q.
        standing: Whether angle and pressures of a standing turn show it above their noise at full severity.
    """

    id: str
    component: str
    quantity: str
    unit: str
    low: float
    high: float
    source: str
    apply: Apply
    measure: Measure
    parts: tuple[str, ...] = ()
    relative: bool = False
    standing: bool = True


def with_effects(constants: Constants, effects: Mapping[str, ArrayLike], level: int) -> dict[str, Array]:
    """Constants of plants that have the given ΔQ by id, each a number, (R,), or (2, R); applied in the catalogue's order.

    Raises:
        ValueError: an id is unknown, or a magnitude has no physical meaning on these plants.
    """
    unknown = [name for name in effects if name not in EFFECTS]
    if unknown:
        raise ValueError(f"effect is {unknown[0]!r}; choose one of: {', '.join(EFFECTS)}")
    changed = dict(constants)
    runs = len(changed["oil.bulk_modulus"])
    for effect in EFFECTS.values():
        if effect.id in effects:
            shape = (len(effect.parts), runs) if effect.parts else (runs,)
            magnitude = np.asarray(effects[effect.id], dtype=np.float64)
            if effect.parts and magnitude.shape == (len(effect.parts),):
                magnitude = magnitude[:, None]
            changes = effect.apply(changed, np.broadcast_to(magnitude, shape), level)
            for key, value in changes.items():
                new = np.broadcast_to(value, (runs,))
                if (
                    not np.all(np.isfinite(new))
                    or (key in _POSITIVE and np.any(new <= 0.0))
                    or (key in _NON_NEGATIVE and np.any(new < 0.0))
                ):
                    worst = int(np.argmin(np.where(np.isfinite(new), new, -np.inf)))
                    raise ValueError(
                        f"{effect.id} = {magnitude.ravel()[min(worst, magnitude.size - 1)]:g} {effect.unit} makes "
                        f"{key} {new[worst]:g}, but it must be "
                        f"{'above' if key in _POSITIVE else 'at least'} 0; give a smaller magnitude"
                    )
                changed[key] = np.array(new)
    return changed


_POSITIVE = {
    "steering.pump.stroke_up_time", "steering.pump.stroke_down_time", "steering.pump.cutoff",
    "steering.valve.spool_time_constant", "steering.valve.spool_rate_limit", "steering.valve.compensator_time_constant",
    "steering.valve.compensator_open_drop", "oil.bulk_modulus", "tire.stiffness", "tire.sigma0_lateral",
    "tire.sigma0_longitudinal",
}  # fmt: skip
_NON_NEGATIVE = {
    "sensor.delay", "sensor.lag", "sensor.smoothing", "engine.droop", "steering.valve.command_delay",
    "steering.valve.hysteresis", "steering.tank_line.back_pressure", "oil.gas_fraction", "steering.cylinder.leakage",
    "steering.valve.cross_orifice", "steering.cylinder.seal_preload", "joint.friction_torque", "joint.play",
    "joint.compliance", "payload.mass", "driveline.brake.disc_torque", "tire.scrub_torque", "tire.rolling_resistance",
    "steering.pocket_a", "steering.valve.leak_a", "steering.valve.kink_b", "joint.bump", "driveline.brake.drag_fl",
    "steering.valve.shock_drop_a",
}  # fmt: skip


# ------------------------------------------------------------------------------------------------------------ bench tests
def _part(p: Constants, level: int, kind: Any) -> NDArray[Any]:
    """Records (R,) of a part of the circuits, for :func:`~aoro_gym.diagnosis_benchmark.plants.records.evaluate`."""
    name = {Joint: "joint", Valve: "valve", Lines: "lines", Engine: "engine"}[kind]
    return packed(kind, circuit_of(p, level)[name], len(p["joint.play"]))


def _edge(beyond: Callable[[Array], NDArray[Any]], low: Array, high: Array) -> Array:
    """The least number (R,) between ``low`` and ``high`` that is ``beyond``, to 1e-9 of their distance; ``beyond`` is asked
    of (points, R) and holds at ``high``."""
    each = np.arange(len(low))
    for _ in range(4):
        points = low + np.linspace(0.0, 1.0, 201)[:, None] * (high - low)
        first = np.maximum(np.argmax(beyond(points), axis=0), 1)
        low, high = points[first - 1, each], points[first, each]
    return high


def _sampled_step(constants: Constants) -> tuple[Array, Array]:
    """Time [s] and the sensor's answer (F, R) to a step of the angle by 1 rad at 0, without noise."""
    time = 1e-3 * np.arange(-100, 2000, dtype=np.float64)
    runs = len(constants["sensor.delay"])
    step = np.repeat((time >= 0.0)[:, None].astype(np.float64), runs, axis=1)
    return time, angle_chain(time, step, {**constants, "sensor.wobble": np.zeros(runs)})


def _sensor_delay(constants: Constants, level: int) -> Array:
    time, answer = _sampled_step({**constants, "sensor.lag": np.zeros_like(constants["sensor.lag"])})
    return _area(time, answer)


def _sensor_lag(constants: Constants, level: int) -> Array:
    time, answer = _sampled_step({**constants, "sensor.delay": np.zeros_like(constants["sensor.delay"])})
    return _area(time, answer)


def _area(time: Array, answer: Array) -> Array:
    """Mean age [s] of a step's answer: the area between the step and what was shown of it.

    Held samples of 1 ms: a step that is true from a sample on began half an interval before.
    """
    after = time >= 0.0
    return 1e-3 * ((1.0 - answer[after] / answer[-1]).sum(axis=0))


def _sensor_gain(constants: Constants, level: int) -> Array:
    _, answer = _sampled_step(constants)
    return answer[-1] - 1.0


def _command_delay(constants: Constants, level: int) -> Array:
    signal = np.zeros((400, len(constants["steering.valve.command_delay"])))
    signal[100:] = 1.0
    arrived = delay(signal, constants["steering.valve.command_delay"], 1e-3)
    return 0.5e-3 * (len(arrived) - 200 - arrived.sum(axis=0))


@wp.func
def _swept(m: PlantRecord, step: f64):
    """Distance between the commands, in steps of ``step``, at which the spool passes half a step below 0.5 upward and
    downward."""
    play, up, down = f64(0.0), f64(2.0), f64(-1.0)
    count, middle = int(wp.round(f64(1.0) / step)), f64(0.5) - f64(0.5) * step
    for i in range(2 * count):
        signal = wp.where(i < count, f64(i) * step, f64(1.0) - f64(i - count) * step)
        left, told = after_play(play, signal, m.half_play)
        play = left
        if i < count and told > middle:
            up = wp.min(up, signal)
        if i >= count and told < middle:
            down = wp.max(down, signal)
    return up - down - step


def _hysteresis(constants: Constants, level: int) -> Array:
    return evaluate(_swept, _plant(constants, level), PlantRecord, 1e-3)


def _plant(constants: Constants, level: int) -> NDArray[Any]:
    return packed(PlantRecord, plant_of(constants, level), len(constants["joint.play"]))


@wp.func
def _opening_left(v: Valve, volts: f64):
    return opening(v.left, v.shift, volts)


def _dead_band(constants: Constants, level: int) -> Array:
    """The smallest signal [V] that opens the port, as far as the spool lets it."""
    valves = _part(constants, level, Valve)
    low, high = np.full(len(valves), -0.5), np.full(len(valves), 1.5)
    return _edge(lambda volts: evaluate(_opening_left, valves, Valve, volts) > 1e-12, low, high)


def _droop(constants: Constants, level: int) -> Array:
    engines = _part(constants, level, Engine)
    speed = engines["set_speed"]
    slope, load = evaluate(droop_slope, engines, Engine, 0.0), evaluate(full_load, engines, Engine, speed)
    return slope * load / speed


def _stroke_time(constants: Constants, level: int) -> Array:
    return 1.0 / circuit_of(constants, level)["lines"]["swash_up"]


def _compensator_drop(constants: Constants, level: int) -> Array:
    return (OPERATING / circuit_of(constants, level)["valve"]["compensator"]) ** 2


def _valve_gain(constants: Constants, level: int) -> Array:
    valve = circuit_of(constants, level)["valve"]
    return valve["inlet"][0] * np.sqrt(valve["setting"])


def _back_pressure(constants: Constants, level: int) -> Array:
    lines = _part(constants, level, Lines)
    low, high = np.zeros(len(lines)), np.full(len(lines), 100e5)
    return _edge(lambda tank: evaluate(return_flow, lines, Lines, tank) > OPERATING, low, high)


def _kink(constants: Constants, level: int) -> Array:
    straight = {**constants, "steering.valve.kink_b": np.zeros_like(constants["steering.valve.kink_b"])}
    with_kink, without = (circuit_of(p, level)["valve"]["outlet"][0] ** -2 for p in (constants, straight))
    return OPERATING**2 * (with_kink - without)


def _wall(constants: Constants, level: int) -> Array:
    lines = circuit_of(constants, level)["lines"]
    return lines["wall"][PORT_A] + lines["cells"] * lines["hose_wall"]


def _modulus(constants: Constants, level: int, pressure: float, *, air: bool) -> Array:
    share = None if air else np.zeros_like(constants["oil.gas_fraction"])
    return 1.0 / compressibility_of(oil_of(constants, level, share), pressure)


_SPEEDS = np.concatenate([[0.0], np.logspace(-6, -1, 400)])[:, None]
"""Cylinder speeds [m/s] at which a breakaway is looked for."""


@wp.func
def _seal_friction(j: Joint, speed: f64):
    """Force [N] of one cylinder's seals without pressure."""
    sliding = seal_torque(j, f64(1.0), f64(0.0))
    if j.level == 0:
        return stribeck_level(sliding, j.static_ratio, speed, j.stribeck)
    return -dry_law(j.level, speed, sliding, sliding * j.static_ratio)


@wp.func
def _bearing_friction(j: Joint, speed: f64):
    """Torque [N m] of the bearing, away from its damaged spot."""
    torque = bearing_torque(j, f64(0.5))
    if j.level == 0:
        return torque
    return -dry_law(j.level, speed, torque / BEARING_RATIO, torque)


def _seal(constants: Constants, level: int) -> Array:
    return evaluate(_seal_friction, _part(constants, level, Joint), Joint, _SPEEDS).max(axis=0)


def _bearing(constants: Constants, level: int) -> Array:
    return evaluate(_bearing_friction, _part(constants, level, Joint), Joint, _SPEEDS).max(axis=0)


def _bump(constants: Constants, level: int) -> Array:
    torque = evaluate(bearing_torque, _part(constants, level, Joint), Joint, np.linspace(-0.5, 0.5, 401)[:, None])
    return torque.max(axis=0) - torque[-1]


@wp.func
def _twisted(j: Joint, pin: f64):
    """Torque [N m] between pins at ``pin`` [rad] and frames at 0, both at rest."""
    return series_torque(j, pin, f64(0.0), f64(0.0), f64(0.0))


def _play(constants: Constants, level: int) -> Array:
    """Width [rad] over which the pins move without torque, the frames held, from one edge: they are alike."""
    joints = _part(constants, level, Joint)
    low, high = np.zeros(len(joints)), np.full(len(joints), 0.1)
    edge = _edge(lambda pin: evaluate(_twisted, joints, Joint, pin) != 0.0, low, high)
    return np.where((joints["elastic"] == 1) & (joints["play"] > 0.0), 2.0 * edge, 0.0)


def _compliance(constants: Constants, level: int) -> Array:
    """Of frames and pins under 1 to 2 kN m, the cylinders held [rad/(N m)]."""
    joints = _part(constants, level, Joint)
    wide = joints["play"] + 0.05
    torque = evaluate(_twisted, joints, Joint, np.stack([wide, wide + 0.01]))
    elastic = joints["elastic"] == 1
    return np.where(elastic, 0.01 / np.where(elastic, torque[1] - torque[0], 1.0), 0.0)


def _lateral_stiffness(constants: Constants, level: int) -> Array:
    travel = 1e-6
    return -pushed(constants, level, [(0.0, travel, 0.0, 0.0, 1.0)])[1] / travel


def _swivel(constants: Constants, level: int) -> Array:
    steps = 200
    return -pushed(constants, level, [(0.0, 0.0, SWIVEL / steps, 0.0, 1.0)] * steps)[2]


def _towing(constants: Constants, level: int) -> Array:
    return -pushed(constants, level, [], (0.0, 0.0, 0.0, 10.0))[3] / float(NOMINAL_LOAD)


@wp.func
def _turned_brake(m: PlantRecord, travel: f64):
    """Dry torque [N m] of the rear right wheel's brake after a hundred times ``travel`` [rad] without oil pressure."""
    bristle, holding = f64(0.0), wheel_capacity(m, 3, f64(0.0))
    for _ in range(100):
        bristle = held_wheel(m, bristle, travel, holding)
    return bristle * wp.where(m.level == 0, m.brake_stiffness, holding)


def _wheel_torque(constants: Constants, level: int) -> Array:
    return evaluate(_turned_brake, _plant(constants, level), PlantRecord, 0.016)


def _drag(constants: Constants, level: int) -> Array:
    return plant_of(constants, level)["brake"][0] - constants["driveline.brake.disc_torque"]


def _slope(constants: Constants, level: int) -> Array:
    """Angles [rad] that a plumb line shows ahead and to the left."""
    gravity = bodies_of(constants, level)["gravity"]
    return np.arctan2(-gravity[:2], -gravity[2])


# ------------------------------------------------------------------------------------------------------------------ laws
def _add(key: str) -> Apply:
    """The constant ``key`` is Q itself."""
    return lambda p, magnitude, level: {key: p[key] + magnitude}


def _scale(measure: Measure, *keys: str, power: float = 1.0) -> Apply:
    """The constants ``keys`` grow as Q to ``power``."""

    def apply(p: Constants, magnitude: Array, level: int) -> Changes:
        own = measure(p, level)
        return {key: p[key] * ((own + magnitude) / own) ** power for key in keys}

    return apply


def _apply_valve_gain(p: Constants, magnitude: Array, level: int) -> Changes:
    own = _valve_gain(p, level)
    return {"steering.valve.edge_gain": (1.0 + p["steering.valve.edge_gain"]) * ((own + magnitude) / own) - 1.0}


def _apply_back_pressure(p: Constants, magnitude: Array, level: int) -> Changes:
    """Level 0: the filter's valve opens later. The others: a throttle, quadratic in the flow."""
    if level == 0 or np.any(magnitude < 0.0):
        return _add("steering.tank_line.back_pressure")(p, magnitude, level)
    return {"steering.tank_line.throttle": p["steering.tank_line.throttle"] + magnitude / OPERATING**2}


_LAMINAR_LEAKS = (
    "steering.valve.leakage", "steering.cylinder.leakage", "steering.pump.leakage", "driveline.pump.leakage",
    "driveline.pump.cross_leakage", "driveline.motor.leakage",
)  # fmt: skip
_TURBULENT = (
    "steering.valve.nominal_flow_left", "steering.valve.nominal_flow_right", "steering.valve.anticavitation_flow",
    "steering.pump.bleed_flow", "steering.tank_line.suction_flow", "driveline.charge.check_flow",
    "driveline.traction.nominal_flow",
)  # fmt: skip
MODULUS_PER_KELVIN = -0.005
"""Relative change of the oil's bulk modulus a kelvin (textbook value, range −0.4 to −0.7 %)."""


def _apply_temperature(p: Constants, magnitude: Array, level: int) -> Changes:
    """Leaks as 1/ν, orifices as 1/√ρ, viscous friction of seals and resistance of the filter as ν, modulus by −0.5 %/K."""
    before, after = p["oil.celsius"], p["oil.celsius"] + magnitude
    thicker = viscosity(after) / viscosity(before)
    lighter = np.sqrt(density(before) / density(after))
    return {
        "oil.celsius": after,
        "oil.bulk_modulus": p["oil.bulk_modulus"] * (1.0 + MODULUS_PER_KELVIN * magnitude),
        **{key: p[key] / thicker for key in _LAMINAR_LEAKS},
        **{key: p[key] * lighter for key in _TURBULENT},
        **{
            key: p[key] * thicker for key in ("steering.cylinder.seal_viscous", "steering.tank_line.back_pressure_ramp")
        },
    }


def _apply_air(p: Constants, magnitude: Array, level: int) -> Changes:
    softer = _modulus(p, level, TEN_BAR, air=True) + magnitude
    share = air_for(oil_of(p, level), softer, TEN_BAR)
    return {"oil.gas_fraction": np.where(magnitude == 0.0, p["oil.gas_fraction"], share)}


def _apply_seal(p: Constants, magnitude: Array, level: int) -> Changes:
    own = _seal(p, level)
    preload = p["steering.cylinder.seal_preload"]
    return {"steering.cylinder.seal_preload": preload + magnitude * preload / own}


def _apply_bearing(p: Constants, magnitude: Array, level: int) -> Changes:
    own = _bearing(p, level)
    return {"joint.friction_torque": p["joint.friction_torque"] * ((own + magnitude) / own)}


def _apply_scrub(p: Constants, magnitude: Array, level: int) -> Changes:
    """A torque of Dahl's form on every wheel. Level 2: a longer and wider contact patch."""
    if level != 2:
        built_up = -np.expm1(-SWIVEL / float(SCRUB_ANGLE))
        return {"tire.scrub_torque": p["tire.scrub_torque"] + magnitude / built_up}
    changed = np.flatnonzero(magnitude)
    few = {key: value[changed] for key, value in p.items()}
    wanted = _swivel(few, level) + magnitude[changed]
    low, high = few["tire.patch_gain"], np.full(len(changed), 6.0)
    for _ in range(40):
        middle = 0.5 * (low + high)
        more = _swivel({**few, "tire.patch_gain": middle}, level) > wanted
        low, high = np.where(more, low, middle), np.where(more, middle, high)
    gain = p["tire.patch_gain"].copy()
    gain[changed] = low
    return {"tire.patch_gain": gain}


def _apply_soft_ground(p: Constants, magnitude: Array, level: int) -> Changes:
    """Rolling resistance; above level 0 a rut resists motion across the wheel, too."""
    rolled = {"tire.rolling_resistance": p["tire.rolling_resistance"] + magnitude}
    return rolled if level == 0 else {**rolled, "ground.rut": p["ground.rut"] + magnitude}


_CATALOGUE = (
    PlantEffect(
        "sensor_delay", "sensor", "age of the measured joint angle", "s", 0.005, 0.05, "F 16, C 10: 0.2 ms to five samples",
        _add("sensor.delay"), _sensor_delay,
    ),
    PlantEffect(
        "sensor_filter", "sensor", "time constant of a first-order lag of the angle before the sampler", "s", 0.005, 0.05,
        "F 18: corners of 3 to 30 Hz", _add("sensor.lag"), _sensor_lag,
    ),
    PlantEffect(
        "sensor_gain", "sensor", "measured over true angle, less one", "1", -0.05, 0.05, "F 19: lever map off by 3 %",
        _add("sensor.gain_error"), _sensor_gain,
    ),
    PlantEffect(
        "measuring_chain", "sensor", "undeclared zero-phase low-pass of the logger on angle and pressures: 1/(2π f) of its "
        "frequency of half gain", "s", 0.008, 0.05, "F 18: 3 to 20 Hz", _add("sensor.smoothing"),
        lambda p, level: half_gain_time(p["sensor.smoothing"], level),
    ),
    PlantEffect(
        "engine_droop", "engine", "relative fall of the steady speed from no load to full load", "1", 0.01, 0.07,
        "D: droop 0 to 7 %", _add("engine.droop"),
        _droop,
        standing=False,
    ),
    PlantEffect(
        "pump_response", "pump", "time of pump 2's swash from zero to full at saturated error; down alike", "s", -0.6, 2.0,
        "C: 0.05 to 0.3 s", _scale(
            _stroke_time,
            "steering.pump.stroke_up_time", "steering.pump.stroke_down_time",
        ), _stroke_time, relative=True,
    ),
    PlantEffect(
        "pump_limit", "pump", "supply pressure at which the cut-off lets pump 2 hold no flow", "Pa", -0.6, 0.2,
        "C: 180 to 280 bar; lower where it is set so", _add("steering.pump.cutoff"),
        lambda p, level: circuit_of(p, level)["lines"]["cutoff"], relative=True,
    ),
    PlantEffect(
        "command_delay", "valve", "dead time from command to spool", "s", 0.003, 0.04, "C: 3 to 40 ms",
        _add("steering.valve.command_delay"), _command_delay,
    ),
    PlantEffect(
        "spool_lag", "valve", "time constant of the spool for a small step", "s", 0.005, 0.08, "C: 8 to 60 ms",
        _add("steering.valve.spool_time_constant"), lambda p, level: 1.0 / circuit_of(p, level)["valve"]["spool_pace"],
    ),
    PlantEffect(
        "spool_rate", "valve", "highest speed of the spool, strokes a second", "1/s", -0.92, -0.3,
        "C: 5 to 25; operators' ramps of 2 1/s (S14)", _add("steering.valve.spool_rate_limit"),
        lambda p, level: circuit_of(p, level)["valve"]["spool_rate"], relative=True,
    ),
    PlantEffect(
        "dead_band", "valve", "signal from 2.5 V at which the left port begins to open; the whole curve shifts", "V", -0.15,
        0.3, "C: 0.23 to 0.45 V; null offset", _add("steering.valve.curve_shift"), _dead_band,
    ),
    PlantEffect(
        "valve_gain", "valve", "flow at full signal to the left with the compensator at its setting; all edges alike",
        "m^3/s", -0.25, 0.3, "P: 62 L/min in the data sheet, 70.6 measured", _apply_valve_gain, _valve_gain, relative=True,
    ),
    PlantEffect(
        "valve_hysteresis", "valve", "width of the play between command and spool, share of the full signal; shows where "
        "the signal falls short of zero", "1", 0.02, 0.2, "C: 1 to 6 %; worn linkages more",
        _add("steering.valve.hysteresis"), _hysteresis,
    ),
    PlantEffect(
        "compensator_lag", "valve", "time of the compensator's full stroke under an excess of one setting", "s", -0.9, 4.0,
        "C: 0.2 to 30 ms", _add("steering.valve.compensator_time_constant"),
        lambda p, level: (lambda v: 1.0 / (v["compensator_rate"] * v["setting"]))(circuit_of(p, level)["valve"]),
        relative=True,
    ),
    PlantEffect(
        "compensator_opening", "valve", "drop over the fully open compensator at 60 L/min", "Pa", -0.8, 3.0,
        "F 8: kick of a compensator that starts open", _scale(
            _compensator_drop, "steering.valve.compensator_open_drop"
        ), _compensator_drop, relative=True,
    ),
    PlantEffect(
        "back_pressure", "oil_and_hoses", "pressure of the return line at 60 L/min", "Pa", 1e5, 15e5,
        "C: 1 to 6 bar; a clogged filter more", _apply_back_pressure, _back_pressure,
    ),
    PlantEffect(
        "oil_temperature", "oil_and_hoses", "oil temperature", "K", -30.0, 40.0, "C: 10 to 60 °C; F 12",
        _apply_temperature, lambda p, level: p["oil.celsius"] + 0.0,
    ),
    PlantEffect(
        "oil_bulk_modulus", "oil_and_hoses", "tangent bulk modulus of the oil, no air, at 100 bar", "Pa", -0.4, 0.6,
        "C: 1.0e9 to 1.72e9", _add("oil.bulk_modulus"), lambda p, level: _modulus(p, level, HUNDRED_BAR, air=False),
        relative=True,
    ),
    PlantEffect(
        "entrained_air", "oil_and_hoses", "tangent bulk modulus of oil with air, no walls, at 10 bar", "Pa", -0.9, -0.1,
        "F 1: 0.2 to 5 % of air", _apply_air, lambda p, level: _modulus(p, level, TEN_BAR, air=True), relative=True,
    ),
    PlantEffect(
        "hose_compliance", "oil_and_hoses", "volume per pressure that the walls of one side's joint hoses take", "m^3/Pa",
        -0.6, 4.0, "C: 0.8e9 to 1.64e9 Pa and 0.26 to 0.9 L", _add("steering.hose_wall"), _wall, relative=True,
    ),
    PlantEffect(
        "cylinder_leakage", "cylinders", "leakage past both pistons from A to B at 100 bar, laminar", "m^3/s", 5e-6, 1e-4,
        "F 11: to 1e-11 m^3/s/Pa", lambda p, magnitude, level: {
            "steering.cylinder.leakage": p["steering.cylinder.leakage"] + 0.5 * magnitude / HUNDRED_BAR
        }, lambda p, level: circuit_of(p, level)["lines"]["cylinder_leak"] * HUNDRED_BAR,
    ),
    PlantEffect(
        "cross_port_leakage", "valve", "leakage from A to B within the valve at 100 bar, turbulent", "m^3/s", 5e-6, 1e-4,
        "F 11, as a valve left ajar", lambda p, magnitude, level: {
            "steering.valve.cross_orifice": p["steering.valve.cross_orifice"] + magnitude / np.sqrt(HUNDRED_BAR)
        }, lambda p, level: circuit_of(p, level)["valve"]["cross_orifice"] * np.sqrt(HUNDRED_BAR),
    ),
    PlantEffect(
        "seal_friction", "cylinders", "breakaway force of one cylinder without pressure", "N", 200.0, 5000.0,
        "C: preload 20 to 600 N; swollen or dry seals more", _apply_seal, _seal,
    ),
    PlantEffect(
        "joint_friction", "joint", "breakaway torque of the joint's bearing", "N*m", 200.0, 5000.0,
        "F 5: 50 to 500 N m; a dry pin more", _apply_bearing, _bearing,
    ),
    PlantEffect(
        "joint_backlash", "joint", "free play of the joint, the cylinders held, full width", "rad", 0.001, 0.012,
        "F 20: 0.3 to 1.5 mm at the pins, 0.3° a millimetre", _add("joint.play"), _play,
    ),
    PlantEffect(
        "frame_compliance", "joint", "joint angle per torque, the cylinders held", "rad/(N*m)", 5e-8, 5e-7,
        "F 21: 2 to 20 MN m/rad", _add("joint.compliance"), _compliance,
    ),
    PlantEffect(
        "payload", "mass", "mass of the machine; what is added lies over the front axle 1.5 m above the ground", "kg", 150.0,
        1500.0, "F 22: crane and load", _add("payload.mass"),
        lambda p, level: (lambda b: b["front"]["mass"] + b["rear"]["mass"])(bodies_of(p, level)),
    ),
    PlantEffect(
        "driveline_resistance", "driveline", "dry torque with which one wheel resists turning", "N*m", 100.0, 1000.0,
        "A: 230 to 370 N m is the brake of the published twin", _add("driveline.brake.disc_torque"), _wheel_torque,
    ),
    PlantEffect(
        "tire_relaxation", "wheels_and_ground", "initial lateral stiffness of one standing tire at 24.5 kN", "N/m", -0.85,
        1.5, "E.1: 5 to 100 1/m", _scale(_lateral_stiffness, "tire.sigma0_lateral", "tire.sigma0_longitudinal"),
        _lateral_stiffness, relative=True,
    ),
    PlantEffect(
        "tire_stiffness", "wheels_and_ground", "vertical stiffness of one tire", "N/m", -0.5, 0.6, "E.2: 300 to 650 kN/m",
        _add("tire.stiffness"), lambda p, level: p["tire.stiffness"] + 0.0, relative=True,
    ),
    PlantEffect(
        "tire_scrub", "wheels_and_ground", "torque to swivel one standing wheel by 20° at 24.5 kN", "N*m", 200.0, 3000.0,
        "E.3: 0.8 to 3.2 kN m", _apply_scrub, _swivel,
    ),
    PlantEffect(
        "soft_ground", "wheels_and_ground", "towing resistance over weight of a free wheel", "1", 0.02, 0.15,
        "E.2: 0.05 to 0.1; mud 0.15", _apply_soft_ground, _towing,
    ),
    PlantEffect(
        "ground_slope", "wheels_and_ground", "rise of the ground ahead and to the left at heading 0", "rad", -0.1, 0.1,
        "F 23: 0 to 3° on a test yard, 6° outside", lambda p, magnitude, level: {
            "ground.slope_ahead": p["ground.slope_ahead"] + magnitude[0],
            "ground.slope_left": p["ground.slope_left"] + magnitude[1],
        }, _slope, parts=("ahead", "left"),
    ),
    # outside of the catalogue
    PlantEffect(
        "x_air_pocket", "oil_and_hoses", "air trapped in port A, volume at atmospheric pressure", "m^3", 3e-5, 4e-4,
        "estimate: a badly bled cylinder", _add("steering.pocket_a"),
        lambda p, level: circuit_of(p, level)["lines"]["pocket"],
    ),
    PlantEffect(
        "x_port_leak", "valve", "leakage from port A to tank at 100 bar, laminar: a spool worn on one land", "m^3/s", 1e-5,
        1e-4, "estimate", lambda p, magnitude, level: {
            "steering.valve.leak_a": p["steering.valve.leak_a"] + magnitude / HUNDRED_BAR
        }, lambda p, level: -np.diff(circuit_of(p, level)["valve"]["port_leak"], axis=0)[0] * HUNDRED_BAR,
    ),
    PlantEffect(
        "x_return_kink", "oil_and_hoses", "drop over a kink in the return from port B at 60 L/min", "Pa", 3e5, 40e5,
        "estimate", lambda p, magnitude, level: {
            "steering.valve.kink_b": p["steering.valve.kink_b"] + magnitude / OPERATING**2
        }, _kink,
    ),
    PlantEffect(
        "x_angle_wobble", "sensor", "amplitude of an error of the angle with twelve periods a turn", "rad", 0.002, 0.01,
        "estimate: an eccentric magnet", _add("sensor.wobble"), lambda p, level: p["sensor.wobble"] + 0.0,
    ),
    PlantEffect(
        "x_hinge_bump", "joint", "extra breakaway torque of the bearing at a spot 0.4 rad to the right", "N*m", 800.0,
        8000.0, "estimate: a damaged race", _add("joint.bump"), _bump,
    ),
    PlantEffect(
        "x_dragging_brake", "driveline", "extra dry torque at the front left wheel alone", "N*m", 300.0, 3000.0,
        "estimate: a parking brake that hangs", _add("driveline.brake.drag_fl"), _drag,
    ),
    PlantEffect(
        "x_low_shock_valve", "valve", "opening pressure of port B's shock valve less that of port A's", "Pa", 60e5, 180e5,
        "estimate: a fatigued spring", _add("steering.valve.shock_drop_a"),
        lambda p, level: np.diff(circuit_of(p, level)["valve"]["shock_setting"], axis=0)[0],
    ),
    PlantEffect(
        "x_ls_restriction", "pump", "time constant of the load-sensing line", "s", 0.01, 0.08,
        "estimate: a clogged damping orifice", _add("steering.pump.ls_time_constant"),
        lambda p, level: 1.0 / circuit_of(p, level)["lines"]["ls_pace"],
    ),
)  # fmt: skip

EFFECTS: Mapping[str, PlantEffect] = {effect.id: effect for effect in _CATALOGUE}
"""All deviations by id, those of the diagnosis's catalogue first."""

OUTSIDE = tuple(name for name in EFFECTS if name.startswith("x_"))
"""Ids that a diagnosis does not know."""
