"""Training of the network on simulated days: batches drawn, sensed and labelled on the device."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.dataset import Labelled
from aoro_gym.diagnosis.network.features import features
from aoro_gym.diagnosis.network.model import Network
from aoro_gym.diagnosis.network.sensing import Draw, sensed
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.diagnosis.simulation.prior import SensorPrior

SENSORS = {"pressures": (1, 1, 1, 1), "ports": (1, 1, 1, 0), "angle": (1, 0, 0, 0)}
"""Channels of usual sets of sensors."""


@dataclass(frozen=True)
class Course:
    """How a network is trained.

    Attributes:
        steps: Batches.
        batch: Cases in each.
        rate: Highest learning rate; it rises over the first 3 % and falls as a cosine.
        decay: Of the weights.
        logs: Largest number of a case's logs.
        sensors: How often a case has each of :data:`SENSORS`; what remains has channels at random.
        day_one: Share of cases without healthy logs.
        unpaired: Share of logs that lack their healthy or their later day.
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
    size: float = 0.3
    presence: float = 5.0


@dataclass(frozen=True)
class Batch:
    """Cases as the network takes them, and their labels."""

    rows: Tensor
    present: Tensor
    hypothesis: Tensor
    effects: Tensor
    sizes: Tensor


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
        sensors: One of :data:`SENSORS`, with nothing else missing; by default anything may be.
    """
    batch = len(machines)
    day = 1 + draw.one_of(data.samples.shape[1] - 1, batch)
    order = torch.argsort(draw.even(0.0, 1.0, batch, data.samples.shape[2]), dim=1)[:, : course.logs]
    both = torch.stack([torch.zeros_like(day), day], dim=1)
    pick = machines[:, None, None], both[:, :, None], order[:, None, :]
    own = machines[:, None], both
    signals = sensed(data.samples[pick], data.chain[own], data.outsider[own], prior, draw)
    has, days, present = _what_there_is(batch, order.shape[1], signals.shape[3], course, draw, sensors)
    rows = features(torch, data.commands[machines[:, None], order], signals[:, 0], signals[:, 1], has, days)
    return Batch(rows, present, data.hypothesis[machines, day], data.effects[machines, day], data.sizes[machines, day])


def _what_there_is(
    batch: int, logs: int, channels: int, course: Course, draw: Draw, sensors: str | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Channels (B, J, channels), healthy and later days (B, J, 2), and logs (B, J)."""
    device = draw.device
    if sensors is not None:
        has = torch.tensor(SENSORS[sensors], device=device, dtype=torch.float32).expand(batch, logs, channels)
        return has, torch.ones(batch, logs, 2, device=device), torch.ones(batch, logs, dtype=torch.bool, device=device)
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
    days[..., 0] = (draw.even(0.0, 1.0, batch, 1) >= course.day_one).float()
    lacks, which_day = draw.even(0.0, 1.0, batch, logs) < course.unpaired, draw.one_of(2, batch, logs)
    days[..., 0] *= 1.0 - (lacks & (which_day == 0)).float()
    days[..., 1] *= 1.0 - (lacks & (which_day == 1) & (days[..., 0] > 0)).float()
    days[:, 0, 1] = 1.0  # one log of the later day at least
    return has[:, None].expand(batch, logs, channels), days, present


def loss_of(logits: Tensor, quantiles: Tensor, batch: Batch, course: Course) -> dict[str, Tensor]:
    """Cross-entropy of the hypotheses, binary one of the effects' presence, pinball loss of the sizes."""
    cause = nn.functional.cross_entropy(logits, batch.hypothesis)
    share = effect_probabilities(torch.softmax(logits, dim=1)).clamp(1e-6, 1.0 - 1e-6)
    truth = torch.zeros_like(share)
    for place in range(2):
        there = batch.effects[:, place] >= 0
        truth[there, batch.effects[there, place]] = 1.0
    presence = nn.functional.binary_cross_entropy(share, truth)
    levels = torch.tensor(QUANTILES, device=logits.device)
    pinball = logits.new_zeros(())
    count = 0
    for place in range(2):
        there = batch.effects[:, place] >= 0
        error = batch.sizes[there, place][:, None] - quantiles[there, batch.effects[there, place]]
        pinball = pinball + torch.maximum(levels * error, (levels - 1.0) * error).sum()
        count += len(error) * len(QUANTILES)
    pinball = pinball / max(count, 1)
    total = cause + course.presence * presence + course.size * pinball
    return {"loss": total, "cause": cause, "presence": presence, "size": pinball}


def effect_probabilities(probabilities: Tensor) -> Tensor:
    """Probability (..., effects) that an effect is there, of those of the hypotheses (..., HYPOTHESES)."""
    return probabilities @ torch.tensor(hypotheses.MEMBERS, dtype=probabilities.dtype, device=probabilities.device)


def train(
    data: Labelled,
    course: Course,
    *,
    shape: Shape | None = None,
    prior: SensorPrior | None = None,
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
        prior: What sensors add.
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
    network = Network(shape).to(device)
    optimiser = torch.optim.AdamW(network.parameters(), lr=course.rate, weight_decay=course.decay, betas=(0.9, 0.98))
    began, done = time.monotonic(), 0.0
    for step in range(course.steps):
        done = max(step / course.steps, (time.monotonic() - began) / seconds)
        if done >= 1.0:
            break
        warm = min(1.0, (step + 1) / (0.03 * course.steps))
        for group in optimiser.param_groups:
            group["lr"] = course.rate * warm * (0.02 + 0.98 * 0.5 * (1.0 + math.cos(math.pi * done)))
        machines = draw.one_of(data.machines - held_out, course.batch)
        with torch.no_grad():
            batch = draw_batch(data, machines, course, prior, draw)
        with torch.autocast(device.type, dtype=torch.bfloat16):
            logits, quantiles = network(batch.rows, batch.present)
        losses = loss_of(logits.float(), quantiles.float(), batch, course)
        optimiser.zero_grad(set_to_none=True)
        losses["loss"].backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        if step % max(min(100, course.steps // 50), 1) == 0:
            progress(step, course.steps, {name: float(value.detach()) for name, value in losses.items()})
    return network
