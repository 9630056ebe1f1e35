"""Host side of the twin: allocate, reset, step, watch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import numpy.typing as npt
import warp as wp

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.execution import devices
from aoro_gym.execution.device_names import SIMD
from aoro_gym.execution.launches import RecordedLaunch
from aoro_gym.machine.parameters import Machine
from aoro_gym.recording.commands import ALL_COMMAND_BOUNDS
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.raster import CELL
from aoro_gym.terrains.soil import Soil
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.forms import choose_roles
from aoro_gym.twin.grounds import Grounds
from aoro_gym.twin.hydraulic_step import check_hydraulic_step, warn_of_fine_step
from aoro_gym.twin.kernels import overwrite
from aoro_gym.twin.kernels.build import build
from aoro_gym.twin.kernels.laws import ChosenLaws, DefaultLaws
from aoro_gym.twin.kernels.roles import BLOCK_DIM as ROLES_BLOCK_DIM
from aoro_gym.twin.physics.ground import Planes, Rasters
from aoro_gym.twin.recorded import BLOCK_DIM, RecordedAdvance, cores
from aoro_gym.twin.records import (
    CHANNELS,
    COMMAND_BOUNDS,
    CRANE_OUTPUT_UNITS,
    NON_FINITE,
    RUTS_FULL,
    Command,
    CraneCommand,
    CraneRow,
    LoadRow,
    MachineRecord,
    Output,
    State,
    command_row,
    pack,
    row_of,
)
from aoro_gym.units import GRAVITY

if TYPE_CHECKING:
    from aoro_gym.machine.vehicle_crane import VehicleCrane
    from aoro_gym.terrains.world.world import World
    from aoro_gym.twin.frame_cranes import FrameCranes
    from aoro_gym.twin.soil_ruts import Ruts

LONGEST_COMMAND_DELAY = 0.1
"""Upper bound [s] of ``steering.valve.command_delay``; that much of the steering command is kept."""

KEPT_LAUNCHES = 16
"""Recorded launches that a twin keeps, one for each duration and sampling interval it is advanced by."""

STATE_ARRAYS = ("_machines", "state", "commands", "_history", "_clock", "_status", "_outputs")
"""What a twin's next steps depend on, beside its ground."""

STATUS = {int(NON_FINITE): "non-finite state"}
"""Reasons for which any twin is frozen, by status code (0: running)."""


class UnknownChannel(KeyError):
    """A trace has no channel of that name."""

    def __str__(self) -> str:
        return str(self.args[0])  # a KeyError's own text is quoted


@dataclass(frozen=True, eq=False)
class Trace(Mapping[str, npt.NDArray[np.float32]]):
    """Sampled outputs of one :meth:`Twin.step`: a mapping of channel names to arrays (frames, num_twins).

    SI units as in ``OUTPUT_UNITS``, ``OBJECT_OUTPUT_UNITS``, ``SOIL_OUTPUT_UNITS`` and ``CRANE_OUTPUT_UNITS``; a name that
    is not there raises a KeyError that lists the channels.
    """

    time: npt.NDArray[np.float64]
    """(frames,) [s]."""
    samples: npt.NDArray[Any]
    """All channels in their order, float32, (frames, channels, num_twins)."""
    channels: tuple[str, ...] = CHANNELS
    """Names of all channels."""

    def __getitem__(self, channel: str) -> npt.NDArray[np.float32]:
        try:
            return self.samples[:, _channel_row(self.channels, channel)]
        except ValueError as error:
            raise UnknownChannel(str(error)) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)

    # arrays have no one truth value: a trace is compared by identity
    __eq__ = object.__eq__
    __hash__ = object.__hash__  # pyright: ignore[reportAssignmentType]


