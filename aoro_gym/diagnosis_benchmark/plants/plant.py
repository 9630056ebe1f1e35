"""A plant: machines with laws of their own, stepped together, that stand in for the machine of a sim-to-real gap.

Symmetric splitting (Strang): over half a step frames and wheels move at constant rates while oil, engine and bristles
follow; then the rates change over a whole step under what oil and ground exert; then the other half. Both parts are of
second order, so is the whole. One thread has a run, on a CPU or a GPU.
"""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from aoro_gym.diagnosis_benchmark.plants import bodies, hydraulics, joint, tires
from aoro_gym.diagnosis_benchmark.plants import circuits as rows
from aoro_gym.diagnosis_benchmark.plants.bodies import Bodies
from aoro_gym.diagnosis_benchmark.plants.circuits import Circuit, circuit_of
from aoro_gym.diagnosis_benchmark.plants.friction import dahl, prandtl_force
from aoro_gym.diagnosis_benchmark.plants.linkage import Displacement, displacement
from aoro_gym.diagnosis_benchmark.plants.records import (
    BLOCK_DIM,
    Array,
    Constants,
    clipped,
    f64,
    launch,
    packed,
    record,
    vec4,
    vec7,
    vec11,
    vec29,
)
from aoro_gym.diagnosis_benchmark.plants.tires import Tire

LEVELS = (0, 1, 2, 3)
"""0: the twin's laws in other words. 1: another friction law, another law of air in oil. 2: also distributed joint hoses
and tires with a contact patch. 3: yet other laws of all these parts, for development."""

MAIN_STEP = 1e-3
"""[s]"""

SUBSTEPS, FINE_SUBSTEPS, STAGES = 2, 4, 5
"""Steps of the circuits in half a main step, and stages of their method: stable up to eigenvalues of 6e4/s. The stiffest
there is, an open edge and a suction valve below their laminar drop on a chamber of 0.36 L, has 5e4/s. Finer where hoses
oscillate (level 2) or pins and frame yield."""

BLOCK = 100
"""Main steps of a launch at most, after each of which progress is told."""

CHANNELS = (
    "joint_angle", "pressure_a", "pressure_b", "pump_pressure", "drive_pressure_forward", "drive_pressure_return",
    "engine_speed", "wheel_rate_fl", "wheel_rate_fr", "wheel_rate_rl", "wheel_rate_rr",
)  # fmt: skip
"""What the machine's logger has sensors for, SI."""

EVERY_ANGLE = "joint_angle of every main step"
"""Name of an output of :func:`simulate`."""

POSITION, RATES, ACROSS, BRAKE = (wp.constant(i) for i in (29, 36, 47, 51))
BRISTLE, PLAY, ENGINE_ANGLE, JOINT_ANGLE, JOINT_RATE, WHEEL_RATE = (wp.constant(i) for i in (55, 56, 57, 58, 59, 60))
TIRES = wp.constant(64)
ROWS = 64 + tires.TIRE_ROWS
"""Rows of a plant's state: the circuits', then places of the bodies, their rates with the wheels' spins, places of the
contacts across the tires, the brakes' bristles [rad] (level 0) or shares of their capacity (the others), the joint's
bristle [rad], what the hysteresis has remembered of the steering signal, the engine's angle [rad]; what is only shown; the
tires'."""

OUTPUTS: Mapping[str, int] = {
    "pressure_a": rows.PORT_A, "pressure_b": rows.PORT_B, "pump_pressure": rows.SUPPLY, "return_pressure": rows.RETURN,
    "drive_pressure_forward": rows.FORWARD, "drive_pressure_return": rows.BACK, "charge_pressure": rows.CHARGE,
    "ls_pressure": rows.LS, "spool": rows.SPOOL, "compensator": rows.COMPENSATOR, "pump_swash": rows.SWASH,
    "engine_speed": rows.ENGINE, "engine_torque": rows.TORQUE, "engine_angle": ENGINE_ANGLE, "joint_angle": JOINT_ANGLE,
    "joint_rate": JOINT_RATE, "position_x": POSITION, "position_y": POSITION + 1,
    **{f"wheel_rate_{wheel}": WHEEL_RATE + i for i, wheel in enumerate(("fl", "fr", "rl", "rr"))},
}  # fmt: skip
"""Rows of the state by the outputs' names."""

