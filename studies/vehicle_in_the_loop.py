"""How much delay, jitter and loss a vehicle in the loop bears.

    python -m studies.vehicle_in_the_loop

Bodies and driveline of many machines side by side exchange in lock-step over simulated lines
(:mod:`aoro_gym.cosimulation.laboratory`), each with its own delay; what is drawn is drawn by a seed. A coupling counts as
stable where the torque at each hub swings less at the end than a second before, or by no more than RIPPLE.
Writes ``studies/vehicle_in_the_loop_results/results.json`` and ``docs/pictures/vehicle_in_the_loop.png``.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.cosimulation.laboratory.comparison import HUB_INERTIA, parted
from aoro_gym.cosimulation.laboratory.coupling import Coupling
from aoro_gym.cosimulation.laboratory.delays import DelayLine
from aoro_gym.cosimulation.laboratory.manoeuvres import Manoeuvre
from aoro_gym.machine.parameters import Machine

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "studies" / "vehicle_in_the_loop_results" / "results.json"
PICTURE = ROOT / "docs" / "pictures" / "vehicle_in_the_loop.png"

MAIN_STEP, SUBSTEPS = 5e-4, 15
RIPPLE = 600.0
"""[N m] peak to peak, a choice: 5 % of the parking brake's torque."""
WINDOW, BETWEEN = 0.5, 1.0
"""Length [s] of the two windows in which a swing is measured, and how long the second begins after the first [s]."""
DECAY = 0.9
"""Swing at the end over that before, from which on it is not said to decay, a choice."""
PERIODS = (1, 2, 4, 10)
"""Main steps of a period: 0.5, 1, 2 and 5 ms."""


def _parked(time: float) -> dict[str, float]:
    return {"drive_signal": 0.5 if time < 1.0 else 0.0, "parking_brake": float(time > 1.3)}


def _stopped(time: float) -> dict[str, float]:
    return {"drive_signal": 0.5 if time < 1.0 else 0.0}


def _driving(time: float) -> dict[str, float]:
    return {"drive_signal": 0.6}


CASES = {
    "parked": Manoeuvre("standing, parking brake set", 3.5, _parked),
    "stopped": Manoeuvre("standing on the hub's friction", 3.5, _stopped),
    "driving": Manoeuvre("driving steadily", 4.0, _driving),
}
DELAYS = {"parked": 0.012, "stopped": 0.024, "driving": 0.12}
"""Longest round trip [s] that is tried."""


