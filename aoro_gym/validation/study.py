"""The validation: full turns of the twin beside the published machine and the published twin."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.execution.files import write_json
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import SAMPLE_RATE, measured_flow, sample
from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch, steady_swing_batch, turn_span
from aoro_gym.twin.hydraulic_step import FineStepWarning
from aoro_gym.units import BAR, LITRE_PER_MINUTE
from aoro_gym.validation.published import Row, published, published_rows
from aoro_gym.validation.shape import SHAPE, SHAPE_TURN, shape_batch
from aoro_gym.validation.turns import TURNS, Turn, TurnRecording, motor_pressure_at, rim_speed, run_turns, stacked

TARGETS: Mapping[str, tuple[str, float]] = {
    "turn_time_s": ("relative", 0.02),
    "mean_flow_L_per_min": ("relative", 0.02),
    "steady_flow_L_per_min": ("relative", 0.02),
    "first_peak_L_per_min": ("relative", 0.05),
    "first_peak_time_s": ("difference", 0.02),
    "lowest_undershoot_L_per_min": ("relative", 0.08),
    "second_peak_L_per_min": ("relative", 0.08),
}
"""How near the twin is to be to the published one: kind of error and its bound."""

SWING_TARGET = 0.02
"""How near, relative, the flow is to be to a straight line in the steady period: the published twin's is called steady, and
a wave within the bound of the steady flow itself does not tell it from one that is."""
TURN_TIME_TARGET = 0.01
"""How near [s] the times of full turns at full signal are to be to the machine's."""
MOTOR_PRESSURE_TARGET = 0.02
"""How near, relative, the motors' pressure drop is to be to the machine's; the disc brake is set by it."""
BARE_PRESSURE_TARGET = 0.25
"""The same without the disc brake: only its order is asked for."""
RIM_SPEED_TARGET = 0.02
"""How near, relative, the rims' largest speed in the full left turn is to be to the machine's, given in two digits."""
MASS_TARGET = 0.05
"""How near, relative, the mass is to be to the machine's, given in one digit."""
RIGHT_FLOW_TARGET = 0.02
"""How near, relative, the mean flows of right turns below full signal are to be to the machine's."""
HALF_STEP_TARGET = 0.005
"""Largest relative change of any key figure that halving the hydraulic step may make."""

_SLACK = 1e-9  # a published figure has few decimals: 1.98 + 0.01 must not fail by rounding


@dataclass(frozen=True, eq=False)
class FlowCurve:
    """What is drawn of one turn; time [s] counts from t = 0 of the key figures."""

    turn: Turn
    time: NDArray[np.float64]  # 100 samples a second
    flow: NDArray[np.float64]  # [L/min] of the measuring chain
    raw_time: NDArray[np.float64]
    raw_flow: NDArray[np.float64]  # [L/min] unfiltered
    uncalibrated_time: NDArray[np.float64]
    uncalibrated_flow: NDArray[np.float64]  # [L/min] of the measuring chain; empty without a second machine
    low: NDArray[np.float64]  # [L/min] on `time`: least and largest of the ensemble; empty without one
    high: NDArray[np.float64]


@dataclass(frozen=True)
class Miss:
    """How far a figure of a turn is from a published one."""

    figure: str
    signal_percent: float
    direction: str
    error: float | None
    """None where the twin has no such figure."""
    kind: str
    """``relative`` or ``difference``."""
    bound: float

    @property
    def in_bounds(self) -> float:
        """The error's size as a multiple of its bound."""
        return math.inf if self.error is None else abs(self.error) / (self.bound + _SLACK)

    @property
    def words(self) -> str:
        """Such as ``first peak at 50 %, +38.9 %``."""
        from aoro_gym.reporting.page import describe

        name, unit, _ = describe(self.figure)
        if self.error is None:
            miss = "not reached"
        elif self.kind == "relative":
            miss = f"{100.0 * self.error:+.1f} %"
        else:
            miss = f"{self.error:+.2f} {unit}"
        return f"the {name} at {self.signal_percent:g} % signal, {miss}"