PlantRecord = record(
    "PlantRecord", "half_play command_delay motor_loss brake_stiffness brake_damping spin_inertia",
    circuit=Circuit, bodies=Bodies, tire=Tire, brake=vec4, level=wp.int32, substeps=wp.int32,
)  # fmt: skip
"""Constants of one run; ``brake``: dry torque [N m] by wheel."""


def plant_of(p: Constants, level: int) -> dict[str, Any]:
    """Fields of :data:`PlantRecord` (R,)."""
    disc, circuit = p["driveline.brake.disc_torque"], circuit_of(p, level)
    return {
        "circuit": circuit, "bodies": bodies.bodies_of(p, level), "tire": tires.tire_of(p, level), "level": level,
        "half_play": 0.5 * p["steering.valve.hysteresis"], "command_delay": p["steering.valve.command_delay"],
        "brake": np.stack([disc + p["driveline.brake.drag_fl"], disc, disc, disc]),
        "motor_loss": 1.0 - p["driveline.motor.mechanical_efficiency"], "spin_inertia": p["wheel.inertia_spin"],
        "brake_stiffness": p["driveline.brake.presliding_stiffness"],
        "brake_damping": p["driveline.brake.presliding_damping"],
        "substeps": np.where(circuit["joint"]["elastic"] | (level == 2), FINE_SUBSTEPS, SUBSTEPS),
    }  # fmt: skip


# ------------------------------------------------------------------------------------------------------------------ rest
@wp.func
def idle(c: Circuit, angle: f64):
    """State of idle circuits at the joint ``angle`` [rad]: pumps make up the leaks, the charge relief takes what is left."""
    y = vec29()
    d, lines, e = c.drive, c.lines, c.engine
    y[rows.SUPPLY] = lines.margin
    for i in range(3):
        y[rows.PORT_A + i] = lines.back_pressure  # both ports and the return line
    y[rows.COMPENSATOR] = f64(1.0)
    y[rows.SWASH] = lines.pump_leak * lines.margin / (lines.pump_size * e.set_speed)
    supplied = d.charge_size * e.set_speed
    main = d.charge_setting
    charge = d.charge_setting
    for _ in range(50):
        charge = d.charge_setting + (supplied - f64(2.0) * d.leak * main) / d.charge_gain
        main = charge - d.charge_crack - d.leak * main * wp.sqrt(c.valve.laminar) / d.charge_check
    y[rows.CHARGE] = charge
    y[rows.FORWARD] = main
    y[rows.BACK] = main
    for w in range(4):
        y[rows.WHEEL_LINE + w] = main
        y[rows.NODES + w] = wp.where(w < 2 * lines.cells, lines.back_pressure, f64(0.0))
    if lines.cells == 1:
        y[rows.WALLS] = hydraulics.SLOW_SHARE * lines.hose_wall * lines.back_pressure
        y[rows.WALLS + 1] = y[rows.WALLS]
    load = hydraulics.pump_torque(c, y[rows.SWASH], y[rows.SUPPLY], f64(0.0), f64(0.0), charge)
    y[rows.ENGINE] = e.set_speed - hydraulics.droop_slope(e, f64(0.0)) * load
    y[rows.TORQUE] = e.friction_0 + e.friction_1 * y[rows.ENGINE] + load
    y[rows.GOVERNOR] = y[rows.TORQUE]
    y[rows.PIN_ANGLE] = angle
    return y


@wp.func
def show(b: Bodies, state: wp.array2d(dtype=f64), run: int):
    """Write what follows from the state and is shown only."""
    state[JOINT_ANGLE, run] = state[POSITION + bodies.FRONT, run] - state[POSITION + bodies.REAR, run]
    state[JOINT_RATE, run] = state[RATES + bodies.FRONT, run] - state[RATES + bodies.REAR, run]
    q, u = vec7(), vec7()
    for i in range(7):
        q[i] = state[POSITION + i, run]
        u[i] = state[RATES + i, run]
    s = bodies.stance_of(b, q, vec4())
    for w in range(4):
        state[WHEEL_RATE + w, run] = bodies.relative_spin(s, w, u, state[RATES + 7 + w, run])


@wp.kernel(enable_backward=False)
def rest(
    first: int,
    machines: wp.array(dtype=PlantRecord),
    joint_angle: wp.array(dtype=f64),
    state: wp.array2d(dtype=f64),
):
    """Put runs at rest."""
    run = first + wp.tid()
    m = machines[run]
    y = idle(m.circuit, joint_angle[run])
    for i in range(29):
        state[i, run] = y[i]
    q, across = bodies.standing(m.bodies, joint_angle[run])
    for i in range(7):
        state[POSITION + i, run] = q[i]
    for w in range(4):
        state[ACROSS + w, run] = across[w]
    show(m.bodies, state, run)