def ripples(
    machine: Machine, case: Manoeuvre, steps: int, lines: Mapping[str, NDArray[Any]], hub_inertia: float = 0.0
) -> NDArray[np.float64]:
    """Peak-to-peak torque [N m] in the window before and in the last one, at the hub where it is largest: (2, N).

    Args:
        machine: The whole machine.
        case: What is driven.
        steps: Main steps of a period.
        lines: ``delay``, ``jitter`` [periods, round trip] and ``loss`` [-, each way], (N,).
        hub_inertia: Behind the cut [kg m²].
    """
    count = len(lines["delay"])
    sides = parted(machine, case, num_machines=count, hub_inertia=hub_inertia, main_step=MAIN_STEP, substeps=SUBSTEPS)
    half = {name: values // 2 for name, values in lines.items() if name != "loss"}
    rest = {name: lines[name] - half[name] for name in half}
    forth = DelayLine(**rest, loss=lines["loss"], num_machines=count, seed=1)
    back = DelayLine(**half, loss=lines["loss"], num_machines=count, seed=2)
    coupling = Coupling(*sides, steps=steps, forth=forth, back=back)
    torques = [
        coupling.exchange(case.commands(number * coupling.period))
        for number in range(round(case.duration / coupling.period))
    ]
    window, between = (round(one / coupling.period) for one in (WINDOW, BETWEEN))
    parts = np.array(torques[-window - between : -between]), np.array(torques[-window:])
    swings = np.array([np.ptp(part.astype(float), axis=0).max(axis=0) for part in parts])
    swings[1, [number for number, _ in coupling.bodies.diverged]] = np.inf
    return swings


def lines_of(delay: Any, jitter: Any = 0, loss: Any = 0.0) -> dict[str, NDArray[Any]]:
    """Broadcast to one shape."""
    values = np.broadcast_arrays(np.asarray(delay), np.asarray(jitter), np.asarray(loss))
    return dict(zip(("delay", "jitter", "loss"), (one.copy() for one in values), strict=True))


def longest_stable(round_trips: NDArray[Any], swings: NDArray[np.float64]) -> float | None:
    """Round trip [s] up to which all are stable, by their ``swings`` (2, N); None if not even the first is."""
    stable = (swings[1] <= DECAY * swings[0]) | (swings[1] <= RIPPLE)
    count = len(stable) if stable.all() else int(np.argmin(stable))
    return float(round_trips[count - 1]) if count else None


def in_ms(seconds: float | None) -> str:
    """For people."""
    return "none" if seconds is None else f"{1e3 * seconds:g} ms"


def edges(machine: Machine) -> list[dict[str, Any]]:
    """Of every case and period: round trips, swings, and the longest stable one."""
    found = []
    for name, case in CASES.items():
        for steps in PERIODS:
            period = steps * MAIN_STEP
            delays = np.unique(np.round(np.linspace(0.0, DELAYS[name] / period, 13)).astype(int))
            swings = ripples(machine, case, steps, lines_of(delays))
            trips = delays * period
            found.append(
                {
                    "case": name,
                    "period_s": period,
                    "round_trip_s": trips.tolist(),
                    "swing_N_m": swings[1].tolist(),
                    "swing_before_N_m": swings[0].tolist(),
                    "longest_stable_s": longest_stable(trips, swings),
                }
            )
            print(f"{name} {1e3 * period:g} ms: {in_ms(found[-1]['longest_stable_s'])}", flush=True)
    return found


def uneven(machine: Machine, steps: int = 1) -> list[dict[str, Any]]:
    """Longest stable mean round trip of the case that bears least, with jitter and with loss, at one period."""
    found, case, period = [], CASES["parked"], steps * MAIN_STEP
    delays = np.arange(0, 13)
    for jitter, loss in ((0, 0.0), (1, 0.0), (2, 0.0), (4, 0.0), (0, 0.02), (0, 0.1), (0, 0.3), (2, 0.1)):
        swings = ripples(machine, case, steps, lines_of(delays, jitter, loss))
        stable = longest_stable(delays * period, swings)
        found.append(
            {"jitter_s": jitter * period, "loss": loss, "longest_stable_s": stable, "swing_N_m": swings[1].tolist()}
        )
        print(f"jitter {1e3 * jitter * period:g} ms loss {loss:g}: {in_ms(stable)}", flush=True)
    return found


def inertias(machine: Machine, steps: int = 2) -> list[dict[str, Any]]:
    """The same with more and more of the wheel's inertia behind the cut."""
    found, delays, period = [], np.arange(0, 7), steps * MAIN_STEP
    for inertia in (0.0, HUB_INERTIA, 10.0, 20.0, 25.0, 35.0):
        swings = ripples(machine, CASES["parked"], steps, lines_of(delays), inertia)
        stable = longest_stable(delays * period, swings)
        found.append({"hub_inertia_kg_m2": inertia, "longest_stable_s": stable, "swing_N_m": swings[1].tolist()})
        print(f"hub inertia {inertia:g}: {in_ms(stable)}", flush=True)
    return found


def stiffnesses(machine: Machine, steps: int = 2) -> list[dict[str, Any]]:
    """The same with brakes of other stiffness: what holds late is negative damping of stiffness times delay, which the
    brake's own damping outweighs up to ``own_damping_s`` = c/k, and the tires' beyond."""
    found, period = [], steps * MAIN_STEP
    delays, key = np.arange(0, 25, 2), "driveline.brake.presliding_stiffness"
    for factor in (0.5, 1.0, 2.0):
        brake = machine.scale({key: factor}, check_ranges=False)
        swings = ripples(brake, CASES["parked"], steps, lines_of(delays))
        own = float(machine.driveline.brake.presliding_damping) / float(brake.driveline.brake.presliding_stiffness)
        stable = longest_stable(delays * period, swings)
        found.append({"stiffness_factor": factor, "own_damping_s": own, "longest_stable_s": stable})
        print(f"stiffness {factor:g}: {in_ms(stable)}, own damping {1e3 * own:g} ms", flush=True)
    return found


def draw(results: Mapping[str, Any], path: Path) -> None:
    """The swings over the round trip, and what jitter, loss and inertia leave of it."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(13.0, 3.6), layout="constrained", sharey=True)
    for axis, (name, case) in zip(axes, CASES.items(), strict=False):
        for one in (one for one in results["edges"] if one["case"] == name):
            swings = np.clip(np.array(one["swing_N_m"], dtype=float), 1.0, 1e5)
            axis.plot(1e3 * np.array(one["round_trip_s"]), swings, ".-", label=f"period {1e3 * one['period_s']:g} ms")
        axis.axhline(RIPPLE, color="k", lw=0.8, ls=":")
        axis.set(title=case.text, xlabel="round trip [ms]", yscale="log")
        axis.grid(alpha=0.3)
    own = next(one["own_damping_s"] for one in results["stiffnesses"] if one["stiffness_factor"] == 1.0)
    axes[0].axvline(1e3 * own, color="C3", ls="--", label="brake's own damping c/k")
    axes[0].set_ylabel("swing of the torque at a hub [N m]")
    axes[0].legend(fontsize=7)
    for one in results["uneven"]:
        label = f"jitter {1e3 * one['jitter_s']:g} ms, loss {100 * one['loss']:g} %"
        swings = np.clip(np.array(one["swing_N_m"], dtype=float), 1.0, 1e5)
        axes[3].plot(1e3 * MAIN_STEP * np.arange(len(swings)), swings, ".-", label=label)
    axes[3].axhline(RIPPLE, color="k", lw=0.8, ls=":")
    axes[3].set(title="parked, period 0.5 ms, uneven", xlabel="least round trip [ms]")
    axes[3].legend(fontsize=6)
    axes[3].grid(alpha=0.3)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    begun, machine = time.monotonic(), Machine.load("aoro")
    results: dict[str, Any] = {
        "machine": platform.machine(),
        "ripple_N_m": RIPPLE,
        "edges": edges(machine),
        "uneven": uneven(machine),
        "inertias": inertias(machine),
        "stiffnesses": stiffnesses(machine),
    }
    results["seconds"] = round(time.monotonic() - begun)
    RESULTS.parent.mkdir(exist_ok=True)
    text = json.dumps(results, indent=1).replace("Infinity", "null")  # of machines that diverged
    RESULTS.write_text(text + "\n")
    draw(results, PICTURE)


if __name__ == "__main__":
    main()
