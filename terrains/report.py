"""Tables of a terrain's report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.markup import escape
from rich.table import Table
from rich.text import Text

from aoro_gym.reporting.terminal import labelled
from aoro_gym.terrains.io.check import Hole, Report

MOST_HOLES = 8
"""Places without ground that are listed; the JSON names all."""


def tables(report: Report) -> Iterator[Table | str]:
    """Properties of the ground, the changes on the way, and warnings."""
    yield _properties(report)
    yield "changed:" if report.changes else labelled("changed", [])
    for change in report.changes:
        yield f"  {escape(change.text)}"
    for warning in report.warnings:
        yield f"[yellow]warning:[/] {escape(warning)}"
    if report.holes:
        yield from _holes(report.holes)


def _properties(report: Report) -> Table:
    table = Table(title=Text(f"Ground of {report.source}"), title_justify="left", header_style="bold")
    table.add_column("what", overflow="fold")
    table.add_column("value", overflow="fold")
    size_x, size_y, size_z = report.extent_m
    spacing = f"one every {report.cell_m:.3g} m" if report.cell_m is not None else "as in the file"
    for name, value in (
        ("read as", f"{report.kind}: {report.points_read:,}"),
        ("units", report.units),
        ("up", report.up),
        ("coordinate system", report.crs or "unknown"),
        ("local origin", "{:.0f}, {:.0f}, {:.0f} m".format(*report.origin_m)),
        ("extent", f"{size_x:.4g} m x {size_y:.4g} m, {size_z:.3g} m high"),
        ("triangles", f"{report.triangles:,} over {report.vertices:,} heights, {spacing}"),
        ("with ground", f"{report.ground_m2:,.0f} m², {report.ground_share:.1%} of the extent"),
        ("slope", f"median {report.slope_median_deg:.1f}°, 95 % below {report.slope_95_deg:.1f}°"),
        ("steepest", f"{report.slope_max_deg:.1f}°"),
        ("drivable (up to 45°)", f"{report.drivable_share:.1%} of the ground"),
        ("roughness", f"{report.roughness_m * 1e3:.0f} mm root mean square, within 2 m"),
    ):
        table.add_row(name, escape(value))
    return table


def _holes(holes: Sequence[Hole]) -> Iterator[str]:
    inside = [hole for hole in holes if not hole.at_edge]
    area = sum(hole.area_m2 for hole in holes)
    plural = "" if len(holes) == 1 else "s"
    count = f"{len(holes)} place{plural} without ground, {len(inside)} of them inside"
    yield f"[yellow]warning:[/] {count}; {area:,.0f} m² in all"
    for hole in holes[:MOST_HOLES]:
        where = f"x {hole.west:.1f} to {hole.east:.1f} m, y {hole.south:.1f} to {hole.north:.1f} m"
        yield f"  {hole.area_m2:,.1f} m² at {where}{' (at the edge)' if hole.at_edge else ''}"
    if len(holes) > MOST_HOLES:
        yield f"  and {len(holes) - MOST_HOLES} smaller ones, in the JSON"
