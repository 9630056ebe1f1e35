"""Quick fits of every family of laws to the published key figures and to the shape of the published curve.

    python -m studies.families.fit --out fits --device cuda:0 --minutes 8

One covariance-matrix adaptation (Hansen, *The CMA Evolution Strategy: A Tutorial*, arXiv:1604.00772) a family and start
searches all uncertain parameters that the figures feel, within their ranges; all candidates of a generation turn side by
side in one twin. Misses are in tolerances; the cost is quadratic up to :data:`HUBER` of them and linear beyond. A parameter
within :data:`MARGIN` of an end of its range costs :data:`BOUND_COST`: a machine that leans on its ranges is the wrong model.
"""

from __future__ import annotations

import argparse
import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.published import LEVELS, published_targets
from aoro_gym.calibration.space import Space
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, LAWS
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.twin import Twin
from aoro_gym.twin.records import Output
from aoro_gym.validation.shape import SHAPE, shape_batch
from aoro_gym.validation.turns import repeated, stacked

SIGNALS = np.array([turn.signal_percent for turn in LEVELS]) / 100.0
"""Of the left turns."""
BEFORE, TURNING = 0.6, 8.4
"""Rest and turn [s]: at 50 % the published twin takes 6.32 s; half a second of rest follows."""
TICK = 0.01
"""Sampling interval [s] of the published chain."""
CHUNK = 0.6
"""Simulated time [s] a launch."""
FAILED = 30.0
"""Miss in tolerances of a figure that there is not."""
HUBER = 3.0
MARGIN = 0.02
BOUND_COST = 0.5
PULL = 0.05
"""Cost of a parameter that is half its range away from the start: where figures say nothing, it stays."""
SHAPE_WEIGHT = 1.0
PART = 256
"""Machines whose figures one thread reads."""
IDENTIFIABLE = 0.05
"""Tolerances that a quarter of a parameter's range moves a figure by, at least, for it to be searched."""

Floats = NDArray[np.float64]


def turned(machine: Machine, device: str, substeps: int = 30) -> tuple[Floats, NDArray[np.bool_]]:
    """Joint angles and both port pressures (3, frames, levels x N) of left turns at all levels, 100 frames a second, and
    whether each twin runs."""
    count = machine.num_variants
    signal = np.repeat(SIGNALS, count)
    batch = repeated(machine, len(LEVELS))
    twin = Twin(len(signal), machine=batch, device=device, substeps=substeps, check_step=False)
    twin.reset(joint_angle=-np.broadcast_to(batch.joint.range, signal.shape))
    rows = [int(Output.JOINT_ANGLE), int(Output.PRESSURE_A), int(Output.PRESSURE_B)]
    parts = []
    for commands, duration in ((0.0 * signal, BEFORE), (signal, TURNING)):
        twin.set_commands({"steering_signal": commands})
        for _ in range(round(duration / CHUNK)):
            twin.advance(CHUNK, sample_every=TICK)
            parts.append(np.stack([twin.outputs[:, row].contiguous().numpy() for row in rows]))
    return np.concatenate(parts, axis=1).astype(np.float64), twin.status == 0


