"""Training of the network on simulated days: batches drawn, sensed and labelled on the device."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any

import torch
from torch import Tensor, nn

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.dataset import Labelled
from aoro_gym.diagnosis.network.features import features
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.model import Causes, Network
from aoro_gym.diagnosis.network.sensing import Draw, sensed
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.diagnosis.simulation.days import HEALTHY
from aoro_gym.diagnosis.simulation.prior import SensorPrior

SENSORS = {"pressures": (1, 1, 1, 1), "ports": (1, 1, 1, 0), "angle": (1, 0, 0, 0)}
"""Channels of usual sets of sensors."""


WARM = 0.03
"""Share of a training over which the learning rate rises."""


@dataclass(frozen=True)
class Course:
    """How a network is trained.

    Attributes:
        steps: Batches.
        batch: Cases in each.
        rate: Highest learning rate; it rises over :data:`WARM` of the training and falls as a cosine.
        decay: Of the weights.
        logs: Largest number of a case's logs.
        sensors: How often a case has each of :data:`SENSORS`; what remains has channels at random.
        day_one: Share of cases without healthy logs.
        unpaired: Share of logs that lack their healthy or their later day.
        repeated: Share of cases with healthy logs of a second day.
        repeats: Share of their logs that are.
        size: Weight of the sizes' loss.
        presence: Weight of the loss of single effects, whatever comes with them.
    """

    steps: int = 16000
    batch: int = 1024
    rate: float = 1e-3
    decay: float = 0.05
    logs: int = 6
    sensors: tuple[float, ...] = (0.45, 0.2, 0.25)
    day_one: float = 0.12
    unpaired: float = 0.06
    repeated: float = 0.3
    repeats: float = 0.4
    size: float = 0.3
    presence: float = 5.0


@dataclass(frozen=True)
class Batch:
    """Cases as the network takes them, and their labels; scaled sizes that nobody knows are NaN."""

    rows: Tensor
    present: Tensor
    hypothesis: Tensor
    effects: Tensor
    sizes: Tensor

    def joined(self, other: Batch) -> Batch:
        """These cases and ``other`` ones."""
        return Batch(
            *(torch.cat([mine, theirs]) for mine, theirs in zip(vars(self).values(), vars(other).values(), strict=True))
        )


@dataclass(frozen=True)
class Available:
    """What a user has of each case: channels (B, J, channels), healthy and later days (B, J, 2), 0 or 1; logs (B, J), and
    those whose later day is a healthy one, too (B, J)."""

    channels: Tensor
    days: Tensor
    logs: Tensor
    repeats: Tensor


def draw_batch(
    data: Labelled, machines: Tensor, course: Course, prior: SensorPrior, draw: Draw, sensors: str | None = None
) -> Batch:
    """Cases as a user may have them, a later day of each machine drawn.

    Args:
        data: Simulated days.
        machines: Their numbers (B,).
        course: What a user may lack, and how often.
        prior: What sensors add.
        draw: Random numbers.
        sensors: One of :data:`SENSORS`, with nothing else missing and no repeats; by default anything may be.
    """
    batch = len(machines)
    day = HEALTHY + draw.one_of(data.samples.shape[1] - HEALTHY, batch)
    order = torch.argsort(draw.even(0.0, 1.0, batch, data.samples.shape[2]), dim=1)[:, : course.logs]
    shape = (batch, order.shape[1], data.samples.shape[3])
    if sensors is None:
        has = what_there_may_be(shape, course, draw)
        order = _repeated(order, has.repeats, draw)
    else:
        has = _all_of(shape, sensors, draw.device)
    days = torch.stack([torch.zeros_like(day), day, torch.ones_like(day)], dim=1)
    pick = machines[:, None, None], days[:, :, None], order[:, None, :]
    own = machines[:, None], days
    signals = sensed(data.samples[pick], data.chain[own], data.outsider[own], prior, draw)
    second = torch.where(has.repeats[..., None, None], signals[:, 2], signals[:, 1])
    commands = data.commands[machines[:, None], order]
    rows = features(torch, commands, signals[:, 0], second, has.channels, has.days, has.repeats.float())
    return Batch(rows, has.logs, data.hypothesis[machines, day], data.effects[machines, day], data.sizes[machines, day])


def _all_of(shape: tuple[int, int, int], sensors: str, device: torch.device) -> Available:
    batch, logs, _ = shape
    has = torch.tensor(SENSORS[sensors], device=device, dtype=torch.float32).expand(shape)
    every = torch.ones(batch, logs, dtype=torch.bool, device=device)
    return Available(has, torch.ones(batch, logs, 2, device=device), every, ~every)


def what_there_may_be(shape: tuple[int, int, int], course: Course, draw: Draw) -> Available:
    """Channels, days, logs and repeats at random, of cases (B, J, channels)."""
    batch, logs, channels = shape
    device = draw.device
    usual = torch.tensor(tuple(SENSORS.values()), device=device, dtype=torch.float32)
    ends = torch.cumsum(torch.tensor(course.sensors, device=device), dim=0)
    which = torch.searchsorted(ends, draw.even(0.0, 1.0, batch))
    random = (draw.even(0.0, 1.0, batch, channels) < 0.6).float()
    has = torch.where((which < len(usual))[:, None], usual[which.clamp(max=len(usual) - 1)], random)
    has[:, 0] = torch.maximum(has[:, 0], (has.sum(dim=1) == 0).float())
    number = 1 + draw.one_of(logs, batch)
    number = torch.where(draw.even(0.0, 1.0, batch) < 0.5, torch.full_like(number, logs), number)
    present = torch.arange(logs, device=device) < number[:, None]
    days = torch.ones(batch, logs, 2, device=device)
    commissioned = draw.even(0.0, 1.0, batch, 1) >= course.day_one
    days[..., 0] = commissioned.float()
    repeats = commissioned & (draw.even(0.0, 1.0, batch, 1) < course.repeated)
    repeats = repeats & (draw.even(0.0, 1.0, batch, logs) < course.repeats)
    repeats[:, 0] = False
    lacks, which_day = draw.even(0.0, 1.0, batch, logs) < course.unpaired, draw.one_of(2, batch, logs)
    lacks = lacks & ~repeats
    days[..., 0] *= 1.0 - (lacks & (which_day == 0)).float()
    days[..., 1] *= 1.0 - (lacks & (which_day == 1) & (days[..., 0] > 0)).float()
    days[:, 0, 1] = 1.0  # one log of the later day at least
    return Available(has[:, None].expand(shape), days, present, repeats)


def _repeated(order: Tensor, repeats: Tensor, draw: Draw) -> Tensor:
    """Numbers of manoeuvres (B, J), those of half of the ``repeats`` (B, J) being other logs' as well."""
    batch, logs = order.shape
    others = order.gather(1, draw.one_of(logs, batch, logs))
    return torch.where(repeats & (draw.even(0.0, 1.0, batch, logs) < 0.5), others, order)


