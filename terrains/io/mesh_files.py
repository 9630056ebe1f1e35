"""Vertices and faces of a mesh file: what it declares is held against what it holds, then trimesh reads it.

trimesh takes what is there of an ASCII file that was cut off, reserves the memory that a header asks for, and takes the
relative indices of OBJ for the last vertices of the file; so files are checked before, and OBJ is read here.
"""

from __future__ import annotations

import itertools
import json
import logging
import re
import struct
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.interrupts import interrupt_deferred
from aoro_gym.terrains.io.check import TerrainError

with interrupt_deferred():  # its imports take Ctrl-C for a library that is missing
    import trimesh

LONGEST_HEADER = 1 << 20
"""Bytes after which the header of a PLY is no header."""
PLY_SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16", "float16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64", "int64", "uint64"), 8),
}
"""Bytes of PLY's types."""
FACE_LISTS = ("vertex_indices", "vertex_index")
LIBRARIES = {".3mf": "lxml", ".dae": "pycollada"}
"""What trimesh needs beside itself."""
PLAINLY = {
    "PLY is unexpected length!": "its faces differ in their number of corners, or more bytes follow than its header"
    " declares; save it as triangles"
}
"""What some of trimesh's errors mean."""
MOST_VERTICES = 50_000_000
"""Vertices of a scene, those of a mesh counted as often as it is placed."""
STL_HEAD, STL_FACET = 84, 50
"""Bytes of a binary STL before its triangles, and of each."""

Array = NDArray[np.float64]
Faces = NDArray[np.int64]


