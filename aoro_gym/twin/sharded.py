"""Twins on several devices at once.

Each device has a share of the twins as a :class:`~aoro_gym.twin.twin.Twin` of its own, with a copy of the ground. A step
is a launch on each, one after the other and without waiting, so that GPUs work at once; the host waits only where values
are asked for. No twin knows of another, so they move as those of one device do: to the bit where the devices are alike
and their shares run in the same kernel, to rounding else (few twins take another one on ``"cpu:simd"``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aoro_gym.checks import check_integer, check_range
from aoro_gym.execution import devices
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.soil import Soil
from aoro_gym.twin.hydraulic_step import check_hydraulic_step, warn_of_fine_step
from aoro_gym.twin.twin import Trace, Twin

if TYPE_CHECKING:
    from aoro_gym.terrains.terrain import Terrain
    from aoro_gym.terrains.world.world import World


class ShardedTwins:
    """Many copies of one articulated machine, advanced together on several devices.

    >>> from aoro_gym.twin.sharded import ShardedTwins
    >>> twins = ShardedTwins(5, device="cpu,cpu")  # on a computer with GPUs: device="cuda:all"
    >>> twins.step({"steering_signal": [0.1, 0.2, 0.3, 0.4, 0.5]}, duration=0.5)
    >>> twins.output("joint_angle").shape
    (5,)

    Args:
        num_twins: Copies to simulate, at least one a device; dealt out in their order, as equally as may be.
        device: Devices with commas between them, or ``"cuda:all"``, see :func:`aoro_gym.execution.devices.several`.
        machine: See :class:`~aoro_gym.twin.twin.Twin`; variants are dealt out with the twins.
        terrain: Likewise, with the values of a plane.
        soil: Likewise.
        check_step: Likewise.
        others: The other arguments of :class:`~aoro_gym.twin.twin.Twin`.

    Raises:
        ValueError: there is no such device, there are more devices than twins, or as :class:`~aoro_gym.twin.twin.Twin` does.
    """

    def __init__(
        self,
        num_twins: int,
        *,
        device: str = "cuda:all",
        machine: str | Path | Machine = "aoro",
        terrain: Plane | Terrain | World | Sequence[Terrain | World] | None = None,
        soil: str | Soil | None = None,
        check_step: bool = True,
        **others: Any,
    ):
        check_integer("num_twins", num_twins)
        self.devices = devices.several(device)
        """Their names."""
        self.num_twins = int(num_twins)
        self.spans = _spans(self.num_twins, self.devices)
        """Which twins each device has, one after the other."""
        machine = machine if isinstance(machine, Machine) else Machine.load(machine)
        self._check_count("the machine", machine.num_variants)
        soil = Soil.named(soil) if isinstance(soil, str) else soil
        # every shard in the kernel that all would run in together
        if others.get("carry_load") is None:
            others["carry_load"] = machine.loaded
        if others.get("choose_laws") is None:
            others["choose_laws"] = not machine.laws.default
        self.shards = tuple(
            Twin(
                span.stop - span.start,
                device=name,
                machine=machine.variants(np.arange(span.start, span.stop)),
                terrain=self._share_of(terrain, span) if isinstance(terrain, Plane) else terrain,
                soil=None if soil is None else self._share_of(soil, span),
                check_step=False,
                **others,
            )
            for name, span in zip(self.devices, self.spans, strict=True)
        )
        """The twins of each device. Their :attr:`~aoro_gym.twin.twin.Twin.commands` and outputs are memory of the device."""

        self._steps = self.shards[0].main_step, self.shards[0].substeps
        self._check_step = check_step
        if check_step:
            check_hydraulic_step(machine, *self._steps)
            warn_of_fine_step(*self._steps, stacklevel=3)

    def _check_count(self, what: str, count: int) -> None:
        if count not in (1, self.num_twins):
            raise ValueError(f"{what} has {count} variants, but must have 1 or num_twins = {self.num_twins}")

    def _share_of(self, values: Any, span: slice) -> Any:
        """A :class:`Plane` or :class:`Soil` with the values of the twins ``span``."""
        found = {entry.name: getattr(values, entry.name) for entry in fields(values) if entry.init}
        for name, value in found.items():
            if isinstance(value, np.ndarray):
                self._check_count(f"{type(values).__name__.lower()} {name}", len(value))
                found[name] = value if len(value) == 1 else value[span]
        return type(values)(**found)

    def _dealt(self, name: str, values: Any, last: tuple[int, ...] = ()) -> list[Any]:
        """``values`` of shape ``last`` for all twins, or (num_twins, *last), for each shard."""
        if values is None:
            return [None] * len(self.shards)
        array = np.asarray(values)
        if array.shape == last:
            return [values] * len(self.shards)
        if array.shape != (self.num_twins, *last):
            wanted = ", ".join(map(str, (self.num_twins, *last)))
            raise ValueError(f"{name} has shape {array.shape}, but must be {last or 'a scalar'} or ({wanted})")
        return [array[span] for span in self.spans]

    def reset(
        self,
        mask: npt.ArrayLike | None = None,
        *,
        position: npt.ArrayLike = (0.0, 0.0),
        heading: npt.ArrayLike = 0.0,
        joint_angle: npt.ArrayLike = 0.0,
        terrain: npt.ArrayLike | None = None,
    ) -> None:
        """Put twins at rest on the ground; arguments and errors as of :meth:`aoro_gym.twin.twin.Twin.reset`.

        Args:
            mask: Which twins, booleans of shape (num_twins,); all by default.
            position: Plan position of the hinge [m], shape (2,) or (num_twins, 2).
            heading: Heading of the front frame [rad], scalar or (num_twins,).
            joint_angle: Joint angle [rad], positive left, scalar or (num_twins,).
            terrain: Which of the terrains each twin stands on, whole numbers, scalar or (num_twins,).
        """
        for shard, chosen, at, course, angle, ground in zip(
            self.shards,
            self._dealt("mask", mask),
            self._dealt("position", position, (2,)),
            self._dealt("heading", heading),
            self._dealt("joint_angle", joint_angle),
            self._dealt("terrain", terrain),
            strict=True,
        ):
            shard.reset(chosen, position=at, heading=course, joint_angle=angle, terrain=ground)

    def set_commands(self, commands: Mapping[str, npt.ArrayLike]) -> None:
        """Set commands by name, each a scalar or of shape (num_twins,), as :meth:`aoro_gym.twin.twin.Twin.set_commands`."""
        parts = {name: self._dealt(name, values) for name, values in commands.items()}
        for number, shard in enumerate(self.shards):
            shard.set_commands({name: values[number] for name, values in parts.items()})

    def advance(self, duration: float = 0.02, *, sample_every: float | None = None) -> None:
        """Advance all twins under the commands that :attr:`commands` hold, on all devices at once, and wait for none; see
        :meth:`aoro_gym.twin.twin.Twin.advance`."""
        for shard in sorted(self.shards, key=lambda shard: shard.device.is_cpu):  # which is waited for
            shard.advance(duration, sample_every=sample_every)

    def step(
        self,
        commands: Mapping[str, npt.ArrayLike] | None = None,
        duration: float = 0.02,
        *,
        sample_every: float | None = None,
    ) -> Trace | None:
        """Advance all twins by ``duration`` [s]; arguments and result as of :meth:`aoro_gym.twin.twin.Twin.step`."""
        if commands:
            self.set_commands(commands)
        start = None if sample_every is None else float(self.time.max())
        self.advance(duration, sample_every=sample_every)
        if start is None or sample_every is None:
            return None
        samples = np.concatenate([shard.outputs.numpy() for shard in self.shards], axis=-1)
        time = np.asarray(start + sample_every * np.arange(1, len(samples) + 1), dtype=np.float64)
        return Trace(time=time, samples=samples, channels=self.channels)

    def synchronize(self) -> None:
        """Wait until every device has done what it was told."""
        for shard in self.shards:
            wp.synchronize_device(shard.device)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the outputs, in the order of their rows."""
        return self.shards[0].channels

    @property
    def commands(self) -> list[wp.array]:
        """Of each shard: command rows × twins, float32, on its device; what is written there holds from the next step on."""
        return [shard.commands for shard in self.shards]

    @property
    def outputs(self) -> list[wp.array]:
        """Of each shard: frames × :attr:`channels` × twins of the last step, float32, on its device, until the next one."""
        return [shard.outputs for shard in self.shards]

    def output(self, channel: str) -> npt.NDArray[np.float32]:
        """Last value of an output channel, SI, shape (num_twins,); zero before the first step."""
        return np.concatenate([shard.output(channel) for shard in self.shards])

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Time since the last reset [s], shape (num_twins,)."""
        return np.concatenate([shard.time for shard in self.shards])

    @property
    def status(self) -> npt.NDArray[Any]:
        """Status of every twin, shape (num_twins,): 0 runs, else frozen (see ``STATUS``)."""
        return np.concatenate([shard.status for shard in self.shards])

    @property
    def status_reasons(self) -> dict[int, str]:
        """See :attr:`aoro_gym.twin.twin.Twin.status_reasons`."""
        return self.shards[0].status_reasons

    @property
    def diverged(self) -> list[tuple[int, str]]:
        """Index and reason of every frozen twin; a reset revives it."""
        return [
            (span.start + index, reason)
            for shard, span in zip(self.shards, self.spans, strict=True)
            for index, reason in shard.diverged
        ]

    def set_machines(self, indices: npt.ArrayLike, machine: Machine) -> None:
        """Give some twins other machines, as :meth:`aoro_gym.twin.twin.Twin.set_machines`.

        Args:
            indices: Which twins, integers of shape (K,).
            machine: One machine for all of them, or K variants.
        """
        chosen = np.atleast_1d(np.asarray(indices))
        check_range("indices", chosen, ge=0, le=self.num_twins - 1)
        if machine.num_variants not in (1, len(chosen)):
            raise ValueError(f"the machine has {machine.num_variants} variants, but must have 1 or {len(chosen)}")
        if self._check_step:
            check_hydraulic_step(machine, *self._steps, numbers=chosen)
        for shard, span in zip(self.shards, self.spans, strict=True):
            rows = np.flatnonzero((chosen >= span.start) & (chosen < span.stop))
            if len(rows):
                shard.set_machines(chosen[rows] - span.start, machine.variants(rows))


def _spans(count: int, names: Sequence[str]) -> list[slice]:
    """Which of ``count`` twins each device has; ValueError if one had none."""
    number = len(names)
    if number > count:
        raise ValueError(
            f"device is {','.join(names)}, {number} devices, but there are {count} twins; name {count} devices at most"
        )
    ends = [count * k // number for k in range(number + 1)]
    return [slice(begin, end) for begin, end in pairwise(ends)]