class Twin:
    """Many copies of one articulated machine, advanced together.

    Every call of :meth:`step` is one launch of one kernel; nothing returns to Python in between.

    Args:
        num_twins: Copies to simulate, at least 1.
        machine: Name of a bundled machine, path of a machine file, or a :class:`Machine`; a machine whose values are
            arrays of length ``num_twins`` gives every twin its own.
        terrain: Ground; level asphalt by default. A plane whose values are arrays gives every twin its own; of several
            terrains, :meth:`reset` chooses. The stems, stumps, boulders and logs of a
            :class:`~aoro_gym.terrains.world.world.World` push back.
        ground: How twins feel a terrain: ``"raster"`` (fastest) or ``"mesh"`` (its very triangles, below overhangs), both as
            a plane that is averaged over the patch under a wheel; or ``"discs"``: each disc of a tire asks the triangles
            itself, for kerbs, ruts and ditches (:mod:`aoro_gym.twin.physics.tire_discs`). Planes are the same by either.
        cell: Distance of the raster's nodes [m].
        soil: What the ground is made of, where it is soft: a preset's name (:meth:`~aoro_gym.terrains.soil.Soil.named`) or a
            :class:`~aoro_gym.terrains.soil.Soil`; hard by default. Everywhere alike, on roads, too, and without solid
            objects.
        own_machines: Keep a machine record for every twin even if all start alike, so that :meth:`set_machines` can
            change them one by one.
        carry_load: Whether machines may have logs in their bunk, which takes another, slower kernel; by default whether the
            ``machine`` has.
        choose_laws: Whether machines may obey other laws than the default ones (:mod:`aoro_gym.machine.laws`), which takes
            another, slower kernel; by default whether the ``machine`` does.
        crane: Whether the front frame carries a crane whose joints move, or which and how
            (:class:`~aoro_gym.machine.vehicle_crane.VehicleCrane`): :attr:`crane`. Takes another, slower kernel. Without,
            the crane is a mass that is fast on the front frame, as in the published twin.
        device: ``"cpu"``, ``"cpu:simd"`` (several twins at once on a core, equal to rounding; needs a C++ compiler) or
            ``"cuda:N"``.
        threads: CPU threads that share the twins, at most :func:`cores`, which is the default; a GPU needs none.
        roles: Whether four warps of a GPU share 32 twins, a part of the machine each, instead of one thread a twin; by
            default where that was measured to be faster (:mod:`aoro_gym.twin.forms`): on planes and rasters, by the default
            laws. Not among solid objects, on soil, with a load that may be carried, a crane, or a driveline outside.
        main_step: Time step of the bodies [s].
        substeps: Hydraulic substeps a main step.
        gravity: [m/s²].
        check_step: Refuse a hydraulic step at which the circuits of a machine are unstable, and warn
            (:class:`~aoro_gym.twin.hydraulic_step.FineStepWarning`) of one so fine that rounding outweighs what it gains.
            Off for populations of a search, which are judged by their results.

    Raises:
        ValueError: a value is out of its bound; the message names it.
    """

    def __init__(
        self,
        num_twins: int = 1,
        *,
        machine: str | Path | Machine = "aoro",
        terrain: Plane | Terrain | World | Sequence[Terrain | World] | None = None,
        ground: str = "raster",
        cell: float = CELL,
        soil: str | Soil | None = None,
        own_machines: bool = False,
        carry_load: bool | None = None,
        choose_laws: bool | None = None,
        crane: VehicleCrane | bool = False,
        device: str = "cpu",
        threads: int | None = None,
        roles: bool | None = None,
        main_step: float = 1e-3,
        substeps: int = 30,
        gravity: float = GRAVITY,
        check_step: bool = True,
    ):
        check_integer("num_twins", num_twins)
        check_integer("substeps", substeps)
        if threads is not None:
            check_integer("threads", threads, le=cores(), note=", the cores here")
        check_range("main_step", main_step, "s", gt=0.0, le=2e-3, note=" for the contacts to be stable")
        check_finite("gravity", gravity, "m/s²")
        self.num_twins = int(num_twins)
        self.threads = cores() if threads is None else int(threads)
        self.machine = machine if isinstance(machine, Machine) else Machine.load(machine)
        self.terrain = terrain if terrain is not None else Plane()
        self.main_step = float(main_step)
        self.substeps = int(substeps)
        self.device = devices.find(device)
        self.simd = device == SIMD
        """Whether lanes of a CPU core advance several twins at once."""
        _check_count("the machine", self.machine.num_variants, self.num_twins)
        self._check_step = check_step
        self.soil = _checked_soil(soil, self.simd)
        """What the ground is made of; None where it is hard."""
        self._made = {"ground": ground, "cell": cell, "own_machines": own_machines, "choose_laws": choose_laws}
        self._made |= {"soil": self.soil, "gravity": gravity, "carry_load": carry_load, "roles": roles}
        self._vehicle_crane = self._checked_crane(crane)
        if check_step:
            check_hydraulic_step(self.machine, self.main_step, self.substeps)
            warn_of_fine_step(self.main_step, self.substeps, stacklevel=3)
        records = pack(self.machine)
        if own_machines:
            records = _repeated(records, self.num_twins)
        self._machines = wp.array(records, dtype=MachineRecord, device=self.device)
        self._grounds = Grounds(
            self.terrain, num_twins=self.num_twins, kind=ground, cell=cell, soil=self.soil, gravity=gravity,
            device=self.device,
        )  # fmt: skip
        self._chooses_laws = not self.machine.laws.default if choose_laws is None else choose_laws
        self.carries_load = self.has_crane or (self.machine.loaded if carry_load is None else carry_load)
        """Whether machines may have logs in their bunk; with a crane they may."""
        laws = ChosenLaws() if self._chooses_laws else DefaultLaws()
        self._build(laws, roles)
        self._felt = self._grounds.advancing
        of_crane = CRANE_OUTPUT_UNITS if self.has_crane else ()
        self.channels = (*CHANNELS, *self._grounds.further_outputs, *of_crane)
        """Names of the outputs, in the order of their rows."""

        self._allocate()
        self._laws = self.crane.with_laws(laws, self._machines) if self.has_crane else laws
        self._make_room(1)
        with devices.compiling(self._reset_kernel, self.device, BLOCK_DIM):
            self.reset()
        self._lanes = self._on_lanes() if self.simd else None
        self._checks_start = True

    def __repr__(self) -> str:
        return (
            f"Twin({self.num_twins}, machine={self.machine.name!r}, device={SIMD if self.simd else str(self.device)!r})"
        )

    def _build(self, laws: Any, roles: bool | None) -> None:
        """Choose the kernels, by roles if these are asked for, and compile what the first reset does not."""
        objects, soil = self._grounds.objects is not None, self._grounds.ruts is not None
        obstacles = {
            "have their wheels turned by a driveline outside": self._measured_hubs,
            "stand among solid objects": objects,
            "are on soil": soil,
            "may carry a load": self.carries_load,
            "carry a crane": self.has_crane,
        }
        obstacle = next((what for what, is_so in obstacles.items() if is_so), None)
        kind = type(self.ground)._cls
        as_measured = not self._chooses_laws and kind in (Planes, Rasters)
        self.by_roles = choose_roles(
            roles, self.num_twins, on_cuda=self.device.is_cuda, obstacle=obstacle, as_measured=as_measured
        )
        """Whether four warps of a GPU share 32 twins."""
        self._reset_kernel, self._advance_kernel = build(
            kind,
            type(laws)._cls,
            measured_hubs=self._measured_hubs,
            objects=objects,
            soil=soil,
            passes=self.soil is not None and self.soil.has_passes,
            load=self.carries_load,
            crane=self.has_crane,
            by_roles=self.by_roles,
        )
        if self.by_roles:
            with devices.compiling(self._advance_kernel, self.device, ROLES_BLOCK_DIM):
                wp.load_module(self._advance_kernel.module, device=self.device, block_dim=ROLES_BLOCK_DIM)

    def _allocate(self) -> None:
        """Make the arrays that no launch changes the length of."""
        n = self.num_twins
        rows = len(State) + self.carries_load * len(LoadRow)
        told = len(Command)
        if self.has_crane:
            rows, told = len(State) + len(LoadRow) + len(CraneRow), told + len(CraneCommand)
        self.state = wp.zeros((rows, n), dtype=float, device=self.device)
        self.commands = wp.zeros((told, n), dtype=float, device=self.device)
        if self._vehicle_crane is not None:
            from aoro_gym.twin.frame_cranes import FrameCranes  # few twins have one

            self._crane = FrameCranes(self._vehicle_crane, self.state, self.commands, gravity=self._made["gravity"])
        self._host_commands = self.commands.numpy() if self.device.is_cpu else None  # the same memory
        self._held = self.commands.reshape((1, *self.commands.shape))
        kept = int(np.ceil(LONGEST_COMMAND_DELAY / self.main_step)) + 2
        self._history = wp.zeros((kept, n), dtype=float, device=self.device)
        self._clock = wp.zeros(n, dtype=int, device=self.device)
        self._status = wp.zeros(n, dtype=int, device=self.device)
        seen = {"_clock": self._clock, "_status": self._status} if self.device.is_cpu else {}
        self._seen = {name: array.numpy() for name, array in seen.items()}  # the same memory, to be had at once
        self._mask = wp.ones(n, dtype=bool, device=self.device)
        self._pose = wp.zeros((4, n), dtype=float, device=self.device)
        self._numbers = wp.zeros(n, dtype=int, device=self.device)

    def _checked_crane(self, crane: VehicleCrane | bool) -> VehicleCrane | None:
        """The crane that is asked for; ValueError if these twins can have none, or not this one."""
        self._made["crane"] = crane
        if crane is False:
            return None
        if self.simd or self._measured_hubs:
            what = f"device is {SIMD!r}" if self.simd else "its wheels are turned from outside"
            raise ValueError(f"crane is given, but {what}, where twins have none yet; leave crane out")
        from aoro_gym.machine.vehicle_crane import VehicleCrane

        one = VehicleCrane() if crane is True else crane
        one.check_fits(self.machine)
        return one

    @property
    def has_crane(self) -> bool:
        """Whether the front frame carries a crane whose joints move."""
        return self._vehicle_crane is not None

    @property
    def crane(self) -> FrameCranes:
        """Its cranes; ValueError if it has none."""
        if self._crane is None:
            raise ValueError("these twins have no crane; construct them with crane=True")
        return self._crane

    state: wp.array
    """State rows (see :class:`State`; :class:`LoadRow` if :attr:`carries_load`) × twins, float32, on the device."""
    commands: wp.array
    """Command rows (see :class:`Command`) × twins, float32, on the device."""
    _checks_start = False
    """Whether a reset refuses places in objects: not that of the constructor, which nobody chose."""
    _crane: FrameCranes | None = None
    _measured_hubs = False
    """Whether a driveline outside turns the wheels."""

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy goes on from the same state, to the bit; on another computer it needs the same device."""
        made = {
            **self._made,
            "num_twins": self.num_twins,
            "machine": self.machine,
            "terrain": self.terrain,
            "device": SIMD if self.simd else self.device.alias,
            "main_step": self.main_step,
            "substeps": self.substeps,
        }
        state = {name: getattr(self, name).numpy().copy() for name in STATE_ARRAYS}
        return _restored, (type(self), made, self._check_step, self.threads, state, self._grounds.standing())

    @property
    def machines(self) -> wp.array:
        """Records of the machines on the device: one for all twins, or one a twin."""
        return self._machines

    @property
    def ground(self) -> Any:
        """What the twins stand on, on the device: the ``terrain`` of :func:`aoro_gym.twin.physics.ground.footing`."""
        return self._grounds.device_struct

    def reset(
        self,
        mask: npt.ArrayLike | None = None,
        *,
        position: npt.ArrayLike = (0.0, 0.0),
        heading: npt.ArrayLike = 0.0,
        joint_angle: npt.ArrayLike = 0.0,
        terrain: npt.ArrayLike | None = None,
    ) -> None:
        """Put twins at rest on the ground with idle circuits and all commands at their initial values.

        On a terrain the frames lie as the ground under the four wheels does, and every arm swings until its wheel bears
        its share; over a pit deeper than the arm's swing it hangs.

        Args:
            mask: Which twins, booleans of shape (num_twins,); all by default.
            position: Plan position of the hinge [m], shape (2,) or (num_twins, 2).
            heading: Heading of the front frame [rad], scalar or (num_twins,).
            joint_angle: Joint angle [rad], positive left, scalar or (num_twins,).
            terrain: Which of the terrains each twin stands on, whole numbers, scalar or (num_twins,); by default where it
                stood.

        Raises:
            ValueError: a value has the wrong shape, is out of its bound, or puts a twin into an object of its world, where
                it stands all the same.
        """
        n = self.num_twins
        chosen = np.ones(n, dtype=bool) if mask is None else np.asarray(mask)
        if chosen.shape != (n,) or chosen.dtype != bool:
            raise ValueError(f"mask has shape {chosen.shape} and type {chosen.dtype}, but must be ({n},) of bool")
        pose, numbers = self.checked_start(n, position, heading, joint_angle, terrain)
        self._mask.assign(chosen)
        self._numbers.assign(numbers)
        self._pose.assign(pose)
        self.reset_marked()
        if self._grounds.objects is not None and self._checks_start:
            self._grounds.objects.check_start(self._machines, self.state, chosen)

    def checked_start(
        self,
        count: int,
        position: npt.ArrayLike,
        heading: npt.ArrayLike,
        joint_angle: npt.ArrayLike,
        terrain: npt.ArrayLike | None,
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """What :meth:`reset` makes of its arguments for ``count`` twins K: poses (4, K), and numbers of terrains (K,), −1
        where they stay.

        Args:
            count: K.
            position: See :meth:`reset`, with K in place of num_twins.
            heading: Likewise.
            joint_angle: Likewise.
            terrain: Likewise.

        Raises:
            ValueError: a value is out of its bound; the message names it.
        """
        n = count
        pose = np.empty((4, n), dtype=np.float32)
        try:
            pose[:2] = np.broadcast_to(np.asarray(position, dtype=np.float64), (n, 2)).T
            pose[2] = np.broadcast_to(np.asarray(heading, dtype=np.float64), n)
            pose[3] = np.broadcast_to(np.asarray(joint_angle, dtype=np.float64), n)
        except ValueError as error:
            raise ValueError(
                f"position, heading and joint_angle must broadcast to ({n}, 2), ({n},) and ({n},): {error}"
            ) from error
        for name, values in (("position", pose[:2].T), ("heading", pose[2]), ("joint_angle", pose[3])):
            check_finite(name, values)
        limit = np.max(self.machine.joint.range)
        if np.any(np.abs(pose[3]) > limit + 1e-6):
            worst = pose[3][np.argmax(np.abs(pose[3]))]
            raise ValueError(
                f"joint_angle is {worst:.4f} rad, but the joint reaches only ±{limit:.4f} rad (joint.range)"
            )
        numbers = np.full(n, -1, dtype=np.int32)
        if terrain is not None:
            asked = np.asarray(terrain)
            if asked.shape not in ((), (n,)) or not np.issubdtype(asked.dtype, np.integer):
                raise ValueError(
                    f"terrain has shape {asked.shape} and type {asked.dtype}, but must be ({n},) of integers"
                )
            if not self._grounds.count:
                raise ValueError(
                    "terrain is given, but these twins stand on a plane; construct them with terrains to choose from"
                )
            check_range("terrain", asked, ge=0, le=self._grounds.count - 1)
            numbers[:] = asked
        return pose, numbers

    @property
    def start_memory(self) -> tuple[wp.array, wp.array, wp.array]:
        """On the device, for :meth:`reset_marked`: which twins, bool; their poses (4, num_twins), float32; their terrains,
        int32, as :meth:`checked_start` has them."""
        return self._mask, self._pose, self._numbers

    def reset_marked(self) -> None:
        """What :meth:`reset` does, to the twins that :attr:`start_memory` marks, by what it holds of them, unchecked."""
        inputs = self._reset_inputs()
        wp.launch(self._reset_kernel, self.num_twins, inputs, device=self.device, block_dim=BLOCK_DIM)
        if self._crane is not None:
            self._crane.start(self._mask)
        if self._grounds.objects is not None:
            self._grounds.objects.clear(self._mask, self._numbers)
        if self._grounds.ruts is not None:
            self._grounds.ruts.start(self._machines, self._mask, self.state)

    def _reset_inputs(self) -> list[Any]:
        return [
            self._machines, self.ground, self._mask, self._pose, self._numbers, self.state, self.commands, self._history,
            self._clock, self._status,
        ]  # fmt: skip

    @property
    def resets_in_one_launch(self) -> bool:
        """Whether :meth:`recorded_reset` is all of a reset: without a crane, solid objects and soil."""
        return self._crane is None and self._grounds.objects is None and self._grounds.ruts is None

    def recorded_reset(self) -> RecordedLaunch:
        """The launch of :meth:`reset_marked`, to be repeated; see :attr:`resets_in_one_launch`."""
        inputs = self._reset_inputs()
        return RecordedLaunch(self._reset_kernel, self.num_twins, inputs, device=self.device, block_dim=BLOCK_DIM)

    @property
    def machine_words(self) -> wp.array:
        """The memory of :attr:`machines` as whole numbers of 4 bytes (records, words), for what writes them itself."""
        records: Any = self._machines
        shape = records.shape[0], records.strides[0] // 4
        return wp.array(ptr=records.ptr, shape=shape, dtype=int, device=self.device)

    @property
    def load_slide(self) -> npt.NDArray[np.float32]:
        """How far the logs have slid from the middle of their bunk [m], forward positive, shape (num_twins,)."""
        if not self.carries_load:
            return np.zeros(self.num_twins, dtype=np.float32)
        slide, rate = (self.state[int(row)].numpy() for row in (LoadRow.LOAD_SLIDE, LoadRow.LOAD_RATE))
        return slide + np.float32(0.5 * self.main_step) * rate  # it belongs to the middle of the last step

    @property
    def has_objects(self) -> bool:
        """Whether any of its grounds is a world, whose objects are solid: :meth:`reset` looks where twins would stand."""
        return self._grounds.objects is not None

    def set_commands(self, commands: Mapping[str, npt.ArrayLike]) -> None:
        """Set commands by name, each a scalar or of shape (num_twins,); the others keep their last value.

        Raises:
            ValueError: unknown name, wrong shape, not finite or out of its bounds (``COMMAND_BOUNDS``).
        """
        if self._host_commands is not None and _plain(commands):
            for name, value in commands.items():
                self._host_commands[_PLAIN[name][0]] = value
            return
        rows: dict[int, npt.NDArray[np.float32]] = {}
        for name, value in commands.items():
            row = command_row(name) if self.has_crane else row_of(Command, name, "command")
            low, high, _ = ALL_COMMAND_BOUNDS[name]
            array = np.asarray(value, dtype=np.float32)
            if array.shape not in ((), (self.num_twins,)):
                raise ValueError(f"{name} has shape {array.shape}, but must be a scalar or ({self.num_twins},)")
            check_range(name, array, ge=low, le=high)
            if name == "gear" and np.any(array != np.round(array)):
                wrong = array if array.ndim == 0 else array[array != np.round(array)][0]
                raise ValueError(f"gear is {wrong}, but must be one of 1, 2, 3")
            rows[row] = np.broadcast_to(array, self.num_twins)
        for row, array in rows.items():
            if self._host_commands is not None:
                self._host_commands[row] = array
            else:
                self.commands[row].assign(np.ascontiguousarray(array))

    @overload
    def step(
        self, commands: Mapping[str, npt.ArrayLike] | None = None, duration: float = 0.02, *, sample_every: float
    ) -> Trace: ...

    @overload
    def step(
        self, commands: Mapping[str, npt.ArrayLike] | None = None, duration: float = 0.02, *, sample_every: None = None
    ) -> None: ...

    @overload
    def step(
        self,
        commands: Mapping[str, npt.ArrayLike] | None = None,
        duration: float = 0.02,
        *,
        sample_every: float | None = None,
    ) -> Trace | None: ...

    def step(
        self,
        commands: Mapping[str, npt.ArrayLike] | None = None,
        duration: float = 0.02,
        *,
        sample_every: float | None = None,
    ) -> Trace | None:
        """Advance all twins by ``duration`` [s] in one launch.

        Args:
            commands: See :meth:`set_commands`; constant over the step.
            duration: A whole number of main steps [s].
            sample_every: Sampling interval of the returned trace [s], a whole number of main steps; no trace if None.

        Returns:
            The sampled outputs, if asked for; the last sample is also what :meth:`output` gives.
        """
        if commands:
            self.set_commands(commands)
        start = None if sample_every is None else self.time.max()
        self.advance(duration, sample_every=sample_every)
        if start is None or sample_every is None:
            return None
        samples = self._on_host("_outputs").copy()
        time = start + sample_every * np.arange(1, len(samples) + 1)
        return Trace(time=time, samples=samples, channels=self.channels)

    def advance(self, duration: float = 0.02, *, sample_every: float | None = None) -> None:
        """Advance all twins under the commands that :attr:`commands` holds, unchecked, and copy nothing to the host.

        Args:
            duration: A whole number of main steps [s].
            sample_every: Sampling interval of :attr:`outputs` [s], a whole number of main steps; only the end if None.
        """
        recorded = self._recorded.get((duration, sample_every))
        if recorded is None:
            recorded = self._record(self._held, *self._frames(duration, sample_every))
            if len(self._recorded) >= KEPT_LAUNCHES:
                self._recorded.clear()
            self._recorded[duration, sample_every] = recorded
        recorded(0, self.num_twins, self.threads)

    def advancing(
        self, duration: float = 0.02, *, sample_every: float | None = None, commands: wp.array | None = None
    ) -> Callable[[int, int], None]:
        """What :meth:`advance` does, to the twins from one number up to another, to be called many times: a launch that was
        recorded is told faster than all anew. Valid until anything but the state and the commands of the twins is replaced.

        Args:
            duration: See :meth:`advance`.
            sample_every: See :meth:`advance`.
            commands: Sets × command rows × twins, float32, on the device: each set is held for an equal number of samples;
                :attr:`commands` by default.
        """
        frames, every = self._frames(duration, sample_every)
        told = self._held if commands is None else commands
        if frames % len(told):
            raise ValueError(f"{len(told)} sets of commands cannot share {frames} samples equally")
        recorded = self._record(told, frames, every)
        return lambda first, last: recorded(first, last, self.threads)

    def _frames(self, duration: float, sample_every: float | None) -> tuple[int, int]:
        """Number of samples, for which there is room then, and main steps a sample."""
        steps = self._whole(duration, "duration")
        every = steps if sample_every is None else self._whole(sample_every, "sample_every")
        if steps % every:
            raise ValueError(
                f"duration is {duration} s, but must be a whole multiple of sample_every = {sample_every} s"
            )
        frames = steps // every
        if self._outputs.shape[0] != frames:
            self._make_room(frames)
        return frames, every

    def _make_room(self, frames: int) -> None:
        """Make outputs of so many samples; launches are not of them yet."""
        self._outputs = wp.zeros((frames, len(self.channels), self.num_twins), dtype=float, device=self.device)
        if self.device.is_cpu:
            self._seen["_outputs"] = self._outputs.numpy()
        self._recorded: dict[tuple[float, float | None], RecordedAdvance] = {}

    def _on_host(self, name: str) -> npt.NDArray[Any]:
        """The values of ``_outputs``, ``_clock`` or ``_status``."""
        seen = self._seen.get(name)
        return getattr(self, name).numpy() if seen is None else seen

    def _record(self, commands: wp.array, frames: int, every: int) -> RecordedAdvance:
        """The launch of ``frames`` times ``every`` main steps."""
        inputs = [
            self._machines, self._laws, self._felt, commands, self.state, self._history, self._clock, self._status,
            self._outputs, 0, frames, every, self.substeps, self.main_step,
        ]  # fmt: skip
        return RecordedAdvance(
            self._advance_kernel, inputs, steps=frames * every, device=self.device, lanes=self._lanes,
            by_roles=self.by_roles,
        )  # fmt: skip

    def _on_lanes(self) -> Any:
        from aoro_gym.execution.lanes import compiled  # few ask for it

        return compiled(self._advance_kernel, self.device, BLOCK_DIM, devices.say)

    def _whole(self, seconds: float, name: str) -> int:
        steps = round(seconds / self.main_step) if np.isfinite(seconds) else 0
        if steps < 1 or abs(steps * self.main_step - seconds) > 1e-6 * self.main_step * steps:
            raise ValueError(
                f"{name} is {seconds} s, but must be a positive whole multiple of the main step {self.main_step} s"
            )
        return steps

    def take_up(self, other: Twin, indices: npt.NDArray[np.intp]) -> None:
        """Go on from where twins of ``other`` are, with the machines that these twins have: each may take up the same one.

        Args:
            other: Twins on the same grounds, on any device.
            indices: Which of them each twin takes up, integers (num_twins,).
        """
        frames = other._outputs.shape[0]
        if self._outputs.shape[0] != frames:
            self._make_room(frames)
        numbers = wp.array(indices, dtype=int, device=self.device)
        for name in STATE_ARRAYS:
            if name != "_machines":
                source, mine = getattr(other, name), getattr(self, name)
                if other.device == self.device:  # nothing comes to the host
                    taken: Any = wp.indexedarray(source, [None] * (source.ndim - 1) + [numbers])
                    wp.copy(mine, taken)
                else:
                    mine.assign(np.take(source.numpy(), indices, axis=-1))
        standing = other._grounds.standing()
        self._grounds.stand({name: np.take(values, indices, axis=-1) for name, values in standing.items()})

    @property
    def outputs(self) -> wp.array:
        """Sampled outputs of the last step on the device: frames × :attr:`channels` × twins, float32.

        Valid until the next step; the last frame is the end of the step.
        """
        return self._outputs

    def set_ground(
        self,
        indices: npt.ArrayLike,
        *,
        friction: npt.ArrayLike | None = None,
        rolling_resistance: npt.ArrayLike | None = None,
    ) -> None:
        """Change the grip of the ground for some twins; it stays so over resets and terrains.

        Args:
            indices: Which twins, integers of shape (K,).
            friction: Multiplier of the tires' friction in [0.01, 2], scalar or (K,); on a terrain, on top of its own.
            rolling_resistance: Multiplier of the tires' rolling resistance in [0, 50], likewise.

        Raises:
            ValueError: an index or a value is out of its bound; the message names it.
        """
        self._grounds.set_multipliers(self._chosen(indices), friction, rolling_resistance)

    def _chosen(self, indices: npt.ArrayLike) -> npt.NDArray[np.int32]:
        chosen = np.atleast_1d(np.asarray(indices, dtype=np.int32))
        check_range("indices", chosen, ge=0, le=self.num_twins - 1)
        return chosen

    def set_machines(self, indices: npt.ArrayLike, machine: Machine) -> None:
        """Give some twins other machines; takes effect at their next reset or step, reset them first.

        Args:
            indices: Which twins, integers of shape (K,).
            machine: One machine for all of them, or K variants.

        Raises:
            ValueError: this twin shares one machine between all copies, the numbers disagree, a machine has a load that
                these twins cannot carry, its front frame is too light for their crane, or its circuits are unstable at
                the twin's hydraulic step.
        """
        if self._machines.shape[0] != self.num_twins:
            raise ValueError(
                "these twins share one machine record; construct them with own_machines=True to change it one by one"
            )
        if not machine.laws.default and not self._chooses_laws:
            raise ValueError(
                "these twins obey the default laws alone; construct them with choose_laws=True to give them others"
            )
        chosen = self._chosen(indices)
        self.set_records(chosen, self.checked_records(chosen, machine))

    def checked_records(self, chosen: npt.NDArray[np.int32], machine: Machine) -> npt.NDArray[Any]:
        """Records (K,) of ``machine`` for the twins ``chosen`` (K,), for :meth:`set_records`; raises as
        :meth:`set_machines` does."""
        if machine.loaded and not self.carries_load:
            raise ValueError(
                "these twins carry no load; construct them with a machine that has logs in its bunk, or with carry_load=True"
            )
        _check_count("the machine", machine.num_variants, max(len(chosen), 1))
        if self._vehicle_crane is not None:
            self._vehicle_crane.check_fits(machine, chosen)
        if self._check_step:
            check_hydraulic_step(machine, self.main_step, self.substeps, numbers=chosen)
        return _repeated(pack(machine), len(chosen))

    def set_records(self, chosen: npt.NDArray[np.int32], records: npt.NDArray[Any]) -> None:
        """Give the twins ``chosen`` (K,) the records (K,) that :meth:`checked_records` made."""
        wp.launch(
            overwrite.exchange,
            dim=len(chosen),
            inputs=[
                wp.array(records, dtype=MachineRecord, device=self.device),
                wp.array(chosen, dtype=int, device=self.device),
                self._machines,
            ],
            device=self.device,
        )

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Time since the last reset [s], shape (num_twins,)."""
        return self._on_host("_clock") * self.main_step

    def output(self, channel: str) -> npt.NDArray[np.float32]:
        """Last value of an output channel, SI, shape (num_twins,); zero before the first step."""
        return self._on_host("_outputs")[-1, _channel_row(self.channels, channel)]

    @property
    def status(self) -> npt.NDArray[Any]:
        """Status of every twin, shape (num_twins,): 0 runs, else frozen (see ``STATUS``)."""
        return self._on_host("_status")

    @property
    def status_codes(self) -> wp.array:
        """The same on the device, int32."""
        return self._status

    @property
    def diverged(self) -> list[tuple[int, str]]:
        """Index and reason of every frozen twin; a reset revives it."""
        status, reasons = self.status, self.status_reasons
        return [(int(i), reasons[int(status[i])]) for i in np.flatnonzero(status)]

    @property
    def status_reasons(self) -> dict[int, str]:
        """Reasons for which these twins can be frozen, by status code: those of ``STATUS``, and on soil that the memory of
        ruts is full."""
        ruts = self._grounds.ruts
        return STATUS if ruts is None else {**STATUS, int(RUTS_FULL): ruts.full}

    def rut_raster(self, twin: int = 0) -> Ruts:
        """The ruts of one twin since its last reset; ValueError if its ground is hard."""
        if self._grounds.ruts is None:
            raise ValueError("the ground of these twins is hard; construct them with soil= to have ruts")
        check_integer("twin", twin, ge=0, le=self.num_twins - 1)
        return self._grounds.ruts.raster(self._machines, int(twin))


