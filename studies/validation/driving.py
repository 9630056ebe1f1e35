"""Driving, shifting, braking, climbing and lifting of the default machine beside closed forms and ODEs written apart.

The twin's time courses are held against :mod:`tests.oracles.straight`, its steady states against closed forms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from aoro_gym.calibration.procedure import rolling_pressure
from aoro_gym.execution.files import written_whole
from aoro_gym.machine import Machine
from aoro_gym.reporting.style import AMBER, BLUE, PLOT_STYLE
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.records import State
from aoro_gym.units import BAR
from tests.oracles.straight import GRAVITY, LAYOUT, SCALE, StraightDrive
from tests.twin.rig import Log, all_wheels, drive

Floats = NDArray[np.float64]

SPEED = 0.75
"""Speed [m/s] that the publication gives the driving pressure at."""
TICK = 0.01
"""Time [s] between two samples of a time course."""
COURSE = 0.05
"""Share of a swing by which a time course may differ from the ODE's, which has no arms that give way. They do so by a tenth
of what the tires do in pitch, and that is a tenth of the drive's give: 0.5 % of its frequency, 0.1 rad after 3 periods."""
STEADY = 5e-4
"""Share of a pressure that is left of settling: 1e-4 m/s² of acceleration take 3 mbar."""


@dataclass(frozen=True)
class Compared:
    """A figure of the twin beside what is expected of it."""

    what: str
    unit: str
    twin: float
    expected: float
    bound: float
    """By which they may differ, in the unit."""
    published: float | None = None

    @property
    def met(self) -> bool:
        return abs(self.twin - self.expected) <= self.bound


@dataclass(frozen=True, eq=False)
class Course:
    """Two time courses (F,) of the twin and of theory, at instants [s]."""

    name: str
    time: Floats
    twin: tuple[Floats, Floats]
    expected: tuple[Floats, Floats]
    labels: tuple[str, str] = ("speed [m/s]", "pressure over a motor [bar]")


Part = tuple[list[Compared], list[Course]]
"""What a manoeuvre showed."""


def settled(model: StraightDrive, signal: float) -> Floats:
    """The ODE's states in steady driving in first gear."""
    machine, line = model.machine, model.machine.driveline
    rate = signal * line.pump.displacement * machine.engine.set_speed / (4.0 * line.motor.displacement)
    guess = {
        "speed": rate * machine.tire.radius, "wheel_rate_front": rate, "wheel_rate_rear": rate,
        "drive_forward": 35e5, "drive_return": 24e5, "line_front": 34e5, "line_rear": 34e5, "charge": 25e5,
        "drive_swash": signal, "fraction_front": 1.0, "fraction_rear": 1.0, "engine_speed": machine.engine.set_speed,
        "engine_torque": 150.0, "governor": 150.0,
    }  # fmt: skip
    return model.settled(guess, {"drive_signal": signal})


def signal_of(machine: Machine, speed: float) -> float:
    """Drive signal that holds a speed [m/s] on level ground in first gear: speed is flow, less leaks of a few hundredths."""
    tried = 0.65
    reached = dict(zip(LAYOUT, settled(StraightDrive(machine), tried) * SCALE, strict=True))["speed"]
    return tried * speed / float(reached)


def slopes(grades: Sequence[float], friction: float = 1.0) -> Plane:
    """Planes that rise ahead by ``grades`` [°]."""
    rise = np.asarray(grades, dtype=np.float64)
    return Plane(slope_deg=np.abs(rise), direction_deg=np.where(rise < 0.0, 180.0, 0.0), friction=friction)


def course_of(name: str, log: Log, time: Floats, found: Mapping[str, Floats], twin: int = 0) -> Course:
    """Speed and motor pressure of a twin of a log beside those of an ODE."""
    pressure = log.wheels("motor_pressure").mean(axis=1)[:, twin] / BAR
    return Course(name, time, (log["speed"][:, twin], pressure), (found["hinge_speed"], found["motor_pressure"] / BAR))


