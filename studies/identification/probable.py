"""What the most probable machines predict: ``aoro-gym calibrate --published`` without one level.

    python -m studies.identification.probable --device cpu:simd
    python -m studies.identification.probable --device cpu:simd --reference physical

As the command itself: the published procedure, least squares from the data sheet, then the most probable machine that has
the figures of the two other levels, of the published twin or of the real machine, with the same limits; the score is that of
:mod:`.splits`.
"""

from __future__ import annotations

import argparse
import sys
from itertools import compress

import numpy as np

from aoro_gym.calibration.fit import least_squares_fit
from aoro_gym.calibration.probable import most_probable_fit, prior_cost
from aoro_gym.calibration.procedure import measured_curve, published_procedure
from aoro_gym.calibration.progress import Work
from aoro_gym.calibration.published import LEVELS, PRIOR_WEIGHT, SINGLE_FIGURES, PublishedFigures
from aoro_gym.calibration.space import Space
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES, SWING
from studies.identification.figures import REFERENCES, found_of, targets
from studies.identification.splits import BY_LEVEL, Split
from studies.identification.table import table


def known(split: Split) -> np.ndarray:
    """Rows of the published figures that a split fits: turns at its levels; the swing of their steady flow, known of the
    published twin alone; and single figures, of which the rims' speed belongs to the turn at full signal."""
    steady = split.levels & (split.reference == "mevea")
    of_turns = [np.repeat(levels, len(names)) for levels, names in ((split.levels, FIGURES), (steady, SWING))]
    return np.concatenate([*of_turns, [name != "rim_speed" or split.levels[0] for name in SINGLE_FIGURES]])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu, cpu:simd or cuda:N")
    parser.add_argument("--reference", default="mevea", choices=REFERENCES, help="published twin, or real machine")
    given = parser.parse_args()
    device = given.device
    sheet = Machine.load("aoro_datasheet")
    target, tolerance = np.array([targets(given.reference, turn) for turn in LEVELS]).swapaxes(0, 1)
    comparison = PublishedFigures(target, tolerance, device, Work())
    start = published_procedure(sheet, device=device)
    uncertain = [p.key for p in sheet.parameters() if p.role in ("nuisance", "both")]
    space = Space(start, list(compress(uncertain, comparison.identifiable(Space(start, uncertain), 0))))
    prior, rows = space.point(measured_curve(sheet)), []
    for split in (split for split in BY_LEVEL if split.reference == given.reference):
        rows_known = known(split)

        def residuals(points: np.ndarray, which: np.ndarray = rows_known) -> np.ndarray:
            return comparison.residuals(space)(points)[which]

        near = least_squares_fit(residuals, space.point(), prior_weight=PRIOR_WEIGHT, starts=1, population=2)[0]
        fit = most_probable_fit(residuals, prior, np.array(near.point))
        machine = space.population(np.array(fit.point)).levelled()
        found = found_of(machine, np.ones((3, 1), dtype=bool), device, batch=1)
        rows.append([
            f"{split.left_out} %", f"{100.0 * split.score(found)[0]:.1f} %", f"{np.max(np.abs(fit.residuals)) / 2.0:.2f}",
            f"{prior_cost(np.array(fit.point), prior):.1f}", str(len(space.at_bounds(fit.point))),
        ])  # fmt: skip
        print(rows[-1], file=sys.stderr, flush=True)
    head = ["left out", "mean error there", "largest miss elsewhere, tolerances", "prior's cost", "at a bound"]
    print(table(head, rows))


if __name__ == "__main__":
    main()
