"""What each effect of the catalogue does to the key figures of full left turns by theory, and where theory is silent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.effects.joint import TIGHT
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import SAMPLE_RATE, measured_flow, sample
from aoro_gym.simulation.key_figures import FIRST_PEAK_END, SECOND_PEAK, UNDERSHOOT_END, key_figures_batch, turn_span
from aoro_gym.terrains.plane import Plane
from aoro_gym.validation.theory.circuit import Array, chambers, steady_turn
from aoro_gym.validation.theory.planar import Planar
from aoro_gym.validation.theory.states import PHI
from aoro_gym.validation.turns import REST_AFTER, REST_BEFORE, repeated, stacked

FIGURES = (
    "turn_time_s",
    "first_peak_L_per_min",
    "lowest_undershoot_L_per_min",
    "second_peak_L_per_min",
    "steady_flow_L_per_min",
)
"""Key figures that theory speaks of."""
LEVELS = (1.0, 0.75, 0.5)
"""Steering signals of the turns."""
TRANSIENT = 2.6
"""Time [s] from the command on that the planar machine is integrated for; then its joint takes the steady turn's flow. The
published turns at 100 and 75 % are over by then."""
RATE = 1000.0
"""Samples a second [Hz] of the angle before the logger's."""
PHASES = 10
"""Phases of the logger's clock, a millisecond apart, over which figures are averaged: they are read from samples."""
SHARE, FACTOR = 0.02, 0.05
"""Size of a change: as a share of the magnitude's range beyond none; what it adds to a factor of one."""
SIZES: Mapping[str, float] = {"joint_backlash": 2.0 * TIGHT, "measuring_chain": 0.015}
"""Sizes of changes that are nothing below a threshold: pins that touch all round, a corner above the chain's own 7 Hz."""

SILENT: Mapping[str, str] = {
    "command_delay": "t = 0 is where the joint leaves: all of the turn comes later",
    "engine_droop": "load sensing strokes the pump until the margin holds: the flow is the valve's at any engine speed",
    "sensor_delay": "t = 0 and the stop are read from the same late angle",
    "valve_hysteresis": "a turn's command only rises, and the opening curve is that of rising commands",
}
"""Why theory expects no change."""


@dataclass(frozen=True)
class Change:
    """One effect's magnitude moved a little from where the effect is absent."""

    effect: str
    magnitude: str
    sizes: tuple[tuple[float, ...], ...]
    """Magnitudes of the effect: one tuple a side, the upward one first; one where the range ends at none."""
    unit: str

    @property
    def name(self) -> str:
        """Id of the effect, with the magnitude where the effect has two."""
        return self.effect if len(EFFECTS[self.effect].magnitudes) == 1 else f"{self.effect}.{self.magnitude}"


def changes() -> list[Change]:
    """Changes of every effect of the catalogue in alphabetical order.

    Without the compliance of a play, which is none without the play.
    """
    found = []
    for name in sorted(IDS):
        effect = EFFECTS[name]
        for index, one in enumerate(effect.magnitudes):
            if name == "joint_backlash" and one.name == "compliance":
                continue
            if one.scale == "log":
                sides = [1.0 + FACTOR, 1.0 / (1.0 + FACTOR)]
            else:
                size = SIZES.get(name, SHARE * (one.high - one.none))
                sides = [size, -size] if one.low < one.none else [size]
            if name == "sensor_gain":  # a sensor that reads too little never reads the stop
                sides = sides[:1]
            sizes = tuple(
                tuple(side if at == index else other.none for at, other in enumerate(effect.magnitudes))
                for side in sides
            )
            found.append(Change(name, one.name, sizes, one.unit))
    return found