def run_in(machine: Machine) -> Part:
    """The disc brake takes hold at 0.75 m/s: pressure before and after, in closed form, and on the way."""
    bare = machine.set({"driveline.brake.disc_torque": 0.0}, check_ranges=False)
    commands = {"drive_signal": signal_of(bare, SPEED)}
    before = Twin(1, machine=bare)
    last = drive(before, (60.0, commands), (1.0, {}), sample_every=TICK)
    after = Twin(1, machine=machine)
    after.set_commands(commands)
    after.state.assign(before.state.numpy())
    log = drive(after, (4.0, {}), sample_every=TICK)
    rest = drive(after, (30.0, {}), sample_every=TICK)
    time, found = StraightDrive(machine).run(
        settled(StraightDrive(bare), commands["drive_signal"]), [(4.0, commands)], TICK
    )
    course = course_of("the disc brake takes hold at 0.75 m/s", log, time, found)
    off, on = (float(one.wheels("motor_pressure")[-100:].mean() / BAR) for one in (last, rest))
    less, more = (float(rolling_pressure(machine, brake=brake)[0]) for brake in (False, True))
    own, other = course.twin[1], course.expected[1]
    bound = COURSE * (more - less)
    return [
        Compared("motor pressure at 0.75 m/s without the disc brake", "bar", off, less, STEADY * less, 4.6),
        Compared("motor pressure at 0.75 m/s with it", "bar", on, more, STEADY * more, 12.8),
        Compared("highest pressure after it took hold", "bar", float(own.max()), float(other.max()), bound),
        Compared("its time", "s", float(time[own.argmax()]), float(time[other.argmax()]), 2.0 * TICK),
        Compared("farthest from the ODE within 4 s", "bar", float(np.abs(own - other).max()), 0.0, bound),
    ], [course]


def shifts(machine: Machine) -> Part:
    """Full pump, through all gears and back."""
    gears = (2, 3, 1)
    twin, model = Twin(1, machine=machine), StraightDrive(machine)
    drive(twin, (20.0, {"drive_signal": 1.0}), sample_every=1.0)
    log = drive(twin, *((4.0, {"gear": gear}) for gear in gears), sample_every=TICK)
    time, found = model.run(settled(model, 1.0), [(4.0, {"drive_signal": 1.0, "gear": gear}) for gear in gears], TICK)
    course = course_of("full pump, gears 1, 2, 3, 1", log, time, found)
    compared = []
    for at, gear in enumerate(gears):
        last = slice(400 * at + 300, 400 * at + 400)
        own, other = (float(curve[0][last].mean()) for curve in (course.twin, course.expected))
        compared.append(Compared(f"speed in gear {gear}, 3 to 4 s after the shift", "m/s", own, other, 2e-3 * other))
    own, other = course.twin[1], course.expected[1]
    bound = COURSE * float(np.ptp(other))
    compared.append(Compared("highest pressure of the shifts", "bar", float(own.max()), float(other.max()), bound))
    compared.append(Compared("lowest pressure of the shifts", "bar", float(own.min()), float(other.min()), bound))
    return compared, [course]


GRADES = (-10.0, 0.0, 10.0)
"""Slopes [°] on which it brakes, uphill ahead positive."""


def braking(machine: Machine) -> Part:
    """From half a full pump in first gear the pump goes to zero, as a driver brakes.

    The way is the oil that the pump still gives, less leaks, which are some hundredths: 1 %.
    """
    twin = Twin(len(GRADES), machine=machine, terrain=slopes(GRADES))
    drive(twin, (30.0, {"drive_signal": 0.5}), sample_every=1.0)
    log = drive(twin, (3.0, {"drive_signal": 0.0}), sample_every=TICK)
    compared, drawn = [], []
    for i, grade in enumerate(GRADES):
        model = StraightDrive(machine, np.radians(grade))
        time, found = model.run(settled(model, 0.5), [(3.0, {"drive_signal": 0.0})], TICK)
        course = course_of(f"pump to zero on {grade:+g}°", log, time, found, i)
        way, expected = (float(curve[0].sum() * TICK) for curve in (course.twin, course.expected))
        own, other = course.twin[1], course.expected[1]
        bound = COURSE * float(np.ptp(other))
        compared.append(
            Compared(f"way while the pump goes to zero on {grade:+g}°", "m", way, expected, 1e-2 * expected)
        )
        what = f"lowest motor pressure meanwhile on {grade:+g}°"
        compared.append(Compared(what, "bar", float(own.min()), float(other.min()), bound))
        drawn.append(course)
    return compared, drawn


