"""Limits, soft start and a stop that latches."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from aoro_gym.cosimulation.laboratory.coupling import Coupling
from aoro_gym.cosimulation.laboratory.protection import Limits, Phase, Protection
from aoro_gym.twin.driveline import Driveline
from aoro_gym.twin.hub_driven import HubDrivenTwin

REST = np.full((4, 1), 100.0, dtype=np.float32)


def wheels(value: float) -> np.ndarray:
    return np.full((4, 1), value, dtype=np.float32)


def test_soft_start_comes_up_over_its_time() -> None:
    protection = Protection(Limits(soft_start=1.0, acceleration=1e6), REST)
    assert protection.torques(wheels(1100.0), 0.25)[0, 0] == 100.0  # what holds it at rest
    assert protection.torques(wheels(1100.0), 0.25)[0, 0] == pytest.approx(350.0)
    assert protection.setpoints(wheels(2.0), 0.25)[0, 0] == pytest.approx(1.0)
    for _ in range(2):
        protection.torques(wheels(1100.0), 0.25)
    assert protection.phase is Phase.RUNNING
    assert protection.torques(wheels(1100.0), 0.25)[0, 0] == 1100.0
    assert protection.setpoints(wheels(2.0), 0.25)[0, 0] == 2.0


@pytest.mark.parametrize(
    ("rate", "torque", "reason"),
    [(1.0, 5001.0, "5001 N m"), (1.0, np.nan, "torque is not finite"), (5.1, 0.0, "5.1 rad/s"), (np.inf, 0.0, "rate")],
)
def test_what_is_beyond_its_limit_stops(rate: float, torque: float, reason: str) -> None:
    protection = Protection(Limits(torque=5000.0, speed=5.0, soft_start=0.0), REST)
    protection.setpoints(wheels(rate), 1e-3)
    protection.torques(wheels(torque), 1e-3)
    assert protection.phase is Phase.STOPPED
    assert reason in protection.reason


def test_just_within_its_limits_it_runs() -> None:
    protection = Protection(Limits(torque=5000.0, speed=5.0, soft_start=0.0), REST)
    protection.setpoints(wheels(5.0), 1e-3)
    protection.torques(wheels(-5000.0), 1e-3)
    assert protection.phase is Phase.RUNNING


def test_a_stop_brings_set_points_to_rest_and_holds_until_rearmed() -> None:
    protection = Protection(Limits(acceleration=10.0, soft_start=0.0), REST)
    for _ in range(1000):
        protection.setpoints(wheels(3.0), 1e-3)  # 0.3 s to get there
    protection.stop("button")
    protection.stop("another")
    assert protection.reason == "button"
    rates = [protection.setpoints(wheels(3.0), 1e-3)[0, 0] for _ in range(310)]
    assert np.all(np.abs(np.diff(rates)) <= 0.0101)
    assert rates[150] == pytest.approx(1.49, abs=0.01)
    assert protection.at_rest
    protection.rearm(REST)
    assert protection.phase is Phase.RUNNING  # without a soft start at once
    protection.stop("again")
    protection._setpoints += 1.0
    with pytest.raises(ValueError, match="still turn"):
        protection.rearm(REST)


class Recorded(Driveline):
    """A driveline that keeps what it was commanded."""

    told: Mapping[str, Any] = {}

    def set_commands(self, commands: Mapping[str, Any]) -> None:
        self.told = commands
        super().set_commands(commands)


def test_a_stopped_laboratory_is_neutral_then_braked_and_starts_again() -> None:
    twin, driveline = HubDrivenTwin(), Recorded()
    protection = Protection(Limits(soft_start=0.1), twin.hub_torques)
    coupling = Coupling(twin, driveline, protection=protection)
    for _ in range(400):
        coupling.exchange({"drive_signal": 0.6})
    assert protection.phase is Phase.RUNNING
    assert twin.output("speed")[0] > 0.05
    protection.stop("button")
    coupling.exchange({"drive_signal": 0.6})
    moment = float(twin.time[0])
    assert driveline.told["drive_signal"] == 0.0
    assert driveline.told["parking_brake"] == 0.0  # not at speed
    for _ in range(300):
        coupling.exchange({"drive_signal": 0.6})
    assert protection.at_rest
    assert driveline.told["parking_brake"] == 1.0
    assert twin.time[0] == moment  # time stands still for the bodies
    twin.reset()
    driveline.reset(twin.hub_torques)
    protection.rearm(twin.hub_torques)
    for _ in range(300):
        coupling.exchange({"drive_signal": 0.6, "parking_brake": 0.0})
    assert protection.phase is Phase.RUNNING
    assert np.all(twin.wheel_rates > 0.0)


def test_limits_are_checked() -> None:
    with pytest.raises(ValueError, match=r"limits\.torque"):
        Limits(torque=0.0)
    with pytest.raises(ValueError, match=r"limits\.soft_start"):
        Limits(soft_start=-1.0)
