"""Other forms of the catalogue's effects: the same fault where other laws hold, or by another of its usual causes.

A name like "back pressure" or "worn pins" covers several laws in the literature, and no machine has all of them. Each form
is a change of the machine's parameters as an effect of the catalogue makes it, of the same magnitudes, and scaled so that
the operational magnitude which a bench would show is about the same. Simulated machines have the catalogue's form, another
one or a mix, so that a diagnosis learns what the forms have in common. Forms of the measuring chain act on sampled signals,
in :mod:`aoro_gym.diagnosis.network.sensing`.

Some forms of one effect do what another effect's own form does: a leak's law does not tell where it leaks. On machines of
unknown laws such causes cannot be told apart for sure, and a network is to learn how sure it may be. Sizes are those of the
catalogue's form, whatever the form.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import Effect, MachineEffect
from aoro_gym.effects.magnitudes import REFERENCE_FLOW, REFERENCE_PRESSURE, scaled
from aoro_gym.effects.mass import PAYLOAD_HEIGHT
from aoro_gym.machine import Machine
from aoro_gym.machine.quantities import Quantity

Change = Callable[..., Mapping[str, Quantity]]
"""``change(machine, *magnitudes)`` [SI], as of :class:`~aoro_gym.effects.effect.MachineEffect`."""

FULL_SIGNAL = 2.0
"""[V] of the full steering signal."""
SEAL_PRESSURE = 50e5
"""Mean pressure [Pa] in a cylinder at which energised seals rub as much as preloaded ones (E)."""
SEAL_SPEED = 0.08
"""Speed [m/s] of a rod in a turn at which viscous friction resists as much as dry friction (E: 265 mm in 3 s)."""
STIFFEST = 10.0
"""Most by which a tight bearing's presliding is stiffer, less one (E)."""
WHEEL_SCRUB = 1.5
"""Lever [m] of the rut's grip per rolling resistance: a wheel that sank swivels against the walls of its rut (E)."""


def _renewed_curve(machine: Machine, overlap: Quantity) -> Mapping[str, Quantity]:
    """Laps that are wider while the full signal opens as far as before: the curve is pressed together, as where the notches
    begin later on the same spool. The points at 1.0 and 1.5 V move to o(d + (V − d′)(2 − d)/(2 − d′))."""
    changes: dict[str, Quantity] = {}
    for side in ("left", "right"):
        keys = [
            f"steering.valve.{name}" for name in (f"dead_band_{side}", f"opening_{side}_1V0", f"opening_{side}_1V5")
        ]
        before, low, high = (np.asarray(machine.value(key)) for key in keys)
        after = np.clip(before + overlap, 0.0, 0.95)
        ratio = (FULL_SIGNAL - before) / (FULL_SIGNAL - after)
        for key, volts, old in ((keys[1], 1.0, low), (keys[2], 1.5, high)):
            changes[key] = _opening(before + (volts - after) * ratio, before, low, high) - old
        changes[keys[0]] = after - before
    return changes


def _opening(volts: Quantity, dead: Quantity, low: Quantity, high: Quantity) -> Quantity:
    """Measured opening at a signal: straight lines through the dead band's end, 1.0, 1.5 and 2.0 V."""
    first = low * np.clip((volts - dead) / (1.0 - dead), 0.0, 1.0)
    second = (high - low) * np.clip(2.0 * (np.asarray(volts) - 1.0), 0.0, 1.0)
    return first + second + (1.0 - high) * np.clip(2.0 * (np.asarray(volts) - 1.5), 0.0, 1.0)