SLIPPERY, PUSHED = 0.5, 2.0
"""Friction of the ground, as a share of asphalt's, and speed [m/s] at which the machine is set sliding."""


def slid(machine: Machine, grade: float) -> float:
    """Way [m] of a machine that slides on locked wheels until it stands.

    v̇ = −g (cos α (σ₀ z + σ₁ ż + σ₂ v) + sin α), ż = v − σ₀ |v| z/g(v): whatever each wheel bears, all bear the weight.
    """
    tire, slope = machine.tire, np.radians(grade)
    more = tire.friction_static - tire.friction_coulomb

    def motion(t: float, y: Floats) -> list[Any]:
        v, z = float(y[1]), float(y[2])
        grip = SLIPPERY * (tire.friction_coulomb + more * np.exp(-((v / tire.stribeck_velocity) ** 2)))
        bent = v - tire.sigma0_longitudinal * abs(v) * z / grip
        force = tire.sigma0_longitudinal * z + tire.sigma1_longitudinal * bent + tire.sigma2_longitudinal * v
        return [v, -GRAVITY * (np.cos(slope) * force + np.sin(slope)), bent]

    found = solve_ivp(motion, (0.0, 4.0), [0.0, PUSHED, 0.0], method="LSODA", rtol=1e-9, atol=1e-9, max_step=1e-3)
    return float(found.y[0].max())


def sliding(machine: Machine) -> Part:
    """Parked machines that are set sliding on slippery slopes: the way until they stand.

    The push makes the frames heave, and their load with them, by a few hundredths in the mean over a slide: 2 %.
    """
    grades = [0.5 * grade for grade in GRADES]
    twin = Twin(len(grades), machine=machine, terrain=slopes(grades, SLIPPERY))
    drive(twin, (2.0, {"parking_brake": 1.0}), sample_every=1.0)
    start = np.array([twin.output(f"position_{axis}") for axis in "xyz"])
    state = twin.state.numpy()
    state[State.VX] += PUSHED
    twin.state.assign(state)
    log = drive(twin, (4.0, {}), sample_every=TICK)
    way = np.linalg.norm(np.stack([log[f"position_{axis}"] for axis in "xyz"]) - start[:, None], axis=0).max(axis=0)
    compared = []
    for grade, own in zip(grades, way, strict=True):
        other = slid(machine, grade)
        what = f"way of locked wheels from 2 m/s, half the grip, on {grade:+g}°"
        compared.append(Compared(what, "m", float(own), other, 2e-2 * other))
    return compared, []


CLIMBS = (0.0, 5.0, 10.0, 15.0)
"""Slopes [°] that it climbs."""
CLIMB_SIGNAL = 0.5


def climbing(machine: Machine) -> Part:
    """Steady climbing: the pull is the weight's share along the slope, m g sin α, and stands for a drawbar's.

    Pressure over the motors in closed form, (m g sin α r + rolling + discs)/(η ΣD); the engine's power by the balance of
    driveline and friction at the ODE's pressures, and what the standing twin's engine gives beyond that, which pump 2 takes.
    """
    twin = Twin(len(CLIMBS) + 1, machine=machine, terrain=slopes((*CLIMBS, 0.0)))
    drive(twin, (40.0, {"drive_signal": np.array([CLIMB_SIGNAL] * len(CLIMBS) + [0.0])}), sample_every=1.0)
    log = drive(twin, (2.0, {}), sample_every=TICK)
    pressure = log.wheels("motor_pressure").mean(axis=(0, 1)) / BAR
    power = brake_power(machine, log["engine_torque"].mean(axis=0), log["engine_speed"].mean(axis=0))
    line, tire = machine.driveline, machine.tire
    idle = power[-1] - driven_power(machine, 0.0, 0.0)
    compared = []
    for i, grade in enumerate(CLIMBS):
        slope = np.radians(grade)
        pull = machine.mass * GRAVITY * np.sin(slope)
        rolling = tire.rolling_resistance * machine.mass * GRAVITY * np.cos(slope) * tire.radius
        torque = pull * tire.radius + rolling + 4.0 * line.brake.disc_torque
        expected = float(torque / (4.0 * line.motor.mechanical_efficiency * line.motor.displacement) / BAR)
        what = f"pull of {pull / 1e3:.1f} kN (climbs {grade:g}°)"
        compared.append(Compared(f"{what}: motor pressure", "bar", float(pressure[i]), expected, STEADY * expected))
        wanted = 1e-3 * float(driven_power(machine, CLIMB_SIGNAL, slope) + idle)
        compared.append(
            Compared(f"{what}: engine's power", "kW", 1e-3 * float(power[i]), wanted, 2.0 * STEADY * wanted)
        )
    return compared, []


