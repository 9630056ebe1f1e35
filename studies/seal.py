"""The judged suite: drawn by the operating system's chance, simulated, judged, written and sealed.

``python -m studies.seal FOLDER ANSWERS [--suite NAME] [--device cuda:0] [--stock]`` goes on where it was stopped: libraries
and calibrated machines are kept in ``FOLDER``. Calibration takes 22 to 30 minutes a machine on two cores; with ``--stock``
only the suite with the stock machine file is made.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from aoro_gym.diagnosis_benchmark import independent
from aoro_gym.diagnosis_benchmark.judge.plants import IndependentPlants
from aoro_gym.diagnosis_benchmark.judge.suite import SUITES
from aoro_gym.diagnosis_benchmark.judged_suite import VARIANTS, calibrate_on, draw, write_machines, write_suite
from aoro_gym.execution.files import read_json
from studies.judge import libraries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--suite", choices=SUITES, default="seal")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--stock", action="store_true", help="no machine file is calibrated")
    options = parser.parse_args()
    variants = VARIANTS[:1] if options.stock else VARIANTS
    judged = [IndependentPlants(name, options.device) for name in independent.FAMILIES]
    made = draw(SUITES[options.suite], judged, options.answers)
    options.folder.mkdir(parents=True, exist_ok=True)
    books = libraries(options.folder, made, judged, options.device)
    if not options.stock:
        write_machines(options.folder, made, judged, calibrate_on(options.device))
    write_suite(options.folder, options.answers, made, judged, books, variants)
    for variant in variants:
        print(variant, read_json(options.folder / variant / "seal.json")["sha256"])


if __name__ == "__main__":
    main()
