"""Calibrate a machine file to logs: which parameters do three turns tell, and how surely?

You learn how logs become a machine file, which parameters they identify with which interval, and what a verdict says. The
logs come from a machine whose spool and pump are slower than the data sheet says; yours come from your machine's recorder.
``aoro-gym calibrate --logs`` searches all uncertain parameters, makes an ensemble, and goes on after a kill.
"""

from pathlib import Path

import numpy as np

from aoro_gym import Machine, Twin
from aoro_gym.calibration.logs import calibrate_logs
from aoro_gym.simulation.log import log_columns, write_log
from aoro_gym.simulation.manoeuvres import run, standing_turn

HIDDEN = {"steering.valve.spool_time_constant": 0.035, "steering.valve.nominal_drop_in_left": 8.5}  # [s], [bar]
TURNS = ((+1, 1.0), (-1, 1.0), (+1, 0.6))  # direction, share of the steering signal

start = Machine.load("aoro_datasheet")
real, reach = start.set(HIDDEN), float(start.joint.range)
logs = []
for number, (direction, signal) in enumerate(TURNS):
    turn = standing_turn(direction=direction, signal=signal, joint_range=reach, duration=2.0)
    recording = run(Twin(machine=real), turn)
    columns = log_columns(recording.time, recording.channels, rng=np.random.default_rng(number))
    logs.append(Path(f"turn{number}.csv"))
    write_log(logs[-1], columns)

found = calibrate_logs(start, logs, keys=list(HIDDEN), starts=1, population=8)
parameters = {row["key"]: row for row in found.report["parameters"]}
print(f"{'parameter':38} {'data sheet':>10} {'found':>8} {'95 % interval':>18} {'hidden':>8}")
for key, value in HIDDEN.items():
    row = parameters[key]
    interval = f"{row['low95']:.4g} to {row['high95']:.4g}"
    print(f"{key:38} {start.entries[key].value:10.4g} {row['value']:8.4g} {interval:>18} {value:8.4g}")
print("the machine does what the logs say:", found.report["verdict"]["fits"])
found.machine.save("calibrated.toml")