def brake_power(machine: Machine, torque: Any, speed: Any) -> Any:
    """Power [W] that the engine gives to its pumps: less its friction."""
    return (torque - machine.engine.friction_0 - machine.engine.friction_1 * speed) * speed


def driven_power(machine: Machine, signal: float, slope: float) -> float:
    """Power [W] that pump 1 and its charge pump take of the ODE's engine in steady driving up a slope [rad]."""
    model = StraightDrive(machine, slope)
    state = dict(zip(LAYOUT, settled(model, signal) * SCALE, strict=True))
    return float(brake_power(machine, state["engine_torque"], state["engine_speed"]))


LIFT = 0.3
"""Signal of all arms in the step."""


def steady_lift(machine: Machine, load: float) -> tuple[float, float, float]:
    """Rate of extension [m/s] and pressures of bore and rod [bar] of an arm that extends by a steady signal.

    The edge meters Q = Q_nom (u − u_d)/(1 − u_d) into the bore. What leaves the rod passes the load-holding valve, opened by
    (p_rod + R p_bore − p_h)/ramp, and the other edge; the piston carries ``load`` [N] and the seals' friction.
    """
    valve, cylinder = machine.arm.valve, machine.arm.cylinder
    opening = (LIFT - valve.dead_band) / (1.0 - valve.dead_band)
    rate = valve.nominal_flow * opening / cylinder.bore_area
    tank, share = machine.steering.tank_line.back_pressure, cylinder.seal_pressure_coefficient
    sliding = cylinder.seal_preload + cylinder.seal_viscous * rate

    def bore_of(rod: float) -> Any:
        return (load + sliding + (cylinder.annulus_area + share) * rod) / (cylinder.bore_area - share)

    def surplus(rod: float) -> float:
        held = (rod + valve.pilot_ratio * bore_of(rod) - valve.holding_pressure) / valve.holding_ramp
        out = np.clip(held, 0.0, 1.0) * valve.cv * opening * np.sqrt(max(rod - tank, 0.0))
        return float(out - cylinder.annulus_area * rate)

    rod: Any = brentq(surplus, tank, machine.arm.valve.port_relief)
    return float(rate), float(bore_of(rod)) / BAR, float(rod) / BAR


def lifted(machine: Machine, time: Floats, drops: Floats) -> Floats:
    """Height (F,) of the hinge by linear theory, for wheels of the front and rear axle let down by ``drops`` (F, 2) [m].

    A body of mass m and inertia I heaves by z and pitches by θ, nose down, on axles x_i ahead of its centre; at each are two
    tires with k and c, and a half of the mass m_w that moves with the wheels. With w_i = z − x_i θ − d_i and the forces
    F_i = −2 (k w_i + c ẇ_i) its momenta p = m ż − ½ m_w Σ ḋ_i and L = I θ̇ + ½ m_w Σ x_i ḋ_i follow ṗ = Σ F_i and
    L̇ = −Σ x_i F_i.
    """
    body, tire, arm = StraightDrive(machine), machine.tire, machine.arm
    below = 2.0 * (machine.wheel.mass + arm.motor_mass + arm.cog_fraction * arm.mass)
    rates, axles = np.gradient(drops, time, axis=0), body.axles

    def motion(t: float, y: Floats) -> list[float]:
        z, pitch, momentum, spin = y
        drop, rate = (np.array([np.interp(t, time, each) for each in values.T]) for values in (drops, rates))
        rising = (momentum + below * float(rate.sum())) / machine.mass
        turning = (spin - below * float(axles @ rate)) / body.pitch_inertia
        w, w_rate = z - axles * pitch - drop, rising - axles * turning - rate
        force = -2.0 * (tire.stiffness * w + tire.damping * w_rate)
        return [rising, turning, float(force.sum()), -float(axles @ force)]

    found = solve_ivp(motion, (time[0], time[-1]), [0.0] * 4, t_eval=time, rtol=1e-8, atol=1e-8, max_step=2e-3)
    return found.y[0] + body.centre_ahead * found.y[1]


