"""Integration of a family's laws over a log: one thread a run, classical Runge–Kutta of fourth order with a fixed step.

Steps start where the delayed command may change, so that a delay acts exactly, whatever the step; should the step not
divide the commands' grid, a step takes their mean.
"""

from typing import Any

import warp as wp

from . import layout as at
from .bodies import kinetic_energy
from .geometry import chambers
from .numbers import HALF, ONE, TWO, ZERO, f64

GRID = wp.constant(wp.float64(1e-3))  # commands stand on a grid of this many seconds

Inputs = wp.types.vector(length=at.N_INPUTS, dtype=wp.float64)
Signals = wp.types.vector(length=at.N_SIGNALS, dtype=wp.float64)


@wp.func
def held(values: wp.array2d(dtype=wp.float64), run: int, cell: int):
    """Value of a held signal; nought before the log, the last one after it."""
    value = ZERO
    if cell >= 0:
        value = values[run, wp.min(cell, values.shape[1] - 1)]
    return value


@wp.func
def mean_over(values: wp.array2d(dtype=wp.float64), run: int, since: wp.float64, step: wp.float64):
    """Mean of a held signal over [since, since + step], step at most one cell."""
    first = wp.floor(since / GRID + f64(1e-9))
    border = (first + ONE) * GRID
    share = wp.clamp((border - since) / step, ZERO, ONE)
    cell = int(first)
    return share * held(values, run, cell) + (ONE - share) * held(values, run, cell + 1)


@wp.func
def remember(history: wp.array2d(dtype=wp.float64), run: int, place: wp.float64):
    """Value of a ring buffer between two of its places."""
    size = history.shape[1]
    low = wp.floor(place)
    share = place - low
    one = wp.max(int(low), 0) % size
    two = wp.max(int(low) + 1, 0) % size
    return (ONE - share) * history[run, one] + share * history[run, two]


@wp.func
def vehicle_at_rest(x: Any, m: Any, angle: wp.float64):
    """Set the states of the vehicle and of the filters at rest."""
    x[at.ANGLE] = angle
    x[at.ROD] = angle
    x[at.LOOP_FORWARD] = m.charge_pressure
    x[at.LOOP_RETURN] = m.charge_pressure
    x[at.ENGINE] = m.engine_speed
    x[at.GOVERNOR] = m.engine_idle_torque
    x[at.LAG] = angle
    x[at.LAG_TWO] = angle
    return x


@wp.func
def vehicle_signals(x: Any, m: Any, h: Any):
    """Signals of a state; ``h``: the hydraulic ones (pressures a, b, pump, flows into a, b, spool)."""
    c = chambers(x[at.ROD], m)
    y = Signals()
    y[0] = x[at.LAG_TWO]
    for i in range(3):
        y[1 + i] = x[at.LAG + 1 + i]
        y[9 + i] = h[i]
    y[4] = x[at.LOOP_FORWARD]
    y[5] = x[at.LOOP_RETURN]
    y[6] = x[at.ENGINE]
    y[7] = x[at.ANGLE]
    y[8] = x[at.RATE_FRONT] - x[at.RATE_REAR]
    y[12] = h[3]
    y[13] = h[4]
    y[14] = c[2] * x[at.ROD_RATE]
    y[15] = c[3] * x[at.ROD_RATE]
    y[16] = c[0]
    y[17] = c[1]
    y[18] = kinetic_energy(x, m)
    y[19] = h[5]
    return y


@wp.func
def inputs_at(
    m: Any, commands: wp.array2d(dtype=wp.float64), drives: wp.array2d(dtype=wp.float64), run: int, time: wp.float64,
    step: wp.float64,
):  # fmt: skip
    """What drives a plant during the step from ``time`` on."""
    inputs = Inputs()
    inputs[at.COMMAND] = mean_over(commands, run, time - m.command_delay, step)
    inputs[at.DRIVE] = mean_over(drives, run, time, step)
    inputs[at.TIME] = time
    inputs[at.VISCOSITY] = m.viscosity * wp.exp(-m.heating * wp.max(time, ZERO))
    return inputs


