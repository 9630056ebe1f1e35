"""Exports that need kernels of their own: a terrain's raster, and machines of other laws. Also what takes long."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest

from aoro_gym.cosimulation.export.build import build_library, export_twin, generate
from aoro_gym.cosimulation.export.compiler import find_compiler
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains import Plane, Terrain
from tests.cosimulation.export.library import (
    Exported,
    Library,
    assert_same_bits,
    listed_for,
    outputs,
    portable_twin,
    run_twin,
)

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "c"


def waves() -> Terrain:
    """Ground 40 m wide that goes up and down by 0.3 m."""
    x = np.arange(-20.0, 20.1, 0.5)
    heights = 0.3 * np.sin(0.5 * x)[None, :] * np.cos(0.4 * x)[:, None]
    return Terrain.from_heights(heights, cell=0.5, corner=(-20.0, -20.0))


def driving(step):
    return {5: {"drive_signal": 0.5}, 100: {"steering_signal": 0.6}, 200: {"gear": 2.0}}.get(step, {})


def exported(machine, terrain, folder) -> Exported:
    export_twin("c", folder, machine=machine, terrain=terrain)
    return Exported(Library(folder / "libaoro.so", listed_for(machine, terrain)))


def test_a_terrain_is_the_python_twins_to_the_bit(shipped, tmp_path):
    ground = waves()
    twin = exported(shipped, ground, tmp_path)
    assert set(twin.set({"initial.x": 2.0, "initial.y": 1.0, "initial.heading": 0.5, "ground.friction": 0.8})) == {0}
    assert twin.reset() == 0
    python = portable_twin(shipped, ground)
    python.set_ground([0], friction=0.8)
    expected = run_twin(python, driving, 300, position=(2.0, 1.0), heading=0.5)
    found = twin.run(driving, 300)
    assert_same_bits(found, expected)
    assert np.ptp(found[:, outputs(twin.library.listed).index("roll")]) > 0.01


def test_a_terrain_lies_in_the_unit(shipped, tmp_path):
    ground, file = waves(), tmp_path / "waves.fmu"
    export_twin("fmi3", file, machine=shipped, terrain=ground)
    names = outputs(listed_for(shipped, ground))
    result = fmpy.simulate_fmu(
        str(file), stop_time=0.5, output_interval=0.01, start_values={"drive_signal": 0.5}, output=names
    )
    expected = run_twin(portable_twin(shipped, ground), lambda step: {"drive_signal": 0.5}, 50)
    assert_same_bits(np.stack([result[name] for name in names], axis=1).astype(np.float32)[1:], expected)


def test_other_laws_are_the_python_twins_to_the_bit(shipped, tmp_path):
    machine = shipped.with_laws("library")
    assert not machine.laws.default
    twin = exported(machine, Plane(), tmp_path)
    assert twin.reset() == 0
    assert_same_bits(twin.run(driving, 150), run_twin(portable_twin(machine), driving, 150))


def test_the_data_sheets_machine_is_exported(tmp_path):
    machine = Machine.load("aoro_datasheet")
    twin = exported(machine, Plane(), tmp_path)
    assert twin.reset() == 0
    assert_same_bits(twin.run(driving, 100), run_twin(portable_twin(machine), driving, 100))


def compiled(source, folder, out):
    arguments = [str(source), f"-I{folder}", f"-L{folder}", "-laoro", f"-Wl,-rpath,{folder}", "-o", str(out)]
    subprocess.run([*find_compiler(), "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", *arguments], check=True)


def test_an_hour_takes_no_memory(unit, tmp_path):
    compiled(EXAMPLES / "hour.c", unit("c"), tmp_path / "hour")
    shown = json.loads(subprocess.run([tmp_path / "hour"], capture_output=True, check=True, text=True).stdout)
    assert shown["seconds"] == 3600
    assert shown["rss_end_kB"] - shown["rss_start_kB"] < 256, "a float lost a step would be 14,000 kB"


def test_the_sources_compile_without_a_warning(shipped, tmp_path):
    made = generate(tmp_path, shipped, Plane())
    build_library(made, "c", tmp_path / "libaoro.so")
    for name in ("aoro.c", "fmi2.c", "fmi3.c"):
        strict = ["-std=gnu11", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wno-sign-conversion", "-Werror"]
        subprocess.run([*find_compiler(), *strict, "-c", tmp_path / name, "-o", os.devnull], check=True)


def test_the_example_builds_with_cmake(unit, tmp_path):
    if shutil.which("cmake") is None:
        pytest.skip("there is no cmake")
    steps = (["cmake", "-S", EXAMPLES, "-B", tmp_path, f"-DAORO={unit('c')}"], ["cmake", "--build", tmp_path])
    for step in steps:
        subprocess.run(step, check=True, capture_output=True)
    shown = subprocess.run([tmp_path / "host"], check=True, capture_output=True, text=True).stdout
    assert len(shown.splitlines()) == 30
