"""Meshes through trimesh: cleaned, told from what hangs over them, and kept as they are if they are one whole surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from aoro_gym.terrains.heights import sample_triangles
from aoro_gym.terrains.io.check import SMALLEST_PIECE, Report, TerrainError
from aoro_gym.terrains.io.cloud_survey import NEIGHBOURS
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import LoadOptions, are_plausible, choose_cell, find_frame
from aoro_gym.terrains.io.mesh_files import load_mesh
from aoro_gym.terrains.io.precision import note_lost_precision
from aoro_gym.terrains.io.read_cloud import PLAN, read_points
from aoro_gym.terrains.io.repair import remove_spikes

Y_UP = (".glb", ".gltf")
"""Formats that fix y as up, and metres."""
CLEARLY, UNCERTAIN = 2.0, 1.1
"""How many times more of the surface faces along an axis that is taken as up, and from which one is named."""
ONE_SIDED = 0.9
"""Share of what faces along an axis that does so with the same side, where all of it is seen from above."""
MERGED = 1e-4
"""Vertices within about this distance [m] are one."""
OVERHANG = 0.3
"""Height [m] of a second surface over the ground from which it is an overhang, not a wrinkle of the scan."""
WRINKLE = 0.01
"""Height [m] between two surfaces that are one."""
NATURAL_CELL = (0.1, 1.0)
"""Finest and coarsest distance [m] at which triangles are sampled unasked."""

Array = NDArray[np.float64]
Faces = NDArray[np.int64]


def read_mesh(path: Path, request: LoadOptions, report: Report) -> ElevationModel:
    """The drivable surface of a mesh file; a file of points only goes the way of a cloud."""
    vertices, faces = load_mesh(path)
    by_rule = path.suffix.lower() in Y_UP
    unit = "m" if by_rule else None
    if not len(faces):
        return read_points(vertices, request, report, unit=unit, rule="y" if by_rule else "z")
    report.kind = "mesh"
    report.points_read = len(vertices)
    vertices, faces = _finite(vertices, faces, report)
    up = request.up or _guess_up(path, vertices, faces, report)
    used = vertices[faces.ravel()]
    edge = float(np.median(np.linalg.norm(np.diff(used.reshape(-1, 3, 3)[:, :2], axis=1), axis=2)))
    frame = find_frame(request, report, used.min(axis=0), used.max(axis=0), spacing=edge, up=up, unit=unit)
    if frame.projection is None:
        plan = np.unique(faces[:NEIGHBOURS])
        axes = ["xyz".index(name) for name in PLAN[up] + up]
        note_lost_precision(vertices[plan][:, axes], edge, frame.scale, report, names=PLAN[up])
    vertices = frame.local(vertices)
    faces = _faces_in_window(vertices, faces, frame.low, frame.high, report)
    vertices, faces = _cleaned(vertices, faces, report)
    vertices, faces = _oriented_upward(vertices, faces, report)
    faces = _without_small_pieces(vertices, faces, report)
    low, high = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
    plan_edges = np.linalg.norm(np.diff(vertices[faces][:, :, :2], axis=1), axis=2)
    natural = float(np.clip(0.5 * np.median(plan_edges), *NATURAL_CELL))
    cell = choose_cell(request, report, low, high, natural)
    heights, highest = sample_triangles(vertices, faces, cell)
    gap = np.nan_to_num(highest - heights.z)
    over = int((gap > OVERHANG).sum())
    wrinkles = int(((gap > WRINKLE) & (gap <= OVERHANG)).sum())
    reasons = [
        text
        for found, text in (
            (over, "something hangs over the ground"),
            (wrinkles, "surfaces lie on each other"),
            (remove_spikes(heights, request.spike_limit)[1], "it has spikes"),
            (_count_inner_boundaries(faces), "it has holes"),
        )
        if found
    ]
    report.change("overhangs_removed", over, f"{over:,} heights under overhangs: the lower surface is the ground")
    report.change(
        "wrinkles", wrinkles, f"{wrinkles:,} heights where surfaces lie on each other: the lower one is taken"
    )
    if not reasons:
        used, numbered = np.unique(faces, return_inverse=True)
        return ElevationModel(heights, frame, (vertices[used], numbered.reshape(-1, 3).astype(np.int32)))
    report.change(
        "resampled",
        heights.z.size,
        f"triangles sampled every {cell:.3g} m to be repaired, because {' and '.join(reasons)}",
    )
    return ElevationModel(heights, frame)


def _finite(vertices: Array, faces: Faces, report: Report) -> tuple[Array, Faces]:
    """Faces whose corners are finite."""
    whole = are_plausible(vertices)
    good = np.asarray(whole[faces].all(axis=1))
    lost = int((~good).sum())
    if lost == len(faces):
        raise TerrainError(f"{report.source}: none of its {len(faces):,} triangles has finite corners; it is broken")
    report.change("broken_triangles", lost, f"{lost:,} triangles with corners that are not finite removed")
    return np.where(whole[:, None], vertices, 0.0), faces[good]


def _guess_up(path: Path, vertices: Array, faces: Faces, report: Report) -> str:
    """The axis along which most of the surface faces; where none stands out, that of the format, with a warning."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    facing = np.abs(normals).sum(axis=0) + 1e-300
    share = dict(zip("xyz", facing / facing.sum(), strict=True))
    sided = dict(zip("xyz", np.abs(normals.sum(axis=0)) / facing, strict=True))
    by_rule = path.suffix.lower() in Y_UP
    rule, other = ("y", "z") if by_rule else ("z", "y")
    rule_text = f"glTF's rule of {rule}" if by_rule else f"the usual {rule}"
    clearly = share[other] > CLEARLY * max(share[axis] for axis in "xyz" if axis != other)
    # Seen along the axis that is up, all of a ground shows one side; across it, as many slopes fall as rise.
    one_sided = share[other] > share[rule] and sided[other] > ONE_SIDED and sided[rule] < 0.5 * ONE_SIDED
    if clearly or one_sided:
        report.up = f"{other} (most of the surface faces along it)"
        text = f"{other} taken as up against {rule_text}: {share[other]:.0%} of the surface faces along {other}"
        report.change("up", 1, f"{text}; up='{rule}' keeps {rule}")
        return other
    best = max(share, key=lambda axis: share[axis])
    if share[best] > share[rule] * UNCERTAIN:
        report.warnings.append(
            f"{rule} is taken as up by {rule_text}, but {share[best]:.0%} of the surface faces along {best} and"
            f" {share[rule]:.0%} along {rule}; up='{best}' says otherwise"
        )
    if by_rule:
        report.up = f"y (of {path.suffix[1:].upper()})"
    return rule