def _restored(
    kind: type[Twin],
    made: Mapping[str, Any],
    check_step: bool,
    threads: int,
    state: Mapping[str, npt.NDArray[Any]],
    standing: Mapping[str, npt.NDArray[Any]],
) -> Twin:
    """The twin that was made so, in the state that it was in."""
    twin = kind(**made, threads=min(threads, cores()), check_step=False)  # it was checked when it was made
    twin._check_step = check_step
    twin._make_room(len(state["_outputs"]))
    for name, values in state.items():
        array = getattr(twin, name)
        wp.copy(array, wp.array(values, dtype=array.dtype, device=twin.device))
    twin._grounds.stand(standing)
    return twin


def _checked_soil(soil: str | Soil | None, simd: bool) -> Soil | None:
    """The soil of a twin, from its name; ValueError on lanes of a core."""
    if simd and soil is not None:
        raise ValueError(f"device is {SIMD!r}, but lanes cannot run twins on soil; take device='cpu'")
    return Soil.named(soil) if isinstance(soil, str) else soil


def _channel_row(channels: tuple[str, ...], name: Any) -> int:
    """Row of a channel; ValueError that lists all if there is none such."""
    return channels.index(name) if name in channels[len(CHANNELS) :] else row_of(Output, name, "output")


_PLAIN = {
    name: (int(Command[name.upper()]), low, high) for name, (low, high, _) in COMMAND_BOUNDS.items() if name != "gear"
}
"""Row and bounds of the commands that may be any number within them."""


def _plain(commands: Mapping[str, Any]) -> bool:
    """Whether all are numbers of Python's within their bounds, which is most of what takes a while to check of arrays."""
    for name, value in commands.items():
        if type(value) not in (float, int) or name not in _PLAIN:
            return False
        _, low, high = _PLAIN[name]
        if not low <= value <= high:
            return False
    return True


def _repeated(records: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    """Records (count,), again and again those there are (``np.resize`` takes a millisecond for each)."""
    return records[np.arange(count) % len(records)]


def _check_count(what: str, count: int, num_twins: int) -> None:
    if count not in (1, num_twins):
        raise ValueError(f"{what} has {count} variants, but must have 1 or num_twins = {num_twins}")
