"""Signatures of every effect under every family of laws, and the cosines between families.

``python -m studies.signatures [--shipped] [--families NAME ...] [--out FOLDER]`` (17 minutes on one core).
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from aoro_gym import Machine
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.execution.files import write_text
from aoro_gym.machine.laws import FAMILIES
from aoro_gym.validation.theory.sensitivities import Change, changes
from studies.sensitivities import json_of
from studies.signatures.figure import drawn
from studies.signatures.likeness import CHANNELS, SEEN, between_effects, between_families, cosines, nearest, products
from studies.signatures.responses import DAY, HOLD, NOISE, Responses, responses, typical
from studies.validation import members

FITTED = {"default": "aoro", "materials": "aoro_physical"} | {
    name: name for name in ("library", "valve_maker", "vehicle")
}
"""Machines that come with the package, by family: each was fitted to the published figures with these laws."""
VIEWS = ("whole", "turning", "slow")
"""What is compared: all frames; those from a command up to the first arrival of any machine at a stop; these smoothed."""
SWAY = 15
"""Standard deviation, in samples, of the window that parts a signal's sway, of about 3 Hz, from its slow course."""
ROUNDINGS = 10.0
"""Length of a signature, over that of a change of some roundings, below which single precision blurs it."""


def two_sided(change: Change) -> bool:
    """Whether the effect has both signs."""
    effect = EFFECTS[change.effect]
    one = next(one for one in effect.magnitudes if one.name == change.magnitude)
    return one.low < one.none < one.high


