"""How many steps a second twins take on soil, and with logs in their bunks, beside empty ones on hard ground:
``python -m studies.soil_and_load_speed OUT.json``.

All take turns, so that a busy machine slows all alike; medians of ``--repeats`` turns. The twins drive apart, each with
another steering signal, so that every one presses ruts of its own.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from aoro_gym import Machine, Twin

TWIN_STEPS = 20_000
"""Steps of 1 ms of all twins together in a turn, at least 20 of each."""
LOGS = 30.0
"""In the bunk of those that carry some."""


def measured(count: int, soil: str, device: str, repeats: int) -> dict[str, float]:
    """Steps a second of ``count`` twins on hard ground, on a ``soil`` and laden, and ratios of their times to the first."""
    laden = Machine.load("aoro").set({"payload.count": LOGS})
    twins = {
        "hard": Twin(count, device=device),
        "soil": Twin(count, soil=soil, device=device),
        "load": Twin(count, machine=laden, device=device),
    }
    steering = np.linspace(-0.4, 0.4, count) if count > 1 else 0.0
    for twin in twins.values():
        twin.step({"drive_signal": 0.5, "steering_signal": steering}, 0.5)
    duration = 1e-3 * max(TWIN_STEPS // count, 20)
    times: dict[str, list[float]] = {name: [] for name in twins}
    for turn in range(repeats + 1):
        for name, twin in twins.items():
            start = time.perf_counter()
            twin.advance(duration)
            twin.output("speed")  # waits for the device
            if turn:  # the first one warms up
                times[name].append(time.perf_counter() - start)
    steps = count * duration / 1e-3
    medians = {name: float(np.median(values)) for name, values in times.items()}
    rates = {f"{name}_steps_per_s": steps / median for name, median in medians.items()}
    ratios = {f"{name}_ratio": medians[name] / medians["hard"] for name in ("soil", "load")}
    return {"twins": count, **rates, **ratios}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--soil", default="peat")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--twins", type=int, nargs="+", default=[1, 64, 4096])
    parser.add_argument("--repeats", type=int, default=9)
    asked = parser.parse_args()
    rows = []
    for count in asked.twins:
        row = measured(count, asked.soil, asked.device, asked.repeats)
        rows.append(row)
        rates = ", ".join(f"{row[f'{name}_steps_per_s']:.3g}" for name in ("hard", "soil", "load"))
        ratios = " and ".join(f"x {row[f'{name}_ratio']:.2f}" for name in ("soil", "load"))
        print(f"{count:5d} twins hard, on soil, laden: {rates} steps/s, {ratios} as long", flush=True)
        asked.out.write_text(json.dumps({"soil": asked.soil, "device": asked.device, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
