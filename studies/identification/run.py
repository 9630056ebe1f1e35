"""Leave-one-level-out fits: which family of laws predicts left turns at a level that it was not fitted to.

    python -m studies.identification.run --out identification --families default library --device cpu:simd

For the figures of the published twin and, apart, of the real machine, a family is fitted to two of the levels 100, 75
and 50 % and predicts the third. Every uncertain parameter that the figures feel is searched: a population around the data
sheets, turned once and shared by all six fits, then bounded Gauss–Newton steps from its best member. Ranges are priors: the
pull to the data sheet is that of a range read as 95 %, and its ends bound the search. The valve's table is an
input of every fit, so that the mean flow of the level left out is known; what is predicted are the figures of the transient.

Ctrl-C is safe: the same command goes on where it stopped. ``FOLDER`` gets a JSON file a family and ``table.md``.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from aoro_gym.calibration.fit import FAILED, Fit, least_squares_fit
from aoro_gym.calibration.procedure import measured_curve
from aoro_gym.calibration.published import LEVELS, SINGLE_FIGURES
from aoro_gym.calibration.space import Space
from aoro_gym.calibration.turns import SAMPLING, STANDSTILL, longest
from aoro_gym.execution.digest import digest
from aoro_gym.execution.files import read_json, write_json, write_text
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, LAWS
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.twin import Twin
from aoro_gym.validation.published import published, published_rows
from aoro_gym.validation.shape import SHAPE_TURN, shape_batch
from aoro_gym.validation.study import TARGETS, TURN_TIME_TARGET
from aoro_gym.validation.turns import Turn
from studies.identification.table import markdown

REFERENCES = ("mevea", "physical")
"""Rows that are fitted: those of the published twin, and those of the real machine."""
TRANSIENT = FIGURES[3:]
"""Figures that the predictive score is made of: first peak and its time, lowest undershoot, second peak."""
PRIOR_WEIGHT = 1.0
"""Weight of the pull to the data sheet: a range is read as 95 %."""
SPREAD = 0.25
"""Standard deviation of the population, share of a range: that of the prior."""
IDENTIFIABLE = 0.05
"""Tolerances that a quarter of a parameter's range moves a figure by, at least, for it to be searched."""
KNOWN = ("motor_pressure", "motor_pressure_without_brake", "mass")
"""Single figures that every fit has, in closed form."""
BATCH = 128
"""Members of a population that turn side by side."""

Floats = NDArray[np.float64]


def turned(machine: Machine, turn: Turn, device: str) -> tuple[Floats, Floats, Floats]:
    """Key figures (7, N) of a left turn, between samples; misses (7 or 0, N) of the curve's shape in tolerances; and key
    figures (7, N) read from samples, as published. NaN where a turn failed."""
    twin = Twin(machine.num_variants, machine=machine, device=device, check_step=False)
    twin.reset(joint_angle=-turn.sign * np.broadcast_to(machine.joint.range, machine.num_variants))
    parts = []
    for signal, duration in ((0.0, STANDSTILL), (turn.sign * turn.signal_percent / 100.0, longest(turn) + STANDSTILL)):
        trace = twin.step({"steering_signal": signal}, round(duration, 2), sample_every=SAMPLING)
        assert trace is not None
        parts.append([trace[name] for name in ("joint_angle", "pressure_a", "pressure_b")])
    angle, *ports = np.concatenate(parts, axis=1).astype(np.float64)
    clock = SAMPLING * np.arange(len(angle))
    with np.errstate(all="ignore"):
        smooth = key_figures_batch(clock, angle, machine, interpolate=True)
        sampled = key_figures_batch(clock, angle, machine)
        shape = shape_batch(clock, angle, machine, ports, interpolate=True)[1] if turn == SHAPE_TURN else {}
    found = [
        np.array([figures[name] for name in names]).reshape(len(names), machine.num_variants)
        for figures, names in ((smooth, FIGURES), (shape, tuple(shape)), (sampled, FIGURES))
    ]
    for rows in found:
        rows[:, twin.status != 0] = np.nan
    return found[0], found[1], found[2]


def targets(reference: str, turn: Turn) -> tuple[Floats, Floats]:
    """Figures of a reference at a level (7,), and their tolerances."""
    row = next(
        row
        for row in published_rows()
        if (row["source"], row["direction"], row["signal_percent"]) == (reference, turn.direction, turn.signal_percent)
    )
    target = np.array([row[name] for name in FIGURES], dtype=np.float64)
    tolerance = np.array([bound if kind == "difference" else bound * known
                          for (kind, bound), known in zip(TARGETS.values(), target, strict=True)])  # fmt: skip
    if turn.signal_percent == 100.0:
        tolerance[FIGURES.index("turn_time_s")] = TURN_TIME_TARGET
    return target, tolerance


