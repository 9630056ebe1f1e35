"""The twin's speed beside the ceilings of the computer it runs on: operations and bytes counted from the code, ceilings
measured by small kernels, the twin timed in the same run.

`python -m studies.roofline --device cuda:0 --json studies/roofline_results/h200.json` measures a computer;
`python -m studies.roofline --write` puts all files of that folder into the tables of `roofline.md`, and the counts
into the file that `aoro-gym bench` reads. A CPU is measured on one core (`taskset -c 0`), with one twin.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import argparse
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from rich.console import Console
from rich.progress import track

from aoro_gym import Machine, Twin
from aoro_gym.benchmark.ceiling import OPERATIONS
from aoro_gym.benchmark.probes import WIDTH, bandwidth, best, full, multiply_add, probe_time
from aoro_gym.simulation.manoeuvres import SimulationDiverged
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.twin.physics.fluid import Oil, fill, free_gas, orifice, pressure, without_gas
from aoro_gym.twin.records import pack
from studies import terrain_speed
from studies.counting import CLASSES, FLOATING, Cost, Tally, cost
from tests.twin.landscapes import MIDDLE, rough

FOLDER = Path(__file__).parent
REPORT = FOLDER / "roofline.md"
RESULTS = FOLDER / "roofline_results"

INSTANTS = (0.3, 0.5, 0.7, 0.9, 1.1)
"""Times [s] into a drive over rough ground, turning left at full signal, at which a main step is counted."""
LAUNCH = 20
"""Main steps a launch, over which what a launch moves is shared."""


# ---- what the probes do ---------------------------------------------------------------------------------------------


@wp.struct
class Probe:
    """Opaque operands of all probes."""

    a: float
    b: float
    oil: Oil
    coefficient: float  # [m³/s/√Pa]
    supply: float  # [Pa]
    volume: float  # [m³]
    compliance: float  # [m³/Pa]
    dt: float  # [s]


@wp.func
def maximum(x: float, p: Probe):
    return wp.max(p.a - x, p.b)


@wp.func
def division(x: float, p: Probe):
    return p.a / x


@wp.func
def root(x: float, p: Probe):
    return wp.sqrt(x)


@wp.func
def exponential(x: float, p: Probe):
    return wp.exp(-x)


@wp.func
def oil_volume(x: float, p: Probe):
    """The laws' own mixture: a volume filled through an orifice, state in units of its supply."""
    oil = without_gas(p.oil)
    content = x * p.supply
    flow = orifice(p.coefficient, p.supply - pressure(oil, content), oil.laminar_pressure)
    return fill(oil, free_gas(oil, content), content, flow, p.dt, p.volume, p.compliance) / p.supply


PROBES = {f.key: f for f in (multiply_add, maximum, division, root, exponential, oil_volume)}


def probe_values(device: Any) -> Any:
    """Operands that keep every chain near 1, with the shipped machine's pump line as the volume."""
    machine: Any = pack(Machine.load("aoro"))[0]
    layout: Any = Probe
    out: Any = np.zeros(1, dtype=layout.numpy_dtype())
    steering = machine["steering"]
    out["a"], out["b"] = 0.999, 0.001
    out["oil"] = machine["oil"]
    out["coefficient"], out["supply"] = steering["pump_cv_bleed"], steering["pump_margin"]
    out["volume"], out["compliance"] = steering["pump_line_volume"], steering["pump_line_compliance"]
    out["dt"] = 1e-3 / 30
    return wp.array(out, dtype=Probe, device=device)


# ---- measure --------------------------------------------------------------------------------------------------------


