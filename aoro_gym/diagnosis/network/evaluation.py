"""How well a network names causes on simulated machines that it was not trained on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.dataset import Labelled
from aoro_gym.diagnosis.network.model import Causes, Network
from aoro_gym.diagnosis.network.sensing import Draw
from aoro_gym.diagnosis.network.training import Batch, Course, draw_batch
from aoro_gym.diagnosis.simulation.prior import SensorPrior

BATCH = 512


@dataclass(frozen=True)
class Answers:
    """What networks said of N cases, and the truth.

    Attributes:
        probabilities: Of the hypotheses (N, hypotheses).
        truth: Numbers of the true ones (N,).
        quantiles: Of the scaled sizes (N, effects, quantiles).
        effects: Numbers of the true effects (N, 2), −1 for none.
        sizes: Their scaled sizes (N, 2).
    """

    probabilities: NDArray[np.float32]
    truth: NDArray[np.int64]
    quantiles: NDArray[np.float32]
    effects: NDArray[np.int64]
    sizes: NDArray[np.float32]


@dataclass(frozen=True)
class Rates:
    """Shares of cases; of single effects and pairs whether or not they could be seen.

    Attributes:
        cases: Number of them.
        cross_entropy: Mean −ln of the truth's probability [nat].
        false_alarms: Nothing was wrong, and nothing is not the likeliest.
        noticed: A single effect, and nothing has a probability below one half.
        named_first: A single effect, and its probability is the highest of all effects'.
        named_of_noticed: The same of those noticed.
        among_three: A single effect, among the three likeliest.
        both: A pair, and the two likeliest effects are it.
        one: A pair, and the likeliest effect is one of it.
        outside: Something outside of the catalogue, and that is the likeliest.
        known_outside: An effect or a pair, and something outside is the likeliest.
        covered: Sizes within their 90 % intervals.
    """

    cases: int
    cross_entropy: float
    false_alarms: float
    noticed: float
    named_first: float
    named_of_noticed: float
    among_three: float
    both: float
    one: float
    outside: float
    known_outside: float
    covered: float

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)


def answers(
    networks: Sequence[Network], data: Labelled, machines: torch.Tensor, sensors: str, *, seed: int = 0, rounds: int = 1
) -> Answers:
    """What the mean of networks says of days of machines, all logs there.

    Args:
        networks: Their probabilities and quantiles are averaged.
        data: Simulated days.
        machines: Numbers of those that are asked about.
        sensors: One of the usual sets.
        seed: Of days and noise.
        rounds: Days of each machine.
    """
    draw = Draw(torch.Generator(device=data.samples.device).manual_seed(seed))
    course = Course(logs=data.samples.shape[2])
    parts = machines.repeat(rounds).split(BATCH)
    return answered(networks, (draw_batch(data, part, course, SensorPrior(), draw, sensors) for part in parts))


def answered(networks: Sequence[Causes], batches: Iterable[Batch]) -> Answers:
    """What the mean of ``networks`` says of ``batches``."""
    found = []
    with torch.no_grad():
        for batch in batches:
            said = [network.eval()(batch.rows, batch.present) for network in networks]
            share = torch.stack([torch.softmax(logits, dim=1) for logits, _ in said]).mean(dim=0)
            quantiles = torch.stack([quantiles for _, quantiles in said]).mean(dim=0)
            parts = (share, batch.hypothesis, quantiles, batch.effects, batch.sizes)
            found.append([values.cpu().numpy() for values in parts])
    return Answers(*(np.concatenate(column) for column in zip(*found, strict=True)))


def rates(given: Answers) -> Rates:
    """Shares of right and wrong answers."""
    share, truth = given.probabilities.astype(np.float64), given.truth
    first, by_effect = share.argmax(axis=1), share @ hypotheses.MEMBERS
    ranked = np.argsort(-by_effect, axis=1)
    nothing, outside = truth == hypotheses.NOTHING, truth == hypotheses.OUTSIDE
    single, pair = (truth >= hypotheses.SINGLE) & (truth < hypotheses.PAIR), truth >= hypotheses.PAIR
    noticed = share[:, hypotheses.NOTHING] < 0.5
    right = ranked[:, 0] == given.effects[:, 0]
    low, high = (
        np.take_along_axis(given.quantiles[:, :, place], np.maximum(given.effects, 0), axis=1) for place in (0, -1)
    )
    there = given.effects >= 0
    within = (given.sizes >= low) & (given.sizes <= high)

    def mean(values: NDArray[np.bool_], where: NDArray[np.bool_]) -> float:
        return float(values[where].mean()) if where.any() else float("nan")

    return Rates(
        cases=len(truth),
        cross_entropy=float(-np.log(share[np.arange(len(truth)), truth] + 1e-12).mean()),
        false_alarms=mean(first != hypotheses.NOTHING, nothing),
        noticed=mean(noticed, single),
        named_first=mean(right, single),
        named_of_noticed=mean(right, single & noticed),
        among_three=mean((ranked[:, :3] == given.effects[:, :1]).any(axis=1), single),
        both=mean((np.sort(ranked[:, :2], axis=1) == np.sort(given.effects, axis=1)).all(axis=1), pair),
        one=mean((ranked[:, :1] == given.effects).any(axis=1), pair),
        outside=mean(first == hypotheses.OUTSIDE, outside),
        known_outside=mean(first == hypotheses.OUTSIDE, single | pair),
        covered=mean(within, there),
    )