# ----------------------------------------------------------------------------------------------------------------- drift
@wp.func
def after_play(play: f64, signal: f64, half_width: f64):
    """What a play of ``half_width`` w about the signal has remembered, and what the hysteresis lets through: w back toward
    its centre, so that a signal that has only risen passes unchanged."""
    left = wp.min(wp.max(play, signal - half_width), signal + half_width)
    return left, left + clipped(left, half_width)


@wp.func
def motor_torque(m: PlantRecord, state: wp.array2d(dtype=f64), run: int, wheel: int):
    least = m.circuit.lines.least
    line = wp.max(state[rows.WHEEL_LINE + wheel, run], least)
    return m.circuit.drive.motor_size * (line - wp.max(state[rows.BACK, run], least))


@wp.func
def wheel_capacity(m: PlantRecord, wheel: int, motor: f64):
    """Torque [N m] at which a wheel's dry friction slides under the ``motor``'s [N m]."""
    return m.brake[wheel] + m.motor_loss * wp.abs(motor) + f64(1e-9)


@wp.func
def held_wheel(m: PlantRecord, bristle: f64, travel: f64, capacity_now: f64):
    """The brake's bristle after the wheel's ``travel`` [rad]."""
    if m.level == 0:
        return clipped(bristle + travel, capacity_now / m.brake_stiffness)
    return dahl(bristle, travel, m.brake_stiffness / capacity_now)


@wp.func
def drift(
    m: PlantRecord, rule: wp.array2d(dtype=f64), state: wp.array2d(dtype=f64), run: int, known: hydraulics.Softness,
    steer: f64, drive: f64, duration: f64,
):  # fmt: skip
    """Move places and states on at constant rates of frames and wheels; gives the oil's softness, ``known`` so far."""
    angle = state[POSITION + bodies.FRONT, run] - state[POSITION + bodies.REAR, run]
    q, u = vec7(), vec7()
    for i in range(7):
        u[i] = state[RATES + i, run]
        q[i] = state[POSITION + i, run] + f64(0.5) * duration * u[i]
        state[POSITION + i, run] += duration * u[i]
    rate = u[bodies.FRONT] - u[bodies.REAR]
    across, wheel_rate = vec4(), vec4()
    for w in range(4):
        across[w] = state[ACROSS + w, run]
    s = bodies.stance_of(m.bodies, q, across)
    for w in range(4):
        spin = state[RATES + 7 + w, run]
        slip, turn = bodies.contact(m.bodies, s, w, u, spin)
        tires.advance_tire(m.tire, state, TIRES, run, w, slip, turn, m.bodies.radius * spin, duration)
        wheel_rate[w] = bodies.relative_spin(s, w, u, spin)
        holding = wheel_capacity(m, w, motor_torque(m, state, run, w))
        state[BRAKE + w, run] = held_wheel(m, state[BRAKE + w, run], wheel_rate[w] * duration, holding)
    y = vec29()
    for i in range(29):
        y[i] = state[i, run]
    held = hydraulics.held_of(m.circuit, y, angle, rate, wheel_rate, steer, drive)
    y, stretch, soft = hydraulics.advance_circuit(
        m.circuit, rule, y, state[BRISTLE, run], known, held, angle, duration, m.substeps
    )
    for i in range(29):
        state[i, run] = y[i]
    if m.level == 0 and m.circuit.joint.elastic == 0:
        least, now = m.circuit.lines.least, angle + duration * rate
        at = displacement(m.circuit.joint.cylinders, now)
        p_a, p_b = wp.max(y[rows.PORT_A], least), wp.max(y[rows.PORT_B], least)
        limit = joint.capacity(m.circuit.joint, at, now, rate, p_a, p_b) / m.circuit.joint.presliding
        stretch = clipped(stretch + duration * rate, limit)
    state[BRISTLE, run] = stretch
    return soft


