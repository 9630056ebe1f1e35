"""The start of Warp: nothing is said on a computer without a GPU, and who asks for one learns why there is none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import aoro_gym
from aoro_gym.execution import devices

ROOT = str(Path(aoro_gym.__file__).parents[1])
needs_no_gpu = pytest.mark.skipif(devices._driver(), reason="there is a GPU")


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": ROOT, **environment}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)


@needs_no_gpu
def test_an_environment_is_made_without_a_word():
    ran = run("import aoro_gym, gymnasium; gymnasium.make('AORO/Turning-v0').reset(seed=0); print('made')")
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "made\n", "")


@needs_no_gpu
def test_a_missing_gpu_is_said_where_one_is_asked_for():
    with pytest.raises(
        ValueError, match=r"device 'cuda:0' is not available here; choose one of: cpu, cpu:simd \(the NVIDIA driver"
    ):
        devices.find("cuda:0")
    with pytest.raises(ValueError, match=r"device 'tpu' is not available here; choose one of: cpu"):
        devices.find("tpu")


def test_who_started_warp_is_let_be():
    code = "import warp; warp.init(); level = warp.config.log_level; from aoro_gym.execution import devices; devices.start()"
    ran = run(f"{code}; print(warp.config.log_level == level)")
    assert ran.stdout.splitlines()[-1] == "True"
    assert "initialized" in ran.stdout + ran.stderr


def test_only_the_line_itself_is_left_out(capfd):
    with devices._without("no driver"):
        os.write(2, b"Warp: no driver here\nanother fault\n")
    assert capfd.readouterr().err == "another fault\n"


def test_compilations_are_announced_when_they_come(monkeypatch):
    said: list[str] = []
    monkeypatch.setattr(devices, "say", said.append)
    aoro_gym.Twin()
    kernel = aoro_gym.Twin()._reset_kernel
    with devices.compiling(kernel, devices.find("cpu"), 32):
        pass
    del said[:]  # the first twin of a fresh computer is compiled
    aoro_gym.Twin()
    assert said == []

    class Fresh:
        execs: dict[str, str] = {}  # noqa: RUF012

        def get_module_identifier(self, block_dim: int) -> str:
            return "of_no_module"

    kernel = type("Kernel", (), {"module": Fresh()})
    with devices.compiling(kernel, devices.find("cpu"), 32):
        said.append("inside")
    assert [line.split(" ")[0] for line in said] == ["compiling", "inside", "compiled"]


def test_who_wants_quiet_hears_nothing_of_compilations(capsys, monkeypatch):
    monkeypatch.setattr(devices, "_quiet", False)
    devices.say("compiling")
    devices.set_quiet(True)
    devices.say("compiling")
    assert capsys.readouterr().err == "compiling\n"
