"""What an effect does to a plant with the twin's laws is what the twin's own effect does, at its best magnitude."""

from itertools import product

import numpy as np
import pytest

from aoro_gym import Machine, Twin
from aoro_gym.diagnosis.axes import axes_of
from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.effects import EFFECTS as OF_PLANTS
from aoro_gym.diagnosis_benchmark.plants.effects import with_effects
from aoro_gym.diagnosis_benchmark.plants.plant import MAIN_STEP, Plant, simulate
from aoro_gym.effects.catalogue import EFFECTS

pytestmark = pytest.mark.slow

CHANNELS = {"joint_angle": np.radians(0.03), "pressure_a": 0.5e5, "pressure_b": 0.5e5, "pump_pressure": 0.5e5}
"""Noise of the sensors."""
TICK, START = 0.01, -0.3
STEERING = np.repeat([0.0, 1.0, -0.5, 0.0], [30, 80, 70, 50])
SEVERITY = 0.6

LAWS = {  # whose laws are alike, and which a turn and its reversal show
    "pump_response", "pump_limit", "spool_lag", "spool_rate", "dead_band", "valve_gain", "compensator_lag",
    "compensator_opening", "back_pressure", "oil_temperature", "oil_bulk_modulus", "hose_compliance",
    "cylinder_leakage", "cross_port_leakage", "seal_friction", "joint_friction", "joint_backlash", "frame_compliance",
    "driveline_resistance", "soft_ground",
}  # fmt: skip


@pytest.fixture(scope="module")
def shipped():
    return Machine.load("aoro")


@pytest.fixture(scope="module")
def of_plants(shipped):
    """Logs (ticks, channels) in standard deviations of noise, by effect; "" has none."""
    names = sorted(LAWS)
    constants = constants_of([shipped.entries] * (len(names) + 1))
    nominal = constants_of([shipped.entries])
    magnitudes = {}
    for index, name in enumerate(names):
        effect = OF_PLANTS[name]
        near, far = sorted((effect.low, effect.high), key=abs) if effect.low > 0.0 else (0.0, effect.low)
        size = near + SEVERITY * (far - near)
        whole = np.asarray(effect.measure(nominal, 0))
        magnitudes[name] = np.zeros((*whole.shape[:-1], len(names) + 1))
        magnitudes[name][..., index] = size * (whole if effect.relative else np.ones_like(whole))[..., 0]
    plant = Plant(with_effects(constants, magnitudes, 0), 0, joint_angle=np.full(len(names) + 1, START))
    held = round(TICK / MAIN_STEP)
    signal = np.repeat(STEERING, held)[:, None] * np.ones(len(names) + 1)
    out = simulate(plant, {"steering_signal": signal}, keep_every=held, channels=tuple(CHANNELS))
    logs = np.stack([out[name][1:] / std for name, std in CHANNELS.items()], axis=1)
    return {name: logs[:, :, index] for index, name in enumerate([*names, ""])}


def of_twins(machine, count):
    """The same (ticks, channels, N)."""
    twin = Twin(count, machine=machine)
    twin.reset(joint_angle=np.full(count, START))
    traces = [twin.step({"steering_signal": signal}, TICK, sample_every=TICK) for signal in STEERING]
    return np.stack([np.concatenate([t[name] for t in traces if t]) / std for name, std in CHANNELS.items()], axis=1)


@pytest.fixture(scope="module")
def healthy(shipped):
    return of_twins(shipped, 1)


@pytest.mark.parametrize("name", sorted(LAWS))
def test_a_plant_s_effect_is_the_twin_s(name, of_plants, healthy, shipped):
    """At the best magnitude, to a four-hundredth of its range or nearer, no more than 6 % of what the effect does is left
    (root mean square): without any effect the two part by half a standard deviation of noise."""
    axes = axes_of(EFFECTS[name])
    effect = of_plants[name] - of_plants[""]

    def left(places):
        """Share (N,) of the effect that the twin's leaves at ``places`` (N, axes)."""
        values = [a.value(z) for a, z in zip(axes, places.T, strict=True)]
        shown = of_twins(EFFECTS[name].apply(shipped, *values), len(places)) - healthy
        return np.sqrt(np.mean((effect[:, :, None] - shown) ** 2, axis=(0, 1)) / np.mean(effect**2))

    count = 31 if len(axes) == 1 else 16
    places = np.array(list(product(np.linspace(0.0, 1.0, count), repeat=len(axes))))
    best = places[np.nanargmin(left(places))]
    near = np.array(list(product(np.linspace(-1.0, 1.0, count) / (count - 1), repeat=len(axes))))
    shares = left(np.clip(best + near, 0.0, 1.0))
    assert np.nanmin(shares) < 0.06
