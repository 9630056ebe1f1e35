"""A benchmark as tables."""

from __future__ import annotations

from typing import Any

from aoro_gym.benchmark.peers import valid_runs
from aoro_gym.reporting.terminal import Comparison


def tables(result: dict[str, Any]) -> list[Comparison]:
    """Tables of the benchmark ``result``: cases, then what there is of peers, ratios and start-up."""
    on = result["machine"]
    cases = _table(
        f"{on['device']}, {on['cores']} cores",
        ("what", "ground", "copies", "threads", *_RATES, *_SHARES, "bytes a twin"),
    )
    own = next((case for case in result["cases"] if "share_of_ceiling" in case), None)
    if own is not None:
        per_s, whose = on["ceiling"], "a core" if own["device"] == "cpu" else "the device"
        cases.note = (
            f"ceiling of {whose}: {per_s['operations_per_s']:.3g} scalar operations and {per_s['bytes_per_s']:.3g} bytes a "
            f"second; a step takes {own['operations_per_step']:,} and {own['bytes_per_step']:,.0f}"
        )
    for case in result["cases"]:
        factor = case["real_time_factor"]
        share = case.get("share_of_ceiling")
        memory = case.get("memory", {}).get("bytes_per_twin")
        cases.add(
            f"{case['what']}, {case['trainer']}" if "trainer" in case else case["what"],
            case["ground"] + ", randomised" * case["randomised"],
            f"{case['twins']}",
            _count(case["threads"]),
            *_rates(case),
            "" if share is None else f"{100.0 * share:.3g} %",
            f"{factor:.3g}",
            f"{factor * case['twins']:,.0f}",
            _count(memory),
        )
    shown = [cases]
    if result["peers"]:
        peers = _table("The same vehicle without hydraulics", ("peer", "worlds", "threads", *_RATES, "sound"))
        good = valid_runs(result["peers"])
        for row in result["peers"]:
            verdict = "yes" if row in good else ", ".join([*row["dropped"], f"{row['finite']} finite"])
            name = f"{row['what']} {row['version']}"
            peers.add(name, f"{row['worlds']}", _count(row.get("threads")), *_rates(row), verdict)
        shown.append(peers)
    if result["ratios"]:
        compared = _table("", ("ratio", ""))
        for name, ratio in result["ratios"].items():
            compared.add(name.replace("_", " "), f"{ratio:.3g}")
        shown.append(compared)
    if "startup" in result:
        startup = _table("Fresh processes", ("start-up", "s"))
        for name, value in result["startup"].items():
            if name.endswith("_s"):
                startup.add(name.removesuffix("_s").replace("_", " "), f"{value:.2f}")
        shown.append(startup)
    return shown


def guard_table(result: dict[str, Any]) -> Comparison:
    """What :func:`aoro_gym.benchmark.guards.check` found."""
    on = result["machine"]
    table = _table(f"{on['device']}, {on['cores']} cores", ("rate over rate", "ratio", "at least", ""))
    for row in result["guards"]:
        table.add(row["name"], f"{row['ratio']:.3g}", f"{row['least']:.3g}", "passes" if row["passes"] else "fails")
    return table


_SHARES = ("share of ceiling", "x real time, each", "x real time, all")
_RATES = ("steps/s (median)", "slowest", "fastest", "a core second")


def _rates(row: dict[str, Any]) -> list[str]:
    return [_count(row.get(name)) for name in ("steps_per_s", "min", "max", "steps_per_core_s")]


def _count(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"


def _table(title: str, columns: tuple[str, ...]) -> Comparison:
    return Comparison(title, columns, [])
