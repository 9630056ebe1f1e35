"""A machine of your own: change a parameter, write it to a file, and see what it does to a turn.

You learn how parameters are named, how a machine file is written and read, and how a whole range of values is tried at once.
"""

import numpy as np

from aoro_gym import Machine, Twin

key = "steering.valve.nominal_flow_left"
aoro = Machine.load("aoro")
entry = aoro.entries[key]
print(f"{key} = {entry.value:.1f} {entry.unit}, plausible from {entry.range[0]:.0f} to {entry.range[1]:.0f}")

mine = aoro.set({key: 1.03 * entry.value}, source="measured on our test stand")
mine.save("mine.toml", base="aoro")  # holds what differs; give it to any command: --machine mine.toml
assert Machine.load("mine.toml").entries[key].value == mine.entries[key].value

factors = np.linspace(0.7, 1.0, 4)
twin = Twin(num_twins=len(factors), machine=aoro.scale({key: factors}, check_ranges=False))
twin.reset(joint_angle=-0.5)
trace = twin.step({"steering_signal": 1.0}, duration=3.0, sample_every=1e-3)
times = trace.time[np.argmax(trace["joint_angle"] > 0.5, axis=0)]
for factor, time in zip(factors, times, strict=True):
    print(f"{100.0 * factor:3.0f} % of the flow: from -0.5 to 0.5 rad in {time:.2f} s")