# ------------------------------------------------------------------------------------------------------------------ kick
@wp.func
def joint_torque(m: PlantRecord, state: wp.array2d(dtype=f64), run: int, at: Displacement, angle: f64, rate: f64):
    """Torque [N m] on the joint angle at the present state."""
    least = m.circuit.lines.least
    if m.circuit.joint.elastic == 1:
        return joint.series_torque(m.circuit.joint, state[rows.PIN_ANGLE, run], state[rows.PIN_RATE, run], angle, rate)
    p_a, p_b = wp.max(state[rows.PORT_A, run], least), wp.max(state[rows.PORT_B, run], least)
    return joint.cylinder_torque(m.circuit.joint, at, angle, rate, state[BRISTLE, run], p_a, p_b)


@wp.func
def kick(m: PlantRecord, state: wp.array2d(dtype=f64), run: int, duration: f64, evaluations: int):
    """Change the rates under forces at the present places: Heun's method, of two ``evaluations``."""
    q, rates = vec7(), vec11()
    for i in range(7):
        q[i] = state[POSITION + i, run]
    for i in range(11):
        rates[i] = state[RATES + i, run]
    b = m.bodies
    s = bodies.leaning(b, q)
    factor = bodies.mass_factor(b, q)
    fixed = bodies.weighed(
        b.rear, bodies.REAR, b.gravity, q, bodies.weighed(b.front, bodies.FRONT, b.gravity, q, vec7())
    )
    angle = q[bodies.FRONT] - q[bodies.REAR]
    at = displacement(m.circuit.joint.cylinders, angle)
    total, change = vec11(), vec11()
    for _ in range(evaluations):
        now = rates + duration * change
        u = vec7()
        for i in range(7):
            u[i] = now[i]
        force = bodies.turning(b.rear, bodies.REAR, q, u, bodies.turning(b.front, bodies.FRONT, q, u, fixed))
        for w in range(4):
            spin = now[7 + w]
            load = bodies.wheel_load(b, s, w, q, u)
            slip, turn = bodies.contact(b, s, w, u, spin)
            ahead, aside, swivel = tires.tire_force(m.tire, state, TIRES, run, w, load, slip, turn, b.radius * spin)
            motor = motor_torque(m, state, run, w)
            holding = wheel_capacity(m, w, motor)
            bristle = state[BRAKE + w, run]
            dry = -holding * bristle
            if m.level == 0:
                rate = bodies.relative_spin(s, w, u, spin)
                dry = prandtl_force(bristle, rate, m.brake_stiffness, m.brake_damping, holding)
            force = bodies.lifted(s, w, q, load, force)
            force = bodies.gripped(b, s, w, ahead, aside, swivel, motor + dry, force)
            moment = motor + dry - b.radius * ahead + tires.rolling_moment(m.tire, load, b.radius, spin)
            change[7 + w] = moment / m.spin_inertia
        torque = joint_torque(m, state, run, at, angle, u[bodies.FRONT] - u[bodies.REAR])
        force[bodies.FRONT] += torque
        force[bodies.REAR] -= torque
        accelerations = bodies.solved(factor, force)
        for i in range(7):
            change[i] = accelerations[i]
        total += change
    for i in range(11):
        state[RATES + i, run] = rates[i] + duration / f64(evaluations) * total[i]
    for w in range(4):
        state[ACROSS + w, run] = s.across[w]


# ------------------------------------------------------------------------------------------------------------- main step
@wp.func
def told(signals: wp.array2d(dtype=f64), run: int, tick: f64, instant: f64):
    """Integral [s] up to an ``instant`` [s] of a signal that was zero before its start: ``signals`` (2 K, R) are its
    samples, held over ``tick`` [s], and below them their sums up to each."""
    count = signals.shape[0] // 2
    place = wp.max(instant / tick, f64(0.0))
    whole = wp.min(int(place), count - 1)
    return tick * (signals[count + whole, run] + (place - f64(whole)) * signals[whole, run])