def level_misses(found: tuple[Floats, Floats, Floats], reference: str, turn: Turn) -> Floats:
    """Misses (R, N) of a level in tolerances; the shape is published of the published twin alone."""
    target, tolerance = targets(reference, turn)
    rows = [(found[0] - target[:, None]) / tolerance[:, None]]
    return np.vstack([*rows, found[1]] if reference == "mevea" else rows)


def single_misses(machine: Machine) -> Floats:
    """Misses (3, N) of the figures :data:`KNOWN` in tolerances."""
    rows = []
    for name in KNOWN:
        measure, bound = SINGLE_FIGURES[name]
        rows.append(
            np.broadcast_to((measure(machine, "cpu", 30) / published(name) - 1.0) / bound, machine.num_variants)
        )
    return np.array(rows)


def by_level(machine: Machine, reference: str, device: str) -> dict[str, dict[str, Any]]:
    """Figures, relative errors and mean error of the transient figures of one machine, by level."""
    levels = {}
    for turn in LEVELS:
        sampled = turned(machine, turn, device)[2][:, 0]
        errors = sampled / targets(reference, turn)[0] - 1.0
        levels[f"{turn.signal_percent:g}"] = {
            "figures": dict(zip(FIGURES, _numbers(sampled), strict=True)),
            "errors": dict(zip(FIGURES, _numbers(errors), strict=True)),
            "transient_error": _numbers([np.mean(np.abs(errors[-len(TRANSIENT) :]))])[0],
        }
    return levels


@dataclass(frozen=True)
class Split:
    """Rows that are fitted, and the level that is left out."""

    reference: str
    left_out: Turn

    @property
    def fitted(self) -> tuple[Turn, ...]:
        """The other levels."""
        return tuple(turn for turn in LEVELS if turn != self.left_out)

    @property
    def name(self) -> str:
        return f"{self.reference}-{self.left_out.signal_percent:g}"

    def residuals(self, found: dict[Turn, tuple[Floats, Floats, Floats]], machine: Machine) -> Floats:
        """Misses (R, N) of what is fitted, in half tolerances."""
        rows = [level_misses(found[turn], self.reference, turn) for turn in self.fitted]
        return 2.0 * np.vstack([*rows, single_misses(machine)])


SPLITS = tuple(Split(reference, turn) for reference in REFERENCES for turn in LEVELS)