@wp.func
def due(times: wp.array2d(dtype=wp.float64), run: int, sample: int, until: wp.float64):
    """Whether a sample is to be taken before ``until``."""
    taken = False
    if sample < times.shape[1]:
        taken = times[run, sample] < until
    return taken


@wp.func
def way(times: wp.array2d(dtype=wp.float64), run: int, sample: int, time: wp.float64, step: wp.float64):
    """Share of a step after which a sample is taken."""
    return wp.clamp((times[run, sample] - time) / step, ZERO, ONE)


def stepper(laws: Any, machine: Any) -> Any:
    """Function of a Runge–Kutta step by a family's laws."""
    derivative, limit = laws.derivative, laws.limit

    @wp.func
    def step_on(x: laws.State, m: machine, inputs: Inputs, step: wp.float64):
        total = laws.State()
        stage = x
        begin = inputs[at.TIME]
        for i in range(4):
            weight = ONE
            ahead = HALF
            if i == 1 or i == 2:
                weight = TWO
            if i == 2:
                ahead = ONE
            rate = derivative(stage, m, inputs)
            total += weight * rate
            stage = x + ahead * step * rate
            inputs[at.TIME] = begin + ahead * step
        return limit(x + step / f64(6.0) * total, m)

    return step_on


def build(laws: Any, machine: Any) -> Any:
    """Kernel of a family.

    ``laws``: module with ``State``, ``derivative``, ``limit``, ``start``, ``remembered`` and ``hydraulic_signals``;
    ``machine``: Warp struct of its constants.

    The kernel writes the joint angle at ``angle_times``, and behind it the signals of the numbers ``columns`` at
    ``other_times``.
    """
    step_on, start, remembered, hydraulics = stepper(laws, machine), laws.start, laws.remembered, laws.hydraulic_signals

    @wp.kernel(enable_backward=False, module="unique")
    def advance(
        machines: wp.array(dtype=machine),
        commands: wp.array2d(dtype=wp.float64),
        drives: wp.array2d(dtype=wp.float64),
        angles: wp.array(dtype=wp.float64),
        angle_times: wp.array2d(dtype=wp.float64),
        other_times: wp.array2d(dtype=wp.float64),
        columns: wp.array(dtype=int),
        step: wp.float64,
        settle: int,
        steps: int,
        history: wp.array2d(dtype=wp.float64),
        out: wp.array3d(dtype=wp.float64),
    ):
        run = wp.tid()
        m = machines[run]
        x = vehicle_at_rest(start(m, angles[run]), m, angles[run])
        one = int(0)
        other = int(0)
        shift = m.command_delay / step
        shift = (shift - wp.ceil(shift - f64(1e-6))) * step  # in (−step, 0]: edges of the command start steps
        for k in range(steps):
            time = f64(k - settle) * step + shift
            inputs = inputs_at(m, commands, drives, run, time, step)
            if history.shape[1] > 1:
                history[run, k % history.shape[1]] = remembered(x, m)
                inputs[at.DELAYED] = remember(history, run, f64(k) + HALF - m.dead_time / step)
            begin = x
            x = step_on(x, m, inputs, step)
            while due(angle_times, run, one, time + step):
                share = way(angle_times, run, one, time, step)
                out[run, one, 0] = (ONE - share) * begin[at.LAG_TWO] + share * x[at.LAG_TWO]
                one += 1
            if due(other_times, run, other, time + step):
                first = vehicle_signals(begin, m, hydraulics(begin, m, inputs))
                last = vehicle_signals(x, m, hydraulics(x, m, inputs))
                while due(other_times, run, other, time + step):
                    share = way(other_times, run, other, time, step)
                    for k in range(columns.shape[0]):
                        c = columns[k]
                        out[run, other, 1 + k] = (ONE - share) * first[c] + share * last[c]
                    other += 1

    return advance
