"""The laws of soft ground beside published measurements of wheels: ``python -m studies.published_soil OUT.json``; the
picture stands beside it.

What was measured stands in ``published_soil.toml`` with its sources. Wheels are those of the measurements, soils by the
parameters that are published with them; nothing is fitted. The laws are those that twins have
(:mod:`aoro_gym.twin.physics.soil`), on the same device code, for one wheel that rolls on at a slip.
"""

# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false, reportCallIssue=false
import argparse
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from scipy.optimize import brentq

from aoro_gym.reporting.style import BLUE, INK, PLOT_STYLE, RED, SOFT
from aoro_gym.terrains.soil import Soil, preset_table
from aoro_gym.twin.physics.soil import Patch, Reaction, half_chord, pass_sinkage_factor, recall, wheel_reaction
from aoro_gym.twin.physics.soil import Soil as DeviceSoil
from aoro_gym.twin.soil_ruts import device_records

PUBLISHED = Path(__file__).with_suffix(".toml")
RIGID = 1e9
"""Stiffness [N/m] of a wheel that is no tire."""
HALVINGS = wp.constant(40)
PASSES = 10
TIRE = (0.6258, 0.53, 24.5e3, 3.44e5)
"""Radius and width [m] of the tire of ``aoro_least_squares``, its load [N] and stiffness [N/m]: the presets' pass exponents
are of it."""
SOILS = ("sand", "sandy_loam", "sandy_loam:0.26", "peat", "clay:0.4", "loam", "moraine")
"""Soils of passes."""


@wp.struct
class RollingRut:
    """Soil that bore ``ahead`` [m] before a wheel comes; behind its axle it bore what the wheel presses. The wheel is the
    last of some ``passes``."""

    ahead: float
    behind: float
    passes: int


@wp.func
def recall(memory: RollingRut, s: DeviceSoil, twin: int, x: float, y: float):  # noqa: F811 (an overload)
    return wp.where(x < 0.0, memory.behind, memory.ahead), pass_sinkage_factor(s, memory.passes)


@wp.kernel(enable_backward=False)
def roll(soils: wp.array(dtype=DeviceSoil), wheels: wp.array(dtype=wp.vec4), ahead: wp.array(dtype=float),
         slip: wp.array(dtype=float), passes: int, sinkage: wp.array(dtype=float),
         out: wp.array(dtype=Reaction)):  # fmt: skip
    """A wheel (radius, width [m], load [N], stiffness [N/m]) that rolls in a rut at a slip: sinkage [m], by halving, and
    what the soil does to it."""
    i = wp.tid()
    wheel = wheels[i]
    w = Patch()
    w.radius = wheel[0]
    w.width = wheel[1]
    w.roll = 1.0
    w.east = 1.0
    low = float(0.0)  # noqa: UP018 (it changes in a loop)
    high = 0.9 * wheel[0]
    memory = RollingRut()
    memory.ahead = ahead[i]
    memory.passes = passes
    r = Reaction()
    halvings = int(HALVINGS)
    for _ in range(halvings):
        w.sinkage = 0.5 * (low + high)
        w.depth = wp.min(w.sinkage + wheel[2] / wheel[3], wheel[0])
        w.shear = slip[i] * (half_chord(w.radius, w.depth - w.sinkage) + half_chord(w.radius, w.depth))
        memory.behind = wp.max(w.sinkage, ahead[i])
        r = wheel_reaction(soils[i], memory, 0, w)
        if r.load < wheel[2]:
            low = w.sinkage
        else:
            high = w.sinkage
    sinkage[i] = 0.5 * (low + high)
    out[i] = r


def rolled(
    soils: list[Soil], wheel: tuple[float, float, float, float], ahead: Any = 0.0, slip: Any = 0.0, passes: int = 1
) -> tuple[np.ndarray, Any]:
    """Sinkages [m] (N,) and reactions of a wheel in N soils.

    Args:
        soils: N of them.
        wheel: Its radius, width [m], load [N] and stiffness [N/m].
        ahead: Deepest sinkage [m] of the rut that it comes to, one or (N,).
        slip: One or (N,).
        passes: Wheels over the place, with this one.
    """
    n = len(soils)
    records = np.concatenate([device_records(soil) for soil in soils])
    inputs = [
        wp.array(records, dtype=DeviceSoil, device="cpu"),
        wp.array(np.tile(np.array(wheel, np.float32), (n, 1)), dtype=wp.vec4, device="cpu"),
        *(wp.array(np.broadcast_to(np.float32(one), n).copy(), device="cpu") for one in (ahead, slip)),
        passes,
    ]
    sinkage, out = wp.zeros(n, dtype=float, device="cpu"), wp.zeros(n, dtype=Reaction, device="cpu")
    wp.launch(roll, n, inputs, [sinkage, out], device="cpu")
    return sinkage.numpy().astype(float), out.numpy()