def ceilings(device: Any) -> dict[str, Any]:
    """Times [s] of one operation: ``latency`` of a chain; ``full`` with all units busy, shared by all chains; ``resident``
    the same with as many threads as twins stay on the device (on a CPU one core has one)."""
    resident = 1 if device.is_cpu else 256 * device.sm_count  # 255 registers leave room for two warps a scheduler
    out: dict[str, Any] = {"resident_twins": resident, "probes": {}}
    operands = probe_values(device)
    for name, operation in track(PROBES.items(), "ceilings", console=Console(stderr=True)):
        times = {"latency": probe_time(operation, operands, 1, resident)}
        for kind, threads in (("resident", resident), ("full", full(device))):
            times[kind] = probe_time(operation, operands, WIDTH, threads) / (threads * WIDTH)
        out["probes"][name] = times
    if device.is_cpu:
        out["simd_multiply_add"] = probe_time(multiply_add, operands, 4 * WIDTH, 1, simd=True) / (4 * WIDTH)
    out["bytes_per_s"] = bandwidth(device)
    return out


# ---- count ----------------------------------------------------------------------------------------------------------


def mean_cost(
    latency: dict[str, float], *, gpu: bool, terrain: Terrain | Plane | None = None, device: str = "cpu"
) -> Cost:
    """Mean cost of a main step over :data:`INSTANTS` of a loaded turn over ``terrain``, by default rough, as a raster; the
    twin turns on ``device``."""
    twin = Twin(terrain=terrain or rough(0, bumps=0.05, hills=0.1), device=device)
    twin.reset(position=(MIDDLE, MIDDLE))
    found = []
    for since, instant in zip((0.0, *INSTANTS), INSTANTS, strict=False):
        twin.step({"steering_signal": 1.0, "drive_signal": 0.5}, duration=instant - since)
        found.append(cost(twin, latency, gpu=gpu))
    if twin.diverged:
        raise RuntimeError(f"the counted simulation diverged ({twin.diverged[0][1]})")

    def mean(counts: Any) -> Counter:
        return Counter({key: n / len(found) for key, n in sum(counts, Counter()).items()})

    return Cost(
        written=mean(one.written for one in found),
        distinct=mean(one.distinct for one in found),
        fused=sum(one.fused for one in found) / len(found),
        step_bytes=mean(one.step_bytes for one in found),
        launch_bytes=mean(one.launch_bytes for one in found),
        chain=sum(one.chain for one in found) / len(found),
    )


def by_class(counts: Counter, part: str | None = None) -> dict[str, float]:
    """Operations of each class, of one part or of all."""
    return {c: sum(n for (p, k), n in counts.items() if k == c and part in (None, p)) for c in CLASSES}


def instructions(counts: Counter, fused: float) -> float:
    """All operations, a multiplication and addition that fuse as one."""
    return sum(counts.values()) - fused


def mixture_instructions(*, gpu: bool) -> float:
    """Instructions of one :func:`oil_volume`, without what stays the same from one to the next."""
    tally = Tally(gpu=gpu)
    probe = tally.leaf(probe_values("cpu").numpy()[0], Probe)
    step = tally.of(oil_volume)
    x = step(tally.number(0.9), probe)
    first, fused = tally.distinct.copy(), tally.fused
    step(x, probe)
    return instructions(tally.distinct - first, tally.fused - fused)


def operations() -> dict[str, Any]:
    """What ``aoro-gym bench`` knows of a main step: by ground the operations of each class that a CPU and CUDA carry out, a
    multiplication that an addition takes up as one ``multiply_add``, and the bytes of a step and of a launch."""
    found: dict[str, Any] = {}
    for ground, terrain in (("plane", Plane()), ("raster", None)):
        cpu, cuda = (mean_cost({}, gpu=gpu, terrain=terrain) for gpu in (False, True))
        moved = {"step": round(sum(cuda.step_bytes.values())), "launch": round(sum(cuda.launch_bytes.values()))}
        found[ground] = {"cpu": executed(cpu), "cuda": executed(cuda), "bytes": moved}
    return found


def executed(count: Cost) -> dict[str, int]:
    """Operations of each class, with the additions that take up a product in a class of their own."""
    fused = round(count.fused)
    classes = {name: round(n) for name, n in by_class(count.distinct).items()}
    return {"multiply_add": fused} | {n: c - fused if n in ("add", "multiply") else c for n, c in classes.items()}


