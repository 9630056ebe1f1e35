"""The catalogue of effects: what may part a machine from its twin, each off by default.

An effect is a deviation from the commissioned machine with one or two magnitudes. At the magnitudes ``none`` it leaves
everything as it is, to the bit. It acts in one of three places, and each effect has all three methods, so that a caller
need not know which:

- :meth:`Effect.apply`: on the machine's parameters;
- :meth:`Effect.tilt`: on the plane under it;
- :meth:`Effect.record`: on the signals that were sampled, after the simulation.

Magnitudes are numbers, or arrays (N,) with one value a twin::

    machine = EFFECTS["seal_friction"].apply(Machine.load("aoro"), np.linspace(0.0, 4000.0, 64))

What can be measured on any machine, whatever its laws, is the effect's operational magnitude Q (:meth:`Effect.measured`);
how large an effect is, is said by Q with it less Q without.

A new effect is one more entry. Where parameters of the machine file can bring it about, that is all::

    weak_relief = MachineEffect(
        id="weak_relief", component="valve", physics="The ports' shock valves open early.", sign="+: lower setting",
        magnitudes=(Magnitude("drop", "Pa", 0.0, 1e7, "E"),),
        operational=(
            Operational("opening pressure of a shock valve", "Pa", lambda m, drop: m.steering.valve.shock_pressure),
        ),
        change=lambda machine, drop: {"steering.valve.shock_pressure": -drop},
    )
    effects = {**EFFECTS, weak_relief.id: weak_relief}

Where it needs a law of its own, write a ``wp.func`` in ``twin/physics`` with a parameter that switches it off, give the
parameter a place in ``sections.py`` and the machine files (role ``effect``), and let the effect move it.

Source tags are those of the machine file, and:

- S13 Project Chrono, 335/65 R22.5 tire; S15 Simscape excavator model, parameter scripts
- S19 Sharp & Granger, On car steering torques at parking speeds; S20 Mateichyk et al., Appl. Sci. 14, 2024, 10925;
  S21 doi:10.1177/1687814016668765: steering torque of a standing wheel
- S24 Yuan et al., Chin. J. Mech. Eng. 2022: bulk modulus of oil with air; S26 Johnston, Drew & Longmore, J. Vib. Acoust.
  132, 2010, 021011: dynamic modulus of hoses
- S34 Novotechnik, RFC-4800 rotary sensors, data sheets
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.effects.signals import delayed, lagged, smoothed
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import UNITS, Quantity, as_quantity
from aoro_gym.machine.rest import GRAVITY
from aoro_gym.terrains.plane import Plane

COMPONENTS = (
    "sensor", "pump", "valve", "oil_and_hoses", "cylinders", "joint", "wheels_and_ground", "mass", "engine", "driveline",
)  # fmt: skip
"""Parts of the machine that an effect can lie in."""

ANGLE = "joint_angle"
"""Signal of the joint's sensor, named as the twin's output."""

COMMISSIONED_TEMPERATURE = 35.0
"""Temperature [°C] of the oil that the machine files hold for (E)."""

REFERENCE_LOAD = 24.5e3
"""Wheel load [N] at which tires are measured: a quarter of the machine."""
REFERENCE_FLOW = 1e-3
"""Flow [m³/s] at which pressure drops are measured: 60 L/min."""
REFERENCE_PRESSURE = 100e5
"""Pressure [Pa] at which leakages and moduli are measured."""
SWIVEL = np.radians(20.0)
"""Angle [rad] by which a wheel is swivelled to measure its resistance."""
PAYLOAD_HEIGHT = 1.5
"""Height [m] of a payload over the design ground, above the middle of the front axle (E: a log in the folded crane)."""


@dataclass(frozen=True)
class Magnitude:
    """One magnitude of an effect: a number that an optimiser can work on between ``low`` and ``high`` (about 95 %)."""

    name: str
    unit: str
    low: float
    high: float
    source: str
    none: float = 0.0  # the value at which the effect is absent
    scale: str = "linear"  # or "log": what is searched is its logarithm
    least: float | None = None  # from which on it counts as a cause, where that is not at once; ``none`` is then below

    def __post_init__(self) -> None:
        if self.scale not in ("linear", "log"):
            raise ValueError(f"magnitude {self.name}: scale = {self.scale!r} must be linear or log")
        if not self.low <= self.none <= self.high or self.low == self.high:
            raise ValueError(f"magnitude {self.name}: none = {self.none:g} must lie in [{self.low:g}, {self.high:g}]")
        if self.least is not None and not self.none < self.least < self.high:
            raise ValueError(
                f"magnitude {self.name}: least = {self.least:g} must lie between none = {self.none:g} and {self.high:g}"
            )
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(f"magnitude {self.name}: low = {self.low:g} must be above 0 on a log scale")


@dataclass(frozen=True)
class Operational:
    """What can be measured on any machine: ``measure(machine, *magnitudes)`` gives it for the machine that already has
    the effect, in SI."""

    quantity: str
    unit: str
    measure: Callable[..., Quantity]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What all effects have in common; see the module."""

    id: str
    component: str
    physics: str
    sign: str
    magnitudes: tuple[Magnitude, ...]
    operational: tuple[Operational, ...]
    hidden: str = ""
    """Where it does not show; empty if standing turns tell."""

    def __post_init__(self) -> None:
        if self.component not in COMPONENTS:
            raise ValueError(f"effect {self.id}: component = {self.component!r}; choose one of {', '.join(COMPONENTS)}")
        if len(self.magnitudes) not in (1, 2):
            raise ValueError(f"effect {self.id} has {len(self.magnitudes)} magnitudes, but must have one or two")

    @property
    def none(self) -> tuple[float, ...]:
        """Magnitudes at which the effect is absent."""
        return tuple(magnitude.none for magnitude in self.magnitudes)

    def apply(self, machine: Machine, *magnitude: ArrayLike) -> Machine:
        """``machine`` with the effect; one variant a value where a magnitude is an array (N,)."""
        self._checked(magnitude)
        return machine

    def tilt(self, plane: Plane, *magnitude: ArrayLike) -> Plane:
        """The ``plane`` that the machine stands on, with the effect."""
        self._checked(magnitude)
        return plane

    def record(
        self, signals: Mapping[str, NDArray[Any]], rate: float, *magnitude: ArrayLike
    ) -> Mapping[str, NDArray[Any]]:
        """Sampled ``signals`` (F, N), by the twin's output names, as the machine's logger has them.

        Args:
            signals: Evenly spaced samples, at rest in the first; best denser than the log, whose samples are then taken.
            rate: Samples a second [Hz].
            magnitude: Numbers, or shape (N,).
        """
        self._checked(magnitude)
        return signals

    def measured(self, machine: Machine, *magnitude: ArrayLike) -> tuple[Quantity, ...]:
        """Operational magnitudes [SI] of ``machine`` once it has the effect."""
        values = self._checked(magnitude)
        affected = self.apply(machine, *values)
        return tuple(as_quantity(one.measure(affected, *values)) for one in self.operational)

    def describe(self, machine: Machine) -> dict[str, Any]:
        """The entry as plain values, for JSON, with the operational magnitudes of one ``machine`` without the effect and at
        the ends of the magnitudes' ranges."""
        low, high = (tuple(getattr(one, end) for one in self.magnitudes) for end in ("low", "high"))
        without, least, most = (self.measured(machine, *magnitude) for magnitude in (self.none, low, high))
        return {
            "id": self.id,
            "component": self.component,
            "physics": self.physics,
            "sign": self.sign,
            "magnitudes": [
                {
                    "name": one.name, "unit": one.unit, "range": [one.low, one.high], "none": one.none, "scale": one.scale,
                    "least": one.least, "source": one.source,
                }
                for one in self.magnitudes
            ],
            "operational": [
                {
                    "quantity": one.quantity, "unit": one.unit, "none": float(without[i]), "low": float(least[i]),
                    "high": float(most[i]),
                }
                for i, one in enumerate(self.operational)
            ],
            "hidden": self.hidden,
        }  # fmt: skip

    def _checked(self, magnitude: tuple[ArrayLike, ...]) -> tuple[Quantity, ...]:
        if len(magnitude) != len(self.magnitudes):
            names = ", ".join(one.name for one in self.magnitudes)
            raise ValueError(f"effect {self.id} has {len(magnitude)} magnitudes, but takes {names}")
        for one, value in zip(self.magnitudes, magnitude, strict=True):
            array = np.asarray(value, dtype=np.float64)
            if array.ndim > 1 or array.size == 0 or not np.all(np.isfinite(array)):
                raise ValueError(f"effect {self.id}: {one.name} = {value!r} must be a finite number, or one a twin")
        return tuple(as_quantity(value) for value in magnitude)


