"""Which part contradicts what was measured at its boundary: parts of the machine, each between measured signals.

A twin that follows a recording (:mod:`.following`) works between measured boundaries everywhere. What it takes to keep it
there is a balance a part:

- ``mechanics`` (cylinders' friction, joint, wheels and ground, masses, driveline): the measured pressures A and B drive it;
  a torque between the frames is missing;
- ``circuit`` (valve, oil and hoses, cylinders' leakage, play of the joint): the command, the measured motion and the
  measured pump pressure drive it; flows into A and B are missing;
- ``pump`` (and engine): the measured load and the flow that the measured motion takes drive it; a pressure is missing.

A part that does as its laws say lacks nothing, whatever its neighbours do. What cannot be isolated:

- parts between the same boundaries: valve from oil, hoses and leaking pistons; joint from seals, wheels and masses;
- an angle that is read late or by a wrong measure contradicts the pressures in ``mechanics`` and the flows in ``circuit``;
- a play or a soft frame between cylinders and joint takes oil that the joint's angle does not show: ``circuit``;
- a valve that opens late lets the pump sense its load late: ``pump``, too, and now and then more than ``circuit``;
- behind the arrival at a stop, ``mechanics`` cannot be judged, as the stop bears what it must;
- leakage that is small beside the flow of a turn: what shows it is pressure at standstill;
- a return line under high pressure moves the pendulum arms, too, and so shows in ``mechanics``;
- without a pump pressure there is no ``pump``, and a valve that lacks supply is ``circuit``.

The noise of the sensors passes through the balances: a pressure's by its change times the compliance of its volume and by
what its zero does to the flows, the angle's through the leash. Besides, every part may err by a share of its own torque,
flow or pressure, wandering as a rate does in :mod:`.noise`; how large a share, its healthy logs tell. Only that is looked at
in which a share of :data:`SHOWN` would exceed the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from aoro_gym.diagnosis.arrival import arrival_of, bounce
from aoro_gym.diagnosis.following import DRAWN, LACKED, LEASH, LED, LINE, STEPS
from aoro_gym.diagnosis.noise import MERGED, RATE_MEMORY, Floats, Noise, merged
from aoro_gym.diagnosis.problem import START_JITTER, ZEROS, Problem
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import Replay
from aoro_gym.diagnosis.result import Boundary
from aoro_gym.machine import Machine

PARTS: Mapping[str, tuple[str, ...]] = {
    "mechanics": ("cylinders", "joint", "wheels_and_ground", "mass", "driveline"),
    "circuit": ("valve", "oil_and_hoses", "cylinders", "joint"),
    "pump": ("pump", "engine"),
}
"""Components of every part."""
BALANCED = LACKED[:4]
BALANCES: Mapping[str, tuple[str, ...]] = {
    "mechanics": BALANCED[:1], "circuit": BALANCED[1:3], "pump": BALANCED[3:],
}  # fmt: skip
"""Of every part."""
UNITS: Mapping[str, str] = {"mechanics": "N*m", "circuit": "m^3/s", "pump": "Pa"}
"""Of what a part lacks."""
SHOWN = 0.05
"""Share of its own torque, flow or pressure by which a part has to err to be looked at."""
LEAST_ERROR = 0.01
"""Least share by which a part errs: levers, areas and slopes of sensors are hardly known better (a judgement)."""
DEFAULT_ERROR = 0.03
"""The same where no healthy recording tells (a judgement)."""
ENVELOPE = 9
"""Samples over which the size of a torque, flow or pressure is taken."""
VOID = 2e5
"""Pressure [Pa] below which a port may hold a void, for all that a sensor's zero may be off."""
SMOOTH = 5
"""Samples over which a rate is taken."""
FIRST = 10
"""Samples within which a twin finds to what is measured at rest."""
TAIL = 200
"""Ticks after which the leash has forgotten: 40/ω₀."""
LEAST_PROBABILITY_RATIO = 0.05
"""Share of the likeliest component's probability below which one is not to blame, whatever its part contradicts: a wrong
angle, or laws that differ, contradict as well."""
ROUNDING = 1e-6
"""Share of the largest variance that is added to all, so that a covariance has a factor."""


