"""What steering and arms tell each other within a substep: every order in which four warps may run, one access at a time.

Barriers are those of a multiprocessor: a counter that goes by warps. Who arrives goes on, who waits goes on when as many
warps are counted as the barrier is told, and then counting begins anew. By the PTX manual ("barrier{.cta}") accesses before
an arrival or a wait are done for all of the barrier's threads once it completes, and none after a wait begins earlier. So
accesses that no order of running puts side by side are no race, and each sees what was written last.
"""

import ast
import inspect
import re
import textwrap
from collections import deque
from itertools import combinations
from typing import Any

import pytest

from aoro_gym.twin.kernels.roles import BLOCK_DIM, TWINS, advance, board
from aoro_gym.twin.kernels.roles.advance import move_arms, steer

Event = tuple[str, Any, Any]
"""``write``, ``read``, ``arrive`` or ``wait``; of what, or at which barrier; and the substep of which."""
State = tuple[tuple[int, ...], frozenset[tuple[int, int]]]
"""How far the warps have come, and who is counted at which barrier."""

MAIN_STEPS, SUBSTEPS = 2, 3
"""Enough for all that a barrier can be: new, used, used again after all have waited for each other."""


def barrier(function: Any) -> tuple[str, int, int]:
    """What a function of the kernel does at which barrier, and of how many warps that is."""
    (kind, number, threads), *others = re.findall(r"bar\.(\w+) (\d+)(?:, (\d+))?;", function.native_snippet)
    assert not others
    return {"sync": "wait", "arrive": "arrive"}[kind], int(number), int(threads or BLOCK_DIM) // TWINS


BARRIERS = ("pressures_are_told", "wait_for_pressures", "flows_are_told", "wait_for_flows", "wait_for_all")
ACCESSES = {
    "tell_pressures": [("write", "pressures")],
    "arms_flow": [("read", "pressures"), ("write", "flows")],
    "arms_exchange": [("read", "flows")],
}
"""What the calls of a substep do to what steering and arms tell each other."""


