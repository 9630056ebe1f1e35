"""What is drawn stays within its range, differs from episode to episode and reaches the twins."""

from typing import Any

import numpy as np
import pytest

from aoro_gym.envs.core.randomisation import Randomisation
from aoro_gym.envs.turning.config import MILD
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.twin.records import pack

KEY = "steering.valve.spool_time_constant"


def generators(count, seed=0):
    return [np.random.default_rng(seed + i) for i in range(count)]


def test_draws_fill_their_ranges():
    randomisation = Randomisation(
        machine={"joint.friction_torque": (100.0, 300.0)}, machine_scale={KEY: (0.5, 2.0)}, ground_friction=(0.5, 1.0)
    )
    draws = randomisation.draw(generators(400))
    for values, (low, high) in (
        (draws.machine["joint.friction_torque"], (100.0, 300.0)),
        (draws.machine_scale[KEY], (0.5, 2.0)),
        (draws.ground_friction, (0.5, 1.0)),
        (draws.sensor_noise, (1.0, 1.0)),
        (draws.joint_angle, (-1.0, 1.0)),
    ):
        assert values.shape == (400,)
        assert values.min() >= low and values.max() <= high
        # the extremes of 400 uniform draws miss an end by more than 3 % once in 200,000 times
        assert values.max() - values.min() >= 0.94 * (high - low)


def test_draws_reach_the_machine(machine):
    randomisation = Randomisation(
        machine={"joint.friction_torque": (150.0, 300.0)}, machine_scale={KEY: (0.5, 2.0)}, ground_friction=(0.5, 0.9)
    )
    draws = randomisation.draw(generators(5))
    drawn = draws.apply(machine)
    np.testing.assert_allclose(drawn.joint.friction_torque, draws.machine["joint.friction_torque"])
    np.testing.assert_allclose(drawn.value(KEY), draws.machine_scale[KEY] * machine.value(KEY), rtol=1e-12)
    for key in ("tire.friction_coulomb", "tire.friction_static"):
        np.testing.assert_allclose(drawn.value(key), draws.ground_friction * machine.value(key), rtol=1e-12)


def test_nothing_drawn_leaves_the_machine_alone(machine):
    assert not Randomisation().varies_machine
    assert Randomisation().draw(generators(3)).apply(machine) is machine


def test_every_episode_gets_another_machine():
    env = TurningVectorEnv(3, randomisation=MILD, max_episode_steps=2, autoreset_mode="SameStep")
    env.reset(seed=0)
    step = np.zeros((3, 1), dtype=np.float32)
    records: list[Any] = [env.twin._machines.numpy().copy()]
    for _ in range(2):
        env.step(step)
    records.append(env.twin._machines.numpy().copy())
    taus = np.concatenate([record["steering"]["valve_spool_time_constant"] for record in records])
    assert len(np.unique(taus)) == 6
    env.reset(seed=0)
    np.testing.assert_array_equal(env.twin._machines.numpy(), records[0])


def test_machine_of_a_sub_environment_does_not_depend_on_its_neighbours():
    many, one = TurningVectorEnv(4, randomisation=MILD), TurningVectorEnv(1, randomisation=MILD)
    many.reset(seed=[1, 2, 3, 4])
    one.reset(seed=3)
    assert many.twin._machines.numpy()[2] == one.twin._machines.numpy()[0]


def test_variants_are_picked(machine):
    batched = machine.set({"joint.friction_torque": np.array([100.0, 200.0, 300.0])})
    picked = batched.variants([2, 0])
    np.testing.assert_array_equal(picked.joint.friction_torque, [300.0, 100.0])
    np.testing.assert_array_equal(pack(picked), pack(batched)[[2, 0]])
    assert machine.variants([0]) is machine


def test_mild_randomisation_stays_near_the_machine(machine):
    for key, (low, high) in MILD.machine_scale.items():
        assert key in machine.entries
        assert 0.5 <= low < 1.0 < high <= 2.0
    MILD.draw(generators(200)).apply(machine)  # a machine in every case


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"machine": {"valve.colour": (0.0, 1.0)}}, "randomisation.machine has the unknown parameter 'valve.colour'"),
        ({"machine": {KEY: (2.0, 1.0)}}, "is \\(2, 1\\), but must be finite with"),
        ({"machine": {KEY: 1.0}}, "is 1.0, but must be a pair"),
        ({"machine_scale": {KEY: (-1.0, 1.0)}}, "but must be finite with 0 ≤ low ≤ high"),
        ({"machine": {KEY: (0.0, 1.0)}, "machine_scale": {KEY: (1.0, 1.0)}}, f"both have {KEY}"),
        ({"ground_friction": (0.0, 1.0)}, "randomisation.ground_friction is \\(0, 1\\)"),
        ({"sensor_noise": (-1.0, 1.0)}, "randomisation.sensor_noise is \\(-1, 1\\)"),
        ({"joint_angle": (-2.0, 1.0)}, "randomisation.joint_angle is \\(-2, 1\\)"),
        ({"joint_angle": (0.0, np.nan)}, "randomisation.joint_angle is \\(0, nan\\)"),
    ],
)
def test_wrong_ranges_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Randomisation(**arguments)


def test_machines_that_cannot_be_are_named():
    env = TurningVectorEnv(1, randomisation=Randomisation(machine_scale={"steering.cylinder.rod": (3.0, 3.0)}))
    with pytest.raises(ValueError, match=r"drew an invalid machine: .*steering.cylinder.rod.* narrow that key's range"):
        env.reset()