def boundaries(problem: Problem, healthy: Sequence[Recording] = ()) -> tuple[Boundary, ...]:
    """How far each part of the machine contradicts its boundary, the farthest first; none where the ports' pressures were
    not logged.

    Args:
        problem: Recordings, and nuisances around a twin, its centre. What it was told to subtract is left alone.
        healthy: Of the same machine while nothing was wrong. What twins lack under the same commands is subtracted.
    """
    if not {"pressure_a", "pressure_b"} <= set(problem.signals):
        return ()
    points, h = problem.neighbours(problem.centre)
    logs = followed(problem, problem.recordings, points, h)
    healthy_logs = followed(problem, healthy, points[:0], h[:0]) if healthy else []
    prior = problem.precision[: len(points), : len(points)]
    found = []
    for part, balances in BALANCES.items():
        if part != "pump" or "pump_pressure" in problem.signals:
            error = relative_error(healthy_logs, balances) if healthy_logs else DEFAULT_ERROR
            found.append(_boundary_test(part, error, logs, healthy_logs, np.linalg.inv(np.linalg.cholesky(prior)).T))
    excess = [one.contradicts * max(one.energy - one.freedom, 0.0) for one in found]
    whole = sum(excess) or 1.0
    shared = (replace(one, share=part / whole) for one, part in zip(found, excess, strict=True))
    return tuple(sorted(shared, key=lambda one: (-one.share, one.p)))


def faulty_component(parts: Sequence[Boundary], components: Mapping[str, float]) -> str:
    """The component that is to blame: the likeliest of ``components`` that lies in a part which contradicts its boundary;
    the likeliest of all where none does, where what lies there is below :data:`LEAST_PROBABILITY_RATIO`, or where that is
    the sensor, which contradicts all."""
    likeliest = next(iter(components), "")
    suspected = {name for one in parts if one.contradicts for name in one.components}
    if likeliest == "sensor":
        return likeliest
    least = LEAST_PROBABILITY_RATIO * components.get(likeliest, 0.0)
    return next((name for name, share in components.items() if name in suspected and share >= least), likeliest)


def _boundary_test(
    part: str, error: float, logs: Sequence[Followed], healthy: Sequence[Followed], root: Floats
) -> Boundary:
    """A part that errs by a share ``error``, where the machine's nuisances lie as ``root`` (d, d) times standard normals."""
    residuals, spread, blocks = [], [], []
    for index, one in enumerate(logs):
        for name in BALANCES[part]:
            balance = one.balances[name]
            alike = [other.balances[name] for other in healthy if other.signature == one.signature]
            residual = (
                balance.missing - np.mean([other.missing for other in alike], axis=0) if alike else balance.missing
            )
            # noise, clocks, zeros and errors of what is subtracted add to its own
            more = np.sqrt(1.0 + 1.0 / len(alike)) if alike else 1.0
            std = more * np.sqrt(1.0 + error**2 * balance.power)
            own = np.zeros((len(residual), len(logs), balance.own.shape[1]))
            own[:, index] = more * balance.own
            columns = np.column_stack([residual, balance.slopes @ root, own.reshape(len(residual), -1)])
            white = balance.whitened(columns) / std[:, None]
            residuals.append(white[:, 0])
            spread.append(white[:, 1:])
            blocks.append((balance, std))
    all_of, moves = np.concatenate(residuals), np.concatenate(spread)
    # (1 + M Mᵀ)⁻¹ r: what the nuisances M do not explain
    unexplained = all_of - moves @ np.linalg.solve(np.eye(moves.shape[1]) + moves.T @ moves, moves.T @ all_of)
    energy, freedom = float(all_of @ unexplained), len(all_of)
    parts = np.split(unexplained, np.cumsum([len(std) for _, std in blocks])[:-1])
    missing = np.concatenate(
        [balance.estimated(std * mine) for (balance, std), mine in zip(blocks, parts, strict=True)]
    )
    size = np.concatenate([balance.size for balance, _ in blocks])
    rms = [float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0 for values in (missing, size)]
    return Boundary(
        part, PARTS[part], energy, freedom, float(chi2.sf(energy, freedom)), rms[0], rms[1], UNITS[part], error
    )


