"""How many steps a second twins take on soil, beside those on hard ground: ``python -m studies.soil_speed OUT.json``.

Both take turns, so that a busy machine slows both; medians of ``--repeats`` turns. The twins drive apart, each with another
steering signal, so that every one presses ruts of its own.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from aoro_gym import Twin

TWIN_STEPS = 20_000
"""Steps of 1 ms of all twins together in a turn, at least 20 of each."""


def measured(count: int, soil: str, device: str, repeats: int) -> dict[str, float]:
    """Steps a second of ``count`` twins on hard ground and on a ``soil``, and the ratio of their times."""
    twins = {"hard": Twin(count, device=device), "soil": Twin(count, soil=soil, device=device)}
    steering = np.linspace(-0.4, 0.4, count) if count > 1 else 0.0
    for twin in twins.values():
        twin.step({"drive_signal": 0.5, "steering_signal": steering}, 0.5)
    duration = 1e-3 * max(TWIN_STEPS // count, 20)
    times: dict[str, list[float]] = {name: [] for name in twins}
    for _ in range(repeats):
        for name, twin in twins.items():
            start = time.perf_counter()
            twin.advance(duration)
            twin.output("speed")  # waits for the device
            times[name].append(time.perf_counter() - start)
    steps = count * duration / 1e-3
    medians = {name: float(np.median(values)) for name, values in times.items()}
    rates = {f"{name}_steps_per_s": steps / median for name, median in medians.items()}
    return {"twins": count, **rates, "ratio": medians["soil"] / medians["hard"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--soil", default="peat")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--twins", type=int, nargs="+", default=[1, 64, 4096])
    parser.add_argument("--repeats", type=int, default=9)
    asked = parser.parse_args()
    rows = [measured(count, asked.soil, asked.device, asked.repeats) for count in asked.twins]
    asked.out.write_text(json.dumps({"soil": asked.soil, "device": asked.device, "rows": rows}, indent=2) + "\n")
    for row in rows:
        rates = f"{row['hard_steps_per_s']:.3g} and {row['soil_steps_per_s']:.3g} steps/s"
        print(f"{row['twins']:5.0f} twins: {rates}, x {row['ratio']:.2f}")


if __name__ == "__main__":
    main()