# ---- bounds ---------------------------------------------------------------------------------------------------------


def latencies(limits: dict[str, Any], *, gpu: bool) -> dict[str, float]:
    """Time [s] from operands to result of an operation of each class."""
    times = {name: one["latency"] for name, one in limits["probes"].items()}
    add = times["multiply_add"] * (1.0 if gpu else 0.5)
    return {
        "add": add,
        "multiply": add,
        "compare": times["maximum"] - add,  # of a sum
        "division": times["division"],
        "root": times["root"],
        "transcendental": times["exponential"],
        "integer": add,
        "branch": 0.0,  # foreseen
    }


def bounds(limits: dict[str, Any], count: Cost, *, gpu: bool) -> dict[str, float]:
    """Highest rates [steps/s] that each resource of the computer allows, were it the only one that is short."""
    probes = limits["probes"]
    fused = count.fused if gpu else 0.0
    one = by_class(count.distinct)
    instruction = probes["multiply_add"]["full"] / (1.0 if gpu else 2.0)
    mixture = instructions(count.distinct, fused) / mixture_instructions(gpu=gpu)
    special = {"division": "division", "root": "root", "transcendental": "exponential"}
    moved = sum(count.step_bytes.values()) + sum(count.launch_bytes.values()) / LAUNCH
    return {
        "additions and multiplications": 1.0 / ((one["add"] + one["multiply"] - fused) * instruction),
        "divisions, roots, transcendentals": 1.0 / sum(one[c] * probes[name]["full"] for c, name in special.items()),
        "all instructions at that rate": 1.0 / (instructions(count.distinct, fused) * instruction),
        "the laws' mixture, full": 1.0 / (mixture * probes["oil_volume"]["full"]),
        "the laws' mixture, resident": 1.0 / (mixture * probes["oil_volume"]["resident"]),
        "the laws' mixture, resident, one chain": limits["resident_twins"]
        / (mixture * probes["oil_volume"]["latency"]),
        "longest chain, resident": limits["resident_twins"] / count.chain,
        "memory": limits["bytes_per_s"] / moved,
    }


def drive(
    twins: int, ground: str, device: str, *, steps: int = LAUNCH, substeps: int = 30, upload: bool = False
) -> float:
    """Time [s] of a launch of ``steps`` main steps of twins that steer and drive at random, each its own way; with
    ``upload``, two new commands before each launch.

    Raises:
        SimulationDiverged: a state stopped being finite.
    """
    level = ground == "plane"
    terrain = Plane() if level else terrain_speed.scan()
    twin = Twin(twins, terrain=terrain, ground="raster" if level else ground, substeps=substeps, device=device)
    rng = np.random.default_rng(0)
    twin.reset(
        position=rng.uniform(0.3, 0.7, (twins, 2)) * (terrain_speed.WIDTH, terrain_speed.LENGTH),
        heading=rng.uniform(-np.pi, np.pi, twins),
    )
    schedule = [
        {
            "steering_signal": rng.uniform(-1.0, 1.0, twins).astype(np.float32),
            "drive_signal": rng.uniform(-0.5, 0.5, twins).astype(np.float32),
        }
        for _ in range(16)
    ]
    twin.step(schedule[0], duration=0.5)
    duration = steps * twin.main_step

    def run(turns: int) -> None:
        for turn in range(turns):
            twin.step(schedule[turn % len(schedule)] if upload else None, duration=duration)

    spent = best(run, twin.device)
    if twin.diverged:
        index, reason = twin.diverged[0]
        number = len(twin.diverged)
        raise SimulationDiverged(f"simulation diverged in {number} of {twins} twins (first {index}: {reason})")
    return spent