@dataclass(frozen=True, eq=False)
class Validation:
    """What :func:`validate` found; flows in L/min, times in s."""

    machine: str
    uncalibrated: str | None
    rows: list[Row]
    """Key figures: ``twin``, ``twin_raw``, ``twin_uncalibrated``, ``physical`` and ``mevea`` of every turn."""
    errors: list[dict[str, Any]]
    """For each row of a twin and each published row: ``relative``, ``difference`` and ``reached`` by figure."""
    noise: list[dict[str, Any]]
    """What the sensor's noise and clock do to the twin's figures: ``low90``, ``median`` and ``high90`` by figure."""
    noise_runs: int
    ensemble: list[dict[str, Any]]
    """``low``, ``median`` and ``high`` of the ensemble's members by figure."""
    ensemble_members: int
    checks: list[dict[str, Any]]
    """Single figures: ``value``, ``published``, ``bound`` and ``reached``."""
    shape: list[dict[str, Any]]
    """The same of the left turn's shape at 100 %, with ``name``: see :mod:`aoro_gym.validation.shape`."""
    notes: list[str]
    curves: list[FlowCurve] = field(default_factory=list)

    def row(self, source: str, turn: Turn) -> Row | None:
        """The row of ``source`` for ``turn``, if there is one."""
        wanted = (source, turn.direction, turn.signal_percent)
        for row in self.rows:
            if (row["source"], row["direction"], row["signal_percent"]) == wanted:
                return row
        return None

    def entry(self, listed: list[dict[str, Any]], turn: Turn, **keys: str) -> dict[str, Any] | None:
        """The entry of ``errors``, ``noise`` or ``ensemble`` for ``turn``."""
        for item in listed:
            if (item["direction"], item["signal_percent"]) == (turn.direction, turn.signal_percent) and all(
                item[key] == value for key, value in keys.items()
            ):
                return item
        return None

    def reached(self, source: str = "twin") -> tuple[int, int]:
        """How many of the published twin's figures ``source`` reaches, and how many there are."""
        marks = [
            mark
            for item in self.errors
            if item["source"] == source and item["reference"] == "mevea"
            for mark in item["reached"].values()
            if mark is not None
        ]
        return sum(marks), len(marks)

    def misses(self, reference: str, source: str = "twin") -> list[Miss]:
        """How far the figures of ``source`` are from those of a published ``reference``, by the bounds of
        :data:`TARGETS`; the farthest first, those that are not known before all."""
        found = []
        for item in self.errors:
            if item["source"] != source or item["reference"] != reference:
                continue
            published_row = self.row(reference, Turn(item["direction"], item["signal_percent"]))
            for name, (kind, bound) in TARGETS.items():
                if published_row is None or published_row[name] is None:
                    continue
                error = item[kind][name]
                found.append(Miss(name, item["signal_percent"], item["direction"], error, kind, bound))
        return sorted(found, key=lambda one: -one.in_bounds)

    def headline(self) -> str:
        """How near the twin is to what was published: to the machine itself, and to its published twin."""
        machine, twin = self.misses("physical"), self.misses("mevea")
        near, near_twin = (sum(one.in_bounds <= 1.0 for one in misses) for misses in (machine, twin))
        text = (
            f"Full turns, by the same bounds: {near} of {len(machine)} figures of the published machine itself are met, and "
            f"{near_twin} of {len(twin)} of its published twin; of the shape of that one's curve {self.shape_reached} of "
            f"{len(self.shape)}"
        )
        return f"{text}. Farthest from the machine: {machine[0].words}." if machine else f"{text}."

    @property
    def shape_reached(self) -> int:
        """How many figures of the shape are reached."""
        return sum(figure["reached"] for figure in self.shape)

    def misfit(self, source: str = "twin") -> float | None:
        """Root mean square of error over bound against the published twin; None where a figure is missing."""
        errors = [
            (item[kind][name], bound)
            for item in self.errors
            if item["source"] == source and item["reference"] == "mevea"
            for name, (kind, bound) in TARGETS.items()
        ]
        if not errors or any(error is None for error, _ in errors):
            return None
        return math.sqrt(sum((error / bound) ** 2 for error, bound in errors) / len(errors))

    def to_json(self) -> dict[str, Any]:
        """Content of ``validation.json``."""
        return {
            "machine": self.machine,
            "uncalibrated": self.uncalibrated,
            "rows": self.rows,
            "errors": self.errors,
            "reached": {
                source: {
                    "figures": self.reached(source)[0],
                    "of": self.reached(source)[1],
                    "misfit": self.misfit(source),
                }
                for source in ("twin", "twin_raw", *(["twin_uncalibrated"] if self.uncalibrated is not None else []))
            },
            "noise": {"runs": self.noise_runs, "rows": self.noise},
            "ensemble": {"members": self.ensemble_members, "rows": self.ensemble},
            "checks": self.checks,
            "shape": self.shape,
            "notes": self.notes,
        }

    def save(self, path: Path) -> None:
        """Write :meth:`to_json` to ``path``, whole or not at all."""
        write_json(path, self.to_json())