@dataclass
class Study:
    """Fits of one family of laws."""

    family: str
    folder: Path
    device: str
    population: int
    steps: int
    seed: int

    def __post_init__(self) -> None:
        self.machine = measured_curve(Machine.load("aoro_datasheet").with_default_priors().with_laws(self.family))
        self.file = self.folder / f"{self.family}.json"
        inputs = digest(
            self.machine.identity, self.population, self.steps, self.seed, PRIOR_WEIGHT, SPREAD, IDENTIFIABLE
        )
        kept = read_json(self.file) if self.file.exists() else {}
        if kept and kept.get("inputs") != inputs:
            raise ValueError(f"{self.file} was begun with other settings or another machine: choose another --out")
        self.result: dict[str, Any] = kept or {"family": self.family, "inputs": inputs, "splits": {}}

    def keep(self) -> None:
        """Write what is known."""
        write_json(self.file, self.result)

    def run(self) -> None:
        """Parameters that are felt, the population, then the fits that are not yet there."""
        if "searched" not in self.result:
            self.say("which parameters the figures feel")
            self.result["searched"] = self.felt()
            self.keep()
        space = Space(self.machine, self.result["searched"])
        if "not_fitted" not in self.result:
            start = self.machine.levelled()
            self.result["not_fitted"] = {reference: by_level(start, reference, self.device) for reference in REFERENCES}
            self.keep()
        points = self.points(space)
        kept = self.folder / f".{self.family}-population.npz"
        if not kept.exists():
            np.savez(kept, costs=self.population_costs(space, points))
        with np.load(kept) as file:
            costs = file["costs"]
        for number, split in enumerate(SPLITS):
            if split.name not in self.result["splits"]:
                self.say(
                    f"fit {number + 1} of {len(SPLITS)}: {split.reference} without {split.left_out.signal_percent:g} %"
                )
                self.result["splits"][split.name] = self.fitted(space, split, points[int(np.argmin(costs[number]))])
                self.keep()

    def say(self, what: str) -> None:
        """Tell what is being done."""
        print(f"{time.strftime('%H:%M:%S')} {self.family}: {what}", file=sys.stderr, flush=True)

    def felt(self) -> list[str]:
        """Uncertain parameters that a figure feels, at the data sheet's machine or at a random one near it."""
        own = {key for law, option in FAMILIES[self.family].items() for key in LAWS[law].parameters.get(option, ())}
        keys = [
            p.key
            for p in self.machine.parameters()
            if (p.role in ("nuisance", "both") or p.key in own) and p.range[0] < p.range[1]
        ]
        space = Space(self.machine, keys)
        rng = np.random.default_rng(self.seed)
        felt = np.zeros(len(keys), dtype=bool)
        for probe in (space.point(), np.clip(space.point() + rng.normal(0.0, 0.15, len(keys)), 0.05, 0.95)):
            side = np.where(probe > 0.5, -0.25, 0.25)
            machine = space.population(np.vstack([probe, probe + np.diag(side)])).levelled()
            for turn in LEVELS:
                found = level_misses(turned(machine, turn, self.device), "mevea", turn)
                felt |= np.nanmax(np.abs(found[:, 1:] - found[:, :1]), axis=0, initial=0.0) > IDENTIFIABLE
            single = single_misses(machine)
            felt |= np.max(np.abs(single[:, 1:] - single[:, :1]), axis=0) > IDENTIFIABLE
        return list(compress(keys, felt))

    def points(self, space: Space) -> Floats:
        """The population (N, d), the data sheet's machine first."""
        normal = qmc.MultivariateNormalQMC(np.zeros(len(space.keys)), rng=np.random.default_rng(self.seed))
        points = np.clip(space.point() + SPREAD * normal.random(self.population), 0.01, 0.99)
        # half of it nearer: far from every data sheet most machines do nothing like the published turns
        points[::2] = space.point() + 0.4 * (points[::2] - space.point())
        points[0] = space.point()
        return np.clip(points, 0.01, 0.99)

    def population_costs(self, space: Space, points: Floats) -> Floats:
        """Cost (splits, N) of every member, prior included."""
        parts: list[Floats] = []
        for batch in np.array_split(points, max(1, len(points) // BATCH)):
            self.say(f"population, {sum(part.shape[1] for part in parts)} of {len(points)} have turned")
            machine = space.population(batch).levelled()
            found = {turn: turned(machine, turn, self.device) for turn in LEVELS}
            pull = np.sum(np.square(PRIOR_WEIGHT / 0.25 * (batch - space.point())), axis=1)
            misses = [_sound(split.residuals(found, machine)) for split in SPLITS]
            parts.append(np.array([np.sum(np.square(one), axis=0) + pull for one in misses]))
        return np.hstack(parts)

    def fitted(self, space: Space, split: Split, start: Floats) -> dict[str, Any]:
        """A fit from ``start`` (d,), and what it predicts."""

        def residuals(points: Floats) -> Floats:
            machine = space.population(points).levelled()
            return split.residuals({turn: turned(machine, turn, self.device) for turn in split.fitted}, machine)

        fit = least_squares_fit(
            residuals, space.point(), prior_weight=PRIOR_WEIGHT, starts=1, population=1, initial=start,
            max_iterations=self.steps, problem=digest(space.describe(), split.name),
            checkpoint=self.folder / f".{self.family}-{split.name}.json",
        )[0]  # fmt: skip
        return self.described(space, split, fit)

    def described(self, space: Space, split: Split, fit: Fit) -> dict[str, Any]:
        """The fit's misses, and its figures, errors and score at every level."""
        machine = space.population(np.array([fit.point])).levelled()
        levels = by_level(machine, split.reference, self.device)
        data = np.array(fit.residuals) / 2.0
        return {
            "reference": split.reference, "left_out": split.left_out.signal_percent,
            "score": levels[f"{split.left_out.signal_percent:g}"]["transient_error"],
            "rms_miss_tolerances": float(np.sqrt(np.mean(np.square(data)))),
            "largest_miss_tolerances": float(np.max(np.abs(data))), "cost": fit.cost, "evaluations": fit.evaluations,
            "at_bounds": dict(set(space.at_bounds(fit.point)) - set(space.at_bounds(space.point()))), "levels": levels,
            "values": dict(zip(space.keys, space.values(fit.point).tolist(), strict=True)),
        }  # fmt: skip


def _sound(found: Floats) -> Floats:
    """Residuals within ± :data:`FAILED`, that of a figure that there is not among them."""
    return np.clip(np.where(np.isfinite(found), found, FAILED), -FAILED, FAILED)


def _numbers(values: Any) -> list[float | None]:
    """Numbers for JSON, None where there is none."""
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=FAMILIES, help="families to fit")
    parser.add_argument("--device", default="cpu:simd", help="cpu, cpu:simd or cuda:N")
    parser.add_argument("--population", type=int, default=256, help="machines that are turned at first")
    parser.add_argument("--steps", type=int, default=8, help="Gauss-Newton steps a fit, at most")
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn")
    parser.add_argument("--table", action="store_true", help="only write table.md anew from the results in the folder")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    try:
        for family in () if given.table else given.families:
            Study(family, given.out, given.device, given.population, given.steps, given.seed).run()
            write_text(given.out / "table.md", markdown(given.out))
    except KeyboardInterrupt:
        print("interrupted; the same command goes on here", file=sys.stderr)
        sys.exit(130)
    write_text(given.out / "table.md", markdown(given.out))
    print(markdown(given.out))


if __name__ == "__main__":
    main()
