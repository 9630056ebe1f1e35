"""Peers: the same vehicle without its hydraulics, in MuJoCo on the CPU and in MuJoCo Warp on a GPU; in Newton:
:mod:`aoro_gym.benchmark.newton`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.benchmark.scene import CELL, CHANGES, CONTROL_STEP, heights, signals, starts
from aoro_gym.benchmark.timing import Subject
from aoro_gym.benchmark.vehicle import OPTIONS, TIME_STEP, controls, load, poses
from aoro_gym.machine import Machine

WORLDS = {
    "mujoco": (1, 16, 64),
    "mujoco_warp": (1024, 4096, 8192, 16384, 32768, 65536),
    "newton": (1024, 4096, 8192, 16384, 32768),
}
"""Peers by name, and the batches among which each has its best."""
NEWTON = "pip install newton==1.8.0"
"""How to get the peer that is no part of ``aoro-gym[bench]``. Newton asks for Warp 1.17 or later, and its ``SolverMuJoCo``
runs by the MuJoCo 4 that is here; but what it declares for that solver, its extra ``sim``, is MuJoCo 3.17."""
STEPS = round(CONTROL_STEP / TIME_STEP)
SETTLE = 1.5
"""Time [s] in which vehicles drop onto the ground and come to rest before anything is timed: in the air they are cheap."""
CHUNK = 25
"""Control steps that MuJoCo rolls out at once; it writes the state of every step."""
CONTACTS, CONSTRAINTS = 24, 80
"""Room of a world in MuJoCo Warp: at most four contacts of a wheel with a height field, four rows each, and five stops."""


def package(name: str) -> Any:
    """The optional package of a peer; ``ValueError`` names the fix where it is missing."""
    try:
        return import_module(name)
    except ImportError:
        raise ValueError(f"the peers need {name}: pip install 'aoro-gym[bench]'") from None


def skipped(peers: Sequence[str]) -> dict[str, str]:
    """Those of ``peers`` that are left out here, each with the reason."""
    absent = "newton" in peers and find_spec("newton") is None
    return {"newton": f"not installed: {NEWTON}"} if absent else {}


def mujoco(worlds: int, *, machine: Machine, ground: str = "raster", threads: int = 1, seed: int = 0) -> Subject:
    """``worlds`` vehicles in MuJoCo C, rolled out by its own thread pool where there are several ``threads``.

    Args:
        worlds: Number of vehicles.
        machine: The machine that is modelled.
        ground: ``plane`` or ``raster``.
        threads: Threads of the pool.
        seed: Of ground, poses and commands.
    """
    mj = package("mujoco")
    surface = heights(ground)
    model = load(machine, surface, CELL)
    datas = [mj.MjData(model) for _ in range(threads)]
    kind = mj.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty((worlds, mj.mj_stateSize(model, kind)))
    for row, pose in zip(state, poses(model, surface, CELL, *starts(worlds, seed)), strict=True):
        datas[0].qpos[:] = pose
        mj.mj_getState(model, datas[0], row, kind)
    schedule = controls(model, signals(worlds, seed))  # (CHANGES, worlds, nu)
    pool = package("mujoco.rollout").Rollout(nthread=threads if threads > 1 else 0)

    def roll(control: NDArray[np.float64]) -> None:
        """On from ``state`` under ``control`` (worlds, steps, nu)."""
        states, _ = pool.rollout(model, datas, state, control)
        state[:] = states[:, -1]

    roll(np.zeros((worlds, round(SETTLE / TIME_STEP), model.nu)))
    start = state.copy()

    def restart() -> None:
        state[:] = start

    def advance(steps: int) -> None:
        for first in range(0, steps, CHUNK):
            indices = np.arange(first, min(first + CHUNK, steps)) % CHANGES
            roll(np.repeat(schedule[indices].swapaxes(0, 1), STEPS, axis=1))

    return Subject(
        description=described("mujoco", mj.__version__, "cpu", worlds, ground) | {"threads": threads},
        copies=worlds,
        steps=STEPS,
        step_time=TIME_STEP,
        restart=restart,
        advance=advance,
        check=lambda: {"finite": int(np.isfinite(state).all(axis=1).sum()), "dropped": []},
    )


def mujoco_warp(
    worlds: int, *, machine: Machine, ground: str = "raster", device: str = "cuda:0", seed: int = 0
) -> Subject:
    """``worlds`` vehicles in MuJoCo Warp; on CUDA a step is a recorded graph, and the controls lie on the device already.

    Args:
        worlds: Number of vehicles.
        machine: The machine that is modelled.
        ground: ``plane`` or ``raster``.
        device: ``"cpu"``, ``"cpu:simd"`` or ``"cuda:N"``.
        seed: Of ground, poses and commands.
    """
    mj, mjw = package("mujoco"), package("mujoco_warp")
    surface = heights(ground)
    host = load(machine, surface, CELL)
    pose = poses(host, surface, CELL, *starts(worlds, seed)).astype(np.float32)
    with wp.ScopedDevice(device):
        model = mjw.put_model(host)
        model.opt.warn_overflow = 0  # `check` says what was dropped, nothing is printed
        data = mjw.put_data(host, mj.MjData(host), nworld=worlds, nconmax=CONTACTS, njmax=CONSTRAINTS)
        wp.copy(data.qpos, wp.array(pose, dtype=float))
        schedule = [wp.array(c.astype(np.float32), dtype=float) for c in controls(host, signals(worlds, seed))]
        mjw.step(model, data)  # compiles
        graph = None
        if wp.get_device(device).is_cuda:
            with wp.ScopedCapture() as capture:
                mjw.step(model, data)
            graph = capture.graph

    def step(count: int) -> None:
        for _ in range(count):
            if graph is None:
                mjw.step(model, data)
            else:
                wp.capture_launch(graph)

    with wp.ScopedDevice(device):
        step(round(SETTLE / TIME_STEP))
        start = wp.clone(data.qpos), wp.clone(data.qvel)

    def restart() -> None:
        with wp.ScopedDevice(device):
            mjw.reset_data(model, data)
            wp.copy(data.qpos, start[0])
            wp.copy(data.qvel, start[1])
            wp.synchronize_device(device)

    def advance(steps: int) -> None:
        with wp.ScopedDevice(device):
            for index in range(steps):
                wp.copy(data.ctrl, schedule[index % CHANGES])
                step(STEPS)
            wp.synchronize_device(device)

    def check() -> dict[str, Any]:
        finite = np.isfinite(data.qpos.numpy()).all(axis=1) & np.isfinite(data.qvel.numpy()).all(axis=1)
        return {"finite": int(finite.sum()), "dropped": dropped(mjw, data.overflow)}

    return Subject(
        description=described("mujoco_warp", mjw.__version__, device, worlds, ground),
        copies=worlds,
        steps=STEPS,
        step_time=TIME_STEP,
        restart=restart,
        advance=advance,
        check=check,
    )


def dropped(mjw: Any, overflow: Any) -> list[str]:
    """What MuJoCo Warp had no room for, of its flags ``overflow`` (worlds,)."""
    # a solver that used all of its iterations dropped nothing
    harmless = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS
    seen = int(np.bitwise_or.reduce(overflow.numpy())) & ~int(harmless)
    return [flag.name for flag in mjw.OverflowType if flag.value.bit_count() == 1 and flag.value & seen]


def valid_runs(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of peers in which every world stayed finite and no contact was dropped."""
    return [row for row in rows if row["finite"] == row["worlds"] and not row["dropped"]]


def described(what: str, version: str, device: str, worlds: int, ground: str) -> dict[str, Any]:
    return {
        "what": what,
        "version": version,
        "device": device,
        "worlds": worlds,
        "ground": ground,
        "time_step_s": TIME_STEP,
        "control_step_s": CONTROL_STEP,
        "options": OPTIONS,
    }
