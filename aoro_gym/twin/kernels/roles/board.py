"""The board of a block: what its warps tell each other, in shared memory; and the barriers at which they wait.

A block of 128 threads has four warps, and each of them one thread for each of the block's 32 twins. The board has a row a
quantity and a column a twin: first the rows of the state (:class:`~aoro_gym.twin.records.State`), then those of
:class:`Board`. Beside it lie the twins' machine records, from where each warp takes what it needs when it needs it, so that
registers hold little of them.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.recording.commands import WHEELS
from aoro_gym.twin.kernels.roles import BLOCK_DIM, TWINS
from aoro_gym.twin.records import MachineRecord, State


def _each(name: str) -> list[str]:
    return [f"{name}_{wheel}" for wheel in WHEELS]


LOAD_ROWS = wp.constant(8)
"""Of one corner's load: torques of arm and wheel, force, moment."""
HULL_ROWS = wp.constant(7)
"""Of what the ground does to a half of a frame's corners: force, moment, and the sum of the forces' magnitudes."""

_NAMES = (
    # whether the twin runs, 1 or 0
    "alive",
    # in the middle of the main step: joint and arms [rad]; motors [m³/rad]; at its start: wheels against arms [rad/s]
    *("middle_joint", *_each("middle_arm"), "motor_front", "motor_rear", *_each("wheel_rate")),
    # all that turns the joint [N m]
    "joint_torque",
    # what the ground does to wheels and arms, and to the frames' corners
    *(f"load_{number}_{wheel}" for wheel in WHEELS for number in range(LOAD_ROWS)),
    *(f"hull_{number}_{wheel}" for wheel in WHEELS for number in range(HULL_ROWS)),
    # what record_outputs tells of it: wheel loads [N], shares of patches on the map [-]
    *(*_each("normal"), *_each("known")),
)
Board: Any = IntEnum("Board", [name.upper() for name in _NAMES], start=len(State))
"""Rows of the board after those of the state."""

# rows that one part of a main step leaves to another
DRAWN = wp.constant(int(Board.NORMAL_FL))
"""In the substeps: what the front arms draw [m³/s], and then the rear ones."""
RETURNED = wp.constant(int(Board.NORMAL_RL))
"""Likewise what they return [m³/s]."""
BORNE = wp.constant(int(Board.KNOWN_FL))
"""Likewise what they bear [Pa]."""
OIL_ARM = wp.constant(int(Board.LOAD_0_FL))
"""From the substeps to the corners, every :data:`LOAD_ROWS` rows: mean torque of the oil on an arm [N m]."""
OIL_MOTOR = wp.constant(int(Board.LOAD_1_FL))
"""Likewise mean pressure over a motor [Pa]."""
MOVED = wp.constant(int(Board.LOAD_0_FL))
"""From the bodies to the end of the step, nine rows: by how much joint, arms and wheels moved beyond their old velocity
[rad]."""

ROWS = len(State) + len(Board)
"""Of the board."""


def record_words(default_laws: bool) -> int:
    """Words of four bytes of a machine record that the roles need, from its start: by the ``default_laws`` not those that
    other laws of the steering need; an odd number, so that the lanes of a warp meet 32 banks."""
    fields: Any = np.dtype(MachineRecord.numpy_dtype()).fields
    kind, steering = fields["steering"]
    words = (steering + kind.fields["spool_law"][1] if default_laws else fields["payload"][1]) // 4
    return words + 1 - words % 2


def shared_words(default_laws: bool) -> int:
    """Words of shared memory of a block."""
    return TWINS * (ROWS + record_words(default_laws))


@wp.func_native(f"""
    extern __shared__ char dynamic_smem_base[];
    return wp::array_t<float>((float*)dynamic_smem_base, {ROWS}, {TWINS});
""")
def shared_board() -> wp.array2d(dtype=float):
    """The board of this block: what ``tile_zeros`` of :func:`shared_words` has made room for."""


@wp.func_native(f"""
    extern __shared__ char dynamic_smem_base[];
    auto out = machines;
    out.data = (decltype(out.data))(dynamic_smem_base + {4 * TWINS * ROWS});
    out.shape[0] = {TWINS};
    out.strides[0] = 4 * words;
    return out;
""")
def shared_records(machines: wp.array(dtype=MachineRecord), words: int) -> wp.array(dtype=MachineRecord):
    """Room for ``words`` of each machine record of this block's twins, behind the board."""


@wp.func_native(f"""
    for (int twin = 0; twin < {TWINS}; ++twin) {{
        int t = first + twin < last ? first + twin : last - 1;
        const int* from = (const int*)(machines.data + t % machines.shape[0]);
        int* to = (int*)records.data + twin * words;
        for (int word = thread; word < words; word += {BLOCK_DIM})
            to[word] = from[word];
    }}
""")
def share_records(
    machines: wp.array(dtype=MachineRecord), records: wp.array(dtype=MachineRecord), words: int, first: int, last: int,
    thread: int,
):  # fmt: skip
    """Copy ``words`` of the records of the twins from ``first`` on, no farther than to the one before ``last``, a part a
    ``thread`` of the block."""


@wp.func_native("return __any_sync(0xffffffff, here);")
def any_lane(here: bool) -> bool:
    """Whether it is so for any twin of the block."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("" :: "f"(x));
#endif
""")
def note(x: float):
    """Does nothing: the compiler, which takes nothing out of a loop that waits, finds there again what was noted before."""


@wp.func_native("""asm volatile("bar.sync 0;" ::: "memory");""")
def wait_for_all():
    """Until all four warps are here."""


@wp.func_native("""asm volatile("bar.arrive 1, 96;" ::: "memory");""")
def pressures_are_told():
    """The steering warp has written supply and return line for this substep; it goes on."""


@wp.func_native("""asm volatile("bar.sync 1, 96;" ::: "memory");""")
def wait_for_pressures():
    """The warps of the arms wait for them."""


@wp.func_native("""asm volatile("bar.arrive 2, 96;" ::: "memory");""")
def flows_are_told():
    """A warp of arms has written what they draw, return and bear in this substep; it goes on."""


@wp.func_native("""asm volatile("bar.sync 2, 96;" ::: "memory");""")
def wait_for_flows():
    """The steering warp waits for those of both."""
