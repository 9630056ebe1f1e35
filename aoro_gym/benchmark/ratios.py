"""What a benchmark says at a glance: twins against peers, threads against one, many twins against few."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from aoro_gym.benchmark.peers import WORLDS, valid_runs
from aoro_gym.execution.device_names import on_cpu

SATURATED = 0.9
"""Share of the best rate from which on a device counts as full."""

Rows = Sequence[dict[str, Any]]


def ratios(cases: Rows, peers: Rows) -> dict[str, float]:
    """Ratios of rates in one run, each side at its best batch.

    - ``twin_over_mujoco_per_core_second``: steps a second of processor time, twins and MuJoCo on the CPU;
    - ``twin_over_mujoco_warp``, ``twin_over_newton``: steps a second on the GPU;
    - ``twin_T_threads_over_1_at_N`` (and ``env_...``): steps a second of N twins;
    - ``train_resident_over_sb3_at_N``: environment steps a second that N sub-environments are learned from;
    - ``twin_cost_of_one_at_N_over_M``: time a twin's step takes among N, the most twins, against M, the fewest that fill
      the device; 1 is linear.
    """
    found: dict[str, float] = {}
    own = [case for case in cases if case["what"] == "twin"]
    for peer in WORLDS:
        rate = "steps_per_core_s" if peer == "mujoco" else "steps_per_s"
        theirs = [row[rate] for row in valid_runs(peers) if row["what"] == peer]
        ours = [case[rate] for case in own if on_cpu(case["device"]) == (peer == "mujoco")]
        if ours and theirs:
            found[f"twin_over_{peer}" + "_per_core_second" * (peer == "mujoco")] = max(ours) / max(theirs)
    for what in ("twin", "env"):
        alone = {c["twins"]: c["steps_per_s"] for c in cases if c["what"] == what and c["threads"] == 1}
        for case in cases:
            if case["what"] == what and (case["threads"] or 1) > 1 and case["twins"] in alone:
                name = f"{what}_{case['threads']}_threads_over_1_at_{case['twins']}"
                found[name] = case["steps_per_s"] / alone[case["twins"]]
    learned = {(c["trainer"], c["twins"], c["threads"]): c["steps_per_s"] for c in cases if c["what"] == "train"}
    for (trainer, count, threads), rate in learned.items():
        if trainer != "sb3" and ("sb3", count, threads) in learned:
            name = f"train_{trainer}_over_sb3_at_{count}" + f"_{threads}_threads" * ((threads or 1) > 1)
            found[name] = rate / learned["sb3", count, threads]
    if own:
        threads = max(case["threads"] or 0 for case in own)
        rates = {c["twins"]: c["steps_per_s"] for c in own if (c["threads"] or 0) == threads}
        full = min(count for count, rate in rates.items() if rate >= SATURATED * max(rates.values()))
        most = max(rates)
        if most > full:
            found[f"twin_cost_of_one_at_{most}_over_{full}"] = rates[full] / rates[most]
    return found
