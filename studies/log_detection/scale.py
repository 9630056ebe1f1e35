"""How large the study is: one that two cores do in hours, and one for a GPU."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scale:
    """Sizes of the study."""

    canvas: tuple[int, int]
    """Height and width [pixels] of the pictures."""
    sizes: tuple[int, ...]
    """Pictures of made forests that detectors learn from."""
    ablated: int
    """Pictures of each set in which something is not drawn anew."""
    tested: int
    """Pictures of forests of other seeds that detectors are scored on."""
    of_forest: int
    """Pictures of a forest to learn from."""
    shots: tuple[int, ...]
    """Pictures of the other renderer that detectors learn from, after made forests or from scratch."""
    others: tuple[int, int]
    """Pictures of the other renderer: to learn from, and to score on, of woods of their own."""
    long_steps: int
    """Batches of the training that others go on from."""
    steps: int
    """Batches of the others on made forests."""
    fine_steps: int
    """Batches on the other renderer's pictures, whether from scratch or not."""
    batch: int
    """Pictures of one."""


SCALES = {
    "cpu": Scale(
        (144, 192), (20, 40, 80, 160, 320), 100, 100, 5, (0, 5, 10, 20, 40, 80), (120, 100), 2400, 800, 250, 16
    ),
    "gpu": Scale((240, 320), (100, 500, 3000), 500, 400, 20, (0, 5, 20, 80), (80, 160), 16_000, 6000, 1000, 32),
}
"""``gpu`` is what the page of evidence tells first, ``cpu`` what it tells below."""