def _higher_setting(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """A compensator whose spring is set higher: flow by the root of its pressure."""
    return scaled("steering.valve.compensator_pressure")(machine, factor**2)


def _centred_play(machine: Machine, width: Quantity) -> Mapping[str, Quantity]:
    """A spool that rests in the middle of its play: rising commands lose half of it, falling ones the other half."""
    return {"steering.valve.hysteresis": width, "steering.valve.overlap": 0.5 * FULL_SIGNAL * np.asarray(width)}


def _laminar_leak(machine: Machine, flow: Quantity) -> Mapping[str, Quantity]:
    """A gap from side to side: as much at the reference pressure, in proportion to pressure (Merritt 1967, ch. 3)."""
    return {"steering.cylinder.leakage": np.asarray(flow) / (2.0 * REFERENCE_PRESSURE)}


def _turbulent_leak(machine: Machine, flow: Quantity) -> Mapping[str, Quantity]:
    """A hole from side to side, as a cut seal is: as much at the reference pressure, by its root."""
    return {"steering.valve.cross_port_leakage": flow}


def _filter_resistance(machine: Machine, pressure: Quantity, throttle: Quantity) -> Mapping[str, Quantity]:
    """A fine filter, which is laminar: pressure in proportion to flow (Darcy)."""
    share = REFERENCE_FLOW / np.asarray(machine.steering.tank_line.back_flow)
    return {"steering.tank_line.back_pressure_ramp": (np.asarray(pressure) + throttle) / share}


def _longer_hoses(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """Hoses of another length or bore, whose walls and oil give way in proportion."""
    return scaled("steering.hose_volume")(machine, factor)


def _energised_seals(machine: Machine, preload: Quantity) -> Mapping[str, Quantity]:
    """Lips that pressure drives against the rod: friction by pressure instead of by preload."""
    return {"steering.cylinder.seal_pressure_coefficient": np.asarray(preload) / (2.0 * SEAL_PRESSURE)}


def _viscous_seals(machine: Machine, preload: Quantity) -> Mapping[str, Quantity]:
    """Half dry, half viscous: swollen seals on a thick film."""
    half = 0.5 * np.asarray(preload)
    return {"steering.cylinder.seal_preload": half, "steering.cylinder.seal_viscous": half / SEAL_SPEED}


def _stiff_bearing(machine: Machine, torque: Quantity) -> Mapping[str, Quantity]:
    """A tight bearing that breaks away at the same angle: presliding is stiffer by as much as friction."""
    share = np.minimum(np.asarray(torque) / np.maximum(machine.joint.friction_torque, 1.0), STIFFEST)
    return {"joint.friction_torque": torque, **scaled("joint.presliding_stiffness")(machine, 1.0 + share)}


def _free_play(machine: Machine, play: Quantity, compliance: Quantity) -> Mapping[str, Quantity]:
    """A play between pins that are stiff wherever they touch."""
    return {"joint.backlash": play}


def _rear_load(machine: Machine, mass: Quantity) -> Mapping[str, Quantity]:
    """A load on the rear frame over the middle of its axle, as that on the front one (parallel axes)."""
    rear = machine.frame.rear
    share = mass / (rear.mass + np.asarray(mass))
    ahead, above = np.asarray(rear.cog_offset), PAYLOAD_HEIGHT - np.asarray(rear.cog_height)
    reduced = rear.mass * share
    return {
        "frame.rear.mass": mass,
        "frame.rear.cog_offset": -share * ahead,
        "frame.rear.cog_height": share * above,
        "frame.rear.inertia_xx": reduced * above**2,
        "frame.rear.inertia_yy": reduced * (ahead**2 + above**2),
        "frame.rear.inertia_zz": reduced * ahead**2,
    }


def _relaxation_lengths(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """The way on which grip builds up, where a tire's law has it: shorter of a stiffer one (Pacejka 2012, ch. 5)."""
    return {
        **scaled("tire.relaxation_longitudinal", "tire.relaxation_lateral")(machine, 1.0 / np.asarray(factor)),
        **scaled("tire.sigma0_lateral")(machine, factor),
    }


def _inflated(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """Another inflation, which moves a tire's stiffness in every direction: vertical, in the ground's plane, swivelling."""
    return {
        **scaled("tire.stiffness", "tire.sigma0_longitudinal", "tire.sigma0_lateral", "tire.bore_stiffness")(
            machine, factor
        ),
        **scaled("tire.scrub_angle")(machine, 1.0 / np.asarray(factor)),
    }


def _rut(machine: Machine, resistance: Quantity) -> Mapping[str, Quantity]:
    """Ground that resists rolling and, in the rut, swivelling."""
    lever = WHEEL_SCRUB * np.asarray(resistance)
    bore = machine.laws.obeys("swivel", "bore_torque")
    return {
        "tire.rolling_resistance": resistance,
        "tire.scrub_radius": np.where(bore, 0.0, lever),
        "tire.bore_radius": np.where(bore, lever, 0.0),
    }


def _up_alone(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """A swash that is slow or fast on its way out only: a narrow or wide control edge."""
    return scaled("steering.pump.stroke_up_time")(machine, factor)


def _late_load_sensing(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """The load's pressure that reaches the pump later: the time from standby to flow is longer by as much."""
    later = np.asarray(machine.steering.pump.stroke_up_time) * np.maximum(np.asarray(factor) - 1.0, 0.0)
    return {
        "steering.pump.ls_time_constant": 0.3 * later,
        **scaled("steering.pump.stroke_up_time", "steering.pump.stroke_down_time")(machine, np.asarray(factor) ** 0.7),
    }


def _slow_controller(machine: Machine, factor: Quantity) -> Mapping[str, Quantity]:
    """A controller of another gain: its band and its valve's times go with the swash's."""
    return scaled(
        "steering.pump.control_band", "steering.pump.valve_time_constant", "steering.pump.stroke_up_time",
        "steering.pump.stroke_down_time",
    )(machine, np.asarray(factor) ** 0.7)  # fmt: skip


FORMS: Mapping[str, tuple[Change, ...]] = {
    "pump_response": (_up_alone, _late_load_sensing, _slow_controller),
    "dead_band": (_renewed_curve,),
    "valve_gain": (_higher_setting,),
    "valve_hysteresis": (_centred_play,),
    "back_pressure": (_filter_resistance,),
    "hose_compliance": (_longer_hoses,),
    "cylinder_leakage": (_turbulent_leak,),
    "cross_port_leakage": (_laminar_leak,),
    "seal_friction": (_energised_seals, _viscous_seals),
    "joint_friction": (_stiff_bearing,),
    "joint_backlash": (_free_play,),
    "payload": (_rear_load,),
    "tire_relaxation": (_relaxation_lengths,),
    "tire_stiffness": (_inflated,),
    "soft_ground": (_rut,),
}
"""Forms beside the catalogue's, by effect."""


@cache
def moved_keys() -> frozenset[str]:
    """Parameters that a form of any effect moves."""
    machine = Machine.load("aoro")
    return frozenset(
        key for effect, changes in FORMS.items() for change in changes for key in change(machine, *EFFECTS[effect].none)
    )


def drawn_form(effect: Effect, count: int, own: float, mixed: float, varied: float, rng: np.random.Generator) -> Effect:
    """``effect`` on ``count`` machines, each with a form of its own.

    Args:
        effect: Of the catalogue; one without other forms is drawn from its own alone.
        count: Machines.
        own: Share of the machines that have the catalogue's form alone.
        mixed: Share of the others that have a mix of all forms, by shares that are even on the simplex; the rest have one.
        varied: Standard deviation of the logarithm of a factor on each parameter's change, one a machine and parameter, on
            machines without the catalogue's own form: no law holds to the per cent. The factors of a change have the
            geometric mean 1, so that its size stays.
        rng: Random numbers.
    """
    if not isinstance(effect, MachineEffect):
        return effect
    changes = (effect.change, *FORMS.get(effect.id, ()))
    other = rng.random(count) >= own
    share = _shares(len(changes), other, mixed, rng)
    state = int(rng.integers(2**63))

    def change(machine: Machine, *magnitudes: Quantity) -> Mapping[str, Quantity]:
        total: dict[str, Quantity] = {}
        for weight, one in zip(share, changes, strict=True):
            for key, amount in one(machine, *magnitudes).items():
                total[key] = total.get(key, 0.0) + weight * np.asarray(amount)
        if len(total) == 1:
            return total
        again = np.random.default_rng(state)  # the same factors however often sizes are tried
        factor = again.standard_normal((len(total), count))
        factor = np.where(other, np.exp(varied * (factor - factor.mean(axis=0))), 1.0)
        return {key: amount * own for (key, amount), own in zip(sorted(total.items()), factor, strict=True)}

    return replace(effect, change=change)


def _shares(forms: int, other: NDArray[np.bool_], mixed: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Shares (forms, N) of the forms on each of N machines: the first alone, or ``other``."""
    count = len(other)
    share = np.zeros((forms, count))
    share[0] = 1.0
    if forms == 1:
        return share
    mix = rng.random(count) < mixed
    one = np.eye(forms)[rng.integers(1, forms, count)].T
    many = rng.dirichlet(np.ones(forms), count).T
    return np.where(other, np.where(mix, many, one), share)
