"""A small detector without anchors: each cell of a map says what stands in its middle and how far away its edges are.

A network of 0.44 million weights, or of more, makes a map of a quarter of the picture's size. Its scores learn bell curves
round the middles of boxes, as in Zhou, Wang and Krähenbühl, *Objects as Points*, arXiv:1904.07850; its distances to the four
edges learn by the generalised intersection over union (Rezatofighi and others, arXiv:1902.09630), as in Tian and others,
*FCOS*, arXiv:1904.01355. It starts from random numbers: nothing is downloaded.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional

from aoro_gym.execution.files import written_whole
from studies.log_detection.keeping import Keeping
from studies.log_detection.pictures import CANVAS, CLASSES, Pictures

STRIDE = 4
"""Pixels of a cell."""
CHANNELS = (16, 24, 48, 96, 96)
"""Of maps of a half, a quarter, an eighth, a sixteenth and a thirty-second of the picture's size."""
HEAD = 32
LEARNING_RATE, DECAY = 2e-3, 1e-2
BATCH = 16
TOLD = 20
"""Batches from one report of progress to the next on a GPU: reading the loss waits for it."""
POSITIVE = 0.5
"""Height of a bell curve from which a cell learns the box's edges."""
LEAST_SCORE, MOST, OVERLAP = 0.02, 100, 0.6
"""Of what is told: least score, most boxes a picture, and the overlap from which the weaker box of a class goes."""


