"""Energy and momentum of the whole twin, flying freely with every loss switched off, and its order of convergence.

Nothing is left out: bodies, wheels and the oil that is shut in the steering and arm cylinders, which is a spring.
The float64 reference of the bodies measures kinetic energy and momentum.
"""

import numpy as np
import pytest

from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.twin.records import State
from tests.oracles.bodies import BodyModel

HEIGHT = 50.0  # [m] of the flight: no ground is felt
DURATION = 10.0  # [s]

LOSSLESS = {
    "joint.friction_torque": 0.0,
    "joint.presliding_damping": 0.0,
    "arm.presliding_damping": 0.0,
    "driveline.brake.disc_torque": 0.0,
    "driveline.brake.presliding_damping": 0.0,
    "driveline.motor.mechanical_efficiency": 1.0,
    "driveline.motor.leakage": 0.0,
    "driveline.pump.leakage": 0.0,
    "driveline.pump.cross_leakage": 0.0,
    "steering.valve.leakage": 0.0,
    "steering.cylinder.leakage": 0.0,
    "oil.bulk_modulus_slope": 0.0,
    **{
        f"{section}.cylinder.{key}": 0.0
        for section in ("steering", "arm")
        for key in ("seal_preload", "seal_pressure_coefficient", "seal_viscous")
    },
}


@pytest.fixture(scope="module")
def machine():
    # a vanishing motor displacement leaves the wheels free
    return Machine.load("aoro_datasheet").set(LOSSLESS, si=True).set({"driveline.motor.displacement": 1e-9})


def fly(machine, main_step, duration, samples):
    """States (rows, samples + 1) of one tumbling twin, without gravity, every ``duration / samples`` seconds."""
    twin = Twin(1, machine=machine, gravity=0.0, main_step=main_step, substeps=round(main_step / 1e-3 * 30))
    twin.reset(joint_angle=0.2)
    state = twin.state.numpy()
    state[State.Z] = HEIGHT
    for row, value in zip(("VX", "VY", "VZ", "WX", "WY", "WZ"), (0.3, -0.2, 0.4, 0.5, 0.3, 1.0), strict=True):
        state[State[row]] = value
    # the joint and the arms bounce on their oil
    state[State.JOINT_RATE : State.ARM_RATE_RR + 1] = 0.1
    state[State.SPIN_FL : State.SPIN_RR + 1, 0] = (8.0, -4.0, 6.0, 3.0)
    # oil preloaded so that both sides pull alike, far from voids and reliefs
    state[State.PORT_A : State.PORT_B + 1] = 60e5
    bore, annulus = machine.arm.cylinder.bore_area, machine.arm.cylinder.annulus_area
    state[State.ARM_ROD_FL : State.ARM_ROD_RR + 1] = 120e5
    state[State.ARM_BORE_FL : State.ARM_BORE_RR + 1] = 120e5 * annulus / bore
    twin.state.assign(state)
    states = [twin.state.numpy()[:, 0].copy()]
    for _ in range(samples):
        twin.step({}, duration / samples)
        states.append(twin.state.numpy()[:, 0].copy())
    assert twin.diverged == []
    return np.array(states, dtype=np.float64).T


def generalised(states):
    """Coordinates (16, K) and velocities (15, K) in the reference's order, from state rows (rows, K)."""
    rows = [State[n] for n in ("X", "Y", "Z", "QW", "QX", "QY", "QZ", "JOINT")]
    q = np.concatenate([states[rows], states[State.ARM_FL : State.WHEEL_RR + 1]])
    v = states[State.VX : State.SPIN_RR + 1].copy()
    theta, theta_dot, arm_rate = q[7], v[6], v[7:11]
    front_y = v[4]
    rear_y = np.sin(theta) * v[3] + np.cos(theta) * v[4]
    v[11:15] -= [front_y, front_y, rear_y, rear_y]
    v[11:15] += arm_rate * np.array([1.0, 1.0, -1.0, -1.0])[:, None]
    assert theta_dot.shape == theta.shape
    return q, v


