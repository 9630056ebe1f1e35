"""How many pictures a second a data set takes, and where their time goes.

    python -m studies.dataset_speed
    python -m studies.dataset_speed --device cuda:0 --frames 480 --worlds 24 --processes 12 --json speed.json

Pictures are those of `studies.log_detection`: left ones before logs. Kernels are compiled first. Then one process takes some
pictures step by step, each step by itself: that says where time goes. Launches and copies are counted as all of these are
taken at once: they are the same on any device, a CPU's bands of rows being counted as one. Last a whole data set is made by
as many processes as are asked for: that is the figure.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import warp as wp

from aoro_gym.execution.devices import find
from aoro_gym.execution.files import write_json
from aoro_gym.reporting import terminal
from aoro_gym.sensors.camera import rendering
from aoro_gym.sensors.dataset import DatasetSettings, make
from aoro_gym.sensors.dataset.making import Plan
from aoro_gym.sensors.dataset.sites import Site
from aoro_gym.sensors.dataset.taking import Taken, Wanted, finish, set_up, take

STEPS = ("forest", "place and light", "rendering", "labels and files", "own file")


class Watch:
    """Times of steps, on the clock and of the process's cores."""

    def __init__(self) -> None:
        self.wall = defaultdict[str, float](float)
        self.cores = defaultdict[str, float](float)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time what is done in it."""
        began = time.perf_counter(), time.process_time()
        yield
        self.wall[name] += time.perf_counter() - began[0]
        self.cores[name] += time.process_time() - began[1]


def stepwise(folder: Path, settings: DatasetSettings, device: str, most: int) -> tuple[dict[str, Any], list[Wanted]]:
    """Milliseconds a picture of each step, for the first forest's pictures up to so many; and these."""
    plan, watch = Plan(folder, settings, device=device), Watch()
    numbers = plan.numbers(0)[:most]
    with watch.step("forest"):
        site = Site(settings, 0, None, None, device, len(numbers))
    for first in range(0, len(numbers), plan.together):
        with watch.step("place and light"):
            ready = set_up([Wanted(site, number) for number in numbers[first : first + plan.together]])
        with watch.step("rendering"):
            taken: list[Taken] = take(ready)
        for one in taken:
            with watch.step("labels and files"):
                frame = finish(folder, one)
            with watch.step("own file"):
                write_json(plan.frame_file(one.setup.number), frame)
    share = len(numbers) / len(plan.numbers(0))  # of a forest whose pictures are not all taken
    out = {}
    for name in STEPS:
        part = 1e3 / len(numbers) * (share if name == "forest" else 1.0)
        out[name] = {"ms": round(part * watch.wall[name], 2), "core_ms": round(part * watch.cores[name], 2)}
    return out, [Wanted(site, number) for number in numbers]


def counted(wanted: list[Wanted]) -> dict[str, float]:
    """Launches, copies to the device and copies home, a picture, of pictures that are taken together."""
    count: Counter[str] = Counter()
    launch, numpy, begin = wp.launch, wp.array.numpy, wp.array.__init__

    def launched(*arguments: Any, **named: Any) -> Any:
        count["launches"] += 1
        return launch(*arguments, **named)

    def brought(own: Any, *arguments: Any, **named: Any) -> Any:
        count["copies_home"] += 1
        return numpy(own, *arguments, **named)

    def begun(own: Any, data: Any = None, *arguments: Any, **named: Any) -> None:
        count["copies_to_device"] += data is not None
        begin(own, data, *arguments, **named)

    with (
        mock.patch.object(wp, "launch", launched),
        mock.patch.object(wp.array, "numpy", brought),
        mock.patch.object(wp.array, "__init__", begun),
        mock.patch.object(rendering, "BAND", 100_000),
    ):
        take(set_up(wanted))
    return {"pictures": len(wanted), **{name: round(n / len(wanted), 2) for name, n in sorted(count.items())}}


def measure(asked: argparse.Namespace) -> dict[str, Any]:
    """All three measurements."""
    settings = DatasetSettings(
        frames=asked.frames,
        worlds=asked.worlds,
        size=asked.size,
        width=asked.width,
        samples=1,
        formats=(),
        left_only=True,
        near="log",
    )
    first = DatasetSettings(frames=3, worlds=3, width=32, samples=1, formats=(), left_only=True, size=30.0)
    with tempfile.TemporaryDirectory(prefix="dataset_speed") as name, terminal.progress("measuring") as tell:
        folder = Path(name)
        tell("compiling", 0.0)
        make(folder / "first", first, device=asked.device)
        tell("step by step", 0.02)
        steps, wanted = stepwise(folder / "steps", settings, asked.device, asked.steps)
        launches = counted(wanted)
        began, cores = time.perf_counter(), os.times()
        make(
            folder / "whole", settings, device=asked.device, processes=asked.processes,
            progress=lambda share: tell("a data set", 0.1 + 0.9 * share),
        )  # fmt: skip
        taken, now = time.perf_counter() - began, os.times()
    spent = sum(now[:4]) - sum(cores[:4])
    return {
        "device": find(asked.device).name,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "pictures": asked.frames,
        "forests": asked.worlds,
        "width": asked.width,
        "processes": asked.processes,
        "steps": steps,
        "a_picture": launches,
        "seconds": round(taken, 2),
        "core_seconds": round(spent, 2),
        "pictures_per_s": round(asked.frames / taken, 2),
    }


def _shown(found: dict[str, Any]) -> str:
    lines = [f"{'a picture, one process':24}{'ms':>10}{'core ms':>10}{'pictures/s':>12}"]
    for name, each in found["steps"].items():
        rate = 1e3 / each["ms"] if each["ms"] else float("inf")
        lines.append(f"{name:24}{each['ms']:>10.1f}{each['core_ms']:>10.1f}{rate:>12.1f}")
    counts = ", ".join(
        f"{value:g} {name.replace('_', ' ')}" for name, value in found["a_picture"].items() if name != "pictures"
    )
    lines.append(f"{found['a_picture']['pictures']} pictures together, a picture: {counts}")
    lines.append(
        f"{found['pictures']} pictures of {found['forests']} forests by {found['processes']} processes on {found['device']}:"
        f" {found['seconds']:.1f} s, {found['pictures_per_s']:.2f} pictures/s, {found['core_seconds']:.1f} s of cores"
    )
    return "\n".join(lines)


def main() -> int:
    """Print, or write, the figures."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.dataset_speed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--frames", type=int, default=24, metavar="N", help="pictures of the data set; default: 24")
    parser.add_argument("--worlds", type=int, default=3, metavar="N", help="forests, 3 at least; default: 3")
    parser.add_argument("--steps", type=int, default=20, metavar="N", help="pictures step by step; default: 20")
    parser.add_argument("--size", type=float, default=60.0, metavar="M", help="side of a forest; default: 60")
    parser.add_argument("--width", type=int, default=320, metavar="PIXELS", help="of a picture; default: 320")
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0; default: cpu")
    parser.add_argument("--processes", type=int, default=1, metavar="N", help="of the data set; default: 1")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there, too")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    asked = parser.parse_args()
    terminal.set_quiet(asked.quiet)
    try:
        found = measure(asked)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    print(_shown(found))
    if asked.json is not None:
        write_json(asked.json, found)
    else:
        print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
