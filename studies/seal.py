"""The judged suite: drawn by the operating system's chance, simulated, judged, written and sealed.

``python -m studies.seal FOLDER ANSWERS [--families GROUP] [--suite NAME] [--device cuda:0] [--processes N] [--stock]``
goes on where it was stopped: libraries and calibrated machines are kept in ``FOLDER``. Calibration takes 22 to 30 minutes a
machine on two cores; with ``--stock`` only the suite with the stock machine file is made. Families are simulated beside one
another in processes, which a GPU shares out best with its multi-process service.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from aoro_gym.diagnosis_benchmark.judge.observed import observe
from aoro_gym.diagnosis_benchmark.judge.plants import JUDGED, OPEN, LayeredPlants, Plants, judged_plants
from aoro_gym.diagnosis_benchmark.judge.suite import SUITES
from aoro_gym.diagnosis_benchmark.judged_suite import VARIANTS, calibrate_on, draw, write_machines, write_suite
from aoro_gym.execution.files import read_json
from studies.judge import LEVELS, library


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--families", choices=JUDGED, default="independent", help="whose plants are judged")
    parser.add_argument("--suite", choices=SUITES, default="seal")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--processes", type=int, default=2, help="that simulate a family each")
    parser.add_argument("--stock", action="store_true", help="no machine file is calibrated")
    options = parser.parse_args()
    variants = VARIANTS[:1] if options.stock else VARIANTS
    judged = judged_plants(options.families, options.device)
    others: list[Plants] = [LayeredPlants(level, options.device) for level in LEVELS]
    for group in dict.fromkeys((*OPEN, options.families)):
        others += judged_plants(group, options.device)
    made = draw(SUITES[options.suite], judged, options.answers)
    options.folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
        watched = pool.map(partial(observe, made), judged)
        books = list(pool.map(partial(library, options.folder, made, options.device), others))
        seen = {name: one for family in watched for name, one in family.items()}
    if not options.stock:
        write_machines(options.folder, made, judged, calibrate_on(options.device))
    write_suite(options.folder, options.answers, made, judged, seen, books, variants)
    for variant in variants:
        print(variant, read_json(options.folder / variant / "seal.json")["sha256"])


if __name__ == "__main__":
    main()