def lifting(machine: Machine) -> Part:
    """A step of all arms' signals: how fast the cylinders extend, against which pressures, and how the frames swing.

    The load is that of the standing machine; over the step the arms' levers change, and pressures may with them.
    """
    twin = Twin(1, machine=machine)
    start = drive(twin, (2.0, {}), sample_every=1.0)
    log = start.then(drive(twin, (1.0, all_wheels("arm", LIFT)), sample_every=1e-3))
    time, angle = log.time - log.time[0], log.wheels("arm_angle")[:, :, 0]
    bore, rod = (log.wheels(f"arm_pressure_{side}")[:, :, 0] for side in ("bore", "rod"))
    cylinder, steady = machine.arm.cylinder, slice(600, None)
    lever = np.asarray(cylinder.linkage.lever(-angle))
    extending = (-np.gradient(angle, time, axis=0) * lever)[steady].mean()
    load = float(bore[0].mean() * cylinder.bore_area - rod[0].mean() * cylinder.annulus_area)
    rate, high, low = steady_lift(machine, load)
    changed = float(np.abs(lever[-1] / lever[0] - 1.0).max())
    drops = -machine.arm.length * np.sin(angle)
    drops = (drops - drops[0]).reshape(-1, 2, 2).mean(axis=2)
    drop = drops.mean(axis=1)
    height = log["position_z"][:, 0] - log["position_z"][0, 0]
    expected = lifted(machine, time, drops)
    swing, other = 1e3 * (height - drop), 1e3 * (expected - drop)
    bound = 1e-2 * float(np.abs(other).max())
    return [
        Compared("rate of extension, step of 30 %", "m/s", float(extending), rate, 5e-3 * rate),
        Compared("pressure of the bores", "bar", float(bore[steady].mean() / BAR), high, changed * high),
        Compared("pressure of the rods", "bar", float(rod[steady].mean() / BAR), low, changed * high),
        Compared("largest lag of the frames behind the wheels", "mm", -float(swing.min()), -float(other.min()), bound),
        Compared("farthest from linear theory within 1 s", "mm", float(np.abs(swing - other).max()), 0.0, bound),
    ], [
        Course(
            "all arms by 30 %", time, (swing, 1e3 * height), (other, 1e3 * expected),
            ("frames less wheels [mm]", "frames [mm]"),
        )
    ]  # fmt: skip


MANOEUVRES: Mapping[str, Callable[[Machine], Part]] = {
    "run_in": run_in, "shifts": shifts, "braking": braking, "sliding": sliding, "climbing": climbing, "lifting": lifting,
}  # fmt: skip
"""All of them, by name."""


def rounded(compared: Compared) -> dict[str, Any]:
    """For JSON: digits beyond a millionth are rounding of single precision."""
    values = {key: float(f"{v:.7g}") if isinstance(v, float) else v for key, v in asdict(compared).items()}
    return values | {"met": compared.met}


def write_courses(courses: Sequence[Course], path: Path) -> None:
    """Draw time courses of the twin over those of theory."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.5, 2.3 * len(courses)), dpi=110, layout="constrained")
        axes = figure.subplots(len(courses), 2, squeeze=False)
        for row, course in zip(axes, courses, strict=True):
            for axis, own, other, label in zip(row, course.twin, course.expected, course.labels, strict=True):
                axis.plot(course.time, other, color=AMBER, lw=3.5, alpha=0.75, label="theory")
                axis.plot(course.time, own, color=BLUE, lw=1.2, label="twin")
                axis.set_title(f"{course.name}: {label}", loc="left", fontsize=10.5, fontweight="bold")
                axis.grid(True)
                axis.spines[["top", "right"]].set_visible(False)
                axis.set_xlim(0.0, course.time[-1])
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        axes[0][0].legend(frameon=False, ncols=2, loc="lower right")
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as temporary:
            figure.savefig(temporary)
