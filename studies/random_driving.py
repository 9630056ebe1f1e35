"""A day of driving at random over rough ground: nothing that is not a number escapes, and every diverged twin is named.

`python -m studies.random_driving` spreads 24 h over 128 twins; `--hours` and `--twins` say otherwise.
"""

import argparse
import json
import time

import numpy as np
import warp as wp

from aoro_gym.twin.twin import Twin
from tests.twin.landscapes import MIDDLE, rough

SIGNALS = ("steering_signal", "drive_signal", "arm_fl", "arm_fr", "arm_rl", "arm_rr")


def day(hours: float, twins: int, ground: str, device: str, seed: int) -> dict:
    """Drive ``hours`` in all; a twin that tips over, leaves the map or diverges starts again."""
    rng = np.random.default_rng(seed)
    terrains = [
        rough(seed + n, bumps=bumps, hills=hills) for n, (bumps, hills) in enumerate(((0.05, 0.1), (0.15, 0.2)))
    ]
    twin = Twin(twins, terrain=terrains, ground=ground, device=device)

    def restart(which: np.ndarray) -> None:
        twin.reset(
            which,
            position=rng.uniform(0.5 * MIDDLE, 1.5 * MIDDLE, (twins, 2)),
            heading=rng.uniform(-np.pi, np.pi, twins),
            joint_angle=rng.uniform(-0.6, 0.6, twins),
            terrain=rng.integers(0, len(terrains), twins),
        )

    restart(np.ones(twins, dtype=bool))
    rounds = round(hours * 3600.0 / twins)
    reasons: dict[str, int] = {}
    tipped, left, fastest = 0, 0, 0.0
    began = time.perf_counter()
    for _ in range(rounds):
        commands = {name: rng.uniform(-1.0, 1.0, twins).astype(np.float32) for name in SIGNALS}
        trace = twin.step({**commands, "gear": rng.integers(1, 4, twins)}, 1.0, sample_every=0.1)
        assert trace is not None
        for _, reason in twin.diverged:
            reasons[reason] = reasons.get(reason, 0) + 1
        running = twin.status == 0
        if not np.isfinite(trace.samples[..., running]).all():
            raise SystemExit("an output is not a number, but its twin runs")
        fastest = max(fastest, float(np.abs(trace["speed"][:, running]).max(initial=0.0)))
        over = np.maximum(np.abs(trace["roll"][-1]), np.abs(trace["pitch"][-1])) > 1.2
        off = trace["wheels_off_map"][-1] > 0.0
        tipped += int((over & running).sum())
        left += int((off & ~over & running).sum())
        again = ~running | over | off
        if again.any():
            restart(again)
    return {
        "hours": rounds * twins / 3600.0,
        "ground": ground,
        "twins": twins,
        "lost": reasons,
        "tipped": tipped,
        "left_the_map": left,
        "fastest_m_per_s": round(fastest, 2),
        "wall_s": round(time.perf_counter() - began, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--twins", type=int, default=128)
    parser.add_argument("--ground", default="raster")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=0)
    wp.config.log_level = wp.LOG_ERROR
    print(json.dumps(day(**vars(parser.parse_args()))))


if __name__ == "__main__":
    main()
