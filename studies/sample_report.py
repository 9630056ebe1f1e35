"""The sample report of the documentation: a development plant with one effect, which the diagnosis is not told.

``python -m studies.sample_report FOLDER [--seed S] [--level L] [--number N]`` simulates the N-th case with a single effect
of a suite of development plants, whose laws are not the twin's, diagnoses it with the stock machine file, writes what
``aoro-gym diagnose`` writes into the folder, and prints the truth afterwards.
"""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path

from aoro_gym.diagnosis.diagnose import diagnose
from aoro_gym.diagnosis.report import write_report
from studies.development.cases import LAYERED, cases_of, planned


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1, help="of the suite")
    parser.add_argument("--level", type=int, default=2, help="of the plant's laws, from 0, nearest to the twin's, to 3")
    parser.add_argument("--number", type=int, default=0, help="of the case among those with a single effect")
    options = parser.parse_args()
    cases = cases_of(planned(options.seed), LAYERED[options.level], kind="single", most=options.number + 1)
    case = next(islice(cases, options.number, None))
    found = diagnose(case.later, healthy=case.healthy, out=options.folder, progress=lambda text, share: print(text))
    found.save(options.folder)
    write_report(found, options.folder)
    print(f"{found.verdict}: {found.causes[0].effects if found.causes else ()}")
    print(f"truth: {dict(case.sizes)}")


if __name__ == "__main__":
    main()
