"""A twin of this process on a page of another process, so that its steps do not wait for a browser.

Time, state and outputs go through memory that both share. A count beside them is odd while they are written: a reader that
finds it odd, or changed, reads again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Sequence
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Floats, Pose
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state
from aoro_gym.twin.records import CHANNELS, State
from aoro_gym.view.forces import TireForces
from aoro_gym.view.page import FRAME, TwinPage
from aoro_gym.view.server import free_port, start

ENDED = -1
"""Count of a twin that is shown no more."""
NICENESS = 10
"""Of the page's process: the twin comes first."""
LAYOUT = np.dtype(
    [
        ("count", np.int64),
        ("time", np.float64),
        ("state", np.float32, len(State)),
        ("outputs", np.float32, len(CHANNELS)),
    ]
)


class SharedTwin:
    """The first of a twin's machines, in memory that another process reads."""

    def __init__(self, twin: Twin):
        self._twin = twin
        self.memory = SharedMemory(create=True, size=LAYOUT.itemsize)
        self._record = np.ndarray((), LAYOUT, buffer=self.memory.buf)
        self._record["count"] = 0
        self.publish()

    def publish(self) -> None:
        """Write what is now; 20 us."""
        record, twin = self._record, self._twin
        record["count"] += 1
        record["time"] = twin.time[0]
        record["state"] = twin.state.numpy()[: len(State), 0]  # what is further is not drawn
        record["outputs"] = twin.outputs.numpy()[-1][: len(CHANNELS), 0]
        record["count"] += 1

    def close(self) -> None:
        """End what reads it, and give the memory back."""
        self._record["count"] = ENDED
        del self._record
        self.memory.close()
        self.memory.unlink()


class MirroredTwin:
    """What another process says of its twin, as :class:`~aoro_gym.view.page.TwinPage` shows it.

    Args:
        memory: Of a :class:`SharedTwin`.
        twin: Of the same machine on the same ground: its state is overwritten, to know the tires' forces.
    """

    def __init__(self, memory: SharedMemory, twin: Twin):
        self._shared = np.ndarray((), LAYOUT, buffer=memory.buf)
        self._twin, self._forces = twin, TireForces(twin)
        self._record = self._shared.copy()

    def look(self) -> bool:
        """Take over what is now; False once the other twin is shown no more."""
        while True:
            before = int(self._shared["count"])
            if before == ENDED:
                return False
            record = self._shared.copy()
            if before % 2 == 0 and int(self._shared["count"]) == before:
                self._record = record
                return True

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._record["time"])

    def poses(self) -> list[Pose]:
        """Where the machine is."""
        return [pose_of_state(self._record["state"])]

    def forces(self) -> tuple[Floats, Floats]:
        """Contact points [m] and forces [N] of its tires, (1, 4, 3)."""
        state = self._twin.state.numpy()
        state[: len(State), 0] = self._record["state"]
        self._twin.state.assign(state)
        return self._forces.evaluate()

    def readings(self) -> list[dict[str, float]]:
        """Its outputs, SI."""
        return [dict(zip(CHANNELS, self._record["outputs"].astype(float).tolist(), strict=True))]


class MirrorPage:
    """A page in a process of its own for a twin of this one.

    Args:
        twin: One, whose state is published by :meth:`publish`.
        ground: How it feels its ground: ``"raster"`` or ``"mesh"``.
        path: To draw.
        port: On 127.0.0.1; 0: any free one.

    Raises ValueError if the page cannot be shown, with what its process said, and OSError if the port is taken.
    """

    def __init__(self, twin: Twin, *, ground: str = "raster", path: Path | None = None, port: int = 0):
        free_port(port)  # said at once, not when the page's process has come so far
        self._shared = SharedTwin(twin)
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        arguments = (self._shared.memory.name, twin.machine, twin.terrain, ground, path, port, there)
        self._process = context.Process(target=_show, args=arguments, daemon=True)
        self._process.start()
        there.close()
        try:
            said = here.recv()
        except EOFError:
            said = ValueError("the view's process ended before it had a page")
        except BaseException:  # Ctrl-C, while the page's process may compile
            self._process.kill()
            self.close()
            raise
        if isinstance(said, Exception):
            self.close()
            raise said
        self.address: str = said
        """Where a browser finds it."""

    def publish(self) -> None:
        """Let the page know what is now."""
        self._shared.publish()

    def close(self) -> None:
        """End the page and its process."""
        self._shared.close()
        self._process.join(timeout=10.0)
        if self._process.is_alive():
            self._process.kill()


def _show(
    name: str,
    machine: Machine,
    terrain: Plane | Terrain | Sequence[Terrain],
    ground: str,
    path: Path | None,
    port: int,
    told: Any,
) -> None:
    """The page's process: tells its address, or what is wrong, and shows the twin until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the twin's process says when it is over
    os.nice(NICENESS)
    parent = os.getppid()
    memory = SharedMemory(name)
    try:
        twin = Twin(1, machine=machine, terrain=terrain, ground=ground, threads=1)
        mirrored = MirroredTwin(memory, twin)
        page = TwinPage(start(port), mirrored, [machine])
        page.surround(terrain if isinstance(terrain, Plane | Terrain) else terrain[0], path)
        mirrored.forces()  # compiled now, once on a computer, not beside the first steps
    except (ValueError, OSError) as error:
        told.send(error)
        return
    told.send(page.address)
    while mirrored.look() and os.getppid() == parent:
        page.show(FRAME)
    page.close()