@wp.kernel(enable_backward=False)
def advance(
    first: int, machines: wp.array(dtype=PlantRecord), rule: wp.array2d(dtype=f64), steering: wp.array2d(dtype=f64),
    drive: wp.array2d(dtype=f64), steps: wp.array(dtype=wp.int32), begin: int, count: int, hold: int,
    every: int, evaluations: int, main_step: f64, kept: wp.array(dtype=wp.int32),
    state: wp.array2d(dtype=f64), outputs: wp.array3d(dtype=f64), angles: wp.array2d(dtype=f64),
):  # fmt: skip
    """Advance runs by ``count`` main steps from the one with the number ``begin``, or until their own ``steps`` are done.

    Args:
        first: Number of the first run.
        machines: Constants (R,).
        rule: Coefficients of :func:`~aoro_gym.diagnosis_benchmark.plants.hydraulics.chebyshev`.
        steering: Signal as :func:`told` needs it.
        drive: Signal (K, R).
        steps: Main steps (R,) of each run.
        begin: Main steps done.
        count: Main steps to do.
        hold: Main steps for which a sample of the signals is held.
        every: Main steps between two frames of ``outputs``.
        evaluations: Of the accelerations: 2.
        main_step: [s].
        kept: Rows of the state to be kept as outputs (C,).
        state: (rows, R).
        outputs: (frames, C, R), the first of time 0.
        angles: Joint angle [rad] (main steps + 1, R), or nothing where it has no rows.
    """
    run = first + wp.tid()
    m = machines[run]
    half = f64(0.5) * main_step
    tick = main_step * f64(hold)
    soft = hydraulics.unknown_softness()
    for index in range(begin, wp.min(begin + count, steps[run])):
        state[ENGINE_ANGLE, run] += main_step * state[rows.ENGINE, run]
        sample = wp.min(index // hold, drive.shape[0] - 1)
        for part in range(evaluations):  # two halves of a step with a kick between
            start = main_step * f64(index) + half * f64(part) - m.command_delay
            signal = (told(steering, run, tick, start + half) - told(steering, run, tick, start)) / half
            play, steer = after_play(state[PLAY, run], signal, m.half_play)
            state[PLAY, run] = play
            soft = drift(m, rule, state, run, soft, steer, drive[sample, run], half)
            if part == 0:
                kick(m, state, run, main_step, evaluations)
        done = index + 1
        if angles.shape[0] > 0:
            angles[done, run] = state[POSITION + bodies.FRONT, run] - state[POSITION + bodies.REAR, run]
        if done % every == 0:
            show(m.bodies, state, run)
            for i in range(kept.shape[0]):
                outputs[done // every, i, run] = state[kept[i], run]


@wp.kernel(enable_backward=False)
def _delay(signals: wp.array2d(dtype=f64), age: wp.array(dtype=f64), tick: f64, out: wp.array2d(dtype=f64)):
    i, run = wp.tid()
    half = f64(0.5) * tick
    start = half * f64(i) - age[run]
    out[i, run] = (told(signals, run, tick, start + half) - told(signals, run, tick, start)) / half


def delay(signal: Array, age: Array, step: float) -> Array:
    """Means (2 K, R) over half steps of ``signal`` (K, R), held over steps of ``step`` [s], ``age`` [s] (R,) earlier; it was
    zero before its start."""
    count, runs = signal.shape
    out = wp.zeros((2 * count, runs), dtype=f64, device="cpu")
    inputs = [wp.array(_with_sums(signal), dtype=f64, device="cpu"), wp.array(age, dtype=f64, device="cpu"), step, out]
    wp.launch(_delay, dim=(2 * count, runs), inputs=inputs, device="cpu", block_dim=BLOCK_DIM)
    return np.asarray(out.numpy(), dtype=np.float64)


def _with_sums(signal: Array) -> Array:
    """``signal`` (K, R) and its running sum before each sample, as :func:`told` needs it (2 K, R)."""
    return np.concatenate([signal, np.zeros((1, signal.shape[1])), np.cumsum(signal[:-1], axis=0)])


class Plant:
    """R machines of one level, from rest on.

    Args:
        constants: SI values by key, each (R,); see :func:`aoro_gym.diagnosis_benchmark.plants.constants.constants_of`.
        level: Which laws, see :data:`LEVELS`.
        joint_angle: [rad] at rest (R,).
        main_step: [s].
        substeps: Of the circuits, in half a main step; by default as the laws need it.
        stages: Of the circuits' method.

    Attributes:
        machines: Records (R,) of :data:`PlantRecord`.
        state: (rows, R), see :data:`ROWS`.
    """

    def __init__(
        self,
        constants: Constants,
        level: int = 0,
        *,
        joint_angle: ArrayLike = 0.0,
        main_step: float = MAIN_STEP,
        substeps: int | None = None,
        stages: int = STAGES,
    ):
        if level not in LEVELS:
            raise ValueError(f"level is {level!r}; choose one of: {', '.join(map(str, LEVELS))}")
        self.main_step, self.rule = main_step, hydraulics.chebyshev(stages)
        runs = len(constants["oil.bulk_modulus"])
        angle = np.broadcast_to(np.asarray(joint_angle, dtype=np.float64), (runs,)).copy()
        reach = constants["joint.range"]
        if np.any(np.abs(angle) > reach + 1e-9):
            worst = int(np.argmax(np.abs(angle) - reach))
            raise ValueError(
                f"joint_angle is {angle[worst]:.4f} rad, but the joint of run {worst} reaches only ±{reach[worst]:.4f} rad"
            )
        self.machines = packed(PlantRecord, plant_of(constants, level), runs)
        if substeps is not None:
            self.machines["substeps"] = substeps
        self.state = np.zeros((ROWS, runs))
        state = wp.array(self.state, dtype=f64, device="cpu", copy=False)
        inputs = [
            wp.array(self.machines, dtype=PlantRecord, device="cpu"),
            wp.array(angle, dtype=f64, device="cpu"),
            state,
        ]
        launch(rest, runs, inputs, device="cpu", threads=1)

    @classmethod
    def joined(cls, plants: Sequence["Plant"]) -> "Plant":
        """The runs of ``plants``, stepped as those of the first, as one."""
        whole = cls.__new__(cls)
        whole.main_step, whole.rule = plants[0].main_step, plants[0].rule
        whole.machines = np.concatenate([plant.machines for plant in plants]).astype(PlantRecord.numpy_dtype())
        whole.state = np.concatenate([plant.state for plant in plants], axis=1)
        return whole


def simulate(
    plant: Plant,
    commands: Mapping[str, Array],
    *,
    steps: Any = None,
    hold: int = 1,
    keep_every: int = 1,
    channels: tuple[str, ...] = CHANNELS,
    device: str = "cpu",
    threads: int | None = None,
    progress: Callable[[int], Any] | None = None,
) -> dict[str, Array]:
    """Run a plant from rest: outputs (frames, R) by name, the first at time 0, one every ``keep_every`` main steps; where
    that is not all, the joint angle of every main step is beside them as :data:`EVERY_ANGLE`.

    Args:
        plant: At rest; it is used up.
        commands: ``steering_signal`` and, where it is driven, ``drive_signal``, each (K, R).
        steps: Main steps of each run (R,), after which its outputs are zeros; as long as the commands by default.
        hold: Main steps for which a command is held.
        keep_every: Main steps between two frames.
        channels: Names of the outputs.
        device: ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads that share the runs; as many as there are cores by default.
        progress: Called with the number of main steps done.

    Raises:
        FloatingPointError: a run has diverged.
    """
    signal = np.asarray(commands["steering_signal"], dtype=np.float64)
    total, runs = len(signal) * hold, signal.shape[1]
    kept = [OUTPUTS[name] for name in channels]
    outputs = np.zeros((total // keep_every + 1, len(kept), runs))
    outputs[0] = plant.state[kept]
    angles = np.zeros((total + 1 if keep_every > 1 else 0, runs))
    angles[:1] = plant.state[JOINT_ANGLE]

    def moved(array: Any, dtype: Any = f64) -> Any:
        return wp.array(np.ascontiguousarray(array), dtype=dtype, device=device)

    counts = np.full(runs, total) if steps is None else steps
    state, shown, fine = moved(plant.state), moved(outputs), moved(angles)
    fixed = [
        moved(plant.machines, PlantRecord), moved(plant.rule), moved(_with_sums(signal)),
        moved(commands.get("drive_signal", np.zeros((1, runs)))), moved(counts, wp.int32),
    ]  # fmt: skip
    kept_rows = moved(kept, wp.int32)
    for begin in range(0, total, BLOCK):
        varied = [begin, BLOCK, hold, keep_every, 2, plant.main_step, kept_rows, state, shown, fine]
        launch(advance, runs, [*fixed, *varied], device=device, threads=threads)
        if progress is not None:
            wp.synchronize_device(device)
            progress(min(begin + BLOCK, total))
    plant.state[:], outputs, angles = state.numpy(), shown.numpy(), fine.numpy()
    diverged = ~np.isfinite(plant.state).all(axis=0)
    if diverged.any():
        raise FloatingPointError(
            f"run {int(np.argmax(diverged))}: simulation diverged (non-finite state); "
            "raise stages or substeps, or check its constants"
        )
    least = plant.machines["circuit"]["lines"]["least"]
    result = {
        name: np.maximum(outputs[:, i], least) if "pressure" in name else outputs[:, i]
        for i, name in enumerate(channels)
    }
    return result | ({EVERY_ANGLE: angles} if len(angles) else {})
