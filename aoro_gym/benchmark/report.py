"""A benchmark as tables."""

from __future__ import annotations

from typing import Any

from aoro_gym.benchmark.peers import valid_runs
from aoro_gym.execution.device_names import on_cpu
from aoro_gym.reporting.terminal import Comparison


def tables(result: dict[str, Any]) -> list[Comparison]:
    """Tables of the benchmark ``result``: cases, then what there is of peers, ratios and start-up."""
    cases = _case_table(result["machine"], result["cases"])
    shown = [cases]
    if result["peers"] or result.get("skipped"):
        shown.append(_peer_table(result["peers"], result.get("skipped", {})))
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


def _case_table(on: dict[str, Any], rows: list[dict[str, Any]]) -> Comparison:
    """``rows`` of twins, environments and trainings on the computer ``on``."""
    grounds = {row["ground"] + ", machines of their own" * row["randomised"] for row in rows}
    title = f"{on['device']}, {on['cores']} cores; {', '.join(sorted(grounds))}"
    cases = _table(title, ("what", *_RATES, *_SHARES, "bytes a twin"))
    for row in rows:
        what = f"{row['twins']:,} x {row['what']}" + (f", {row['trainer']}" if "trainer" in row else "")
        factor, share = row["real_time_factor"], row.get("share_of_ceiling")
        cases.add(
            what + _threads(row),
            *_rates(row),
            "" if share is None else f"{100.0 * share:.3g} %",
            f"{factor:.3g}",
            f"{factor * row['twins']:,.0f}",
            _count(row.get("memory", {}).get("bytes_per_twin")),
        )
    steps = {row["what"]: row["main_step_s" if row["what"] == "twin" else "control_step_s"] for row in rows}
    cases.note = "a step is " + ", ".join(f"{1e3 * step:g} ms of {what}" for what, step in steps.items())
    if any("steps_per_core_s" in row for row in rows):
        cases.note += "; steps of a core are those in a second of its own time, whatever else it does meanwhile"
    own = next((row for row in rows if "share_of_ceiling" in row), None)
    if own is not None:
        per_s, whose = on["ceiling"], "a core" if on_cpu(own["device"]) else "the device"
        cases.note += (
            f"\nceiling of {whose}: {per_s['operations_per_s']:.3g} scalar operations and {per_s['bytes_per_s']:.3g} bytes "
            f"a second, of which a step of a twin takes {own['operations_per_step']:,} and {own['bytes_per_step']:,.0f}"
        )
    return cases


def _peer_table(rows: list[dict[str, Any]], skipped: dict[str, str]) -> Comparison:
    """``rows`` of peers, and those that were ``skipped`` with the reason."""
    peers = _table("The same vehicle without hydraulics, in steps of 1 ms", ("peer", *_RATES, "sound"))
    good = valid_runs(rows)
    for row in rows:
        verdict = "yes" if row in good else ", ".join([*row["dropped"], f"{row['finite']} finite"])
        name = f"{row['worlds']:,} x {row['what']} {row['version']}" + (f", {row['solver']}" if "solver" in row else "")
        peers.add(name + _threads(row), *_rates(row), verdict)
    peers.note = "; ".join(f"{name} is {reason}" for name, reason in skipped.items())
    return peers


def guard_table(result: dict[str, Any]) -> Comparison:
    """What :func:`aoro_gym.benchmark.guards.check` found."""
    on = result["machine"]
    table = _table(f"{on['device']}, {on['cores']} cores", ("rate over rate", "ratio", "at least", ""))
    for row in result["guards"]:
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.3g}"
        table.add(row["name"], ratio, f"{row['least']:.3g}", "passes" if row["passes"] else "fails")
    failed = [f"{row['name']}: {row['error']}" for row in result["guards"] if "error" in row]
    left_out = [f"left out: {row['name']}, which takes {row['lacks']}" for row in result["left_out"]]
    table.note = "\n".join([*failed, *left_out])
    return table


_SHARES = ("share of ceiling", "x real time, each", "x real time, all")
_RATES = ("steps/s (median)", "slowest", "fastest", "of a core")


def _rates(row: dict[str, Any]) -> list[str]:
    return [_count(row.get(name)) for name in ("steps_per_s", "min", "max", "steps_per_core_s")]


def _threads(row: dict[str, Any]) -> str:
    number = row.get("threads")
    return "" if number is None else f", {number} thread" + "s" * (number > 1)


def _count(value: float | None) -> str:
    return "" if value is None else f"{value:,.0f}"


def _table(title: str, columns: tuple[str, ...]) -> Comparison:
    return Comparison(title, columns, [])
