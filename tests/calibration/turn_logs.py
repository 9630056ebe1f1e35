"""Logs of turns as a machine's sensors see them."""

import numpy as np

from aoro_gym.twin import Twin

NOISE = {"joint_angle_rad": 5e-4, "pressure_a_bar": 0.3, "pressure_b_bar": 0.3, "pump_pressure_bar": 0.3}


def write_log(path, machine, signal, duration, seed):
    """A turn of ``machine`` as its sensors see it: 100 Hz, white noise."""
    twin = Twin(1, machine=machine)
    twin.reset(joint_angle=-np.sign(signal) * machine.joint.range)
    rest = twin.step({}, 0.6, sample_every=0.01)
    move = twin.step({"steering_signal": signal}, duration, sample_every=0.01)
    assert rest is not None and move is not None
    rng = np.random.default_rng(seed)
    time = np.concatenate([rest.time, move.time])
    # a sample shows what the commands before it have done; the command of a row holds from that row on
    command = np.where(time < 0.6 - 1e-9, 0.0, signal)
    columns = {"time_s": time, "steering_signal": command}
    for column, noise in NOISE.items():
        name, unit = (column.removesuffix("_rad"), 1.0) if column.endswith("_rad") else (column[:-4], 1e5)
        exact = np.concatenate([rest[name], move[name]])[:, 0] / unit
        columns[column] = exact + noise * rng.standard_normal(len(time))
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.7g")
    return path
