"""The kernel ``advance_by_roles``: what :func:`aoro_gym.twin.kernels.advance.advance` does, by four warps for 32 twins.

=================  ====================  ==================  =================  =====================
                   warp 0                warp 1              warp 2             warp 3
=================  ====================  ==================  =================  =====================
substeps           steering              front arms          rear arms          driveline
contacts           front left corner     front right corner  rear left corner   rear right corner
bodies             waits                 waits               waits              tree of bodies
end of the step    oil of the steering   oil of front arms   oil of rear arms   closed loop, engine
=================  ====================  ==================  =================  =====================

All four wait for each other at the end of each of these; within the substeps steering and arms wait at two barriers of their
own, at which who has told goes on at once. A thread that has no twin, or one that no longer runs, takes part in all and
stores nothing. Laws and their order are those of the other form, functions of :mod:`aoro_gym.twin.physics`; sums over arms
and hulls are grouped otherwise, so both forms differ by rounding.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.hydraulics import load_signals
from aoro_gym.twin.kernels.laws import with_laws
from aoro_gym.twin.kernels.roles import BLOCK_DIM, ROLES, TWINS
from aoro_gym.twin.kernels.roles.board import (
    Board,
    any_lane,
    flows_are_told,
    pressures_are_told,
    record_words,
    share_records,
    shared_board,
    shared_records,
    shared_words,
    wait_for_all,
    wait_for_flows,
    wait_for_pressures,
)
from aoro_gym.twin.kernels.roles.bodies import (
    arm_takes_up,
    bodies_role,
    corner_role,
    driveline_takes_up,
    steering_takes_up,
    tell_outputs,
    watch,
)
from aoro_gym.twin.kernels.roles.oil import (
    arms_begin,
    arms_end,
    arms_exchange,
    arms_fill,
    arms_flow,
    driveline_begins,
    driveline_ends,
    driveline_moves,
    note_quotients_of_arms,
    note_quotients_of_steering,
    steering_begins,
    steering_ends,
    steering_fills,
    tell_pressures,
    without_rare,
)
from aoro_gym.twin.physics.steering import steering_flows
from aoro_gym.twin.records import NON_FINITE, OK, Command, MachineRecord, State

STATES = wp.constant(len(State))
THREADS = wp.constant(BLOCK_DIM)
ROLES_OF_BLOCK = wp.constant(ROLES)
TWINS_OF_BLOCK = wp.constant(TWINS)
TREE = wp.constant(3)
"""Role that the tree of bodies is left to: that with the least to do in the substeps."""
WORDS = wp.constant(record_words(default_laws=False))
ROOM = wp.constant(shared_words(default_laws=False))


@wp.func
def steer(
    records: wp.array(dtype=MachineRecord),
    laws: Any,
    board: wp.array2d(dtype=float),
    lane: int,
    history: wp.array2d(dtype=float),
    t: int,
    tick: int,
    signal: float,
    rare: bool,
    h: float,
    num_substeps: int,
):
    """The steering's main step."""
    dt = h / float(num_substeps)
    m = without_rare(with_laws(laws, records[lane]), rare)
    note_quotients_of_steering(m, dt)
    x = steering_begins(m, board, lane, history, t, tick, signal, h)
    for substep in range(num_substeps):
        tell_pressures(board, lane, x)
        pressures_are_told()
        q, begun = steering_flows(m.steering, m.oil, x.spool_demand, x.circuit, dt)
        wait_for_flows()
        x = steering_fills(m, x, q, begun, arms_exchange(board, lane), substep, dt)
    steering_ends(
        without_rare(with_laws(laws, records[lane]), rare), board, lane, x, 1.0 / float(num_substeps), h
    )


@wp.func
def move_arms(
    records: wp.array(dtype=MachineRecord),
    laws: Any,
    board: wp.array2d(dtype=float),
    pair: int,
    lane: int,
    signal_left: float,
    signal_right: float,
    rare: bool,
    h: float,
    num_substeps: int,
):
    """The main step of both arms of a ``pair`` (0 front, 1 rear)."""
    dt = h / float(num_substeps)
    m = without_rare(with_laws(laws, records[lane]), rare)
    note_quotients_of_arms(m)
    x = arms_begin(m, board, 2 * pair, lane, signal_left, signal_right, h)
    for _ in range(num_substeps):
        wait_for_pressures()
        left, right = arms_flow(m, board, pair, lane, x, dt)
        flows_are_told()
        x = arms_fill(m, x, left.bore, left.rod, right.bore, right.rod, dt)
        x.left.compensator = left.compensator
        x.right.compensator = right.compensator
    arms_end(m, board, 2 * pair, lane, x, 1.0 / float(num_substeps))


@wp.func
def drive(
    records: wp.array(dtype=MachineRecord),
    laws: Any,
    board: wp.array2d(dtype=float),
    lane: int,
    commands: wp.array2d(dtype=float),
    t: int,
    rare: bool,
    h: float,
    num_substeps: int,
):
    """The driveline's main step."""
    dt = h / float(num_substeps)
    m = without_rare(with_laws(laws, records[lane]), rare)
    x = driveline_begins(m, board, lane, load_signals(commands, t), h)
    for _ in range(num_substeps):
        x = driveline_moves(m, x, dt)
    driveline_ends(m, board, lane, x, 1.0 / float(num_substeps))


