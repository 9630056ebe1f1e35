"""Deviations that a plant can be given, each by a magnitude that can be measured on any plant whatever its laws.

An effect's size is ΔQ = Q(with) − Q(without) of its operational quantity Q, SI; zero is none. :meth:`PlantEffect.apply`
turns ΔQ into constants of the plant's own law at a level, :meth:`PlantEffect.measure` finds Q on a plant by a bench test of
the part.
Ids that begin with ``x_`` are outside of the diagnosis's catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.diagnosis_benchmark.plants.bodies import Bodies
from aoro_gym.diagnosis_benchmark.plants.circuits import OPERATING, PORT_A, Circuits
from aoro_gym.diagnosis_benchmark.plants.fluid import Array, Constants, Oil, density, orifice, viscosity
from aoro_gym.diagnosis_benchmark.plants.friction import BEARING_RATIO, dry_law, stribeck_level
from aoro_gym.diagnosis_benchmark.plants.plant import STAGES, Plant, delay
from aoro_gym.diagnosis_benchmark.plants.sensors import angle_chain, half_gain_time
from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD, SCRUB_ANGLE, Tires

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
def _circuits(constants: Constants, level: int) -> Circuits:
    return Circuits(constants, level, STAGES)


def _bodies(constants: Constants, level: int) -> Bodies:
    return Bodies(constants, Oil(constants, level))


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


def _hysteresis(constants: Constants, level: int) -> Array:
    """Distance between the commands at which the spool passes 0.5 upward and downward."""
    plant = Plant(constants, level)
    sweep = np.concatenate([np.arange(0.0, 1.0, 1e-3), np.arange(1.0, 0.0, -1e-3)])
    runs = np.ones(plant.circuits.runs)
    told = np.array([plant._after_play(value * runs) for value in sweep])
    top = len(sweep) // 2
    up, down = sweep[np.argmax(told >= 0.5, axis=0)], sweep[top + np.argmax(told[top:] < 0.5, axis=0)]
    return up - down


def _dead_band(constants: Constants, level: int) -> Array:
    circuits = _circuits(constants, level)
    side = circuits.side(np.ones(circuits.runs, dtype=bool), circuits.set_speed)
    low, high = np.full(circuits.runs, -0.5), np.full(circuits.runs, 1.5)
    for _ in range(50):  # bisection: the smallest signal that opens the port, as far as the spool lets it
        middle = 0.5 * (low + high)
        is_open = circuits.opening(middle, side) > 1e-12
        low, high = np.where(is_open, low, middle), np.where(is_open, middle, high)
    return high


def _valve_gain(constants: Constants, level: int) -> Array:
    circuits = _circuits(constants, level)
    return circuits.edges["inlet"][0] * np.sqrt(circuits.setting)


def _back_pressure(constants: Constants, level: int) -> Array:
    circuits = _circuits(constants, level)
    low, high = np.zeros(circuits.runs), np.full(circuits.runs, 100e5)
    for _ in range(60):
        middle = 0.5 * (low + high)
        more = circuits.return_flow(middle) > OPERATING
        low, high = np.where(more, low, middle), np.where(more, middle, high)
    return high


def _wall(constants: Constants, level: int) -> Array:
    circuits = _circuits(constants, level)
    return circuits.wall[PORT_A] + (circuits.cells * circuits.hose_wall if circuits.hoses else 0.0)


def _modulus(constants: Constants, level: int, pressure: float, *, air: bool) -> Array:
    oil = Oil(constants, level, None if air else np.zeros_like(constants["oil.gas_fraction"]))
    return 1.0 / oil.compressibility(np.full_like(constants["oil.bulk_modulus"], pressure))


_SPEEDS = np.concatenate([[0.0], np.logspace(-6, -1, 400)])[:, None]
"""Cylinder speeds [m/s] at which a breakaway is looked for."""


def _seal(constants: Constants, level: int) -> Array:
    p, part = constants, "steering.cylinder."
    if level == 0:
        level_at = p[part + "seal_preload"], p[part + "seal_static_ratio"], _SPEEDS, p[part + "seal_stribeck_velocity"]
        return stribeck_level(*level_at).max(axis=0)
    sliding, static = _circuits(p, level).seal_levels(np.ones(()), _SPEEDS, np.zeros(()))
    return -dry_law(level)(_SPEEDS, sliding, static).min(axis=0)


def _bearing(constants: Constants, level: int) -> Array:
    torque = _circuits(constants, level).bearing_torque(np.full_like(constants["joint.bump"], 0.5))
    if level == 0:
        return torque
    return -dry_law(level)(_SPEEDS, torque / BEARING_RATIO, torque).min(axis=0)


def _bump(constants: Constants, level: int) -> Array:
    circuits = _circuits(constants, level)
    angles = np.linspace(-0.5, 0.5, 401)[:, None]
    torque = circuits.bearing_torque(angles)
    return torque.max(axis=0) - torque[-1]


def _play(constants: Constants, level: int) -> Array:
    """Width [rad] over which the pins move without torque, the frames held; bisection of either edge, which are alike."""
    circuits = _circuits(constants, level)
    low, high = np.zeros(circuits.runs), np.full(circuits.runs, 0.1)
    for _ in range(50):
        middle = 0.5 * (low + high)
        free = circuits.series_torque(middle, np.zeros(()), np.zeros(()), np.zeros(())) == 0.0
        low, high = np.where(free, middle, low), np.where(free, high, middle)
    return np.where(circuits.elastic, 2.0 * low, 0.0)


def _compliance(constants: Constants, level: int) -> Array:
    """Of frames and pins under 1 to 2 kN m, the cylinders held [rad/(N m)]."""
    circuits = _circuits(constants, level)
    if not circuits.elastic.any():
        return np.zeros(circuits.runs)
    wide = circuits.play + 0.05
    torque = circuits.series_torque(np.stack([wide, wide + 0.01]), np.zeros(()), np.zeros(()), np.zeros(()))
    rise = torque[1] - torque[0]
    return np.where(circuits.elastic, 0.01 / np.where(circuits.elastic, rise, 1.0), 0.0)


def _lateral_stiffness(constants: Constants, level: int) -> Array:
    tires, travel = Tires(constants, level), 1e-6
    zero = np.zeros_like(tires.twist)
    tires.advance(zero, zero + travel, zero, zero, 1.0)
    return -tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[1][0] / travel


def _swivel(constants: Constants, level: int) -> Array:
    tires, steps = Tires(constants, level), 200
    zero = np.zeros_like(tires.twist)
    for _ in range(steps):
        tires.advance(zero, zero, zero + SWIVEL / steps, zero, 1.0)
    return -tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2][0]


def _towing(constants: Constants, level: int) -> Array:
    tires = Tires(constants, level)
    one = np.ones_like(tires.twist)
    return -tires.rolling_moment(one, one, 10.0 * one)[0]


def _wheel_torque(constants: Constants, level: int) -> Array:
    """Dry torque [N m] of the rear right wheel's brake after a quarter turn without oil pressure."""
    plant = Plant(constants, level)
    plant.state[:] = 0.0
    for _ in range(100):
        plant._hold_wheels(np.full_like(plant.spin, 0.016))
    capacity = plant._wheel_capacity()
    held = plant.brake_stretch * plant._brake_spring[0] if level == 0 else capacity * plant.brake_stretch
    return held[3]


