"""Laws on the device against their closed forms, and against the magnitudes that are measured on the constants."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark.independent import nominal
from aoro_gym.diagnosis_benchmark.independent.common import viscosity
from aoro_gym.diagnosis_benchmark.independent.families import GROUP
from aoro_gym.diagnosis_benchmark.independent.laws import cedar, friction, numbers, oil, tires

vec4d = wp.types.vector(length=4, dtype=wp.float64)
ZERO = wp.float64(0.0)
F64 = wp.float64


def over(function: Any, *arguments: Any) -> np.ndarray:
    """Values of a device function of numbers."""
    table = np.column_stack(np.broadcast_arrays(*arguments)).astype(float)
    count = table.shape[1]

    @wp.kernel(enable_backward=False, module="unique")
    def evaluate(x: wp.array2d(dtype=F64), y: wp.array(dtype=F64)):
        i = wp.tid()
        if wp.static(count == 3):
            y[i] = function(x[i, 0], x[i, 1], x[i, 2])
        if wp.static(count == 4):
            y[i] = function(x[i, 0], x[i, 1], x[i, 2], x[i, 3])
        if wp.static(count == 5):
            y[i] = function(x[i, 0], x[i, 1], x[i, 2], x[i, 3], x[i, 4])

    out = wp.zeros(len(table), dtype=F64, device="cpu")
    wp.launch(evaluate, len(table), [wp.array(table, dtype=F64, device="cpu"), out], device="cpu")
    return out.numpy()


GAUGE = np.array([0.0, 2e5, 1e6, 3e6, 1e7, 2e7])


@pytest.mark.parametrize("family", ["alder", "birch", "cedar"])
def test_bulk_modulus_is_as_measured_on_the_constants(family):
    made = GROUP.family_of(family).derived(nominal(family))
    law, last = {
        "alder": (oil.nykanen, ()),
        "birch": (oil.yu, ("dissolving",)),
        "cedar": (oil.ruan_burton, ("critical_pressure",)),
    }[family]
    liquid = made["liquid"] + made["liquid_slope"] * GAUGE
    got = over(law, GAUGE + 101325.0, liquid, made["air"], made["polytropic"], *(made[name] for name in last))
    assert np.allclose(got, [GROUP.family_of(family).bulk_modulus(made, p) for p in GAUGE], rtol=1e-9)
    assert np.all(np.diff(got) > 0.0)
    assert got[-1] == pytest.approx(liquid[-1], rel=0.02)  # air hardly counts at 200 bar
    assert got[0] < 0.05 * liquid[0]


def test_orifices_are_turbulent_far_out_and_linear_near_nought():
    for law in (numbers.orifice, numbers.mccloy):
        drops = np.array([-4e6, -1e3, 1e-3, 1e3, 4e6])
        flow = over(law, 1e-6, drops, 8e4)
        assert flow[-1] == pytest.approx(1e-6 * 2000.0, rel=1e-3)
        assert flow[3] == pytest.approx(1e-6 * 1e3 / math.sqrt(8e4), rel=1e-2)
        assert np.allclose(flow[:2], -flow[:-3:-1])


def test_friction_settles_on_its_level_and_springs_before():
    for law in (friction.bristle_rate, friction.maxwell_rate, friction.bouc_wen_rate):
        speeds = np.full(1, 0.1)
        rates = over(law, speeds, np.linspace(0.0, 300.0, 4), 300.0, 2e6)
        assert rates[0] == pytest.approx(2e5)  # stiffness times speed
        assert rates[-1] == pytest.approx(0.0, abs=1e-6)
        unloading = over(law, -speeds, np.array([150.0]), 300.0, 2e6)
        assert unloading[0] < -1.9e5


def test_round_holes_open_from_nought_to_one():
    got = over(cedar.holes, np.linspace(0.0, 1.0, 41), 0.1, 0.1, 0.15)
    assert got[0] == 0.0 and got[-1] == pytest.approx(1.0)
    assert np.all(np.diff(got) >= 0.0)


def swivelled(family: str, angle: float) -> float:
    """Torque [N m] of a standing front tire that the device code has swivelled slowly by an angle [rad]."""
    kind = GROUP.structure(family)

    @wp.kernel(enable_backward=False, module="unique")
    def swivel(machines: wp.array(dtype=kind), steps: int, rate: F64, step: F64, out: wp.array(dtype=F64)):
        m = machines[0]
        u = vec4d()
        motion = vec4d(ZERO, ZERO, ZERO, rate)
        for _ in range(steps):
            if wp.static(family == "alder"):
                a = tires.relaxation_tire(m, motion, m.load_front, u[0], u[1], u[2])
                for i in range(3):
                    u[i] = u[i] + step * a[3 + i]
                out[0] = a[2]
            if wp.static(family == "birch"):
                b = tires.carpet_tire(m, motion, m.load_front, u)
                for i in range(4):
                    u[i] = u[i] + step * b[3 + i]
                out[0] = b[2]
            if wp.static(family == "cedar"):
                c = tires.lugre_tire(m, motion, m.load_front, u[0], u[1], u[2])
                for i in range(3):
                    u[i] = u[i] + step * c[3 + i]
                out[0] = c[2]

    out = wp.zeros(1, dtype=F64, device="cpu")
    machines = wp.array(GROUP.pack(family, [nominal(family)]), dtype=kind, device="cpu")
    steps, rate = 20000, 1e-3
    wp.launch(swivel, 1, [machines, steps, rate, angle / rate / steps, out], device="cpu")
    return -float(out.numpy()[0])


@pytest.mark.parametrize("family", ["alder", "birch", "cedar"])
def test_swivel_torque_is_as_measured_on_the_constants(family):
    module = GROUP.family_of(family)
    made = module.derived(nominal(family))
    for degrees in (2.0, 20.0):
        angle = math.radians(degrees)
        assert swivelled(family, angle) == pytest.approx(module.swivel_torque(made, angle), rel=0.02)
    small = 1e-4
    assert module.swivel_torque(made, small) / small == pytest.approx(module.MEASURES["tire_stiffness"](made), rel=0.01)
    assert 1500.0 < module.swivel_torque(made, math.radians(20.0)) < 3300.0  # published formulas: 2.2–3.7 kN m at μ = 1


def test_oil_of_grade_46():
    assert viscosity(40.0) == pytest.approx(46.0)
    assert viscosity(75.0) == pytest.approx(12.0)
    assert 70.0 < viscosity(30.0) < 85.0


def test_every_constant_lies_in_its_range_and_names_its_source():
    for family in ("alder", "birch", "cedar"):
        for name, one in GROUP.family_of(family).TABLE.items():
            assert one.low <= one.nominal <= one.high, name
            assert one.source, name
