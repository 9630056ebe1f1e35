"""Effects measured on the plants as on a bench: by experiment, whatever the laws."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.independent import FAMILIES, Run, apply, measure, nominal, record, trace
from aoro_gym.diagnosis_benchmark.independent.catalogue import HUNDRED
from aoro_gym.units import BAR, LITRE_PER_MINUTE
from tests.diagnosis_benchmark.independent.plants import back_and_forth, turn

each_family = pytest.mark.parametrize("family", FAMILIES)


def changed(family, effect, size):
    return apply(effect, family, nominal(family), size)


@each_family
def test_pump_holds_its_limit_at_the_stop(family):
    lower = changed(family, "pump_limit", -80.0)
    for machine in (nominal(family), lower):
        (log,) = trace([turn(family, 1.0, 3.0, machine=machine)], period=0.01)
        assert log["exact_pump"][-20:].mean() / BAR == pytest.approx(measure("pump_limit", family, machine), rel=0.04)


@each_family
def test_flow_follows_the_valves_gain(family):
    logs = trace(
        [turn(family, 1.0, 1.6, machine=one) for one in (nominal(family), changed(family, "valve_gain", -0.2))]
    )
    flows = [log["flow_a"][700:].mean() for log in logs]
    assert flows[1] / flows[0] == pytest.approx(0.8, rel=0.05)
    assert flows[0] / LITRE_PER_MINUTE == pytest.approx(measure("valve_gain", family, nominal(family)), rel=0.12)


@each_family
def test_valve_opens_at_its_dead_band(family):
    command = np.linspace(0.0, 0.35, 350)
    opens = []
    for size in (0.0, 0.06):
        machine = changed(family, "dead_band", size) if size else nominal(family)
        (log,) = trace([Run(family, machine, command, joint_angle=-0.3)], period=0.01)
        opens.append(command[np.argmax(log["flow_a"] > 0.4 * LITRE_PER_MINUTE)])
        assert 0.0 < opens[-1] - machine["dead_left"] < 0.09
    assert opens[1] - opens[0] == pytest.approx(0.06, abs=0.008)


@each_family
def test_return_pressure_rises_by_the_back_pressure(family):
    logs = trace(
        [turn(family, 1.0, 2.0, machine=one) for one in (nominal(family), changed(family, "back_pressure", 6.0))]
    )
    outlet = [log["exact_b"][900:1800].mean() / BAR for log in logs]
    flow = -logs[1]["flow_b"][900:1800].mean() / LITRE_PER_MINUTE
    assert 50.0 < flow < 80.0
    assert outlet[1] - outlet[0] == pytest.approx(6.0 * (flow / 70.0) ** 2, rel=0.35)


@each_family
@pytest.mark.parametrize("effect", ["cylinder_leakage", "cross_port_leakage"])
def test_leakage_passes_between_the_sides(effect, family):
    """With the valve closed, what one side loses to the other is leakage · pressure difference."""
    size = 6.0
    machine = nominal(family) | {"rest_pressure": 80 * BAR, "rest_difference": 50 * BAR, "air": 1e-4}
    leaky = apply(effect, family, machine, size)
    tight, open_ = trace([Run(family, one, np.zeros(60)) for one in (machine, leaky)])
    flows = []
    for log in (tight, open_):
        drop = log["exact_a"] - log["exact_b"]
        lost = -(log["flow_a"] - log["flow_b"]) / 2.0
        flows.append(np.median(lost[50:] / drop[50:]) * HUNDRED / LITRE_PER_MINUTE)
    if effect == "cylinder_leakage" or family != "birch":  # birch leaks at the valve, away from where flow is seen
        assert flows[1] - flows[0] == pytest.approx(size, rel=0.12)  # birch's hoses empty into the cylinder meanwhile


@each_family
def test_delays_of_sensor_and_chain_are_exact(family):
    late = 0.03
    healthy, delayed = record(
        [back_and_forth(family), back_and_forth(family, effects={"sensor_delay": late})], noise=False
    )
    assert np.allclose(delayed["joint_angle"][3:], healthy["joint_angle"][:-3], atol=1e-6)
    assert np.array_equal(delayed["pressure_a"], healthy["pressure_a"])