@dataclass(frozen=True, eq=False)
class Cases:
    """The machine as it is and with every change, each at every level: one lane a turn, level by level."""

    changes: tuple[Change, ...]
    machine: Machine  # L lanes
    level: Array  # (L,)
    plane: Plane
    lanes: tuple[tuple[str, tuple[float, ...]], ...]
    """Effect ("" for none) and magnitudes of the lanes of one level."""

    @property
    def count(self) -> int:
        """Lanes of one level."""
        return len(self.lanes)

    def recorded(self, angle: Array) -> Array:
        """Angles (F, L) as the logger has them: effects of the measuring chain act on theirs."""
        out = angle.copy()
        for lane, (name, magnitudes) in enumerate(self.lanes):
            if name:
                for at in range(lane, len(self.level), self.count):
                    signals = EFFECTS[name].record({"joint_angle": angle[:, at : at + 1]}, RATE, *magnitudes)
                    out[:, at] = signals["joint_angle"][:, 0]
        return out

    def figures(self, time: Array, angle: Array) -> Array:
        """Key figures (phases, levels, lanes, figures) of angles (F, L) [rad] at :data:`RATE`, read between samples."""
        recorded, read = self.recorded(angle), []
        for phase in range(PHASES):
            ticks, sampled = sample(time, recorded, offset=phase / (PHASES * SAMPLE_RATE))
            values = key_figures_batch(ticks, sampled, self.machine, interpolate=True)
            read.append(np.stack([values[name] for name in FIGURES], axis=-1))
        return np.stack(read).reshape(PHASES, len(LEVELS), self.count, len(FIGURES))

    def sensitivities(self, values: Array) -> tuple[Array, Array]:
        """Relative change (levels, changes, figures) by each change, and what it scatters by with the clock's phase.

        Half the difference between both sides where there are two, so that what is even in the change falls out.

        Args:
            values: Key figures as of :meth:`figures`.
        """
        rows, lane = [], 1
        for change in self.changes:
            sides = values[:, :, lane : lane + len(change.sizes)]
            other = sides[:, :, 1] if len(change.sizes) == 2 else values[:, :, 0]
            rows.append((sides[:, :, 0] - other) / (len(change.sizes) * values[:, :, 0]))
            lane += len(change.sizes)
        each = np.stack(rows, axis=2)
        return each.mean(axis=0), each.std(axis=0)

    def places(self, time: Array, angle: Array) -> Array:
        """Instants [s] (levels, 2) since t = 0 of lowest undershoot and second peak of the machine as it is."""
        lanes = np.arange(len(LEVELS)) * self.count
        cylinder = self.machine.variants(lanes).steering.cylinder
        ticks, sampled = sample(time, angle[:, lanes])
        span = turn_span(ticks, sampled, cylinder.half_range, interpolate=True)
        flow, since = measured_flow(cylinder, sampled, span.direction), ticks[:, None] - span.began
        peak = np.argmax(np.where((since >= 0.0) & (since < FIRST_PEAK_END), flow, -np.inf), axis=0)
        after = since > since[peak, np.arange(len(LEVELS))]
        low = np.argmin(np.where(after & (since <= UNDERSHOOT_END), flow, np.inf), axis=0)
        second = np.argmax(np.where((since >= SECOND_PEAK[0]) & (since <= SECOND_PEAK[1]), flow, -np.inf), axis=0)
        return np.stack([since[row, np.arange(len(LEVELS))] for row in (low, second)], axis=1)


def cases(machine: Machine, wanted: Sequence[Change] | None = None) -> Cases:
    """Lanes of ``machine`` (one variant) for ``wanted`` changes, by default all."""
    chosen = tuple(changes() if wanted is None else wanted)
    lanes: list[tuple[str, tuple[float, ...]]] = [("", ())]
    machines, slopes = [machine], [Plane()]
    for change in chosen:
        effect = EFFECTS[change.effect]
        for size in change.sizes:
            lanes.append((change.effect, size))
            machines.append(effect.apply(machine, *size))
            slopes.append(effect.tilt(Plane(), *size))
    times = len(LEVELS)
    plane = Plane(
        slope_deg=np.tile([float(np.asarray(one.slope_deg)) for one in slopes], times),
        direction_deg=np.tile([float(np.asarray(one.direction_deg)) for one in slopes], times),
    )
    return Cases(chosen, repeated(stacked(machines), times), np.repeat(LEVELS, len(lanes)), plane, tuple(lanes))


def predicted_angles(
    turns: Cases, without: Sequence[Sequence[str]] = (), transient: float = TRANSIENT
) -> tuple[Array, Array]:
    """Instants [s] (F,) and joint angles [rad] (F, L) of planar machines: rest, transient, steady turn, rest at the stop.

    Args:
        turns: The lanes.
        without: Limits out of reach, one sequence a lane; see :data:`aoro_gym.validation.theory.states.LIMITS`.
        transient: Time [s] from the command on that is integrated.
    """
    machine = turns.machine
    reach = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), turns.level.shape)
    gradient = np.tan(np.radians(turns.plane.slope_deg))
    toward = np.radians(turns.plane.direction_deg)
    aside = 0.5 * reach  # the hinge moves across the bisector of both headings, the front one along x at the start
    slope = gradient * (np.cos(toward) * np.sin(-aside) + np.sin(toward) * np.cos(aside))
    planar = Planar(machine, turns.level, slope, without)
    time, states = planar.turn(transient, 1.0 / RATE)
    return continued(machine, turns.level, time, 2.0 * states[:, PHI], 2.0 * planar.half.half_track * planar.half.drag)


def continued(machine: Machine, level: ArrayLike, time: Array, angle: Array, load: ArrayLike) -> tuple[Array, Array]:
    """Instants and angles (F, L) of a whole recording: rest before the transient, then the steady turn's flow to the stop.

    Args:
        machine: L lanes.
        level: Steering signals (L,).
        time: Instants of the transient [s] (K,), from the command on.
        angle: Its joint angles [rad] (K, L).
        load: Torque [N m] by which the ground resists the joint.
    """
    reach = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), angle.shape[1:])
    flow = steady_turn(machine, level, np.zeros(angle.shape[1]), load).flow
    grid = np.linspace(-1.0, 1.0, 4001)[:, None] * reach
    volume = chambers(machine, grid).volume_a
    begin = np.array([np.interp(a, g, v) for a, g, v in zip(angle[-1], grid.T, volume.T, strict=True)])
    longest = max(0.0, float(((volume[-1] - begin) / flow).max()))
    after = np.arange(1, round((longest + REST_AFTER) * RATE) + 1) / RATE
    turned = np.stack(
        [np.interp(b + q * after, v, g) for b, q, v, g in zip(begin, flow, volume.T, grid.T, strict=True)], axis=1
    )
    before = np.repeat(angle[:1], round(REST_BEFORE * RATE), axis=0)
    whole = np.concatenate([before, angle, turned])
    return np.arange(len(whole)) / RATE, whole