def spans(twins: int, device: str) -> dict[str, float]:
    """Where a twin's time [s] on a raster goes: one substep, the rest of a main step; and, of all ``twins`` together, a
    launch and the upload of two commands (0 where they are lost in the time of many twins).

    Raises:
        RuntimeError: other work on the computer made differences of times negative.
    """
    short = drive(twins, "raster", device)
    long = drive(twins, "raster", device, steps=5 * LAUNCH)
    fine = drive(twins, "raster", device, steps=5 * LAUNCH, substeps=60)
    step = (long - short) / (4 * LAUNCH * twins)
    substep = (fine - long) / (5 * LAUNCH * 30 * twins)
    rest = step - 30 * substep
    if min(substep, rest) <= 0.0:
        raise RuntimeError(
            f"a substep takes {substep:.3g} s and the rest of a step {rest:.3g} s, but both must be positive: the computer "
            "is too busy with other work, measure again"
        )
    return {
        "substep": substep,
        "rest": rest,
        "launch": max(short - LAUNCH * twins * step, 0.0),
        "upload": max(drive(twins, "raster", device, upload=True) - short, 0.0),
    }


def measure(device: str, name: str, twins: int) -> dict[str, Any]:
    """All of one computer: ceilings, counts, bounds, and the twin on a plane and on a raster."""
    here = wp.get_device(device)
    gpu = here.is_cuda
    limits = ceilings(here)
    count = mean_cost(latencies(limits, gpu=gpu), gpu=gpu, device=str(device))
    timed = {g: LAUNCH * twins / drive(twins, g, device, upload=True) for g in ("plane", "raster")}
    return {
        "name": name,
        "warp": wp.__version__,
        "twins": twins,
        "operations": by_class(count.distinct),
        "fused": count.fused if gpu else 0.0,
        "bytes": {"step": dict(count.step_bytes), "launch": dict(count.launch_bytes)},
        "chain_s": count.chain,
        "ceilings": limits,
        "steps_per_s": timed,
        "spans_s": spans(twins, device),
        "bounds": bounds(limits, count, gpu=gpu),
    }


# ---- report ---------------------------------------------------------------------------------------------------------


def table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] + ["---:"] * (len(head) - 1), *rows])


def count_tables() -> str:
    """Operations by part and class, bytes by array."""
    count = mean_cost({}, gpu=True)
    parts = sorted({p for p, _ in count.distinct}, key=lambda p: -sum(by_class(count.distinct, p).values()))
    rows = []
    for name, part in [*((p, p) for p in parts), ("**all**", None)]:
        one = by_class(count.distinct, part)
        written = sum(by_class(count.written, part).values())
        floating = sum(one[c] for c in FLOATING)
        rows.append([name, *(f"{one[c]:,.0f}" for c in CLASSES), f"{floating:,.0f}", f"{written:,.0f}"])
    out = table(["part", *CLASSES, "floating-point", "all, as written"], rows)
    launch, step = count.launch_bytes, count.step_bytes
    rows = [[f"`{name}`", f"{launch[name]:,.0f}", f"{step[name]:,.0f}"] for name in {**launch, **step}]
    rows.append(["**all**", f"{sum(launch.values()):,.0f}", f"{sum(step.values()):,.0f}"])
    total = sum(by_class(count.distinct).values())
    return (
        f"{out}\n\n{count.fused:,.0f} of the additions can take up a product. The longest chain of dependent operations "
        f"has {count.chain:,.0f} of the {total:,.0f}.\n\n{table(['array', 'bytes a launch', 'bytes a step'], rows)}"
    )