def _faces_in_window(vertices: Array, faces: Faces, low: Array, high: Array, report: Report) -> Faces:
    """Faces whose corners all lie in the window."""
    within = np.all((vertices[:, :2] >= low - MERGED) & (vertices[:, :2] <= high + MERGED), axis=1)
    kept = within[faces].all(axis=1)
    if not kept.any():
        raise TerrainError(f"{report.source}: no triangle lies within the window")
    report.change(
        "outside_triangles", int((~kept).sum()), f"{int((~kept).sum()):,} triangles outside of the window left out"
    )
    return faces[kept]


def _cleaned(vertices: Array, faces: Faces, report: Report) -> tuple[Array, Faces]:
    """One vertex a place, no triangle twice, none without an area."""
    _, first, merged = np.unique(
        np.round(vertices / MERGED).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    vertices, faces = vertices[first], merged.reshape(-1)[faces]
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    flat = area <= MERGED**2
    report.change("degenerate_triangles", int(flat.sum()), f"{int(flat.sum()):,} triangles without an area removed")
    faces = faces[~flat]
    if not len(faces):
        raise TerrainError(f"{report.source}: no triangle has an area; there is no ground in it")
    _, kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    twice = len(faces) - len(kept)
    report.change("duplicate_triangles", twice, f"{twice:,} triangles that were there twice removed")
    return vertices, faces[np.sort(kept)]


def _oriented_upward(vertices: Array, faces: Faces, report: Report) -> tuple[Array, Faces]:
    """All faces counter-clockwise from above; undersides of solids and overhangs removed where the winding tells them."""
    lift = _signed_areas(vertices, faces)
    up, down = lift > 0.0, lift < 0.0
    if not (up.any() or down.any()):
        raise TerrainError(f"{report.source}: all its triangles stand upright; is another axis up (up=...)?")
    if _consistent(faces):
        under = _undersides(vertices, faces, lift)
        text = f"{int(under.sum()):,} triangles of undersides (of solids and of what hangs over the ground) removed"
        report.change("undersides_removed", int(under.sum()), text)
        faces, down = faces[~under], down[~under]
    report.change("flipped_triangles", int(down.sum()), f"{int(down.sum()):,} triangles that faced down were flipped")
    return vertices, np.where(down[:, None], faces[:, ::-1], faces)


def _undersides(vertices: Array, faces: Faces, lift: Array) -> NDArray[np.bool_]:
    """(F,) whether a face of a consistently wound mesh looks down, or up if its piece is inside out."""
    piece = _components(len(vertices), faces)
    count = int(piece.max()) + 1
    middle = vertices[faces].mean(axis=1)[:, 2]
    areas, heights = [], []
    for side in (np.maximum(lift, 0.0), np.maximum(-lift, 0.0)):
        area = np.bincount(piece, weights=side, minlength=count)
        areas.append(area)
        heights.append(np.bincount(piece, weights=side * middle, minlength=count) / np.maximum(area, 1e-30))
    share = areas[1] / np.maximum(areas[0] + areas[1], 1e-30)
    # Of a solid, half looks down, and lies below. Of a sheet, most looks up; if most looks down, it is inside out.
    solid = np.abs(share - 0.5) < 0.1
    inside_out = np.where(solid, heights[1] > heights[0], share > 0.5)
    return np.where(inside_out[piece], lift > 0.0, lift < 0.0) & (np.minimum(*areas)[piece] > 0.0)


def _components(count: int, faces: Faces) -> NDArray[np.int32]:
    """(F,) the number of the piece that each face belongs to; faces with a common vertex hang together."""
    links = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = sparse.coo_matrix((np.ones(len(links), dtype=np.int8), links.T), shape=(count, count))
    return connected_components(graph, directed=False)[1][faces[:, 0]]


def _signed_areas(vertices: Array, faces: Faces) -> Array:
    """(F,) twice the signed area of each face in plan."""
    a, b, c = (vertices[faces[:, i], :2] for i in range(3))
    u, v = b - a, c - a
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _consistent(faces: Faces) -> bool:
    """Whether neighbours run through their common edge in opposite directions, everywhere."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return len(np.unique(directed, axis=0)) == len(directed)


def _without_small_pieces(vertices: Array, faces: Faces, report: Report) -> Faces:
    """Pieces too small to stand on removed; the largest one stays."""
    piece = _components(len(vertices), faces)
    area = np.bincount(piece, weights=0.5 * np.abs(_signed_areas(vertices, faces)))
    gone = (area < min(SMALLEST_PIECE, area.max()))[piece]
    number = len(np.unique(piece[gone]))
    text = f"pieces below {SMALLEST_PIECE:g} m² removed: {number:,} ({int(gone.sum()):,} triangles)"
    report.change("pieces_removed", number, text)
    return faces[~gone]


def _count_inner_boundaries(faces: Faces) -> int:
    """How many places, other than one outline a piece, keep the surface from being whole."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    count = int(faces.max()) + 1

    def groups(links: Any) -> int:
        graph = sparse.coo_matrix((np.ones(len(links), dtype=np.int8), links.T), shape=(count, count))
        return connected_components(graph, directed=False)[0] - (count - len(np.unique(links)))

    rim = edges[uses == 1]
    crossings = int((np.bincount(rim.ravel(), minlength=1) > 2).sum())
    return int((uses > 2).sum()) + crossings + max(groups(rim) - groups(edges), 0)