@wp.func
def move_oil(
    records: wp.array(dtype=MachineRecord),
    laws: Any,
    board: wp.array2d(dtype=float),
    role: int,
    lane: int,
    commands: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    t: int,
    tick: int,
    rare: bool,
    h: float,
    num_substeps: int,
):
    """All circuits over a main step of ``h`` [s], each by its ``role``; ``rare``: with gas and mounts."""
    if role == 0:
        steer(
            records, laws, board, lane, history, t, tick, commands[Command.STEERING_SIGNAL, t], rare, h, num_substeps
        )
    elif role == 3:
        drive(records, laws, board, lane, commands, t, rare, h, num_substeps)
    else:
        row = int(Command.ARM_FL) + 2 * (role - 1)
        move_arms(
            records, laws, board, role - 1, lane, commands[row, t], commands[row + 1, t], rare, h, num_substeps
        )


@wp.func
def take_up(m: MachineRecord, board: wp.array2d(dtype=float), role: int, lane: int, h: float):
    """The end of a main step of ``h`` [s]: the oil takes up what the bodies moved beyond their old velocity."""
    if role == 0:
        steering_takes_up(m, board, lane)
    elif role == 3:
        driveline_takes_up(m, board, lane, h)
    else:
        arm_takes_up(m, board, 2 * role - 2, lane)
        arm_takes_up(m, board, 2 * role - 1, lane)


@wp.func
def main_step(
    records: wp.array(dtype=MachineRecord),
    laws: Any,
    terrain: Any,
    board: wp.array2d(dtype=float),
    role: int,
    lane: int,
    commands: wp.array2d(dtype=float),
    state: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    t: int,
    tick: int,
    rare: bool,
    h: float,
    num_substeps: int,
):
    """A main step of ``h`` [s], of which each role does its part; all wait for each other after each of the four parts."""
    if rare:
        move_oil(records, laws, board, role, lane, commands, history, t, tick, True, h, num_substeps)
    else:  # compiled without gas and mount
        move_oil(records, laws, board, role, lane, commands, history, t, tick, False, h, num_substeps)
    wait_for_all()
    parking_brake = commands[Command.PARKING_BRAKE, t]
    corner_role(with_laws(laws, records[lane]), terrain, terrain.twins[t], board, role, lane, parking_brake, h)
    wait_for_all()
    if role == TREE:
        bodies_role(with_laws(laws, records[lane]), laws, terrain.twins[t].gravity, board, state, lane, t, h)
    wait_for_all()
    take_up(with_laws(laws, records[lane]), board, role, lane, h)
    wait_for_all()


def advance_by_roles(
    # parameters
    machines: wp.array(dtype=MachineRecord),
    laws: Any,
    terrain: Any,
    # commands (set, row, twin): each set holds for an equal number of frames
    commands: wp.array3d(dtype=float),
    # state in and out
    state: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    clock: wp.array(dtype=int),
    status: wp.array(dtype=int),
    # outputs (frame, row, twin): one frame every ``frame_steps`` main steps
    outputs: wp.array3d(dtype=float),
    # time stepping
    first: int,
    num_frames: int,
    frame_steps: int,
    num_substeps: int,
    h: float,
    # the twin after the last one
    last: int,
):
    """Advance the twins from ``first`` to the one before ``last`` by ``num_frames`` times ``frame_steps`` main steps of
    ``h`` [s] with ``num_substeps`` each; launched with :data:`BLOCK_DIM` threads a block, a block for 32 twins.

    A role is the same warp of every block, so that the instruction cache of each of a multiprocessor's four schedulers has
    the loop of one role to hold: turning the roles from block to block was 3 to 10 % slower.
    """
    thread = wp.tid()
    block = thread // THREADS
    lane = thread % TWINS_OF_BLOCK
    role = thread // TWINS_OF_BLOCK % ROLES_OF_BLOCK
    begin = first + block * TWINS_OF_BLOCK
    t = wp.min(begin + lane, last - 1)
    runs = begin + lane < last and status[t] == OK
    wp.tile_zeros(shape=ROOM, dtype=float, storage="shared")
    board = shared_board()
    records = shared_records(machines, WORDS)
    share_records(machines, records, WORDS, begin, last, thread % THREADS)
    for row in range(role, STATES, ROLES_OF_BLOCK):
        board[row, lane] = state[row, t]
    board[Board.ALIVE, lane] = wp.where(runs, 1.0, 0.0)
    tick = clock[t]
    wait_for_all()
    rare = any_lane(records[lane].oil.gas_fraction > 0.0 or records[lane].joint.mount_stiffness > 0.0)

    for frame in range(num_frames):
        told = commands[frame * commands.shape[0] // num_frames]
        for _step in range(frame_steps):
            main_step(
                records, laws, terrain, board, role, lane, told, state, history, t, tick, rare, h, num_substeps
            )
            tick += 1
        if role == 0 and board[Board.ALIVE, lane] > 0.0:
            tell_outputs(
                with_laws(laws, records[lane]), terrain, board, outputs, frame, load_signals(told, t), lane, t
            )
        wait_for_all()

    for row in range(role, STATES, ROLES_OF_BLOCK):
        watch(board, lane, board[row, lane])
    wait_for_all()
    if runs and board[Board.ALIVE, lane] > 0.0:
        for row in range(role, STATES, ROLES_OF_BLOCK):
            state[row, t] = board[row, lane]
        clock[t] = tick
    elif runs:
        status[t] = NON_FINITE