def loss_of(logits: Tensor, quantiles: Tensor, batch: Batch, course: Course) -> dict[str, Tensor]:
    """Cross-entropy of the hypotheses, binary one of the effects' presence, pinball loss of the sizes."""
    cause = nn.functional.cross_entropy(logits, batch.hypothesis)
    share = effect_probabilities(torch.softmax(logits, dim=1)).clamp(1e-6, 1.0 - 1e-6)
    there = batch.effects >= 0
    none = share.shape[1]  # a column more, which those that are not there go to
    truth = share.new_zeros(len(share), none + 1).scatter_(1, torch.where(there, batch.effects, none), 1.0)[:, :none]
    presence = nn.functional.binary_cross_entropy(share, truth)
    levels = _constant(QUANTILES, logits.device)
    asked = batch.effects.clamp(min=0)[..., None].expand(-1, -1, len(QUANTILES))
    known = there & torch.isfinite(batch.sizes)
    error = torch.where(known, batch.sizes, 0.0)[..., None] - quantiles.gather(1, asked)
    missed = torch.maximum(levels * error, (levels - 1.0) * error) * known[..., None]
    pinball = missed.sum() / (known.sum() * len(QUANTILES)).clamp(min=1)
    total = cause + course.presence * presence + course.size * pinball
    return {"loss": total, "cause": cause, "presence": presence, "size": pinball}


def effect_probabilities(probabilities: Tensor) -> Tensor:
    """Probability (..., effects) that an effect is there, of those of the hypotheses (..., HYPOTHESES)."""
    return probabilities @ _members(probabilities.device, probabilities.dtype)


