"""The wheel holds every package and data file, imports flow one way, and importing the package stays cheap."""

import doctest
import fnmatch
import os
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import gymnasium
import pytest

import aoro_gym

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SETUPTOOLS = PROJECT["tool"]["setuptools"]
LINKED = ("envs", "terrains", "agents")


def folder_of(package: str) -> Path:
    """Folder of a package by setuptools' mapping."""
    mapping = SETUPTOOLS["package-dir"]
    for name in sorted(mapping, key=len, reverse=True):
        if package == name or package.startswith(f"{name}."):
            return ROOT / mapping[name] / package[len(name) :].strip(".").replace(".", "/")
    raise AssertionError(f"{package} has no folder")


def test_every_package_is_listed():
    found = set()
    for top in ("aoro_gym", *LINKED):
        for folder, subfolders, files in os.walk(ROOT / top):  # does not follow the links
            subfolders[:] = [name for name in subfolders if name != "__pycache__"]
            if any(name.endswith(".py") for name in files):
                assert "__init__.py" in files, f"{folder} holds modules but no __init__.py"
                dotted = Path(folder).relative_to(ROOT).as_posix().replace("/", ".")
                found.add(dotted if top == "aoro_gym" else f"aoro_gym.{dotted}")
    assert sorted(SETUPTOOLS["packages"]) == sorted(found)


@pytest.mark.parametrize("name", LINKED)
def test_folders_at_the_root_are_linked_into_the_package(name):
    link = ROOT / "aoro_gym" / name
    assert link.is_symlink()
    assert os.readlink(link) == f"../{name}"
    assert SETUPTOOLS["package-dir"][f"aoro_gym.{name}"] == name


def test_every_data_file_is_in_the_wheel():
    patterns = {folder_of(package): globs for package, globs in SETUPTOOLS["package-data"].items()}
    for top in ("aoro_gym", *LINKED):
        for folder, subfolders, files in os.walk(ROOT / top):
            subfolders[:] = [name for name in subfolders if name != "__pycache__"]
            for file in (Path(folder, name) for name in files if not name.endswith(".py")):
                covered = any(
                    file.is_relative_to(base)
                    and any(fnmatch.fnmatch(str(file.relative_to(base)), glob) for glob in globs)
                    for base, globs in patterns.items()
                )
                assert covered, f"{file.relative_to(ROOT)} matches no pattern of package-data"


def test_every_direct_dependency_is_pinned():
    pins = re.findall(r"(?m)^([\w.-]+)==", (ROOT / "constraints.txt").read_text(encoding="utf-8"))
    pinned = {re.sub(r"[-_.]+", "-", pin).lower() for pin in pins}
    project = PROJECT["project"]
    wanted = [
        *project["dependencies"],
        *(item for extra in project["optional-dependencies"].values() for item in extra),
    ]
    for requirement in [*wanted, *PROJECT["build-system"]["requires"]]:
        name = re.sub(r"[-_.]+", "-", re.split(r"[\[<>=!~; ]", requirement)[0]).lower()
        assert name == "aoro-gym" or name in pinned, f"{requirement} has no pin in constraints.txt"
    assert len(pins) == len(set(pins))


@pytest.mark.parametrize("module", ["aoro_gym", "aoro_gym.cli"])
def test_importing_is_cheap(module):
    # gymnasium, and with it numpy, is there to register the environments
    heavy = ["scipy", "warp", "matplotlib", "plotly", "trimesh", "pandas", "pyarrow", "torch"]
    code = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", ["AORO/Turning-v0", "aoro_gym:AORO/Turning-v0"])
def test_importing_registers_the_environments(name):
    alone = "" if ":" in name else "import aoro_gym; "
    code = f"import gymnasium; {alone}print(gymnasium.make({name!r}).spec.id)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "AORO/Turning-v0"


def test_plug_in_registers_the_environments():
    module, _, function = PROJECT["project"]["entry-points"]["gymnasium.envs"]["__root__"].partition(":")
    getattr(import_module(module), function)()
    assert "AORO/Turning-v0" in gymnasium.registry


def test_names_load_on_first_use():
    for name in aoro_gym.__all__:
        assert getattr(aoro_gym, name) is not None
        assert name in dir(aoro_gym)
    with pytest.raises(AttributeError, match="Tractor"):
        _ = aoro_gym.Tractor


def test_example_of_the_package():
    tried = doctest.testmod(aoro_gym)
    assert tried.attempted > 0
    assert tried.failed == 0
