"""The same vehicle in Newton, whose importer reads the model of MuJoCo, stepped by its solver ``SolverMuJoCo``.

That solver has the contacts, joints, servos and time step of the other peers. Newton's own solvers know less of that model
(as of 1.8.0): ``SolverXPBD`` and ``SolverSteel`` no springs of joints, ``SolverFeatherstone`` no bound of a servo's torque,
and by the contact springs that the importer makes for it ten tonnes sink through the ground.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.benchmark.peers import CONSTRAINTS, CONTACTS, SETTLE, STEPS, described, dropped, package
from aoro_gym.benchmark.scene import CELL, CHANGES, heights, signals, starts
from aoro_gym.benchmark.timing import Subject
from aoro_gym.benchmark.vehicle import TIME_STEP, controls, load, mjcf, poses
from aoro_gym.machine import Machine

SAME = 1e-5
"""Difference of a model's numbers, relative to the largest of their kind, that makes it another vehicle: Newton keeps single
precision, 6e-8, and a mass matrix is a sum of a few dozen rounded products."""


def newton(worlds: int, *, machine: Machine, ground: str = "raster", device: str = "cuda:0", seed: int = 0) -> Subject:
    """``worlds`` vehicles in Newton by ``SolverMuJoCo``; on CUDA two steps are a recorded graph, there and back between its
    two states, and the controls lie on the device already.

    Args:
        worlds: Number of vehicles.
        machine: The machine that is modelled.
        ground: ``plane`` or ``raster``.
        device: ``"cpu"`` or ``"cuda:N"``.
        seed: Of ground, poses and commands.

    Raises:
        RuntimeError: Newton has read another vehicle than MuJoCo.
    """
    engine, mujoco_warp = package("newton"), package("mujoco_warp")
    surface = heights(ground)
    host = load(machine, surface, CELL)
    pose = joints(poses(host, surface, CELL, *starts(worlds, seed)))
    with wp.ScopedDevice(device), warnings.catch_warnings():
        # of MuJoCo's version, which `_hold_same` looks into, and of names that it has changed
        warnings.simplefilter("ignore", engine.NewtonWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        model = _model(engine, mjcf(machine, surface, CELL), surface, pose)
        solver = engine.solvers.SolverMuJoCo(
            model, nconmax=CONTACTS, njmax=CONSTRAINTS, enable_multiccd=True, kinematic_switchable_roots=False
        )
        _hold_same(host, solver.mj_model)
        solver.mjw_model.opt.warn_overflow = 0  # `check` says what was dropped, nothing is printed
        schedule = [wp.array(c.astype(np.float32).ravel(), dtype=float) for c in controls(host, signals(worlds, seed))]
        vehicles = _Vehicles(model, solver, schedule)
    return Subject(
        description=described("newton", engine.__version__, device, worlds, ground)
        | {"solver": "SolverMuJoCo", "mujoco_warp": mujoco_warp.__version__},
        copies=worlds,
        steps=STEPS,
        step_time=TIME_STEP,
        restart=vehicles.restart,
        advance=vehicles.advance,
        check=lambda: {
            "finite": vehicles.finite(),
            "dropped": dropped(mujoco_warp, solver.mjw_data.overflow),
        },
    )


class _Vehicles:
    """Vehicles of a Newton ``model``, once they have come to rest.

    Args:
        model: Of all worlds.
        solver: That steps it.
        schedule: Controls (worlds x 5,) of the control steps, in turn.
    """

    def __init__(self, model: Any, solver: Any, schedule: Sequence[Any]):
        self._solver, self._schedule, self._device = solver, schedule, model.device
        self._worlds = model.world_count
        self._control = model.control()
        self._here, self._there = model.state(), model.state()
        self._graph: Any = None
        self._two_steps()  # compiles
        if model.device.is_cuda:
            with wp.ScopedCapture() as capture:
                self._two_steps()
            self._graph = capture.graph
        self._step(round(SETTLE / TIME_STEP))
        self._start = wp.clone(self._here.joint_q), wp.clone(self._here.joint_qd)

    def _two_steps(self) -> None:
        self._solver.step(self._here, self._there, self._control, None, TIME_STEP)
        self._solver.step(self._there, self._here, self._control, None, TIME_STEP)

    def _step(self, count: int) -> None:
        for _ in range(count // 2):
            if self._graph is None:
                self._two_steps()
            else:
                wp.capture_launch(self._graph)

    def restart(self) -> None:
        """Back to where they came to rest."""
        with wp.ScopedDevice(self._device):
            self._solver.reset(self._here)
            wp.copy(self._here.joint_q, self._start[0])
            wp.copy(self._here.joint_qd, self._start[1])
            wp.synchronize_device(self._device)

    def advance(self, steps: int) -> None:
        """Take so many control steps."""
        with wp.ScopedDevice(self._device):
            for index in range(steps):
                wp.copy(self._control.mujoco.ctrl, self._schedule[index % CHANGES])
                self._step(STEPS)
            wp.synchronize_device(self._device)

    def finite(self) -> int:
        """Worlds whose state is finite."""
        state = (values.numpy().reshape(self._worlds, -1) for values in (self._here.joint_q, self._here.joint_qd))
        return int(np.logical_and(*(np.isfinite(values).all(axis=1) for values in state)).sum())


def joints(positions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Newton's joint coordinates (K, nq) of MuJoCo's: the real part of a quaternion comes last."""
    return positions[:, [0, 1, 2, 4, 5, 6, 3, *range(7, positions.shape[1])]].astype(np.float32)