def _drag(constants: Constants, level: int) -> Array:
    return Plant(constants, level)._brake[0] - constants["driveline.brake.disc_torque"]


def _slope(constants: Constants, level: int) -> Array:
    """Angles [rad] that a plumb line shows ahead and to the left."""
    gravity = _bodies(constants, level).gravity
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
    return {"steering.valve.edge_gain": (1.0 + p["steering.valve.edge_gain"]) * (own + magnitude) / own - 1.0}


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
    share = Oil(p, level).air_for(softer, TEN_BAR)
    return {"oil.gas_fraction": np.where(magnitude == 0.0, p["oil.gas_fraction"], share)}


def _apply_seal(p: Constants, magnitude: Array, level: int) -> Changes:
    own = _seal(p, level)
    preload = p["steering.cylinder.seal_preload"]
    return {"steering.cylinder.seal_preload": preload + magnitude * preload / own}


def _apply_bearing(p: Constants, magnitude: Array, level: int) -> Changes:
    own = _bearing(p, level)
    return {"joint.friction_torque": p["joint.friction_torque"] * (own + magnitude) / own}


def _apply_scrub(p: Constants, magnitude: Array, level: int) -> Changes:
    """A torque of Dahl's form on every wheel. Level 2: a longer and wider contact patch."""
    if level != 2:
        built_up = -np.expm1(-SWIVEL / SCRUB_ANGLE)
        return {"tire.scrub_torque": p["tire.scrub_torque"] + magnitude / built_up}
    own = _swivel(p, level)
    low, high = p["tire.patch_gain"], np.full_like(own, 6.0)
    for _ in range(40):
        middle = 0.5 * (low + high)
        more = _swivel({**p, "tire.patch_gain": middle}, level) > own + magnitude
        low, high = np.where(more, low, middle), np.where(more, middle, high)
    return {"tire.patch_gain": np.where(magnitude == 0.0, p["tire.patch_gain"], low)}


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
        lambda p, level: (lambda c: c.engine_droop * c.ceiling(c.set_speed) / c.set_speed)(_circuits(p, level)),
        standing=False,
    ),
    PlantEffect(
        "pump_response", "pump", "time of pump 2's swash from zero to full at saturated error; down alike", "s", -0.6, 2.0,
        "C: 0.05 to 0.3 s", _scale(
            lambda p, level: 1.0 / _circuits(p, level).swash_up,
            "steering.pump.stroke_up_time", "steering.pump.stroke_down_time",
        ), lambda p, level: 1.0 / _circuits(p, level).swash_up, relative=True,
    ),
    PlantEffect(
        "pump_limit", "pump", "supply pressure at which the cut-off lets pump 2 hold no flow", "Pa", -0.6, 0.2,
        "C: 180 to 280 bar; lower where it is set so", _add("steering.pump.cutoff"),
        lambda p, level: _circuits(p, level).cutoff, relative=True,
    ),
    PlantEffect(
        "command_delay", "valve", "dead time from command to spool", "s", 0.003, 0.04, "C: 3 to 40 ms",
        _add("steering.valve.command_delay"), _command_delay,
    ),
    PlantEffect(
        "spool_lag", "valve", "time constant of the spool for a small step", "s", 0.005, 0.08, "C: 8 to 60 ms",
        _add("steering.valve.spool_time_constant"), lambda p, level: 1.0 / _circuits(p, level).spool_pace,
    ),
    PlantEffect(
        "spool_rate", "valve", "highest speed of the spool, strokes a second", "1/s", -0.92, -0.3,
        "C: 5 to 25; operators' ramps of 2 1/s (S14)", _add("steering.valve.spool_rate_limit"),
        lambda p, level: _circuits(p, level).spool_rate, relative=True,
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
        lambda p, level: (lambda c: 1.0 / (c.compensator_rate * c.setting))(_circuits(p, level)), relative=True,
    ),
    PlantEffect(
        "compensator_opening", "valve", "drop over the fully open compensator at 60 L/min", "Pa", -0.8, 3.0,
        "F 8: kick of a compensator that starts open", _scale(
            lambda p, level: (OPERATING / _circuits(p, level).compensator) ** 2, "steering.valve.compensator_open_drop"
        ), lambda p, level: (OPERATING / _circuits(p, level).compensator) ** 2, relative=True,
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
        }, lambda p, level: _circuits(p, level).cylinder_leak * HUNDRED_BAR,
    ),
    PlantEffect(
        "cross_port_leakage", "valve", "leakage from A to B within the valve at 100 bar, turbulent", "m^3/s", 5e-6, 1e-4,
        "F 11, as a valve left ajar", lambda p, magnitude, level: {
            "steering.valve.cross_orifice": p["steering.valve.cross_orifice"] + magnitude / np.sqrt(HUNDRED_BAR)
        }, lambda p, level: orifice(
            _circuits(p, level).cross_orifice, np.full_like(p["joint.play"], HUNDRED_BAR), p["oil.laminar_pressure"]
        ),
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
        lambda p, level: (lambda b: b.front.mass + b.rear.mass)(_bodies(p, level)),
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
        _add("tire.stiffness"), lambda p, level: _bodies(p, level).stiffness, relative=True,
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
        "estimate: a badly bled cylinder", _add("steering.pocket_a"), lambda p, level: _circuits(p, level).pocket,
    ),
    PlantEffect(
        "x_port_leak", "valve", "leakage from port A to tank at 100 bar, laminar: a spool worn on one land", "m^3/s", 1e-5,
        1e-4, "estimate", lambda p, magnitude, level: {
            "steering.valve.leak_a": p["steering.valve.leak_a"] + magnitude / HUNDRED_BAR
        }, lambda p, level: (lambda c: (c.port_leak[0] - c.port_leak[1]) * HUNDRED_BAR)(_circuits(p, level)),
    ),
    PlantEffect(
        "x_return_kink", "oil_and_hoses", "drop over a kink in the return from port B at 60 L/min", "Pa", 3e5, 40e5,
        "estimate", lambda p, magnitude, level: {
            "steering.valve.kink_b": p["steering.valve.kink_b"] + magnitude / OPERATING**2
        }, lambda p, level: (
            lambda kinked, straight: OPERATING**2 * (kinked.edges["outlet"][0] ** -2 - straight.edges["outlet"][0] ** -2)
        )(_circuits(p, level), _circuits({**p, "steering.valve.kink_b": np.zeros_like(p["joint.play"])}, level)),
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
        lambda p, level: (lambda c: c.shock_setting[1] - c.shock_setting[0])(_circuits(p, level)),
    ),
    PlantEffect(
        "x_ls_restriction", "pump", "time constant of the load-sensing line", "s", 0.01, 0.08,
        "estimate: a clogged damping orifice", _add("steering.pump.ls_time_constant"),
        lambda p, level: 1.0 / _circuits(p, level).ls_pace,
    ),
)  # fmt: skip

EFFECTS: Mapping[str, PlantEffect] = {effect.id: effect for effect in _CATALOGUE}
"""All deviations by id, those of the diagnosis's catalogue first."""

OUTSIDE = tuple(name for name in EFFECTS if name.startswith("x_"))
"""Ids that a diagnosis does not know."""