def _layer(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class Detector(nn.Module):
    """The network, for the ``classes`` that it names.

    Args:
        classes: By name.
        canvas: Height and width [pixels] that it sees pictures in.
        wide: Channels by those of the smallest one: weights by the square of it.
    """

    def __init__(self, classes: Sequence[str] = CLASSES, canvas: tuple[int, int] = CANVAS, wide: int = 1):
        super().__init__()
        self.classes, self.canvas, self.wide = tuple(classes), (int(canvas[0]), int(canvas[1])), wide
        channels, head = [wide * count for count in CHANNELS], wide * HEAD
        half, quarter, eighth, sixteenth, last = channels
        self.quarter = nn.Sequential(_layer(3, half, 2), _layer(half, quarter, 2), _layer(quarter, quarter))
        self.coarser = nn.ModuleList(
            [
                nn.Sequential(_layer(quarter, eighth, 2), _layer(eighth, eighth)),
                nn.Sequential(_layer(eighth, sixteenth, 2), _layer(sixteenth, sixteenth)),
                nn.Sequential(_layer(sixteenth, last, 2), _layer(last, last), _layer(last, last)),
            ]
        )
        self.sides = nn.ModuleList(nn.Conv2d(count, head, 1) for count in channels[1:])
        self.scores = nn.Sequential(_layer(head, head), nn.Conv2d(head, len(self.classes), 1))
        self.edges = nn.Sequential(_layer(head, head), nn.Conv2d(head, 4, 1))
        nn.init.constant_(self.scores[-1].bias, -4.0)  # type: ignore[arg-type]  # few cells have something in them
        nn.init.constant_(self.edges[-1].bias, math.log(3.0))  # type: ignore[arg-type]

    def forward(self, pictures: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of the scores (N, C, H/4, W/4) and distances (N, 4, H/4, W/4) [pixels] to left, upper, right and lower
        edges, of pictures (N, 3, H, W) from -1 to 1."""
        maps = [self.quarter(pictures)]
        for stage in self.coarser:
            maps.append(stage(maps[-1]))
        out = self.sides[-1](maps[-1])
        for side, finer in zip(self.sides[-2::-1], maps[-2::-1], strict=True):
            out = side(finer) + functional.interpolate(out, size=finer.shape[-2:])
        return self.scores(out), STRIDE * torch.exp(self.edges(out).float().clamp(-3.0, 5.0))

    def save(self, path: Path, told: dict[str, Any] | None = None) -> None:
        """As safetensors, with classes, canvas and width, and what else is told of it."""
        made = {"classes": self.classes, "canvas": self.canvas, "wide": self.wide, "told": told or {}}
        description = {name: json.dumps(value) for name, value in made.items()}
        with written_whole(path) as temporary:
            save_file({name: value.contiguous() for name, value in self.state_dict().items()}, temporary, description)

    @classmethod
    def load(cls, path: Path) -> Detector:
        """Raises ``ValueError`` where the file holds no detector."""
        try:
            with safe_open(path, framework="pt") as opened:
                described = {name: json.loads(opened.metadata()[name]) for name in ("classes", "canvas", "wide")}
                made = cls(**described)
                made.load_state_dict({name: opened.get_tensor(name) for name in opened.keys()})  # noqa: SIM118
        except Exception as error:
            raise ValueError(f"{path} holds no detector of `python -m studies.log_detection train`: {error}") from error
        return made.eval()


def normalised(pixels: Tensor) -> Tensor:
    """(N, 3, H, W) from -1 to 1, of (N, H, W, 3) from 0 to 255."""
    return (pixels.permute(0, 3, 1, 2).float() / 127.5 - 1.0).contiguous(memory_format=torch.channels_last)


def padded(
    boxes: Sequence[NDArray[np.float32]], labels: Sequence[NDArray[np.int64]], device: str = "cpu"
) -> tuple[Tensor, Tensor]:
    """Boxes (N, K, 4) and labels (N, K) of pictures, K that of the picture with the most; labels of no box are -1."""
    most = max([1, *map(len, boxes)])
    whole, kinds = np.zeros((len(boxes), most, 4), np.float32), np.full((len(boxes), most), -1, np.int64)
    for number, (own, label) in enumerate(zip(boxes, labels, strict=True)):
        whole[number, : len(own)], kinds[number, : len(own)] = own, label
    return torch.from_numpy(whole).to(device), torch.from_numpy(kinds).to(device)


def targets(boxes: Tensor, labels: Tensor, count: int, canvas: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor]:
    """What cells learn: scores (N, C, H/4, W/4), edges (N, 4, H/4, W/4) of the box that counts in a cell, [pixels], and the
    weights (N, H/4, W/4) of these, 1 in sum for each box. Of several boxes the nearest middle counts.

    Args:
        boxes: (N, K, 4) [pixels].
        labels: (N, K) places of classes; -1: no box.
        count: Of classes.
        canvas: Height and width [pixels].
    """
    at = cells(canvas, boxes.device)
    columns, rows = at[0, 0], at[1, :, 0]
    middle, size = 0.5 * (boxes[..., :2] + boxes[..., 2:]), boxes[..., 2:] - boxes[..., :2]
    spread = (size / 6.0).clamp(min=0.6 * STRIDE)
    across = torch.exp(-0.5 * ((columns - middle[..., :1]) / spread[..., :1]) ** 2)
    down = torch.exp(-0.5 * ((rows - middle[..., 1:]) / spread[..., 1:]) ** 2)
    across = across / across.amax(dim=-1, keepdim=True).clamp(min=1e-6)  # the nearest cell has 1
    down = down / down.amax(dim=-1, keepdim=True).clamp(min=1e-6)
    bells = (down * (labels >= 0)[..., None])[..., None] * across[..., None, :]
    none = bells.new_zeros(())
    heat = torch.stack(
        [torch.where((labels == kind)[..., None, None], bells, none).amax(dim=1) for kind in range(count)], dim=1
    )
    most, owner = bells.max(dim=1)
    places = owner.flatten(1)
    edges = boxes.gather(1, places[..., None].expand(-1, -1, 4)).permute(0, 2, 1).reshape(len(boxes), 4, *at.shape[1:])
    counts = torch.where(most >= POSITIVE, most, 0.0).flatten(1)
    shares = torch.zeros_like(labels, dtype=counts.dtype).scatter_add(1, places, counts)
    weights = counts / shares.clamp(min=1e-6).gather(1, places)  # large boxes have many cells, but one vote
    return heat, edges, weights.view_as(most)


def cells(canvas: tuple[int, int], device: torch.device | str = "cpu") -> Tensor:
    """(2, H/4, W/4) x and y [pixels] of the cells' middles."""
    height, width = (edge // STRIDE for edge in canvas)
    rows, columns = torch.meshgrid(
        torch.arange(height, device=device), torch.arange(width, device=device), indexing="ij"
    )
    return torch.stack([columns, rows]) * STRIDE + 0.5 * STRIDE


def loss(scores: Tensor, distances: Tensor, wanted: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    """Focal loss of the scores, the mean over classes of a middle's share, so that rare classes count as common ones, and
    one less the generalised intersection over union, the mean over boxes."""
    heat, edges, weights = wanted
    scores = scores.float()
    chance, hit = torch.sigmoid(scores), heat >= 0.999
    good = functional.logsigmoid(scores) * (1.0 - chance) ** 2
    bad = functional.logsigmoid(-scores) * chance**2 * (1.0 - heat) ** 4
    around = (0, 2, 3)
    focal = -(torch.where(hit, good, bad).sum(dim=around) / hit.sum(dim=around).clamp(min=1)).mean()
    at = cells((STRIDE * distances.shape[2], STRIDE * distances.shape[3]), distances.device)
    low, high = at - distances[:, :2], at + distances[:, 2:]
    own_low, own_high = edges[:, :2], edges[:, 2:]
    both = (torch.minimum(high, own_high) - torch.maximum(low, own_low)).clamp(min=0).prod(dim=1)
    either = (high - low).prod(dim=1) + (own_high - own_low).prod(dim=1) - both
    hull = (torch.maximum(high, own_high) - torch.minimum(low, own_low)).prod(dim=1)
    apart = 1.0 - both / either.clamp(min=1e-3) + (hull - either) / hull.clamp(min=1e-3)
    return focal + (weights * apart).sum() / weights.sum().clamp(min=1.0)


def varied(pixels: Tensor, boxes: Tensor, labels: Tensor, draw: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Pictures mirrored, shifted, scaled by 0.8 to 1.25 and of other brightness and colour; their boxes, cut off at the
    edges; and their labels, -1 where less than a third of a box is left on the canvas.

    Args:
        pixels: (N, 3, H, W) from -1 to 1.
        boxes: (N, K, 4) [pixels].
        labels: (N, K); -1: no box.
        draw: On the CPU, so that all devices draw the same.
    """
    count, (height, width), device = len(pixels), pixels.shape[2:], pixels.device
    scale = torch.exp(torch.empty(count).uniform_(math.log(0.8), math.log(1.25), generator=draw))
    shift = torch.empty(count, 2).uniform_(-0.12, 0.12, generator=draw)
    mirror = torch.where(torch.rand(count, generator=draw) < 0.5, -1.0, 1.0)
    gain = torch.exp(torch.empty(count, 3).uniform_(-0.1, 0.1, generator=draw))
    bright = torch.exp(torch.empty(count, 1).uniform_(-0.35, 0.35, generator=draw))
    drawn = torch.cat([scale[:, None], shift, mirror[:, None], gain * bright], dim=1).to(device)
    scale, shift, mirror, gain = drawn[:, 0], drawn[:, 1:3], drawn[:, 3], drawn[:, 4:]
    affine = torch.zeros(count, 2, 3, device=device)
    affine[:, 0, 0], affine[:, 1, 1], affine[:, :, 2] = mirror / scale, 1.0 / scale, shift
    grid = functional.affine_grid(affine, [count, 3, height, width], align_corners=False)
    moved = functional.grid_sample(pixels, grid, align_corners=False)
    moved = ((moved + 1.0) * gain[..., None, None] - 1.0).clamp(-1.0, 1.0)
    half = torch.tensor([width / 2.0, height / 2.0], device=device)
    stretch = torch.stack([mirror * scale, scale], dim=1)[:, None, None]
    corners = ((boxes.unflatten(-1, (2, 2)) / half - 1.0 - shift[:, None, None]) * stretch + 1.0) * half
    low, high = corners.amin(dim=2), corners.amax(dim=2)
    within_low, within_high = low.clamp(min=0.0), torch.minimum(high, 2.0 * half)
    share = (within_high - within_low).clamp(min=0.0).prod(dim=-1) / (high - low).prod(dim=-1).clamp(min=1e-3)
    return moved, torch.cat([within_low, within_high], dim=-1), torch.where(share > 1.0 / 3.0, labels, -1)


def train(
    pictures: Pictures,
    *,
    steps: int = 800,
    batch: int = BATCH,
    wide: int = 1,
    seed: int = 0,
    start: Detector | None = None,
    device: str = "cpu",
    progress: Callable[[float, str], None] | None = None,
    keeping: Keeping | None = None,
) -> Detector:
    """A detector that has learnt from pictures.

    Args:
        pictures: With their boxes.
        steps: Batches.
        batch: Pictures of a batch.
        wide: Of the network, where it starts from random weights.
        seed: Of first weights, batches and variations.
        start: A detector to go on from, with the same classes and canvas; None: random weights.
        device: Of the training; the detector comes back to the CPU.
        progress: Told the share that is done, and the loss.
        keeping: Where it is kept each minute, and goes on from if it was; the detector is the same.

    Raises:
        ValueError: There is no picture, or the first detector has other classes or another canvas.
    """
    if not len(pictures):
        raise ValueError("there is no picture to learn from")
    if start is not None and (start.classes, start.canvas) != (pictures.classes, pictures.canvas):
        told = [f"{one.classes} on a canvas of {one.canvas}" for one in (start, pictures)]
        raise ValueError(f"the detector to start from knows {told[0]}, the pictures {told[1]}")
    torch.manual_seed(seed)
    draw = torch.Generator().manual_seed(seed)
    made = Detector(pictures.classes, pictures.canvas, wide if start is None else start.wide)
    if start is not None:
        made.load_state_dict(start.state_dict())
    made = made.to(device, memory_format=torch.channels_last).train()  # type: ignore[call-overload]
    on_gpu = torch.device(device).type == "cuda"
    if on_gpu:
        torch.backends.cudnn.benchmark = True  # all batches have one shape
    learning = torch.optim.AdamW(made.parameters(), lr=LEARNING_RATE, weight_decay=DECAY, fused=on_gpu)
    schedule = torch.optim.lr_scheduler.OneCycleLR(learning, LEARNING_RATE, total_steps=steps, pct_start=0.1)
    pixels = torch.from_numpy(pictures.pixels).to(device)
    boxes, labels = padded(pictures.boxes, pictures.labels, device)
    recent, done = torch.zeros((), device=device), 0
    parts = {"detector": made, "learning": learning, "schedule": schedule}
    course = {
        "steps": steps, "batch": batch, "seed": seed, "pictures": len(pictures), "canvas": list(made.canvas),
        "wide": made.wide, "tuned": start is not None, "device": torch.device(device).type,
    }  # fmt: skip
    if keeping is not None:
        done, kept = keeping.restore(course, parts, draw)
        recent = recent if kept is None else kept.to(device)
    for step in range(done, steps):
        chosen = torch.randint(len(pictures), (batch,), generator=draw).to(device)
        moved, own, kinds = varied(normalised(pixels[chosen]), boxes[chosen], labels[chosen], draw)
        wanted = targets(own, kinds, len(pictures.classes), pictures.canvas)
        with torch.autocast(torch.device(device).type, dtype=torch.bfloat16):
            scores, distances = made(moved)
        value = loss(scores, distances, wanted)
        learning.zero_grad()
        value.backward()
        nn.utils.clip_grad_norm_(made.parameters(), 10.0)
        learning.step()
        schedule.step()
        recent = value.detach() if step == 0 else 0.95 * recent + 0.05 * value.detach()
        if progress is not None and (not on_gpu or step % TOLD == 0 or step == steps - 1):
            progress((step + 1) / steps, f"loss {recent.item():.2f}")
        if keeping is not None:
            keeping.keep(course, parts, draw, step + 1, recent)
    return made.cpu().eval()


def detect(detector: Detector, pixels: NDArray[np.uint8], device: str = "cpu") -> list[NDArray[np.float32]]:
    """Of pictures (N, H, W, 3) on the canvas, each (K, 6): left, upper, right, lower [pixels], score, class."""
    out, there = [], detector.to(device)
    for first in range(0, len(pixels), 32):
        with torch.no_grad():
            scores, distances = there(normalised(torch.from_numpy(pixels[first : first + 32]).to(device)))
        scores, distances = torch.sigmoid(scores).cpu(), distances.cpu()
        out += [_told(one, own) for one, own in zip(scores, distances, strict=True)]
    detector.cpu()
    return out


def _told(scores: Tensor, distances: Tensor) -> NDArray[np.float32]:
    """The best of one picture's cells that no neighbour beats, without those that lie over better ones."""
    peaks = functional.max_pool2d(scores[None], 3, 1, 1)[0]
    height, width = STRIDE * scores.shape[1], STRIDE * scores.shape[2]
    at = cells((height, width))
    corners = torch.cat([at - distances[:2], at + distances[2:]]).clamp(min=0.0)
    corners = torch.minimum(corners, torch.tensor([width, height, width, height])[:, None, None])
    kinds, rows, columns = torch.nonzero((scores == peaks) & (scores >= LEAST_SCORE), as_tuple=True)
    order = scores[kinds, rows, columns].argsort(descending=True)[: 4 * MOST]
    kinds, rows, columns = kinds[order], rows[order], columns[order]
    found = torch.cat([corners[:, rows, columns].T, scores[kinds, rows, columns, None], kinds[:, None]], dim=1)
    return _thinned(found.numpy().astype(np.float32))


def _thinned(found: NDArray[np.float32]) -> NDArray[np.float32]:
    """Boxes (K, 6), best first, without those that overlap a better one of their class too much."""
    kept: list[int] = []
    areas = (found[:, 2] - found[:, 0]) * (found[:, 3] - found[:, 1])
    left = np.ones(len(found), dtype=bool)
    for number in range(len(found)):
        if not left[number] or len(kept) == MOST:
            continue
        kept.append(number)
        low, high = np.maximum(found[:, :2], found[number, :2]), np.minimum(found[:, 2:4], found[number, 2:4])
        both = np.clip(high - low, 0.0, None).prod(axis=1)
        over = both / np.maximum(areas + areas[number] - both, 1e-6)
        left &= (over < OVERLAP) | (found[:, 5] != found[number, 5])
    return found[kept]