def _model(engine: Any, text: str, ground: NDArray[np.float64], pose: NDArray[np.float32]) -> Any:
    """Newton's model of the vehicle in the MJCF ``text``, one a world at each ``pose`` (K, nq), all on one ``ground``."""
    vehicle, scene = (engine.ModelBuilder() for _ in range(2))
    for builder in (vehicle, scene):
        engine.solvers.SolverMuJoCo.register_custom_attributes(builder)
    # not collapse_fixed_joints: arms and their motors as one body have other inertias in 1.8.0
    vehicle.add_mjcf(text, ctrl_direct=True, ignore_names=("ground",))
    scene.add_mjcf(_ground(text, ground))
    scene.replicate(vehicle, len(pose))
    scene.joint_q = pose.ravel().tolist()
    return scene.finalize()


def _ground(text: str, ground: NDArray[np.float64]) -> str:
    """The MJCF ``text`` without the vehicle, and with heights in a picture's order: the first row is the northernmost."""
    root: Any = ElementTree.fromstring(text)
    world = root.find("worldbody")
    for parent, name in ((root, "actuator"), (root, "keyframe"), (world, "body")):
        parent.remove(parent.find(name))
    root.find("asset/hfield").set("elevation", " ".join(f"{height:.9g}" for height in ground[::-1].ravel()))
    return ElementTree.tostring(root, encoding="unicode")


def _hold_same(host: Any, read: Any) -> None:
    """``RuntimeError`` where MuJoCo's model ``read`` from Newton's is not that of ``host``: mass matrix and springs at rest,
    servos, wheels and ground."""
    for name, of_host, of_read in (
        ("masses", *(_mass_matrix(model, host.key("rest").qpos) for model in (host, read))),
        *(
            (name, getattr(host, name), getattr(read, name))
            for name in ("jnt_stiffness", "qpos_spring", "dof_damping", "actuator_gainprm", "actuator_forcerange")
        ),
        ("hfield_data", host.hfield_data, read.hfield_data),
        ("wheels", _of_wheels(host), _of_wheels(read)),
    ):
        same = of_host.shape == of_read.shape and np.abs(of_host - of_read).max() <= SAME * np.abs(of_host).max()
        if not same:
            raise RuntimeError(f"Newton has read another vehicle than MuJoCo: {name} differ")


def _mass_matrix(model: Any, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(nv, nv) at ``positions`` (nq,)."""
    mj = package("mujoco")
    data = mj.MjData(model)
    data.qpos[:] = positions
    mj.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    for row, rate in zip(matrix, np.eye(model.nv), strict=True):
        mj.mj_mulM(model, data, row, rate)
    return matrix


def _of_wheels(model: Any) -> NDArray[np.float64]:
    """Radius and friction of the four spheres."""
    spheres = model.geom_type == package("mujoco").mjtGeom.mjGEOM_SPHERE
    return np.column_stack([model.geom_size[spheres, 0], model.geom_friction[spheres]])
