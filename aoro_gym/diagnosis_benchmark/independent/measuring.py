"""The measuring chain after the filters: gain, zero, engine orders, noise, quantisation. SI units."""

import math
from collections.abc import Mapping

import numpy as np

ORDERS = ((1.0, 1.0), (2.0, 0.6), (3.985, 0.5), (4.32, 0.4))
"""Engine orders on the joint angle and their share: 26.6 Hz, 53.2, 106 (sampled: 6 Hz), 115 (15 Hz)."""
PISTONS = 9.0


def measured(
    exact: np.ndarray, times: np.ndarray, machine: Mapping[str, float], rng: np.random.Generator, noise: bool
) -> dict[str, np.ndarray]:
    """Columns of a log from the filtered signals (K, 7).

    Args:
        exact: Joint angle [rad], pressures a, b, pump, drive forward and return [Pa], engine speed [rad/s].
        times: Of the samples [s].
        machine: Constants of the chain.
        rng: For phases and noise.
        noise: False leaves out engine orders, noise and quantisation.
    """
    angle = machine["angle_gain"] * exact[:, 0] + machine["angle_offset"]
    ports = ("a", "b", "pump")
    pressures = [exact[:, 1 + i] + machine[f"pressure_offset_{port}"] for i, port in enumerate(ports)]
    drives = [exact[:, 4], exact[:, 5]]
    speed = exact[:, 6]
    if noise:
        count = len(angle)
        base = machine["engine_speed"]
        for order, share in ORDERS:
            phase = rng.uniform(0.0, 2.0 * math.pi)
            angle = angle + machine["angle_wave"] * share * np.sin(order * base * times + phase)
        angle = angle + machine["angle_noise"] * rng.standard_normal(count)
        angle = np.round(angle / machine["angle_step"]) * machine["angle_step"]
        wave = machine["pressure_wave"] * np.sin(PISTONS * base * times + rng.uniform(0.0, 2.0 * math.pi))
        pressures = [
            one + share * wave + machine["pressure_noise"] * rng.standard_normal(count)
            for one, share in zip(pressures, (0.3, 0.3, 1.0), strict=True)
        ]
        drives = [one + machine["pressure_noise"] * rng.standard_normal(count) for one in drives]
        step = machine["pressure_step"]
        pressures, drives = ([np.round(one / step) * step for one in some] for some in (pressures, drives))
        speed = np.round(speed / 0.013) * 0.013  # an eighth of a revolution a minute, as engine controllers send it
    return {
        "joint_angle": angle,
        **{f"{name}": one for name, one in zip(("pressure_a", "pressure_b", "pump_pressure"), pressures, strict=True)},
        "drive_forward": drives[0],
        "drive_return": drives[1],
        "engine_speed": speed,
    }
