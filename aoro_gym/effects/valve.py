"""Effects of the steering valve: command, spool, metering edges, pressure compensator, leakage."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import REFERENCE_FLOW, added, factor, parameter, scaled
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity


def _valve_gain(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """Edges of another size behind the same compensator, whose drop at the larger nominal flow grows with its square."""
    edges = scaled("steering.valve.nominal_flow_left", "steering.valve.nominal_flow_right")(machine, factor)
    compensator = scaled("steering.valve.compensator_open_drop")(machine, factor**2)
    return {**edges, **compensator}


def _opening_signal(side: str) -> Callable[..., Quantity]:
    return lambda machine, *magnitude: (
        machine.value(f"steering.valve.dead_band_{side}") + np.asarray(machine.steering.valve.overlap)
    )


def _metered_flow(machine: Machine, *magnitude: Quantity) -> Quantity:
    valve = machine.steering.valve
    return valve.cv_in_left * np.sqrt(valve.compensator_pressure)


def _slower_spool(machine: Machine, time_constant: Quantity) -> Mapping[str, Quantity]:
    """Of first order, a longer time constant; of second order, a frequency at which its lag at low frequency, 2ζ/ω, is
    longer by as much."""
    valve, second = machine.steering.valve, machine.laws.obeys("spool", "second_order")
    slower = 1.0 / (1.0 + np.asarray(time_constant) * valve.spool_frequency / (2.0 * valve.spool_damping))
    return {
        "steering.valve.spool_time_constant": np.where(second, 0.0, time_constant),
        "steering.valve.spool_frequency": np.where(second, valve.spool_frequency * (slower - 1.0), 0.0),
    }


def _spool_lag(machine: Machine, *magnitude: Quantity) -> Quantity:
    valve = machine.steering.valve
    second = machine.laws.obeys("spool", "second_order")
    return np.where(second, 2.0 * valve.spool_damping / valve.spool_frequency, valve.spool_time_constant)


def _slower_compensator(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """A longer time constant, or a spring and a mass with all times longer; a static one has none."""
    valve, mass = machine.steering.valve, machine.laws.obeys("compensator", "spring_mass")
    slower = valve.compensator_frequency * (1.0 / np.asarray(factor) - 1.0)
    return {
        **scaled("steering.valve.compensator_time_constant")(machine, factor),
        "steering.valve.compensator_frequency": np.where(mass, slower, 0.0),
    }


def _compensator_time(machine: Machine, *magnitude: Quantity) -> Quantity:
    valve, mass = machine.steering.valve, machine.laws.obeys("compensator", "spring_mass")
    own = np.where(mass, 2.0 * valve.compensator_damping / valve.compensator_frequency, valve.compensator_time_constant)
    return np.where(machine.laws.obeys("compensator", "static"), 0.0, own)


def _open_drop(machine: Machine, *magnitude: Quantity) -> Quantity:
    return (REFERENCE_FLOW / machine.steering.valve.cv_compensator) ** 2


EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="command_delay",
        component="valve",
        physics="The command reaches the spool later.",
        sign="+: later",
        magnitudes=(Magnitude("delay", "s", 0.0, 0.04, "E: 3 to 40 ms"),),
        operational=(Operational("dead time from command to spool", "s", parameter("steering.valve.command_delay")),),
        change=added("steering.valve.command_delay"),
    ),
    MachineEffect(
        id="spool_lag",
        component="valve",
        physics="The spool follows its pilot slower.",
        sign="+: slower",
        magnitudes=(Magnitude("time_constant", "s", 0.0, 0.08, "1D: 0.010 to 0.042 s, R: to 0.06"),),
        operational=(Operational("time constant of the spool for small steps", "s", _spool_lag),),
        change=_slower_spool,
    ),
    MachineEffect(
        id="spool_rate",
        component="valve",
        physics="The pilot's flow limits the spool's speed.",
        sign="+: faster",
        magnitudes=(factor(0.08, 2.0, "E: 5 to 25 full strokes a second; S14, S15: 2"),),
        operational=(
            Operational(
                "highest speed of the spool in full strokes", "1/s", parameter("steering.valve.spool_rate_limit")
            ),
        ),
        change=scaled("steering.valve.spool_rate_limit"),
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
        change=added("steering.valve.overlap"),
    ),
    MachineEffect(
        id="valve_gain",
        component="valve",
        physics="All metering edges are larger by one factor, or their compensator is set higher.",
        sign="+: more flow",
        magnitudes=(factor(0.75, 1.3, "P: 70.6 measured, 62 L/min on the data sheet"),),
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
            Operational("width of the loop between command and spool", "1", parameter("steering.valve.hysteresis")),
        ),
        hidden="full turns at one signal: only a falling or reversed command shows it",
        change=added("steering.valve.hysteresis"),
    ),
    MachineEffect(
        id="compensator_lag",
        component="valve",
        physics="The pressure compensator closes slower, so that the first rush of oil lasts longer.",
        sign="+: slower",
        magnitudes=(factor(0.1, 5.0, "S16, 1D: 0.2 to 30 ms"),),
        operational=(
            Operational("time of the compensator's stroke under an excess of one setting", "s", _compensator_time),
        ),
        change=_slower_compensator,
    ),
    MachineEffect(
        id="compensator_opening",
        component="valve",
        physics="The compensator, fully open at rest, throttles more or less of the first rush of oil.",
        sign="+: narrower",
        magnitudes=(factor(0.2, 4.0, "E: 1.5 to 6 bar at the nominal flow"),),
        operational=(Operational("pressure drop of the fully open compensator at 60 L/min", "Pa", _open_drop),),
        change=scaled("steering.valve.compensator_open_drop"),
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
                parameter("steering.valve.cross_port_leakage"),
            ),
        ),
        change=added("steering.valve.cross_port_leakage"),
    ),
)
