"""What the warps of a block do, one after the other on the CPU: a kernel of the very same roles, without barriers.

It shows that the roles together are a main step of the twin, and that the board holds all that they have to tell each other.
That nobody reads the board before it is written is for the GPU to show.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
from functools import cache
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.hydraulics import load_signals
from aoro_gym.twin.kernels.laws import with_laws
from aoro_gym.twin.kernels.roles.advance import take_up
from aoro_gym.twin.kernels.roles.board import Board
from aoro_gym.twin.kernels.roles.bodies import bodies_role, corner_role, tell_outputs, watch
from aoro_gym.twin.kernels.roles.oil import (
    arms_begin,
    arms_end,
    arms_exchange,
    arms_fill,
    arms_flow,
    driveline_begins,
    driveline_ends,
    driveline_moves,
    steering_begins,
    steering_ends,
    steering_fills,
    tell_pressures,
    without_rare,
)
from aoro_gym.twin.physics.steering import steering_flows
from aoro_gym.twin.records import NON_FINITE, OK, Command, MachineRecord, State

STATES = wp.constant(len(State))


@wp.func
def move_oil_in_turn(
    m: MachineRecord, board: wp.array2d(dtype=float), commands: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float), t: int, tick: int, h: float, num_substeps: int,
):  # fmt: skip
    dt = h / float(num_substeps)
    share = 1.0 / float(num_substeps)
    signals = load_signals(commands, t)
    steering = steering_begins(m, board, t, history, t, tick, signals.steering, h)
    front = arms_begin(m, board, 0, t, signals.arms[0], signals.arms[1], h)
    rear = arms_begin(m, board, 2, t, signals.arms[2], signals.arms[3], h)
    loop = driveline_begins(m, board, t, signals, h)
    for substep in range(num_substeps):
        tell_pressures(board, t, steering)
        q, begun = steering_flows(m.steering, m.oil, steering.spool_demand, steering.circuit, dt)
        fl, fr = arms_flow(m, board, 0, t, front, dt)
        rl, rr = arms_flow(m, board, 1, t, rear, dt)
        steering = steering_fills(m, steering, q, begun, arms_exchange(board, t), substep, dt)
        front = arms_fill(m, front, fl.bore, fl.rod, fr.bore, fr.rod, dt)
        rear = arms_fill(m, rear, rl.bore, rl.rod, rr.bore, rr.rod, dt)
        front.left.compensator = fl.compensator
        front.right.compensator = fr.compensator
        rear.left.compensator = rl.compensator
        rear.right.compensator = rr.compensator
        loop = driveline_moves(m, loop, dt)
    steering_ends(m, board, t, steering, share, h)
    arms_end(m, board, 0, t, front, share)
    arms_end(m, board, 2, t, rear, share)
    driveline_ends(m, board, t, loop, share)


def advance_in_turn(
    machines: wp.array(dtype=MachineRecord),
    laws: Any,
    terrain: Any,
    commands: wp.array3d(dtype=float),
    state: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    clock: wp.array(dtype=int),
    status: wp.array(dtype=int),
    outputs: wp.array3d(dtype=float),
    first: int,
    num_frames: int,
    frame_steps: int,
    num_substeps: int,
    h: float,
    board: wp.array2d(dtype=float),
):
    """As :func:`aoro_gym.twin.kernels.roles.advance.advance_by_roles`, a twin after the other; ``board`` (rows, twins)."""
    t = first + wp.tid()
    if status[t] != OK:
        return
    m = with_laws(laws, machines[t % machines.shape[0]])
    for row in range(STATES):
        board[row, t] = state[row, t]
    board[Board.ALIVE, t] = 1.0
    rare = m.oil.gas_fraction > 0.0 or m.joint.mount_stiffness > 0.0
    tick = clock[t]
    for frame in range(num_frames):
        told = commands[frame * commands.shape[0] // num_frames]
        for _step in range(frame_steps):
            if rare:
                move_oil_in_turn(without_rare(m, True), board, told, history, t, tick, h, num_substeps)
            else:
                move_oil_in_turn(without_rare(m, False), board, told, history, t, tick, h, num_substeps)
            for corner in range(4):
                corner_role(m, terrain, terrain.twins[t], board, int(corner), t, told[Command.PARKING_BRAKE, t], h)
            bodies_role(m, laws, terrain.twins[t].gravity, board, state, t, t, h)
            for role in range(4):
                take_up(m, board, int(role), t, h)
            tick += 1
        if board[Board.ALIVE, t] > 0.0:
            tell_outputs(m, terrain, board, outputs, frame, load_signals(told, t), t, t)
    for row in range(STATES):
        watch(board, t, board[row, t])
    if board[Board.ALIVE, t] > 0.0:
        for row in range(STATES):
            state[row, t] = board[row, t]
        clock[t] = tick
    else:
        status[t] = NON_FINITE


@cache
def in_turn(kind: Any, laws: Any) -> Any:
    """The kernel for one kind of ground and of laws."""
    module = f"{__name__}.{kind.key.lower()}.{laws.key.lower()}"
    wp.set_module_options({"default_grid_stride": False, "optimization_level": 0}, module=module)
    return wp.overload(
        wp.kernel(advance_in_turn, enable_backward=False, module=module), {"terrain": kind, "laws": laws}
    )