def validate(
    machine: str | Path | Machine = "aoro",
    *,
    uncalibrated: str | Path | Machine | None = None,
    ensemble: Machine | Sequence[str | Path | Machine] = (),
    device: str = "cpu",
    seed: int = 0,
    noise: JointAngleNoise | None = None,
    noise_runs: int = 200,
    substeps: int = 30,
    progress: Callable[[str, float], Any] | None = None,
) -> Validation:
    """Full turns to both sides at 100, 75 and 50 % signal, in one launch, and two straight drives.

    Args:
        machine: The machine asked for: name, file or :class:`Machine`. Of a machine with variants the first is taken,
            and all of them make the ensemble.
        uncalibrated: A second machine to compare with, in rows ``twin_uncalibrated``.
        ensemble: Machines that are thought to fit equally well, or one with a variant each; their spread is reported.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        seed: Of the sensor's noise.
        noise: What the joint-angle sensor adds; the published kind by default.
        noise_runs: How many noisy recordings of each turn show the spread; 0 for none.
        substeps: Hydraulic substeps a main step.
        progress: Called with what is being done and the share that is.

    The figures are without noise. Twins that diverged have none (null), and a note says why.
    """
    tell = progress or (lambda what, share: None)
    chosen = _machine(machine)
    members = [ensemble] if isinstance(ensemble, Machine) else [_machine(member) for member in ensemble]
    if chosen.num_variants > 1:
        members = members or [chosen]
        chosen = chosen.variant(0)
    second = None if uncalibrated is None else _machine(uncalibrated)
    family = [chosen, *([second] if second is not None else []), *members]

    tell(f"full turns, {len(TURNS) * sum(m.num_variants for m in family)} twins", 0.0)
    recording = run_turns(stacked(family), device=device, substeps=substeps)
    exact, raw = _figures(recording), _raw_figures(recording)
    rows: list[Row] = []
    for index, turn in enumerate(TURNS):
        rows.append(_row(turn, "twin", exact, index, 0))
        rows.append(_row(turn, "twin_raw", raw, index, 0))
        if second is not None:
            rows.append(_row(turn, "twin_uncalibrated", exact, index, 1))
    rows += published_rows()

    first_member = 1 + (second is not None)
    tell("sensor noise", 0.3)
    spread = noise_spread(recording, noise or JointAngleNoise.published(), noise_runs, seed) if noise_runs else []
    tell("half the hydraulic step, and straight drives", 0.6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FineStepWarning)
        fine = run_turns(chosen, device=device, substeps=2 * substeps)
    names = [chosen.name, *([second.name] if second is not None else [])]
    return Validation(
        machine=names[0],
        uncalibrated=names[1] if second is not None else None,
        rows=rows,
        errors=_errors(rows),
        noise=spread,
        noise_runs=noise_runs,
        ensemble=_ensemble(exact, first_member) if members else [],
        ensemble_members=sum(member.num_variants for member in members),
        checks=[
            *_checks(rows, chosen, device, substeps),
            *_swings(recording),
            _check(
                "largest change of a flow figure by half the hydraulic step",
                "1",
                _largest_change(recording, fine),
                None,
                HALF_STEP_TARGET,
            ),
        ],
        shape=_shape(recording),
        notes=_notes(recording, exact, names),
        curves=_curves(recording, exact, second is not None, first_member if members else None),
    )


