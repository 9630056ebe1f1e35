"""Heights in memory and in .npy: numbers in two dimensions, or one clear error."""

import numpy as np
import pytest

from aoro_gym.terrains import TerrainError, load

Z = 100.0 + np.add.outer(0.1 * np.arange(12), 0.2 * np.arange(15))


@pytest.mark.parametrize("dtype", ["float64", "float32", ">f4", "float16", "longdouble"])
def test_numbers(tmp_path, dtype):
    for z in (Z.astype(dtype), np.asfortranarray(Z.astype(dtype))):
        np.save(tmp_path / "g.npy", z)
        terrain, _ = load(tmp_path / "g.npy", cell=1.0)
        np.testing.assert_array_equal(terrain.vertices[:, 2], z.astype(np.float64).ravel())


@pytest.mark.parametrize("dtype", ["int64", "uint16", "int8"])
def test_whole_numbers(dtype):
    terrain, _ = load(np.rint(Z).astype(dtype), cell=2.0)
    np.testing.assert_array_equal(terrain.vertices[:, 2], np.rint(Z).ravel())


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.array([[1, None], [2, 3]], dtype=object), "Python objects|of the type object"),
        (Z.astype(complex), "of the type complex128"),
        (np.full(Z.shape, "1"), "of the type <U1"),
        (Z > 100.0, "of the type bool"),
        (np.zeros((9, 9), "M8[s]"), "of the type datetime64"),
        (np.zeros((9, 9), [("z", float)]), "of the type"),
        (np.zeros((3, 3, 3)), "have the shape"),
        (np.zeros(()), "have the shape"),
    ],
)
def test_what_is_no_heights(tmp_path, array, message):
    with pytest.raises(TerrainError, match=message):
        load(array, cell=1.0)
    np.save(tmp_path / "g.npy", array, allow_pickle=True)
    with pytest.raises(TerrainError, match=f"{message}|cannot be read as an array") as caught:
        load(tmp_path / "g.npy", cell=1.0)
    assert "g.npy" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_ragged_lists_and_bands():
    with pytest.raises(TerrainError, match="must be numbers"):
        load([[1.0, 2.0], [3.0]], cell=1.0)
    with pytest.raises(TerrainError, match="no bands"):
        load(Z, cell=1.0, band=1)
    with pytest.raises(TerrainError, match="nodata is 'none', but must be a number"):
        load(Z, cell=1.0, nodata="none")  # pyright: ignore[reportArgumentType]


def test_files_that_are_no_array(tmp_path):
    np.save(tmp_path / "whole.npy", Z)
    whole = (tmp_path / "whole.npy").read_bytes()
    np.savez(tmp_path / "many.npz", heights=Z, more=Z)
    files = {
        "cut.npy": whole[:-100],
        "archive.npy": (tmp_path / "many.npz").read_bytes(),
        "vast.npy": whole.replace(b"(12, 15), }" + b" " * 8, b"(900000, 900000), }"),
        "header.npy": whole[:20],
        "words.npy": b"z = 3\n" * 50,
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(TerrainError, match=name):
            load(tmp_path / name, cell=1.0)
    with pytest.raises(TerrainError, match="heights, more"):
        load(tmp_path / "archive.npy", cell=1.0)
    with pytest.raises(TerrainError, match="terrains end in one of"):
        load(tmp_path / "many.npz", cell=1.0)