@dataclass(frozen=True, kw_only=True)
class MachineEffect(Effect):
    """An effect on the machine's parameters: ``change(machine, *magnitudes)`` gives what is added to each key [SI]."""

    change: Callable[..., Mapping[str, Quantity]]

    def apply(self, machine: Machine, *magnitude: ArrayLike) -> Machine:
        """See :meth:`Effect.apply`; raises ValueError where the machine would have no physical meaning."""
        changes = self.change(machine, *self._checked(magnitude))
        entries = machine.entries
        values = {key: entries[key].value + added / UNITS[entries[key].unit][1] for key, added in changes.items()}
        return machine.set(values, source=f"effect {self.id}", check_ranges=False)


@dataclass(frozen=True, kw_only=True)
class GroundEffect(Effect):
    """An effect on the ground: ``change(plane, *magnitudes)`` gives the plane."""

    change: Callable[..., Plane]

    def tilt(self, plane: Plane, *magnitude: ArrayLike) -> Plane:
        """See :meth:`Effect.tilt`."""
        return self.change(plane, *self._checked(magnitude))


@dataclass(frozen=True, kw_only=True)
class ChainEffect(Effect):
    """An effect of the measuring chain: ``change(values, rate, *magnitudes)`` of each of the ``signals`` that it touches,
    of all of them if None."""

    change: Callable[..., NDArray[np.floating]]
    signals: tuple[str, ...] | None = (ANGLE,)

    def record(
        self, signals: Mapping[str, NDArray[Any]], rate: float, *magnitude: ArrayLike
    ) -> Mapping[str, NDArray[Any]]:
        """See :meth:`Effect.record`."""
        values = self._checked(magnitude)
        touched = signals if self.signals is None else [name for name in self.signals if name in signals]
        return {**signals, **{name: self.change(signals[name], rate, *values) for name in touched}}