def misses(machine: Machine, device: str, substeps: int = 30) -> Floats:
    """Misses in tolerances (21 figures of the levels one after the other, then the shape's, N)."""
    count = machine.num_variants
    channels, sound = turned(machine, device, substeps)
    channels = channels.reshape(3, -1, len(LEVELS), count)
    sound = sound.reshape(len(LEVELS), count)
    parts = np.array_split(np.arange(count), max(count // PART, 1))
    with ThreadPoolExecutor() as pool:
        found = pool.map(lambda part: _part(machine.variants(part), channels[..., part], sound[:, part]), parts)
        return np.hstack(list(found))


def _part(machine: Machine, channels: Floats, sound: NDArray[np.bool_]) -> Floats:
    """Misses (R, N) of machines by their ``channels`` (3, frames, levels, N)."""
    target, tolerance = published_targets()
    clock = TICK * np.arange(channels.shape[1])
    out = []
    with np.errstate(all="ignore"):
        for i in range(len(LEVELS)):
            end = len(clock) if i == 2 else int((BEFORE + 3.9) / TICK)
            found = key_figures_batch(clock[:end], channels[0, :end, i], machine, interpolate=True)
            rows = np.array([found[name] for name in FIGURES])
            rows[:, ~sound[i]] = np.nan
            out.append((rows - target[i][:, None]) / tolerance[i][:, None])
        end = int((BEFORE + 3.9) / TICK)
        angle, *ports = channels[:, :end, 0]
        _, shape = shape_batch(clock[:end], angle, machine, ports, interpolate=True)
    whole = np.vstack([*out, np.array([shape[name] for name in SHAPE])])
    return np.where(np.isfinite(whole), whole, FAILED)


def cost(found: Floats, points: Floats, start: Floats) -> Floats:
    """Cost (N,) of misses (R, N) at ``points`` (N, d)."""
    size = np.abs(found)
    each = np.where(size <= HUBER, size**2, HUBER * (2.0 * size - HUBER))
    each[3 * len(FIGURES) :] *= SHAPE_WEIGHT
    at_bound = (np.minimum(points, 1.0 - points) < MARGIN).sum(axis=1)
    return each.sum(axis=0) + BOUND_COST * at_bound + PULL * (4.0 * (points - start) ** 2).sum(axis=1)


@dataclass
class Search:
    """Covariance-matrix adaptation of one family from one start, in the unit cube of a space."""

    family: str
    space: Space
    start: Floats
    rng: np.random.Generator
    population: int
    step: float = 0.12
    best: float = np.inf
    history: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        n, half = len(self.start), self.population // 2
        weights = np.log(half + 0.5) - np.log(np.arange(1, half + 1))
        self.weights = weights / weights.sum()
        effective = 1.0 / np.sum(self.weights**2)
        self.c_step = (effective + 2.0) / (n + effective + 5.0)
        self.damping = 1.0 + 2.0 * max(0.0, np.sqrt((effective - 1.0) / (n + 1.0)) - 1.0) + self.c_step
        self.c_path = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n)
        self.c_one = 2.0 / ((n + 1.3) ** 2 + effective)
        self.c_rank = min(1.0 - self.c_one, 2.0 * (effective - 2.0 + 1.0 / effective) / ((n + 2.0) ** 2 + effective))
        self.effective, self.mean = effective, np.clip(self.start, 0.03, 0.97)
        self.covariance, self.path, self.step_path = np.eye(n), np.zeros(n), np.zeros(n)
        self.point, self.found = self.mean, np.full(0, np.nan)

    def ask(self) -> Floats:
        """Candidates (population, d) in the unit cube."""
        values, vectors = np.linalg.eigh(self.covariance)
        self.root = vectors * np.sqrt(np.maximum(values, 1e-12))
        self.inverse_root = (vectors / np.sqrt(np.maximum(values, 1e-12))) @ vectors.T
        steps = self.rng.standard_normal((self.population, len(self.mean))) @ self.root.T
        self.points = np.clip(self.mean + self.step * steps, 0.0, 1.0)
        return self.points

    def tell(self, found: Floats) -> None:
        """Adapt to the misses (R, population) of the candidates."""
        costs = cost(found, self.points, self.start)
        order = np.argsort(costs)
        if costs[order[0]] < self.best:
            self.best, self.point, self.found = float(costs[order[0]]), self.points[order[0]], found[:, order[0]]
        self.history.append(float(self.best))
        n = len(self.mean)
        steps = (self.points[order[: len(self.weights)]] - self.mean) / self.step
        moved = self.weights @ steps
        self.mean = self.mean + self.step * moved
        self.step_path = (1.0 - self.c_step) * self.step_path + np.sqrt(
            self.c_step * (2.0 - self.c_step) * self.effective
        ) * (self.inverse_root @ moved)
        length, usual = np.linalg.norm(self.step_path), np.sqrt(n) * (1.0 - 0.25 / n)
        slow = length / np.sqrt(1.0 - (1.0 - self.c_step) ** (2 * len(self.history))) < (1.4 + 2.0 / (n + 1.0)) * usual
        self.path = (1.0 - self.c_path) * self.path + slow * np.sqrt(
            self.c_path * (2.0 - self.c_path) * self.effective
        ) * moved
        rank = (steps.T * self.weights) @ steps
        self.covariance = (
            (1.0 - self.c_one - self.c_rank) * self.covariance
            + self.c_one * np.outer(self.path, self.path)
            + self.c_rank * rank
        )
        self.step *= float(np.exp(min(1.0, self.c_step / self.damping * (length / usual - 1.0))))


def identifiable(machine: Machine, keys: list[str], device: str, rng: np.random.Generator) -> list[str]:
    """Those of ``keys`` that a figure feels, at the machine or at one of three random points near it."""
    space = Space(machine, keys)
    felt = np.zeros(len(keys), dtype=bool)
    for probe in (space.point(), *np.clip(space.point() + rng.normal(0.0, 0.15, (3, len(keys))), 0.05, 0.95)):
        points = np.repeat(probe[None], len(keys) + 1, axis=0)
        side = np.where(probe > 0.5, -0.25, 0.25)
        points[np.arange(1, len(keys) + 1), np.arange(len(keys))] += side
        found = misses(space.population(points).levelled(), device)
        felt |= np.abs(found[:, 1:] - found[:, :1]).max(axis=0) > IDENTIFIABLE
    return [key for key, one in zip(keys, felt, strict=True) if one]


def law_keys(family: str) -> set[str]:
    """Parameters that the family's options alone have."""
    return {key for law, option in FAMILIES[family].items() for key in LAWS[law].parameters.get(option, ())}


def searches(names: list[str], population: int, device: str, seed: int) -> list[Search]:
    """One search a family and start: the shipped machine, and the data sheet's."""
    out = []
    for number, name in enumerate(names):
        for start in ("aoro", "aoro_datasheet"):
            rng = np.random.default_rng((seed, number, len(out)))
            machine = Machine.load(start).with_default_priors().with_laws(name)
            needed = law_keys(name)
            keys = [
                p.key
                for p in machine.parameters()
                if (p.role in ("nuisance", "both") or p.key in needed) and p.range[0] < p.range[1]
            ]
            keys = identifiable(machine, keys, device, rng)
            space = Space(machine, keys)
            print(f"{name} from {start}: {len(keys)} parameters", flush=True)
            out.append(Search(name, space, space.point(), rng, population))
    return out


def resumed(names: list[str], folder: Path, population: int, seed: int, step: float) -> list[Search]:
    """One search a family from the best machine of an earlier run in ``folder``."""
    fits = json.loads((folder / "fits.json").read_text())
    out = []
    for number, name in enumerate(names):
        best = min((fit for fit in fits if fit["family"] == name), key=lambda fit: fit["cost"])
        machine = Machine.load(best["start"]).with_default_priors().with_laws(name)
        space = Space(machine, list(best["values"]))
        start = space.places(list(best["values"].values()))
        out.append(Search(name, space, start, np.random.default_rng((seed, number)), population, step))
    return out


def described(search: Search) -> dict[str, object]:
    """Best machine of a search: misses by figure, parameters at a bound, values."""
    names = [f"{name} at {turn.signal_percent:g} %" for turn in LEVELS for name in FIGURES]
    found = dict(zip([*names, *SHAPE], search.found.tolist(), strict=True))
    figures = np.abs(search.found[: len(names)])
    return {
        "family": search.family, "start": search.space.machine.name, "cost": search.best,
        "figures_reached": int((figures <= 1.0).sum()), "figures": len(names),
        "shape_reached": int((np.abs(search.found[len(names) :]) <= 1.0).sum()), "shape": len(SHAPE),
        "worst_miss": float(figures.max()), "misses": found,
        "parameters": len(search.space.keys), "at_bounds": dict(search.space.at_bounds(search.point, MARGIN)),
        "values": dict(zip(search.space.keys, search.space.values(search.point).tolist(), strict=True)),
        "history": search.history,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--device", default="cpu", help="cpu or cuda:N")
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), help="families to fit")
    parser.add_argument("--population", type=int, default=512, help="candidates a generation, family and start")
    parser.add_argument("--minutes", type=float, default=8.0, help="time to search")
    parser.add_argument("--generations", type=int, default=100000, help="generations at most")
    parser.add_argument("--resume", type=Path, help="folder of an earlier run to start from")
    parser.add_argument("--step", type=float, default=0.06, help="first step of a resumed search, share of a range")
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    if given.resume is None:
        running = searches(given.families, given.population, given.device, given.seed)
    else:
        running = resumed(given.families, given.resume, given.population, given.seed, given.step)
    for generation in range(given.generations):
        if time.monotonic() - began > 60.0 * given.minutes:
            break
        asked = [search.space.population(search.ask()).levelled() for search in running]
        found = misses(stacked(asked), given.device)
        for i, search in enumerate(running):
            search.tell(found[:, i * given.population : (i + 1) * given.population])
        if generation % 5 == 0:
            bests = " ".join(f"{search.family}:{search.best:.1f}" for search in running)
            print(f"{time.monotonic() - began:.0f} s, generation {generation}: {bests}", flush=True)
            (given.out / "fits.json").write_text(json.dumps([described(search) for search in running], indent=1))
    results = [described(search) for search in running]
    (given.out / "fits.json").write_text(json.dumps(results, indent=1))
    for family in given.families:
        own = [search for search in running if search.family == family]
        search = min(own, key=lambda one: one.best)
        search.space.population(search.point).levelled().save(given.out / f"{family}.toml")


if __name__ == "__main__":
    main()
