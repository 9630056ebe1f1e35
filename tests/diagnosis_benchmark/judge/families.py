"""Plants by hand: a joint that moves at the command's rate, and channels that effects add known shapes to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS, PERIOD
from aoro_gym.diagnosis_benchmark.judge.plants import Log, Path, PlantRun

NOISE = {"joint_angle": 1e-3, "pressure_a": 1e4, "pressure_b": 1e4, "pump_pressure": 1e4}


@dataclass(frozen=True)
class Made:
    """A family whose effects ``one``, ``two`` and ``twin`` (the same as ``two``) add a ramp to the angle, and a step to
    port A; ``law`` bends the ramp."""

    name: str
    law: float = 0.0

    @property
    def effects(self) -> dict[str, tuple[Path, ...]]:
        return {
            "one": (Path((1.0,), 0.004, 0.02), Path((-1.0,), 0.004, 0.02)),
            "two": (Path((1.0,), 1e5, 1e6),),
            "twin": (Path((1.0,), 1e5, 1e6),),
        }

    @property
    def outside(self) -> tuple[str, ...]:
        return ("supply_sag", "bent_rod")

    def machine(self, rng: np.random.Generator) -> Any:
        return {"rate": 0.2 + 0.01 * rng.standard_normal(), "pressure": 2e6}

    def another_day(self, machine: Any, rng: np.random.Generator) -> Any:
        return {
            "rate": machine["rate"] + 1e-3 * rng.standard_normal(),
            "pressure": machine["pressure"] + 2e4 * rng.standard_normal(),
        }

    def magnitude(self, effect: str, machine: Any, size: tuple[float, ...]) -> dict[str, Any]:
        return {"magnitude": list(size), "unit": "1"}

    def record(self, runs: Sequence[PlantRun], *, exact: bool) -> list[Log]:
        logs = []
        for run in runs:
            steering = run.excitation.steering
            turned = PERIOD * np.cumsum(steering)
            size = {name: values[0] for name, values in run.effects.items()}
            angle = run.machine["rate"] * turned + size.get("one", 0.0) * turned * (1.0 + self.law * turned)
            columns = {channel: np.full(len(steering), run.machine["pressure"]) for channel in CHANNELS}
            columns["joint_angle"] = angle + (0.05 * turned if run.outside else 0.0)
            step = size.get("two", 0.0) + size.get("twin", 0.0)
            columns["pressure_a"] = columns["pressure_a"] + step * (turned > 0.0)
            if not exact:
                rng = np.random.default_rng(run.seed)
                columns = {name: v + NOISE[name] * rng.standard_normal(len(v)) for name, v in columns.items()}
            logs.append(columns)
        return logs