def load_mesh(path: Path) -> tuple[Array, Faces]:
    """Vertices (V, 3) and triangles (F, 3), none for points; ``TerrainError`` in one sentence for what is no whole mesh."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".obj":
            vertices, faces = _read_obj(path)
        else:
            declared = CHECKS[suffix](path) if suffix in CHECKS else (None, None)
            vertices, faces = _read(path)
            _compare(path, declared, len(vertices), len(faces))
    except TerrainError:
        raise
    except (RecursionError, MemoryError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else "larger than the memory"
        raise TerrainError(f"{path}: cannot be read as a mesh: it is {why}; it is broken") from None
    except Exception as error:  # whatever a library finds wrong with a broken file
        text = " ".join(str(error).split()) or type(error).__name__
        if suffix in LIBRARIES and (isinstance(error, ModuleNotFoundError) or "pip install" in text):
            text = f"{LIBRARIES[suffix]} is not installed; save it as .ply"
        text = PLAINLY.get(text, text)
        raise TerrainError(f"{path}: cannot be read as a mesh: {text[:160]}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not len(vertices):
        raise TerrainError(f"{path}: it holds no points")
    faces = faces.reshape(-1, 3)
    beyond = np.flatnonzero(np.any((faces < 0) | (faces >= len(vertices)), axis=1))
    if len(beyond):
        face = faces[beyond[0]]
        raise TerrainError(
            f"{path}: {len(beyond):,} of its {len(faces):,} triangles name a vertex that is not there, the first {face[0]},"
            f" {face[1]}, {face[2]} of {len(vertices):,} (counted from 0); it is cut off or broken"
        )
    return vertices, faces


def _read(path: Path) -> tuple[Array, Faces]:
    """What trimesh makes of the file."""
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # what is wrong is raised here, not printed
    with warnings.catch_warnings(), np.errstate(all="ignore"):  # what is not finite is told apart afterwards
        warnings.filterwarnings("error", category=DeprecationWarning)  # numpy's, of text that is no number
        loaded: Any = trimesh.load(path, process=False, skip_materials=True)
        if isinstance(loaded, trimesh.Scene):
            scene = loaded
            loaded = scene.to_mesh()
            if not len(loaded.faces):  # points only
                loaded = scene.to_geometry()
    vertices = np.array(loaded.vertices, dtype=np.float64)
    return vertices, np.array(getattr(loaded, "faces", np.zeros((0, 3))), dtype=np.int64)


def _compare(path: Path, declared: tuple[int | None, int | None], vertices: int, faces: int) -> None:
    """``TerrainError`` if fewer vertices or faces were read than declared (a polygon becomes several triangles)."""
    for what, wanted, found in (("vertices", declared[0], vertices), ("faces", declared[1], faces)):
        if wanted is not None and found < wanted:
            raise TerrainError(
                f"{path}: its header declares {wanted:,} {what}, but {found:,} can be read; it is broken"
            )


# --- PLY ---


def _check_ply(path: Path) -> tuple[int | None, int | None]:
    """Vertices and faces that the header declares, if the file can hold them."""
    with path.open("rb") as file:
        head = file.read(LONGEST_HEADER)
        end = re.search(rb"^end_header[ \t]*\r?\n", head, re.MULTILINE)
        if not head.startswith(b"ply") or end is None:
            raise TerrainError(f"{path}: it does not begin with the header of a PLY, from 'ply' to 'end_header'")
        lines = head[: end.start()].decode("latin-1").splitlines()
        elements = _ply_elements(path, lines)
        file.seek(end.end())
        left = path.stat().st_size - end.end()
        encoding = next((line.split()[1] for line in lines if line.startswith("format") and len(line.split()) > 1), "")
        if encoding == "ascii":
            _check_ply_text(path, elements, len(lines) + 1, file)
        else:
            least = sum(count * _ply_size(properties) for _, count, properties in elements)
            if least > left:
                raise TerrainError(
                    f"{path}: its header declares {_listed(elements)}, which take at least {least:,} bytes, but {left:,}"
                    " follow; it is cut off or broken"
                )
    counts = {name: count for name, count, _ in elements}
    lists = [p[-1] for name, _, properties in elements if name == "face" for p in properties if p[0] == "list"]
    if counts.get("face") and not set(lists) & set(FACE_LISTS):
        raise TerrainError(
            f"{path}: its faces have no list {' or '.join(FACE_LISTS)}, but {', '.join(lists) or 'none'}; save it anew"
        )
    if counts.get("tristrips"):
        raise TerrainError(
            f"{path}: its surface is kept in strips (tristrips), which are not read; save it as triangles"
        )
    return counts.get("vertex"), counts.get("face")


Element = tuple[str, int, list[list[str]]]


def _ply_elements(path: Path, lines: list[str]) -> list[Element]:
    """Name, number and properties (words after ``property``) of each element."""
    elements: list[Element] = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not re.fullmatch(r"\d{1,18}", words[2]):
                raise TerrainError(f"{path}, line {number}: {line[:60]!r} is no element with its number")
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            types = words[2:4] if words[1:2] == ["list"] else words[1:2]
            if not elements or len(words) != (5 if words[1:2] == ["list"] else 3) or not set(types) <= set(PLY_SIZES):
                raise TerrainError(f"{path}, line {number}: {line[:60]!r} is no property with a type that PLY knows")
            elements[-1][2].append(words[1:])
    if not any(name == "vertex" and count for name, count, _ in elements):
        raise TerrainError(f"{path}: its header declares no vertices; it holds no points")
    return elements


def _ply_size(properties: list[list[str]]) -> int:
    """Least bytes of an element; a face has at least three corners."""
    size = 0
    for words in properties:
        if words[0] == "list":
            size += PLY_SIZES[words[1]] + (3 * PLY_SIZES[words[2]] if words[3] in FACE_LISTS else 0)
        else:
            size += PLY_SIZES[words[0]]
    return size


def _check_ply_text(path: Path, elements: list[Element], line: int, rows: Iterator[bytes]) -> None:
    """``TerrainError`` naming the first row, one an element, that is not there or not whole."""
    for name, count, properties in elements:
        found = 0
        while found < count:
            row = next(rows, None)
            line += 1
            if row is None:
                raise TerrainError(
                    f"{path}: its header declares {_listed(elements)}, but it ends after {found:,} of {count:,} {name}"
                    " rows; it is cut off or broken"
                )
            words = row.split()
            if not words:
                raise TerrainError(f"{path}, line {line}: an empty line among {count:,} {name} rows; it is broken")
            wanted = _ply_words(properties, words)
            if len(words) < wanted:
                raise TerrainError(
                    f"{path}, line {line}: {len(words)} numbers, but a {name} has {wanted}; of {_listed(elements)} that its"
                    f" header declares, the file is whole up to {name} {found:,}; it is cut off or broken"
                )
            found += 1


def _ply_words(properties: list[list[str]], words: list[bytes]) -> int:
    """How many numbers a row has."""
    at = 0
    for kind in properties:
        if kind[0] == "list":
            length = words[at] if at < len(words) else b"0"
            at += int(length) if length.isdigit() and len(length) < 10 else 0
        at += 1
    return at


def _listed(elements: list[Element]) -> str:
    plural = {"vertex": "vertices", "face": "faces"}
    return " and ".join(f"{count:,} {plural.get(name, name)}" for name, count, _ in elements)


# --- OFF, STL, glTF ---


def _check_off(path: Path) -> tuple[int | None, int | None]:
    rows = (row.split(b"#")[0].split() for row in path.read_bytes().splitlines())
    words = [row for row in rows if row]
    if not words or not words[0][0].upper().endswith(b"OFF"):
        raise TerrainError(f"{path}: it does not begin with OFF")
    counts = words[0][1:] if len(words[0]) > 1 else (words[1] if len(words) > 1 else [])
    if len(counts) < 2 or not all(re.fullmatch(rb"\d{1,18}", word) for word in counts[:2]):
        raise TerrainError(f"{path}: its second line gives no number of vertices and of faces")
    vertices, faces = int(counts[0]), int(counts[1])
    rest = words[1:] if len(words[0]) > 1 else words[2:]
    if len(rest) < vertices + faces:
        raise TerrainError(
            f"{path}: its header declares {vertices:,} vertices and {faces:,} faces, but {len(rest):,} lines follow; it is"
            " cut off or broken"
        )
    last = rest[vertices + faces - 1] if faces else []
    if last and not (last[0].isdigit() and len(last) > int(last[0][:6])):
        raise TerrainError(f"{path}: its last face lacks corners; it is cut off or broken")
    return vertices, faces


def _check_stl(path: Path) -> tuple[int | None, int | None]:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(STL_HEAD)
    count = struct.unpack_from("<I", head, 80)[0] if len(head) == STL_HEAD else 0
    if size == STL_HEAD + STL_FACET * count and len(head) == STL_HEAD:
        return 3 * count, count
    if head.lstrip()[:5].lower() != b"solid":
        held = max(0, size - STL_HEAD) // STL_FACET
        raise TerrainError(
            f"{path}: its header declares {count:,} triangles, but it holds {held:,}; it is cut off or broken"
        )
    text = path.read_bytes().lower()
    began, ended, corners = (len(re.findall(rb"(?m)^\s*" + word, text)) for word in (b"facet", b"endfacet", b"vertex"))
    if began != ended or corners != 3 * began or not re.search(rb"\bendsolid\b", text):
        raise TerrainError(
            f"{path}: {began:,} facets begin with {corners:,} vertices, {ended:,} end, and"
            f" {'the solid does' if b'endsolid' in text else 'no endsolid follows'}; it is cut off or broken"
        )
    return 3 * began, began


def _check_gltf(path: Path) -> tuple[int | None, int | None]:
    """Accessors that the buffers can hold, and nodes that are a tree."""
    content = path.read_bytes()
    if path.suffix.lower() == ".glb":
        if content[:4] != b"glTF" or len(content) < 20:
            raise TerrainError(f"{path}: it does not begin as a binary glTF does")
        declared, length = struct.unpack_from("<I", content, 8)[0], struct.unpack_from("<I", content, 12)[0]
        if declared > len(content) or 20 + length > len(content):
            raise TerrainError(
                f"{path}: its header declares {max(declared, 20 + length):,} bytes, but it holds {len(content):,}; it is"
                " cut off or broken"
            )
        content = content[20 : 20 + length]
    tree = json.loads(content)
    try:
        _check_gltf_tree(path, tree)
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise TerrainError(f"{path}: its JSON is no glTF ({type(error).__name__}: {error})") from None
    return None, None


def _check_gltf_tree(path: Path, tree: Any) -> None:
    files = [
        path,
        *(path.parent / b["uri"] for b in tree.get("buffers", []) if not b.get("uri", "data:").startswith("data:")),
    ]
    held = sum(file.stat().st_size for file in files if file.is_file())
    for number, accessor in enumerate(tree.get("accessors", [])):
        if not 0 <= accessor["count"] <= held:
            raise TerrainError(
                f"{path}: its accessor {number} declares {accessor['count']:.12g} items, but there are {held:,} bytes; it is"
                " broken"
            )
    counts = [
        sum(tree["accessors"][part["attributes"]["POSITION"]]["count"] for part in mesh["primitives"])
        for mesh in tree.get("meshes", [])
    ]
    total = sum(counts[node["mesh"]] for node in tree.get("nodes", []) if "mesh" in node)
    if total > MOST_VERTICES:
        raise TerrainError(
            f"{path}: its scene shows {total:,} vertices, some many times, more than {MOST_VERTICES:,}; split it"
        )
    packed = [name for name in tree.get("extensionsRequired", []) if re.search("draco|meshopt|quantization", name)]
    if packed:
        raise TerrainError(f"{path}: its mesh is compressed ({packed[0]}), which is not read; save it without")
    _check_tree(path, tree.get("nodes", []))


def _check_tree(path: Path, nodes: list[dict[str, Any]]) -> None:
    """``TerrainError`` if a node of a scene has two parents, or is its own ancestor."""
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if not 0 <= child < len(nodes) or child in parents:
                raise TerrainError(f"{path}: node {child} of its scene has two parents, or is not there; it is broken")
            parents[child] = number
    for number in range(len(nodes)):
        at, steps = number, 0
        while at in parents:
            at, steps = parents[at], steps + 1
            if steps > 1000:
                raise TerrainError(
                    f"{path}: its scene is nested more than 1,000 nodes deep, or in a circle; it is broken"
                )


CHECKS: dict[str, Callable[[Path], tuple[int | None, int | None]]] = {
    ".ply": _check_ply,
    ".off": _check_off,
    ".stl": _check_stl,
    ".glb": _check_gltf,
    ".gltf": _check_gltf,
}

# --- OBJ ---


def _read_obj(path: Path) -> tuple[Array, Faces]:
    """Vertices and triangles of Wavefront OBJ; a polygon becomes a fan. Texture, normals and materials are left alone."""
    places: list[list[float]] = []
    faces: list[list[int]] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in _logical_lines(file):
            kind, _, rest = line.partition(" ")
            if kind == "v":
                places.append(_vertex(path, number, rest))
            elif kind == "f":
                faces += _triangle_fan(path, number, rest, len(places))
    vertices = np.array(places, dtype=np.float64).reshape(-1, 3)
    return vertices, np.array(faces, dtype=np.int64).reshape(-1, 3)


def _logical_lines(file: Iterator[str]) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, without comments; a backslash at the end of a line joins the next."""
    held = ""
    for number, line in enumerate(itertools.chain(file, [""]), start=1):
        line = held + line.split("#")[0].strip().replace("\t", " ")
        if line.endswith("\\") and len(line) < 100_000:
            held = line[:-1] + " "
            continue
        held = ""
        if line:
            yield number, line


def _vertex(path: Path, number: int, rest: str) -> list[float]:
    words = rest.split()[:3]
    try:
        place = [float(word) for word in words if "_" not in word]
    except ValueError:
        place = []
    if len(place) != 3:
        raise TerrainError(
            f"{path}, line {number}: 'v {rest[:60]}' is no vertex of three numbers; it is cut off or broken"
        )
    return place


def _triangle_fan(path: Path, number: int, rest: str, count: int) -> list[list[int]]:
    """Triangles of a face's corners, which count from 1, or back from the last vertex if negative."""
    corners = []
    for word in rest.split():
        index = word.split("/")[0]
        if not re.fullmatch(r"-?\d{1,12}", index) or int(index) == 0:
            raise TerrainError(f"{path}, line {number}: corner {word[:40]!r} of a face is no number of a vertex")
        corners.append(int(index) - 1 if int(index) > 0 else count + int(index))
    if len(corners) < 3:
        raise TerrainError(f"{path}, line {number}: a face of {len(corners)} corners; it is cut off or broken")
    return [[corners[0], a, b] for a, b in itertools.pairwise(corners[1:])]
