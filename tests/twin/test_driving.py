"""Driving: resistance, gears, the open differential, traction valves, and the books of oil and energy over a shift."""

import numpy as np
import pytest
from scipy.optimize import root

from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS, State
from aoro_gym.twin.twin import Twin
from tests.oracles.bodies import BodyModel
from tests.oracles.hydraulics import check_valve, orifice, relief_valve
from tests.twin.rig import Log, LoopLedger, drive, integral, states

BAR = 1e5
GRAVITY = 9.81
GEARS = {1: (1.0, 1.0), 2: (1.0, 0.5), 3: (0.5, 0.5)}
"""Share of the motors' displacement in front and in rear."""


class Steady:
    """Straight, steady driving as seven algebraic equations: no step, no state, wheels rolling without slip.

    Unknown: wheel rate, both mains, the hoses in front and in rear, charge. The engine holds its set speed.
    """

    def __init__(self, machine, *, swash, gear=1, slope=0.0, closed=()):
        line, tire = machine.driveline, machine.tire
        laminar = machine.oil.laminar_pressure
        speed = machine.engine.set_speed
        shares = np.array([GEARS[gear][0]] * 2 + [GEARS[gear][1]] * 2)
        size = line.motor.displacement * shares
        opening = np.array([0.0 if wheel in closed else 1.0 for wheel in WHEELS])
        load = machine.mass * GRAVITY * np.cos(slope) / 4.0
        pull = machine.mass * GRAVITY * np.sin(slope) * tire.radius

        way = np.sign(swash if swash else -slope)  # it goes

        def equations(x):
            rate, forward, back, charge = x[0], *(x[1:4] * BAR)
            hose = x[4:8] * BAR
            drop = hose - back
            taken = orifice(opening * line.traction.cv, forward - hose, laminar)
            given = size * rate + line.motor.leakage * drop
            pumped = swash * line.pump.displacement * speed - line.pump.cross_leakage * (forward - back)
            checks = [
                check_valve(line.charge.cv_check, charge - p, line.charge.check_crack, laminar) for p in (forward, back)
            ]
            shift = np.clip(np.abs(forward - back) / line.flush.shift_pressure - 1.0, 0.0, 1.0)
            flush = shift * relief_valve(min(forward, back), line.flush.pressure, line.flush.ramp, line.flush.flow)
            flushed = (flush, 0.0) if forward < back else (0.0, flush)
            relief = relief_valve(
                charge, line.charge.relief_pressure, line.charge.relief_ramp, line.charge.relief_flow
            )
            friction = line.brake.disc_torque + (1.0 - line.motor.mechanical_efficiency) * size * np.abs(drop)
            rolling = tire.rolling_resistance * load * tire.radius * np.tanh(rate / 0.05)
            flows = [
                pumped + checks[0] - flushed[0] - line.pump.leakage * forward - taken.sum(),
                -pumped + checks[1] - flushed[1] - line.pump.leakage * back + given.sum(),
                line.charge.displacement * speed - sum(checks) - relief,
                *(taken - given),
            ]
            return [*(np.array(flows) * 6e4), (np.sum(size * drop - way * friction - rolling) - pull) / 1e3]

        torque = 0.25 * pull + way * line.brake.disc_torque
        drop = torque / size.mean() / BAR
        high, low = 25.0 + max(drop, 0.0), 25.0 - min(drop, 0.0)
        rate = swash * line.pump.displacement * speed / size.sum() or 0.01 * way
        found = root(equations, [rate, high, low, 25.0, *[high] * 4], method="lm", tol=1e-14)
        assert np.abs(found.fun).max() < 1e-6, found.message
        self.wheel_rate, self.forward, self.back, self.charge = found.x[0], *(found.x[1:4] * BAR)
        self.motor_pressure = found.x[4:8] * BAR - self.back
        self.speed = self.wheel_rate * tire.radius


def compare(log, case, steady, rel):
    """Last frame of twin ``case`` against the algebra."""
    last = {name: log[name][-1, case] for name in log.rows}
    assert last["speed"] == pytest.approx(steady.speed, rel=rel)
    assert last["drive_pressure_forward"] == pytest.approx(steady.forward, rel=rel)
    assert last["drive_pressure_return"] == pytest.approx(steady.back, rel=rel)
    assert last["charge_pressure"] == pytest.approx(steady.charge, rel=rel)
    for wheel, pressure in zip(WHEELS, steady.motor_pressure, strict=True):
        assert last[f"wheel_rate_{wheel}"] == pytest.approx(steady.wheel_rate, rel=rel)
        assert last[f"motor_pressure_{wheel}"] == pytest.approx(pressure, rel=rel)