def likeness(
    found: Sequence[Responses], size: str, channels: Sequence[int], view: str, freed: bool
) -> tuple[Floats, Floats]:
    """Cosines (families, E, families, E) and lengths (families, E) of the signatures of a size.

    Args:
        found: Responses of the families.
        size: Name of the size of the changes.
        channels: Numbers of those that are compared.
        view: One of :data:`VIEWS`.
        freed: Whether of what nuisances cannot explain, on the average of the families' covariances.
    """
    frames = np.s_[:] if view == "whole" else np.logical_and.reduce([one.turning for one in found])

    def flat(part: Floats) -> Floats:
        chosen = part[:, list(channels)]
        if view == "slow":
            levels = np.split(chosen, np.cumsum(found[0].frames)[:-1], axis=-1)
            chosen = np.concatenate([gaussian_filter1d(level, SWAY, axis=-1) for level in levels], axis=-1)
        return chosen[..., frames].reshape(len(part), -1)

    signatures = np.concatenate([flat(one.sizes[size]) for one in found])
    nuisances = np.concatenate([flat(one.nuisances) for one in found]) / np.sqrt(len(found)) if freed else None
    gram = products(signatures, nuisances)
    shape = (len(found), len(signatures) // len(found))
    blurred = [ROUNDINGS * float(np.linalg.norm(flat(one.rounding[None]))) for one in found]
    cosine = cosines(gram, np.maximum(SEEN if size == "typical" else 0.0, np.repeat(blurred, shape[1])))
    return cosine.reshape(*shape, *shape), np.sqrt(np.maximum(np.diag(gram), 0.0)).reshape(shape)


def compared(names: Sequence[str], found: Sequence[Responses], wanted: Sequence[Change]) -> dict[str, Any]:
    """Cosines between families by change, size, view, set of channels, with and without nuisances; their medians and
    confusions.

    Args:
        names: Of the families.
        found: Their responses to changes of the sizes ``small`` and ``typical``.
        wanted: The changes.
    """
    either = np.array([two_sided(one) for one in wanted])
    summary, rows = [], []
    for size, view, freed, channels in product(("typical", "small"), VIEWS, (False, True), CHANNELS):
        cosine, length = likeness(found, size, CHANNELS[channels], view, freed)
        own, near = between_families(cosine), nearest(cosine, either)
        of_effect = medians(own)
        head = {"size": size, "view": view, "nuisances_removed": freed, "channels": channels}
        summary.append(head | summarised(own, of_effect, near) | {"median_of_other_effects": between_effects(cosine)})
        if size == "small" and (freed or view != "whole"):
            continue  # the summary says enough
        for at, change in enumerate(wanted):
            others = Counter(wanted[k].name for k in near["other"][:, at] if k >= 0)
            rows.append(
                head
                | {
                    "effect": change.name,
                    "magnitudes": list(typical(change).sizes[0] if size == "typical" else change.sizes[0]),
                    "lengths": length[:, at].tolist(),
                    "cosines": own[at].tolist(),
                    "median": float(of_effect[at]),
                    "families": int(np.sum(near["other"][:, at] > -2)),
                    "confused_with": dict(others.most_common()),
                }
            )
    return {
        "families": list(names),
        "pairs": [f"{one} - {other}" for one, other in combinations(names, 2)],
        "noise": dict(NOISE),
        "hold_s": {f"{100 * level:g} %": list(hold) for level, hold in HOLD.items()},
        "nuisances": DAY,
        "summary": summary,
        "rows": rows,
    }


def summarised(own: Floats, of_effect: Floats, near: Mapping[str, Any]) -> dict[str, Any]:
    """Medians and counts over effects, of cosines (E, pairs) between families, their medians (E,) and what is nearest."""
    seen, right = (values[np.isfinite(values)] for values in (own, near["right"]))
    low, middle, high = np.quantile(seen, (0.25, 0.5, 0.75)) if seen.size else np.full(3, np.nan)
    return {
        "median": float(middle),
        "median_of_effects": float(medians(of_effect[None])[0]),
        "quartiles": [float(low), float(high)],
        "negative": int(np.sum(seen < 0.0)),
        "pairs": int(seen.size),
        "effects_of_families": int(np.sum(near["other"] > -2)),
        "confused": int(np.sum(near["other"] >= 0)),
        "own_is_nearest_of_two_families": float(right.mean()) if right.size else np.nan,
    }


def medians(values: Floats) -> Floats:
    """Medians along the last axis of what is not NaN, NaN where all is."""
    return np.array([np.nanmedian(row) if np.isfinite(row).any() else np.nan for row in values])


def table(result: Mapping[str, Any]) -> str:
    """Markdown: the summary, then a row an effect with the median cosine between families by set of channels."""
    heads = (
        "size",
        "view",
        "nuisances",
        "channels",
        "median cosine",
        "of other effects",
        "quartiles",
        "negative",
        "confused",
        "own is nearest",
    )
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for row in result["summary"]:
        low, high = row["quartiles"]
        cells = (
            row["size"],
            row["view"],
            "removed" if row["nuisances_removed"] else "left in",
            row["channels"],
            f"{row['median']:.2f}",
            f"{row['median_of_other_effects']:.2f}",
            f"{low:.2f} to {high:.2f}",
            f"{row['negative']} of {row['pairs']}",
            f"{row['confused']} of {row['effects_of_families']}",
            f"{100.0 * row['own_is_nearest_of_two_families']:.0f} %",
        )
        lines.append("| " + " | ".join(cells) + " |")
    columns = {channels: ("typical", "whole", False, channels) for channels in CHANNELS} | {
        "all, nuisances removed": ("typical", "whole", True, "all"),
        "all, turning": ("typical", "turning", False, "all"),
        "all, slow": ("typical", "slow", False, "all"),
        "all, small": ("small", "whole", False, "all"),
    }
    by = {(r["size"], r["view"], r["nuisances_removed"], r["channels"], r["effect"]): r for r in result["rows"]}
    heads = ("effect", "size", "length", *columns, "confused with")
    lines += ["", "| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name in dict.fromkeys(row["effect"] for row in result["rows"]):
        whole = by["typical", "whole", False, "all", name]
        cells = [by[(*column, name)]["median"] for column in columns.values()]
        text = " | ".join(f"{value:.2f}" if np.isfinite(value) else "–" for value in cells)
        size = ", ".join(f"{value:.3g}" for value in whole["magnitudes"])
        length = f"{min(whole['lengths']):.0f} to {max(whole['lengths']):.0f}"
        with_whom = ", ".join(f"{other} ({count})" for other, count in whole["confused_with"].items())
        lines.append(f"| {name} | {size} | {length} | {text} | {with_whom} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), help="families of laws, two at least")
    parser.add_argument(
        "--shipped", action="store_true", help="the default machine with each family's laws, not its fit"
    )
    parser.add_argument("--device", default="cpu", help="cpu or cuda:N")
    parser.add_argument("--out", type=Path, default=Path("results/signatures"), help="folder of the results")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    wanted = changes()
    sizes = {"small": wanted, "typical": [typical(change) for change in wanted]}
    machines, found, fitted = [], [], members.machines()
    for name in asked.families:
        machine = Machine.load("aoro").with_laws(name) if asked.shipped else fitted[FITTED[name]]
        machines.append(machine)
        found.append(responses(machine, sizes, device=asked.device))
        print(f"{name}: {len(found[-1].nuisances)} nuisances", flush=True)
    result = {"machines": "shipped" if asked.shipped else "fitted"} | compared(asked.families, found, wanted)
    write_text(asked.out / "signatures.json", json_of(result))
    write_text(asked.out / "signatures.md", table(result))
    drawn(result, machines, found, asked.out / "signatures.png")
    print(table(result).split("\n\n")[0])


if __name__ == "__main__":
    main()