def _soil(values: dict[str, Any], **others: Any) -> Soil:
    names = ("k_c", "k_phi", "exponent", "cohesion", "friction_angle_deg")
    return Soil(**({name: values[name] for name in names} | others))


def pull_and_sinkage(published: dict[str, Any]) -> dict[str, Any]:
    """Drawbar pull over load and sinkage at the slips that were measured, without slip sinkage and with it."""
    load, slips = published["load_N"], np.array(published["slip"])
    wheel = (published["radius_m"], published["width_m"], load, RIGID)
    rows: dict[str, Any] = {"slip": slips.tolist(), "measured_pull": [p / load for p in published["pull_N"]]}
    rows["measured_sinkage_m"] = published["sinkage_m"]
    for name, part in (("plain", 0.0), ("slip_sinkage", 1.0)):
        soil = _soil(published, shear_modulus=published["shear_modulus"], slip_sinkage=part)
        z, r = rolled([soil] * len(slips), wheel, slip=slips)
        rows[f"{name}_pull"] = ((r["grip"] - r["resistance"]) / load).tolist()
        rows[f"{name}_sinkage_m"] = z.tolist()
    return rows


def in_snow(published: dict[str, Any]) -> list[dict[str, Any]]:
    """Sinkage and resistance over load of a leading tire by the snow's depth, and resistances of a second and a third."""
    wheel = (published["radius_m"], published["width_m"], published["load_N"], published["stiffness_N_per_m"])
    depths = sorted(set(published["depth_m"]))
    found = []
    for values in published["soils"]:
        soils = [_soil(values, shear_modulus=0.04, layer=depth, a_u=109.6e6) for depth in depths]
        z, r = rolled(soils, wheel)
        trailing, rut = [], z
        for _ in range(2):
            rut, again = rolled(soils, wheel, ahead=rut)
            trailing.append(float((again["resistance"] / published["load_N"]).mean()))
        leading = (r["resistance"] / published["load_N"]).tolist()
        found.append(
            {"soil": values["name"], "depth_m": depths, "sinkage_m": z.tolist(), "resistance": leading}
            | {"trailing": trailing}
        )
    return found


def passes_of(soil: Soil, wheel: tuple[float, float, float, float]) -> list[float]:
    """Sinkage after each of :data:`PASSES` passes over that after the first."""
    sinkages, rut = [], np.zeros(1)
    for n in range(1, PASSES + 1):
        z, _ = rolled([soil], wheel, ahead=rut, passes=n)
        rut = np.maximum(z, rut)
        sinkages.append(float(rut[0]))
    return [z / sinkages[0] for z in sinkages]


def fitted_exponent(soil: Soil, a: float, wheel: tuple[float, float, float, float]) -> float:
    """The ``pass_exponent`` by which :data:`PASSES` wheels sink :data:`PASSES` ** (1/a) times as deep as the first, with
    what a rut deepens by without it; 0 where that is more."""

    def excess(m: float) -> float:
        return passes_of(replace(soil, pass_exponent=m), wheel)[-1] - PASSES ** (1.0 / a)

    return 0.0 if excess(0.0) >= 0.0 else float(brentq(excess, 0.0, 1.0 / a + 0.01, xtol=1e-4))


def pass_exponents() -> dict[str, dict[str, float]]:
    """Of every preset's states that the machine's tire sinks into: forestry's a, the preset's ``pass_exponent``, and that
    which comes of a."""
    found = {}
    for entry in preset_table():
        for state in entry["states"]:
            name = entry["name"] + (f":{state['moisture']:g}" if len(entry["states"]) > 1 else "")
            if "pass_exponent" not in state or name == "clay:0.25":  # which bears the tire without sinking
                continue
            # the wettest sandy loam does not bear the machine's load
            wheel = TIRE if name != "sandy_loam:0.32" else (*TIRE[:2], 7e3, TIRE[3])
            known = {"a": state["a"], "pass_exponent": state["pass_exponent"]}
            found[name] = known | {"fitted": fitted_exponent(Soil.named(name), state["a"], wheel)}
    return found


def compared() -> dict[str, Any]:
    """Everything, for the JSON."""
    published = tomllib.loads(PUBLISHED.read_text(encoding="utf-8"))
    rover = pull_and_sinkage(published["rover_wheel"])
    rigid = (published["rover_wheel"]["radius_m"], published["rover_wheel"]["width_m"], 80.0, RIGID)
    bare = _soil(published["rover_wheel"], shear_modulus=0.011)
    return {
        "rover_wheel": rover,
        "snow": in_snow(published["snow"]),
        "passes": {name: passes_of(Soil.named(name), TIRE) for name in SOILS} | {"rover wheel": passes_of(bare, rigid)},
        "passes_counted": {name: passes_of(Soil.named(f"{name}+passes"), TIRE) for name in SOILS},
        "pass_exponents": pass_exponents(),
        "published": published,
    }