def relative_error(healthy: Sequence[Followed], names: Sequence[str]) -> float:
    """Share of its own torque, flow or pressure by which a healthy part errs, whose balances have these ``names``: the
    likeliest, as each recording's own clock and zeros may have it."""
    rows = []
    for one in healthy:
        balances = [one.balances[name] for name in names]
        shown = np.concatenate([mine.whitened(np.column_stack([mine.missing, mine.own])) for mine in balances])
        rows.append((np.concatenate([mine.power for mine in balances]), shown))

    def cost(logarithm: float) -> float:
        total = 0.0
        for power, shown in rows:
            variance = 1.0 + np.exp(2.0 * logarithm) * power
            residual, own = np.split(shown / np.sqrt(variance)[:, None], [1], axis=1)
            inner, pull = np.eye(own.shape[1]) + own.T @ own, own.T @ residual[:, 0]
            total += np.sum(np.log(variance)) + np.linalg.slogdet(inner)[1]
            total += residual[:, 0] @ residual[:, 0] - pull @ np.linalg.solve(inner, pull)
        return float(total)

    if not any(len(power) for power, _ in rows):
        return DEFAULT_ERROR
    best: Any = minimize_scalar(cost, bounds=(np.log(LEAST_ERROR), 0.0), method="bounded")
    return float(np.exp(best.x))


# ---- balances ----


class Balance:
    """One balance of one recording, and the part of it in which an error of :data:`SHOWN` would exceed the noise.

    With noise of covariance L Lᵀ and an error of a share α of the size s, wandering as K = s sᵀ exp(−|t − t′|/τ), that part
    is spanned by the eigenvectors of L⁻¹ K L⁻ᵀ whose eigenvalues λ have α² λ > 1.

    Args:
        missing: (F,) SI.
        slopes: Its change (F, d) by a standard deviation of each nuisance of the machine.
        own: The same (F, n) of the recording's clock and of its sensors' zeros.
        noise: Covariance (F // MERGED, F // MERGED) SI² of its merged samples.
        size: (F,) SI of the torque, flow or pressure itself.
        counts: Samples (F,) that are compared.
    """

    def __init__(
        self, missing: Floats, slopes: Floats, own: Floats, noise: Floats, size: Floats, counts: NDArray[np.bool_]
    ):
        self.missing, self.slopes, self.own = missing, slopes, own
        self._samples = np.flatnonzero(_merged_first(counts))
        self.size: Floats = _merged_first(size)[self._samples]
        """Of the samples that are compared."""
        covariance = noise[np.ix_(self._samples, self._samples)]
        covariance[np.diag_indices(len(covariance))] += ROUNDING * np.max(np.diag(covariance), initial=0.0)
        self._factor = cholesky(covariance, lower=True)
        memory = toeplitz(np.exp(-TICK / RATE_MEMORY * np.arange(len(size))))
        wander = merged(merged(size[:, None] * memory * size).T)[np.ix_(self._samples, self._samples)]
        half = solve_triangular(self._factor, wander, lower=True)
        power, axes = np.linalg.eigh(solve_triangular(self._factor, half.T, lower=True))
        clear = power * SHOWN**2 > 1.0
        self._axes = axes[:, clear]
        self.power: Floats = power[clear]
        """λ (m,) of what is shown."""

    def whitened(self, values: Floats) -> Floats:
        """Shown part (m,) or (m, N) of ``values`` (F,) or (F, N), in which the sensors' noise is white."""
        return self._axes.T @ solve_triangular(self._factor, merged(values)[self._samples], lower=True)

    def estimated(self, shown: Floats) -> Floats:
        """What is missing, SI, of the samples that are compared, by its shown part: with an error of :data:`SHOWN` expected
        along with the noise (Wiener)."""
        expected = SHOWN**2 * self.power
        return self._factor @ (self._axes @ (expected / (1.0 + expected) * shown))


