"""A log of a machine with a hidden fault: which fault shows in it?

You learn how a log is written and read, how one launch repeats it with seventeen sizes of a fault, and the idea of a
diagnosis: the fault that leaves least of the gap between log and twin. ``aoro-gym diagnose`` does it in earnest: all
effects and pairs of them, machines that are not known exactly, and how sure the answer is.
"""

from pathlib import Path

import numpy as np

from aoro_gym import Machine, Twin
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.recording.logs import TICK, Log, read_log
from aoro_gym.simulation.log import log_columns, write_log
from aoro_gym.simulation.manoeuvres import run, standing_turn

TRIED = ("spool_lag", "valve_gain", "seal_friction", "joint_friction", "hose_compliance", "entrained_air")
COMPARED = ("joint_angle", "pressure_a", "pressure_b")


def replay(machine: Machine, log: Log) -> dict[str, np.ndarray]:
    """Channels (samples - 1, machines) of twins under the commands of a log; the first sample is their start."""
    twin = Twin(num_twins=machine.num_variants, machine=machine)
    reach = float(machine.joint.range)
    twin.reset(joint_angle=np.clip(log.start_angle, -reach, reach))  # the sensor's noise may show more than the stop
    rows = []
    for signal in log.commands["steering_signal"]:
        twin.step({"steering_signal": signal}, duration=TICK)
        rows.append({name: twin.output(name).copy() for name in COMPARED})
    return {name: np.stack([row[name] for row in rows]) for name in COMPARED}


def gap(machine: Machine, log: Log) -> np.ndarray:
    """Root mean square difference of each machine from the log, over the noise that its standstill shows."""
    found = replay(machine, log)
    parts = []
    for name in COMPARED:
        measured = log.channels[name]
        error = found[name] - measured[1:, None]
        error -= error[: log.rest - 1].mean(axis=0)  # sensors have a zero of their own
        parts.append((error / measured[: log.rest].std()) ** 2)
    return np.sqrt(np.mean(parts, axis=(0, 1)))


healthy = Machine.load("aoro")
faulty = EFFECTS["spool_lag"].apply(healthy, 0.03)  # hidden: the spool is 30 ms slower than it was
turn = standing_turn(direction=+1, signal=0.75, joint_range=float(healthy.joint.range), duration=2.0)
recording = run(Twin(machine=faulty), turn)
write_log(Path("log.csv"), log_columns(recording.time, recording.channels, rng=np.random.default_rng(1)))

log = read_log(Path("log.csv"))
least = {"nothing": gap(healthy, log)[0]}
print(f"{'nothing':18} leaves a gap of {least['nothing']:6.2f} times the noise")
for name in TRIED:
    size = EFFECTS[name].magnitudes[0]
    sizes = np.linspace(size.low, size.high, 17)
    gaps = gap(EFFECTS[name].apply(healthy, sizes), log)
    best = gaps.argmin()
    least[name] = gaps[best]
    print(
        f"{name:18} leaves a gap of {gaps[best]:6.2f} times the noise, at {size.name} = {sizes[best]:.3g} {size.unit}"
    )
print("the fault that shows:", min(least, key=least.__getitem__))