def chamber_energy(pressure, volume, walls, modulus):
    """Work [J] to bring a shut chamber's oil from 0 to ``pressure``, at the chamber's present volume.

    ṗ = −V̇/(V/β + c) gives p = −β ln((V + βc)/(V₀ + βc)), so the stored work −∫p dV from V₀ is
    β (W − W e^{p/β} + W e^{p/β} p/β) ... written with W = V + βc and W₀ = W e^{p/β}.
    """
    present = volume + modulus * walls
    start = present * np.exp(pressure / modulus)
    return modulus * (start - present) - pressure * present


def oil_energy(machine, states):
    """Energy [J] (K,) of the oil shut in the steering and arm cylinders."""
    beta = machine.oil.bulk_modulus
    st, arm = machine.steering, machine.arm
    right = st.cylinder.linkage.extension(states[State.JOINT])
    left = st.cylinder.linkage.extension(-states[State.JOINT])
    stroke = st.cylinder.stroke
    fixed = st.hose_volume + 2 * st.cylinder.dead_volume
    total = np.zeros(states.shape[1])
    for row, out, back in ((State.PORT_A, right, left), (State.PORT_B, left, right)):
        volume = fixed + st.cylinder.bore_area * out + st.cylinder.annulus_area * (stroke - back)
        total += chamber_energy(states[row], volume, st.hose_compliance, beta)
    for wheel in range(4):
        extension = arm.cylinder.linkage.extension(-states[State.ARM_FL + wheel])
        fixed = arm.hose_volume + arm.cylinder.dead_volume
        bore = fixed + arm.cylinder.bore_area * extension
        rod = fixed + arm.cylinder.annulus_area * (arm.cylinder.stroke - extension)
        total += chamber_energy(states[State.ARM_BORE_FL + wheel], bore, arm.hose_compliance, beta)
        total += chamber_energy(states[State.ARM_ROD_FL + wheel], rod, arm.hose_compliance, beta)
    return total


def test_chamber_energy_is_the_integral_of_pressure():
    """The closed form against quadrature of −p dV along the compression law."""
    beta, walls, start, end = 1.4e9, 2e-13, 1.1e-3, 1.0e-3
    volumes = np.linspace(start, end, 20001)
    pressures = -beta * np.log((volumes + beta * walls) / (start + beta * walls))
    work = -np.trapezoid(pressures, volumes)
    assert chamber_energy(pressures[-1], end, walls, beta) == pytest.approx(work, rel=1e-7)


def test_energy_and_momentum_are_conserved_over_ten_seconds(machine):
    states = fly(machine, 1e-3, DURATION, 100)
    body = BodyModel(machine, gravity=0.0)
    q, v = generalised(states)
    kinetic = body.energy(q, v)
    oil = oil_energy(machine, states)
    assert np.ptp(oil) > 5.0, "the oil should take part"
    # Rounding: 1e4 steps, each of which rounds velocities to 6e-8 relative, random walk 6e-6 of the momentum and
    # twice that of the energy. Discretisation: momentum errors of a second-order scheme at ω ≤ 1.2 rad/s are
    # (ωh)²/12 ≈ 1e-7 a radian turned, about 1e-6 in all; the arms on their oil (ω ≈ 150 rad/s) change phase only.
    linear = body.linear_momentum(q, v)
    angular = body.angular_momentum(q, v, about=body.center_of_mass(q))
    for momentum in (linear, angular):
        drift = np.linalg.norm(momentum - momentum[:, :1], axis=0).max() / np.linalg.norm(momentum[:, 0])
        assert drift < 1e-4
    energy = kinetic + oil
    assert np.abs(energy - energy[0]).max() < 2e-4 * kinetic[0]


def test_second_order_in_the_main_step(machine):
    """Joint, arm angles and attitude after one second against a step of 0.1 ms: halving the step quarters the error."""
    rows = [State[n] for n in ("QX", "QY", "QZ", "QW", "JOINT", "ARM_FL", "ARM_FR", "ARM_RL", "ARM_RR")]
    fine = fly(machine, 1e-4, 1.0, 1)[rows, -1]
    errors = [np.linalg.norm(fly(machine, h, 1.0, 1)[rows, -1] - fine) for h in (2e-3, 1e-3)]
    order = np.log2(errors[0] / errors[1])
    assert 1.8 < order < 2.6, f"errors {errors}, order {order:.2f}"