def _machine(machine: str | Path | Machine) -> Machine:
    return machine if isinstance(machine, Machine) else Machine.load(machine)


def _shaped(recording: TurnRecording, flat: dict[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    return {name: values.reshape(recording.angle.shape[1:]) for name, values in flat.items()}


def _figures(recording: TurnRecording, *, interpolate: bool = False) -> dict[str, NDArray[np.float64]]:
    """Key figures (T, V) through the measuring chain, from samples without noise."""
    ticks, angle = sample(recording.time, recording.angle.reshape(len(recording.time), -1))
    return _shaped(recording, key_figures_batch(ticks, angle, recording.machine, interpolate=interpolate))


def _raw_figures(recording: TurnRecording) -> dict[str, NDArray[np.float64]]:
    """Key figures (T, V) of the simulated flow, unfiltered, at every main step."""
    frames = len(recording.time)
    angle, flow = recording.angle.reshape(frames, -1), recording.flow.reshape(frames, -1)
    return _shaped(recording, key_figures_batch(recording.time, angle, recording.machine, flow=flow))


def _row(turn: Turn, source: str, figures: dict[str, NDArray[np.float64]], index: int, variant: int) -> Row:
    row: Row = {"direction": turn.direction, "signal_percent": turn.signal_percent, "source": source}
    return row | {name: _number(figures[name][index, variant]) for name in FIGURES}


def _number(value: ArrayLike) -> float | None:
    """A figure for JSON: None where there is none; digits beyond a millionth are rounding of single precision."""
    number = float(np.asarray(value))
    return float(f"{number:.7g}") if math.isfinite(number) else None


def _errors(rows: list[Row]) -> list[dict[str, Any]]:
    errors = []
    for row in rows:
        for reference in rows:
            if not str(row["source"]).startswith("twin") or reference["source"] not in ("physical", "mevea"):
                continue
            if any(row[key] != reference[key] for key in ("direction", "signal_percent")):
                continue
            difference: dict[str, float | None] = dict.fromkeys(FIGURES)
            relative, reached = dict(difference), dict.fromkeys(FIGURES)
            for name in FIGURES:
                value, published_value = row[name], reference[name]
                if isinstance(value, float) and isinstance(published_value, float):
                    difference[name] = value - published_value
                    relative[name] = value / published_value - 1.0
                if isinstance(published_value, float) and reference["source"] == "mevea":
                    kind, bound = TARGETS[name]
                    error = difference[name] if kind == "difference" else relative[name]
                    reached[name] = error is not None and abs(error) <= bound + _SLACK
            errors.append(
                {key: row[key] for key in ("direction", "signal_percent", "source")}
                | {"reference": reference["source"]}
                | {"relative": relative, "difference": difference, "reached": reached}
            )
    return errors


def noise_spread(recording: TurnRecording, noise: JointAngleNoise, runs: int, seed: int) -> list[dict[str, Any]]:
    """Spread of the first machine's figures over noisy recordings, each with a clock that ticks at another instant.

    One entry for each of :data:`TURNS`: ``low90``, ``median`` and ``high90`` by figure.
    """
    every = round(1.0 / (SAMPLE_RATE * (recording.time[1] - recording.time[0])))
    sensor = JointAngleSensor(noise=noise)
    machine = recording.machine.variant(0)
    spread = []
    for index, (turn, rng) in enumerate(zip(TURNS, np.random.default_rng(seed).spawn(len(TURNS)), strict=True)):
        count = (len(recording.time) - every + 1) // every
        picked = np.arange(count)[:, None] * every + rng.integers(every, size=runs)
        ticks, measured = sensor.record(recording.angle[picked, index, 0], np.arange(count) / SAMPLE_RATE, rng)
        figures = key_figures_batch(ticks, measured, machine)
        entry: dict[str, Any] = {"direction": turn.direction, "signal_percent": turn.signal_percent}
        for name in FIGURES:
            known = figures[name][np.isfinite(figures[name])]
            low, median, high = np.percentile(known, (5, 50, 95)) if known.size else (np.nan,) * 3
            entry[name] = {"low90": _number(low), "median": _number(median), "high90": _number(high)}
        spread.append(entry)
    return spread


def _ensemble(figures: dict[str, NDArray[np.float64]], first: int) -> list[dict[str, Any]]:
    rows = []
    for index, turn in enumerate(TURNS):
        entry: dict[str, Any] = {"direction": turn.direction, "signal_percent": turn.signal_percent}
        for name in FIGURES:
            values = figures[name][index, first:]
            known = values[np.isfinite(values)]
            low, median, high = (known.min(), np.median(known), known.max()) if known.size else (np.nan,) * 3
            entry[name] = {"low": _number(low), "median": _number(median), "high": _number(high)}
        rows.append(entry)
    return rows


def _checks(
    rows: list[Row],
    machine: Machine,
    device: str,
    substeps: int,
) -> list[dict[str, Any]]:
    """Single figures beside the published ones."""

    def figure(name: str, source: str, direction: str, level: float = 100.0) -> float | None:
        for row in rows:
            if (row["source"], row["direction"], row["signal_percent"]) == (source, direction, level):
                value = row[name]
                return value if isinstance(value, float) else None
        return None

    checks = []
    for direction in ("left", "right"):
        value, known = (figure("turn_time_s", source, direction) for source in ("twin_raw", "physical"))
        checks.append(_check(f"full turn to the {direction}, full signal", "s", value, known, TURN_TIME_TARGET))
    for level in (75.0, 50.0):
        value, known = (figure("mean_flow_L_per_min", source, "right", level) for source in ("twin", "physical"))
        bound = RIGHT_FLOW_TARGET * (known or 0.0)
        checks.append(_check(f"mean flow of the right turn, {level:g} % signal", "L/min", value, known, bound))
    speed = published("drive_speed")
    for brake, name, share in (
        (True, "motor_pressure", MOTOR_PRESSURE_TARGET),
        (False, "motor_pressure_without_brake", BARE_PRESSURE_TARGET),
    ):
        pressure = motor_pressure_at(speed, machine, brake=brake, device=device, substeps=substeps)
        what = f"motor pressure at {speed:g} m/s, {'with' if brake else 'without'} the disc brake"
        checks.append(_check(what, "bar", _number(pressure[0] / BAR), published(name), share * published(name)))
    rim = rim_speed(machine, device=device, substeps=substeps)
    known = published("rim_speed")
    what = "fastest tire rim in the full left turn, full signal"
    checks.append(_check(what, "m/s", _number(rim[0]), known, RIM_SPEED_TARGET * known))
    known = published("mass")
    checks.append(_check("mass", "kg", _number(machine.mass), known, MASS_TARGET * known))
    return checks


def _swings(recording: TurnRecording) -> list[dict[str, Any]]:
    """How far [%] from its straight line the flow of the first machine's left turns is in the steady period."""
    ticks, angle = sample(recording.time, recording.angle[:, :, 0])
    turns = [turn for turn in recording.turns if turn.direction == "left"]
    places = [recording.turns.index(turn) for turn in turns]
    swing = steady_swing_batch(ticks, angle[:, places], recording.machine.variant(0))
    farthest = 100.0 * np.max(list(swing.values()), axis=0)
    bound = 100.0 * SWING_TARGET
    return [
        _check(f"steady flow's swing, left turn, {turn.signal_percent:g} % signal", "%", _number(far), 0.0, bound)
        for turn, far in zip(turns, farthest, strict=True)
    ]


def _largest_change(coarse: TurnRecording, fine: TurnRecording) -> float | None:
    """Largest relative difference between the first machines' flow figures, read between samples: a turn that ends at
    the edge of a sample must not look like one that changed."""
    before, after = _figures(coarse, interpolate=True), _figures(fine, interpolate=True)
    names = [name for name in FIGURES if name.endswith("L_per_min")]
    changes = np.array([after[name][:, 0] / before[name][:, 0] - 1.0 for name in names])
    return _number(np.nanmax(np.abs(changes))) if np.isfinite(changes).any() else None


def _check(what: str, unit: str, value: float | None, known: float | None, bound: float) -> dict[str, Any]:
    reached = value is not None and abs(value - (known or 0.0)) <= bound + _SLACK
    return {"what": what, "unit": unit, "value": value, "published": known, "bound": bound, "reached": reached}


def _shape(recording: TurnRecording) -> list[dict[str, Any]]:
    """Figures of the shape of the first machine's left turn at 100 %, through the measuring chain."""
    turn = recording.turns.index(SHAPE_TURN)
    machine = recording.machine.variant(turn * recording.angle.shape[2] % recording.machine.num_variants)
    channels = [channel[:, turn, :1] for channel in (recording.angle, *recording.pressures)]
    ticks, sampled = sample(recording.time, np.stack(channels, axis=1))
    angle, *ports = sampled.transpose(1, 0, 2)
    figures, _ = shape_batch(ticks, angle, machine, ports)
    return [
        {"name": name} | _check(what, unit, _number(figures[name][0]), published(name), bound)
        for name, (what, unit, bound) in SHAPE.items()
    ]


def _notes(recording: TurnRecording, figures: dict[str, NDArray[np.float64]], names: list[str]) -> list[str]:
    def who(variant: int) -> str:
        return names[variant] if variant < len(names) else f"ensemble member {variant - len(names) + 1}"

    notes = [
        f"{who(variant)}, {TURNS[turn].title.lower()}: simulation diverged ({reason})"
        for turn, variant, reason in recording.diverged
    ]
    diverged = {(turn, variant) for turn, variant, _ in recording.diverged}
    for turn, variant in np.argwhere(~np.isfinite(figures["turn_time_s"])):
        if (turn, variant) not in diverged:
            notes.append(f"{who(int(variant))}, {TURNS[turn].title.lower()}: did not reach its stop")
    return notes


def _curves(
    recording: TurnRecording,
    exact: dict[str, NDArray[np.float64]],
    second: bool,
    first_member: int | None,
) -> list[FlowCurve]:
    """Flow curves, each from its own t = 0: the start of a turn depends on the machine."""
    cylinder = recording.machine.steering.cylinder
    variants = recording.angle.shape[2]
    sign = np.repeat([turn.sign for turn in TURNS], variants)
    ticks, angle = sample(recording.time, recording.angle.reshape(len(recording.time), -1))
    flow = (measured_flow(cylinder, angle, sign) / LITRE_PER_MINUTE).reshape(len(ticks), len(TURNS), variants)
    starts = turn_span(ticks, angle, cylinder.half_range).began.reshape(len(TURNS), variants)
    rough = recording.angle.reshape(len(recording.time), -1)
    raw_starts = turn_span(recording.time, rough, cylinder.half_range).began.reshape(len(TURNS), variants)
    curves = []
    nothing = np.empty(0)
    for index, turn in enumerate(TURNS):
        time = ticks - starts[index, 0]
        longest = np.nanmax(exact["turn_time_s"][index]) if np.isfinite(exact["turn_time_s"][index]).any() else np.inf
        shown = (time > -0.3) & (time < longest + 0.15)
        low = high = nothing
        if first_member is not None:
            family = [
                np.interp(time[shown], ticks - starts[index, v], flow[:, index, v])
                for v in range(first_member, variants)
            ]
            low, high = np.min(family, axis=0), np.max(family, axis=0)
        raw_time = recording.time - raw_starts[index, 0]
        raw_shown = (raw_time > -0.3) & (raw_time < longest + 0.15)
        other = ticks - starts[index, 1] if second else nothing
        other_shown = (other > -0.3) & (other < longest + 0.15)
        curves.append(
            FlowCurve(
                turn=turn,
                time=time[shown],
                flow=flow[shown, index, 0],
                raw_time=raw_time[raw_shown],
                raw_flow=recording.flow[raw_shown, index, 0] / LITRE_PER_MINUTE,
                uncalibrated_time=other[other_shown],
                uncalibrated_flow=flow[other_shown, index, 1] if second else nothing,
                low=low,
                high=high,
            )
        )
    return curves
