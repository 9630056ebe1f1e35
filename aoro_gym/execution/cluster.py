"""Jobs on a Ray cluster, for where one machine is outgrown.

A job is a function of plain arguments. One whose process or node dies is begun again elsewhere: jobs either give their
result back, or keep files in a folder that all nodes share, from which they go on. Needs ``pip install 'aoro-gym[ray]'``,
the same version of the package on every node, and, where jobs read or write files, a file system that all of them see.
"""

from __future__ import annotations

import os
import socket
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from aoro_gym.execution.device_names import on_cpu

LOCAL = "local"
"""Instead of an address: a cluster of this computer alone, for as long as it is needed."""
REACHABLE = 10.0
"""Time [s] within which a cluster must answer."""
RETRIES = 8
"""How often a job whose process or node died is begun again."""


class ClusterError(RuntimeError):
    """A job on the cluster failed."""


@dataclass(frozen=True)
class Failed:
    """Why a job has no result."""

    reason: str
    """In a line."""
    trace: str = ""
    """Where in the code, if the job raised an exception."""


@contextmanager
def connected(address: str) -> Iterator[None]:
    """Connection to the cluster at ``address``: ``auto`` for the one that this computer belongs to, ``local``, or HOST:PORT;
    a connection that there is already stays.

    A cluster of this computer alone asks whoever connects for a token, which Ray makes (from its version 2.52 on, before
    it is imported); one that was started elsewhere does as ``RAY_AUTH_MODE`` said there.

    Raises ValueError if Ray is missing or there is no such cluster.
    """
    if address == LOCAL:
        os.environ.setdefault("RAY_AUTH_MODE", "token")
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(f"{error.name} is missing: pip install 'aoro-gym[ray]'") from error
    if ray.is_initialized():
        yield
        return
    try:
        host, colon, port = address.rpartition(":")
        if colon:  # Ray itself would wait for minutes
            socket.create_connection((host, int(port)), timeout=REACHABLE).close()
        ray.init(address=address, log_to_driver=False, include_dashboard=False if address == LOCAL else None)
    except (OSError, ValueError) as error:
        raise ValueError(f"no Ray cluster at {address!r}: {error}; start one with 'ray start --head'") from error
    try:
        yield
    finally:
        ray.shutdown()


def on_ray(
    work: Callable[..., Any], jobs: Mapping[str, tuple[Any, ...]], *, device: str = "cpu", cores: int = 1
) -> Iterator[tuple[str, Any]]:
    """Call ``work(*arguments)`` for every job on the cluster, and yield its name and its result as soon as it has ended, or
    :class:`Failed` if it raised an exception.

    Whatever ends the iteration cancels what is not done.

    Args:
        work: What to do; it and the arguments are sent to the nodes.
        jobs: Arguments by name, begun in this order.
        device: ``"cpu"``, or ``"cuda:0"``, which is each job's own GPU.
        cores: That a job occupies.
    """
    import ray  # pyright: ignore[reportMissingImports]
    from ray.exceptions import RayError  # pyright: ignore[reportMissingImports]

    remote = ray.remote(num_cpus=cores, num_gpus=0 if on_cpu(device) else 1, max_retries=RETRIES)(_done)
    shared = ray.put(work)
    names = {remote.remote(shared, *arguments): name for name, arguments in jobs.items()}
    try:
        while names:
            ended, _ = ray.wait(list(names))
            try:
                result = ray.get(ended[0])
            except RayError as error:
                result = Failed(f"it was begun {1 + RETRIES} times, and each time its process or node died: {error}")
            yield names.pop(ended[0]), result
    finally:
        for reference in names:
            ray.cancel(reference, force=True)


def _done(work: Callable[..., Any], *arguments: Any) -> Any:
    """What a node does."""
    try:
        return work(*arguments)
    except Exception as error:
        return Failed(f"{type(error).__name__}: {error}", traceback.format_exc())
