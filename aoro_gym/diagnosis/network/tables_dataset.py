"""Tables of simulated machines with their labels, on the device: drawn in processes, simulated, and drawn from for training.

What parts a table from exact figures is drawn anew for every batch: what no simulated law has, scatter between runs,
standard deviations that may be given, rounding, and figures, rows and healthy days that may be missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.dataset import Amount, DrawJob, drawn_chunks, size_scales
from aoro_gym.diagnosis.network.sensing import Draw
from aoro_gym.diagnosis.network.tables_features import change_unit, features
from aoro_gym.diagnosis.network.training import Batch, Course
from aoro_gym.diagnosis.simulation.days import HEALTHY, Days, draw_days
from aoro_gym.diagnosis.simulation.outsiders import ALL, SIGNAL
from aoro_gym.diagnosis.simulation.prior import Prior, SensorPrior
from aoro_gym.diagnosis.simulation.turns import READ, draw_signals, simulate_figures

CHUNK = 2560
"""Machines that are drawn together."""
TIMES = tuple(name.endswith("_s") for name in READ)
"""Which figures are times [s]; the others are flows [L/min]."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Tables:
    """Figures of simulated days on the device: M machines, D days, the first of them healthy, J turns.

    Attributes:
        figures: (M, D, J, figures), NaN of a turn without.
        signals: Of the turns (M, J), left positive.
        hypothesis: Number of what is wrong (M, D).
        effects: Numbers of the effects (M, D, 2), −1 for none.
        sizes: Scaled sizes (M, D, 2).
    """

    figures: Tensor
    signals: Tensor
    hypothesis: Tensor
    effects: Tensor
    sizes: Tensor

    @property
    def machines(self) -> int:
        return len(self.figures)


@dataclass(frozen=True)
class TablePrior:
    """What tables have and lack; pairs are ends of a logarithmically even draw. All are estimates (E).

    Attributes:
        scatter: Standard deviation of figures between runs, in units of what just counts (:func:`change_unit`), one a table.
        unevenness: The same of its logarithm from figure to figure.
        std_known: Share of the tables that give standard deviations.
        std_error: Standard deviation of the logarithm of those that are given: few repeats say little.
        rounded: Share of the tables in hundredths of seconds and tenths of litres a minute.
        columns: How often a table has all figures, only its time and steady flow, only its peaks; what remains has some.
        empty: Share of empty cells.
        usual_rows: Share of the tables of the three usual signals to one side; the others have any number of rows.
        misread: Share of the cases in which figures are off by what no effect makes: one to three of them by factors.
        misread_by: Ends of these factors' logarithms.
    """

    scatter: tuple[float, float] = (0.05, 8.0)
    unevenness: float = 0.5
    std_known: float = 0.3
    std_error: float = 0.3
    rounded: float = 0.6
    columns: tuple[float, ...] = (0.5, 0.1, 0.1)
    empty: float = 0.04
    usual_rows: float = 0.4
    misread: float = 0.04
    misread_by: tuple[float, float] = (0.08, 0.6)


def simulate(
    prior: Prior,
    amount: Amount,
    device: str,
    *,
    threads: int = 1,
    progress: Callable[[int, int], object] = lambda done, total: None,
) -> tuple[Tables, Floats]:
    """Tables, and the scales (effects,) [SI] of their sizes; the same for the same ``amount``. Of the healthy days the first
    is kept.

    Args:
        prior: What machines, days and effects are drawn from.
        amount: How many; its manoeuvres are full turns.
        device: Where twins run, and tables are.
        threads: That read figures.
        progress: Told turns that are done, and all.
    """
    with drawn_chunks(_draw, prior, amount, CHUNK) as chunks:
        drawn = list(chunks)
    days, signals = Days.joined([one for one, _ in drawn]), np.concatenate([told for _, told in drawn])
    figures = simulate_figures(
        days, signals, prior=SensorPrior(), seed=amount.seed, device=device, threads=threads, progress=progress
    )
    scales = size_scales(days)
    return labelled(figures, signals, days, scales, device), scales


def _draw(job: DrawJob) -> tuple[Days, Floats]:
    prior, machines, amount, seed = job
    days = draw_days(prior, machines, amount.later, seed)
    number = np.arange(len(days.kind)).reshape(machines, -1)
    kept = days.of(np.concatenate([number[:, :1], number[:, HEALTHY:]], axis=1).ravel())
    return kept, draw_signals(np.random.default_rng([seed, 1]), machines, amount.manoeuvres)