def device_tables(results: list[dict[str, Any]]) -> str:
    """Ceilings, bounds and the twin's speed, one column a computer."""
    names = [one["name"] for one in results]
    rows = []
    for probe in PROBES:
        row = [probe.replace("_", " ")]
        for one in results:
            times = one["ceilings"]["probes"][probe]
            row += [f"{1e9 * times['latency']:.3g}", *(f"{1e-9 / times[k]:.4g}" for k in ("resident", "full"))]
        rows.append(row)
    columns = [f"{n}: {what}" for n in names for what in ("latency [ns]", "resident [1e9/s]", "full [1e9/s]")]
    out = table(["probe", *columns], rows)
    rows = [["stream [GB/s]", *(f"{1e-9 * one['ceilings']['bytes_per_s']:.4g}" for one in results)]]
    simd = [one["ceilings"].get("simd_multiply_add") for one in results]
    rows.append(["multiply and add in SIMD [1e9/s]", *(f"{1e-9 / s:.4g}" if s else "–" for s in simd)])
    out += "\n\n" + table(["", *names], rows)
    alone = [1.0 / (30.0 * one["spans_s"]["substep"] + one["spans_s"]["rest"]) for one in results]
    rows = [["**kernel, on a raster**", *(f"**{rate:.3g}**" for rate in alone)]]
    for ground in ("plane", "raster"):
        rows.append(
            [f"twin on a {ground}, new commands each launch", *(f"{r['steps_per_s'][ground]:.3g}" for r in results)]
        )
    for bound in results[0]["bounds"]:
        shares = zip((one["bounds"][bound] for one in results), alone, strict=True)
        rows.append([bound, *(f"{top:.3g} ({100.0 * rate / top:.0f} %)" for top, rate in shares)])
    out += "\n\n" + table(["steps/s (share of the bound that the kernel reaches)", *names], rows)
    rows = []
    for what, span, times in (("30 substeps", "substep", 30.0), ("rest of the step", "rest", 1.0)):
        rows.append([what, *(f"{1e9 * times * one['spans_s'][span]:.4g}" for one in results)])
    for what, span in (("launch", "launch"), ("upload of two commands", "upload")):
        share = [1e9 * one["spans_s"][span] / (LAUNCH * one["twins"]) for one in results]
        rows.append([f"{what}, each {LAUNCH} steps", *(f"{one:.4g}" for one in share)])
    return out + "\n\n" + table(["where a twin's time goes [ns a step]", *names], rows)


def write(results: list[dict[str, Any]]) -> None:
    """Put the tables between their marks in the report."""
    text = REPORT.read_text(encoding="utf-8")
    for mark, tables in (("counts", count_tables()), ("computers", device_tables(results))):
        begin, end = f"<!-- {mark} -->", f"<!-- /{mark} -->"
        if begin not in text or end not in text:
            raise SystemExit(f"{REPORT} has no marks {begin} … {end}; put them where the table shall stand")
        text = re.sub(f"{begin}.*?{end}", lambda _: f"{begin}\n{tables}\n{end}", text, flags=re.DOTALL)  # noqa: B023
    REPORT.write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--name", help="of the computer in the tables; by default the device's")
    parser.add_argument("--twins", type=int, help="timed together; by default 1 on a CPU and 32,768 on a GPU")
    parser.add_argument("--json", type=Path, help="file for the result")
    parser.add_argument("--write", action="store_true", help=f"count again: {REPORT.name} and {OPERATIONS.name}")
    asked = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    if asked.write:
        files = sorted(RESULTS.glob("*.json"))
        if not files:
            raise SystemExit(f"{RESULTS} holds no result; measure one: --json {RESULTS.name}/NAME.json")
        write([json.loads(file.read_text(encoding="utf-8")) for file in files])
        OPERATIONS.write_text(json.dumps(operations(), indent=2) + "\n", encoding="utf-8")
        return
    device = wp.get_device(asked.device)
    twins = asked.twins or (1 if device.is_cpu else 32_768)
    result = measure(asked.device, asked.name or device.name, twins)
    text = json.dumps(result, indent=2, ensure_ascii=False)
    if asked.json:
        asked.json.parent.mkdir(parents=True, exist_ok=True)
        asked.json.write_text(text + "\n", encoding="utf-8")
    print(device_tables([result]))


if __name__ == "__main__":
    main()