# --- how magnitudes move parameters ---


def _factor(low: float, high: float, source: str) -> Magnitude:
    """A magnitude that multiplies."""
    return Magnitude("factor", "1", low, high, source, none=1.0, scale="log")


def _added(key: str) -> Callable[..., Mapping[str, Quantity]]:
    """A magnitude that is added to ``key`` [SI]."""
    return lambda machine, amount: {key: amount}


def _scaled(*keys: str) -> Callable[..., Mapping[str, Quantity]]:
    """A factor on ``keys``."""
    return lambda machine, factor: {key: machine.value(key) * (factor - 1.0) for key in keys}


def _valve_gain(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """Edges of another size behind the same compensator, whose drop at the larger nominal flow grows with its square."""
    edges = _scaled("steering.valve.nominal_flow_left", "steering.valve.nominal_flow_right")(machine, factor)
    compensator = _scaled("steering.valve.compensator_open_drop")(machine, factor**2)
    return {**edges, **compensator}


def kinematic_viscosity(temperature: Quantity) -> Quantity:
    """Viscosity [mm²/s] of a VG 46 oil at ``temperature`` [°C]: Walther, lg lg(ν + 0.7) = A − B lg T (ASTM D341), through
    46 mm²/s at 40 °C and 12 mm²/s at 75 °C (S27). Valid from −20 to 120 °C."""
    (t1, v1), (t2, v2) = ((np.log10(t + 273.15), np.log10(np.log10(v + 0.7))) for t, v in ((40.0, 46.0), (75.0, 12.0)))
    slope = (v2 - v1) / (t2 - t1)
    return 10.0**10.0 ** (v1 + slope * (np.log10(np.asarray(temperature) + 273.15) - t1)) - 0.7


def relative_density(temperature: Quantity) -> Quantity:
    """Density of a mineral oil at ``temperature`` [°C] over that at 15 °C: 1 − 6.5e-4 (T − 15) (R)."""
    return 1.0 - 6.5e-4 * (np.asarray(temperature) - 15.0)


MODULUS_PER_KELVIN = -0.005
"""Relative change of the liquid's bulk modulus with temperature [1/K] (R; S24: −0.4 to −0.7 %)."""


def _oil_temperature(machine: Machine, change: Quantity) -> Mapping[str, Quantity]:
    """Laminar leaks, viscous friction and what the return filter adds with its flow by dynamic viscosity, the steering
    edges' and traction valves' turbulent flows by density, the liquid's modulus."""
    before, after = COMMISSIONED_TEMPERATURE, COMMISSIONED_TEMPERATURE + np.asarray(change)
    lighter = relative_density(after) / relative_density(before)
    thinner = lighter * (kinematic_viscosity(after) / kinematic_viscosity(before))
    leaks = (
        "steering.valve.leakage", "steering.cylinder.leakage", "steering.pump.leakage", "driveline.pump.leakage",
        "driveline.pump.cross_leakage", "driveline.motor.leakage",
    )  # fmt: skip
    turbulent = (
        "steering.valve.nominal_flow_left", "steering.valve.nominal_flow_right", "driveline.traction.nominal_flow",
    )  # fmt: skip
    return {
        **_scaled(*leaks)(machine, 1.0 / thinner),
        **_scaled("steering.cylinder.seal_viscous", "steering.tank_line.back_pressure_ramp")(machine, thinner),
        **_scaled(*turbulent)(machine, 1.0 / np.sqrt(lighter)),
        **_scaled("oil.bulk_modulus")(machine, 1.0 + MODULUS_PER_KELVIN * np.asarray(change)),
    }


def _back_pressure(machine: Machine, pressure: Quantity, throttle: Quantity) -> Mapping[str, Quantity]:
    """A spring that holds, and a throttle of this drop at the reference flow."""
    return {
        "steering.tank_line.back_pressure": pressure,
        "steering.tank_line.throttle_drop": throttle * (machine.steering.tank_line.back_flow / REFERENCE_FLOW) ** 2,
    }


TIGHT = 1e-3
"""Play [rad] below which pins still touch all round: a quarter of a millimetre at either end."""


def _worn_pins(machine: Machine, play: Quantity, compliance: Quantity) -> Mapping[str, Quantity]:
    """A free play, and pins that touch along a line, the less of it the wider the play, up to :data:`TIGHT`."""
    return {"joint.backlash": play, "joint.compliance": compliance * np.clip(np.asarray(play) / TIGHT, 0.0, 1.0)}


def _payload(machine: Machine, mass: Quantity) -> Mapping[str, Quantity]:
    """A point over the middle of the front axle joined to the front frame (parallel axes)."""
    front = machine.frame.front
    share = mass / (front.mass + mass)
    ahead, above = np.asarray(front.cog_offset), PAYLOAD_HEIGHT - np.asarray(front.cog_height)
    reduced = front.mass * share
    return {
        "frame.front.mass": mass,
        "frame.front.cog_offset": -share * ahead,
        "frame.front.cog_height": share * above,
        "frame.front.inertia_xx": reduced * above**2,
        "frame.front.inertia_yy": reduced * (ahead**2 + above**2),
        "frame.front.inertia_zz": reduced * ahead**2,
    }


def _soft_ground(machine: Machine, resistance: Quantity) -> Mapping[str, Quantity]:
    """Bekker's compaction resistance of a rigid wheel on ground with p = k z: R/W = 0.75 √(z/D) (*Theory of Land
    Locomotion*, 1956). The sinkage z that belongs to it is bearing in series with the tire."""
    tire = machine.tire
    sinkage = 2.0 * tire.radius * (np.asarray(resistance) / 0.75) ** 2
    load = 0.25 * GRAVITY * np.asarray(machine.mass)
    in_series = 1.0 / (1.0 + tire.stiffness * sinkage / load)
    return {
        "tire.rolling_resistance": resistance,
        "tire.stiffness": machine.value("tire.stiffness") * (in_series - 1.0),
    }


def _ground_slope(plane: Plane, ahead: Quantity, left: Quantity) -> Plane:
    """Gradients add: that of the plane and that of the slope ahead (world x) and to the left (world y)."""
    direction, steepness = np.radians(plane.direction_deg), np.tan(np.radians(plane.slope_deg))
    x = steepness * np.cos(direction) + np.tan(ahead)
    y = steepness * np.sin(direction) + np.tan(left)
    level = np.equal(ahead, 0.0) & np.equal(left, 0.0)
    return Plane(
        slope_deg=np.where(level, plane.slope_deg, np.degrees(np.arctan(np.hypot(x, y)))),
        direction_deg=np.where(level, plane.direction_deg, np.degrees(np.arctan2(y, x))),
        friction=plane.friction,
        rolling_resistance=plane.rolling_resistance,
    )


# --- how operational magnitudes are measured ---


def _parameter(key: str, factor: float = 1.0) -> Callable[..., Quantity]:
    """A parameter [SI] times ``factor``."""
    return lambda machine, *magnitude: factor * np.asarray(machine.value(key))


def _given(machine: Machine, *magnitude: Quantity) -> Quantity:
    """The magnitude itself, which is measured as such."""
    return magnitude[0]


def _opening_signal(side: str) -> Callable[..., Quantity]:
    return lambda machine, *magnitude: (
        machine.value(f"steering.valve.dead_band_{side}") + np.asarray(machine.steering.valve.overlap)
    )


def _metered_flow(machine: Machine, *magnitude: Quantity) -> Quantity:
    valve = machine.steering.valve
    return valve.cv_in_left * np.sqrt(valve.compensator_pressure)


def _open_drop(machine: Machine, *magnitude: Quantity) -> Quantity:
    return (REFERENCE_FLOW / machine.steering.valve.cv_compensator) ** 2


def _return_pressure(machine: Machine, *magnitude: Quantity) -> Quantity:
    line = machine.steering.tank_line
    share = REFERENCE_FLOW / line.back_flow
    return line.back_pressure + line.back_pressure_ramp * share + line.throttle_drop * share**2


def _modulus(pressure: float) -> Callable[..., Quantity]:
    return lambda machine, *magnitude: machine.oil.effective_modulus(pressure)


def _piston_leakage(machine: Machine, *magnitude: Quantity) -> Quantity:
    return 2.0 * REFERENCE_PRESSURE * np.asarray(machine.steering.cylinder.leakage)


def _breakaway_force(machine: Machine, *magnitude: Quantity) -> Quantity:
    cylinder = machine.steering.cylinder
    return cylinder.seal_preload * np.asarray(cylinder.seal_static_ratio)


def _swivel_torque(machine: Machine, *magnitude: Quantity) -> Quantity:
    """Dahl's torque after a swivel from rest: M (1 − exp(−ψ/ψ₀)), at slow swivel of a wheel that does not roll."""
    tire = machine.tire
    sliding = tire.friction_coulomb * REFERENCE_LOAD * np.asarray(tire.scrub_radius)
    return sliding * (1.0 - np.exp(-SWIVEL / np.asarray(tire.scrub_angle)))


# --- the catalogue ---

_SECONDS_OF_SENSOR = "E: longer than any of the sensors in question; S34: 0.2 to 5 ms"

EFFECTS: Mapping[str, Effect] = {
    effect.id: effect
    for effect in (
        ChainEffect(
            id="sensor_delay",
            component="sensor",
            physics="The joint angle is logged late by a pure delay.",
            sign="+: older",
            magnitudes=(Magnitude("delay", "s", 0.0, 0.05, _SECONDS_OF_SENSOR),),
            operational=(Operational("age of the measured joint angle", "s", _given),),
            change=delayed,
        ),
        ChainEffect(
            id="sensor_filter",
            component="sensor",
            physics="The joint-angle sensor has a first-order lag before its sampler.",
            sign="+: slower",
            magnitudes=(Magnitude("time_constant", "s", 0.0, 0.05, _SECONDS_OF_SENSOR),),
            operational=(Operational("time constant of the measured joint angle", "s", _given),),
            change=lagged,
        ),
        ChainEffect(
            id="sensor_gain",
            component="sensor",
            physics="The joint-angle sensor reads a wrong multiple of the angle.",
            sign="+: reads too much",
            magnitudes=(Magnitude("error", "1", -0.05, 0.05, "E; S34: linearity of 0.5 %, a wrong scale is worse"),),
            operational=(Operational("measured over true joint angle, less one", "1", _given),),
            change=lambda values, rate, error: np.asarray(values) * (1.0 + np.asarray(error)),
        ),
        ChainEffect(
            id="measuring_chain",
            component="sensor",
            physics="The log went through a zero-phase low-pass that nobody mentioned, all signals alike.",
            sign="+: smoother",
            magnitudes=(Magnitude("smoothing", "s", 0.0, 0.05, "P: 7 Hz is 0.023 s; E"),),
            operational=(
                Operational("1/(2π f) of the frequency f of half gain of a zero-phase low-pass", "s", _given),
            ),
            change=smoothed,
            signals=None,
        ),
        MachineEffect(
            id="engine_droop",
            component="engine",
            physics="The governor lets the speed fall in proportion to the brake torque.",
            sign="+: falls",
            magnitudes=(Magnitude("droop", "1", 0.0, 0.07, "E: 0 to 7 % of governors"),),
            operational=(
                Operational(
                    "relative fall of steady engine speed from no load to full load", "1", _parameter("engine.droop")
                ),
            ),
            hidden="joint angle and pressures of standing turns, whose pump makes up for it; the engine's speed shows it",
            change=_added("engine.droop"),
        ),
        MachineEffect(
            id="pump_response",
            component="pump",
            physics="Pump 2's swash moves slower or faster, up and down.",
            sign="+: slower",
            magnitudes=(_factor(0.4, 3.0, "R, S16: 0.05 to 0.30 s up"),),
            operational=(
                Operational(
                    "time of the swash from zero to full at saturated error",
                    "s",
                    _parameter("steering.pump.stroke_up_time"),
                ),
            ),
            change=_scaled("steering.pump.stroke_up_time", "steering.pump.stroke_down_time"),
        ),
        MachineEffect(
            id="pump_limit",
            component="pump",
            physics="Pump 2's pressure cut-off stands elsewhere and caps the first acceleration.",
            sign="+: higher",
            magnitudes=(_factor(0.4, 1.2, "1D: 178 to 243 bar; E: down to a misadjusted one"),),
            operational=(
                Operational(
                    "supply pressure at which pump 2 delivers nothing", "Pa", _parameter("steering.pump.cutoff")
                ),
            ),
            change=_scaled("steering.pump.cutoff"),
        ),
        MachineEffect(
            id="command_delay",
            component="valve",
            physics="The command reaches the spool later.",
            sign="+: later",
            magnitudes=(Magnitude("delay", "s", 0.0, 0.04, "E: 3 to 40 ms"),),
            operational=(
                Operational("dead time from command to spool", "s", _parameter("steering.valve.command_delay")),
            ),
            change=_added("steering.valve.command_delay"),
        ),
        MachineEffect(
            id="spool_lag",
            component="valve",
            physics="The spool follows its pilot slower.",
            sign="+: slower",
            magnitudes=(Magnitude("time_constant", "s", 0.0, 0.08, "1D: 0.010 to 0.042 s, R: to 0.06"),),
            operational=(
                Operational(
                    "time constant of the spool for small steps", "s", _parameter("steering.valve.spool_time_constant")
                ),
            ),
            change=_added("steering.valve.spool_time_constant"),
        ),
        MachineEffect(
            id="spool_rate",
            component="valve",
            physics="The pilot's flow limits the spool's speed.",
            sign="+: faster",
            magnitudes=(_factor(0.08, 2.0, "E: 5 to 25 full strokes a second; S14, S15: 2"),),
            operational=(
                Operational(
                    "highest speed of the spool in full strokes", "1/s", _parameter("steering.valve.spool_rate_limit")
                ),
            ),
            change=_scaled("steering.valve.spool_rate_limit"),
        ),
        MachineEffect(
            id="dead_band",
            component="valve",
            physics="Both sides' overlap is wider, so that the whole opening curve lies farther out.",
            sign="+: wider",
            magnitudes=(Magnitude("overlap", "V", -0.15, 0.3, "P: 0.23 to 0.30 V left, above it right; E"),),
            operational=(
                Operational("signal at which the left port begins to open", "V", _opening_signal("left")),
                Operational("signal at which the right port begins to open", "V", _opening_signal("right")),
            ),
            change=_added("steering.valve.overlap"),
        ),
        MachineEffect(
            id="valve_gain",
            component="valve",
            physics="All metering edges are larger by one factor, or their compensator is set higher.",
            sign="+: more flow",
            magnitudes=(_factor(0.75, 1.3, "P: 70.6 measured, 62 L/min on the data sheet"),),
            operational=(
                Operational("flow at full left signal with the compensator at its setting", "m^3/s", _metered_flow),
            ),
            change=_valve_gain,
        ),
        MachineEffect(
            id="valve_hysteresis",
            component="valve",
            physics="Play between command and spool: the spool follows a falling command late.",
            sign="+: wider",
            magnitudes=(Magnitude("width", "1", 0.0, 0.2, "E: 1 to 6 %; worn ones more"),),
            operational=(
                Operational(
                    "width of the loop between command and spool", "1", _parameter("steering.valve.hysteresis")
                ),
            ),
            hidden="full turns at one signal: only a falling or reversed command shows it",
            change=_added("steering.valve.hysteresis"),
        ),
        MachineEffect(
            id="compensator_lag",
            component="valve",
            physics="The pressure compensator closes slower, so that the first rush of oil lasts longer.",
            sign="+: slower",
            magnitudes=(_factor(0.1, 5.0, "S16, 1D: 0.2 to 30 ms"),),
            operational=(
                Operational(
                    "time of the compensator's stroke under an excess of one setting",
                    "s",
                    _parameter("steering.valve.compensator_time_constant"),
                ),
            ),
            change=_scaled("steering.valve.compensator_time_constant"),
        ),
        MachineEffect(
            id="compensator_opening",
            component="valve",
            physics="The compensator, fully open at rest, throttles more or less of the first rush of oil.",
            sign="+: narrower",
            magnitudes=(_factor(0.2, 4.0, "E: 1.5 to 6 bar at the nominal flow"),),
            operational=(Operational("pressure drop of the fully open compensator at 60 L/min", "Pa", _open_drop),),
            change=_scaled("steering.valve.compensator_open_drop"),
        ),
        MachineEffect(
            id="back_pressure",
            component="oil_and_hoses",
            physics="A filter's bypass holds up the return line, whatever its flow, or a pinched hose does by its square.",
            sign="+: higher",
            magnitudes=(
                Magnitude("pressure", "Pa", 0.0, 15e5, "1D: 1.5 to 5.5 bar; E: a clogged filter's bypass"),
                Magnitude("throttle", "Pa", 0.0, 15e5, "E: the same at 60 L/min"),
            ),
            operational=(Operational("pressure of the return line at 60 L/min", "Pa", _return_pressure),),
            change=_back_pressure,
        ),
        MachineEffect(
            id="oil_temperature",
            component="oil_and_hoses",
            physics="Warmer oil is thinner, lighter and softer: leaks, viscous friction, flows and stiffness follow.",
            sign="+: warmer",
            magnitudes=(Magnitude("change", "K", -30.0, 40.0, "E: 10 to 60 °C about 35 °C, and a hot day"),),
            operational=(Operational("temperature of the oil less that at commissioning", "K", _given),),
            change=_oil_temperature,
        ),
        MachineEffect(
            id="oil_bulk_modulus",
            component="oil_and_hoses",
            physics="The liquid itself is stiffer or softer.",
            sign="+: stiffer",
            magnitudes=(_factor(0.6, 1.6, "P: adjustable; S16, S27: 1.0 to 1.72e9 Pa"),),
            operational=(Operational("bulk modulus of the oil at 100 bar", "Pa", _modulus(REFERENCE_PRESSURE)),),
            change=_scaled("oil.bulk_modulus"),
        ),
        MachineEffect(
            id="entrained_air",
            component="oil_and_hoses",
            physics="Free air makes the oil soft at low pressure and little so at high pressure.",
            sign="+: more air, a lower modulus",
            magnitudes=(Magnitude("gas_fraction", "1", 0.0, 0.05, "S17, S18: 0.5 % by default; E: 0.2 to 5 %"),),
            operational=(
                Operational("bulk modulus of the oil with its air at 10 bar", "Pa", _modulus(10e5)),
                Operational("bulk modulus of the oil with its air at 100 bar", "Pa", _modulus(REFERENCE_PRESSURE)),
            ),
            change=_added("oil.gas_fraction"),
        ),
        MachineEffect(
            id="hose_compliance",
            component="oil_and_hoses",
            physics="The walls of the joint's hoses give more or less.",
            sign="+: softer",
            magnitudes=(_factor(0.4, 5.0, "P: 1.2 and 1.64e9 Pa; S26: static is softer than dynamic"),),
            operational=(
                Operational(
                    "volume per pressure that one side's joint hoses take",
                    "m^3/Pa",
                    lambda machine, *magnitude: machine.steering.hose_compliance,
                ),
            ),
            change=lambda machine, factor: _scaled("steering.hose_bulk_modulus")(machine, 1.0 / factor),
        ),
        MachineEffect(
            id="cylinder_leakage",
            component="cylinders",
            physics="Worn piston seals: laminar leakage from one side of the pistons to the other.",
            sign="+: more",
            magnitudes=(Magnitude("flow", "m^3/s", 0.0, 1e-4, "1D: 1e-13 to 3e-12, S16: 1e-11 m³/s/Pa a cylinder"),),
            operational=(Operational("leakage past both pistons at 100 bar", "m^3/s", _piston_leakage),),
            change=lambda machine, flow: {"steering.cylinder.leakage": np.asarray(flow) / (2.0 * REFERENCE_PRESSURE)},
        ),
        MachineEffect(
            id="cross_port_leakage",
            component="valve",
            physics="A shock or anti-cavitation valve that does not seat: turbulent leakage from port to port in the block.",
            sign="+: more",
            magnitudes=(Magnitude("flow", "m^3/s", 0.0, 1e-4, "R: 5 to 60 cm³/min new; E: a seat that stays open"),),
            operational=(
                Operational(
                    "leakage from port to port in the valve block at 100 bar",
                    "m^3/s",
                    _parameter("steering.valve.cross_port_leakage"),
                ),
            ),
            change=_added("steering.valve.cross_port_leakage"),
        ),
        MachineEffect(
            id="seal_friction",
            component="cylinders",
            physics="Tight or dry seals of the steering cylinders.",
            sign="+: more",
            magnitudes=(Magnitude("preload", "N", 0.0, 4000.0, "E: 20 to 600 N new; ten times that when dry"),),
            operational=(Operational("breakaway force of one cylinder without pressure", "N", _breakaway_force),),
            change=_added("steering.cylinder.seal_preload"),
        ),
        MachineEffect(
            id="joint_friction",
            component="joint",
            physics="Dry friction in the bearing of the joint.",
            sign="+: more",
            magnitudes=(
                Magnitude("torque", "N*m", 0.0, 5000.0, "E: 50 to 500 N m greased; ten times that when seizing"),
            ),
            operational=(
                Operational("breakaway torque of the joint's bearing", "N*m", _parameter("joint.friction_torque")),
            ),
            change=_added("joint.friction_torque"),
        ),
        MachineEffect(
            id="joint_backlash",
            component="joint",
            physics="Worn pins: the cylinders cross a free play before they push the frames, through pins that give way "
            "where they touch; the sensor sees the joint.",
            sign="+: more play",
            magnitudes=(
                Magnitude(
                    "play", "rad", 0.0, 0.012, "E, D: pins of 0.3 to 1.5 mm, 0.3° a millimetre, both ends", least=TIGHT
                ),
                Magnitude(
                    "compliance",
                    "rad/(N*m)",
                    1.5e-8,
                    1.5e-7,
                    "E: pins of 1e8 to 1e9 N/m at 0.18 m",
                    none=5e-8,
                    scale="log",
                ),
            ),
            operational=(
                Operational("free play of the joint with the cylinders held", "rad", _parameter("joint.backlash")),
            ),
            change=_worn_pins,
        ),
        MachineEffect(
            id="frame_compliance",
            component="joint",
            physics="Frames and cylinder mounts bend, a torsion spring in series with the oil.",
            sign="+: softer",
            magnitudes=(Magnitude("compliance", "rad/(N*m)", 0.0, 5e-7, "E: 2 to 20 MN m/rad", least=5e-8),),
            operational=(
                Operational(
                    "joint angle per torque with the cylinders held", "rad/(N*m)", _parameter("joint.compliance")
                ),
            ),
            change=_added("joint.compliance"),
        ),
        MachineEffect(
            id="payload",
            component="mass",
            physics="A load on the front frame, over the middle of its axle.",
            sign="+: heavier",
            magnitudes=(Magnitude("mass", "kg", 0.0, 1500.0, "E: ±500 to 1500 kg m² about the joint and more"),),
            operational=(Operational("mass of the machine", "kg", lambda machine, *magnitude: machine.mass),),
            change=_payload,
        ),
        MachineEffect(
            id="driveline_resistance",
            component="driveline",
            physics="Dragging brakes or motors: dry friction at every wheel.",
            sign="+: more",
            magnitudes=(Magnitude("torque", "N*m", 0.0, 1000.0, "D: 230 to 370 N m in the published figures; E"),),
            operational=(
                Operational(
                    "dry torque that one wheel's brake disc turns with",
                    "N*m",
                    _parameter("driveline.brake.disc_torque"),
                ),
            ),
            change=_added("driveline.brake.disc_torque"),
        ),
        MachineEffect(
            id="tire_relaxation",
            component="wheels_and_ground",
            physics="Tires that are softer or stiffer in the ground's plane: grip builds up over more or less way.",
            sign="+: stiffer",
            magnitudes=(_factor(0.15, 2.5, "S13, S14: 142 to 400 kN/m; S11: up to 4.4 MN/m"),),
            operational=(
                Operational(
                    "lateral stiffness of one standing tire at 24.5 kN",
                    "N/m",
                    _parameter("tire.sigma0_lateral", REFERENCE_LOAD),
                ),
            ),
            change=_scaled("tire.sigma0_longitudinal", "tire.sigma0_lateral"),
        ),
        MachineEffect(
            id="tire_stiffness",
            component="wheels_and_ground",
            physics="Tires of another inflation: other vertical stiffness.",
            sign="+: stiffer",
            magnitudes=(_factor(0.5, 1.6, "S13, S14, R: 300 to 650 kN/m at 150 to 350 kPa"),),
            operational=(Operational("vertical stiffness of one tire", "N/m", _parameter("tire.stiffness")),),
            change=_scaled("tire.stiffness"),
        ),
        MachineEffect(
            id="tire_scrub",
            component="wheels_and_ground",
            physics="The tires' patches twist on the ground as the frames yaw, and resist it.",
            sign="+: more",
            magnitudes=(Magnitude("radius", "m", 0.0, 0.2, "S19 to S21: 2.2 to 3.9 kN m a wheel at full friction"),),
            operational=(
                Operational(
                    "torque that swivels one standing wheel by 20° from rest at 24.5 kN", "N*m", _swivel_torque
                ),
            ),
            change=_added("tire.scrub_radius"),
        ),
        MachineEffect(
            id="soft_ground",
            component="wheels_and_ground",
            physics="Ground that the wheels sink into: compaction resists rolling, and the bearing is soft.",
            sign="+: more resistance",
            magnitudes=(Magnitude("resistance", "1", 0.0, 0.15, "S29: 0.05 to 0.1 on soil"),),
            operational=(
                Operational(
                    "towing resistance of a free wheel over its load", "1", _parameter("tire.rolling_resistance")
                ),
            ),
            change=_soft_ground,
        ),
        GroundEffect(
            id="ground_slope",
            component="wheels_and_ground",
            physics="The ground, taken as level, is a plane with a slope: gravity pulls on the halves.",
            sign="+: rises ahead; rises to the left",
            magnitudes=(
                Magnitude("ahead", "rad", -0.1, 0.1, "D: 0 to 3° unnoticed; E: twice that"),
                Magnitude("left", "rad", -0.1, 0.1, "D: 0 to 3° unnoticed; E: twice that"),
            ),
            operational=(
                Operational("rise of the ground along the machine's heading at the start", "rad", _given),
                Operational("rise of the ground to the left of it", "rad", lambda machine, ahead, left: left),
            ),
            change=_ground_slope,
        ),
    )
}
"""Every effect by its id."""


def matching(pattern: str | None = None) -> list[Effect]:
    """Effects whose id or component holds ``pattern``, all if None; raises ValueError if there is none."""
    found = [one for one in EFFECTS.values() if pattern is None or pattern in one.id or pattern in one.component]
    if not found:
        raise ValueError(f"no effect matches {pattern!r}; choose from: {', '.join(EFFECTS)}")
    return found