def labelled(figures: NDArray[np.float32], signals: Floats, days: Days, scales: Floats, device: str) -> Tables:
    """Figures with what is wrong on their days. Days of an outsider that lies in sampled signals were simulated without it:
    nothing is wrong with their figures.

    Args:
        figures: (M, D, J, figures).
        signals: Of the turns (M, J).
        days: (M · D,).
        scales: Of the effects' sizes (effects,) [SI].
        device: Where the tables are to be.
    """
    machines, each = figures.shape[:2]

    def put(values: NDArray[np.generic], dtype: torch.dtype) -> Tensor:
        return torch.as_tensor(values.reshape(machines, each, *values.shape[1:]), dtype=dtype, device=device)

    outside = (days.outsider >= 0) & (days.outsider < ALL.index(SIGNAL[0]))
    return Tables(
        figures=torch.as_tensor(figures.copy(), device=device),
        signals=torch.as_tensor(signals, dtype=torch.float32, device=device),
        hypothesis=put(hypotheses.number_of(days.effects, outside), torch.int64),
        effects=put(days.effects, torch.int64),
        sizes=put(np.arcsinh(days.change / scales[np.maximum(days.effects, 0)]), torch.float32),
    )


def draw_batch(
    data: Tables,
    machines: Tensor,
    course: Course,
    draw: Draw,
    *,
    prior: TablePrior,
    sensors: SensorPrior,
    day_one: bool | None = None,
) -> Batch:
    """Cases as a user may have them, a later day of each machine drawn.

    Args:
        data: Simulated days.
        machines: Their numbers (B,).
        course: How often there is no healthy day, or a row lacks a day.
        draw: Random numbers.
        prior: What tables have and lack.
        sensors: How large the error of laws is.
        day_one: Whether there is no healthy day; by default at random.
    """
    day = 1 + draw.one_of(data.figures.shape[1] - 1, len(machines))
    row, turns = _rows(data, machines, course, prior, draw)
    days = torch.stack([torch.zeros_like(day), day], dim=1)
    exact = data.figures[machines[:, None, None], days[:, :, None], row[:, None]].transpose(1, 2)
    has = torch.isfinite(exact) & _there(exact, course, prior, draw, day_one) & turns[..., None, None]
    figures = _with_law_error(torch.nan_to_num(exact), sensors, draw)
    figures, misread = _misread(figures, prior, draw)
    figures, std, has_std = _scattered(figures, prior, draw)
    rows = features(torch, data.signals[machines[:, None], row], figures, has.float(), std, (has_std & has).float())
    hypothesis, effects = data.hypothesis[machines, day], data.effects[machines, day]
    return Batch(
        rows,
        has.any(dim=-1).any(dim=-1),
        torch.where(misread, torch.full_like(hypothesis, hypotheses.OUTSIDE), hypothesis),
        torch.where(misread[:, None], torch.full_like(effects, -1), effects),
        data.sizes[machines, day],
    )


def _rows(data: Tables, machines: Tensor, course: Course, prior: TablePrior, draw: Draw) -> tuple[Tensor, Tensor]:
    """Numbers of turns (B, J) in any order, and which of them a table has (B, J)."""
    batch, each = len(machines), data.signals.shape[1]
    rows = min(course.logs, each)
    usual = draw.even(0.0, 1.0, batch) < prior.usual_rows
    key = draw.even(0.0, 1.0, batch, each)
    first = torch.arange(each, device=draw.device).expand(batch, each) / each
    order = torch.argsort(torch.where(usual[:, None], first, key), dim=1)[:, :rows]
    number = torch.where(usual, torch.full_like(machines, min(3, rows)), 1 + draw.one_of(rows, batch))
    return order, torch.arange(rows, device=draw.device) < number[:, None]