def events(function: Any) -> list[tuple[str, Any]]:
    """What a role does in a substep, in the order of its source."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function.func)))
    (loop,) = (node for node in ast.walk(tree) if isinstance(node, ast.For))
    calls = [node for node in ast.walk(loop) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    calls.sort(key=lambda call: (call.end_lineno, call.end_col_offset))
    names = [ast.unparse(call.func) for call in calls]
    told = ACCESSES | {name: [barrier(getattr(board, name))[:2]] for name in BARRIERS}
    return [event for name in names for event in told.get(name, [])]


def programs(steering: list[tuple[str, Any]], arms: list[tuple[str, Any]]) -> list[list[Event]]:
    """Of steering, front arms, rear arms and driveline, which all wait for each other at the end of a main step; there
    steering leaves its lines on the board once more. Each pair of arms has flows of its own, steering reads both."""
    both = [each for event in steering for each in ([(event[0], 0), (event[0], 1)] if event[1] == "flows" else [event])]
    substep = [both, *([(kind, pair if what == "flows" else what) for kind, what in arms] for pair in (0, 1)), []]
    found: list[list[Event]] = [[] for _ in substep]
    for warp, program in enumerate(found):
        for main in range(MAIN_STEPS):
            program += [(*event, (main, number)) for number in range(SUBSTEPS) for event in substep[warp]]
            program += [("write", "pressures", (main, SUBSTEPS))] * (warp == 0) + [("wait", "all", main)]
    return found


def faults(running: list[list[Event]], warps: dict[Any, int]) -> set[str]:
    """What goes wrong in any order of the ``running`` programs, with barriers of so many ``warps``."""
    start: State = (0,) * len(running), frozenset()
    known, left, found = {start}, deque([start]), set()
    while left:
        at, counted = state = left.popleft()
        following = {warp: running[warp][n] for warp, n in enumerate(at) if n < len(running[warp])}
        free = {w: e for w, e in following.items() if e[0] != "wait" or (e[1], w) not in counted}
        if following and not free:
            found.add("they wait for each other for ever")
        for (_, (kind, what, _)), (_, (other, that, _)) in combinations(free.items(), 2):
            if what == that and "write" in (kind, other) and {kind, other} <= {"read", "write"}:
                found.add(f"a race for {what}")
        for warp, event in free.items():
            if event[0] == "read" and told(running, at, event[1]) != event[2]:
                found.add(f"{event[1]} of another substep are read")
            if event[0] in ("arrive", "wait") and (event[1], warp) in counted:
                found.add("a warp is counted twice")
                continue
            after = run(running, warps, state, warp)
            if after not in known:
                known.add(after)
                left.append(after)
    return found


def told(running: list[list[Event]], at: tuple[int, ...], what: Any) -> Any:
    """The substep of which ``what`` was written last; of each one warp alone writes."""
    writes = [
        event for program, n in zip(running, at, strict=True) for event in program[:n] if event[:2] == ("write", what)
    ]
    return writes[-1][2] if writes else None


def run(running: list[list[Event]], warps: dict[Any, int], state: State, warp: int) -> State:
    """The state after ``warp`` has done what it does next."""
    at, counted = list(state[0]), state[1]
    kind, which, _ = running[warp][at[warp]]
    at[warp] += kind != "wait"
    if kind in ("arrive", "wait"):
        counted |= {(which, warp)}
        here = {one for barrier, one in counted if barrier == which}
        if len(here) == warps[which]:
            for one in here:
                at[one] += at[one] < len(running[one]) and running[one][at[one]][:2] == ("wait", which)
            counted = frozenset(each for each in counted if each[0] != which)
    return tuple(at), counted


def waiting(tree: ast.Module) -> dict[str, ast.FunctionDef]:
    """Functions of a module that wait somewhere, or call one that does."""
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    names, before = set(BARRIERS), set()
    while names != before:
        before = set(names)
        names |= {name for name, node in functions.items() if called(node) & names}
    return {name: node for name, node in functions.items() if name in names}


def called(node: ast.AST) -> set[str]:
    """Names of the functions that are called within."""
    return {ast.unparse(one.func) for one in ast.walk(node) if isinstance(one, ast.Call)}


STEERING, ARMS = events(steer), events(move_arms)
WARPS: dict[Any, int] = {number: warps for _, number, warps in (barrier(getattr(board, name)) for name in BARRIERS)}
WARPS["all"] = WARPS.pop(0)


def test_barriers_are_of_three_warps_and_of_all():
    assert WARPS == {1: 3, 2: 3, "all": 4}
    assert [kind for kind, _ in STEERING] == ["write", "arrive", "wait", "read"]
    assert [kind for kind, _ in ARMS] == ["wait", "read", "write", "arrive"]


def test_all_lanes_of_a_warp_come_to_each_barrier():
    """Also those without a twin, and those whose twin no longer runs: what decides on the way is the same for all."""
    functions = waiting(ast.parse(inspect.getsource(advance)))
    assert set(functions) == {"steer", "move_arms", "move_oil", "main_step", "advance_by_roles"}
    for name, function in functions.items():
        assert not any(isinstance(node, ast.Return) for node in ast.walk(function)), name
        for node in ast.walk(function):
            if called(node) & (set(BARRIERS) | set(functions)) and isinstance(node, ast.If | ast.For | ast.While):
                decides = node.iter if isinstance(node, ast.For) else node.test
                words = {one.id for one in ast.walk(decides) if isinstance(one, ast.Name)}
                assert words <= {"role", "rare", "range", "num_substeps", "num_frames", "frame_steps"}, (name, words)
    (rare,) = (
        node.value
        for node in ast.walk(functions["advance_by_roles"])
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "rare"
    )
    assert called(rare) == {"any_lane"}


def test_nobody_reads_too_early_or_writes_too_soon_whatever_the_order():
    assert faults(programs(STEERING, ARMS), WARPS) == set()


@pytest.mark.parametrize("event", [0, 1])
def test_what_is_left_out_is_noticed(event):
    """Each of the four that tell or wait."""
    for mine, other in ((STEERING, ARMS), (ARMS, STEERING)):
        kinds = [one for one in mine if one[0] in ("arrive", "wait")]
        less = [one for one in mine if one != kinds[event]]
        pair = (less, other) if mine is STEERING else (other, less)
        assert faults(programs(*pair), WARPS)


@pytest.mark.parametrize(("barrier", "warps"), [(1, 2), (1, 4), (2, 2), (2, 4)])
def test_a_barrier_of_another_number_is_noticed(barrier, warps):
    assert faults(programs(STEERING, ARMS), WARPS | {barrier: warps})