def _merged_first(values: NDArray) -> NDArray:
    """First of every :data:`MERGED` samples."""
    return values[: len(values) // MERGED * MERGED : MERGED]


@dataclass(frozen=True)
class Followed:
    """A recording that twins have followed."""

    signature: bytes
    balances: Mapping[str, Balance]


def followed(problem: Problem, recordings: Sequence[Recording], points: Floats, h: Floats) -> list[Followed]:
    """``recordings`` followed by twins at the centre of a problem and at ``points`` (d, u) next to it, ``h`` (d,) standard
    deviations away."""
    signals = len(LED)
    machines = problem.at(np.vstack([np.tile(problem.centre, (1 + signals, 1)), points]))
    centre = problem.at(problem.centre[None])
    # sensors that read too much, one after the other; then those of a clock that is late
    zeros = np.zeros((signals, machines.count))
    zeros[:, 1 : 1 + signals] = np.diag([ZEROS[name] for name in LED])
    tasks = [*(Replay(machines, one) for one in recordings), *(Replay(centre, _delayed(one)) for one in recordings)]
    outputs = problem.simulator.follow(tasks, [zeros] * len(recordings) + [zeros[:, :1]] * len(recordings))
    out = []
    for recording, on_time, late in zip(recordings, outputs, outputs[len(recordings) :], strict=False):
        values = np.concatenate([on_time, late], axis=2).astype(np.float64)
        values, inertia = values[:4], values[4, :, 0]
        shifts = values[:, :, 1:] - values[:, :, :1]
        own = np.concatenate([shifts[:, :, :signals], shifts[:, :, -1:]], axis=2)
        ports = ports_of(centre.machine, recording)
        noises = _noises(recording, problem.noise, own, ports, inertia)
        magnitudes = _magnitudes(recording, ports)
        balances = {
            name: Balance(
                values[k, :, 0],
                shifts[k, :, signals:-1] / h,
                own[k],
                noises[k],
                magnitudes[k],
                _compared(recording, name),
            )
            for k, name in enumerate(BALANCED)
        }
        out.append(Followed(recording.signature, balances))
    return out


def _delayed(recording: Recording) -> Recording:
    """As a clock that is late by a standard deviation has it."""
    moved = {name: values - START_JITTER * np.gradient(values) / TICK for name, values in recording.channels.items()}
    return replace(recording, channels=moved)


def _compared(recording: Recording, balance: str) -> NDArray[np.bool_]:
    """Samples (F,) that are compared: not the bounce and, of the torque, none that the stop bears, too; of a port's flow
    none around a void, whose volume no sensor tells."""
    out = np.ones(recording.ticks + 1, dtype=bool)
    out[:FIRST] = False
    stopped = bounce(arrival_of(recording.channels["joint_angle"], recording.commands[:, 0]))
    out[stopped] = False
    if balance == "torque" and stopped.start is not None:
        out[stopped.start :] = False
    if balance.startswith("flow"):
        pressure = recording.channels[LED[BALANCED.index(balance)]]
        out &= minimum_filter1d(pressure, ENVELOPE) > VOID
    return out


# ---- the machine between its sensors ----


@dataclass(frozen=True)
class Ports:
    """Ports A and B (2, F) in one recording, and the pump's line."""

    displacement: Floats  # [m³/rad] oil that the joint's motion takes
    compliance: Floats  # [m³/Pa]
    line: float  # [m³/Pa]


def ports_of(machine: Machine, recording: Recording) -> Ports:
    """By the cylinders' geometry and the compliance of oil and hoses."""
    steering, angle = machine.steering, recording.channels["joint_angle"]
    cylinder, linkage = steering.cylinder, steering.cylinder.linkage
    bore, annulus = cylinder.bore_area, cylinder.annulus_area
    lever, extension = (
        np.array([np.asarray(of(sign * angle)) for sign in (1.0, -1.0)]) for of in (linkage.lever, linkage.extension)
    )
    fixed = steering.hose_volume + 2.0 * cylinder.dead_volume + annulus * linkage.stroke
    # side A extends the right cylinder, at the angle, and retracts the left one, at minus the angle
    volume = fixed + bore * extension - annulus * extension[::-1]
    displacement = np.array([[1.0], [-1.0]]) * (bore * lever + annulus * lever[::-1])
    modulus = np.asarray(machine.oil.effective_modulus(np.maximum(_pressures(recording)[:2], 0.0)))
    line = steering.pump.line_volume / machine.oil.bulk_modulus + steering.pump.line_compliance
    return Ports(displacement, volume / modulus + steering.hose_compliance, float(line))


def _pressures(recording: Recording) -> Floats:
    """Of A, B and the pump's line (3, F); not logged: zero."""
    none = np.zeros(recording.ticks + 1)
    return np.stack([recording.channels.get(name, none) for name in LED[1:]])


def _magnitudes(recording: Recording, ports: Ports) -> Floats:
    """Of the balances (4, F) SI: the oil's torque beyond that at rest, the flows that move and fill, the pump's pressure
    beyond that at rest."""
    pressures = _pressures(recording)
    excursions = np.abs(pressures - np.mean(pressures[:, : recording.rest], axis=1, keepdims=True))
    rate = np.gradient(uniform_filter1d(recording.channels["joint_angle"], SMOOTH)) / TICK
    rise = np.gradient(uniform_filter1d(pressures[:2], SMOOTH, axis=1), axis=1) / TICK
    torque = np.sum(np.abs(ports.displacement) * excursions[:2], axis=0)
    flows = np.abs(ports.displacement * rate) + np.abs(ports.compliance * rise)
    return maximum_filter1d(np.stack([torque, *flows, excursions[2]]), ENVELOPE, axis=1)


# ---- noise ----


def _noises(
    recording: Recording, noise: Mapping[str, Noise], own: Floats, ports: Ports, inertia: Floats
) -> list[Floats]:
    """Covariance (F // MERGED, F // MERGED) SI² of each balance's merged samples by what sensors' noise does to it, linear.
    ``own`` (4, F, n) begins with what their zeros do; ``inertia`` (F,) is [kg m²]."""
    count = recording.ticks + 1
    acceleration, rate = response(count)
    difference = (np.eye(count) - np.eye(count, k=-1)) / TICK
    # what is drawn is averaged, and the pump's line evens it out
    evens = _lagged(count, LINE) @ _lagged(count, DRAWN) * (LINE / ports.line)
    steering = np.append(recording.commands[:, 0], 0.0)
    through: list[dict[str, Floats]] = [{"joint_angle": inertia[:, None] * acceleration}]
    pump: dict[str, Floats] = {"joint_angle": np.zeros((count, count)), "pump_pressure": np.eye(count)}
    for index, (signal, loaded) in enumerate(zip(LED[1:3], (steering > 0.0, steering < 0.0), strict=True)):
        moves, fills = ports.displacement[index][:, None] * rate, ports.compliance[index][:, None] * difference
        through.append({"joint_angle": moves, signal: fills})
        pump["joint_angle"] -= evens @ (loaded[:, None] * moves)
        pump[signal] = -evens @ (loaded[:, None] * fills)
    sensed = {signal: toeplitz(noise[signal].covariance[:count]) for signal in LED if signal in noise}
    out = []
    for name, mine, zeros in zip(BALANCED, [*through, pump], own, strict=True):
        covariance = np.zeros((count // MERGED, count // MERGED))
        for signal, shift in zip(LED, zeros.T, strict=False):
            if signal in sensed:
                linear = merged(mine[signal]) if signal in mine else np.zeros((count // MERGED, count))
                if signal not in ("joint_angle", name):  # restrictors and seals feel a pressure itself
                    linear += merged(np.diag(shift / ZEROS[signal]))
                covariance += linear @ sensed[signal] @ linear.T
        out.append(covariance)
    return out


def response(count: int) -> tuple[Floats, Floats]:
    """What the leash makes of the angle's noise: acceleration [1/s²] and rate [1/s] (count, count) of every tick, by its
    end, by every sample, of frames that lie free."""
    h = TICK / STEPS
    place = speed = last = 0.0
    kicks, speeds = np.zeros(TAIL), np.zeros(TAIL)
    for tick in range(TAIL):  # from two samples before the one that is one
        for step in range(STEPS):
            place += h * speed
            ahead = catmull_rom(tick - 2 + (step + 1) / STEPS) - place
            kick = LEASH**2 * h * ahead + 2.0 * LEASH * (ahead - last)
            speed, last = speed + kick, ahead
            kicks[tick] += kick / TICK
            speeds[tick] += speed / STEPS
    return _by_sample(kicks, count), _by_sample(speeds, count)


def catmull_rom(distance: float) -> float:
    """Weight of a sample so many samples away, as twins are led."""
    x = abs(distance)
    if x < 1.0:
        return 1.0 + x * x * (1.5 * x - 2.5)
    return 2.0 + x * (-4.0 + x * (2.5 - 0.5 * x)) if x < 2.0 else 0.0


def _by_sample(response: Floats, count: int) -> Floats:
    """Matrix (count, count) of a response that begins with the tick that ends a sample before its cause."""
    whole = np.zeros(max(count, len(response)) + 1)
    whole[: len(response)] = response
    return toeplitz(whole[1 : count + 1], np.r_[whole[1], whole[0], np.zeros(count)][:count])


def _lagged(count: int, time: float) -> Floats:
    """First-order lag (count, count) of ticks, with a time constant [s]."""
    return toeplitz(-np.diff(np.exp(-TICK / time * np.arange(count + 1))), np.zeros(count))
