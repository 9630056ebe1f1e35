"""A plan view of the machine that shows which component a cause lies in. The front is on the right; it is not to scale."""

from __future__ import annotations

from collections.abc import Mapping

from markupsafe import Markup

from aoro_gym.diagnosis.words import probability, readable
from aoro_gym.reporting.style import GRID, INK, RED, SHADE, SOFT

LABELLED = 0.02
"""Probability from which a component is labelled."""
WIDTH, HEIGHT = 760, 330

YOKE = f'<path d="M305 165 H415" stroke="{GRID}" stroke-width="12"/>'
"""What the frames reach for the joint with."""
SHAPES: Mapping[str, str] = {
    "mass": '<rect x="80" y="118" width="225" height="94" rx="10"/><rect x="415" y="118" width="225" height="94" rx="10"/>',
    "wheels_and_ground": "".join(
        f'<rect x="{x}" y="{y}" width="92" height="36" rx="9"/>' for x in (112, 516) for y in (50, 244)
    ),
    "driveline": "".join(
        f'<rect x="{x}" y="{y}" width="28" height="20" rx="4"/>' for x in (144, 548) for y in (92, 218)
    ),
    "engine": '<rect x="100" y="138" width="78" height="54" rx="5"/>',
    "pump": '<circle cx="206" cy="165" r="19"/>',
    "oil_and_hoses": '<path d="M225 158 H258 M225 172 H258 M290 152 L322 136 M290 178 L322 194" stroke-width="6"/>',
    "valve": '<rect x="258" y="144" width="32" height="42" rx="4"/>',
    "cylinders": '<path d="M318 134 L412 128 M318 196 L412 202" stroke-width="13"/>',
    "joint": '<circle cx="360" cy="165" r="20"/>',
    "sensor": '<circle cx="360" cy="165" r="7"/>',
}
"""Of every component, from the lowest to the uppermost; lines where a width is given, else areas."""
LABELS: Mapping[str, tuple[tuple[int, int], tuple[int, int], tuple[int, int], str]] = {
    "wheels_and_ground": ((580, 56), (640, 38), (750, 32), "end"),
    "driveline": ((576, 228), (652, 238), (656, 243), "start"),
    "mass": ((600, 150), (700, 112), (750, 106), "end"),
    "engine": ((112, 185), (52, 234), (10, 248), "start"),
    "pump": ((206, 184), (226, 290), (226, 304), "middle"),
    "oil_and_hoses": ((240, 158), (226, 26), (226, 20), "middle"),
    "valve": ((274, 144), (300, 56), (300, 50), "middle"),
    "cylinders": ((385, 202), (400, 238), (400, 252), "middle"),
    "joint": ((346, 179), (318, 268), (318, 282), "middle"),
    "sensor": ((360, 158), (400, 86), (400, 80), "middle"),
}
"""Where a label's line begins and ends, where its text stands, and how it is anchored there."""


def machine_drawing(shares: Mapping[str, float]) -> Markup:
    """SVG of the machine, every component the redder the likelier it holds the cause.

    Args:
        shares: Probability by component; those that are missing have none.
    """
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{_told(shares)}" style="width: 100%; height: auto">',
        f'<g fill="none" stroke="{SOFT}">{YOKE}',
    ]
    for name, shape in SHAPES.items():
        share = min(max(shares.get(name, 0.0), 0.0), 1.0)
        what = "stroke" if "stroke-width" in shape else "fill"
        for colour, opacity in ((SHADE if name == "mass" else GRID, 1.0), (RED, share)):
            parts.append(f'<g class="{name}" {what}="{colour}" {what}-opacity="{opacity:.3f}">{shape}</g>')
    parts.append("</g>")
    parts += [_label(name, shares[name]) for name in LABELS if shares.get(name, 0.0) >= LABELLED]
    parts.append(
        f'<text x="750" y="{HEIGHT / 2 + 4:.0f}" text-anchor="end" font-size="12" fill="{SOFT}">front ▸</text>'
    )
    return Markup("".join([*parts, "</svg>"]))


def _told(shares: Mapping[str, float]) -> str:
    """What the picture says, for those who do not see it."""
    named = sorted((name for name in LABELS if shares.get(name, 0.0) >= LABELLED), key=lambda name: -shares[name])
    return "Machine from above: " + (
        ", ".join(f"{readable(name)} {probability(shares[name])}" for name in named) or "nothing is suspected"
    )


def _label(name: str, share: float) -> str:
    (x, y), (end_x, end_y), (at_x, at_y), anchor = LABELS[name]
    return (
        f'<path d="M{x} {y} L{end_x} {end_y}" stroke="{INK}" stroke-width="0.8"/>'
        f'<text x="{at_x}" y="{at_y}" text-anchor="{anchor}" font-size="13" fill="{INK}">{readable(name)} '
        f'<tspan font-weight="600">{probability(share)}</tspan></text>'
    )