@cache
def _members(device: torch.device, dtype: torch.dtype) -> Tensor:
    return torch.tensor(hypotheses.MEMBERS, dtype=dtype, device=device)


@cache
def _constant(values: tuple[float, ...], device: torch.device) -> Tensor:
    """On the device once: every copy to it waits for all that it has to do."""
    return torch.tensor(values, device=device)


def _drawn_ahead(make: Callable[[], Batch], device: torch.device) -> Iterator[Batch]:
    """Batches; on a GPU drawn on a stream of their own, while the network learns from the last one."""
    if device.type != "cuda":
        while True:
            yield make()
    drawing, learning = torch.cuda.Stream(device), torch.cuda.current_stream(device)
    drawing.wait_stream(learning)
    while True:
        with torch.cuda.stream(drawing):
            batch = make()
        learning.wait_stream(drawing)
        for part in vars(batch).values():
            part.record_stream(learning)
        yield batch


def train(
    data: Labelled,
    course: Course,
    *,
    shape: Shape | None = None,
    start: Weights | None = None,
    prior: SensorPrior | None = None,
    beside: Callable[[int, Draw], Batch] | None = None,
    held_out: int = 0,
    seed: int = 0,
    seconds: float = math.inf,
    progress: Callable[[int, int, dict[str, float]], Any] = lambda step, steps, losses: None,
) -> Network:
    """A trained network.

    Args:
        data: Simulated days.
        course: How it is trained.
        shape: Its sizes.
        start: Weights to begin with, of that shape; random ones by default.
        prior: What sensors add.
        beside: Draws cases that are half of every batch, given their number; all are simulated days by default.
        held_out: Machines, the last of ``data``, that it never sees.
        seed: Of the first weights and of all draws.
        seconds: Time after which it ends; the learning rate falls accordingly.
        progress: Called every hundred steps, and at least fifty times, with the step, their number and the losses by
            name.
    """
    torch.manual_seed(seed)
    device = data.samples.device
    prior = prior or SensorPrior()
    draw = Draw(torch.Generator(device=device).manual_seed(seed))
    network = (Network(shape) if start is None else Network.of(start)).to(device)

    own = course.batch if beside is None else course.batch // 2

    def make() -> Batch:
        batch = draw_batch(data, draw.one_of(data.machines - held_out, own), course, prior, draw)
        return batch if beside is None else batch.joined(beside(course.batch - own, draw))

    optimise(network, make, course, device, seconds=seconds, progress=progress)
    return network


def learning_rate(course: Course, done: float) -> float:
    """Of a batch when a share ``done`` of the training, of its steps or its time, is over."""
    warm = min(1.0, (done + 1.0 / course.steps) / WARM)
    return course.rate * warm * (0.02 + 0.98 * 0.5 * (1.0 + math.cos(math.pi * done)))


def optimise(
    network: Causes,
    make: Callable[[], Batch],
    course: Course,
    device: torch.device,
    *,
    seconds: float = math.inf,
    progress: Callable[[int, int, dict[str, float]], Any] = lambda step, steps, losses: None,
) -> None:
    """Train ``network`` on batches.

    Args:
        network: On the ``device``.
        make: Makes a batch.
        course: How the network is trained.
        device: Where that is.
        seconds: See :func:`train`.
        progress: See :func:`train`.
    """
    compiled = device.type == "cuda" and find_spec("triton") is not None
    learner = torch.compile(network) if compiled else network
    optimiser = torch.optim.AdamW(network.parameters(), lr=course.rate, weight_decay=course.decay, betas=(0.9, 0.98))
    batches = _drawn_ahead(make, device)
    began, done = time.monotonic(), 0.0
    for step in range(course.steps):
        done = max(step / course.steps, (time.monotonic() - began) / seconds)
        if done >= 1.0:
            break
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(course, done)
        batch = next(batches)
        with torch.autocast(device.type, dtype=torch.bfloat16):
            logits, quantiles = learner(batch.rows, batch.present)
        losses = loss_of(logits.float(), quantiles.float(), batch, course)
        optimiser.zero_grad(set_to_none=True)
        losses["loss"].backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        if step % max(min(100, course.steps // 50), 1) == 0:
            progress(step, course.steps, {name: float(value.detach()) for name, value in losses.items()})