def _errors(result: dict[str, Any]) -> list[str]:
    """Lines that say how far the laws are off."""
    rover, lines = result["rover_wheel"], []
    for name in ("plain", "slip_sinkage"):
        pull = np.array(rover[f"{name}_pull"]) - np.array(rover["measured_pull"])
        sinkage = np.array(rover[f"{name}_sinkage_m"]) / np.array(rover["measured_sinkage_m"])
        lines.append(f"rover wheel, {name}: pull/load {np.round(pull, 3)}, sinkage x {np.round(sinkage, 2)}")
    snow = result["published"]["snow"]
    for one in result["snow"]:
        z = np.interp(snow["depth_m"], one["depth_m"], one["sinkage_m"]) / np.array(snow["sinkage_m"])
        r = np.interp(snow["depth_m"], one["depth_m"], one["resistance"]) / np.array(snow["resistance_coefficient"])
        trailing = np.round(one["trailing"], 4)
        lines.append(f"snow, {one['soil']}: sinkage x {np.median(z):.2f}, resistance x {np.median(r):.2f}, {trailing}")
    for name, values in result["passes"].items():
        counted = np.round(result["passes_counted"].get(name, []), 3)
        lines.append(f"passes, {name}: {np.round(values, 3)}, counted {counted}")
    for name, of in result["pass_exponents"].items():
        lines.append(f"pass_exponent, {name}: a {of['a']}, preset {of['pass_exponent']}, fitted {of['fitted']:.3f}")
    return lines


def draw(result: dict[str, Any], path: Path) -> None:
    """The picture: pull and sinkage against slip, resistance in snow, sinkage against passes."""
    import matplotlib
    from matplotlib.figure import Figure

    rover, snow, published = result["rover_wheel"], result["snow"], result["published"]
    lugs, load = published["rover_wheel_with_lugs"], published["rover_wheel"]["load_N"]
    with matplotlib.rc_context(PLOT_STYLE | {"font.size": 9.0}):
        figure = Figure(figsize=(11.5, 7.2), dpi=120, layout="constrained")
        (pull, sink), (resist, passes) = figure.subplots(2, 2)
        pull.plot(rover["slip"], rover["measured_pull"], "o", color=INK, label="measured, smooth")
        pull.plot(lugs["slip"], [p / load for p in lugs["pull_N"]], "^", color=SOFT, label="measured, with lugs")
        sink.plot(rover["slip"], 1e3 * np.array(rover["measured_sinkage_m"]), "o", color=INK)
        sink.plot(lugs["slip"], 1e3 * np.array(lugs["sinkage_m"]), "^", color=SOFT)
        for name, color, text in (("plain", BLUE, "laws"), ("slip_sinkage", RED, "laws with slip sinkage")):
            pull.plot(rover["slip"], rover[f"{name}_pull"], color=color, label=text)
            sink.plot(rover["slip"], 1e3 * np.array(rover[f"{name}_sinkage_m"]), color=color)
        pull.set(title="Drawbar pull of a rover's wheel", xlabel="slip", ylabel="pull over load")
        sink.set(title="Its sinkage", xlabel="slip", ylabel="sinkage [mm]")
        measured = published["snow"]
        resist.plot(measured["depth_m"], measured["resistance_coefficient"], "o", color=INK, label="measured")
        for one, style in zip(snow, ("-", "--", ":"), strict=True):
            resist.plot(one["depth_m"], one["resistance"], style, color=BLUE, label=one["soil"])
        resist.set(
            title="Resistance of a car's tire in snow", xlabel="depth of the snow [m]", ylabel="resistance over load"
        )
        n = np.arange(1, PASSES + 1)
        for name, shade in (("loose", 0.35), ("medium", 0.25), ("firm", 0.15)):
            low, high = published["passes"][name]
            passes.fill_between(
                n, n ** (1 / high), n ** (1 / low), color=SOFT, alpha=shade, lw=0, label=f"n^(1/a), {name}"
            )
        lines = {"sandy_loam": ("sandy loam", "-"), "peat": ("peat", "--"), "clay:0.4": ("wet clay", ":")}
        for name, (label, style) in lines.items():
            passes.plot(n, result["passes"][name], ls=style, color=BLUE, label=label)
            passes.plot(n, result["passes_counted"][name], ls=style, color=RED, label=f"{label}, passes counted")
        passes.set(title="Sinkage after n wheels over that of the first", xlabel="wheels", ylabel="ratio")
        for axes in (pull, resist, passes):
            axes.legend(frameon=False, fontsize=8)
        figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="JSON to write; the picture has its name with .png")
    out = parser.parse_args().out
    result = compared()
    out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    draw(result, out.with_suffix(".png"))
    print("\n".join([*_errors(result), f"wrote {out} and {out.with_suffix('.png')}"]))


if __name__ == "__main__":
    main()
