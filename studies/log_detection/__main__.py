"""A detector for logs that learns from made forests.

    python -m studies.log_detection train logs/annotations/instances_train.json --images logs/images --out logs.safetensors
    python -m studies.log_detection score logs.safetensors own.json --images photographs --name log=Timber --sheet found.png

`train` and `score` take any files of COCO; what a detector was trained on and what it is scored on need not be of one make.
`pictures`, `study` and `figures` are a study, in this order: how good detectors are by number of pictures, without some of
what is drawn anew, and on another renderer's pictures. Each goes on where it was stopped, a training from where it was kept
within the last minute, with its scores until then in `partial` of the results; several processes of `study` share trainings.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from aoro_gym.execution.files import write_json, written_whole
from aoro_gym.reporting import terminal
from studies.log_detection.detector import BATCH, Detector, detect, train
from studies.log_detection.pictures import CANVAS, CLASSES, joined, load
from studies.log_detection.scale import SCALES
from studies.log_detection.scoring import score, told

RESULTS = Path(__file__).parents[1] / "log_detection_results"


def _train(asked: argparse.Namespace) -> None:
    for name, least in (("steps", 2), ("batch", 1), ("wide", 1)):
        if getattr(asked, name) < least:
            raise ValueError(f"--{name} is {getattr(asked, name)}, but must be at least {least}")
    if asked.width < 32 or asked.width % 16:
        raise ValueError(f"--width is {asked.width}, but must be a multiple of 16, at least 32")
    start = None if asked.start is None else Detector.load(asked.start)
    classes = CLASSES if start is None else start.classes
    canvas = (3 * asked.width // 4, asked.width) if start is None else start.canvas
    names = _names(asked.name)
    pictures = joined([load(file, asked.images, classes, renamed=names, canvas=canvas) for file in asked.annotations])
    if asked.pictures is not None:
        pictures = pictures.first(asked.pictures)
    with terminal.progress("training") as tell:

        def progress(share: float, detail: str) -> None:
            tell("training", share, detail)

        made = train(
            pictures, steps=asked.steps, batch=asked.batch, wide=asked.wide, seed=asked.seed, start=start,
            device=asked.device, progress=progress,
        )  # fmt: skip
    made.save(asked.out, {"pictures": len(pictures), "steps": asked.steps, "seed": asked.seed})
    print(f"wrote {asked.out}: it learnt from {len(pictures)} pictures")


def _score(asked: argparse.Namespace) -> None:
    from studies.log_detection.drawing import sheet

    detector = Detector.load(asked.detector)
    pictures = load(
        asked.annotations, asked.images, detector.classes, renamed=_names(asked.name), canvas=detector.canvas
    )
    result = score(detector, pictures)
    print(f"{result['pictures']} pictures; AP50 with its interval of 95 % over forests")
    for name, value in result["ap50"].items():
        boxes = f", {result['boxes'][name]} boxes" if name in result["boxes"] else ""
        print(
            f"  {name:10}" + (" none there" if value is None else " {:.3f} ({:.3f} to {:.3f})".format(*value)) + boxes
        )
    if asked.json is not None:
        write_json(asked.json, result)
    if asked.told is not None:
        asked.told.write_text(json.dumps(told(detector, pictures)) + "\n", encoding="utf-8")
    if asked.sheet is not None:
        chosen = range(0, len(pictures), max(len(pictures) // 6, 1))[:6]
        with written_whole(asked.sheet) as temporary:
            sheet(pictures, detect(detector, pictures.pixels), chosen).save(temporary, format="PNG")


def _names(given: Sequence[str]) -> dict[str, str]:
    """``log=Timber`` as a name in a file by that of a class."""
    for one in given:
        if "=" not in one or one.partition("=")[0] not in CLASSES:
            raise ValueError(f"--name is '{one}', but must be CLASS=NAME with one of: {', '.join(CLASSES)}")
    return dict(one.split("=", 1) for one in given)


def _data(asked: argparse.Namespace) -> Path:
    """Folder of the pictures, by default one a scale."""
    return asked.data or Path("log_detection" if asked.scale == "cpu" else f"log_detection_{asked.scale}")


def _results(asked: argparse.Namespace) -> Path:
    """Folder of the scores, by default one a scale."""
    return asked.results or (RESULTS if asked.scale == "cpu" else RESULTS / asked.scale)


def _pictures(asked: argparse.Namespace) -> None:
    from studies.log_detection.making import make_all

    make_all(_data(asked), SCALES[asked.scale], device=asked.device, processes=asked.processes)


def _study(asked: argparse.Namespace) -> None:
    from studies.log_detection.study import run

    run(_data(asked), _results(asked), SCALES[asked.scale], seeds=asked.seeds, device=asked.device)


def _figures(asked: argparse.Namespace) -> None:
    from studies.log_detection.figures import draw

    draw(_data(asked), _results(asked), asked.out, SCALES[asked.scale])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m studies.log_detection",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, what: Callable[[argparse.Namespace], None], text: str) -> Any:
        made = commands.add_parser(name, help=text, description=text)
        made.add_argument("--quiet", action="store_true", help="no progress")
        made.set_defaults(what=what)
        return made

    training = command(
        "train", _train, "train a detector on pictures of COCO files, from random weights or from a detector"
    )
    training.add_argument("annotations", type=Path, nargs="+", metavar="FILE.json", help="COCO files")
    training.add_argument("--out", type=Path, required=True, metavar="FILE", help="detector to write, .safetensors")
    training.add_argument("--steps", type=int, default=1000, help="batches; default: 1000")
    training.add_argument("--batch", type=int, default=BATCH, metavar="N", help=f"pictures of one; default: {BATCH}")
    training.add_argument(
        "--width", type=int, default=CANVAS[1], metavar="PIXELS",
        help=f"that pictures are shrunk to, with 3 to 4 of height; without --start; default: {CANVAS[1]}",
    )  # fmt: skip
    training.add_argument(
        "--wide", type=int, default=1, metavar="N", help="times as many channels; without --start; default: 1"
    )
    training.add_argument("--pictures", type=int, metavar="N", help="only the first N pictures")
    training.add_argument(
        "--start", type=Path, metavar="FILE", help="a detector to go on from, to tune it to other pictures"
    )
    training.add_argument("--seed", type=int, default=0)
    scoring = command("score", _score, "score a detector on pictures of a COCO file, made or photographed")
    scoring.add_argument("detector", type=Path, metavar="FILE", help="of `train`")
    scoring.add_argument("annotations", type=Path, metavar="FILE.json", help="COCO file")
    scoring.add_argument("--json", type=Path, metavar="FILE", help="write the scores there")
    scoring.add_argument("--told", type=Path, metavar="FILE", help="write the boxes there, as COCO's results")
    scoring.add_argument(
        "--sheet", type=Path, metavar="FILE", help="draw six pictures, above truth, below what is told; .png"
    )
    for made in (training, scoring):
        made.add_argument(
            "--images", type=Path, required=True, metavar="FOLDER", help="that the names in the file are in"
        )
        made.add_argument(
            "--name", action="append", default=[], metavar="CLASS=NAME",
            help=f"the file's name of one of {', '.join(CLASSES)}, where it differs; repeatable",
        )  # fmt: skip
    study = command("study", _study, "all trainings of the study that are not there yet")
    study.add_argument("--seeds", type=int, default=1, help="trainings of each kind; default: 1")
    figures = command("figures", _figures, "figures of the study")
    figures.add_argument(
        "--out", type=Path, default=Path("docs/pictures"), metavar="FOLDER", help="default: docs/pictures"
    )
    making = command("pictures", _pictures, "all pictures of the study that are not there yet")
    making.add_argument("--processes", type=int, default=1, metavar="N", help="that take pictures at once; default: 1")
    for made in (making, study, training):
        made.add_argument("--device", default="cpu", help="cpu or cuda:0; default: cpu")
    for made in (making, study, figures):
        made.add_argument("--data", type=Path, metavar="FOLDER", help="of the pictures; default: log_detection")
        made.add_argument(
            "--scale",
            choices=sorted(SCALES),
            default="cpu",
            help="how large the study is; default: cpu, hours of two cores",
        )
    for made in (study, figures):
        made.add_argument("--results", type=Path, metavar="FOLDER", help="of the scores; default: in studies")
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Exit status of a command: 0, 2 for wrong input, 130 for Ctrl-C."""
    asked = _parser().parse_args(words)
    terminal.set_quiet(asked.quiet)
    try:
        asked.what(asked)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
