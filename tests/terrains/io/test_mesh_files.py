"""Mesh files: what is declared is held against what is there, the up axis against the surface, digits against edges."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from aoro_gym.terrains import TerrainError, load

SIDE = 21


def height(x, y):
    return 1.5 * np.sin(x / 5.0) + np.cos(y / 6.0)


def ground(cell: float = 1.0, shape=height) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of 21 x 21 nodes, z up, faces counter-clockwise from above."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] * cell
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    below = np.stack([corner, corner + 1, corner + SIDE + 1], axis=1)
    above = np.stack([corner, corner + SIDE + 1, corner + SIDE], axis=1)
    return np.stack([x, y, shape(x, y)], axis=-1).reshape(-1, 3), np.concatenate([below, above])


def exported(what, kind: str) -> Any:
    """What trimesh writes of this kind: text, bytes, or files by name."""
    return what.export(file_type=kind)


def export(path: Path, vertices, faces, **options) -> Path:
    trimesh.Trimesh(vertices, faces, process=False).export(path, **options)
    return path


def y_up(vertices: np.ndarray) -> np.ndarray:
    return np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)


def ascii_ply(vertices, rows, properties=("float x", "float y", "float z"), lists="uchar int vertex_indices") -> str:
    head = [f"element vertex {len(vertices)}", *(f"property {text}" for text in properties)]
    if rows is not None:
        head += [f"element face {len(rows)}", f"property list {lists}"]
    body = [" ".join(f"{value:.9g}" for value in vertex) for vertex in vertices]
    body += [" ".join(map(str, [len(row), *row])) for row in (() if rows is None else rows)]
    return "\n".join(["ply", "format ascii 1.0", "comment made here", *head, "end_header", *body]) + "\n"


def write_off(vertices, rows) -> str:
    lines = [f"OFF # a comment\n{len(vertices)} {len(rows)} 0"]
    lines += [" ".join(f"{value:.9g}" for value in vertex) for vertex in vertices]
    return "\n".join(lines + [" ".join(map(str, [len(row), *row])) for row in rows]) + "\n"


def write_obj(vertices, rows) -> str:
    lines = ["# made here", *("v " + " ".join(f"{value:.9g}" for value in vertex) for vertex in vertices)]
    return "\n".join(lines + ["f " + " ".join(str(index + 1) for index in row) for row in rows]) + "\n"


def kinds(report) -> set[str]:
    return {change.what for change in report.changes}


def assert_ground(terrain, vertices: np.ndarray, atol: float = 1e-6) -> None:
    """The same vertices, in any order."""
    found = terrain.vertices + np.asarray(terrain.origin)
    order = np.lexsort(np.round(found[:, :2], 3).T), np.lexsort(np.round(vertices[:, :2], 3).T)
    np.testing.assert_allclose(found[order[0]], vertices[order[1]], atol=atol)


# --- the up axis ---


def hill(x, y):
    return 12.0 * np.exp(-((x - 10.0) ** 2 + (y - 9.0) ** 2) / 40.0)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("shape", [height, hill, lambda x, y: 0.0 * x])
def test_gltf_with_z_up_is_told_by_its_surface(tmp_path, suffix, shape):
    vertices, faces = ground(shape=shape)
    path = export(tmp_path / "zup.glb", vertices, faces)
    if suffix == ".gltf":
        for name, content in exported(trimesh.Trimesh(vertices, faces, process=False), "gltf").items():
            (tmp_path / name).write_bytes(content)
        path = tmp_path / "model.gltf"
    terrain, report = load(path)
    assert_ground(terrain, vertices)
    (change,) = (change for change in report.changes if change.what == "up")
    assert "against glTF's rule of y" in change.text
    assert "up='y'" in change.text
    assert report.units == "m (of its format)"


@pytest.mark.parametrize("shape", [height, hill, lambda x, y: 0.3 * x + 0.2 * y])
def test_gltf_with_y_up_stays(tmp_path, shape):
    vertices, faces = ground(shape=shape)
    terrain, report = load(export(tmp_path / "yup.glb", y_up(vertices), faces))
    assert_ground(terrain, vertices)
    assert "up" not in kinds(report)
    assert not any("is taken as up" in text for text in report.warnings)


def test_a_side_that_shows_more_is_named(tmp_path):
    vertices, faces = ground(shape=lambda x, y: 0.2 * x)
    lean = np.stack([vertices[:, 0], 0.8 * vertices[:, 1], vertices[:, 1] * 1.0 + vertices[:, 2]], axis=1)
    _, report = load(export(tmp_path / "lean.glb", lean, faces), up=None)
    assert any("up='z' says otherwise" in text for text in report.warnings) or "up" not in kinds(report)


def test_the_users_axis_wins_over_the_surface(tmp_path):
    vertices, faces = ground()
    with pytest.raises(TerrainError):  # taken as y up, it is a wall
        load(export(tmp_path / "zup.glb", vertices * [1.0, 1.0, 0.01], faces), up="y")
    terrain, report = load(tmp_path / "zup.glb", up="z")
    assert report.up == "z (as asked)"
    assert len(terrain.vertices) == SIDE**2


def test_points_of_gltf_follow_the_same_rule(tmp_path):
    vertices, _ = ground(0.5)
    for name, points in (("zup", vertices), ("yup", y_up(vertices))):
        trimesh.Scene([trimesh.PointCloud(points)]).export(tmp_path / f"{name}.glb")
        terrain, report = load(tmp_path / f"{name}.glb", ground="all", cell=0.5)
        x, y, z = terrain.vertices.T
        np.testing.assert_allclose(z, height(x, y), atol=1e-5)
        assert ("up" in kinds(report)) == (name == "zup")


# --- lost digits ---


def jittered(cell=0.4, seed=0):
    vertices, faces = ground(cell, lambda x, y: 0.5 * np.sin(x) + 0.4 * np.cos(y / 1.3))
    inner = np.random.default_rng(seed).uniform(-0.3 * cell, 0.3 * cell, (len(vertices), 2))
    vertices[:, :2] += inner
    return vertices, faces


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".off"])
def test_single_precision_far_out_is_a_warning(tmp_path, suffix):
    vertices, faces = jittered()
    for shift in ([500_000.0, 6_650_000.0, 150.0], [32_500_000.0, 5_500_000.0, 0.0]):
        far = (vertices + shift).astype(np.float32).astype(np.float64)
        step = np.spacing(np.float32(max(shift)))
        try:
            _, report = load(export(tmp_path / f"far{suffix}", far, faces), units="m")
        except TerrainError:  # what is left may be no ground at all
            continue
        (warning,) = (text for text in report.warnings if text.startswith("coordinates"))
        assert "float32" in warning
        assert f"steps of {step:.3g} m" in warning
        assert "double precision" in warning


@pytest.mark.parametrize("digits", [4, 6])
def test_too_few_digits_are_a_warning(tmp_path, digits):
    vertices, _ = ground(0.6)
    far = vertices * [1.0, 5.0, 1.0] + [500_000.0, 6_650_000.0, 150.0]
    rows = [" ".join(f"{value:.{digits}g}" for value in vertex) for vertex in far]
    (tmp_path / "few.xyz").write_text("\n".join(rows))
    if digits == 4:  # all of x is 5e+05
        with pytest.raises(TerrainError, match=r"lie at x = 500000, .* too few digits"):
            load(tmp_path / "few.xyz", ground="all", units="m")
        return
    _, report = load(tmp_path / "few.xyz", ground="all", units="m", hole_limit=30.0)
    (warning,) = (text for text in report.warnings if text.startswith("coordinates"))
    assert f"have few digits: steps of {10 ** (7 - digits)} m" in warning


def test_an_error_after_lost_digits_names_them(tmp_path):
    far = ground(0.1)[0] + np.array([500_000.0, 6_650_000.0, 150.0])
    rows = [" ".join(f"{value:.7g}" for value in vertex) for vertex in far]
    (tmp_path / "few.xyz").write_text("\n".join(rows))
    with pytest.raises(TerrainError, match=r"before that: coordinates have few digits"):
        load(tmp_path / "few.xyz", ground="all", units="m")


def neighbours_with_all_digits():
    grid, faces = ground(1.0)
    irregular, _ = jittered()
    utm = np.array([500_000.0, 6_650_000.0, 150.0])
    wall = ground(1.0, lambda x, y: np.where(x > 10.0, 3.0, 0.0))[0]
    return {
        "a grid of whole metres": (grid + utm, ".obj"),
        "half metres": (grid * [0.5, 0.5, 1.0] + utm, ".off"),
        "in double": (irregular + utm, ".obj"),
        "near the origin in single": (irregular.astype(np.float32).astype(np.float64), ".stl"),
        "steps of a terrace": (wall, ".ply"),
    }, faces


@pytest.mark.parametrize("name", neighbours_with_all_digits()[0])
def test_enough_digits_are_no_warning(tmp_path, name):
    meshes, faces = neighbours_with_all_digits()
    vertices, suffix = meshes[name]
    options = {"digits": 12} if suffix in (".obj", ".off") else {}
    terrain, report = load(export(tmp_path / f"whole{suffix}", vertices, faces, **options))
    assert not any(text.startswith("coordinates") for text in report.warnings)
    if name != "steps of a terrace":
        assert_ground(terrain, vertices, atol=1e-4)


# --- whole files ---


def test_dialects_of_ply_are_read_alike(tmp_path):
    vertices, faces = ground()
    quads = faces.reshape(2, -1, 3)
    quads = np.concatenate([quads[0], quads[1][:, 2:]], axis=1)
    texts = {
        "triangles": ascii_ply(vertices, faces),
        "quads": ascii_ply(vertices, quads),
        "mixed": ascii_ply(vertices, [*quads[:100].tolist(), *faces[100:400].tolist(), *faces[500:].tolist()]),
        "double": ascii_ply(vertices, faces, ("double x", "double y", "double z")),
        "other name": ascii_ply(vertices, faces, lists="uint8 uint32 vertex_index"),
        "lines of Windows": ascii_ply(vertices, faces).replace("\n", "\r\n"),
    }
    for name, text in texts.items():
        (tmp_path / "dialect.ply").write_bytes(text.encode())
        terrain, _ = load(tmp_path / "dialect.ply")
        assert_ground(terrain, vertices)
        assert len(terrain.faces) == len(faces), name
    for encoding in ("binary_little_endian", "ascii"):
        assert_ground(load(export(tmp_path / "binary.ply", vertices, faces, encoding=encoding[:6]))[0], vertices)


def test_obj_is_read_as_its_writers_mean_it(tmp_path):
    vertices, faces = ground()
    plain = write_obj(vertices, faces)
    with_rest = plain.replace("f ", "vt 0 0\nusemtl grass\nf ", 1)
    relative = ""
    for face in faces:
        relative += "".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in vertices[face]) + "f -3 -2 -1\n"
    dialects = {
        "plain": plain,
        "textures": "\n".join(
            " ".join(f"{word}/1/1" if line[0] == "f" and word != "f" else word for word in line.split())
            for line in with_rest.splitlines()
        ),
        "normals": plain.replace("\nf ", "\nvn 0 0 1\nf ", 1),
        "continued": plain.replace("\nf 1 2", "\nf \\\n1 2", 1),
        "colours": "\n".join(f"{line} 0.5 0.5 0.5" if line.startswith("v ") else line for line in plain.splitlines()),
        "tabs": plain.replace(" ", "\t"),
    }
    for name, text in dialects.items():
        (tmp_path / "dialect.obj").write_text(text)
        terrain, _ = load(tmp_path / "dialect.obj")
        assert_ground(terrain, vertices)
        assert len(terrain.faces) == len(faces), name
    (tmp_path / "relative.obj").write_text(relative)
    terrain, _ = load(tmp_path / "relative.obj", units="m")
    assert_ground(terrain, vertices)
    assert len(terrain.faces) == len(faces)


def cut_files() -> dict[str, tuple[str, bytes, str]]:
    """Suffix, content and what the error says."""
    vertices, faces = ground()
    ply, off, obj = ascii_ply(vertices, faces), write_off(vertices, faces), write_obj(vertices, faces)
    stl = exported(trimesh.Trimesh(vertices, faces, process=False), "stl_ascii")
    glb = exported(trimesh.Trimesh(vertices, faces, process=False), "glb")
    binary = exported(trimesh.Trimesh(vertices, faces, process=False), "stl")
    beyond = [*faces[:-1].tolist(), [0, 1, 5000]]
    return {
        "PLY, faces gone": (
            ".ply",
            ply.encode()[: 3 * len(ply) // 4],
            "of 441 vertices and 800 faces that its",
        ),
        "PLY, vertices gone": (".ply", ply.encode()[: len(ply) // 4], "of 441 vertices .* whole up to vertex 27"),
        "PLY, rows gone": (".ply", ply.encode()[: ply.rindex("3 ")], "but it ends after 799 of 800 face rows"),
        "PLY, a row not whole": (".ply", ply.encode()[:-5], "a face has 4; .* whole up to face 799"),
        "PLY, a huge count": (".ply", ply.replace("vertex 441", "vertex 1000000000000").encode(), "1,000,000,000,000"),
        "PLY, a count of words": (".ply", ply.replace("vertex 441", "vertex many").encode(), "no element with its num"),
        "PLY, an unknown type": (".ply", ply.replace("float x", "real x").encode(), "no property with a type"),
        "PLY, corners beyond": (".ply", ascii_ply(vertices, beyond).encode(), "1 of its 800 triangles .* 5000 of 441"),
        "PLY, negative corners": (".ply", ascii_ply(vertices, [*faces.tolist(), [0, 1, -7]]).encode(), "not there"),
        "PLY, other lists": (
            ".ply",
            ascii_ply(vertices, faces, lists="uchar int rings").encode(),
            "no list vertex_ind",
        ),
        "PLY, no end": (".ply", ply.replace("end_header", "end").encode(), "'ply' to 'end_header'"),
        "PLY, a word": (".ply", ply.replace("\n0 0 ", "\n0 zero ", 1).encode(), "cannot be read"),
        "OFF, faces gone": (".off", off.encode()[: 3 * len(off) // 4], "441 vertices and 800 faces, but"),
        "OFF, corners gone": (".off", off.encode()[:-5], "lacks corners"),
        "OFF, a huge count": (".off", off.replace("441 800", "441 1000000000000").encode(), "1,000,000,000,000 faces"),
        "OFF, corners beyond": (".off", write_off(vertices, beyond).encode(), "outside the range|not there"),
        "OBJ, vertices gone": (".obj", "\n".join(obj.splitlines()[200:]).encode(), "name a vertex that is not there"),
        "OBJ, a vertex not whole": (
            ".obj",
            obj.replace("\nv 0 0 1", "\nv 0 0\nv 0 0 1", 1).encode(),
            "line 2: 'v 0 0'",
        ),
        "OBJ, a corner in words": (".obj", (obj + "f a b c\n").encode(), "corner 'a'"),
        "OBJ, corner zero": (".obj", (obj + "f 0 1 2\n").encode(), "corner '0'"),
        "OBJ, 400 digits": (".obj", (obj + f"f 1 2 {'9' * 400}\n").encode(), "is no number of a vertex"),
        "STL, no end": (".stl", stl.encode()[: len(stl) // 2], "no endsolid follows; it is cut off"),
        "STL, a facet gone": (".stl", stl.replace("endfacet", "", 1).encode(), "800 facets begin .* 799 end"),
        "STL, binary": (".stl", binary[:-60], "declares 800 triangles, but it holds 798"),
        "GLB, cut": (".glb", glb[: len(glb) // 2], "declares [0-9,]+ bytes, but it holds"),
        "GLB, no JSON": (".glb", glb[:20] + b"[" * 900 + glb[920:], "cannot be read as a mesh|no glTF"),
        "glTF, nested": (".gltf", b'{"nodes":' + b"[" * 100_000 + b"]" * 100_000 + b"}", "nested too deeply"),
        "glTF, a list": (".gltf", b"[1, 2]", "no glTF"),
        "glTF, a huge accessor": (".gltf", b'{"accessors": [{"count": 1000000000000}]}', "1e\\+12|1000000000000"),
        "glTF, a circle": (".gltf", b'{"nodes": [{"children": [1]}, {"children": [0]}]}', "in a circle"),
        "glTF, 400 digits": (".gltf", b'{"accessors": [{"count": ' + b"9" * 400 + b"}]}", "glTF|cannot be read|broken"),
    }


@pytest.mark.parametrize("name", cut_files())
def test_what_is_not_whole_is_one_clear_error(tmp_path, name):
    suffix, content, message = cut_files()[name]
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(content)
    with pytest.raises(TerrainError, match=message) as caught:
        load(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert len(text) < len(str(path)) + 300


def test_binary_ply_that_lacks_bytes_is_named_by_its_counts(tmp_path):
    vertices, faces = ground()
    path = export(tmp_path / "cut.ply", vertices, faces)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(TerrainError, match="declares 441 vertices and 800 faces, which take at least"):
        load(path)


def test_compressed_gltf_is_named(tmp_path):
    vertices, faces = ground()
    glb = export(tmp_path / "draco.glb", vertices, faces).read_bytes()
    (length,) = struct.unpack_from("<I", glb, 12)
    tree = json.loads(glb[20 : 20 + length]) | {"extensionsRequired": ["KHR_draco_mesh_compression"]}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + length :]
    (tmp_path / "draco.glb").write_bytes(
        struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest
    )
    with pytest.raises(TerrainError, match="KHR_draco_mesh_compression"):
        load(tmp_path / "draco.glb")


def test_a_mesh_that_is_placed_too_often_is_refused(tmp_path):
    vertices, faces = ground()
    scene = trimesh.Scene()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    for number in range(3):
        scene.add_geometry(mesh, node_name=str(number), geom_name="ground")
    for name, content in exported(scene, "gltf").items():
        (tmp_path / name).write_bytes(content)
    assert len(load(tmp_path / "model.gltf").terrain.vertices) == SIDE**2
    tree = json.loads((tmp_path / "model.gltf").read_text())
    tree["nodes"] += [{"mesh": 0}] * 120_000
    (tmp_path / "model.gltf").write_text(json.dumps(tree))
    with pytest.raises(TerrainError, match="vertices, some many times, more than 50,000,000"):
        load(tmp_path / "model.gltf")


@pytest.mark.parametrize(("suffix", "library"), [(".dae", "pycollada"), (".3mf", "lxml")])
def test_a_format_whose_library_is_missing_says_so(tmp_path, monkeypatch, suffix, library):
    monkeypatch.setitem(__import__("sys").modules, {"pycollada": "collada"}.get(library, library), None)
    (tmp_path / f"mesh{suffix}").write_bytes(b"<x/>")
    with pytest.raises(TerrainError, match=f"{library} is not installed|cannot be read as a mesh"):
        load(tmp_path / f"mesh{suffix}")
