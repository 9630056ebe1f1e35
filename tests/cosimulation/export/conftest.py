"""Exported twins, each built once: the kernels lie in Warp's own cache, the C compiler takes a second or two."""

import pytest

from aoro_gym.cosimulation.export.build import export_twin
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains import Plane
from tests.cosimulation.export.library import Library, listed_for


@pytest.fixture(scope="session")
def shipped():
    """The calibrated machine."""
    return Machine.load("aoro")


@pytest.fixture(scope="session")
def unit(shipped, tmp_path_factory):
    """Writes the shipped machine on a plane in a format, once; returns the file or folder."""
    made = {}

    def get(format):
        if format not in made:
            folder = tmp_path_factory.mktemp("exported")
            made[format] = folder / ("aoro" if format == "c" else "aoro.fmu")
            export_twin(format, made[format], machine=shipped)
        return made[format]

    return get


@pytest.fixture(scope="session")
def library(unit, shipped):
    """The library of C."""
    return Library(unit("c") / "libaoro.so", listed_for(shipped, Plane()))