def _there(figures: Tensor, course: Course, prior: TablePrior, draw: Draw, day_one: bool | None) -> Tensor:
    """Which figures (B, J, 2, figures) a table has."""
    batch, rows, _, count = figures.shape
    device = draw.device
    time, steady = READ.index("turn_time_s"), READ.index("steady_flow_L_per_min")
    flows = torch.zeros(count, dtype=torch.bool, device=device)
    flows[time] = flows[steady] = True
    kinds = torch.stack([torch.ones_like(flows), flows, ~flows])
    ends = torch.cumsum(torch.tensor(prior.columns, device=device), dim=0)
    which = torch.searchsorted(ends, draw.even(0.0, 1.0, batch))
    some = draw.even(0.0, 1.0, batch, count) < 0.6
    some = some | (torch.arange(count, device=device) == draw.one_of(count, batch, 1))
    columns = torch.where((which < len(kinds))[:, None], kinds[which.clamp(max=len(kinds) - 1)], some)
    cells = draw.even(0.0, 1.0, batch, rows, 2, count) >= prior.empty
    healthy = draw.even(0.0, 1.0, batch) >= course.day_one
    if day_one is not None:
        healthy = torch.full_like(healthy, not day_one)
    days = torch.stack([healthy, torch.ones_like(healthy)], dim=1)[:, None].expand(batch, rows, 2)
    lacks = (draw.even(0.0, 1.0, batch, rows, 1) < course.unpaired) & healthy[:, None, None]
    lacks = lacks & (torch.arange(2, device=device) == draw.one_of(2, batch, rows, 1))
    lacks[:, 0, 1] = False  # one row of the later day at least
    return columns[:, None, None] & cells & (days & ~lacks)[..., None]


def _with_law_error(figures: Tensor, sensors: SensorPrior, draw: Draw) -> Tensor:
    """What laws that were not simulated might do to figures (B, J, 2, figures): on both days alike, and to what changes
    from one to the other; a part is the same in all turns."""
    batch, rows, _, count = figures.shape

    def factors(ends: tuple[float, float]) -> Tensor:
        size = draw.log_even(ends, batch, 1, 1, 1)
        return size * (0.8 * draw.normal(batch, 1, 1, count) + 0.6 * draw.normal(batch, rows, 1, count))

    before = figures[:, :, :1]
    change = figures[:, :, 1:] - before
    unit = change_unit(torch, before)
    mixing = draw.log_even(sensors.change_error, batch, 1, 1) * draw.normal(batch, count, count) / count**0.5
    mixed = torch.einsum("brdc,bce->brde", change / unit, mixing) * unit
    after = before + change * (1.0 + factors(sensors.change_error)) + mixed
    return torch.cat([before, after], dim=2) * (1.0 + factors(sensors.law_error))


def _misread(figures: Tensor, prior: TablePrior, draw: Draw) -> tuple[Tensor, Tensor]:
    """``figures`` (B, J, 2, figures), and which cases (B,) have some on the later day that no effect makes."""
    batch, _, _, count = figures.shape
    hit = draw.even(0.0, 1.0, batch) < prior.misread
    chosen = torch.argsort(draw.even(0.0, 1.0, batch, count), dim=1) < 1 + draw.one_of(3, batch, 1)
    side = 2.0 * draw.one_of(2, batch, count).float() - 1.0
    factor = torch.exp(side * draw.log_even(prior.misread_by, batch, count) * chosen * hit[:, None])
    later = figures[:, :, 1] * factor[:, None]
    return torch.stack([figures[:, :, 0], later], dim=2), hit


def _scattered(figures: Tensor, prior: TablePrior, draw: Draw) -> tuple[Tensor, Tensor, Tensor]:
    """``figures`` (B, J, 2, figures) as a table gives them, standard deviations, and which tables give these."""
    batch, rows, days, count = figures.shape
    device = draw.device
    size = draw.log_even(prior.scatter, batch, 1, 1, 1) * torch.exp(prior.unevenness * draw.normal(batch, 1, 1, count))
    std = size * change_unit(torch, figures)
    values = figures + std * draw.normal(batch, rows, days, count)
    step = torch.where(torch.tensor(TIMES, device=device), 0.01, 0.1)
    rounded = draw.even(0.0, 1.0, batch, 1, 1, 1) < prior.rounded
    values = torch.where(rounded, torch.round(values / step) * step, values)
    given = std * torch.exp(prior.std_error * draw.normal(batch, rows, days, count))
    known = draw.even(0.0, 1.0, batch, 1, 1, 1) < prior.std_known
    return values, given, known.expand(values.shape)
